//! One viewer of the bridge: what is there is advertised, what is subscribed to is sent, and what a viewer is too slow
//! for is left out.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use futures_util::stream::SplitSink;
use futures_util::{SinkExt as _, StreamExt as _};
use jiff::Timestamp;
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::time::Instant;
use uuid::Uuid;

use super::{Shared, TOPICS};
use crate::api::pictures::picture::{DEFAULT_QUALITY, Reduce, next};
use crate::api::pictures::viewport::whole;
use crate::control::events::{BenchView, Event, MeasurementView};
use crate::control::job::JobSnapshot;
use crate::control::recording::words;
use crate::device::{AxisName, Frame};
use crate::record::foxglove::CompressedImage;
use crate::record::messages::MeterReading;
use crate::record::{DESCRIPTIONS, Topic, nanoseconds, stamp};
use crate::telemetry::{self, ReaderKind};

/// Messages that may wait for a viewer.
const QUEUE: usize = 64;
/// Of these, pictures and readings only while there is so much room: who is slow still gets the rest.
const ROOM_FOR_PICTURES: usize = QUEUE / 2;
/// Between two pictures, at least.
const PICTURE_INTERVAL: Duration = Duration::from_millis(100);
/// A viewer that takes nothing for so long is gone.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// What begins a binary message with data of a subscription.
const MESSAGE_DATA: u8 = 1;
/// How grave a status is: a warning.
const WARNING: u8 = 1;

/// What a viewer asks for.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Asked {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: u32,
}

/// Runs a viewer's session until it goes.
pub(super) async fn run(shared: Shared, socket: WebSocket) {
    let (sink, mut stream) = socket.split();
    let (queue, waiting) = channel(QUEUE);
    let mut viewer = Viewer::new(&shared, queue);
    viewer.say(server_info(&shared));
    viewer.say(advertisement());
    let mut writing = std::pin::pin!(write(sink, waiting));
    let mut events = shared.service.subscribe();
    let mut frames = shared.service.bench().camera.live();
    frames.mark_changed();
    let mut next_picture = Instant::now();
    loop {
        let sees = viewer.has(Topic::PICTURE);
        tokio::select! {
            () = &mut writing => return,
            message = stream.next() => match message {
                Some(Ok(Message::Text(text))) => viewer.hear(&text),
                Some(Ok(Message::Binary(_))) => viewer.refuse(),
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
            },
            event = events.recv() => match event {
                Ok(event) => viewer.event(&event),
                // What it has missed is left out, as what it is too slow for.
                Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => return,
            },
            reading = next_reading(&mut viewer.readings) => viewer.reading(reading),
            frame = async { tokio::time::sleep_until(next_picture).await; next(&mut frames).await }, if sees => {
                let Some(frame) = frame else { return };
                next_picture = Instant::now() + PICTURE_INTERVAL;
                viewer.picture(&frame).await;
            }
        }
    }
}

/// The next reading, or how many were left out before it; never for one who wants none.
async fn next_reading(readings: &mut Option<broadcast::Receiver<Arc<MeterReading>>>) -> Result<Arc<MeterReading>, u64> {
    let Some(each) = readings else { return std::future::pending().await };
    match each.recv().await {
        Ok(reading) => Ok(reading),
        Err(RecvError::Lagged(left_out)) => Err(left_out),
        // The program is ending.
        Err(RecvError::Closed) => std::future::pending().await,
    }
}

/// Hands what waits to the socket until one of them ends.
async fn write(mut sink: SplitSink<WebSocket, Message>, mut waiting: Receiver<Message>) {
    while let Some(message) = waiting.recv().await {
        if !matches!(tokio::time::timeout(SEND_TIMEOUT, sink.send(message)).await, Ok(Ok(()))) {
            return;
        }
    }
}

fn server_info(shared: &Shared) -> Value {
    let simulated = shared.service.bench().is_simulated();
    json!({
        "op": "serverInfo",
        "name": if simulated { "plenalign, SIMULATED bench" } else { "plenalign" },
        "capabilities": [],
        "supportedEncodings": ["protobuf"],
        "metadata": { "version": env!("CARGO_PKG_VERSION"), "simulated": simulated.to_string() },
        "sessionId": Uuid::now_v7().to_string(),
    })
}

fn advertisement() -> Value {
    let schema = BASE64.encode(DESCRIPTIONS);
    let channels: Vec<Value> = TOPICS
        .iter()
        .enumerate()
        .map(|(index, topic)| {
            json!({
                "id": index + 1, "topic": topic.name, "encoding": "protobuf",
                "schemaName": topic.schema, "schema": schema, "schemaEncoding": "protobuf",
            })
        })
        .collect();
    json!({ "op": "advertise", "channels": channels })
}

struct Viewer<'a> {
    shared: &'a Shared,
    queue: Sender<Message>,
    /// Topic of each subscription.
    subscriptions: HashMap<u32, Topic>,
    /// Has the live picture's spacing measured while it is looked at.
    looking: Option<Arc<()>>,
    /// What the meter reads, while that is subscribed to, and how many readings have been left out.
    readings: Option<broadcast::Receiver<Arc<MeterReading>>>,
    readings_left_out: u64,
    /// How many decisions and lines of a job's log have been sent or were there before.
    job: Option<(Uuid, usize, usize)>,
    /// Where the axes stood when they were sent last: focus and e.
    stood: Option<[Option<f64>; 2]>,
    /// Messages left out since the viewer was told.
    left_out: u64,
}

impl<'a> Viewer<'a> {
    fn new(shared: &'a Shared, queue: Sender<Message>) -> Self {
        let newest = shared.service.jobs().last().map(|job| (job.id, job.iterations.len(), job.log.len()));
        Self {
            shared,
            queue,
            subscriptions: HashMap::new(),
            looking: None,
            readings: None,
            readings_left_out: 0,
            job: newest,
            stood: None,
            left_out: 0,
        }
    }

    fn has(&self, topic: Topic) -> bool {
        self.subscriptions.values().any(|subscribed| *subscribed == topic)
    }

    /// Sends a message of the protocol itself.
    fn say(&mut self, message: Value) {
        self.put(Message::Text(message.to_string().into()));
    }

    fn put(&mut self, message: Message) {
        if self.queue.try_send(message).is_err() {
            self.left_out += 1;
        } else if self.left_out > 0 && self.queue.capacity() > ROOM_FOR_PICTURES {
            let left_out = std::mem::take(&mut self.left_out);
            self.status(&format!("{left_out} messages were left out: the connection is too slow for them"));
        }
    }

    fn status(&mut self, words: &str) {
        self.say(json!({ "op": "status", "level": WARNING, "message": words }));
    }

    fn refuse(&mut self) {
        self.status("this bridge is to look on only: it takes subscriptions and no commands");
    }

    fn hear(&mut self, text: &str) {
        match serde_json::from_str(text) {
            Ok(Asked::Subscribe { subscriptions }) => {
                for subscription in subscriptions {
                    self.subscribe(&subscription);
                }
            }
            Ok(Asked::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    self.subscriptions.remove(&id);
                }
            }
            Ok(Asked::Other) => self.refuse(),
            Err(error) => self.status(&format!("a message cannot be understood: {error}")),
        }
        let measured = [Topic::MEASUREMENT, Topic::ANNOTATIONS].into_iter().any(|topic| self.has(topic));
        let service = &self.shared.service;
        self.looking = measured.then(|| self.looking.take().unwrap_or_else(|| service.look_on()));
        let reads = self.has(Topic::READING);
        self.readings = reads.then(|| self.readings.take().unwrap_or_else(|| service.each_reading()));
    }

    fn subscribe(&mut self, subscription: &Subscription) {
        let index = usize::try_from(subscription.channel_id).ok().and_then(|id| id.checked_sub(1));
        let Some(&topic) = index.and_then(|index| TOPICS.get(index)) else {
            return self.status(&format!("there is no channel {}", subscription.channel_id));
        };
        if self.subscriptions.len() >= 4 * TOPICS.len() || self.subscriptions.contains_key(&subscription.id) {
            return self.status(&format!("subscription {} is one too many, or there already", subscription.id));
        }
        self.subscriptions.insert(subscription.id, topic);
        // What is known already is sent at once.
        let service = Arc::clone(&self.shared.service);
        match topic {
            Topic::MEASUREMENT | Topic::ANNOTATIONS => {
                if let Some(measurement) = service.measurement() {
                    self.measurement(&measurement, &[topic]);
                }
            }
            Topic::TRANSFORM | Topic::POSE => {
                self.stood = None;
                self.poses(&service.bench_view());
            }
            _ => {}
        }
    }

    /// Sends a message to every subscription of a topic.
    fn send(&mut self, topic: Topic, message: &impl prost::Message) {
        let ids: Vec<u32> =
            self.subscriptions.iter().filter(|(_, subscribed)| **subscribed == topic).map(|(id, _)| *id).collect();
        for id in ids {
            let mut data = Vec::with_capacity(13 + message.encoded_len());
            data.push(MESSAGE_DATA);
            data.extend_from_slice(&id.to_le_bytes());
            data.extend_from_slice(&nanoseconds(Timestamp::now()).to_le_bytes());
            data.extend_from_slice(&message.encode_to_vec());
            self.put(Message::Binary(data.into()));
        }
    }

    fn event(&mut self, event: &Event) {
        match event {
            Event::Measurement { measurement } => {
                self.measurement(measurement, &[Topic::MEASUREMENT, Topic::ANNOTATIONS]);
            }
            Event::Bench { bench } => self.poses(bench),
            Event::Job { job } => self.job(job),
        }
    }

    fn measurement(&mut self, measurement: &MeasurementView, topics: &[Topic]) {
        if topics.contains(&Topic::MEASUREMENT) {
            self.send(Topic::MEASUREMENT, &words::measurement(measurement));
        }
        if topics.contains(&Topic::ANNOTATIONS) && self.has(Topic::ANNOTATIONS) {
            let map = self.shared.service.field_map().borrow().clone();
            let map = map.filter(|map| map.frame_seq == measurement.frame_seq);
            self.send(Topic::ANNOTATIONS, &words::annotations(measurement, map.as_deref()));
        }
    }

    fn poses(&mut self, bench: &BenchView) {
        let position = |axis| bench.axes.iter().find(|view| view.axis == axis).and_then(|view| view.position_mm);
        let stand = [position(AxisName::Focus), position(AxisName::E)];
        if self.stood == Some(stand) {
            return;
        }
        self.stood = Some(stand);
        let (now, [focus_mm, e_mm]) = (Timestamp::now(), stand);
        for transform in words::transforms(now, focus_mm, e_mm) {
            self.send(Topic::TRANSFORM, &transform);
        }
        if let Some(pose) = words::pose(now, e_mm) {
            self.send(Topic::POSE, &pose);
        }
    }

    fn job(&mut self, job: &JobSnapshot) {
        let (_, iterations, lines) = self.job.filter(|(id, ..)| *id == job.id).unwrap_or((job.id, 0, 0));
        for iteration in job.iterations.iter().skip(iterations) {
            self.send(Topic::DECISION, &words::decision(iteration));
        }
        for line in job.log.iter().skip(lines) {
            self.send(Topic::LOG, &words::line(line));
        }
        // A snapshot of before another one may come after it.
        self.job = Some((job.id, job.iterations.len().max(iterations), job.log.len().max(lines)));
    }

    fn reading(&mut self, reading: Result<Arc<MeterReading>, u64>) {
        let left_out = match reading {
            Ok(reading) if self.queue.capacity() >= ROOM_FOR_PICTURES => {
                let readings_left_out = self.readings_left_out;
                return self.send(Topic::READING, &MeterReading { readings_left_out, ..(*reading).clone() });
            }
            Ok(_) => 1,
            Err(lagged) => lagged,
        };
        self.readings_left_out += left_out;
        self.left_out += left_out;
        telemetry::reading_left_out(ReaderKind::Foxglove, left_out);
    }

    async fn picture(&mut self, frame: &Arc<Frame>) {
        if self.queue.capacity() < ROOM_FOR_PICTURES {
            self.left_out += 1;
            return;
        }
        let encoding = whole(&frame.image, Reduce::Not, DEFAULT_QUALITY).encoding();
        match self.shared.pictures.encode(frame, encoding).await {
            Ok(jpeg) => {
                let picture = CompressedImage {
                    timestamp: Some(stamp(frame.captured_at)),
                    frame_id: "camera".to_owned(),
                    data: jpeg,
                    format: "jpeg".to_owned(),
                };
                self.send(Topic::PICTURE, &picture);
            }
            Err(error) => tracing::error!(%error, seq = frame.seq, "a frame could not be encoded"),
        }
    }
}
