//! Taking frames: exposing, rendering what was seen, stamping, handing over to be sent.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender};
use std::time::{Duration, Instant};

use super::control::Again;
use super::faults::GigeFaults;
use super::format::Format;
use super::settings::Settings;
use super::stream::{Block, Link};
use super::world::now_us;
use super::{Exposure, SLICE, Shared};
use crate::config::{Config, TimestampMeans};
use crate::sim::picture::Picture;

/// How long it takes until everything that moved during an exposure has been told.
const TOLD_WITHIN: Duration = Duration::from_millis(12);
/// The exposure, µs, whose brightness is the configured one.
const USUAL_EXPOSURE_US: f64 = 10_000.0;
/// Moments of an exposure that see something move, at least.
const MOMENTS: u32 = 3;

/// A frame to be sent.
pub(super) struct Take {
    block: Arc<Block>,
    link: Arc<Link>,
    generation: u64,
}

/// An exposure that is due.
struct Order {
    settings: Settings,
    generation: u64,
}

/// What takes the frames.
pub(super) struct Film {
    shared: Arc<Shared>,
    config: Config,
    means: TimestampMeans,
    /// The pictures of the format that was last asked for: its depth is the camera's.
    picture: Option<(Format, Picture)>,
    /// What is sent again: of a driver that hangs one frame.
    again: VecDeque<(Settings, Vec<u8>)>,
    frames: u64,
    exposed_at: Option<Instant>,
}

impl Film {
    pub(super) fn new(shared: Arc<Shared>, config: &Config, means: TimestampMeans) -> Self {
        let mut config = config.clone();
        let motion = &mut config.bench.simulation.motion;
        motion.steps = motion.steps.max(MOMENTS);
        Self { shared, config, means, picture: None, again: VecDeque::new(), frames: 0, exposed_at: None }
    }

    /// Takes frames until the camera ends.
    pub(super) fn run(mut self, out: &SyncSender<Take>) {
        while let Some(order) = self.next() {
            if let Some(take) = self.take(&order)
                && out.send(take).is_err()
            {
                return;
            }
        }
    }

    /// Waits until a frame is due; `None` once the camera has ended.
    fn next(&mut self) -> Option<Order> {
        let mut control = self.shared.control();
        loop {
            if self.shared.has_ended() {
                return None;
            }
            let now = Instant::now();
            let settings = control.registers.settings();
            let interval = Duration::try_from_secs_f64(1.0 / settings.rate_hz).unwrap_or(SLICE);
            let due = self.exposed_at.map_or(now, |at| at + interval);
            let waits = control.registers.acquiring && settings.triggered && control.triggers == 0;
            if control.registers.acquiring && !waits && due <= now {
                control.triggers = control.triggers.saturating_sub(1);
                self.exposed_at = Some(now);
                let generation = control.generation.load(Ordering::SeqCst);
                return Some(Order { settings, generation });
            }
            let runs = control.registers.acquiring && !waits;
            let left = if runs { due.saturating_duration_since(now).min(SLICE) } else { SLICE };
            control = self.shared.wait(control, left);
        }
    }

    fn take(&mut self, order: &Order) -> Option<Take> {
        let settings = order.settings;
        let (started, started_us) = (Instant::now(), now_us());
        std::thread::sleep(Duration::from_secs_f64(settings.exposure_us * 1e-6));
        let (exposed, exposed_us) = (Instant::now(), now_us());
        if self.shared.follows {
            std::thread::sleep(TOLD_WITHIN);
        }
        let faults = self.shared.faults();
        if faults.camera.unplugged || faults.link.silent {
            return None;
        }
        let kept = if faults.camera.frozen { 1 } else { self.shared.repeated.load(Ordering::SeqCst) };
        self.again.retain(|(before, _)| *before == settings);
        let oldest = if self.again.len() >= kept { self.again.pop_front().filter(|_| kept > 0) } else { None };
        let bytes = match oldest {
            Some((_, bytes)) => bytes,
            None => self.see(&settings, [started_us, exposed_us], &faults),
        };
        self.again.truncate(kept.saturating_sub(1));
        if kept > 0 {
            self.again.push_back((settings, bytes.clone()));
        }
        let read_out = Instant::now();
        let mut control = self.shared.control();
        if !control.registers.acquiring || control.generation.load(Ordering::SeqCst) != order.generation {
            return None;
        }
        let stamped = match self.means {
            TimestampMeans::ExposureStart => started,
            TimestampMeans::ExposureEnd => exposed,
            // A camera without a clock, whose stamps are all 0, has nothing else to say either.
            TimestampMeans::Readout | TimestampMeans::Arrival => read_out,
        };
        if settings.single {
            control.registers.acquiring = false;
        }
        let ticks = control.ticks(stamped);
        self.shared.note(Exposure { from: started, to: exposed, checksum: Exposure::checksum(&bytes) });
        let (format, region) = (settings.format, settings.region);
        let block = control.keep(Block { id: 0, ticks, format, region, bytes });
        Some(Take { block, link: control.link.clone()?, generation: order.generation })
    }

    /// The bytes of what is seen between two moments.
    fn see(&mut self, settings: &Settings, moments: [i64; 2], faults: &GigeFaults) -> Vec<u8> {
        let [from, to] = self.shared.world.poses(moments);
        if self.picture.as_ref().is_none_or(|(format, _)| format.bits != settings.format.bits) {
            let mut config = self.config.clone();
            config.bench.simulation.bits = settings.format.bits;
            self.picture = Some((settings.format, Picture::new(&config)));
        }
        let Some((_, picture)) = &self.picture else { return Vec::new() };
        let gain = 10f64.powf(settings.gain_db / 20.0);
        picture.set_exposed(settings.exposure_us / USUAL_EXPOSURE_US, gain);
        self.frames += 1;
        let image = picture.take(&from, &to, self.config.bench.simulation.rays, self.frames, &faults.seen());
        settings.format.pack(&image, &settings.region)
    }
}

/// Sends frames, one after the other, until none come any more.
pub(super) fn send(shared: &Shared, generation: &AtomicU64, takes: &Receiver<Take>) {
    while let Ok(Take { block, link, generation: of }) = takes.recv() {
        let packets = {
            let mut control = shared.control();
            let faults = *control.link_faults();
            control.chance.sent(0..link.packets(&block), &faults)
        };
        link.send(&block, &packets, false, || shared.has_ended() || generation.load(Ordering::SeqCst) != of);
    }
}

/// Sends packets again that were asked for, until the camera ends.
pub(super) fn send_again(shared: &Shared, generation: &AtomicU64) {
    while !shared.has_ended() {
        let again = {
            let mut control = shared.control();
            let again = control.take_again();
            if again.is_none() {
                drop(shared.wait(control, SLICE));
            }
            again
        };
        if let Some(Again { block, link, packets, generation: of }) = again {
            link.send(&block, &packets, true, || shared.has_ended() || generation.load(Ordering::SeqCst) != of);
        }
    }
}
