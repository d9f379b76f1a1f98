//! A whole simulated bench for a test: small sensor, simulated time.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{BenchConfig, BenchDriver, Config, ControllerConfig, ControllerDriver};
use plenalign::control::events::Event;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot};
use plenalign::control::motion::lease::{LeaseRequest, Leases, Permit};
use plenalign::control::motion::{Admission, Motion};
use plenalign::control::{Service, open_bench};
use plenalign::device::Bench;
use plenalign::store::Store;
use tokio::sync::broadcast::error::RecvError;

/// The reference bench with a sensor small enough to render in a blink.
pub(crate) fn small_config(seed: u64) -> Config {
    let mut config = Config::default();
    config.sensor.width_px = 560;
    config.sensor.height_px = 560;
    config.bench.simulation.seed = seed;
    config.bench.simulation.rays = 16;
    config
}

/// Has both axes go so fast that a test hardly waits for their way, nor for their homing.
pub(crate) fn quick_axes(bench: &mut BenchConfig) {
    for axis in [&mut bench.focus, &mut bench.e] {
        axis.speed_mm_per_s = 40.0;
        axis.acceleration_mm_per_s2 = 400.0;
    }
}

/// The same in a program's configuration, at its end.
pub(crate) const QUICK_AXES: &str = "[bench.focus]\nspeed_mm_per_s = 40\nacceleration_mm_per_s2 = 400\n\
     [bench.e]\nspeed_mm_per_s = 40\nacceleration_mm_per_s2 = 400\n";

/// Waits until a simulated bench has shown so many frames: what moves does so meanwhile.
pub(crate) async fn frames(bench: &Bench, count: usize) {
    let mut live = bench.camera.live();
    for _ in 0..count {
        live.changed().await.unwrap();
    }
}

/// A configuration's bench with real drivers: both axes on one Grbl controller at a port, and no camera.
pub(crate) fn grbl_hardware(mut config: Config, port: &Path) -> Config {
    config.bench.driver = BenchDriver::Hardware;
    let controller = ControllerConfig {
        driver: ControllerDriver::Grbl,
        port: port.to_owned(),
        baud: None,
        identity: None,
        address: 1,
    };
    config.bench.controllers.insert("main".to_owned(), controller);
    config.bench.camera.device = "/dev/there-is-no-camera".to_owned();
    for axis in [&mut config.bench.focus, &mut config.bench.e] {
        "main".clone_into(&mut axis.controller);
        axis.accept_wider_firmware_limits = true;
    }
    config
}

/// A service over the simulated bench of a configuration.
pub(crate) async fn service(config: Config) -> Arc<Service> {
    let config = Arc::new(config);
    let bench = open_bench(&config).await.unwrap();
    Service::start(config, "a test's configuration".to_owned(), bench, Store::in_memory())
}

/// The rules over a bench, and what the lease's holder is admitted under now.
pub(crate) fn rules(config: Config, bench: Bench) -> (Arc<Motion>, impl Fn() -> Admission) {
    let leases = Arc::<Leases>::default();
    let request = LeaseRequest { owner: "a test".into(), note: None, ttl: Duration::from_secs(3600) };
    let grant = leases.acquire(request).unwrap();
    let permit = leases.permit(Some(&grant.key)).unwrap();
    let motion = Arc::new(Motion::new(Arc::new(config), bench, leases));
    let admitting = Arc::clone(&motion);
    (motion, move || admitting.admit(&permit))
}

/// The control lease, taken over from whatever the test had before.
pub(crate) fn permit(service: &Service) -> Permit {
    key_and_permit(service).1
}

/// The same with its key, by which what a job asks is confirmed.
pub(crate) fn key_and_permit(service: &Service) -> (String, Permit) {
    let request = LeaseRequest { owner: "a test".to_owned(), note: None, ttl: Duration::from_secs(3600) };
    let key = service.leases().take_over(request).key;
    let permit = service.leases().permit(Some(&key)).unwrap();
    (key, permit)
}

/// Runs a job to its end.
pub(crate) async fn run(service: &Arc<Service>, request: JobRequest) -> JobSnapshot {
    let mut events = service.subscribe();
    let id = service.create_job(&permit(service), request).await.unwrap().id;
    loop {
        match events.recv().await {
            Ok(Event::Job { job }) if job.id == id && job.state.is_final() => break,
            Ok(_) | Err(RecvError::Lagged(_)) => {}
            Err(RecvError::Closed) => panic!("the service ended before its job"),
        }
    }
    service.job(id).unwrap()
}

/// Runs a joint alignment to its end.
pub(crate) async fn align(service: &Arc<Service>) -> JobSnapshot {
    run(service, JobRequest::of(JobKind::JointAlignment)).await
}
