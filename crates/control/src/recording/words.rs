//! What control knows as the messages of recordings and of the live bridge, and back.

use serde::de::DeserializeOwned;

use super::{Answer, End};
use crate::events::{FieldMap, MeasurementView, TwoBoardsView};
use crate::job::{Iteration, LogLine, word};
use crate::reading::{NoReading, Reading};
use crate::spacing::SpacingReading;
use bench::device::replayed::OPERATOR;
use bench::device::{AxisName, Frame, StageState};
use bench::record::foxglove::{
    Color, FrameTransform, ImageAnnotations, Log, Point2, PointsAnnotation, Pose, PoseInFrame, Quaternion,
    TextAnnotation, Vector3, log, points_annotation,
};
use bench::record::{messages, stamp, time};
use plenoptics::imaging::spacing::LensState;
use plenoptics::units::Millimetres;

/// Micro-images drawn on a frame, at most: of more, one in so many.
const MOST_DRAWN: usize = 2000;
/// A deviation of the spacing that is drawn in full colour, px.
const FULL_COLOUR_PX: f64 = 0.5;
/// Size of the words on a frame, as a share of its height in pitches of the micro-images.
const WORDS_PITCHES: f64 = 1.5;
/// Who says what is in the log.
const LOGGER: &str = "plenalign";

/// A measurement.
#[must_use]
pub fn measurement(view: &MeasurementView) -> messages::Measurement {
    messages::Measurement {
        timestamp: Some(stamp(view.captured_at)),
        frame_seq: view.frame_seq,
        focus_mm: view.focus_mm,
        e_mm: view.e_mm,
        settled: view.settled,
        spacing: Some(spacing(&view.spacing)),
        spacing_target_px: view.spacing_target_px,
        spacing_target_source: word(&view.spacing_target_source),
        spacing_tolerance_px: view.spacing_tolerance_px,
        in_focus: view.in_focus,
        micro_image_pitch_px: view.micro_image_pitch_px,
        micro_image_pitch_sigma_px: view.micro_image_pitch_sigma_px,
        eog: view.eog,
        eog_sum: view.eog_sum,
        ssim: view.ssim,
        two_boards: view.two_boards.map(|two| messages::TwoBoards {
            larger_px: two.spacings_px[0],
            smaller_px: two.spacings_px[1],
            difference_sigma_px: two.difference_sigma_px,
            share: two.share,
        }),
    }
}

/// The measurement in a message.
#[must_use]
pub fn measured(message: &messages::Measurement) -> MeasurementView {
    MeasurementView {
        frame_seq: message.frame_seq,
        captured_at: time(message.timestamp.as_ref()),
        focus_mm: message.focus_mm,
        e_mm: message.e_mm,
        settled: message.settled,
        spacing: reading(message.spacing.as_ref()),
        spacing_target_px: message.spacing_target_px,
        spacing_target_source: known(&message.spacing_target_source).unwrap_or_default(),
        spacing_tolerance_px: message.spacing_tolerance_px,
        in_focus: message.in_focus,
        micro_image_pitch_px: message.micro_image_pitch_px,
        micro_image_pitch_sigma_px: message.micro_image_pitch_sigma_px,
        eog: message.eog,
        eog_sum: message.eog_sum,
        ssim: message.ssim,
        two_boards: message.two_boards.map(|two| TwoBoardsView {
            spacings_px: [two.larger_px, two.smaller_px],
            difference_sigma_px: two.difference_sigma_px,
            share: two.share,
        }),
    }
}

fn spacing(reading: &SpacingReading) -> messages::Spacing {
    messages::Spacing {
        spacing_px: reading.spacing_px,
        spacing_sigma_px: reading.spacing_sigma_px,
        tilt_x_px: reading.tilt_x_px,
        tilt_y_px: reading.tilt_y_px,
        curvature_px: reading.curvature_px,
        pairs: reading.pairs,
        frames: reading.frames,
    }
}

fn reading(message: Option<&messages::Spacing>) -> SpacingReading {
    let message = message.copied().unwrap_or_default();
    SpacingReading {
        spacing_px: message.spacing_px,
        spacing_sigma_px: message.spacing_sigma_px,
        tilt_x_px: message.tilt_x_px,
        tilt_y_px: message.tilt_y_px,
        curvature_px: message.curvature_px,
        pairs: message.pairs,
        frames: message.frames,
    }
}

/// A decision.
#[must_use]
pub fn decision(iteration: &Iteration) -> messages::Decision {
    messages::Decision {
        timestamp: Some(stamp(iteration.at)),
        number: iteration.number,
        stage: word(&iteration.stage),
        kind: word(&iteration.kind),
        axis: iteration.axis.map(|axis| axis.name().to_owned()),
        focus_mm: iteration.focus_mm,
        e_mm: iteration.e_mm,
        delta_v_mm: iteration.delta_v_mm,
        delta_v_sigma_mm: iteration.delta_v_sigma_mm,
        delta_v_target_mm: iteration.delta_v_target_mm,
        e_estimate_mm: iteration.e_estimate_mm,
        e_estimate_sigma_mm: iteration.e_estimate_sigma_mm,
        spacing: Some(spacing(&iteration.spacing)),
        spacing_predicted_px: iteration.spacing_predicted_px,
        spacing_target_px: iteration.spacing_target_px,
        decision: iteration.decision.clone(),
    }
}

/// The decision in a message.
///
/// # Errors
/// Which of its words is not known.
pub fn decided(message: &messages::Decision) -> Result<Iteration, String> {
    Ok(Iteration {
        number: message.number,
        stage: known(&message.stage)?,
        kind: known(&message.kind)?,
        axis: message.axis.as_deref().map(known).transpose()?,
        focus_mm: message.focus_mm,
        e_mm: message.e_mm,
        delta_v_mm: message.delta_v_mm,
        delta_v_sigma_mm: message.delta_v_sigma_mm,
        delta_v_target_mm: message.delta_v_target_mm,
        e_estimate_mm: message.e_estimate_mm,
        e_estimate_sigma_mm: message.e_estimate_sigma_mm,
        spacing: reading(message.spacing.as_ref()),
        spacing_predicted_px: message.spacing_predicted_px,
        spacing_target_px: message.spacing_target_px,
        // The measurement has it.
        eog: None,
        decision: message.decision.clone(),
        discarded: false,
        at: time(message.timestamp.as_ref()),
    })
}

/// What the meter read. How many readings were left out before is for who sends it on.
#[must_use]
pub fn meter_reading(reading: &Reading) -> messages::MeterReading {
    let frame = &reading.frame;
    let exposure = frame.exposed_to.saturating_duration_since(frame.exposed_from);
    let read = reading.spacing.as_ref().ok();
    let (state, why) = match &reading.spacing {
        Ok(_) => ("measured", reading.unresolved.as_deref().unwrap_or_default()),
        Err(NoReading::Lost(why)) => ("lost", why.as_str()),
        Err(NoReading::Refused(why)) => ("refused", why.as_str()),
    };
    messages::MeterReading {
        timestamp: Some(stamp(frame.captured_at)),
        frame_seq: frame.seq,
        exposure_us: u64::try_from(exposure.as_micros()).unwrap_or(u64::MAX),
        exposure_assumed: frame.exposure_assumed,
        focus_mm: frame.focus.position.map(Millimetres::value),
        e_mm: frame.e.position.map(Millimetres::value),
        settled: frame.is_settled(),
        preview: frame.preview,
        simulated: frame.simulated,
        replayed: frame.replayed,
        state: state.to_owned(),
        why: why.to_owned(),
        spacing: read.map(|read| messages::Spacing {
            spacing_px: read.on_axis_px,
            spacing_sigma_px: read.sigma_px,
            tilt_x_px: read.tilt_x_px,
            tilt_y_px: read.tilt_y_px,
            curvature_px: read.curvature_px,
            pairs: u32::try_from(read.pairs).unwrap_or(u32::MAX),
            frames: 1,
        }),
        spacing_sigma_random_px: read.map(|read| read.sigma_random_px),
        spacing_target_px: reading.spacing_target_px,
        in_focus: reading.in_focus,
        frames_left_out: reading.frames_left_out,
        readings_left_out: 0,
        doubted: reading.doubted,
    }
}

/// What a word of the API stands for.
pub(crate) fn known<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned()))
        .map_err(|_| format!("{text:?} is not known to this version of the program"))
}

/// A line of the log.
#[must_use]
pub fn line(line: &LogLine) -> Log {
    Log {
        timestamp: Some(stamp(line.at)),
        level: log::Level::Info.into(),
        message: line.message.clone(),
        name: LOGGER.to_owned(),
        ..Log::default()
    }
}

/// When and where a frame was taken; `from` is when the recording began.
pub(super) fn frame(frame: &Frame, from: tokio::time::Instant) -> messages::FrameInfo {
    let since = |at: tokio::time::Instant| match at.checked_duration_since(from) {
        Some(after) => i64::try_from(after.as_nanos()).unwrap_or(i64::MAX),
        None => -i64::try_from(from.duration_since(at).as_nanos()).unwrap_or(i64::MAX),
    };
    messages::FrameInfo {
        timestamp: Some(stamp(frame.captured_at)),
        seq: frame.seq,
        bits: frame.image.bits().into(),
        exposed_from_ns: since(frame.exposed_from),
        exposed_to_ns: since(frame.exposed_to),
        exposure_assumed: frame.exposure_assumed,
        focus_mm: frame.focus.position.map(Millimetres::value),
        e_mm: frame.e.position.map(Millimetres::value),
        focus_settled: frame.focus.settled,
        e_settled: frame.e.settled,
        simulated: frame.simulated,
    }
}

/// An axis's state.
pub(crate) fn axis_state(state: &StageState) -> messages::AxisState {
    messages::AxisState {
        connected: state.connected,
        homed: state.homed,
        position_mm: state.position.value(),
        fault: state.fault.clone(),
        ..messages::AxisState::default()
    }
}

/// What a device answered.
pub(super) fn answer(answer: &Answer, at: jiff::Timestamp) -> messages::Answer {
    messages::Answer {
        timestamp: Some(stamp(at)),
        device: answer.axis.map_or("camera", AxisName::name).to_owned(),
        asked: answer.asked.to_owned(),
        target_mm: answer.target.map(Millimetres::value),
        readback_mm: answer.readback.map(Millimetres::value),
        state: answer.state.as_ref().map(axis_state),
        error_json: answer.error.as_ref().and_then(|error| serde_json::to_string(error).ok()),
        ..messages::Answer::default()
    }
}

/// What an operator answered who asked for an earlier step `again`, in place of confirming `step`.
pub(super) fn again(step: u32, again: u32, at: jiff::Timestamp) -> messages::Answer {
    messages::Answer {
        timestamp: Some(stamp(at)),
        device: OPERATOR.to_owned(),
        asked: "again".to_owned(),
        step: Some(step),
        again: Some(again),
        ..messages::Answer::default()
    }
}

/// How a job ended.
pub(super) fn end(end: &End, at: jiff::Timestamp) -> messages::JobEnd {
    messages::JobEnd {
        timestamp: Some(stamp(at)),
        state: end.state.to_string(),
        reason: end.reason.clone(),
        report_json: end.report.as_ref().and_then(|report| serde_json::to_string(report).ok()),
        outcome_json: end.outcome.as_ref().and_then(|outcome| serde_json::to_string(outcome).ok()),
    }
}

/// Where e axis and focus axis stand, as frames of reference: `camera` lies e (in m) behind the shell's centre, `bench`,
/// along z; `mla` lies Δv, by the focus axis's reading, behind its design's place in the camera.
#[must_use]
pub fn transforms(at: jiff::Timestamp, focus_mm: Option<f64>, e_mm: Option<f64>) -> Vec<FrameTransform> {
    let one = |parent: &str, child: &str, z_mm: f64| FrameTransform {
        timestamp: Some(stamp(at)),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(behind(z_mm)),
        rotation: Some(UPRIGHT),
    };
    let camera = e_mm.map(|e| one("bench", "camera", e));
    let mla = focus_mm.map(|focus| one("camera", "mla", focus));
    camera.into_iter().chain(mla).collect()
}

/// Where the camera stands on the bench; none while that is unknown.
#[must_use]
pub fn pose(at: jiff::Timestamp, e_mm: Option<f64>) -> Option<PoseInFrame> {
    let pose = Pose { position: Some(behind(e_mm?)), orientation: Some(UPRIGHT) };
    Some(PoseInFrame { timestamp: Some(stamp(at)), frame_id: "bench".to_owned(), pose: Some(pose) })
}

const UPRIGHT: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

/// A point so many mm behind an origin: the camera looks along z, and away from the shell is behind.
fn behind(mm: f64) -> Vector3 {
    Vector3 { x: 0.0, y: 0.0, z: -mm / 1000.0 }
}

const fn colour(r: f64, g: f64, b: f64, a: f64) -> Color {
    Color { r, g, b, a }
}

/// A measurement drawn on its frame: the spacing in words, and a dot on every micro-image that is blue where its spacing
/// is below the target, red above, white on it, and grey where it is not known.
#[must_use]
pub fn annotations(view: &MeasurementView, map: Option<&FieldMap>) -> ImageAnnotations {
    let timestamp = Some(stamp(view.captured_at));
    let (spacing, pitch) = (&view.spacing, view.micro_image_pitch_px);
    let text = TextAnnotation {
        timestamp,
        position: Some(Point2 { x: 0.5 * pitch, y: (WORDS_PITCHES + 0.5) * pitch }),
        text: format!(
            "{:.4} ± {:.4} px, wanted {:.4} px",
            spacing.spacing_px, spacing.spacing_sigma_px, view.spacing_target_px
        ),
        font_size: WORDS_PITCHES * pitch,
        text_color: Some(if view.in_focus { colour(0.4, 1.0, 0.4, 1.0) } else { colour(1.0, 0.8, 0.2, 1.0) }),
        background_color: Some(colour(0.0, 0.0, 0.0, 0.6)),
    };
    let dots = map.map(|map| {
        let lenses = &map.map.lenses;
        let every = lenses.len().div_ceil(MOST_DRAWN).max(1);
        let drawn = || lenses.iter().step_by(every);
        PointsAnnotation {
            timestamp,
            r#type: points_annotation::Type::Points.into(),
            // The message's origin is the outer corner of the first pixel, the program's its middle.
            points: drawn().map(|lens| Point2 { x: lens.centre_px[0] + 0.5, y: lens.centre_px[1] + 0.5 }).collect(),
            outline_colors: drawn()
                .map(|lens| match lens.state {
                    LensState::Matched => deviation_colour(lens.spacing_px - view.spacing_target_px),
                    _ => colour(0.5, 0.5, 0.5, 0.6),
                })
                .collect(),
            thickness: 0.2 * pitch,
            ..PointsAnnotation::default()
        }
    });
    ImageAnnotations { circles: Vec::new(), points: dots.into_iter().collect(), texts: vec![text] }
}

fn deviation_colour(deviation_px: f64) -> Color {
    let share = (deviation_px / FULL_COLOUR_PX).clamp(-1.0, 1.0);
    let (red, blue) = (1.0 + share.min(0.0), 1.0 - share.max(0.0));
    colour(red, 1.0 - share.abs(), blue, 0.9)
}
