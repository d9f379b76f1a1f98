//! Follows the bench and shapes what happens into messages.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde::Serialize;
use serde_json::{Map, Value, json};
use tokio::sync::broadcast::error::{RecvError, TryRecvError};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::alerts::{Alerts, wrong};
use super::message::{Kind, Message};
use super::outbox::Outbox;
use super::rate::Rated;
use super::story::Stories;
use super::topics::Topics;
use crate::config::MqttConfig;
use crate::control::Service;
use crate::control::events::{AxisView, BenchView, Event, MeasurementView, ShellState, StopView};
use crate::control::job::JobSnapshot;
use crate::device::AxisName;

/// Between two looks at what no event tells of: the disk's room, and whether the bench is ready.
const LOOK_INTERVAL: Duration = Duration::from_secs(5);

/// Follows the bench until the token says so, and then to the newest event.
pub(super) async fn follow(
    service: Arc<Service>,
    outbox: Arc<Outbox>,
    topics: Arc<Topics>,
    config: MqttConfig,
    until: CancellationToken,
) {
    // Subscribed first: nothing is missed between the events and what is there already.
    let mut events = service.subscribe();
    let mut follower = Follower {
        service,
        outbox,
        topics,
        stories: Stories::default(),
        alerts: Alerts::default(),
        positions: AxisName::ALL.map(|axis| (axis, None, Rated::new(config.positions_per_s))),
        measurements: Rated::new(config.measurements_per_s),
        disk_free: None,
    };
    follower.catch_up();
    let mut look = tokio::time::interval(LOOK_INTERVAL);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let [focus, e] = &mut follower.positions;
        tokio::select! {
            event = events.recv() => match event {
                Ok(event) => follower.event(event),
                Err(RecvError::Lagged(missed)) => {
                    tracing::warn!(missed, "events came faster than they could be shaped for MQTT; none of a job's is lost");
                    follower.catch_up();
                }
                Err(RecvError::Closed) => return,
            },
            axis = focus.2.next() => follower.publish_axis(&axis),
            axis = e.2.next() => follower.publish_axis(&axis),
            measurement = follower.measurements.next() => {
                let topic = follower.topics.measurement();
                follower.put(Kind::Passing, topic, measurement.captured_at, &Measured { measurement: &measurement });
            }
            _ = look.tick() => {
                follower.disk_free = follower.service.disk_free_bytes();
                let bench = follower.service.bench_view();
                follower.state(&bench);
            }
            () = until.cancelled() => break,
        }
    }
    // What happened before the end belongs to the story.
    loop {
        match events.try_recv() {
            Ok(event) => follower.event(event),
            Err(TryRecvError::Lagged(_)) => follower.catch_up(),
            Err(TryRecvError::Empty | TryRecvError::Closed) => break,
        }
    }
    follower.catch_up();
}

struct Follower {
    service: Arc<Service>,
    outbox: Arc<Outbox>,
    topics: Arc<Topics>,
    stories: Stories,
    alerts: Alerts,
    /// Of each axis: how it was when it was offered last, and what has yet to be published of it.
    positions: [(AxisName, Option<AxisView>, Rated<AxisView>); 2],
    measurements: Rated<MeasurementView>,
    /// Room left on the disk when it was looked at last, bytes.
    disk_free: Option<u64>,
}

impl Follower {
    fn event(&mut self, event: Event) {
        match event {
            Event::Bench { bench } => self.bench(&bench),
            Event::Job { job } => self.job(&job),
            Event::Measurement { measurement } => self.measurements.offer(*measurement),
        }
    }

    /// Tells what is so now, as far as it has not been told.
    fn catch_up(&mut self) {
        for job in self.service.jobs() {
            self.job(&job);
        }
        let bench = self.service.bench_view();
        self.bench(&bench);
    }

    fn job(&mut self, job: &JobSnapshot) {
        for event in self.stories.tell(job) {
            self.put(Kind::Event, self.topics.job(), event.at, &event);
        }
    }

    fn bench(&mut self, bench: &BenchView) {
        for (axis, before, rated) in &mut self.positions {
            let now = bench.axes.iter().find(|view| view.axis == *axis);
            if let Some(now) = now.filter(|now| before.as_ref() != Some(*now)) {
                *before = Some(now.clone());
                rated.offer(now.clone());
            }
        }
        self.state(bench);
    }

    fn publish_axis(&self, axis: &AxisView) {
        self.put(Kind::Passing, self.topics.axis(axis.axis), Timestamp::now(), &Moved { axis });
    }

    /// Publishes how the bench is where that is otherwise than before, and its alerts.
    fn state(&mut self, bench: &BenchView) {
        let state = State::of(&self.service, bench);
        self.put(Kind::Standing, self.topics.state(), Timestamp::now(), &Standing { state: &state });
        let kept = u64::from(self.service.config().record.keep_free_mb) << 20;
        let wrong = wrong(bench, self.disk_free, kept);
        let now = Timestamp::now();
        for alert in self.alerts.update(now, wrong) {
            self.put(Kind::Standing, self.topics.alert(alert.alert), now, &alert);
        }
    }

    fn put(&self, kind: Kind, topic: String, at: Timestamp, body: &impl Serialize) {
        if let Some(message) = Message::of(kind, topic, at, body) {
            self.outbox.put(message);
        }
    }
}

#[derive(Serialize)]
struct Measured<'a> {
    measurement: &'a MeasurementView,
}

#[derive(Serialize)]
struct Moved<'a> {
    axis: &'a AxisView,
}

#[derive(Serialize)]
struct Standing<'a> {
    state: &'a State,
}

/// How the bench is, without what changes all the time.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct State {
    /// Whether it can be worked with.
    ready: bool,
    /// What keeps it from being worked with, one sentence each.
    hindrances: Vec<String>,
    simulated: bool,
    stop: StopView,
    shell: ShellState,
    job: Option<Uuid>,
    /// Who has the control lease.
    lease: Option<Value>,
    camera: Value,
    axes: Map<String, Value>,
    history_fault: Option<String>,
}

impl State {
    fn of(service: &Service, bench: &BenchView) -> Self {
        let hindrances = service.hindrances_of(bench);
        let axis = |axis: &AxisView| {
            let said = json!({
                "connected": axis.connected, "homed": axis.homed, "fault": axis.fault, "failure": axis.failure,
                "disagreements": axis.disagreements,
            });
            (axis.axis.name().to_owned(), said)
        };
        Self {
            ready: hindrances.is_empty(),
            hindrances,
            simulated: bench.simulated,
            stop: bench.stop.clone(),
            shell: bench.shell,
            job: bench.job,
            lease: bench
                .lease
                .as_ref()
                .map(|lease| json!({ "owner": lease.owner, "note": lease.note, "since": lease.since })),
            camera: json!({ "online": bench.camera.online, "fault": bench.camera.fault, "replay": bench.camera.replay }),
            axes: bench.axes.iter().map(axis).collect(),
            history_fault: bench.history_fault.clone(),
        }
    }
}
