//! A browser's session: signing in with a token or the one-time key, who one is, signing out.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::client::Client;
use super::credentials;
use crate::access::{AuditRecord, Principal, Scope, SignInError};
use crate::api::App;
use crate::api::error::{Problem, Result, UnauthorisedProblem};
use crate::api::extract::JsonBody;

/// What a browser signs in with.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct SignIn {
    /// A token, or the key of the one-time link.
    #[schema(max_length = 200)]
    pub(in crate::api) key: String,
}

/// Who one is.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct SessionView {
    /// Name of the token one came in with; `local` where none is demanded.
    pub(in crate::api) name: String,
    /// What one may do.
    pub(in crate::api) scope: Scope,
    /// Whether this is a browser that has signed in, and can sign out.
    pub(in crate::api) signed_in: bool,
    /// Whether a token is demanded of everybody.
    pub(in crate::api) demanded: bool,
}

/// Signs a browser in.
///
/// Answers with a cookie that no script can read and that no other site can have sent.
#[utoipa::path(
    post, path = "/api/v1/session", operation_id = "sign_in", tag = "access", request_body = SignIn,
    responses(
        (status = 200, body = SessionView, headers(("Set-Cookie" = String, description = "The session"))),
        (status = 401, description = "The key opens nothing", body = UnauthorisedProblem,
         content_type = "application/problem+json"),
        (status = 429, description = "Too many keys of this address have opened nothing", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn sign_in(
    State(app): State<App>,
    Extension(client): Extension<Client>,
    JsonBody(SignIn { key }): JsonBody<SignIn>,
) -> Result<Response> {
    let session = app.gate.sign_in(key.trim(), client.address).await.map_err(|error| match error {
        SignInError::Unauthorised(why) => Problem::unauthorised(why),
        SignInError::Failed(error) => {
            tracing::error!(%error, "a session cannot be opened");
            Problem::internal()
        }
    })?;
    let lasts = session.remembered_until.duration_since(jiff::Timestamp::now()).as_secs().max(0);
    let cookie = cookie(&app.cookie, session.secret.reveal(), lasts, client.secure)?;
    let Principal { name, scope, .. } = session.principal;
    let view = SessionView { name, scope, signed_in: true, demanded: app.gate.demands() };
    Ok(([(header::SET_COOKIE, cookie)], Json(view)).into_response())
}

/// Who one is.
#[utoipa::path(get, path = "/api/v1/session", operation_id = "get_session", tag = "access", responses((status = 200, body = SessionView)))]
pub(in crate::api) async fn get(
    State(app): State<App>,
    Extension(Principal { name, scope, .. }): Extension<Principal>,
    headers: HeaderMap,
) -> Json<SessionView> {
    let demanded = app.gate.demands();
    let signed_in = demanded
        && !headers.contains_key(header::AUTHORIZATION)
        && credentials::session(&headers, &app.cookie).is_some();
    Json(SessionView { name, scope, signed_in, demanded })
}

/// Signs a browser out.
#[utoipa::path(
    delete, path = "/api/v1/session", operation_id = "sign_out", tag = "access",
    responses((status = 204, description = "The session is over"))
)]
pub(in crate::api) async fn sign_out(
    State(app): State<App>,
    Extension(client): Extension<Client>,
    Extension(principal): Extension<Principal>,
    headers: HeaderMap,
) -> Result<Response> {
    if let Some(session) = credentials::session(&headers, &app.cookie) {
        app.gate.sign_out(session).await;
        app.gate.audit(AuditRecord::of(&principal, "session.close", serde_json::json!({})));
    }
    let cookie = cookie(&app.cookie, "", 0, client.secure)?;
    Ok((StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response())
}

fn cookie(name: &str, value: &str, lasts_s: i64, secure: bool) -> Result<HeaderValue> {
    let secure = if secure { "; Secure" } else { "" };
    let text = format!("{name}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Strict{secure}");
    HeaderValue::from_str(&text).map_err(|_| Problem::internal())
}
