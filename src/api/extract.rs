//! Reading requests: a JSON body and path parameters, with every failure a problem.

use std::convert::Infallible;
use std::fmt::Display;
use std::str::FromStr;
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{DefaultBodyLimit, FromRequest, FromRequestParts, Path, Request};
use axum::http::request::Parts;
use axum::http::{HeaderValue, header};
use axum::response::IntoResponse;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::App;
use super::error::{CONFIRM_HEADER, LEASE_HEADER, Problem};
use crate::access::{LOCAL, Principal};
use crate::control::Shown;
use crate::control::field::words;
use crate::control::motion::Stops;

/// Longest body of a request, bytes.
pub(super) const BODY_LIMIT_BYTES: usize = 16 * 1024;

/// How long a request's body may take to come.
const BODY_ALLOWED: Duration = Duration::from_secs(10);

/// A JSON body of so many bytes at most.
pub(super) struct JsonBody<T, const LIMIT_BYTES: usize = BODY_LIMIT_BYTES>(pub T);

impl<S: Send + Sync, T: DeserializeOwned, const LIMIT_BYTES: usize> FromRequest<S> for JsonBody<T, LIMIT_BYTES> {
    type Rejection = Problem;

    async fn from_request(mut request: Request, state: &S) -> Result<Self, Problem> {
        DefaultBodyLimit::max(LIMIT_BYTES).apply(&mut request);
        let content_type = request.headers().get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
        let essence = content_type.map(|value| value.split(';').next().unwrap_or_default().trim());
        if !essence.is_some_and(|essence| essence.eq_ignore_ascii_case("application/json")) {
            return Err(Problem::unsupported_media_type(content_type));
        }
        let bytes = tokio::time::timeout(BODY_ALLOWED, Bytes::from_request(request, state))
            .await
            .map_err(|_| Problem::slow_body(BODY_ALLOWED))?
            .map_err(|rejection| body_problem(&rejection, LIMIT_BYTES))?;
        parse(&bytes).map(Self)
    }
}

fn body_problem(rejection: &BytesRejection, limit_bytes: usize) -> Problem {
    if rejection.status().as_u16() == 413 {
        return Problem::too_large(limit_bytes);
    }
    // The connection broke off within the body: nobody is there to read this.
    Problem::malformed(rejection.body_text())
}

/// JSON text to a value; where it does not fit, the problem names the field.
pub(super) fn parse<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Problem> {
    // The whole text first: what is not JSON at its end is not JSON, whatever its beginning lacks.
    serde_json::from_slice::<serde::de::IgnoredAny>(bytes)
        .map_err(|error| Problem::malformed(format!("the body is not JSON: {error}")))?;
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    serde_path_to_error::deserialize(&mut reader).map_err(|error| {
        let path = error.path().to_string();
        let inner = error.into_inner();
        if inner.is_data() {
            unfit(path, &inner.to_string())
        } else {
            Problem::malformed(format!("the body is not JSON: {inner}"))
        }
    })
}

/// A member of a body that was read before by the member's `name` alone; where it does not fit, the problem names what of it.
pub(super) fn parse_member<T: DeserializeOwned>(name: &str, value: Value) -> Result<T, Problem> {
    serde_path_to_error::deserialize(value).map_err(|error| {
        let field = match field(error.path().to_string(), &error.inner().to_string()) {
            whole if whole == "." => name.to_owned(),
            field => format!("{name}.{field}"),
        };
        Problem::invalid(&field, format!("{field}: {}", error.inner()))
    })
}

/// What serde says of a field that does not fit, at a path from the root.
fn unfit(path: String, message: &str) -> Problem {
    let field = field(path, message);
    Problem::invalid(&field, format!("{field}: {message}"))
}

/// The field that serde means at a path: it names a missing or unknown one in its message, and the path is then that of the
/// object around it.
fn field(path: String, message: &str) -> String {
    let named = message.split('`').nth(1).filter(|_| message.contains("field `"));
    if matches!(path.as_str(), "." | "?") { named.unwrap_or(".").to_owned() } else { path }
}

/// Who stops or cancels, where no token says so. It is no body, which a stop would have to wait for.
#[derive(Debug, serde::Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct Asker {
    /// Who, where no token says so: shown to everybody. What could not be shown is left out, and refuses nothing.
    owner: Option<String>,
}

impl Asker {
    /// What whoever asks is called: the token's name, or the one given; `None` where there is neither.
    pub(super) fn name(asked: Result<Query<Self>, Problem>, principal: &Principal) -> Option<String> {
        if principal.name != LOCAL {
            return Some(principal.name.clone());
        }
        asked.ok().and_then(|Query(Self { owner })| owner).filter(|owner| words("owner", owner).is_ok())
    }
}

/// The control lease's key, as the request shows it.
#[derive(Debug, utoipa::IntoParams)]
#[into_params(parameter_in = Header)]
pub(super) struct LeaseKey {
    /// Key of the control lease.
    #[param(rename = "Plenalign-Lease")]
    key: Option<String>,
    /// The stops when the request's head had come: its body may take its time.
    #[param(ignore)]
    asked: Stops,
}

impl LeaseKey {
    /// The stops when the request was made.
    pub(super) const fn asked(&self) -> Stops {
        self.asked
    }

    /// The key, if one was shown.
    pub(super) fn shown(&self) -> Option<&str> {
        self.key.as_deref()
    }
}

impl FromRequestParts<App> for LeaseKey {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &App) -> Result<Self, Infallible> {
        Ok(Self { key: parts.headers.get(LEASE_HEADER).map(text_of), asked: app.service.stops() })
    }
}

/// What a request shows to be let confirm what a job asks.
#[derive(Debug, utoipa::IntoParams)]
#[into_params(parameter_in = Header)]
pub(super) struct ConfirmKeys {
    /// Key of the lease that the job has.
    #[param(rename = "Plenalign-Lease")]
    lease: Option<String>,
    /// The job's confirm key.
    #[param(rename = "Plenalign-Confirm")]
    confirm: Option<String>,
}

impl ConfirmKeys {
    /// What was shown.
    pub(super) fn shown(&self) -> Shown<'_> {
        Shown { lease: self.lease.as_deref(), confirm: self.confirm.as_deref() }
    }
}

impl<S: Send + Sync> FromRequestParts<S> for ConfirmKeys {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Infallible> {
        let header = |name| parts.headers.get(name).map(text_of);
        Ok(Self { lease: header(LEASE_HEADER), confirm: header(CONFIRM_HEADER) })
    }
}

/// A key as a header shows it. What is not text opens nothing; it is not the same as showing none.
fn text_of(value: &HeaderValue) -> String {
    value.to_str().unwrap_or("?").to_owned()
}

/// What follows the question mark of a path.
pub(super) struct Query<T>(pub T);

impl<S: Send + Sync, T: DeserializeOwned> FromRequestParts<S> for Query<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Self, Problem> {
        let pairs = form_urlencoded::parse(parts.uri.query().unwrap_or_default().as_bytes());
        serde_path_to_error::deserialize(serde_urlencoded::Deserializer::new(pairs))
            .map(Self)
            .map_err(|error| unfit(error.path().to_string(), &error.inner().to_string()))
    }
}

/// The one parameter of a path, such as a job's id.
pub(super) struct PathParam<T>(pub T);

/// What a path parameter names.
pub(super) trait PathName: Sized {
    /// Reads the parameter, or says what would be right.
    fn from_path(text: &str) -> Result<Self, String>;
}

impl PathName for uuid::Uuid {
    fn from_path(text: &str) -> Result<Self, String> {
        read(text).map_err(|error| format!("there is no job {text:?}: a job's id is a UUID ({error})"))
    }
}

impl PathName for crate::device::AxisName {
    fn from_path(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|axis| axis.name() == text)
            .ok_or_else(|| format!("there is no axis {text:?}; there are focus and e"))
    }
}

fn read<T: FromStr>(text: &str) -> Result<T, impl Display + use<T>>
where
    T::Err: Display,
{
    text.parse::<T>()
}

impl<S: Send + Sync, T: PathName> FromRequestParts<S> for PathParam<T> {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Self, Problem> {
        let Path(text) = Path::<String>::from_request_parts(parts, state).await.map_err(|rejection| {
            let status = rejection.into_response().status();
            if status.is_server_error() { Problem::internal() } else { Problem::not_found("the path cannot be read") }
        })?;
        T::from_path(&text).map(Self).map_err(Problem::not_found)
    }
}

#[cfg(test)]
mod tests {
    use super::super::types::{ConfirmRequest, MoveRequest, Show, ViewerMessage};
    use super::*;

    fn field_of(text: &str) -> (u16, String) {
        let problem = parse::<MoveRequest>(text.as_bytes()).unwrap_err();
        let field = problem.members.get("field").map_or_else(String::new, |f| f.as_str().unwrap_or_default().into());
        (problem.status, field)
    }

    #[test]
    fn what_is_not_json_is_400() {
        for text in ["", "{", "nonsense", "{\"position_mm\": 1} trailing", "{\"position_mm\": NaN}"] {
            assert_eq!(field_of(text), (400, String::new()), "{text:?}");
        }
    }

    #[test]
    fn what_does_not_fit_is_422_and_names_the_field() {
        assert_eq!(field_of("{}"), (422, "position_mm".into()));
        assert_eq!(field_of("{\"position_mm\": \"far\"}"), (422, "position_mm".into()));
        assert_eq!(field_of("{\"position_mm\": 1, \"speed\": 2}"), (422, "speed".into()));
        assert_eq!(field_of("[]").0, 422);
        assert_eq!(parse::<ConfirmRequest>(b"{\"step\": -1}").unwrap_err().status, 422);
    }

    #[tokio::test(start_paused = true)]
    async fn a_body_that_does_not_come_is_not_waited_for_without_end() {
        let body = axum::body::Body::from_stream(futures_util::stream::pending::<std::io::Result<Bytes>>());
        let request = Request::post("/").header(header::CONTENT_TYPE, "application/json").body(body).unwrap();
        let problem = JsonBody::<MoveRequest>::from_request(request, &()).await.err().unwrap();
        assert_eq!((problem.status, problem.kind.as_str()), (408, "urn:plenalign:problem:slow-body"));
    }

    #[test]
    fn a_viewers_message_has_defaults() {
        let message = parse::<ViewerMessage>(b"{\"type\":\"pictures\",\"on\":true}").unwrap();
        assert_eq!(
            message,
            ViewerMessage::Pictures {
                on: true,
                max_rate_hz: 15.0,
                reduce: 1,
                viewport: None,
                quality: 80,
                show: Show::Raw,
                overlay: false,
                window: 0
            }
        );
    }
}
