//! The camera's driver against a real kernel's virtual cameras, in the guest that tests/hardware/run.sh boots:
//! `make test-hardware`. `chain` runs on the host and drives a daemon in the guest, with `feed` there as its camera.
//!
//! Emulation is slow and uneven, so no test asserts a frame rate, and all wait long before they give up.

// Tests may panic: that is how they fail.
#![allow(clippy::unwrap_used)]

mod bench;
mod chain;
mod faults;
mod feed;
mod formats;
mod loopback;
mod settings;
mod u3v;
#[path = "../suite/until.rs"]
#[expect(dead_code, reason = "what tests on a paused clock use")]
mod until;
mod usb;
mod usbip;

use std::any::Any;
use std::process::ExitCode;
use std::time::Instant;

/// A test: its name and what it does, which panics where something is wrong.
type Test = (&'static str, fn());

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match words[..] {
        ["feed", address, device] => feed::run(address, device),
        ["chain", share] => chain::run(share),
        ref filters => cameras(filters),
    }
}

/// Runs the tests whose names contain one of `filters`, or all.
fn cameras(filters: &[&str]) -> ExitCode {
    if !std::path::Path::new(bench::WEBCAM).exists() {
        eprintln!("hardware: there is no {}; these tests run in a guest: make test-hardware", bench::WEBCAM);
        return ExitCode::FAILURE;
    }
    let tests: Vec<Test> = [formats::TESTS, settings::TESTS, faults::TESTS, loopback::TESTS, usb::TESTS].concat();
    let wanted = |name: &str| filters.is_empty() || filters.iter().any(|filter| name.contains(filter));
    let mut failed = Vec::new();
    let mut passed = 0;
    for (name, test) in tests.into_iter().filter(|(name, _)| wanted(name)) {
        let begun = Instant::now();
        let outcome = std::panic::catch_unwind(test);
        let mark = if outcome.is_ok() { "ok    " } else { "FAILED" };
        println!("hardware: {mark} {name} ({:.1} s)", begun.elapsed().as_secs_f64());
        match outcome {
            Ok(()) => passed += 1,
            Err(panic) => failed.push((name, why(&*panic))),
        }
    }
    // Once more, last: where only a log's end is kept, it says why.
    for (name, why) in &failed {
        println!("hardware: {name}: {why}");
    }
    let names: Vec<&str> = failed.iter().map(|(name, _)| *name).collect();
    println!("hardware: {passed} passed, {} failed {}", names.len(), names.join(" "));
    if failed.is_empty() && passed > 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// What a panic said, its end where that is long.
fn why(panic: &dyn Any) -> String {
    const LINES: usize = 16;
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref().copied());
    let lines: Vec<&str> = text.unwrap_or("a panic without words").lines().collect();
    lines[lines.len().saturating_sub(LINES)..].join("\n")
}
