//! `benches/table.py`: what it makes of criterion's results, here made up.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, SystemTime};

use serde_json::json;

/// A page with a place for the table.
const PAGE: &str = "# Title\n\nBefore.\n\n<!-- The table of `make bench` begins: written by benches/table.py, not by hand. \
                    -->\nold\n<!-- The table of `make bench` ends. -->\n\nAfter.\n";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A result as criterion 0.8 leaves it; a name's slash is an underscore in the path.
fn timed(folder: &Path, group: &str, function: &str, median_ms: f64) {
    let path = folder.join("criterion").join(group.replace('/', "_")).join(function.replace('/', "_"));
    for set in ["base", "new"] {
        let set = path.join(set);
        fs::create_dir_all(&set).unwrap();
        let full = format!("{group}/{function}");
        let name = json!({ "group_id": group, "function_id": function, "value_str": null, "full_id": full });
        fs::write(set.join("benchmark.json"), name.to_string()).unwrap();
        let estimate = |ns: f64| json!({ "point_estimate": ns, "standard_error": 1.0 });
        let estimates = json!({ "mean": estimate(9e9), "median": estimate(1e6 * median_ms), "slope": null });
        fs::write(set.join("estimates.json"), estimates.to_string()).unwrap();
    }
    // What differs from the run before is no result of its own.
    let change = path.join("change");
    fs::create_dir_all(&change).unwrap();
    fs::write(change.join("estimates.json"), json!({ "median": { "point_estimate": 0.1 } }).to_string()).unwrap();
}

fn table(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new("python3");
    command.arg(root().join("benches/table.py")).args(["--criterion", "criterion"]).args(arguments).arg("out/table.md");
    command.current_dir(folder).env("BENCH_MACHINE", "lab").output().unwrap()
}

fn said(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn error(output: &Output) -> String {
    assert!(!output.status.success());
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// The cells of the row that begins with a name.
fn row(table: &str, name: &str) -> Vec<String> {
    let cells = |line: &str| line.trim_matches('|').split(" | ").map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let rows: Vec<Vec<String>> = table.lines().filter(|line| line.starts_with('|')).map(cells).collect();
    rows.iter().find(|row| row[0] == name).unwrap_or_else(|| panic!("no row {name}:\n{table}")).clone()
}

#[test]
fn the_table_has_medians_targets_and_ratios() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    timed(folder, "live", "measure 4096x3072", 24.75);
    timed(folder, "live", "plain sum 4096x3072", 1.1);
    timed(folder, "live", "measure 1160x1160", 5.0);
    timed(folder, "views", "coloured depth 1160x1160", 0.000_25);
    timed(folder, "frame 1160x1160", "water, 64 rays", 1234.0);
    timed(folder, "jpeg", "libjpeg-turbo 1160x1160", 2.0);
    timed(folder, "jpeg", "jpeg-encoder 1160x1160", 5.0);
    let figures = |ours: [f64; 3], theirs: [f64; 3]| {
        let of = |[grid, spacing, error]: [f64; 3]| {
            json!({
                "grid_ms": grid, "grid_error_px": 0.01, "spacing_ms": 10.0, "spacing_error_px": 0.003,
                "live_ms": spacing, "live_error_px": error,
            })
        };
        json!({ "name": "a | b", "ours": of(ours), "theirs": of(theirs) })
    };
    let comparison = json!({
        "tools": "OpenCV, NumPy",
        "versions": ["OpenCV 5.0.0", "NumPy 2.4.6"],
        "frames": [
            figures([4.0, 2.0, 0.002], [8.0, 100.0, 0.002]),
            figures([4.0, 2.0, 0.002], [32.0, 100.0, 0.008]),
        ],
    });
    fs::write(folder.join("comparison.json"), comparison.to_string()).unwrap();
    fs::write(folder.join("page.md"), PAGE).unwrap();
    let given = ["--partial", "--comparison", "comparison.json", "--page", "page.md"];
    let said = said(&table(folder, &given));
    for (name, cells) in [
        ("benchmark", ["here", "target", "of the target", "plain sums", "beside", "theirs", "theirs / here"]),
        ("live: measure 4096x3072", ["24.8 ms", "≤ 33.0 ms", "75 %", "22.5", "", "", ""]),
        ("live: measure 1160x1160", ["5.00 ms", "≤ 4.00 ms", "**125 %: missed**", "", "", "", ""]),
        ("live: plain sum 4096x3072", ["1.10 ms", "", "", "1.00", "", "", ""]),
        ("views: coloured depth 1160x1160", ["250 ns", "", "", "", "", "", ""]),
        ("frame 1160x1160: water, 64 rays", ["1.23 s", "≤ 1.00 s", "**123 %: missed**", "", "", "", ""]),
        ("jpeg: libjpeg-turbo 1160x1160", ["2.00 ms", "", "", "", "the encoder in Rust", "5.00 ms", "2.50"]),
        ("jpeg: jpeg-encoder 1160x1160", ["5.00 ms", "", "", "", "", "", ""]),
        ("compare: spacing live, time, a \\| b", ["2.00 ms", "", "", "", "OpenCV, NumPy", "100 ms", "50.0"]),
        ("compare: grid, time, geometric mean", ["", "", "", "", "OpenCV, NumPy", "", "4.00"]),
        ("compare: spacing live, time, geometric mean", ["", "≥ 20 ×", "2.50 ×", "", "OpenCV, NumPy", "", "50.0"]),
        (
            "compare: spacing live, error, geometric mean",
            ["", "≥ 5 ×", "**0.400 ×: missed**", "", "OpenCV, NumPy", "", "2.00"],
        ),
    ] {
        assert_eq!(row(&said, name)[1..], cells, "{name}");
    }
    for name in ["machine", "date", "compiler", "commit"] {
        let line = said.lines().find(|line| line.starts_with(&format!("- {name}: "))).unwrap();
        assert!(!line.contains("unknown") || name == "commit", "{line}");
    }
    assert!(said.starts_with("- machine: lab: ") && said.contains(" of memory\n"), "{said}");
    assert!(said.contains("- compared with: OpenCV 5.0.0, NumPy 2.4.6"));
    assert_eq!(fs::read_to_string(folder.join("out/table.md")).unwrap(), said);
    let page = fs::read_to_string(folder.join("page.md")).unwrap();
    assert!(page.starts_with("# Title\n\nBefore.\n") && page.ends_with("-->\n\nAfter.\n"), "{page}");
    assert!(page.contains(&said) && !page.contains("old"), "{page}");
    // Into the same page again: it does not grow.
    self::said(&table(folder, &given));
    let again = fs::read_to_string(folder.join("page.md")).unwrap();
    assert_eq!((again.lines().count(), again.matches("<!--").count()), (page.lines().count(), 2));
}

#[test]
fn what_was_not_run_now_is_not_in_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    timed(folder, "live", "measure 1160x1160", 3.0);
    timed(folder, "live", "gone 1160x1160", 3.0);
    let hour_ago = SystemTime::now() - Duration::from_secs(3600);
    let old = fs::File::options().write(true).open(folder.join("criterion/live/gone 1160x1160/new/estimates.json"));
    old.unwrap().set_modified(hour_ago).unwrap();
    fs::write(folder.join("started"), "0.02 0.10 0.30\n").unwrap();
    let started = fs::File::options().write(true).open(folder.join("started")).unwrap();
    started.set_modified(SystemTime::now() - Duration::from_secs(60)).unwrap();
    let said = said(&table(folder, &["--partial", "--since", "started"]));
    assert!(said.contains("live: measure 1160x1160") && !said.contains("gone"), "{said}");
    assert!(said.contains("- load before: 0.02 0.10 0.30"), "{said}");

    // A target that no benchmark has is one that was lost.
    let lost = error(&table(folder, &["--since", "started"]));
    assert!(lost.contains("no benchmark was run, of: live/measure 4096x3072; "), "{lost}");
    let later = fs::File::options().write(true).open(folder.join("started")).unwrap();
    later.set_modified(SystemTime::now() + Duration::from_secs(60)).unwrap();
    let none = error(&table(folder, &["--partial", "--since", "started"]));
    assert!(none.contains("no result of criterion that is newer than this run"), "{none}");
}

#[test]
fn what_is_wrong_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let none = error(&table(folder, &[]));
    assert!(none.contains("criterion: there is no result of criterion; run `cargo bench` first"), "{none}");
    timed(folder, "live", "measure 1160x1160", 3.0);
    fs::write(folder.join("page.md"), "# A page\n").unwrap();
    let page = error(&table(folder, &["--partial", "--page", "page.md"]));
    assert!(page.contains("page.md: has no place for the table"), "{page}");
    fs::write(folder.join("comparison.json"), "{}").unwrap();
    let comparison = error(&table(folder, &["--partial", "--comparison", "comparison.json"]));
    assert!(comparison.contains("comparison.json: has no 'tools'"), "{comparison}");
    fs::write(folder.join("criterion/live/measure 1160x1160/new/estimates.json"), "{\"mean\": 1}").unwrap();
    let broken = error(&table(folder, &["--partial"]));
    assert!(broken.contains("estimates.json: not as criterion writes it: KeyError('median')"), "{broken}");
}

/// Every benchmark is run, its targets are of benchmarks that there are, and the page has its place.
#[test]
fn nothing_is_left_out() {
    let read = |path: &str| fs::read_to_string(root().join(path)).unwrap();
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let run = read("benches/run.sh");
    for bench in manifest["bench"].as_array().unwrap() {
        let name = bench["name"].as_str().unwrap();
        let place = if name == "compare" { "benches/compare/run.sh".to_owned() } else { format!("--bench {name}") };
        assert!(run.contains(&place), "{name}");
    }
    for mark in PAGE.lines().filter(|line| line.starts_with("<!--")) {
        assert_eq!(read("docs/benchmarks.md").matches(mark).count(), 1, "{mark}");
        assert_eq!(read("benches/table.py").matches(mark).count(), 1, "{mark}");
    }
}
