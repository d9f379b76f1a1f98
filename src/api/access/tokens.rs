//! Tokens: made, listed, revoked.

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use axum::{Extension, Json};
use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::json;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::access::{AuditRecord, Gate, Principal, Scope, TokenError, TokenRecord};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::{JsonBody, PathName, PathParam};

/// A token, without its secret.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct TokenView {
    /// Path of this token.
    pub(in crate::api) href: String,
    /// Names it for good.
    pub(in crate::api) id: Uuid,
    /// What its holder is called.
    pub(in crate::api) name: String,
    /// What it allows.
    pub(in crate::api) scope: Scope,
    /// When it was made.
    #[schema(value_type = String, format = DateTime)]
    pub(in crate::api) created_at: Timestamp,
    /// When it was last used, to the minute.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(in crate::api) last_used_at: Option<Timestamp>,
    /// When it ends by itself.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(in crate::api) expires_at: Option<Timestamp>,
}

impl From<TokenRecord> for TokenView {
    fn from(record: TokenRecord) -> Self {
        let TokenRecord { id, name, scope, created_at, last_used_at, expires_at, .. } = record;
        Self { href: format!("/api/v1/tokens/{id}"), id, name, scope, created_at, last_used_at, expires_at }
    }
}

/// The tokens there are.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct TokenList {
    /// The tokens, newest last.
    pub(in crate::api) tokens: Vec<TokenView>,
}

/// A token to be made.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct TokenRequest {
    /// What its holder is to be called: 1 to 64 letters, digits, blanks and `.@_-`.
    #[schema(
        max_length = 64,
        pattern = "^[\\p{L}\\p{N}\\u0300-\\u036f\\u0900-\\u0fff .@_-]*[\\p{L}\\p{N}\\u0300-\\u036f\\u0900-\\u0fff.@_-][\\p{L}\\p{N}\\u0300-\\u036f\\u0900-\\u0fff .@_-]*$"
    )]
    pub(in crate::api) name: String,
    /// What it is to allow.
    pub(in crate::api) scope: Scope,
    /// When it is to end by itself; left out: not before it is revoked.
    #[serde(default)]
    #[schema(value_type = Option<String>, format = DateTime)]
    pub(in crate::api) expires_at: Option<Timestamp>,
}

/// A token just made.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct NewToken {
    /// The secret. It is shown here and never again.
    pub(in crate::api) secret: String,
    /// The token.
    #[serde(flatten)]
    pub(in crate::api) token: TokenView,
}

/// Every token, without its secret.
#[utoipa::path(get, path = "/api/v1/tokens", operation_id = "list_tokens", tag = "access", responses((status = 200, body = TokenList)))]
pub(in crate::api) async fn list(State(app): State<App>) -> Json<TokenList> {
    Json(TokenList { tokens: app.gate.tokens().list().into_iter().map(TokenView::from).collect() })
}

/// Makes a token.
#[utoipa::path(
    post, path = "/api/v1/tokens", operation_id = "create_token", tag = "access", request_body = TokenRequest,
    responses(
        (status = 201, body = NewToken, headers(("Location" = String, description = "Path of the token"))),
        (status = 409, description = "The name is taken, or the time it is to end at is past", body = Problem,
         content_type = "application/problem+json"),
        (status = 503, description = "It cannot be kept", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn create(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(TokenRequest { name, scope, expires_at }): JsonBody<TokenRequest>,
) -> Result<impl IntoResponse> {
    let (secret, record) = changing(&app, move |gate| gate.tokens().create(&name, scope, expires_at)).await?;
    let detail = json!({ "id": record.id, "name": record.name, "scope": record.scope });
    app.gate.audit(AuditRecord::of(&principal, "token.create", detail));
    let token = TokenView::from(record);
    let location = [(header::LOCATION, token.href.clone())];
    Ok((StatusCode::CREATED, location, Json(NewToken { secret: secret.reveal().to_owned(), token })))
}

/// The id of a token in a path.
pub(in crate::api) struct TokenId(Uuid);

impl PathName for TokenId {
    fn from_path(text: &str) -> std::result::Result<Self, String> {
        text.parse().map(Self).map_err(|error| format!("there is no token {text:?}: a token's id is a UUID ({error})"))
    }
}

/// Revokes a token, with every session opened with it.
#[utoipa::path(
    delete, path = "/api/v1/tokens/{id}", operation_id = "revoke_token", tag = "access",
    params(("id" = Uuid, Path, description = "The token's id")),
    responses(
        (status = 204, description = "It opens nothing any more"),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "It cannot be kept", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn revoke(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(TokenId(id)): PathParam<TokenId>,
) -> Result<StatusCode> {
    let by = principal.name.clone();
    let record = changing(&app, move |gate| gate.tokens().revoke(&id.to_string(), Some(&by))).await?;
    app.gate.audit(AuditRecord::of(&principal, "token.revoke", json!({ "id": id, "name": record.name })));
    Ok(StatusCode::NO_CONTENT)
}

/// Changes tokens where blocking is allowed.
async fn changing<T: Send + 'static>(
    app: &App,
    change: impl FnOnce(&Gate) -> std::result::Result<T, TokenError> + Send + 'static,
) -> Result<T> {
    let gate = app.gate.clone();
    match tokio::task::spawn_blocking(move || change(&gate)).await {
        Ok(changed) => changed.map_err(Problem::from),
        Err(_) => Err(Problem::internal()),
    }
}

#[cfg(test)]
mod tests {
    use crate::access::{LONGEST_NAME, NAME_PATTERN};

    #[test]
    fn the_contract_has_the_names_that_can_be() {
        let contract = serde_json::to_value(crate::api::openapi()).unwrap();
        let stated = &contract["components"]["schemas"]["TokenRequest"]["properties"]["name"];
        assert_eq!((&stated["pattern"], &stated["maxLength"]), (&NAME_PATTERN.into(), &LONGEST_NAME.into()));
    }
}
