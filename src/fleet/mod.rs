//! Many benches: what happens on this one, published over MQTT 5 to a broker that is configured; off by default.
//!
//! ```text
//!   control's events --> follower --> outbox --> link --> broker
//!                        (shapes)    (bounded)  (one connection after another)
//! ```
//!
//! The follower never waits for the link, nor anything in `control` for either: what the broker does not take waits in
//! the outbox, within bounds, and is counted where it is given up. Topics and payloads are described in
//! `proto/asyncapi-mqtt.yaml` and `docs/mqtt.md`.
//!
//! Deliberately absent: nothing is subscribed to, and no message from a broker commands anything.

mod alerts;
mod follower;
mod link;
mod message;
mod outbox;
mod rate;
mod session;
mod story;
mod tls;
mod topics;
mod trouble;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::{CancellationToken, DropGuard};
use uuid::Uuid;

pub use alerts::ALERTS;
pub use story::EVENTS;
pub use topics::{Topics, forms};

use link::{Link, Settings};
use outbox::Outbox;

use crate::config::MqttConfig;
use crate::control::Service;
use crate::telemetry;

/// How long the end may take, the broker's answers included: less than the daemon has for its streams.
const CLOSING_ALLOWED: Duration = Duration::from_millis(1_000);

/// Everything read and checked that can be wrong before the bench is opened.
pub struct Prepared {
    settings: Settings,
    config: MqttConfig,
}

impl std::fmt::Debug for Prepared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "for {}", self.settings.broker)
    }
}

impl Prepared {
    /// Reads what the configuration names: password, authorities, certificate. `None` where no broker is configured.
    /// `host_name` is this machine's name, which is the bench's where none is given. A password goes without TLS to
    /// this machine alone, unless `insecure`.
    ///
    /// # Errors
    /// What cannot be used, in words, with its key.
    pub fn read(config: &MqttConfig, host_name: Option<&str>, insecure: bool) -> Result<Option<Self>, String> {
        let Some(broker) = config.broker().map_err(|why| format!("mqtt.broker: {why}"))? else { return Ok(None) };
        let settings = Settings::new(config, broker, host_name)?;
        // To be told at the start, and not when a broker is there; every connection reads them again.
        settings.password()?;
        settings.tls()?;
        if settings.sends_password_in_the_clear() {
            if !insecure {
                return Err(format!(
                    "mqtt.broker: the password would be sent to {} for everybody on the way to read: use mqtts://; \
                     --insecure sends it all the same",
                    settings.broker
                ));
            }
            tracing::warn!(broker = %settings.broker, "INSECURE: the password for MQTT can be read on the way");
            eprintln!("plenalign: INSECURE: the password for {} can be read on the way", settings.broker);
        }
        Ok(Some(Self { settings, config: config.clone() }))
    }

    /// Begins to follow the bench and to look for the broker. `boot_id` names this run of the program. Has to be called
    /// within a tokio runtime.
    #[must_use]
    pub fn start(self, service: &Arc<Service>, boot_id: Uuid) -> Fleet {
        let outbox = Arc::new(Outbox::default());
        let (leave, leaving) = watch::channel(None);
        let follow = CancellationToken::new();
        telemetry::mqtt_connected(false);
        telemetry::mqtt_waiting(0);
        let topics = Arc::new(self.settings.topics.clone());
        let follower = follower::follow(
            Arc::clone(service),
            Arc::clone(&outbox),
            Arc::clone(&topics),
            self.config,
            follow.clone(),
        );
        let link = Link::new(self.settings, Arc::clone(service), Arc::clone(&outbox), boot_id, leaving);
        let follow = follow.drop_guard();
        Fleet { outbox, leave, follow, follower: tokio::spawn(follower), link: tokio::spawn(link.run()) }
    }
}

/// The bench's part in a fleet while it is published.
pub struct Fleet {
    outbox: Arc<Outbox>,
    /// Why the link is to be closed, once it is.
    leave: watch::Sender<Option<String>>,
    /// Ends the follower when it is dropped.
    follow: DropGuard,
    follower: JoinHandle<()>,
    link: JoinHandle<()>,
}

impl Fleet {
    /// Publishes what has happened so far, then the bench's death with `reason`, and leaves the broker. Takes no longer
    /// than 1 s: where the broker does not answer by then, it publishes the last will by itself.
    pub async fn close(self, reason: &str) {
        let Self { outbox, leave, follow, follower, mut link } = self;
        let orderly = async {
            drop(follow);
            let _ = follower.await;
            leave.send_replace(Some(reason.to_owned()));
            let _ = (&mut link).await;
        };
        if tokio::time::timeout(CLOSING_ALLOWED, orderly).await.is_err() {
            // It ends by itself before that; this is for what hangs.
            tracing::error!("the link to the MQTT broker does not end");
            link.abort();
        }
        telemetry::mqtt_connected(false);
        let left = outbox.give_up();
        if left > 0 {
            tracing::warn!(left, "events were still to be published over MQTT when the program ended");
        }
    }
}
