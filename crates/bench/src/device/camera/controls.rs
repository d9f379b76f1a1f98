//! A camera's controls: what there is, and setting what is configured.
//!
//! Whatever a camera adjusts by itself is switched off unless the configuration says otherwise: between two frames that
//! are compared, nothing may change but the pose.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use v4l::Device;
use v4l::v4l_sys::{
    V4L2_CID_ANALOGUE_GAIN, V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, V4L2_CID_AUTO_WHITE_BALANCE, V4L2_CID_AUTOBRIGHTNESS,
    V4L2_CID_AUTOGAIN, V4L2_CID_CHROMA_AGC, V4L2_CID_EXPOSURE, V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE_AUTO,
    V4L2_CID_EXPOSURE_AUTO_PRIORITY, V4L2_CID_FOCUS_AUTO, V4L2_CID_GAIN, V4L2_CID_HUE_AUTO,
    V4L2_CID_ISO_SENSITIVITY_AUTO, V4L2_CTRL_FLAG_DISABLED, V4L2_CTRL_FLAG_GRABBED, V4L2_CTRL_FLAG_INACTIVE,
    V4L2_CTRL_FLAG_READ_ONLY, V4L2_CTRL_FLAG_VOLATILE, V4L2_CTRL_FLAG_WRITE_ONLY,
};

use super::kernel;
use crate::config::ControlValue;
use crate::device::light::{ControlName, ControlUnit, LightControl};

/// What adjusts itself, and the value that stops it: 0, but for exposure, where 1 is the menu's manual mode.
const AUTOMATICS: &[(u32, i64)] = &[
    (V4L2_CID_EXPOSURE_AUTO, 1),
    (V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0),
    (V4L2_CID_AUTOGAIN, 0),
    (V4L2_CID_ISO_SENSITIVITY_AUTO, 0),
    (V4L2_CID_AUTO_WHITE_BALANCE, 0),
    (V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, 0),
    (V4L2_CID_AUTOBRIGHTNESS, 0),
    (V4L2_CID_HUE_AUTO, 0),
    (V4L2_CID_CHROMA_AGC, 0),
    (V4L2_CID_FOCUS_AUTO, 0),
];
/// What sets how bright a picture is, best first.
const BRIGHTNESS: &[u32] = &[V4L2_CID_EXPOSURE_ABSOLUTE, V4L2_CID_EXPOSURE, V4L2_CID_ANALOGUE_GAIN, V4L2_CID_GAIN];

/// Controls of exposure and of gain, best first: what they are, and how many of the driver's numbers make one of those
/// told. `exposure_time_absolute` counts units of 100 µs.
const LIGHT: &[(u32, ControlName, ControlUnit, f64)] = &[
    (V4L2_CID_EXPOSURE_ABSOLUTE, ControlName::Exposure, ControlUnit::Ms, 10.0),
    (V4L2_CID_EXPOSURE, ControlName::Exposure, ControlUnit::Driver, 1.0),
    (V4L2_CID_ANALOGUE_GAIN, ControlName::Gain, ControlUnit::Driver, 1.0),
    (V4L2_CID_GAIN, ControlName::Gain, ControlUnit::Driver, 1.0),
];
/// What adjusts exposure or gain by itself, and the values by which it leaves them alone.
const LIGHT_AUTOMATICS: &[(u32, ControlName, &[i64])] = &[
    // A menu: automatic, manual, shutter first (the exposure is set by hand), aperture first (it is not).
    (V4L2_CID_EXPOSURE_AUTO, ControlName::Exposure, &[1, 2]),
    (V4L2_CID_AUTOGAIN, ControlName::Gain, &[0]),
];

/// Kinds of controls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlKind {
    /// A whole number.
    Number,
    /// A whole number of 64 bits.
    WideNumber,
    /// On or off.
    Switch,
    /// One of some items.
    Menu,
    /// One of some numbers.
    NumberMenu,
    /// Something done when it is written.
    Button,
    /// Bits.
    Bits,
    /// Anything else: text, arrays, structures.
    Other,
}

impl ControlKind {
    fn of(kind: u32) -> Self {
        use v4l::v4l_sys as sys;
        match kind {
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER => Self::Number,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER64 => Self::WideNumber,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BOOLEAN => Self::Switch,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_MENU => Self::Menu,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_INTEGER_MENU => Self::NumberMenu,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BUTTON => Self::Button,
            sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_BITMASK => Self::Bits,
            _ => Self::Other,
        }
    }
}

/// A control of a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Control {
    /// The name to configure it by: the driver's in small letters, with `_` for whatever is no letter or digit.
    pub key: String,
    /// The driver's name.
    pub name: String,
    /// Kind.
    pub kind: ControlKind,
    /// Least value.
    pub minimum: i64,
    /// Greatest value.
    pub maximum: i64,
    /// Between values.
    pub step: u64,
    /// The driver's default.
    pub default: i64,
    /// The value now, where it can be read.
    pub value: Option<i64>,
    /// Items of a menu: their numbers and names.
    pub items: Vec<(u32, String)>,
    /// Why it cannot be set now: `read-only`, `in use`, or `inactive` while another control governs it.
    pub locked: Option<&'static str>,
    #[serde(skip)]
    id: u32,
    #[serde(skip)]
    flags: u32,
}

/// The key of a driver's name for a control: as `v4l2-ctl` makes it.
#[must_use]
pub fn key_of(name: &str) -> String {
    let words: Vec<String> = name
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_lowercase)
        .collect();
    words.join("_")
}

/// Every control of a device that has one value, in the driver's order.
#[must_use]
pub fn list(device: &Device) -> Vec<Control> {
    let of_class = v4l::v4l_sys::v4l2_ctrl_type_V4L2_CTRL_TYPE_CTRL_CLASS;
    let usable = |raw: &kernel::RawControl| raw.kind != of_class && raw.flags & V4L2_CTRL_FLAG_DISABLED == 0;
    kernel::controls(device).into_iter().filter(usable).map(|raw| described(device, raw)).collect()
}

fn described(device: &Device, raw: kernel::RawControl) -> Control {
    let kind = if raw.compound { ControlKind::Other } else { ControlKind::of(raw.kind) };
    let numbers = kind == ControlKind::NumberMenu;
    let items = match kind {
        ControlKind::Menu | ControlKind::NumberMenu => (raw.minimum..=raw.maximum.min(raw.minimum + 1000))
            .filter_map(|index| u32::try_from(index).ok())
            .filter_map(|index| Some((index, kernel::menu_item(device, raw.id, index, numbers)?)))
            .collect(),
        _ => Vec::new(),
    };
    let readable =
        !matches!(kind, ControlKind::Button | ControlKind::Other) && raw.flags & V4L2_CTRL_FLAG_WRITE_ONLY == 0;
    let value = readable.then(|| kernel::control(device, raw.id, kind == ControlKind::WideNumber).ok()).flatten();
    let locked = [
        (V4L2_CTRL_FLAG_READ_ONLY, "read-only"),
        (V4L2_CTRL_FLAG_GRABBED, "in use"),
        (V4L2_CTRL_FLAG_INACTIVE, "inactive"),
    ];
    Control {
        key: key_of(&raw.name),
        name: raw.name,
        kind,
        minimum: raw.minimum,
        maximum: raw.maximum,
        step: raw.step,
        default: raw.default,
        value,
        items,
        locked: locked.iter().find(|(flag, _)| raw.flags & flag != 0).map(|(_, why)| *why),
        id: raw.id,
        flags: raw.flags,
    }
}

impl Control {
    /// The values it takes, in words.
    #[must_use]
    pub fn choices(&self) -> String {
        match self.kind {
            ControlKind::Switch => "true or false".to_owned(),
            ControlKind::Menu | ControlKind::NumberMenu => {
                let items: Vec<String> = self.items.iter().map(|(index, name)| format!("{index} {name:?}")).collect();
                items.join(", ")
            }
            ControlKind::Button => "true, which presses it".to_owned(),
            ControlKind::Bits => format!("0x0 to 0x{:x}", self.maximum),
            ControlKind::Number | ControlKind::WideNumber if self.step > 1 => {
                format!("{} to {} in steps of {}", self.minimum, self.maximum, self.step)
            }
            ControlKind::Number | ControlKind::WideNumber => format!("{} to {}", self.minimum, self.maximum),
            ControlKind::Other => "nothing that can be set here".to_owned(),
        }
    }

    /// A value of it, in words.
    #[must_use]
    pub fn said(&self, value: i64) -> String {
        let item = self.items.iter().find(|(index, _)| i64::from(*index) == value);
        match (self.kind, item) {
            (ControlKind::Switch, _) => (value != 0).to_string(),
            (_, Some((index, name))) => format!("{index} {name:?}"),
            _ => value.to_string(),
        }
    }

    /// The driver's number for a configured value.
    ///
    /// # Errors
    /// Why it has no such value, naming those it has.
    pub fn number_of(&self, wanted: &ControlValue) -> Result<i64, String> {
        let refused = || format!("`{}` cannot be {wanted}: it takes {}", self.key, self.choices());
        let number = match (self.kind, wanted) {
            (ControlKind::Switch, ControlValue::Switch(on)) => Some(i64::from(*on)),
            (ControlKind::Switch, ControlValue::Number(number @ (0 | 1))) => Some(*number),
            (ControlKind::Button, ControlValue::Switch(true)) => Some(1),
            (ControlKind::Menu | ControlKind::NumberMenu, wanted) => self
                .items
                .iter()
                .find(|(index, name)| match wanted {
                    ControlValue::Number(number) => i64::from(*index) == *number,
                    ControlValue::Item(item) => name.trim().eq_ignore_ascii_case(item.trim()),
                    ControlValue::Switch(_) | ControlValue::Real(_) => false,
                })
                .map(|(index, _)| i64::from(*index)),
            (ControlKind::Number | ControlKind::WideNumber, ControlValue::Number(number)) => {
                let within = (self.minimum..=self.maximum).contains(number);
                let above = i128::from(*number) - i128::from(self.minimum);
                (within && above % i128::from(self.step.max(1)) == 0).then_some(*number)
            }
            (ControlKind::Bits, ControlValue::Number(number)) => (number & !self.maximum == 0).then_some(*number),
            _ => None,
        };
        number.ok_or_else(refused)
    }

    fn is_mode(&self) -> bool {
        matches!(self.kind, ControlKind::Switch | ControlKind::Menu | ControlKind::NumberMenu)
    }

    fn set(&self, device: &Device, number: i64) -> Result<(), String> {
        let wide = self.kind == ControlKind::WideNumber;
        kernel::set_control(device, self.id, number, wide)
            .map_err(|error| format!("`{}` cannot be set to {}: {error}", self.key, self.said(number)))
    }
}

/// Switches off what the camera adjusts by itself and sets what is configured. Returns what is to be known of it, one
/// sentence each.
///
/// # Errors
/// The first configured control that there is not, or whose value it does not take; nothing is set then.
pub fn apply(device: &Device, wanted: &BTreeMap<String, ControlValue>) -> Result<Vec<String>, String> {
    let controls = list(device);
    let mut chosen =
        wanted.iter().map(|(name, value)| choose(&controls, name, value)).collect::<Result<Vec<_>, _>>()?;
    // Modes first: a number may not be set while its automatic is on.
    chosen.sort_by_key(|(control, _)| !control.is_mode());
    let mut notes = Vec::new();
    let automatics = controls.iter().filter_map(|control| {
        let (_, off) = AUTOMATICS.iter().find(|(id, _)| *id == control.id)?;
        let configured = chosen.iter().any(|(other, _)| other.id == control.id);
        (!configured && control.value != Some(*off)).then_some((control, *off))
    });
    for (control, off) in automatics {
        if let Err(why) = control.set(device, off) {
            notes.push(format!("the camera still adjusts itself: {why}"));
        }
    }
    for (control, number) in &chosen {
        control.set(device, *number)?;
    }
    for (control, number) in chosen {
        let told = matches!(control.kind, ControlKind::Button) || control.flags & V4L2_CTRL_FLAG_WRITE_ONLY != 0;
        if told || control.flags & V4L2_CTRL_FLAG_VOLATILE != 0 {
            continue;
        }
        match kernel::control(device, control.id, control.kind == ControlKind::WideNumber) {
            Ok(read) if read == number => {}
            Ok(read) => notes.push(format!(
                "`{}` was set to {} and reads {}",
                control.key,
                control.said(number),
                control.said(read)
            )),
            Err(error) => notes.push(format!("`{}` was set and cannot be read back: {error}", control.key)),
        }
    }
    Ok(notes)
}

fn choose<'c>(controls: &'c [Control], name: &str, value: &ControlValue) -> Result<(&'c Control, i64), String> {
    let key = key_of(name);
    let control = controls.iter().find(|control| control.key == key).ok_or_else(|| {
        let settable = controls.iter().filter(|control| control.kind != ControlKind::Other);
        let keys: Vec<&str> = settable.map(|control| control.key.as_str()).collect();
        let known = if keys.is_empty() { "it has none".to_owned() } else { format!("it has {}", keys.join(", ")) };
        format!("the camera has no control `{name}` (bench.camera.controls): {known}")
    })?;
    Ok((control, control.number_of(value)?))
}

/// The controls that a picture is made brighter or darker with, with their values and ranges, in words; empty where the
/// camera has none.
#[must_use]
pub fn of_brightness(device: &Device) -> String {
    let controls = list(device);
    let settable = BRIGHTNESS.iter().filter_map(|id| controls.iter().find(|control| control.id == *id));
    let named = settable.map(|control| {
        let now = control.value.map_or_else(String::new, |value| format!("now {}, ", control.said(value)));
        format!("`{}` ({now}{})", control.key, control.choices())
    });
    named.collect::<Vec<_>>().join(" or ")
}

/// The exposure and the gain among a camera's controls, each by the best control that there is of it, with that.
fn light_of(controls: &[Control]) -> Vec<(LightControl, &Control, f64)> {
    let best = |wanted: ControlName| {
        let of = LIGHT.iter().filter(|(_, name, ..)| *name == wanted);
        let mut found = of.filter_map(|(id, name, unit, per_unit)| {
            let numbers = [ControlKind::Number, ControlKind::WideNumber];
            let control = controls.iter().find(|control| control.id == *id && numbers.contains(&control.kind))?;
            Some((control, *name, *unit, *per_unit))
        });
        found.next()
    };
    let described = |(control, name, unit, per_unit): (&'_ Control, _, _, f64)| {
        let by_itself = LIGHT_AUTOMATICS.iter().find_map(|(id, of, by_hand)| {
            let automatic = controls.iter().find(|control| control.id == *id && *of == name)?;
            automatic.value.filter(|value| !by_hand.contains(value)).map(|value| (automatic, value))
        });
        let locked = match (by_itself, control.locked) {
            (Some((automatic, value)), _) => Some(format!(
                "the camera adjusts it by itself: `{}` is {}, as bench.camera.controls can change",
                automatic.key,
                automatic.said(value)
            )),
            (None, Some(why)) => {
                Some(format!("the camera's driver does not let it be set now: `{}` is {why}", control.key))
            }
            (None, None) => None,
        };
        let told = |number: i64| number as f64 / per_unit;
        LightControl {
            name,
            key: control.key.clone(),
            unit,
            value: control.value.map(told),
            minimum: told(control.minimum),
            maximum: told(control.maximum),
            step: control.step.max(1) as f64 / per_unit,
            default: told(control.default),
            automatic: by_itself.is_some(),
            locked,
        }
    };
    let each = ControlName::ALL.into_iter().filter_map(best);
    each.map(|found| (described(found), found.0, found.3)).collect()
}

/// A camera's exposure and gain.
#[must_use]
pub fn light(device: &Device) -> Vec<LightControl> {
    light_of(&list(device)).into_iter().map(|(told, ..)| told).collect()
}

/// Sets a camera's exposure or gain, and returns what that is in `[bench.camera.controls]`.
///
/// # Errors
/// Why it cannot, in words.
pub fn set_light(device: &Device, name: ControlName, value: f64, kept: &KeptControls) -> Result<(), String> {
    let controls = list(device);
    let of_name = light_of(&controls).into_iter().find(|(told, ..)| told.name == name);
    let (told, control, per_unit) = of_name.ok_or_else(|| format!("it has no control of its {name}"))?;
    if let Some(why) = told.locked {
        return Err(why);
    }
    let number = control.number_of(&ControlValue::Number((value * per_unit).round() as i64))?;
    keep_while(kept, told.key, ControlValue::Number(number), || control.set(device, number))
}

/// What was set by hand since the start, as `[bench.camera.controls]` has it: a camera that was lost gets it again.
pub type KeptControls = Mutex<BTreeMap<String, ControlValue>>;

/// Keeps a value and sets it, in this order: a camera that is opened anew meanwhile gets it, too. One that is refused is
/// kept no longer.
pub(super) fn keep_while(
    kept: &KeptControls,
    key: String,
    value: ControlValue,
    set: impl FnOnce() -> Result<(), String>,
) -> Result<(), String> {
    let values = || kept.lock().unwrap_or_else(PoisonError::into_inner);
    let before = values().insert(key.clone(), value);
    set().inspect_err(|_| {
        match before {
            Some(before) => values().insert(key, before),
            None => values().remove(&key),
        };
    })
}

#[cfg(test)]
mod tests;
