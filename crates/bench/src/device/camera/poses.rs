//! Where the axes stood when a frame was exposed.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use crate::device::{AxisPose, StageState};

/// Tells the poses of focus and e axis over an exposure, from its begin to its end.
pub type PoseSource = Arc<dyn Fn(Instant, Instant) -> (AxisPose, AxisPose) + Send + Sync>;

/// The poses of two stages over an exposure, from their states: settled when an axis has been at rest since `settle`
/// before the exposure began.
#[must_use]
pub fn poses_of_stages(
    focus: (watch::Receiver<StageState>, Duration),
    e: (watch::Receiver<StageState>, Duration),
) -> PoseSource {
    let pose = |(state, settle): &(watch::Receiver<StageState>, Duration), from: Instant| {
        let state = state.borrow();
        AxisPose {
            position: (state.homed && state.connected).then_some(state.position),
            settled: state.at_rest_since.is_some_and(|since| since + *settle <= from),
        }
    };
    Arc::new(move |from, _to| (pose(&focus, from), pose(&e, from)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn an_axis_has_settled_when_it_stood_since_its_time_before_the_exposure() {
        let rest = Instant::now();
        let state = StageState {
            connected: true,
            homed: true,
            position: plenoptics::units::Millimetres(1.5),
            moving: false,
            at_rest_since: Some(rest),
            limit_switch: false,
            fault: None,
        };
        let (focus, e) = (watch::Sender::new(state.clone()), watch::Sender::new(state));
        let ms = Duration::from_millis;
        let poses = poses_of_stages((focus.subscribe(), ms(100)), (e.subscribe(), ms(300)));
        let settled = |from: Instant| {
            let (focus, e) = poses(from, from + ms(50));
            (focus.settled, e.settled)
        };
        assert_eq!(settled(rest + ms(99)), (false, false));
        assert_eq!(settled(rest + ms(100)), (true, false));
        assert_eq!(settled(rest + ms(300)), (true, true));
        // In motion now: whatever stood before may have begun to move during the exposure.
        e.send_modify(|state| (state.moving, state.at_rest_since) = (true, None));
        assert_eq!(settled(rest + ms(900)), (true, false));
        let position = || poses(rest, rest).0.position.map(plenoptics::units::Millimetres::value);
        assert_eq!(position(), Some(1.5));
        // Not homed, or not connected, an axis's position says nothing.
        focus.send_modify(|state| state.homed = false);
        assert_eq!(position(), None);
        focus.send_modify(|state| (state.homed, state.connected) = (true, false));
        assert_eq!(position(), None);
    }
}
