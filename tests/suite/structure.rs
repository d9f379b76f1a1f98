//! The structure that the crate's documentation promises, read from the sources.
//!
//! What is in a crate below another cannot name what is above it; within a crate, only this test keeps it from that.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Where the crates are, and the folder that their modules are taken to be in: `control` is a crate as a whole.
const CRATES: [(&str, &str); 4] =
    [(".", ""), ("crates/bench", ""), ("crates/control", "control"), ("crates/plenoptics", "")];

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
    for (of, within) in CRATES {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("src");
        let mut files = Vec::new();
        collect(&root, &mut files);
        assert!(files.len() > 30, "the sources were not found");
        all.extend(
            files.into_iter().map(|(path, text)| (Path::new(within).join(path.strip_prefix(&root).unwrap()), text)),
        );
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
    // What sim takes from the crate plenoptics, and config one word of.
    ("renderer", &[]),
    ("access", &["state_folder"]),
    ("config", &["optics", "units", "raw", "access", "renderer"]),
    ("device", &["optics", "units", "raw", "config", "telemetry", "whole", "record"]),
    ("sim", &["optics", "units", "raw", "config", "device", "renderer"]),
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
    ("jpeg", &[]),
    ("whole", &[]),
    (
        "api",
        &[
            "jpeg",
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
            "jpeg",
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

/// What a line names first behind the name of a crate, alone or as one of several in braces.
fn named<'l>(line: &'l str, of: &str) -> Vec<&'l str> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let word = |text: &'l str| text.split(|c| !is_word(c)).next().unwrap_or_default();
    let mut found = Vec::new();
    for (at, root) in line.match_indices(of) {
        let before = line[..at].chars().next_back();
        let Some(rest) = line[at + root.len()..].strip_prefix("::") else { continue };
        // Part of another word, or a module of that name.
        if before.is_some_and(|c| is_word(c) || c == ':') {
            continue;
        }
        match rest.strip_prefix('{') {
            Some(several) => found.extend(several.split(',').map(|one| word(one.trim_start()))),
            None => found.push(word(rest)),
        }
    }
    found
}

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
            // What control calls `crate` is control itself, and the crate below it goes by a shorter name there.
            let own = if module == "control" { "bench" } else { "crate" };
            let numbers =
                named(line, "plenoptics").into_iter().map(|named| if named == "sim" { "renderer" } else { named });
            for named in named(line, own).into_iter().chain(numbers) {
                let known = MAY_USE.iter().any(|(name, _)| *name == named);
                if known && named != module && !allowed.contains(&named) {
                    wrong.push(format!("{}:{}: {module} names {named}", path.display(), number + 1));
                }
            }
            // By their rooms' names in the service, which are looked for above.
            for of in ["plenalign_bench", "plenalign_control"] {
                if !named(line, of).is_empty() {
                    wrong.push(format!("{}:{}: {module} names the crate {of}", path.display(), number + 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What control gives its callers by another name than its room's.
const OF_CONTROL: &[(&str, &str)] = &[
    ("Acceptance", "service"),
    ("Refusal", "refusal"),
    ("Service", "service"),
    ("ServiceError", "refusal"),
    ("Shown", "service"),
    ("StopReport", "motion"),
];

/// The rooms of control from top to bottom, those on one line together, as the map in its documentation has them.
fn rooms_of_control(map: &str) -> Vec<Vec<&str>> {
    let lines = map.lines().skip_while(|line| *line != "//! ```text").skip(1).take_while(|line| *line != "//! ```");
    lines
        .map(|line| {
            let words = line.trim_start_matches("//!").trim_start();
            words.split("  ").next().unwrap_or_default().split(", ").collect()
        })
        .collect()
}

#[test]
fn rooms_of_control_call_downwards_only() {
    let all = sources();
    let of_control = || all.iter().filter_map(|(path, text)| Some((path.strip_prefix("control").ok()?, text)));
    let (_, map) = of_control().find(|(path, _)| *path == Path::new("lib.rs")).unwrap();
    let lines = rooms_of_control(map);
    let line_of = |room: &str| lines.iter().position(|rooms| rooms.contains(&room));
    let mut wrong = Vec::new();
    for (path, text) in of_control() {
        let room = path.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs");
        // Tests begin with the whole service.
        if room == "lib" || path.file_name().is_some_and(|name| name == "tests.rs") {
            continue;
        }
        let Some(own) = line_of(room) else { panic!("{room} is not on the map in the documentation of control") };
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for (number, line) in code.lines().enumerate() {
            for word in named(line, "crate") {
                let of = OF_CONTROL.iter().find(|(name, _)| *name == word).map_or(word, |(_, room)| room);
                let below = line_of(of).is_some_and(|line| line > own);
                if of != room && !below {
                    wrong.push(format!("{}:{}: {room} names {word}", path.display(), number + 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What a reader keeps in the head.
const MOST_LINES: usize = 450;

#[test]
fn no_file_is_longer_than_a_reader_keeps_in_the_head() {
    let long = sources().into_iter().filter(|(path, text)| {
        let is_tests =
            path.file_name().is_some_and(|name| name == "tests.rs") || path.iter().any(|part| part == "tests");
        !is_tests && text.lines().count() > MOST_LINES
    });
    let long: Vec<_> = long.map(|(path, text)| format!("{}: {}", path.display(), text.lines().count())).collect();
    assert!(long.is_empty(), "{}", long.join("\n"));
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

/// What the live meter and the measurement of whole frames are both made of, and where it stands.
const ESTIMATOR: &[(&str, &str)] = &[
    ("struct Tile", "tile.rs"),
    ("fn slope<", "tile.rs"),
    ("fn spline<", "tile.rs"),
    ("enum Light", "gains.rs"),
    ("fn mask_radius", "masks.rs"),
    ("struct Pupil", "pupil.rs"),
    ("fn corrected", "pupil.rs"),
    ("fn of_pair", "smeared.rs"),
    ("struct Overlap", "compare.rs"),
    ("struct Moments", "compare.rs"),
    ("struct Order", "score.rs"),
    ("struct PairScore", "score.rs"),
    ("struct Contents", "score.rs"),
    ("struct Model", "model.rs"),
    ("struct Place ", "model.rs"),
    ("fn block", "model.rs"),
    ("struct Normal", "normal.rs"),
    ("fn check_texture", "normal.rs"),
    ("fn noise_scale", "normal.rs"),
    ("fn refined", "normal.rs"),
    ("struct Random", "random.rs"),
    ("struct Exposure", "exposure.rs"),
];

#[test]
fn there_is_one_estimator() {
    let rooms = ["imaging/matching", "imaging/spacing", "imaging/live"];
    let sources = sources();
    let within = |room: &'static str| {
        let of_room = sources.iter().filter(move |(path, _)| path.starts_with(room));
        of_room.map(|(path, text)| (path, text.split("#[cfg(test)]").next().unwrap_or_default()))
    };
    for (item, file) in ESTIMATOR {
        let found = rooms.iter().flat_map(|room| within(room)).filter(|(_, text)| text.contains(item));
        let found: Vec<String> = found.map(|(path, _)| path.display().to_string()).collect();
        assert_eq!(found, [format!("imaging/matching/{file}")], "{item}");
    }
    // Neither compares pixels or solves for the unknowns by itself; the bound is a solution of its own.
    for (path, text) in ["imaging/spacing", "imaging/live"].iter().flat_map(|room| within(room)) {
        for own in ["slope_weights(", "spline_coefficients(", ".cholesky()"] {
            let bound = path.ends_with("bound.rs") && own == ".cholesky()";
            assert!(bound || !text.contains(own), "{} has {own} of its own", path.display());
        }
    }
}

/// Every place that lifts the ban on unsafe code (for what is below it, too), each with its reason in the comment above it.
const UNSAFE_EXCEPTIONS: &[&str] = &["jpeg/turbo.rs", "device/camera/kernel/mod.rs"];

#[test]
fn unsafe_code_is_listed() {
    let found: Vec<String> = sources()
        .iter()
        .filter(|(_, text)| text.contains("allow(unsafe_code)") || text.contains("expect(unsafe_code)"))
        .map(|(path, _)| path.display().to_string())
        .collect();
    assert_eq!(found, UNSAFE_EXCEPTIONS);
}

/// Where tests wait for a time, in how many places, and why it is not a state that they wait for.
///
/// All others wait by `until` of `tests/suite/until.rs`, or its like where that is not Rust; on a paused clock they let
/// time pass by `elapse`.
const WAITS_FOR_TIME: &[(&str, &[(&str, usize)])] = &[
    (
        "the one place that waits, of a language or an environment",
        &[
            ("tests/alpaca-client/client.py", 1),
            ("tests/daemon.sh", 1),
            ("tests/genicam/twins.py", 1),
            ("tests/genicam/client.py", 1),
            ("tests/hardware/cameras.sh", 1),
            ("tests/hardware/chain.sh", 1),
            ("tests/mdns/resolver.py", 1),
            ("tests/mqtt/daemon.py", 1),
            ("tests/package/lib.sh", 1),
            ("tests/python-client/bench.py", 1),
            ("tests/suite/until.rs", 3),
            ("tests/vendor-clients/waiting.py", 1),
            ("tests/ws-clients/client.py", 1),
            ("web/e2e/until.mjs", 1),
        ],
    ),
    (
        "the clock is the test's own, where there is no `elapse`",
        &[
            ("crates/bench/src/device/camera/feed/tests.rs", 7),
            ("crates/bench/src/device/port/tests.rs", 9),
            ("crates/bench/src/telemetry.rs", 1),
            ("src/api/server/stall.rs", 1),
            ("web/test/jog.test.ts", 2),
            ("web/test/live.test.ts", 3),
            ("web/test/needle.test.ts", 1),
        ],
    ),
    (
        "a stand-in that takes its time, as what it stands for does",
        &[
            ("crates/bench/src/device/camera/genicam/bounded.rs", 1),
            ("tests/hardware/chain.sh", 1),
            ("tests/hardware/loopback.rs", 1),
            ("tests/hardware/u3v.rs", 1),
            ("tests/package/booted.sh", 1),
            ("tests/python-client/test_failures.py", 2),
            ("tests/python-client/test_lease.py", 1),
            ("tests/suite/every_poll/controller.rs", 2),
            ("tests/suite/fakes.rs", 1),
            ("tests/suite/gige.rs", 1),
            ("tests/suite/kill.rs", 1),
            ("web/e2e/harness.mjs", 1),
        ],
    ),
    ("a guest in emulation, whose one limit is that of the whole", &[("tests/hardware/chain.rs", 9)]),
    (
        "nothing is to come, and no state tells that it will not",
        &[("tests/mdns/resolver.py", 1), ("tests/mqtt/test_outages.py", 1), ("tests/vendor-clients/thorlabs.py", 1)],
    ),
    (
        "how long it lasts is what is tested or measured",
        &[("tests/vendor-clients/thorlabs.py", 1), ("web/e2e/pace.mjs", 2), ("web/e2e/speed.mjs", 5)],
    ),
    ("a limit, which is not waited for", &[("tests/foxglove/client.mjs", 1)]),
    ("the journal's marks are whole seconds", &[("tests/package/booted.sh", 1)]),
];

/// The names by which a file would wait for a time, by how its own name ends, and what comes behind them.
fn waits(file: &Path) -> (&'static [&'static str], &'static [char]) {
    match file.extension().and_then(|e| e.to_str()) {
        Some("rs") => (&["sleep", "sleep_until"], &['(']),
        Some("py") => (&["sleep"], &['(']),
        Some("mjs" | "ts") => (&["sleep", "setTimeout", "waitForTimeout"], &['(']),
        // One of another language may lie within.
        Some("sh") => (&["sleep"], &[' ', '(']),
        _ => (&[], &[]),
    }
}

/// How often a text waits by these names.
fn count_waits(text: &str, (names, behind): (&[&str], &[char])) -> usize {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let count = |name: &&str| {
        let called = |at: usize| text[at + name.len()..].starts_with(behind) && !text[..at].ends_with(is_word);
        text.match_indices(*name).filter(|(at, _)| called(*at)).count()
    };
    names.iter().map(count).sum()
}

#[test]
fn tests_wait_for_states() {
    fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if !path.is_dir() {
                files.push(path);
            } else if path.file_name().is_none_or(|name| name != "node_modules") {
                collect(&path, files);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in ["tests", "web/e2e", "web/test"] {
        collect(&root.join(folder), &mut files);
    }
    let tests = files.len();
    for (of, _) in CRATES {
        collect(&root.join(of).join("src"), &mut files);
    }
    let mut found = BTreeMap::new();
    for (index, file) in files.iter().enumerate() {
        let by = waits(file);
        if by.0.is_empty() {
            continue;
        }
        let text = fs::read_to_string(file).unwrap();
        let whole = index < tests || file.ends_with("tests.rs");
        let of_tests = if whole { &text } else { text.split_once("\nmod tests {").map_or("", |(_, tests)| tests) };
        let count = count_waits(of_tests, by);
        if count > 0 {
            found.insert(file.strip_prefix(root).unwrap().to_str().unwrap(), count);
        }
    }
    let mut listed = BTreeMap::new();
    for (file, count) in WAITS_FOR_TIME.iter().flat_map(|(_, files)| *files) {
        *listed.entry(*file).or_insert(0) += count;
    }
    let count = |of: &BTreeMap<&str, usize>, file| of.get(file).copied().unwrap_or(0);
    let files: BTreeSet<&str> = found.keys().chain(listed.keys()).copied().collect();
    let counts = files.into_iter().map(|file| (file, count(&found, file), count(&listed, file)));
    let wrong: Vec<_> = counts.filter(|(_, found, listed)| found != listed).collect();
    assert!(wrong.is_empty(), "waits for a time, as found and as listed with their reasons: {wrong:?}");
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

/// The page rewords lengths in mm to the unit that its reader has chosen, and knows no other.
#[test]
fn jobs_say_lengths_in_mm() {
    for (path, text) in sources().into_iter().filter(|(path, _)| path.starts_with("control")) {
        for line in text.lines().filter(|line| !line.trim_start().starts_with("//")) {
            assert!(!line.contains("µm"), "{}: {line}", path.display());
        }
    }
}
