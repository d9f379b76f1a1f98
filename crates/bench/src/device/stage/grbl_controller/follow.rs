//! Motion along a course: jogs queue up in the controller, which goes over from one to the next without slowing down.

use std::time::Duration;

use tokio::time::{Instant, sleep_until, timeout};

use super::super::grbl::{self, Alarm, Mode};
use super::super::track::{BEGIN, CYCLE, END, Track, reach_mm};
use super::moves::ARRIVAL_MM;
use super::{ANSWER, Controller, Reading, locked};
use crate::device::DeviceError;
use crate::device::jog::Course;
use plenoptics::units::Millimetres;

/// Least time between two status requests: each is answered by a line of its own.
const REPORTS: Duration = CYCLE.saturating_add(Duration::from_millis(10));
/// Reports asked for until two agree on where an axis is.
const REPORTS_ASKED: u32 = 4;
/// Longest wait for a status report before it is asked for once more.
const REPORT: Duration = Duration::from_millis(200);

impl Controller {
    pub(super) async fn follow_course(
        &self,
        index: usize,
        course: Course,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        let name = self.axes[index].link.name();
        let _operation = self.operation.lock().await;
        self.ready(name, generation).await?;
        if let Some(alarm) = *self.alarm.borrow() {
            return Err(self.alarmed(alarm));
        }
        self.renew_if_stale(index).await?;
        *locked(&self.moved) = Some(index);
        let mut restarts = self.restarts.subscribe();
        let begun = *restarts.borrow_and_update();
        let mut alarm = self.alarm.subscribe();
        let alarmed = async { alarm.wait_for(Option::is_some).await.ok().and_then(|alarm| *alarm) };
        let ended = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => return self.stopped(name).await,
            alarm = alarmed => return Err(self.alarmed(alarm.unwrap_or(Alarm::unknown(self.dialect)))),
            () = async { let _ = restarts.wait_for(|&count| count > begun).await.is_ok(); } => return Err(self.restarted()),
            ended = self.lead(index, course, generation) => ended,
        };
        match ended {
            Err(_) if self.orders.generation() != generation => self.stopped(name).await,
            Err(error) => {
                // It may move still, as far as it was told.
                self.stop().await;
                Err(error)
            }
            reached => reached,
        }
    }

    /// Tells the axis of its way, a little at a time, up to the end of the course.
    async fn lead(&self, index: usize, mut course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        let axis = &self.axes[index];
        let (name, letter, setup) = (axis.link.name(), axis.letter, axis.link.setup());
        let mut track = Track::new(axis.facts().acceleration_mm_per_s2);
        let mut line = self.latest_line();
        let (mut home, mut seen) = (None, None);
        loop {
            let (asked, reading) = self.believed(index, line, &mut seen).await?;
            line = reading.line_number;
            // Only now: a reset meanwhile has lost it, or made it another.
            let Some(now) = axis.link.home().filter(|now| *home.get_or_insert(*now) == *now) else {
                return Err(DeviceError::NotHomed { axis: name });
            };
            if !reading.mode.at_rest() && reading.mode != Mode::Jog {
                let reason = format!("it is in the mode {:?}; stop it, which resets it", reading.mode);
                return Err(DeviceError::Refused { device: self.name.clone(), reason });
            }
            let at = Millimetres(setup.coordinate(reading.machine[letter.index()], now));
            let Some(next) = course(track.see(at, asked, reading.at)) else { break };
            if track.is_worth_an_order(next, at) {
                let speed = next.speed_mm_per_s.min(axis.facts().speed_mm_per_s);
                let machine = setup.machine(next.to.value(), now);
                // Not onto the home switch, which lies at the end of the controller's own limits.
                if self.check_reach(axis, next.to, machine).is_err() {
                    break;
                }
                self.free(&reading, generation).await?;
                axis.note_move(machine - reading.machine[letter.index()], reading.limits);
                let order = grbl::jog(letter, machine, speed * 60.0);
                let answer = self.port.request(order, ANSWER, generation).await;
                line = answer.map_err(|error| self.device_error("take a move", error))?.line_number;
                track.tell(next);
            } else if reading.mode.at_rest() && track.since_told() > BEGIN {
                // There, or it goes no farther.
                break;
            }
            sleep_until(asked + REPORTS).await;
        }
        let _watching = self.watching();
        let Ok(reading) = timeout(END, self.rest(line)).await else {
            return Err(self.timeout("end a motion", END));
        };
        let (reading, home) = (reading?, axis.link.home());
        let Some(home) = home else { return Err(DeviceError::NotHomed { axis: name }) };
        let reached = setup.coordinate(reading.machine[letter.index()], home);
        match track.told() {
            Some(told) if (reached - told.value()).abs() > ARRIVAL_MM => {
                Err(self.held(name, reached, told, reading.hold_pressed))
            }
            _ => Ok(Millimetres(reached)),
        }
    }

    /// A report later than a line, with when it was asked for, whose position the axis can have come to from that of the
    /// report before it: a digit lost on the line makes another number of one.
    async fn believed(
        &self,
        index: usize,
        mut after_line: u64,
        seen: &mut Option<(Instant, f64)>,
    ) -> Result<(Instant, Reading), DeviceError> {
        let axis = &self.axes[index];
        let speed = axis.facts().speed_mm_per_s;
        for _ in 0..REPORTS_ASKED {
            let asked = Instant::now();
            let reading = self.report(after_line).await?;
            after_line = reading.line_number;
            let at = reading.machine[axis.letter.index()];
            let before = seen.replace((reading.at, at));
            if before.is_some_and(|(when, was)| (at - was).abs() <= reach_mm(speed, reading.at - when)) {
                return Ok((asked, reading));
            }
        }
        let detail = format!("its reports contradict one another as to where the {} axis is", axis.link.name());
        Err(DeviceError::Protocol { device: self.name.clone(), detail })
    }

    /// A report later than a line, asked for now.
    async fn report(&self, after_line: u64) -> Result<Reading, DeviceError> {
        for _ in 0..3 {
            // A full queue means that the device takes no bytes: the silence will tell.
            let _ = self.port.urgent(&[grbl::STATUS], false);
            let mut readings = self.readings.subscribe();
            let later = readings.wait_for(|r| r.as_ref().is_some_and(|r| r.line_number > after_line));
            if let Ok(Ok(reading)) = timeout(REPORT, later).await
                && let Some(reading) = reading.clone()
            {
                return Ok(reading);
            }
        }
        Err(self.closed_error().unwrap_or_else(|| self.timeout("report its status", 3 * REPORT)))
    }
}
