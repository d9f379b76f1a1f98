//! Errors on the wire: the one place that knows status codes and turns an error into `application/problem+json`.

mod refused;

use std::net::IpAddr;
use std::time::Duration;

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use crate::access::{Ended, Principal, Scope, TooMany, Unauthorised, VIEWED_MEASUREMENTS};
use crate::control::Refusal;
use crate::device::DeviceError;

/// The header in which a request shows the control lease's key.
pub const LEASE_HEADER: &str = "Plenalign-Lease";

/// The header in which a request shows a job's confirm key.
pub const CONFIRM_HEADER: &str = "Plenalign-Confirm";

/// What every `type` begins with; the rest is a short name that stays what it is.
pub const TYPE_PREFIX: &str = "urn:plenalign:problem:";

/// A problem as RFC 9457 has it, with members of its own beside the standard ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// What kind of problem: `urn:plenalign:problem:` and a short name, stable.
    #[serde(rename = "type")]
    #[schema(example = "urn:plenalign:problem:limit")]
    pub kind: String,
    /// The kind in words.
    pub title: String,
    /// The HTTP status.
    #[schema(minimum = 400, maximum = 599)]
    pub status: u16,
    /// What was wrong here, and what would be right.
    pub detail: String,
    /// What the kind has beside these, for example `axis`, `low_mm` and `high_mm` of a limit.
    #[serde(flatten)]
    #[schema(value_type = std::collections::HashMap<String, Value>)]
    pub members: Map<String, Value>,
}

/// The problem of who is not let in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UnauthorisedProblem {
    /// What every problem has.
    #[serde(flatten)]
    pub problem: Problem,
    /// Why what was shown opens nothing any more; left out where it is not known to have opened anything.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ended: Option<EndedView>,
}

/// Why a token, or a session that was opened with it, opens nothing any more.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct EndedView {
    /// How it has ended.
    pub how: EndedHow,
    /// Name of the token.
    pub name: String,
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: jiff::Timestamp,
    /// Who revoked it; `null` where it was done on the daemon's machine, and where it has expired.
    pub by: Option<String>,
}

/// How a token has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EndedHow {
    /// Somebody revoked it.
    Revoked,
    /// The end that it was made with has come.
    Expired,
}

impl Problem {
    fn new(status: StatusCode, name: &str, title: &str, detail: impl Into<String>) -> Self {
        Self {
            kind: format!("{TYPE_PREFIX}{name}"),
            title: title.to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            members: Map::new(),
        }
    }

    fn with(mut self, members: Value) -> Self {
        if let Value::Object(members) = members {
            self.members.extend(members);
        }
        self
    }

    /// Nothing is found under this path, or under the name in it.
    #[must_use]
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// A recording that is asked for is still being written.
    #[must_use]
    pub fn still_recording(job: uuid::Uuid) -> Self {
        let detail = format!("job {job} is still being recorded; its recording can be had once the job has ended");
        Self::new(StatusCode::CONFLICT, "still-recording", "The recording is not whole yet", detail)
            .with(json!({ "job": job }))
    }

    /// The path exists, the method on it does not.
    #[must_use]
    pub fn method_not_allowed(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::METHOD_NOT_ALLOWED, "method-not-allowed", "Method not allowed", detail)
    }

    /// The body or a parameter is not even JSON or a number.
    #[must_use]
    pub fn malformed(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "malformed", "The request cannot be read", detail)
    }

    /// The body is JSON and does not say what it must; `field` is where.
    #[must_use]
    pub fn invalid(field: &str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "invalid", "The request does not say what it must", detail)
            .with(json!({ "field": field }))
    }

    /// The body is longer than any request is.
    #[must_use]
    pub fn too_large(limit_bytes: usize) -> Self {
        let detail = format!("a request's body may be {limit_bytes} bytes long");
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "too-large", "The body is too large", detail)
            .with(json!({ "limit_bytes": limit_bytes }))
    }

    /// The request's head is larger than any client's has to be.
    #[must_use]
    pub fn head_too_large(limit_headers: usize, limit_bytes: usize) -> Self {
        let detail = format!(
            "a request may have {limit_headers} headers, and {limit_bytes} bytes of them and of its path together"
        );
        Self::new(
            StatusCode::REQUEST_HEADER_FIELDS_TOO_LARGE,
            "head-too-large",
            "The request's head is too large",
            detail,
        )
        .with(json!({ "limit_headers": limit_headers, "limit_bytes": limit_bytes }))
    }

    /// The body is not said to be JSON.
    #[must_use]
    pub fn unsupported_media_type(found: Option<&str>) -> Self {
        let detail = format!("the body's content type is {}; send application/json", found.unwrap_or("not given"));
        Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "unsupported-media-type", "The body is not JSON", detail)
    }

    /// The `Host` named is not this machine: a page elsewhere has had its name point here.
    #[must_use]
    pub fn wrong_host(host: &str, loopback_only: bool) -> Self {
        let right =
            if loopback_only { "use 127.0.0.1 or localhost" } else { "use its address, or one of server.names" };
        let detail = format!("this daemon is not {host:?}; {right}");
        Self::new(StatusCode::MISDIRECTED_REQUEST, "wrong-host", "Another host is meant", detail)
    }

    /// A page of another origin asks for more than to read.
    #[must_use]
    pub fn cross_origin(origin: &str) -> Self {
        let detail = format!("a page from {origin:?} may not command this bench; use the page served here");
        Self::new(StatusCode::FORBIDDEN, "cross-origin", "Not from this origin", detail)
    }

    /// The request says that a proxy forwarded it, and none is trusted there.
    #[must_use]
    pub fn untrusted_proxy(header: &str, address: IpAddr) -> Self {
        let detail = format!(
            "the header {header} says that a proxy forwarded this, and {address} is none of server.trusted_proxies; \
             name it there, or ask directly"
        );
        Self::new(StatusCode::FORBIDDEN, "untrusted-proxy", "Not through this proxy", detail)
    }

    /// A trusted proxy does not say whom it asks for.
    #[must_use]
    pub fn nameless_proxy() -> Self {
        let detail = "the proxy has to say in X-Forwarded-For whom it asks for: an address, or several with commas";
        Self::new(StatusCode::BAD_REQUEST, "nameless-proxy", "Whom the proxy asks for is not known", detail)
    }

    /// Who asks is not let in.
    #[must_use]
    pub fn unauthorised(why: Unauthorised) -> Self {
        let detail = match why {
            Unauthorised::Nothing => "sign in on the page, or send a token: Authorization: Bearer plenalign_…",
            Unauthorised::Wrong => {
                "this token, ticket or session is not valid: it may have expired, or have been revoked"
            }
            Unauthorised::TooMany(wait) => return Self::too_many(wait),
            Unauthorised::Ended(ended) => return Self::ended(ended),
        };
        Self::new(StatusCode::UNAUTHORIZED, "unauthorised", "Not signed in", detail)
    }

    /// Who asks was let in once, and is no more.
    fn ended(ended: Ended) -> Self {
        let (what, ended) = match ended {
            Ended::Revoked { name, at, by } => {
                let whence = by.as_ref().map_or_else(|| "on the daemon's machine".to_owned(), |by| format!("by {by}"));
                (format!("was revoked {whence}"), EndedView { how: EndedHow::Revoked, name, at, by })
            }
            Ended::Expired { name, at } => {
                ("has expired".to_owned(), EndedView { how: EndedHow::Expired, name, at, by: None })
            }
        };
        let detail = format!("the token of {} {what} at {:.0}: ask for another", ended.name, ended.at);
        Self::new(StatusCode::UNAUTHORIZED, "unauthorised", "Not signed in", detail).with(json!({ "ended": ended }))
    }

    /// Who asks is known, and may not do this.
    #[must_use]
    pub fn scope(principal: &Principal, needed: Scope) -> Self {
        let detail = format!("{} has the scope {}; this needs {needed}", principal.name, principal.scope);
        Self::new(StatusCode::FORBIDDEN, "scope", "Not allowed", detail)
            .with(json!({ "scope": principal.scope, "needed": needed }))
    }

    /// Something comes too often.
    #[must_use]
    pub fn too_many(TooMany(wait): TooMany) -> Self {
        let seconds = wait.as_secs_f64().ceil().max(1.0) as u64;
        let detail = format!("too many requests; try again in {seconds} s");
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too-many-requests", "Too many requests", detail)
            .with(json!({ "retry_after_s": seconds }))
    }

    /// As many different viewports are watched as may be.
    #[must_use]
    pub fn too_many_viewports(limit: usize) -> Self {
        let detail = format!(
            "{limit} different viewports are watched, as many as server.max_viewports allows; ask for the whole frame by \
             reduce, or for one of these, or again when another viewer has gone"
        );
        Self::new(StatusCode::TOO_MANY_REQUESTS, "too-many-viewports", "Too many viewports", detail)
            .with(json!({ "limit": limit }))
    }

    /// Who may only look has had as many measurements kept as they may.
    #[must_use]
    pub fn too_many_measurements(wait: TooMany) -> Self {
        let mut problem = Self::too_many(wait);
        problem.detail = format!(
            "measurements are kept, and the scope view has {VIEWED_MEASUREMENTS} measurements a minute: {}; a token of \
             scope control has no such limit, and GET /api/v1/measurement has the newest one for everybody",
            problem.detail
        );
        problem
    }

    /// Every connection that may ask for anything is taken; `instead` says what this one can do.
    #[must_use]
    pub fn crowded(instead: &str) -> Self {
        let detail = format!("every connection is taken; {instead}");
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "crowded", "Too many connections", detail)
    }

    /// Plain HTTP where TLS is spoken.
    #[must_use]
    pub fn tls_required() -> Self {
        let detail =
            "TLS is spoken here, and this was plain HTTP: use https://. A token sent like this should be revoked";
        Self::new(StatusCode::BAD_REQUEST, "tls-required", "Plain HTTP on a TLS port", detail)
    }

    /// The body did not come in time.
    #[must_use]
    pub fn slow_body(allowed: Duration) -> Self {
        let detail = format!("a request's body has to come within {} s", allowed.as_secs());
        Self::new(StatusCode::REQUEST_TIMEOUT, "slow-body", "The body is late", detail)
    }

    /// A token's name is taken.
    #[must_use]
    pub fn taken(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, "taken", "There is one already", detail)
    }

    /// The state folder cannot be written.
    #[must_use]
    pub fn not_kept(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "not-kept", "The change cannot be kept", detail)
    }

    /// The daemon runs without a configuration file, so that there is none to write.
    #[must_use]
    pub fn no_config_file() -> Self {
        let detail = "the daemon runs without a configuration file; start it with one to write it from here: \
            plenalign serve --config /etc/plenalign/plenalign.toml, which may be empty at first";
        Self::new(StatusCode::CONFLICT, "no-config-file", "There is no configuration file", detail)
    }

    /// The configuration file cannot be read or written into as it is.
    #[must_use]
    pub fn config_unreadable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, "config-unreadable", "The configuration file cannot be used", detail)
    }

    /// The request does not say which state of the file it changes.
    #[must_use]
    pub fn if_match_missing(now: &str) -> Self {
        let detail = "read the configuration first and send its ETag as If-Match, so that nobody's change is lost";
        Self::new(StatusCode::PRECONDITION_REQUIRED, "if-match-missing", "Which state is changed?", detail)
            .with(json!({ "etag": now }))
    }

    /// The file is no longer in the state that was changed.
    #[must_use]
    pub fn config_changed(now: &str) -> Self {
        let detail = "the configuration file has changed since it was read; read it again";
        Self::new(StatusCode::PRECONDITION_FAILED, "config-changed", "The file has changed", detail)
            .with(json!({ "etag": now }))
    }

    /// The configuration makes no sense; `problems` says key by key why.
    #[must_use]
    pub fn config_invalid(problems: Value) -> Self {
        let detail = "the configuration is not written: problems says what is wrong with it, key by key";
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, "config-invalid", "The configuration makes no sense", detail)
            .with(json!({ "problems": problems }))
    }

    /// No camera can be as the draft asks for.
    #[must_use]
    pub fn design_impossible(problems: Value) -> Self {
        let detail = if problems.as_array().is_some_and(Vec::is_empty) {
            "each value could be, and together they come to no finite numbers"
        } else {
            "problems says what is wrong with it, key by key"
        };
        // Each value fits the contract: they conflict with each other, or with those that they are laid over.
        Self::new(StatusCode::CONFLICT, "design-impossible", "No camera can be like that", detail)
            .with(json!({ "problems": problems }))
    }

    /// The configuration changes what is changed only on the machine itself.
    #[must_use]
    pub fn config_locked(problems: Value) -> Self {
        let detail = "the configuration is not written: it changes keys that are locked, which problems names";
        Self::new(StatusCode::FORBIDDEN, "config-locked", "The key is locked", detail)
            .with(json!({ "problems": problems }))
    }

    /// Things can be made to go wrong with a simulated bench only.
    #[must_use]
    pub fn not_simulated() -> Self {
        let detail = "this bench is not simulated; start the daemon with --simulated to try faults";
        Self::new(StatusCode::CONFLICT, "not-simulated", "The bench is not simulated", detail)
    }

    /// The WebSocket's path was asked for without an upgrade.
    #[must_use]
    pub fn upgrade_required(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UPGRADE_REQUIRED, "upgrade-required", "A WebSocket is here", detail)
    }

    /// There is no frame, or only one too old to show.
    #[must_use]
    pub fn no_frame(detail: impl Into<String>, age_ms: Option<f64>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "no-frame", "There is no fresh frame", detail)
            .with(json!({ "frame_age_ms": age_ms }))
    }

    /// The bench cannot be worked with, for these reasons.
    #[must_use]
    pub fn not_ready(hindrances: &[String]) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, "not-ready", "The bench is not ready", hindrances.join("; "))
            .with(json!({ "hindrances": hindrances }))
    }

    /// Nothing has been measured yet.
    #[must_use]
    pub fn no_measurement() -> Self {
        let detail = "nothing has been measured since the program started; start a job";
        Self::new(StatusCode::NOT_FOUND, "no-measurement", "Nothing has been measured", detail)
    }

    /// A mistake of the daemon's own.
    #[must_use]
    pub fn internal() -> Self {
        let detail = "the daemon made a mistake; its log has the particulars";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "internal", "The daemon made a mistake", detail)
    }

    fn refused(name: &str, title: &str, refusal: &Refusal, members: Value) -> Self {
        Self::new(StatusCode::CONFLICT, name, title, refusal.to_string()).with(members)
    }

    fn device(status: StatusCode, name: &str, title: &str, error: &DeviceError, members: Value) -> Self {
        Self::new(status, name, title, error.to_string()).with(members)
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let wait = self.members.get("retry_after_s").and_then(Value::as_u64);
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if status == StatusCode::SERVICE_UNAVAILABLE {
            headers.insert(header::RETRY_AFTER, HeaderValue::from_static("2"));
        }
        if let Some(seconds) = wait {
            headers.insert(header::RETRY_AFTER, seconds.into());
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"plenalign\""));
        }
        if status == StatusCode::UPGRADE_REQUIRED {
            headers.insert(header::UPGRADE, HeaderValue::from_static("websocket"));
        }
        response
    }
}

/// What handlers return.
pub(super) type Result<T> = std::result::Result<T, Problem>;

#[cfg(test)]
mod tests;
