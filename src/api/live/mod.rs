//! The WebSocket: a snapshot, then changes as text; pictures as binary, to who asks for them.
//!
//! A viewer is one task. Changes are bounded and none is skipped: a viewer that cannot follow is cut off with the reason,
//! and one that comes back goes on where it was, if what it missed is kept.
//! Pictures are the opposite: the newest wins, and a viewer that is slow is sent fewer. Neither delays another viewer.

pub(in crate::api) mod hub;
pub(in crate::api) mod stream;

mod watching;

use std::sync::Arc;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code};
use axum::response::Response;
use prost::Message as _;
use serde_json::Value;
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::watch;
use tokio::time::{Instant, MissedTickBehavior};
use tungstenite::error::ProtocolError;
use uuid::Uuid;

use super::App;
use super::error::{Problem, Result};
use super::extract::{Query, parse, parse_member};
use super::live::hub::{Begin, text};
use super::pictures::frame::{milliseconds, monotonic};
use super::pictures::picture::{QUALITIES, Reduce, Skipped, age};
use super::pictures::viewed::{Wanted, map_message, picture_message, picture_of, reading_message};
use super::pictures::viewport::Part;
use super::proto::{self, viewed::What};
use super::types::{ServerMessage, Show, ViewerMessage};
use crate::access::Principal;
use crate::control::ServiceError;
use crate::control::events::FieldMap;
use crate::control::motion::lease::Permit;
use crate::control::reading::Reading;
use crate::device::Frame;
use crate::telemetry::{self, ViewerKind};
use watching::{Metering, Repeated, See, Watching, next_reading, next_seen};

/// Between signs of life.
const TICK: Duration = Duration::from_secs(1);
/// A viewer that takes nothing for so long is cut off.
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// What of it is left to a viewer once the program ends; as much again for its farewell.
const PARTING: Duration = Duration::from_millis(500);
/// A viewer that says nothing for so long, pongs included, is gone.
const SILENCE: Duration = Duration::from_secs(30);
/// Before another frame is tried after one of which no picture could be made.
const RETRY: Duration = Duration::from_millis(500);
/// Longest message of a viewer, bytes.
const MESSAGE_LIMIT: usize = 4096;
/// How long the end may take: saying it and hearing that it was heard.
const FAREWELL: Duration = Duration::from_secs(1);

type Frames = watch::Receiver<Option<Arc<Frame>>>;
type Maps = watch::Receiver<Option<Arc<FieldMap>>>;
type Readings = watch::Receiver<Option<Arc<Reading>>>;

/// The live view: `proto/asyncapi.yaml` says what is sent here.
#[utoipa::path(
    get, path = "/api/v1/ws", operation_id = "open_websocket", tag = "live", params(Follow),
    responses(
        (status = 101, description = "The WebSocket is open; asyncapi.yaml has its messages"),
        (status = 403, description = "A page of another origin", body = Problem,
         content_type = "application/problem+json"),
        (status = 426, description = "No upgrade was asked for", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn ws(
    State(app): State<App>,
    Query(follow): Query<Follow>,
    Extension(principal): Extension<Principal>,
    upgrade: std::result::Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response> {
    let upgrade = upgrade.map_err(|rejection| Problem::upgrade_required(rejection.body_text()))?;
    let viewers = app.viewers.clone();
    Ok(upgrade.max_message_size(MESSAGE_LIMIT).max_frame_size(MESSAGE_LIMIT).on_upgrade(move |socket| {
        viewers.track_future(async move { Viewer::new(app, principal, socket).run(follow).await })
    }))
}

/// Where a viewer that was here before wants to go on.
#[derive(Debug, Clone, Copy, serde::Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct Follow {
    /// Number of the newest change that the viewer has.
    after: Option<u64>,
    /// The run of the program that it is of.
    boot_id: Option<Uuid>,
}

/// Why a viewer's task ends.
enum End {
    /// The connection broke.
    Gone,
    /// The viewer closed, and has yet to be answered.
    Left,
    /// This side closes, and says why.
    Close(u16, &'static str),
}

impl End {
    /// What follows from a message that could not be read.
    fn of(error: axum::Error) -> Self {
        use tungstenite::Error;
        match error.into_inner().downcast_ref::<Error>() {
            Some(Error::Capacity(_)) => Self::Close(close_code::SIZE, "a message may be 4096 bytes long"),
            Some(Error::Utf8(_)) => Self::Close(close_code::INVALID, "a text message has to be UTF-8"),
            Some(Error::Protocol(error)) if *error != ProtocolError::ResetWithoutClosingHandshake => {
                Self::Close(close_code::PROTOCOL, "this breaks the WebSocket protocol")
            }
            _ => Self::Gone,
        }
    }
}

struct Viewer {
    app: App,
    principal: Principal,
    socket: WebSocket,
    watching: Option<Watching>,
    metering: Option<Metering>,
    /// The control lease, where this connection holds it.
    lease: Option<Permit>,
    repeated: Repeated,
    heard_at: Instant,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.let_go();
    }
}

impl Viewer {
    fn new(app: App, principal: Principal, socket: WebSocket) -> Self {
        Self {
            app,
            principal,
            socket,
            watching: None,
            metering: None,
            lease: None,
            repeated: Repeated::default(),
            heard_at: Instant::now(),
        }
    }

    async fn run(mut self, follow: Follow) {
        let end = match self.follow(follow).await {
            Ok(never) => match never {},
            Err(end) => end,
        };
        // From here on nobody watches, and nobody is there for the lease.
        self.let_go();
        let farewell = async {
            match end {
                End::Gone => return,
                // The answer to a close is sent while the next message is awaited.
                End::Left => {}
                End::Close(code, reason) => {
                    let frame = CloseFrame { code, reason: reason.into() };
                    if self.socket.send(Message::Close(Some(frame))).await.is_err() {
                        return;
                    }
                }
            }
            while let Some(Ok(_)) = self.socket.recv().await {}
        };
        let allowed = if self.app.shutdown.is_cancelled() { PARTING } else { FAREWELL };
        let _ = tokio::time::timeout(allowed, farewell).await;
    }

    /// Watches nothing any more, and is no longer there for the lease.
    fn let_go(&mut self) {
        (self.watching, self.metering) = (None, None);
        if let Some(lease) = self.lease.take() {
            self.app.service.leases().disconnect(&lease);
        }
    }

    async fn follow(&mut self, follow: Follow) -> std::result::Result<std::convert::Infallible, End> {
        let boot_id = self.app.hub.boot_id();
        let after = follow.after.filter(|_| follow.boot_id == Some(boot_id));
        let (begin, mut changes) = self.app.hub.subscribe(after);
        match begin {
            Begin::Replay(missed) => {
                for change in missed {
                    self.send(Message::Text(change)).await?;
                }
            }
            Begin::Snapshot(seq) => {
                if let (Some(after), Some(after_boot_id)) = (follow.after, follow.boot_id) {
                    let gap = ServerMessage::Gap { seq, boot_id, after, after_boot_id };
                    self.send(Message::Text(text(&gap))).await?;
                }
                self.send_snapshot(seq).await?;
            }
        }
        let mut tick = tokio::time::interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        tick.reset();
        let shutdown = self.app.shutdown.clone();
        loop {
            tokio::select! {
                biased;
                () = shutdown.cancelled() => return Err(End::Close(close_code::AWAY, "the program is shutting down")),
                change = changes.recv() => match change {
                    Ok(text) => self.send(Message::Text(text)).await?,
                    Err(RecvError::Lagged(_)) => {
                        return Err(End::Close(close_code::POLICY, "more than 512 changes behind: connect anew"));
                    }
                    Err(RecvError::Closed) => return Err(End::Close(close_code::AWAY, "the program is shutting down")),
                },
                message = self.socket.recv() => self.hear(message).await?,
                _ = tick.tick() => self.tick().await?,
                reading = next_reading(&mut self.metering) => {
                    self.send_viewed(What::Reading(reading_message(&reading))).await?;
                }
                what = next_seen(&mut self.watching) => match what {
                    See::Frame(frame) => self.send_picture(frame).await?,
                    See::Map(map) => self.send_map(&map).await?,
                },
            }
        }
    }

    async fn send(&mut self, message: Message) -> std::result::Result<(), End> {
        let shutdown = &self.app.shutdown;
        let closing = async {
            shutdown.cancelled().await;
            tokio::time::sleep(PARTING).await;
        };
        tokio::select! {
            sent = tokio::time::timeout(SEND_TIMEOUT, self.socket.send(message)) => match sent {
                Ok(Ok(())) => Ok(()),
                Ok(Err(_)) | Err(_) => Err(End::Gone),
            },
            // Whoever takes nothing must not hold the program's end up.
            () = closing => Err(End::Gone),
        }
    }

    async fn send_snapshot(&mut self, seq: u64) -> std::result::Result<(), End> {
        let service = &self.app.service;
        let snapshot = self.app.hub.snapshot(seq, service.bench_view(), service.jobs(), service.measurement());
        self.send(Message::Text(text(&snapshot))).await
    }

    async fn tick(&mut self) -> std::result::Result<(), End> {
        if self.heard_at.elapsed() > SILENCE {
            return Err(End::Close(close_code::POLICY, "nothing was heard for 30 s"));
        }
        if !self.app.gate.knows(&self.principal) {
            return Err(End::Close(close_code::POLICY, "the token was revoked, or has expired"));
        }
        let newest = self.watching.as_ref().and_then(|watching| watching.frames.borrow().clone());
        let tick = ServerMessage::Tick {
            seq: self.app.hub.newest(),
            boot_id: self.app.hub.boot_id(),
            now: jiff::Timestamp::now(),
            monotonic_us: monotonic(Instant::now()).as_micros() as u64,
            frame_age_ms: newest.map(|frame| milliseconds(age(&frame))),
        };
        self.send(Message::Text(text(&tick))).await?;
        self.send(Message::Ping(Default::default())).await
    }

    async fn hear(
        &mut self,
        message: Option<std::result::Result<Message, axum::Error>>,
    ) -> std::result::Result<(), End> {
        self.heard_at = Instant::now();
        match message {
            None => Err(End::Gone),
            Some(Err(error)) => Err(End::of(error)),
            Some(Ok(Message::Close(_))) => Err(End::Left),
            Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(()),
            Some(Ok(Message::Binary(_))) => Err(End::Close(close_code::UNSUPPORTED, "send text")),
            Some(Ok(Message::Text(said))) => match self.obey(&said) {
                Ok(None) => Ok(()),
                Ok(Some(answer)) => self.send(Message::Text(text(&answer))).await,
                Err(problem) => self.send_problem(problem).await,
            },
        }
    }

    async fn send_problem(&mut self, problem: Problem) -> std::result::Result<(), End> {
        let (seq, boot_id) = (self.app.hub.newest(), self.app.hub.boot_id());
        self.send(Message::Text(text(&ServerMessage::Problem { seq, boot_id, problem }))).await
    }

    /// Does what a message asks for; what is to be answered.
    fn obey(&mut self, message: &Utf8Bytes) -> Result<Option<ServerMessage>> {
        match parse(message.as_bytes())? {
            ViewerMessage::Pictures { on: false, .. } => (self.watching, self.repeated) = (None, Repeated::default()),
            ViewerMessage::Readings { on: false, .. } => self.metering = None,
            ViewerMessage::Readings { on: true, max_rate_hz, whole } => {
                let interval = interval(max_rate_hz, 120.0)?;
                let mut readings = self.app.service.readings();
                // One that there is already counts as new.
                readings.mark_changed();
                let _whole = whole.then(|| self.app.service.look_on());
                self.metering = Some(Metering { readings, _whole, interval, next_at: Instant::now() });
            }
            ViewerMessage::Hold { lease } => {
                let leases = self.app.service.leases();
                let held = leases.connect(&lease).map_err(ServiceError::from)?;
                if let Some(before) = self.lease.replace(held) {
                    leases.disconnect(&before);
                }
            }
            ViewerMessage::Pictures { on: true, max_rate_hz, reduce, viewport, quality, show, overlay, window } => {
                let part = part(reduce, viewport, show)?;
                let interval = interval(max_rate_hz, 60.0)?;
                if !QUALITIES.contains(&quality) {
                    let detail = format!("quality: {quality} is not within 10 to 100");
                    return Err(Problem::invalid("quality", detail));
                }
                if window > 16 {
                    return Err(Problem::invalid("window", format!("window: {window} is not within 0 to 16")));
                }
                let mut frames = self.app.service.bench().camera.live();
                if let Some(frame) = &*frames.borrow() {
                    part.shown(&frame.image, quality)?;
                }
                let before = self.watching.as_ref().and_then(|watching| watching.watched.as_ref());
                let watched = self.app.viewports.watch(part, quality, before)?;
                // The picture there is counts as new, so that a viewer sees something at once.
                frames.mark_changed();
                let map = overlay.then(|| {
                    let mut map = self.app.service.field_map();
                    map.mark_changed();
                    map
                });
                // What was sent before is on the way still: a viewer that asks for something else is not sent more for it.
                let unseen = self.watching.take().map_or_else(Vec::new, |before| before.unseen);
                self.watching = Some(Watching {
                    frames,
                    map,
                    _viewing: telemetry::viewing(ViewerKind::WebSocket),
                    _spacing: self.app.service.look_on(),
                    wanted: Wanted { show, part, quality },
                    watched,
                    told: None,
                    interval,
                    next_at: Instant::now(),
                    window,
                    unseen,
                    skipped: Skipped::default(),
                });
            }
            ViewerMessage::Clock { asked_ms } => {
                let (seq, boot_id) = (self.app.hub.newest(), self.app.hub.boot_id());
                let (now, monotonic_us) = (jiff::Timestamp::now(), monotonic(Instant::now()).as_micros() as u64);
                return Ok(Some(ServerMessage::Clock { seq, boot_id, asked_ms, now, monotonic_us }));
            }
            ViewerMessage::Seen { seq } => {
                if let Some(watching) = &mut self.watching {
                    watching.unseen.retain(|&unseen| unseen > seq);
                }
            }
        }
        Ok(None)
    }

    async fn send_picture(&mut self, frame: Arc<Frame>) -> std::result::Result<(), End> {
        let Some(watching) = &mut self.watching else { return Ok(()) };
        let picture = match picture_of(&self.app, frame, watching.wanted).await {
            Ok(picture) => picture,
            Err(problem) => {
                // A frame of another kind may come: it is not tried again at once, and said once.
                watching.next_at = Instant::now() + watching.interval.max(RETRY);
                let why = problem.detail.clone();
                if watching.told.replace(why.clone()) == Some(why) {
                    return Ok(());
                }
                return self.send_problem(problem).await;
            }
        };
        watching.told = None;
        let frame = Arc::clone(&picture.frame);
        if watching.skipped.has(frame.seq) {
            return Ok(());
        }
        let dropped = watching.skipped.until(frame.seq);
        // Counted from when it was due: frames that come at the viewer's own rate, a little late, are all sent.
        watching.next_at = (watching.next_at + watching.interval).max(Instant::now());
        if watching.window > 0 {
            watching.unseen.push(frame.seq);
        }
        // What is played from files may well come again.
        let first = if frame.replayed { frame.seq } else { self.app.service.first_alike(&frame).await };
        let alike = self.repeated.note(frame.seq, first);
        let message = picture_message(picture, watching.wanted, watching.skipped.total, alike);
        self.send_viewed(What::Frame(message)).await?;
        telemetry::picture_sent(ViewerKind::WebSocket, age(&frame), dropped);
        Ok(())
    }

    async fn send_map(&mut self, map: &FieldMap) -> std::result::Result<(), End> {
        // It says nothing of what is before the lens by now.
        if map.captured_at < self.app.service.set_up_at() {
            return Ok(());
        }
        self.send_viewed(What::SpacingMap(map_message(map))).await
    }

    async fn send_viewed(&mut self, what: What) -> std::result::Result<(), End> {
        let message = proto::Viewed { what: Some(what) };
        self.send(Message::Binary(message.encode_to_vec().into())).await
    }
}

/// What of the raw frame is asked for.
fn part(reduce: u32, viewport: Option<Value>, show: Show) -> Result<Part> {
    let whole = Reduce::from_number(reduce)
        .ok_or_else(|| Problem::invalid("reduce", format!("reduce: {reduce} is not 1, 2 or 4")))?;
    let Some(viewport) = viewport else { return Ok(Part::Whole(whole)) };
    let wrong = |why| Err(Problem::invalid("viewport", format!("viewport: {why}")));
    if show != Show::Raw {
        return wrong("is of the raw frame, and a view is as large as it is: leave it out, or ask to show raw");
    }
    if whole != Reduce::Not {
        return wrong("says how many pixels the picture has: leave reduce out");
    }
    Part::of_viewport(parse_member("viewport", viewport)?)
}

/// The time between two messages of which so many a second are asked for, `most` at most.
fn interval(max_rate_hz: f64, most: f64) -> Result<Duration> {
    if !(0.1..=most).contains(&max_rate_hz) {
        let detail = format!("max_rate_hz: {max_rate_hz} is not within 0.1 to {most}");
        return Err(Problem::invalid("max_rate_hz", detail));
    }
    Ok(Duration::from_secs_f64(1.0 / max_rate_hz))
}
