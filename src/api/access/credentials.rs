//! What a request brings to say who sends it: a token in `Authorization`, a session's cookie, or a ticket.

use axum::http::{HeaderMap, Method, Uri, header};

/// What a request brings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::api) enum Credential {
    /// `Authorization: Bearer …`.
    Token(String),
    /// An `Authorization` that holds no token.
    Unreadable,
    /// `?ticket=…`.
    Ticket(String),
    /// The cookie of a session.
    Session(String),
}

impl Credential {
    /// The credential of a request: the most explicit one, where it brings several.
    pub(in crate::api) fn of(method: &Method, headers: &HeaderMap, uri: &Uri, cookie: &str) -> Option<Self> {
        if let Some(value) = headers.get(header::AUTHORIZATION) {
            let token = value.to_str().ok().and_then(|value| {
                let (scheme, token) = value.split_once(' ')?;
                scheme.eq_ignore_ascii_case("bearer").then(|| token.trim().to_owned())
            });
            return Some(token.filter(|token| !token.is_empty()).map_or(Self::Unreadable, Self::Token));
        }
        // A ticket opens its path to be read, and for nothing else.
        if matches!(*method, Method::GET | Method::HEAD)
            && let Some(ticket) = ticket(uri)
        {
            return Some(Self::Ticket(ticket.to_owned()));
        }
        session(headers, cookie).map(Self::Session)
    }
}

/// The ticket in a query.
fn ticket(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("ticket="))
}

/// The same URI without a ticket; `None` where it has none.
pub(in crate::api) fn without_ticket(uri: &Uri) -> Option<Uri> {
    ticket(uri)?;
    let rest: Vec<&str> = uri.query()?.split('&').filter(|pair| !pair.starts_with("ticket=")).collect();
    let query = if rest.is_empty() { String::new() } else { format!("?{}", rest.join("&")) };
    format!("{}{query}", uri.path()).parse().ok()
}

/// The session in the cookie of this name.
pub(in crate::api) fn session(headers: &HeaderMap, cookie: &str) -> Option<String> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(';'))
        .find_map(|pair| pair.trim().strip_prefix(cookie)?.strip_prefix('='))
        .map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(headers: &[(&'static str, &str)], uri: &str) -> Option<Credential> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        Credential::of(&Method::GET, &map, &uri.parse().unwrap(), "session_1")
    }

    #[test]
    fn a_ticket_is_taken_out_of_what_a_handler_reads() {
        let without = |uri: &str| without_ticket(&uri.parse().unwrap()).map(|uri| uri.to_string());
        assert_eq!(without("/x?a=1&ticket=t7&b=2").as_deref(), Some("/x?a=1&b=2"));
        assert_eq!(without("/x?ticket=t7").as_deref(), Some("/x"));
        assert_eq!(without("/x?a=1"), None);
    }

    #[test]
    fn a_credential_is_found_where_it_may_be() {
        assert_eq!(of(&[], "/"), None);
        assert_eq!(of(&[("authorization", "bEARER abc")], "/"), Some(Credential::Token("abc".into())));
        for empty in ["", "Bearer", "Bearer ", "Bearer   ", "Basic YTpi", "abc"] {
            assert_eq!(of(&[("authorization", empty)], "/"), Some(Credential::Unreadable), "{empty:?}");
        }
        assert_eq!(of(&[], "/x?a=1&ticket=t7"), Some(Credential::Ticket("t7".into())));
        let cookies = [("cookie", "session_10=no; other=1"), ("cookie", "a=b; session_1=s9")];
        assert_eq!(of(&cookies, "/"), Some(Credential::Session("s9".into())));
        assert_eq!(
            of(&[("cookie", "session_1=s9"), ("authorization", "Bearer t")], "/"),
            Some(Credential::Token("t".into()))
        );
    }
}
