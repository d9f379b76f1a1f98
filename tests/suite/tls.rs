//! The program beyond loopback, and on the command line: certificates, tokens, the one-time link, the stop.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use reqwest::{Certificate, Client};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use super::daemon::problem;
use super::program::{Program, plenalign, serve};
use super::until::until;

fn run(state: &Path, arguments: &[&str]) -> Output {
    plenalign(state).args(arguments).output().unwrap()
}

/// What a command prints as JSON.
fn said(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// What a command that fails says of it: one line.
fn refusal(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(text.lines().filter(|line| line.starts_with("plenalign: ")).count(), 1, "{text}");
    text
}

fn trusting(ca: &Path) -> Client {
    plenalign::api::server::use_ring();
    let ca = Certificate::from_pem(&std::fs::read(ca).unwrap()).unwrap();
    Client::builder().no_proxy().tls_certs_only([ca]).redirect(reqwest::redirect::Policy::none()).build().unwrap()
}

fn mode(path: &Path) -> u32 {
    std::fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn beyond_loopback_it_does_not_start_without_a_certificate() {
    let state = tempfile::tempdir().unwrap();
    let said = refusal(&run(state.path(), &["serve", "--simulated", "--listen", "0.0.0.0:0"]));
    for hint in ["plenalign tls init", "[server.tls]", "--insecure"] {
        assert!(said.contains(hint), "{said}");
    }
}

#[tokio::test]
async fn without_tls_it_still_demands_a_token() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(serve(state.path(), &["--listen", "0.0.0.0:0", "--insecure"]));
    let client = super::daemon::client();
    let response = client.get(format!("{}/api/v1/bench", program.url())).send().await.unwrap();
    problem(response, 401, "unauthorised").await;
}

#[tokio::test]
async fn a_certificate_made_here_is_served_and_trusted_with_its_authority() {
    let state = tempfile::tempdir().unwrap();
    let made = said(&run(state.path(), &["tls", "init", "--json", "bench.lab", "192.0.2.7"]));
    let path = |key: &str| PathBuf::from(made[key].as_str().unwrap());
    let names: Vec<&str> = made["names"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(names.starts_with(&["bench.lab", "192.0.2.7"]) && names.contains(&"localhost"), "{names:?}");
    let ca_key = path("ca").with_extension("key");
    for file in [path("key"), ca_key.clone()] {
        assert_eq!(mode(&file), 0o600, "{}", file.display());
    }
    for name in ["bench.lab", "localhost", "192.0.2.7", "127.0.0.1"] {
        verify(&path("ca"), &path("certificate"), name).unwrap();
    }
    assert!(verify(&path("ca"), &path("certificate"), "other.lab").is_err());
    let text = described(&path("certificate"));
    for part in [
        "X509v3 Subject Key Identifier",
        "X509v3 Authority Key Identifier",
        "CA:FALSE",
        "TLS Web Server Authentication",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }

    let token = said(&run(state.path(), &["token", "create", "--name", "Ana", "--scope", "control", "--json"]));
    let secret = token["secret"].as_str().unwrap();
    let program = Program::start(serve(state.path(), &["--listen", "0.0.0.0:0"]));
    assert!(program.url().starts_with("https://localhost:"), "{}", program.url());
    let client = trusting(&path("ca"));
    let bench = client.get(format!("{}/api/v1/bench", program.url())).bearer_auth(secret).send().await.unwrap();
    assert_eq!(bench.status(), 200);
    let signed_in = client.post(format!("{}/api/v1/session", program.url())).json(&json!({ "key": secret }));
    let signed_in = signed_in.header("origin", program.url()).send().await.unwrap();
    assert_eq!(signed_in.status(), 200);
    assert!(signed_in.headers()["set-cookie"].to_str().unwrap().contains("; Secure"));
    // Who does not trust the authority does not talk to the daemon.
    assert!(super::daemon::client().get(program.url()).send().await.is_err());

    // Plain HTTP gets an answer, and nothing else.
    let plain = super::daemon::client().get(format!("http://127.0.0.1:{}/login?a=b", program.port()));
    let client = Client::builder().no_proxy().tls_certs_only([]).redirect(reqwest::redirect::Policy::none());
    let plain = client.build().unwrap().execute(plain.build().unwrap()).await.unwrap();
    assert_eq!(plain.status(), 308);
    assert_eq!(plain.headers()["location"], format!("https://127.0.0.1:{}/login?a=b", program.port()));
    let plain = super::daemon::client().post(format!("http://127.0.0.1:{}/api/v1/stop", program.port()));
    problem(plain.send().await.unwrap(), 400, "tls-required").await;

    // The same authority vouches for the next certificate; another one only on demand.
    let before = std::fs::read(path("ca")).unwrap();
    said(&run(state.path(), &["tls", "init", "--json", "other.lab"]));
    assert_eq!(std::fs::read(path("ca")).unwrap(), before);
    verify(&path("ca"), &path("certificate"), "other.lab").unwrap();
    said(&run(state.path(), &["tls", "init", "--json", "--new-ca"]));
    assert_ne!(std::fs::read(path("ca")).unwrap(), before);
    verify(&path("ca"), &path("certificate"), "localhost").unwrap();
}

/// Whether OpenSSL, which had no part in making it, takes a certificate for a name.
fn verify(ca: &Path, certificate: &Path, name: &str) -> Result<(), String> {
    let by = if name.parse::<std::net::IpAddr>().is_ok() { "-verify_ip" } else { "-verify_hostname" };
    let mut openssl = Command::new("openssl");
    openssl.args(["verify", "-x509_strict", "-purpose", "sslserver", by, name, "-CAfile"]).arg(ca).arg(certificate);
    let output = openssl.output().unwrap();
    if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into_owned()) }
}

fn described(certificate: &Path) -> String {
    let output = Command::new("openssl").args(["x509", "-noout", "-text", "-in"]).arg(certificate).output().unwrap();
    String::from_utf8(output.stdout).unwrap()
}

#[tokio::test]
async fn a_stop_gets_through_over_tls_when_every_connection_is_taken() {
    let state = tempfile::tempdir().unwrap();
    let made = said(&run(state.path(), &["tls", "init", "--json"]));
    let ca = made["ca"].as_str().unwrap();
    let token = said(&run(state.path(), &["token", "create", "--name", "Vera", "--scope", "view", "--json"]));
    let config = format!(
        "[bench.simulation]\nrays = 4\n[server]\nmax_connections = 3\n[server.tls]\ncertificate = {}\nkey = {}\n",
        made["certificate"], made["key"]
    );
    std::fs::write(state.path().join("bench.toml"), config).unwrap();
    let program = Program::start(serve(state.path(), &["--listen", "127.0.0.1:0"]));
    assert!(program.url().starts_with("https://127.0.0.1:"));
    let mut held = Vec::new();
    for _ in 0..40 {
        // Some say nothing at all, some begin a handshake that never ends.
        let mut stream = TcpStream::connect(("127.0.0.1", program.port())).await.unwrap();
        if held.len() % 2 == 0 {
            stream.write_all(&[0x16, 3, 1]).await.unwrap();
        }
        held.push(stream);
    }
    let from = Instant::now();
    let mut command = plenalign(state.path());
    command.args(["stop", "--server", program.url(), "--ca", ca, "--json"]);
    let stopped = said(&command.env("PLENALIGN_TOKEN", token["secret"].as_str().unwrap()).output().unwrap());
    assert_eq!((&stopped["focus"], &stopped["e"]), (&json!("confirmed"), &json!("confirmed")));
    assert!(from.elapsed() < Duration::from_secs(5), "the stop took {:?}", from.elapsed());
    // Without a token it is told why not.
    let refused = refusal(&run(state.path(), &["stop", "--server", program.url(), "--ca", ca]));
    assert!(refused.contains("token"), "{refused}");
    let mut one = [0];
    let _ = tokio::time::timeout(Duration::from_millis(10), held[0].read(&mut one)).await;
}

#[test]
fn tokens_are_made_listed_and_revoked_on_the_command_line() {
    let state = tempfile::tempdir().unwrap();
    let token = |arguments: &[&str]| run(state.path(), &[&["token"], arguments].concat());
    let made = token(&["create", "--name", "Ana", "--scope", "view", "--expires-in-days", "7"]);
    let secret = String::from_utf8(made.stdout).unwrap().trim().to_owned();
    assert!(secret.starts_with("plenalign_") && !secret.contains('\n'), "{secret}");
    assert!(!String::from_utf8(made.stderr).unwrap().contains(&secret));
    assert_eq!(mode(&state.path().join("tokens.json")), 0o600);
    assert!(
        !std::fs::read_to_string(state.path().join("tokens.json")).unwrap().contains(&secret["plenalign_".len()..])
    );
    let taken = refusal(&token(&["create", "--name", "Ana", "--scope", "admin"]));
    assert!(taken.contains("\"Ana\" already"), "{taken}");
    let list = said(&token(&["list", "--json"]));
    assert_eq!((&list["tokens"][0]["name"], &list["tokens"][0]["scope"]), (&json!("Ana"), &json!("view")));
    let line = String::from_utf8(token(&["list"]).stdout).unwrap();
    assert!(line.contains("Ana: made ") && line.contains("never used, expires "), "{line}");
    assert!(token(&["revoke", "Ana"]).status.success());
    let unknown = refusal(&token(&["revoke", "Ana"]));
    assert!(unknown.contains("no token \"Ana\""), "{unknown}");
    assert_eq!(said(&token(&["list", "--json"])), json!({ "tokens": [] }));
}

#[tokio::test]
async fn the_first_person_gets_in_by_a_link_that_only_the_daemons_user_can_read() {
    let state = tempfile::tempdir().unwrap();
    std::fs::write(state.path().join("bench.toml"), "[bench.simulation]\nrays = 4\n[server]\nauth = \"required\"\n")
        .unwrap();
    let program = Program::start(serve(state.path(), &["--listen", "127.0.0.1:0"]));
    let file = state.path().join("login-url");
    let link = until("there is a link", async || std::fs::read_to_string(&file)).await;
    assert_eq!(mode(&file), 0o600);
    let key = link.trim().strip_prefix(&format!("{}/login?once=", program.url())).unwrap_or_else(|| panic!("{link}"));
    let client = super::daemon::client();
    let signed_in = client.post(format!("{}/api/v1/session", program.url())).json(&json!({ "key": key }));
    assert_eq!(signed_in.send().await.unwrap().status(), 200);
    assert!(!file.exists(), "a key that is dead is left lying about");
}

#[test]
fn a_certificate_that_cannot_be_used_is_told_with_its_file() {
    let state = TempDir::new().unwrap();
    let made = said(&run(state.path(), &["tls", "init", "--json"]));
    let wrong = state.path().join("wrong.pem");
    std::fs::write(&wrong, "nothing").unwrap();
    let (certificate, key) = (made["certificate"].as_str().unwrap(), made["key"].as_str().unwrap());
    let (ca_key, wrong, gone) =
        (made["ca"].as_str().unwrap().replace("ca.pem", "ca.key"), wrong.to_str().unwrap(), "/nowhere.pem");
    let pairs = [
        (wrong, key, "holds no certificate"),
        (certificate, wrong, "holds no private key"),
        (gone, key, "cannot read /nowhere.pem"),
        (certificate, ca_key.as_str(), "cannot be used together"),
    ];
    for (certificate, key, expected) in pairs {
        let set = [format!("server.tls.certificate={certificate}"), format!("server.tls.key={key}")];
        let arguments = ["serve", "--simulated", "--listen", "127.0.0.1:0", "--set", &set[0], "--set", &set[1]];
        let said = refusal(&run(state.path(), &arguments));
        assert!(said.contains(expected), "{said}");
    }
}
