//! Controllers that do not obey a stop: what comes after it, and what is believed then.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use plenalign::config::ControllerDriver;
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::plant::Plant;
use plenalign::sim::stage::drive::DriveConfig;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::pi::PiFirmware;
use plenalign::sim::stage::thorlabs::ThorlabsFirmware;
use plenalign::sim::stage::tmcl::TmclFirmware;
use plenalign::sim::stage::zaber::ZaberFirmware;
use plenalign::sim::stage::{ControllerTwin, Protocol};
use plenalign::units::Millimetres;
use tokio::time::Instant;

use super::super::until::elapse;
use super::kit::{Behind, Kit, every_protocol, near};

every_protocol!(a_stop_that_is_not_obeyed_is_followed_by_a_harder_one);

/// For how long a stop is not heard: longer than any driver waits for 5 mm/s to end at 20 mm/s².
fn deaf(driver: Protocol) -> Duration {
    // Grbl carries out what it has buffered first, and two of its reports are waited for.
    Duration::from_millis(if driver.driver() == ControllerDriver::Grbl { 900 } else { 500 })
}
/// Grbl's orders that hold and that end a jog, and PI's that stops all axes.
const HOLD: u8 = b'!';
const JOG_CANCEL: u8 = 0x85;
const STOP_ALL: u8 = 24;
/// Bytes of a TMCL command, and the number of the one that stops a motor.
const TMCL_LENGTH: usize = 9;
const MOTOR_STOP: u8 = 3;
/// What a Thorlabs message that stops a motor along its ramp begins with.
const THORLABS_STOP: [u8; 4] = [0x65, 0x04, 1, 2];

/// What hears no soft stop for a while, once it is told to be so.
struct Stubborn {
    driver: Protocol,
    armed: Arc<AtomicBool>,
    since: Option<Instant>,
    /// The command that is being received, where commands have more than a byte.
    command: Vec<u8>,
}

impl Stubborn {
    fn twin(kit: &Kit, armed: &Arc<AtomicBool>) -> ControllerTwin {
        let axes = [&kit.bench.focus, &kit.bench.e];
        let drives = axes.iter().map(|axis| DriveConfig::of(axis)).collect();
        let plant: Arc<dyn Plant> = kit.slides.clone();
        let firmware = match kit.driver {
            Protocol::Grbl => Behind::new(GrblFirmware::new(FirmwareConfig::for_axes(&axes), plant)),
            Protocol::GrblHal => Behind::new(GrblFirmware::new(FirmwareConfig::grblhal(&axes), plant)),
            Protocol::FluidNc => Behind::new(GrblFirmware::new(FirmwareConfig::fluidnc(&axes), plant)),
            Protocol::Zaber => Behind::new(ZaberFirmware::new(drives, &plant)),
            Protocol::Pi => Behind::new(PiFirmware::new(drives, &plant)),
            Protocol::Tmcl => Behind::new(TmclFirmware::new(drives, &plant)),
            Protocol::Thorlabs => Behind::new(ThorlabsFirmware::of(drives, &plant)),
        };
        let mut ears = Self { driver: kit.driver, armed: Arc::clone(armed), since: None, command: Vec::new() };
        ControllerTwin::new(Behind { hears: Box::new(move |byte| ears.hear(byte)), ..firmware })
    }

    fn ignores_stops(&mut self) -> bool {
        self.armed.load(Ordering::SeqCst) && self.since.get_or_insert_with(Instant::now).elapsed() < deaf(self.driver)
    }

    /// What is heard of a byte: nothing before its command is whole.
    fn hear(&mut self, byte: u8) -> Vec<u8> {
        self.command.push(byte);
        let (whole, stops) = match self.driver {
            Protocol::Grbl | Protocol::GrblHal | Protocol::FluidNc => (true, byte == HOLD || byte == JOG_CANCEL),
            Protocol::Pi => (true, byte == STOP_ALL),
            // `estop` has no blank before its `stop`.
            Protocol::Zaber => (byte == b'\n', String::from_utf8_lossy(&self.command).contains(" stop")),
            Protocol::Tmcl => (self.command.len() == TMCL_LENGTH, self.command.get(1) == Some(&MOTOR_STOP)),
            Protocol::Thorlabs => {
                let (data, length) = (self.command.get(4).is_some_and(|dest| dest & 0x80 != 0), self.command.get(2));
                let length = 6 + if data { usize::from(*length.unwrap_or(&0)) } else { 0 };
                (self.command.len() >= length, self.command.get(..4) == Some(&THORLABS_STOP))
            }
        };
        if !whole {
            return Vec::new();
        }
        let command = std::mem::take(&mut self.command);
        if stops && self.ignores_stops() { Vec::new() } else { command }
    }
}

async fn a_stop_that_is_not_obeyed_is_followed_by_a_harder_one(driver: Protocol) {
    let mut kit = Kit::new(driver);
    let armed = Arc::new(AtomicBool::new(false));
    kit.twin = Stubborn::twin(&kit, &armed);
    let rig = kit.connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    rig.e.home(rig.e.generation()).await.unwrap();
    let mover = rig.e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
    elapse(Duration::from_secs(1)).await;
    armed.store(true, Ordering::SeqCst);
    let asked = Instant::now();
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    let took = asked.elapsed();
    assert!(took > deaf(driver).min(Duration::from_millis(400)) && took < Duration::from_millis(2500), "{took:?}");
    let stands = rig.slides.at(1);
    assert!(stands > 10.0, "it is stopped on its way: {stands}");
    assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    elapse(Duration::from_secs(5)).await;
    assert_eq!(rig.slides.at(1), stands, "it stands");
    // Steps may have been lost: no axis's position is believed.
    for stage in [&rig.focus, &rig.e] {
        assert!(!stage.read_state().await.unwrap().homed);
        let refused = stage.move_to(Millimetres(1.0), stage.generation()).await.unwrap_err();
        assert!(matches!(refused, DeviceError::NotHomed { .. } | DeviceError::Alarm { .. }), "{refused}");
    }
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004), "{}", rig.slides.at(1));
}
