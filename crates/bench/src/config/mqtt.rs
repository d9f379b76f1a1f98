//! `[mqtt]`: the broker that events and measurements are published to.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Faults;

/// Most messages a second of one measurement or axis that can be asked for.
const FASTEST_PER_S: f64 = 20.0;

/// `[mqtt]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MqttConfig {
    /// The broker, as `mqtts://broker.lab:8883`, or `mqtt://127.0.0.1:1883` without TLS; empty for none.
    pub broker: String,
    /// What every topic begins with.
    pub topic_prefix: String,
    /// The benches that belong together: the second part of every topic.
    pub group: String,
    /// This bench's name in topics; empty for the machine's name.
    pub bench: String,
    /// How this daemon names itself to the broker; empty for `plenalign-GROUP-BENCH`.
    pub client_id: String,
    /// User name at the broker; empty for none.
    pub user: String,
    /// File with the password, and nothing else, of that user; empty for none.
    pub password_file: PathBuf,
    /// Measurements published a second, at most; 0 for none.
    pub measurements_per_s: f64,
    /// Positions of each axis published a second, at most; 0 for none.
    pub positions_per_s: f64,
    /// A connection on which nothing was heard for half as long again is given up, s.
    pub keep_alive_s: f64,
    /// By what the broker is known, and this daemon to it.
    pub tls: MqttTlsConfig,
}

/// `[mqtt.tls]`
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MqttTlsConfig {
    /// PEM file with the authorities that may vouch for the broker; empty for those that the system trusts.
    pub ca: PathBuf,
    /// PEM file with this daemon's certificate and those that lead to its root; empty for none.
    pub certificate: PathBuf,
    /// PEM file with its key; empty for none.
    pub key: PathBuf,
}

impl Default for MqttConfig {
    fn default() -> Self {
        Self {
            broker: String::new(),
            topic_prefix: "plenalign".to_owned(),
            group: "benches".to_owned(),
            bench: String::new(),
            client_id: String::new(),
            user: String::new(),
            password_file: PathBuf::new(),
            measurements_per_s: 1.0,
            positions_per_s: 1.0,
            keep_alive_s: 30.0,
            tls: MqttTlsConfig::default(),
        }
    }
}

/// Where a broker is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broker {
    /// Its name or address; an address of IPv6 without brackets.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// Whether TLS is spoken with it.
    pub tls: bool,
}

impl Broker {
    /// Whether it is on this machine.
    #[must_use]
    pub fn is_loopback(&self) -> bool {
        self.host == "localhost" || self.host.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback())
    }
}

impl std::fmt::Display for Broker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let scheme = if self.tls { "mqtts" } else { "mqtt" };
        let brackets = if self.host.contains(':') { ("[", "]") } else { ("", "") };
        write!(f, "{scheme}://{}{}{}:{}", brackets.0, self.host, brackets.1, self.port)
    }
}

impl MqttConfig {
    /// The broker; `None` where none is configured.
    ///
    /// # Errors
    /// Why there can be none of that address, in words.
    pub fn broker(&self) -> Result<Option<Broker>, String> {
        let text = self.broker.as_str();
        if text.is_empty() {
            return Ok(None);
        }
        // Never with the text in it: a password may be there.
        let wrong = |why: &str| Err(format!("{why}; give it as mqtts://broker.lab:8883, or as mqtt://127.0.0.1:1883"));
        let (tls, rest) = match text.split_once("://") {
            Some(("mqtts", rest)) => (true, rest),
            Some(("mqtt", rest)) => (false, rest),
            Some(_) => return wrong("the address of a broker begins with mqtts:// or mqtt://"),
            None => return wrong("mqtts:// (TLS) or mqtt:// has to come first"),
        };
        if rest.contains('@') {
            return wrong("user and password do not belong here but in mqtt.user and mqtt.password_file");
        }
        let default_port = if tls { 8883 } else { 1883 };
        let (host, port) = match rest.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
            Some((host, "")) => (host, None),
            Some((host, port)) => match port.strip_prefix(':') {
                Some(port) => (host, Some(port)),
                None => return wrong("between host and port belongs a colon"),
            },
            None => rest.split_once(':').map_or((rest, None), |(host, port)| (host, Some(port))),
        };
        let is_address = host.parse::<std::net::Ipv6Addr>().is_ok();
        let is_name = !host.is_empty() && host.chars().all(|c| c.is_ascii_alphanumeric() || ".-_".contains(c));
        if !is_name && !is_address {
            return wrong("that is no host's name and no address");
        }
        let port = match port.map(str::parse::<u16>) {
            None => default_port,
            Some(Ok(port)) if port > 0 => port,
            Some(_) => return wrong("the port is a number from 1 to 65535, with nothing behind it"),
        };
        Ok(Some(Broker { host: host.to_owned(), port, tls }))
    }

    pub(super) fn check(&self, faults: &mut Faults) {
        let broker = match self.broker() {
            Ok(broker) => broker,
            Err(wrong) => {
                faults.add("mqtt.broker", wrong);
                None
            }
        };
        let is_level = |text: &str| !text.contains(['/', '+', '#']) && !text.chars().any(char::is_control);
        let prefix = &self.topic_prefix;
        let is_prefix = !prefix.starts_with('$') && prefix.split('/').all(|level| !level.is_empty() && is_level(level));
        faults.require(is_prefix, "mqtt.topic_prefix", || {
            format!("{prefix:?} cannot begin a topic: words without '+' and '#', with '/' between, and no '$' in front")
        });
        for (key, text, may_be_empty) in [("mqtt.group", &self.group, false), ("mqtt.bench", &self.bench, true)] {
            faults.require(is_level(text) && (may_be_empty || !text.is_empty()), key, || {
                format!("{text:?} cannot be a part of a topic: one or more characters, and none of '/', '+' and '#'")
            });
        }
        for (key, text) in [("mqtt.client_id", &self.client_id), ("mqtt.user", &self.user)] {
            faults.require(!text.chars().any(char::is_control) && text.len() <= 256, key, || {
                "may be 256 bytes long, without control characters".to_owned()
            });
        }
        let empty = |path: &PathBuf| path.as_os_str().is_empty();
        if !empty(&self.password_file) && self.user.is_empty() {
            faults.add("mqtt.user", "is missing: mqtt.password_file is of no use without it");
        }
        for (key, rate) in
            [("mqtt.measurements_per_s", self.measurements_per_s), ("mqtt.positions_per_s", self.positions_per_s)]
        {
            // Less often than every quarter of an hour would be a mistake of units.
            faults.require(rate == 0.0 || (0.001..=FASTEST_PER_S).contains(&rate), key, || {
                format!("must be 0, or 0.001 to {FASTEST_PER_S}, not {rate}")
            });
        }
        // The client library takes no less than 5 s.
        faults.require((5.0..=3600.0).contains(&self.keep_alive_s), "mqtt.keep_alive_s", || {
            format!("must be 5 to 3600, not {}", self.keep_alive_s)
        });
        let tls = &self.tls;
        for (path, key) in [(&tls.ca, "ca"), (&tls.certificate, "certificate"), (&tls.key, "key")] {
            faults.require(
                empty(path) || broker.as_ref().is_none_or(|broker| broker.tls),
                format!("mqtt.tls.{key}"),
                || "is of no use without TLS: mqtt.broker has to begin with mqtts://".to_owned(),
            );
        }
        let (missing, given) = match (empty(&tls.certificate), empty(&tls.key)) {
            (true, false) => ("certificate", "key"),
            (false, true) => ("key", "certificate"),
            _ => return,
        };
        faults.add(format!("mqtt.tls.{missing}"), format!("is missing: mqtt.tls.{given} is of no use without it"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broker(text: &str) -> Result<Option<Broker>, String> {
        MqttConfig { broker: text.to_owned(), ..MqttConfig::default() }.broker()
    }

    #[test]
    fn a_broker_is_named_by_scheme_host_and_port() {
        let at = |host: &str, port, tls| Ok(Some(Broker { host: host.to_owned(), port, tls }));
        assert_eq!(broker(""), Ok(None));
        assert_eq!(broker("mqtts://broker.lab"), at("broker.lab", 8883, true));
        assert_eq!(broker("mqtt://127.0.0.1:1884"), at("127.0.0.1", 1884, false));
        assert_eq!(broker("mqtts://[2001:db8::1]:8884"), at("2001:db8::1", 8884, true));
        assert_eq!(broker("mqtt://[::1]"), at("::1", 1883, false));
        for text in ["mqtts://broker.lab:8883", "mqtt://[::1]:1883"] {
            assert_eq!(broker(text).unwrap().unwrap().to_string(), text);
        }
        let loopback = |text| broker(text).unwrap().unwrap().is_loopback();
        assert!(loopback("mqtt://localhost") && loopback("mqtt://127.1.2.3") && loopback("mqtt://[::1]"));
        assert!(!loopback("mqtt://broker.lab") && !loopback("mqtt://192.0.2.1"));
    }

    #[test]
    fn what_is_no_broker_is_refused_without_repeating_a_password() {
        for (text, words) in [
            ("broker.lab:1883", "has to come first"),
            ("http://broker.lab", "begins with mqtts://"),
            ("mqtt://", "no host's name"),
            ("mqtt://a b", "no host's name"),
            ("mqtt://broker.lab:0", "1 to 65535"),
            ("mqtt://broker.lab:99999", "1 to 65535"),
            ("mqtt://broker.lab:1883/x", "nothing behind it"),
            ("mqtt://[::1]1883", "a colon"),
            ("mqtt://ada:secret@broker.lab", "mqtt.password_file"),
        ] {
            let why = broker(text).unwrap_err();
            assert!(why.contains(words) && why.contains("mqtts://broker.lab:8883"), "{text}: {why}");
            assert!(!why.contains("secret"), "{why}");
        }
    }
}
