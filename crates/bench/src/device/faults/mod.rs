//! What can be made to go wrong with a simulated bench, for whoever wants to see what then happens.

mod plan;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use plan::{FaultEvent, FaultPlan, PlanError, Plannable};

use super::AxisName;
use crate::whole::whole;

/// Everything that goes wrong with a simulated bench at a time. By default nothing; what is not named goes right.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Faults {
    /// The stages' controller, and the wire to it.
    pub serial: SerialFaults,
    /// The focus axis.
    pub focus: AxisFaults,
    /// The e axis.
    pub e: AxisFaults,
    /// The camera.
    pub camera: CameraFaults,
    /// What stands before the camera.
    pub scene: SceneFaults,
    /// The disk that the history is written to.
    pub disk: DiskFaults,
}

/// What goes wrong between the program and the stages' controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SerialFaults {
    /// The adapter is unplugged.
    pub unplugged: bool,
    /// The controller is without power, while its adapter stays. With the power back it knows no place any more.
    pub unpowered: bool,
    /// How late what the controller says arrives, ms.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 5000)]
    pub delay_ms: u16,
    /// One byte in this many that the controller says is lost; 0 for none.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 1_000_000)]
    pub lost_one_in: u32,
    /// One byte in this many that the controller says arrives as another; 0 for none.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 1_000_000)]
    pub garbled_one_in: u32,
}

/// What goes wrong with an axis.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AxisFaults {
    /// The motor stands still whatever steps it is given; the controller does not know.
    pub stalled: bool,
    /// Share of every way that the screw slips.
    #[schema(minimum = 0, maximum = 1)]
    pub slip_share: f64,
    /// Play on reversal, beside the configured one, mm.
    #[schema(minimum = 0, maximum = 5)]
    pub backlash_mm: f64,
    /// By how much the play grows at every reversal, mm.
    #[schema(minimum = 0, maximum = 1)]
    pub backlash_growth_mm: f64,
    /// How long the carriage creeps after the motor, ms: the controller says "stopped" and it is not true.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 5000)]
    pub stops_late_ms: u16,
    /// Its switches are closed, wherever it stands.
    pub limit_switch: bool,
}

/// What goes wrong with the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CameraFaults {
    /// The camera is unplugged.
    pub unplugged: bool,
    /// Its driver gives the same picture again and again, as if it were new.
    pub frozen: bool,
    /// What is wrong with its pictures.
    pub picture: PictureFault,
}

/// What is wrong with a camera's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PictureFault {
    /// Nothing.
    #[default]
    None,
    /// Hardly any light falls on the sensor.
    Dark,
    /// There is more light than the sensor can take.
    Saturated,
    /// Everything is blurred within the micro-images.
    Blurred,
    /// A part of the data was lost on the way: what comes after it is out of place.
    Torn,
}

/// What is wrong with what stands before the camera.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneFaults {
    /// Bubbles in the field, instead of as many as are configured.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 500)]
    pub bubbles: u16,
    /// The tank has no water in it: there is air beyond the shell.
    pub tank_empty: bool,
    /// How much farther away the boards are than where they should be, mm.
    #[schema(minimum = -300, maximum = 1000)]
    pub board_displaced_mm: f64,
    /// By how much the boards are turned about their upright, mrad.
    #[schema(minimum = -300, maximum = 300)]
    pub board_turned_mrad: f64,
    /// How far before a flat board another stands that fills half of the field, mm; 0 where there is none.
    #[schema(minimum = 0, maximum = 300)]
    pub second_board_mm: f64,
    /// There is no shell: a flat window stands in the place of its vertex.
    pub no_shell: bool,
    /// By how much the shell's radii are larger than they should be, mm; its vertex is in its place.
    #[schema(minimum = -20, maximum = 200)]
    pub shell_radius_mm: f64,
}

/// What goes wrong with the disk that the history is written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DiskFaults {
    /// Nothing more can be written.
    pub full: bool,
    /// How much longer than it should everything takes that is written, ms of real time.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 0, maximum = 5000)]
    pub delay_ms: u16,
}

/// A fault that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{value} is not within {low} to {high}")]
pub struct FaultRange {
    /// Which, as a path.
    pub field: &'static str,
    /// What was asked for.
    pub value: f64,
    /// Least.
    pub low: f64,
    /// Greatest.
    pub high: f64,
}

impl Faults {
    /// The faults of an axis.
    #[must_use]
    pub const fn axis(&self, axis: AxisName) -> &AxisFaults {
        match axis {
            AxisName::Focus => &self.focus,
            AxisName::E => &self.e,
        }
    }

    /// Whether anything goes wrong.
    #[must_use]
    pub fn any(&self) -> bool {
        *self != Self::default()
    }
}

impl Plannable for Faults {
    fn check(&self) -> Result<(), FaultRange> {
        let one_in = 1e6;
        for (field, value, low, high) in [
            ("serial.delay_ms", f64::from(self.serial.delay_ms), 0.0, 5000.0),
            ("serial.lost_one_in", f64::from(self.serial.lost_one_in), 0.0, one_in),
            ("serial.garbled_one_in", f64::from(self.serial.garbled_one_in), 0.0, one_in),
            ("focus.slip_share", self.focus.slip_share, 0.0, 1.0),
            ("focus.backlash_mm", self.focus.backlash_mm, 0.0, 5.0),
            ("focus.backlash_growth_mm", self.focus.backlash_growth_mm, 0.0, 1.0),
            ("focus.stops_late_ms", f64::from(self.focus.stops_late_ms), 0.0, 5000.0),
            ("e.slip_share", self.e.slip_share, 0.0, 1.0),
            ("e.backlash_mm", self.e.backlash_mm, 0.0, 5.0),
            ("e.backlash_growth_mm", self.e.backlash_growth_mm, 0.0, 1.0),
            ("e.stops_late_ms", f64::from(self.e.stops_late_ms), 0.0, 5000.0),
            ("scene.bubbles", f64::from(self.scene.bubbles), 0.0, 500.0),
            ("scene.board_displaced_mm", self.scene.board_displaced_mm, -300.0, 1000.0),
            ("scene.board_turned_mrad", self.scene.board_turned_mrad, -300.0, 300.0),
            ("scene.second_board_mm", self.scene.second_board_mm, 0.0, 300.0),
            ("scene.shell_radius_mm", self.scene.shell_radius_mm, -20.0, 200.0),
            ("disk.delay_ms", f64::from(self.disk.delay_ms), 0.0, 5000.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(FaultRange { field, value, low, high });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_named() {
        assert_eq!(Faults::default().check(), Ok(()));
        let mut faults = Faults::default();
        faults.e.slip_share = 1.5;
        assert_eq!(faults.check().map_err(|fault| fault.field), Err("e.slip_share"));
        faults.e.slip_share = f64::NAN;
        assert!(faults.check().is_err() && faults.any());
    }

    #[test]
    fn what_is_not_named_goes_right() {
        let faults: Faults = serde_json::from_str(r#"{"camera": {"picture": "dark"}}"#).unwrap();
        assert_eq!(faults.camera.picture, PictureFault::Dark);
        assert_eq!(Faults { camera: CameraFaults::default(), ..faults }, Faults::default());
        assert!(serde_json::from_str::<Faults>(r#"{"camera": {"pictures": "dark"}}"#).is_err());
        let faults: Faults = serde_json::from_str(r#"{"serial": {"lost_one_in": 6518.0}}"#).unwrap();
        assert_eq!(faults.serial.lost_one_in, 6518);
    }
}
