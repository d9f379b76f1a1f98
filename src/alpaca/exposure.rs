//! The exposure under way, and what came of the last.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::task::AbortHandle;

use super::fault::Fault;
use super::image::{Picture, Window};
use crate::control::Service;
use crate::device::Frame;

/// What the camera does for its Alpaca clients.
#[derive(Default)]
enum State {
    #[default]
    Idle,
    Exposing {
        /// Tells it from those before.
        number: u64,
        task: AbortHandle,
    },
    Taken(Picture),
    Failed(Fault),
}

/// The state, as the specification counts it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CameraState {
    Idle = 0,
    Exposing = 2,
    Error = 5,
}

#[derive(Default)]
struct Inner {
    state: State,
    number: u64,
    /// The last frame taken, whatever was begun since.
    last: Option<Arc<Frame>>,
}

/// One exposure at a time.
#[derive(Default)]
pub(super) struct Shutter(Arc<Mutex<Inner>>);

fn lock(inner: &Mutex<Inner>) -> MutexGuard<'_, Inner> {
    inner.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shutter {
    /// Begins an exposure: the frame is one whose exposure begins after this.
    ///
    /// # Errors
    /// One is under way.
    pub(super) fn open(&self, service: Arc<Service>, window: Window) -> Result<(), Fault> {
        let mut inner = lock(&self.0);
        if matches!(inner.state, State::Exposing { .. }) {
            return Err(Fault::invalid_operation("an exposure is under way: wait for its image, or abort it"));
        }
        inner.number += 1;
        let (number, shared) = (inner.number, Arc::clone(&self.0));
        let task = tokio::spawn(async move {
            let exposed = service.expose().await;
            let mut inner = lock(&shared);
            // Aborted in the very moment of its end, it is not wanted any more.
            if matches!(inner.state, State::Exposing { number: current, .. } if current == number) {
                inner.state = match exposed.map_err(Fault::from).and_then(|frame| Picture::new(frame, window)) {
                    Ok(picture) => {
                        inner.last = Some(Arc::clone(picture.frame()));
                        State::Taken(picture)
                    }
                    Err(fault) => State::Failed(fault),
                };
            }
        });
        inner.state = State::Exposing { number, task: task.abort_handle() };
        Ok(())
    }

    /// Ends an exposure without an image, if one is under way.
    pub(super) fn abort(&self) {
        let mut inner = lock(&self.0);
        if let State::Exposing { task, .. } = &inner.state {
            task.abort();
            inner.state = State::Idle;
        }
    }

    pub(super) fn state(&self) -> CameraState {
        match lock(&self.0).state {
            State::Idle | State::Taken(_) => CameraState::Idle,
            State::Exposing { .. } => CameraState::Exposing,
            State::Failed(_) => CameraState::Error,
        }
    }

    /// Whether there is an image.
    ///
    /// # Errors
    /// Why there will be none.
    pub(super) fn is_ready(&self) -> Result<bool, Fault> {
        match &lock(&self.0).state {
            State::Taken(_) => Ok(true),
            State::Idle | State::Exposing { .. } => Ok(false),
            State::Failed(fault) => Err(fault.clone()),
        }
    }

    /// The image.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn picture(&self) -> Result<Picture, Fault> {
        match &lock(&self.0).state {
            State::Taken(picture) => Ok(picture.clone()),
            State::Idle => Err(Fault::invalid_operation("no image has been taken: begin an exposure first")),
            State::Exposing { .. } => Err(Fault::invalid_operation("the exposure is still under way")),
            State::Failed(fault) => Err(fault.clone()),
        }
    }

    /// The frame of the last exposure that succeeded.
    ///
    /// # Errors
    /// None has.
    pub(super) fn last(&self) -> Result<Arc<Frame>, Fault> {
        let last = lock(&self.0).last.clone();
        last.ok_or_else(|| Fault::invalid_operation("no image has been taken yet"))
    }
}
