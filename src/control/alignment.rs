//! The joint alignment, from the first homing to the report: the order of steps, the operator's part, and what is kept
//! of each. Every decision of the loops is made in [`super::air`] and [`super::shell`].

use std::sync::Arc;
use std::time::Duration;

use super::air::{AirDecision, AirGoal, AirLoop, AirObservation, FREE_TRAVEL_MM, PROBE_MM};
use super::axis_model::check_move;
use super::calibrated::CalibratedCamera;
use super::context::{JobContext, JobEnd};
use super::events::ShellState;
use super::eye::{Eye, Seen};
use super::job::{IterationKind, Stage};
use super::mistake::ShellLook;
use super::motion::Motion;
use super::shell::{ShellDecision, ShellGoal, ShellLoop, ShellObservation};
use super::sight::HoldB;
use super::tasks::AirStep;
use crate::config::{Config, LBoundSource, ShellStep, Side, SpacingTarget};
use crate::device::{AxisName, Setup};
use crate::imaging::spacing::capture_range;
use crate::optics::{CameraDesign, Solution};
use crate::units::Millimetres;

/// Distance between the levels of the triple-level board, mm.
const LEVEL_STEP_MM: f64 = 8.0;
/// b is held at its configured value while Δv is further than this from its target, mm: the board then cannot tell it.
const HOLD_B_BEYOND_MM: f64 = 0.2;
/// Δv is this near to its target (mm, by the axis's reading) when the aperture is set for it.
const APERTURE_WITHIN_MM: f64 = 0.5;
/// Standard relative uncertainty of the configured b while it is held.
const B_RELATIVE_SIGMA: f64 = 0.002;
/// So far (mm) e may be moved with the shell off: the boards, which stay where they are, can then still be measured.
const FOLLOWED_IN_AIR_MM: f64 = 5.0;
/// Between two looks at whether the picture stands still: longer than an axis rests between two pieces of its way, so
/// that a carriage a second late is seen to move.
const CREEP_LOOK: Duration = Duration::from_millis(600);
/// How often it is looked again, and how many standard uncertainties of their difference two spacings of one place may be
/// apart.
const CREEP_LOOKS: u32 = 8;
const CREEP_SIGMAS: f64 = 4.0;
/// Frames combined in a verifying measurement.
pub(super) const VERIFY_FRAMES: u32 = 2;
/// Measurements of a loop before it is cut off, whatever its decisions.
const MAX_MEASUREMENTS: u32 = 60;
/// Steps of a joint alignment, for the progress bar.
pub(super) const STEPS: u32 = 22;

/// What an alignment has found so far: enough for a report at any moment.
#[derive(Debug, Clone, Default)]
pub(super) struct Findings {
    /// Solution aimed for.
    pub(super) solution: Option<Solution>,
    /// Δv at the end of the air step and its standard uncertainty, mm.
    pub(super) delta_v_air: Option<(f64, f64)>,
    /// Trim of Δv since, mm.
    pub(super) trim_mm: f64,
    /// Camera as calibrated.
    pub(super) camera: Option<CalibratedCamera>,
    /// e as the picture has it and its standard uncertainty, mm.
    pub(super) e: Option<(f64, f64)>,
    /// The last measurement.
    pub(super) seen: Option<Seen>,
    /// Moves in the air step.
    pub(super) moves_air: u32,
    /// Moves in the shell step.
    pub(super) moves_shell: u32,
    /// Scale of the focus axis.
    pub(super) focus_scale: Option<f64>,
    /// Scale of the e axis.
    pub(super) e_scale: Option<f64>,
    /// EOG of the central view before the first move with the shell, mean per pixel.
    pub(super) eog_before: Option<f64>,
    /// The same at the end.
    pub(super) eog_after: Option<f64>,
    /// Uncertainty of a measured l_bound, mm.
    pub(super) l_bound_sigma_mm: Option<f64>,
    /// What the shell step did, in words.
    pub(super) shell_step_done: Option<String>,
    /// What a reader should know.
    pub(super) notes: Vec<String>,
    /// The simulated truth at the end of the air step.
    pub(super) truth_air: Option<serde_json::Value>,
}

/// One joint alignment under way.
pub(super) struct Alignment<'a> {
    pub(super) context: &'a JobContext,
    pub(super) motion: &'a Motion,
    pub(super) eye: &'a Eye,
    pub(super) config: &'a Arc<Config>,
    pub(super) design: CameraDesign,
    pub(super) findings: Findings,
}

impl Alignment<'_> {
    /// The joint alignment.
    pub(super) async fn joint(&mut self) -> Result<(), JobEnd> {
        self.prepare().await?;
        self.withdraw_e().await?;
        if self.config.assembly.l_bound == LBoundSource::Measure {
            self.measure_l_bound().await?;
        }
        let solution = self.design.joint(self.motion.l_bound_mm());
        self.findings.solution = Some(solution);
        self.context.stage(Stage::Air);
        self.eye.aim_at(self.eye.paraxial_target_px());
        let levels = self.air(&solution).await?;
        self.park_e(&levels, self.config.assembly.initial_e_mm).await?;
        self.context.stage(Stage::Shell);
        self.shell(&solution, self.config.assembly.shell_step).await
    }

    pub(super) async fn prepare(&mut self) -> Result<(), JobEnd> {
        self.context.stage(Stage::Preparation);
        self.eye.check_camera()?;
        self.context.doing("devices and homing");
        for axis in AxisName::ALL {
            let state = self.context.unless_cancelled(self.motion.read_state(axis)).await?;
            for disagreement in self.motion.stage_info(axis).disagreements {
                self.context.log(format!("{axis} axis: {disagreement}"));
            }
            if !state.homed {
                self.context.log(format!("homing the {axis} axis"));
                self.context.unless_cancelled(self.motion.home(axis)).await?;
            }
            let state = self.context.unless_cancelled(self.motion.read_state(axis)).await?;
            self.context.log(format!("the {axis} axis stands at {:.3}", state.position));
        }
        self.white_frame().await
    }

    /// Takes e back from where an earlier alignment left it near the shell, by homing: that way is the same whatever the
    /// axis's coordinate is like, and makes its zero new. An axis that homes on the shell's side is left where it is.
    async fn withdraw_e(&mut self) -> Result<(), JobEnd> {
        let (at, initial) = (self.motion.position_mm(AxisName::E)?, self.config.assembly.initial_e_mm);
        if initial - at <= FOLLOWED_IN_AIR_MM || self.config.bench.e.home_side != Side::High {
            return Ok(());
        }
        self.context.log(format!(
            "the e axis stands {:.3} mm nearer to the shell than at the start: it is homed",
            initial - at
        ));
        self.context.unless_cancelled(self.motion.home(AxisName::E)).await?;
        Ok(())
    }

    pub(super) async fn white_frame(&mut self) -> Result<(), JobEnd> {
        let instruction = "Put the diffuser on the lens and light it evenly: a white frame is taken.".to_owned();
        self.context.ask("white_frame", instruction, None, Setup::Diffuser).await?;
        self.context.doing("white frame");
        let found = self.context.unless_cancelled(self.eye.take_white()).await?;
        self.context.log(found);
        Ok(())
    }

    /// "167.2 mm from the principal point", with what a ruler can touch where that is known.
    pub(super) fn board_place(&self, distances_mm: &[f64]) -> String {
        let list = |offset: f64| {
            let distances: Vec<String> = distances_mm.iter().map(|d| format!("{:.1}", d + offset)).collect();
            distances.join(", ")
        };
        match self.config.main_lens.principal_from_mount_mm {
            Some(offset) => format!(
                "{} mm from the lens's principal point, which is {} mm from the mount's face",
                list(0.0),
                list(offset)
            ),
            None => format!("{} mm from the lens's principal point", list(0.0)),
        }
    }

    pub(super) async fn place_triple_board(&mut self, middle_mm: f64) -> Result<[f64; 3], JobEnd> {
        let levels = [middle_mm - LEVEL_STEP_MM, middle_mm, middle_mm + LEVEL_STEP_MM];
        let instruction = format!(
            "Take the diffuser off. With the shell off, in air, put the triple-level board's levels at {}.",
            self.board_place(&levels)
        );
        let value = format!("{:.1}, {:.1}, {:.1} mm", levels[0], levels[1], levels[2]);
        let setup = Setup::AirTripleBoard { distances_mm: levels };
        self.context.ask("triple_board_in_air", instruction, Some(value), setup).await?;
        self.motion.set_shell(ShellState::Off);
        Ok(levels)
    }

    /// Puts the triple-level board where it is measured at a reading (mm) of the focus axis: where the solution has it,
    /// or, while that is out of the range of focus, left where it is or put where the lens is focused.
    async fn boards_in_range(
        &mut self,
        present: Option<[f64; 3]>,
        reading_mm: f64,
        solution: &Solution,
    ) -> Result<[f64; 3], JobEnd> {
        let measurable = |distance_mm: f64| {
            let relative = self.design.spacing_at(distance_mm, reading_mm) / self.design.mla.pitch;
            let [low, high] = capture_range(self.design.mla.mode);
            (low..=high).contains(&relative)
        };
        let place_mm = if measurable(solution.equivalent_distance) {
            solution.equivalent_distance
        } else if let Some(levels) = present.filter(|levels| measurable(levels[1])) {
            levels[1]
        } else {
            self.design.main_lens.object_distance(self.design.air_image_distance() + reading_mm)
        };
        match present.filter(|levels| levels[1] == place_mm) {
            Some(levels) => Ok(levels),
            None => self.place_triple_board(place_mm).await,
        }
    }

    /// σ(v) that the boards' distance from the principal plane is uncertain by, mm.
    fn board_sigma_mm(&self, distance_mm: f64) -> f64 {
        let magnification = self.design.main_lens.focal_length / (distance_mm - self.design.main_lens.focal_length);
        self.config.main_lens.principal_from_mount_sigma_mm.unwrap_or(0.0) * magnification * magnification
    }

    pub(super) async fn air(&mut self, solution: &Solution) -> Result<[f64; 3], JobEnd> {
        let axis = &self.config.bench.focus;
        let mut air = AirLoop::new(AirGoal {
            delta_v_mm: solution.delta_v,
            tolerance_mm: self.config.assembly.delta_v_tolerance_mm,
            low_limit_mm: axis.low_limit_mm,
            high_limit_mm: axis.high_limit_mm,
            scale_sigma: axis.scale_uncertainty,
            zero_sigma_mm: axis.zero_uncertainty_mm,
            backlash_mm: axis.backlash_mm,
            systematic_sigma_mm: self.board_sigma_mm(solution.equivalent_distance),
        });
        let (mut kind, mut predicted, mut frames) = (IterationKind::Start, None, 1);
        let (mut aperture_set, moves_before) = (false, self.findings.moves_air);
        let mut boards = None;
        for _ in 0..MAX_MEASUREMENTS {
            let reading_mm = self.motion.position_mm(AxisName::Focus)?;
            let levels = self.boards_in_range(boards, reading_mm, solution).await?;
            boards = Some(levels);
            let near = (reading_mm - solution.delta_v).abs() <= APERTURE_WITHIN_MM;
            if near && !aperture_set {
                // The micro-images shrink as d grows: with the new aperture they have the size of the white frame's.
                self.set_aperture(solution, &levels).await?;
                aperture_set = true;
            }
            self.context.doing(format!("air: measuring Δv ({})", kind.word()));
            let (observation, seen) = self.observe_air(&levels, solution, frames).await?;
            let decision = air.next(observation);
            let here = air.here().unwrap_or(observation);
            self.findings.moves_air = moves_before + air.moves();
            self.findings.delta_v_air = Some((here.delta_v_mm, here.sigma_mm));
            self.findings.focus_scale = air.model().map(|model| model.scale().0);
            let predicted_px =
                predicted.map(|delta_v| self.design.spacing_at(levels[1], delta_v) / self.eye.pixel_mm());
            self.record_air(kind, &seen, here, predicted_px, &decision);
            frames = 1;
            match decision {
                AirDecision::Probe { to_mm } | AirDecision::Move { to_mm } => {
                    kind = if matches!(decision, AirDecision::Probe { .. }) {
                        IterationKind::Probe
                    } else {
                        IterationKind::Move
                    };
                    predicted = air.model().map(|model| model.predict(to_mm).0);
                    self.context.doing(format!("air: focus axis to {to_mm:.4} mm"));
                    self.context.unless_cancelled(self.motion.go(AxisName::Focus, Millimetres(to_mm))).await?;
                }
                AirDecision::MoreFrames => (kind, predicted, frames) = (IterationKind::Verify, None, 2),
                AirDecision::Verify => (kind, predicted, frames) = (IterationKind::Verify, None, VERIFY_FRAMES),
                AirDecision::Done => {
                    self.findings.truth_air = self.context.truth();
                    if let Some(camera) = self.findings.camera {
                        let delta_v = (here.delta_v_mm, here.sigma_mm);
                        self.eye.keep_air_step(AirStep { camera, delta_v, focus_mm: reading_mm });
                    }
                    self.context.log(format!(
                        "air step done: Δv = {:.4} ± {:.4} mm, wanted {:.4} mm",
                        here.delta_v_mm, here.sigma_mm, solution.delta_v
                    ));
                    return Ok(levels);
                }
                AirDecision::NotConverged { why } => return Err(JobEnd::NotConverged { why }),
                AirDecision::Fault(fault) => return Err(JobEnd::failed(fault.to_string())),
            }
        }
        Err(JobEnd::failed("the air loop did not end; this is a defect of the program"))
    }

    /// How b is held with the camera at a Δv (mm): not at all near the solution, where the boards tell it.
    pub(super) fn hold_b(&self, delta_v_mm: f64, solution: &Solution) -> Option<HoldB> {
        let far = (delta_v_mm - solution.delta_v).abs() > HOLD_B_BEYOND_MM;
        far.then(|| HoldB {
            sigma_mm: B_RELATIVE_SIGMA * self.design.mla.b(),
            beyond_mm: HOLD_B_BEYOND_MM,
            image_distance_mm: solution.image_distance,
        })
    }

    async fn observe_air(
        &mut self,
        levels: &[f64; 3],
        solution: &Solution,
        frames: u32,
    ) -> Result<(AirObservation, Seen), JobEnd> {
        let expected = self.findings.delta_v_air.map_or(0.0, |(delta_v, _)| delta_v);
        let reading = self.motion.position_mm(AxisName::Focus)?;
        // Before the first measurement the axis's own reading is the best guess.
        let guess = if self.findings.delta_v_air.is_some() { expected } else { reading };
        let hold_b = self.hold_b(guess, solution);
        let triple = self.context.unless_cancelled(self.eye.calibrate(levels, hold_b, frames)).await?;
        let delta_v_mm = triple.camera.image_distance_mm - self.design.air_image_distance();
        self.findings.camera = Some(CalibratedCamera {
            design: self.design,
            lens_to_mla_mm: triple.camera.lens_to_mla_mm,
            mla_to_sensor_mm: triple.camera.mla_to_sensor_mm,
            image_distance_sigma_mm: triple.camera.image_distance_sigma_mm,
            pixel_mm: self.eye.pixel_mm(),
            window_px: Some(triple.middle.window_px),
        });
        let seen = triple.middle;
        self.findings.seen = Some(seen.clone());
        let observation = AirObservation {
            reading_mm: reading,
            delta_v_mm,
            sigma_mm: triple.camera.image_distance_sigma_mm,
            repeatability_mm: triple.camera.repeatability_mm,
        };
        Ok((observation, seen))
    }

    /// Takes e (mm) to where the shell is to be mounted, with the shell off: a probe first, and the picture of the boards in
    /// air, whose distance changes with e, must follow every move.
    pub(super) async fn park_e(&mut self, levels: &[f64; 3], initial: f64) -> Result<(), JobEnd> {
        let start = self.motion.position_mm(AxisName::E)?;
        let way = initial - start;
        if way.abs() <= self.config.assembly.e_tolerance_mm {
            return Ok(());
        }
        let (low, high) = self.motion.range_mm(AxisName::E);
        let free = (start - low).min(high - start);
        if free < FREE_TRAVEL_MM {
            return Err(JobEnd::NotConverged {
                why: format!(
                    "the e axis stands {free:.2} mm from an end of its travel; its first move needs {FREE_TRAVEL_MM} mm free on both sides"
                ),
            });
        }
        let mut from = start;
        for to in [start + way.clamp(-PROBE_MM, PROBE_MM), initial] {
            if (to - from).abs() < 1e-6 {
                continue;
            }
            let Some((camera, before)) = self.findings.camera.zip(self.findings.seen.clone()) else {
                return Err(JobEnd::failed("e is moved in air only after the air step"));
            };
            self.context.doing(format!("air: e axis to {to:.3} mm, where the shell is mounted"));
            self.context.unless_cancelled(self.motion.go(AxisName::E, Millimetres(to))).await?;
            let after = self.context.unless_cancelled(self.eye.calibrate(levels, None, 1)).await?.middle;
            let [here, there] = [&before, &after].map(|seen| {
                let (distance, slope) = camera.air_distance_mm(seen.spacing.spacing_px);
                (distance, slope.abs() * seen.spacing.spacing_sigma_px)
            });
            let (measured, sigma) = (there.0 - here.0, here.1.hypot(there.1));
            if let Some(fault) = check_move("e", to - from, measured, sigma, self.config.bench.e.backlash_mm) {
                return Err(JobEnd::failed(fault.to_string()));
            }
            self.context
                .log(format!("e moved by {:.3} mm; the picture shows {measured:.3} ± {sigma:.3} mm", to - from));
            self.findings.seen = Some(after);
            from = to;
        }
        Ok(())
    }

    async fn set_aperture(&mut self, solution: &Solution, levels: &[f64; 3]) -> Result<(), JobEnd> {
        let ring = self.design.main_lens.ring_f_number(solution.aperture);
        let instruction = format!(
            "Set the aperture to {:.2} mm: f/{ring:.2} on the lens's ring (not the working number {:.2}).",
            solution.aperture, solution.main_lens_f_number
        );
        let value = Some(format!("{:.2} mm, f/{ring:.2}", solution.aperture));
        let setup = Setup::Aperture { diameter_mm: solution.aperture, ring_f_number: ring };
        self.context.ask("aperture", instruction, value, setup).await?;
        // The micro-images have moved and changed their size: does the white frame still fit?
        self.context.doing("white frame still good?");
        let misfit = self.context.unless_cancelled(self.eye.white_misfit()).await?;
        if let Some(misfit) = misfit {
            self.context.log(misfit);
            self.white_frame().await?;
            self.place_triple_board(levels[1]).await?;
        } else {
            self.context.log("the white frame still fits");
        }
        Ok(())
    }

    pub(super) async fn shell(&mut self, solution: &Solution, step: ShellStep) -> Result<(), JobEnd> {
        let Some(camera) = self.findings.camera else {
            return Err(JobEnd::failed("the shell step needs the air step's calibration"));
        };
        let distance_mm = self.config.object.distance_mm;
        let instruction = format!(
            "Take the diffuser off if it is on. Mount the shell, fill the tank, and put the flat board {distance_mm:.1} mm from the shell's outer vertex."
        );
        let setup = Setup::WaterBoard { distance_mm };
        // From here on the shell counts as on, whatever becomes of the confirmation.
        self.motion.set_shell(ShellState::On);
        self.context.ask("shell_and_water", instruction, Some(format!("{distance_mm:.1} mm")), setup).await?;
        if self.config.assembly.spacing_target == SpacingTarget::Exact {
            self.eye.aim_at(camera.exact_target_px(solution.e));
        }
        let axis = &self.config.bench.e;
        let (low_mm, high_mm) = self.motion.range_mm(AxisName::E);
        let mut first_look = true;
        let in_air = self.findings.seen.clone();
        let mut shell = ShellLoop::new(
            ShellGoal {
                e_mm: solution.e,
                wall_mm: low_mm,
                tolerance_mm: self.config.assembly.e_tolerance_mm,
                spacing_px: self.eye.target_px(),
                step,
                high_limit_mm: high_mm,
                scale_sigma: axis.scale_uncertainty,
                zero_sigma_mm: axis.zero_uncertainty_mm,
                backlash_mm: axis.backlash_mm,
                home_mm: axis.home_position_mm,
            },
            camera,
        );
        let (mut kind, mut predicted, mut frames, mut moved) = (IterationKind::Start, None, 1, AxisName::E);
        let here_mm = self.motion.position_mm(AxisName::Focus)?;
        let focus_at_air = self.eye.air_step().map_or(here_mm, |air| air.focus_mm);
        for _ in 0..MAX_MEASUREMENTS {
            self.context.doing(format!("shell: measuring the spacing ({})", kind.word()));
            let e_reading_mm = self.motion.position_mm(AxisName::E)?;
            let focus_scale = self.findings.focus_scale.unwrap_or(1.0);
            let trim_mm = (self.motion.position_mm(AxisName::Focus)? - focus_at_air) * focus_scale;
            let seen = self.spacing_at_rest(kind, frames).await;
            let look = ShellLook { camera: &camera, axis, e_mm: e_reading_mm, trim_mm };
            let seen = if std::mem::take(&mut first_look) { as_configured(&look, seen)? } else { seen? };
            if let Some(picture) = &seen.picture {
                // The first stays; of the others the last.
                self.context.keep_picture(if self.findings.eog_before.is_none() { "before" } else { "after" }, picture);
            }
            if self.findings.eog_before.is_none() {
                self.findings.eog_before = seen.eog;
            }
            self.findings.eog_after = seen.eog;
            let decision = shell.next(ShellObservation {
                e_reading_mm,
                trim_mm,
                spacing_px: seen.spacing.spacing_px,
                sigma_px: seen.spacing.spacing_sigma_px,
            });
            self.keep_shell(&shell, step, &seen, e_reading_mm, trim_mm);
            self.record_shell(kind, moved, &seen, predicted, &decision);
            frames = 1;
            match decision {
                ShellDecision::ProbeE { to_mm } => {
                    let e = shell.model().predict(to_mm).0;
                    (kind, moved, predicted) = (IterationKind::Probe, AxisName::E, Some(camera.spacing_px(e, trim_mm)));
                    self.move_e(to_mm).await?;
                }
                ShellDecision::MoveE { to_mm, predicted_px } => {
                    (kind, moved, predicted) = (IterationKind::Move, AxisName::E, Some(predicted_px));
                    self.move_e(to_mm).await?;
                }
                ShellDecision::Trim { by_mm, predicted_px } => {
                    (kind, moved, predicted) = (IterationKind::Move, AxisName::Focus, Some(predicted_px));
                    let to = self.motion.position_mm(AxisName::Focus)? + by_mm / focus_scale;
                    self.context.doing(format!("shell: trimming Δv by {:.1} µm", by_mm * 1000.0));
                    self.context.unless_cancelled(self.motion.go(AxisName::Focus, Millimetres(to))).await?;
                }
                ShellDecision::MoreFrames => (kind, predicted, frames) = (IterationKind::Verify, None, 2),
                ShellDecision::Verify => (kind, predicted, frames) = (IterationKind::Verify, None, VERIFY_FRAMES),
                ShellDecision::Done => {
                    self.note_turned_board(&look, in_air.as_ref(), &seen);
                    return Ok(());
                }
                ShellDecision::NotConverged { why } => return Err(JobEnd::NotConverged { why }),
                ShellDecision::Fault(fault) => return Err(JobEnd::failed(fault.to_string())),
            }
        }
        Err(JobEnd::failed("the shell loop did not end; this is a defect of the program"))
    }

    /// The spacing over so many frames, after a move once the picture stands still: a controller may say that an axis
    /// stands while its carriage creeps on, and what is decided near the shell would be of where it no longer is.
    async fn spacing_at_rest(&self, kind: IterationKind, frames: u32) -> Result<Seen, JobEnd> {
        let mut seen = self.context.unless_cancelled(self.eye.spacing(frames)).await?;
        if !matches!(kind, IterationKind::Probe | IterationKind::Move) {
            return Ok(seen);
        }
        for _ in 0..CREEP_LOOKS {
            self.context.unless_cancelled(async { Ok::<_, JobEnd>(tokio::time::sleep(CREEP_LOOK).await) }).await?;
            let again = self.context.unless_cancelled(self.eye.spacing(frames)).await?;
            let (one, other) = (&seen.spacing, &again.spacing);
            let sigma = one.spacing_sigma_px.hypot(other.spacing_sigma_px);
            let changed = (one.spacing_px - other.spacing_px).abs() > CREEP_SIGMAS * sigma;
            seen = again;
            if !changed {
                return Ok(seen);
            }
            self.context.log("the picture still changes after the move: the axis creeps on, though its controller says that it stands");
        }
        Err(JobEnd::failed(
            "the picture does not come to rest after a move: the axis creeps on, though its controller says that it stands; check the coupling and the controller's settings",
        ))
    }

    /// Notes where the spacing's tilt says that a board is turned.
    fn note_turned_board(&mut self, look: &ShellLook<'_>, in_air: Option<&Seen>, seen: &Seen) {
        let half_width_mm = f64::from(self.config.sensor.width_px) / 2.0 * self.eye.pixel_mm();
        let turned = in_air.and_then(|in_air| look.turned_board(&in_air.spacing, &seen.spacing, half_width_mm));
        if let Some(turned) = turned {
            self.context.log(turned.clone());
            self.findings.notes.push(turned);
        }
    }

    async fn move_e(&self, to_mm: f64) -> Result<(), JobEnd> {
        self.context.doing(format!("shell: e axis to {to_mm:.3} mm"));
        self.context.unless_cancelled(self.motion.go(AxisName::E, Millimetres(to_mm))).await?;
        Ok(())
    }
}

/// The first picture through the shell, or why it cannot be measured, where it contradicts nothing of what was asked to be
/// set up: before anything moves on the strength of it.
fn as_configured(look: &ShellLook<'_>, seen: Result<Seen, JobEnd>) -> Result<Seen, JobEnd> {
    let seen = seen.map_err(|end| match end {
        JobEnd::Unmeasurable { why } => JobEnd::failed(look.unmeasurable(&why)),
        end => end,
    })?;
    match look.contradiction(&seen.spacing) {
        Some(why) => Err(JobEnd::failed(why)),
        None => Ok(seen),
    }
}
