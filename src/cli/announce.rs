//! The daemon announced on the local network, so that programs find it by its kind: mDNS and DNS-SD.

use std::net::SocketAddr;
use std::time::Duration;

use anyhow::Context as _;
use mdns_sd::{IfKind, ServiceDaemon, ServiceInfo};

use super::remote;

/// What is announced.
pub(super) const KIND: &str = "_plenalign._tcp.local.";
/// How long taking it back may take.
const FAREWELL: Duration = Duration::from_millis(500);
/// Longest label of a name, bytes.
const LABEL: usize = 63;

/// An announcement, taken back when this is dropped.
pub(super) struct Announcement {
    daemon: ServiceDaemon,
    name: String,
}

impl Announcement {
    /// Announces a daemon that listens at an address; nothing where that is loopback, which nobody else can reach.
    ///
    /// # Errors
    /// When the network cannot be used for it.
    pub(super) fn start(address: SocketAddr, tls: bool, simulated: bool) -> anyhow::Result<Option<Self>> {
        if address.ip().is_loopback() {
            return Ok(None);
        }
        let host = host_name();
        let service = service(&host, address, tls, simulated).context("this cannot be announced")?;
        let daemon = ServiceDaemon::new().context("no multicast")?;
        // Loopback is nobody's network; and what listens at one address is announced where that is.
        daemon.disable_interface(vec![IfKind::LoopbackV4, IfKind::LoopbackV6])?;
        if !address.ip().is_unspecified() {
            daemon.disable_interface(IfKind::All)?;
            daemon.enable_interface(IfKind::Addr(address.ip()))?;
        } else if address.is_ipv4() {
            daemon.disable_interface(IfKind::IPv6)?;
        }
        let name = service.get_fullname().to_owned();
        daemon.register(service)?;
        tracing::info!(%name, "announced on the local network");
        Ok(Some(Self { daemon, name }))
    }
}

impl Drop for Announcement {
    fn drop(&mut self) {
        if let Ok(done) = self.daemon.unregister(&self.name) {
            let _ = done.recv_timeout(FAREWELL);
        }
        let _ = self.daemon.shutdown();
    }
}

fn service(host: &str, address: SocketAddr, tls: bool, simulated: bool) -> mdns_sd::Result<ServiceInfo> {
    let properties = [
        ("version", env!("CARGO_PKG_VERSION")),
        ("path", "/"),
        ("api", "/api/v1"),
        ("tls", if tls { "true" } else { "false" }),
        ("bench", if simulated { "simulated" } else { "real" }),
    ];
    let (target, instance) = (format!("{host}.local."), instance(host, address.port()));
    if address.ip().is_unspecified() {
        return Ok(ServiceInfo::new(KIND, &instance, &target, (), address.port(), &properties[..])?.enable_addr_auto());
    }
    ServiceInfo::new(KIND, &instance, &target, address.ip(), address.port(), &properties[..])
}

/// The daemon's name for people: two of one machine are told apart by their ports.
fn instance(host: &str, port: u16) -> String {
    let end = format!(" {port}");
    let room = LABEL - "Plenalign on ".len() - end.len();
    let host: String = host.chars().take(room).collect();
    format!("Plenalign on {host}{end}")
}

/// This machine's name without its domain; letters, digits and hyphens.
fn host_name() -> String {
    let whole = remote::host_name().unwrap_or_default();
    let first = whole.split('.').next().unwrap_or_default();
    let name: String = first.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').take(LABEL).collect();
    if name.is_empty() { "plenalign".to_owned() } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_announced_says_how_it_is_reached() {
        let address: SocketAddr = "192.0.2.7:8443".parse().unwrap();
        let service = service("bench", address, true, false).unwrap();
        assert_eq!(service.get_fullname(), "Plenalign on bench 8443._plenalign._tcp.local.");
        assert_eq!((service.get_hostname(), service.get_port()), ("bench.local.", 8443));
        let said = |key| service.get_property_val_str(key);
        assert_eq!((said("path"), said("tls"), said("bench")), (Some("/"), Some("true"), Some("real")));
        assert_eq!(said("version"), Some(env!("CARGO_PKG_VERSION")));
        assert!(instance(&"x".repeat(80), 65535).len() <= LABEL);
    }

    #[test]
    fn loopback_is_not_announced() {
        for address in ["127.0.0.1:8080", "[::1]:8080"] {
            assert!(Announcement::start(address.parse().unwrap(), false, true).unwrap().is_none());
        }
    }
}
