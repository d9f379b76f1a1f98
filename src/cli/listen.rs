//! Where the daemon listens, and what it demands there.

use std::io::{ErrorKind, IsTerminal as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use tokio::net::TcpListener;

use super::tls::OwnFiles;
use crate::access::{Demand, Gate, GateSettings, Networks, Secret, write_private};
use crate::api::server::{ServerSettings, read_certificate, use_ring};
use crate::config::{Auth, ServerConfig};
use crate::state_folder::state_folder;

/// How long the one-time key opens the door.
const KEY_LASTS: Duration = Duration::from_secs(3600);
/// Holds the one-time link, where there is no terminal to show it on.
const KEY_FILE: &str = "login-url";

/// What the daemon demands where it listens.
pub(super) struct Exposure {
    pub(super) gate: GateSettings,
    pub(super) server: ServerSettings,
    /// The authority that vouches for the daemon, where it was made here.
    pub(super) ca: Option<PathBuf>,
}

impl Exposure {
    /// Beyond loopback a token and TLS, which only `insecure` waives; on loopback what the configuration says.
    ///
    /// # Errors
    /// When there is no certificate where one is needed, or it cannot be used.
    pub(super) fn decide(
        config: &ServerConfig,
        address: SocketAddr,
        state: &Path,
        insecure: bool,
    ) -> anyhow::Result<Self> {
        use_ring();
        let beyond = !address.ip().is_loopback();
        let own = OwnFiles::find(state).filter(|_| beyond && !config.tls.is_given());
        let tls = match &own {
            _ if config.tls.is_given() => Some(read_certificate(&config.tls.certificate, &config.tls.key)?),
            Some(own) => Some(read_certificate(&own.certificate, &own.key)?),
            None if beyond && !insecure => bail!(
                "{address} can be reached from other machines, and there is no certificate: run `plenalign tls init`, \
                 or name one in [server.tls]; --insecure serves there without TLS, for whoever is on the network to \
                 read along"
            ),
            None => None,
        };
        if beyond && tls.is_none() {
            tracing::warn!(%address, "INSECURE: tokens and pictures can be read on the way");
            eprintln!("plenalign: INSECURE: {address} is served without TLS; tokens can be read on the way");
        }
        let demand = if beyond || config.auth == Auth::Required { Demand::Always } else { Demand::OnceATokenExists };
        let trusted_proxies = Networks::parse(config.trusted_proxies.iter().map(String::as_str))
            .map_err(|wrong| anyhow!("server.trusted_proxies: {wrong}"))?;
        let gate = GateSettings {
            demand,
            trusted_proxies,
            names: config.names.clone(),
            requests_per_s: config.requests_per_s,
        };
        let server = ServerSettings {
            connections: config.max_connections as usize,
            connections_per_address: config.max_connections_per_address as usize,
            idle_timeout: Duration::from_secs_f64(config.idle_timeout_s),
            tls,
        };
        Ok(Self { gate, server, ca: own.map(|own| own.ca) })
    }

    /// Where a daemon that listens at an address is reached, without a slash at the end: what listens everywhere is
    /// reached by a name of its own, or from this machine.
    pub(super) fn url(&self, address: SocketAddr) -> String {
        let scheme = if self.server.tls.is_some() { "https" } else { "http" };
        if address.ip().is_unspecified() {
            let name = self.gate.names.first().map_or("localhost", String::as_str);
            return format!("{scheme}://{name}:{}", address.port());
        }
        format!("{scheme}://{address}")
    }
}

/// Takes the port.
pub(super) async fn bind(address: &str) -> anyhow::Result<TcpListener> {
    match TcpListener::bind(address).await {
        Ok(listener) => Ok(listener),
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            Err(anyhow!("{address} is taken by another program; choose another address"))
        }
        Err(error) => Err(error).with_context(|| format!("cannot listen on {address}")),
    }
}

/// Makes the one-time key where a token is demanded and there is none.
pub(super) fn offer_key(gate: &Gate, url: &str, may_print: bool) -> anyhow::Result<()> {
    if !gate.demands() || gate.tokens().has_any() {
        return Ok(());
    }
    let key = Secret::random("").context("no key can be made")?;
    let link = format!("{url}/login?once={}", key.reveal());
    if may_print && std::io::stdout().is_terminal() {
        gate.once().set(&key, KEY_LASTS, None);
        println!("there is no token yet; within an hour this opens the page, once:\n  {link}");
        return Ok(());
    }
    let file = state_folder()?.join(KEY_FILE);
    // The key is good before its link can be read: whoever reads the file at once gets in.
    gate.once().set(&key, KEY_LASTS, Some(file.clone()));
    write_private(&file, format!("{link}\n").as_bytes()).with_context(|| format!("cannot write {}", file.display()))?;
    tracing::info!(file = %file.display(), "there is no token yet; the file holds a link that opens the page once");
    eprintln!(
        "plenalign: there is no token yet: {} holds a link that opens the page once, within an hour",
        file.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decide(config: &ServerConfig, address: &str, insecure: bool) -> anyhow::Result<Exposure> {
        let state = tempfile::tempdir()?;
        Exposure::decide(config, address.parse()?, state.path(), insecure)
    }

    #[test]
    fn beyond_loopback_nothing_is_open() {
        let config = ServerConfig::default();
        for address in ["127.0.0.1:80", "[::1]:80"] {
            let exposure = decide(&config, address, false).unwrap();
            assert_eq!(exposure.gate.demand, Demand::OnceATokenExists);
            assert!(exposure.url(address.parse().unwrap()).starts_with("http://"));
        }
        for address in ["0.0.0.0:80", "192.0.2.1:80", "[::]:80"] {
            let refused = decide(&config, address, false).err().unwrap().to_string();
            for hint in ["tls init", "[server.tls]", "--insecure"] {
                assert!(refused.contains(hint), "{refused}");
            }
            // Without TLS, and still not without a token.
            assert_eq!(decide(&config, address, true).unwrap().gate.demand, Demand::Always);
        }
        let required = ServerConfig { auth: Auth::Required, ..config };
        assert_eq!(decide(&required, "127.0.0.1:80", false).unwrap().gate.demand, Demand::Always);
    }
}
