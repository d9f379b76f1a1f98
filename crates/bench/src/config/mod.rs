//! The configuration: one TOML file to one struct per concern, checked once, immutable afterwards.
//!
//! [`Config::open`] reads a file or takes the preset; [`Config::set_all`] lays `key=value` overrides on top; every way to
//! a configuration goes through [`Config::validate`], which names all that is wrong and not only the first.
//!
//! Every key carries its unit in its name. Without a file the reference preset stands, whose camera and shell are
//! inferred from the paper's Table 2 (f is forced by it; the shell and the MLA are a choice among those that fit).

mod alpaca;
mod assembly;
mod bench;
mod boards;
mod camera;
mod capture;
mod check;
mod check_bench;
mod check_simulation;
mod edit;
mod error;
mod flaws;
mod history;
mod load;
mod mqtt;
mod origin;
mod overrides;
mod record;
mod schema;
mod server;
mod simulation;
mod uncertainty;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use alpaca::AlpacaConfig;
pub use assembly::{AssemblyConfig, E_SPACING_PX, LBoundSource, ShellStep, SpacingTarget, Tolerances};
pub use bench::{AxisConfig, BenchConfig, BenchDriver, ControllerConfig, ControllerDriver, Side};
pub use boards::{BoardTexture, BoardsConfig, BoardsInAir};
pub use camera::{MainLensConfig, MlaConfig, ObjectConfig, SensorConfig, ShellConfig, WaterConfig};
pub use capture::{CameraConfig, CameraDriver, ControlValue, GenicamName, TimestampMeans};
pub use edit::{Change, EditError, Forbidden, LOCKED};
pub use error::{ConfigError, Position, Violation};
pub use flaws::{BubblesConfig, DustConfig, MicrolensesConfig, MosaicConfig, MotionConfig, ReelConfig};
pub use history::HistoryConfig;
pub use mqtt::{Broker, MqttConfig, MqttTlsConfig};
pub use origin::ConfigOrigin;
pub use record::{FoxgloveConfig, RecordConfig, RecordJobs};
pub use server::{Auth, ServerConfig, TlsConfig};
pub use simulation::{SimulationConfig, Texture};
pub use uncertainty::UncertaintyConfig;

use plenoptics::optics::report::DesignCriteria;
use plenoptics::optics::{CameraDesign, MainLens, Mla, SensorExtent, Shell};
use plenoptics::units::{Micrometres, Millimetres, PixelPitch, Pixels};

/// Where the preset's numbers come from, to be shown wherever the preset is.
pub const PRESET_ORIGIN: &str = "reference preset, inferred from Table 2";

/// Everything the daemon is told.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The main lens.
    pub main_lens: MainLensConfig,
    /// The microlens array.
    pub mla: MlaConfig,
    /// The sensor.
    pub sensor: SensorConfig,
    /// The spherical shell.
    pub shell: ShellConfig,
    /// The water.
    pub water: WaterConfig,
    /// The object distances.
    pub object: ObjectConfig,
    /// Which boards there are in air.
    pub boards: BoardsConfig,
    /// How the camera is put together, and to which tolerances.
    pub assembly: AssemblyConfig,
    /// How well what is configured above is known.
    pub uncertainty: UncertaintyConfig,
    /// Stages, camera and limits.
    pub bench: BenchConfig,
    /// Who may ask the daemon, and how many at once.
    pub server: ServerConfig,
    /// The facade for ASCOM Alpaca clients.
    pub alpaca: AlpacaConfig,
    /// How long the history keeps what.
    pub history: HistoryConfig,
    /// What is recorded of jobs, and where.
    pub record: RecordConfig,
    /// The live bridge for Foxglove and Lichtblick.
    pub foxglove: FoxgloveConfig,
    /// The broker that events and measurements are published to.
    pub mqtt: MqttConfig,
}

impl Config {
    /// Side of a pixel.
    #[must_use]
    pub fn pixel_pitch(&self) -> PixelPitch {
        PixelPitch(Micrometres(self.sensor.pixel_um))
    }

    /// The optical design that the configuration describes.
    #[must_use]
    pub fn design(&self) -> CameraDesign {
        CameraDesign {
            main_lens: MainLens { focal_length: self.main_lens.focal_length_mm },
            mla: Mla {
                array: self.mla.array,
                pitch: self.mla.pitch_mm,
                focal_length: self.mla.focal_length_mm,
                angular_resolution: self.mla.angular_resolution,
                mode: self.mla.mode,
            },
            shell: Shell {
                outer_radius: self.shell.outer_radius_mm,
                inner_radius: self.shell.inner_radius_mm,
                n_shell: self.shell.refractive_index,
                n_water: self.water.index(),
            },
            air_distance: self.object.air_distance_mm,
            object_distance: self.object.distance_mm,
        }
    }

    /// The sensor's extent.
    #[must_use]
    pub fn sensor_extent(&self) -> SensorExtent {
        let pixel = self.pixel_pitch().millimetres();
        SensorExtent {
            width: f64::from(self.sensor.width_px) * pixel,
            height: f64::from(self.sensor.height_px) * pixel,
        }
    }

    /// δ on the sensor.
    #[must_use]
    pub fn blur_limit(&self) -> Millimetres {
        self.pixel_pitch().to_millimetres(Pixels(self.assembly.blur_limit_px))
    }

    /// What the design is judged against.
    #[must_use]
    pub fn design_criteria(&self) -> DesignCriteria {
        DesignCriteria {
            sensor: self.sensor_extent(),
            pixel: self.pixel_pitch().millimetres(),
            initial_e: self.assembly.initial_e_mm,
            l_bound: self.assembly.l_bound_mm,
            blur_limit: self.blur_limit().value(),
        }
    }
}
