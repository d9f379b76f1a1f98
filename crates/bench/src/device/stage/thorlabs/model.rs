//! Which controllers are known, and what their numbers are: speeds and accelerations are counted in units that depend on
//! what kind of motor a controller drives.

use super::Message;

/// Time between two cycles of a servo controller's loop, s.
const SERVO_CYCLE_S: f64 = 2048.0 / 6e6;
/// A servo's speeds and accelerations are counted in so many parts.
const SERVO_PARTS: f64 = 65_536.0;
/// A stepper's speeds are counted in so many parts of a microstep a second.
const STEPPER_SPEED: f64 = 53.68;
/// A stepper's accelerations, in parts of its speeds.
const STEPPER_ACCELERATION: f64 = 204.94e-6;

/// What a controller drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motor {
    /// A brushed direct-current motor with an encoder, in a closed loop: positions are counts of the encoder.
    Servo,
    /// A stepper motor: positions are microsteps, 2048 a full step.
    Stepper,
}

impl Motor {
    /// A controller's number for a speed, mm/s, of an axis with so many units of position a millimetre.
    #[must_use]
    pub fn speed(self, mm_per_s: f64, units_per_mm: f64) -> f64 {
        mm_per_s * units_per_mm * self.speed_scale()
    }

    /// The speed, mm/s, that a controller's number means.
    #[must_use]
    pub fn speed_mm_per_s(self, number: f64, units_per_mm: f64) -> f64 {
        number / (units_per_mm * self.speed_scale())
    }

    /// A controller's number for an acceleration, mm/s².
    #[must_use]
    pub fn acceleration(self, mm_per_s2: f64, units_per_mm: f64) -> f64 {
        let scale = match self {
            Self::Servo => SERVO_CYCLE_S * SERVO_CYCLE_S * SERVO_PARTS,
            Self::Stepper => STEPPER_SPEED * STEPPER_ACCELERATION,
        };
        mm_per_s2 * units_per_mm * scale
    }

    const fn speed_scale(self) -> f64 {
        match self {
            Self::Servo => SERVO_CYCLE_S * SERVO_PARTS,
            Self::Stepper => STEPPER_SPEED,
        }
    }
}

/// A kind of controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// What it calls itself.
    pub name: &'static str,
    /// What it drives.
    pub motor: Motor,
    /// Whether each of its motors is on a board in a bay, with an address of its own.
    pub has_bays: bool,
}

/// The controllers whose numbers are known here.
pub const MODELS: &[Model] = &[
    Model { name: "KDC101", motor: Motor::Servo, has_bays: false },
    Model { name: "TDC001", motor: Motor::Servo, has_bays: false },
    Model { name: "KST101", motor: Motor::Stepper, has_bays: false },
    Model { name: "KST201", motor: Motor::Stepper, has_bays: false },
    Model { name: "TST101", motor: Motor::Stepper, has_bays: false },
    Model { name: "BSC201", motor: Motor::Stepper, has_bays: true },
    Model { name: "BSC202", motor: Motor::Stepper, has_bays: true },
    Model { name: "BSC203", motor: Motor::Stepper, has_bays: true },
];

/// Their names, in words.
#[must_use]
pub fn known_models() -> String {
    MODELS.iter().map(|model| model.name).collect::<Vec<_>>().join(", ")
}

/// What a controller says it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Info {
    /// Its model's name.
    pub name: String,
    /// Its serial number.
    pub serial: u32,
    /// Its firmware's version: major, interim, minor.
    pub firmware: [u8; 3],
}

impl Info {
    /// Out of the answer to the question what a unit is.
    #[must_use]
    pub fn read(answer: &Message) -> Option<Self> {
        let data = answer.data();
        let name: String = data
            .get(4..12)?
            .iter()
            .take_while(|&&byte| byte != 0)
            .map(|&byte| if byte.is_ascii_graphic() { char::from(byte) } else { ' ' })
            .collect();
        let [minor, interim, major] = data.get(14..17)?.try_into().ok()?;
        let serial = answer.long(0)? as u32;
        Some(Self { name: name.trim().to_owned(), serial, firmware: [major, interim, minor] })
    }

    /// The model, where it is a known one: a name may have a variant's letters behind it.
    #[must_use]
    pub fn model(&self) -> Option<&'static Model> {
        MODELS.iter().find(|model| self.name.starts_with(model.name))
    }
}

impl std::fmt::Display for Info {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [major, interim, minor] = self.firmware;
        write!(f, "Thorlabs {}, serial number {}, firmware {major}.{interim}.{minor}", self.name, self.serial)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::stage::thorlabs::{Body, HOST, USB_UNIT};

    #[test]
    fn speeds_and_accelerations_are_the_documents() {
        // Thorlabs' table of conversions: units a millimetre (a degree), and the numbers for 1 mm/s and 1 mm/s².
        for (motor, units, speed, acceleration) in [
            (Motor::Servo, 34_304.0, 767_367.49, 261.93),
            (Motor::Servo, 1_919.64, 42_941.66, 14.66),
            (Motor::Stepper, 409_600.0, 21_987_328.0, 4506.0),
            (Motor::Stepper, 2_008_645.63, 107_824_097.5, 22_097.3),
        ] {
            let close = |found: f64, published: f64| (found / published - 1.0).abs() < 4e-4;
            assert!(close(motor.speed(1.0, units), speed), "{motor:?}: {}", motor.speed(1.0, units));
            let found = motor.acceleration(1.0, units);
            assert!(close(found, acceleration), "{motor:?}: {found}");
            assert!((motor.speed_mm_per_s(motor.speed(2.5, units), units) - 2.5).abs() < 1e-12);
        }
    }

    #[test]
    fn a_controller_is_what_it_says() {
        let mut data = vec![0u8; 84];
        data[..4].copy_from_slice(&27_250_417u32.to_le_bytes());
        data[4..10].copy_from_slice(b"KDC101");
        data[14..17].copy_from_slice(&[9, 1, 2]);
        let answer = Message { id: 6, dest: HOST, source: USB_UNIT, body: Body::Data(data) };
        let info = Info::read(&answer).unwrap();
        assert_eq!(info.to_string(), "Thorlabs KDC101, serial number 27250417, firmware 2.1.9");
        assert_eq!(info.model().map(|model| model.motor), Some(Motor::Servo));
        let other = |name: &str| Info { name: name.to_owned(), ..info.clone() };
        assert_eq!(other("BSC203").model().map(|model| model.has_bays), Some(true));
        // The same family, with speeds in other units.
        assert_eq!(other("BSC103").model(), None);
        assert_eq!(Info::read(&Message { body: Body::Data(vec![0; 5]), ..answer }), None);
    }
}
