//! What every request passes: where it comes from, which page sent it, who asks, whether they may, and how often.

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::Response;

use super::client::{Client, Peer, text};
use super::credentials::{Credential, without_ticket};
use super::origin::{is_own_host, is_same_origin};
use super::scopes::{Need, STOP, need};
use crate::access::{Gate, Principal, Scope, Unauthorised};
use crate::api::App;
use crate::api::error::Problem;

/// Lets a request through to its handler with its [`Client`] and, where its route asks who it is, its [`Principal`]
/// among its extensions.
///
/// # Errors
/// Refuses a foreign `Host`; a foreign `Origin` on everything but reading; whoever brings no credential where one is
/// demanded, a wrong one, or one without the scope; and who asks too often, but for the stop.
pub(in crate::api) async fn guard(
    State(app): State<App>,
    mut request: Request,
    next: Next,
) -> Result<Response, Problem> {
    let peer = *request.extensions().get::<Peer>().ok_or_else(|| {
        tracing::error!("a request without its connection's far end");
        Problem::internal()
    })?;
    let headers = request.headers();
    let client = Client::vetted(peer, headers, &app.gate, app.loopback_only)?;
    let reads = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if !reads || headers.contains_key(header::UPGRADE) {
        client.check_origin(headers)?;
    }
    let route = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let is_stop = route.as_deref() == Some(STOP.1) && request.method() == STOP.0;
    let need = need_of(&request, route.as_deref());
    let admitted = match need {
        Need::Nothing => Ok(None),
        Need::AtLeast(scope) => {
            let credential = Credential::of(request.method(), request.headers(), request.uri(), &app.cookie);
            let path = request.uri().path().to_owned();
            admit(&app, credential, &path, &client, scope).await.map(Some)
        }
    };
    // A service manager's watchdog must not starve because others ask too often.
    if !is_stop && !peer.is_own() {
        let name = admitted.as_ref().ok().and_then(Option::as_ref).map(|principal| principal.name.as_str());
        app.gate.count(client.address, name).map_err(Problem::too_many)?;
    }
    let principal = admitted?;
    // It is used up, and no parameter of a handler's.
    if let Some(uri) = without_ticket(request.uri()) {
        *request.uri_mut() = uri;
    }
    if let Some(principal) = principal {
        request.extensions_mut().insert(principal);
    }
    request.extensions_mut().insert(client);
    Ok(next.run(request).await)
}

impl Client {
    /// Whoever sent a request, where it may be answered at all.
    ///
    /// # Errors
    /// Refuses a proxy that nobody trusts, and a foreign `Host`.
    pub(crate) fn vetted(peer: Peer, headers: &HeaderMap, gate: &Gate, loopback_only: bool) -> Result<Self, Problem> {
        let client = Self::of(peer, headers, &gate.settings().trusted_proxies)?;
        match &client.host {
            Some(host) if !is_own_host(host, &gate.settings().names, loopback_only) => {
                Err(Problem::wrong_host(host, loopback_only))
            }
            _ => Ok(client),
        }
    }

    /// That no page of another origin has sent the request.
    ///
    /// # Errors
    /// Refuses a foreign `Origin`, and what a browser says comes from another site.
    pub(crate) fn check_origin(&self, headers: &HeaderMap) -> Result<(), Problem> {
        match (text(headers, header::ORIGIN), text(headers, header::HeaderName::from_static("sec-fetch-site"))) {
            (Some(origin), _) if !is_same_origin(origin, self.host.as_deref(), self.secure) => {
                Err(Problem::cross_origin(origin))
            }
            (None, Some(site)) if !matches!(site, "same-origin" | "none") => Err(Problem::cross_origin("another site")),
            _ => Ok(()),
        }
    }
}

/// What a request needs: of a route, what the table says, and everything where the table says nothing of it; elsewhere
/// nothing for the page's files, and to be known for whatever is asked below `/api`, also of what is not there.
fn need_of(request: &Request, route: Option<&str>) -> Need {
    let path = request.uri().path();
    match route {
        Some(route) => need(request.method().as_str(), route).unwrap_or(Need::AtLeast(Scope::Admin)),
        None if path == "/api" || path.starts_with("/api/") => Need::AtLeast(Scope::View),
        None => Need::Nothing,
    }
}

/// Finds out who asks, and whether they may.
async fn admit(
    app: &App,
    credential: Option<Credential>,
    path: &str,
    client: &Client,
    least: Scope,
) -> Result<Principal, Problem> {
    let (gate, address) = (&app.gate, client.address);
    let found = match credential {
        Some(Credential::Token(token)) => gate.by_token(&token, address).await,
        Some(Credential::Unreadable) => Err(Unauthorised::Wrong),
        Some(Credential::Ticket(ticket)) => gate.by_ticket(&ticket, path, address),
        // A cookie that has run out is as none: where nothing is demanded, it must not shut its browser out.
        Some(Credential::Session(session)) => match gate.by_session(&session, address) {
            Ok(principal) => Ok(principal),
            Err(refused) => gate.stranger(address).map_err(|_| refused),
        },
        None => gate.stranger(address),
    };
    let principal = found.map_err(Problem::unauthorised)?;
    if principal.scope < least {
        return Err(Problem::scope(&principal, least));
    }
    Ok(principal)
}
