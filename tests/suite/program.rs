//! The program as a process of its own, killed when the test lets go of it, also where the test panics.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use super::bench::QUICK_AXES;
use super::until::until_blocking;

/// The program with a state folder of the test's own, and nothing taken from the environment of whoever runs the test.
pub(crate) fn plenalign(state: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plenalign"));
    command.env("PLENALIGN_STATE_DIR", state).env_remove("PLENALIGN_TOKEN").env_remove("NOTIFY_SOCKET");
    command.env("RUST_LOG", "info").env("NO_COLOR", "1");
    command
}

/// `unshare`, for a command with mounts of its own: as root of a user namespace where this user may not have them
/// otherwise. Whoever may needs none, and within a chroot nobody gets one.
pub(crate) fn own_mounts() -> Command {
    let may = Command::new("unshare").args(["--mount", "true"]).output().unwrap().status.success();
    let mut command = Command::new("unshare");
    command.args(if may { &["--mount", "--"][..] } else { &["--map-root-user", "--mount", "--"] });
    command
}

/// `plenalign serve` on a simulated bench and a free port of loopback, whose configuration is in the state folder: what
/// the test has put there, or else a small and quick one.
pub(crate) fn serve(state: &Path, arguments: &[&str]) -> Command {
    let config = state.join("bench.toml");
    if !config.exists() {
        let small = "[sensor]\nwidth_px = 400\nheight_px = 400\n[bench.simulation]\nrays = 4\n";
        std::fs::write(&config, format!("{small}{QUICK_AXES}")).unwrap();
    }
    let mut command = plenalign(state);
    command.args(["serve", "--simulated", "--json", "--config"]).arg(config);
    if !arguments.contains(&"--listen") {
        command.args(["--listen", "127.0.0.1:0"]);
    }
    command.args(arguments);
    command
}

/// A running program.
pub(crate) struct Program {
    child: Child,
    /// What it said first, where it was waited for.
    pub(crate) said: Value,
    /// Reads what it logs, so that it never waits for that to be read.
    log: Option<JoinHandle<String>>,
    /// Held open: a program that says more must not end by it.
    stdout: Option<BufReader<ChildStdout>>,
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Program {
    /// Starts it and waits for nothing.
    pub(crate) fn spawn(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut stderr = child.stderr.take().unwrap();
        let log = std::thread::spawn(move || {
            let mut text = Vec::new();
            let _ = stderr.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        });
        let stdout = child.stdout.take().map(BufReader::new);
        Self { child, said: Value::Null, log: Some(log), stdout }
    }

    /// Starts it and waits for its first line, which is JSON.
    pub(crate) fn start(command: Command) -> Self {
        let mut program = Self::spawn(command);
        let mut line = String::new();
        program.stdout.as_mut().unwrap().read_line(&mut line).unwrap();
        match serde_json::from_str(&line) {
            Ok(said) => program.said = said,
            Err(_) => {
                let (status, _, log) = program.end(Duration::from_secs(5));
                panic!("the program did not start: {status}, {line:?}, {log}");
            }
        }
        program
    }

    /// Where a daemon serves, without a slash at the end.
    pub(crate) fn url(&self) -> &str {
        self.said["address"].as_str().expect("a daemon says where it serves").trim_end_matches('/')
    }

    /// Host and port of a daemon.
    pub(crate) fn address(&self) -> &str {
        self.url().split_once("//").unwrap().1
    }

    /// A daemon's port.
    pub(crate) fn port(&self) -> u16 {
        self.url().rsplit_once(':').unwrap().1.parse().unwrap()
    }

    /// Its process.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Asks it to end.
    pub(crate) fn terminate(&self) {
        kill(Pid::from_raw(i32::try_from(self.child.id()).unwrap()), Signal::SIGTERM).unwrap();
    }

    /// Kills it: nothing of it runs any more when this returns.
    pub(crate) fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for the end and returns how it ended, after how long, and what was logged.
    pub(crate) fn end(mut self, allowed: Duration) -> (ExitStatus, Duration, String) {
        let from = Instant::now();
        let status = until_blocking("the program ends", || {
            let ended = self.child.try_wait().unwrap();
            assert!(ended.is_some() || from.elapsed() < allowed, "the program still runs after {allowed:?}");
            ended
        });
        let took = from.elapsed();
        (status, took, self.log.take().unwrap().join().unwrap())
    }
}
