//! Every command of motion, and everything that ends the right to move, after each of the command's polls.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Waker};
use std::time::Duration;

use plenalign::config::Side;
use plenalign::control::Service;
use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::control::motion::lease::{LeaseGrant, LeaseRequest, Permit};
use plenalign::device::{AxisName, Bench, StopDelivery};
use plenalign::store::{Hindrance, Store};
use plenalign::units::Millimetres;
use tokio::task::JoinHandle;
use tokio::time::{Instant, advance};

use super::super::bench::small_config;
use super::super::fakes::fakes;
use super::super::steps::{Steps, stepwise};
use super::super::until::elapse;
use super::controller::{FarEnd, Told};

/// A bench with a controller that keeps what it is told.
pub(super) struct Rig {
    pub(super) far: FarEnd,
    pub(super) service: Arc<Service>,
    store: Store,
    grant: LeaseGrant,
    pub(super) permit: Permit,
}

fn request(owner: &str, ttl_s: u64) -> LeaseRequest {
    LeaseRequest { owner: owner.to_owned(), note: None, ttl: Duration::from_secs(ttl_s) }
}

impl Rig {
    pub(super) async fn new() -> Self {
        Self::with(FarEnd::new(false)).await
    }

    async fn with(far: FarEnd) -> Self {
        let controller = far.controller();
        controller.first_attempt().await.unwrap();
        let stage = |axis| Arc::new(controller.stage(axis).unwrap());
        let bench = Bench { focus: stage(AxisName::Focus), e: stage(AxisName::E), ..fakes().bench };
        let store = Store::in_memory();
        let service = Service::start(Arc::new(small_config(1)), "a test's".to_owned(), bench, store.clone());
        service.open_history().await;
        far.put_home();
        let grant = service.leases().acquire(request("ada", 3600)).unwrap();
        let permit = service.leases().permit(Some(&grant.key)).unwrap();
        Self { far, service, store, grant, permit }
    }
}

type Command = fn(&Rig) -> JoinHandle<()>;

/// Refused or not, and however it ends.
fn command<F: Future<Output = ()> + Send + 'static>(future: F) -> JoinHandle<()> {
    tokio::spawn(future)
}

/// Whether nothing has the axes, and no job is left.
pub(super) fn is_idle(service: &Service) -> bool {
    !AxisName::ALL.into_iter().any(|axis| service.is_commanded(axis)) && service.bench_view().job.is_none()
}

/// Waits until it is so, on a paused clock.
pub(super) async fn done(service: &Service) {
    while !is_idle(service) {
        elapse(Duration::from_millis(5)).await;
    }
}

fn moves(rig: &Rig) -> JoinHandle<()> {
    let (service, permit) = (Arc::clone(&rig.service), rig.permit.clone());
    command(async move {
        // Beyond a second's way: in pieces, and with an approach.
        let _ = service.move_axis(&permit, AxisName::E, Millimetres(21.0)).await;
        done(&service).await;
    })
}

fn homes(rig: &Rig) -> JoinHandle<()> {
    let (service, permit) = (Arc::clone(&rig.service), rig.permit.clone());
    command(async move {
        let _ = service.home_axis(&permit, AxisName::Focus).await;
        done(&service).await;
    })
}

fn jogs(rig: &Rig) -> JoinHandle<()> {
    let (service, permit) = (Arc::clone(&rig.service), rig.permit.clone());
    command(async move {
        for _ in 0..5 {
            let _ = service.jog(&permit, AxisName::Focus, Side::High, Some(1.0), None).await;
            elapse(Duration::from_millis(25)).await;
        }
        service.end_jog(AxisName::Focus);
        done(&service).await;
    })
}

fn job(rig: &Rig, kind: JobKind) -> JoinHandle<()> {
    let (service, permit) = (Arc::clone(&rig.service), rig.permit.clone());
    rig.far.forget_home();
    command(async move {
        let Ok(job) = service.create_job(&permit, JobRequest::of(kind)).await else { return };
        // Up to where it asks its operator: a camera of this bench sees nothing.
        while !matches!(service.job(job.id).unwrap().state, JobState::WaitingForOperator) {
            if service.job(job.id).unwrap().state.is_final() {
                return;
            }
            elapse(Duration::from_millis(5)).await;
        }
        service.cancel(job.id, None).unwrap();
        done(&service).await;
    })
}

const COMMANDS: [(&str, Command); 5] = [
    ("move", moves),
    ("home", homes),
    ("jog", jogs),
    ("job homing", |rig| job(rig, JobKind::Homing)),
    ("job joint_alignment", |rig| job(rig, JobKind::JointAlignment)),
];

/// Up to where they ask their operator these go the way of a joint alignment.
const COMMANDS_ALIKE: [(&str, Command); 3] = [
    ("job air_only", |rig| job(rig, JobKind::AirOnly)),
    ("job clarity_only", |rig| job(rig, JobKind::ClarityOnly)),
    ("job l_bound_measurement", |rig| job(rig, JobKind::LBoundMeasurement)),
];

/// What ends the right to move.
#[derive(Debug, Clone, Copy, PartialEq)]
enum End {
    Stop(StopDelivery),
    Release,
    /// Its time to live runs out.
    Expiry,
    Takeover,
    Unplugged,
    Reset,
}

const ENDS: [End; 8] = [
    End::Stop(StopDelivery::Confirmed),
    End::Stop(StopDelivery::Sent),
    End::Stop(StopDelivery::Undeliverable),
    End::Release,
    End::Expiry,
    End::Takeover,
    End::Unplugged,
    End::Reset,
];

type Ending = Pin<Box<dyn Future<Output = ()> + Send>>;

fn ending(rig: &Rig, end: End) -> Ending {
    let (service, far, key) = (Arc::clone(&rig.service), rig.far.clone(), rig.grant.key.clone());
    match end {
        End::Stop(delivery) => Box::pin(async move {
            far.delivers(delivery);
            let report = service.stop(Instant::now(), "ada").await;
            assert_eq!((report.focus, report.e), (delivery, delivery));
        }),
        End::Release => Box::pin(async move { drop(service.release_lease(Some(&key)).await.unwrap()) }),
        End::Expiry => Box::pin(async move {
            if let Some(until) = service.leases().runs_out() {
                advance(until - Instant::now()).await;
            }
        }),
        End::Takeover => Box::pin(async move { drop(service.take_over(request("admin", 3600)).await) }),
        End::Unplugged => Box::pin(async move { far.unplug() }),
        End::Reset => Box::pin(async move { far.reset() }),
    }
}

/// What came of one try.
struct Tried {
    /// Orders that went out before the end.
    orders_before: usize,
    /// Whether the end was one.
    judged: bool,
    /// Orders that the clock has overtaken.
    late: usize,
}

/// Carries a command out and ends the right to move after so many polls. Returns whether it had not ended before, and
/// how many orders went out before.
async fn tried(steps: &Steps, name: &str, begin: Command, end: End, polls: usize) -> Option<Tried> {
    let rig = Rig::new().await;
    let commanded = begin(&rig);
    let reached = steps.after(polls, || commanded.is_finished()).await;
    if !reached {
        return None;
    }
    let before = rig.far.told().len();
    // The part of it without a wait: from here on nothing may go out.
    let mut ending = ending(&rig, end);
    let ended = ending.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_ready();
    // A job keeps its lease to its end: given back it is then only, and the job goes on.
    let kept_by_job = matches!(end, End::Release | End::Expiry) && rig.service.leases().view().is_some();
    if kept_by_job {
        drop(ending);
        commanded.await.unwrap();
        rig.service.shut_down().await;
        return Some(Tried { orders_before: before, judged: false, late: 0 });
    }
    rig.far.told().push(Told::Ended);
    if !ended {
        tokio::spawn(ending).await.unwrap();
    }
    if let Some(job) = rig.service.bench_view().job {
        rig.service.cancel(job, None).unwrap();
    }
    commanded.await.unwrap();
    done(&rig.service).await;
    let after = |rig: &Rig| {
        let told = rig.far.told();
        let ended = told.iter().position(|told| *told == Told::Ended).unwrap_or(told.len());
        let after = &told[ended..];
        let orders = |told: &[Told]| {
            let moves = |told: &&Told| match told {
                // Homing is what a controller that was reset needs.
                Told::Order(_, what) => end != End::Reset || *what == "move",
                _ => false,
            };
            told.iter().filter(moves).count()
        };
        // Time passes between a look at the clock and the order that it allows: that one has the stop behind it.
        let late = match (end, after.iter().position(|told| *told == Told::Stop)) {
            (End::Expiry, Some(stopped)) => orders(&after[..stopped]),
            _ => 0,
        };
        assert!(late <= 1, "{name}, {end:?} after {polls} polls: {told:?}");
        assert_eq!(orders(after), late, "{name}, {end:?} after {polls} polls: {told:?}");
        late
    };
    let late = after(&rig);
    if let End::Stop(_) = end {
        assert!(rig.service.bench_view().stop.latched);
        rig.service.reset_stop("ada", "a test").await.unwrap();
        // Nothing goes on by itself.
        elapse(Duration::from_secs(2)).await;
        after(&rig);
    }
    rig.service.shut_down().await;
    Some(Tried { orders_before: before, judged: true, late })
}

/// How many motions the history has.
async fn written(store: &Store) -> usize {
    let count = |connection: &rusqlite::Connection| {
        connection.query_row("SELECT count(*) FROM moves", [], |row| row.get::<_, i64>(0))
    };
    store.read(count).await.unwrap() as usize
}

/// The history fails after so many polls: what is not written does not move.
async fn tried_without_history(steps: &Steps, name: &str, begin: Command, polls: usize) -> bool {
    let rig = Rig::new().await;
    let commanded = begin(&rig);
    let reached = steps.after(polls, || commanded.is_finished()).await;
    if !reached {
        return false;
    }
    rig.store.hinder(Hindrance { full: true, ..Hindrance::default() });
    commanded.await.unwrap();
    rig.store.hinder(Hindrance::default());
    rig.store.flush().await;
    let written = written(&rig.store).await;
    let orders = |of: fn(&str) -> bool| {
        let told = rig.far.told();
        told.iter().filter(|told| matches!(told, Told::Order(_, what) if of(what))).count()
    };
    // A homing is one order, a move or a jog several.
    let homings = orders(|what| what == "home");
    assert!(homings <= written, "{name}, after {polls} polls: {homings} homings, and {written} are written");
    assert!(written > 0 || orders(|_| true) == 0, "{name}, after {polls} polls: it moved, and nothing is written");
    rig.service.shut_down().await;
    true
}

/// The axes of the orders that went out where another command came after so many polls of the first, by turns; none
/// where the first had ended before.
async fn turns(steps: &Steps, first: Command, second: Command, polls: usize) -> Option<Vec<AxisName>> {
    let rig = Rig::with(FarEnd::new(true)).await;
    let commanded = first(&rig);
    if !steps.after(polls, || commanded.is_finished()).await {
        return None;
    }
    second(&rig).await.unwrap();
    commanded.await.unwrap();
    rig.service.shut_down().await;
    let of_order = |told: &Told| match told {
        Told::Order(axis, _) => Some(*axis),
        _ => None,
    };
    let mut turns: Vec<_> = rig.far.told().iter().filter_map(of_order).collect();
    turns.dedup();
    Some(turns)
}

#[test]
fn axes_that_take_turns_move_one_after_the_other() {
    const PAIRS: [(Command, Command); 4] = [(moves, jogs), (moves, homes), (jogs, moves), (homes, moves)];
    let (mut points, mut refused) = (0, 0);
    for (first, second) in PAIRS {
        for polls in 0.. {
            let Some(turns) = stepwise(|steps| async move { turns(&steps, first, second, polls).await }) else { break };
            assert!(turns.len() <= 2, "after {polls} polls: {turns:?}");
            points += 1;
            refused += usize::from(turns.len() == 1);
        }
    }
    println!("{points} points, {refused} of them refused");
    assert!(refused > points / 10, "{refused} of {points}");
}

fn try_all(commands: &[(&str, Command)]) {
    let (mut points, mut amid, mut late) = (0, 0, 0);
    for &(name, begin) in commands {
        let mut of_command = 0;
        for end in ENDS {
            for polls in 0.. {
                match stepwise(|steps| async move { tried(&steps, name, begin, end, polls).await }) {
                    None => break,
                    Some(Tried { judged: false, .. }) => continue,
                    Some(tried) => {
                        amid += usize::from(tried.orders_before > 0);
                        late += tried.late;
                    }
                }
                of_command += 1;
            }
        }
        for polls in 0.. {
            if !stepwise(|steps| async move { tried_without_history(&steps, name, begin, polls).await }) {
                break;
            }
            of_command += 1;
        }
        println!("{name}: {of_command} points");
        assert!(of_command > 8 * ENDS.len(), "{name} has next to no polls");
        points += of_command;
    }
    let ends = ENDS.len() + 1;
    println!("{} commands x {ends} ends: {points} points, {amid} of them amid motion", commands.len());
    println!("{late} orders were overtaken by a lease that ran out, and stopped");
    assert!(amid > points / 10, "{amid} of {points}");
}

#[test]
fn after_the_end_of_the_right_to_move_no_order_goes_out() {
    try_all(&COMMANDS);
}

#[test]
#[ignore = "long: a part of make test-long"]
fn after_the_end_of_the_right_to_move_no_order_of_the_other_jobs_goes_out() {
    try_all(&COMMANDS_ALIKE);
}
