//! Measuring for who asks: one frame, at rest or not, and what was measured so before.

use std::time::Duration;

use axum::extract::State;
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::history::PageAsked;
use crate::access::Principal;
use crate::api::App;
use crate::api::contract::FromHistory;
use crate::api::error::{Problem, Result};
use crate::api::extract::{JsonBody, Query};
use crate::control::events::SingleMeasurement;
use crate::control::measuring::measurement::MeasurementRequest;
use crate::whole::whole_or_none;

/// Oldest frame that may be asked for, ms.
const MAX_AGE_MS: u64 = 60_000;

/// Which frame is to be measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MeasurementAsked {
    /// Whether the frame has to be exposed wholly while both axes stood settled. Where it was not, the answer is 409 with
    /// the problem `spans-motion`; with `false` it is measured all the same and `spans_motion` says so.
    #[serde(default = "settled")]
    #[schema(default = true)]
    pub settled: bool,
    /// How long ago the frame's exposure may have begun, ms; where it is not given, it begins after the request.
    #[schema(maximum = 60_000)]
    #[serde(default, deserialize_with = "whole_or_none")]
    pub max_age_ms: Option<u64>,
}

fn settled() -> bool {
    true
}

/// A page of the measurements that belong to no job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeasurementList {
    /// What was measured, newest first.
    pub measurements: Vec<SingleMeasurement>,
    /// What to give as `cursor` for the next, older page; `null` on the last one.
    pub next: Option<String>,
}

/// Measures the spacing in one frame of full quality; nothing moves.
///
/// It is kept in the history beside those of the jobs; a token of scope `view` may ask for ten a minute. A white frame has
/// to have been taken, which every alignment and calibration begins with.
#[utoipa::path(
    post, path = "/api/v1/measurements", operation_id = "measure", tag = "bench", request_body = MeasurementAsked,
    responses(
        (status = 200, body = SingleMeasurement),
        (status = 409, description = "An axis moved during the exposure (`spans-motion`), or there is nothing to be \
                                      measured (`not-measurable`)", body = Problem,
         content_type = "application/problem+json"),
        (status = 429, description = "Too many requests, or more than ten a minute by the scope `view`; Retry-After says \
                                      when to try again", body = Problem,
         content_type = "application/problem+json"),
        (status = 503, description = "No frame came from the camera", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn measure(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(asked): JsonBody<MeasurementAsked>,
) -> Result<Json<SingleMeasurement>> {
    if let Some(age) = asked.max_age_ms.filter(|&age| age > MAX_AGE_MS) {
        return Err(Problem::invalid("max_age_ms", format!("max_age_ms: {age} is more than {MAX_AGE_MS}")));
    }
    app.gate.count_measurement(&principal).map_err(Problem::too_many_measurements)?;
    let request = MeasurementRequest { settled: asked.settled, max_age: asked.max_age_ms.map(Duration::from_millis) };
    Ok(Json(app.service.measure(request).await?))
}

/// The measurements asked for by `POST`, newest first, a page at a time.
#[utoipa::path(
    get, path = "/api/v1/measurements", operation_id = "list_measurements", tag = "bench",
    params(PageAsked),
    responses((status = 200, body = MeasurementList), FromHistory)
)]
pub(in crate::api) async fn list(
    State(app): State<App>,
    Query(asked): Query<PageAsked>,
) -> Result<Json<MeasurementList>> {
    let page =
        app.service.measurements_alone(asked.cursor.map(|number| number.0.unsigned_abs()), asked.limit.0).await?;
    let next = page.items.last().filter(|_| page.more).map(|(number, _)| number.to_string());
    Ok(Json(MeasurementList { measurements: page.items.into_iter().map(|(_, measured)| measured).collect(), next }))
}
