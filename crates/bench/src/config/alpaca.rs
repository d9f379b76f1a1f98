//! `[alpaca]`: the facade for ASCOM Alpaca clients.

use std::net::SocketAddr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Faults;

/// `[alpaca]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AlpacaConfig {
    /// Address and port on which Alpaca is spoken; empty for not at all. Beyond loopback only with `--insecure`: Alpaca
    /// knows no tokens and no TLS.
    pub listen: String,
    /// How long a client keeps the control lease without a request, s.
    pub lease_ttl_s: f64,
    /// Whether clients that look for Alpaca devices by UDP on port 32227 are told of this one.
    pub discovery: bool,
}

impl Default for AlpacaConfig {
    fn default() -> Self {
        Self { listen: String::new(), lease_ttl_s: 30.0, discovery: false }
    }
}

impl AlpacaConfig {
    /// Where Alpaca is to be spoken, if it is.
    #[must_use]
    pub fn address(&self) -> Option<SocketAddr> {
        self.listen.parse().ok()
    }

    pub(super) fn check(&self, faults: &mut Faults) {
        faults.require(self.listen.is_empty() || self.address().is_some(), "alpaca.listen", || {
            format!("{:?} is no address with a port, such as 127.0.0.1:11111, nor empty", self.listen)
        });
        // What a lease may ask for.
        faults.require((2.0..=3600.0).contains(&self.lease_ttl_s), "alpaca.lease_ttl_s", || {
            format!("must be 2 to 3600, not {}", self.lease_ttl_s)
        });
    }
}
