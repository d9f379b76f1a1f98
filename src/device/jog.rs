//! Motion that goes on only while somebody holds it: a jog with a deadman.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use super::{DeviceError, Stage};
use crate::units::Millimetres;

/// Who holds a jog: it goes on while this is renewed, and ends when it is dropped.
#[derive(Debug)]
pub struct Grip(watch::Sender<Instant>);

/// What a jog looks at.
#[derive(Debug)]
pub struct Deadman(watch::Receiver<Instant>);

/// A grip that holds for `hold` from now on, and what it holds.
#[must_use]
pub fn deadman(hold: Duration) -> (Grip, Deadman) {
    let (sender, receiver) = watch::channel(Instant::now() + hold);
    (Grip(sender), Deadman(receiver))
}

impl Grip {
    /// Holds for `hold` from now on.
    pub fn renew(&self, hold: Duration) {
        self.0.send_replace(Instant::now() + hold);
    }
}

impl Deadman {
    /// Whether it is held.
    #[must_use]
    pub fn held(&self) -> bool {
        self.0.has_changed().is_ok() && *self.0.borrow() > Instant::now()
    }

    /// Returns once the grip has run out or was dropped.
    pub async fn released(&mut self) {
        loop {
            let until = *self.0.borrow_and_update();
            tokio::select! {
                biased;
                renewed = self.0.changed() => if renewed.is_err() { return },
                () = tokio::time::sleep_until(until) => return,
            }
        }
    }
}

/// Moves an axis towards `end` at `speed_mm_per_s` while the deadman is held, then stops it (and whatever else its
/// controller moves), and returns where it stands. It goes in pieces, one told when the one before has ended: `next`
/// says where the piece that begins at a position ends, or why it must not begin. `end` and `next` are the caller's
/// bounds: they are not checked here. `generation` is what the jog was admitted under. Dropping this future does not
/// let go: dropping the grip does.
///
/// # Errors
/// As [`Stage::move_at`], but for the stop that a release is; and what `next` says.
pub async fn jog<E: From<DeviceError> + Send + 'static>(
    stage: &Arc<dyn Stage>,
    end: Millimetres,
    speed_mm_per_s: f64,
    mut deadman: Deadman,
    generation: u64,
    next: impl Fn(Millimetres) -> Result<Millimetres, E> + Send + 'static,
) -> Result<Millimetres, E> {
    let (stage, watched) = (Arc::clone(stage), stage);
    let task = tokio::spawn(async move {
        let mut at = stage.state().borrow().position;
        while at != end && deadman.held() {
            let piece = next(at)?;
            let motion = stage.move_at(piece, speed_mm_per_s, generation);
            tokio::pin!(motion);
            tokio::select! {
                biased;
                () = deadman.released() => {
                    stage.stop().await;
                    return match motion.await {
                        Err(DeviceError::Stopped { .. }) => Ok(stage.read_state().await?.position),
                        ended => Ok(ended?),
                    };
                }
                ended = &mut motion => ended?,
            };
            at = piece;
        }
        Ok(stage.read_state().await?.position)
    });
    match task.await {
        Ok(ended) => ended,
        Err(_) => {
            // What it had moving is watched by nobody.
            watched.stop().await;
            let device = format!("the {} stage", watched.info().axis);
            Err(DeviceError::Disconnected { device, reason: "its task has ended".to_owned() }.into())
        }
    }
}
