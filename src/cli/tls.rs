//! `plenalign tls init`: a certification authority of one's own, and a certificate by it for the daemon.

use std::fs;
use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use jiff::{ToSpan as _, Zoned};
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
};
use serde_json::json;

use crate::access::write_private;
use crate::state_folder::state_folder;

/// How long the authority's certificate is good: whoever trusts it need not do so again soon.
const CA_YEARS: i32 = 10;
/// How long the daemon's is: the longest that every browser takes.
const LEAF_DAYS: i32 = 820;
const FOLDER: &str = "tls";
const CA: &str = "ca.pem";
const CA_KEY: &str = "ca.key";
const LEAF: &str = "server.pem";
const LEAF_KEY: &str = "server.key";

/// Arguments of `plenalign tls`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Make a certificate for the daemon, and an authority that vouches for it where there is none yet.
    Init {
        /// Names and addresses by which the daemon is to be reached; this machine's name and loopback are added.
        #[arg(value_name = "NAME|ADDRESS")]
        names: Vec<String>,
        /// Make a new authority, too: everybody has to trust it anew.
        #[arg(long)]
        new_ca: bool,
        /// Print one JSON object instead of text: `ca`, `certificate`, `key`, `names`, `expires`.
        #[arg(long)]
        json: bool,
    },
}

/// Certificate files in the state folder, made here.
pub(super) struct OwnFiles {
    /// The daemon's certificate.
    pub(super) certificate: PathBuf,
    /// Its key.
    pub(super) key: PathBuf,
    /// The authority's certificate, to be handed out.
    pub(super) ca: PathBuf,
}

impl OwnFiles {
    /// The files of a state folder, if they are there.
    pub(super) fn find(state: &Path) -> Option<Self> {
        let files = Self::of(state);
        files.certificate.exists().then_some(files)
    }

    fn of(state: &Path) -> Self {
        let folder = state.join(FOLDER);
        Self { certificate: folder.join(LEAF), key: folder.join(LEAF_KEY), ca: folder.join(CA) }
    }
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Command::Init { names, new_ca, json } = &args.command;
    let state = state_folder()?;
    let (names, files) = (with_own(names)?, OwnFiles::of(&state));
    let made_ca = *new_ca || !files.ca.exists();
    let expires = init(&files, &state.join(FOLDER).join(CA_KEY), &names, made_ca)?;
    if *json {
        println!(
            "{}",
            json!({ "ca": files.ca, "certificate": files.certificate, "key": files.key, "names": names, "expires": expires })
        );
        return Ok(ExitCode::SUCCESS);
    }
    println!("certificate for {}, good until {expires}: {}", names.join(", "), files.certificate.display());
    if made_ca {
        println!("trust its authority wherever the daemon is used: {}", files.ca.display());
        println!("  browsers: import it as an authority; command line: --ca {}", files.ca.display());
    } else {
        println!("by the authority that there was: {}", files.ca.display());
    }
    println!("`plenalign serve --listen 0.0.0.0:8443` takes it; restart a daemon that runs");
    Ok(ExitCode::SUCCESS)
}

/// The names asked for, and those by which a machine is known to itself.
fn with_own(asked: &[String]) -> anyhow::Result<Vec<String>> {
    let mut names: Vec<String> = Vec::new();
    let host = super::remote::host_name();
    let own = host.into_iter().chain(["localhost", "127.0.0.1", "::1"].map(str::to_owned));
    for name in asked.iter().cloned().chain(own.filter(|name| is_name(name))) {
        if !is_name(&name) {
            bail!("{name:?} is neither a host's name nor an address: give them without scheme and port");
        }
        if !names.contains(&name) {
            names.push(name);
        }
    }
    Ok(names)
}

fn is_name(name: &str) -> bool {
    name.parse::<IpAddr>().is_ok()
        || !name.is_empty() && name.len() <= 253 && name.chars().all(|c| c.is_ascii_alphanumeric() || ".-".contains(c))
}

/// Makes the files; returns the day on which the daemon's certificate ends.
fn init(files: &OwnFiles, ca_key: &Path, names: &[String], new_ca: bool) -> anyhow::Result<String> {
    let issuer = if new_ca {
        let key = KeyPair::generate().context("no key can be made")?;
        let params = ca_params()?;
        let certificate = params.self_signed(&key).context("no authority can be made")?;
        // The key first: a certificate without its key would look like an authority, and could vouch for nothing.
        write(ca_key, &key.serialize_pem())?;
        write(&files.ca, &certificate.pem())?;
        Issuer::new(params, key)
    } else {
        let read = |path: &Path| fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()));
        let unusable = || format!("{} is no authority; --new-ca makes another", files.ca.display());
        let key = KeyPair::from_pem(&read(ca_key)?).with_context(unusable)?;
        Issuer::from_ca_cert_pem(&read(&files.ca)?, key).with_context(unusable)?
    };
    let key = KeyPair::generate().context("no key can be made")?;
    let (params, until) = leaf_params(names)?;
    let certificate = params.signed_by(&key, &issuer).context("no certificate can be made")?;
    write(&files.key, &key.serialize_pem())?;
    write(&files.certificate, &certificate.pem())?;
    Ok(until)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    write_private(path, text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))
}

fn ca_params() -> anyhow::Result<CertificateParams> {
    let mut params = CertificateParams::new(Vec::new())?;
    let today = Zoned::now();
    // Two benches' authorities are told apart by their day and a number.
    let number = uuid::Uuid::now_v7().simple().to_string();
    let name = format!("Plenalign {} {}", today.date(), &number[number.len() - 6..]);
    params.distinguished_name.push(DnType::CommonName, name);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    params.use_authority_key_identifier_extension = true;
    valid(&mut params, &today, CA_YEARS.years())?;
    Ok(params)
}

/// What the daemon's certificate says, and the day on which it ends.
fn leaf_params(names: &[String]) -> anyhow::Result<(CertificateParams, String)> {
    let mut params = CertificateParams::new(names.to_vec())?;
    params.distinguished_name.push(DnType::CommonName, "Plenalign");
    params.is_ca = IsCa::ExplicitNoCa;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
    params.use_authority_key_identifier_extension = true;
    let until = valid(&mut params, &Zoned::now(), LEAF_DAYS.days())?;
    Ok((params, until))
}

/// Good from yesterday, for clocks that are late.
fn valid(params: &mut CertificateParams, today: &Zoned, lasts: jiff::Span) -> anyhow::Result<String> {
    let from = today.date().yesterday()?;
    let until = today.date().checked_add(lasts)?;
    let day = |date: jiff::civil::Date| {
        rcgen::date_time_ymd(date.year().into(), date.month().unsigned_abs(), date.day().unsigned_abs())
    };
    (params.not_before, params.not_after) = (day(from), day(until));
    Ok(until.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_hosts_and_addresses() {
        let names = with_own(&["bench.lab".to_owned(), "192.168.1.5".to_owned(), "localhost".to_owned()]).unwrap();
        assert_eq!(&names[..3], ["bench.lab", "192.168.1.5", "localhost"]);
        assert!(names.contains(&"127.0.0.1".to_owned()) && names.contains(&"::1".to_owned()));
        for wrong in ["https://bench.lab", "bench.lab:8443", "", "b c"] {
            assert!(with_own(&[wrong.to_owned()]).is_err(), "{wrong}");
        }
    }
}
