//! A model of the bench: random sequences of requests by several people, of leases that end, of faults, restarts and
//! kills, carried out on the whole daemon over a simulated controller of any protocol, on a paused clock. After every step each promise
//! in [`invariants`] is checked against what the controller was told and what truly moved.
//!
//! A sequence that breaks one is shrunk to a short one that still does. `MODEL=1-300` runs other seeds (in
//! `tests/long.sh`); `MODEL_ONLY="one job"` lets only invariants whose names have these words count; with
//! `MODEL_SURVEY=1` nothing is shrunk, and how often each invariant was broken is printed instead.

mod answers;
mod checks;
mod commands;
mod confirming;
mod exchange;
mod invariants;
mod known;
mod leases;
mod life;
mod play;
mod requests;
mod resolve;
mod rig;
mod run;
mod steps;
mod tally;
mod upsets;
mod wire;

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use clap::ValueEnum as _;
use plenalign::config::ControllerDriver;
use proptest::strategy::{Strategy as _, ValueTree as _};
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};

use self::invariants::{ALL, Said};
use self::run::run;
use self::steps::{Sequence, sequence};
use self::tally::Tally;

/// Sequences of one seed, and most steps of each.
const SEQUENCES: u32 = 6;
const STEPS: usize = 40;
/// Shorter sequences tried for one that breaks something, at most.
const SHRINKS: u32 = 300;

fn runtime() -> tokio::runtime::Runtime {
    tokio::runtime::Builder::new_current_thread().enable_all().start_paused(true).build().unwrap()
}

/// A runner that draws the same sequences whenever it is made from the same seed.
fn runner(seed: u64) -> TestRunner {
    let mut bytes = [0; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    let config = Config { cases: SEQUENCES, max_shrink_iters: SHRINKS, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &bytes))
}

/// Whether an invariant counts.
fn counts(name: &str) -> bool {
    std::env::var("MODEL_ONLY").map_or(true, |words| name.contains(&words))
}

fn told(sequence: &Sequence) -> String {
    let steps = sequence.steps.iter().enumerate().map(|(n, step)| format!("  {}. {step:?}\n", n + 1));
    let Sequence { driver, low, homed, .. } = sequence;
    format!(
        "{driver:?}, e homes towards the shell: {low}, both axes homed first: {homed}\n{}",
        steps.collect::<String>()
    )
}

/// Runs the sequences of a range of seeds; what was exercised.
fn model(seeds: RangeInclusive<u64>) -> Tally {
    let total = Cell::new(Tally::default());
    for seed in seeds {
        let failed = Cell::new(false);
        let outcome = runner(seed).run(&sequence(STEPS), |sequence| {
            let outcome = runtime().block_on(run(&sequence, counts, false));
            if !failed.get() {
                let mut sum = total.get();
                sum += outcome.tally;
                total.set(sum);
            }
            outcome.broken.first().map_or(Ok(()), |broken| {
                failed.set(true);
                let invariant = ALL.iter().find(|invariant| invariant.name == broken.name).unwrap();
                Err(TestCaseError::fail(format!(
                    "\"{}\" is broken\n({:?})\nat {}",
                    broken.name, invariant.said, broken.told
                )))
            })
        });
        match outcome {
            Ok(()) => println!("seed {seed}: {SEQUENCES} sequences"),
            Err(TestError::Fail(why, shortest)) => panic!("seed {seed}: {why}\n{}", told(&shortest)),
            Err(error) => panic!("seed {seed}: {error}"),
        }
    }
    let total = total.get();
    println!("{total}, {} invariants", ALL.len());
    total
}

/// Runs every sequence to its end whatever it breaks, and counts what is broken.
fn survey(seeds: RangeInclusive<u64>) -> Tally {
    let found: RefCell<BTreeMap<&str, (usize, String)>> = RefCell::default();
    let mut total = Tally::default();
    for seed in seeds {
        let mut runner = runner(seed);
        for _ in 0..SEQUENCES {
            let sequence = sequence(STEPS).new_tree(&mut runner).unwrap().current();
            let outcome = runtime().block_on(run(&sequence, counts, true));
            total += outcome.tally;
            let mut found = found.borrow_mut();
            let mut broken = outcome.broken;
            let mut names = BTreeSet::new();
            broken.retain(|broken| names.insert(broken.name));
            for broken in broken {
                if std::env::var_os("MODEL_ONLY").is_some() {
                    println!("seed {seed}: {}", broken.told);
                }
                let entry = found.entry(broken.name).or_insert_with(|| {
                    let whole = if std::env::var_os("MODEL_ONLY").is_some() { told(&sequence) } else { String::new() };
                    (0, format!("seed {seed}, {}\n{whole}", broken.told))
                });
                entry.0 += 1;
            }
        }
    }
    for (name, (times, first)) in found.borrow().iter() {
        println!("{times} sequences broke \"{name}\", first {first}");
    }
    println!("{total}, {} invariants", ALL.len());
    total
}

/// A range of seeds such as `1-300`.
fn range(text: &str) -> RangeInclusive<u64> {
    let (first, last) = text.split_once('-').expect("a range such as 1-300");
    first.parse().unwrap()..=last.parse().unwrap()
}

/// That enough has happened of everything: so much in a hundred sequences.
fn enough(tally: &Tally) {
    let least = |what: &str, found: u64, in_hundred: u64| {
        let wanted = in_hundred * tally.sequences / 100;
        assert!(found >= wanted.max(1), "{found} {what} are too few: {wanted} were wanted ({tally})");
    };
    least("requests", tally.requests, 1500);
    least("refusals", tally.refusals, 300);
    least("commands", tally.commands, 250);
    least("orders", tally.orders, 250);
    least("jobs", tally.jobs, 25);
    least("confirmations", tally.confirmations, 8);
    least("confirmations by confirm key", tally.by_confirm_key, 4);
    least("tries with a dead confirm key", tally.dead_confirm_keys, 4);
    least("new confirm keys", tally.new_confirm_keys, 4);
    least("presses that were over", tally.presses_over, 10);
    for (driver, of) in ControllerDriver::value_variants().iter().zip(tally.of_protocol) {
        least(&format!("sequences with {driver:?}"), of, 9);
    }
    least("stops in motion", tally.stops_in_motion, 15);
    least("expiries in motion", tally.expiries_in_motion, 12);
    least("releases in motion", tally.releases_in_motion, 6);
    least("takeovers in motion", tally.takeovers_in_motion, 12);
    least("connections", tally.connections, 5);
    least("full disks", tally.full_disks, 5);
    least("kills", tally.kills, 8);
    least("latched starts", tally.latched_restarts, 3);
}

#[test]
fn whatever_is_asked_and_goes_wrong_every_promise_is_kept() {
    let seeds = 1..=6;
    let tally = if std::env::var_os("MODEL_SURVEY").is_some() { survey(seeds) } else { model(seeds) };
    enough(&tally);
}

/// `MODEL=1-300`: a range of seeds.
#[test]
#[ignore = "long: a part of make test-long"]
fn many_sequences() {
    let seeds = range(&std::env::var("MODEL").expect("MODEL=1-300 says which seeds"));
    let tally = if std::env::var_os("MODEL_SURVEY").is_some() { survey(seeds) } else { model(seeds) };
    enough(&tally);
}

#[test]
fn every_promise_stands_where_it_is_said_to() {
    let plain = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    for invariant in ALL {
        let Said(file, words) = invariant.said;
        let text = std::fs::read_to_string(format!("{}/{file}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        assert!(plain(&text).contains(&plain(words)), "{file} does not say \"{words}\"");
    }
    let mut names: Vec<_> = ALL.iter().map(|invariant| invariant.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), ALL.len(), "each has a name of its own");
}
