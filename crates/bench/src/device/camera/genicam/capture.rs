//! Taking frames off a camera's stream.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use viva_genicam::{Frame as Block, GenicamError, StreamStats};

use super::super::controls::KeptControls;
use super::super::feed::{Capture, Count, Judge, News, Outlet};
use super::super::unpack::{UnpackError, unpack};
use super::bounded::{OPEN_WITHIN, Wanted, within};
use super::dating::{Dating, HELD};
use super::features;
use super::find;
use super::hold::Hold;
use super::known::InUse;
use super::read::Opened;
use super::setup::{self, Agreed};
use super::transport::{Device, Frames, Transport};
use crate::config::{CameraConfig, ControlValue};
use crate::device::light::{ControlName, LightControl};
use plenoptics::raw::{Layout, PixelFormat, RawImage};

/// How long a frame is waited for before orders and the camera's state are looked at: where there are no timestamps, a frame
/// counts as so much older than it is.
const SLICE: Duration = Duration::from_millis(10);
/// How often the camera's clock is read, so that it cannot drift away.
const LATCH_EVERY: Duration = Duration::from_secs(1);

/// What is to be done with the camera between two frames.
pub(super) enum Order {
    /// Tell exposure and gain.
    Tell(oneshot::Sender<Result<Vec<LightControl>, String>>),
    /// Set one of them.
    Set(ControlName, f64, oneshot::Sender<Result<(), String>>),
}

/// What the capture thread works with.
pub(super) struct Capturer {
    pub(super) config: CameraConfig,
    pub(super) set_by_hand: Arc<KeptControls>,
    pub(super) format: PixelFormat,
    pub(super) outlet: Outlet,
    pub(super) orders: Receiver<Order>,
    /// Why the camera's clock was not believed, where it was given up for that: it is opened anew to go by arrival, and by
    /// its clock again once it was away.
    pub(super) distrusted: Option<String>,
    /// Whether a frame came since the camera was last away.
    pub(super) has_sent: bool,
}

/// What is known of the stream since it began.
struct Stream {
    identity: String,
    agreed: Agreed,
    hold: Hold,
    dating: Dating,
    latched_at: Instant,
    seen: StreamStats,
    judge: Judge,
    good_at: Instant,
    /// When a frame last came or was lost.
    heard_at: Instant,
    /// Why the last frame was not good.
    damage: Option<String>,
}

impl Capture for Capturer {
    fn outlet(&self) -> &Outlet {
        &self.outlet
    }

    fn capture(&mut self) -> Result<(), String> {
        self.refuse_orders();
        let mut controls = self.config.controls.clone();
        controls.extend(self.set_by_hand.lock().unwrap_or_else(PoisonError::into_inner).clone());
        let (config, format, size) = (self.config.clone(), self.format, self.outlet.size());
        let distrusted = self.distrusted.take();
        let running =
            within(OPEN_WITHIN, move |wanted| Running::begin(&config, &controls, (format, size), distrusted, wanted));
        // One that cannot be opened is away, and may come back by another cable.
        self.has_sent &= running.is_ok();
        let Running { mut opened, mut frames, mut stream, in_use } = running?;
        self.outlet.pace(stream.agreed.interval);
        let ended = self.take_frames(&mut opened.device, &mut frames, &mut stream);
        if stream.hold.is_silent() {
            // To let go of it takes as long as its answers are waited for, and nobody is to take its last picture for a new
            // one until then. Until then it is in use.
            let let_go = move || drop((frames, opened, in_use));
            let let_go = std::thread::Builder::new().name("camera-gone".to_owned()).spawn(let_go);
            if let Err(error) = let_go {
                tracing::warn!(%error, "there is no thread to let go of a camera in");
            }
        } else {
            // Whoever has the camera now is not disturbed: the library refuses to write what it has no control of.
            let _ = opened.device.acquisition_stop();
            // In use until it is let go of: who lists cameras does not open it before that.
            drop((frames, opened, in_use));
        }
        ended
    }
}

/// A camera that is this program's own and sends frames.
struct Running {
    frames: Frames,
    stream: Stream,
    opened: Opened,
    in_use: InUse,
}

impl Running {
    /// Finds, opens and sets up the camera, and has it begin, while that is `wanted`. Why its clock was not believed is told,
    /// where it was given up for that.
    ///
    /// # Errors
    /// Why not, in words.
    fn begin(
        config: &CameraConfig,
        controls: &BTreeMap<String, ControlValue>,
        (format, size): (PixelFormat, (usize, usize)),
        distrusted: Option<String>,
        wanted: &Wanted,
    ) -> Result<Self, String> {
        let target = find::resolve(config)?;
        let (in_use, mut opened) = find::open(&target, wanted)?;
        let device = &mut opened.device;
        let hold = Hold::of(device);
        let mut agreed = setup::agree(device, config, controls, format, size)?;
        let clock = match distrusted.map_or_else(|| setup::clock(device, config), |why| Err(Some(why))) {
            Ok(clock) => Some(clock),
            Err(note) => {
                agreed.notes.extend(note);
                None
            }
        };
        let frame_bytes = format.row_bytes(size.0 * size.1);
        let room = || setup::room_by_arrival(frame_bytes, super::most_buffer_bytes());
        let room = clock.is_none().then(room);
        // Which takes control again, if it was lost.
        wanted.check()?;
        let frames = setup::open_stream(device, config, room, HELD)?;
        wanted.check()?;
        device.acquisition_start().map_err(|error| format!("it does not start: {}", features::why(&error)))?;
        if let Err(why) = wanted.check() {
            let _ = device.acquisition_stop();
            return Err(why);
        }
        let now = Instant::now();
        let buffered = room.map_or(0, |room| match device.transport() {
            Transport::Gige(_) => setup::buffered(room, frame_bytes),
            Transport::Usb(_) => setup::in_transfers(frame_bytes),
        });
        let delays = (Duration::from_millis(config.pipeline_delay_ms), Duration::from_millis(config.timeout_ms));
        let stream = Stream {
            identity: target.identity(),
            dating: Dating::new((config.timestamp_means, clock), agreed.interval, buffered, delays, now),
            agreed,
            hold,
            latched_at: now,
            seen: frames.stats(),
            judge: Judge::default(),
            good_at: now,
            heard_at: now,
            damage: None,
        };
        Ok(Self { frames, stream, opened, in_use })
    }
}

impl Capturer {
    /// What was asked of a camera that is away is not kept for when it comes.
    fn refuse_orders(&self) {
        while let Ok(order) = self.orders.try_recv() {
            drop(order);
        }
    }

    fn take_frames(&mut self, device: &mut Device, frames: &mut Frames, stream: &mut Stream) -> Result<(), String> {
        let timeout = Duration::from_millis(self.config.timeout_ms);
        while !self.outlet.has_ended() {
            stream.hold.check(device)?;
            self.follow_orders(device, stream)?;
            self.renew_clock(device, stream)?;
            let asked_at = Instant::now();
            let mut newest = None;
            let mut wait = SLICE;
            loop {
                match frames.next(wait) {
                    Ok(Some(block)) => {
                        self.outlet.seq = self.outlet.seq.saturating_add(1);
                        newest = Some(block);
                        wait = Duration::ZERO;
                    }
                    Err(GenicamError::Timeout(_)) => break,
                    Ok(None) => return Err("its stream has ended".to_owned()),
                    Err(error) => {
                        let why = features::why(&error);
                        return Err(stream
                            .hold
                            .check(device)
                            .err()
                            .unwrap_or(format!("waiting for a frame failed: {why}")));
                    }
                }
            }
            let stats = frames.stats();
            // What waits in the camera meanwhile is older than its arrival says.
            if stats.transfer_errors > stream.seen.transfer_errors && !stream.dating.has_clock() {
                return Err("a transfer of its frames failed, and it has no clock to date the next ones by".to_owned());
            }
            let mut count = self.count(&stats, stream);
            let lost = count.lost > 0 || count.damaged > 0;
            if lost {
                stream.dating.lost();
            }
            let news = newest.is_some() || lost;
            if news {
                stream.heard_at = Instant::now();
            }
            if let Some(block) = newest
                && let Some(damage) = self.see(device, stream, block)?
            {
                count.damaged = count.damaged.saturating_add(1);
                stream.damage = Some(damage);
            }
            // Nothing waited after it was asked for.
            stream.dating.nothing_waited(asked_at);
            self.has_sent |= stream.dating.has_begun();
            // What came by then has been seen, however long this program was kept from looking.
            if asked_at.saturating_duration_since(stream.good_at) > timeout {
                return Err(format!(
                    "no good frame came within {} ms; {}",
                    timeout.as_millis(),
                    why_none(device, stream, self.has_sent)
                ));
            }
            if news {
                self.tell(stream, count);
            }
        }
        Ok(())
    }

    /// What was lost since this was last asked.
    fn count(&mut self, stats: &StreamStats, stream: &mut Stream) -> Count {
        let before = std::mem::replace(&mut stream.seen, *stats);
        let damaged = stats.frames_incomplete.saturating_sub(before.frames_incomplete);
        let lost = [
            (stats.frames_missed, before.frames_missed),
            (stats.frames_backpressure, before.frames_backpressure),
            (stats.frames_unsupported, before.frames_unsupported),
        ];
        let lost = lost.into_iter().fold(0u64, |sum, (now, then)| sum.saturating_add(now.saturating_sub(then)));
        // That is what a packet says of its frame's number: there was time for so many.
        let time = stream.heard_at.elapsed().as_secs_f64();
        let lost = lost.min((time / stream.agreed.interval.as_secs_f64()) as u64 + 1);
        self.outlet.seq = self.outlet.seq.saturating_add(lost).saturating_add(damaged);
        if damaged > 0 {
            let packets = stats.packets_missing.saturating_sub(before.packets_missing);
            stream.damage = Some(match packets {
                0 => format!("{damaged} frames ended early"),
                packets => format!("{packets} packets of {damaged} frames did not come"),
            });
        }
        Count { lost, damaged }
    }

    /// Publishes a frame, or says why it is damaged.
    ///
    /// # Errors
    /// What no later frame will mend.
    fn see(&mut self, device: &Device, stream: &mut Stream, block: Block) -> Result<Option<String>, String> {
        let (width, height) = self.outlet.size();
        let name = block.pixel_format.to_string();
        if (block.width as usize, block.height as usize) != (width, height) || name != self.format.name() {
            return Err(format!(
                "its frames are {}x{} {name} instead of the configured {width}x{height} {}",
                block.width,
                block.height,
                self.format.name()
            ));
        }
        // Cameras that leave the rows of their trailers at 0 have been seen.
        if !block.is_complete() || block.delivered_height.is_some_and(|rows| (1..block.height).contains(&rows)) {
            return Ok(Some("it ended early".to_owned()));
        }
        let ticks = block.ts_dev;
        match image_of(block, width, height, self.format) {
            Ok(image) => {
                let image = Arc::new(image);
                let now = Instant::now();
                let dated = stream.dating.date(ticks, self.outlet.seq, now);
                let window = dated.map_err(|why| self.distrust(why))?;
                stream.good_at = Instant::now();
                stream.damage = None;
                self.outlet.pace(stream.dating.interval());
                if let Some(window) = window {
                    self.outlet.publish(Arc::clone(&image), self.outlet.seq, (window, now.into()));
                }
                stream.judge.see(&image, self.format.white_level(), || features::of_brightness(device));
                Ok(None)
            }
            Err(error @ (UnpackError::Stride { .. } | UnpackError::Depth { .. })) => {
                Err(format!("its frames are not what {} says: {error}", self.format.name()))
            }
            Err(error) => Ok(Some(error.to_string())),
        }
    }

    /// Has the camera opened anew without its clock, and says so.
    fn distrust(&mut self, why: String) -> String {
        let told = format!("{why}; it is opened anew for that");
        self.distrusted = Some(why);
        told
    }

    fn renew_clock(&mut self, device: &Device, stream: &mut Stream) -> Result<(), String> {
        if !stream.dating.has_clock() || stream.latched_at.elapsed() < LATCH_EVERY {
            return Ok(());
        }
        stream.latched_at = Instant::now();
        let latch = match device.transport().latch() {
            Ok(latch) => latch,
            // That comes of another's having the camera, or of none.
            Err(why) => {
                return Err(stream.hold.ask(device).err().unwrap_or(format!("its clock cannot be read: {why}")));
            }
        };
        stream.dating.renew(latch).map_err(|why| self.distrust(why))
    }

    fn follow_orders(&self, device: &mut Device, stream: &mut Stream) -> Result<(), String> {
        loop {
            match self.orders.try_recv() {
                Ok(Order::Tell(reply)) => drop(reply.send(features::light(device))),
                Ok(Order::Set(name, value, reply)) => {
                    let done = features::set_light(device, name, value, &self.set_by_hand);
                    // A longer exposure is in force from some frame on; a shorter one may not be yet.
                    let exposure = Duration::try_from_secs_f64(features::exposure_s(device)?).unwrap_or_default();
                    stream.dating.exposes(exposure);
                    self.outlet.pace(stream.dating.interval());
                    drop(reply.send(done));
                }
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return Ok(()),
            }
        }
    }

    fn tell(&self, stream: &Stream, count: Count) {
        self.outlet.tell(News {
            good: stream.damage.is_none(),
            identity: &stream.identity,
            white: self.format.white_level(),
            notes: stream.agreed.notes.iter().cloned().chain(stream.judge.note()).collect(),
            count,
        });
    }
}

/// Why no frames come, as far as the camera's answers and what came before tell.
fn why_none(device: &Device, stream: &mut Stream, has_sent: bool) -> String {
    match (&stream.damage, stream.hold.ask(device), has_sent) {
        (_, Err(why), _) => why,
        (Some(why), Ok(()), _) => format!("the last one was damaged: {why}"),
        (None, Ok(()), true) => {
            "it answers and is this program's own: it has stopped sending, or what it sends is lost on the way"
                .to_owned()
        }
        (None, Ok(()), false) if matches!(device.transport(), Transport::Usb(_)) => {
            "it answers, and none came at all: it has too little power, or its cable or hub loses what it sends"
                .to_owned()
        }
        // A switch between that does not carry large packets.
        (None, Ok(()), false) => {
            "it answers, and none came at all: a firewall (UDP), or a switch that does not carry packets as large; set \
             bench.camera.packet_bytes = 1500"
                .to_owned()
        }
    }
}

/// A frame's pixels; those of 8 bits that lie without padding are not copied.
fn image_of(block: Block, width: usize, height: usize, format: PixelFormat) -> Result<RawImage, UnpackError> {
    let stride = block.row_stride().unwrap_or(0);
    let Block { payload, raw_payload, .. } = block;
    if format.layout() == (Layout::Bytes { first: 0, step: 1 }) && stride == 0 && payload.len() == width * height {
        // The other handle on the same bytes would make it a copy.
        drop(raw_payload);
        return Ok(RawImage::from_u8(width, height, payload.into()));
    }
    unpack(&payload, width, height, stride, format)
}
