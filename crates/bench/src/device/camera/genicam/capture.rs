//! Taking frames off a camera's stream.

use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use viva_genicam::{ControlState, Frame as Block, FrameStream, GenicamError, StreamStats};

use super::super::controls::KeptControls;
use super::super::feed::{Capture, Count, Judge, News, Outlet};
use super::super::unpack::{UnpackError, unpack};
use super::dating::{Dating, HELD};
use super::features::{self, Device};
use super::find;
use super::setup::{self, Agreed};
use crate::config::CameraConfig;
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
}

/// What is known of the stream since it began.
struct Stream {
    identity: String,
    agreed: Agreed,
    dating: Dating,
    latched_at: Instant,
    seen: StreamStats,
    judge: Judge,
    good_at: Instant,
    /// Why the last frame was not good.
    damage: Option<String>,
}

impl Capture for Capturer {
    fn outlet(&self) -> &Outlet {
        &self.outlet
    }

    fn capture(&mut self) -> Result<(), String> {
        self.refuse_orders();
        let info = find::resolve(&self.config)?;
        let (mut device, _in_use) = find::open(&info)?;
        let mut controls = self.config.controls.clone();
        controls.extend(self.set_by_hand.lock().unwrap_or_else(PoisonError::into_inner).clone());
        let mut agreed = setup::agree(&mut device, &self.config, &controls, self.format, self.outlet.size())?;
        let clock =
            match self.distrusted.take().map_or_else(|| setup::clock(&device, &self.config), |why| Err(Some(why))) {
                Ok(clock) => Some(clock),
                Err(note) => {
                    agreed.notes.extend(note);
                    None
                }
            };
        let room = || setup::room_by_arrival(self.frame_bytes(), super::most_buffer_bytes());
        let room = clock.is_none().then(room);
        let mut frames = setup::open_stream(&mut device, &self.config, room)?;
        frames.set_block_timeout(HELD);
        device.acquisition_start().map_err(|error| format!("it does not start: {}", features::why(&error)))?;
        let now = Instant::now();
        let buffered = room.map_or(0, |room| setup::buffered(room, self.frame_bytes()));
        let delays =
            (Duration::from_millis(self.config.pipeline_delay_ms), Duration::from_millis(self.config.timeout_ms));
        self.outlet.pace(agreed.interval);
        let mut stream = Stream {
            identity: find::identity(&info),
            dating: Dating::new((self.config.timestamp_means, clock), agreed.interval, buffered, delays, now),
            agreed,
            latched_at: now,
            seen: frames.stats(),
            judge: Judge::default(),
            good_at: now,
            damage: None,
        };
        let ended = self.take_frames(&mut device, &mut frames, &mut stream);
        // Whoever has the camera now is not disturbed: the library refuses to write what it has no control of.
        let _ = device.acquisition_stop();
        ended
    }
}

impl Capturer {
    /// What was asked of a camera that is away is not kept for when it comes.
    fn refuse_orders(&self) {
        while let Ok(order) = self.orders.try_recv() {
            drop(order);
        }
    }

    fn take_frames(
        &mut self,
        device: &mut Device,
        frames: &mut FrameStream,
        stream: &mut Stream,
    ) -> Result<(), String> {
        let timeout = Duration::from_millis(self.config.timeout_ms);
        while !self.outlet.has_ended() {
            if device.transport().control_state() != ControlState::Held {
                return Err("it let go of this program: another took control of it, or it was restarted".to_owned());
            }
            if stream.good_at.elapsed() > timeout {
                let why = match (&stream.damage, stream.dating.has_begun()) {
                    (Some(why), _) => format!("; the last one was damaged: {why}"),
                    (None, true) => "; unplugged, without power, or taken by another program".to_owned(),
                    // A switch between that does not carry large packets.
                    (None, false) => "; where there were none at all, set bench.camera.packet_bytes = 1500".to_owned(),
                };
                return Err(format!("no good frame came within {} ms{why}", timeout.as_millis()));
            }
            self.follow_orders(device, stream)?;
            self.renew_clock(device, stream)?;
            let asked_at = Instant::now();
            let mut newest = None;
            let mut wait = SLICE;
            loop {
                match frames.next_frame_blocking(wait) {
                    Ok(Some(block)) => {
                        self.outlet.seq = self.outlet.seq.saturating_add(1);
                        newest = Some(block);
                        wait = Duration::ZERO;
                    }
                    Err(GenicamError::Timeout(_)) => break,
                    Ok(None) => return Err("its stream has ended".to_owned()),
                    Err(error) => return Err(format!("waiting for a frame failed: {error}")),
                }
            }
            let mut count = self.count(&frames.stats(), stream);
            let lost = count.lost > 0 || count.damaged > 0;
            if lost {
                stream.dating.lost();
            }
            let news = newest.is_some() || lost;
            if let Some(block) = newest
                && let Some(damage) = self.see(device, stream, block)?
            {
                count.damaged = count.damaged.saturating_add(1);
                stream.damage = Some(damage);
            }
            // Nothing waited after it was asked for.
            stream.dating.nothing_waited(asked_at);
            if news {
                self.tell(stream, count);
            }
        }
        Ok(())
    }

    /// What was lost since this was last asked.
    fn count(&mut self, stats: &StreamStats, stream: &mut Stream) -> Count {
        let before = std::mem::replace(&mut stream.seen, *stats);
        // How many are missed is the network's word.
        let damaged = stats.frames_incomplete.saturating_sub(before.frames_incomplete);
        let lost = [
            (stats.frames_missed, before.frames_missed),
            (stats.frames_backpressure, before.frames_backpressure),
            (stats.frames_unsupported, before.frames_unsupported),
        ];
        let lost = lost.into_iter().fold(0u64, |sum, (now, then)| sum.saturating_add(now.saturating_sub(then)));
        self.outlet.seq = self.outlet.seq.saturating_add(lost).saturating_add(damaged);
        if damaged > 0 {
            let packets = stats.packets_missing.saturating_sub(before.packets_missing);
            stream.damage = Some(format!("{packets} packets of {damaged} frames did not come"));
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
                let dated = stream.dating.date(ticks, self.outlet.seq, Instant::now());
                let window = dated.map_err(|why| self.distrust(why))?;
                stream.good_at = Instant::now();
                stream.damage = None;
                self.outlet.pace(stream.dating.interval());
                if let Some(window) = window {
                    self.outlet.publish(Arc::clone(&image), self.outlet.seq, window);
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

    /// Bytes of a frame as it is sent.
    fn frame_bytes(&self) -> usize {
        let (width, height) = self.outlet.size();
        self.format.row_bytes(width * height)
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
        let latch = setup::latch(device).map_err(|why| format!("its clock cannot be read any more: {why}"))?;
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
