//! A camera that is there, before it is opened: who it is, and where.

use std::net::Ipv4Addr;

use viva_genicam::gige::DeviceInfo;
use viva_genicam::u3v::U3vDeviceInfo;

use super::known::Identity;
use super::usb::{self, Names};
use crate::config::GenicamName;

/// Where a camera is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Site {
    /// On the network.
    Network(Ipv4Addr),
    /// On a USB bus, at an address that it has until it is unplugged.
    Usb { bus: String, address: u8 },
}

/// A camera that is there.
#[derive(Debug, Clone)]
pub(super) enum Target {
    /// On the network.
    Network(DeviceInfo),
    /// On USB, with what it says of itself, or why it does not.
    Usb(U3vDeviceInfo, Result<Names, String>),
}

/// What was given, where something was.
pub(super) fn given(text: Option<&String>) -> Option<String> {
    text.map(|text| text.trim().to_owned()).filter(|text| !text.is_empty())
}

impl Target {
    /// Where it is.
    pub(super) fn site(&self) -> Site {
        match self {
            Self::Network(info) => Site::Network(info.ip),
            Self::Usb(info, _) => usb::site(info),
        }
    }

    /// Which it is, for what is kept of it.
    pub(super) fn known_as(&self) -> Identity {
        match self {
            Self::Network(info) => Identity::of(info),
            Self::Usb(info, _) => Identity::of_usb(info),
        }
    }

    /// Who made it, and the model.
    pub(super) fn model(&self) -> String {
        let (maker, model) = match self {
            Self::Network(info) => (&info.manufacturer, &info.model),
            Self::Usb(info, _) => (&info.manufacturer, &info.model),
        };
        [maker, model].into_iter().flatten().map(|word| word.trim()).collect::<Vec<_>>().join(" ")
    }

    /// Its serial number.
    pub(super) fn serial(&self) -> Option<String> {
        match self {
            Self::Network(info) => given(info.serial.as_ref()),
            Self::Usb(info, names) => {
                given(info.serial.as_ref()).or_else(|| names.as_ref().ok().and_then(|names| names.serial.clone()))
            }
        }
    }

    /// The name that a user gave it.
    pub(super) fn user_name(&self) -> Option<String> {
        match self {
            Self::Network(info) => given(info.user_name.as_ref()),
            Self::Usb(_, names) => names.as_ref().ok().and_then(|names| names.user_name.clone()),
        }
    }

    /// Whether a name means it.
    pub(super) fn is_called(&self, name: &GenicamName) -> bool {
        match (name, self) {
            (GenicamName::Serial(serial), Self::Usb(_, Ok(names))) if names.serial.as_ref() == Some(serial) => true,
            (GenicamName::Serial(serial), _) => self.serial().as_ref() == Some(serial),
            (GenicamName::Name(name), _) => self.user_name().as_ref() == Some(name),
            (GenicamName::Address(address), Self::Network(info)) => info.ip == *address,
            (GenicamName::Product(vendor, product), Self::Usb(info, _)) => {
                (info.vendor_id, info.product_id) == (*vendor, *product)
            }
            (GenicamName::Address(_) | GenicamName::Product(..), _) => false,
        }
    }

    /// Where it is, for a sentence.
    pub(super) fn said_site(&self) -> String {
        match self {
            Self::Network(info) => info.ip.to_string(),
            Self::Usb(info, _) => format!("usb:{:04x}:{:04x}", info.vendor_id, info.product_id),
        }
    }

    /// It among others, for a sentence.
    pub(super) fn described(&self) -> String {
        let (model, unread) = match self {
            Self::Network(info) => (&info.model, None),
            Self::Usb(info, names) => (&info.model, names.as_ref().err()),
        };
        let serial = self.serial().map_or_else(String::new, |serial| format!(", serial:{serial}"));
        let named = self.user_name().map_or_else(String::new, |named| format!(", name:{named}"));
        let unread = unread.map_or_else(String::new, |why| format!("; {why}"));
        format!("{} ({}{serial}{named}{unread})", self.said_site(), model.as_deref().unwrap_or("of no name"))
    }

    /// What it is, in a line.
    pub(super) fn identity(&self) -> String {
        let serial = self.serial().map_or_else(String::new, |serial| format!("{serial}, "));
        let model = Some(self.model()).filter(|model| !model.is_empty());
        let model = model.unwrap_or_else(|| "GenICam camera".to_owned());
        match self {
            Self::Network(_) => format!("{model} ({serial}{})", self.said_site()),
            Self::Usb(..) => format!("{model} ({serial}USB3 Vision)"),
        }
    }
}
