//! Who may read what the program keeps: every file of the state folder, under the widest umask there is.

use std::fs::{self, Permissions};
use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use plenalign::api::error::LEASE_HEADER;
use reqwest::Client;
use serde_json::{Value, json};

use super::daemon::client;
use super::program::{Program, plenalign};
use super::until::until;

/// What nobody but its owner may read, below the state folder.
const SECRET: [&str; 9] = [
    "history.db",
    "history.db-wal",
    "history.db-shm",
    "tokens.json",
    "tokens.lock",
    "bench-simulated.lock",
    "tls/ca.key",
    "tls/server.key",
    "login-url",
];

/// A command under a umask that takes nothing away.
fn under_no_umask(command: &Command) -> Command {
    let mut under = Command::new("sh");
    under.args(["-c", "umask 000; exec \"$0\" \"$@\""]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => under.env(name, value),
            None => under.env_remove(name),
        };
    }
    under
}

fn run(state: &Path, arguments: &[&str]) -> String {
    let done = under_no_umask(plenalign(state).args(arguments)).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).unwrap()
}

/// `plenalign serve` on the simulated bench; its configuration lies beside the state folder.
fn serve(state: &Path, arguments: &[&str]) -> Program {
    let config = state.with_file_name("bench.toml");
    fs::write(&config, "[bench.simulation]\nrays = 4\n").unwrap();
    let mut command = plenalign(state);
    command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"]).arg(config).args(arguments);
    Program::start(under_no_umask(&command))
}

/// Everything below a folder with its permissions, the folder itself first.
fn modes(folder: &Path) -> Vec<(PathBuf, u32)> {
    // A file that is being written has another name for a moment.
    let Ok(found) = fs::symlink_metadata(folder) else { return Vec::new() };
    let mut all = vec![(folder.to_owned(), found.permissions().mode() & 0o7777)];
    if found.is_dir() {
        for entry in fs::read_dir(folder).unwrap() {
            all.extend(modes(&entry.unwrap().path()));
        }
    }
    all
}

/// Nobody outside the group reads anything, and the secrets are there, their owner's alone.
fn nobody_else_reads(state: &Path, secrets: &[&str]) {
    for (path, mode) in modes(state) {
        assert_eq!(mode & 0o007, 0, "{} is {mode:o}", path.display());
    }
    for secret in secrets {
        let mode = fs::metadata(state.join(secret)).unwrap_or_else(|error| panic!("{secret}: {error}")).permissions();
        assert_eq!(mode.mode() & 0o777, 0o600, "{secret}");
    }
}

/// A person with a token.
struct Person {
    client: Client,
    url: String,
    token: String,
}

impl Person {
    async fn post(&self, path: &str, key: Option<&str>, body: &Value) -> reqwest::Response {
        let mut request = self.client.post(format!("{}{path}", self.url)).bearer_auth(&self.token).json(body);
        if let Some(key) = key {
            request = request.header(LEASE_HEADER, key);
        }
        let response = request.send().await.unwrap();
        assert!(response.status().is_success(), "{path}: {}", response.status());
        response
    }

    async fn ask(&self, path: &str, body: &Value) -> Value {
        self.post(path, None, body).await.json().await.unwrap()
    }
}

#[tokio::test]
async fn nobody_else_reads_what_the_program_keeps() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("made/state");
    let login = folder.path().join("other/state");
    fs::create_dir(folder.path().join("other")).unwrap();
    fs::create_dir(folder.path().join("made")).unwrap();
    run(&state, &["tls", "init"]);
    let token = run(&state, &["token", "create", "--name", "Root", "--scope", "admin"]).trim().to_owned();
    let program = serve(&state, &[]);
    let root = Person { client: client(), url: program.url().to_owned(), token };
    let lease = root.ask("/api/v1/lease", &json!({ "owner": "Root" })).await;
    let job = json!({ "kind": "joint_alignment", "record": true });
    root.post("/api/v1/jobs", lease["key"].as_str(), &job).await;
    // Its file is begun on a thread of its own.
    until("a recording has begun", async || modes(&state.join("recordings")).len() >= 2).await;
    nobody_else_reads(&state, &SECRET[..8]);
    assert_eq!(fs::metadata(&state).unwrap().permissions().mode() & 0o777, 0o700);
    program.kill();

    // The link that opens the page once.
    let program = serve(&login, &["--set", "server.auth=required"]);
    // It is made once the daemon has said where it serves.
    until("there is a link", async || login.join("login-url").exists()).await;
    nobody_else_reads(&login, &["login-url", "history.db", "bench-simulated.lock"]);
    program.kill();
}

#[tokio::test]
async fn a_state_folder_that_others_could_read_is_mended_at_the_start_and_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    run(&state, &["tls", "init"]);
    run(&state, &["token", "create", "--name", "Root", "--scope", "admin"]);
    serve(&state, &[]).kill();
    fs::create_dir_all(state.join("recordings")).unwrap();
    fs::write(state.join("recordings/old.mcap"), "old").unwrap();
    fs::write(state.join("login-url"), "old").unwrap();
    // A link out of the folder is nothing of the folder's.
    let elsewhere = folder.path().join("elsewhere");
    fs::write(&elsewhere, "not ours").unwrap();
    fs::set_permissions(&elsewhere, Permissions::from_mode(0o644)).unwrap();
    std::os::unix::fs::symlink(&elsewhere, state.join("link")).unwrap();
    for (path, _) in modes(&state) {
        if !path.is_symlink() {
            let mode = if path.is_dir() { 0o755 } else { 0o644 };
            fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
        }
    }
    let program = serve(&state, &[]);
    let (found, there) = (modes(&state), fs::metadata(&elsewhere).unwrap().permissions().mode() & 0o777);
    program.terminate();
    let (_, _, log) = program.end(Duration::from_secs(10));
    for (path, mode) in found.iter().filter(|(path, _)| !path.ends_with("link")) {
        assert_eq!(mode & 0o007, 0, "{} is {mode:o}", path.display());
        let name = path.strip_prefix(&state).unwrap().to_str().unwrap();
        assert!(!SECRET.contains(&name) || mode & 0o777 == 0o600, "{name} is {mode:o}");
    }
    assert_eq!(there, 0o644);
    for secret in SECRET.iter().filter(|name| !name.ends_with("-wal") && !name.ends_with("-shm")) {
        let path = state.join(secret).display().to_string();
        assert!(log.lines().any(|line| line.contains("WARN") && line.contains(&path)), "{secret} is not in: {log}");
    }
}

/// What a token, a session, a ticket, a link and a lease are opened with.
#[tokio::test]
async fn no_secret_is_in_the_history_nor_in_a_file_that_others_read_nor_in_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    fs::DirBuilder::new().mode(0o750).create(&state).unwrap();
    let token = run(&state, &["token", "create", "--name", "Root", "--scope", "admin"]).trim().to_owned();
    let program = serve(&state, &[]);
    let root = Person { client: client(), url: program.url().to_owned(), token };
    let made = root.ask("/api/v1/tokens", &json!({ "name": "Ada", "scope": "control" })).await;
    let signed_in = root.post("/api/v1/session", None, &json!({ "key": made["secret"] })).await;
    let cookie = signed_in.headers()["set-cookie"].to_str().unwrap().split([';', '=']).nth(1).unwrap().to_owned();
    let ticket = root.ask("/api/v1/tickets", &json!({ "path": "/api/v1/snapshot.jpg" })).await;
    let lease = root.ask("/api/v1/lease", &json!({ "owner": "Root" })).await;
    let job = json!({ "kind": "joint_alignment", "record": true });
    root.post("/api/v1/jobs", lease["key"].as_str(), &job).await;
    root.post("/api/v1/stop", None, &Value::Null).await;
    let text = |value: &Value| value.as_str().unwrap_or_else(|| panic!("{value}")).to_owned();
    let bare = |secret: &str| secret.trim_start_matches("plenalign_").to_owned();
    let of_lease = text(&lease["key"]);
    let secrets = [bare(&root.token), bare(&text(&made["secret"])), cookie, text(&ticket["ticket"]), of_lease];
    program.terminate();
    let (_, _, log) = program.end(Duration::from_secs(10));
    let holds = |bytes: &[u8], secret: &str| bytes.windows(secret.len()).any(|part| part == secret.as_bytes());
    let mut looked_into = 0;
    for (path, _) in modes(&state).into_iter().filter(|(path, _)| path.is_file()) {
        let bytes = fs::read(&path).unwrap();
        looked_into += 1;
        // Session, tokens and lease are kept as hashes.
        for secret in &secrets {
            assert!(!holds(&bytes, secret), "{} holds a secret", path.display());
        }
    }
    assert!(looked_into >= 4, "{looked_into} files only");
    for secret in &secrets {
        assert!(!log.contains(secret), "{log}");
    }
}

/// While the state folder cannot be used, the lock is among the temporary files, where anybody can put a file of a
/// known name: a link to the daemon's own, for one, which it would write its number into.
#[test]
fn a_lock_among_temporary_files_is_in_a_folder_of_ones_own() {
    let folder = tempfile::tempdir().unwrap();
    let (state, temporary) = (folder.path().join("state"), folder.path().join("tmp"));
    fs::write(&state, "in the way").unwrap();
    fs::create_dir(&temporary).unwrap();
    fs::set_permissions(&temporary, Permissions::from_mode(0o1777)).unwrap();
    let victim = folder.path().join("victim");
    fs::write(&victim, "mine").unwrap();
    std::os::unix::fs::symlink(&victim, temporary.join("bench-simulated.lock")).unwrap();
    let config = folder.path().join("bench.toml");
    fs::write(&config, "[bench.simulation]\nrays = 4\n").unwrap();
    let start = || {
        let mut command = plenalign(&state);
        command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"]).arg(&config);
        command.env("TMPDIR", &temporary).env_remove("XDG_RUNTIME_DIR");
        under_no_umask(&command)
    };
    let program = Program::start(start());
    assert_eq!(fs::read_to_string(&victim).unwrap(), "mine");
    let (lock, mode) = modes(&temporary)
        .into_iter()
        .find(|(path, _)| path.ends_with("bench-simulated.lock") && !path.is_symlink())
        .expect("there is a lock");
    assert_eq!((mode, fs::metadata(lock.parent().unwrap()).unwrap().permissions().mode() & 0o777), (0o600, 0o700));
    // It still keeps a second daemon away.
    let (status, _, log) = Program::spawn(start()).end(Duration::from_secs(20));
    assert!(!status.success() && log.contains("another process drives this bench"), "{log}");
    let own = lock.parent().unwrap().to_owned();
    program.kill();
    // A folder that somebody else could write is not one's own.
    fs::set_permissions(&own, Permissions::from_mode(0o777)).unwrap();
    let (status, _, log) = Program::spawn(start()).end(Duration::from_secs(20));
    assert!(!status.success() && log.contains(&own.display().to_string()), "{log}");
}
