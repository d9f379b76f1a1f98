//! The link to the broker: one connection after another, with pauses between them that grow, and never the bench's
//! concern.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use futures_util::FutureExt as _;
use jiff::Timestamp;
use rand::RngExt as _;
use rumqttc::v5::MqttOptions;
use rumqttc::v5::mqttbytes::QoS;
use rumqttc::v5::mqttbytes::v5::{LastWill, LastWillProperties};
use rumqttc::{TlsConfiguration, Transport};
use serde::Serialize;
use serde_json::json;
use tokio::sync::watch;
use tokio::time::Instant;
use uuid::Uuid;

use super::message::{Envelope, Kind, Message};
use super::outbox::Outbox;
use super::session::{CONTENT_TYPE, End, IDENTIFIERS, Session};
use super::tls;
use super::topics::{Topics, level};
use super::trouble::Trouble;
use crate::config::{Broker, MqttConfig, MqttTlsConfig};
use crate::control::Service;
use crate::control::events::{BenchView, MeasurementView};
use crate::telemetry;

/// Pause after the first connection that fails; it doubles with each that follows.
const SHORTEST_PAUSE: Duration = Duration::from_secs(1);
/// Longest pause.
const LONGEST_PAUSE: Duration = Duration::from_mins(1);
/// A connection that lasted so long was a good one: the pauses begin anew.
const GOOD: Duration = Duration::from_secs(30);
/// Longest wait for a broker to answer, TLS included, s.
const CONNECT_ALLOWED_S: u64 = 5;
/// Longest password taken from a file, bytes.
const LONGEST_PASSWORD: usize = 1024;
/// Form of the payloads; another number where what was there before is there no more, or means something else.
const FORM: u32 = 1;

/// Where to, and as whom.
#[derive(Debug, Clone)]
pub(super) struct Settings {
    pub(super) broker: Broker,
    pub(super) topics: Topics,
    group: String,
    bench: String,
    client_id: String,
    user: String,
    password_file: std::path::PathBuf,
    keep_alive: Duration,
    tls: MqttTlsConfig,
}

impl Settings {
    /// As the configuration has it; what is left open follows from the machine's name.
    pub(super) fn new(config: &MqttConfig, broker: Broker, host_name: Option<&str>) -> Result<Self, String> {
        let bench = match (config.bench.as_str(), host_name.map(level)) {
            ("", Some(host)) if !host.is_empty() => host,
            ("", _) => return Err("mqtt.bench: this machine has no name; give the bench one".to_owned()),
            (bench, _) => bench.to_owned(),
        };
        let client_id = if config.client_id.is_empty() {
            format!("plenalign-{}-{bench}", config.group)
        } else {
            config.client_id.clone()
        };
        Ok(Self {
            broker,
            topics: Topics::new(&config.topic_prefix, &config.group, &bench),
            group: config.group.clone(),
            bench,
            client_id,
            user: config.user.clone(),
            password_file: config.password_file.clone(),
            keep_alive: Duration::from_secs_f64(config.keep_alive_s.round()),
            tls: config.tls.clone(),
        })
    }

    /// The password of the user; `None` where there is none.
    pub(super) fn password(&self) -> Result<Option<String>, String> {
        let file = &self.password_file;
        if file.as_os_str().is_empty() {
            return Ok(None);
        }
        let wrong = |why: String| format!("mqtt.password_file: {}: {why}", file.display());
        let text = std::fs::read_to_string(file).map_err(|error| wrong(error.to_string()))?;
        let password = text.strip_suffix('\n').unwrap_or(&text);
        let password = password.strip_suffix('\r').unwrap_or(password);
        if password.is_empty() {
            return Err(wrong("holds no password".to_owned()));
        }
        if password.contains('\n') || password.len() > LONGEST_PASSWORD {
            return Err(wrong(format!("holds more than a password: one line of {LONGEST_PASSWORD} bytes at most")));
        }
        Ok(Some(password.to_owned()))
    }

    /// TLS towards the broker, where it is spoken.
    pub(super) fn tls(&self) -> Result<Option<Arc<rustls::ClientConfig>>, String> {
        if self.broker.tls { tls::read(&self.tls).map(Some) } else { Ok(None) }
    }

    /// Whether somebody on the way could read the password.
    pub(super) fn sends_password_in_the_clear(&self) -> bool {
        !self.password_file.as_os_str().is_empty() && !self.broker.tls && !self.broker.is_loopback()
    }

    /// What a connection begins with. Files are read anew for each, so that a new password or certificate counts.
    fn options(&self, will: &Message, envelope: &Envelope) -> Result<MqttOptions, String> {
        let mut options = MqttOptions::new(&self.client_id, &self.broker.host, self.broker.port);
        let will_properties = LastWillProperties {
            delay_interval: None,
            payload_format_indicator: Some(1),
            message_expiry_interval: None,
            content_type: Some(CONTENT_TYPE.to_owned()),
            response_topic: None,
            correlation_data: None,
            user_properties: Vec::new(),
        };
        let payload = will.payload(envelope, 0);
        // What is to be delivered waits here and not at the broker: nothing of a connection outlives it there.
        options
            .set_clean_start(true)
            .set_session_expiry_interval(Some(0))
            .set_keep_alive(self.keep_alive)
            .set_connection_timeout(CONNECT_ALLOWED_S)
            .set_outgoing_inflight_upper_limit(IDENTIFIERS)
            .set_last_will(LastWill::new(&will.topic, payload, QoS::AtLeastOnce, true, Some(will_properties)));
        if !self.user.is_empty() {
            options.set_credentials(&self.user, self.password()?.unwrap_or_default());
        }
        if let Some(tls) = self.tls()? {
            options.set_transport(Transport::tls_with_config(TlsConfiguration::Rustls(tls)));
        }
        Ok(options)
    }
}

/// That the bench is there.
#[derive(Serialize)]
struct Birth<'a> {
    form: u32,
    version: &'static str,
    group: &'a str,
    name: &'a str,
    simulated: bool,
    bench: &'a BenchView,
    measurement: Option<MeasurementView>,
}

/// The link to the broker.
pub(super) struct Link {
    settings: Settings,
    service: Arc<Service>,
    outbox: Arc<Outbox>,
    boot_id: Uuid,
    leaving: watch::Receiver<Option<String>>,
}

impl Link {
    pub(super) fn new(
        settings: Settings,
        service: Arc<Service>,
        outbox: Arc<Outbox>,
        boot_id: Uuid,
        leaving: watch::Receiver<Option<String>>,
    ) -> Self {
        Self { settings, service, outbox, boot_id, leaving }
    }

    /// Connects, again and again, until it is to be left.
    pub(super) async fn run(mut self) {
        let (mut failures, mut said) = (0u32, None::<Trouble>);
        loop {
            let begun = Instant::now();
            let ended = AssertUnwindSafe(self.connect()).catch_unwind().await;
            telemetry::mqtt_connected(false);
            let trouble = match ended {
                Ok(End::Left) => return,
                Ok(End::Trouble(trouble)) => trouble,
                // What a broker sends is taken apart by a library: its mistakes are not to end the link for good.
                Err(_) => Trouble::new("protocol", "what the broker says cannot be used"),
            };
            if self.leaving.borrow().is_some() {
                return;
            }
            telemetry::mqtt_failed(trouble.word);
            failures = if begun.elapsed() >= GOOD { 1 } else { failures.saturating_add(1) };
            let pause = pause(failures, rand::rng().random_range(0.5..1.0));
            let broker = self.settings.broker.to_string();
            // Once for each reason: a broker that is away for a week is no news every minute.
            if said.as_ref() == Some(&trouble) && begun.elapsed() < GOOD {
                tracing::debug!(broker, why = trouble.detail, ?pause, "no connection to the MQTT broker");
            } else {
                tracing::warn!(
                    broker,
                    why = trouble.detail,
                    "no connection to the MQTT broker; it is tried again and again"
                );
            }
            said = Some(trouble);
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                _ = self.leaving.changed() => return,
            }
        }
    }

    async fn connect(&mut self) -> End {
        let Self { settings, service, outbox, leaving, .. } = self;
        let envelope = Envelope { boot_id: self.boot_id, session: Uuid::now_v7() };
        let death = |reason: &str| {
            let body = json!({ "reason": reason });
            Message::new(Kind::Bound, settings.topics.death(), &body)
        };
        let birth = || {
            let bench = service.bench_view();
            let body = Birth {
                form: FORM,
                version: env!("CARGO_PKG_VERSION"),
                group: &settings.group,
                name: &settings.bench,
                simulated: bench.simulated,
                bench: &bench,
                measurement: service.measurement(),
            };
            Message::of(Kind::Bound, settings.topics.birth(), Timestamp::now(), &body)
        };
        let Some(will) = death("the connection was lost") else {
            return End::Trouble(Trouble::new("protocol", "there is no last will"));
        };
        let options = match settings.options(&will, &envelope) {
            Ok(options) => options,
            Err(why) => return End::Trouble(Trouble::new("configuration", why)),
        };
        let broker = settings.broker.to_string();
        let born = || {
            telemetry::mqtt_connected(true);
            tracing::info!(broker, topic = settings.topics.birth(), "connected to the MQTT broker");
        };
        let user = settings.user.clone();
        Session { options, envelope, outbox, leaving, birth: &birth, death: &death, born: &born, user }.run().await
    }
}

/// How long to wait after so many failures in a row: `share` (0.5 to 1) of a time that doubles, so that a hall full of
/// benches does not come back to a broker all at once.
fn pause(failures: u32, share: f64) -> Duration {
    let doubled = SHORTEST_PAUSE.saturating_mul(1 << failures.saturating_sub(1).min(10));
    doubled.min(LONGEST_PAUSE).mul_f64(share)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(config: &MqttConfig, host: Option<&str>) -> Result<Settings, String> {
        Settings::new(config, config.broker()?.unwrap(), host)
    }

    fn config() -> MqttConfig {
        MqttConfig { broker: "mqtt://broker.lab".to_owned(), ..MqttConfig::default() }
    }

    #[test]
    fn names_follow_from_the_machine_unless_given() {
        let from_host = settings(&config(), Some("bench/3")).unwrap();
        assert_eq!(from_host.client_id, "plenalign-benches-bench_3");
        assert_eq!(from_host.topics.birth(), "plenalign/benches/NBIRTH/bench_3");
        let given = MqttConfig { bench: "wet".to_owned(), client_id: "me".to_owned(), ..config() };
        let given = settings(&given, None).unwrap();
        assert_eq!((given.client_id.as_str(), given.topics.death().as_str()), ("me", "plenalign/benches/NDEATH/wet"));
        assert!(settings(&config(), None).unwrap_err().contains("mqtt.bench"));
    }

    #[test]
    fn a_password_is_one_line_of_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("password");
        let with = MqttConfig { user: "ada".to_owned(), password_file: file.clone(), ..config() };
        let with = settings(&with, Some("b")).unwrap();
        assert!(with.password().unwrap_err().contains("mqtt.password_file"));
        for (text, password) in [("secret\n", "secret"), ("a b\r\n", "a b"), ("x", "x")] {
            std::fs::write(&file, text).unwrap();
            assert_eq!(with.password().unwrap().as_deref(), Some(password));
        }
        for (text, words) in [("\n", "no password"), ("a\nb\n", "more than a password")] {
            std::fs::write(&file, text).unwrap();
            assert!(with.password().unwrap_err().contains(words));
        }
        assert!(with.sends_password_in_the_clear());
        assert_eq!(settings(&config(), Some("b")).unwrap().password(), Ok(None));
    }

    #[test]
    fn pauses_grow_and_are_never_alike() {
        assert_eq!(pause(1, 1.0), Duration::from_secs(1));
        assert_eq!(pause(4, 0.5), Duration::from_secs(4));
        for failures in [7, 100, u32::MAX] {
            assert_eq!(pause(failures, 1.0), LONGEST_PAUSE);
        }
    }
}
