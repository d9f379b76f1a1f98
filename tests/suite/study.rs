//! `plenalign study --quick`: what its report must say, that an interrupted study goes on, and that its Monte Carlos in
//! parts are those of one run.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use super::until::{until_blocking, when};

/// What the shards make, and merge takes from them.
pub(super) const MONTE_CARLOS: [&str; 2] = ["loops", "assembly"];

/// `plenalign study`, run in a folder, where its own folder is `study`.
pub(super) fn study(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plenalign"));
    command.arg("study").args(arguments).current_dir(folder);
    command
}

/// What it says on standard error, after it ended well.
pub(super) fn told(output: &Output) -> String {
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    told
}

/// A folder with a quick study that was run whole: once for all tests that look at it.
pub(super) fn whole() -> &'static Path {
    static WHOLE: OnceLock<PathBuf> = OnceLock::new();
    WHOLE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("quick-study");
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        told(&study(&folder, &["--quick"]));
        folder
    })
}

/// A folder that has the chapters of the whole study that are not left out.
pub(super) fn with_chapters(left_out: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for kind in ["chapters", "pictures"] {
        let to = folder.path().join("study").join(kind);
        fs::create_dir_all(&to).unwrap();
        for entry in fs::read_dir(whole().join("study").join(kind)).unwrap() {
            let from = entry.unwrap().path();
            if kind == "pictures" || !left_out.iter().any(|name| from.file_stem().unwrap() == *name) {
                fs::copy(&from, to.join(from.file_name().unwrap())).unwrap();
            }
        }
    }
    folder
}

/// The results, as they stand in the file, without the lines that tell times.
pub(super) fn results(folder: &Path) -> String {
    let text = fs::read_to_string(folder.join("study/results.json")).unwrap();
    let lines = text.lines().filter(|line| !line.trim_start().starts_with("\"seconds\": "));
    lines.collect::<Vec<_>>().join("\n")
}

/// The findings of a chapter, by what they are about.
fn finding<'a>(results: &'a Value, chapter: &str, about: &str) -> &'a Value {
    let chapter = results["chapters"].as_array().unwrap().iter().find(|c| c["name"] == chapter).expect(chapter);
    let findings = chapter["findings"].as_array().unwrap();
    findings.iter().find(|f| f["what"].as_str().unwrap().contains(about)).unwrap_or_else(|| panic!("{about}"))
}

fn cells(results: &Value, chapter: &str, table: &str, column: &str) -> Vec<f64> {
    let chapter = results["chapters"].as_array().unwrap().iter().find(|c| c["name"] == chapter).expect(chapter);
    let table = chapter["tables"].as_array().unwrap().iter().find(|t| t["name"] == table).expect(table);
    let at = table["columns"].as_array().unwrap().iter().position(|c| c == column).expect(column);
    table["rows"].as_array().unwrap().iter().map(|row| row[at].as_str().unwrap().parse().unwrap()).collect()
}

#[test]
fn the_quick_study_holds_what_the_paper_claims() {
    let folder = with_chapters(&["table_2"]);
    // A chapter that was not finished is made again, and only that one.
    let again = study(folder.path(), &["--quick", "--json"]);
    assert_eq!(told(&again).matches("kept from an earlier run").count(), 8);
    assert_eq!(self::results(folder.path()), self::results(whole()));
    let results: Value = serde_json::from_slice(&again.stdout).unwrap();

    // Table 2, to its last digit, and the f that follows from it.
    for optimisation in ["Δv, clarity", "Δv, joint"] {
        assert_eq!(finding(&results, "table_2", optimisation)["verdict"], "agrees");
    }
    // Clarity and joint far above direct, for every texture, on the same piece of board.
    let ratios = cells(&results, "clarity", "eog", "same board, mean per pixel");
    for texture in ratios.chunks_exact(4) {
        let [_, direct, clarity, joint] = texture else { panic!("{texture:?}") };
        assert!(*clarity > 1.5 * direct && *joint > 1.5 * direct, "{texture:?}");
        assert!((joint / clarity - 1.0).abs() < 0.15, "{texture:?}");
    }
    // What is seen of the board is what rays say.
    for off in cells(&results, "field_of_view", "cases", "difference, %") {
        assert!(off.abs() < 1.0, "{off}");
    }
    for off in cells(&results, "blur", "blur", "difference, px") {
        assert!(off.abs() < 0.3, "{off}");
    }
    for about in ["median of |z/z_true", "block artefacts", "energy of gradient of the scene"] {
        let found = finding(&results, "two_fish", about);
        assert_eq!(found["verdict"], "agrees", "{found}");
    }
    for what in cells(&results, "two_fish", "depth", "median |z/z_true − 1|, %") {
        assert!(what < 3.0, "{what}");
    }
    assert_eq!(finding(&results, "second_camera", "l_bound")["verdict"], "agrees");

    // The report stands alone; the tables and pictures are there.
    let out = folder.path().join("study");
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("data:image/png;base64,") && report.contains("SIMULATED"));
    assert!(!report.contains("src=\"http") && !report.contains("href=\"http"));
    assert!(out.join("tables/table_2-cases.csv").exists() && out.join("pictures/two_fish-depth.png").exists());
}

#[test]
fn merged_parts_are_the_whole_study() {
    for (of, order) in [(3, &[2, 3, 1][..]), (4, &[4, 2, 1, 3])] {
        let folder = with_chapters(&MONTE_CARLOS);
        let part = |number: usize| format!("study/parts/part-{number}-of-{of}.json");
        for number in order {
            if *number == order[order.len() - 1] {
                // Before the last of them is there, they are not the whole.
                let short = study(folder.path(), &["merge"]);
                let error = String::from_utf8_lossy(&short.stderr).into_owned();
                assert!(
                    !short.status.success() && error.contains("the parts cannot be merged: no part has "),
                    "{error}"
                );
                assert!(
                    error.contains("assemblies ") && error.ends_with(&format!("; not there: {number}/{of}\n")),
                    "{error}"
                );
            }
            told(&study(folder.path(), &["--quick", "--shard", &format!("{number}/{of}")]));
            assert!(folder.path().join(part(*number)).exists());
        }
        let parts: Vec<String> = order.iter().map(|number| part(*number)).collect();
        let arguments: Vec<&str> = match of {
            // All in a folder, and one by one; those in the study's folder a cluster merges.
            3 => vec!["merge", "study/parts"],
            _ => std::iter::once("merge").chain(parts.iter().map(String::as_str)).collect(),
        };
        let told = told(&study(folder.path(), &arguments));
        assert_eq!(told.matches("of the merged parts").count(), 2, "{told}");
        assert_eq!(told.matches("kept from an earlier run").count(), 7, "{told}");
        // Line by line, so that a difference can be read.
        for (merged, single) in results(folder.path()).lines().zip(results(whole()).lines()) {
            assert_eq!(merged, single, "of {of}");
        }
        assert_eq!(results(folder.path()), results(whole()), "of {of}");
        for table in fs::read_dir(whole().join("study/tables")).unwrap() {
            let table = table.unwrap();
            let merged = fs::read(folder.path().join("study/tables").join(table.file_name())).unwrap();
            assert!(merged == fs::read(table.path()).unwrap(), "{:?} of {of}", table.file_name());
        }
        // The merged chapters are kept, and are this study's.
        let again = self::told(&study(folder.path(), &["--quick"]));
        assert_eq!(again.matches("kept from an earlier run").count(), 9, "{again}");
    }
}

#[test]
fn an_interrupted_part_goes_on_and_a_finished_one_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--quick", "--benches", "4", "--assemblies", "9000", "--shard", "2/2", "--json"];
    let status = || -> Value {
        let output = study(folder.path(), &["status", "--json"]);
        told(&output);
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        said["studies"][0]["parts"][0].clone()
    };
    let mut interrupted = command(folder.path(), &arguments);
    // With one thread it is at its second bench when the first is finished.
    interrupted.env("RAYON_NUM_THREADS", "1").stdout(Stdio::null()).stderr(Stdio::piped());
    let mut interrupted = interrupted.spawn().unwrap();
    let journal = until_blocking("a bench is finished", || {
        let mut files = fs::read_dir(folder.path().join("study/parts")).ok()?;
        let path = files.next()?.unwrap().path();
        fs::read_to_string(&path).unwrap().contains("\"outcome\"").then_some(path)
    });
    kill(Pid::from_raw(i32::try_from(interrupted.id()).unwrap()), Signal::SIGTERM).unwrap();
    let mut why = String::new();
    interrupted.stderr.take().unwrap().read_to_string(&mut why).unwrap();
    assert_eq!(interrupted.wait().unwrap().code(), Some(143));
    assert!(why.contains("ended by a signal: 1 of 2 benches of part 2/2 are kept"), "{why}");
    let path = folder.path().join("study/parts/part-2-of-2.json");
    assert!(!path.exists() && journal.exists());
    let interrupted = status();
    assert_eq!((&interrupted["state"], &interrupted["benches_finished"]), (&"interrupted".into(), &1.into()));

    // Whatever Slurm says, a thread for each processor that it gives and no more than there are; also where what is said finds
    // no room.
    let processors = std::thread::available_parallelism().unwrap().get();
    for (given, threads) in [("1000", processors), ("1", 1)] {
        let slurm = arguments.map(|argument| if argument == "2/2" { "slurm" } else { argument });
        let mut unheard = command(folder.path(), &slurm);
        unheard.env_remove("RAYON_NUM_THREADS").stdout(full()).stderr(full()).env("SLURM_CPUS_PER_TASK", given);
        for (variable, value) in [("ID", "2"), ("COUNT", "2"), ("MIN", "1"), ("MAX", "2")] {
            unheard.env(format!("SLURM_ARRAY_TASK_{variable}"), value);
        }
        let before = fs::read_dir(folder.path().join("study/parts")).unwrap().count();
        let mut unheard = unheard.spawn().unwrap();
        // Its threads are there before its journal is.
        until_blocking("another attempt has begun", || {
            (fs::read_dir(folder.path().join("study/parts")).ok()?.count() > before).then_some(())
        });
        until_blocking("the study's threads are as many as are due", || {
            let names = threads_of(unheard.id());
            // Beside them are what began, hears signals, and writes.
            let (of_study, others): (Vec<_>, Vec<_>) = names.iter().partition(|name| name.starts_with("study-"));
            when((of_study.len(), others.len()), |&(of_study, others)| of_study == threads && others <= 3)
                .map_err(|_| format!("{threads} of {names:?}"))
        });
        kill(Pid::from_raw(i32::try_from(unheard.id()).unwrap()), Signal::SIGTERM).unwrap();
        assert_eq!(unheard.wait().unwrap().code(), Some(143));
    }

    // In another split, whose third part of four is the bench that is finished.
    let other = tempfile::tempdir().unwrap();
    let parts = other.path().join("study/parts");
    fs::create_dir_all(&parts).unwrap();
    fs::copy(&journal, parts.join(journal.file_name().unwrap())).unwrap();
    let third = arguments.map(|argument| if argument == "2/2" { "3/4" } else { argument });
    let goes_on = told(&study(other.path(), &third));
    assert!(
        goes_on.contains("1 of 1 benches are there from earlier attempts at part 3/4, 1 of them from when "),
        "{goes_on}"
    );
    assert_eq!(fs::read_dir(&parts).unwrap().count(), 2);

    let said = |kept: bool| {
        let output = study(folder.path(), &arguments);
        let goes_on = told(&output).contains("1 of 2 benches are there from earlier attempts at part 2/2");
        assert_eq!(goes_on, !kept);
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(said["kept"], kept, "{said}");
        assert_eq!(said["part"], "study/parts/part-2-of-2.json");
        assert_eq!(said["benches"], serde_json::json!({ "first": 2, "end": 4 }));
        assert_eq!(said["assemblies"], serde_json::json!({ "first": 4500, "end": 9000 }));
        fs::read(&path).unwrap()
    };
    let first = said(false);
    assert!(said(true) == first);
    assert!(!journal.exists());
    assert_eq!(status()["state"], "done");
    let part: Value = serde_json::from_slice(&first).unwrap();
    assert_eq!(part["format"], "plenalign-study-part");
    assert_eq!(part["assemblies"]["outcomes"].as_array().unwrap().len(), 4500);

    // Neither does the part of another configuration pass for this one's.
    let other = study(folder.path(), &["merge", "study/parts/part-2-of-2.json", "--set", "assembly.initial_e_mm=25"]);
    let error = String::from_utf8_lossy(&other.stderr).into_owned();
    assert!(!other.status.success() && error.contains("made with another configuration than this one"), "{error}");
}

/// The names of a process' threads.
fn threads_of(process: u32) -> Vec<String> {
    let threads = fs::read_dir(format!("/proc/{process}/task")).unwrap();
    threads
        .filter_map(|thread| Some(fs::read_to_string(thread.ok()?.path().join("comm")).ok()?.trim().to_owned()))
        .collect()
}

/// A file that has no room.
fn full() -> fs::File {
    fs::File::options().write(true).open("/dev/full").unwrap()
}

#[test]
fn a_part_is_whole_though_nobody_hears_of_it_and_no_other_takes_its_place() {
    let folder = tempfile::tempdir().unwrap();
    // No bench falls to it.
    let small = ["--quick", "--benches", "1", "--assemblies", "4"];
    let shard = |seed: &'static str, shard: &'static str| [&small[..], &["--seed", seed, "--shard", shard]].concat();
    let unheard = command(folder.path(), &shard("1", "1/2")).stdout(full()).stderr(full()).status().unwrap();
    assert!(unheard.success());
    let path = folder.path().join("study/parts/part-1-of-2.json");
    let first = fs::read(&path).unwrap();
    for (seed, number, says) in [
        ("2", "1/2", "part-1-of-2.json: there is part 1/2 of a study (quick, seed 1, 1 benches, 4 assemblies, "),
        ("1", "1/3", "part-1-of-2.json: it is one of 2 parts of this study, and 1/3 would be one of 3"),
    ] {
        let output = study(folder.path(), &shard(seed, number));
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(says), "{error}");
    }
    // Cut off, and with another digit in a number: both are told, and the part is not taken for whole.
    let text = String::from_utf8(first.clone()).unwrap();
    let (before, number) = text.split_once("\"as_built_mm\":0.").unwrap();
    let digit = if number.starts_with('0') { "1" } else { "0" };
    let flipped = format!("{before}\"as_built_mm\":0.{digit}{}", &number[1..]);
    for (damaged, says) in
        [(&first[..200], "not a part: EOF"), (flipped.as_bytes(), "damaged: it does not end with the")]
    {
        fs::write(&path, damaged).unwrap();
        for (arguments, then) in [(shard("1", "1/2"), "; move it away to have it made again"), (vec!["merge"], "")] {
            let output = study(folder.path(), &arguments);
            let error = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(!output.status.success() && error.contains(says) && error.contains(then), "{error}");
        }
    }
    // What was asked for is lost: that is told by the end.
    let lost = command(folder.path(), &["status", "--json"]).stdout(full()).output().unwrap();
    let error = String::from_utf8_lossy(&lost.stderr).into_owned();
    assert!(!lost.status.success() && !error.contains("panicked"), "{error}");
}

#[test]
fn what_parts_do_not_have_is_made_beside_them_without_a_report() {
    let folder = with_chapters(&["table_2", "loops", "assembly"]);
    let output = study(folder.path(), &["--quick", "--other-chapters", "--json"]);
    let kept = told(&output).matches("kept from an earlier run").count();
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((kept, said["chapters"].as_array().unwrap().len()), (6, 7), "{said}");
    let out = folder.path().join("study");
    assert!(out.join("chapters/table_2.json").exists() && !out.join("chapters/loops.json").exists());
    assert!(!out.join("report.html").exists() && !out.join("results.json").exists());
    // Whoever else writes there is waited for.
    let held = fs::File::create(out.join(".lock")).unwrap();
    held.lock().unwrap();
    let mut waiting = command(folder.path(), &["--quick", "--other-chapters"]);
    let mut waiting = waiting.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    let mut said = BufReader::new(waiting.stderr.take().unwrap());
    said.read_line(&mut line).unwrap();
    assert!(line.ends_with("another study writes into study: waiting for its end\n"), "{line}");
    assert!(waiting.try_wait().unwrap().is_none());
    drop(held);
    assert!(waiting.wait().unwrap().success());
}

#[test]
fn what_is_asked_wrongly_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, says) in [
        (&["--shard", "5/4"][..], "there is no part 5 of 4"),
        (&["--shard", "0/4"], "counted from 1"),
        (&["--shard", "slurm"], "SLURM_ARRAY_TASK_ID is not set: --shard slurm is for a task of an array"),
        (&["--assemblies", "0"], "1..=10000000"),
        (&["--benches", "100001"], "1..=100000"),
        (&["--quick", "merge"], "cannot be used with"),
        (&["--other-chapters", "--shard", "1/2"], "cannot be used with"),
        (&["merge"], "study/parts: No such file"),
        (&["status", "--json"], "study: no part of a study has been begun here"),
        (&["status"], "study: no part of a study has been begun here"),
        (&["merge", "."], "there is no part-K-of-N.json"),
    ] {
        let output = study(folder.path(), arguments);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(says), "{arguments:?}: {error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
