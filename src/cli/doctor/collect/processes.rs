//! Processes: who has a device open, who has the bench, who is known to meddle.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::cli::doctor::facts::Process;
use crate::cli::lock::BenchLock;
use crate::config::BenchConfig;

/// Programs that are known to get hold of serial ports.
const MEDDLERS: [&str; 2] = ["ModemManager", "brltty"];
/// Longest command line that is shown, characters.
const COMMAND: usize = 80;

/// Which processes have which device files open. Of other users' processes only root sees that.
pub(super) type OpenDevices = BTreeMap<PathBuf, Vec<Process>>;

pub(super) fn open_devices() -> OpenDevices {
    let mut open = OpenDevices::new();
    let own = std::process::id();
    for pid in pids().filter(|pid| *pid != own) {
        let files = fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        let mut devices: Vec<PathBuf> = files.filter_map(|file| fs::read_link(file.path()).ok()).collect();
        devices.retain(|path| path.starts_with("/dev"));
        // Who made a pseudo-terminal keeps its far end open, too.
        if devices.iter().any(|path| path.ends_with("ptmx")) {
            devices.retain(|path| !path.starts_with("/dev/pts"));
        }
        devices.sort();
        devices.dedup();
        for device in devices {
            open.entry(device).or_default().extend(process(pid));
        }
    }
    open
}

/// The process that has the bench.
pub(super) fn bench_holder(bench: &BenchConfig) -> Option<Process> {
    let pid = BenchLock::holder(bench)?;
    let unseen = Process { pid, name: "plenalign".to_owned(), command: String::new() };
    Some(process(pid).unwrap_or(unseen))
}

/// The programs that are known to meddle, where they run.
pub(super) fn meddlers() -> Vec<Process> {
    pids().filter_map(process).filter(|process| MEDDLERS.contains(&process.name.as_str())).collect()
}

fn pids() -> impl Iterator<Item = u32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

fn process(pid: u32) -> Option<Process> {
    let folder = Path::new("/proc").join(pid.to_string());
    let name = fs::read_to_string(folder.join("comm")).ok()?.trim().to_owned();
    let command = fs::read(folder.join("cmdline")).unwrap_or_default();
    Some(Process { pid, name, command: command_line(&command) })
}

/// A command line as people write it, shortened.
fn command_line(words: &[u8]) -> String {
    let words = words.split(|byte| *byte == 0).filter(|word| !word.is_empty());
    let words: Vec<String> = words.map(|word| String::from_utf8_lossy(word).into_owned()).collect();
    let mut line = hidden(&words).join(" ");
    if line.chars().count() > COMMAND {
        line = line.chars().take(COMMAND - 1).collect();
        line.push('…');
    }
    line
}

/// The words without a token among them: reports are passed around.
fn hidden(words: &[String]) -> Vec<String> {
    let mut after_token = false;
    let shown = words.iter().map(|word| {
        let hide = std::mem::replace(&mut after_token, word == "--token");
        match word.split_once('=') {
            _ if hide => "…".to_owned(),
            Some(("--token", _)) => "--token=…".to_owned(),
            _ => word.clone(),
        }
    });
    shown.collect()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::os::unix::process::CommandExt as _;

    use super::*;

    #[test]
    fn command_lines_are_shown_without_secrets_and_not_too_long() {
        assert_eq!(
            command_line(b"plenalign\0serve\0--listen\x00127.0.0.1:0\0"),
            "plenalign serve --listen 127.0.0.1:0"
        );
        assert_eq!(command_line(b"plenalign\0stop\0--token\0plenalign_secret\0-v\0"), "plenalign stop --token … -v");
        assert_eq!(command_line(b"plenalign\0stop\0--token=plenalign_secret\0"), "plenalign stop --token=…");
        assert_eq!(command_line(&[b'x'; 500]).chars().count(), COMMAND);
    }

    #[test]
    fn a_process_that_has_a_device_open_is_found() {
        let null = File::open("/dev/null").unwrap();
        let mut child = std::process::Command::new("sleep").arg0("a holder").arg("60").stdin(null).spawn().unwrap();
        // A program that is being started has a name before it has a command line.
        let command_line = Path::new("/proc").join(child.id().to_string()).join("cmdline");
        while fs::read(&command_line).unwrap().is_empty() {
            std::thread::yield_now();
        }
        let open = open_devices();
        let holders = open.get(Path::new("/dev/null")).cloned().unwrap_or_default();
        child.kill().unwrap();
        child.wait().unwrap();
        let found = holders.iter().find(|process| process.pid == child.id()).expect("the child is found");
        assert_eq!((found.name.as_str(), found.command.as_str()), ("sleep", "a holder 60"));
    }
}
