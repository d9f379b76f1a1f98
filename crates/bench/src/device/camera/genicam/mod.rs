//! A GenICam camera over GigE Vision or USB3 Vision: the frame source in front of the thread that takes its frames.
//!
//! The protocol and the camera's XML are read by `viva-genicam`, of which nothing is named outside of here.

mod allowance;
mod bounded;
mod capture;
mod clock;
mod dating;
mod features;
pub mod find;
pub mod found;
mod hold;
mod known;
pub mod listing;
mod network;
mod read;
mod setup;
pub mod survey;
mod target;
mod transport;
mod turn;
pub mod usb;

use std::sync::Arc;
use std::sync::mpsc;

use async_trait::async_trait;
use tokio::sync::oneshot;

use self::capture::{Capturer, Order};
use super::controls::KeptControls;
use super::feed::{self, CONTROLS_ALLOWED, Driven, Feed};
use super::poses::PoseSource;
use crate::config::CameraConfig;
use crate::device::light::{ControlName, LightControl};
use crate::device::{CameraState, DeviceError};

/// The largest buffer that the kernel gives a socket for what it receives, bytes, of which it then makes twice as much;
/// `None` where it does not say.
#[must_use]
pub fn most_buffer_bytes() -> Option<u64> {
    std::fs::read_to_string("/proc/sys/net/core/rmem_max").ok()?.trim().parse().ok()
}

/// A GenICam camera.
pub struct GenicamCamera {
    feed: Feed,
    orders: mpsc::Sender<Order>,
}

impl GenicamCamera {
    /// Starts taking frames of `size` (columns and rows) from the configured camera. One that is missing, unsuitable or
    /// controlled by another program is not an error here: the state says so, and it is tried again.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] for a pixel format that this program does not read, [`DeviceError::Disconnected`] when
    /// no thread can be started.
    pub fn start(config: &CameraConfig, size: (usize, usize), poses: PoseSource) -> Result<Self, DeviceError> {
        let format = config.pixel_format().ok_or_else(|| DeviceError::Refused {
            device: config.device.clone(),
            reason: format!("frames in `{}` are not read; `plenalign camera list` shows what is", config.format),
        })?;
        let (feed, outlet) = feed::feed(config, size, poses, CameraState::not_yet("genicam", "not opened yet"));
        let (orders, taken) = mpsc::channel();
        let set_by_hand = Arc::<KeptControls>::default();
        let config = config.clone();
        feed::spawn(Capturer {
            config,
            set_by_hand,
            format,
            outlet,
            orders: taken,
            distrusted: None,
            has_sent: false,
        })?;
        Ok(Self { feed, orders })
    }

    /// Has the thread that takes frames do something with the camera between two of them.
    async fn order<T>(
        &self,
        what: &str,
        order: impl FnOnce(oneshot::Sender<Result<T, String>>) -> Order,
    ) -> Result<T, DeviceError> {
        self.feed.require_there()?;
        let device = || self.feed.name.clone();
        let lost = || DeviceError::Disconnected { device: device(), reason: "it was lost meanwhile".to_owned() };
        let (reply, answer) = oneshot::channel();
        self.orders.send(order(reply)).map_err(|_| lost())?;
        let late = || DeviceError::Timeout { device: device(), what: what.to_owned(), allowed: CONTROLS_ALLOWED };
        let answer = tokio::time::timeout(CONTROLS_ALLOWED, answer).await.map_err(|_| late())?;
        answer.map_err(|_| lost())?.map_err(|reason| DeviceError::Refused { device: device(), reason })
    }
}

#[async_trait]
impl Driven for GenicamCamera {
    fn feed(&self) -> &Feed {
        &self.feed
    }

    async fn tell_controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        self.order("tell its controls", Order::Tell).await
    }

    async fn change_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        self.order("set its controls", |reply| Order::Set(name, value, reply)).await
    }
}
