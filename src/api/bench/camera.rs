//! The camera's exposure and gain, and how the newest frame is exposed.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::{IntoParams, ToSchema};

use crate::access::{AuditRecord, Principal};
use crate::api::App;
use crate::api::contract::Leased;
use crate::api::error::{Problem, Result};
use crate::api::extract::{JsonBody, LeaseKey, PathName, PathParam, Query};
use crate::api::pictures::frame::milliseconds;
use crate::api::pictures::picture::{age, fresh};
use crate::control::ServiceError;
use crate::control::service::light::{AutoExposureView, LightView};
use crate::device::light::ControlName;
use crate::raw::CLIPPED_SHARE;

/// Ranges of a histogram where no number is asked for, and the most that may be asked for: every level of 16 bits.
const RANGES: (u64, u64) = (256, 65_536);

impl PathName for ControlName {
    fn from_path(text: &str) -> std::result::Result<Self, String> {
        let named = Self::ALL.into_iter().find(|control| control.name() == text);
        named.ok_or_else(|| format!("there is no control {text:?} here; there are exposure and gain"))
    }
}

/// What a control of the camera is to be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlRequest {
    /// The value, in the control's unit. The camera is set to the nearest that it takes, which the answer has.
    pub value: f64,
}

/// The camera's exposure and gain, with value, limits and unit as the camera has them.
#[utoipa::path(
    get, path = "/api/v1/camera/controls", operation_id = "get_camera_controls", tag = "camera",
    responses(
        (status = 200, body = LightView),
        (status = 503, description = "The camera is away", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn controls(State(app): State<App>) -> Result<Json<LightView>> {
    Ok(Json(app.service.light().await?))
}

/// Sets the camera's exposure or gain, until it is set otherwise or the program ends.
///
/// Refused while a job holds the bench. A change drops the white frame, and what was read of the scene is gone: the next
/// job takes a white frame, and its frames, with the camera set so. Set back as it was, the white frame counts again.
#[utoipa::path(
    put, path = "/api/v1/camera/controls/{control}", operation_id = "set_camera_control", tag = "camera",
    request_body = ControlRequest,
    params(("control" = ControlName, Path, description = "Which control"), LeaseKey),
    responses(
        (status = 200, description = "The camera is set", body = LightView),
        (status = 409, description = "A job holds the bench or the exposure is searched for (`busy`), the value is \
                                      outside the control's limits (`control-range`), or the camera has no such control, or \
                                      adjusts it by itself (`no-control`)", body = Problem,
         content_type = "application/problem+json"),
        (status = 503, description = "The camera is away, or refuses", body = Problem,
         content_type = "application/problem+json"),
        Leased,
    )
)]
pub(in crate::api) async fn set_control(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(control): PathParam<ControlName>,
    key: LeaseKey,
    JsonBody(request): JsonBody<ControlRequest>,
) -> Result<Json<LightView>> {
    let (permit, wanted) = (app.permit(&key)?, request.value);
    let gate = Arc::clone(&app.gate);
    let tell = move |done: &Told<LightView>| {
        let mut detail = json!({ "control": control, "wanted": wanted });
        match done {
            Ok(view) => {
                let set = view.controls.iter().find(|of| of.name == control);
                detail["value"] = json!(set.and_then(|of| of.value));
            }
            Err(error) => detail["error"] = json!(error.to_string()),
        }
        gate.audit(AuditRecord::of(&principal, "camera.set", detail));
    };
    Ok(Json(app.service.set_light(&permit, control, wanted, tell).await?))
}

/// Finds exposure and gain for a white frame, by frames of what is before the lens now: put the diffuser on it first.
///
/// The bright pixels come to lie at four fifths of white, and hardly any is clipped; exposure goes before gain, and no
/// frame is exposed for longer than the time between two. It takes some seconds, in which no job is accepted. Refused while
/// a job holds the bench. A picture that is right is left as it is. Where the camera's steps are too coarse, the brightest
/// that is not too bright is taken, down to half of white; where there is too much light or too little, the camera
/// is set back to as it was. A change drops the white frame, as setting a control does.
#[utoipa::path(
    post, path = "/api/v1/camera/auto-exposure", operation_id = "auto_expose", tag = "camera", params(LeaseKey),
    responses(
        (status = 200, description = "The picture is exposed for a white frame", body = AutoExposureView),
        (status = 409, description = "A job holds the bench or a search is under way (`busy`), there is too much \
                                      light or too little, or the camera's steps are too coarse (`not-exposed`), or \
                                      nothing of the camera can be set (`no-control`)",
         body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The camera is away, or refuses", body = Problem,
         content_type = "application/problem+json"),
        Leased,
    )
)]
pub(in crate::api) async fn auto_expose(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    key: LeaseKey,
) -> Result<Json<AutoExposureView>> {
    let permit = app.permit(&key)?;
    let gate = Arc::clone(&app.gate);
    let tell = move |done: &Told<AutoExposureView>| {
        let detail = match done {
            Ok(found) => {
                let controls = found.light.controls.iter().map(|of| (of.name.name().to_owned(), json!(of.value)));
                json!({ "controls": controls.collect::<serde_json::Map<_, _>>(), "changed": found.changed })
            }
            Err(error) => json!({ "error": error.to_string() }),
        };
        gate.audit(AuditRecord::of(&principal, "camera.auto_exposure", detail));
    };
    Ok(Json(app.service.auto_expose(&permit, tell).await?))
}

/// What came of a command, for the audit log: that is written whether or not somebody waits for the answer.
type Told<T> = std::result::Result<T, ServiceError>;

/// How finely a histogram is wanted.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct HistogramAsked {
    /// In how many ranges of grey levels the pixels are counted, 2 to 65536; never more than the sensor has levels.
    #[param(default = 256, minimum = 2, maximum = 65536)]
    ranges: Option<u64>,
}

/// How many pixels of a raw frame have which grey level: all of them, at the sensor's full depth; of a mosaic all colours
/// together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistogramView {
    /// Sequence number of the frame.
    pub frame_seq: u64,
    /// End of its exposure, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub captured_at: jiff::Timestamp,
    /// Age of the frame when this was said, ms.
    pub frame_age_ms: f64,
    /// Significant bits of a sample.
    #[schema(minimum = 1, maximum = 16)]
    pub bits: u8,
    /// Grey levels in each range but the last, which may have fewer.
    pub levels_per_range: u64,
    /// Pixels in each range, darkest first.
    pub counts: Vec<u64>,
    /// Share of the pixels at level 0: darker they cannot be.
    pub black_share: f64,
    /// From which level on a pixel is clipped: within 2 % of white, which is the greatest level, or 235 of video levels.
    pub clipped_from: u16,
    /// Share of the pixels that are clipped: they may have got more light than they can tell.
    pub clipped_share: f64,
    /// Whether that is too much: more than hot pixels and mirrored lamps make up.
    pub overexposed: bool,
    /// Whether the frame was simulated.
    pub simulated: bool,
    /// Whether the frame was recorded earlier and is played from a file.
    pub replayed: bool,
}

/// The grey levels of the newest frame, with what is clipped at either end; of one exposed as the camera is set now.
/// Counted when it is asked for.
#[utoipa::path(
    get, path = "/api/v1/camera/histogram", operation_id = "get_histogram", tag = "camera", params(HistogramAsked),
    responses(
        (status = 200, body = HistogramView),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "No frame, or none fresh", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn histogram(
    State(app): State<App>,
    Query(asked): Query<HistogramAsked>,
) -> Result<Json<HistogramView>> {
    let ranges = asked.ranges.unwrap_or(RANGES.0);
    if !(2..=RANGES.1).contains(&ranges) {
        return Err(Problem::invalid("ranges", format!("ranges: {ranges} is not within 2 to {}", RANGES.1)));
    }
    let max_age = Duration::from_millis(app.service.config().bench.camera.timeout_ms);
    let camera = app.service.bench().camera.as_ref();
    let mut frame = fresh(camera, max_age, None).await;
    // What was exposed otherwise says nothing of how the camera is set now.
    if frame.as_ref().is_ok_and(|frame| !app.service.is_exposed_so(frame)) {
        frame = fresh(camera, max_age, app.service.light_set_at()).await;
    }
    let frame = frame.map_err(|age| app.no_fresh_frame(max_age, age))?;
    let counted = app.service.histogram_of(&frame).await?;
    let levels_per_range = counted.levels().div_ceil(ranges as usize) as u64;
    Ok(Json(HistogramView {
        frame_seq: frame.seq,
        captured_at: frame.captured_at,
        frame_age_ms: milliseconds(age(&frame)),
        bits: frame.image.bits(),
        levels_per_range,
        counts: counted.in_ranges(ranges as usize),
        black_share: counted.black_share(),
        clipped_from: counted.clipped_from(),
        clipped_share: counted.clipped_share(),
        overexposed: counted.clipped_share() > CLIPPED_SHARE,
        simulated: frame.simulated,
        replayed: frame.replayed,
    }))
}
