//! A Slurm cluster of two nodes on this machine, for as long as a test holds it.

use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::super::program::own_mounts;
use super::super::until::until_blocking;

/// A running cluster, ended with this.
pub(super) struct Cluster {
    child: Child,
    /// Where its daemons keep what is theirs.
    own: tempfile::TempDir,
    /// The folder that a user of it works in, which has `deploy` and a disk that is soon full, `small`.
    pub(super) home: tempfile::TempDir,
}

impl Drop for Cluster {
    fn drop(&mut self) {
        // What stands in it reads until there is nothing more, so that it is ended also where this test is killed.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

impl Cluster {
    /// Starts it, with a user who works in this folder; where asked for, with a file system of 1 MiB at `small` there.
    pub(super) fn start(home: tempfile::TempDir, small: bool) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        std::os::unix::fs::symlink(root.join("deploy"), home.path().join("deploy")).unwrap();
        let own = tempfile::tempdir().unwrap();
        let script = root.join("tests/slurm/cluster.sh");
        let mut command = if small { own_mounts() } else { Command::new("/usr/bin/env") };
        command.arg("bash").arg(script).arg(own.path()).args(["sh", "-c", "echo up && exec cat"]);
        command.env("PATH", path()).current_dir(home.path());
        if small {
            command.env("FULL", home.path().join("small"));
        }
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let cluster = Self { child, own, home };
        assert_eq!(line, "up\n", "the cluster did not come up");
        cluster
    }

    /// A command of a user, in whose environment nothing is but where programs are.
    pub(super) fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env_clear().env("PATH", path()).env("SLURM_CONF", self.own.path().join("slurm.conf"));
        command.current_dir(self.home.path());
        command
    }

    /// What a line of a shell says, which has to end well.
    pub(super) fn shell(&self, line: &str) -> String {
        let output = self.command("bash").args(["-euc", line]).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{line}: {error}");
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }

    /// Slurm's word for a task's or job's state, such as RUNNING.
    pub(super) fn state(&self, job: &str) -> String {
        self.shell(&format!("squeue --noheader --states=all --jobs={job} --format=%T"))
    }

    /// Waits for a job, or every task of one, to come to an end, for as long as anything moves, and says how each ended.
    pub(super) fn ended(&self, job: &str) -> Vec<String> {
        loop {
            let before = self.moved(job);
            let now = until_blocking(&format!("job {job} goes on"), || {
                let now = self.moved(job);
                if now != before || has_ended(&now.0) { Ok(now) } else { Err(now.0.join(" ")) }
            });
            if has_ended(&now.0) {
                return now.0;
            }
        }
    }

    /// What changes while a job is worked on: its tasks' states, and how much there is of the parts.
    fn moved(&self, job: &str) -> (Vec<String>, u64) {
        let parts = fs::read_dir(self.home.path().join("study/parts")).into_iter().flatten().flatten();
        let lengths = parts.filter_map(|file| file.metadata().ok()).map(|file| file.len());
        (self.state(job).lines().map(str::to_owned).collect(), lengths.sum())
    }

    /// What a task of an array has said.
    pub(super) fn log(&self, array: &str, task: u64) -> String {
        let path = self.home.path().join(format!("plenalign-study-parts-{array}_{task}.log"));
        fs::read_to_string(&path).unwrap_or_default()
    }

    /// Sends the program that works on a task a signal.
    pub(super) fn signal(&self, array: &str, task: u64, signal: Signal) {
        let wanted = [format!("SLURM_ARRAY_JOB_ID={array}"), format!("SLURM_ARRAY_TASK_ID={task}")];
        let mut found = 0;
        for process in self.processes() {
            let program = fs::read_link(process.join("exe")).unwrap_or_default();
            let environment = fs::read(process.join("environ")).unwrap_or_default();
            let has =
                |variable: &String| environment.split(|byte| *byte == 0).any(|other| other == variable.as_bytes());
            if program.ends_with("plenalign") && wanted.iter().all(has) {
                send(&process, signal);
                found += 1;
            }
        }
        assert_eq!(found, 1, "the program of task {task} of {array}");
    }

    /// Takes a node down as a power cut does: its daemon, and all that it has started.
    pub(super) fn cut(&self, node: &str) {
        let name = format!("SLURMD_NODENAME={node}");
        // The daemon first, which would report the end of a task.
        let pid = fs::read_to_string(self.own.path().join(format!("{node}.pid"))).unwrap();
        send(&Path::new("/proc").join(pid.trim()), Signal::SIGKILL);
        let mut tasks = 0;
        for process in self.processes() {
            let command = fs::read(process.join("cmdline")).unwrap_or_default();
            let environment = fs::read(process.join("environ")).unwrap_or_default();
            let of_node = environment.split(|byte| *byte == 0).any(|variable| variable == name.as_bytes());
            let keeper = command.starts_with(b"slurmstepd") && self.keeps(&process, node);
            if of_node || keeper {
                send(&process, Signal::SIGKILL);
                tasks += usize::from(of_node);
            }
        }
        assert!(tasks > 0, "nothing was running on {node}");
    }

    /// Whether a task's keeper is one of this node: its log is the node's.
    fn keeps(&self, process: &Path, node: &str) -> bool {
        let log = self.own.path().join(format!("{node}.log"));
        let files = fs::read_dir(process.join("fd")).into_iter().flatten().flatten();
        files.into_iter().any(|file| fs::read_link(file.path()).is_ok_and(|path| path == log))
    }

    /// The processes of this cluster, in whose environment its configuration is.
    fn processes(&self) -> Vec<PathBuf> {
        let own = format!("SLURM_CONF={}", self.own.path().join("slurm.conf").display());
        let is_own = |process: &PathBuf| {
            let environment = fs::read(process.join("environ")).unwrap_or_default();
            environment.split(|byte| *byte == 0).any(|variable| variable == own.as_bytes())
        };
        fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().path()).filter(is_own).collect()
    }
}

/// Whether none of these states is one of a job that goes on.
fn has_ended(states: &[String]) -> bool {
    let go_on = ["PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "REQUEUED", "SUSPENDED"];
    !states.iter().any(|state| go_on.contains(&state.as_str()))
}

/// Where a node finds the program, and Slurm's.
fn path() -> String {
    let program = Path::new(env!("CARGO_BIN_EXE_plenalign")).parent().unwrap();
    format!("{}:/usr/bin:/bin:/usr/sbin", program.display())
}

/// Sends a process a signal, by its folder in /proc.
fn send(process: &Path, signal: Signal) {
    let pid = process.file_name().unwrap().to_str().unwrap().parse().unwrap();
    // One that ended meanwhile needs none.
    let _ = kill(Pid::from_raw(pid), signal);
}
