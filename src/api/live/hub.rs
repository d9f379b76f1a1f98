//! Changes, numbered and written once for every viewer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::ws::Utf8Bytes;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use crate::api::types::{JobResource, ServerMessage};
use crate::control::Service;
use crate::control::events::{BenchView, Event, MeasurementView};
use crate::control::job::JobSnapshot;

/// Changes kept, for a viewer that is behind or comes back.
pub(in crate::api) const KEPT: usize = 512;

/// Numbers changes and hands them to viewers, each written as JSON once.
pub(in crate::api) struct Hub {
    boot_id: Uuid,
    /// The newest changes. Locked while a change is handed out, so that a new viewer's place among the changes is
    /// certain.
    newest: Mutex<Newest>,
    changes: broadcast::Sender<Utf8Bytes>,
}

#[derive(Default)]
struct Newest {
    /// Number of the newest change.
    seq: u64,
    /// The changes up to it, oldest first.
    kept: VecDeque<Utf8Bytes>,
}

/// Where a viewer begins.
pub(in crate::api) enum Begin {
    /// With these changes, which follow what it has.
    Replay(Vec<Utf8Bytes>),
    /// With everything as it is: the changes up to this number are in it.
    Snapshot(u64),
}

impl Hub {
    pub(in crate::api) fn new() -> Self {
        Self { boot_id: Uuid::now_v7(), newest: Mutex::default(), changes: broadcast::channel(KEPT).0 }
    }

    fn lock(&self) -> MutexGuard<'_, Newest> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Identity of this run of the program.
    pub(in crate::api) const fn boot_id(&self) -> Uuid {
        self.boot_id
    }

    /// Number of the newest change.
    pub(in crate::api) fn newest(&self) -> u64 {
        self.lock().seq
    }

    /// Every change from now on, and what a viewer that has those up to `after` needs before them.
    pub(in crate::api) fn subscribe(&self, after: Option<u64>) -> (Begin, broadcast::Receiver<Utf8Bytes>) {
        let newest = self.lock();
        let missing =
            after.and_then(|after| newest.seq.checked_sub(after)).and_then(|count| usize::try_from(count).ok());
        let begin = match missing.and_then(|missing| newest.kept.len().checked_sub(missing)) {
            Some(first) => Begin::Replay(newest.kept.range(first..).cloned().collect()),
            None => Begin::Snapshot(newest.seq),
        };
        (begin, self.changes.subscribe())
    }

    /// Numbers a change and hands it out.
    pub(in crate::api) fn publish(&self, event: Event) {
        let mut newest = self.lock();
        newest.seq += 1;
        let (seq, boot_id) = (newest.seq, self.boot_id);
        let message = match event {
            Event::Bench { bench } => ServerMessage::Bench { seq, boot_id, bench },
            Event::Job { job } => ServerMessage::Job { seq, boot_id, job: Box::new(JobResource::from(*job)) },
            Event::Measurement { measurement } => ServerMessage::Measurement { seq, boot_id, measurement },
        };
        let message = text(&message);
        if newest.kept.len() == KEPT {
            newest.kept.pop_front();
        }
        newest.kept.push_back(message.clone());
        // No receiver means that nobody watches.
        let _ = self.changes.send(message);
    }

    /// Everything as it is, for a viewer that has the changes up to `seq`.
    pub(in crate::api) fn snapshot(
        &self,
        seq: u64,
        bench: BenchView,
        jobs: Vec<JobSnapshot>,
        measurement: Option<MeasurementView>,
    ) -> ServerMessage {
        ServerMessage::Snapshot {
            seq,
            boot_id: self.boot_id,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            bench: Box::new(bench),
            jobs: jobs.into_iter().map(JobResource::from).collect(),
            measurement,
        }
    }
}

/// A message as it is sent.
pub(in crate::api) fn text(message: &ServerMessage) -> Utf8Bytes {
    match serde_json::to_string(message) {
        Ok(text) => text.into(),
        Err(error) => {
            // No field of a message can fail to be written; an empty object is what a viewer ignores.
            tracing::error!(%error, "a message cannot be written as JSON");
            Utf8Bytes::from_static("{}")
        }
    }
}

/// Hands the service's events on until it ends or the token says so.
pub(in crate::api) async fn pump(hub: Arc<Hub>, service: Arc<Service>, shutdown: CancellationToken) {
    let mut events = service.subscribe();
    loop {
        let event = tokio::select! {
            event = events.recv() => event,
            () = shutdown.cancelled() => return,
        };
        match event {
            Ok(event) => hub.publish(event),
            Err(RecvError::Lagged(missed)) => {
                tracing::warn!(missed, "events came faster than they could be handed on; the state is sent anew");
                hub.publish(Event::Bench { bench: Box::new(service.bench_view()) });
                for job in service.jobs() {
                    hub.publish(Event::Job { job: Box::new(job) });
                }
                if let Some(measurement) = service.measurement() {
                    hub.publish(Event::Measurement { measurement: Box::new(measurement) });
                }
            }
            Err(RecvError::Closed) => return,
        }
    }
}
