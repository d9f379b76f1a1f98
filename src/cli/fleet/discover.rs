//! Daemons that announce themselves on the local network.

use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use mdns_sd::{IfKind, ResolvedService, ServiceDaemon, ServiceEvent};
use reqwest::Url;

use super::ask::Target;
use crate::cli::announce::KIND;
use crate::cli::remote::RemoteArgs;

/// How long is listened.
pub(super) const LOOK: Duration = Duration::from_secs(2);

/// The daemons that are heard of within [`LOOK`]. Anybody on the network can announce a daemon: who asks is told only to
/// one that a given authority vouches for.
///
/// # Errors
/// When the network cannot be used for it.
pub(super) async fn daemons(remote: &RemoteArgs) -> anyhow::Result<Vec<Target>> {
    let remote = remote.clone();
    let found = tokio::task::spawn_blocking(move || listen(&remote)).await;
    found.context("the search ended")?.context("the local network cannot be searched")
}

fn listen(remote: &RemoteArgs) -> anyhow::Result<Vec<Target>> {
    let resolver = ServiceDaemon::new().context("no multicast")?;
    resolver.disable_interface(vec![IfKind::LoopbackV4, IfKind::LoopbackV6])?;
    let events = resolver.browse(KIND)?;
    let (until, mut found) = (Instant::now() + LOOK, Vec::<Target>::new());
    while let Ok(event) = events.recv_deadline(until) {
        let ServiceEvent::ServiceResolved(service) = event else { continue };
        let Some(target) = target(&service, remote) else { continue };
        // One that has several addresses is heard of several times.
        found.retain(|other| other.name != target.name);
        found.push(target);
    }
    let _ = resolver.shutdown();
    found.sort_by(|one, other| one.name.cmp(&other.name));
    Ok(found)
}

/// Where an announced daemon is asked.
fn target(service: &ResolvedService, remote: &RemoteArgs) -> Option<Target> {
    let kind = format!(".{KIND}");
    let name = service.get_fullname().strip_suffix(&kind).unwrap_or(service.get_fullname()).to_owned();
    let mut addresses: Vec<IpAddr> = service.get_addresses().iter().map(|address| address.to_ip_addr()).collect();
    // IPv4 first: an IPv6 address of one link says nothing without that link.
    addresses.sort();
    let at = SocketAddr::new(*addresses.first()?, service.get_port());
    let tls = service.get_property_val_str("tls") == Some("true");
    if !tls {
        let url = Url::parse(&format!("http://{at}")).ok()?;
        return Some(Target { name, url, remote: RemoteArgs::default(), at: None });
    }
    // The name that every certificate made by `plenalign tls init` has.
    let host = service.get_hostname().trim_end_matches('.').trim_end_matches(".local").to_owned();
    let url = Url::parse(&format!("https://{host}:{}", at.port())).ok()?;
    let token = remote.token.clone().filter(|_| remote.ca.is_some());
    Some(Target { name, url, remote: RemoteArgs { token, ca: remote.ca.clone() }, at: Some(at) })
}

#[cfg(test)]
mod tests {
    use mdns_sd::ServiceInfo;

    use super::*;

    fn announced(tls: &str) -> ResolvedService {
        let properties = [("tls", tls), ("bench", "real")];
        let address: IpAddr = "192.0.2.7".parse().unwrap();
        let info = ServiceInfo::new(KIND, "Plenalign on left 8443", "left.local.", address, 8443, &properties[..]);
        info.unwrap().as_resolved_service()
    }

    #[test]
    fn the_token_goes_to_nobody_that_no_authority_vouches_for() {
        let token = Some("plenalign_secret".to_owned());
        let trusting = RemoteArgs { token: token.clone(), ca: Some("ca.pem".into()) };
        let vouched = target(&announced("true"), &trusting).unwrap();
        assert_eq!((vouched.name.as_str(), vouched.url.as_str()), ("Plenalign on left 8443", "https://left:8443/"));
        assert_eq!((vouched.remote.token, vouched.at), (token.clone(), Some("192.0.2.7:8443".parse().unwrap())));
        let plain = target(&announced("false"), &trusting).unwrap();
        assert_eq!((plain.url.as_str(), plain.remote.token), ("http://192.0.2.7:8443/", None));
        let unknown = target(&announced("true"), &RemoteArgs { token, ca: None }).unwrap();
        assert_eq!(unknown.remote.token, None);
    }
}
