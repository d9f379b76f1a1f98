//! The daemon's address: whether it can be taken, and who answers there.

use std::fs;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::Timestamp;
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use tokio::net::{TcpListener, lookup_host};
use tokio::time::timeout;
use x509_parser::parse_x509_certificate;

use crate::api::server::read_certificate;
use crate::api::types::Health;
use crate::cli::doctor::facts::{CertificateFacts, DaemonFacts, PortState, ServerFacts};
use crate::cli::open_files;
use crate::cli::remote::{Daemon, RemoteArgs};
use crate::cli::tls::OwnFiles;
use crate::config::Config;
use crate::state_folder::state_folder;

/// Longest wait for a name's address, and for each of a daemon's answers.
const ALLOWED: Duration = Duration::from_secs(3);

pub(super) async fn server(listen: &str, config: Option<&Config>) -> ServerFacts {
    let address = resolve(listen).await;
    let own = state_folder().ok().and_then(|state| OwnFiles::find(&state));
    let beyond = address.as_ref().is_ok_and(|address| !address.ip().is_loopback());
    let given = config.map(|config| &config.server.tls).filter(|tls| tls.is_given());
    let (certificate, ca) = match (given, own) {
        (Some(tls), _) => (Some(certificate(&tls.certificate, &tls.key, false)), None),
        (None, Some(own)) => (Some(certificate(&own.certificate, &own.key, true)), Some(own.ca)),
        (None, None) => (None, None),
    };
    let tls = given.is_some() || beyond && certificate.is_some();
    let port = match &address {
        Ok(address) => port(*address, tls, ca).await,
        Err(why) => PortState::Refused(why.clone()),
    };
    ServerFacts { listen: listen.to_owned(), address, port, certificate, open_files: open_files::hard_limit() }
}

async fn resolve(listen: &str) -> Result<SocketAddr, String> {
    let no_address = |why: &str| format!("{listen:?} is no address with a port, such as 127.0.0.1:8080: {why}");
    match timeout(ALLOWED, lookup_host(listen)).await {
        Err(_) => Err(no_address("nobody says which address the name has")),
        Ok(Err(error)) => Err(no_address(&error.to_string())),
        Ok(Ok(mut found)) => found.next().ok_or_else(|| no_address("the name has none")),
    }
}

/// Whether an address can be taken; it is given back at once.
async fn port(address: SocketAddr, tls: bool, ca: Option<PathBuf>) -> PortState {
    match TcpListener::bind(address).await {
        Ok(_) => PortState::Free,
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            let url = format!("{}://{}", if tls { "https" } else { "http" }, reached_at(address));
            let daemon = ask(&url, RemoteArgs { token: None, ca: ca.filter(|_| tls) }).await;
            PortState::Taken { url, daemon }
        }
        Err(error) => PortState::Refused(error.to_string()),
    }
}

/// Where what listens at an address is reached from this machine.
fn reached_at(address: SocketAddr) -> SocketAddr {
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => (Ipv4Addr::LOCALHOST, address.port()).into(),
        IpAddr::V6(ip) if ip.is_unspecified() => (Ipv6Addr::LOCALHOST, address.port()).into(),
        _ => address,
    }
}

/// What a daemon says of itself. Nobody needs a token for that.
async fn ask(url: &str, remote: RemoteArgs) -> Result<DaemonFacts, String> {
    let words = |error: anyhow::Error| crate::cli::one_line(&error);
    let daemon = Daemon::new(url, &remote).map_err(words)?;
    let late = || format!("no answer within {ALLOWED:?}");
    let health: Health = timeout(ALLOWED, daemon.get("/healthz")).await.map_err(|_| late())?.map_err(words)?;
    let hindrances = timeout(ALLOWED, daemon.hindrances()).await.map_err(|_| late())?.map_err(words)?;
    Ok(DaemonFacts { version: health.version, simulated: health.simulated, hindrances })
}

fn certificate(path: &Path, key: &Path, own: bool) -> CertificateFacts {
    let fault = read_certificate(path, key).err().map(|error| error.to_string());
    let (from, until) = dates(path).unzip();
    CertificateFacts { path: path.to_owned(), own, fault, from, until }
}

/// Since when and until when the first certificate of a file is good.
fn dates(path: &Path) -> Option<(Timestamp, Timestamp)> {
    let der = CertificateDer::from_pem_slice(&fs::read(path).ok()?).ok()?;
    let (_, certificate) = parse_x509_certificate(&der).ok()?;
    let validity = certificate.validity();
    let at = |time: x509_parser::time::ASN1Time| Timestamp::from_second(time.timestamp()).ok();
    Some((at(validity.not_before)?, at(validity.not_after)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_listens_everywhere_is_reached_over_loopback() {
        let reached = |address: &str| reached_at(address.parse().unwrap()).to_string();
        assert_eq!(reached("0.0.0.0:8443"), "127.0.0.1:8443");
        assert_eq!(reached("[::]:8443"), "[::1]:8443");
        assert_eq!(reached("192.0.2.7:8443"), "192.0.2.7:8443");
    }

    #[tokio::test]
    async fn an_address_is_free_or_says_who_is_there() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        tokio::spawn(async move { while listener.accept().await.is_ok() {} });
        let PortState::Taken { daemon: Err(why), url } = port(address, false, None).await else {
            panic!("it is taken, by no daemon");
        };
        assert!(url.ends_with(&address.to_string()) && !why.is_empty(), "{url}: {why}");
        assert!(matches!(port("127.0.0.1:0".parse().unwrap(), false, None).await, PortState::Free));
        assert!(matches!(port("192.0.2.1:80".parse().unwrap(), false, None).await, PortState::Refused(_)));
        assert!(resolve("no address").await.is_err());
    }

    #[test]
    fn a_certificates_dates_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let (path, key_path) = (folder.path().join("server.pem"), folder.path().join("server.key"));
        let key = rcgen::KeyPair::generate().unwrap();
        let mut params = rcgen::CertificateParams::new(vec!["bench.lab".to_owned()]).unwrap();
        (params.not_before, params.not_after) = (rcgen::date_time_ymd(2024, 1, 2), rcgen::date_time_ymd(2025, 3, 4));
        fs::write(&path, params.self_signed(&key).unwrap().pem()).unwrap();
        fs::write(&key_path, key.serialize_pem()).unwrap();
        let found = certificate(&path, &key_path, true);
        assert_eq!(found.fault, None);
        assert_eq!(found.until.unwrap().to_string(), "2025-03-04T00:00:00Z");
        assert_eq!(found.from.unwrap().to_string(), "2024-01-02T00:00:00Z");
        let missing = certificate(&folder.path().join("none.pem"), &key_path, false);
        assert!(missing.fault.is_some_and(|why| why.contains("none.pem")) && missing.until.is_none());
    }
}
