//! TLS towards the broker: whom to believe, and what to show.

use std::path::Path;
use std::sync::Arc;

use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject as _};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ClientConfig, RootCertStore};

use crate::config::MqttTlsConfig;

/// Reads the authorities and this daemon's certificate.
///
/// # Errors
/// What cannot be used, in words, with its key.
pub(super) fn read(config: &MqttTlsConfig) -> Result<Arc<ClientConfig>, String> {
    let roots = if config.ca.as_os_str().is_empty() { trusted_by_system()? } else { authorities(&config.ca)? };
    let builder = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| format!("TLS cannot be spoken: {error}"))?
        .with_root_certificates(roots);
    if config.certificate.as_os_str().is_empty() {
        return Ok(Arc::new(builder.with_no_client_auth()));
    }
    let chain = certificates(&config.certificate, "mqtt.tls.certificate")?;
    let key = PrivateKeyDer::from_pem_file(&config.key)
        .map_err(|error| wrong("mqtt.tls.key", &config.key, "private key", &error))?;
    builder.with_client_auth_cert(chain, key).map(Arc::new).map_err(|error| {
        let (certificate, key) = (config.certificate.display(), config.key.display());
        format!("mqtt.tls.certificate: {certificate} and the key {key} cannot be used together: {error}")
    })
}

fn authorities(file: &Path) -> Result<RootCertStore, String> {
    let mut roots = RootCertStore::empty();
    for certificate in certificates(file, "mqtt.tls.ca")? {
        roots.add(certificate).map_err(|error| format!("mqtt.tls.ca: {} cannot be used: {error}", file.display()))?;
    }
    Ok(roots)
}

fn trusted_by_system() -> Result<RootCertStore, String> {
    let found = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    // Some systems have old ones among them that nothing can use.
    let (usable, _) = roots.add_parsable_certificates(found.certs);
    if usable == 0 {
        let why = found.errors.first().map_or_else(String::new, |error| format!(" ({error})"));
        return Err(format!("mqtt.tls.ca: none is given, and this system trusts no authority{why}"));
    }
    Ok(roots)
}

fn certificates(file: &Path, key: &str) -> Result<Vec<CertificateDer<'static>>, String> {
    let found: Vec<_> = CertificateDer::pem_file_iter(file)
        .and_then(Iterator::collect)
        .map_err(|error| wrong(key, file, "certificate", &error))?;
    if found.is_empty() {
        return Err(wrong(key, file, "certificate", &pem::Error::NoItemsFound));
    }
    Ok(found)
}

fn wrong(key: &str, file: &Path, what: &str, error: &pem::Error) -> String {
    match error {
        pem::Error::Io(error) => format!("{key}: cannot read {}: {error}", file.display()),
        error => format!("{key}: {} holds no {what} in PEM: {error}", file.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_used_is_named_with_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let made = rcgen::generate_simple_self_signed(vec!["bench".to_owned()]).unwrap();
        let other = rcgen::generate_simple_self_signed(vec!["bench".to_owned()]).unwrap();
        let certificate = at("certificate.pem", &made.cert.pem());
        let key = at("key.pem", &made.signing_key.serialize_pem());
        let other = at("other.pem", &other.signing_key.serialize_pem());
        let (nothing, none) = (at("nothing.pem", "nothing"), folder.path().join("none.pem"));
        let good = MqttTlsConfig { ca: certificate.clone(), certificate, key };
        read(&good).unwrap();
        for (wrong, words) in [
            (MqttTlsConfig { ca: none, ..good.clone() }, ["mqtt.tls.ca: cannot read", "none.pem"]),
            (MqttTlsConfig { ca: nothing.clone(), ..good.clone() }, ["mqtt.tls.ca", "no certificate in PEM"]),
            (MqttTlsConfig { key: nothing, ..good.clone() }, ["mqtt.tls.key", "no private key in PEM"]),
            (MqttTlsConfig { key: other, ..good }, ["mqtt.tls.certificate", "cannot be used together"]),
        ] {
            let why = read(&wrong).unwrap_err();
            assert!(words.iter().all(|words| why.contains(words)), "{why}");
        }
    }
}
