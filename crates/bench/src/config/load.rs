//! From a file to a checked configuration.

use std::ops::Range;
use std::path::Path;

use toml::de::DeTable;
use toml::{Spanned, Table, Value};

use super::error::FROM_SET;
use super::overrides::{SET, assigned};
use super::schema::{joined, unknown_keys};
use super::{BenchDriver, Config, ConfigError, ConfigOrigin, Position, Violation};

impl Config {
    /// The configuration in force, and where it came from: a file's where one is named, else the reference preset, with
    /// assignments (`KEY=VALUE`, as `--set` takes them) laid over it. What is in force is checked, and not the file alone.
    ///
    /// # Errors
    /// As [`Config::load`]; what is wrong with a value that was assigned says so.
    pub fn open(file: Option<&Path>, assignments: &[String]) -> Result<(Self, ConfigOrigin), ConfigError> {
        Self::open_checked(file, assignments, Self::violations_of)
    }

    /// The same for a program that only stops the axes, which what is not said of the camera does not keep from it.
    ///
    /// # Errors
    /// As [`Config::open`].
    pub fn open_to_stop(file: Option<&Path>, assignments: &[String]) -> Result<(Self, ConfigOrigin), ConfigError> {
        Self::open_checked(file, assignments, |config, _| config.violations())
    }

    fn open_checked(
        file: Option<&Path>,
        assignments: &[String],
        check: impl FnOnce(&Self, &dyn Fn(&str) -> bool) -> Option<Vec<Violation>>,
    ) -> Result<(Self, ConfigOrigin), ConfigError> {
        let set = assigned(assignments)?;
        let origin = file.map_or(ConfigOrigin::Preset, |path| ConfigOrigin::File(path.to_owned()));
        let (text, name) = match file {
            Some(path) => (text(path)?, path.display().to_string()),
            None => (String::new(), SET.to_owned()),
        };
        let (read, config) = Self::default().read_set(&text, &name, &set, check)?;
        Ok((config.clone(), origin.overridden(&read, &config)))
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`ConfigError::Read`], or as [`Config::from_toml`].
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::from_toml(&text(path)?, &path.display().to_string())
    }

    /// Reads and checks a TOML text; `origin` names it in errors. A key left out has its value in the preset, also
    /// within a section that is present; but `[water]`, where present, stands alone, its keys being alternatives, and on
    /// a hardware bench lens, array, sensor and shell have no defaults.
    ///
    /// # Errors
    /// [`ConfigError::Syntax`] where it is not TOML; [`ConfigError::Invalid`] with every unknown key, else with the first
    /// value of a wrong type, else with every impossible value.
    pub fn from_toml(text: &str, origin: &str) -> Result<Self, ConfigError> {
        Self::default().read_set(text, origin, &[], Self::violations_of).map(|(_, config)| config)
    }

    /// The same with the values of `self` for the keys left out, and with keys set to other values; checked as `check`
    /// does, which is given what the text says. Returns also what it was before the keys were set.
    pub(super) fn read_set(
        &self,
        text: &str,
        origin: &str,
        set: &[(&str, &str)],
        check: impl FnOnce(&Self, &dyn Fn(&str) -> bool) -> Option<Vec<Violation>>,
    ) -> Result<(Self, Self), ConfigError> {
        let invalid = |mut violations: Vec<Violation>| {
            violations.sort_by_key(|violation| violation.position);
            ConfigError::Invalid { origin: origin.to_owned(), violations }
        };
        let document = DeTable::parse(text).map_err(|error| {
            let position = Position::of(text, error.span().map_or(0, |span| span.start));
            let message = syntax_message(text, position, error.message());
            ConfigError::Syntax { origin: origin.to_owned(), position, message }
        })?;
        let document = document.get_ref();
        let unknown = unknown_keys(text, document);
        if !unknown.is_empty() {
            return Err(invalid(unknown));
        }
        let wrong_type = |error: &toml::de::Error| {
            let at = error.span().map_or(0, |span| span.start);
            let key = key_at(document, at, "").unwrap_or_else(|| "the file".to_owned());
            invalid(vec![Violation { key, position: Some(Position::of(text, at)), message: type_message(error) }])
        };
        // Once as it stands, for errors that know their place; once merged over the preset, for the values left out.
        let _: Self = toml::from_str(text).map_err(|error| wrong_type(&error))?;
        let written: Table = toml::from_str(text).map_err(|error| wrong_type(&error))?;
        let merged = self.merged(written).map_err(|error| wrong_type(&error))?;
        let in_force = merged.with(set)?;
        let is_set = |key: &str| set.iter().any(|(name, _)| *name == key);
        let said = |key: &str| is_set(key) || span_of(document, key).is_some();
        check(&in_force, &said).map_or(Ok(()), |mut violations| {
            for violation in &mut violations {
                if is_set(&violation.key) {
                    violation.message.push_str(FROM_SET);
                } else {
                    violation.position = span_of(document, &violation.key).map(|span| Position::of(text, span.start));
                }
            }
            Err(invalid(violations))
        })?;
        Ok((merged, in_force))
    }

    /// What is wrong with a configuration of which this was `said`; what was not has its default.
    fn violations_of(&self, said: &dyn Fn(&str) -> bool) -> Option<Vec<Violation>> {
        let left_out = self.keys_without_default().into_iter().filter(|key| !said(key)).map(|key| Violation {
            key,
            position: None,
            message: "is missing: on a hardware bench it has no default".to_owned(),
        });
        let all: Vec<Violation> = left_out.chain(self.violations().unwrap_or_default()).collect();
        (!all.is_empty()).then_some(all)
    }

    /// The keys that have to be said: on a hardware bench those of the lens, the array, the sensor and the shell, which
    /// would be another camera's.
    pub(super) fn keys_without_default(&self) -> Vec<String> {
        if self.bench.driver != BenchDriver::Hardware {
            return Vec::new();
        }
        let preset = Table::try_from(Self::default()).unwrap_or_default();
        let keys = |section: &str| -> Vec<String> {
            let table = preset.get(section).and_then(Value::as_table);
            table.map(|table| table.keys().map(|key| joined(section, key)).collect()).unwrap_or_default()
        };
        ["main_lens", "mla", "sensor", "shell"].into_iter().flat_map(keys).collect()
    }

    fn merged(&self, written: Table) -> Result<Self, toml::de::Error> {
        let mut table = Table::try_from(self).map_err(serde::de::Error::custom)?;
        if written.contains_key("water") {
            table.remove("water");
        }
        merge(&mut table, written);
        table.try_into()
    }
}

fn text(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.to_owned(), source })
}

/// Lays `over` on `base`, section by section.
fn merge(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(base)), Value::Table(over)) => merge(base, over),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// What the deserialiser says of a type, in the words of the file.
pub(super) fn type_message(error: &toml::de::Error) -> String {
    let mut message = one_line(error.message());
    for (rust, plain) in [
        ("expected f64", "expected a number"),
        ("expected u32", "expected a whole number from 0 up"),
        ("expected u8", "expected a whole number from 0 to 255"),
        ("expected u64", "expected a whole number from 0 up"),
        ("expected a boolean", "expected true or false"),
        ("expected an array of length 2", "expected two numbers, as in [0.0, 0.0]"),
        ("expected an array of length 3", "expected three numbers, as in [0.0, 0.0, 0.0]"),
        ("floating point", "number"),
    ] {
        message = message.replace(rust, plain);
    }
    message
}

/// Most characters of a line that a message repeats.
const LINE_SHOWN: usize = 80;

/// What a line has that is not TOML, what the parser says of it, and how one is written: the parser knows what it expected at
/// one place, and not what was meant.
fn syntax_message(text: &str, position: Position, said: &str) -> String {
    let line = text.lines().nth(position.line - 1).unwrap_or_default().trim();
    let shown: String =
        line.chars().take(LINE_SHOWN).map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect();
    format!(
        "`{shown}`: {}; a line is `[section]` or `key = value`, a text in quotes, a decimal with a point",
        one_line(said)
    )
}

fn one_line(message: &str) -> String {
    message.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ")
}

/// The dotted key whose name or value holds a byte of the text.
fn key_at(table: &DeTable<'_>, byte: usize, path: &str) -> Option<String> {
    let holds = |span: Range<usize>| span.contains(&byte);
    table.iter().find_map(|(key, value)| {
        let full = joined(path, key.get_ref());
        let inner = value.get_ref().as_table().and_then(|table| key_at(table, byte, &full));
        inner.or_else(|| (holds(key.span()) || holds(value.span())).then_some(full))
    })
}

/// Where the value of a dotted key stands.
fn span_of(table: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let get = |table: &DeTable<'_>, name: &str| {
        table.iter().find(|(known, _)| known.get_ref() == name).map(|(_, value)| Spanned::span(value))
    };
    match key.split_once('.') {
        None => get(table, key),
        Some((section, rest)) => table
            .iter()
            .find(|(known, _)| known.get_ref() == section)
            .and_then(|(_, value)| value.get_ref().as_table())
            .and_then(|table| span_of(table, rest)),
    }
}
