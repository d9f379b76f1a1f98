//! What turns one motor in the twins of Zaber, PI and Trinamic controllers: ramps, homing, limit switches.

use std::sync::Arc;

use crate::config::AxisConfig;
use crate::device::AxisName;
use crate::device::stage::axis::AxisSetup;
use crate::sim::plant::Plant;

use super::PULL_OFF_MM;

/// Longest step of time taken at once, s.
const TICK: f64 = 0.001;

/// One axis as a firmware is set up for it. Positions are the controller's own, mm, 0 at home.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveConfig {
    /// The controller's name for the axis.
    pub name: String,
    /// The controller's units a millimetre.
    pub units_per_mm: f64,
    /// Smallest step of the motor, mm.
    pub step_mm: f64,
    /// Greatest speed, mm/s.
    pub speed_mm_per_s: f64,
    /// Acceleration, mm/s².
    pub acceleration_mm_per_s2: f64,
    /// Least position.
    pub low_mm: f64,
    /// Greatest position.
    pub high_mm: f64,
    /// Whether the home switch is at the negative end.
    pub homes_negative: bool,
    /// Whether its motor is wired the other way round, which the controller makes good.
    pub motor_inverted: bool,
}

impl DriveConfig {
    /// What suits an axis of the bench.
    #[must_use]
    pub fn of(config: &AxisConfig) -> Self {
        // Which axis it is makes no difference to its coordinate.
        let setup = AxisSetup::new(AxisName::Focus, config);
        let (a, b) = (setup.machine(config.low_limit_mm, 0.0), setup.machine(config.high_limit_mm, 0.0));
        Self {
            name: config.axis.clone(),
            units_per_mm: config.steps_per_mm,
            step_mm: (1.0 / config.steps_per_mm).min(1e-3),
            speed_mm_per_s: config.speed_mm_per_s,
            acceleration_mm_per_s2: config.acceleration_mm_per_s2,
            low_mm: a.min(b),
            high_mm: a.max(b),
            homes_negative: setup.homes_negative(),
            motor_inverted: config.motor_inverted,
        }
    }
}

/// What came of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It stands at its target.
    Arrived,
    /// It was stopped.
    Stopped,
    /// A limit switch closed: it stands still.
    Limit,
    /// It stands at home.
    Homed,
    /// It found no home switch.
    HomingFailed,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Task {
    Rest,
    To(f64),
    At(f64),
    Stop,
    Home(Phase),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// Fast towards the switch, from here.
    Seek(f64),
    /// To here, off the switch.
    PullOff(f64),
    /// Slowly towards the switch.
    Locate,
    /// To here, off the switch, and that is home.
    Settle(f64),
}

/// One motor.
pub struct Drive {
    /// What it is set up for.
    pub config: DriveConfig,
    plant: Arc<dyn Plant>,
    axis: usize,
    /// Greatest speed now, mm/s.
    pub speed: f64,
    /// Speed of the search for a switch, mm/s, whatever the last move was told.
    pub homing_speed: f64,
    /// Acceleration now, mm/s².
    pub acceleration: f64,
    /// Travel of the motor since power-up, mm.
    motor: f64,
    /// What the motor turned of it, in its own direction, mm: a stalled one turns nothing.
    turned: f64,
    told: f64,
    /// Whether the controller turns the motor the other way round.
    pub inverted: bool,
    /// Whether the motor stands still whatever steps it is given.
    pub stalled: bool,
    /// Position less travel.
    origin: f64,
    velocity: f64,
    task: Task,
    /// Whether the switch that homing looks for is at the negative end.
    seeks_negative: bool,
    limit_closed: bool,
    /// Whether the limit switch that closed last is the positive one.
    pub positive_limit: bool,
}

impl Drive {
    /// A motor at rest, whose position is 0 until it is set.
    #[must_use]
    pub fn new(config: DriveConfig, axis: usize, plant: Arc<dyn Plant>) -> Self {
        let limit_closed = plant.limit_switch_closed(axis);
        Self {
            speed: config.speed_mm_per_s,
            homing_speed: config.speed_mm_per_s,
            acceleration: config.acceleration_mm_per_s2,
            plant,
            axis,
            motor: 0.0,
            turned: 0.0,
            told: 0.0,
            inverted: config.motor_inverted,
            stalled: false,
            origin: 0.0,
            velocity: 0.0,
            task: Task::Rest,
            seeks_negative: config.homes_negative,
            limit_closed,
            positive_limit: false,
            config,
        }
    }

    /// Position, mm, in whole motor steps.
    #[must_use]
    pub fn position(&self) -> f64 {
        let step = self.config.step_mm;
        ((self.motor + self.origin) / step).round() * step
    }

    /// Makes the place where it stands this position, mm.
    pub fn set_position(&mut self, position: f64) {
        self.origin = position - self.motor;
    }

    /// Speed, mm/s, with its sign.
    #[must_use]
    pub fn velocity(&self) -> f64 {
        self.velocity
    }

    /// Whether it moves, or is about to.
    #[must_use]
    pub fn is_moving(&self) -> bool {
        self.task != Task::Rest
    }

    /// Whether it is on its way home.
    #[must_use]
    pub fn is_homing(&self) -> bool {
        matches!(self.task, Task::Home(_))
    }

    /// Whether a limit switch is closed now.
    #[must_use]
    pub fn at_limit(&self) -> bool {
        self.plant.limit_switch_closed(self.axis)
    }

    /// Whether it homes, or has homed last, to its home switch and not to the one at the other end.
    #[must_use]
    pub fn seeks_home(&self) -> bool {
        self.seeks_negative == self.config.homes_negative
    }

    /// Whether the switch that homing looks for is closed now.
    fn sought_switch_closed(&self) -> bool {
        if self.seeks_home() { self.home_switch_closed() } else { self.at_limit() && !self.home_switch_closed() }
    }

    /// Whether the home switch is closed now.
    #[must_use]
    pub fn home_switch_closed(&self) -> bool {
        self.plant.home_switch_closed(self.axis)
    }

    /// Starts towards a position, mm.
    pub fn move_to(&mut self, position: f64) {
        self.task = Task::To(position);
    }

    /// Starts at a speed, mm/s, whose sign is the direction.
    pub fn run(&mut self, velocity: f64) {
        self.task = Task::At(velocity);
    }

    /// Starts homing: fast to the home switch, off it, slowly to it, off it; its end is [`Event::Homed`].
    pub fn home(&mut self) {
        self.home_towards(self.config.homes_negative);
    }

    /// Starts homing to the switch at one of the ends.
    pub fn home_towards(&mut self, negative: bool) {
        self.seeks_negative = negative;
        self.velocity = 0.0;
        self.task = Task::Home(Phase::Seek(self.motor));
    }

    /// Comes to rest along its ramp.
    pub fn stop(&mut self) {
        if self.is_moving() {
            self.task = Task::Stop;
        }
    }

    /// Stands still at once.
    pub fn halt(&mut self) {
        self.velocity = 0.0;
        self.task = Task::Rest;
    }

    /// As after switching it off and on: standing still, where it stands is 0.
    pub fn power_cycle(&mut self) {
        self.halt();
        self.origin = -self.motor;
        self.inverted = self.config.motor_inverted;
        (self.speed, self.homing_speed) = (self.config.speed_mm_per_s, self.config.speed_mm_per_s);
        self.acceleration = self.config.acceleration_mm_per_s2;
    }

    /// Lets time pass, seconds, and tells what came to an end.
    pub fn advance(&mut self, seconds: f64) -> Option<Event> {
        let mut left = seconds;
        while left > 0.0 && self.is_moving() {
            // The slow approach decides where home is.
            let fine = matches!(self.task, Task::Home(Phase::Locate));
            let dt = left.min(if fine { TICK / 20.0 } else { TICK });
            left -= dt;
            if let Some(event) = self.step(dt) {
                return Some(event);
            }
        }
        None
    }

    fn step(&mut self, dt: f64) -> Option<Event> {
        let ended = match self.task {
            Task::Rest => None,
            Task::To(target) => self.towards(target - self.origin, self.speed, dt).then_some(Event::Arrived),
            Task::At(wanted) => {
                self.ramp(wanted, dt);
                None
            }
            Task::Stop => {
                self.ramp(0.0, dt);
                (self.velocity == 0.0).then_some(Event::Stopped)
            }
            Task::Home(phase) => return self.step_home(phase, dt),
        };
        let closed = self.at_limit();
        if closed && !std::mem::replace(&mut self.limit_closed, closed) {
            self.positive_limit = self.velocity > 0.0;
            self.halt();
            return Some(Event::Limit);
        }
        self.limit_closed = closed;
        if ended.is_some() {
            self.halt();
        }
        ended
    }

    fn step_home(&mut self, phase: Phase, dt: f64) -> Option<Event> {
        let towards = if self.seeks_negative { -1.0 } else { 1.0 };
        let (fast, slow) = (self.homing_speed, self.homing_speed / 4.0);
        match phase {
            Phase::Seek(from) => {
                if self.sought_switch_closed() {
                    self.velocity = 0.0;
                    self.task = Task::Home(Phase::PullOff(self.motor - towards * PULL_OFF_MM));
                } else if (self.motor - from).abs() > 1.5 * (self.config.high_mm - self.config.low_mm) + 10.0 {
                    self.halt();
                    return Some(Event::HomingFailed);
                } else {
                    self.ramp(towards * fast, dt);
                }
            }
            Phase::PullOff(to) => {
                if self.towards(to, fast, dt) {
                    self.velocity = 0.0;
                    self.task = Task::Home(Phase::Locate);
                }
            }
            Phase::Locate => {
                if self.sought_switch_closed() {
                    self.velocity = 0.0;
                    self.task = Task::Home(Phase::Settle(self.motor - towards * PULL_OFF_MM));
                } else {
                    self.ramp(towards * slow, dt);
                }
            }
            Phase::Settle(to) => {
                if self.towards(to, fast, dt) {
                    self.halt();
                    self.limit_closed = self.at_limit();
                    return Some(Event::Homed);
                }
            }
        }
        None
    }

    /// Changes the speed towards one wanted and goes on with it.
    fn ramp(&mut self, wanted: f64, dt: f64) {
        let before = self.velocity;
        let change = self.acceleration * dt;
        self.velocity += (wanted - before).clamp(-change, change);
        self.turn(0.5 * (before + self.velocity) * dt);
    }

    /// Goes towards a travel of the motor; tells whether it is there.
    fn towards(&mut self, target: f64, speed: f64, dt: f64) -> bool {
        let left = target - self.motor;
        // The speed from which the rest of the way suffices to stop.
        let brake = (2.0 * self.acceleration * left.abs()).sqrt();
        let before = self.velocity;
        let wanted = left.signum() * speed.min(brake);
        let change = self.acceleration * dt;
        self.velocity = if wanted.abs() < before.abs() && wanted * before > 0.0 {
            wanted
        } else {
            before + (wanted - before).clamp(-change, change)
        };
        let way = 0.5 * (before + self.velocity) * dt;
        if left.abs() <= 0.5 * self.config.step_mm || (way * left > 0.0 && way.abs() >= left.abs()) {
            self.turn(left);
            return true;
        }
        self.turn(way);
        false
    }

    fn turn(&mut self, way: f64) {
        self.motor += way;
        if !self.stalled {
            self.turned += if self.inverted == self.config.motor_inverted { way } else { -way };
        }
        let step = self.config.step_mm;
        let position = (self.turned / step).round() * step;
        if position != self.told {
            self.told = position;
            self.plant.motor_moved(self.axis, position);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BenchConfig;
    use crate::sim::plant::Slides;

    fn drive() -> (Drive, Arc<Slides>) {
        let config = BenchConfig::default().e;
        let slides = Slides::new(&[(&config, 20.0)]);
        (Drive::new(DriveConfig::of(&config), 0, slides.clone()), slides)
    }

    fn until_rest(drive: &mut Drive) -> (f64, Event) {
        let mut seconds = 0.0;
        loop {
            seconds += 0.001;
            if let Some(event) = drive.advance(0.001) {
                return (seconds, event);
            }
            assert!(seconds < 100.0, "it never comes to rest");
        }
    }

    #[test]
    fn a_move_takes_the_time_of_its_trapezoid() {
        let (mut drive, slides) = drive();
        drive.move_to(-10.0);
        let (seconds, event) = until_rest(&mut drive);
        // 10 mm at 5 mm/s, and 0.25 s for the ramps.
        assert!(event == Event::Arrived && (seconds - 2.25).abs() < 0.03, "{event:?} {seconds}");
        assert!((slides.at(0) - 10.0).abs() < 2e-3 && drive.position() == -10.0);
    }

    #[test]
    fn a_stop_takes_its_distance() {
        let (mut drive, slides) = drive();
        drive.move_to(-15.0);
        drive.advance(1.0);
        let at = slides.at(0);
        drive.stop();
        assert_eq!(until_rest(&mut drive).1, Event::Stopped);
        // v²/2a = 25/40 mm.
        assert!((at - slides.at(0) - 0.625).abs() < 0.01);
    }

    #[test]
    fn homing_ends_a_pull_off_from_the_switch_and_fails_without_motor() {
        let (mut drive, slides) = drive();
        drive.home();
        assert_eq!(until_rest(&mut drive).1, Event::Homed);
        assert!((slides.at(0) - 30.0).abs() < 5e-3, "{}", slides.at(0));
        drive.stalled = true;
        drive.home();
        assert_eq!(until_rest(&mut drive).1, Event::HomingFailed);
    }
}
