//! The page: `web/dist`, embedded where it was there when the program was built.

use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{AppendHeaders, IntoResponse, Response};
use rust_embed::RustEmbed;

use super::error::Problem;

#[derive(RustEmbed)]
#[folder = "web/dist"]
#[allow_missing = true]
struct Page;

/// Shown in place of a page that was not built.
const NOTICE: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Plenalign</title>\
<body style=\"font: 1rem/1.5 system-ui; max-width: 40rem; margin: 4rem auto; padding: 0 1rem\">\
<h1>The page was not built</h1><p>This daemon runs, and its API is at <a href=\"/api/v1/bench\">/api/v1/bench</a> \
(<a href=\"/api/v1/openapi.json\">contract</a>). Build the page with <code>make web</code> or \
<code>cd web &amp;&amp; npm ci &amp;&amp; npm run build</code>, then build the program again.</p>";

/// Nothing but what this daemon serves, and pictures that the page makes itself.
const CONTENT_SECURITY_POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; \
style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Where the build puts what is named by what it holds: another content has another name.
const NAMED_BY_CONTENT: &str = "assets/";
/// For what a name never holds anything else.
const FOR_GOOD: &str = "public, max-age=31536000, immutable";
/// For what is to be asked for each time: an old page is not to speak with a new daemon.
const EACH_TIME: &str = "no-cache";

/// This contract as a page, to be browsed and tried: whoever is signed in sees it.
#[utoipa::path(
    get, path = "/api/v1/docs", operation_id = "get_docs", tag = "daemon",
    responses(
        (status = 200, body = String, content_type = "text/html"),
        (status = 304, description = "The page is that which If-None-Match names"),
    )
)]
pub(super) async fn docs(headers: HeaderMap) -> Response {
    file("docs.html", &headers).unwrap_or_else(notice)
}

/// A file of the page, or a problem for what is not there.
pub(super) fn serve(uri: &Uri, headers: &HeaderMap) -> Response {
    let path = uri.path().trim_start_matches('/');
    // A one-time link leads to the page, too, which signs in with the key that the link holds.
    let name = if matches!(path, "" | "login") { "index.html" } else { path };
    let missing = || match name {
        "index.html" => notice(),
        _ => Problem::not_found(format!("there is nothing at {}", uri.path())).into_response(),
    };
    file(name, headers).unwrap_or_else(missing)
}

fn file(name: &str, headers: &HeaderMap) -> Option<Response> {
    let plain = Page::get(name)?;
    let packed = takes_gzip(headers).then(|| Page::get(&format!("{name}.gz"))).flatten();
    let encoding = packed.is_some().then_some((header::CONTENT_ENCODING, "gzip"));
    let file = packed.unwrap_or(plain);
    let etag = format!("\"{}\"", hex(&file.metadata.sha256_hash()[..16]));
    let known = headers.get(header::IF_NONE_MATCH).is_some_and(|value| value.as_bytes() == etag.as_bytes());
    let kind = mime_guess::from_path(name).first_or_octet_stream();
    let body = if known { Default::default() } else { file.data };
    let status = if known { StatusCode::NOT_MODIFIED } else { StatusCode::OK };
    let about = [(header::CONTENT_TYPE, kind.to_string()), (header::ETAG, etag)];
    let keep = if name.starts_with(NAMED_BY_CONTENT) { FOR_GOOD } else { EACH_TIME };
    let varies = AppendHeaders([(header::VARY, "accept-encoding")]);
    Some(dressed((status, about, AppendHeaders(encoding), varies, body), keep))
}

/// Whether who asks unpacks gzip, which a quality of 0 denies.
fn takes_gzip(headers: &HeaderMap) -> bool {
    let asked = headers.get(header::ACCEPT_ENCODING).and_then(|value| value.to_str().ok()).unwrap_or_default();
    asked.split(',').any(|one| {
        let (name, parameter) = one.split_once(';').unwrap_or((one, ""));
        let quality = parameter.trim().strip_prefix("q=").map(str::parse::<f32>);
        name.trim().eq_ignore_ascii_case("gzip") && !matches!(quality, Some(Ok(0.0)))
    })
}

fn notice() -> Response {
    dressed(([(header::CONTENT_TYPE, "text/html; charset=utf-8")], NOTICE), EACH_TIME)
}

fn dressed(response: impl IntoResponse, keep: &'static str) -> Response {
    let mut response = response.into_response();
    let headers = response.headers_mut();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(keep));
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(CONTENT_SECURITY_POLICY));
    response
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_packed_to_who_unpacks_them() {
        let takes = |asked: &'static str| {
            takes_gzip(&HeaderMap::from_iter([(header::ACCEPT_ENCODING, HeaderValue::from_static(asked))]))
        };
        for asked in ["gzip", "gzip, deflate, br", "br;q=1.0, GZIP;q=0.5"] {
            assert!(takes(asked), "{asked}");
        }
        for asked in ["", "br", "identity", "gzip;q=0", "br, gzip; q=0.000", "xgzip"] {
            assert!(!takes(asked), "{asked}");
        }
        assert!(!takes_gzip(&HeaderMap::new()));
    }
}
