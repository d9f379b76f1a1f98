//! Where the daemon serves, whom it lets in, and what is there now.

use jiff::{SignedDuration, Timestamp};

use crate::cli::doctor::facts::{CertificateFacts, DaemonFacts, Facts, PortState, TokenFacts, quoted};
use crate::cli::doctor::finding::Finding;
use crate::cli::open_files::needed;
use crate::config::{Auth, Config};

/// A certificate that ends sooner is to be renewed.
const RENEW_BEFORE: SignedDuration = SignedDuration::from_hours(30 * 24);

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let mut found = vec![port(facts)];
    if let PortState::Taken { daemon: Ok(daemon), url } = &facts.server.port {
        found.extend(daemon_state(daemon, url, facts));
    }
    if let Some(config) = facts.configuration.config() {
        found.extend(exposure(config, facts));
        found.extend(alpaca(config));
        found.extend(facts.server.open_files.map(|limit| open_files(config, limit)));
    }
    found.extend(facts.server.certificate.as_ref().map(|certificate| of_certificate(certificate, facts.system.now)));
    found
}

fn port(facts: &Facts) -> Finding {
    const ID: &str = "server.port";
    let listen = &facts.server.listen;
    let what = format!("address {listen}");
    if let Err(why) = &facts.server.address {
        return Finding::problem(ID, what, why, "plenalign doctor --listen 127.0.0.1:8080");
    }
    match &facts.server.port {
        PortState::Free => Finding::ok(ID, what, "is free: no daemon serves there"),
        PortState::Refused(why) => Finding::problem(
            ID,
            what,
            format!("cannot be listened on: {why}"),
            "ip -br address    # choose an address of this machine, and a port from 1024 up: --listen ADDRESS:PORT",
        ),
        PortState::Taken { url, daemon: Ok(daemon) } => {
            Finding::ok(ID, what, format!("plenalign {} answers at {url}", daemon.version))
        }
        PortState::Taken { url, daemon: Err(why) } => Finding::problem(
            ID,
            what,
            format!("is taken, and what listens does not answer {url}/healthz as a daemon does: {why}"),
            format!(
                "sudo ss -ltnp 'sport = :{}'    # end it, or choose another: --listen ADDRESS:PORT",
                port_of(listen)
            ),
        ),
    }
}

fn port_of(listen: &str) -> &str {
    listen.rsplit_once(':').map_or(listen, |(_, port)| port)
}

/// What the daemon that runs says of itself.
fn daemon_state(daemon: &DaemonFacts, url: &str, facts: &Facts) -> Vec<Finding> {
    let what = format!("daemon at {url}");
    let mut found = Vec::new();
    if daemon.version != facts.system.version {
        found.push(Finding::warning(
            "server.version",
            &what,
            format!("is version {}, this program {}", daemon.version, facts.system.version),
            "sudo systemctl restart plenalign",
        ));
    }
    let bench = if daemon.simulated { "its SIMULATED bench" } else { "its bench" };
    found.push(if daemon.hindrances.is_empty() {
        Finding::ok("server.ready", what, format!("{bench} can be worked with"))
    } else {
        Finding::problem(
            "server.ready",
            what,
            format!("{bench} cannot be worked with: {}", daemon.hindrances.join("; ")),
            "journalctl -u plenalign -n 50    # and the ports and cameras above",
        )
    });
    found
}

/// Whether what is demanded fits where it serves.
fn exposure(config: &Config, facts: &Facts) -> Option<Finding> {
    const ID: &str = "server.access";
    let address = facts.server.address.as_ref().ok()?;
    let what = format!("address {}", facts.server.listen);
    let tokens = facts.state.as_ref().ok().and_then(|state| state.tokens.as_ref().ok()).copied();
    let valid = tokens.map(|TokenFacts { valid, .. }| valid);
    if !address.ip().is_loopback() {
        if facts.server.certificate.is_none() {
            return Some(Finding::problem(
                ID,
                what,
                "can be reached from other machines, and there is no certificate: the daemon does not serve there",
                "plenalign tls init NAME-OF-THIS-MACHINE",
            ));
        }
        if valid == Some(0) {
            return Some(Finding::warning(
                ID,
                what,
                "can be reached from other machines, and there is no token yet: nobody is let in but by the one-time link",
                "plenalign token create --name YOUR-NAME --scope admin",
            ));
        }
        return Some(Finding::ok(ID, what, "can be reached from other machines; TLS and a token are demanded"));
    }
    if config.server.auth == Auth::Required && valid == Some(0) {
        return Some(Finding::warning(
            ID,
            what,
            "server.auth = \"required\", and there is no token yet: nobody is let in but by the one-time link",
            "plenalign token create --name YOUR-NAME --scope admin",
        ));
    }
    Some(match valid {
        Some(0) => Finding::note(ID, what, "only this machine reaches it, and whoever is on it may command the bench")
            .mend("plenalign token create --name YOUR-NAME --scope admin    # from then on a token is demanded"),
        _ => Finding::ok(ID, what, "only this machine reaches it; a token is demanded"),
    })
}

/// Alpaca knows neither tokens nor TLS.
fn alpaca(config: &Config) -> Option<Finding> {
    let address = config.alpaca.address()?;
    let what = "alpaca.listen";
    if address.ip().is_loopback() {
        return Some(Finding::ok("server.alpaca", what, format!("{address}, which only this machine reaches")));
    }
    Some(Finding::problem(
        "server.alpaca",
        what,
        format!(
            "{address} can be reached from other machines, and Alpaca knows neither tokens nor TLS: the daemon does not \
             start without --insecure"
        ),
        format!("[alpaca] listen = \"127.0.0.1:{}\"", address.port()),
    ))
}

/// Whether the connections that are to be served fit into the limit on open files.
fn open_files(config: &Config, limit: u64) -> Finding {
    const ID: &str = "server.open_files";
    let what = "open files";
    let connections = config.server.max_connections;
    let needed = needed(connections as usize);
    if limit >= needed {
        return Finding::ok(
            ID,
            what,
            format!("{limit} for a process, of which {connections} connections need {needed}"),
        );
    }
    Finding::warning(
        ID,
        what,
        format!(
            "a process of this user may have {limit}, and server.max_connections = {connections} needs {needed}: the \
             daemon serves fewer, or does not start"
        ),
        format!("ulimit -n {needed}    # the service: LimitNOFILE={needed}, by: sudo systemctl edit plenalign"),
    )
}

fn of_certificate(certificate: &CertificateFacts, now: Timestamp) -> Finding {
    const ID: &str = "server.certificate";
    let what = certificate.path.display().to_string();
    let mend = if certificate.own {
        "plenalign tls init NAME-OF-THIS-MACHINE && sudo systemctl restart plenalign".to_owned()
    } else {
        format!(
            "openssl x509 -noout -dates -in {}    # have it renewed, then: sudo systemctl restart plenalign",
            quoted(&certificate.path)
        )
    };
    if let Some(why) = &certificate.fault {
        return Finding::problem(ID, what, why, mend);
    }
    let day = |at: Timestamp| at.strftime("%Y-%m-%d").to_string();
    match (certificate.from, certificate.until) {
        (_, Some(until)) if until <= now => {
            Finding::problem(ID, what, format!("expired on {}: nobody trusts the daemon", day(until)), mend)
        }
        (Some(from), _) if from > now => Finding::problem(
            ID,
            what,
            format!("is good from {} on, and the clock says {}", day(from), day(now)),
            "date -u    # is the clock right?",
        ),
        (_, Some(until)) if until.duration_since(now) < RENEW_BEFORE => {
            Finding::warning(ID, what, format!("expires on {}", day(until)), mend)
        }
        (_, Some(until)) => Finding::ok(ID, what, format!("good until {}", day(until))),
        (_, None) => Finding::note(ID, what, "its dates cannot be read"),
    }
}
