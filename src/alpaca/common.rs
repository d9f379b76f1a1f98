//! The devices there are, and the members that all of them have.

use serde_json::{Value, json};

use super::answer::Answer;
use super::fault::{Fault, Refused};
use super::request::{Call, Caller, Verb, Verbs};
use super::server::Facade;
use super::{camera, focuser};
use crate::device::AxisName;

/// Members of every device, and how each is asked for.
const MEMBERS: &[(&str, Verbs)] = &[
    ("action", Verbs::Put),
    ("commandblind", Verbs::Put),
    ("commandbool", Verbs::Put),
    ("commandstring", Verbs::Put),
    ("connect", Verbs::Put),
    ("connected", Verbs::Both),
    ("connecting", Verbs::Get),
    ("description", Verbs::Get),
    ("devicestate", Verbs::Get),
    ("disconnect", Verbs::Put),
    ("driverinfo", Verbs::Get),
    ("driverversion", Verbs::Get),
    ("interfaceversion", Verbs::Get),
    ("name", Verbs::Get),
    ("supportedactions", Verbs::Get),
];

/// As the specification has it: the version's first two numbers.
const DRIVER_VERSION: &str = concat!(env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));
/// Of the Focuser and of the Camera: those of ASCOM Platform 7.
const INTERFACE_VERSION: i32 = 4;

/// A device of the facade.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Device {
    Focuser(AxisName),
    Camera,
}

impl Device {
    /// Every device, in the order in which they are listed.
    pub(super) const ALL: [Self; 3] = [Self::Focuser(AxisName::Focus), Self::Focuser(AxisName::E), Self::Camera];

    /// The type's name in a path.
    pub(super) const fn path(self) -> &'static str {
        match self {
            Self::Focuser(_) => "focuser",
            Self::Camera => "camera",
        }
    }

    /// The type's name in the list of devices.
    pub(super) const fn kind(self) -> &'static str {
        match self {
            Self::Focuser(_) => "Focuser",
            Self::Camera => "Camera",
        }
    }

    /// Its number among those of its type.
    pub(super) const fn number(self) -> u32 {
        match self {
            Self::Focuser(AxisName::E) => 1,
            Self::Focuser(AxisName::Focus) | Self::Camera => 0,
        }
    }

    /// The device of a path.
    ///
    /// # Errors
    /// What there is instead.
    pub(super) fn find(kind: &str, number: &str) -> Result<Self, Refused> {
        let of_kind: Vec<Self> = Self::ALL.into_iter().filter(|device| device.path() == kind).collect();
        if of_kind.is_empty() {
            let words = format!("there is no device of type {kind:?}; there are focuser and camera, in lower case");
            return Err(Refused::Malformed(words));
        }
        let wanted = number.parse::<u32>().ok();
        of_kind.iter().copied().find(|device| Some(device.number()) == wanted).ok_or_else(|| {
            let last = of_kind.len() - 1;
            Refused::Malformed(format!("there is no {kind} {number:?}; their numbers are 0 to {last}"))
        })
    }

    /// A member by its name in a path.
    ///
    /// # Errors
    /// That there is none.
    pub(super) fn member(self, name: &str) -> Result<(&'static str, Verbs), Refused> {
        let own = match self {
            Self::Focuser(_) => focuser::MEMBERS,
            Self::Camera => camera::MEMBERS,
        };
        let found = MEMBERS.iter().chain(own).find(|(known, _)| *known == name).copied();
        found.ok_or_else(|| {
            Refused::Malformed(format!("a {} has no member {name:?}; members are in lower case", self.path()))
        })
    }

    /// Its name.
    pub(super) fn name(self, simulated: bool) -> String {
        let name = match self {
            Self::Focuser(axis) => format!("Plenalign {axis} axis"),
            Self::Camera => "Plenalign camera".to_owned(),
        };
        if simulated { format!("{name} (SIMULATED)") } else { name }
    }
}

impl Facade {
    pub(super) fn unique_id(&self, device: Device) -> String {
        match device {
            Device::Focuser(axis) => self.ids.of_axis(axis),
            Device::Camera => self.ids.of_camera(),
        }
    }

    /// What a member answers.
    pub(super) async fn answer(&self, device: Device, call: &Call) -> Result<Answer, Refused> {
        match (call.member, call.verb) {
            ("connected", Verb::Get) => Ok(Answer::of(self.is_connected(device, call.caller))),
            ("connected", Verb::Put) => {
                let wanted = call.params.flag("Connected")?;
                self.connect(device, call.caller, wanted)
            }
            ("connect", _) => self.connect(device, call.caller, true),
            ("disconnect", _) => self.connect(device, call.caller, false),
            // Connecting takes no time, so that it is never under way.
            ("connecting", _) => Ok(Answer::of(false)),
            ("description", _) => Ok(Answer::of(self.description(device))),
            ("driverinfo", _) => Ok(Answer::of(format!(
                "Plenalign {}; ASCOM Alpaca for the alignment bench of a plenoptic camera",
                env!("CARGO_PKG_VERSION")
            ))),
            ("driverversion", _) => Ok(Answer::of(DRIVER_VERSION)),
            ("interfaceversion", _) => Ok(Answer::of(INTERFACE_VERSION)),
            ("name", _) => Ok(Answer::of(device.name(self.service.bench().is_simulated()))),
            ("supportedactions", _) => Ok(Answer::of(json!(actions(device)))),
            ("action", _) => {
                let name = call.params.text("Action")?;
                match device {
                    Device::Focuser(axis) if name.eq_ignore_ascii_case(focuser::HOME) => self.home(axis, call).await,
                    _ => Err(Fault::no_such_action(name, actions(device)).into()),
                }
            }
            ("commandblind" | "commandbool" | "commandstring", _) => {
                call.params.text("Command")?;
                Err(Fault::not_implemented(call.member, "nothing is passed on to a device past the motion rules")
                    .into())
            }
            ("devicestate", _) => {
                self.need_connection(device, call.caller)?;
                let mut states = match device {
                    Device::Focuser(axis) => self.focuser_states(axis),
                    Device::Camera => self.camera_states(),
                };
                states.push(("TimeStamp", json!(jiff::Timestamp::now().to_string())));
                let states = states.into_iter().map(|(name, value)| json!({ "Name": name, "Value": value }));
                Ok(Answer::of(Value::Array(states.collect())))
            }
            _ => match device {
                Device::Focuser(axis) => self.answer_focuser(axis, call).await,
                Device::Camera => self.answer_camera(call),
            },
        }
    }

    fn is_connected(&self, device: Device, caller: Caller) -> bool {
        match device {
            Device::Focuser(axis) => self.seat.is_connected(caller, axis),
            Device::Camera => self.viewers.is_connected(caller),
        }
    }

    pub(super) fn need_connection(&self, device: Device, caller: Caller) -> Result<(), Fault> {
        match device {
            Device::Focuser(axis) if !self.seat.is_connected(caller, axis) => Err(self.seat.not_connected(axis)),
            Device::Camera if !self.viewers.is_connected(caller) => {
                Err(Fault::not_connected("this client is not connected to the camera: set Connected to True"))
            }
            _ => Ok(()),
        }
    }

    fn connect(&self, device: Device, caller: Caller, wanted: bool) -> Result<Answer, Refused> {
        match (device, wanted) {
            (Device::Focuser(axis), true) => self.connect_focuser(axis, caller)?,
            (Device::Focuser(axis), false) => self.disconnect_focuser(axis, caller),
            (Device::Camera, true) => self.connect_camera(caller)?,
            (Device::Camera, false) => self.viewers.disconnect(caller),
        }
        Ok(Answer::Done)
    }

    /// In 64 characters, so that it fits a FITS header.
    fn description(&self, device: Device) -> String {
        let words = match device {
            Device::Focuser(axis) => {
                let info = self.service.bench().stage(axis).info();
                format!("{axis} axis, 1 um a step, {} {}", info.driver, info.identity)
            }
            Device::Camera => {
                let state = self.service.bench().camera.state().borrow().clone();
                format!("camera, {} {}", state.driver, state.identity)
            }
        };
        words.trim_end().chars().take(64).collect()
    }
}

const fn actions(device: Device) -> &'static [&'static str] {
    match device {
        Device::Focuser(_) => &[focuser::HOME],
        Device::Camera => &[],
    }
}
