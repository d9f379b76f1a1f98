//! The live picture for generic viewers: an endless `multipart/x-mixed-replace` of JPEGs.
//!
//! The newest frame wins; what a viewer was not sent is counted in each part's headers. While no frame comes, a picture
//! that says why takes its place, so that no viewer shows an old frame as live.

use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Duration;

use axum::Extension;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::access::Principal;
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::Query;
use crate::api::pictures::frame::{PictureAsked, frame_headers};
use crate::api::pictures::picture::{Reduce, Skipped, age, next};
use crate::api::pictures::placeholder;
use crate::api::pictures::viewport::whole;
use crate::device::Frame;
use crate::telemetry::{self, ViewerKind, Viewing};

/// What parts two pictures.
const BOUNDARY: &str = "plenalign-frame";
/// Between two pictures that say why there is none.
const PLACEHOLDER_INTERVAL: Duration = Duration::from_secs(1);

/// The live picture as MJPEG.
#[utoipa::path(
    get, path = "/api/v1/stream.mjpg", operation_id = "get_stream", tag = "frames", params(PictureAsked),
    responses(
        (status = 200, description = "An endless stream of JPEGs", body = [u8],
         content_type = "multipart/x-mixed-replace"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn mjpeg(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    Query(asked): Query<PictureAsked>,
) -> Result<Response> {
    let ((reduce, quality), interval) = (asked.coarseness()?, asked.interval()?);
    let mut frames = app.service.bench().camera.live();
    // The picture there is counts as new.
    frames.mark_changed();
    let viewer = Viewer {
        app,
        principal,
        frames,
        reduce,
        quality,
        interval,
        next_at: Instant::now(),
        skipped: Skipped::default(),
        live: false,
        _viewing: telemetry::viewing(ViewerKind::Mjpeg),
    };
    let parts = stream::unfold(viewer, |mut viewer| async move {
        let part = viewer.next().await?;
        Some((Ok::<Bytes, std::convert::Infallible>(part), viewer))
    });
    let content_type = HeaderValue::from_static("multipart/x-mixed-replace;boundary=plenalign-frame");
    Ok(([(header::CONTENT_TYPE, content_type)], Body::from_stream(parts)).into_response())
}

struct Viewer {
    app: App,
    principal: Principal,
    frames: watch::Receiver<Option<Arc<Frame>>>,
    reduce: Reduce,
    quality: u8,
    interval: Duration,
    next_at: Instant,
    skipped: Skipped,
    /// Whether the last picture sent was a live one.
    live: bool,
    _viewing: Viewing,
}

impl Viewer {
    /// The next part; none once the program ends, or whoever looks would no longer be let in.
    async fn next(&mut self) -> Option<Bytes> {
        if !self.app.gate.knows(&self.principal) {
            return None;
        }
        let shutdown = self.app.shutdown.clone();
        shutdown.run_until_cancelled(self.part()).await
    }

    async fn part(&mut self) -> Bytes {
        tokio::time::sleep_until(self.next_at).await;
        let max_age = Duration::from_millis(self.app.service.config().bench.camera.timeout_ms);
        // A viewer that has no live picture before it is told soon, and again, what there is to tell.
        let patience = if self.live { max_age } else { PLACEHOLDER_INTERVAL.min(max_age) };
        let newest = tokio::time::timeout(patience, self.newest(max_age)).await;
        self.live = matches!(newest, Ok(Some(_)));
        match newest {
            Ok(Some(frame)) => match self.encoded(&frame).await {
                Ok(jpeg) => {
                    self.next_at = (self.next_at + self.interval).max(Instant::now());
                    let dropped = self.skipped.until(frame.seq);
                    telemetry::picture_sent(ViewerKind::Mjpeg, age(&frame), dropped);
                    let mut headers = String::new();
                    for (name, value) in &frame_headers(&frame) {
                        // Every value was made from text here.
                        let _ = write!(headers, "{name}: {}\r\n", value.to_str().unwrap_or_default());
                    }
                    let captured = frame.captured_at.as_microsecond() as f64 / 1e6;
                    let _ = write!(headers, "x-timestamp: {captured:.6}\r\nplenalign-online: true\r\n");
                    part(&headers, self.skipped.total, &jpeg)
                }
                Err(error) => {
                    tracing::error!(%error, seq = frame.seq, "a frame could not be encoded");
                    self.placeholder("The frame could not be encoded.")
                }
            },
            Ok(None) => {
                tokio::time::sleep(PLACEHOLDER_INTERVAL).await;
                self.placeholder("The camera's driver has ended.")
            }
            Err(_) => {
                let fault = self.app.service.bench().camera.state().borrow().fault.clone();
                self.placeholder(fault.as_deref().unwrap_or("No frame comes from the camera."))
            }
        }
    }

    async fn encoded(&self, frame: &Arc<Frame>) -> std::result::Result<Bytes, String> {
        let shown = whole(&frame.image, self.reduce, self.quality);
        self.app.pictures.encode(frame, shown.encoding()).await
    }

    /// The newest frame that this viewer has not been sent and that is no older than `max_age`.
    async fn newest(&mut self, max_age: Duration) -> Option<Arc<Frame>> {
        loop {
            let frame = next(&mut self.frames).await?;
            if age(&frame) <= max_age {
                return Some(frame);
            }
        }
    }

    fn placeholder(&mut self, why: &str) -> Bytes {
        match placeholder::jpeg(why, jiff::Timestamp::now()) {
            Ok(jpeg) => part("plenalign-online: false\r\n", self.skipped.total, &jpeg),
            Err(error) => {
                tracing::error!(%error, "the placeholder could not be encoded");
                Bytes::new()
            }
        }
    }
}

/// One part, with the boundary that begins it and the one that ends it: a browser shows a part only once it has seen its
/// end.
fn part(headers: &str, dropped: u64, jpeg: &[u8]) -> Bytes {
    let mut bytes = format!(
        "--{BOUNDARY}\r\ncontent-type: image/jpeg\r\ncontent-length: {}\r\nplenalign-dropped: {dropped}\r\n{headers}\r\n",
        jpeg.len()
    )
    .into_bytes();
    bytes.extend_from_slice(jpeg);
    bytes.extend_from_slice(b"\r\n");
    bytes.into()
}
