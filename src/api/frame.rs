//! The newest frame as a file.

use std::fmt::Display;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::App;
use super::error::{Problem, Result};
use super::picture::{Encoding, Reduce, age, fresh};
use crate::device::Frame;

/// The newest frame with the camera's own samples, as a PNG of 8 or 16 bits.
#[utoipa::path(
    get, path = "/api/v1/frame.png", operation_id = "get_frame_png", tag = "frames",
    responses(
        (status = 200, body = [u8], content_type = "image/png", headers(
            ("Plenalign-Frame-Seq" = u64, description = "Sequence number from the camera"),
            ("Plenalign-Frame-Age-Ms" = f64, description = "Age when this answer was made"),
            ("Plenalign-Captured-At" = String, description = "End of the exposure, RFC 3339"),
            ("Plenalign-Focus-Mm" = f64, description = "Readback of the focus axis; absent while unknown"),
            ("Plenalign-E-Mm" = f64, description = "Readback of the e axis; absent while unknown"),
            ("Plenalign-Settled" = bool, description = "Whether both axes were at rest during the exposure"),
            ("Plenalign-Preview" = bool, description = "Whether this is a coarse picture for viewing only"),
            ("Plenalign-Simulated" = bool, description = "Whether the frame was simulated"),
            ("Plenalign-Replayed" = bool, description = "Whether the frame is of old, played from a file"),
        )),
        (status = 304, description = "The frame named by If-None-Match is still the newest"),
        (status = 503, description = "No frame, or none fresh", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn png(State(app): State<App>, headers: HeaderMap) -> Result<Response> {
    answer(&app, &headers, Encoding::Png, "image/png").await
}

/// The newest frame for viewing, as a greyscale JPEG; the headers are those of the PNG.
#[utoipa::path(
    get, path = "/api/v1/frame.jpg", operation_id = "get_frame_jpeg", tag = "frames",
    responses(
        (status = 200, body = [u8], content_type = "image/jpeg"),
        (status = 304, description = "The frame named by If-None-Match is still the newest"),
        (status = 503, description = "No frame, or none fresh", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn jpg(State(app): State<App>, headers: HeaderMap) -> Result<Response> {
    answer(&app, &headers, Encoding::Jpeg { reduce: Reduce::Not }, "image/jpeg").await
}

async fn answer(app: &App, asked: &HeaderMap, encoding: Encoding, content_type: &'static str) -> Result<Response> {
    let max_age = Duration::from_millis(app.service.config().bench.camera.timeout_ms);
    let camera = app.service.bench().camera.as_ref();
    let frame = fresh(camera, max_age).await.map_err(|age| {
        let fault = camera.state().borrow().fault.clone();
        let why = fault.unwrap_or_else(|| format!("no frame came within {} ms", max_age.as_millis()));
        Problem::no_frame(why, age.map(milliseconds))
    })?;
    let etag = format!("\"{}-{}\"", app.hub.boot_id().simple(), frame.seq);
    let mut headers = frame_headers(&frame);
    insert(&mut headers, header::ETAG, &etag);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if asked.get(header::IF_NONE_MATCH).is_some_and(|value| value.as_bytes() == etag.as_bytes()) {
        return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
    }
    let picture = app.pictures.encode(&frame, encoding).await.map_err(|error| {
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

fn frame_headers(frame: &Frame) -> HeaderMap {
    let mut headers = HeaderMap::new();
    let mut say = |name, value: &dyn Display| insert(&mut headers, HeaderName::from_static(name), value);
    say("plenalign-frame-seq", &frame.seq);
    say("plenalign-frame-age-ms", &milliseconds(age(frame)));
    say("plenalign-captured-at", &frame.captured_at);
    if let Some(position) = frame.focus.position {
        say("plenalign-focus-mm", &position.value());
    }
    if let Some(position) = frame.e.position {
        say("plenalign-e-mm", &position.value());
    }
    say("plenalign-settled", &(frame.focus.settled && frame.e.settled));
    say("plenalign-preview", &frame.preview);
    say("plenalign-simulated", &frame.simulated);
    say("plenalign-replayed", &frame.replayed);
    headers
}

fn insert(headers: &mut HeaderMap, name: HeaderName, value: &dyn Display) {
    if let Ok(value) = HeaderValue::try_from(value.to_string()) {
        headers.insert(name, value);
    }
}

/// A duration in milliseconds, to the microsecond.
pub(super) fn milliseconds(duration: Duration) -> f64 {
    duration.as_micros() as f64 / 1000.0
}
