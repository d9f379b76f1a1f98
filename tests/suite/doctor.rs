//! `plenalign doctor` as people run it: what it finds, what it says to type, and how it ends.

use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::config::CAMERA;
use super::program::{Program, own_mounts, plenalign, serve};

/// A port of loopback that nobody has: the system gives another one each time.
const ANY: &str = "127.0.0.1:0";

fn doctor(state: &Path, before: &[&str], arguments: &[&str]) -> Output {
    let mut command = plenalign(state);
    command.env("RUST_LOG", "warn").args(before).arg("doctor").args(arguments);
    command.output().unwrap()
}

/// The findings, with the exit code that they should lead to.
fn found(output: &Output, code: i32) -> Vec<Value> {
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{text}\n{errors}");
    assert!(!errors.contains("plenalign: "), "{errors}");
    let report: Value = serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
    let findings = report["findings"].as_array().unwrap().clone();
    let problems = findings.iter().filter(|finding| finding["level"] == "problem").count();
    assert_eq!(report["problems"], problems, "{text}");
    assert_eq!(problems > 0, code == 1, "{text}");
    for finding in &findings {
        let wrong = finding["level"] == "problem" || finding["level"] == "warning";
        assert!(!wrong || finding["mend"].as_str().is_some_and(|mend| !mend.is_empty()), "{finding}");
        assert!(finding["what"].is_string() && finding["detail"].is_string(), "{finding}");
    }
    findings
}

/// The same for a daemon's address, once its bench is ready.
fn found_ready(state: &Path, listen: &str) -> Vec<Value> {
    let from = Instant::now();
    loop {
        let output = doctor(state, &[], &["--json", "--listen", listen]);
        if output.status.success() || from.elapsed() > Duration::from_secs(30) {
            return found(&output, 0);
        }
    }
}

/// The first finding of a kind.
fn one<'a>(findings: &'a [Value], id: &str) -> &'a Value {
    findings.iter().find(|finding| finding["id"] == id).unwrap_or_else(|| panic!("no {id}: {findings:#?}"))
}

/// A finding of a kind, its level, and a part of what it says.
fn says(findings: &[Value], id: &str, level: &str, part: &str) {
    let finding = one(findings, id);
    let detail = finding["detail"].as_str().unwrap();
    assert!(finding["level"] == level && detail.contains(part), "{part}: {finding}");
}

fn hardware(state: &Path, driver: &str, port: &str) -> String {
    let file = state.join("hardware.toml");
    let names = match driver {
        "grbl" => ["X", "Y"],
        "tmcl" => ["0", "1"],
        _ => ["1", "2"],
    };
    let text = format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"{driver}\"\nport = {port:?}\n\
         [bench.focus]\naxis = \"{}\"\n[bench.e]\naxis = \"{}\"\n[bench.camera]\ndevice = \"card:nobody has this\"\n",
        names[0], names[1]
    );
    std::fs::write(&file, text).unwrap();
    file.display().to_string()
}

#[test]
fn nothing_keeps_the_preset_from_working_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let findings = found(&doctor(folder.path(), &[], &["--json", "--listen", ANY]), 0);
    says(&findings, "configuration.file", "note", "reference preset");
    says(&findings, "bench.driver", "note", "SIMULATED");
    says(&findings, "bench.lock", "ok", "no process has it");
    says(&findings, "state.folder", "ok", &folder.path().display().to_string());
    says(&findings, "state.history", "ok", "none yet");
    says(&findings, "state.tokens", "ok", "0 tokens");
    says(&findings, "server.port", "ok", "free");
    says(&findings, "server.access", "note", "only this machine");
    one(&findings, "clock.synchronised");
    assert!(one(&findings, "program.version")["what"].as_str().unwrap().ends_with(env!("CARGO_PKG_VERSION")));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "it has written something");

    let output = doctor(folder.path(), &[], &["--listen", ANY]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.starts_with("ok       plenalign "), "{text}");
    assert!(text.lines().any(|line| line.starts_with("note     bench ") && line.contains("SIMULATED")), "{text}");
    let usage = doctor(folder.path(), &[], &["--no-such-option"]);
    assert_eq!(usage.status.code(), Some(2));
}

#[test]
fn a_broken_configuration_is_a_finding_among_others() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bench.toml");
    let named = file.display().to_string();
    let run = |set: &[&str]| {
        let before: Vec<&str> = [&["--config", named.as_str()][..], set].concat();
        found(&doctor(folder.path(), &before, &["--json", "--listen", ANY]), 1)
    };
    says(&run(&[]), "configuration.file", "problem", "is not there");
    std::fs::write(&file, "[shell\n").unwrap();
    let findings = run(&[]);
    says(&findings, "configuration.syntax", "problem", "line 1");
    assert!(one(&findings, "configuration.syntax")["mend"].as_str().unwrap().ends_with(&format!("+1 {named}")));
    // All else is looked at.
    says(&findings, "state.folder", "ok", "can be written");
    std::fs::write(&file, "[shell]\ninner_radius_mm = 70\n\n[mla]\npitch_mm = 0\n[bench]\ndriver = \"hardware\"\n")
        .unwrap();
    let findings = run(&[]);
    let keys: Vec<&str> = findings
        .iter()
        .filter(|one| one["id"] == "configuration.key")
        .map(|one| one["what"].as_str().unwrap())
        .collect();
    for key in
        ["shell.inner_radius_mm", "mla.pitch_mm", "bench.focus.controller", "bench.e.controller", "sensor.width_px"]
    {
        assert!(keys.contains(&key), "{key}: {keys:?}");
    }
    std::fs::write(&file, "").unwrap();
    says(&run(&["--set", "nonsense"]), "configuration.set", "problem", "KEY=VALUE");
    says(&run(&["--set", "shell.inner_radius_mm=70"]), "configuration.set", "problem", "inner_radius_mm");
}

#[test]
fn a_port_and_a_camera_that_are_not_there_are_problems() {
    let folder = tempfile::tempdir().unwrap();
    let file = hardware(folder.path(), "grbl", "/dev/serial/by-id/no-such-port");
    let findings = found(&doctor(folder.path(), &["--config", &file], &["--json", "--listen", ANY]), 1);
    says(&findings, "stages.port", "problem", "there is no /dev/serial/by-id/no-such-port");
    says(&findings, "camera.device", "problem", "card:nobody has this");
    let file = hardware(folder.path(), "grbl", "usb:nobody-has-this");
    let findings = found(&doctor(folder.path(), &["--config", &file], &["--json", "--listen", ANY]), 1);
    says(&findings, "stages.port", "problem", "nobody-has-this");
    let plain = folder.path().join("plain");
    std::fs::write(&plain, "").unwrap();
    let file = hardware(folder.path(), "grbl", &plain.display().to_string());
    let findings = found(&doctor(folder.path(), &["--config", &file], &["--json", "--listen", ANY]), 1);
    says(&findings, "stages.port", "problem", "is no device");
}

#[test]
fn controllers_are_asked_only_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = [
        ("grbl", "Grbl 1.1"),
        ("zaber", "Zaber device"),
        ("pi", "Physik"),
        ("tmcl", "TMCM-"),
        ("thorlabs", "Thorlabs BSC203"),
    ];
    for (driver, identity) in kinds {
        let (link, record) = (folder.path().join(driver), folder.path().join(format!("{driver}.record")));
        let mut command = plenalign(folder.path());
        command.args(["sim-stage", "--json", "--protocol", driver, "--link"]).arg(&link).arg("--record").arg(&record);
        let _twin = Program::start(command);
        let moved = || std::fs::read_to_string(&record).unwrap();
        let before = moved();
        let file = hardware(folder.path(), driver, &link.display().to_string());
        let run = |arguments: &[&str]| {
            let arguments = [&["--json", "--listen", ANY][..], arguments].concat();
            // The camera is missing.
            found(&doctor(folder.path(), &["--config", &file], &arguments), 1)
        };
        let findings = run(&[]);
        says(&findings, "stages.port", "ok", driver);
        assert!(!findings.iter().any(|finding| finding["id"] == "stages.identity"), "{findings:#?}");
        let findings = run(&["--identify"]);
        says(&findings, "stages.identity", "ok", identity);
        assert_eq!(moved(), before, "{driver}: an axis has moved");
    }
}

#[test]
fn a_state_folder_that_cannot_be_written_is_a_problem() {
    let folder = tempfile::tempdir().unwrap();
    // In a mount namespace, so that nothing of this machine changes: who runs the test may be root, who may write what
    // its permissions forbid.
    let mut command = own_mounts();
    let mounts = "mount --bind \"$0\" \"$0\"; mount -o remount,ro,bind \"$0\"; exec \"$@\"";
    command.args(["sh", "-ec", mounts]).arg(folder.path());
    command.arg(env!("CARGO_BIN_EXE_plenalign")).args(["doctor", "--json", "--listen", ANY]);
    let output = command.env("PLENALIGN_STATE_DIR", folder.path()).env("RUST_LOG", "warn").output().unwrap();
    let findings = found(&output, 1);
    says(&findings, "state.folder", "problem", "read-only");
    assert!(one(&findings, "state.folder")["mend"].as_str().unwrap().contains("remount,rw"));

    let file = folder.path().join("file");
    std::fs::write(&file, "no folder").unwrap();
    let findings = found(&doctor(&file, &[], &["--json", "--listen", ANY]), 1);
    says(&findings, "state.folder", "problem", "is no folder");
    let findings = found(&doctor(&file.join("state"), &[], &["--json", "--listen", ANY]), 1);
    says(&findings, "state.folder", "problem", "is no folder");
    // What is no database.
    let state = folder.path().join("state");
    std::fs::create_dir(&state).unwrap();
    std::fs::write(state.join("history.db"), "no database, and long enough to be one. ".repeat(20)).unwrap();
    std::fs::write(state.join("tokens.json"), "{").unwrap();
    let findings = found(&doctor(&state, &[], &["--json", "--listen", ANY]), 1);
    says(&findings, "state.history", "problem", "not a database");
    says(&findings, "state.tokens", "problem", "tokens.json");
}

#[test]
fn a_daemon_that_runs_is_told_from_a_bench_that_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let program = Program::start(serve(folder.path(), &[]));
    let run = |listen: &str, code| found(&doctor(folder.path(), &[], &["--json", "--listen", listen]), code);
    // At its own address.
    let findings = found_ready(folder.path(), program.address());
    let pid = format!("pid {} ", program.id());
    says(&findings, "bench.lock", "ok", &pid);
    says(&findings, "server.port", "ok", "answers");
    says(&findings, "server.ready", "ok", "SIMULATED");
    says(&findings, "state.history", "ok", "tables of version");
    // Where no daemon serves, another process has the bench.
    let findings = run(ANY, 1);
    says(&findings, "bench.lock", "problem", &pid);
    assert!(one(&findings, "bench.lock")["mend"].as_str().unwrap().starts_with(&format!("kill {}", program.id())));
    program.terminate();
    let (status, _, log) = program.end(Duration::from_secs(5));
    assert!(status.success(), "{log}");
    says(&run(ANY, 0), "bench.lock", "ok", "no process");
    // What listens is no daemon.
    let listener = std::net::TcpListener::bind(ANY).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || while listener.accept().is_ok() {});
    let findings = run(&address, 1);
    says(&findings, "server.port", "problem", "is taken");
}

#[test]
fn beyond_loopback_a_daemon_is_known_by_its_own_authority() {
    let folder = tempfile::tempdir().unwrap();
    let run = |listen: &str, code| found(&doctor(folder.path(), &[], &["--json", "--listen", listen]), code);
    let findings = run("0.0.0.0:0", 1);
    says(&findings, "server.access", "problem", "no certificate");
    assert!(one(&findings, "server.access")["mend"].as_str().unwrap().starts_with("plenalign tls init"));
    assert!(plenalign(folder.path()).args(["tls", "init", "--json"]).output().unwrap().status.success());
    let findings = run("0.0.0.0:0", 0);
    says(&findings, "server.access", "warning", "no token yet");
    says(&findings, "server.certificate", "ok", "good until 20");
    let token = ["token", "create", "--name", "Ana", "--scope", "view", "--json"];
    assert!(plenalign(folder.path()).args(token).output().unwrap().status.success());
    let program = Program::start(serve(folder.path(), &["--listen", "0.0.0.0:0"]));
    let findings = found_ready(folder.path(), &format!("0.0.0.0:{}", program.port()));
    says(&findings, "server.port", "ok", "https://127.0.0.1:");
    says(&findings, "server.ready", "ok", "SIMULATED");
    says(&findings, "state.tokens", "ok", "1 token");
}
