//! Doing within bounded time what a camera's description may have last for ever: working it out, and looking up features by it.

use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

/// How long a camera may take to be opened and set up; or to be read.
pub(super) const OPEN_WITHIN: Duration = Duration::from_secs(30);
/// So much work that was given up may go on: each takes a processor's time until it ends.
const MOST_GIVEN_UP: usize = 4;

/// What was given up and has not ended.
static GIVEN_UP: Mutex<Vec<Weak<()>>> = Mutex::new(Vec::new());

/// Does something in a thread of its own, which is given up when it takes too long: what it comes to is dropped when it ends.
///
/// # Errors
/// That it takes too long, or why it cannot be done, in words.
pub(super) fn within<T: Send + 'static>(
    allowed: Duration,
    work: impl FnOnce() -> Result<T, String> + Send + 'static,
) -> Result<T, String> {
    if given_up() >= MOST_GIVEN_UP {
        return Err(format!(
            "{MOST_GIVEN_UP} cameras' descriptions are being worked out and do not come to an end: none is begun besides; \
             take those cameras off the network, and start this program again"
        ));
    }
    let lives = Arc::new(());
    let life = Arc::downgrade(&lives);
    let (done, end) = sync_channel(1);
    let work = move || {
        let _lives = lives;
        // Nobody may wait for it any more.
        let _ = done.send(work());
    };
    let thread = std::thread::Builder::new().name("camera-open".to_owned()).spawn(work);
    thread.map_err(|error| format!("there is no thread to open it in: {error}"))?;
    match end.recv_timeout(allowed) {
        Ok(done) => done,
        Err(RecvTimeoutError::Disconnected) => Err("the camera's library answered something unexpected".to_owned()),
        Err(RecvTimeoutError::Timeout) => {
            GIVEN_UP.lock().unwrap_or_else(PoisonError::into_inner).push(life);
            Err(format!("it is not open after {} s: what its description says takes too long", allowed.as_secs_f64()))
        }
    }
}

fn given_up() -> usize {
    let mut given_up = GIVEN_UP.lock().unwrap_or_else(PoisonError::into_inner);
    given_up.retain(|life| life.strong_count() > 0);
    given_up.len()
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn what_takes_too_long_is_given_up_and_not_begun_without_end() {
        let soon = Duration::from_secs(20);
        assert_eq!(within(soon, || Ok(7)), Ok(7));
        assert_eq!(within::<()>(soon, || Err("gone".to_owned())), Err("gone".to_owned()));
        let panicked = within::<()>(soon, || panic!("as a library may")).unwrap_err();
        assert!(panicked.contains("unexpected"), "{panicked}");
        let late = Duration::from_millis(1);
        let ends: Vec<mpsc::Sender<()>> = (0..MOST_GIVEN_UP)
            .map(|_| {
                let (to, end) = mpsc::channel::<()>();
                let why = within(late, move || Ok(end.recv().is_err())).unwrap_err();
                assert!(why.contains("not open after 0.001 s"), "{why}");
                to
            })
            .collect();
        let why = within(soon, || Ok(())).unwrap_err();
        assert!(why.contains("none is begun besides"), "{why}");
        drop(ends);
        // They end, each in its own time.
        while given_up() > 0 {
            std::thread::yield_now();
        }
        assert_eq!(within(soon, || Ok(())), Ok(()));
    }
}
