//! The limit switches. Both of an axis are wired to its one pin, and homing takes whichever is pressed for the home
//! switch: from the other one it would "pull off" the wrong way, a millimetre further at each try.

use super::super::grbl::{self, Alarm, Dialect, Letter, Mode};
use super::stop::ALARM_MESSAGE;
use super::{ANSWER, Axis, Controller, START_UP, locked};
use crate::config::Side;
use crate::device::port::PortError;
use crate::device::{DeviceError, MoveTime};

/// The furthest that an axis is moved off a switch, mm, from when its pin was last seen free.
const LONGEST_MM: f64 = 3.0;
/// How fast, mm/s, at most.
const SPEED_MM_PER_S: f64 = 1.0;

/// The last motion of an axis, by which a pressed pin is told to be the home switch's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Last {
    /// Not known: it may have been moved by hand, or begun on a switch that is not known.
    #[default]
    Unknown,
    /// Towards home, with the pin free when it began.
    Home,
    /// Away from home.
    Away,
}

/// Where an axis came from.
#[derive(Debug, Default)]
pub(super) struct Way {
    last: Last,
    /// How far it has been moved off a switch since its pin was last seen free, mm.
    off_mm: f64,
    /// Whether its state says that a pin is pressed.
    told: bool,
}

impl Axis {
    /// Whether the axis's limit pin is pressed.
    pub(super) fn pressed(&self, limits: [bool; 3]) -> bool {
        limits[self.letter.index()]
    }

    /// Why homing must not begin, where it must not: a pin is pressed, and it is not known to be the home switch's.
    pub(super) fn barred(&self, limits: [bool; 3]) -> Option<String> {
        if !self.pressed(limits) || locked(&self.way).last == Last::Home {
            return None;
        }
        let axis = self.link.name();
        Some(format!(
            "a limit switch of the {axis} axis is pressed, and homing would take it for the home switch: look which it \
             is, and say so to have the axis moved off it (leave-switch); then home"
        ))
    }

    /// Notes a motion that is about to begin, by how the controller's position will change (mm).
    pub(super) fn note_move(&self, by_mm: f64, limits: [bool; 3]) {
        if by_mm == 0.0 {
            return;
        }
        let homewards = (by_mm < 0.0) == self.link.setup().homes_negative();
        let mut way = locked(&self.way);
        way.last = match homewards {
            false => Last::Away,
            true if self.pressed(limits) && way.last != Last::Home => Last::Unknown,
            true => Last::Home,
        };
    }

    /// Notes homing that is about to begin: what it meets is the home switch, unless one is pressed already.
    pub(super) fn note_homing(&self, limits: [bool; 3]) {
        locked(&self.way).last = if self.pressed(limits) { Last::Unknown } else { Last::Home };
    }

    /// Notes how homing ended: an end in words of the controller's own (`ALARM:8`) has the axis pulled off something.
    pub(super) fn note_homed(&self, ended: Result<(), &PortError>, dialect: Dialect) {
        match ended {
            Ok(()) => locked(&self.way).last = Last::Away,
            Err(PortError::Halted(line)) if Alarm::from_line(line, dialect).is_some_and(Alarm::is_pull_off) => {
                locked(&self.way).last = Last::Unknown;
            }
            Err(_) => {}
        }
    }

    /// Notes what a reading says of the pin, and returns the words for the state, where that has to say something else.
    pub(super) fn note_pin(&self, limits: [bool; 3]) -> Option<Option<String>> {
        let barred = self.barred(limits);
        let mut way = locked(&self.way);
        if !self.pressed(limits) {
            way.off_mm = 0.0;
        }
        let told = std::mem::replace(&mut way.told, barred.is_some());
        (told || barred.is_some()).then_some(barred)
    }

    /// What a hard limit means after the axis's last motion.
    fn hard_limit(&self) -> Option<String> {
        let (axis, side) = (self.link.name(), self.link.setup().config.home_side);
        match locked(&self.way).last {
            Last::Away => Some(format!(
                "the {axis} axis was on its way from home: a switch that is pressed now is its far switch ({}), so look, \
                 and say so to have it moved off (leave-switch), then home",
                side.opposite()
            )),
            Last::Home => Some(format!("the {axis} axis was on its way to its home switch ({side})")),
            Last::Unknown => None,
        }
    }
}

impl Controller {
    /// An alarm, with what the last motion tells of it.
    pub(super) fn alarmed(&self, alarm: Alarm) -> DeviceError {
        DeviceError::Alarm { device: self.name.clone(), reason: self.alarm_words(alarm) }
    }

    /// An alarm in words, with what the last motion tells of it.
    pub(super) fn alarm_words(&self, alarm: Alarm) -> String {
        let moved = *locked(&self.moved);
        let more = moved.filter(|_| alarm.is_hard_limit()).and_then(|index| self.axes[index].hard_limit());
        more.map_or_else(|| alarm.to_string(), |more| format!("{alarm}; {more}"))
    }

    /// Forgets where the axes came from: they may have been moved by hand.
    pub(super) fn forget_ways(&self) {
        for axis in &self.axes {
            locked(&axis.way).last = Last::Unknown;
        }
    }

    /// Leaves what the controller obeys nothing but a reset in: a critical alarm, a hold, sleep. After another alarm Grbl starts
    /// by itself; an heir that does not is reset.
    pub(super) async fn wake(&self) -> Result<(), DeviceError> {
        let mut alarm = self.alarm.subscribe();
        let now = *alarm.borrow_and_update();
        let locked_up = match now {
            Some(alarm) if alarm.needs_reset() => true,
            Some(_) => tokio::time::timeout(ALARM_MESSAGE, alarm.wait_for(Option::is_none)).await.is_err(),
            None => false,
        };
        let held = self.readings.borrow().as_ref().is_some_and(|r| matches!(r.mode, Mode::Hold(_) | Mode::Sleep));
        if (locked_up || held) && !self.restart(false).await {
            return Err(self.timeout("answer a reset", START_UP));
        }
        Ok(())
    }

    /// See [`Stage::step_off`](crate::device::Stage::step_off).
    pub(super) async fn step_axis_off(
        &self,
        index: usize,
        towards: Side,
        distance_mm: f64,
        generation: u64,
    ) -> Result<bool, DeviceError> {
        let axis = &self.axes[index];
        let (name, letter) = (axis.link.name(), axis.letter);
        let _operation = self.operation.lock().await;
        self.ready(name, generation).await?;
        self.wake().await?;
        self.renew_settings(index).await?;
        let _watching = self.watching();
        let reading = self.fresh_reading(self.latest_line()).await?;
        if !axis.pressed(reading.limits) {
            return Ok(true);
        }
        let by_hand = |why: &str| DeviceError::Refused {
            device: self.name.clone(),
            reason: format!(
                "{why}: take the power from the motors (the emergency stop) and turn the {name} axis by hand towards its \
                 {towards} end until the switch lets go; then give the power back, stop, and home"
            ),
        };
        if locked(&axis.way).off_mm + distance_mm > LONGEST_MM + 1e-9 {
            return Err(by_hand(&format!("the switch is pressed still after {LONGEST_MM} mm")));
        }
        let by_mm = axis.link.setup().direction() * towards.sign() * distance_mm;
        if !self.is_within_bounds(letter, reading.machine[letter.index()] + by_mm) {
            return Err(by_hand("the controller's soft limits (soft_limits) do not let the axis off its switch"));
        }
        self.unlock(generation).await?;
        {
            let mut way = locked(&axis.way);
            way.last = Last::Unknown;
            way.off_mm += distance_mm;
        }
        let facts = axis.facts();
        let speed = facts.speed_mm_per_s.min(SPEED_MM_PER_S);
        let allowed = MoveTime::of_trapezoid(distance_mm, speed, facts.acceleration_mm_per_s2).maximum;
        let mut alarm = self.alarm.subscribe();
        let answer = self.port.request(grbl::jog_by(letter, by_mm, speed * 60.0), ANSWER, generation).await;
        let after_line = match answer {
            Ok(answer) => answer.line_number,
            Err(_) if self.orders.generation() != generation => return self.stopped(name).await,
            Err(PortError::Refused(line)) if grbl::is_beyond_travel(&line) => {
                return Err(by_hand("the controller's soft limits ($20) do not let the axis off its switch"));
            }
            Err(PortError::Halted(_)) => self.latest_line(),
            Err(error) => {
                self.stop().await;
                return Err(self.device_error("move off a switch", error));
            }
        };
        let rested = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => return self.stopped(name).await,
            () = async { let _ = alarm.wait_for(Option::is_some).await.is_ok(); } => None,
            rested = self.rest(after_line) => Some(rested),
            () = tokio::time::sleep(allowed) => Some(Err(self.timeout("end a move off a switch", allowed))),
        };
        match rested {
            Some(Ok(reading)) => Ok(!axis.pressed(reading.limits)),
            Some(Err(error)) => {
                self.stop().await;
                Err(error)
            }
            // A pin that changes is an alarm also where its switch lets go.
            None => {
                if let Some(other) = (*self.alarm.borrow()).filter(|alarm| !alarm.is_hard_limit()) {
                    return Err(DeviceError::Alarm { device: self.name.clone(), reason: other.to_string() });
                }
                self.wake().await?;
                self.ready(name, generation).await?;
                Ok(!axis.pressed(self.fresh_reading(self.latest_line()).await?.limits))
            }
        }
    }

    /// Whether homing axes would begin on a switch that is not known to be the home switch.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] where it would.
    pub(super) fn check_switches(&self, homed: &[&Axis], limits: [bool; 3]) -> Result<(), DeviceError> {
        match homed.iter().find_map(|axis| axis.barred(limits)) {
            Some(reason) => Err(DeviceError::Refused { device: self.name.clone(), reason }),
            None => Ok(()),
        }
    }
}

/// Whether homing a block of axes is bounded by the slowest of them: the sum of what Grbl's blocks can take, at most.
pub(super) fn blocks_time(time_of: impl Fn(&[Letter]) -> f64) -> f64 {
    use Letter::{X, Y, Z};
    let ways: [&[&[Letter]]; 3] = [&[&[Z], &[X, Y]], &[&[X], &[Y], &[Z]], &[&[X, Y, Z]]];
    ways.iter().map(|blocks| blocks.iter().map(|block| time_of(block)).sum()).fold(0.0, f64::max)
}
