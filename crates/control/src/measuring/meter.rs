//! The meter: the spacing in every frame that the camera takes while somebody reads it.
//!
//! The newest frame is measured, never a queue of them: what comes meanwhile is left out and counted. From one frame to
//! the next the spacing is followed. Where it cannot be, the reading says at once that it is lost, and the next frame is
//! searched for it as if nothing were known.
//!
//! While nothing moves, frames are combined ([`plenoptics::imaging::combined`]): beside its own spacing a reading has the mean
//! up to it, which is what is judged.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use tokio::sync::{Notify, broadcast, watch};

use super::at_rest::AtRest;
use super::eye::{Eye, Unmeasured};
use super::meter::doubt::Doubt;
use super::sight::Sight;
use crate::events::{InView, MeasurementView};
use crate::measuring::not_measured::OLD_PICTURE;
use crate::reading::{NoReading, Reading, SEARCHING};
use crate::recording::{Happening, words};
use bench::device::Frame;
use bench::record::messages::MeterReading;
use bench::telemetry::{self, ReadingOutcome};
use plenoptics::imaging::live::{LiveMeter, LivePart, LiveSpacing};

/// How long a frame is awaited before it is seen whether anybody still reads.
const PATIENCE: Duration = Duration::from_millis(500);

/// How many readings are kept to be compared with whole measurements of their frames.
const KEPT: usize = 256;
/// Readings kept for who takes each of them and lags.
const EACH_KEPT: usize = 256;
/// Spacings of one frame that are farther apart are of different matches, px.
const SAME_PX: f64 = 1.0;

/// Frames one after another that cannot be measured in whole, nothing moving, until what is read is in doubt.
const FAILURES: u32 = 2;

/// What is followed from frame to frame.
struct Followed {
    /// What the white frame taught, by which it was begun.
    sight: Arc<Sight>,
    meter: LiveMeter,
    /// The next frame has to be searched for its spacing, not before this: by the machine's own clock, as threads that
    /// compute know no other.
    search_from: Option<Instant>,
    /// Why the spacing is lost, by the newest frame that was looked at for it.
    lost: String,
}

impl Followed {
    fn new(sight: &Arc<Sight>) -> Result<Self, NoReading> {
        let meter = sight.meter().map_err(NoReading::Refused)?;
        Ok(Self { sight: Arc::clone(sight), meter, search_from: Some(Instant::now()), lost: SEARCHING.to_owned() })
    }

    fn read(&mut self, frame: &Frame, waited: Duration) -> Result<LiveSpacing, NoReading> {
        let (began, searched) = (Instant::now(), self.search_from.is_some());
        let mut laps = Laps { from: began, took: Default::default() };
        let read = match self.search_from {
            Some(from) if from > began => return Err(NoReading::Lost(self.lost.clone())),
            Some(_) => self.meter.acquire_by_parts(&frame.image, &mut |part| laps.ended(part)),
            None => {
                // While an axis moves, frames come faster than that.
                if frame.is_settled() {
                    self.meter.keep_profile(&frame.image);
                }
                self.meter.measure_by_parts(&frame.image, &mut |part| laps.ended(part))
            }
        };
        let (read, took) = (read.map_err(NoReading::from), began.elapsed());
        telemetry::read(searched, outcome(&read), took);
        laps.tell(waited);
        if let Err(NoReading::Lost(why)) = &read {
            self.lost.clone_from(why);
        }
        self.search_from = match &read {
            Ok(_) => None,
            // A search takes every core: whatever else there is to do is left as long again.
            Err(_) if searched => Some(Instant::now() + took),
            Err(NoReading::Lost(_)) => Some(began),
            // The frame is at fault, not the place that the spacing was followed to.
            Err(NoReading::Refused(_)) => None,
        };
        read
    }
}

/// How long each part of a reading took.
struct Laps {
    /// When the newest part to have ended did so.
    from: Instant,
    took: [Duration; LivePart::ALL.len()],
}

impl Laps {
    fn ended(&mut self, part: LivePart) {
        let now = Instant::now();
        self.took[part as usize] += now.saturating_duration_since(self.from);
        self.from = now;
    }

    /// Tells of each part that there was, and of how long a thread was waited for before.
    fn tell(&self, waited: Duration) {
        telemetry::reading_part("thread", waited);
        for (part, took) in LivePart::ALL.into_iter().zip(self.took) {
            if took > Duration::ZERO {
                telemetry::reading_part(word(part), took);
            }
        }
    }
}

/// The word for a part of a reading.
const fn word(part: LivePart) -> &'static str {
    match part {
        LivePart::Search => "search",
        LivePart::Exposure => "exposure",
        LivePart::Grid => "grid",
        LivePart::Clusters => "clusters",
        LivePart::Pairs => "pairs",
        LivePart::Equations => "equations",
        LivePart::Noise => "noise",
        LivePart::Boards => "boards",
    }
}

const fn outcome(read: &Result<LiveSpacing, NoReading>) -> ReadingOutcome {
    match read {
        Ok(_) => ReadingOutcome::Measured,
        Err(NoReading::Lost(_)) => ReadingOutcome::Lost,
        Err(NoReading::Refused(_)) => ReadingOutcome::Refused,
    }
}

/// Reads a frame away from the runtime's threads, with what was followed before where the white frame is still the same.
async fn read(
    followed: &mut Option<Followed>,
    sight: Arc<Sight>,
    frame: &Arc<Frame>,
) -> Result<LiveSpacing, NoReading> {
    let before = followed.take().filter(|before| Arc::ptr_eq(&before.sight, &sight));
    let (frame, handed_over) = (Arc::clone(frame), Instant::now());
    let work = move || {
        let mut followed = match before.map_or_else(|| Followed::new(&sight), Ok) {
            Ok(followed) => followed,
            Err(why) => return (None, Err(why)),
        };
        let mut read = || followed.read(&frame, handed_over.elapsed());
        let read = match pool() {
            Some(pool) => pool.install(read),
            None => read(),
        };
        (Some(followed), read)
    };
    let (now, read) = tokio::task::spawn_blocking(work)
        .await
        .unwrap_or_else(|error| (None, Err(NoReading::Refused(format!("reading ended unexpectedly: {error}")))));
    *followed = now;
    read
}

/// Threads of the meter's own: what else is computed takes its turn on others, and does not hold a reading up.
fn pool() -> Option<&'static rayon::ThreadPool> {
    static POOL: OnceLock<Option<rayon::ThreadPool>> = OnceLock::new();
    let build = || rayon::ThreadPoolBuilder::new().thread_name(|k| format!("meter-{k}")).build();
    POOL.get_or_init(|| build().inspect_err(|error| tracing::error!(%error, "the meter has no threads")).ok()).as_ref()
}

/// What a frame measured in whole has to say of readings.
#[derive(Debug, Clone, Copy)]
struct Whole {
    frame_seq: u64,
    captured_at: Timestamp,
    spacing_px: f64,
    two_boards: bool,
}

/// Readings, to who reads them.
pub(crate) struct Readings {
    newest: watch::Sender<Option<Arc<Reading>>>,
    each: broadcast::Sender<Arc<MeterReading>>,
    begun: Notify,
    /// What was measured in whole last.
    whole: watch::Sender<Option<Whole>>,
    /// Why no frame has been measured in whole since that one, in words.
    unmeasured: Mutex<Option<String>>,
    /// How many could not be since, one after another, though nothing moved.
    failures: AtomicU32,
    /// Whether it is in doubt what is in view.
    doubted: watch::Sender<bool>,
}

impl Default for Readings {
    fn default() -> Self {
        Self {
            newest: watch::Sender::new(None),
            each: broadcast::Sender::new(EACH_KEPT),
            begun: Notify::new(),
            whole: watch::Sender::new(None),
            unmeasured: Mutex::default(),
            failures: AtomicU32::new(0),
            doubted: watch::Sender::new(false),
        }
    }
}

impl Readings {
    /// The newest reading from now on.
    pub(crate) fn newest(&self) -> watch::Receiver<Option<Arc<Reading>>> {
        let readings = self.newest.subscribe();
        self.begun.notify_one();
        readings
    }

    /// Each reading from now on.
    pub(crate) fn each(&self) -> broadcast::Receiver<Arc<MeterReading>> {
        let each = self.each.subscribe();
        self.begun.notify_one();
        each
    }

    fn are_read(&self) -> bool {
        self.newest.receiver_count() > 0 || self.each.receiver_count() > 0
    }

    /// The newest reading is of a camera that was set otherwise: nobody is told of it any more.
    pub(crate) fn forget(&self) {
        self.newest.send_replace(None);
    }

    /// Whether it is in doubt what is in view: a whole measurement is wanted to say.
    pub(crate) fn doubted(&self) -> watch::Receiver<bool> {
        self.doubted.subscribe()
    }

    fn doubt(&self, doubted: bool) {
        self.doubted.send_if_modified(|before| {
            let changed = std::mem::replace(before, doubted) != doubted;
            if changed && !self.fails_in_whole() {
                // What could not be measured before says nothing of this doubt.
                *self.unmeasured() = None;
            }
            changed
        });
    }

    /// What was in doubt is no more: another thing is read, or nobody reads.
    fn begin_anew(&self) {
        self.failures.store(0, Ordering::Relaxed);
        self.doubt(false);
    }

    fn unmeasured(&self) -> MutexGuard<'_, Option<String>> {
        self.unmeasured.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// No frame could be measured in whole.
    pub(crate) fn not_measured(&self, Unmeasured { why, by_motion }: Unmeasured) {
        *self.unmeasured() = Some(why);
        if !by_motion {
            self.failures.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Whether frame after frame is read, and none can be measured in whole.
    fn fails_in_whole(&self) -> bool {
        self.failures.load(Ordering::Relaxed) >= FAILURES
    }

    /// A frame was measured in whole. Where the meter has followed another match to it, it searches anew.
    pub(crate) fn compare(&self, measured: &MeasurementView) {
        *self.unmeasured() = None;
        self.failures.store(0, Ordering::Relaxed);
        self.whole.send_replace(Some(Whole {
            frame_seq: measured.frame_seq,
            captured_at: measured.captured_at,
            spacing_px: measured.spacing.spacing_px,
            two_boards: measured.two_boards.is_some(),
        }));
    }

    /// Reads every frame while somebody reads the meter, and tells `read` of each reading.
    pub(crate) async fn watch(&self, eye: &Arc<Eye>, read: impl Fn(&Reading)) {
        loop {
            if !self.are_read() {
                self.newest.send_replace(None);
                self.begun.notified().await;
                continue;
            }
            self.read_frames(eye, &read).await;
            self.begin_anew();
        }
    }

    /// Reads frames until nobody reads them any more.
    async fn read_frames(&self, eye: &Arc<Eye>, published: &impl Fn(&Reading)) {
        let (mut live, mut whole) = (eye.bench().camera.live(), self.whole.subscribe());
        let (mut followed, mut before, mut frames_left_out) = (None, None::<Arc<Frame>>, 0);
        let (mut kept, mut at_rest) = (VecDeque::with_capacity(KEPT), AtRest::new());
        let (mut doubt, mut set_up) = (Doubt::default(), eye.set_up_instant());
        while self.are_read() {
            match tokio::time::timeout(PATIENCE, live.changed()).await {
                Ok(Ok(())) => {}
                // The camera's driver has ended: no frame comes any more.
                Ok(Err(_)) => return std::future::pending().await,
                Err(_) => continue,
            }
            let (Some(frame), Some(sight)) = (live.borrow_and_update().clone(), eye.sight()) else { continue };
            if whole.has_changed().is_ok_and(|changed| changed) {
                let measured = *whole.borrow_and_update();
                let other = |measured: &Whole| {
                    let differs = |&(read, read_px): &(u64, f64)| {
                        read == measured.frame_seq && (read_px - measured.spacing_px).abs() > SAME_PX
                    };
                    kept.iter().any(differs)
                };
                if let Some(measured) = measured.filter(other) {
                    tracing::warn!(?measured, "the meter has followed another match: it searches anew");
                    followed = None;
                    at_rest.lost();
                }
            }
            let now_set_up = eye.set_up_instant();
            if now_set_up != set_up {
                set_up = now_set_up;
                at_rest.set_up();
                doubt = Doubt::default();
                self.begin_anew();
            }
            // It shows, in part at least, what stood there before.
            if frame.exposed_from < set_up && !frame.replayed {
                continue;
            }
            let missed = before.as_ref().map_or(0, |before| frame.seq.saturating_sub(before.seq + 1));
            frames_left_out += missed;
            let spacing = if eye.first_alike(&frame).await == frame.seq {
                read(&mut followed, sight, &frame).await
            } else {
                Err(NoReading::Refused(OLD_PICTURE.to_owned()))
            };
            before = Some(Arc::clone(&frame));
            if let Ok(spacing) = &spacing {
                kept.truncate(KEPT - 1);
                kept.push_front((frame.seq, spacing.on_axis_px));
            }
            telemetry::reading_published(outcome(&spacing), frame.exposed_to.elapsed(), missed);
            if matches!(spacing, Err(NoReading::Lost(_))) {
                at_rest.lost();
            }
            let combined = spacing.as_ref().ok().map(|spacing| at_rest.take(&frame, spacing));
            let spacing_target_px = eye.target_px();
            // What another set-up showed says nothing of this one.
            let set_up_at = eye.set_up_at();
            let newest = (*whole.borrow()).filter(|whole| whole.captured_at >= set_up_at);
            // A board of several levels steps, and is known to.
            let uneven = spacing
                .as_ref()
                .is_ok_and(|spacing| doubt.take(frame.seq, spacing.unevenness, newest.map(|whole| whole.frame_seq)));
            let doubted = eye.in_view() != InView::SteppedBoard && (uneven || self.fails_in_whole());
            if spacing.is_ok() {
                self.doubt(doubted);
            }
            // What cannot be read either, or is of another place, says nothing of what can.
            if spacing.is_err() || !frame.is_settled() {
                self.failures.store(0, Ordering::Relaxed);
            }
            let in_focus = combined.is_some_and(|combined| eye.is_field_in_focus(combined.value))
                && !doubted
                && !newest.is_some_and(|whole| whole.two_boards);
            self.publish(
                eye,
                published,
                Reading {
                    frame,
                    spacing,
                    combined,
                    spacing_target_px,
                    spacing_tolerance_px: eye.tolerance_px(),
                    in_focus,
                    doubted,
                    unresolved: self.unmeasured().clone().filter(|_| doubted),
                    frames_left_out,
                },
            );
        }
    }

    /// Hands a reading to who reads, and to a job's recording. Nobody is waited for.
    fn publish(&self, eye: &Eye, published: &impl Fn(&Reading), reading: Reading) {
        published(&reading);
        eye.journal().happened(|| Happening::Read(Box::new(words::meter_reading(&reading))));
        if self.each.receiver_count() > 0 {
            // Whoever has gone meanwhile is no error.
            let _ = self.each.send(Arc::new(words::meter_reading(&reading)));
        }
        self.newest.send_replace(Some(Arc::new(reading)));
    }
}

mod doubt;
#[cfg(test)]
mod tests;
