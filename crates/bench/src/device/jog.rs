//! Motion that goes on only while somebody holds it: a jog with a deadman.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use super::{DeviceError, Stage};
use plenoptics::units::Millimetres;

/// Who holds a jog: it goes on while this is renewed, and ends when it is dropped.
#[derive(Debug)]
pub struct Grip(watch::Sender<Instant>);

/// What a jog looks at.
#[derive(Debug, Clone)]
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

/// What is certain of an axis on its way: it has come this far and goes this fast, or is farther and faster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Where it is.
    pub at: Millimetres,
    /// Its speed on its way, mm/s.
    pub speed_mm_per_s: f64,
}

/// How far an axis is told to go, and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Next {
    /// Where its way ends unless it is told more.
    pub to: Millimetres,
    /// Greatest speed on it, mm/s.
    pub speed_mm_per_s: f64,
}

/// Asked again and again how far an axis may go, given what is seen of it; `None` ends the motion where it was told to go.
pub type Course = Box<dyn FnMut(Seen) -> Option<Next> + Send>;

/// Moves an axis towards `end` while the deadman is held, then stops it (and whatever else its controller moves), and
/// returns where it stands. Of its way it is told a little at a time, and more before it has come to the end of that:
/// `next` says how far, or why it must not go on. `end` and `next` are the caller's bounds: they are not checked here.
/// `generation` is what the jog was admitted under. Dropping this future does not let go: dropping the grip does.
///
/// # Errors
/// As [`Stage::follow`], but for the stop that a release is; and what `next` says.
pub async fn jog<E: From<DeviceError> + Send + 'static>(
    stage: &Arc<dyn Stage>,
    end: Millimetres,
    mut deadman: Deadman,
    generation: u64,
    mut next: impl FnMut(Seen) -> Result<Next, E> + Send + 'static,
) -> Result<Millimetres, E> {
    let (stage, watched) = (Arc::clone(stage), stage);
    let task = tokio::spawn(async move {
        let refused = Arc::new(Mutex::new(None));
        let (held, refusal) = (deadman.clone(), Arc::clone(&refused));
        let course = Box::new(move |seen: Seen| {
            if seen.at == end || !held.held() {
                return None;
            }
            next(seen).map_err(|error| *refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(error)).ok()
        });
        let motion = stage.follow(course, generation);
        tokio::pin!(motion);
        let (ended, released) = tokio::select! {
            biased;
            () = deadman.released() => {
                stage.stop().await;
                (motion.await, true)
            }
            ended = &mut motion => (ended, false),
        };
        if let Some(error) = refused.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(error);
        }
        match ended {
            Err(DeviceError::Stopped { .. }) if released => Ok(stage.read_state().await?.position),
            ended => Ok(ended?),
        }
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
