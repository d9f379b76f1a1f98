//! One raw frame for who asks for an exposure.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, timeout};

use super::Service;
use crate::ServiceError;
use bench::device::{DeviceError, Frame};

/// How long a frame may take, whatever holds it up: a camera that is lost is waited for, a simulated one renders.
const ALLOWED: Duration = Duration::from_secs(120);

impl Service {
    /// The camera's next frame of full quality, whose exposure begins after this was called. Moves nothing.
    ///
    /// # Errors
    /// The camera's own error; a frame of another size than is configured; a picture that has been seen before; no frame
    /// in time.
    pub async fn expose(&self) -> Result<Arc<Frame>, ServiceError> {
        let camera = &self.bench.camera;
        let (before, from) = (camera.newest(), Instant::now());
        let frame = timeout(ALLOWED, camera.frame(from)).await.map_err(|_| DeviceError::Timeout {
            device: "the camera".to_owned(),
            what: "send a frame".to_owned(),
            allowed: ALLOWED,
        })??;
        if frame.exposed_from < from {
            return Err(DeviceError::Protocol {
                device: "the camera".to_owned(),
                detail: "it gave a frame from before the exposure".to_owned(),
            }
            .into());
        }
        self.eye.check_size(&frame)?;
        self.eye.check_new(before.as_deref(), &frame).map_err(DeviceError::from)?;
        Ok(frame)
    }
}
