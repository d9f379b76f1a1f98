//! A camera that was found, for whoever lists cameras.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use plenoptics::raw::PixelFormat;
use serde::Serialize;

/// How a camera is reached.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Way {
    /// GigE Vision.
    Network {
        /// Its address.
        address: Ipv4Addr,
        /// The interface on which it answered.
        interface: String,
    },
    /// USB3 Vision.
    Usb {
        /// Its device file.
        file: PathBuf,
        /// Its vendor's number and the product's, as `lsusb` has them.
        product: String,
        /// What its connection carries of frames, Mbit/s; absent where the kernel does not say how fast it is.
        carried_mbit_per_s: Option<u32>,
    },
}

/// A camera that is there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FoundCamera {
    /// How it is reached.
    #[serde(flatten)]
    pub way: Way,
    /// Who made it, and the model.
    pub model: String,
    /// Its serial number.
    pub serial: Option<String>,
    /// The name that a user gave it.
    pub user_name: Option<String>,
    /// The formats it offers, by their PFNC names.
    pub formats: Vec<String>,
    /// Why no frames can be had of it; absent where they can.
    pub unusable: Option<String>,
}

impl FoundCamera {
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let serial = self.serial.iter().map(|serial| format!("serial:{serial}"));
        let user_name = self.user_name.iter().map(|name| format!("name:{name}"));
        let by_way = match &self.way {
            Way::Network { address, .. } => address.to_string(),
            Way::Usb { product, .. } => format!("usb:{product}"),
        };
        serial.chain(user_name).chain([by_way]).collect()
    }

    /// Where it is: its address, or its device file.
    #[must_use]
    pub fn path(&self) -> String {
        match &self.way {
            Way::Network { address, .. } => address.to_string(),
            Way::Usb { file, .. } => file.display().to_string(),
        }
    }

    /// The standard that it sends its frames by.
    #[must_use]
    pub const fn standard(&self) -> &'static str {
        match self.way {
            Way::Network { .. } => "GigE Vision",
            Way::Usb { .. } => "USB3 Vision",
        }
    }

    /// The formats of it that this program reads.
    #[must_use]
    pub fn readable(&self) -> Vec<String> {
        self.formats.iter().filter(|name| PixelFormat::from_genicam_name(name).is_some()).cloned().collect()
    }
}
