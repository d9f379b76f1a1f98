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
        let ok = std::panic::catch_unwind(test).is_ok();
        println!("hardware: {} {name} ({:.1} s)", if ok { "ok    " } else { "FAILED" }, begun.elapsed().as_secs_f64());
        if ok {
            passed += 1;
        } else {
            failed.push(name);
        }
    }
    println!("hardware: {passed} passed, {} failed {}", failed.len(), failed.join(" "));
    if failed.is_empty() && passed > 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
