//! What a viewer of the WebSocket is shown, as the messages of `proto/plenalign/v1`.

use std::sync::Arc;

use axum::body::Bytes;

use super::frame::{milliseconds, monotonic};
use super::picture::{Reduce, age};
use super::scene::{Format, Scene};
use super::view::{ends_mm, picture};
use super::viewport::{Part, Shown};
use crate::api::error::{Problem, Result};
use crate::api::types::Show;
use crate::api::{App, proto};
use crate::control::ServiceError;
use crate::control::events::FieldMap;
use crate::control::reading::{NoReading, Reading};
use crate::device::Frame;
use crate::imaging::combined::{Combined, Since};
use crate::imaging::spacing::{LensSpacing, LensState};

/// What pictures a viewer wants.
#[derive(Debug, Clone, Copy)]
pub(in crate::api) struct Wanted {
    pub(in crate::api) show: Show,
    pub(in crate::api) part: Part,
    pub(in crate::api) quality: u8,
}

/// The message that the spacing over the field goes out as.
pub(in crate::api) fn map_message(field: &FieldMap) -> proto::SpacingMap {
    let lenses = &field.map.lenses;
    let each = |value: fn(&LensSpacing) -> f64| lenses.iter().map(|lens| value(lens) as f32).collect();
    proto::SpacingMap {
        frame_seq: field.frame_seq,
        micro_image_pitch_px: field.micro_image_pitch_px,
        spacing_target_px: field.spacing_target_px,
        x_px: each(|lens| lens.centre_px[0]),
        y_px: each(|lens| lens.centre_px[1]),
        spacing_px: each(|lens| lens.spacing_px),
        sigma_px: each(|lens| lens.sigma_px),
        state: lenses.iter().map(|lens| i32::from(lens_state(lens.state))).collect(),
    }
}

/// The message that a reading goes out as.
pub(in crate::api) fn reading_message(reading: &Reading) -> proto::Reading {
    let frame = &reading.frame;
    let message = proto::Reading {
        seq: frame.seq,
        captured_unix_us: frame.captured_at.as_microsecond(),
        captured_monotonic_us: monotonic(frame.exposed_to).as_micros() as u64,
        age_ms: milliseconds(age(frame)),
        focus_mm: frame.focus.position.map(|position| position.value()),
        e_mm: frame.e.position.map(|position| position.value()),
        settled: frame.is_settled(),
        preview: frame.preview,
        simulated: frame.simulated,
        replayed: frame.replayed,
        spacing_target_px: reading.spacing_target_px,
        spacing_tolerance_px: reading.spacing_tolerance_px,
        in_focus: reading.in_focus,
        doubted: reading.doubted,
        frames_left_out: reading.frames_left_out,
        width_px: frame.image.width() as u32,
        ..proto::Reading::default()
    };
    let message = match &reading.combined {
        Some(combined) => with_combined(message, combined),
        None => message,
    };
    match &reading.spacing {
        Ok(spacing) => proto::Reading {
            state: proto::ReadingState::Measured.into(),
            why: reading.unresolved.clone().unwrap_or_default(),
            spacing_px: spacing.on_axis_px,
            spacing_sigma_px: spacing.sigma_px,
            spacing_sigma_random_px: spacing.sigma_random_px,
            tilt_x_px: spacing.tilt_x_px,
            tilt_y_px: spacing.tilt_y_px,
            curvature_px: spacing.curvature_px,
            ..message
        },
        Err(NoReading::Lost(why)) => {
            proto::Reading { state: proto::ReadingState::Lost.into(), why: why.clone(), ..message }
        }
        Err(NoReading::Refused(why)) => {
            proto::Reading { state: proto::ReadingState::Refused.into(), why: why.clone(), ..message }
        }
    }
}

fn with_combined(message: proto::Reading, combined: &Combined) -> proto::Reading {
    let since = match combined.since {
        Since::Start => proto::CombinedSince::Start,
        Since::Axis => proto::CombinedSince::Axis,
        Since::Picture => proto::CombinedSince::Picture,
        Since::Trend => proto::CombinedSince::Trend,
        Since::Lost => proto::CombinedSince::Lost,
    };
    proto::Reading {
        combined_spacing_px: combined.value,
        combined_sigma_px: combined.sigma,
        combined_frames: combined.frames,
        combined_span_s: combined.span_s,
        combined_since: since.into(),
        ..message
    }
}

fn lens_state(state: LensState) -> proto::LensState {
    match state {
        LensState::Matched => proto::LensState::Matched,
        LensState::Mismatched => proto::LensState::Mismatched,
        LensState::Blank => proto::LensState::Blank,
    }
}

/// A picture for a viewer, and what it is of.
pub(in crate::api) struct Picture {
    pub(in crate::api) frame: Arc<Frame>,
    bytes: Bytes,
    /// What of the raw frame it shows, where it shows that.
    shown: Option<Shown>,
    /// The distances that the ends of a depth's colours stand for, mm: far and near.
    ends_mm: [Option<f64>; 2],
}

/// What a viewer is to see of a frame, or of a newer one that was made ready for another viewer meanwhile.
pub(in crate::api) async fn picture_of(app: &App, frame: Arc<Frame>, wanted: Wanted) -> Result<Picture> {
    let scene = match wanted.show {
        Show::Raw => {
            let shown = wanted.part.shown(&frame.image, wanted.quality)?;
            let bytes = app.pictures.encode(&frame, shown.encoding()).await.map_err(|error| {
                tracing::error!(%error, seq = frame.seq, "a frame could not be encoded");
                Problem::internal()
            })?;
            return Ok(Picture { frame, bytes, shown: Some(shown), ends_mm: [None; 2] });
        }
        Show::Central => Scene::central([0.0; 2]),
        Show::AllInFocus => Scene::AllInFocus,
        Show::Depth => Scene::Depth,
    };
    let look = app.service.look_at(&frame).await.map_err(ServiceError::from)?;
    let bytes = picture(app, &look, scene, Format::Jpeg { quality: wanted.quality }).await?;
    let ends_mm = if scene == Scene::Depth { ends_mm(&look) } else { [None; 2] };
    Ok(Picture { frame: Arc::clone(&look.frame), bytes, shown: None, ends_mm })
}

/// The message that a picture of a frame goes out as: one of so many alike in a row.
pub(in crate::api) fn picture_message(
    picture: Picture,
    wanted: Wanted,
    frames_skipped: u64,
    alike: u32,
) -> proto::Frame {
    let Picture { frame, bytes, shown, ends_mm: [far_mm, near_mm] } = picture;
    let pictured = match wanted.show {
        Show::Raw => proto::Picture::Raw,
        Show::Central => proto::Picture::Central,
        Show::AllInFocus => proto::Picture::AllInFocus,
        Show::Depth => proto::Picture::Depth,
    };
    let reduce = match wanted.part {
        Part::Whole(reduce) if wanted.show == Show::Raw => reduce.number(),
        Part::Whole(_) => Reduce::Not.number(),
        Part::Viewport(_) => 0,
    };
    let viewport = shown.map(Shown::message);
    let lossless = viewport.as_ref().is_some_and(|viewport| viewport.lossless);
    let (jpeg, png) = if lossless { (Bytes::new(), bytes) } else { (bytes, Bytes::new()) };
    proto::Frame {
        jpeg,
        seq: frame.seq,
        captured_unix_us: frame.captured_at.as_microsecond(),
        captured_monotonic_us: monotonic(frame.exposed_to).as_micros() as u64,
        exposure_us: frame.exposed_to.saturating_duration_since(frame.exposed_from).as_micros() as u64,
        exposure_assumed: frame.exposure_assumed,
        focus_mm: frame.focus.position.map(|position| position.value()),
        e_mm: frame.e.position.map(|position| position.value()),
        settled: frame.is_settled(),
        preview: frame.preview,
        simulated: frame.simulated,
        age_ms: milliseconds(age(&frame)),
        frames_skipped,
        alike,
        width_px: frame.image.width() as u32,
        height_px: frame.image.height() as u32,
        reduce,
        replayed: frame.replayed,
        picture: pictured.into(),
        viewport,
        png,
        sample_bits: u32::from(frame.image.bits()),
        near_mm,
        far_mm,
    }
}
