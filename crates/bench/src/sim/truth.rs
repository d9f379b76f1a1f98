//! The simulated truth that all twins share: where the carriages really are, what stands before the camera, and the
//! optics as they are rather than as they are configured.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::json;
use tokio::sync::watch;
use tokio::time::Instant;

use super::plant::Plant;
use super::stage::PULL_OFF_MM;
use crate::config::{AxisConfig, Config, Side};
use crate::device::faults::{AxisFaults, Faults};
use crate::device::{AxisName, Setup};
use plenoptics::optics::{CameraDesign, MainLens};

/// What stands before the lens, and what is around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Surroundings {
    /// A diffuser on the lens.
    Diffuser,
    /// In air: a flat board at the distance that the camera was focused on before it was made ready for water.
    AirBoard {
        /// True e when it was put up, mm: the board stands still while the camera moves.
        placed_at_e_mm: f64,
    },
    /// In air: three boards side by side; distances from M at the pose where they were put up, mm.
    AirTripleBoard {
        /// Nearest, middle, farthest.
        distances_mm: [f64; 3],
        /// True e at that moment, mm: the boards stand still while the camera moves.
        placed_at_e_mm: f64,
    },
    /// Shell on, in water: a flat board at this distance from O, mm.
    WaterBoard {
        /// Distance in water, mm.
        distance_mm: f64,
    },
}

/// One axis's mechanics: screw, play, friction and the way the carriage really goes.
#[derive(Debug, Clone)]
struct Carriage {
    /// True travel over the firmware's count.
    scale: f64,
    /// Lost motion on reversal, mm.
    backlash: f64,
    /// A pull shorter than this does not move the carriage, mm.
    friction: f64,
    /// Whether the coordinate runs against the screw, mirrored about home.
    flipped: bool,
    /// Position in screw direction, as if not flipped, mm.
    position: f64,
    /// The nut's push position: carriage position at which the screw's present turn would push it up.
    screw: f64,
    /// The firmware's count at the last call, mm.
    count: f64,
    /// Which way it went last, by its sign.
    way: f64,
    /// Play that has been worn into it, mm.
    worn: f64,
    /// True coordinate after a perfect homing, mm.
    home: f64,
    /// The end where the switch is.
    home_side: Side,
    /// Where the switch closes, in screw direction, mm.
    switch: f64,
    /// Where the far hard stop is, in screw direction, mm.
    far_stop: f64,
    /// Whether the firmware's positive direction is the coordinate's negative one.
    reversed: bool,
}

impl Carriage {
    fn new(axis: &AxisConfig, error: &AxisError, start: f64) -> Self {
        let home = axis.home_position_mm + error.zero_offset_mm;
        let sign = axis.home_side.sign();
        let scale = 1.0 + error.scale;
        let far = match axis.home_side {
            Side::Low => axis.high_limit_mm + 1.0,
            Side::High => axis.low_limit_mm - 1.0,
        };
        Self {
            scale,
            backlash: error.backlash_mm,
            friction: error.friction_mm,
            flipped: error.flipped,
            position: start,
            screw: start,
            count: 0.0,
            way: 0.0,
            worn: 0.0,
            home,
            home_side: axis.home_side,
            // The reversal after the switch loses the play, which the switch's place makes up for.
            switch: home + sign * (PULL_OFF_MM * scale - error.backlash_mm),
            far_stop: far,
            reversed: axis.reversed,
        }
    }

    fn coordinate(&self) -> f64 {
        if self.flipped { 2.0 * self.home - self.position } else { self.position }
    }

    fn turn_to(&mut self, count: f64, faults: &AxisFaults) {
        let direction = if self.reversed { -1.0 } else { 1.0 };
        self.wear(count - self.count, faults.backlash_growth_mm);
        self.screw += direction * (count - self.count) * self.scale * (1.0 - faults.slip_share);
        self.count = count;
        // The nut has this much play below the screw's push position.
        let backlash = self.backlash + faults.backlash_mm + self.worn;
        let pulled = self.position.clamp(self.screw - backlash, self.screw);
        if (pulled - self.position).abs() >= self.friction {
            self.position = pulled;
        }
    }

    /// Lets the play grow at a reversal; it is as good as new where it does not grow.
    fn wear(&mut self, travel: f64, growth: f64) {
        if growth == 0.0 {
            self.worn = 0.0;
        } else if travel * self.way < 0.0 {
            self.worn += growth;
        }
        if travel != 0.0 {
            self.way = travel.signum();
        }
    }

    fn at_switch(&self) -> bool {
        match self.home_side {
            Side::Low => self.position <= self.switch,
            Side::High => self.position >= self.switch,
        }
    }

    fn at_far_stop(&self) -> bool {
        match self.home_side {
            Side::Low => self.position >= self.far_stop,
            Side::High => self.position <= self.far_stop,
        }
    }

    fn place(&mut self, coordinate: f64) {
        self.position = if self.flipped { 2.0 * self.home - coordinate } else { coordinate };
        self.screw = self.position;
    }
}

struct AxisError {
    scale: f64,
    backlash_mm: f64,
    friction_mm: f64,
    flipped: bool,
    zero_offset_mm: f64,
}

/// The state of the simulated world.
#[derive(Debug)]
struct World {
    focus: Carriage,
    e: Carriage,
    surroundings: Surroundings,
    shell_on: bool,
    aperture_mm: f64,
    least_e_with_shell_mm: f64,
    touched_shell: bool,
    /// How often a flat board was put up in air.
    flat_boards: usize,
    /// Turns of the motors that the carriages have yet to follow: when, which axis, the firmware's count, mm.
    creeping: VecDeque<(Instant, AxisName, f64)>,
}

/// A moment of the simulated world, for a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// True Δv: the focus axis's true coordinate, mm.
    pub delta_v_mm: f64,
    /// True d, mm.
    pub lens_to_mla_mm: f64,
    /// True e, mm.
    pub e_mm: f64,
    /// What stands before the lens.
    pub surroundings: Surroundings,
    /// Whether the shell is mounted.
    pub shell_on: bool,
    /// Aperture diameter, mm.
    pub aperture_mm: f64,
}

/// The shared truth of one simulated bench.
#[derive(Debug)]
pub struct Truth {
    design: CameraDesign,
    config: Arc<Config>,
    world: Mutex<World>,
    faults: watch::Sender<Faults>,
}

impl Truth {
    /// A bench as it is found: shell off, axes somewhere along their travel, the aperture at the air design's.
    #[must_use]
    pub fn new(config: &Arc<Config>) -> Arc<Self> {
        let simulation = &config.bench.simulation;
        let mut random = Pcg64::seed_from_u64(simulation.seed);
        let focus = &config.bench.focus;
        let e = &config.bench.e;
        let design = config.design();
        let focus_start = focus.home_position_mm + random.random_range(0.2..1.2);
        let e_start = e.home_position_mm - random.random_range(1.0..5.0);
        let focus_error = AxisError {
            scale: simulation.focus_scale_error,
            backlash_mm: simulation.focus_backlash_mm,
            friction_mm: simulation.friction_step_mm,
            flipped: simulation.focus_sign_flip,
            zero_offset_mm: 0.0,
        };
        let e_error = AxisError {
            scale: simulation.e_scale_error,
            backlash_mm: simulation.e_backlash_mm,
            friction_mm: simulation.friction_step_mm,
            flipped: simulation.e_sign_flip,
            zero_offset_mm: simulation.e_zero_offset_mm,
        };
        Arc::new(Self {
            design,
            config: Arc::clone(config),
            world: Mutex::new(World {
                focus: Carriage::new(focus, &focus_error, focus_start),
                e: Carriage::new(e, &e_error, e_start),
                surroundings: Surroundings::AirBoard { placed_at_e_mm: e_start },
                shell_on: false,
                aperture_mm: design.aperture(0.0),
                least_e_with_shell_mm: f64::INFINITY,
                touched_shell: false,
                flat_boards: 0,
                creeping: VecDeque::new(),
            }),
            faults: watch::Sender::default(),
        })
    }

    /// What goes wrong, now and from now on.
    #[must_use]
    pub fn faults(&self) -> watch::Receiver<Faults> {
        self.faults.subscribe()
    }

    /// Makes that go wrong, and nothing else, as far as it is the world's and the camera's.
    pub fn set_faults(&self, faults: Faults) {
        self.faults.send_replace(faults);
    }

    /// The configuration that the bench was made from.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The pose at this moment.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let world = self.world();
        let delta_v_mm = world.focus.coordinate();
        Pose {
            delta_v_mm,
            lens_to_mla_mm: self.design.air_lens_to_mla()
                + self.config.bench.simulation.lens_to_mla_error_mm
                + delta_v_mm,
            e_mm: world.e.coordinate(),
            surroundings: world.surroundings,
            shell_on: world.shell_on,
            aperture_mm: world.aperture_mm,
        }
    }

    /// The true image distance of what stands before the lens, less a, less the true d, mm: zero when it is in focus.
    /// `None` where nothing stands there that could be.
    fn focus_error_mm(&self, pose: &Pose) -> Option<f64> {
        let lens = MainLens {
            focal_length: self.design.main_lens.focal_length * (1.0 + self.config.bench.simulation.focal_length_error),
        };
        let equivalent = match pose.surroundings {
            Surroundings::AirTripleBoard { distances_mm, placed_at_e_mm } => {
                distances_mm[1] + pose.e_mm - placed_at_e_mm
            }
            Surroundings::WaterBoard { distance_mm } => self.design.shell.equivalent_distance(distance_mm, pose.e_mm),
            Surroundings::AirBoard { placed_at_e_mm } => {
                self.config.object.air_distance_mm + pose.e_mm - placed_at_e_mm
            }
            Surroundings::Diffuser => return None,
        };
        Some(lens.image_distance(equivalent) - self.design.mla.a() - pose.lens_to_mla_mm)
    }

    /// The world as it is at this moment.
    fn world(&self) -> MutexGuard<'_, World> {
        let mut world = self.world.lock().unwrap_or_else(PoisonError::into_inner);
        let (now, faults) = (Instant::now(), *self.faults.borrow());
        while let Some((_, axis, count)) = world.creeping.pop_front_if(|(due, ..)| *due <= now) {
            self.turn(&mut world, axis, count, &faults);
        }
        world
    }

    fn turn(&self, world: &mut World, axis: AxisName, count: f64, faults: &Faults) {
        world.carriage(axis).turn_to(count, faults.axis(axis));
        world.note_shell(self.config.bench.simulation.contact_e_mm);
    }
}

/// The bench's axis of a number on the simulated controller.
fn axis_of(index: usize) -> Option<AxisName> {
    AxisName::ALL.get(index).copied()
}

impl World {
    fn carriage(&mut self, axis: AxisName) -> &mut Carriage {
        match axis {
            AxisName::Focus => &mut self.focus,
            AxisName::E => &mut self.e,
        }
    }

    fn note_shell(&mut self, contact_e_mm: f64) {
        if !self.shell_on {
            return;
        }
        let e = self.e.coordinate();
        self.least_e_with_shell_mm = self.least_e_with_shell_mm.min(e);
        if e < contact_e_mm {
            // The shell holds the lens; the motor turns on against it. At the shell itself the lens is free to leave it.
            self.touched_shell = true;
            self.e.place(contact_e_mm);
        }
    }
}

impl Plant for Truth {
    fn motor_moved(&self, axis: usize, position_mm: f64) {
        let Some(axis) = axis_of(axis) else { return };
        let faults = *self.faults.borrow();
        let mut world = self.world();
        let late = Duration::from_millis(faults.axis(axis).stops_late_ms.into());
        if late.is_zero() && world.creeping.is_empty() {
            self.turn(&mut world, axis, position_mm, &faults);
        } else {
            // Never before what is still to come.
            let due = world.creeping.back().map_or_else(Instant::now, |(due, ..)| *due);
            world.creeping.push_back((due.max(Instant::now() + late), axis, position_mm));
        }
    }

    fn home_switch_closed(&self, axis: usize) -> bool {
        axis_of(axis).is_some_and(|axis| {
            let stuck = self.faults.borrow().axis(axis).limit_switch;
            stuck || self.world().carriage(axis).at_switch()
        })
    }

    fn limit_switch_closed(&self, axis: usize) -> bool {
        axis_of(axis).is_some_and(|axis| {
            let stuck = self.faults.borrow().axis(axis).limit_switch;
            let mut world = self.world();
            let carriage = world.carriage(axis);
            stuck || carriage.at_switch() || carriage.at_far_stop()
        })
    }
}

impl Truth {
    /// Carries out a set-up instruction at once.
    pub fn obey(&self, setup: &Setup) {
        let simulation = &self.config.bench.simulation;
        let error = simulation.board_placement_error_mm;
        let water_error = error + simulation.water_board_error_mm;
        let mut world = self.world();
        match *setup {
            Setup::Diffuser => world.surroundings = Surroundings::Diffuser,
            Setup::AirTripleBoard { distances_mm } => {
                world.shell_on = false;
                let placed_at_e_mm = world.e.coordinate();
                let [near, middle, far] = distances_mm;
                let flat = near == middle && middle == far;
                let put_up = world.flat_boards;
                world.flat_boards += usize::from(flat);
                let true_mm = |level: usize| {
                    // A flat board is in one piece, and stands somewhere else each time that it is put up.
                    let drawn = if flat { put_up % 3 } else { level };
                    distances_mm[level] + error + simulation.level_errors_mm[drawn]
                };
                world.surroundings =
                    Surroundings::AirTripleBoard { distances_mm: [0, 1, 2].map(true_mm), placed_at_e_mm };
            }
            Setup::WaterBoard { distance_mm } => {
                world.shell_on = true;
                world.surroundings = Surroundings::WaterBoard { distance_mm: distance_mm + water_error };
                world.note_shell(simulation.contact_e_mm);
            }
            Setup::LeastE { distance_mm } => {
                world.shell_on = true;
                // Pushed by hand until the barrel touches: no collision.
                world.e.place(simulation.contact_e_mm);
                world.surroundings = Surroundings::WaterBoard { distance_mm: distance_mm + water_error };
            }
            Setup::ShellOff => {
                world.shell_on = false;
                let placed_at_e_mm = world.e.coordinate();
                world.surroundings = Surroundings::AirBoard { placed_at_e_mm };
            }
            Setup::Aperture { diameter_mm, .. } => world.aperture_mm = diameter_mm,
        }
    }

    /// A carriage stands there, mm, by the word of whoever has moved it. The shell stops it as it stops one that is turned.
    pub fn carry(&self, axis: AxisName, coordinate_mm: f64) {
        let mut world = self.world();
        world.carriage(axis).place(coordinate_mm);
        world.note_shell(self.config.bench.simulation.contact_e_mm);
    }

    /// The truth as a JSON object, for reports.
    #[must_use]
    pub fn report(&self) -> serde_json::Value {
        let pose = self.pose();
        let world = self.world();
        json!({
            // What a report's Δv is compared with: the axis's zero and an error of d at it are two names of one thing.
            "delta_v_mm": pose.lens_to_mla_mm - self.design.air_lens_to_mla(),
            "lens_to_mla_mm": pose.lens_to_mla_mm,
            "focus_error_mm": self.focus_error_mm(&pose),
            "e_mm": pose.e_mm,
            "least_e_with_shell_mm": world.least_e_with_shell_mm.is_finite().then_some(world.least_e_with_shell_mm),
            "touched_shell": world.touched_shell,
            "aperture_mm": pose.aperture_mm,
            "shell_on": pose.shell_on,
        })
    }
}

#[cfg(test)]
mod tests;
