//! A message on its way to the broker.

use std::time::Duration;

use jiff::Timestamp;
use serde::Serialize;
use tokio::time::Instant;
use uuid::Uuid;

/// How long a broker keeps a job's event for a subscriber that is away.
pub(super) const EVENT_EXPIRY: Duration = Duration::from_hours(24);
/// How long a measurement or position is worth having.
pub(super) const PASSING_EXPIRY: Duration = Duration::from_secs(60);

/// What becomes of a message that cannot be published at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// What holds until it changes: the newest is published, retained, and again to every broker anew.
    Standing,
    /// What has happened: each is published, in order.
    Event,
    /// What is soon out of date: the newest is published, once, without acknowledgement.
    Passing,
    /// Birth or death, which belong to one connection.
    Bound,
}

impl Kind {
    /// The word for it in the metrics.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Standing => "state",
            Self::Event => "event",
            Self::Passing => "measurement",
            Self::Bound => "birth",
        }
    }

    /// Whether the broker has to acknowledge it (QoS 1).
    pub(super) const fn is_acknowledged(self) -> bool {
        !matches!(self, Self::Passing)
    }

    /// Whether the broker keeps it for whoever subscribes later.
    pub(super) const fn is_retained(self) -> bool {
        matches!(self, Self::Standing | Self::Bound)
    }

    const fn expiry(self) -> Option<Duration> {
        match self {
            Self::Standing | Self::Bound => None,
            Self::Event => Some(EVENT_EXPIRY),
            Self::Passing => Some(PASSING_EXPIRY),
        }
    }
}

/// A message: what it says, and what is to be added once it is sent.
#[derive(Debug, Clone)]
pub(super) struct Message {
    pub(super) kind: Kind,
    pub(super) topic: String,
    /// When what it tells of was so.
    at: Timestamp,
    /// A JSON object with at least one member.
    body: String,
    since: Instant,
    /// Connections on which it was sent and not acknowledged.
    pub(super) attempts: u32,
}

impl Message {
    /// A message of now. `None` where the body cannot be written, which is logged.
    pub(super) fn new(kind: Kind, topic: String, body: &impl Serialize) -> Option<Self> {
        Self::of(kind, topic, Timestamp::now(), body)
    }

    /// A message of an earlier time.
    pub(super) fn of(kind: Kind, topic: String, at: Timestamp, body: &impl Serialize) -> Option<Self> {
        match serde_json::to_string(body) {
            Ok(body) if body.starts_with('{') && body.len() > 2 => {
                Some(Self { kind, topic, at, body, since: Instant::now(), attempts: 0 })
            }
            Ok(_) => {
                tracing::error!(topic, "what is to be published is no JSON object");
                None
            }
            Err(error) => {
                tracing::error!(%error, topic, "what is to be published cannot be written as JSON");
                None
            }
        }
    }

    /// Bytes that it takes up while it waits.
    pub(super) fn size(&self) -> usize {
        self.topic.len() + self.body.len() + 128
    }

    /// Whether it says the same as another.
    pub(super) fn says_as(&self, other: &Self) -> bool {
        self.body == other.body
    }

    /// How long the broker may keep it from now on, s: `Ok(None)` for ever.
    ///
    /// # Errors
    /// It has waited for longer than it is worth.
    pub(super) fn expires_s(&self) -> Result<Option<u32>, Expired> {
        let Some(expiry) = self.kind.expiry() else { return Ok(None) };
        let left = expiry.checked_sub(self.since.elapsed()).map_or(0, |left| left.as_secs());
        if left == 0 { Err(Expired) } else { Ok(Some(u32::try_from(left).unwrap_or(u32::MAX))) }
    }

    /// The payload within a session.
    pub(super) fn payload(&self, envelope: &Envelope, seq: u64) -> String {
        let Envelope { boot_id, session } = envelope;
        format!(
            "{{\"boot_id\":\"{boot_id}\",\"session\":\"{session}\",\"seq\":{seq},\"at\":\"{}\",{}",
            self.at,
            &self.body[1..]
        )
    }
}

/// A message that has waited for longer than it is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Expired;

/// What every message of a connection has in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Envelope {
    /// This run of the program.
    pub(super) boot_id: Uuid,
    /// This connection.
    pub(super) session: Uuid,
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[test]
    fn a_payload_is_its_body_within_an_envelope() {
        let envelope = Envelope { boot_id: Uuid::nil(), session: Uuid::max() };
        let message = Message::new(Kind::Event, "t".to_owned(), &json!({ "event": "log" })).unwrap();
        let payload: Value = serde_json::from_str(&message.payload(&envelope, 7)).unwrap();
        assert_eq!((&payload["seq"], &payload["event"]), (&json!(7), &json!("log")));
        assert_eq!(payload["session"], json!(Uuid::max()));
        assert!(payload["at"].as_str().unwrap().ends_with('Z'), "{payload}");
        assert!(Message::new(Kind::Event, "t".to_owned(), &json!({})).is_none());
        assert!(Message::new(Kind::Event, "t".to_owned(), &7).is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn time_waited_is_taken_from_the_time_to_live() {
        let at = |kind| Message::new(kind, "t".to_owned(), &json!({ "a": 1 })).unwrap();
        let (event, passing, standing) = (at(Kind::Event), at(Kind::Passing), at(Kind::Standing));
        tokio::time::advance(Duration::from_secs(59)).await;
        assert_eq!(passing.expires_s(), Ok(Some(1)));
        tokio::time::advance(Duration::from_secs(1)).await;
        assert_eq!(passing.expires_s(), Err(Expired));
        assert_eq!(event.expires_s(), Ok(Some(86_340)));
        assert_eq!(standing.expires_s(), Ok(None));
    }
}
