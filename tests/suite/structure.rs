//! The structure that the crate's documentation promises, read from the sources.

use std::fs;
use std::path::{Path, PathBuf};

/// Where the crates are.
const CRATES: [&str; 2] = [".", "crates/plenoptics"];

/// Every source file with its path below its crate's `src`.
fn sources() -> Vec<(PathBuf, String)> {
    fn collect(folder: &Path, files: &mut Vec<(PathBuf, String)>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(&path, files);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                files.push((path, text));
            }
        }
    }
    let mut all = Vec::new();
    for root in CRATES.map(|of| Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("src")) {
        let mut files = Vec::new();
        collect(&root, &mut files);
        assert!(files.len() > 30, "the sources were not found");
        all.extend(files.into_iter().map(|(path, text)| (path.strip_prefix(&root).unwrap().to_owned(), text)));
    }
    all
}

/// Modules that the module in the first place may name.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("state_folder", &[]),
    ("store", &["state_folder"]),
    ("record", &["raw"]),
    ("telemetry", &[]),
    ("raw", &[]),
    ("optics", &["units"]),
    ("imaging", &["optics", "units", "raw"]),
    ("access", &["state_folder"]),
    ("config", &["optics", "units", "raw", "access"]),
    ("device", &["optics", "units", "raw", "config", "telemetry", "whole", "record"]),
    ("sim", &["optics", "units", "raw", "config", "device"]),
    (
        "control",
        &[
            "optics",
            "units",
            "raw",
            "config",
            "device",
            "imaging",
            "sim",
            "store",
            "record",
            "access",
            "telemetry",
            "whole",
        ],
    ),
    ("study", &["optics", "units", "raw", "config", "imaging", "sim", "control", "text"]),
    ("text", &[]),
    ("whole", &[]),
    (
        "api",
        &[
            "text",
            "whole",
            "optics",
            "units",
            "raw",
            "config",
            "device",
            "imaging",
            "store",
            "state_folder",
            "control",
            "record",
            "access",
            "telemetry",
        ],
    ),
    ("alpaca", &["units", "raw", "config", "device", "control", "access", "api"]),
    ("fleet", &["config", "control", "device", "telemetry"]),
    (
        "cli",
        &[
            "alpaca",
            "fleet",
            "study",
            "optics",
            "units",
            "raw",
            "config",
            "device",
            "imaging",
            "store",
            "state_folder",
            "control",
            "sim",
            "api",
            "access",
            "telemetry",
        ],
    ),
];

#[test]
fn modules_call_downwards_only() {
    let mut wrong = Vec::new();
    for (path, text) in sources() {
        let module = path.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned();
        if module == "lib" || module == "main" {
            continue;
        }
        let Some((_, allowed)) = MAY_USE.iter().find(|(name, _)| *name == module) else {
            panic!("{} belongs to no module that this test knows", path.display());
        };
        for (number, line) in text.lines().enumerate() {
            for part in line.split("crate::").skip(1) {
                let named: String = part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let known = MAY_USE.iter().any(|(name, _)| *name == named);
                if known && named != module && !allowed.contains(&named.as_str()) {
                    wrong.push(format!("{}:{}: {module} names {named}", path.display(), number + 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn optics_and_imaging_are_pure() {
    for (path, text) in sources() {
        if !(path.starts_with("optics") || path.starts_with("imaging")) {
            continue;
        }
        for forbidden in ["std::fs", "std::io", "std::time", "tokio", "tracing", "async fn", "SystemTime", "Instant"] {
            assert!(!text.contains(forbidden), "{} names {forbidden}", path.display());
        }
    }
}

/// Every place that lifts the ban on unsafe code (for what is below it, too), each with its reason in the comment above it.
const UNSAFE_EXCEPTIONS: &[&str] = &["api/jpeg/turbo.rs", "device/camera/kernel/mod.rs"];

#[test]
fn unsafe_code_is_listed() {
    let found: Vec<String> = sources()
        .iter()
        .filter(|(_, text)| text.contains("allow(unsafe_code)") || text.contains("expect(unsafe_code)"))
        .map(|(path, _)| path.display().to_string())
        .collect();
    assert_eq!(found, UNSAFE_EXCEPTIONS);
}

#[test]
fn only_control_commands_motion() {
    for (path, text) in sources() {
        let may = path.starts_with("control") || path.starts_with("device") || path.starts_with("sim");
        if !may {
            assert!(!text.contains(".move_to("), "{} commands motion past the rules", path.display());
        }
    }
}
