//! No page of another origin commands the bench, and no foreign name leads to the daemon.

use std::net::IpAddr;

/// Whether a `Host` (with or without a port) is one by which the daemon may be addressed: one of its names; this
/// machine's loopback; and, beyond loopback, an address or, where it has been given no names, any.
pub(in crate::api) fn is_own_host(host: &str, names: &[String], loopback_only: bool) -> bool {
    let name = name_of(host);
    if names.iter().any(|own| own.eq_ignore_ascii_case(name)) {
        return true;
    }
    if name.eq_ignore_ascii_case("localhost") {
        return true;
    }
    match name.parse::<IpAddr>() {
        Ok(address) => address.is_loopback() || !loopback_only,
        Err(_) => !loopback_only && names.is_empty(),
    }
}

/// The name in a `Host`, without port and brackets.
fn name_of(host: &str) -> &str {
    let name = match host.rsplit_once(':') {
        // A colon within brackets belongs to an IPv6 address.
        Some((name, port)) if !port.contains(']') => name,
        _ => host,
    };
    name.trim_start_matches('[').trim_end_matches(']')
}

/// Whether a page of this origin was served by the host asked.
pub(in crate::api) fn is_same_origin(origin: &str, host: Option<&str>, secure: bool) -> bool {
    let authority = origin.strip_prefix(if secure { "https://" } else { "http://" });
    matches!((authority, host), (Some(authority), Some(host)) if authority.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_names_are_told_from_others() {
        let names = ["bench.lab".to_owned()];
        for host in ["localhost", "localhost:8080", "LOCALHOST:1", "127.0.0.1:8080", "127.3.2.1", "[::1]:8080", "[::1]"]
        {
            assert!(is_own_host(host, &[], true), "{host}");
        }
        for host in ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "192.168.1.5", "localhost.evil", ""]
        {
            assert!(!is_own_host(host, &names, true), "{host}");
        }
        assert!(is_own_host("Bench.lab:8080", &names, true));
    }

    #[test]
    fn beyond_loopback_names_are_taken_as_given() {
        let names = ["bench.lab".to_owned()];
        for host in ["bench.lab", "BENCH.lab:8443", "192.168.1.5:8443", "[fd00::5]:8443", "localhost"] {
            assert!(is_own_host(host, &names, false), "{host}");
        }
        assert!(!is_own_host("evil.example", &names, false));
        assert!(is_own_host("whatever.lab", &[], false));
    }

    #[test]
    fn an_origin_is_the_same_only_with_scheme_host_and_port() {
        assert!(is_same_origin("http://127.0.0.1:8080", Some("127.0.0.1:8080"), false));
        assert!(is_same_origin("https://bench.lab", Some("bench.lab"), true));
        assert!(!is_same_origin("http://bench.lab", Some("bench.lab"), true));
        assert!(!is_same_origin("https://127.0.0.1:8080", Some("127.0.0.1:8080"), false));
        assert!(!is_same_origin("http://127.0.0.1:8081", Some("127.0.0.1:8080"), false));
        assert!(!is_same_origin("http://evil.example", Some("127.0.0.1:8080"), false));
        assert!(!is_same_origin("null", Some("127.0.0.1:8080"), false));
        assert!(!is_same_origin("http://127.0.0.1:8080", None, false));
    }
}
