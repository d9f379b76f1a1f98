//! The last two minutes: where the axes stood, what the spacing was and how clear the picture was, for who begins to look.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Service;
use crate::events::{BenchView, MeasurementView};
use crate::reading::Reading;
use bench::device::AxisName;

/// How far back it goes.
const SPAN: Duration = Duration::from_secs(120);
/// Of what comes more closely, the newest is kept: a chart shows no more, and there are 480 of a kind at most.
const APART: Duration = Duration::from_millis(250);
/// A measurement in whole says something of the spacing where no frame has been read for so long.
const UNREAD: Duration = Duration::from_secs(1);

/// Where the axes stood.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PositionsThen {
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// Readback of the focus axis, mm; absent while unknown.
    pub focus_mm: Option<f64>,
    /// Readback of the e axis, mm; absent while unknown.
    pub e_mm: Option<f64>,
}

/// What the spacing of one frame was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpacingThen {
    /// When the frame was taken, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// The spacing, px.
    pub spacing_px: f64,
    /// Its standard uncertainty, px.
    pub spacing_sigma_px: f64,
    /// The spacing wanted, px.
    pub spacing_target_px: f64,
}

/// How clear the picture was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ClarityThen {
    /// When the frame was taken, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// Energy of gradient of the central view, mean per pixel; absent where no view could be made.
    pub eog: Option<f64>,
}

/// The last two minutes, as far as somebody looked; oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RecentView {
    /// The daemon's clock when this was said, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub now: Timestamp,
    /// Whenever the bench's state changed: between two, the axes stood where the former says, or moved to the latter.
    pub positions: Vec<PositionsThen>,
    /// In every frame read, at most four a second; where none was read, in those measured in whole. Of several
    /// levels, or two boards, there are none.
    pub spacings: Vec<SpacingThen>,
    /// In every frame measured in whole.
    pub clarities: Vec<ClarityThen>,
}

/// Something that has a time.
trait Then {
    fn at(&self) -> Timestamp;
}

impl Then for PositionsThen {
    fn at(&self) -> Timestamp {
        self.at
    }
}

impl Then for SpacingThen {
    fn at(&self) -> Timestamp {
        self.at
    }
}

impl Then for ClarityThen {
    fn at(&self) -> Timestamp {
        self.at
    }
}

/// How long after `before` something was; nothing where the clock was set back meanwhile.
fn after(at: Timestamp, before: Timestamp) -> Duration {
    Duration::try_from(at.duration_since(before)).unwrap_or_default()
}

/// Adds what is newest, and drops what is too old, or too near to those before and after it. What is at or before the span's
/// beginning still held then: the newest of that is kept.
fn follow<T: Then>(kept: &mut VecDeque<T>, newest: T) {
    let at = newest.at();
    // Where the clock was set back, what is later than now is no more.
    while kept.back().is_some_and(|last| last.at() > at) {
        kept.pop_back();
    }
    while kept.get(1).is_some_and(|second| after(at, second.at()) > SPAN) {
        kept.pop_front();
    }
    // The newest is kept whatever its distance: it is where an axis came to rest.
    if let [.., before, last] = kept.make_contiguous()
        && after(last.at(), before.at()) < APART
    {
        kept.pop_back();
    }
    kept.push_back(newest);
}

#[derive(Default)]
struct Kept {
    positions: VecDeque<PositionsThen>,
    spacings: VecDeque<SpacingThen>,
    clarities: VecDeque<ClarityThen>,
}

/// What is kept of the last two minutes.
#[derive(Default)]
pub(super) struct Recent(Mutex<Kept>);

impl Recent {
    fn change(&self, change: impl FnOnce(&mut Kept)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    pub(super) fn bench(&self, bench: &BenchView) {
        let of = |name| bench.axes.iter().find(|axis| axis.axis == name).and_then(|axis| axis.position_mm);
        let (focus_mm, e_mm) = (of(AxisName::Focus), of(AxisName::E));
        self.change(|kept| follow(&mut kept.positions, PositionsThen { at: Timestamp::now(), focus_mm, e_mm }));
    }

    pub(super) fn reading(&self, reading: &Reading) {
        let Ok(spacing) = &reading.spacing else { return };
        let newest = SpacingThen {
            at: reading.frame.captured_at,
            spacing_px: spacing.on_axis_px,
            spacing_sigma_px: spacing.sigma_px,
            spacing_target_px: reading.spacing_target_px,
        };
        self.change(|kept| follow(&mut kept.spacings, newest));
    }

    pub(super) fn measurement(&self, measurement: &MeasurementView, of_levels: bool) {
        let (at, eog) = (measurement.captured_at, measurement.eog);
        let spacing = SpacingThen {
            at,
            spacing_px: measurement.spacing.spacing_px,
            spacing_sigma_px: measurement.spacing.spacing_sigma_px,
            spacing_target_px: measurement.spacing_target_px,
        };
        self.change(|kept| {
            follow(&mut kept.clarities, ClarityThen { at, eog });
            let of_several = of_levels || measurement.two_boards.is_some();
            if !of_several && kept.spacings.back().is_none_or(|newest| after(at, newest.at) > UNREAD) {
                follow(&mut kept.spacings, spacing);
            }
        });
    }
}

impl Service {
    /// The last two minutes, as far as somebody looked.
    #[must_use]
    pub fn recent(&self) -> RecentView {
        let now = Timestamp::now();
        let kept = self.recent.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut positions = since(&kept.positions, now);
        // An axis that has stood still for longer stands where it stood.
        if let Some(before) = kept.positions.iter().rfind(|then| after(now, then.at) > SPAN) {
            positions.insert(0, PositionsThen { at: now - SPAN, ..before.clone() });
        }
        RecentView { now, positions, spacings: since(&kept.spacings, now), clarities: since(&kept.clarities, now) }
    }
}

fn since<T: Then + Clone>(kept: &VecDeque<T>, now: Timestamp) -> Vec<T> {
    kept.iter().filter(|then| then.at() <= now && after(now, then.at()) <= SPAN).cloned().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clarity(at_ms: i64) -> ClarityThen {
        ClarityThen { at: Timestamp::from_millisecond(at_ms).unwrap(), eog: None }
    }

    #[test]
    fn it_goes_back_two_minutes_four_a_second_and_has_the_newest() {
        let mut kept = VecDeque::new();
        for at_ms in (0..=300_000).step_by(10) {
            follow(&mut kept, clarity(at_ms));
            assert_eq!(kept.back(), Some(&clarity(at_ms)));
        }
        assert!((400..=482).contains(&kept.len()), "{} are kept", kept.len());
        let now = kept[kept.len() - 1].at;
        // The newest of what is older, and no more of that.
        assert!(after(now, kept[0].at) > SPAN && after(now, kept[1].at) <= SPAN);
        let seen = since(&kept, now);
        let span = after(now, seen[0].at);
        assert!((SPAN - APART..=SPAN).contains(&span), "{span:?}");
    }

    #[test]
    fn it_outlives_a_clock_that_is_set_back() {
        let mut kept = VecDeque::from([clarity(600_000), clarity(601_000)]);
        let now = Timestamp::from_millisecond(500_000).unwrap();
        assert_eq!(since(&kept, now), [] as [ClarityThen; 0]);
        for at_ms in [0, 1000, 2000] {
            follow(&mut kept, clarity(at_ms));
        }
        assert_eq!(kept, [0, 1000, 2000].map(clarity));
    }
}
