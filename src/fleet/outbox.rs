//! What waits to be published: within bounds, and never waited for by whoever puts it here.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use super::message::{Kind, Message};
use crate::telemetry::{self, Dropped};

/// Events that may wait: an hour of a busy bench.
const MOST_EVENTS: usize = 4096;
/// Bytes of events that may wait.
const MOST_BYTES: usize = 8 << 20;
/// Connections on which an event may be sent without being acknowledged. Beyond that it is the event that the broker
/// closes the connection for.
const MOST_ATTEMPTS: u32 = 5;

/// What waits.
#[derive(Default)]
pub(super) struct Outbox {
    waiting: Mutex<Waiting>,
    more: Notify,
}

#[derive(Default)]
struct Waiting {
    events: VecDeque<Message>,
    /// Bytes of the events.
    bytes: usize,
    /// By topic: what holds, and whether it has yet to be published.
    standing: BTreeMap<String, (Message, bool)>,
    /// By topic.
    passing: BTreeMap<String, Message>,
}

impl Waiting {
    fn pop_event(&mut self) -> Option<Message> {
        let event = self.events.pop_front()?;
        self.bytes -= event.size();
        Some(event)
    }
}

impl Outbox {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has a message published when there is a connection. Where no more events may wait, the oldest is given up.
    pub(super) fn put(&self, message: Message) {
        let mut waiting = self.lock();
        match message.kind {
            Kind::Standing => {
                let same = waiting.standing.get(&message.topic).is_some_and(|(before, _)| before.says_as(&message));
                if same {
                    return;
                }
                waiting.standing.insert(message.topic.clone(), (message, true));
            }
            Kind::Passing => {
                waiting.passing.insert(message.topic.clone(), message);
            }
            Kind::Event | Kind::Bound => {
                waiting.bytes += message.size();
                waiting.events.push_back(message);
                while waiting.events.len() > MOST_EVENTS || waiting.bytes > MOST_BYTES {
                    if waiting.pop_event().is_none() {
                        break;
                    }
                    telemetry::mqtt_dropped(Dropped::QueueFull, 1);
                }
                telemetry::mqtt_waiting(waiting.events.len());
            }
        }
        drop(waiting);
        self.more.notify_one();
    }

    /// Returns once something may have been put here since it returned last.
    pub(super) async fn more(&self) {
        self.more.notified().await;
    }

    /// The next message to be published. While an event has been sent in vain before, nothing else that waits for an
    /// acknowledgement is given out beside it (`alone` says whether nothing is on its way): the one that a broker
    /// closes the connection for is then known.
    pub(super) fn next(&self, alone: bool) -> Option<Message> {
        let mut waiting = self.lock();
        let suspect = waiting.events.front().is_some_and(|event| event.attempts > 0);
        if suspect && !alone {
            return None;
        }
        if let Some((message, due)) = waiting.standing.values_mut().find(|(_, due)| *due) {
            *due = false;
            return Some(message.clone());
        }
        while let Some(event) = waiting.pop_event() {
            telemetry::mqtt_waiting(waiting.events.len());
            if event.expires_s().is_ok() {
                return Some(event);
            }
            telemetry::mqtt_dropped(Dropped::Expired, 1);
        }
        while let Some((_, message)) = waiting.passing.pop_first() {
            if message.expires_s().is_ok() {
                return Some(message);
            }
        }
        None
    }

    /// Whether nothing waits that may not be lost.
    pub(super) fn is_done(&self) -> bool {
        let waiting = self.lock();
        waiting.events.is_empty() && waiting.standing.values().all(|(_, due)| !due)
    }

    /// A connection has ended: events of it that were not acknowledged wait again, before all others; what holds is to
    /// be published anew.
    pub(super) fn reopen(&self, unacknowledged: Vec<Message>) {
        let mut waiting = self.lock();
        for (_, due) in waiting.standing.values_mut() {
            *due = true;
        }
        for mut event in unacknowledged.into_iter().rev().filter(|message| message.kind == Kind::Event) {
            event.attempts += 1;
            if event.attempts >= MOST_ATTEMPTS {
                tracing::warn!(
                    topic = event.topic,
                    "an event was sent {MOST_ATTEMPTS} times without being acknowledged"
                );
                telemetry::mqtt_dropped(Dropped::Refused, 1);
                continue;
            }
            waiting.bytes += event.size();
            waiting.events.push_front(event);
        }
        telemetry::mqtt_waiting(waiting.events.len());
    }

    /// Gives up what still waits, and returns how many events that was.
    pub(super) fn give_up(&self) -> usize {
        let mut waiting = self.lock();
        let left = waiting.events.len();
        waiting.events.clear();
        waiting.bytes = 0;
        telemetry::mqtt_dropped(Dropped::ProgramEnded, left as u64);
        telemetry::mqtt_waiting(0);
        left
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn message(kind: Kind, topic: &str, n: u64) -> Message {
        Message::new(kind, topic.to_owned(), &json!({ "n": n })).unwrap()
    }

    fn rest(outbox: &Outbox) -> Vec<String> {
        let envelope = super::super::message::Envelope { boot_id: uuid::Uuid::nil(), session: uuid::Uuid::nil() };
        std::iter::from_fn(|| outbox.next(true))
            .map(|message| {
                let payload: serde_json::Value = serde_json::from_str(&message.payload(&envelope, 0)).unwrap();
                format!("{}{}", message.topic, payload["n"])
            })
            .collect()
    }

    #[tokio::test]
    async fn the_newest_wins_but_of_events_each_counts() {
        let outbox = Outbox::default();
        for n in 0..3 {
            for (kind, topic) in [(Kind::Standing, "s"), (Kind::Event, "e"), (Kind::Passing, "p")] {
                outbox.put(message(kind, topic, n));
            }
        }
        assert!(!outbox.is_done());
        assert_eq!(rest(&outbox), ["s2", "e0", "e1", "e2", "p2"]);
        assert!(outbox.is_done());
        // What holds is not said twice to one broker, and again to the next.
        outbox.put(message(Kind::Standing, "s", 2));
        assert_eq!(rest(&outbox), Vec::<String>::new());
        outbox.reopen(Vec::new());
        assert_eq!(rest(&outbox), ["s2"]);
    }

    #[tokio::test]
    async fn what_is_too_much_goes_from_the_old_end() {
        let outbox = Outbox::default();
        for n in 0..MOST_EVENTS as u64 + 10 {
            outbox.put(message(Kind::Event, "e", n));
        }
        assert_eq!(rest(&outbox)[..2], ["e10", "e11"]);
        let long = "x".repeat(1 << 20);
        for n in 0..20 {
            outbox.put(Message::new(Kind::Event, "e".to_owned(), &json!({ "n": n, "long": long })).unwrap());
        }
        assert_eq!(rest(&outbox).len(), 7);
        assert_eq!(outbox.give_up(), 0);
    }

    #[tokio::test]
    async fn an_event_sent_in_vain_goes_first_and_alone_and_not_for_ever() {
        let outbox = Outbox::default();
        outbox.put(message(Kind::Event, "e", 2));
        let mut unacknowledged =
            vec![message(Kind::Bound, "b", 0), message(Kind::Event, "e", 0), message(Kind::Event, "e", 1)];
        for _ in 1..MOST_ATTEMPTS {
            outbox.reopen(std::mem::take(&mut unacknowledged));
            assert!(outbox.next(false).is_none());
            unacknowledged.extend(outbox.next(true));
        }
        outbox.reopen(unacknowledged);
        assert_eq!(rest(&outbox), ["e1", "e2"]);
    }
}
