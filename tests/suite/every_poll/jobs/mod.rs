//! Every kind of job on the simulated bench, from its first order to its last, its right to move ended at each point of
//! it: as a command comes to its stage, as the order is written to the controller, while a frame is waited for or
//! measured, and while the operator is waited for. What goes out is judged on the wire, and where the axes stand.

mod devices;
mod points;
mod rig;
mod wire;

use std::future::Future;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Waker};
use std::time::{Duration, Instant as WallClock};

use plenalign::device::StopDelivery;
use plenalign::store::Hindrance;
use tokio::time::{Instant, timeout};

use self::points::{Point, Seen};
use self::rig::{Case, Rig, cases, request};
use super::super::steps::{Steps, stepwise};
use super::super::until::elapse;
use super::commands::done;

/// Longest that a job may take, simulated.
const JOB_ALLOWED: Duration = Duration::from_secs(3600);
/// After so long a controller that was unplugged is plugged in again: its job may still run.
const UNPLUGGED: Duration = Duration::from_millis(300);
/// Nothing goes on by itself for so long.
const QUIET: Duration = Duration::from_secs(2);

/// What ends a job's right to move. A lease that a job holds neither runs out nor is given back before its end.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    Stop(StopDelivery),
    Takeover,
    Unplugged,
    Reset,
    Unwritable,
}

const ENDS: [End; 7] = [
    End::Stop(StopDelivery::Confirmed),
    End::Takeover,
    End::Reset,
    End::Stop(StopDelivery::Undeliverable),
    End::Unwritable,
    End::Stop(StopDelivery::Sent),
    End::Unplugged,
];

type Ending = Pin<Box<dyn Future<Output = ()> + Send>>;

/// What is done to the bench at once, and what goes on after that.
fn ending(rig: &Rig, end: End) -> Ending {
    let (service, trouble) = (Arc::clone(&rig.service), Arc::clone(&rig.trouble));
    let plug_in_again = |trouble: Arc<wire::Trouble>| async move {
        elapse(UNPLUGGED).await;
        trouble.cut(false);
    };
    match end {
        End::Stop(delivery) => Box::pin(async move {
            match delivery {
                StopDelivery::Confirmed => {}
                StopDelivery::Sent => trouble.deafen(true),
                StopDelivery::Undeliverable => trouble.cut(true),
            }
            let report = service.stop(Instant::now(), "ada").await;
            assert_eq!((report.focus, report.e), (delivery, delivery));
            trouble.deafen(false);
            plug_in_again(trouble).await;
        }),
        End::Takeover => Box::pin(async move { drop(service.take_over(request("admin")).await) }),
        End::Unplugged => Box::pin(async move {
            trouble.cut(true);
            plug_in_again(trouble).await;
        }),
        End::Reset => {
            let twin = rig.twin.clone();
            Box::pin(async move { twin.power_cycle() })
        }
        End::Unwritable => {
            let store = rig.store.clone();
            Box::pin(async move { store.hinder(Hindrance { full: true, ..Hindrance::default() }) })
        }
    }
}

/// What the end of a right to move left.
struct Ended {
    /// What is still to be done.
    ending: Option<Ending>,
    places: [f64; 2],
    /// Whether a command had an axis.
    commanded: bool,
}

/// What came of a run.
struct Tried {
    /// What it passed, the end among it.
    seen: Vec<Seen>,
    /// Its own word for how it ended.
    state: String,
}

/// Where a job's right to move ends, and how.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// The points that come before.
    after: usize,
    /// The polls of tasks between the point and the end; without any, it is at the point itself.
    polls: usize,
    end: End,
}

/// Runs a job, and ends its right to move there; to its own end where no end is given.
async fn tried(steps: Steps, case: &Case, cut: Option<Cut>) -> Tried {
    let rig = Arc::new(Rig::new(case).await);
    rig.prepare(case).await;
    let begun = rig.points.len();
    let (ended, reached) = (Arc::new(Mutex::new(None)), Arc::<AtomicBool>::default());
    let act = cut.map(|cut| {
        let (rig, ended) = (Arc::clone(&rig), Arc::clone(&ended));
        move || {
            let mut ending = ending(&rig, cut.end);
            // The part of it without a wait: from here on nothing may go out.
            let is_over = ending.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_ready();
            rig.points.ended();
            let ending = (!is_over).then_some(ending);
            *ended.lock().unwrap() = Some(Ended { ending, places: rig.places(), commanded: rig.is_commanded() });
        }
    });
    let mut later = None;
    match (cut, act) {
        (Some(Cut { after, polls: 0, .. }), Some(act)) => rig.points.cut(after, Box::new(act)),
        (Some(Cut { after, .. }), Some(act)) => {
            let set = Arc::clone(&reached);
            rig.points.cut(after, Box::new(move || set.store(true, Ordering::SeqCst)));
            later = Some(act);
        }
        _ => {}
    }
    let run = {
        let (rig, request) = (Arc::clone(&rig), case.request.clone());
        tokio::spawn(async move { rig.run(request).await })
    };
    let Some(Cut { polls, end, .. }) = cut else {
        let job = timeout(JOB_ALLOWED, run).await.expect("it ends").unwrap().unwrap();
        rig.service.shut_down().await;
        return Tried { seen: rig.points.since(begun), state: format!("{}: {:?}", job.state, job.reason) };
    };
    let case_of = || format!("{}, {cut:?}", case.name);
    if let Some(act) = later {
        steps.run(|| (reached.load(Ordering::SeqCst) || run.is_finished()).then_some(())).await;
        steps.after(polls - 1, || false).await;
        act();
    }
    let mut left = loop {
        if let Some(ended) = ended.lock().unwrap().take() {
            break ended;
        }
        assert!(!run.is_finished(), "{}: it ended before, after {:?}", case_of(), rig.points.since(begun));
        elapse(Duration::from_millis(1)).await;
    };
    if let Some(ending) = left.ending.take() {
        timeout(JOB_ALLOWED, ending).await.unwrap_or_else(|_| panic!("{}: the end never ends", case_of()));
    }
    let rested = rig.places();
    let job = timeout(JOB_ALLOWED, run).await.unwrap_or_else(|_| panic!("{}: it never ends", case_of())).unwrap();
    rig.store.hinder(Hindrance::default());
    done(&rig.service).await;
    elapse(QUIET).await;
    let judged = || judge(end, &left, rested, rig.places(), &rig.points.since(begun));
    judged().unwrap_or_else(|why| panic!("{}: {why}\n{:?}", case_of(), rig.points.since(begun)));
    if let End::Stop(_) = end {
        assert!(rig.service.bench_view().stop.latched, "{}", case_of());
        rig.service.reset_stop("ada", "a test").await.unwrap();
        elapse(QUIET).await;
        judged().unwrap_or_else(|why| panic!("{}, reset: {why}", case_of()));
    }
    rig.service.shut_down().await;
    let state = job.map_or_else(|| "refused".to_owned(), |job| job.state.to_string());
    if let End::Stop(_) = end {
        assert!(["cancelled", "refused"].contains(&state.as_str()), "{}: it ended as {state}", case_of());
    }
    Tried { seen: rig.points.since(begun), state }
}

/// What may not be seen after the end.
fn judge(end: End, left: &Ended, rested: [f64; 2], now: [f64; 2], seen: &[Seen]) -> Result<(), String> {
    let at = seen.iter().position(|seen| *seen == Seen::Ended).ok_or("there was no end")?;
    let (before, after) = (&seen[..at], &seen[at + 1..]);
    let written: Vec<_> =
        after.iter().enumerate().filter(|(_, seen)| matches!(seen, Seen::At(Point::Written(..)))).collect();
    let homes = |seen: &Seen| matches!(seen, Seen::At(Point::Written(_, "home")));
    let still = |since: [f64; 2], what: &str| match since == now {
        true => Ok(()),
        false => Err(format!("{what}: at {since:?}, and at {now:?} in the end")),
    };
    match end {
        End::Stop(_) | End::Takeover if !written.is_empty() => Err(format!("{written:?} went out after it")),
        End::Stop(StopDelivery::Confirmed) | End::Takeover => still(rested, "it moved after the stop was confirmed"),
        End::Stop(_) => Ok(()),
        // Homing is what a controller that was reset, or is plugged in again, needs.
        End::Unplugged => match written.iter().find(|(_, seen)| !homes(seen)) {
            Some((_, order)) => Err(format!("{order:?} went out after it")),
            None => Ok(()),
        },
        End::Reset => {
            let moves = written.iter().filter(|(_, seen)| !homes(seen)).count();
            // One may be on its way as it happens, to a controller that knows no position any more.
            let on_its_way = matches!(before.last(), Some(Seen::At(Point::Arrived(..))));
            if moves > usize::from(on_its_way) {
                return Err(format!("{written:?} went out after it"));
            }
            let homing_on_its_way = before.last().is_some_and(homes);
            if homing_on_its_way || written.iter().any(|(_, seen)| homes(seen)) {
                Ok(())
            } else {
                still(left.places, "it moved after it")
            }
        }
        End::Unwritable => {
            // The motion that is written goes on to its end; another one is not begun.
            let next = after.iter().position(|seen| matches!(seen, Seen::At(Point::Asked | Point::Prompted)));
            let order = |seen: &&Seen| match seen {
                // This controller can switch off all of its motors only, and names none.
                Seen::At(Point::Arrived(_, "release") | Point::Written(_, "release")) => Some((None, "release")),
                Seen::At(Point::Arrived(axis, what) | Point::Written(axis, what)) => Some((Some(*axis), *what)),
                _ => None,
            };
            let own = before.last().as_ref().and_then(order).filter(|_| left.commanded);
            let other =
                written.iter().find(|(index, seen)| order(seen) != own || next.is_some_and(|next| *index > next));
            other.map_or(Ok(()), |other| Err(format!("{other:?} went out, and is not written")))
        }
    }
}

fn orders(seen: &[Seen]) -> usize {
    seen.iter().filter(|seen| matches!(seen, Seen::At(Point::Written(..)))).count()
}

/// Some points of a run: its first order as it is written, what comes after the middle one, and the last one as it comes.
fn few(seen: &[Seen]) -> Vec<usize> {
    let places: Vec<_> = (0..seen.len()).filter(|&place| matches!(seen[place], Seen::At(Point::Written(..)))).collect();
    let Some(last) = places.len().checked_sub(1) else { return vec![0, seen.len() / 2, seen.len() - 1] };
    let next = (places[last / 2] + 1).min(seen.len() - 1);
    vec![places[0], next, places[last].saturating_sub(1)]
}

fn case(name: &str) -> Case {
    cases().into_iter().find(|case| case.name == name).expect("there is such a job")
}

/// Tries some points of a job's run, each with another end, or all of them with every end; and tells.
fn try_points(name: &str, all: bool) {
    let (case, begun) = (case(name), WallClock::now());
    let whole = stepwise(|steps| tried(steps, &case, None));
    let points = if all { (0..whole.seen.len()).collect() } else { few(&whole.seen) };
    // The ends go round over the kinds: each comes at some point of some job.
    let from = cases().iter().position(|case| case.name == name).unwrap() * points.len();
    let ends = |place: usize| ENDS.into_iter().cycle().skip(from + place).take(if all { ENDS.len() } else { 1 });
    let mut runs = 0;
    for (place, &after) in points.iter().enumerate() {
        for end in ends(place) {
            stepwise(|steps| tried(steps, &case, Some(Cut { after, polls: 0, end })));
            runs += 1;
        }
    }
    println!(
        "{name} ({}): {runs} ends at {} of {} points, with {} orders, in {:.1} s",
        whole.state,
        points.len(),
        whole.seen.len(),
        orders(&whole.seen),
        begun.elapsed().as_secs_f64()
    );
}

/// A test of some points for every kind of job: they run beside each other.
macro_rules! some_points {
    ($($job:ident),* $(,)?) => {
        mod some_points { $(#[test] fn $job() { super::try_points(stringify!($job), false); })* }

        #[test]
        fn every_kind_of_job_is_tried() {
            assert_eq!(cases().iter().map(|case| case.name).collect::<Vec<_>>(), [$(stringify!($job)),*]);
        }
    };
}

some_points!(
    homing,
    joint_alignment,
    air_only,
    shell_only,
    clarity_only,
    l_bound_measurement,
    focus_sweep,
    spacing_watch,
    calibration,
);

/// `JOB=air_only`: a kind of job.
#[test]
#[ignore = "long: a part of make test-long"]
fn all_points_of_a_job() {
    try_points(&std::env::var("JOB").expect("JOB=air_only says which job"), true);
}

/// Every poll from the moment that an order comes to its stage until it has been written, with every end.
fn try_polls(name: &str, is: impl Fn(Point) -> bool) {
    let (case, begun) = (case(name), WallClock::now());
    let whole = stepwise(|steps| tried(steps, &case, None));
    let places = (0..whole.seen.len()).filter(|&place| matches!(whole.seen[place], Seen::At(point) if is(point)));
    let (mut runs, mut tried_orders) = (0, 0);
    for after in places {
        tried_orders += 1;
        for end in ENDS {
            for polls in 0.. {
                let tried = stepwise(|steps| tried(steps, &case, Some(Cut { after, polls, end })));
                runs += 1;
                let ended = tried.seen.iter().position(|seen| *seen == Seen::Ended).unwrap();
                // Written already as it ended.
                if ended > after + 1 {
                    break;
                }
                assert!(polls < 200, "{name}, {end:?} at {after}: it is never written");
            }
        }
    }
    println!(
        "{name}: {tried_orders} orders, {runs} ends between their coming and their being written, in {:.1} s",
        begun.elapsed().as_secs_f64()
    );
    assert!(tried_orders > 0 && runs > tried_orders * ENDS.len());
}

#[test]
fn at_every_poll_of_a_homing_jobs_orders_nothing_goes_out_after_the_end() {
    try_polls("homing", |point| matches!(point, Point::Arrived(..)));
}

#[test]
#[ignore = "long: a part of make test-long"]
fn all_polls_of_a_release() {
    try_polls("l_bound_measurement", |point| matches!(point, Point::Arrived(_, "release")));
}
