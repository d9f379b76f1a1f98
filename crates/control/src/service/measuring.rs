//! What the camera tells to who asks: one measurement, or every reading of the meter.

use std::sync::Arc;

use tokio::sync::{broadcast, watch};

use super::Service;
use crate::ServiceError;
use crate::events::{InView, SingleMeasurement};
use crate::measuring::measurement::MeasurementRequest;
use crate::reading::Reading;
use bench::device::Frame;
use bench::record::messages::MeterReading;

impl Service {
    /// Measures the spacing in one frame, moves nothing, and keeps the result in the history. One at a time, however
    /// many ask.
    ///
    /// # Errors
    /// [`Refusal::SpansMotion`](crate::Refusal::SpansMotion) where settled axes are demanded and one moves or settles;
    /// [`Refusal::NotMeasurable`](crate::Refusal::NotMeasurable) where there is nothing to be measured; the camera's own
    /// error.
    pub async fn measure(&self, request: MeasurementRequest) -> Result<SingleMeasurement, ServiceError> {
        let _turn = self.measuring.lock().await;
        let measured = self.eye.measure_one(request).await?;
        self.publish_measurement(measured.measurement.clone());
        Ok(measured)
    }

    /// What the meter reads from now on, frame by frame: measured for as long as this is held.
    #[must_use]
    pub fn readings(&self) -> watch::Receiver<Option<Arc<Reading>>> {
        self.readings.newest()
    }

    /// Each single reading from now on, without its frame: measured for as long as this is held. Who lags by more than 256
    /// is told how many were left out.
    #[must_use]
    pub fn each_reading(&self) -> broadcast::Receiver<Arc<MeterReading>> {
        self.readings.each()
    }

    /// Whether a board of several levels stands before the lens: the spacing of the whole field is none of theirs.
    pub(super) fn sees_levels(&self) -> bool {
        self.eye.in_view() == InView::SteppedBoard
    }

    /// Reads every frame while somebody reads the meter.
    pub(super) async fn watch_meter(&self) {
        let keep = |reading: &Reading| {
            if !self.sees_levels() {
                self.recent.reading(reading);
            }
        };
        self.readings.watch(&self.eye, keep).await;
    }

    /// The first of the frames in a row, up to this one, that have its very picture, by its sequence number: the frame itself
    /// where it is another picture than the one before, as a sensor never takes the same twice.
    pub async fn first_alike(&self, frame: &Arc<Frame>) -> u64 {
        self.eye.first_alike(frame).await
    }
}
