//! The bench below the daemon: a controller twin with its wire tapped, the true places of both axes, and what can go
//! wrong. It outlives the daemons that are started on it, as a real controller does.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use plenalign::config::{Config, ControllerConfig, ControllerDriver, Side};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::supervisor::Controller;
use plenalign::device::{AxisName, Bench, Stage, open};
use plenalign::sim::camera::SimulatedCamera;
use plenalign::sim::plant::Plant;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::line::Line;
use plenalign::sim::stage::{ControllerTwin, firmware};
use plenalign::sim::truth::Truth;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::super::fakes::Hand;
use super::super::stages::kit::suit;
use super::wire::Tapped;

/// Where the e axis stands beyond the simulated start, mm: clear of a home switch on the shell's side.
const CLEAR_OF_SWITCH_MM: f64 = 15.0;

/// What a daemon told the controller to move, or the place that an axis came to.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Seen {
    /// An order that begins a motion went out.
    Order { axis: AxisName, homing: bool, line: String },
    /// An axis stands elsewhere than before, true coordinate, mm.
    Moved { axis: AxisName, at_mm: f64 },
}

/// Everything seen below the daemon, in order.
#[derive(Default)]
pub(super) struct Record {
    seen: Mutex<Vec<(Instant, Seen)>>,
}

impl Record {
    fn lock(&self) -> MutexGuard<'_, Vec<(Instant, Seen)>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn note(&self, seen: Seen) {
        self.lock().push((Instant::now(), seen));
    }

    /// How much has been seen so far.
    pub(super) fn len(&self) -> usize {
        self.lock().len()
    }

    /// What has been seen since so much had been.
    pub(super) fn since(&self, index: usize) -> Vec<(Instant, Seen)> {
        self.lock()[index..].to_vec()
    }

    /// Whether an axis has moved within the last moments.
    pub(super) fn moves(&self, axis: AxisName) -> bool {
        let fresh = Instant::now() - Duration::from_millis(15);
        let seen = self.lock();
        let recent = seen.iter().rev().take_while(|(at, _)| *at >= fresh);
        recent.into_iter().any(|(_, seen)| matches!(seen, Seen::Moved { axis: moved, .. } if *moved == axis))
    }
}

/// The simulated mechanics, watched.
struct Watched {
    truth: Arc<Truth>,
    record: Arc<Record>,
    /// Where each axis stood last, true coordinate, mm.
    last_mm: Mutex<[f64; 2]>,
    /// Where the motors had been turned to before power-up, mm.
    turned_mm: [f64; 2],
}

fn places(truth: &Truth) -> [f64; 2] {
    let pose = truth.pose();
    [pose.delta_v_mm, pose.e_mm]
}

impl Plant for Watched {
    fn motor_moved(&self, axis: usize, position_mm: f64) {
        self.truth.motor_moved(axis, position_mm + self.turned_mm.get(axis).unwrap_or(&0.0));
        let now = places(&self.truth);
        let mut last = self.last_mm.lock().unwrap_or_else(PoisonError::into_inner);
        for (index, name) in AxisName::ALL.into_iter().enumerate() {
            if (now[index] - last[index]).abs() > 1e-9 {
                self.record.note(Seen::Moved { axis: name, at_mm: now[index] });
            }
        }
        *last = now;
    }

    fn home_switch_closed(&self, axis: usize) -> bool {
        self.truth.home_switch_closed(axis)
    }

    fn limit_switch_closed(&self, axis: usize) -> bool {
        self.truth.limit_switch_closed(axis)
    }
}

/// What is done to the bench behind the daemon's back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Trouble {
    Unplug,
    PlugIn,
    PowerCycle,
    Late(u16),
    InTime,
}

/// The bench below the daemon.
pub(super) struct Rig {
    pub(super) driver: ControllerDriver,
    pub(super) config: Arc<Config>,
    pub(super) record: Arc<Record>,
    truth: Arc<Truth>,
    twin: ControllerTwin,
}

impl Rig {
    /// A bench whose true places are what its controller counts, and which homes quickly: what is tried here is who may
    /// move what, and not how well. `low` has the e axis home towards the shell.
    pub(super) fn new(seed: u64, low: bool, driver: ControllerDriver) -> Self {
        let mut config = super::super::bench::small_config(seed);
        (config.sensor.width_px, config.sensor.height_px) = (160, 160);
        let simulation = &mut config.bench.simulation;
        (simulation.rays, simulation.operator_confirms) = (1, false);
        (simulation.focus_scale_error, simulation.e_scale_error) = (0.0, 0.0);
        (simulation.focus_backlash_mm, simulation.e_backlash_mm) = (0.0, 0.0);
        if low {
            (config.bench.e.home_side, config.bench.e.home_position_mm) = (Side::Low, 3.0);
        }
        suit(driver, &mut config.bench);
        let config = Arc::new(config);
        let (truth, record) = (Truth::new(&config), Arc::<Record>::default());
        let turned_mm = [0.0, if low { CLEAR_OF_SWITCH_MM } else { 0.0 }];
        truth.motor_moved(1, turned_mm[1]);
        let last_mm = Mutex::new(places(&truth));
        let watched = Watched { truth: Arc::clone(&truth), record: Arc::clone(&record), last_mm, turned_mm };
        let (axes, plant) = ([&config.bench.focus, &config.bench.e], Arc::new(watched));
        let twin = if driver == ControllerDriver::Grbl {
            let mut settings = FirmwareConfig::for_axes(&axes);
            (settings.seek_rate_mm_per_min, settings.locate_rate_mm_per_min) = (1200.0, 240.0);
            ControllerTwin::new(GrblFirmware::new(settings, plant))
        } else {
            firmware(driver, &axes, plant)
        };
        Self { driver, config, record, truth, twin }
    }

    /// The devices as one daemon has them, until they are cut.
    pub(super) async fn open(&self, cut: &CancellationToken) -> Bench {
        let mut axes = vec![
            AxisSetup::new(AxisName::Focus, &self.config.bench.focus),
            AxisSetup::new(AxisName::E, &self.config.bench.e),
        ];
        for axis in &mut axes {
            axis.config.accept_wider_firmware_limits = true;
        }
        let (driver, record, cut) = (self.driver, Arc::clone(&self.record), cut.clone());
        let dial = Arc::new(Tapped { driver, dial: self.twin.dial(), record, cut });
        let config = ControllerConfig { driver, port: "/dev/null".into(), baud: None, identity: None, address: 1 };
        let controller = Controller::start("tapped controller", open::driver(&config), dial, None, axes);
        // A controller that is not there now comes later.
        let _ = controller.first_attempt().await;
        let stage = |axis| Arc::new(controller.stage(axis).unwrap()) as Arc<dyn Stage>;
        let (focus, e) = (stage(AxisName::Focus), stage(AxisName::E));
        let camera = SimulatedCamera::new(Arc::clone(&self.truth), Arc::clone(&focus), Arc::clone(&e));
        // Nobody pushes the lens about: each motion that is seen is the controller's.
        let hand = Hand { truth: Arc::clone(&self.truth), pushes_the_lens: false };
        Bench { focus, e, camera: Arc::new(camera), simulated: Some(Arc::new(hand)) }
    }

    /// Where an axis truly stands, mm.
    pub(super) fn place_mm(&self, axis: AxisName) -> f64 {
        let [focus, e] = places(&self.truth);
        if axis == AxisName::Focus { focus } else { e }
    }

    /// Makes something go wrong, or right again.
    pub(super) fn suffer(&self, trouble: Trouble) {
        match trouble {
            Trouble::Unplug => self.twin.unplug(),
            Trouble::PlugIn => self.twin.plug_in(),
            Trouble::PowerCycle => self.twin.power_cycle(),
            Trouble::Late(ms) => {
                self.twin.set_line(Line { delay: Duration::from_millis(ms.into()), ..Line::default() });
            }
            Trouble::InTime => self.twin.set_line(Line::default()),
        }
    }
}
