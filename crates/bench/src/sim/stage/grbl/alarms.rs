//! Limit pins, alarms and resets: what ends motion at once, and how long the firmware then says nothing.

use super::settings::Heir;
use super::{GrblFirmware, State};

/// The firmware waits this long after it has said an alarm, s: it takes nothing meanwhile, not even a reset.
const MESSAGE_S: f64 = 0.5;

/// What comes once an alarm's message has been waited out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum After {
    /// A critical alarm: deaf to everything but a reset.
    Deaf,
    /// The firmware starts anew; a line that was being carried out gets its `ok` first.
    Start {
        /// Whether there was one.
        owes_ok: bool,
    },
    /// FluidNC stays as it is, locked; a line that was being carried out gets its `ok`.
    Locked {
        /// Whether there was one.
        owes_ok: bool,
    },
}

impl GrblFirmware {
    /// Whether the one limit pin of an axis, which both of its switches are wired to, is pressed.
    pub(super) fn pin_pressed(&self, axis: usize) -> bool {
        self.config.axes[axis].is_some()
            && (self.plant.home_switch_closed(axis) || self.plant.limit_switch_closed(axis))
    }

    /// The limit pins as they are now.
    pub(super) fn pins(&self) -> [bool; 3] {
        std::array::from_fn(|axis| self.pin_pressed(axis))
    }

    /// Looks at the limit pins and tells whether hard limits end what the firmware does: any change of a pin does, a
    /// release as well, but for homing and while it is locked.
    pub(super) fn limits_trip(&mut self) -> bool {
        let now = self.pins();
        let before = std::mem::replace(&mut self.pins_before, now);
        // FluidNC minds a switch that closes, and not one that lets go.
        let changed = match self.config.heir {
            Heir::FluidNc => (0..3).any(|axis| now[axis] && !before[axis]),
            Heir::Grbl | Heir::GrblHal => before != now,
        };
        changed && self.settings.is_on(21) && self.homing.is_none() && self.state != State::Alarm
    }

    /// A critical alarm: deaf until reset.
    pub(super) fn alarm(&mut self, number: u8) {
        self.motion = None;
        self.queue.clear();
        self.say_alarm(number, After::Deaf);
    }

    /// An alarm that ends what is under way and starts the firmware anew.
    pub(super) fn abort(&mut self, number: u8) {
        // Homing is answered in the end even where it failed; a jog was answered when it was taken.
        let owes_ok = self.homing.take().is_some();
        self.motion = None;
        self.envelope = [None; 3];
        let after = if self.fluid.is_some() { After::Locked { owes_ok } } else { After::Start { owes_ok } };
        self.say_alarm(number, after);
    }

    pub(super) fn say_alarm(&mut self, number: u8, after: After) {
        if self.fluid.is_some() {
            self.say(&format!("[MSG:INFO: ALARM: number {number}]"));
        }
        self.last_alarm = number;
        self.say(&format!("ALARM:{number}"));
        self.state = State::Alarm;
        self.message = Some((MESSAGE_S, after));
    }

    /// Lets an alarm's message pass.
    pub(super) fn advance_message(&mut self, dt: f64) {
        let Some((left, after)) = self.message.take() else { return };
        if left > dt {
            self.message = Some((left - dt, after));
            return;
        }
        match after {
            After::Deaf => {
                let hint =
                    if self.fluid.is_some() { "[MSG:ERR: Reset to continue]" } else { "[MSG:Reset to continue]" };
                self.say(hint);
                self.deaf = true;
            }
            After::Locked { owes_ok } => {
                if owes_ok {
                    self.say("ok");
                }
            }
            After::Start { owes_ok } => {
                if owes_ok {
                    self.say("ok");
                }
                self.clear();
                self.start();
            }
        }
        if std::mem::take(&mut self.reset_due) {
            self.reset();
        }
        self.work();
    }

    /// The reset byte.
    pub(super) fn reset(&mut self) {
        if self.fluid.is_some() {
            return self.fluid_reset();
        }
        if self.homing.is_some() {
            return self.abort(6);
        }
        if self.motion.is_some() {
            return self.abort(3);
        }
        if self.deaf && std::mem::take(&mut self.owed_ok) {
            self.say("ok");
        }
        // Asleep, the motors were off: where the axes stand is not known.
        let locked = matches!(self.state, State::Alarm | State::Sleep);
        self.state = if locked { State::Alarm } else { State::Idle };
        self.deaf = false;
        self.clear();
        self.start();
    }

    /// What is printed after power-up and after every reset.
    pub(super) fn start(&mut self) {
        if self.fluid.is_some() {
            return self.fluid_start();
        }
        let help = if self.config.heir == Heir::GrblHal { "'$' or '$HELP'" } else { "'$'" };
        let banner = format!("\r\n{} [{help} for help]", self.config.version);
        self.say(&banner);
        self.pins_before = self.pins();
        if self.settings.is_on(21) && self.pins_before.contains(&true) {
            self.state = State::Alarm;
            self.say("[MSG:Check Limits]");
        }
        if self.state == State::Alarm {
            self.say("[MSG:'$H'|'$X' to unlock]");
        }
    }
}
