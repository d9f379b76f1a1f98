//! What a twin speaks: a driver's protocol, and of Grbl's which firmware.

use crate::config::ControllerDriver;

/// What a controller twin is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Protocol {
    /// Grbl 1.1.
    Grbl,
    /// grblHAL.
    #[value(name = "grblhal")]
    GrblHal,
    /// FluidNC.
    #[value(name = "fluidnc")]
    FluidNc,
    /// Zaber's ASCII protocol.
    Zaber,
    /// PI's General Command Set 2.
    Pi,
    /// Trinamic's TMCL.
    Tmcl,
    /// Thorlabs' APT.
    Thorlabs,
}

impl Protocol {
    /// The driver that drives it.
    #[must_use]
    pub const fn driver(self) -> ControllerDriver {
        match self {
            Self::Grbl | Self::GrblHal | Self::FluidNc => ControllerDriver::Grbl,
            Self::Zaber => ControllerDriver::Zaber,
            Self::Pi => ControllerDriver::Pi,
            Self::Tmcl => ControllerDriver::Tmcl,
            Self::Thorlabs => ControllerDriver::Thorlabs,
        }
    }

    /// Its word on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::GrblHal => "grblhal",
            Self::FluidNc => "fluidnc",
            _ => self.driver().name(),
        }
    }

    /// The names of its first two axes.
    #[must_use]
    pub const fn first_axes(self) -> [&'static str; 2] {
        self.driver().first_axes()
    }
}

impl From<ControllerDriver> for Protocol {
    fn from(driver: ControllerDriver) -> Self {
        match driver {
            ControllerDriver::Grbl => Self::Grbl,
            ControllerDriver::Zaber => Self::Zaber,
            ControllerDriver::Pi => Self::Pi,
            ControllerDriver::Tmcl => Self::Tmcl,
            ControllerDriver::Thorlabs => Self::Thorlabs,
        }
    }
}
