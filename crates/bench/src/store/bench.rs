//! What a bench is called in the history: by its devices, not by how the configuration spells their ports.

use std::collections::BTreeSet;

use rusqlite::{Connection, Result};
use serde_json::{Value, json};

use super::read;
use super::records::Kept;
use super::write::Writer;

/// In the place of a value under a spelling: the name of the devices under which it is kept.
const POINTER: &str = "kept_under";

/// Whether a value is nothing but the name under which another one is kept.
fn is_pointer(value: &Value) -> bool {
    value.as_object().is_some_and(|object| object.len() == 1 && object.get(POINTER).is_some_and(Value::is_string))
}

/// A bench's names.
///
/// A value is kept once, under the devices' name, and under the spelling is where that is: so that it is found while the
/// devices are away, and under every spelling while they are there. A value under the spelling itself is one of a time
/// when the devices had never been there, or of an older version, which knew no other name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BenchName {
    /// Its ports as the configuration spells them.
    pub spelled: String,
    /// Its devices; `None` where one of them is away.
    pub devices: Option<String>,
}

impl BenchName {
    /// The name that what happens now is kept under, as far as it can be told without the history.
    #[must_use]
    pub fn now(&self) -> &str {
        self.devices.as_deref().unwrap_or(&self.spelled)
    }

    /// Where the values under the spelling are kept instead.
    fn pointed(&self, connection: &Connection) -> Result<Vec<(String, String)>> {
        let sql = "SELECT key, json_extract(value, '$.kept_under') FROM kept
                   WHERE bench = ? AND json_valid(value) AND json_type(value, '$.kept_under') = 'text'";
        connection.prepare_cached(sql)?.query_map([&self.spelled], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
    }

    /// Every name under which earlier runs on this bench may be found.
    pub fn all(&self, connection: &Connection) -> Result<BTreeSet<String>> {
        let pointed = self.pointed(connection)?.into_iter().map(|(_, name)| name);
        Ok(pointed.chain([self.spelled.clone(), self.now().to_owned()]).collect())
    }

    /// The name that a value is kept under.
    fn holder(&self, connection: &Connection, key: &str) -> Result<String> {
        if let Some(devices) = &self.devices {
            return Ok(devices.clone());
        }
        let pointed = self.pointed(connection)?.into_iter().find(|(pointed, _)| pointed == key);
        Ok(pointed.map_or_else(|| self.spelled.clone(), |(_, name)| name))
    }

    /// The values kept for this bench under a key: the one of these devices first, then that of the devices which had
    /// this spelling before. Empty where nothing was ever kept; a pointer to what is not there is itself the value.
    pub fn kept(&self, connection: &Connection, key: &str) -> Result<Vec<Value>> {
        let mut names = vec![self.holder(connection, key)?];
        let pointed = self.pointed(connection)?.into_iter().filter(|(pointed, _)| pointed == key).map(|(_, name)| name);
        for name in pointed.chain([self.spelled.clone()]) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let values = names.iter().filter_map(|name| read::kept(connection, name, key).transpose());
        let (mut pointers, values): (Vec<Value>, Vec<Value>) =
            values.collect::<Result<Vec<_>>>()?.into_iter().partition(is_pointer);
        pointers.truncate(1);
        Ok(if values.is_empty() { pointers } else { values })
    }

    /// The values kept for all other benches under a key, each with its bench.
    pub fn kept_elsewhere(&self, connection: &Connection, key: &str) -> Result<Vec<(String, Value)>> {
        let own = self.all(connection)?;
        let sql = "SELECT DISTINCT bench FROM kept WHERE key = ?";
        let benches: Vec<String> =
            connection.prepare_cached(sql)?.query_map([key], |row| row.get(0))?.collect::<Result<_>>()?;
        let mut others = Vec::new();
        for bench in benches.into_iter().filter(|bench| !own.contains(bench)) {
            if let Some(value) = read::kept(connection, &bench, key)?.filter(|value| !is_pointer(value)) {
                others.push((bench, value));
            }
        }
        Ok(others)
    }
}

impl Writer<'_> {
    /// Keeps a value for a bench beyond the run, in the place of all that was kept for it under the key.
    pub fn keep_for(&self, name: &BenchName, key: &str, value: Value) -> Result<()> {
        let bench = name.holder(self.connection(), key)?;
        if bench != name.spelled {
            let there = json!({ POINTER: bench });
            self.keep(&Kept { bench: name.spelled.clone(), key: key.to_owned(), value: there })?;
        }
        self.keep(&Kept { bench, key: key.to_owned(), value })
    }
}

#[cfg(test)]
mod tests {
    use super::super::schema;
    use super::*;

    fn name(spelled: &str, devices: Option<&str>) -> BenchName {
        BenchName { spelled: spelled.to_owned(), devices: devices.map(str::to_owned) }
    }

    fn file() -> Connection {
        let mut connection = Connection::open_in_memory().unwrap();
        schema::bring_up_to_date(&mut connection).unwrap();
        connection
    }

    #[test]
    fn a_value_is_found_by_every_spelling_of_its_devices_and_while_they_are_away() {
        let file = file();
        let writer = Writer::new(&file, 1);
        writer.keep_for(&name("by-id", Some("usb 1-2")), "stop", json!(1)).unwrap();
        for (spelled, devices) in [("by-id", Some("usb 1-2")), ("tty", Some("usb 1-2")), ("by-id", None)] {
            assert_eq!(name(spelled, devices).kept(&file, "stop").unwrap(), [json!(1)], "{spelled} {devices:?}");
        }
        assert_eq!(name("tty", None).kept(&file, "stop").unwrap(), Vec::<Value>::new());
        assert_eq!(name("tty", None).kept_elsewhere(&file, "stop").unwrap(), [("usb 1-2".to_owned(), json!(1))]);
        assert_eq!(name("by-id", None).kept_elsewhere(&file, "stop").unwrap(), []);
        // What is changed while they are away is what they come back to, by whatever name.
        writer.keep_for(&name("by-id", None), "stop", json!(2)).unwrap();
        assert_eq!(name("tty", Some("usb 1-2")).kept(&file, "stop").unwrap(), [json!(2)]);
    }

    #[test]
    fn a_pointer_to_nothing_and_what_only_looks_like_one_are_values_that_make_no_sense() {
        let file = file();
        let writer = Writer::new(&file, 1);
        let names = [name("tty", None), name("tty", Some("usb 1-2"))];
        for value in [
            json!({ "kept_under": "nobody" }),
            json!({ "kept_under": null }),
            json!({ "kept_under": 5 }),
            json!({ "kept_under": null, "latched": true }),
            json!({ "kept_under": "nobody", "latched": true }),
        ] {
            writer.keep(&Kept { bench: "tty".to_owned(), key: "stop".to_owned(), value: value.clone() }).unwrap();
            for name in &names {
                assert_eq!(name.kept(&file, "stop").unwrap(), std::slice::from_ref(&value), "{name:?}");
            }
        }
    }

    #[test]
    fn what_an_older_version_kept_under_the_spelling_is_found_until_there_is_something_newer() {
        let file = file();
        let writer = Writer::new(&file, 1);
        writer.keep(&Kept { bench: "by-id".to_owned(), key: "stop".to_owned(), value: json!("old") }).unwrap();
        let now = name("by-id", Some("usb 1-2"));
        assert_eq!(now.kept(&file, "stop").unwrap(), [json!("old")]);
        writer.keep_for(&now, "stop", json!("new")).unwrap();
        assert_eq!(now.kept(&file, "stop").unwrap(), [json!("new")]);
    }

    #[test]
    fn other_devices_under_the_same_spelling_leave_those_before_what_they_have() {
        let file = file();
        let writer = Writer::new(&file, 1);
        let (first, second) = (name("ttyUSB0", Some("usb 1-2")), name("ttyUSB0", Some("usb 1-3")));
        writer.keep_for(&first, "stop", json!("latched")).unwrap();
        assert_eq!(second.kept(&file, "stop").unwrap(), [json!("latched")], "it may be the same, plugged in elsewhere");
        assert_eq!(second.all(&file).unwrap(), ["ttyUSB0", "usb 1-2", "usb 1-3"].map(str::to_owned).into());
        writer.keep_for(&second, "stop", json!("reset")).unwrap();
        assert_eq!(second.kept(&file, "stop").unwrap(), [json!("reset")]);
        assert_eq!(name("ttyUSB1", Some("usb 1-2")).kept(&file, "stop").unwrap(), [json!("latched")]);
    }
}
