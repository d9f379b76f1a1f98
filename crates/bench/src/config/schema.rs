//! The keys that exist, for naming unknown ones and their nearest known neighbour.

use std::collections::BTreeMap;
use std::path::PathBuf;

use toml::de::DeTable;
use toml::{Table, Value};

use super::{
    Config, ControlValue, ControllerConfig, ControllerDriver, HistoryConfig, Position, Violation, WaterConfig,
};
use plenoptics::raw::CfaPattern;

/// Stands for any name of a controller, or of a camera's control.
const ANY_NAME: &str = "NAME";
/// The sections whose keys are names of the user's.
const NAMED_SECTIONS: [&str; 2] = ["bench.controllers", "bench.camera.controls"];
/// Similarity (0 to 1) above which a known key is offered for an unknown one.
const NEAR: f64 = 0.6;

/// Every key with a value of its type: sections are tables, the rest leaves.
pub(super) fn schema() -> Table {
    let mut full = Config::default();
    full.main_lens.principal_from_mount_mm = Some(0.0);
    full.boards.level_step_mm = Some(0.0);
    full.boards.side_mm = Some(0.0);
    full.boards.tank_mm = Some(0.0);
    full.assembly.delta_v_tolerance_mm = Some(0.0);
    full.assembly.e_tolerance_mm = Some(0.0);
    full.main_lens.principal_from_mount_sigma_mm = Some(0.0);
    full.water = WaterConfig {
        refractive_index: Some(1.0),
        temperature_c: Some(0.0),
        salinity_permille: Some(0.0),
        wavelength_nm: Some(0.0),
    };
    full.bench.simulation.array_rotation_deg = Some(0.0);
    full.sensor.mosaic = Some(CfaPattern::Rggb);
    let controller = ControllerConfig {
        driver: ControllerDriver::Grbl,
        port: PathBuf::new(),
        baud: Some(0),
        identity: Some(String::new()),
        address: 0,
    };
    full.bench.camera.crop_left_px = Some(0);
    full.history = HistoryConfig { keep_days: Some(1), keep_mb: Some(1), keep_audit_days: Some(1) };
    full.bench.camera.crop_top_px = Some(0);
    full.bench.camera.packet_bytes = Some(0);
    full.bench.camera.packet_delay_us = Some(0.0);
    full.bench.camera.controls = BTreeMap::from([(ANY_NAME.to_owned(), ControlValue::Number(0))]);
    full.bench.controllers = BTreeMap::from([(ANY_NAME.to_owned(), controller)]);
    Table::try_from(full).unwrap_or_default()
}

/// The schema's value at a dotted key: `None` where the key is unknown.
pub(super) fn lookup<'s>(schema: &'s Table, key: &str) -> Option<&'s Value> {
    let mut table = schema;
    let mut path = String::new();
    let mut parts = key.split('.').peekable();
    while let Some(part) = parts.next() {
        let value = child(table, &path, part)?;
        if parts.peek().is_none() {
            return Some(value);
        }
        table = value.as_table()?;
        path = joined(&path, part);
    }
    None
}

/// The schema's entry for a key of the section at `path`.
fn child<'s>(table: &'s Table, path: &str, key: &str) -> Option<&'s Value> {
    if NAMED_SECTIONS.contains(&path) { table.get(ANY_NAME) } else { table.get(key) }
}

pub(super) fn joined(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// Every unknown key of a parsed text, in no particular order.
pub(super) fn unknown_keys(text: &str, document: &DeTable<'_>) -> Vec<Violation> {
    let schema = schema();
    let mut found = Vec::new();
    walk(text, document, &schema, "", &schema, &mut found);
    found
}

fn walk(text: &str, table: &DeTable<'_>, known: &Table, path: &str, schema: &Table, found: &mut Vec<Violation>) {
    for (key, value) in table {
        let full = joined(path, key.get_ref());
        match (child(known, path, key.get_ref()), value.get_ref().as_table()) {
            (None, _) => found.push(Violation {
                position: Some(Position::of(text, key.span().start)),
                message: unknown_message(schema, &full),
                key: full,
            }),
            (Some(Value::Table(known)), Some(table)) => walk(text, table, known, &full, schema, found),
            // A section where a value belongs, or the reverse, is a matter of types.
            (Some(_), _) => {}
        }
    }
}

/// What to say of an unknown key.
pub(super) fn unknown_message(schema: &Table, key: &str) -> String {
    match suggestion(schema, key) {
        Some(near) => format!("unknown key; did you mean {near}?"),
        None => {
            let (path, _) = key.rsplit_once('.').unwrap_or(("", key));
            let section = if path.is_empty() { Some(schema) } else { lookup(schema, path).and_then(Value::as_table) };
            let names: Vec<&str> =
                section.unwrap_or(schema).keys().map(String::as_str).filter(|&name| name != ANY_NAME).collect();
            format!("unknown key; known here: {}", names.join(", "))
        }
    }
}

/// The known key nearest to an unknown one: in the same section first, then the same word in another section,
/// then, where the section is unknown too, anything similar as a whole.
fn suggestion(schema: &Table, key: &str) -> Option<String> {
    let mut keys = Vec::new();
    collect(schema, "", &mut keys);
    let (section, word) = key.rsplit_once('.').unwrap_or(("", key));
    let nearest = |candidates: &mut dyn Iterator<Item = &String>, wanted: &str, of: fn(&str) -> &str| {
        candidates
            .map(|known| (strsim::normalized_damerau_levenshtein(of(known), wanted), known))
            .filter(|(similarity, _)| *similarity >= NEAR)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, known)| known.clone())
    };
    let last = |known: &str| -> usize { known.rfind('.').map_or(0, |dot| dot + 1) };
    let in_section = |known: &&String| known.rsplit_once('.').map_or("", |(section, _)| section) == section;
    nearest(&mut keys.iter().filter(in_section), word, |known| known.rsplit_once('.').map_or(known, |(_, word)| word))
        .or_else(|| keys.iter().find(|known| &known[last(known)..] == word).cloned())
        .or_else(|| {
            let section_known = section.is_empty() || lookup(schema, section).is_some();
            if section_known { None } else { nearest(&mut keys.iter(), key, |known| known) }
        })
}

/// Every key and section, dotted, but for those under names of the user's.
fn collect(table: &Table, path: &str, keys: &mut Vec<String>) {
    for (key, value) in table {
        let full = joined(path, key);
        if NAMED_SECTIONS.contains(&path) {
            return;
        }
        if let Value::Table(inner) = value {
            collect(inner, &full, keys);
        }
        keys.push(full);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_misses_find_their_key() {
        let schema = schema();
        for (wrong, right) in [
            ("mla.pich_mm", "mla.pitch_mm"),
            ("bench.simulation.e_scale_err", "bench.simulation.e_scale_error"),
            ("mla.pixel_um", "sensor.pixel_um"),
            ("bench.e_scale_error", "bench.simulation.e_scale_error"),
            ("shel.outer_radius_mm", "shell.outer_radius_mm"),
            ("main_lense", "main_lens"),
        ] {
            assert_eq!(suggestion(&schema, wrong).as_deref(), Some(right), "{wrong}");
        }
        assert_eq!(suggestion(&schema, "mla.xyzzy"), None);
        assert!(unknown_message(&schema, "mla.xyzzy").contains("known here: angular_resolution, "));
    }

    #[test]
    fn controllers_have_any_name() {
        let schema = schema();
        assert!(lookup(&schema, "bench.controllers.main.port").is_some());
        assert!(lookup(&schema, "bench.controllers.main.speed").is_none());
        assert!(lookup(&schema, "water.temperature_c").is_some());
    }
}
