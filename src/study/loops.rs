//! The loops: the plain strategy of Section 2.2 (fixed steps, the other way after an overshoot) against this program's,
//! on benches whose axes have their own scale and zero, with the same estimator on frames rendered by exact rays.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::studio::Studio;
use super::{Desk, StudyError};
use crate::config::{AxisConfig, Config, ShellStep, Texture};
use crate::control::air::{AirDecision, AirGoal, AirLoop, AirObservation};
use crate::control::calibrated::CalibratedCamera;
use crate::control::shell::{ShellDecision, ShellGoal, ShellLoop, ShellObservation};
use crate::imaging::measurement::{FrameOptions, WhiteModel, measure_frame};
use crate::sim::renderer::{CameraTruth, Medium};
use crate::sim::scene::{Board, Scene, texel_for};
use crate::sim::texture::TextureMap;

/// Side of the frames, px.
const SIDE: usize = 300;
/// First steps of the plain strategy, mm; every overshoot halves them.
const PLAIN_STEP_MM: [f64; 2] = [0.2, 2.0];
/// Moves after which a loop is given up.
const MOST_MOVES: u32 = 200;
/// Time to take and measure a frame, s.
const MEASUREMENT_S: f64 = 0.25;
/// Standard deviation of the axes' scale and zero about what is configured.
const SCALE_SIGMA: f64 = 0.01;
const ZERO_SIGMA_MM: f64 = 0.1;

/// What a loop took.
#[derive(Debug, Clone, Copy, Default)]
struct Taken {
    moves: u32,
    travel_mm: f64,
    seconds: f64,
    /// Least e on the way, mm.
    least_e_mm: f64,
    /// Final error: Δv (mm), or the spacing's (px).
    error: f64,
    converged: bool,
}

/// What both strategies came to on a bench, the plain one first.
struct Run {
    /// What each loop took; or why a frame of it was refused, which ends it, as it ends a job.
    strategies: [Result<[Taken; 2], String>; 2],
}

/// A strategy's end: a refused frame is one.
fn ended(taken: Result<[Taken; 2], StudyError>) -> Result<Result<[Taken; 2], String>, StudyError> {
    match taken {
        Ok(taken) => Ok(Ok(taken)),
        Err(StudyError::Unseen { what, why }) => Ok(Err(format!("{what}: {why}"))),
        Err(other) => Err(other),
    }
}

/// One bench: its axes as they truly are, and its camera.
struct Bench<'a> {
    studio: &'a Studio,
    config: &'a Config,
    texture: Arc<TextureMap>,
    whites: std::cell::RefCell<Vec<(f64, WhiteModel)>>,
    focus: Axis<'a>,
    e: Axis<'a>,
    frames: std::cell::Cell<u64>,
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

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let studio = Studio { design, pixel, side: SIDE, rays: 8, noise: 2.0, seed: desk.options.seed };
    let seeds: u64 = if desk.options.quick { 4 } else { 100 };
    let joint = design.joint(config.assembly.l_bound_mm);
    let medium = Medium::Water { shell: design.shell, e: joint.e, decentre: [0.0; 2] };
    let texture = |seed: u64| {
        Arc::new(TextureMap::generate(
            Texture::Natural,
            texel_for(&design, medium, design.object_distance, pixel),
            seed,
        ))
    };
    let finished = std::sync::atomic::AtomicU64::new(0);
    let runs = (0..seeds)
        .into_par_iter()
        .map(|seed| {
            let seed = desk.options.seed.wrapping_add(seed);
            let mut random = Pcg64::seed_from_u64(seed ^ 0x100b5);
            let mut axis = |config| {
                let scale = Normal::new(1.0, SCALE_SIGMA).map_or(1.0, |law| law.sample(&mut random));
                let zero = Normal::new(0.0, ZERO_SIGMA_MM).map_or(0.0, |law| law.sample(&mut random));
                Axis { config, scale, zero }
            };
            let (focus, e) = (axis(&config.bench.focus), axis(&config.bench.e));
            let bench = Bench {
                studio: &studio,
                config,
                texture: texture(seed),
                whites: std::cell::RefCell::default(),
                focus,
                e,
                frames: std::cell::Cell::new(random.random_range(0..1 << 32)),
                seed,
            };
            let run = Run { strategies: [ended(bench.plain())?, ended(bench.ours())?] };
            let done = finished.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            desk.watch.done(done, seeds);
            Ok(run)
        })
        .collect::<Result<Vec<Run>, StudyError>>()?;
    Ok(chapter(config, &runs, design.mla.target_spacing() / pixel))
}

impl Bench<'_> {
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
    fn plain(&self) -> Result<[Taken; 2], StudyError> {
        let design = &self.studio.design;
        let assembly = &self.config.assembly;
        let joint = design.joint(assembly.l_bound_mm);
        let (focus, air) = self.steps(
            &self.focus,
            0.0,
            PLAIN_STEP_MM[0],
            |reading| Ok(self.delta_v(reading)?.0 - joint.delta_v),
            assembly.delta_v_tolerance_mm,
        )?;
        let target = design.mla.target_spacing() / self.studio.pixel;
        // |l − l_target| that e's tolerance allows.
        let slope = design.spacing_per_equivalent(joint.equivalent_distance, joint.delta_v) / self.studio.pixel;
        let (e, shell) = self.steps(
            &self.e,
            assembly.initial_e_mm,
            PLAIN_STEP_MM[1],
            |reading| Ok((target - self.in_water(focus, reading)?.0) / slope.abs()),
            assembly.e_tolerance_mm,
        )?;
        let air = Taken { error: self.focus.truth(focus) - joint.delta_v, ..air };
        let error = self.true_spacing(focus, e) - target;
        Ok([air, Taken { error, ..shell }])
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
    fn ours(&self) -> Result<[Taken; 2], StudyError> {
        let design = &self.studio.design;
        let (assembly, pixel) = (&self.config.assembly, self.studio.pixel);
        let joint = design.joint(assembly.l_bound_mm);
        let axis = self.focus.config;
        let mut air_loop = AirLoop::new(AirGoal {
            delta_v_mm: joint.delta_v,
            tolerance_mm: assembly.delta_v_tolerance_mm,
            low_limit_mm: axis.low_limit_mm,
            high_limit_mm: axis.high_limit_mm,
            scale_sigma: axis.scale_uncertainty,
            zero_sigma_mm: axis.zero_uncertainty_mm,
            backlash_mm: axis.backlash_mm,
            systematic_sigma_mm: 0.0,
        });
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
                AirDecision::NotConverged { .. } | AirDecision::Fault(_) => break,
            }
        }
        air.error = self.focus.truth(focus) - joint.delta_v;

        let (found, sigma) = air_loop.here().map_or((joint.delta_v, 0.01), |here| (here.delta_v_mm, here.sigma_mm));
        let camera = CalibratedCamera {
            design: *design,
            lens_to_mla_mm: design.lens_to_mla(found),
            mla_to_sensor_mm: design.mla.b(),
            image_distance_sigma_mm: sigma,
            pixel_mm: pixel,
            window_px: None,
        };
        let axis = self.e.config;
        let target = design.mla.target_spacing() / pixel;
        let mut shell_loop = ShellLoop::new(
            ShellGoal {
                e_mm: joint.e,
                wall_mm: assembly.l_bound_mm - assembly.e_tolerance_mm,
                tolerance_mm: assembly.e_tolerance_mm,
                spacing_px: target,
                step: ShellStep::TranslateEThenTrim,
                high_limit_mm: axis.high_limit_mm,
                scale_sigma: axis.scale_uncertainty,
                zero_sigma_mm: axis.zero_uncertainty_mm,
                backlash_mm: axis.backlash_mm,
                home_mm: axis.home_position_mm,
            },
            camera,
        );
        let mut e = assembly.initial_e_mm;
        let mut shell = Taken { least_e_mm: self.e.truth(e), ..Taken::default() };
        let mut trim = 0.0;
        let scale = air_loop.model().map_or(1.0, |model| model.scale().0);
        while shell.moves < MOST_MOVES {
            let (spacing_px, sigma_px) = self.in_water(focus + trim / scale, e)?;
            shell.seconds += MEASUREMENT_S;
            match shell_loop.next(ShellObservation { e_reading_mm: e, trim_mm: trim, spacing_px, sigma_px }) {
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
        shell.error = self.true_spacing(focus + trim / scale, e) - target;
        Ok([air, shell])
    }

    /// The paraxial spacing that the bench truly has in water, px.
    fn true_spacing(&self, focus: f64, e: f64) -> f64 {
        let design = &self.studio.design;
        let equivalent = design.shell.equivalent_distance(design.object_distance, self.e.truth(e));
        design.spacing_at(equivalent, self.focus.truth(focus)) / self.studio.pixel
    }
}

/// The benches, by number, whose frames could all be measured, and what a strategy took there.
fn ended_well(runs: &[Run], strategy: usize) -> impl Iterator<Item = (usize, [Taken; 2])> {
    runs.iter().enumerate().filter_map(move |(k, run)| run.strategies[strategy].as_ref().ok().map(|taken| (k, *taken)))
}

fn chapter(config: &Config, runs: &[Run], target_px: f64) -> Chapter {
    let mut chapter = Chapter::default();
    let joint = config.design().joint(config.assembly.l_bound_mm);
    let tolerance = config.assembly.delta_v_tolerance_mm;
    chapter.text.push(format!(
        "{} benches of their own axes (scale ±{:.0} %, zero ±{ZERO_SIGMA_MM} mm, one standard deviation), each aligned by \
         both strategies with the same estimator on {SIDE}×{SIDE} px frames. The paper's strategy reads: adjust further \
         while Δv_1 is too small, in the opposite direction when it is too great, until within the tolerance. With steps \
         of one size that ends for certain only if a step is at most twice the tolerance, {:.0} moves for Δv = {:.3} mm at \
         ±{tolerance} mm; here it starts with steps of {} mm (Δv) and {} mm (e), and halves them at every overshoot.",
        runs.len(),
        100.0 * SCALE_SIGMA,
        joint.delta_v / (2.0 * tolerance),
        joint.delta_v,
        PLAIN_STEP_MM[0],
        PLAIN_STEP_MM[1],
    ));
    chapter.text.push(format!(
        "Time is simulated: moves by the configured speeds and accelerations, settling, and {MEASUREMENT_S} s for a frame \
         and its measurement."
    ));
    let mut table = Table::new(
        "loops",
        "Median and greatest over the benches",
        &["loop", "strategy", "moves", "travel, mm", "time, s", "error left, rms", "converged", "past the wall"],
    );
    let wall = config.assembly.l_bound_mm - config.assembly.e_tolerance_mm;
    let mut past = [0usize; 2];
    let mut medians = [[0.0; 2]; 2];
    let names = ["plain", "this program's"];
    for (stage, (name, unit)) in [("Δv in air", "µm"), ("e with the shell", "px")].into_iter().enumerate() {
        for (strategy, label) in names.into_iter().enumerate() {
            let taken: Vec<Taken> = ended_well(runs, strategy).map(|(_, taken)| taken[stage]).collect();
            if taken.is_empty() {
                continue;
            }
            let figures = |value: &dyn Fn(&Taken) -> f64, digits: usize| {
                let mut values: Vec<f64> = taken.iter().map(value).collect();
                values.sort_unstable_by(f64::total_cmp);
                let (median, most) = (values[values.len() / 2], values[values.len() - 1]);
                (format!("{median:.digits$} ({most:.digits$})"), median)
            };
            let square = taken.iter().map(|t| t.error * t.error).sum::<f64>() / taken.len() as f64;
            let error = if stage == 0 { 1000.0 * square.sqrt() } else { square.sqrt() };
            let converged = taken.iter().filter(|t| t.converged).count();
            if stage == 1 {
                past[strategy] = taken.iter().filter(|t| t.least_e_mm < wall).count();
            }
            let (moves, median) = figures(&|t| f64::from(t.moves), 0);
            medians[stage][strategy] = median;
            table.push([
                name.to_owned(),
                label.to_owned(),
                moves,
                figures(&|t| t.travel_mm, 2).0,
                figures(&|t| t.seconds, 1).0,
                format!("{error:.3} {unit}"),
                format!("{converged} of {}", runs.len()),
                if stage == 1 { format!("{} of {}", past[strategy], taken.len()) } else { "–".to_owned() },
            ]);
        }
    }
    chapter.tables.push(table);
    chapter.findings.push(Finding::new(
        "moves, Δv and e together (median)",
        format!(
            "{:.0} by the plain strategy, {:.0} by this program's",
            medians[0][0] + medians[1][0],
            medians[0][1] + medians[1][1]
        ),
        "this program's loops know the slope of spacing against travel and learn the axis's scale from the picture",
    ));
    chapter.findings.push(Finding::new(
        format!("benches on which the lens was taken past the wall at e = {wall:.2} mm"),
        format!("{} by the plain strategy, {} by this program's, of {}", past[0], past[1], runs.len()),
        "to see an overshoot the plain strategy has to make one, and behind l_bound is the shell; what this program goes \
         beyond by is its axis's scale and zero error, which the wall has to include",
    ));
    for (stage, (name, title, y)) in [
        ("delta_v", "Error left in Δv", "Δv − target, µm"),
        ("spacing", "Error left in the spacing", "spacing − target, px"),
    ]
    .into_iter()
    .enumerate()
    {
        let scale = if stage == 0 { 1000.0 } else { 1.0 };
        let curves = names
            .into_iter()
            .enumerate()
            .map(|(strategy, label)| {
                let points =
                    ended_well(runs, strategy).map(|(k, taken)| [k as f64, scale * taken[stage].error]).collect();
                Curve::marks(label, points)
            })
            .collect();
        chapter.charts.push(Chart {
            name: name.to_owned(),
            title: format!("{title}, bench by bench"),
            x: "bench".to_owned(),
            y: y.to_owned(),
            curves,
        });
    }
    for (strategy, name) in names.into_iter().enumerate() {
        let refused: Vec<&str> =
            runs.iter().filter_map(|run| run.strategies[strategy].as_ref().err()).map(String::as_str).collect();
        if let Some(first) = refused.first() {
            chapter.text.push(format!(
                "On {} of the benches a frame of the {name} loops was refused, which ended them, as it ends a job; they \
                 count as not converged, and are in no other figure. The first: {first}.",
                refused.len()
            ));
        }
    }
    chapter.text.push(format!("The target of the spacing is {target_px:.3} px (Eq. 16)."));
    chapter
}
