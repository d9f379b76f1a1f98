//! One device, however its port is spelled: the same bench, with the same lock, latch and lease.

use std::path::Path;
use std::time::Duration;

use reqwest::{Client, Method};
use rusqlite::Connection;
use serde_json::{Value, json};

use super::bench::{grbl_hardware, small_config};
use super::daemon::client;
use super::program::{Program, plenalign};
use super::until::{until, when};

fn write_hardware(file: &Path, port: &Path) {
    std::fs::write(file, toml::to_string(&grbl_hardware(small_config(1), port)).unwrap()).unwrap();
}

/// A twin behind a pseudo-terminal, a second name for it, and a configuration for either.
struct Rig {
    folder: tempfile::TempDir,
    twin: Program,
}

impl Rig {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("by-id");
        write_hardware(&folder.path().join("by-id.toml"), &link);
        write_hardware(&folder.path().join("tty.toml"), &folder.path().join("tty"));
        let mut command = plenalign(folder.path());
        command.args(["sim-stage", "--json", "--protocol", "grbl", "--link"]).arg(&link).arg("--config");
        command.arg(folder.path().join("by-id.toml"));
        let twin = Program::start(command);
        std::os::unix::fs::symlink(std::fs::read_link(&link).unwrap(), folder.path().join("tty")).unwrap();
        Self { folder, twin }
    }

    fn command(&self, spelling: &str) -> std::process::Command {
        let mut command = plenalign(&self.folder.path().join("state"));
        command.args(["serve", "--json", "--listen", "127.0.0.1:0", "--config"]);
        command.arg(self.folder.path().join(format!("{spelling}.toml")));
        command
    }

    fn serve(&self, spelling: &str) -> Program {
        Program::start(self.command(spelling))
    }

    fn history(&self) -> Connection {
        let file = Connection::open(self.folder.path().join("state/history.db")).unwrap();
        file.busy_timeout(Duration::from_secs(5)).unwrap();
        file
    }
}

async fn ask(client: &Client, program: &Program, method: Method, path: &str, body: Value) -> Value {
    let answer = client.request(method, format!("{}{path}", program.url())).json(&body).send().await.unwrap();
    assert!(answer.status().is_success(), "{path}: {}", answer.text().await.unwrap());
    answer.json().await.unwrap_or_default()
}

async fn bench_until(client: &Client, program: &Program, what: &str, is: impl Fn(&Value) -> bool) {
    let bench = async || ask(client, program, Method::GET, "/api/v1/bench", Value::Null).await;
    until(what, async || when(bench().await, &is)).await;
}

/// Stops it and waits until the history has that.
async fn stop(rig: &Rig, client: &Client, program: &Program) {
    ask(client, program, Method::POST, "/api/v1/stop", Value::Null).await;
    let latched = "SELECT count(*) FROM kept WHERE key = 'stop' AND value LIKE '%\"latched\":true%'";
    let count = || rig.history().query_row(latched, [], |row| row.get::<_, i64>(0)).unwrap();
    until("the latch is kept", async || count() > 0).await;
}

#[tokio::test]
async fn latch_and_lease_are_the_device_s_and_not_its_spelling_s() {
    let (rig, client) = (Rig::new(), client());
    let first = rig.serve("by-id");
    ask(&client, &first, Method::POST, "/api/v1/lease", json!({ "owner": "Ada", "ttl_s": 3600 })).await;
    stop(&rig, &client, &first).await;
    first.kill();
    let second = rig.serve("tty");
    bench_until(&client, &second, "latched", |bench| bench["stop"]["latched"] == true).await;
    bench_until(&client, &second, "held", |bench| bench["lease"]["owner"] == "Ada").await;
    second.kill();
}

#[tokio::test]
async fn a_second_daemon_on_the_same_device_is_refused_however_its_port_is_spelled() {
    let rig = Rig::new();
    let first = rig.serve("by-id");
    let (status, _, log) = Program::spawn(rig.command("tty")).end(Duration::from_secs(20));
    assert!(!status.success() && log.contains("another process drives this bench"), "{log}");
    first.kill();
    rig.serve("tty").kill();
}

/// What an older version has kept under the spelling is still found.
#[tokio::test]
async fn a_latch_kept_under_the_spelling_by_an_older_version_still_holds_until_it_is_reset() {
    let (rig, client) = (Rig::new(), client());
    let first = rig.serve("tty");
    stop(&rig, &client, &first).await;
    first.kill();
    let path = rig.folder.path().join("by-id").display().to_string();
    let older: String = path.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    rig.history().execute("DELETE FROM kept WHERE key <> 'stop' OR value LIKE '%kept_under%'", []).unwrap();
    rig.history().execute("UPDATE kept SET bench = ? WHERE key = 'stop'", [&older]).unwrap();
    rig.history().execute("UPDATE runs SET bench = ?", [&older]).unwrap();
    let second = rig.serve("by-id");
    bench_until(&client, &second, "latched", |bench| bench["stop"]["latched"] == true).await;
    second.kill();
    let third = rig.serve("tty");
    bench_until(&client, &third, "latched", |bench| bench["stop"]["latched"] == true).await;
    third.kill();
}

/// With the device away nobody can tell which it is: what is kept of it when it was there last holds, and a spelling of
/// which nothing is known begins latched where any bench is.
#[tokio::test]
async fn a_latch_is_not_lost_while_the_device_is_away() {
    let (rig, client) = (Rig::new(), client());
    let first = rig.serve("by-id");
    stop(&rig, &client, &first).await;
    first.kill();
    let Rig { twin, folder } = rig;
    twin.kill();
    let _ = std::fs::remove_file(folder.path().join("by-id"));
    let _ = std::fs::remove_file(folder.path().join("tty"));
    for spelling in ["by-id", "tty"] {
        let mut command = plenalign(&folder.path().join("state"));
        command.args(["serve", "--json", "--listen", "127.0.0.1:0", "--config"]);
        command.arg(folder.path().join(format!("{spelling}.toml")));
        let program = Program::start(command);
        bench_until(&client, &program, "latched", |bench| bench["stop"]["latched"] == true).await;
        program.kill();
    }
}
