//! Grbl 1.1's firmware, and its heirs grblHAL and FluidNC ([`Heir`]). A jog that is queued in the direction of the one under
//! way is blended with it; other blocks come to rest between one another, unlike Grbl's.
//!
//! ```text
//!            $J=            end, 0x85, !
//!   Idle ---------> Jog ------------------> Idle          0x18 in motion: ALARM:3, Alarm
//!   Idle --G0/G1--> Run --end-> Idle, --!-> Hold --~-> Run
//!   Idle, Alarm --$H--> Home --switch found--> Idle       not found: ALARM:9, Alarm; 0x18: ALARM:6, Alarm
//!   Alarm --$X--> Idle
//!   ALARM:1 (hard limit) and ALARM:2 (soft limit): deaf to everything but 0x18
//! ```
//!
//! After every alarm nothing is taken for half a second, not even 0x18. Both switches of an axis are wired to its one pin.
//! What FluidNC does otherwise is in `fluidnc.rs`.

mod alarms;
mod configuration;
mod firmware;
mod fluidnc;
mod gcode;
mod homing;
mod motion;
mod report;
mod settings;

use std::collections::VecDeque;
use std::sync::Arc;

use motion::{Block, Homing, Motion};
use settings::Settings;
pub use settings::{FirmwareAxis, FirmwareConfig, Heir};

use super::Firmware;
use crate::sim::plant::Plant;

/// Blocks that the planner holds; a line that needs another waits.
const PLANNER_BLOCKS: usize = 15;
/// Bytes that the receive buffer holds; more are lost.
const RECEIVE_BYTES: usize = 128;
/// Longest line; a longer one is answered with an error.
const LONGEST_LINE: usize = 80;
/// Longest step of time taken at once, s: motors report to the plant at least this often.
const TICK: f64 = 0.001;

/// What the firmware is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    Jog,
    Run,
    Hold,
    Alarm,
    Door,
    Home,
    Sleep,
}

/// Grbl 1.1's behaviour over the axes of one controller.
pub struct GrblFirmware {
    config: FirmwareConfig,
    plant: Arc<dyn Plant>,
    settings: Settings,
    state: State,
    /// In a critical alarm nothing is answered until the reset; the line that caused it gets its `ok` then.
    deaf: bool,
    owed_ok: bool,
    alarm_at_rest: Option<u8>,
    /// Motor positions since power-up.
    steps: [i64; 3],
    /// Steps that the motors made, counted in their own direction: a stalled one makes none.
    turned: [i64; 3],
    /// Whether a motor follows its steps.
    stalled: [bool; 3],
    /// The limit pins when they were last looked at.
    pins_before: [bool; 3],
    /// An alarm's message that is being waited out: how long still, s, and what comes then.
    message: Option<(f64, alarms::After)>,
    /// How long it still holds its motors after a motion before it switches them off, s: it answers nothing meanwhile.
    silent_s: f64,
    /// What has come in the meantime.
    unheard: Vec<u8>,
    /// Machine position less motor position.
    origin: [i64; 3],
    /// grblHAL's soft limits, machine mm: those of an axis that is homed, as it was set then.
    envelope: [Option<(f64, f64)>; 3],
    motion: Option<Motion>,
    queue: VecDeque<Block>,
    homing: Option<Homing>,
    line: Vec<u8>,
    waiting: VecDeque<Vec<u8>>,
    waiting_bytes: usize,
    report_due: bool,
    /// A reset that came while an alarm was being said: FluidNC carries it out afterwards.
    reset_due: bool,
    last_alarm: u8,
    /// What FluidNC has of its own.
    fluid: Option<configuration::Fluid>,
    /// Which way each axis leaves the switch that it stands on, in steps.
    leaving: [i64; 3],
    reports: u32,
    modal: gcode::Modal,
    out: Vec<u8>,
}

impl GrblFirmware {
    /// A firmware just powered up: locked until homed, as Grbl is when homing is on.
    #[must_use]
    pub fn new(config: FirmwareConfig, plant: Arc<dyn Plant>) -> Self {
        let settings = Settings::new(&config);
        let fluid = (config.heir == Heir::FluidNc).then(|| configuration::Fluid::new(&config));
        let mut firmware = Self {
            fluid,
            leaving: [0; 3],
            reset_due: false,
            last_alarm: 0,
            config,
            plant,
            settings,
            state: State::Alarm,
            deaf: false,
            owed_ok: false,
            alarm_at_rest: None,
            steps: [0; 3],
            turned: [0; 3],
            stalled: [false; 3],
            pins_before: [false; 3],
            message: None,
            silent_s: 0.0,
            unheard: Vec::new(),
            origin: [0; 3],
            envelope: [None; 3],
            motion: None,
            queue: VecDeque::new(),
            homing: None,
            line: Vec::new(),
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            report_due: false,
            reports: 0,
            modal: gcode::Modal::default(),
            out: Vec::new(),
        };
        if firmware.config.blank_settings {
            firmware.say("error:7");
            firmware.say_settings();
        }
        if firmware.fluid.is_some() {
            firmware.fluid_power_up();
            // That was a while ago.
            firmware.message = None;
        } else {
            firmware.start();
        }
        firmware
    }

    /// Machine position, mm.
    fn machine_mm(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.mm(i, self.steps[i] + self.origin[i]))
    }

    fn mm(&self, axis: usize, steps: i64) -> f64 {
        steps as f64 / self.settings.of_axis(100, axis)
    }

    fn say(&mut self, line: &str) {
        self.out.extend_from_slice(line.as_bytes());
        self.out.extend_from_slice(b"\r\n");
    }

    pub(super) fn say_settings(&mut self) {
        let lines: Vec<String> = self.settings.lines().collect();
        for line in lines {
            self.say(&line);
        }
    }

    /// Forgets what was under way and what waited.
    fn clear(&mut self) {
        self.alarm_at_rest = None;
        self.motion = None;
        self.homing = None;
        self.message = None;
        self.silent_s = 0.0;
        self.unheard.clear();
        self.report_due = false;
        self.queue.clear();
        self.line.clear();
        self.waiting.clear();
        self.waiting_bytes = 0;
        self.modal = gcode::Modal::default();
    }

    fn hold(&mut self) {
        match self.state {
            State::Idle => self.state = State::Hold,
            State::Run => {
                self.state = State::Hold;
                self.decelerate();
            }
            // A jog is cancelled by a hold, not held.
            State::Jog => self.decelerate(),
            State::Hold | State::Alarm | State::Door | State::Home | State::Sleep => {}
        }
    }

    fn open_door(&mut self) {
        if matches!(self.state, State::Idle | State::Run | State::Jog | State::Hold) {
            self.state = State::Door;
            self.decelerate();
            self.say("[MSG:Check Door]");
        }
    }

    fn resume(&mut self) {
        if matches!(self.state, State::Hold | State::Door) && self.motion.is_none() {
            self.state = State::Idle;
            self.next_block(State::Run);
        }
        self.work();
    }

    fn decelerate(&mut self) {
        // Segments of 10 ms: five of Grbl's, twelve of FluidNC's.
        let buffered_s = if self.fluid.is_some() { 0.12 } else { 0.05 };
        if let Some(motion) = &mut self.motion {
            motion.stop(buffered_s);
        }
    }

    /// Answers the lines that can be answered now.
    fn work(&mut self) {
        while (!self.deaf || self.fluid.is_some())
            && self.silent_s <= 0.0
            && self.message.is_none()
            && self.homing.is_none()
            && self.alarm_at_rest.is_none()
        {
            let Some(line) = self.waiting.front() else { break };
            let moves = !line.starts_with(b"$") || line.starts_with(b"$J");
            if moves && self.queue.len() >= PLANNER_BLOCKS {
                break;
            }
            let line = self.waiting.pop_front().unwrap_or_default();
            self.waiting_bytes = self.waiting_bytes.saturating_sub(line.len() + 1);
            let answer = if line.len() > LONGEST_LINE { Err(gcode::Refusal::Error(11)) } else { self.execute(&line) };
            match answer {
                Ok(gcode::Answer::Ok) => self.say("ok"),
                // Answered at the end.
                Ok(gcode::Answer::AtEnd) => {}
                Err(gcode::Refusal::Error(number)) => self.say(&format!("error:{number}")),
                Err(gcode::Refusal::SoftLimit) => {
                    if self.motion.is_some() {
                        self.decelerate();
                        self.alarm_at_rest = Some(2);
                    } else {
                        self.alarm(2);
                    }
                    self.owed_ok = true;
                }
            }
        }
    }

    /// Queues a line and starts it if nothing moves.
    fn plan(&mut self, target_mm: [f64; 3], speed: f64, as_state: State) {
        let target: [i64; 3] = std::array::from_fn(|i| (target_mm[i] * self.settings.of_axis(100, i)).round() as i64);
        let (speeds, to) = (self.speeds(), std::array::from_fn(|i| self.mm(i, target[i])));
        let jogs_on = self.state == State::Jog && as_state == State::Jog && self.queue.is_empty();
        if jogs_on && self.motion.as_mut().is_some_and(|motion| motion.extend(to, speed, speeds)) {
            return;
        }
        self.queue.push_back(Block { target, speed });
        if self.state == State::Idle {
            self.next_block(as_state);
        }
    }

    /// Where the last queued line ends, machine mm.
    fn planned_mm(&self) -> [f64; 3] {
        match self.queue.back() {
            Some(block) => std::array::from_fn(|i| self.mm(i, block.target[i])),
            None => match &self.motion {
                Some(motion) => motion.end_mm(),
                None => self.machine_mm(),
            },
        }
    }

    /// The axes' greatest speeds, mm/s.
    fn speeds(&self) -> [f64; 3] {
        std::array::from_fn(|i| self.settings.of_axis(110, i) / 60.0)
    }

    fn next_block(&mut self, as_state: State) {
        while let Some(block) = self.queue.pop_front() {
            let to = std::array::from_fn(|i| self.mm(i, block.target[i]));
            let speeds = self.speeds();
            let accelerations = std::array::from_fn(|i| self.settings.of_axis(120, i));
            self.motion = Motion::new(self.machine_mm(), to, block.speed, speeds, accelerations);
            if self.motion.is_some() {
                self.state = as_state;
                return;
            }
        }
        self.state = State::Idle;
    }

    fn advance_motion(&mut self, dt: f64) {
        let Some(mut motion) = self.motion.take() else { return };
        let at_rest = motion.advance(dt);
        let position = motion.position_mm();
        for (axis, mm) in position.into_iter().enumerate() {
            let steps = (mm * self.settings.of_axis(100, axis)).round() as i64 - self.origin[axis];
            self.turn(axis, steps);
        }
        if self.limits_trip() {
            self.envelope = [None; 3];
            self.alarm(1);
            return;
        }
        if !at_rest {
            self.motion = Some(motion);
            return;
        }
        if let Some(number) = self.alarm_at_rest.take() {
            self.alarm(number);
            return;
        }
        match (self.state, motion.is_stopping()) {
            (State::Jog, true) => {
                self.queue.clear();
                self.state = State::Idle;
            }
            (State::Hold | State::Door, _) => {
                // What is left of the line comes first when the hold ends.
                let target = motion.end_mm();
                let rest = std::array::from_fn(|i| (target[i] * self.settings.of_axis(100, i)).round() as i64);
                self.queue.push_front(Block { target: rest, speed: motion.speed_asked() });
            }
            (state, _) => self.next_block(state),
        }
        if self.motion.is_none() {
            self.fall_silent();
        }
        self.work();
    }

    /// After a motion the firmware waits `$1` milliseconds where it stands in its program, then switches its motors off;
    /// 255 keeps them on.
    fn fall_silent(&mut self) {
        let held_ms = self.settings.get(1);
        if held_ms < 255.0 {
            self.silent_s = held_ms / 1000.0;
        }
    }

    /// Lets that time pass, and hears what came in it: of any number of `?` one.
    fn advance_silence(&mut self, dt: f64) {
        self.silent_s -= dt;
        if self.silent_s > 0.0 {
            return;
        }
        let unheard = std::mem::take(&mut self.unheard);
        if unheard.contains(&0x18) {
            return self.receive(0x18);
        }
        if unheard.contains(&b'?') {
            self.report();
        }
        for byte in unheard.into_iter().filter(|&byte| byte != b'?') {
            self.receive(byte);
        }
        self.work();
    }

    /// Brings a motor to a position, in steps since power-up.
    fn turn(&mut self, axis: usize, steps: i64) {
        let made = steps - self.steps[axis];
        if made == 0 {
            return;
        }
        self.steps[axis] = steps;
        let Some(fitted) = self.config.axes[axis].as_ref().filter(|_| !self.stalled[axis]) else { return };
        // The wires' direction, and what the firmware makes of it.
        let inverted = (self.settings.get(3) as u32) & (1 << axis) != 0;
        self.turned[axis] += if inverted == fitted.motor_inverted { made } else { -made };
        self.plant.motor_moved(axis, self.turned[axis] as f64 / fitted.steps_per_mm);
    }
}
