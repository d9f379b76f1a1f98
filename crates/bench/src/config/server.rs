//! `[server]`: who may ask, and how many at once.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Faults;
use crate::access::Networks;

/// Most connections that can be asked for: the system gives a process a thousand files as a rule, and the stop needs
/// some of them.
const MOST_CONNECTIONS: u32 = 512;
/// Most viewports that can be asked for: what each costs comes with every frame.
const MOST_VIEWPORTS: u32 = 256;

/// When a token is demanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Auth {
    /// On loopback only once there is one; elsewhere always.
    Auto,
    /// Always.
    Required,
}

/// `[server]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ServerConfig {
    /// When a token is demanded.
    pub auth: Auth,
    /// Names by which the daemon may be addressed, beside its addresses.
    pub names: Vec<String>,
    /// Proxies that may say whom they ask for: addresses or networks.
    pub trusted_proxies: Vec<String>,
    /// Connections served at once.
    pub max_connections: u32,
    /// Of these, at most so many from one address.
    pub max_connections_per_address: u32,
    /// A connection on which no request has come for so long is closed, s.
    pub idle_timeout_s: f64,
    /// Requests a second of one token or address, in the long run; four times as many at once.
    pub requests_per_s: f64,
    /// Different parts of the raw frame, or sizes or qualities of them, that are sent of each frame.
    pub max_viewports: u32,
    /// Whether the daemon is announced on the local network (mDNS, `_plenalign._tcp`); never on loopback.
    pub mdns: bool,
    /// Certificate and key.
    pub tls: TlsConfig,
}

/// `[server.tls]`
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TlsConfig {
    /// PEM file with the certificate and those that lead to its root; empty for none.
    pub certificate: PathBuf,
    /// PEM file with its key; empty for none.
    pub key: PathBuf,
}

impl TlsConfig {
    /// Whether there is a certificate.
    #[must_use]
    pub fn is_given(&self) -> bool {
        !self.certificate.as_os_str().is_empty()
    }
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            auth: Auth::Auto,
            names: Vec::new(),
            trusted_proxies: Vec::new(),
            max_connections: 256,
            max_connections_per_address: 64,
            idle_timeout_s: 30.0,
            requests_per_s: 100.0,
            max_viewports: 16,
            mdns: false,
            tls: TlsConfig::default(),
        }
    }
}

impl ServerConfig {
    pub(super) fn check(&self, faults: &mut Faults) {
        let is_name =
            |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || ".-".contains(c));
        for name in &self.names {
            faults.require(is_name(name), "server.names", || {
                format!("{name:?} is no host's name, such as bench.lab, without scheme and port")
            });
        }
        if let Err(wrong) = Networks::parse(self.trusted_proxies.iter().map(String::as_str)) {
            faults.add("server.trusted_proxies", wrong);
        }
        let counts = [
            ("server.max_connections", self.max_connections),
            ("server.max_connections_per_address", self.max_connections_per_address),
        ];
        for (key, count) in counts {
            faults.require((1..=MOST_CONNECTIONS).contains(&count), key, || {
                format!("must be 1 to {MOST_CONNECTIONS}, not {count}")
            });
        }
        faults.require((1.0..=3600.0).contains(&self.idle_timeout_s), "server.idle_timeout_s", || {
            format!("must be 1 to 3600, not {}", self.idle_timeout_s)
        });
        faults.require((1.0..=1e6).contains(&self.requests_per_s), "server.requests_per_s", || {
            format!("must be 1 to 1000000, not {}", self.requests_per_s)
        });
        faults.require((1..=MOST_VIEWPORTS).contains(&self.max_viewports), "server.max_viewports", || {
            format!("must be 1 to {MOST_VIEWPORTS}, not {}", self.max_viewports)
        });
        let empty = |path: &PathBuf| path.as_os_str().is_empty();
        let (missing, given) = match (empty(&self.tls.certificate), empty(&self.tls.key)) {
            (true, false) => ("certificate", "key"),
            (false, true) => ("key", "certificate"),
            _ => return,
        };
        faults.add(format!("server.tls.{missing}"), format!("is missing: server.tls.{given} is of no use without it"));
    }
}
