//! Who may ask: no page of another origin commands the bench, and no foreign name leads to a loopback daemon.

use std::net::IpAddr;

use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::Response;

use super::App;
use super::error::Problem;

/// Refuses a foreign `Host` where the daemon listens on loopback (a web page whose name was made to point here), and
/// a foreign `Origin` on everything but reading.
pub(super) async fn guard(State(app): State<App>, request: Request, next: Next) -> Result<Response, Problem> {
    let headers = request.headers();
    if app.loopback_only
        && let Some(host) = text(headers, header::HOST)
        && !is_loopback(host)
    {
        return Err(Problem::wrong_host(host));
    }
    let reads = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    let upgrades = headers.contains_key(header::UPGRADE);
    if (!reads || upgrades)
        && let Some(origin) = text(headers, header::ORIGIN)
        && !is_same_origin(origin, text(headers, header::HOST))
    {
        return Err(Problem::cross_origin(origin));
    }
    Ok(next.run(request).await)
}

/// A header as text; one that is not text stands for a value that nothing matches.
fn text(headers: &HeaderMap, name: header::HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

/// Whether a `Host` (with or without a port) names this machine's loopback.
fn is_loopback(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        // A colon within brackets belongs to an IPv6 address.
        Some((name, port)) if !port.contains(']') => name,
        _ => host,
    };
    let name = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

fn is_same_origin(origin: &str, host: Option<&str>) -> bool {
    let authority = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
    matches!((authority, host), (Some(authority), Some(host)) if authority.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_names_are_told_from_others() {
        for host in ["localhost", "localhost:8080", "LOCALHOST:1", "127.0.0.1:8080", "127.3.2.1", "[::1]:8080", "[::1]"]
        {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "192.168.1.5", "localhost.evil", ""]
        {
            assert!(!is_loopback(host), "{host}");
        }
    }

    #[test]
    fn an_origin_is_the_same_only_with_host_and_port() {
        assert!(is_same_origin("http://127.0.0.1:8080", Some("127.0.0.1:8080")));
        assert!(!is_same_origin("http://127.0.0.1:8081", Some("127.0.0.1:8080")));
        assert!(!is_same_origin("http://evil.example", Some("127.0.0.1:8080")));
        assert!(!is_same_origin("null", Some("127.0.0.1:8080")));
        assert!(!is_same_origin("http://127.0.0.1:8080", None));
    }
}
