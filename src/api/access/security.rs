//! What the contract says of who may ask: written from the table of scopes.

use utoipa::openapi::path::{Operation, PathItem};
use utoipa::openapi::security::{
    ApiKey, ApiKeyValue, HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme,
};
use utoipa::openapi::{Components, OpenApi};

use super::scopes::{Need, STOP, need};
use crate::access::Scope;
use crate::api::contract::{failure, problem};

const TOKEN: &str = "token";
const SESSION: &str = "session";
const TICKET: &str = "ticket";

/// Says for every operation what it needs, and how it fails for who has not got it.
pub(in crate::api) fn describe(contract: &mut OpenApi) {
    let components = contract.components.get_or_insert_with(Components::new);
    for (name, scheme) in schemes() {
        components.add_security_scheme(name, scheme);
    }
    for (path, item) in &mut contract.paths.paths {
        for (method, operation) in operations(item) {
            if let Some(Need::AtLeast(scope)) = need(method, path) {
                secure(operation, scope, method == "GET");
            }
            if (method, path.as_str()) != STOP {
                fails(operation, "429", "Too many requests; Retry-After says when to try again");
            }
        }
    }
}

fn schemes() -> [(&'static str, SecurityScheme); 3] {
    let token = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).bearer_format("plenalign_…").description(Some(
        "A token, as `plenalign token create` or POST /api/v1/tokens makes it. On loopback none is demanded before \
         there is one, unless the configuration says so.",
    ));
    let session = ApiKeyValue::with_description(
        "plenalign_session_8080",
        "A browser's session, set by POST /api/v1/session; the number is the daemon's port.",
    );
    let ticket =
        ApiKeyValue::with_description("ticket", "For one path, once, within 30 s: made by POST /api/v1/tickets.");
    [
        (TOKEN, SecurityScheme::Http(token.build())),
        (SESSION, SecurityScheme::ApiKey(ApiKey::Cookie(session))),
        (TICKET, SecurityScheme::ApiKey(ApiKey::Query(ticket))),
    ]
}

fn operations(item: &mut PathItem) -> impl Iterator<Item = (&'static str, &mut Operation)> {
    let PathItem { get, put, post, delete, patch, .. } = item;
    [("GET", get), ("PUT", put), ("POST", post), ("DELETE", delete), ("PATCH", patch)]
        .into_iter()
        .filter_map(|(method, operation)| operation.as_mut().map(|operation| (method, operation)))
}

fn secure(operation: &mut Operation, scope: Scope, reads: bool) {
    let mut ways = vec![TOKEN, SESSION];
    if reads {
        ways.push(TICKET);
    }
    operation.security = Some(ways.into_iter().map(|way| SecurityRequirement::new(way, [scope.name()])).collect());
    let stranger = "Not signed in: no token, ticket or session is shown, or one that is not valid";
    let responses = &mut operation.responses.responses;
    responses.entry("401".to_owned()).or_insert_with(|| failure("UnauthorisedProblem", stranger));
    if scope > Scope::View {
        fails(operation, "403", "Who asks may not do this");
    }
}

/// Says how an operation fails, unless it says so itself.
fn fails(operation: &mut Operation, status: &str, description: &str) {
    operation.responses.responses.entry(status.to_owned()).or_insert_with(|| problem(description));
}
