//! What moves ends with the control that it moves under: with its lease, and with the task that watches it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::config::Side;
use plenalign::control::events::ShellState;
use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::control::motion::lease::{LeaseRequest, Permit};
use plenalign::control::{Refusal, Service, ServiceError};
use plenalign::device::{AxisName, Bench, DeviceError, MoveTime, Stage, StageInfo, StageState, StopDelivery};
use plenalign::store::{Hindrance, Store};
use plenalign::units::Millimetres;
use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use super::bench::{rules, service, small_config};
use super::fakes::fakes;
use super::until::{elapse, until};

fn request(owner: &str, ttl_s: u64) -> LeaseRequest {
    LeaseRequest { owner: owner.to_owned(), note: None, ttl: Duration::from_secs(ttl_s) }
}

fn taken(service: &Service, owner: &str, ttl_s: u64) -> (String, Permit) {
    let grant = service.leases().acquire(request(owner, ttl_s)).unwrap();
    let permit = service.leases().permit(Some(&grant.key)).unwrap();
    (grant.key, permit)
}

async fn free(service: &Service, axis: AxisName) {
    let free = until("the axis is at rest", async || !service.axis_view(axis).moving);
    timeout(Duration::from_secs(60), free).await.unwrap();
}

/// A simulated bench with both axes homed, and nobody's lease.
async fn homed() -> Arc<Service> {
    let service = service(small_config(1)).await;
    let (key, permit) = taken(&service, "before", 3600);
    service.set_shell(&permit, ShellState::Off).unwrap();
    for axis in AxisName::ALL {
        service.home_axis(&permit, axis).await.unwrap();
        free(&service, axis).await;
    }
    service.release_lease(Some(&key)).await.unwrap();
    service
}

/// How a lease ends.
#[derive(Debug, Clone, Copy)]
enum End {
    RunsOut,
    GivenBack,
    TakenOver,
}

const ENDS: [End; 3] = [End::RunsOut, End::GivenBack, End::TakenOver];

/// Ends the lease of `key`, and returns the permit of the one who has it then.
async fn ended(service: &Arc<Service>, end: End, key: &str) -> Permit {
    let next = match end {
        End::TakenOver => service.take_over(request("next", 3600)).await.key,
        End::GivenBack => {
            service.release_lease(Some(key)).await.unwrap();
            taken(service, "next", 3600).0
        }
        End::RunsOut => {
            until("the lease runs out", async || service.leases().view().is_none()).await;
            taken(service, "next", 3600).0
        }
    };
    service.leases().permit(Some(&next)).unwrap()
}

#[tokio::test(start_paused = true)]
async fn a_move_ends_with_its_lease_and_the_next_ones_does_not() {
    for end in ENDS {
        let service = homed().await;
        let (key, permit) = taken(&service, "ada", 2);
        // Six seconds' way.
        service.move_axis(&permit, AxisName::E, Millimetres(1.0)).await.unwrap();
        elapse(Duration::from_millis(900)).await;
        let next = ended(&service, end, &key).await;
        free(&service, AxisName::E).await;
        let view = service.axis_view(AxisName::E);
        let stood = view.position_mm.unwrap();
        assert!(stood > 15.0 && stood < 29.0, "{end:?}: {stood}");
        assert_eq!(
            view.failure.as_deref(),
            Some("the e axis was stopped on its way, because control ended"),
            "{end:?}"
        );
        let lost = Refusal::LeaseLost { holder: Some("next".to_owned()) };
        let refused = service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await.unwrap_err();
        assert_eq!(refused, lost.into(), "{end:?}");

        service.move_axis(&next, AxisName::E, Millimetres(29.5)).await.unwrap();
        free(&service, AxisName::E).await;
        let view = service.axis_view(AxisName::E);
        assert_eq!(view.failure, None, "{end:?}");
        assert!((view.position_mm.unwrap() - 29.5).abs() < 0.01, "{end:?}: {view:?}");
        service.shut_down().await;
    }
}

#[tokio::test(start_paused = true)]
async fn that_a_stop_ended_a_move_is_no_news_once_it_is_reset_and_where_the_axis_was_is_kept() {
    let service = homed().await;
    let (_, permit) = taken(&service, "ada", 3600);
    service.move_axis(&permit, AxisName::E, Millimetres(1.0)).await.unwrap();
    elapse(Duration::from_millis(900)).await;
    service.stop(Instant::now(), "ada").await;
    free(&service, AxisName::E).await;
    let view = service.axis_view(AxisName::E);
    assert_eq!(view.failure.as_deref(), Some("the e axis was stopped"));
    service.reset_stop("ada", "the bench is clear").await.unwrap().unwrap();
    assert_eq!(service.axis_view(AxisName::E).failure, None);
    // A chart that begins now ends where the axis stands.
    assert_eq!(service.recent().positions.last().unwrap().e_mm, view.position_mm);
    service.shut_down().await;
}

#[tokio::test(start_paused = true)]
async fn homing_cut_short_is_not_homed_because_control_ended() {
    for end in ENDS {
        let service = homed().await;
        let (_, permit) = taken(&service, "before", 3600);
        service.move_axis(&permit, AxisName::E, Millimetres(1.0)).await.unwrap();
        free(&service, AxisName::E).await;
        service.take_over(request("between", 2)).await;
        elapse(Duration::from_secs(3)).await;
        let (key, permit) = taken(&service, "ada", 2);
        service.home_axis(&permit, AxisName::E).await.unwrap();
        elapse(Duration::from_millis(300)).await;
        assert!(service.axis_view(AxisName::E).moving);
        ended(&service, end, &key).await;
        free(&service, AxisName::E).await;
        let view = service.axis_view(AxisName::E);
        assert_eq!((view.homed, view.position_mm), (false, None), "{end:?}");
        assert_eq!(view.failure.as_deref(), Some("the e axis is not homed, because control ended"), "{end:?}");
        service.shut_down().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_jog_held_on_ends_with_its_lease() {
    for end in ENDS {
        let service = homed().await;
        let (key, permit) = taken(&service, "ada", 2);
        let held = tokio::spawn({
            let service = Arc::clone(&service);
            async move {
                loop {
                    match service.jog(&permit, AxisName::E, Side::Low, Some(1.0), None).await {
                        Ok(_) => elapse(Duration::from_millis(100)).await,
                        Err(refused) => return refused,
                    }
                }
            }
        });
        elapse(Duration::from_millis(800)).await;
        ended(&service, end, &key).await;
        free(&service, AxisName::E).await;
        let stood = service.axis_view(AxisName::E).position_mm.unwrap();
        let refused = timeout(Duration::from_secs(5), held).await.unwrap().unwrap();
        assert!(matches!(refused, ServiceError::Refused(Refusal::LeaseLost { .. })), "{end:?}: {refused}");
        elapse(Duration::from_secs(1)).await;
        assert_eq!(service.axis_view(AxisName::E).position_mm, Some(stood), "{end:?}");
        service.shut_down().await;
    }
}

/// An axis whose driver fails in a way that no driver should.
struct Broken {
    inner: Arc<dyn Stage>,
    stops: Arc<AtomicU32>,
}

#[async_trait]
impl Stage for Broken {
    fn info(&self) -> StageInfo {
        self.inner.info()
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.inner.state()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        self.inner.read_state().await
    }

    fn generation(&self) -> u64 {
        self.inner.generation()
    }

    fn move_time(&self, from: Millimetres, to: Millimetres) -> MoveTime {
        self.inner.move_time(from, to)
    }

    async fn home(&self, _: u64) -> Result<(), DeviceError> {
        panic!("a number that nobody thought of");
    }

    async fn set_position(&self, position: Millimetres, generation: u64) -> Result<(), DeviceError> {
        self.inner.set_position(position, generation).await
    }

    async fn move_at(&self, _: Millimetres, _: f64, _: u64) -> Result<Millimetres, DeviceError> {
        panic!("a number that nobody thought of");
    }

    fn forget_position(&self) {
        self.inner.forget_position();
    }

    async fn release(&self, generation: u64) -> Result<(), DeviceError> {
        self.inner.release(generation).await
    }

    async fn stop(&self) -> StopDelivery {
        self.stops.fetch_add(1, Ordering::SeqCst);
        self.inner.stop().await
    }
}

fn broken_bench() -> (Bench, Arc<AtomicU32>) {
    let (fakes, stops) = (fakes(), Arc::<AtomicU32>::default());
    let e = Arc::new(Broken { inner: fakes.e, stops: Arc::clone(&stops) });
    (Bench { e, ..fakes.bench }, stops)
}

#[tokio::test(start_paused = true)]
async fn a_job_whose_task_fails_has_ended_and_holds_nothing() {
    let (bench, stops) = broken_bench();
    let service = Service::start(Arc::new(small_config(1)), "a test's".to_owned(), bench, Store::in_memory());
    service.open_history().await;
    let (key, permit) = taken(&service, "ada", 3600);
    for _ in 0..2 {
        let request = JobRequest { axes: Some(vec![AxisName::E]), ..JobRequest::of(JobKind::Homing) };
        service.set_shell(&permit, ShellState::Off).unwrap();
        let id = service.create_job(&permit, request).await.unwrap().id;
        until("the job is over", async || service.bench_view().job.is_none()).await;
        let job = service.job(id).unwrap();
        assert_eq!(job.state, JobState::Failed);
        let reason = job.reason.unwrap();
        assert!(reason.contains("the program failed (a number that nobody thought of)"), "{reason}");
        assert!(stops.swap(0, Ordering::SeqCst) > 0, "the axes were not brought to rest");
        until("its lease is its own", async || service.leases().view().is_none_or(|lease| lease.job.is_none())).await;
        assert!(service.leases().permit(Some(&key)).is_ok());
    }
    service.shut_down().await;
}

#[tokio::test(start_paused = true)]
async fn a_command_by_hand_whose_task_fails_leaves_an_axis_that_is_free_and_stopped() {
    let (bench, stops) = broken_bench();
    let service = Service::start(Arc::new(small_config(1)), "a test's".to_owned(), bench, Store::in_memory());
    service.open_history().await;
    let (_, permit) = taken(&service, "ada", 3600);
    for jogged in [false, true] {
        if jogged {
            service.jog(&permit, AxisName::E, Side::Low, None, None).await.unwrap();
        } else {
            service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await.unwrap();
        }
        free(&service, AxisName::E).await;
        assert!(!service.is_commanded(AxisName::E));
        let failure = service.axis_view(AxisName::E).failure.unwrap();
        let words = if jogged { "its task has ended" } else { "a number that nobody thought of" };
        assert!(failure.contains(words), "{failure}");
        assert!(stops.swap(0, Ordering::SeqCst) > 0, "the axis was not stopped");
    }
    let stopped = timeout(Duration::from_secs(5), service.stop(Instant::now(), "ada")).await.unwrap();
    assert_eq!(stopped.e, StopDelivery::Confirmed);
    service.shut_down().await;
}

/// What an axis failed at is of no account any more once it is homed, by the other's homing too.
#[tokio::test(start_paused = true)]
async fn a_failure_is_gone_once_the_homing_of_the_other_axis_has_homed_both() {
    let fakes = fakes();
    let e = Arc::new(Broken { inner: fakes.e, stops: Arc::default() });
    let bench = Bench { e, ..fakes.bench };
    let service = Service::start(Arc::new(small_config(1)), "a test's".to_owned(), bench, Store::in_memory());
    service.open_history().await;
    let (_, permit) = taken(&service, "ada", 3600);
    service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await.unwrap();
    free(&service, AxisName::E).await;
    for also in [None, Some(AxisName::E)] {
        *fakes.focus.homes_also.lock().unwrap() = also;
        service.home_axis(&permit, AxisName::Focus).await.unwrap();
        free(&service, AxisName::Focus).await;
        assert_eq!(service.axis_view(AxisName::E).failure.is_none(), also.is_some(), "{also:?}");
    }
    service.shut_down().await;
}

#[tokio::test]
async fn a_wall_beyond_the_travel_refuses_in_words() {
    let (motion, admit) = rules(small_config(1), fakes().bench);
    motion.set_l_bound(1e3, motion.contact());
    let refused = motion.go(&admit(), AxisName::E, Millimetres(20.0)).await.unwrap_err();
    assert!(matches!(refused, ServiceError::Refused(Refusal::Wall { .. })), "{refused}");
    for side in [Side::Low, Side::High] {
        // Away from the shell there is a way, to the end of the travel at most; towards it there is none.
        let end = motion.jog_end(AxisName::E, side);
        assert_eq!(end.is_ok(), side == Side::High, "{side:?}: {end:?}");
    }
}

/// A request that comes while the stop is latched is not kept for its reset.
#[tokio::test]
async fn what_is_asked_for_before_a_reset_does_not_begin_by_it() {
    let (fakes, store) = (fakes(), Store::in_memory());
    let service = Service::start(Arc::new(small_config(1)), "a test's".to_owned(), fakes.bench.clone(), store.clone());
    service.open_history().await;
    let (_, permit) = taken(&service, "ada", 3600);
    service.stop(Instant::now(), "ada").await;
    // The reset takes its time to be written, and the request waits behind it.
    store.hinder(Hindrance { delay: Duration::from_millis(300), ..Hindrance::default() });
    let reset = tokio::spawn({
        let service = Arc::clone(&service);
        async move { service.reset_stop("ada", "the bench is clear").await }
    });
    tokio::task::yield_now().await;
    let asked = service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await;
    assert!(reset.await.unwrap().unwrap().is_some());
    let stopped = [Refusal::Stopped.into(), DeviceError::Stopped { axis: AxisName::E }.into()];
    assert!(asked.as_ref().is_err_and(|error| stopped.contains(error)), "{:?}", asked.err());
    assert!(fakes.e.told.lock().unwrap().is_empty());
    store.hinder(Hindrance::default());
    service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await.unwrap();
    free(&service, AxisName::E).await;
    assert_eq!(fakes.e.told.lock().unwrap().last(), Some(&20.0), "what is asked for after the reset does");
    service.shut_down().await;
}

#[tokio::test(start_paused = true)]
async fn what_is_said_of_the_shell_waits_for_the_axes() {
    let service = homed().await;
    let (_, permit) = taken(&service, "ada", 3600);
    service.move_axis(&permit, AxisName::E, Millimetres(20.0)).await.unwrap();
    let refused = service.set_shell(&permit, ShellState::On).unwrap_err();
    assert_eq!(refused, Refusal::Moving { axis: AxisName::E }.into());
    free(&service, AxisName::E).await;
    service.set_shell(&permit, ShellState::On).unwrap();
    service.shut_down().await;
}

/// An axis stands between two pieces of its way: one that takes turns with it is not to begin there, nor end it.
#[tokio::test]
async fn an_axis_that_takes_turns_waits_for_the_other_ones_command() {
    let fakes = fakes();
    *fakes.e.takes_turns_with.lock().unwrap() = Some(AxisName::Focus);
    *fakes.e.homes_also.lock().unwrap() = Some(AxisName::Focus);
    let (motion, admit) = rules(small_config(1), fakes.bench);
    let moves = motion.claim(&admit(), AxisName::Focus).unwrap();
    let refused = motion.claim(&admit(), AxisName::E).unwrap_err();
    assert_eq!(refused, Refusal::Moving { axis: AxisName::Focus }.into());
    drop(moves);
    motion.home(&admit(), AxisName::E).await.unwrap();
    motion.release(&admit(), AxisName::E).await.unwrap();
    motion.claim(&admit(), AxisName::E).unwrap();
}

/// Where one command homes both axes, both are taken: none goes on from where it no longer stands.
#[tokio::test]
async fn homing_takes_along_the_axis_that_its_controller_takes_along() {
    let fakes = fakes();
    *fakes.e.homes_also.lock().unwrap() = Some(AxisName::Focus);
    let (motion, admit) = rules(small_config(1), fakes.bench);
    let moves = motion.claim(&admit(), AxisName::Focus).unwrap();
    let refused = motion.home(&admit(), AxisName::E).await.unwrap_err();
    assert_eq!(refused, Refusal::Moving { axis: AxisName::Focus }.into());
    drop(moves);
    motion.home(&admit(), AxisName::E).await.unwrap();
}
