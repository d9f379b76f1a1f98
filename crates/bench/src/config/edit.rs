//! Changing a configuration file from elsewhere: what changes, what may not be changed so, and the file's new text,
//! with its comments.

use serde_json::Value as Json;
use toml::{Table, Value};
use toml_edit::{DocumentMut, Item, TableLike};

use super::schema::{joined, lookup};
use super::{Config, ConfigError, Violation};

/// Named in errors as the origin of a configuration that came in a request.
const ORIGIN: &str = "the request";
/// Keys, with all below them, that are changed only on the machine itself: who may ask the daemon, whom it
/// tells, and what it reads.
pub const LOCKED: [&str; 7] =
    ["server", "alpaca", "foxglove", "mqtt", "history", "record.folder", "bench.camera.files"];
/// Stands for a value that is not told.
const REDACTED: &str = "(redacted)";
/// Keys whose values are not told.
const SECRET: [&str; 3] = ["server.tls.key", "mqtt.password_file", "mqtt.tls.key"];

/// A key with another value.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// The key, dotted from the root.
    pub key: String,
    /// The value it has; absent where the key is.
    pub from: Option<Value>,
    /// The value it gets; absent where the key is taken away.
    pub to: Option<Value>,
}

/// Why a file's text cannot be changed.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// The text is not TOML.
    #[error("the file is not valid TOML: {0}")]
    Syntax(#[from] toml_edit::TomlError),
    /// The change cannot be written into the text as it is laid out.
    #[error("{0} cannot be written into the file as it is laid out; change it by hand")]
    Layout(String),
}

impl Config {
    /// Every key with its value, and those that are secret redacted.
    ///
    /// # Errors
    /// When a value cannot be written as JSON.
    pub fn redacted(&self) -> serde_json::Result<Json> {
        let mut json = serde_json::to_value(self)?;
        for key in SECRET {
            if let Some(value) = json.pointer_mut(&pointer(key)).filter(|value| value.as_str() != Some("")) {
                *value = REDACTED.into();
            }
        }
        Ok(json)
    }

    /// Reads and checks a configuration from JSON as [`Config::redacted`] writes it. A key left out, or null, has its
    /// value in the preset; what is redacted has that of `known`. Faults come in the order of their keys.
    ///
    /// # Errors
    /// As [`Config::from_toml`], without places.
    pub fn from_json(json: &Json, known: &Self) -> Result<Self, ConfigError> {
        let mut json = json.clone();
        for key in SECRET {
            let (at, kept) = (pointer(key), serde_json::to_value(known).unwrap_or_default());
            if let Some(value) = json.pointer_mut(&at).filter(|value| value.as_str() == Some(REDACTED)) {
                *value = kept.pointer(&at).cloned().unwrap_or_default();
            }
        }
        Self::from_toml(&toml_text(&json)?, ORIGIN).map_err(placeless)
    }

    /// This configuration with a camera otherwise, as far as the sections in `sections` say: a draft, to be worked out
    /// and not to be built. Only the camera itself is checked, not whether the bench could align it. A key left out has
    /// its value here; but `water`, where it is there, stands alone.
    ///
    /// # Errors
    /// As [`Config::from_json`].
    pub fn drafted(&self, sections: &Json) -> Result<Self, ConfigError> {
        let text = toml_text(sections)?;
        let (_, draft) = self.read_set(&text, ORIGIN, &[], |draft, _| draft.camera_violations()).map_err(placeless)?;
        Ok(draft)
    }

    /// The keys whose values differ in `after`, in alphabetical order.
    #[must_use]
    pub fn changes(&self, after: &Self) -> Vec<Change> {
        let table = |config: &Self| Table::try_from(config).unwrap_or_default();
        let mut changes = Vec::new();
        compare(&table(self), &table(after), "", &mut changes);
        changes.sort_by(|one, other| one.key.cmp(&other.key));
        changes
    }

    /// A file's text with the values of another configuration, as far as they differ: everything else, comments too,
    /// stays as it is. `self` is what the text says now.
    ///
    /// # Errors
    /// When the text is not TOML, or laid out in a way into which the values do not go.
    pub fn edited(&self, text: &str, after: &Self) -> Result<String, EditError> {
        let mut document: DocumentMut = text.parse()?;
        for change in self.changes(after) {
            put(document.as_table_mut(), &change.key, change.to.as_ref())
                .ok_or_else(|| EditError::Layout(change.key.clone()))?;
        }
        let mut edited = document.to_string();
        // What has no default has to be written with it: of [water] all keys once one is, on hardware those of the camera.
        if !Self::says(&edited, after) {
            let all = Table::try_from(after).unwrap_or_default();
            let water = Table::try_from(&after.water).unwrap_or_default();
            let of_water = water.keys().map(|key| joined("water", key));
            for key in of_water.chain(after.keys_without_default()) {
                put(document.as_table_mut(), &key, lookup(&all, &key));
            }
            edited = document.to_string();
        }
        if Self::says(&edited, after) { Ok(edited) } else { Err(EditError::Layout("the change".to_owned())) }
    }

    fn says(text: &str, config: &Self) -> bool {
        Self::from_toml(text, ORIGIN).is_ok_and(|said| said == *config)
    }

    /// The JSON Schema of the configuration.
    #[must_use]
    pub fn json_schema() -> Json {
        schemars::schema_for!(Self).to_value()
    }
}

impl Change {
    /// Why the change may not be made from elsewhere, if it may not.
    ///
    /// # Errors
    /// What is to be done instead, or what would be right.
    pub fn check_from_afar(&self) -> Result<(), Forbidden> {
        let below =
            |section: &str| self.key.strip_prefix(section).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
        if LOCKED.into_iter().any(below) {
            return Err(Forbidden::Locked);
        }
        let is_port = self.key.starts_with("bench.controllers.") && self.key.ends_with(".port");
        match &self.to {
            Some(Value::String(path)) if is_port || self.key == "bench.camera.device" => {
                if is_device(path) {
                    Ok(())
                } else {
                    Err(Forbidden::NoDevice)
                }
            }
            _ => Ok(()),
        }
    }
}

/// Why a change may not be made from elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Forbidden {
    /// The key is locked.
    Locked,
    /// The path names no device.
    NoDevice,
}

/// Whether a path names a device, and can name no other file.
fn is_device(path: &str) -> bool {
    path.starts_with("usb:")
        || path.starts_with("card:")
        || path.starts_with("/dev/") && path.split('/').all(|part| part != "..")
}

fn pointer(key: &str) -> String {
    format!("/{}", key.replace('.', "/"))
}

/// A request's sections as the text of a file.
fn toml_text(json: &Json) -> Result<String, ConfigError> {
    let refused = |key: &str, message: &str| ConfigError::Invalid {
        origin: ORIGIN.to_owned(),
        violations: vec![Violation { key: key.to_owned(), position: None, message: message.to_owned() }],
    };
    let table = match to_toml(json, "").map_err(|(key, message)| refused(&key, message))? {
        Some(Value::Table(table)) => table,
        _ => return Err(refused("config", "expected an object with the sections of the file")),
    };
    toml::to_string(&table).map_err(|error| refused("config", &error.to_string()))
}

/// What is wrong with a request has no line and column: it comes in the order of its keys.
fn placeless(error: ConfigError) -> ConfigError {
    match error {
        ConfigError::Invalid { origin, mut violations } => {
            for violation in &mut violations {
                violation.position = None;
            }
            violations.sort_by(|one, other| one.key.cmp(&other.key));
            ConfigError::Invalid { origin, violations }
        }
        error => error,
    }
}

/// JSON as TOML has it; nulls are left out.
fn to_toml(json: &Json, path: &str) -> Result<Option<Value>, (String, &'static str)> {
    Ok(Some(match json {
        Json::Null => return Ok(None),
        Json::Bool(on) => Value::Boolean(*on),
        Json::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(whole), _) => Value::Integer(whole),
            // JSON makes no difference between 400 and 400.0; a key for fractions takes either.
            (None, Some(whole)) if whole.fract() == 0.0 && whole.abs() < 1e15 => Value::Integer(whole as i64),
            (None, Some(fraction)) => Value::Float(fraction),
            (None, None) => return Err((path.to_owned(), "the number is too large")),
        },
        Json::String(text) => Value::String(text.clone()),
        Json::Array(items) => {
            let items = items.iter().map(|item| to_toml(item, path)).collect::<Result<Option<Vec<_>>, _>>()?;
            Value::Array(items.ok_or_else(|| (path.to_owned(), "null is no item of a list"))?)
        }
        Json::Object(members) => {
            let mut table = Table::new();
            for (key, member) in members {
                if let Some(value) = to_toml(member, &joined(path, key))? {
                    table.insert(key.clone(), value);
                }
            }
            Value::Table(table)
        }
    }))
}

fn compare(before: &Table, after: &Table, path: &str, changes: &mut Vec<Change>) {
    let none = Table::new();
    let keys = before.keys().chain(after.keys().filter(|key| !before.contains_key(*key)));
    for key in keys {
        let full = joined(path, key);
        match (before.get(key), after.get(key)) {
            (Some(Value::Table(from)), Some(Value::Table(to))) => compare(from, to, &full, changes),
            (Some(Value::Table(from)), None) => compare(from, &none, &full, changes),
            (None, Some(Value::Table(to))) => compare(&none, to, &full, changes),
            (from, to) if from != to => changes.push(Change { key: full, from: from.cloned(), to: to.cloned() }),
            _ => {}
        }
    }
}

/// Puts a value at a dotted key of a document, or takes it away, with the comments around it kept. `None` where
/// something is there that is no section.
fn put(table: &mut dyn TableLike, key: &str, value: Option<&Value>) -> Option<()> {
    if let Some((section, rest)) = key.split_once('.') {
        if !table.contains_key(section) {
            if value.is_none() {
                return Some(());
            }
            let mut made = toml_edit::Table::new();
            // No heading for a section that holds only sections.
            made.set_implicit(true);
            table.insert(section, Item::Table(made));
        }
        let inner = table.get_mut(section)?.as_table_like_mut()?;
        put(inner, rest, value)?;
        // An empty section can say something by being there: that of a controller would be one without a driver.
        if value.is_none() && inner.is_empty() {
            table.remove(section);
        }
        return Some(());
    }
    let Some(value) = value else {
        table.remove(key);
        return Some(());
    };
    let mut new: toml_edit::Value = value.to_string().parse().ok()?;
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(old) => {
            *new.decor_mut() = old.decor().clone();
            *old = new;
        }
        None => {
            table.insert(key, Item::Value(new));
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# My bench.\n[assembly] # how\ninitial_e_mm = 30.0 # the shell is mounted here\n\n[bench.e]\n# Not beyond.\nhigh_limit_mm = 32.0\n";

    fn config(text: &str) -> Config {
        Config::from_toml(text, "a test").unwrap()
    }

    fn edited(text: &str, key: &str, value: &str) -> String {
        let (before, mut after) = (config(text), config(text));
        after.set(key, value).unwrap();
        let edited = before.edited(text, &after).unwrap();
        assert_eq!(config(&edited), after, "{edited}");
        edited
    }

    #[test]
    fn a_whole_number_may_be_written_with_a_point() {
        let known = Config::default();
        let read = |width: serde_json::Value| {
            Config::from_json(&serde_json::json!({ "sensor": { "width_px": width, "height_px": 400 } }), &known)
        };
        assert_eq!(read(400.0.into()).unwrap(), read(400.into()).unwrap());
        assert!(read(400.5.into()).is_err());
    }

    #[test]
    fn a_value_changes_and_everything_around_it_stays() {
        let changed = edited(TEXT, "assembly.initial_e_mm", "29.5");
        assert_eq!(changed, TEXT.replace("30.0", "29.5"));
        assert_eq!(edited(TEXT, "assembly.initial_e_mm", "30.0"), TEXT);
        let added = edited(TEXT, "bench.e.low_limit_mm", "-4.0");
        assert!(added.starts_with(TEXT.trim_end()) && added.trim_end().ends_with("low_limit_mm = -4.0"), "{added}");
        let elsewhere = edited(TEXT, "bench.camera.frame_rate_hz", "12.5");
        assert!(elsewhere.contains("\n[bench.camera]\nframe_rate_hz = 12.5\n"), "{elsewhere}");
        assert_eq!(edited("", "bench.camera.frame_rate_hz", "12.5"), "[bench.camera]\nframe_rate_hz = 12.5\n");
    }

    #[test]
    fn sections_of_every_layout_are_written_into() {
        for text in ["assembly = { initial_e_mm = 30.0 }\n", "assembly.initial_e_mm = 30.0\n"] {
            edited(text, "assembly.initial_e_mm", "29.0");
            edited(text, "assembly.blur_limit_px", "1.5");
        }
    }

    #[test]
    fn alternatives_take_each_others_place() {
        for text in ["", "[water]\nrefractive_index = 1.34 # measured\n"] {
            let (before, mut after) = (config(text), config(text));
            after
                .set_all([
                    ("water.refractive_index", ""),
                    ("water.temperature_c", "12"),
                    ("water.salinity_permille", "35"),
                    ("water.wavelength_nm", "550"),
                ])
                .unwrap();
            let there = before.edited(text, &after).unwrap();
            assert_eq!(config(&there), after, "{there}");
            let back = after.edited(&there, &before).unwrap();
            assert_eq!(config(&back), before, "{back}");
        }
    }

    #[test]
    fn json_says_what_the_file_says() {
        let known = config(TEXT);
        let mut json = known.redacted().unwrap();
        assert_eq!(Config::from_json(&json, &known).unwrap(), known);
        json["assembly"]["initial_e_mm"] = 29.into();
        json["sensor"]["mosaic"] = Json::Null;
        let after = Config::from_json(&json, &known).unwrap();
        let changes = known.changes(&after);
        assert_eq!(changes.len(), 1);
        assert_eq!((changes[0].key.as_str(), &changes[0].to), ("assembly.initial_e_mm", &Some(Value::Float(29.0))));
    }

    #[test]
    fn every_fault_of_a_request_is_named_by_its_key() {
        let known = Config::default();
        let faults = |change: fn(&mut Json)| {
            let mut json = known.redacted().unwrap();
            change(&mut json);
            let error = Config::from_json(&json, &known).unwrap_err();
            error.violations().iter().map(|v| v.key.clone()).collect::<Vec<_>>()
        };
        assert_eq!(faults(|json| json["mla"]["pich_mm"] = 1.into()), ["mla.pich_mm"]);
        assert_eq!(faults(|json| json["mla"]["pitch_mm"] = "wide".into()), ["mla.pitch_mm"]);
        let two = faults(|json| {
            json["mla"]["pitch_mm"] = (-1).into();
            json["bench"]["e"]["steps_per_mm"] = 0.into();
        });
        assert_eq!(two, ["bench.e.steps_per_mm", "mla.pitch_mm"]);
        for none in [Json::Null, 7.into(), Json::Array(vec![])] {
            assert_eq!(Config::from_json(&none, &known).unwrap_err().violations()[0].key, "config");
        }
    }

    #[test]
    fn a_secret_is_not_told_and_comes_back_unharmed() {
        let text = "[server.tls]\ncertificate = \"a.pem\"\nkey = \"b.key\"\n\
                    [mqtt]\nbroker = \"mqtts://b\"\nuser = \"u\"\npassword_file = \"c.key\"\n\
                    [mqtt.tls]\ncertificate = \"d.pem\"\nkey = \"e.key\"\n";
        let known = config(text);
        let json = known.redacted().unwrap();
        assert!(!json.to_string().contains(".key\""), "{json}");
        assert_eq!(Config::from_json(&json, &known).unwrap(), known);
    }

    #[test]
    fn what_is_run_read_or_opened_is_not_chosen_from_afar() {
        let check = |key: &str, to: &str| {
            Change { key: key.to_owned(), from: None, to: Some(Value::String(to.to_owned())) }.check_from_afar()
        };
        for key in ["server.auth", "server.tls.certificate", "alpaca.listen", "mqtt.broker", "bench.camera.files"] {
            assert_eq!(check(key, "x"), Err(Forbidden::Locked), "{key}");
        }
        for path in ["/etc/passwd", "/dev/../etc/passwd", "ttyUSB0", "http://x", ""] {
            assert_eq!(check("bench.controllers.main.port", path), Err(Forbidden::NoDevice), "{path}");
            assert_eq!(check("bench.camera.device", path), Err(Forbidden::NoDevice), "{path}");
        }
        for path in ["/dev/serial/by-id/usb-x", "usb:A50285BI"] {
            assert_eq!(check("bench.controllers.main.port", path), Ok(()));
        }
        assert_eq!(check("bench.controllers.main.identity", "Grbl"), Ok(()));
    }

    #[test]
    fn the_schema_knows_the_keys_and_what_they_mean() {
        let schema = Config::json_schema();
        let text = schema.to_string();
        assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
        assert!(text.contains("Greatest speed, mm/s."), "{text}");
        fn keys(table: &Table, found: &mut Vec<String>) {
            for (key, value) in table {
                found.push(key.clone());
                if let Value::Table(inner) = value {
                    keys(inner, found);
                }
            }
        }
        let mut known = Vec::new();
        keys(&super::super::schema::schema(), &mut known);
        for key in known.iter().filter(|key| *key != "NAME") {
            assert!(text.contains(&format!("\"{key}\":")), "{key} is not in the schema");
        }
    }
}
