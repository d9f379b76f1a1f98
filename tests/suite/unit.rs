//! The service manager's side: the unit file, and what the daemon tells the manager.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::{Duration, Instant};

use super::config::CAMERA;
use super::program::{Program, plenalign, serve};

#[test]
fn the_unit_restarts_the_daemon_and_stops_the_axes_after_every_end() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/plenalign.service");
    let unit = std::fs::read_to_string(path).unwrap();
    for line in ["Type=notify", "Restart=always", "StartLimitIntervalSec=0"] {
        assert!(unit.lines().any(|found| found == line), "{line}");
    }
    let after = unit.lines().find(|line| line.starts_with("ExecStopPost=")).expect("something runs after every end");
    assert!(after.ends_with(" stop-axes"), "{after}");
    assert!(unit.lines().any(|line| line.starts_with("WatchdogSec=")));
}

#[test]
fn the_unit_gives_every_connection_its_files_and_leaves_the_system_its_memory() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/plenalign.service");
    let unit = std::fs::read_to_string(path).unwrap();
    let value = |key: &str| {
        let line = unit.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        line.unwrap_or_else(|| panic!("{key} is missing")).to_owned()
    };
    // The most that server.max_connections may be, two files each, the reserve of 128, and 96 of the daemon's own.
    assert!(value("LimitNOFILE").parse::<u64>().unwrap() >= 2 * 512 + 128 + 96);
    let share: u64 = value("MemoryMax").trim_end_matches('%').parse().unwrap();
    assert!((1..100).contains(&share), "{share} %");
}

#[test]
fn the_manager_is_told_that_it_serves_that_it_lives_and_that_it_ends() {
    let folder = tempfile::tempdir().unwrap();
    let socket = UnixDatagram::bind(folder.path().join("notify")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut command = serve(folder.path(), &[]);
    command.env("NOTIFY_SOCKET", folder.path().join("notify")).env("WATCHDOG_USEC", "1500000");
    let program = Program::spawn(command);
    let hear = || {
        let mut buffer = [0; 256];
        let length = socket.recv(&mut buffer).expect("the manager hears of the daemon");
        String::from_utf8_lossy(&buffer[..length]).trim().to_owned()
    };
    assert_eq!(hear(), "READY=1");
    let from = Instant::now();
    for _ in 0..4 {
        assert_eq!(hear(), "WATCHDOG=1");
    }
    assert!(from.elapsed() < Duration::from_secs(6), "fed in time: {:?}", from.elapsed());
    program.terminate();
    while hear() != "STOPPING=1" {}
    let (status, _, log) = program.end(Duration::from_secs(5));
    assert!(status.success(), "{log}");
}

#[test]
fn stopping_the_axes_without_a_daemon_says_what_became_of_each() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| plenalign(folder.path()).args(arguments).output().unwrap();
    let simulated = run(&["stop-axes"]);
    assert!(simulated.status.success());
    assert!(String::from_utf8_lossy(&simulated.stdout).contains("SIMULATED"));

    // A twin behind a pseudo-terminal stands for the controller.
    let link = folder.path().join("grbl");
    let mut command = plenalign(folder.path());
    command.args(["sim-stage", "--json", "--protocol", "grbl", "--link"]).arg(&link);
    let twin = Program::start(command);
    let config = folder.path().join("bench.toml");
    let text = format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\nport = {:?}\n",
        link.display().to_string()
    );
    std::fs::write(&config, text).unwrap();
    let file = config.display().to_string();
    let stopped = run(&["--config", &file, "stop-axes", "--json"]);
    let said: serde_json::Value = serde_json::from_slice(&stopped.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&stopped.stderr)));
    assert_eq!(said, serde_json::json!({ "focus": "confirmed", "e": "confirmed" }));
    assert!(stopped.status.success());
    twin.kill();
    let gone = run(&["--config", &file, "stop-axes"]);
    assert!(!gone.status.success());
    assert!(String::from_utf8_lossy(&gone.stdout).contains("hardware stop"), "{gone:?}");
}
