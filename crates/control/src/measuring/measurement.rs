//! A measurement of the live picture for who asks for one: of one frame, which says whether an axis moved meanwhile.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::eye::Eye;
use crate::events::{MeasurementView, SingleMeasurement};
use crate::{Refusal, ServiceError};
use bench::device::{AxisName, AxisPose, Frame};

/// Which frame is to be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeasurementRequest {
    /// Whether the frame has to be exposed wholly while both axes stood settled, as every frame of a job is.
    pub settled: bool,
    /// How long ago the frame's exposure may have begun; with none, it begins after the request.
    pub max_age: Option<Duration>,
}

impl SingleMeasurement {
    pub(crate) fn of(frame: &Frame, measurement: MeasurementView) -> Self {
        let unsettled = unsettled(frame);
        let exposure = frame.exposed_to.saturating_duration_since(frame.exposed_from);
        Self {
            measurement,
            spans_motion: !unsettled.is_empty(),
            unsettled,
            exposed_from: frame.captured_at.checked_sub(exposure).unwrap_or(frame.captured_at),
            exposure_assumed: frame.exposure_assumed,
            simulated: frame.simulated,
            replayed: frame.replayed,
        }
    }
}

/// The axes that moved, or had not settled, while a frame was exposed.
fn unsettled(frame: &Frame) -> Vec<AxisName> {
    let pose = |axis| -> AxisPose {
        match axis {
            AxisName::Focus => frame.focus,
            AxisName::E => frame.e,
        }
    };
    AxisName::ALL.into_iter().filter(|&axis| !pose(axis).settled).collect()
}

impl Eye {
    /// The frame that a request is about.
    async fn frame_for(&self, request: MeasurementRequest) -> Result<Arc<Frame>, ServiceError> {
        let spans = |axes: Vec<AxisName>| Refusal::SpansMotion { axes };
        let wanted = |frame: &Arc<Frame>| {
            let young = request.max_age.is_some_and(|age| frame.exposed_from.elapsed() <= age);
            // A preview is for viewing only.
            young && !frame.preview && (!request.settled || unsettled(frame).is_empty())
        };
        if let Some(frame) = self.bench().camera.newest().filter(wanted) {
            return Ok(frame);
        }
        let now = Instant::now();
        let from = if request.settled {
            self.motion().settled_from().ok_or_else(|| spans(self.motion().moving()))?.max(now)
        } else {
            now
        };
        let frame = self.bench().camera.frame(from).await?;
        // A motion may have begun meanwhile.
        let unsettled = unsettled(&frame);
        if request.settled && !unsettled.is_empty() { Err(spans(unsettled).into()) } else { Ok(frame) }
    }

    /// Measures one frame.
    pub(crate) async fn measure_one(&self, request: MeasurementRequest) -> Result<SingleMeasurement, ServiceError> {
        let cannot = |why: String| ServiceError::from(Refusal::NotMeasurable { why });
        if let Some(why) = &self.bench().camera.state().borrow().unfit {
            return Err(cannot(format!("the camera's frames are not fit for it: {why}")));
        }
        if !self.has_white() {
            return Err(cannot("no white frame has been taken since the program started; a job takes one".to_owned()));
        }
        let frame = self.frame_for(request).await?;
        let view = self.measure_frame(&frame).await.map_err(cannot)?;
        let measured = SingleMeasurement::of(&frame, view);
        self.journal().measured_alone(&measured);
        Ok(measured)
    }
}
