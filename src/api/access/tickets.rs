//! Tickets: a way in for what cannot send a header.

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::scopes::{Need, need_to_read, readable_pattern};
use crate::access::{Principal, TICKET_LASTS};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::JsonBody;

/// A path that can be read.
fn readable() -> utoipa::openapi::schema::Object {
    use utoipa::openapi::schema::{ObjectBuilder, Type};
    ObjectBuilder::new()
        .schema_type(Type::String)
        .description(Some("A path of this API that can be read, without a query."))
        .pattern(Some(readable_pattern()))
        .max_length(Some(200))
        .examples([serde_json::json!("/api/v1/snapshot.jpg")])
        .build()
}

/// What a ticket is to open.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct TicketRequest {
    /// A path of this API that can be read, without a query.
    #[schema(schema_with = readable)]
    pub(in crate::api) path: String,
}

/// A ticket.
#[derive(Debug, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct Ticket {
    /// The ticket itself.
    pub(in crate::api) ticket: String,
    /// The path with the ticket in its query: opened once, within the time it lasts.
    pub(in crate::api) href: String,
    /// How long it is good, s.
    pub(in crate::api) lasts_s: u64,
}

/// Gives out a ticket to one path, which opens it once, for whoever asks here.
#[utoipa::path(
    post, path = "/api/v1/tickets", operation_id = "create_ticket", tag = "access", request_body = TicketRequest,
    responses(
        (status = 201, body = Ticket),
        (status = 403, description = "Who asks may not read this", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn create(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(TicketRequest { path }): JsonBody<TicketRequest>,
) -> Result<(StatusCode, Json<Ticket>)> {
    match need_to_read(&path) {
        Some(Need::AtLeast(scope)) if principal.scope < scope => return Err(Problem::scope(&principal, scope)),
        Some(_) => {}
        None => {
            let detail = format!("path: {path:?} is nothing that can be read here, such as /api/v1/snapshot.jpg");
            return Err(Problem::invalid("path", detail));
        }
    }
    let ticket = app.gate.tickets().give(&path, principal).map_err(|error| {
        tracing::error!(%error, "no ticket can be made");
        Problem::internal()
    })?;
    let ticket = ticket.reveal().to_owned();
    let href = format!("{path}?ticket={ticket}");
    Ok((StatusCode::CREATED, Json(Ticket { ticket, href, lasts_s: TICKET_LASTS.as_secs() })))
}
