//! Readings: asked for again and again, and what they tell.

use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError, Weak};
use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::Instant;

use super::{AxisReading, Dialogue, Polled, Seen, Watching};
use crate::device::DeviceError;
use crate::device::stage::track::reach_mm;
use plenoptics::units::Millimetres;

/// Time between readings in motion and at rest.
pub(super) const POLL_MOVING: Duration = Duration::from_millis(100);
const POLL_AT_REST: Duration = Duration::from_millis(250);
/// Readings that fail one after another before the controller counts as lost.
const FAILURES: u32 = 4;
/// Readings at rest differ by less than this while nothing moves, mm: a servo holds its place.
const JITTER_MM: f64 = 1e-3;
/// Answers that are asked for until two agree on where an axis is.
const ANSWERS: u32 = 4;

impl Seen {
    /// Whether an axis of this greatest speed (mm/s) cannot have come from here to there; at rest both times it has not
    /// moved at all.
    fn leaps_to(&self, now: &Self, speed: f64) -> bool {
        let reach = match self.moving || now.moving {
            true => reach_mm(speed, now.at - self.at),
            false => JITTER_MM,
        };
        (now.position - self.position).abs() > reach
    }
}

/// Asks again and again, until the port closes or every stage is dropped.
pub(super) async fn poll<D: Dialogue>(weak: Weak<Polled<D>>, poll_now: Arc<Notify>) {
    let mut failures = 0;
    loop {
        let asked = Instant::now();
        // Nothing is held while waiting: the last stage dropped closes the port at once.
        let period = {
            let Some(session) = weak.upgrade() else { return };
            if session.dialogue.closed().borrow().is_some() {
                return;
            }
            let mut failed = false;
            // What moves an axis along a course looks at all of them, so that no order waits for an answer to this.
            let followed = session.axes.iter().any(|axis| axis.followed.load(Ordering::SeqCst));
            for index in (0..session.axes.len()).filter(|_| !followed) {
                failed |= session.look(index).await.is_err();
            }
            failures = if failed { failures + 1 } else { 0 };
            if failures == FAILURES {
                session.dialogue.close("the controller does not answer");
                return;
            }
            if session.watched.load(Ordering::SeqCst) > 0 { POLL_MOVING } else { POLL_AT_REST }
        };
        tokio::select! {
            () = tokio::time::sleep_until(asked + period) => {}
            () = poll_now.notified() => {}
        }
    }
}

impl<D: Dialogue> Polled<D> {
    /// Asks for readings at the faster rate while the guard lives.
    pub(super) fn watching(&self) -> Watching<'_> {
        self.watched.fetch_add(1, Ordering::SeqCst);
        self.poll_now.notify_one();
        Watching(&self.watched)
    }

    /// Asks now.
    pub(super) async fn look(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let asked = Instant::now();
        let reading = self.dialogue.read(axis).await?;
        self.reading_takes.send_replace(asked.elapsed());
        let reading = self.believed(axis, reading).await?;
        self.take_reading(axis, &reading);
        Ok(reading)
    }

    /// Asks where the axis is, and no more than it takes to believe that.
    pub(super) async fn glance(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let reading = self.dialogue.glance(axis).await?;
        let reading = self.believed(axis, reading).await?;
        self.take_reading(axis, &reading);
        Ok(reading)
    }

    /// Asks again where a reading leaps from the one before it: where answers have no checksum, a digit that the line has
    /// lost makes another number of it. What two answers say is believed, whatever came before them; of an axis that moves
    /// the last of several that differ, since the next one comes soon.
    async fn believed(&self, index: usize, mut reading: AxisReading) -> Result<AxisReading, DeviceError> {
        let axis = self.axis(index);
        let speed = self.dialogue.facts(index).speed_mm_per_s;
        let mut asked = 1;
        // Homing has speeds of its own, and makes another coordinate; and an axis that is not homed may be turned by hand.
        let known = !axis.homing.load(Ordering::SeqCst) && axis.link.home().is_some();
        loop {
            let now = Seen { position: reading.position, moving: reading.moving, at: Instant::now() };
            let before = axis.seen.lock().unwrap_or_else(PoisonError::into_inner).replace(now);
            let leaps = known && before.is_some_and(|before| before.leaps_to(&now, speed));
            if !leaps || (asked == ANSWERS && reading.moving) {
                return Ok(reading);
            }
            if asked == ANSWERS {
                let detail = format!(
                    "of {ANSWERS} answers no two said the same of where the {} axis stands at rest: see to the line",
                    axis.link.name()
                );
                return Err(DeviceError::Protocol { device: self.name.clone(), detail });
            }
            reading = self.dialogue.read(index).await?;
            asked += 1;
        }
    }

    pub(super) fn take_reading(&self, index: usize, reading: &AxisReading) {
        let axis = self.axis(index);
        let homing = axis.homing.load(Ordering::SeqCst);
        if reading.referenced == Some(false) && !homing && axis.link.home().is_some() {
            tracing::warn!(controller = %self.name, axis = %axis.link.name(), "an axis has lost its reference");
            axis.link.forget_home();
        }
        let (home, homed) = (axis.link.home(), axis.link.state().homed);
        let home = home.filter(|_| homed).unwrap_or(reading.position);
        let position = Millimetres(axis.link.setup().coordinate(reading.position, home));
        let now = Instant::now();
        axis.link.modify(|state| {
            let moved = (state.position - position).abs().value() > JITTER_MM;
            state.connected = true;
            state.position = position;
            state.moving = reading.moving || homing;
            state.fault.clone_from(&reading.fault);
            if state.moving {
                state.at_rest_since = None;
            } else if moved || state.at_rest_since.is_none() {
                state.at_rest_since = Some(now);
            }
        });
    }

    /// Asks until two readings one after another say rest at the same place, or one a fault.
    pub(super) async fn rest(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let mut last: Option<AxisReading> = None;
        let mut failures = 0;
        loop {
            match self.look(axis).await {
                Ok(reading) => {
                    failures = 0;
                    if reading.fault.is_some() && !reading.moving {
                        return Ok(reading);
                    }
                    let same = last.is_some_and(|last| (last.position - reading.position).abs() <= JITTER_MM);
                    if !reading.moving && same {
                        return Ok(reading);
                    }
                    last = (!reading.moving).then_some(reading);
                }
                // A damaged answer is asked for again; a lost port is not.
                Err(error) if matches!(error, DeviceError::Disconnected { .. }) || failures == FAILURES => {
                    return Err(error);
                }
                Err(_) => failures += 1,
            }
            tokio::time::sleep(POLL_MOVING).await;
        }
    }
}
