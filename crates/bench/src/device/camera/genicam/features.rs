//! A camera's features: reading and setting them with the limits and units of the camera's own XML.

use std::collections::BTreeMap;
use std::io::ErrorKind;

use viva_genicam::genapi::{AccessMode, FeatureState, FeatureValue, GenApiError};
use viva_genicam::gige::{GigeError, GigeStatus};
use viva_genicam::u3v::U3vError;
use viva_genicam::{GenicamError, StandardFeature, gencp};

use super::super::controls::{KeptControls, keep_while};
use super::transport::Device;
use crate::config::ControlValue;
use crate::device::light::{ControlName, ControlUnit, LightControl};

/// What adjusts itself, and would change a picture between two frames that are compared.
const AUTOMATICS: [&str; 6] =
    ["ExposureAuto", "GainAuto", "BalanceWhiteAuto", "BlackLevelAuto", "GammaAuto", "TargetBrightnessAuto"];
/// So many names like an unknown one are told.
const NEAREST: usize = 3;

/// What is wrong where somebody else has control.
pub(super) const CONTROLLED: &str =
    "another program controls it: end that one, or wait until the camera has let go of it";

/// What is wrong where nothing comes back.
const SILENT: &str = "it does not answer: unplugged, without power, or behind a firewall (UDP, port 3956)";
/// What is wrong where a camera on USB is gone.
pub(super) const UNPLUGGED: &str = "it is not connected any more: unplugged, without power, or reset";
/// What is wrong where it is there and does not answer.
const HUNG: &str = "it does not answer: unplug it, and plug it in again";
/// How the network says that nobody is there.
const UNREACHABLE: [ErrorKind; 3] =
    [ErrorKind::ConnectionRefused, ErrorKind::HostUnreachable, ErrorKind::NetworkUnreachable];

/// Why something failed, and what to do.
pub(super) fn why(error: &(dyn std::error::Error + 'static)) -> String {
    if let Some(error) = cause::<U3vError>(error) {
        return match error {
            U3vError::Disconnected | U3vError::NotFound { .. } => UNPLUGGED.to_owned(),
            U3vError::Timeout => HUNG.to_owned(),
            U3vError::Claim { source, .. } => {
                format!("another program has it, or this one has not let go of it yet ({source}): end that one")
            }
            _ => error.to_string(),
        };
    }
    match cause(error) {
        Some(GigeError::Timeout) => SILENT.to_owned(),
        Some(GigeError::Io(error)) if UNREACHABLE.contains(&error.kind()) => SILENT.to_owned(),
        // Whoever has a camera for itself alone keeps others from reading, too.
        _ if is_denied(error) => CONTROLLED.to_owned(),
        _ => error.to_string(),
    }
}

/// Whether a camera refused since another program has control of it.
pub(super) fn is_denied(error: &(dyn std::error::Error + 'static)) -> bool {
    let refused = GigeStatus::Common(gencp::StatusCode::AccessDenied);
    matches!(cause::<GigeError>(error), Some(GigeError::Status(status)) if *status == refused)
}

/// What went wrong on the way to a camera or back, if that is behind an error.
fn cause<'e, E: std::error::Error + 'static>(error: &'e (dyn std::error::Error + 'static)) -> Option<&'e E> {
    std::iter::successors(Some(error), |error| error.source()).find_map(|error| error.downcast_ref())
}

/// What the camera says of a feature; `None` where it has none of that name.
pub(super) fn state(device: &Device, name: &str) -> Result<Option<FeatureState>, String> {
    match device.feature_state(name) {
        Ok(state) => Ok(Some(state).filter(|state| state.is_implemented)),
        Err(GenicamError::GenApi(GenApiError::NodeNotFound(_))) => Ok(None),
        Err(error) => Err(format!("`{name}` cannot be read: {}", why(&error))),
    }
}

/// The first of a standard feature's names that the camera has, and what it says of it.
pub(super) fn standard(
    device: &Device,
    feature: StandardFeature,
) -> Result<Option<(&'static str, FeatureState)>, String> {
    for &name in feature.names() {
        if let Some(state) = state(device, name)? {
            return Ok(Some((name, state)));
        }
    }
    Ok(None)
}

/// The number that a feature holds.
pub(super) fn number(state: &FeatureState) -> Option<f64> {
    match state.value {
        FeatureValue::Integer(number) => Some(number as f64),
        FeatureValue::Float(number) => Some(number),
        _ => None,
    }
}

/// What a feature holds, as it is set to it.
fn text(state: &FeatureState) -> Option<String> {
    match &state.value {
        FeatureValue::Enum(now) => Some(now.clone()),
        FeatureValue::Boolean(now) => Some(now.to_string()),
        FeatureValue::Integer(now) => Some(now.to_string()),
        _ => None,
    }
}

/// The values that a feature takes, in words.
pub(super) fn choices(state: &FeatureState) -> String {
    let unit = state.unit.as_deref().map_or_else(String::new, |unit| format!(" {unit}"));
    match (&state.enum_entries, state.range) {
        (Some(entries), _) => entries.join(", "),
        (None, Some(range)) => match range.inc.filter(|step| *step != 1.0) {
            Some(step) => format!("{} to {}{unit} in steps of {step}", range.min, range.max),
            None => format!("{} to {}{unit}", range.min, range.max),
        },
        (None, None) => match state.kind {
            "Boolean" => "true or false".to_owned(),
            "Command" => "true, which carries it out".to_owned(),
            kind => format!("what a feature of kind {kind} can be"),
        },
    }
}

/// Sets a feature to text, which the camera's XML says the meaning of.
///
/// # Errors
/// Why it cannot, naming what it can be.
pub(super) fn set(device: &mut Device, name: &str, value: &str) -> Result<(), String> {
    let now = state(device, name)?.ok_or_else(|| unknown(device, name))?;
    // What a camera has always may well not be set.
    if text(&now).as_deref() == Some(value) {
        return Ok(());
    }
    let refused = |why: String| format!("`{name}` cannot be {value:?}: {why}");
    if !now.is_available || now.access == Some(AccessMode::RO) {
        return Err(refused("the camera does not let it be set now".to_owned()));
    }
    if now.enum_entries.as_ref().is_some_and(|entries| !entries.iter().any(|entry| entry == value)) {
        return Err(refused(format!("it takes {}", choices(&now))));
    }
    device.set(name, value).map_err(|error| refused(format!("{}; it takes {}", why(&error), choices(&now))))
}

/// Sets a feature that there is to text, unless it is configured. Returns why it cannot be set, where it cannot.
///
/// # Errors
/// Why it cannot be read.
pub(super) fn set_unless_wanted(
    device: &mut Device,
    wanted: &BTreeMap<String, ControlValue>,
    name: &str,
    value: &str,
) -> Result<Option<String>, String> {
    if wanted.contains_key(name) || state(device, name)?.is_none() {
        return Ok(None);
    }
    Ok(set(device, name, value).err())
}

/// What to say of a feature that there is not.
fn unknown(device: &Device, name: &str) -> String {
    let mut near: Vec<(f64, &str)> = device
        .nodemap()
        .categories()
        .into_iter()
        .flat_map(|(_, children)| children)
        .map(|known| {
            (strsim::normalized_damerau_levenshtein(&known.to_lowercase(), &name.to_lowercase()), known.as_str())
        })
        .collect();
    near.sort_by(|one, other| other.0.total_cmp(&one.0));
    let near: Vec<String> = near.into_iter().take(NEAREST).map(|(_, known)| format!("`{known}`")).collect();
    format!("the camera has no feature `{name}`; near it are {}", near.join(", "))
}

/// Switches off what the camera adjusts by itself and sets what is configured. Returns what is to be known of it, one
/// sentence each.
///
/// # Errors
/// The first configured feature that there is not, or whose value it does not take.
pub(super) fn apply(device: &mut Device, wanted: &BTreeMap<String, ControlValue>) -> Result<Vec<String>, String> {
    let mut notes = Vec::new();
    for automatic in AUTOMATICS {
        let kept_on = set_unless_wanted(device, wanted, automatic, "Off")?;
        notes.extend(kept_on.map(|why| format!("the camera still adjusts itself: {why}")));
    }
    // Modes first: a number may not be set while its automatic is on.
    let (modes, numbers): (Vec<_>, Vec<_>) =
        wanted.iter().partition(|(_, value)| matches!(value, ControlValue::Item(_) | ControlValue::Switch(_)));
    for (name, value) in modes.into_iter().chain(numbers) {
        let said = match value {
            ControlValue::Item(item) => item.clone(),
            other => other.to_string(),
        };
        set(device, name, &said).map_err(|why| format!("{why} (bench.camera.controls)"))?;
        let read = state(device, name)?.as_ref().and_then(number);
        let asked = match value {
            ControlValue::Number(number) => Some(*number as f64),
            ControlValue::Real(number) => Some(*number),
            ControlValue::Item(_) | ControlValue::Switch(_) => None,
        };
        if let (Some(read), Some(asked)) = (read, asked)
            && (read - asked).abs() > 1e-6 * asked.abs()
        {
            notes.push(format!("`{name}` was set to {asked} and reads {read}"));
        }
    }
    Ok(notes)
}

/// What of a standard feature makes a picture brighter, what its numbers are, and what adjusts it by itself.
const LIGHT: [(StandardFeature, ControlName, &str); 2] = [
    (StandardFeature::ExposureTime, ControlName::Exposure, "ExposureAuto"),
    (StandardFeature::Gain, ControlName::Gain, "GainAuto"),
];

/// What an exposure's or a gain's numbers are, by the unit that the camera's description gives them, and how many of the
/// camera's make one of those told.
fn unit_of(name: ControlName, key: &str, said: Option<&str>) -> (ControlUnit, f64) {
    let said = said.map(|unit| unit.trim().to_lowercase());
    match (name, said.as_deref()) {
        (ControlName::Exposure, Some("ns")) => (ControlUnit::Ms, 1e6),
        // The Greek letter, and the sign that looks like it.
        (ControlName::Exposure, Some("us" | "μs" | "µs" | "usec" | "microseconds")) => (ControlUnit::Ms, 1000.0),
        (ControlName::Exposure, Some("ms" | "msec" | "milliseconds")) => (ControlUnit::Ms, 1.0),
        (ControlName::Exposure, Some("s" | "sec" | "seconds")) => (ControlUnit::Ms, 1e-3),
        // The standard has exposures in µs; those whose name says that they are raw are in units of the camera's own.
        (ControlName::Exposure, None | Some("")) if !key.ends_with("Raw") => (ControlUnit::Ms, 1000.0),
        (ControlName::Gain, Some("db")) => (ControlUnit::Db, 1.0),
        _ => (ControlUnit::Driver, 1.0),
    }
}

/// How long the camera exposes a frame, s; 0 where it does not say.
pub(super) fn exposure_s(device: &Device) -> Result<f64, String> {
    let Some((key, state)) = standard(device, StandardFeature::ExposureTime)? else { return Ok(0.0) };
    Ok(match (number(&state), unit_of(ControlName::Exposure, key, state.unit.as_deref())) {
        (Some(number), (ControlUnit::Ms, per_ms)) => number / per_ms * 1e-3,
        _ => 0.0,
    })
}

/// An exposure or gain as told to users, and how many of the camera's numbers make one of those told.
fn light_of(
    device: &Device,
    (feature, name, automatic): (StandardFeature, ControlName, &str),
) -> Result<Option<(LightControl, f64)>, String> {
    let Some((key, state_now)) = standard(device, feature)? else { return Ok(None) };
    let (unit, per_unit) = unit_of(name, key, state_now.unit.as_deref());
    let Some(range) = state_now.range else { return Ok(None) };
    let automatic = state(device, automatic)?.map_or_else(String::new, |state| match state.value {
        FeatureValue::Enum(now) if now != "Off" => now,
        _ => String::new(),
    });
    let settable = state_now.is_available && state_now.access != Some(AccessMode::RO);
    let locked = match (automatic.as_str(), settable) {
        ("", true) => None,
        ("", false) => Some(format!("the camera does not let `{key}` be set now")),
        (mode, _) => {
            Some(format!("the camera adjusts it by itself ({mode}), as bench.camera.controls can change: {key}"))
        }
    };
    let value = number(&state_now).map(|now| now / per_unit);
    let step = match (range.inc, matches!(state_now.value, FeatureValue::Integer(_))) {
        (Some(step), _) if step > 0.0 => step,
        (_, true) => 1.0,
        // A number without steps: whole µs, hundredths of anything else.
        (_, false) if unit == ControlUnit::Ms => 1e-3 * per_unit,
        _ => 0.01,
    };
    let told = LightControl {
        name,
        key: key.to_owned(),
        unit,
        value,
        minimum: range.min / per_unit,
        maximum: range.max / per_unit,
        step: step / per_unit,
        // No camera tells what it would be without anybody's doing.
        default: value.unwrap_or(range.min / per_unit),
        automatic: !automatic.is_empty(),
        locked,
    };
    Ok(Some((told, per_unit)))
}

/// A camera's exposure and gain.
pub(super) fn light(device: &Device) -> Result<Vec<LightControl>, String> {
    let each = LIGHT.into_iter().map(|of| light_of(device, of));
    Ok(each.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().map(|(told, _)| told).collect())
}

/// Sets a camera's exposure or gain, and keeps what that is in `[bench.camera.controls]`.
///
/// # Errors
/// Why it cannot, in words.
pub(super) fn set_light(device: &mut Device, name: ControlName, value: f64, kept: &KeptControls) -> Result<(), String> {
    let of =
        LIGHT.into_iter().find(|(_, of, _)| *of == name).ok_or_else(|| format!("it has no control of its {name}"))?;
    let (told, per_unit) = light_of(device, of)?.ok_or_else(|| format!("it has no control of its {name}"))?;
    if let Some(why) = told.locked {
        return Err(why);
    }
    let number = as_meant(value * per_unit);
    let kept_as = if number.fract() == 0.0 { ControlValue::Number(number as i64) } else { ControlValue::Real(number) };
    let said = kept_as.to_string();
    keep_while(kept, told.key.clone(), kept_as, || set(device, &told.key, &said))
}

/// A number without what reckoning with it has added in its last places.
fn as_meant(number: f64) -> f64 {
    format!("{number:.11e}").parse().unwrap_or(number)
}

/// The controls that a picture is made brighter or darker with, with their values and ranges, in words and in the camera's own
/// numbers, as they are configured.
pub(super) fn of_brightness(device: &Device) -> String {
    let named = LIGHT.into_iter().filter_map(|(feature, ..)| {
        let (key, state) = standard(device, feature).ok()??;
        let now = number(&state).map_or_else(String::new, |now| format!("now {now}, "));
        Some(format!("`{key}` ({now}{})", choices(&state)))
    });
    named.collect::<Vec<_>>().join(" or ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_the_one_that_the_camera_says() {
        use ControlName::{Exposure, Gain};
        for (name, key, said, unit) in [
            (Exposure, "ExposureTime", Some("us"), (ControlUnit::Ms, 1000.0)),
            (Exposure, "ExposureTimeAbs", None, (ControlUnit::Ms, 1000.0)),
            (Exposure, "ExposureTime", Some("\u{b5}s"), (ControlUnit::Ms, 1000.0)),
            (Exposure, "ExposureTime", Some("\u{3bc}s"), (ControlUnit::Ms, 1000.0)),
            (Exposure, "ExposureTime", Some("ms"), (ControlUnit::Ms, 1.0)),
            (Exposure, "ExposureTime", Some(" s"), (ControlUnit::Ms, 1e-3)),
            (Exposure, "ExposureTime", Some("lines"), (ControlUnit::Driver, 1.0)),
            (Exposure, "ExposureTimeRaw", None, (ControlUnit::Driver, 1.0)),
            (Exposure, "ExposureTimeRaw", Some("us"), (ControlUnit::Ms, 1000.0)),
            (Gain, "Gain", Some("dB"), (ControlUnit::Db, 1.0)),
            (Gain, "Gain", None, (ControlUnit::Driver, 1.0)),
            (Gain, "GainRaw", None, (ControlUnit::Driver, 1.0)),
        ] {
            assert_eq!(unit_of(name, key, said), unit, "{key} in {said:?}");
        }
    }

    #[test]
    fn a_number_is_set_as_it_was_meant() {
        // 12.3 ms of a camera that counts seconds, 0.1 + 0.2 dB.
        assert_eq!(as_meant(12.3 * 1e-3), 0.0123);
        assert_eq!(as_meant(0.1 + 0.2), 0.3);
        assert_eq!(as_meant(12_345_678.0), 12_345_678.0);
        assert_eq!(as_meant(0.0), 0.0);
    }

    #[test]
    fn a_refusal_deep_within_an_error_is_told_as_what_it_is() {
        use viva_genapi_xml::XmlError;
        let denied = || GigeError::Status(GigeStatus::Common(gencp::StatusCode::AccessDenied));
        let read = GenicamError::from(XmlError::transport(denied()));
        assert_eq!((why(&read).as_str(), is_denied(&read)), (CONTROLLED, true));
        assert_eq!(why(&denied()), CONTROLLED);
        let silent = GenicamError::from(XmlError::transport(GigeError::Timeout));
        assert_eq!((why(&silent).as_str(), is_denied(&silent)), (SILENT, false));
        let busy = GigeError::Status(GigeStatus::Common(gencp::StatusCode::Busy));
        assert!(why(&busy).contains("BUSY"));
    }
}
