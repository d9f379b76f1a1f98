//! A job's recording to take away.

use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use futures_util::stream;
use tokio::fs::File;
use tokio::io::AsyncReadExt as _;
use uuid::Uuid;

use crate::api::App;
use crate::api::contract::FromHistory;
use crate::api::error::{Problem, Result};
use crate::api::extract::PathParam;
use crate::control::job::RecordingState;

/// Bytes read from the disk at a time.
const PIECE: usize = 256 << 10;

/// A job's recording, an MCAP file.
///
/// Of one that ended before its job there is what it has; of one that is still being written, nothing yet.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/recording", operation_id = "get_job_recording", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, description = "The file", body = [u8], content_type = "application/octet-stream"),
        FromHistory,
        (status = 409, description = "It is still being written", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn download(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Response> {
    let job = app.service.find_job(id).await?;
    let Some(recording) = &job.recording else {
        return Err(Problem::not_found(format!(
            "job {id} was not recorded; a job is whose request has \"record\": true"
        )));
    };
    if recording.state == RecordingState::Recording && !job.state.is_final() {
        return Err(Problem::still_recording(id));
    }
    let gone = |why: String| Problem::not_found(format!("the recording of job {id} is not there: {why}"));
    let path = app.service.recording_file(recording).map_err(gone)?;
    let file = File::open(&path).await.map_err(|error| gone(format!("{}: {error}", recording.file)))?;
    let length = file.metadata().await.map(|found| found.len()).map_err(|error| gone(error.to_string()))?;
    let pieces = stream::try_unfold(file, |mut file| async move {
        let mut piece = vec![0; PIECE];
        let read = file.read(&mut piece).await?;
        piece.truncate(read);
        Ok::<_, std::io::Error>((read > 0).then(|| (Bytes::from(piece), file)))
    });
    let mut response = Body::from_stream(pieces).into_response();
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    headers.insert(header::CONTENT_LENGTH, length.into());
    let simulated = HeaderValue::from_static(if job.simulated { "true" } else { "false" });
    headers.insert(HeaderName::from_static("plenalign-simulated"), simulated);
    if let Ok(disposition) = HeaderValue::try_from(format!("attachment; filename=\"{}\"", recording.file)) {
        headers.insert(header::CONTENT_DISPOSITION, disposition);
    }
    Ok(response)
}
