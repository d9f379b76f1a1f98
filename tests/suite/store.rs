//! The history on disk, by itself.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use jiff::Timestamp;
use plenalign::store::records::{Audit, Job, Kept, Line, Move, Run};
use plenalign::store::{BenchName, FILE_NAME, Health, JobFilter, Store, StoreError, read};
use serde_json::json;
use uuid::Uuid;

use super::program::own_mounts;
use super::until::{until, when};

fn run(bench: &str) -> Run {
    Run {
        id: Uuid::now_v7(),
        bench: bench.to_owned(),
        version: "1".to_owned(),
        configuration: "a = 1".to_owned(),
        started_at: Timestamp::now(),
    }
}

fn job(run: &Run, state: &str) -> Job {
    Job {
        id: Uuid::now_v7(),
        run: run.id,
        kind: "joint_alignment".to_owned(),
        state: state.to_owned(),
        simulated: true,
        generation: 3,
        created_at: Timestamp::now(),
        ended_at: (state != "running").then(Timestamp::now),
        reason: None,
        request: json!({ "kind": "joint_alignment" }),
        idempotency_key: None,
        document: json!({ "progress": 1 }),
    }
}

async fn begin(store: &Store, run: &Run) {
    let run = run.clone();
    store.write(move |writer| writer.begin_run(&run)).await.unwrap();
}

async fn put(store: &Store, job: &Job) {
    let job = job.clone();
    store.write(move |writer| writer.put_job(&job)).await.unwrap();
}

async fn ids(store: &Store, filter: JobFilter) -> Vec<Uuid> {
    let page = store.read(move |c| read::jobs(c, &filter, 100)).await.unwrap();
    page.items.into_iter().map(|(job, _)| job.id).collect()
}

pub(crate) async fn until_health(store: &Store, what: &str, is: impl Fn(&Health) -> bool) {
    let health = store.health();
    until(what, async || when(health.borrow().clone(), &is).map_err(|health| format!("{health:?}"))).await;
}

#[tokio::test]
async fn what_is_queued_is_there_before_what_is_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("made/when/needed"));
    let run = run("one");
    begin(&store, &run).await;
    let job = job(&run, "running");
    put(&store, &job).await;
    for number in 1..=200 {
        let line = Line { number, at: Timestamp::now(), message: format!("line {number}") };
        let id = job.id;
        store.queue(move |writer| writer.put_line(id, &line));
    }
    store.write(|_| Ok(())).await.unwrap();
    let id = job.id;
    let lines = store.read(move |c| read::log(c, id)).await.unwrap();
    assert_eq!(lines.len(), 200);
    assert_eq!(store.read(move |c| read::find_job(c, id)).await.unwrap(), Some(job));
    // The same configuration twice is there once.
    begin(&store, &self::run("one")).await;
    let texts = store.read(|c| c.query_row("SELECT count(*) FROM configurations", [], |row| row.get::<_, i64>(0)));
    assert_eq!(texts.await.unwrap(), 1);
}

#[tokio::test]
async fn an_older_record_of_a_job_never_replaces_a_newer_one() {
    let store = Store::in_memory();
    let run = run("one");
    begin(&store, &run).await;
    let newer = job(&run, "converged");
    put(&store, &newer).await;
    put(&store, &Job { generation: 2, state: "running".to_owned(), ended_at: None, ..newer.clone() }).await;
    let id = newer.id;
    assert_eq!(store.read(move |c| read::find_job(c, id)).await.unwrap().unwrap().state, "converged");
}

#[tokio::test]
async fn what_an_earlier_run_on_the_same_bench_left_open_is_interrupted() {
    let store = Store::in_memory();
    let (earlier, other, now) = (run("one"), run("two"), run("one"));
    for run in [&earlier, &other, &now] {
        begin(&store, run).await;
    }
    let (left, ended, elsewhere, mine) =
        (job(&earlier, "running"), job(&earlier, "failed"), job(&other, "running"), job(&now, "running"));
    for job in [&left, &ended, &elsewhere, &mine] {
        put(&store, job).await;
    }
    let motion = Move {
        id: Uuid::now_v7(),
        job: Some(left.id),
        axis: "e".to_owned(),
        what: "move".to_owned(),
        from_mm: Some(30.0),
        to_mm: Some(20.0),
        started_at: Timestamp::now(),
        ended_at: None,
        end_mm: None,
        outcome: None,
    };
    let (last, id) = (Timestamp::now() + Duration::from_secs(5), left.id);
    let (line, before, begun) =
        (Line { number: 1, at: last, message: "the last".to_owned() }, earlier.id, motion.clone());
    store
        .write(move |writer| {
            writer.begin_move(before, &begun)?;
            writer.put_line(id, &line)
        })
        .await
        .unwrap();
    let name = BenchName { spelled: "one".to_owned(), devices: None };
    let found = store.write(move |writer| writer.interrupt(&now, &name, "interrupted", "gone")).await.unwrap();
    assert_eq!((found.jobs, found.moves), (vec![left.id], 1));
    let interrupted = store.read(move |c| read::find_job(c, id)).await.unwrap().unwrap();
    assert_eq!((interrupted.state.as_str(), interrupted.reason.as_deref()), ("interrupted", Some("gone")));
    // It ended no earlier than its last sign of life.
    assert_eq!(interrupted.ended_at, Some(last));
    let moves = store.read(move |c| read::moves(c, id)).await.unwrap();
    assert_eq!(moves, [Move { outcome: Some("interrupted".to_owned()), ..motion }]);
    let running = JobFilter { states: vec!["running".to_owned()], ..JobFilter::default() };
    assert_eq!(ids(&store, running).await, [mine.id, elsewhere.id]);
}

#[tokio::test]
async fn jobs_are_filtered_and_paged_newest_first() {
    let store = Store::in_memory();
    let run = run("one");
    begin(&store, &run).await;
    let mut all = Vec::new();
    for (n, state) in ["converged", "failed", "converged", "cancelled"].into_iter().enumerate() {
        let reason = (n == 1).then(|| "The AXIS 50% stood_still".to_owned());
        let job = Job { created_at: Timestamp::from_second(1000 + n as i64).unwrap(), reason, ..job(&run, state) };
        put(&store, &job).await;
        all.push(job.id);
    }
    let id = all[3];
    let line = Line { number: 1, at: Timestamp::now(), message: "white frame: square array".to_owned() };
    store.write(move |writer| writer.put_line(id, &line)).await.unwrap();
    let at = |second| Some(Timestamp::from_second(second).unwrap());
    let none = JobFilter::default();
    assert_eq!(ids(&store, none.clone()).await, [all[3], all[2], all[1], all[0]]);
    let converged = JobFilter { states: vec!["converged".to_owned()], ..none.clone() };
    assert_eq!(ids(&store, converged).await, [all[2], all[0]]);
    let between = JobFilter { since: at(1001), until: at(1003), ..none.clone() };
    assert_eq!(ids(&store, between).await, [all[2], all[1]]);
    let of_text = |text: &str| JobFilter { text: Some(text.to_owned()), ..JobFilter::default() };
    assert_eq!(ids(&store, of_text("axis 50%")).await, [all[1]]);
    assert_eq!(ids(&store, of_text("square ARRAY")).await, [all[3]]);
    // No wildcards.
    assert_eq!(ids(&store, of_text("stood%still")).await, Vec::<Uuid>::new());
    assert_eq!(ids(&store, JobFilter { without: vec![all[3]], before: Some(all[2]), ..none }).await, [all[1], all[0]]);
    let page = store.read(|c| read::jobs(c, &JobFilter::default(), 3)).await.unwrap();
    assert_eq!((page.items.len(), page.more), (3, true));
}

#[tokio::test]
async fn how_long_jobs_took_is_told_by_the_steps_that_count() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path());
    let (here, elsewhere) = (run("here"), run("elsewhere"));
    for run in [&here, &elsewhere] {
        begin(&store, run).await;
    }
    // The operator's share of a step's time is not the bench's, and of a step that was done again only the last time
    // counts.
    let steps = |own: f64| {
        json!({ "steps": [
            { "state": "done", "operator_s": 500.0, "bench_s": 10.0 },
            { "state": "repeated", "operator_s": 400.0, "bench_s": 40.0 },
            { "state": "done", "operator_s": 0.0, "bench_s": own - 10.0 },
        ] })
    };
    for (of, state, document) in [
        (&here, "converged", steps(50.0)),
        (&here, "cancelled", steps(5.0)),
        (&elsewhere, "converged", steps(7.0)),
        (&here, "converged", steps(80.0)),
        (&here, "converged", json!({ "steps": [] })),
    ] {
        put(&store, &Job { document, ..job(of, state) }).await;
    }
    let name = BenchName { spelled: "here".to_owned(), devices: None };
    let times = |kind: &'static str| {
        let (name, store) = (name.clone(), &store);
        async move { store.read(move |c| read::own_times(c, &name, kind, 9)).await.unwrap() }
    };
    let asked = json!({ "kind": "joint_alignment" });
    assert_eq!(times("joint_alignment").await, [(asked.clone(), 80.0), (asked, 50.0)]);
    assert_eq!(times("homing").await, []);
}

#[tokio::test]
async fn values_and_the_audit_log_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let kept = |value| Kept { bench: "one".to_owned(), key: "lease".to_owned(), value };
    let store = Store::open(folder.path());
    for value in [json!(1), json!({ "holder": "Ada" })] {
        let kept = kept(value);
        store.write(move |writer| writer.keep(&kept)).await.unwrap();
    }
    for n in 0..3 {
        let audit = Audit {
            at: Timestamp::from_second(n).unwrap(),
            who: "Ada".to_owned(),
            what: "stop".to_owned(),
            detail: json!({ "n": n }),
            from: None,
        };
        store.write(move |writer| writer.add_audit(&audit)).await.unwrap();
    }
    drop(store);
    let store = Store::open(folder.path());
    store.write(|_| Ok(())).await.unwrap();
    assert_eq!(store.read(|c| read::kept(c, "one", "lease")).await.unwrap(), Some(json!({ "holder": "Ada" })));
    assert_eq!(store.read(|c| read::kept(c, "two", "lease")).await.unwrap(), None);
    let page = store.read(|c| read::audit(c, None, 2)).await.unwrap();
    let numbers: Vec<_> = page.items.iter().map(|(_, audit)| audit.detail["n"].clone()).collect();
    assert_eq!((numbers, page.more), (vec![json!(2), json!(1)], true));
    let last = page.items[1].0;
    let rest = store.read(move |c| read::audit(c, Some(last), 2)).await.unwrap();
    assert_eq!((rest.items.len(), rest.more), (1, false));
}

#[tokio::test]
async fn a_folder_replaced_by_a_file_is_said_and_mended_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let store = Store::open(&state);
    let first = store.write(|writer| Ok(writer.opened())).await.unwrap();
    std::fs::remove_dir_all(&state).unwrap();
    std::fs::write(&state, "in the way").unwrap();
    let refused = store.write(|_| Ok(())).await.unwrap_err();
    assert!(matches!(&refused, StoreError::Unusable(why) if why.contains("state")), "{refused}");
    until_health(&store, "unwritable", |health| health.fault().is_some()).await;
    std::fs::remove_file(&state).unwrap();
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    assert!(store.write(|writer| Ok(writer.opened())).await.unwrap() > first, "it is known to be another file");
}

/// The file unlinked below an open connection: SQLite would go on writing to what nobody will ever find.
#[tokio::test]
async fn a_file_removed_is_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path());
    let first = store.write(|writer| Ok(writer.opened())).await.unwrap();
    std::fs::remove_file(store.path().unwrap()).unwrap();
    assert_eq!(store.write(|writer| Ok(writer.opened())).await.unwrap(), first + 1);
    assert!(store.path().unwrap().exists());
}

#[tokio::test]
async fn a_file_of_a_newer_program_or_of_none_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(FILE_NAME);
    std::fs::write(&file, "no database at all, but long enough to look like one to a hasty reader").unwrap();
    let store = Store::open(folder.path());
    let refused = store.write(|_| Ok(())).await.unwrap_err().to_string();
    assert!(refused.contains("not a database") && refused.contains("history.db"), "{refused}");
    assert!(std::fs::read_to_string(&file).unwrap().starts_with("no database"));
    drop(store);

    std::fs::remove_file(&file).unwrap();
    let made = rusqlite::Connection::open(&file).unwrap();
    made.pragma_update(None, "user_version", 99).unwrap();
    let store = Store::open(folder.path());
    let refused = store.write(|_| Ok(())).await.unwrap_err().to_string();
    assert!(refused.contains("newer version"), "{refused}");
    assert!(store.read(|_| Ok(())).await.unwrap_err().to_string().contains("newer version"));
}

#[tokio::test]
async fn a_change_is_made_whole_or_not_at_all() {
    let store = Store::in_memory();
    let run = run("one");
    begin(&store, &run).await;
    let (first, stray) = (job(&run, "running"), Job { run: Uuid::now_v7(), ..job(&run, "running") });
    let refused = store
        .write(move |writer| {
            writer.put_job(&first)?;
            writer.put_job(&stray)
        })
        .await;
    assert!(matches!(refused, Err(StoreError::Refused(_))), "{refused:?}");
    assert_eq!(ids(&store, JobFilter::default()).await, Vec::<Uuid>::new());
    assert!(matches!(*store.health().borrow(), Health::Writable { .. }), "a wrong record is no fault of the disk");
}

/// Set in a test that has been started again where it may mount a disk.
const AGAIN: &str = "PLENALIGN_TEST_MOUNTS";

/// A disk of its own at a folder. Where this user may not mount one, the test is started again in a namespace in which
/// it may, and there is nothing left to do here: `None`.
fn own_disk<'a>(test: &str, at: &'a Path, options: &str) -> Option<Mounted<'a>> {
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", options, "none"]).arg(at).output().unwrap();
    if mounted.status.success() {
        return Some(Mounted(at));
    }
    let why = String::from_utf8_lossy(&mounted.stderr).into_owned();
    assert!(std::env::var_os(AGAIN).is_none(), "no disk may be mounted even in a namespace of one's own: {why}");
    let again = own_mounts()
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", &format!("suite::store::{test}"), "--nocapture"])
        .env(AGAIN, "1")
        .output()
        .unwrap();
    let said = [again.stdout, again.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(again.status.success() && said.contains("1 passed"), "{why}\n{said}");
    None
}

struct Mounted<'a>(&'a Path);

impl Drop for Mounted<'_> {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0).status();
    }
}

/// Needs no disk of its own: a program may not let its files grow further, as on a disk with a quota that is used up.
#[test]
fn a_file_that_may_grow_no_further_is_said_and_mended_by_itself() {
    let child = Command::new("sh")
        .arg("-c")
        // Without this the system ends whoever writes more, instead of refusing the write.
        .arg("trap '' XFSZ; ulimit -S -f 1024; exec \"$0\" \"$@\"")
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", "suite::store::within_half_a_megabyte", "--ignored", "--nocapture"])
        .output()
        .unwrap();
    let said = [child.stdout, child.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(child.status.success() && said.contains("1 passed"), "{said}");
}

/// In a process of its own, whose files may grow to half a megabyte.
#[tokio::test]
#[ignore = "started by the test before it"]
async fn within_half_a_megabyte() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path());
    let put = async |n: usize| {
        let kept = Kept { bench: "one".to_owned(), key: format!("{n}"), value: json!("x".repeat(60_000)) };
        store.write(move |writer| writer.keep(&kept)).await
    };
    let (mut written, mut refused) = (0, None);
    while refused.is_none() {
        match put(written).await {
            Ok(()) => written += 1,
            Err(error) => refused = Some(error),
        }
        assert!(written < 50, "more was written than may be");
    }
    let refused = refused.unwrap();
    assert!(written > 0 && matches!(refused, StoreError::Unusable(_)), "after {written}: {refused}");
    until_health(&store, "unwritable", |health| health.fault().is_some()).await;
    // Whole, with everything that was said to be kept.
    for n in 0..written {
        assert!(store.read(move |c| read::kept(c, "one", &n.to_string())).await.unwrap().is_some(), "{n} of {written}");
    }
    let more = Command::new("prlimit").args(["--fsize=unlimited:", "--pid", &std::process::id().to_string()]).status();
    assert!(more.unwrap().success());
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    put(written).await.unwrap();
}

#[tokio::test]
async fn a_full_disk_is_said_before_it_is_needed_and_mended_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let test = "a_full_disk_is_said_before_it_is_needed_and_mended_by_itself";
    let Some(_mounted) = own_disk(test, folder.path(), "size=8m") else { return };
    let store = Store::open(folder.path());
    store.write(|_| Ok(())).await.unwrap();
    let ballast = folder.path().join("ballast");
    std::fs::write(&ballast, vec![1; 5 << 20]).unwrap();
    // Nobody writes, and still it is seen.
    until_health(&store, "full", |health| health.fault().is_some_and(|why| why.contains("full"))).await;
    let refused = store.write(|_| Ok(())).await.unwrap_err().to_string();
    assert!(refused.contains("is full"), "{refused}");
    // What there is room for is still kept: the end of a job under way.
    let from = Instant::now();
    store.queue(|writer| writer.keep(&Kept { bench: "one".to_owned(), key: "end".to_owned(), value: json!(true) }));
    store.flush().await;
    assert!(from.elapsed() < Duration::from_secs(4));
    assert_eq!(store.read(|c| read::kept(c, "one", "end")).await.unwrap(), Some(json!(true)));
    // To the last byte.
    let _ = std::fs::write(folder.path().join("more"), vec![1; 8 << 20]);
    let whole = "x".repeat(1 << 20);
    store.queue(move |writer| {
        writer.keep(&Kept { bench: "one".to_owned(), key: "large".to_owned(), value: json!(whole) })
    });
    store.flush().await;
    assert_eq!(store.read(|c| read::kept(c, "one", "large")).await.unwrap(), None);
    std::fs::remove_file(ballast).unwrap();
    std::fs::remove_file(folder.path().join("more")).unwrap();
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    store.write(|_| Ok(())).await.unwrap();
}

#[tokio::test]
async fn a_disk_made_read_only_is_said_and_mended_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let test = "a_disk_made_read_only_is_said_and_mended_by_itself";
    let Some(_mounted) = own_disk(test, folder.path(), "size=16m") else { return };
    let remount = |how: &str| {
        let status = Command::new("mount").args(["-o", &format!("remount,{how}")]).arg(folder.path()).status();
        assert!(status.unwrap().success());
    };
    // From the beginning.
    remount("ro");
    let store = Store::open(folder.path());
    let refused = store.write(|_| Ok(())).await.unwrap_err();
    assert!(matches!(refused, StoreError::Unusable(_)), "{refused}");
    // SQLite by itself says that it cannot open the file, and not why.
    let said = refused.to_string().to_lowercase();
    assert!(said.contains(FILE_NAME) && said.contains("read-only file system"), "{said}");
    remount("rw");
    until_health(&store, "writable", |health| matches!(health, Health::Writable { .. })).await;
    store.write(|_| Ok(())).await.unwrap();
}
