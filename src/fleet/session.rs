//! One connection to the broker: birth first, then what waits, and death at an orderly end.

use std::collections::{BTreeMap, VecDeque};
use std::pin::pin;
use std::time::Duration;

use rumqttc::Outgoing;
use rumqttc::v5::mqttbytes::QoS;
use rumqttc::v5::mqttbytes::v5::{ConnAck, Packet, PubAck, PubAckReason, PublishProperties};
use rumqttc::v5::{AsyncClient, ConnectionError, Event, MqttOptions};
use tokio::sync::watch;
use tokio::time::Instant;

use super::message::{Envelope, Kind, Message};
use super::outbox::Outbox;
use super::trouble::Trouble;
use crate::telemetry::{self, Dropped};

/// Messages on their way that the broker has not acknowledged.
const WINDOW: usize = 16;
/// Messages handed to the library that it has not sent.
const HANDED: usize = 32;
/// Packet identifiers in use: more than the window, so that none comes round while its message is on its way.
pub(super) const IDENTIFIERS: u16 = 64;
/// Longest packet without a word of the broker's, bytes.
const LONGEST_PACKET: usize = 1 << 20;
/// What a packet has beside topic and payload, bytes.
const HEAD: usize = 64;
/// Of the time for the end, how long the events before the death may take.
const DRAIN_ALLOWED: Duration = Duration::from_millis(500);
/// How long the end may take altogether: what the broker has not acknowledged by then is counted as left behind.
const LEAVE_ALLOWED: Duration = Duration::from_millis(900);
/// The media type of every payload.
pub(super) const CONTENT_TYPE: &str = "application/json";

/// How a connection came to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum End {
    /// As it was asked to.
    Left,
    /// Otherwise.
    Trouble(Trouble),
}

/// What a session needs.
pub(super) struct Session<'a> {
    pub(super) options: MqttOptions,
    pub(super) envelope: Envelope,
    pub(super) outbox: &'a Outbox,
    /// Why the connection is to be closed, once it is.
    pub(super) leaving: &'a mut watch::Receiver<Option<String>>,
    /// The birth, made once the broker is there.
    pub(super) birth: &'a (dyn Fn() -> Option<Message> + Sync),
    /// The death for a reason.
    pub(super) death: &'a (dyn Fn(&str) -> Option<Message> + Sync),
    /// Told when the broker has taken the birth.
    pub(super) born: &'a (dyn Fn() + Sync),
    pub(super) user: String,
}

impl Session<'_> {
    /// Runs the connection to its end, and gives back what was not acknowledged.
    pub(super) async fn run(self) -> End {
        let Self { options, envelope, outbox, leaving, birth, death, born, user } = self;
        let (client_id, mut patience) = (options.client_id(), patience(options.keep_alive()));
        let (client, mut eventloop) = AsyncClient::new(options, HANDED);
        let mut flight = Flight::new(client, envelope);
        let mut heard_at = Instant::now();
        let mut leave = Leave::No;
        let mut leave_by = None;
        let end = loop {
            // Polling is not to be broken off half-way: what is being written then would be lost.
            let polled = {
                let mut polling = pin!(eventloop.poll());
                loop {
                    let reason = leaving.borrow_and_update().clone();
                    if let Some(reason) = reason {
                        if !flight.open && leave == Leave::No {
                            break Polled::Gone;
                        }
                        leave_by.get_or_insert_with(|| Instant::now() + LEAVE_ALLOWED);
                        leave.advance(outbox, &mut flight, || death(&reason));
                    }
                    tokio::select! {
                        polled = &mut polling => break Polled::Event(Box::new(polled)),
                        () = outbox.more(), if flight.open => flight.fill(outbox),
                        asked = leaving.changed() => if asked.is_err() { break Polled::Gone },
                        () = tokio::time::sleep_until(heard_at + patience) => break Polled::Silence,
                        () = leave.drained() => {}
                        () = until(leave_by) => {
                            tracing::warn!("the MQTT broker did not answer in time; it publishes the last will");
                            break Polled::Gone;
                        }
                    }
                }
            };
            let event = match polled {
                Polled::Gone => break End::Left,
                Polled::Silence => break End::Trouble(Trouble::new("timeout", "the broker has fallen silent")),
                Polled::Event(polled) => match *polled {
                    Ok(event) => event,
                    Err(error) => break End::Trouble(Trouble::of(&error, &client_id, &user)),
                },
            };
            match event {
                Event::Incoming(packet) => {
                    heard_at = Instant::now();
                    match packet {
                        Packet::ConnAck(answer) => {
                            if let Some(keep_alive) = flight.opened(&answer) {
                                patience = self::patience(keep_alive);
                            }
                            if let Some(birth) = birth() {
                                flight.send(birth);
                            }
                        }
                        Packet::PubAck(ack) => {
                            let taken = flight.acknowledged(&ack);
                            if taken == Some(Kind::Bound) && leave == Leave::No {
                                born();
                            }
                        }
                        _ => {}
                    }
                }
                Event::Outgoing(Outgoing::Publish(id)) => flight.sent(id),
                Event::Outgoing(Outgoing::AwaitAck(_)) => {
                    let detail = "the broker acknowledges messages and leaves older ones without an answer";
                    break End::Trouble(Trouble::new("protocol", detail));
                }
                // It has been handed to the system; the broker closes.
                Event::Outgoing(Outgoing::Disconnect) => break End::Left,
                Event::Outgoing(_) => {}
            }
            flight.fill(outbox);
        };
        outbox.reopen(flight.left());
        end
    }
}

/// What came of waiting for the broker.
enum Polled {
    /// Something happened, or the connection ended.
    Event(Box<Result<Event, ConnectionError>>),
    /// Nothing was heard for too long.
    Silence,
    /// The link is given up: the broker was not there yet, or does not answer in time.
    Gone,
}

/// How long nothing may be heard: the library asks for a sign of life once in the time.
fn patience(keep_alive: Duration) -> Duration {
    keep_alive.saturating_add(keep_alive / 2)
}

/// Returns at a time; never where there is none.
async fn until(time: Option<Instant>) {
    match time {
        Some(time) => tokio::time::sleep_until(time).await,
        None => std::future::pending().await,
    }
}

/// How far an orderly end is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Leave {
    /// Nobody has asked for it.
    No,
    /// What waits is still published, until then.
    Draining(Instant),
    /// The death is on its way.
    Dying,
    /// The broker has been told.
    Told,
}

impl Leave {
    /// Takes the next step, as soon as it can be taken.
    fn advance(&mut self, outbox: &Outbox, flight: &mut Flight, death: impl FnOnce() -> Option<Message>) {
        if *self == Self::No {
            flight.fill(outbox);
            *self = Self::Draining(Instant::now() + DRAIN_ALLOWED);
        }
        if let Self::Draining(until) = *self
            && ((outbox.is_done() && flight.is_landed()) || Instant::now() >= until)
        {
            flight.open = false;
            if let Some(death) = death() {
                flight.send(death);
            }
            *self = Self::Dying;
        }
        // Without the acknowledgement the broker might forget it with the connection.
        if *self == Self::Dying && flight.is_landed() {
            flight.disconnect();
            *self = Self::Told;
        }
    }

    /// Returns when draining has taken long enough.
    async fn drained(self) {
        until(if let Self::Draining(until) = self { Some(until) } else { None }).await;
    }
}

/// What is on its way.
struct Flight {
    client: AsyncClient,
    envelope: Envelope,
    /// Whether the broker is there for what waits.
    open: bool,
    seq: u64,
    longest_packet: usize,
    /// Handed to the library and not yet sent, in order.
    handed: VecDeque<(u64, Message)>,
    /// Sent and not yet acknowledged, by packet identifier, with its place in the order.
    unacknowledged: BTreeMap<u16, (u64, Message)>,
}

impl Flight {
    fn new(client: AsyncClient, envelope: Envelope) -> Self {
        Self {
            client,
            envelope,
            open: false,
            seq: 0,
            longest_packet: LONGEST_PACKET,
            handed: VecDeque::new(),
            unacknowledged: BTreeMap::new(),
        }
    }

    /// The broker is there. Returns how often it wants a sign of life, where it says.
    fn opened(&mut self, answer: &ConnAck) -> Option<Duration> {
        self.open = true;
        let said = answer.properties.as_ref()?;
        if let Some(longest) = said.max_packet_size {
            self.longest_packet = longest as usize;
        }
        said.server_keep_alive.map(|s| Duration::from_secs(s.into()))
    }

    fn on_their_way(&self) -> usize {
        self.handed.len() + self.unacknowledged.len()
    }

    fn is_landed(&self) -> bool {
        self.handed.is_empty() && self.unacknowledged.is_empty()
    }

    /// Hands on what waits, as much as may be on its way.
    fn fill(&mut self, outbox: &Outbox) {
        while self.open && self.on_their_way() < WINDOW {
            let Some(message) = outbox.next(self.is_landed()) else { return };
            self.send(message);
        }
    }

    /// Hands a message on. Numbered only now, so that a gap in the numbers is a message lost on the way.
    fn send(&mut self, message: Message) {
        let Ok(expiry) = message.expires_s() else { return };
        let payload = message.payload(&self.envelope, self.seq);
        if payload.len() + message.topic.len() + HEAD > self.longest_packet {
            tracing::warn!(
                topic = message.topic,
                bytes = payload.len(),
                longest = self.longest_packet,
                "a message is longer than the MQTT broker takes"
            );
            telemetry::mqtt_dropped(Dropped::TooLong, 1);
            return;
        }
        let properties = PublishProperties {
            payload_format_indicator: Some(1),
            message_expiry_interval: expiry,
            content_type: Some(CONTENT_TYPE.to_owned()),
            ..PublishProperties::default()
        };
        let qos = if message.kind.is_acknowledged() { QoS::AtLeastOnce } else { QoS::AtMostOnce };
        let (topic, retain) = (message.topic.as_str(), message.kind.is_retained());
        match self.client.try_publish_with_properties(topic, qos, retain, payload, properties) {
            Ok(()) => {
                self.handed.push_back((self.seq, message));
                self.seq += 1;
            }
            Err(error) => {
                // There is room for all that may be on its way, and topics have been checked.
                tracing::error!(%error, topic = message.topic, "a message cannot be handed on");
                telemetry::mqtt_dropped(Dropped::Refused, 1);
            }
        }
    }

    /// The library has sent the next message, under this identifier; 0 where no acknowledgement comes.
    fn sent(&mut self, id: u16) {
        let Some((place, message)) = self.handed.pop_front() else { return };
        if id == 0 {
            telemetry::mqtt_published(message.kind.word());
        } else {
            self.unacknowledged.insert(id, (place, message));
        }
    }

    /// The broker has answered; returns what the message was, where it was taken.
    fn acknowledged(&mut self, ack: &PubAck) -> Option<Kind> {
        let (_, message) = self.unacknowledged.remove(&ack.pkid)?;
        if matches!(ack.reason, PubAckReason::Success | PubAckReason::NoMatchingSubscribers) {
            telemetry::mqtt_published(message.kind.word());
            return Some(message.kind);
        }
        let why = ack.properties.as_ref().and_then(|said| said.reason_string.as_deref()).unwrap_or_default();
        tracing::warn!(topic = message.topic, reason = ?ack.reason, why, "the MQTT broker refuses a message");
        telemetry::mqtt_dropped(Dropped::Refused, 1);
        None
    }

    fn disconnect(&self) {
        if let Err(error) = self.client.try_disconnect() {
            tracing::warn!(%error, "the MQTT broker cannot be left in good order");
        }
    }

    /// What the broker has not acknowledged, in order.
    fn left(self) -> Vec<Message> {
        let mut left: Vec<(u64, Message)> = self.unacknowledged.into_values().chain(self.handed).collect();
        left.sort_by_key(|(place, _)| *place);
        left.into_iter().map(|(_, message)| message).collect()
    }
}
