//! Program, machine, clock, libraries.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use jiff::Timestamp;

use crate::cli::doctor::facts::SystemFacts;
use crate::jpeg::TurboJpeg;

/// There once the system's own client has set the clock.
const TIMESYNCD: &str = "/run/systemd/timesync/synchronized";
/// There while systemd is the service manager, whose clock service can be asked.
const SYSTEMD: &str = "/run/systemd/system";
/// There while udev runs.
const UDEV: &str = "/run/udev/control";

pub(super) fn system() -> SystemFacts {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let kernel = read("/proc/sys/kernel/osrelease").trim().to_owned();
    SystemFacts {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        system: pretty_name(&read("/etc/os-release")).unwrap_or_else(|| "an unknown system".to_owned()),
        kernel: if kernel.is_empty() { "of unknown release".to_owned() } else { kernel },
        architecture: std::env::consts::ARCH.to_owned(),
        udev: Path::new(UDEV).exists(),
        now: Timestamp::now(),
        synchronised: synchronised(),
        turbo_fault: TurboJpeg::load().err().map(|error| error.to_string()),
    }
}

/// The name by which a system wants to be called.
fn pretty_name(release: &str) -> Option<String> {
    let value = release.lines().find_map(|line| line.strip_prefix("PRETTY_NAME="))?;
    Some(value.trim_matches(['"', '\'']).to_owned()).filter(|name| !name.is_empty())
}

/// Whether something keeps the clock right; `None` where nobody can say.
fn synchronised() -> Option<bool> {
    if Path::new(TIMESYNCD).exists() {
        return Some(true);
    }
    if !Path::new(SYSTEMD).exists() {
        return None;
    }
    let mut ask = Command::new("timedatectl");
    ask.args(["show", "--property=NTPSynchronized", "--value"]).stdin(Stdio::null());
    let said = ask.output().ok().filter(|output| output.status.success())?;
    match String::from_utf8_lossy(&said.stdout).trim() {
        "yes" => Some(true),
        "no" => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_has_a_name() {
        let debian = "ID=debian\nPRETTY_NAME=\"Debian GNU/Linux 13 (trixie)\"\n";
        assert_eq!(pretty_name(debian).as_deref(), Some("Debian GNU/Linux 13 (trixie)"));
        assert_eq!(pretty_name("ID=debian\n"), None);
        let found = system();
        assert!(!found.kernel.is_empty() && found.kernel.lines().count() == 1);
    }
}
