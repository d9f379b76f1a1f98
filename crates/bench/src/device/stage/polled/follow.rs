//! Motion along a course: the controller is told of the next piece of it while it still goes over the one before.

use std::sync::atomic::{AtomicBool, Ordering};

use tokio::time::{Duration, Instant, sleep_until, timeout};

use super::motion::ARRIVAL_MM;
use super::{Dialogue, Polled};
use crate::device::DeviceError;
use crate::device::jog::Course;
use crate::device::stage::track::{BEGIN, CYCLE, END, Track};
use plenoptics::units::Millimetres;

/// Time between two looks at everything that a controller says of an axis, where its position alone is quicker to ask.
const WHOLE: Duration = Duration::from_millis(250);

/// Says that an axis is looked at by what moves it, while it lives.
struct Followed<'a>(&'a AtomicBool);

impl<'a> Followed<'a> {
    fn new(followed: &'a AtomicBool) -> Self {
        followed.store(true, Ordering::SeqCst);
        Self(followed)
    }
}

impl Drop for Followed<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::SeqCst);
    }
}

impl<D: Dialogue> Polled<D> {
    pub(super) async fn follow_course(
        &self,
        index: usize,
        course: Course,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        let axis = self.axis(index);
        let _operation = axis.operation.lock().await;
        self.ready(index, generation).await?;
        let followed = Followed::new(&axis.followed);
        let ended = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => None,
            ended = self.lead(index, course, generation) => Some(ended),
        };
        drop(followed);
        match ended {
            None => self.stopped(index).await,
            Some(Err(_)) if self.orders.generation() != generation => self.stopped(index).await,
            Some(Err(error)) => {
                // It may move still, as far as it was told.
                self.stop().await;
                Err(error)
            }
            Some(Ok(reached)) => Ok(reached),
        }
    }

    /// Tells the axis of its way, a little at a time, up to the end of the course.
    async fn lead(&self, index: usize, mut course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        let axis = self.axis(index);
        let (name, setup, facts) = (axis.link.name(), axis.link.setup(), self.dialogue.facts(index));
        let mut track = Track::new(facts.acceleration_mm_per_s2);
        let mut whole = None;
        let mut last: Option<f64> = None;
        let home = axis.link.home().filter(|_| axis.link.state().homed);
        let Some(home) = home else { return Err(DeviceError::NotHomed { axis: name }) };
        loop {
            let due = whole.is_none_or(|at: Instant| at.elapsed() >= WHOLE);
            if due {
                self.look_at_others(index).await;
            }
            let asked = Instant::now();
            let mut reading = if due { self.look(index).await? } else { self.glance(index).await? };
            let stands = last.replace(reading.position) == Some(reading.position);
            if due || stands {
                reading = if due { reading } else { self.look(index).await? };
                whole = Some(asked);
            }
            if let Some(reason) = reading.fault {
                return Err(self.alarm(index, reason));
            }
            if axis.link.home() != Some(home) {
                return Err(DeviceError::NotHomed { axis: name });
            }
            let at = Millimetres(setup.coordinate(reading.position, home));
            let Some(next) = course(track.see(at, asked, Instant::now())) else { break };
            if track.is_worth_an_order(next, at) {
                let speed = next.speed_mm_per_s.min(facts.speed_mm_per_s);
                let to = setup.machine(next.to.value(), home);
                if track.changes_speed(next) {
                    self.dialogue.start_move(index, to, speed, generation).await?;
                } else {
                    self.dialogue.go_on(index, to, speed, generation).await?;
                }
                track.tell(next);
            } else if !reading.moving && track.since_told() > BEGIN {
                // There, or it goes no farther.
                break;
            }
            sleep_until(asked + CYCLE).await;
        }
        let Ok(reading) = timeout(END, self.rest(index)).await else {
            return Err(self.timeout("end a motion", END));
        };
        let reading = reading?;
        if let Some(reason) = reading.fault {
            return Err(self.alarm(index, reason));
        }
        if axis.link.home().is_none() {
            return Err(DeviceError::NotHomed { axis: name });
        }
        let reached = setup.coordinate(reading.position, home);
        match track.told() {
            Some(told) if (reached - told.value()).abs() > ARRIVAL_MM => {
                Err(self.came_to_rest_short(index, reached, told).await)
            }
            _ => Ok(Millimetres(reached)),
        }
    }

    /// Looks at the axes that nothing else looks at meanwhile. One that does not answer is its controller's failure, which
    /// the next question to it tells.
    async fn look_at_others(&self, index: usize) {
        for (other, axis) in self.axes.iter().enumerate() {
            if other != index && !axis.followed.load(Ordering::SeqCst) {
                let _ = self.look(other).await;
            }
        }
    }
}
