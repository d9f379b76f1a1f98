//! One bench: drawn by its seed, and aligned by both strategies.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

use super::outcome::{Aligned, BenchOutcome, Ended, Taken};
use super::{MEASUREMENT_S, PLAIN_STEP_MM, SCALE_SIGMA, SIDE, ZERO_SIGMA_MM};
use crate::config::{AxisConfig, Config, ShellStep};
use crate::control::loops::air::{AirDecision, AirLoop, AirObservation};
use crate::control::loops::axis_model::AxisModel;
use crate::control::loops::calibrated::CalibratedCamera;
use crate::control::loops::room::{Contact, EAxis, Room};
use crate::control::loops::shell::{ShellDecision, ShellLoop, ShellObservation};
use crate::control::plan::Plan;
use crate::imaging::measurement::{FrameOptions, WhiteModel, measure_frame};
use crate::sim::renderer::{CameraTruth, Medium};
use crate::sim::scene::{Board, Scene};
use crate::sim::texture::TextureMap;
use crate::study::StudyError;
use crate::study::studio::Studio;

/// Moves after which a loop is given up.
const MOST_MOVES: u32 = 200;

/// One bench: its axes as they truly are, and its camera.
pub(super) struct Bench<'a> {
    studio: &'a Studio,
    config: &'a Config,
    texture: Arc<TextureMap>,
    whites: RefCell<Vec<(f64, WhiteModel)>>,
    focus: Axis<'a>,
    e: Axis<'a>,
    frames: Cell<u64>,
    /// The bench's own seed.
    seed: u64,
}

/// An axis: reading to true position.
struct Axis<'a> {
    config: &'a AxisConfig,
    scale: f64,
    zero: f64,
}

impl Axis<'_> {
    fn truth(&self, reading: f64) -> f64 {
        self.zero + self.scale * reading
    }

    /// Time of a move, s: up to speed, along, down again, and until it has settled.
    fn seconds(&self, travel: f64) -> f64 {
        let (speed, acceleration) = (self.config.speed_mm_per_s, self.config.acceleration_mm_per_s2);
        let travel = travel.abs();
        let moving = if travel < speed * speed / acceleration {
            2.0 * (travel / acceleration).sqrt()
        } else {
            travel / speed + speed / acceleration
        };
        moving + self.config.settle_ms as f64 / 1000.0
    }
}

impl<'a> Bench<'a> {
    /// The bench of a seed: its axes' scale and zero, and its noise.
    pub(super) fn draw(studio: &'a Studio, config: &'a Config, texture: Arc<TextureMap>, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0x100b5);
        let mut axis = |config| {
            let scale = Normal::new(1.0, SCALE_SIGMA).map_or(1.0, |law| law.sample(&mut random));
            let zero = Normal::new(0.0, ZERO_SIGMA_MM).map_or(0.0, |law| law.sample(&mut random));
            Axis { config, scale, zero }
        };
        let (focus, e) = (axis(&config.bench.focus), axis(&config.bench.e));
        let frames = Cell::new(random.random_range(0..1 << 32));
        Self { studio, config, texture, whites: RefCell::default(), focus, e, frames, seed }
    }

    /// Aligns it by both strategies, one after the other.
    pub(super) fn align(&self) -> Result<BenchOutcome, StudyError> {
        Ok(BenchOutcome { plain: ended(self.plain())?, ours: ended(self.ours())? })
    }

    /// Measures the spacing of a board: with its standard uncertainty, px.
    fn spacing(&self, delta_v: f64, medium: Medium, distance: f64) -> Result<(f64, f64), StudyError> {
        let studio = self.studio;
        let camera = CameraTruth::from_design(&studio.design, delta_v, medium, studio.pixel, SIDE, SIDE);
        let white = self.white(&camera, delta_v)?;
        let board = Scene::Board(Board::new(distance, Arc::clone(&self.texture)));
        self.frames.set(self.frames.get() + 1);
        let raw = studio.expose(&camera, &board, self.frames.get());
        let options = FrameOptions { white_at_this_setting: false, ..studio.frame_options() };
        let seen = measure_frame(&raw, Some(&white), &options).map_err(|error| {
            StudyError::unseen(format!("a frame of the loops, bench {}, Δv {delta_v:.3} mm", self.seed), error)
        })?;
        Ok((seen.spacing.on_axis_px, seen.spacing.sigma_px))
    }

    /// The white frame of the bench: a new one wherever Δv is half a millimetre from those there are.
    fn white(&self, camera: &CameraTruth, delta_v: f64) -> Result<WhiteModel, StudyError> {
        const APART_MM: f64 = 0.5;
        let kept = self.whites.borrow().iter().find(|(at, _)| (at - delta_v).abs() < APART_MM).map(|(_, w)| w.clone());
        if let Some(white) = kept {
            return Ok(white);
        }
        let white = self.studio.white(camera)?;
        self.whites.borrow_mut().push((delta_v, white.clone()));
        Ok(white)
    }

    /// Δv as the board in air at the target's equivalent distance shows it, and its standard uncertainty, mm.
    fn delta_v(&self, reading: f64) -> Result<(f64, f64), StudyError> {
        let design = &self.studio.design;
        let distance = design.joint(self.config.assembly.l_bound_mm).equivalent_distance;
        let (spacing, sigma) = self.spacing(self.focus.truth(reading), Medium::Air, distance)?;
        let found = |spacing: f64| design.delta_v_from_spacing(spacing * self.studio.pixel, distance);
        Ok((found(spacing), (found(spacing + sigma) - found(spacing)).abs()))
    }

    fn in_water(&self, focus: f64, e: f64) -> Result<(f64, f64), StudyError> {
        let design = &self.studio.design;
        let medium = Medium::Water { shell: design.shell, e: self.e.truth(e), decentre: [0.0; 2] };
        self.spacing(self.focus.truth(focus), medium, design.object_distance)
    }

    /// The plain strategy: steps of one size until the goal is passed, then back by half of that.
    fn plain(&self) -> Result<Aligned, StudyError> {
        let design = &self.studio.design;
        let assembly = &self.config.assembly;
        let joint = design.joint(assembly.l_bound_mm);
        let (focus, air) = self.steps(
            &self.focus,
            0.0,
            PLAIN_STEP_MM[0],
            |reading| Ok(self.delta_v(reading)?.0 - joint.delta_v),
            self.config.tolerances().delta_v_mm,
        )?;
        let target = design.mla.target_spacing() / self.studio.pixel;
        // |l − l_target| that e's tolerance allows.
        let slope = design.spacing_per_equivalent(joint.equivalent_distance, joint.delta_v) / self.studio.pixel;
        let (e, shell) = self.steps(
            &self.e,
            assembly.initial_e_mm,
            PLAIN_STEP_MM[1],
            |reading| Ok((target - self.in_water(focus, reading)?.0) / slope.abs()),
            self.config.tolerances().e_mm,
        )?;
        let delta_v_error_mm = self.focus.truth(focus) - joint.delta_v;
        let spacing_error_px = self.true_spacing(focus, e) - target;
        Ok(Aligned { air, shell, delta_v_error_mm, spacing_error_px })
    }

    /// Steps an axis until the miss is within the tolerance; the miss is negative where the axis has to rise.
    fn steps(
        &self,
        axis: &Axis<'_>,
        start: f64,
        first_step: f64,
        miss: impl Fn(f64) -> Result<f64, StudyError>,
        tolerance: f64,
    ) -> Result<(f64, Taken), StudyError> {
        let mut taken = Taken { least_e_mm: axis.truth(start), ..Taken::default() };
        let (mut reading, mut step) = (start, first_step);
        let mut here = miss(reading)?;
        taken.seconds += MEASUREMENT_S;
        while here.abs() >= tolerance && taken.moves < MOST_MOVES {
            let to = reading - here.signum() * step;
            taken.moves += 1;
            taken.travel_mm += step;
            taken.seconds += axis.seconds(step) + MEASUREMENT_S;
            reading = to;
            taken.least_e_mm = taken.least_e_mm.min(axis.truth(reading));
            let next = miss(reading)?;
            if next.signum() != here.signum() {
                step *= 0.5;
            }
            here = next;
        }
        taken.converged = here.abs() < tolerance;
        Ok((reading, taken))
    }

    /// This program's loops, as the daemon runs them.
    fn ours(&self) -> Result<Aligned, StudyError> {
        let design = &self.studio.design;
        let (assembly, pixel) = (&self.config.assembly, self.studio.pixel);
        let joint = design.joint(assembly.l_bound_mm);
        let plan = Plan::new(self.config, joint, assembly.l_bound_mm, assembly.initial_e_mm);
        let mut air_loop = AirLoop::new(plan.air_goal());
        let (mut focus, mut air) = (0.0, Taken::default());
        while air.moves < MOST_MOVES {
            let (delta_v_mm, sigma_mm) = self.delta_v(focus)?;
            air.seconds += MEASUREMENT_S;
            let seen = AirObservation { reading_mm: focus, delta_v_mm, sigma_mm, repeatability_mm: None };
            match air_loop.next(seen) {
                AirDecision::Probe { to_mm } | AirDecision::Move { to_mm } => {
                    air.moves += 1;
                    air.travel_mm += (to_mm - focus).abs();
                    air.seconds += self.focus.seconds(to_mm - focus);
                    focus = to_mm;
                }
                AirDecision::MoreFrames | AirDecision::Verify => {}
                AirDecision::Done => {
                    air.converged = true;
                    break;
                }
                AirDecision::TooUncertain { .. } | AirDecision::NotConverged { .. } | AirDecision::Fault(_) => break,
            }
        }
        let delta_v_error_mm = self.focus.truth(focus) - joint.delta_v;

        let (found, sigma) = air_loop.here().map_or((joint.delta_v, 0.01), |here| (here.delta_v_mm, here.sigma_mm));
        let camera = CalibratedCamera {
            design: *design,
            lens_to_mla_mm: design.lens_to_mla(found),
            mla_to_sensor_mm: design.mla.b(),
            image_distance_sigma_mm: sigma,
            pixel_mm: pixel,
            window_px: None,
            aberrations_sigma: self.config.uncertainty.shell_aberrations,
        };
        let target = design.mla.target_spacing() / pixel;
        let mut shell_loop = ShellLoop::new(plan.shell_goal(target, ShellStep::TranslateEThenTrim), camera);
        // Nothing but the axes is off, and those the loop learns by itself.
        let home_mm = self.config.bench.e.home_position_mm;
        let contact = Contact { e_mm: assembly.contact_mm(), measured_sigma_mm: None };
        let room = Room { contact, e: EAxis::alone(AxisModel::new(home_mm, home_mm, 0.0, 0.0)) };
        let mut e = plan.mount_e_mm;
        let mut shell = Taken { least_e_mm: self.e.truth(e), ..Taken::default() };
        let mut trim = 0.0;
        let scale = air_loop.model().map_or(1.0, |model| model.scale().0);
        while shell.moves < MOST_MOVES {
            let (spacing_px, sigma_px) = self.in_water(focus + trim / scale, e)?;
            shell.seconds += MEASUREMENT_S;
            let seen =
                ShellObservation { e_reading_mm: e, trim_mm: trim, spacing_px, sigma_px, sigma_random_px: sigma_px };
            match shell_loop.next(seen, |_| Some(room)) {
                ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => {
                    shell.moves += 1;
                    shell.travel_mm += (to_mm - e).abs();
                    shell.seconds += self.e.seconds(to_mm - e);
                    e = to_mm;
                    shell.least_e_mm = shell.least_e_mm.min(self.e.truth(e));
                }
                ShellDecision::Trim { by_mm, .. } => {
                    shell.moves += 1;
                    shell.travel_mm += by_mm.abs();
                    shell.seconds += self.focus.seconds(by_mm);
                    trim += by_mm;
                }
                ShellDecision::MoreFrames | ShellDecision::Verify => {}
                ShellDecision::Done => {
                    shell.converged = true;
                    break;
                }
                ShellDecision::NotConverged { .. } | ShellDecision::Fault(_) => break,
            }
        }
        let spacing_error_px = self.true_spacing(focus + trim / scale, e) - target;
        Ok(Aligned { air, shell, delta_v_error_mm, spacing_error_px })
    }

    /// The paraxial spacing that the bench truly has in water, px.
    fn true_spacing(&self, focus: f64, e: f64) -> f64 {
        let design = &self.studio.design;
        let equivalent = design.shell.equivalent_distance(design.object_distance, self.e.truth(e));
        design.spacing_at(equivalent, self.focus.truth(focus)) / self.studio.pixel
    }
}

/// A strategy's end: a refused frame is one.
fn ended(aligned: Result<Aligned, StudyError>) -> Result<Ended, StudyError> {
    match aligned {
        Ok(aligned) => Ok(Ended::Aligned(aligned)),
        Err(StudyError::Unseen { what, why }) => Ok(Ended::Refused(format!("{what}: {why}"))),
        Err(other) => Err(other),
    }
}
