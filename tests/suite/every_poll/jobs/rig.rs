//! A job's bench: the simulated one, with a real driver on a tapped wire.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use plenalign::config::{Config, LBoundSource};
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::control::motion::lease::{LeaseGrant, LeaseRequest};
use plenalign::control::{Service, Shown};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::grbl_controller::GrblDriver;
use plenalign::device::stage::supervisor::Controller;
use plenalign::device::{AxisName, Bench, Stage};
use plenalign::sim::camera::SimulatedCamera;
use plenalign::sim::stage::ControllerTwin;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::truth::Truth;
use plenalign::store::Store;

use super::super::super::bench::{quick_axes, small_config};
use super::super::super::fakes::Hand;
use super::super::super::until::elapse;
use super::super::commands::done;
use super::devices::{Told, Watched};
use super::points::{Point, Points};
use super::wire::{Tapped, Trouble};

/// A job, and what is done before it.
#[derive(Debug, Clone)]
pub(super) struct Case {
    pub(super) name: &'static str,
    pub(super) before: Option<JobKind>,
    pub(super) request: JobRequest,
    /// Whether it measures l_bound on its way, for which it switches a motor off.
    measures_l_bound: bool,
}

/// Every kind of job, each with all of its parts.
pub(super) fn cases() -> Vec<Case> {
    let case = |name, kind| Case { name, before: None, request: JobRequest::of(kind), measures_l_bound: false };
    let after = |before, case| Case { before: Some(before), ..case };
    let cases = vec![
        case("homing", JobKind::Homing),
        Case { measures_l_bound: true, ..case("joint_alignment", JobKind::JointAlignment) },
        case("air_only", JobKind::AirOnly),
        after(JobKind::AirOnly, case("shell_only", JobKind::ShellOnly)),
        Case {
            request: JobRequest { e_mm: Some(12.0), ..JobRequest::of(JobKind::ClarityOnly) },
            ..case("clarity_only", JobKind::ClarityOnly)
        },
        case("l_bound_measurement", JobKind::LBoundMeasurement),
        after(
            JobKind::Homing,
            Case {
                request: JobRequest {
                    axis: Some(AxisName::Focus),
                    from_mm: Some(1.9),
                    to_mm: Some(2.5),
                    steps: Some(4),
                    ..JobRequest::of(JobKind::FocusSweep)
                },
                ..case("focus_sweep", JobKind::FocusSweep)
            },
        ),
        after(
            JobKind::Homing,
            Case {
                request: JobRequest {
                    duration_s: Some(3.0),
                    interval_s: Some(1.0),
                    ..JobRequest::of(JobKind::SpacingWatch)
                },
                ..case("spacing_watch", JobKind::SpacingWatch)
            },
        ),
        after(JobKind::Homing, case("calibration", JobKind::Calibration)),
    ];
    assert!(JobKind::ALL.iter().all(|kind| cases.iter().any(|case| case.request.kind == *kind)), "a kind is missing");
    cases
}

fn config(case: &Case) -> Config {
    let mut config = small_config(1);
    quick_axes(&mut config.bench);
    if case.measures_l_bound {
        config.assembly.l_bound = LBoundSource::Measure;
    }
    config
}

pub(super) fn request(owner: &str) -> LeaseRequest {
    LeaseRequest { owner: owner.to_owned(), note: None, ttl: Duration::from_secs(3600) }
}

/// The bench of one run, with whoever holds its lease.
pub(super) struct Rig {
    pub(super) points: Arc<Points>,
    pub(super) trouble: Arc<Trouble>,
    pub(super) truth: Arc<Truth>,
    pub(super) twin: ControllerTwin,
    pub(super) store: Store,
    pub(super) service: Arc<Service>,
    pub(super) grant: LeaseGrant,
}

impl Rig {
    /// A bench whose axes are quick.
    pub(super) async fn new(case: &Case) -> Self {
        let config = Arc::new(config(case));
        let (truth, points, trouble) = (Truth::new(&config), Arc::<Points>::default(), Arc::<Trouble>::default());
        let firmware = FirmwareConfig::for_axes(&[&config.bench.focus, &config.bench.e]);
        let twin = ControllerTwin::new(GrblFirmware::new(firmware, Arc::clone(&truth) as _));
        let mut axes =
            vec![AxisSetup::new(AxisName::Focus, &config.bench.focus), AxisSetup::new(AxisName::E, &config.bench.e)];
        for axis in &mut axes {
            axis.config.accept_wider_firmware_limits = true;
        }
        let dial = Tapped { dial: twin.dial(), points: Arc::clone(&points), trouble: Arc::clone(&trouble) };
        let controller =
            Controller::start("tapped controller", Box::new(GrblDriver::default()), Arc::new(dial), None, axes);
        controller.first_attempt().await.unwrap();
        let told = |axis| {
            let (stage, points) = (controller.stage(axis).unwrap(), Arc::clone(&points));
            Arc::new(Told { stage, axis, points }) as Arc<dyn Stage>
        };
        let stages = AxisName::ALL.map(told);
        let [focus, e] = stages.clone();
        let camera = SimulatedCamera::new(Arc::clone(&truth), Arc::clone(&focus), Arc::clone(&e));
        let camera =
            Watched { camera, truth: Arc::clone(&truth), stages, points: Arc::clone(&points), seq: AtomicU64::new(0) };
        let simulated = Some(Arc::new(Hand { truth: Arc::clone(&truth), pushes_the_lens: true }) as _);
        let bench = Bench { focus, e, camera: Arc::new(camera), simulated };
        let store = Store::in_memory();
        let service = Service::start(config, "a test's".to_owned(), bench, store.clone());
        service.open_history().await;
        let grant = service.leases().acquire(request("ada")).unwrap();
        Self { points, trouble, truth, twin, store, service, grant }
    }

    /// Where both axes truly stand, mm.
    pub(super) fn places(&self) -> [f64; 2] {
        let pose = self.truth.pose();
        [pose.delta_v_mm, pose.e_mm]
    }

    /// Whether a command has an axis.
    pub(super) fn is_commanded(&self) -> bool {
        AxisName::ALL.into_iter().any(|axis| self.service.is_commanded(axis))
    }

    /// Runs a job to its end, whatever that is; its operator confirms whatever it asks.
    pub(super) async fn run(&self, request: JobRequest) -> Option<JobSnapshot> {
        let permit = self.service.leases().permit(Some(&self.grant.key)).unwrap();
        let id = self.service.create_job(&permit, request).await.ok()?.id;
        let mut confirmed = 0;
        loop {
            let job = self.service.job(id).unwrap();
            if job.state.is_final() {
                done(&self.service).await;
                return Some(job);
            }
            let step = job.operator_step.filter(|_| job.state == JobState::WaitingForOperator);
            if let Some(step) = step.filter(|step| step.number > confirmed) {
                confirmed = step.number;
                self.points.pass(Point::Prompted);
                // The point may have been its end.
                let shown = Shown { lease: Some(&self.grant.key), confirm: None };
                let _ = self.service.confirm(id, step.number, shown).await;
            }
            elapse(Duration::from_millis(20)).await;
        }
    }

    /// What comes before the job, to its end as it should be.
    pub(super) async fn prepare(&self, case: &Case) {
        if let Some(kind) = case.before {
            let job = self.run(JobRequest::of(kind)).await.unwrap();
            assert!(matches!(job.state, JobState::Converged | JobState::Succeeded), "{kind:?}: {:?}", job.reason);
        }
    }
}
