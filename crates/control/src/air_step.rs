//! The air step: boards up, the moves of [`super::air`] carried out, e taken to where the shell is mounted.

use super::air::{AirDecision, AirGoal, AirLoop, AirObservation, FREE_TRAVEL_MM, PROBE_MM};
use super::alignment::{Alignment, MAX_MEASUREMENTS, VERIFY_FRAMES};
use super::axis_model::check_move;
use super::calibrated::CalibratedCamera;
use super::context::JobEnd;
use super::eye::Seen;
use super::job::IterationKind;
use super::sight::HoldB;
use super::tasks::AirStep;
use bench::device::{AxisName, Setup};
use plenoptics::imaging::spacing::capture_range;
use plenoptics::optics::Solution;
use plenoptics::units::Millimetres;

/// b is held at its configured value while Δv is further than this from its target, mm: the board then cannot tell it.
const HOLD_B_BEYOND_MM: f64 = 0.2;
/// Δv is this near to its target (mm, by the axis's reading) when the aperture is set for it.
const APERTURE_WITHIN_MM: f64 = 0.5;

impl Alignment<'_> {
    /// Whether a board at a distance in air is in the range of focus at a reading of the focus axis (both mm).
    fn in_range(&self, distance_mm: f64, reading_mm: f64) -> bool {
        let relative = self.design.spacing_at(distance_mm, reading_mm) / self.design.mla.pitch;
        let [low, high] = capture_range(self.design.mla.mode);
        (low..=high).contains(&relative)
    }

    /// Where a board in air is in the range of focus at a reading of the focus axis (both mm): where a solution has it, or
    /// where the lens is focused.
    pub(super) fn distance_in_range(&self, reading_mm: f64, solution: &Solution) -> f64 {
        if self.in_range(solution.equivalent_distance, reading_mm) {
            solution.equivalent_distance
        } else {
            self.design.main_lens.object_distance(self.design.air_image_distance() + reading_mm)
        }
    }

    /// Puts the triple-level board where it is measured at a reading (mm) of the focus axis: where the solution has it,
    /// or, while that is out of the range of focus, left where it is or put where the lens is focused.
    async fn boards_in_range(
        &mut self,
        present: Option<[f64; 3]>,
        reading_mm: f64,
        solution: &Solution,
    ) -> Result<[f64; 3], JobEnd> {
        let wanted_mm = self.distance_in_range(reading_mm, solution);
        let stays =
            |levels: &[f64; 3]| wanted_mm != solution.equivalent_distance && self.in_range(levels[1], reading_mm);
        let place_mm = present.filter(stays).map_or(wanted_mm, |levels| levels[1]);
        match present.filter(|levels| levels[1] == place_mm) {
            Some(levels) => Ok(levels),
            None => self.place_triple_board(place_mm).await,
        }
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
                    self.context
                        .unless_cancelled(self.motion.go(self.admission, AxisName::Focus, Millimetres(to_mm)))
                        .await?;
                }
                AirDecision::MoreFrames => (kind, predicted) = (IterationKind::Verify, None),
                AirDecision::Verify => (kind, predicted, frames) = (IterationKind::Verify, None, VERIFY_FRAMES),
                AirDecision::Done => {
                    self.findings.truth_air = self.context.truth();
                    if let Some(camera) = self.findings.camera {
                        let delta_v = (here.delta_v_mm, here.sigma_mm);
                        let boards = self.findings.boards;
                        self.eye.keep_air_step(AirStep { camera, delta_v, boards, focus_mm: reading_mm });
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
            sigma_mm: self.config.uncertainty.mla_to_sensor * self.design.mla.b(),
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
        self.findings.boards = triple.camera.boards;
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
            self.context.unless_cancelled(self.motion.go(self.admission, AxisName::E, Millimetres(to))).await?;
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
        self.ask("aperture", instruction, value, setup).await?;
        // The micro-images have moved and changed their size: does the white frame still fit?
        if self.white_is_off().await? {
            self.white_frame().await?;
            self.place_triple_board(levels[1]).await?;
        }
        Ok(())
    }

    /// Whether the white frame no longer fits what is before the lens now.
    pub(super) async fn white_is_off(&self) -> Result<bool, JobEnd> {
        self.context.doing("white frame still good?");
        let misfit = self.context.unless_cancelled(self.eye.white_misfit()).await?;
        self.context.log(misfit.as_deref().unwrap_or("the white frame still fits"));
        Ok(misfit.is_some())
    }
}
