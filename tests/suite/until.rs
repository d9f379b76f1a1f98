//! Waiting for what is to come about. A test waits for a state: how long that takes is the machine's business, and one
//! that is busy takes long.

use std::fmt::Display;
use std::time::{Duration, Instant};

use futures_util::FutureExt as _;
use tokio::time::{advance, sleep};

/// How long anything may take, by the clock on the wall, also where a test's own is paused: far longer than it does.
const PATIENCE: Duration = Duration::from_secs(120);
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// What a look comes to.
pub(crate) trait Look {
    type Found;

    /// What was waited for, or else what there is instead, to be said if it never comes.
    fn found(self) -> Result<Self::Found, String>;
}

impl Look for bool {
    type Found = ();

    fn found(self) -> Result<(), String> {
        self.then_some(()).ok_or_else(String::new)
    }
}

impl<T> Look for Option<T> {
    type Found = T;

    fn found(self) -> Result<T, String> {
        self.ok_or_else(String::new)
    }
}

impl<T, E: Display> Look for Result<T, E> {
    type Found = T;

    fn found(self) -> Result<T, String> {
        self.map_err(|instead| format!(": {instead}"))
    }
}

/// What is there as a [`Look`]: found where it is as wanted.
pub(crate) fn when<T>(there: T, is: impl FnOnce(&T) -> bool) -> Result<T, T> {
    if is(&there) { Ok(there) } else { Err(there) }
}

/// Looks again and again until what is waited for is there.
pub(crate) async fn until<L: Look>(what: &str, mut look: impl AsyncFnMut() -> L) -> L::Found {
    let began = Instant::now();
    loop {
        match look().await.found() {
            Ok(found) => return found,
            Err(instead) => assert!(began.elapsed() < PATIENCE, "never: {what}{instead}"),
        }
        sleep(LOOK_AGAIN).await;
    }
}

/// As [`until`], for who waits on a thread.
#[track_caller]
pub(crate) fn until_blocking<L: Look>(what: &str, mut look: impl FnMut() -> L) -> L::Found {
    let began = Instant::now();
    loop {
        match look().found() {
            Ok(found) => return found,
            Err(instead) => assert!(began.elapsed() < PATIENCE, "never: {what}{instead}"),
        }
        std::thread::sleep(LOOK_AGAIN);
    }
}

/// Lets a paused clock go on by so much, all that is due meanwhile included. It panics where the clock is not paused:
/// that would be to wait for a time.
pub(crate) async fn elapse(time: Duration) {
    // Its first poll panics so, and nothing is advanced.
    let _ = advance(Duration::ZERO).now_or_never();
    sleep(time).await;
}
