//! The air step: boards up, the moves of [`crate::loops::air`] carried out, e taken to where the shell is mounted.

use super::{Alignment, MAX_MEASUREMENTS, VERIFY_FRAMES};
use crate::budget::{AirPlace, AirStep, BoardSeen};
use crate::job::{IterationKind, Stage};
use crate::loops::air::{AirDecision, AirLoop, AirObservation};
use crate::loops::axis_model::{AxisModel, check_move};
use crate::loops::calibrated::CalibratedCamera;
use crate::measuring::eye::Seen;
use crate::measuring::not_measured::NotMeasured;
use crate::measuring::sight::{CameraSeen, HoldB};
use crate::plan::{AirBoards, Arrangement, Plan, has_shell};
use crate::running::end::JobEnd;
use bench::config::BoardsInAir;
use bench::device::{AxisName, Setup};
use plenoptics::optics::Solution;
use plenoptics::optics::mla::a_from_spacing;
use plenoptics::units::Millimetres;

/// Places of a board nearer to one another than this are one, mm.
const SAME_PLACE_MM: f64 = 0.05;
/// Places of the focus axis nearer to one another than this are one, mm.
const SAME_FOCUS_MM: f64 = 1e-6;

/// What is done where the levels of a board cannot be told well enough.
const IN_TURN: &str = "a flat board is put to three places in turn instead";

/// What boards in air say of Δv, and the middle one as it was seen.
pub(crate) type InAir = (AirObservation, Seen);

impl Alignment<'_> {
    /// Puts boards where they are measured with the camera at a Δv (mm), known to `within_mm`; those that stand there and
    /// serve stay.
    async fn boards_in_range(
        &mut self,
        present: Option<AirBoards>,
        (delta_v_mm, within_mm): (f64, f64),
        plan: &Plan,
    ) -> Result<AirBoards, JobEnd> {
        let Some(wanted) = plan.boards_at(delta_v_mm, within_mm, present) else {
            return Err(JobEnd::failed(format!(
                "with Δv at {delta_v_mm:.2} ± {within_mm:.2} mm there is no place in air where a board is in the range of focus"
            )));
        };
        if present != Some(wanted) {
            self.place(wanted).await?;
        }
        Ok(wanted)
    }

    /// The air step. Returns what stands before the lens at its end.
    pub(crate) async fn air(&mut self, plan: &mut Plan) -> Result<AirBoards, JobEnd> {
        let solution = plan.solution;
        let mut air = AirLoop::new(plan.air_goal());
        self.findings.known_b = Some(self.configured_b());
        // The axis may have been homed since, which repeats to tenths of a millimetre.
        self.findings.air_places.clear();
        let (mut kind, mut predicted, mut frames) = (IterationKind::Start, None, 1);
        let moves_before = self.findings.moves_air;
        self.findings.air_done = false;
        let (mut boards, mut dark) = (None, 0);
        for _ in 0..MAX_MEASUREMENTS {
            let reading_mm = self.motion.position_mm(AxisName::Focus)?;
            let expected = air.model().map_or((reading_mm, plan.unknown_delta_v_mm(reading_mm)), |model| {
                let (delta_v, sigma) = model.predict(reading_mm);
                (delta_v, 2.0 * sigma)
            });
            if self.retook_far_white(reading_mm, plan).await? {
                boards = None;
            }
            let standing = self.boards_in_range(boards, expected, plan).await?;
            let others_stood = boards.is_some_and(|boards| boards != standing);
            boards = Some(standing);
            let near = (expected.0 - solution.delta_v).abs() <= plan.aperture_within_mm;
            let set_now = near && !self.aperture_set;
            if set_now {
                // The micro-images shrink as d grows: with the new aperture they have the size of the white frame's.
                self.set_aperture(&solution, standing).await?;
            }
            if others_stood || set_now {
                air.seen_otherwise(reading_mm);
            }
            self.context.doing(format!("air: measuring Δv ({})", kind.word()));
            let looked = self.observe_air(standing, plan, frames).await;
            if self.was_dark(&looked, &mut dark).await? {
                self.place(standing).await?;
                air.seen_otherwise(reading_mm);
                continue;
            }
            let (observation, seen) = match looked {
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) if self.may_change_to_flat(standing) => {
                    boards = None;
                    self.change_to_flat(plan, &why);
                    continue;
                }
                // Later what was predicted from the pictures before would have to be wrong.
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) if air.model().is_none() => {
                    self.way_in_air(standing, plan, why).await?
                }
                looked => looked?,
            };
            let decision = air.next(observation);
            let here = air.here().unwrap_or(observation);
            self.findings.moves_air = moves_before + air.moves();
            self.findings.delta_v_air = Some((here.delta_v_mm, here.sigma_mm));
            self.findings.focus_scale = air.scale();
            let predicted_px =
                predicted.map(|delta_v| self.design.spacing_at(standing.middle_mm(), delta_v) / self.eye.pixel_mm());
            self.record_air(kind, &seen, here, predicted_px, &decision);
            frames = 1;
            match decision {
                AirDecision::Probe { to_mm } | AirDecision::Move { to_mm } => {
                    // A move costs less than a step of the operator. A probe is to tell the scale, and is not cut short.
                    let model = air.model().filter(|_| matches!(decision, AirDecision::Move { .. }));
                    let to_mm = model.map_or(to_mm, |model| {
                        let expected = |at_mm: f64| {
                            let (delta_v, sigma) = model.predict(at_mm);
                            (delta_v, 2.0 * sigma)
                        };
                        plan.without_other_boards((reading_mm, to_mm), expected, standing)
                    });
                    kind = if matches!(decision, AirDecision::Probe { .. }) {
                        IterationKind::Probe
                    } else {
                        IterationKind::Move
                    };
                    predicted = air.model().map(|model| model.predict(to_mm).0);
                    self.context.doing(format!("air: focus axis to {to_mm:.4} mm"));
                    self.go(AxisName::Focus, to_mm).await?;
                }
                AirDecision::MoreFrames => (kind, predicted) = (IterationKind::Verify, None),
                AirDecision::Verify => (kind, predicted, frames) = (IterationKind::Verify, None, VERIFY_FRAMES),
                AirDecision::Done => {
                    self.findings.air_done = true;
                    self.findings.truth_air = self.context.truth();
                    let standing = self.calibrate_in_turn(plan, standing).await?;
                    if let Some(camera) = self.findings.camera {
                        let delta_v = (here.delta_v_mm, here.sigma_mm);
                        self.eye.keep_air_step(AirStep {
                            camera,
                            delta_v,
                            boards: self.findings.boards,
                            focus_mm: reading_mm,
                            focus_scale: self.findings.focus_scale,
                            places: self.places_but(reading_mm),
                        });
                    }
                    self.context.log(format!(
                        "air step done: Δv = {:.4} ± {:.4} mm, wanted {:.4} mm",
                        here.delta_v_mm, here.sigma_mm, solution.delta_v
                    ));
                    return Ok(standing);
                }
                AirDecision::TooUncertain { why } if self.may_change_to_flat(standing) => {
                    (boards, kind, predicted) = (None, IterationKind::Verify, None);
                    self.change_to_flat(plan, &why);
                    air.seen_otherwise(reading_mm);
                }
                AirDecision::TooUncertain { why } | AirDecision::NotConverged { why } => {
                    return Err(JobEnd::NotConverged { why });
                }
                AirDecision::Fault(fault) => return Err(fault.into()),
            }
        }
        Err(JobEnd::failed("the air loop did not end; this is a defect of the program"))
    }

    /// Has another white frame taken where the focus axis stands too far (mm, by its reading) from where it was taken for
    /// its grid to be followed. Whether it was: the boards are gone then.
    pub(crate) async fn retook_far_white(&mut self, reading_mm: f64, plan: &Plan) -> Result<bool, JobEnd> {
        let white = self.eye.white_frame().ok_or_else(|| JobEnd::failed("no white frame has been taken"))?;
        let taken_at = white.focus.position.map(Millimetres::value);
        let far = taken_at.is_some_and(|taken_at| !plan.grid_followed(taken_at, reading_mm));
        if far {
            self.context.log("so far from where it was taken the white frame's grid no longer fits: another is taken");
            self.another_white_frame().await?;
        }
        Ok(far)
    }

    /// Whether a flat board may stand in for what stands before the lens.
    fn may_change_to_flat(&self, standing: AirBoards) -> bool {
        self.config.boards.in_air == BoardsInAir::Auto && matches!(standing, AirBoards::Levels(_))
    }

    /// From now on a flat board stands in for the levels, and says why.
    fn change_to_flat(&self, plan: &mut Plan, why: &str) {
        self.context.log(format!("{why}: {IN_TURN}"));
        *plan = plan.with_flat_board();
        self.tell_boards(plan);
    }

    /// Has the steps to come say which boards a plan has in air.
    pub(super) fn tell_boards(&self, plan: &Plan) {
        let (mut in_air, parking) = plan.steps_in_air(self.config);
        let job = self.context.snapshot();
        // While l_bound is measured e is not parked.
        if job.stage == Stage::Air && has_shell(job.kind) {
            in_air.extend(parking);
        }
        self.context.change_boards(in_air, self.aperture_set);
    }

    /// b as configured and its standard uncertainty, mm.
    pub(crate) fn configured_b(&self) -> (f64, f64) {
        let b = self.design.mla.b();
        (b, self.config.uncertainty.mla_to_sensor * b)
    }

    /// How b is held with the camera at a Δv (mm): not at all near the solution, where three levels tell it.
    pub(crate) fn hold_b(&self, delta_v_mm: f64, plan: &Plan) -> Option<HoldB> {
        let far = (delta_v_mm - plan.solution.delta_v).abs() > plan.b_told_within_mm;
        far.then(|| HoldB {
            sigma_mm: self.configured_b().1,
            beyond_mm: plan.b_told_within_mm,
            image_distance_mm: plan.solution.image_distance,
        })
    }

    pub(crate) async fn observe_air(&mut self, boards: AirBoards, plan: &Plan, frames: u32) -> Result<InAir, JobEnd> {
        let reading = self.motion.position_mm(AxisName::Focus)?;
        // Before the first measurement the axis's own reading is the best guess.
        let guess = self.findings.delta_v_air.map_or(reading, |(delta_v, _)| delta_v);
        let (known_b, hold_b) = (self.known_b(), self.hold_b(guess, plan));
        let seen = self.context.unless_cancelled(self.eye.calibrate(boards, known_b, hold_b, frames)).await?;
        let delta_v_mm = self.keep_camera(&seen.camera, seen.middle.window_px);
        self.findings.boards = seen.camera.boards;
        let mut air_places = self.places_but(reading);
        let seen_boards = match (seen.camera.boards, boards) {
            (Some(levels), _) => levels.to_vec(),
            (None, AirBoards::Flat(distance_mm)) => vec![BoardSeen::at(distance_mm, &seen.middle.spacing)],
            (None, AirBoards::Levels(_)) => {
                vec![self.as_one(&seen.camera, boards.middle_mm(), seen.middle.spacing.spacing_px)]
            }
        };
        air_places.push(AirPlace { focus_mm: reading, boards: seen_boards });
        self.findings.air_places = air_places;
        self.findings.seen = Some(seen.middle.clone());
        let observation = AirObservation {
            reading_mm: reading,
            delta_v_mm,
            sigma_mm: seen.camera.image_distance_sigma_mm,
            repeatability_mm: seen.camera.repeatability_mm,
        };
        Ok((observation, seen.middle))
    }

    /// What boards showed with the focus axis elsewhere than at a reading, mm.
    fn places_but(&self, focus_mm: f64) -> Vec<AirPlace> {
        let places = self.findings.air_places.iter();
        places.filter(|place| (place.focus_mm - focus_mm).abs() > SAME_FOCUS_MM).cloned().collect()
    }

    /// Levels that were not told apart as one board at a distance (mm) with their spacing (px): as uncertain as that leaves the
    /// image distance.
    fn as_one(&self, seen: &CameraSeen, distance_mm: f64, spacing_px: f64) -> BoardSeen {
        let (mla, pixel_mm) = (self.design.mla, self.eye.pixel_mm());
        let a = a_from_spacing(mla.pitch, spacing_px * pixel_mm, seen.mla_to_sensor_mm);
        // l = P (a − b)/a.
        let slope = mla.pitch * seen.mla_to_sensor_mm / (a * a) / pixel_mm;
        BoardSeen { distance_mm, spacing_px, sigma_px: slope * seen.image_distance_sigma_mm }
    }

    fn known_b(&self) -> (f64, f64) {
        self.findings.known_b.unwrap_or_else(|| self.configured_b())
    }

    /// Keeps the camera as boards have it, seen through masks of a radius (px). Returns its Δv, mm.
    fn keep_camera(&mut self, seen: &CameraSeen, window_px: f64) -> f64 {
        self.findings.camera = Some(CalibratedCamera {
            design: self.design,
            lens_to_mla_mm: seen.lens_to_mla_mm,
            mla_to_sensor_mm: seen.mla_to_sensor_mm,
            image_distance_sigma_mm: seen.image_distance_sigma_mm,
            pixel_mm: self.eye.pixel_mm(),
            window_px: Some(window_px),
            aberrations_sigma: self.config.uncertainty.shell_aberrations,
        });
        seen.image_distance_mm - self.design.air_image_distance()
    }

    /// Where one flat board is put to three places in turn: tells b by the other two, at the end of the air loop. Returns
    /// what stands before the lens then.
    async fn calibrate_in_turn(&mut self, plan: &Plan, standing: AirBoards) -> Result<AirBoards, JobEnd> {
        let (Arrangement::InTurn { places_mm }, Some(middle)) = (plan.arrangement, self.findings.seen.clone()) else {
            return Ok(standing);
        };
        let here = BoardSeen::at(standing.middle_mm(), &middle.spacing);
        let Some((camera, last_mm)) = self.camera_in_turn(places_mm, here).await? else { return Ok(standing) };
        let (b, b_sigma) = self.known_b();
        self.context.log(format!("b by the three places: {b:.5} ± {b_sigma:.5} mm"));
        let delta_v_mm = self.keep_camera(&camera, middle.window_px);
        self.findings.delta_v_air = Some((delta_v_mm, camera.image_distance_sigma_mm));
        self.findings.boards = camera.boards;
        Ok(AirBoards::Flat(last_mm))
    }

    /// Has one flat board that was seen put to the other places too, and keeps the b that they tell together. Returns the
    /// camera by the board as it was seen first, with all three, and where (mm) the board stands at the end; `None` where
    /// there are no other places.
    pub(crate) async fn camera_in_turn(
        &mut self,
        places_mm: [f64; 3],
        here: BoardSeen,
    ) -> Result<Option<(CameraSeen, f64)>, JobEnd> {
        let (mut boards, mut last_mm) = (vec![here], here.distance_mm);
        for place_mm in places_mm {
            if boards.len() == places_mm.len() || (place_mm - here.distance_mm).abs() < SAME_PLACE_MM {
                continue;
            }
            self.place(AirBoards::Flat(place_mm)).await?;
            self.context.doing(format!("air: measuring the board at {place_mm:.1} mm"));
            let looked = self.eye.calibrate(AirBoards::Flat(place_mm), self.known_b(), None, VERIFY_FRAMES);
            boards.push(BoardSeen::at(place_mm, &self.context.unless_cancelled(looked).await?.middle.spacing));
            last_mm = place_mm;
        }
        boards.sort_unstable_by(|one, other| one.distance_mm.total_cmp(&other.distance_mm));
        let (Ok(boards), Some(sight)) = (<[BoardSeen; 3]>::try_from(boards), self.eye.sight()) else { return Ok(None) };
        let known_b = sight.b_from(&boards, self.known_b()).map_err(JobEnd::failed)?;
        self.findings.known_b = Some(known_b);
        Ok(Some((CameraSeen { boards: Some(boards), ..sight.camera_from(here, known_b) }, last_mm)))
    }

    /// Takes e to where the shell is to be mounted, with the shell off: a probe first, and the picture of the boards in
    /// air, whose distance changes with e, must follow every move. Where it would leave the range of focus on the way, a
    /// board is put up anew.
    pub(crate) async fn park_e(&mut self, plan: &Plan, boards: AirBoards) -> Result<(), JobEnd> {
        let (start, to_mm) = (self.motion.position_mm(AxisName::E)?, plan.mount_e_mm);
        if (to_mm - start).abs() <= plan.e_tolerance_mm {
            return Ok(());
        }
        if let Some((free, needed)) = self.too_little_room_mm(AxisName::E, plan.e_probe_mm)? {
            return Err(JobEnd::NotConverged {
                why: format!(
                    "the e axis stands {free:.2} mm from an end of its travel; its first move needs {needed:.2} mm free on both sides"
                ),
            });
        }
        let Some((camera, seen)) = self.findings.camera.zip(self.findings.seen.clone()) else {
            return Err(JobEnd::failed("e is moved in air only after the air step"));
        };
        // A board that was put to three places no longer stands where it was seen first.
        let mut before = match boards {
            AirBoards::Levels(_) => seen,
            AirBoards::Flat(_) => self.look_in_air(boards).await?,
        };
        let (mut from, mut standing, mut probed) = (start, boards, false);
        // Only travel can be seen in air: what the axis reads at its home is taken to be e there.
        let home = self.config.bench.e.home_position_mm;
        let mut scale = AxisModel::new(0.0, 0.0, 0.0, self.config.bench.e.scale_uncertainty);
        loop {
            let rest = home + (to_mm - home) / scale.scale().0 - from;
            if rest.abs() <= 0.5 * plan.e_tolerance_mm {
                break;
            }
            let most = if probed { f64::INFINITY } else { plan.e_probe_mm };
            let way = rest.clamp(-most, most);
            let Some((place_mm, way)) = plan.board_along(standing.middle_mm(), way) else {
                return Err(JobEnd::failed(
                    "no place of a board in air keeps it in the range of focus while e is moved: set assembly.initial_e_mm to where the e axis stands after its homing",
                ));
            };
            if place_mm != standing.middle_mm() {
                standing = plan.arrangement.about(place_mm);
                self.place(standing).await?;
                before = self.look_in_air(standing).await?;
            }
            let to = from + way;
            self.context.doing(format!("air: e axis to {to:.3} mm, where the shell is mounted"));
            self.go(AxisName::E, to).await?;
            let after = self.look_in_air(standing).await?;
            let [here, there] = [&before, &after].map(|seen| {
                let (distance, slope) = camera.air_distance_mm(seen.spacing.spacing_px);
                (distance, slope.abs() * seen.spacing.spacing_sigma_px)
            });
            let (measured, sigma) = (there.0 - here.0, here.1.hypot(there.1));
            if let Some(fault) = check_move(AxisName::E, way, measured, sigma, self.config.bench.e.backlash_mm) {
                return Err(fault.into());
            }
            scale.observe(way, measured, sigma.hypot(self.config.bench.e.backlash_mm));
            self.context.log(format!("e moved by {way:.3} mm; the picture shows {measured:.3} ± {sigma:.3} mm"));
            self.findings.seen = Some(after.clone());
            before = after;
            // The board stands still while the camera moves.
            standing = plan.arrangement.about(standing.middle_mm() + way);
            (from, probed) = (to, true);
        }
        Ok(())
    }

    async fn look_in_air(&self, boards: AirBoards) -> Result<Seen, JobEnd> {
        let looked = self.eye.calibrate(boards, self.known_b(), None, 1);
        Ok(self.context.unless_cancelled(looked).await?.middle)
    }

    async fn set_aperture(&mut self, solution: &Solution, standing: AirBoards) -> Result<(), JobEnd> {
        let ring = self.design.main_lens.ring_f_number(solution.aperture);
        let instruction = format!(
            "Set the aperture to {:.2} mm: f/{ring:.2} on the lens's ring (not the working number {:.2}).",
            solution.aperture, solution.main_lens_f_number
        );
        let value = Some(format!("{:.2} mm, f/{ring:.2}", solution.aperture));
        let setup = Setup::Aperture { diameter_mm: solution.aperture, ring_f_number: ring };
        let mut dark = 0;
        let is_off = loop {
            self.ask("aperture", instruction.clone(), value.clone(), setup.clone()).await?;
            self.aperture_set = true;
            // The micro-images have moved and changed their size: does the white frame still fit?
            let looked = self.white_is_off().await;
            if !self.was_dark(&looked, &mut dark).await? {
                break looked?;
            }
        };
        if is_off {
            self.another_white_frame().await?;
            self.place(standing).await?;
        }
        Ok(())
    }

    /// Whether the white frame no longer fits what is before the lens now.
    pub(crate) async fn white_is_off(&self) -> Result<bool, JobEnd> {
        self.context.doing("white frame still good?");
        let misfit = self.context.unless_cancelled(self.eye.white_misfit()).await?;
        self.context.log(misfit.as_deref().unwrap_or("the white frame still fits"));
        Ok(misfit.is_some())
    }
}
