//! Plain HTTP where TLS is spoken: whoever reads is sent on, whoever commands is told.

use std::convert::Infallible;
use std::time::Duration;

use axum::body::Body;
use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use tokio::time::timeout;

use super::connection::{Stream, closed, http};
use super::stall::Stall;
use crate::api::error::Problem;

/// How long all of it may take.
const ALLOWED: Duration = Duration::from_secs(10);

/// Answers one request and closes.
pub(super) async fn answer(stream: Stall<Box<dyn Stream>>) {
    let service = service_fn(|request: hyper::Request<Incoming>| async move {
        Ok::<_, Infallible>(closed(reply(request.method(), request.uri(), request.headers())))
    });
    let connection = http().keep_alive(false).serve_connection(TokioIo::new(stream), service);
    let _ = timeout(ALLOWED, connection).await;
}

/// A redirect for what only reads; a command is not repeated elsewhere by itself.
fn reply(method: &Method, uri: &Uri, headers: &HeaderMap) -> Response {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).filter(|host| is_plain_host(host));
    match host {
        Some(host) if matches!(*method, Method::GET | Method::HEAD) => {
            let path = uri.path_and_query().map_or("/", |path| path.as_str());
            let location = [(header::LOCATION, format!("https://{host}{path}"))];
            (StatusCode::PERMANENT_REDIRECT, location, Body::empty()).into_response()
        }
        _ => Problem::tls_required().into_response(),
    }
}

/// A name or an address, and perhaps a port: nothing that would make another URL of it.
fn is_plain_host(host: &str) -> bool {
    !host.is_empty() && host.chars().all(|c| c.is_ascii_alphanumeric() || ".-:[]".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reply_to(method: Method, path: &str, host: &str) -> Response {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().unwrap());
        reply(&method, &path.parse().unwrap(), &headers)
    }

    #[test]
    fn whoever_reads_is_sent_on_and_nobody_else() {
        let sent_on = reply_to(Method::GET, "/login?x=1", "[::1]:8443");
        assert_eq!(sent_on.status(), 308);
        assert_eq!(sent_on.headers()[header::LOCATION], "https://[::1]:8443/login?x=1");
        for (method, host) in [(Method::POST, "bench.lab"), (Method::GET, "evil/@bench"), (Method::GET, "")] {
            assert_eq!(reply_to(method, "/", host).status(), 400);
        }
    }
}
