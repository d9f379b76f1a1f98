//! A runtime that a test can hold still after any single poll of any task.
//!
//! Between two polls of tasks a current-thread runtime polls the future that it blocks on, where that was woken and
//! `event_interval` is 1. [`Steps::run`] keeps itself woken, and so sees every state that lies between two polls.
//!
//! A task of its own, the canary, asks to be polled again whenever it was. Polled twice with nothing between, it tells
//! that no other task has anything to do; only then is the paused clock let go on to the next timer.

use std::future::poll_fn;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Poll, Waker};

use tokio::runtime::Builder;

use super::until::elapse;

#[derive(Default)]
struct Shared {
    /// The canary has been polled since this was last looked at.
    sang: AtomicBool,
    /// The clock is let go on: nobody asks to be polled.
    resting: AtomicBool,
    /// Those of the steps and of the canary.
    wakers: Mutex<[Option<Waker>; 2]>,
}

impl Shared {
    fn keep(&self, which: usize, waker: &Waker) {
        self.wakers.lock().unwrap()[which] = Some(waker.clone());
    }
}

/// The polls of the runtime that this runs in.
#[derive(Clone)]
pub(crate) struct Steps(Arc<Shared>);

/// Runs a test on a paused clock, in a runtime whose polls can be counted.
pub(crate) fn stepwise<F: Future>(test: impl FnOnce(Steps) -> F) -> F::Output {
    let shared = Arc::<Shared>::default();
    let unparks = Arc::clone(&shared);
    let runtime = Builder::new_current_thread()
        .enable_all()
        .start_paused(true)
        .event_interval(1)
        .on_thread_unpark(move || {
            if unparks.resting.swap(false, Ordering::SeqCst) {
                for waker in unparks.wakers.lock().unwrap().iter_mut().filter_map(Option::take) {
                    waker.wake();
                }
            }
        })
        .build()
        .unwrap();
    runtime.block_on(test(Steps(shared)))
}

impl Steps {
    /// Returns after so many polls; false where it had ended before.
    pub(crate) async fn after(&self, polls: usize, ended: impl Fn() -> bool) -> bool {
        let mut left = polls;
        self.run(|| match left {
            0 => Some(true),
            _ if ended() => Some(false),
            _ => {
                left -= 1;
                None
            }
        })
        .await
    }

    /// Lets tasks be polled one after another, and calls `look` before the first and after every one of them, until it
    /// returns something.
    pub(crate) async fn run<T>(&self, mut look: impl FnMut() -> Option<T>) -> T {
        let canary = tokio::spawn({
            let shared = Arc::clone(&self.0);
            poll_fn(move |cx| -> Poll<()> {
                shared.sang.store(true, Ordering::SeqCst);
                if shared.resting.load(Ordering::SeqCst) {
                    shared.keep(1, cx.waker());
                } else {
                    cx.waker().wake_by_ref();
                }
                Poll::Pending
            })
        });
        let mut sang_before = false;
        let found = poll_fn(|cx| {
            let sings = self.0.sang.swap(false, Ordering::SeqCst);
            if std::mem::replace(&mut sang_before, sings) && sings {
                sang_before = false;
                self.0.keep(0, cx.waker());
                self.0.resting.store(true, Ordering::SeqCst);
                return Poll::Pending;
            }
            match look() {
                Some(found) => Poll::Ready(found),
                None => {
                    cx.waker().wake_by_ref();
                    Poll::Pending
                }
            }
        })
        .await;
        canary.abort();
        found
    }
}

#[test]
fn every_poll_of_every_task_is_seen() {
    let polls = Arc::new(Mutex::new(Vec::new()));
    let told = Arc::clone(&polls);
    let seen = stepwise(|steps| async move {
        let task = |name: &'static str, pauses: u32| {
            let polls = Arc::clone(&told);
            tokio::spawn(async move {
                for pause in 0..pauses {
                    polls.lock().unwrap().push(name);
                    if pause % 2 == 0 {
                        tokio::task::yield_now().await;
                    } else {
                        elapse(std::time::Duration::from_secs(60)).await;
                    }
                }
            })
        };
        let tasks = [task("a", 5), task("b", 4), task("c", 1)];
        let mut seen = Vec::new();
        steps
            .run(|| {
                seen.push(told.lock().unwrap().len());
                tasks.iter().all(tokio::task::JoinHandle::is_finished).then_some(())
            })
            .await;
        seen
    });
    assert_eq!(polls.lock().unwrap().len(), 10);
    for polled in 0..=10 {
        assert!(seen.contains(&polled), "the state after {polled} polls was never seen: {seen:?}");
    }
}
