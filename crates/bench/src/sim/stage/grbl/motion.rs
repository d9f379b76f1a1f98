//! Motion along straight lines with finite acceleration, and the search for a home switch.

use std::collections::VecDeque;

/// A queued straight line, in machine steps.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Block {
    /// Where it ends, machine steps.
    pub target: [i64; 3],
    /// Speed asked for, mm/s.
    pub speed: f64,
}

/// A line under way: a trapezoid of speed over distance.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Motion {
    from_mm: [f64; 3],
    unit: [f64; 3],
    length_mm: f64,
    travelled_mm: f64,
    speed: f64,
    top_speed: f64,
    acceleration: f64,
    /// Once it is to stop: how long it still goes on as planned, s.
    stopping_in: Option<f64>,
}

impl Motion {
    /// From one point to another (mm), at the speed asked for (mm/s) as far as the axes' greatest speeds (mm/s) and
    /// accelerations (mm/s²) allow; `None` where there is no distance.
    pub(super) fn new(
        from_mm: [f64; 3],
        to_mm: [f64; 3],
        speed: f64,
        speeds: [f64; 3],
        accelerations: [f64; 3],
    ) -> Option<Self> {
        let delta: [f64; 3] = std::array::from_fn(|i| to_mm[i] - from_mm[i]);
        let length_mm = delta.iter().map(|d| d * d).sum::<f64>().sqrt();
        if length_mm < 1e-9 {
            return None;
        }
        let unit = delta.map(|d| d / length_mm);
        let along = |limits: [f64; 3]| {
            (0..3).filter(|&i| unit[i].abs() > 1e-9).map(|i| limits[i] / unit[i].abs()).fold(f64::INFINITY, f64::min)
        };
        Some(Self {
            from_mm,
            unit,
            length_mm,
            travelled_mm: 0.0,
            speed: 0.0,
            top_speed: speed.min(along(speeds)),
            acceleration: along(accelerations),
            stopping_in: None,
        })
    }

    /// Goes on to a farther end in the same direction, at another speed, as lines queued in time are blended; tells
    /// whether that end is in the same direction.
    pub(super) fn extend(&mut self, to_mm: [f64; 3], speed: f64, speeds: [f64; 3]) -> bool {
        let end = self.end_mm();
        let delta: [f64; 3] = std::array::from_fn(|i| to_mm[i] - end[i]);
        let length = delta.iter().map(|d| d * d).sum::<f64>().sqrt();
        let along: f64 = (0..3).map(|i| delta[i] * self.unit[i]).sum();
        if self.is_stopping() || along < length * (1.0 - 1e-9) {
            return false;
        }
        let axes = (0..3).filter(|&i| self.unit[i].abs() > 1e-9).map(|i| speeds[i] / self.unit[i].abs());
        self.top_speed = axes.fold(speed, f64::min);
        self.length_mm += length;
        true
    }

    /// Goes on for `dt` seconds (at most a few milliseconds) and tells whether it has come to rest.
    pub(super) fn advance(&mut self, dt: f64) -> bool {
        let before = self.speed;
        let left = self.length_mm - self.travelled_mm;
        let braking = self.stopping_in.is_some_and(|left| left <= 0.0);
        if let Some(left) = &mut self.stopping_in {
            *left -= dt;
        }
        if braking {
            self.speed = (before - self.acceleration * dt).max(0.0);
        } else {
            // The last term is the speed from which the rest of the way suffices to stop.
            let brake = (2.0 * self.acceleration * left).sqrt();
            let change = self.acceleration * dt;
            self.speed = self.top_speed.clamp(before - change, before + change).min(brake);
        }
        let way = 0.5 * (before + self.speed) * dt;
        // Half a micrometre is a fraction of a motor step: the end of the line.
        if way >= left - 5e-4 {
            self.travelled_mm = self.length_mm;
            self.speed = 0.0;
            return true;
        }
        self.travelled_mm += way;
        braking && self.speed == 0.0
    }

    /// Has it decelerate to rest wherever it is then: what the step buffer holds, seconds, is carried out first.
    pub(super) fn stop(&mut self, buffered_s: f64) {
        self.stopping_in.get_or_insert(buffered_s);
    }

    /// Whether it was told to stop.
    pub(super) const fn is_stopping(&self) -> bool {
        self.stopping_in.is_some()
    }

    /// Where it is now, mm.
    pub(super) fn position_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.from_mm[i] + self.unit[i] * self.travelled_mm)
    }

    /// Where it is to end, mm.
    pub(super) fn end_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.from_mm[i] + self.unit[i] * self.length_mm)
    }

    /// Greatest speed on the way, mm/s.
    pub(super) const fn speed_asked(&self) -> f64 {
        self.top_speed
    }

    /// Speed now, mm/s.
    pub(super) const fn speed(&self) -> f64 {
        self.speed
    }
}

/// Where a homing cycle is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HomingPhase {
    /// Off whatever switch is pressed at the start, where the firmware can tell which it is.
    Leave,
    /// Fast, until the switch closes.
    Seek,
    /// Off the switch.
    PullOff,
    /// Slow, until the switch closes again.
    Locate,
    /// Off the switch, to the home position.
    Settle,
}

impl HomingPhase {
    /// The phase after this one.
    pub(super) const fn next(self) -> Option<Self> {
        match self {
            Self::Leave => Some(Self::Seek),
            Self::Seek => Some(Self::PullOff),
            Self::PullOff => Some(Self::Locate),
            Self::Locate => Some(Self::Settle),
            Self::Settle => None,
        }
    }

    /// Whether it runs towards the switch.
    pub(super) const fn approaches(self) -> bool {
        matches!(self, Self::Seek | Self::Locate)
    }
}

/// One axis in a homing cycle.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct HomingAxis {
    /// Axis number.
    pub axis: usize,
    /// Steps made in this phase.
    pub steps: i64,
    /// Steps due by the time passed in this phase, with their fraction.
    pub due: f64,
    /// Whether it has ended this phase.
    pub done: bool,
}

impl HomingAxis {
    fn all(axes: Vec<usize>) -> Vec<Self> {
        axes.into_iter().map(|axis| Self { axis, steps: 0, due: 0.0, done: false }).collect()
    }
}

/// A homing cycle: every axis of a block goes through the phases together, one block after another.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Homing {
    /// Where the cycle is.
    pub phase: HomingPhase,
    /// The axes of the block that is being homed.
    pub axes: Vec<HomingAxis>,
    /// The blocks after it.
    blocks: VecDeque<Vec<usize>>,
    /// Time to let the switches settle before what comes next, s.
    pub pause_s: f64,
    ended: bool,
}

impl Homing {
    /// Of blocks of axes; `None` where there is none.
    pub(super) fn of(blocks: impl IntoIterator<Item = Vec<usize>>) -> Option<Self> {
        let mut blocks: VecDeque<_> = blocks.into_iter().collect();
        let axes = HomingAxis::all(blocks.pop_front()?);
        Some(Self { phase: HomingPhase::Seek, axes, blocks, pause_s: 0.0, ended: false })
    }

    /// Goes on with what comes next, once the switches have settled for `pause_s`. Returns whether there is something.
    pub(super) fn go_on(&mut self, pause_s: f64) -> bool {
        if std::mem::take(&mut self.ended) {
            return false;
        }
        self.pause_s = pause_s;
        if let Some(next) = self.phase.next() {
            self.phase = next;
            for axis in &mut self.axes {
                (axis.steps, axis.due, axis.done) = (0, 0.0, false);
            }
        } else if let Some(block) = self.blocks.pop_front() {
            (self.phase, self.axes) = (HomingPhase::Seek, HomingAxis::all(block));
        } else {
            // Nothing but the pause is left: every axis is where it ought to be.
            self.ended = true;
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_takes_the_time_of_its_trapezoid_and_ends_at_its_end() {
        let mut motion = Motion::new([0.0; 3], [10.0, 0.0, 0.0], 9.0, [5.0; 3], [20.0; 3]).unwrap();
        let mut time: f64 = 0.0;
        while !motion.advance(0.001) {
            time += 0.001;
            assert!(motion.speed() <= 5.0 + 1e-12);
        }
        // 10 mm at 5 mm/s, with 0.25 s more for speeding up and slowing down.
        assert!((time - 2.25).abs() < 0.02, "{time}");
        assert_eq!(motion.position_mm(), [10.0, 0.0, 0.0]);
    }

    #[test]
    fn a_stop_takes_its_distance_after_what_is_buffered() {
        let mut motion = Motion::new([0.0; 3], [0.0, -10.0, 0.0], 5.0, [5.0; 3], [20.0; 3]).unwrap();
        for _ in 0..1000 {
            assert!(!motion.advance(0.001));
        }
        let at = motion.position_mm()[1];
        motion.stop(0.05);
        let mut time = 0.0;
        while !motion.advance(0.001) {
            time += 0.001;
        }
        // v²/2a = 25/40 mm, and 0.05 s at 5 mm/s before that. A real Grbl 1.1h took 0.288 s and 0.869 mm.
        assert!((at - motion.position_mm()[1] - 0.875).abs() < 0.01, "{}", motion.position_mm()[1]);
        assert!((time - 0.3_f64).abs() < 0.015, "{time}");
    }
}
