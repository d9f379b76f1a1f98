//! Taking frames off a camera's stream.

use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::oneshot;
use viva_genicam::{ControlState, Frame as Block, FrameStream, GenicamError, StreamStats};

use super::super::controls::KeptControls;
use super::super::exposure::Window;
use super::super::feed::{Capture, Count, Judge, News, Outlet};
use super::super::unpack::{UnpackError, unpack};
use super::clock::{self, DeviceClock};
use super::features::{self, Device};
use super::find;
use super::setup::{self, Agreed};
use crate::config::{CameraConfig, TimestampMeans};
use crate::device::light::{ControlName, LightControl};
use plenoptics::raw::{Layout, PixelFormat, RawImage};

/// How long a frame is waited for before orders and the camera's state are looked at: where there are no timestamps, a frame
/// counts as so much older than it is.
const SLICE: Duration = Duration::from_millis(10);
/// How often the camera's clock is read, so that it cannot drift away.
const LATCH_EVERY: Duration = Duration::from_secs(1);
/// How long a frame is held back at most while an earlier one may still be completed.
const HELD: Duration = Duration::from_millis(100);

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
}

/// What is known of the stream since it began.
struct Stream {
    identity: String,
    agreed: Agreed,
    clock: Option<DeviceClock>,
    latched_at: Instant,
    /// When it was last seen that no frame waits: what is taken has arrived since.
    empty_at: Instant,
    /// When the last frame came, and its number, for the interval that frames really have.
    last: Option<(Instant, u64)>,
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
        let mut device = find::open(&info)?;
        let mut controls = self.config.controls.clone();
        controls.extend(self.set_by_hand.lock().unwrap_or_else(PoisonError::into_inner).clone());
        let mut agreed = setup::agree(&mut device, &self.config, &controls, self.format, self.outlet.size())?;
        let clock = match setup::clock(&device, &self.config) {
            Ok(clock) => Some(clock),
            Err(note) => {
                agreed.notes.extend(note);
                None
            }
        };
        let mut frames = setup::open_stream(&mut device, &self.config, clock.is_some())?;
        frames.set_block_timeout(HELD);
        device.acquisition_start().map_err(|error| format!("it does not start: {}", features::why(&error)))?;
        let now = Instant::now();
        let mut stream = Stream {
            identity: find::identity(&info),
            agreed,
            clock,
            latched_at: now,
            empty_at: now,
            last: None,
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
                let why = match (&stream.damage, stream.last) {
                    (Some(why), _) => format!("; the last one was damaged: {why}"),
                    (None, Some(_)) => "; unplugged, without power, or taken by another program".to_owned(),
                    // A switch between that does not carry large packets.
                    (None, None) => "; where there were none at all, set bench.camera.packet_bytes = 1500".to_owned(),
                };
                return Err(format!("no good frame came within {} ms{why}", timeout.as_millis()));
            }
            self.follow_orders(device, stream)?;
            stream.renew_clock(device)?;
            let asked_at = Instant::now();
            let mut newest = None;
            let mut wait = SLICE;
            loop {
                match frames.next_frame_blocking(wait) {
                    Ok(Some(block)) => {
                        self.outlet.seq += 1;
                        newest = Some(block);
                        wait = Duration::ZERO;
                    }
                    Err(GenicamError::Timeout(_)) => break,
                    Ok(None) => return Err("its stream has ended".to_owned()),
                    Err(error) => return Err(format!("waiting for a frame failed: {error}")),
                }
            }
            let mut count = self.count(&frames.stats(), stream);
            let news = newest.is_some() || count.lost + count.damaged > 0;
            if let Some(block) = newest
                && let Some(damage) = self.see(device, stream, block, count.lost + count.damaged > 0)?
            {
                count.damaged += 1;
                stream.damage = Some(damage);
            }
            // Nothing waited after it was asked for.
            stream.empty_at = asked_at;
            if news {
                self.tell(stream, count);
            }
        }
        Ok(())
    }

    /// What was lost since this was last asked.
    fn count(&mut self, stats: &StreamStats, stream: &mut Stream) -> Count {
        let before = std::mem::replace(&mut stream.seen, *stats);
        let damaged = stats.frames_incomplete - before.frames_incomplete;
        let lost = stats.frames_missed + stats.frames_backpressure + stats.frames_unsupported
            - (before.frames_missed + before.frames_backpressure + before.frames_unsupported);
        self.outlet.seq += lost + damaged;
        if damaged > 0 {
            let packets = stats.packets_missing - before.packets_missing;
            stream.damage = Some(format!("{packets} packets of {damaged} frames did not come"));
        }
        Count { lost, damaged }
    }

    /// Publishes a frame, `held` where it may have waited for an earlier one; or says why it is damaged.
    ///
    /// # Errors
    /// What no later frame will mend.
    fn see(&self, device: &Device, stream: &mut Stream, block: Block, held: bool) -> Result<Option<String>, String> {
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
                let window = self.window(stream, ticks, held);
                stream.good_at = Instant::now();
                stream.damage = None;
                self.outlet.publish(Arc::clone(&image), self.outlet.seq, window);
                let white = self.white();
                stream.judge.see(&image, white, || features::of_brightness(device));
                Ok(None)
            }
            Err(error @ (UnpackError::Stride { .. } | UnpackError::Depth { .. })) => {
                Err(format!("its frames are not what {} says: {error}", self.format.name()))
            }
            Err(error) => Ok(Some(error.to_string())),
        }
    }

    /// From this level on a pixel is saturated.
    fn white(&self) -> u16 {
        ((1u32 << self.format.bits()) - 1) as u16
    }

    /// When a frame was exposed.
    fn window(&self, stream: &mut Stream, ticks: Option<u64>, held: bool) -> Window {
        let now = Instant::now();
        let since_last = stream.last.replace((now, self.outlet.seq)).map_or(Duration::ZERO, |(at, seq)| {
            let frames = u32::try_from(self.outlet.seq.saturating_sub(seq)).unwrap_or(u32::MAX).max(1);
            now.saturating_duration_since(at) / frames
        });
        // A camera may well be slower than it says: then its exposures may be longer, too.
        let interval = stream.agreed.interval.max(since_last);
        let longest = Duration::from_millis(self.config.timeout_ms) + 4 * interval;
        let stamped = match (&mut stream.clock, ticks) {
            (Some(clock), Some(ticks)) => clock.judge(ticks, now, longest),
            _ => None,
        };
        let delay = Duration::from_millis(self.config.pipeline_delay_ms);
        let waited = if held { HELD } else { Duration::ZERO };
        let arrived_age = now.saturating_duration_since(stream.empty_at) + waited;
        let means = if stamped.is_some() { self.config.timestamp_means } else { TimestampMeans::Arrival };
        clock::window(means, stamped, arrived_age, interval, delay)
    }

    fn follow_orders(&self, device: &mut Device, stream: &mut Stream) -> Result<(), String> {
        loop {
            match self.orders.try_recv() {
                Ok(Order::Tell(reply)) => drop(reply.send(features::light(device))),
                Ok(Order::Set(name, value, reply)) => {
                    let done = features::set_light(device, name, value, &self.set_by_hand);
                    // A longer exposure is in force from some frame on; a shorter one may not be yet.
                    let exposure = Duration::try_from_secs_f64(setup::exposure_s(device)?).unwrap_or_default();
                    stream.agreed.interval = stream.agreed.interval.max(exposure);
                    drop(reply.send(done));
                }
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return Ok(()),
            }
        }
    }

    fn tell(&self, stream: &Stream, count: Count) {
        let complaint = stream.clock.as_ref().and_then(DeviceClock::complaint);
        self.outlet.tell(News {
            good: stream.damage.is_none(),
            identity: &stream.identity,
            white: self.white(),
            notes: stream.agreed.notes.iter().cloned().chain(complaint).chain(stream.judge.note()).collect(),
            count,
        });
    }
}

impl Stream {
    fn renew_clock(&mut self, device: &Device) -> Result<(), String> {
        let Some(clock) = self.clock.as_mut().filter(|_| self.latched_at.elapsed() >= LATCH_EVERY) else {
            return Ok(());
        };
        self.latched_at = Instant::now();
        clock.renew(setup::latch(device).map_err(|why| format!("its clock cannot be read any more: {why}"))?);
        Ok(())
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
