//! `[bench]`: stages, camera and limits.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{CameraConfig, SimulationConfig};

/// Whether the bench is real.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BenchDriver {
    /// Twins of stages and camera; loud about it everywhere, and never a fallback for missing hardware.
    Simulated,
    /// Stages over serial and a camera over V4L2.
    Hardware,
}

/// `[bench]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchConfig {
    /// Simulated or hardware.
    pub driver: BenchDriver,
    /// Stage controllers by name (hardware only).
    pub controllers: BTreeMap<String, ControllerConfig>,
    /// The focus axis. Its coordinate is Δv: 0 at the air design's image distance, positive away from the lens.
    pub focus: AxisConfig,
    /// The e axis. Its coordinate is e: positive away from the shell.
    pub e: AxisConfig,
    /// The camera.
    pub camera: CameraConfig,
    /// The simulated bench's truth (simulated only).
    pub simulation: SimulationConfig,
}

impl Default for BenchConfig {
    fn default() -> Self {
        Self {
            driver: BenchDriver::Simulated,
            controllers: BTreeMap::new(),
            focus: AxisConfig {
                controller: "main".to_owned(),
                axis: "X".to_owned(),
                low_limit_mm: -2.0,
                high_limit_mm: 5.0,
                home_side: Side::Low,
                home_position_mm: 0.0,
                speed_mm_per_s: 2.0,
                approach: Side::Low,
                ..AxisConfig::default()
            },
            e: AxisConfig {
                controller: "main".to_owned(),
                axis: "Y".to_owned(),
                low_limit_mm: -5.0,
                high_limit_mm: 32.0,
                home_side: Side::High,
                home_position_mm: 30.0,
                speed_mm_per_s: 5.0,
                approach: Side::High,
                ..AxisConfig::default()
            },
            camera: CameraConfig::default(),
            simulation: SimulationConfig::default(),
        }
    }
}

impl BenchConfig {
    /// The simulated bench's name.
    pub const SIMULATED: &str = "simulated";

    /// A name for the bench, fit for a file's: `simulated`, or what its serial ports are called by `call`; `None` where one
    /// of them has no such name.
    #[must_use]
    pub fn name_by(&self, call: impl Fn(&Path) -> Option<String>) -> Option<String> {
        match self.driver {
            BenchDriver::Simulated => Some(Self::SIMULATED.to_owned()),
            BenchDriver::Hardware => {
                let mut ports: Vec<String> =
                    self.controllers.values().map(|controller| call(&controller.port)).collect::<Option<_>>()?;
                ports.sort();
                Some(ports.join("+").chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect())
            }
        }
    }
}

/// Which protocol a stage controller speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ControllerDriver {
    /// Grbl 1.1, grblHAL and FluidNC.
    Grbl,
    /// Zaber's ASCII protocol.
    Zaber,
    /// PI's General Command Set 2.
    Pi,
    /// Trinamic's TMCL.
    Tmcl,
    /// Thorlabs' APT protocol.
    Thorlabs,
}

/// What is known of a protocol before anything is connected: all that the configuration has to be told of a driver.
struct Traits {
    /// The word used in configuration and on the command line.
    name: &'static str,
    /// The baud rate that its controllers leave the factory with.
    usual_baud: u32,
    /// Whether its port needs the handshake of RTS and CTS.
    handshake: bool,
    /// Whether a controller can have an axis of this name.
    has_axis: fn(&str) -> bool,
    /// Which it can have, in words.
    axes: &'static str,
    /// The first two of them.
    first_axes: [&'static str; 2],
    /// Its units a millimetre, where it counts in a unit of length.
    units_per_mm: Option<f64>,
}

impl ControllerDriver {
    /// The row of a protocol.
    const fn traits(self) -> Traits {
        match self {
            Self::Grbl => Traits {
                name: "grbl",
                usual_baud: 115_200,
                handshake: false,
                has_axis: |name| ["X", "Y", "Z"].contains(&name),
                axes: "X, Y or Z on a Grbl controller",
                first_axes: ["X", "Y"],
                units_per_mm: None,
            },
            Self::Zaber => Traits {
                name: "zaber",
                usual_baud: 115_200,
                handshake: false,
                has_axis: |name| is_number(name, 1, 9),
                axes: "1 to 9 on a Zaber device",
                first_axes: ["1", "2"],
                units_per_mm: None,
            },
            Self::Pi => Traits {
                name: "pi",
                usual_baud: 115_200,
                handshake: false,
                has_axis: |name| (1..=8).contains(&name.len()) && name.bytes().all(|byte| byte.is_ascii_alphanumeric()),
                axes: "letters and digits on a PI controller, 1 as a rule",
                first_axes: ["1", "2"],
                units_per_mm: Some(1.0),
            },
            Self::Tmcl => Traits {
                name: "tmcl",
                usual_baud: 9600,
                handshake: false,
                has_axis: |name| is_number(name, 0, 5),
                axes: "0 to 5 on a Trinamic module",
                first_axes: ["0", "1"],
                units_per_mm: None,
            },
            Self::Thorlabs => Traits {
                name: "thorlabs",
                usual_baud: 115_200,
                handshake: true,
                has_axis: |name| is_number(name, 1, 3),
                axes: "1 to 3 on a Thorlabs controller: its bay; 1 on one without bays",
                first_axes: ["1", "2"],
                units_per_mm: None,
            },
        }
    }

    /// The word used in configuration and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.traits().name
    }

    /// Whether an axis of this name can be on such a controller, and if not, which can.
    ///
    /// # Errors
    /// The names that can, in words.
    pub fn check_axis(self, name: &str) -> Result<(), &'static str> {
        let Traits { has_axis, axes, .. } = self.traits();
        if has_axis(name) { Ok(()) } else { Err(axes) }
    }

    /// The names of such a controller's first two axes.
    #[must_use]
    pub const fn first_axes(self) -> [&'static str; 2] {
        self.traits().first_axes
    }

    /// The controller's units a millimetre, where it counts in a unit of length and not in steps.
    #[must_use]
    pub const fn units_per_mm(self) -> Option<f64> {
        self.traits().units_per_mm
    }

    /// Whether the protocol's controllers need the handshake of RTS and CTS on their port.
    #[must_use]
    pub const fn handshake(self) -> bool {
        self.traits().handshake
    }

    /// The baud rate that the protocol's controllers leave the factory with.
    #[must_use]
    pub const fn usual_baud(self) -> u32 {
        self.traits().usual_baud
    }
}

fn is_number(name: &str, least: u8, most: u8) -> bool {
    name.parse::<u8>().is_ok_and(|number| (least..=most).contains(&number))
}

/// `[bench.controllers.NAME]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ControllerConfig {
    /// Protocol.
    pub driver: ControllerDriver,
    /// Serial port: its `/dev/serial/by-id` name or another path, or `usb:` and a USB serial number.
    pub port: PathBuf,
    /// Baud rate; the protocol's usual one where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baud: Option<u32>,
    /// What the controller's identity must contain, beyond being of the right kind: another one is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identity: Option<String>,
    /// Address of the device on its line, where the protocol has addresses.
    #[serde(default = "default_address")]
    pub address: u8,
}

impl ControllerConfig {
    /// Baud rate in force.
    #[must_use]
    pub fn baud(&self) -> u32 {
        self.baud.unwrap_or(self.driver.usual_baud())
    }
}

const fn default_address() -> u8 {
    1
}

/// An end of an axis's travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Towards smaller coordinates.
    Low,
    /// Towards larger coordinates.
    High,
}

impl Side {
    /// −1 for low, +1 for high.
    #[must_use]
    pub const fn sign(self) -> f64 {
        match self {
            Self::Low => -1.0,
            Self::High => 1.0,
        }
    }

    /// The other one.
    #[must_use]
    pub const fn opposite(self) -> Self {
        match self {
            Self::Low => Self::High,
            Self::High => Self::Low,
        }
    }
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Low => "low",
            Self::High => "high",
        })
    }
}

/// `[bench.focus]`, `[bench.e]`: one axis. All positions are in the axis's own coordinate, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AxisConfig {
    /// Name of the controller under `[bench.controllers]`.
    pub controller: String,
    /// Axis letter or number on that controller.
    pub axis: String,
    /// The controller's units of position a millimetre (Grbl, Zaber, TMCL: motor steps or microsteps; PI: 1 where it
    /// counts in mm; Thorlabs: counts of the encoder or microsteps): compared with the controller's own setting, where it has one.
    pub steps_per_mm: f64,
    /// Whether the controller's positive direction is the coordinate's negative one.
    pub reversed: bool,
    /// Whether the controller is set to turn the motor the other way round (Grbl: the axis's bit of `$3`; TMCL: axis
    /// parameter 251): a controller that is set otherwise moves nothing.
    pub motor_inverted: bool,
    /// Least position, mm.
    pub low_limit_mm: f64,
    /// Greatest position, mm.
    pub high_limit_mm: f64,
    /// Whether limits of the controller's own that are wider than these are accepted.
    pub accept_wider_firmware_limits: bool,
    /// The end where the home switch is.
    pub home_side: Side,
    /// Position after homing and pulling off the switch, mm.
    pub home_position_mm: f64,
    /// Greatest speed, mm/s.
    pub speed_mm_per_s: f64,
    /// Acceleration, mm/s².
    pub acceleration_mm_per_s2: f64,
    /// Lost motion on reversal, mm, at most. A final approach starts this much and more beside the target.
    pub backlash_mm: f64,
    /// The side from which a target is approached.
    pub approach: Side,
    /// Rest after a stop before a frame counts as taken at rest, ms.
    pub settle_ms: u64,
    /// Greatest single move, mm.
    pub max_step_mm: f64,
    /// Standard relative uncertainty of the scale before the picture has confirmed it.
    pub scale_uncertainty: f64,
    /// Standard uncertainty of the coordinate's zero after homing, mm.
    pub zero_uncertainty_mm: f64,
}

impl AxisConfig {
    /// How far beside its target, on the side that it is approached from, a move first goes where it comes from the other, mm:
    /// long enough for the play to be taken up on the way.
    #[must_use]
    pub fn approach_leg_mm(&self) -> f64 {
        2.0 * self.backlash_mm + 0.05
    }
}

impl Default for AxisConfig {
    fn default() -> Self {
        Self {
            controller: String::new(),
            axis: String::new(),
            steps_per_mm: 400.0,
            reversed: false,
            motor_inverted: false,
            low_limit_mm: 0.0,
            high_limit_mm: 10.0,
            accept_wider_firmware_limits: false,
            home_side: Side::Low,
            home_position_mm: 0.0,
            speed_mm_per_s: 2.0,
            acceleration_mm_per_s2: 20.0,
            backlash_mm: 0.05,
            approach: Side::Low,
            settle_ms: 200,
            max_step_mm: 40.0,
            scale_uncertainty: 0.05,
            zero_uncertainty_mm: 0.2,
        }
    }
}
