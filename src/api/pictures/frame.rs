//! The newest frame as a file.

use std::fmt::Display;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nix::time::{ClockId, clock_gettime};
use serde::Deserialize;
use tokio::time::Instant;
use utoipa::IntoParams;

use super::picture::{DEFAULT_QUALITY, Encoding, QUALITIES, Reduce, age, fresh};
use super::viewport::whole;
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::Query;
use crate::device::Frame;

/// The newest frame with the camera's own samples, as a PNG of 8 or 16 bits.
#[utoipa::path(
    get, path = "/api/v1/frame.png", operation_id = "get_frame_png", tag = "frames",
    responses(
        (status = 200, body = [u8], content_type = "image/png", headers(
            ("Plenalign-Frame-Seq" = u64, description = "Sequence number from the camera"),
            ("Plenalign-Frame-Age-Ms" = f64, description = "Age when this answer was made"),
            ("Plenalign-Captured-At" = String, description = "End of the exposure, RFC 3339"),
            ("Plenalign-Captured-Monotonic-Ms" = f64,
             description = "The same on the daemon's machine's CLOCK_MONOTONIC, which no setting of the clock disturbs"),
            ("Plenalign-Exposure-Ms" = f64, description = "Length of the exposure"),
            ("Plenalign-Exposure-Assumed" = bool, description = "Whether that is assumed, not the driver's word"),
            ("Plenalign-Focus-Mm" = f64, description = "Readback of the focus axis; absent while unknown"),
            ("Plenalign-E-Mm" = f64, description = "Readback of the e axis; absent while unknown"),
            ("Plenalign-Settled" = bool, description = "Whether both axes were at rest during the exposure"),
            ("Plenalign-Preview" = bool, description = "Whether this is a coarse picture for viewing only"),
            ("Plenalign-Simulated" = bool, description = "Whether the frame was simulated"),
            ("Plenalign-Replayed" = bool, description = "Whether the frame was recorded earlier and is played from a file"),
        )),
        (status = 304, description = "The frame named by If-None-Match is still the newest"),
        (status = 503, description = "No frame, or none fresh", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn png(State(app): State<App>, headers: HeaderMap) -> Result<Response> {
    answer(&app, &headers, |_| Encoding::Png, "image/png", None).await
}

/// What `reduce` may be.
fn reductions() -> utoipa::openapi::schema::Object {
    use utoipa::openapi::schema::{ObjectBuilder, Type};
    ObjectBuilder::new().schema_type(Type::Integer).enum_values(Some([1, 2, 4])).default(Some(1.into())).build()
}

/// How one picture for viewing is wanted.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct SnapshotAsked {
    /// Raw pixels to a picture pixel, each way: 1, 2 or 4.
    #[param(schema_with = reductions)]
    reduce: Option<u32>,
    /// Quality of the JPEG, 10 to 100.
    #[param(default = 80, minimum = 10, maximum = 100)]
    quality: Option<u8>,
}

/// How pictures for viewing are wanted.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct PictureAsked {
    /// Raw pixels to a picture pixel, each way: 1, 2 or 4.
    #[param(schema_with = reductions)]
    reduce: Option<u32>,
    /// Quality of the JPEG, 10 to 100.
    #[param(default = 80, minimum = 10, maximum = 100)]
    quality: Option<u8>,
    /// At most so many pictures a second, 0.1 to 60 (streams).
    #[param(default = 15, minimum = 0.1, maximum = 60)]
    max_rate_hz: Option<f64>,
}

/// How coarse the whole frame is, and the quality of its JPEG.
fn coarseness(reduce: Option<u32>, quality: Option<u8>) -> Result<(Reduce, u8)> {
    let number = reduce.unwrap_or(1);
    let reduce = Reduce::from_number(number)
        .ok_or_else(|| Problem::invalid("reduce", format!("reduce: {number} is not 1, 2 or 4")))?;
    let quality = quality.unwrap_or(DEFAULT_QUALITY);
    if !QUALITIES.contains(&quality) {
        return Err(Problem::invalid("quality", format!("quality: {quality} is not within 10 to 100")));
    }
    Ok((reduce, quality))
}

impl PictureAsked {
    /// How coarse the frame was asked for, and of what quality.
    pub(in crate::api) fn coarseness(self) -> Result<(Reduce, u8)> {
        coarseness(self.reduce, self.quality)
    }

    /// Least time between two pictures.
    pub(in crate::api) fn interval(self) -> Result<Duration> {
        let rate = self.max_rate_hz.unwrap_or(15.0);
        if !(0.1..=60.0).contains(&rate) {
            return Err(Problem::invalid("max_rate_hz", format!("max_rate_hz: {rate} is not within 0.1 to 60")));
        }
        Ok(Duration::from_secs_f64(1.0 / rate))
    }
}

/// A frame taken after this was asked for, as a greyscale JPEG; the headers are those of the PNG.
#[utoipa::path(
    get, path = "/api/v1/snapshot.jpg", operation_id = "get_snapshot", tag = "frames", params(SnapshotAsked),
    responses(
        (status = 200, body = [u8], content_type = "image/jpeg"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "No frame came in time", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn snapshot(
    State(app): State<App>,
    Query(asked): Query<SnapshotAsked>,
    headers: HeaderMap,
) -> Result<Response> {
    let (reduce, quality) = coarseness(asked.reduce, asked.quality)?;
    let encoding = |frame: &Frame| whole(&frame.image, reduce, quality).encoding();
    answer(&app, &headers, encoding, "image/jpeg", Some(Instant::now())).await
}

impl App {
    /// That no frame came within so long; the newest one, if any, is of this age.
    pub(in crate::api) fn no_fresh_frame(&self, within: Duration, age: Option<Duration>) -> Problem {
        let fault = self.service.bench().camera.state().borrow().fault.clone();
        let why = fault.unwrap_or_else(|| format!("no frame came within {} ms", within.as_millis()));
        Problem::no_frame(why, age.map(milliseconds))
    }
}

async fn answer(
    app: &App,
    asked: &HeaderMap,
    encoding: impl FnOnce(&Frame) -> Encoding,
    content_type: &'static str,
    not_before: Option<Instant>,
) -> Result<Response> {
    let max_age = Duration::from_millis(app.service.config().bench.camera.timeout_ms);
    let camera = app.service.bench().camera.as_ref();
    let frame = fresh(camera, max_age, not_before).await.map_err(|age| app.no_fresh_frame(max_age, age))?;
    let etag = format!("\"{}-{}\"", app.hub.boot_id().simple(), frame.seq);
    let mut headers = frame_headers(&frame);
    insert(&mut headers, header::ETAG, &etag);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if asked.get(header::IF_NONE_MATCH).is_some_and(|value| value.as_bytes() == etag.as_bytes()) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let picture = app.pictures.encode(&frame, encoding(&frame)).await.map_err(|error| {
        tracing::error!(%error, seq = frame.seq, "a frame could not be encoded");
        Problem::internal()
    })?;
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    if frame.simulated {
        let extension = content_type.trim_start_matches("image/").replace("jpeg", "jpg");
        let name = format!("inline; filename=\"simulated-frame-{}.{extension}\"", frame.seq);
        insert(&mut headers, header::CONTENT_DISPOSITION, &name);
    }
    Ok((headers, picture).into_response())
}

pub(in crate::api) fn frame_headers(frame: &Frame) -> HeaderMap {
    let mut headers = HeaderMap::new();
    let mut say = |name, value: &dyn Display| insert(&mut headers, HeaderName::from_static(name), value);
    say("plenalign-frame-seq", &frame.seq);
    say("plenalign-frame-age-ms", &milliseconds(age(frame)));
    say("plenalign-captured-at", &frame.captured_at);
    say("plenalign-captured-monotonic-ms", &milliseconds(monotonic(frame.exposed_to)));
    say("plenalign-exposure-ms", &milliseconds(frame.exposed_to.saturating_duration_since(frame.exposed_from)));
    say("plenalign-exposure-assumed", &frame.exposure_assumed);
    if let Some(position) = frame.focus.position {
        say("plenalign-focus-mm", &position.value());
    }
    if let Some(position) = frame.e.position {
        say("plenalign-e-mm", &position.value());
    }
    say("plenalign-settled", &frame.is_settled());
    say("plenalign-preview", &frame.preview);
    say("plenalign-simulated", &frame.simulated);
    say("plenalign-replayed", &frame.replayed);
    headers
}

pub(in crate::api) fn insert(headers: &mut HeaderMap, name: HeaderName, value: &dyn Display) {
    if let Ok(value) = HeaderValue::try_from(value.to_string()) {
        headers.insert(name, value);
    }
}

/// A moment on the system's CLOCK_MONOTONIC: comparable between the programs of one machine until it is started anew.
pub(in crate::api) fn monotonic(moment: Instant) -> Duration {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).map(Duration::from).unwrap_or_default();
    now.saturating_sub(moment.elapsed())
}

/// A duration in milliseconds, to the microsecond.
pub(in crate::api) fn milliseconds(duration: Duration) -> f64 {
    duration.as_micros() as f64 / 1000.0
}
