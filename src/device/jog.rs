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
/// says where the piece that begins at a position ends. `end` and `next` are the caller's bounds: they are not checked
/// here. Dropping this future does not let go: dropping the grip does.
///
/// # Errors
/// As [`Stage::move_at`], but for the stop that a release is.
pub async fn jog(
    stage: &Arc<dyn Stage>,
    end: Millimetres,
    speed_mm_per_s: f64,
    mut deadman: Deadman,
    next: impl Fn(Millimetres) -> Millimetres + Send + 'static,
) -> Result<Millimetres, DeviceError> {
    let stage = Arc::clone(stage);
    let device = format!("the {} stage", stage.info().axis);
    let task = tokio::spawn(async move {
        let mut at = stage.state().borrow().position;
        while at != end && deadman.held() {
            let piece = next(at);
            let motion = stage.move_at(piece, speed_mm_per_s);
            tokio::pin!(motion);
            tokio::select! {
                biased;
                () = deadman.released() => {
                    stage.stop().await;
                    return match motion.await {
                        Err(DeviceError::Stopped { .. }) => Ok(stage.read_state().await?.position),
                        ended => ended,
                    };
                }
                ended = &mut motion => ended?,
            };
            at = piece;
        }
        Ok(stage.read_state().await?.position)
    });
    task.await.unwrap_or_else(|_| Err(DeviceError::Disconnected { device, reason: "its task has ended".to_owned() }))
}
