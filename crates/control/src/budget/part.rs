//! What an alignment takes for granted, and how well each is known.

use bench::config::{AxisConfig, Config};

/// A value that is not measured, or not alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    FocalLength,
    MlaPitch,
    MlaFocalLength,
    MlaToSensor,
    ExitPupil,
    BoardsInAir,
    /// Of the nearest, the middle, and the farthest level.
    BoardStep(usize),
    BoardInWater,
    WaterIndex,
    OuterRadius,
    InnerRadius,
    ShellIndex,
    /// The square of how far the shell's centre is beside the lens's axis.
    Decentre,
    Aberrations,
    FocusScale,
    EZero,
    EScale,
}

/// Boards of the triple-level board.
pub(super) const LEVELS: usize = 3;

impl Part {
    /// All of them; those of one name stand together.
    pub(super) fn all() -> Vec<Self> {
        let steps = (0..LEVELS).map(Self::BoardStep);
        [Self::FocalLength, Self::MlaPitch, Self::MlaFocalLength, Self::MlaToSensor, Self::ExitPupil, Self::BoardsInAir]
            .into_iter()
            .chain(steps)
            .chain([
                Self::BoardInWater,
                Self::WaterIndex,
                Self::OuterRadius,
                Self::InnerRadius,
                Self::ShellIndex,
                Self::Decentre,
                Self::Aberrations,
                Self::FocusScale,
                Self::EZero,
                Self::EScale,
            ])
            .collect()
    }

    /// Its standard uncertainty as configured: mm, or without a unit; that of the decentre's square is the caller's.
    pub(super) fn sigma(self, config: &Config) -> f64 {
        let known = &config.uncertainty;
        let axis: &AxisConfig = &config.bench.e;
        match self {
            Self::FocalLength => known.focal_length * config.main_lens.focal_length_mm,
            Self::MlaPitch => known.mla_pitch * config.mla.pitch_mm,
            Self::MlaFocalLength => known.mla_focal_length * config.mla.focal_length_mm,
            Self::MlaToSensor => known.mla_to_sensor * config.design().mla.b(),
            Self::ExitPupil => known.exit_pupil_mm,
            Self::BoardsInAir => {
                known.boards_in_air_mm.hypot(config.main_lens.principal_from_mount_sigma_mm.unwrap_or(0.0))
            }
            Self::BoardStep(_) => known.board_steps_mm,
            Self::BoardInWater => known.board_in_water_mm,
            Self::WaterIndex => known.water_index,
            Self::OuterRadius | Self::InnerRadius => known.shell_radii_mm,
            Self::ShellIndex => known.shell_index,
            Self::Decentre => known.shell_decentre_mm,
            Self::Aberrations => known.shell_aberrations,
            Self::FocusScale => config.bench.focus.scale_uncertainty,
            Self::EZero => axis.zero_uncertainty_mm,
            Self::EScale => axis.scale_uncertainty,
        }
    }

    /// Its unit with a space before it; nothing of a pure number.
    pub(super) const fn unit(self) -> &'static str {
        match self {
            Self::WaterIndex | Self::ShellIndex | Self::Aberrations | Self::FocusScale | Self::EScale => "",
            Self::Decentre => " mm²",
            _ => " mm",
        }
    }

    /// What it is called.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::FocalLength => "focal length of the main lens",
            Self::MlaPitch => "pitch of the microlenses",
            Self::MlaFocalLength => "focal length of the microlenses",
            Self::MlaToSensor => "distance of the array from the sensor",
            Self::ExitPupil => "place of the exit pupil",
            Self::BoardsInAir => "distance of the boards in air",
            Self::BoardStep(_) => "steps of the boards in air",
            Self::BoardInWater => "distance of the board in water",
            Self::WaterIndex => "index of the water",
            Self::OuterRadius | Self::InnerRadius => "radii of the shell",
            Self::ShellIndex => "index of the shell",
            Self::Decentre => "decentring of the shell",
            Self::Aberrations => "aberrations of the shell",
            Self::FocusScale => "scale of the focus axis",
            Self::EZero => "zero of the e axis",
            Self::EScale => "scale of the e axis",
        }
    }

    /// The key of the configuration that says how well it is known.
    pub(super) const fn key(self) -> &'static str {
        match self {
            Self::FocalLength => "uncertainty.focal_length",
            Self::MlaPitch => "uncertainty.mla_pitch",
            Self::MlaFocalLength => "uncertainty.mla_focal_length",
            Self::MlaToSensor => "uncertainty.mla_to_sensor",
            Self::ExitPupil => "uncertainty.exit_pupil_mm",
            Self::BoardsInAir => "uncertainty.boards_in_air_mm",
            Self::BoardStep(_) => "uncertainty.board_steps_mm",
            Self::BoardInWater => "uncertainty.board_in_water_mm",
            Self::WaterIndex => "uncertainty.water_index",
            Self::OuterRadius | Self::InnerRadius => "uncertainty.shell_radii_mm",
            Self::ShellIndex => "uncertainty.shell_index",
            Self::Decentre => "uncertainty.shell_decentre_mm",
            Self::Aberrations => "uncertainty.shell_aberrations",
            Self::FocusScale => "bench.focus.scale_uncertainty",
            Self::EZero => "bench.e.zero_uncertainty_mm",
            Self::EScale => "bench.e.scale_uncertainty",
        }
    }

    /// What would make it better known.
    pub(super) const fn remedy(self) -> &'static str {
        match self {
            Self::FocalLength => "measure f, on a collimator or with boards far apart",
            Self::MlaPitch => "measure the array under a microscope",
            Self::MlaFocalLength => "have the array's maker state it",
            Self::MlaToSensor => "levels further apart, which tell b",
            Self::ExitPupil => "have the lens's maker state where it is",
            Self::BoardsInAir => "measure from the mount, with principal_from_mount_mm known",
            Self::BoardStep(_) => "gauge blocks between the levels",
            Self::BoardInWater => "a spacer between shell and board",
            Self::WaterIndex => "light of one wavelength, and the water's temperature and salinity",
            Self::OuterRadius | Self::InnerRadius => "measure the shell with a spherometer",
            Self::ShellIndex => "have the material's index at the light's wavelength",
            Self::Decentre => "centre the shell",
            Self::Aberrations => "a smaller aperture, or a larger shell",
            Self::EZero => "a better home switch, or l_bound measured",
            Self::FocusScale | Self::EScale => "calibrate the axis",
        }
    }
}
