//! What a controller is set to, against the configuration, when it is connected.

use std::sync::atomic::AtomicBool;

use super::{Axis, ThorlabsDialogue, quiet};
use crate::device::DeviceError;
use crate::device::stage::axis::AxisSetup;
use crate::device::stage::session::AxisFacts;
use crate::device::stage::thorlabs::model::Motor;
use crate::device::stage::thorlabs::{Body, CHANNEL, FIRST_BAY, MAIN_BOARD, Message, USB_UNIT, id};

/// What the parameters of homing name: a direction, and the switch that ends it.
const FORWARD: u16 = 1;
const REVERSE: u16 = 2;
const REVERSE_SWITCH: u16 = 1;
const FORWARD_SWITCH: u16 = 4;
/// Whether a limit switch stops the motor: what is said of it without the bit that says that the two are swapped.
const SWAPPED: u16 = 0x80;
const STOPS: [u16; 2] = [2, 3];
/// Whether the limits in numbers are in force: the ways in which they stop.
const IN_FORCE: [u16; 2] = [2, 3];
/// Homing is given ten times what the travel takes at the axis's own speed: a slower one may not end in time.
const SLOW: f64 = 0.15;
/// What rounding may add to a speed.
const FAST: f64 = 1.01;

/// The bay of an axis, counted from 0, where its name is one that a controller can have.
pub(super) fn bay(setup: &AxisSetup) -> Option<u8> {
    let number = setup.config.axis.parse::<u8>().ok()?;
    (1..=3).contains(&number).then(|| number - 1)
}

impl ThorlabsDialogue {
    /// The address of an axis's unit.
    pub(super) async fn unit(&self, setup: &AxisSetup) -> Result<u8, DeviceError> {
        let (name, model) = (&setup.config.axis, self.model.name);
        let refused = |reason: String| DeviceError::Refused { device: self.exchange.name.clone(), reason };
        match (bay(setup), self.model.has_bays) {
            (Some(0), false) => Ok(USB_UNIT),
            (_, false) => Err(refused(format!(
                "a {model} has one channel, `1`, and not `{name}`; a second axis needs a controller of its own"
            ))),
            (None, true) => Err(refused(format!("it has no axis `{name}`; a {model}'s bays are 1 to 3"))),
            (Some(bay), true) => {
                let mut turn = self.turn.lock().await;
                let answer = self.ask(&mut turn, MAIN_BOARD, "tell of its bays", id::REQ_BAY_USED, bay).await?;
                match answer.body {
                    Body::Short(_, 1) => Ok(FIRST_BAY + bay),
                    _ => Err(refused(format!("its bay {name} is empty; see bench.{}.axis", setup.axis))),
                }
            }
        }
    }

    /// Stops what a unit does, and what it says by itself, and sees that it answers.
    pub(super) async fn settle(&self, unit: u8) -> Result<(), DeviceError> {
        let bytes = [Message::short(id::NO_FLASH_PROGRAMMING, unit, 0, 0).bytes(), quiet(unit)].concat();
        self.exchange.port.urgent(&bytes, false).map_err(|error| self.exchange.error("stop", error))?;
        let mut turn = self.turn.lock().await;
        self.whole(&mut turn, unit).await.map(drop)
    }

    /// An axis's settings against its configuration.
    pub(super) async fn learn(&self, setup: &AxisSetup, unit: u8) -> Result<Axis, DeviceError> {
        let (axis, config, motor) = (setup.axis, &setup.config, self.model.motor);
        let scale = config.steps_per_mm;
        let mut turn = self.turn.lock().await;
        let homing = self.ask(&mut turn, unit, "tell how it homes", id::REQ_HOMING, CHANNEL).await?;
        let ends = self.ask(&mut turn, unit, "tell its limits", id::REQ_LIMITS, CHANNEL).await?;
        let (_, bits) = self.whole(&mut turn, unit).await?;
        let mut facts = AxisFacts {
            // A speed is a number of 32 bits.
            speed_mm_per_s: config.speed_mm_per_s.min(motor.speed_mm_per_s(f64::from(i32::MAX), scale)),
            acceleration_mm_per_s2: config.acceleration_mm_per_s2,
            ..AxisFacts::default()
        };
        facts.contradictions.extend(homes_elsewhere(setup, &homing));
        let speed = motor.speed_mm_per_s(f64::from(homing.long(6).unwrap_or_default()), scale);
        if speed < SLOW * config.speed_mm_per_s {
            facts.disagreements.push(format!(
                "The controller homes the {axis} axis at {speed:.3} mm/s (home parameters), which may take longer than \
                 homing is given; set its homing velocity in Thorlabs' own program."
            ));
        }
        if speed > FAST * config.speed_mm_per_s {
            facts.disagreements.push(format!(
                "The controller homes the {axis} axis at {speed:.3} mm/s (home parameters), faster than \
                 bench.{axis}.speed_mm_per_s ({}).",
                config.speed_mm_per_s
            ));
        }
        for (at, name) in [(2, "CW"), (4, "CCW")] {
            let kind = ends.word(at).unwrap_or_default() & !SWAPPED;
            if !STOPS.contains(&kind) {
                facts.disagreements.push(format!(
                    "The {name} limit switch of the {axis} axis stops nothing (limit switch parameters: {kind})."
                ));
            }
        }
        if motor == Motor::Servo && !bits.connected() {
            facts.disagreements.push(format!("The controller sees no motor of the {axis} axis (its status bits)."));
        }
        let mode = ends.word(14).unwrap_or_default() & !SWAPPED;
        let limits = IN_FORCE.contains(&mode).then(|| {
            let [a, b] = [6, 10].map(|at| f64::from(ends.long(at).unwrap_or_default()) / scale);
            (a.min(b), a.max(b))
        });
        if let Some(limits) = limits {
            // Homing makes the place where it ends the zero that they count from.
            let (low, high) = setup.range(limits, 0.0);
            facts.limits_mm = Some((low, high));
            facts.note(setup.compare_limits(low, high));
        }
        Ok(Axis { unit, scale, facts, limits, setup: setup.clone(), seen_homed: AtomicBool::new(false) })
    }
}

/// Where the parameters of homing would take the axis elsewhere than the configuration says: a sentence.
pub(super) fn homes_elsewhere(setup: &AxisSetup, homing: &Message) -> Option<String> {
    let (direction, switch) = (homing.word(2).unwrap_or_default(), homing.word(4).unwrap_or_default());
    let axis = setup.axis;
    let (words, negative) = match (direction, switch) {
        (FORWARD, FORWARD_SWITCH) => ("to its forward limit switch", false),
        (REVERSE, REVERSE_SWITCH) => ("to its reverse limit switch", true),
        _ => {
            return Some(format!(
                "How the controller homes the {axis} axis cannot be told: its home parameters are direction {direction} \
                 and limit switch {switch}, where 1 and 4 (forward) or 2 and 1 (reverse) belong together."
            ));
        }
    };
    (negative != setup.homes_negative()).then(|| {
        format!(
            "The controller homes the {axis} axis {words} (home parameters), the configuration says the other end; set \
             the home direction in Thorlabs' own program, or `home_side` and `reversed` in [bench.{axis}] as the stage \
             is mounted."
        )
    })
}
