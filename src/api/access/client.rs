//! Where a request comes from: the far end of the connection, or what a trusted proxy says of it.

use std::net::{IpAddr, SocketAddr};

use axum::http::{HeaderMap, HeaderName, header};

use crate::access::Networks;
use crate::api::error::Problem;

/// The connection a request came over; the server puts it into the request's extensions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Peer {
    /// Its far end.
    pub(crate) address: SocketAddr,
    /// Whether it is encrypted.
    pub(crate) tls: bool,
}

impl Peer {
    /// Whether the program asks itself, over no connection: none has the port 0.
    pub(in crate::api) const fn is_own(&self) -> bool {
        self.address.port() == 0
    }
}

/// Whoever sent a request, as a handler sees it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Client {
    pub(crate) address: IpAddr,
    /// Whether nobody on the way can read along.
    pub(crate) secure: bool,
    /// The host that the client asked for.
    pub(crate) host: Option<String>,
}

const FORWARDED: [&str; 7] = [
    "forwarded",
    "x-forwarded-for",
    "x-forwarded-host",
    "x-forwarded-proto",
    "x-forwarded-port",
    "x-forwarded-server",
    "x-real-ip",
];

impl Client {
    /// Reads where a request comes from.
    ///
    /// # Errors
    /// A problem where it says that it comes through a proxy and none is trusted there.
    pub(in crate::api) fn of(peer: Peer, headers: &HeaderMap, trusted: &Networks) -> Result<Self, Problem> {
        let address = peer.address.ip().to_canonical();
        let host = text(headers, header::HOST).map(str::to_owned);
        let direct = Self { address, secure: peer.tls, host };
        let Some(named) = FORWARDED.into_iter().find(|name| headers.contains_key(*name)) else {
            return Ok(direct);
        };
        if !trusted.contains(address) {
            return Err(Problem::untrusted_proxy(named, address));
        }
        // X-Forwarded-For is what every proxy writes; of the others nothing about the client's address is believed.
        let chain: Vec<&str> = headers
            .get_all("x-forwarded-for")
            .iter()
            .filter_map(|value| value.to_str().ok())
            .flat_map(|v| v.split(','))
            .collect();
        if chain.is_empty() {
            return Err(Problem::nameless_proxy());
        }
        let origin = trusted.origin(address, chain.into_iter()).ok_or_else(Problem::nameless_proxy)?;
        let first = |name: &'static str| {
            text(headers, HeaderName::from_static(name)).map(|value| value.split(',').next().unwrap_or("").trim())
        };
        let secure = first("x-forwarded-proto").map_or(peer.tls, |scheme| scheme.eq_ignore_ascii_case("https"));
        let host = first("x-forwarded-host").map(str::to_owned).or(direct.host);
        Ok(Self { address: origin, secure, host })
    }
}

/// A header as text; one that is not text stands for a value that nothing matches.
pub(in crate::api) fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("?"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(headers: &[(&'static str, &str)], trusted: &[&str]) -> Result<Client, Problem> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        let peer = Peer { address: "127.0.0.1:5000".parse().unwrap(), tls: false };
        Client::of(peer, &map, &Networks::parse(trusted.iter().copied()).unwrap())
    }

    #[test]
    fn a_proxy_nobody_trusts_is_refused() {
        for name in FORWARDED {
            let problem = client(&[(name, "203.0.113.9")], &["10.0.0.0/8"]).unwrap_err();
            assert_eq!((problem.status, problem.kind.as_str()), (403, "urn:plenalign:problem:untrusted-proxy"));
        }
        assert_eq!(client(&[], &[]).unwrap().address, std::net::Ipv4Addr::LOCALHOST);
    }

    #[test]
    fn a_trusted_proxy_says_for_whom_it_asks() {
        let headers = [
            ("host", "127.0.0.1:8080"),
            ("x-forwarded-for", "198.51.100.1, 203.0.113.9"),
            ("x-forwarded-proto", "https"),
            ("x-forwarded-host", "bench.example"),
        ];
        let found = client(&headers, &["127.0.0.1"]).unwrap();
        let expected =
            Client { address: "203.0.113.9".parse().unwrap(), secure: true, host: Some("bench.example".into()) };
        assert_eq!(found, expected);
        for headers in [[("x-real-ip", "203.0.113.9")], [("x-forwarded-for", "somebody")]] {
            assert_eq!(client(&headers, &["127.0.0.1"]).unwrap_err().status, 400);
        }
    }
}
