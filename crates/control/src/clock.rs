//! Where a job's time goes: it is at one part of its work at a time, which is entered where it begins.
//!
//! Who waits, moves or measures need not know for whom: [`enter`] finds the clock of the job whose task it is called in,
//! and does nothing in any other.

use std::future::Future;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use crate::job::TimeSpent;

/// What a job is at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// A person has been asked to do something, and has not confirmed it.
    Operator,
    /// An axis is on its way, or its controller is asked.
    Motion,
    /// The axes have come to rest, and what they carry has not.
    Settling,
    /// The camera has yet to give a frame that was exposed at rest.
    Frames,
    /// Frames are measured.
    Measuring,
    /// Whatever else: decisions, the history's disk, the rest between two measurements of a watch.
    Other,
}

tokio::task_local! {
    static OF_JOB: Arc<JobClock>;
}

/// A job's clock.
#[derive(Debug)]
pub(crate) struct JobClock(Mutex<Spent>);

#[derive(Debug)]
struct Spent {
    at: Part,
    since: Instant,
    before: [Duration; Part::Other as usize + 1],
}

impl Spent {
    /// Counts what is under way up to now.
    fn count(&mut self) {
        let now = Instant::now();
        self.before[self.at as usize] += now.saturating_duration_since(self.since);
        self.since = now;
    }
}

impl JobClock {
    /// A clock that runs from now on.
    pub(crate) fn start() -> Arc<Self> {
        let before = [Duration::ZERO; Part::Other as usize + 1];
        Arc::new(Self(Mutex::new(Spent { at: Part::Other, since: Instant::now(), before })))
    }

    fn spent(&self) -> MutexGuard<'_, Spent> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does a job's work by its clock.
    pub(crate) async fn run<T>(self: &Arc<Self>, work: impl Future<Output = T>) -> T {
        OF_JOB.scope(Arc::clone(self), work).await
    }

    /// Turns to another part, and returns the one before.
    fn turn_to(&self, part: Part) -> Part {
        let mut spent = self.spent();
        spent.count();
        std::mem::replace(&mut spent.at, part)
    }

    /// What has been spent by now.
    pub(crate) fn time_spent(&self) -> TimeSpent {
        let before = {
            let mut spent = self.spent();
            spent.count();
            spent.before
        };
        let of = |part: Part| before[part as usize].as_secs_f64();
        TimeSpent {
            total_s: before.iter().sum::<Duration>().as_secs_f64(),
            operator_s: of(Part::Operator),
            motion_s: of(Part::Motion),
            settling_s: of(Part::Settling),
            frames_s: of(Part::Frames),
            measuring_s: of(Part::Measuring),
            other_s: of(Part::Other),
        }
    }
}

/// Until what this returns is dropped, the job whose task this is called in is at a part of its work; then again at what it
/// was at before.
pub(crate) fn enter(part: Part) -> Stay {
    Stay(OF_JOB.try_with(|clock| (Arc::clone(clock), clock.turn_to(part))).ok())
}

/// A job's stay in a part of its work.
#[must_use]
#[derive(Debug)]
pub(crate) struct Stay(Option<(Arc<JobClock>, Part)>);

impl Drop for Stay {
    fn drop(&mut self) {
        if let Some((clock, before)) = &self.0 {
            clock.turn_to(*before);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::future::pending;

    use tokio::time::{advance, timeout};

    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[tokio::test(start_paused = true)]
    async fn every_moment_belongs_to_one_part() {
        let clock = JobClock::start();
        // Of no job: this is not its task yet.
        let of_no_job = enter(Part::Operator);
        advance(SECOND).await;
        drop(of_no_job);
        clock
            .run(async {
                let moving = enter(Part::Motion);
                advance(2 * SECOND).await;
                {
                    let _within = enter(Part::Settling);
                    advance(4 * SECOND).await;
                }
                advance(8 * SECOND).await;
                drop(moving);
                // Given up half-way, as a step is that a cancellation cuts short.
                let given_up = async {
                    let _waiting = enter(Part::Operator);
                    pending::<()>().await;
                };
                timeout(16 * SECOND, given_up).await.unwrap_err();
                advance(32 * SECOND).await;
                let _measuring = enter(Part::Measuring);
                advance(64 * SECOND).await;
                let spent = clock.time_spent();
                // The timer goes by whole milliseconds.
                assert!((spent.operator_s - 16.0).abs() < 0.01 && (spent.total_s - 127.0).abs() < 0.01, "{spent:?}");
                let [_, others @ ..] = spent.parts().map(|(_, seconds)| seconds);
                assert_eq!(others, [10.0, 4.0, 0.0, 64.0, 33.0]);
                let left = |usual_s| spent.time_left_s(usual_s).map(|left_s| left_s.round());
                assert_eq!([left(120.0), left(111.0)], [Some(9.0), None]);
            })
            .await;
    }
}
