//! The study's parts and their merge in a real Slurm, of two nodes on this machine, submitted as the page tells a user.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

mod cluster;

use std::fs;
use std::path::Path;

use nix::sys::signal::Signal;
use serde_json::Value;

use self::cluster::Cluster;
use super::study::{MONTE_CARLOS, results, study, told, whole, with_chapters};
use super::until::until_blocking;

/// What the page tells a user to type, with another study in so many parts, and the reference preset.
fn as_the_page_says(study_args: &str, parts: u64) -> String {
    let page = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/study.md")).unwrap();
    let block = page.split("```sh\n").skip(1).filter_map(|text| text.split("```").next());
    let mut commands = block.filter(|block| block.contains("sbatch")).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(commands.len(), 1);
    let mut line = commands.remove(0);
    for (from, to) in [
        ("--seed 1 --benches 400 --assemblies 2000000", study_args.to_owned()),
        (" CONFIG=bench.toml", String::new()),
        ("--array=1-8", format!("--array=1-{parts}")),
    ] {
        assert_eq!(line.matches(from).count(), 1, "{from} in {line}");
        line = line.replace(from, &to);
    }
    line
}

/// Submits parts and merge as the page says, and has the numbers of both jobs.
fn submitted(cluster: &Cluster, study_args: &str, parts: u64) -> [String; 2] {
    let said = cluster.shell(&format!("{}\necho \"$parts\"", as_the_page_says(study_args, parts)));
    let (merge, parts) = said.strip_prefix("Submitted batch job ").unwrap().split_once('\n').unwrap();
    [parts.to_owned(), merge.to_owned()]
}

/// Submits some parts again alone, as the page says, and waits for them.
fn done_again(cluster: &Cluster, study_args: &str, parts: u64, which: &str) -> String {
    let variables = format!("STUDY_ARGS='{study_args}' SHARDS={parts} FIRST=1");
    let array = cluster.shell(&format!("{variables} sbatch --parsable --array={which} deploy/batch/slurm-parts.sh"));
    assert!(cluster.ended(&array).iter().all(|state| state == "COMPLETED"), "{}", cluster.state(&array));
    array
}

fn merged(cluster: &Cluster) {
    let merge = cluster.shell("sbatch --parsable deploy/batch/slurm-merge.sh");
    assert_eq!(cluster.ended(&merge), ["COMPLETED"], "{}", cluster.shell("cat plenalign-study-merge-*.log"));
}

/// What the program says of a part of two: its state and how many benches are finished; nothing before it is begun.
fn status(cluster: &Cluster, part: usize) -> (String, u64) {
    let said: Value = serde_json::from_str(&cluster.shell("plenalign study status --json || true")).unwrap();
    let parts = said["studies"][0]["parts"].as_array();
    let part = parts.into_iter().flatten().find(|other| other["shard"] == format!("{part}/2"));
    let Some(part) = part else { return Default::default() };
    (part["state"].as_str().unwrap().to_owned(), part["benches_finished"].as_u64().unwrap())
}

/// Waits until a part has finished some, and is at work.
fn in_the_middle(cluster: &Cluster, part: usize) {
    until_blocking("a part is in its middle", || {
        let (state, finished) = status(cluster, part);
        assert_ne!(state, "done", "it was too quick to be interrupted");
        if state == "running" && finished > 0 { Ok(()) } else { Err(format!("{state} with {finished}")) }
    });
}

#[test]
fn a_slurm_array_and_its_merge_are_the_single_run() {
    let cluster = Cluster::start(with_chapters(&MONTE_CARLOS), false);
    let [parts, merge] = submitted(&cluster, "--quick", 2);
    let names = until_blocking("both parts run", || {
        let tasks = cluster.shell("squeue --noheader --states=running,completed --format='%i %j: %k' --sort=i");
        if tasks.lines().filter(|line| line.contains("index")).count() == 2 { Ok(tasks) } else { Err(tasks) }
    });
    for task in [1, 2] {
        let named = format!("{parts}_{task} plenalign-study-parts: part of a study, index {task} of 1-2, into study");
        assert!(names.contains(&named), "{names}");
    }
    assert_eq!(cluster.ended(&parts), ["COMPLETED"; 2], "{} {}", cluster.log(&parts, 1), cluster.log(&parts, 2));
    assert_eq!(cluster.ended(&merge), ["COMPLETED"], "{}", cluster.shell("cat plenalign-study-merge-*.log"));
    assert_eq!(results(cluster.home.path()), results(whole()));
    let status = cluster.shell("plenalign study status --out study");
    assert!(status.contains("\ndone             1-2\n") && status.contains("\nmissing          none\n"), "{status}");

    // Counted from 0, and one part alone, told in lines that end as on Windows: both are there, and are kept.
    for (variables, array, tasks) in [("", "0-1", 2), ("SHARDS=2 FIRST=0", "1", 1)] {
        let line = format!(
            "{variables} STUDY_ARGS=$'--quick\\r\\n--seed 1\\r' sbatch --parsable --array={array} deploy/batch/slurm-parts.sh"
        );
        let array = cluster.shell(&line);
        assert_eq!(cluster.ended(&array), vec!["COMPLETED"; tasks], "{}", cluster.state(&array));
    }

    // An array with gaps does not say how many parts there are, and SHARDS alone not which is the first.
    for (variables, array, says) in [
        ("", "2,4", "plenalign: the array has gaps: SLURM_ARRAY_TASK_COUNT is 2, and 2-4"),
        ("SHARDS=4", "2", "FIRST: the index of the first part, FIRST=0 or FIRST=1"),
    ] {
        let line =
            format!("{variables} STUDY_ARGS=--quick sbatch --parsable --array={array} deploy/batch/slurm-parts.sh");
        let array = cluster.shell(&line);
        assert!(cluster.ended(&array).iter().all(|state| state == "FAILED"), "{}", cluster.state(&array));
        assert!(cluster.log(&array, 2).contains(says), "{}", cluster.log(&array, 2));
    }
}

/// Of the study in whose middle tasks are ended.
const LONG: &str = "--quick --benches 24";

/// The results of the single run.
fn single(arguments: &str) -> String {
    let folder = with_chapters(&MONTE_CARLOS);
    told(&study(folder.path(), &arguments.split(' ').collect::<Vec<_>>()));
    results(folder.path())
}

#[test]
#[ignore = "minutes: a part of make test-long"]
fn a_slurm_study_comes_through_whatever_ends_its_tasks() {
    let single = single(LONG);
    requeued_and_its_node_lost(&single);
    killed_and_out_of_time(&single);
    on_a_full_disk();
}

/// A task that Slurm ends and begins again, and one whose node is lost: nobody does anything, and the merge is right.
fn requeued_and_its_node_lost(single: &str) {
    let cluster = Cluster::start(with_chapters(&MONTE_CARLOS), false);
    let [parts, merge] = submitted(&cluster, LONG, 2);
    in_the_middle(&cluster, 2);
    cluster.shell(&format!("scontrol requeue {parts}_2"));
    until_blocking("the task ends as it is told", || {
        cluster.log(&parts, 2).contains("of 12 benches of part 2/2 are kept")
    });

    in_the_middle(&cluster, 1);
    let node = cluster.shell(&format!("squeue --noheader --jobs={parts}_1 --format=%N"));
    cluster.cut(&node);
    until_blocking("the node is lost", || {
        let nodes = cluster.shell("sinfo --noheader --Node --format='%N %T'");
        if nodes.contains(&format!("{node} down")) { Ok(()) } else { Err(nodes) }
    });
    cluster.shell(&format!("slurmd -N {node}"));

    assert_eq!(cluster.ended(&parts), ["COMPLETED"; 2], "{} {}", cluster.log(&parts, 1), cluster.log(&parts, 2));
    for task in [1, 2] {
        let log = cluster.log(&parts, task);
        assert!(log.contains("of 12 benches are there from earlier attempts"), "{log}");
    }
    assert_eq!(cluster.ended(&merge), ["COMPLETED"], "{}", cluster.shell("cat plenalign-study-merge-*.log"));
    assert_eq!(results(cluster.home.path()), single);
}

/// A task that is killed and one that is out of time: both fail, and are done again by hand.
fn killed_and_out_of_time(single: &str) {
    let cluster = Cluster::start(with_chapters(&MONTE_CARLOS), false);
    let [parts, merge] = submitted(&cluster, LONG, 2);
    cluster.shell(&format!("scontrol update JobId={parts}_1 TimeLimit=1"));
    in_the_middle(&cluster, 1);
    // Stopped, it is not done before its time is up.
    cluster.signal(&parts, 1, Signal::SIGSTOP);
    in_the_middle(&cluster, 2);
    cluster.signal(&parts, 2, Signal::SIGKILL);
    assert_eq!(cluster.ended(&format!("{parts}_2")), ["FAILED"]);
    assert_eq!(cluster.ended(&format!("{parts}_1")), ["TIMEOUT"]);
    let log = cluster.log(&parts, 1);
    assert!(log.contains("ended by a signal: ") && log.contains("of 12 benches of part 1/2 are kept"), "{log}");
    assert_eq!([1, 2].map(|part| status(&cluster, part).0), ["interrupted", "interrupted"]);
    // What waits for both never comes.
    assert_eq!(cluster.state(&merge), "PENDING");
    cluster.shell(&format!("scancel {merge}"));

    let again = done_again(&cluster, LONG, 2, "1,2");
    for task in [1, 2] {
        let log = cluster.log(&again, task);
        assert!(log.contains("of 12 benches are there from earlier attempts"), "{log}");
    }
    merged(&cluster);
    assert_eq!(results(cluster.home.path()), single);
}

/// A part that finds no room says so, and goes on when there is some.
fn on_a_full_disk() {
    let cluster = Cluster::start(with_chapters(&MONTE_CARLOS), true);
    // On the nodes, whose mounts may be their own.
    let on_a_node = |line: &str| cluster.shell(&format!("sbatch --wait --output=wrapped.log --wrap='{line}'"));
    on_a_node("head -c 900K /dev/zero > small/filler");
    let study_args = "--quick --benches 2";
    let part = |out: &str, task: u64| {
        let variables = format!("STUDY_ARGS='{study_args}' SHARDS=2 FIRST=1 OUT={out}");
        cluster.shell(&format!("{variables} sbatch --parsable --array={task} deploy/batch/slurm-parts.sh"))
    };
    // One part twice at the same time, as after a node that was only thought to be lost.
    let (good, twice, full) = (part("study", 1), part("study", 1), part("small", 2));
    for array in [good, twice] {
        assert_eq!(cluster.ended(&array), ["COMPLETED"], "{}", cluster.log(&array, 1));
    }
    assert_eq!(cluster.ended(&full), ["FAILED"]);
    let log = cluster.log(&full, 2);
    assert!(log.contains("No space left on device") && log.contains("; make room there and give the same"), "{log}");

    on_a_node("rm small/filler");
    let again = part("small", 2);
    assert_eq!(cluster.ended(&again), ["COMPLETED"], "{}", cluster.log(&again, 2));
    let log = cluster.log(&again, 2);
    assert!(log.contains("1 of 1 benches are there from earlier attempts"), "{log}");
    on_a_node("plenalign study merge study/parts small/parts");
    assert_eq!(results(cluster.home.path()), single(study_args));
}
