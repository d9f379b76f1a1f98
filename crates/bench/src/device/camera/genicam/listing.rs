//! A camera's features as its own description has them, for whoever configures it.

use std::collections::HashSet;

use serde::Serialize;
use viva_genicam::StandardFeature;
use viva_genicam::genapi::{AccessMode, FeatureState, FeatureValue};

use super::features;
use super::transport::Device;
use crate::config::ControlValue;

/// A feature of a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Feature {
    /// Its name: its key in `[bench.camera.controls]`.
    pub key: String,
    /// What it is, in GenICam's word: `Integer`, `Float`, `Enumeration`, ...
    pub kind: &'static str,
    /// The value now, in the camera's own unit; absent where there is none that can be read.
    pub value: Option<ControlValue>,
    /// Least value.
    pub minimum: Option<f64>,
    /// Greatest value.
    pub maximum: Option<f64>,
    /// Between values, where only some are taken.
    pub step: Option<f64>,
    /// What an enumeration takes.
    pub items: Vec<String>,
    /// Unit of value, limits and step, where the camera says it.
    pub unit: Option<String>,
    /// Why it cannot be set now; absent where it can.
    pub locked: Option<String>,
    /// The values that it takes, in words.
    #[serde(skip)]
    pub choices: String,
}

/// Every feature of a camera that its description shows to users or that this program sets by itself, in the order of the
/// description.
pub(super) fn list(device: &Device) -> Vec<Feature> {
    let shown = device.nodemap().categories().into_iter().flat_map(|(_, names)| names.iter().map(String::as_str));
    let set = StandardFeature::ALL.iter().flat_map(|feature| feature.names().iter().copied());
    let wanted: HashSet<&str> = shown.chain(set).collect();
    let names = device.nodemap().node_names().filter(|name| wanted.contains(name));
    names.filter_map(|name| feature(name, features::state(device, name).transpose()?)).collect()
}

fn feature(key: &str, state: Result<FeatureState, String>) -> Option<Feature> {
    let bare = |kind, locked| Feature {
        key: key.to_owned(),
        kind,
        value: None,
        minimum: None,
        maximum: None,
        step: None,
        items: Vec::new(),
        unit: None,
        locked,
        choices: String::new(),
    };
    let state = match state {
        Ok(state) if state.kind == "Category" => return None,
        Ok(state) => state,
        Err(why) => return Some(bare("unknown", Some(why))),
    };
    let locked = match (state.is_available, state.access) {
        (false, _) => Some("not available now".to_owned()),
        (_, Some(AccessMode::RO) | None) => Some("read-only".to_owned()),
        _ => None,
    };
    Some(Feature {
        value: match &state.value {
            FeatureValue::Integer(number) => Some(ControlValue::Number(*number)),
            FeatureValue::Float(number) => Some(ControlValue::Real(*number)),
            FeatureValue::Boolean(on) => Some(ControlValue::Switch(*on)),
            FeatureValue::Enum(item) | FeatureValue::String(item) => Some(ControlValue::Item(item.clone())),
            _ => None,
        },
        minimum: state.range.map(|range| range.min),
        maximum: state.range.map(|range| range.max),
        step: state.range.and_then(|range| range.inc),
        items: state.enum_entries.clone().unwrap_or_default(),
        unit: state.unit.clone(),
        choices: features::choices(&state),
        ..bare(state.kind, locked)
    })
}
