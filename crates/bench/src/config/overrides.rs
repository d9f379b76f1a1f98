//! `key=value` overrides of a configuration, as `--set` takes them.

use toml::{Table, Value};

use super::load::type_message;
use super::schema::{lookup, schema, unknown_message};
use super::{Config, ConfigError, Violation};

/// Named in errors as the origin of an override.
pub(super) const SET: &str = "--set";

impl Config {
    /// Sets one key, dotted from the root, to a value written as in TOML; a word that is no TOML value is taken as a
    /// string, and an empty value takes an optional key away. On an error nothing changes.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] where the key is unknown (with the nearest known one), the value has the wrong type, or
    /// the result is impossible.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), ConfigError> {
        self.set_all([(key, value)])
    }

    /// Sets several keys in order and checks the result once, so that values that only make sense together can be given
    /// together. On an error nothing changes.
    ///
    /// # Errors
    /// As [`Config::set`].
    pub fn set_all<'a>(
        &mut self,
        assignments: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<(), ConfigError> {
        let assignments: Vec<_> = assignments.into_iter().collect();
        let changed = self.with(&assignments)?;
        match changed.violations() {
            Some(violations) => Err(ConfigError::Invalid { origin: SET.to_owned(), violations }),
            None => {
                *self = changed;
                Ok(())
            }
        }
    }

    /// This configuration with keys set in order, not checked as a whole.
    pub(super) fn with(&self, assignments: &[(&str, &str)]) -> Result<Self, ConfigError> {
        let schema = schema();
        let mut changed = self.clone();
        for &(key, value) in assignments {
            let refused = |message| refused(key, message);
            let known = lookup(&schema, key).ok_or_else(|| refused(unknown_message(&schema, key)))?;
            if known.is_table() {
                return Err(refused("this is a section; set one of its keys".to_owned()));
            }
            let mut table = Table::try_from(&changed).map_err(|error| refused(error.to_string()))?;
            place(&mut table, key, parse(value, known)).ok_or_else(|| refused("no such section".to_owned()))?;
            changed = table.try_into().map_err(|error| refused(type_message(&error)))?;
        }
        Ok(changed)
    }
}

/// Assignments `KEY=VALUE` as keys and values.
///
/// # Errors
/// [`ConfigError::Invalid`] for what is none.
pub(super) fn assigned(assignments: &[String]) -> Result<Vec<(&str, &str)>, ConfigError> {
    let wrong = |said: &str| refused(said, "expected KEY=VALUE, e.g. assembly.initial_e_mm=25".to_owned());
    assignments
        .iter()
        .map(|said| said.split_once('=').map(|(key, value)| (key.trim(), value.trim())).ok_or_else(|| wrong(said)))
        .collect()
}

fn refused(key: &str, message: String) -> ConfigError {
    let violation = Violation { key: key.to_owned(), position: None, message };
    ConfigError::Invalid { origin: SET.to_owned(), violations: vec![violation] }
}

/// A value as written: `None` for an empty one. Where the key holds a string, anything but a quoted string is the string
/// itself, so that an axis may be called 1.
fn parse(written: &str, known: &Value) -> Option<Value> {
    let written = written.trim();
    if written.is_empty() {
        return None;
    }
    let bare = || Value::String(written.to_owned());
    Some(match written.parse::<Value>() {
        Ok(value) if known.is_str() && !value.is_str() => bare(),
        Ok(value) => value,
        Err(_) => bare(),
    })
}

/// Puts a value at a dotted key, or takes it away. `None` where a section on the way is missing.
fn place(table: &mut Table, key: &str, value: Option<Value>) -> Option<()> {
    match key.split_once('.') {
        Some((section, rest)) => place(table.get_mut(section)?.as_table_mut()?, rest, value),
        None => {
            match value {
                Some(value) => table.insert(key.to_owned(), value),
                None => table.remove(key),
            };
            Some(())
        }
    }
}
