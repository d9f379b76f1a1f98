//! The kinds of job that are parts of an alignment, each from its preparation to its end.

use super::{Alignment, VERIFY_FRAMES};
use crate::budget::BoardSeen;
use crate::job::Stage;
use crate::job::outcome::Outcome;
use crate::job::request::JobKind;
use crate::plan::AirBoards;
use crate::running::end::JobEnd;
use bench::config::{LBoundSource, ShellStep};
use bench::device::AxisName;

impl Alignment<'_> {
    /// Runs what was asked for. What it found stays in `findings`, whatever the end.
    pub(crate) async fn carry_out(&mut self) -> Result<(), JobEnd> {
        let request = self.context.snapshot().request;
        match request.kind {
            JobKind::JointAlignment => self.joint().await,
            JobKind::AirOnly => self.air_only().await,
            JobKind::ShellOnly => self.shell_only().await,
            JobKind::ClarityOnly => self.clarity_only(request.e_mm.unwrap_or(self.config.assembly.initial_e_mm)).await,
            JobKind::LBoundMeasurement => self.l_bound_only().await,
            JobKind::FocusSweep => {
                let sweep = request.sweep().map_err(JobEnd::from)?;
                self.focus_sweep(sweep, request.distance_mm).await
            }
            JobKind::SpacingWatch => {
                let (duration_s, interval_s) = request.watch().map_err(JobEnd::from)?;
                self.spacing_watch(duration_s, interval_s).await
            }
            JobKind::Calibration => self.calibration_only(request.distance_mm).await,
            JobKind::Homing => {
                let axes = request.axes.unwrap_or_else(|| AxisName::ALL.to_vec());
                self.homing(&axes).await
            }
        }
    }

    async fn air_only(&mut self) -> Result<(), JobEnd> {
        let mut plan = self.joint_plan()?;
        self.prepare(&plan).await?;
        if self.config.assembly.l_bound == LBoundSource::Measure {
            self.measure_l_bound().await?;
            plan = self.joint_plan()?;
        }
        self.air_then(&mut plan, None).await
    }

    async fn shell_only(&mut self) -> Result<(), JobEnd> {
        self.eye.check_camera()?;
        let plan = self.plan(self.design.joint(self.motion.l_bound_mm()), self.config.assembly.initial_e_mm);
        let solution = plan.solution;
        let kept = self.eye.air_step_for(&solution).map_err(JobEnd::failed)?;
        self.findings.solution = Some(solution);
        self.findings.camera = Some(kept.camera);
        self.findings.delta_v_air = Some(kept.delta_v);
        self.findings.air_done = true;
        self.findings.focus_scale = kept.focus_scale;
        // A homing that takes the focus axis along would lose Δv.
        if self.eye.bench().stage(AxisName::E).homes_also().is_none() {
            self.withdraw_e(&plan).await?;
        }
        self.context.log(format!("going on from the air step that left the focus axis at {:.4} mm", kept.focus_mm));
        self.context.stage(Stage::Shell);
        self.shell(&plan, self.config.assembly.shell_step).await
    }

    async fn clarity_only(&mut self, e_mm: f64) -> Result<(), JobEnd> {
        // What is on the way is seen in the picture.
        let (low, high) = self.motion.travel(self.config).e_mm;
        let low = low.max(self.motion.e_wall_mm());
        if !(low..=high).contains(&e_mm) {
            return Err(JobEnd::failed(format!(
                "e = {e_mm:.3} mm is outside what the e axis may be sent to: {low:.3} to {high:.3} mm"
            )));
        }
        let mut plan = self.sound_plan(self.design.clarity(e_mm), e_mm)?;
        // Wherever it ends, that is what it was to reach.
        self.findings.solution = Some(plan.solution);
        self.prepare(&plan).await?;
        self.withdraw_e(&plan).await?;
        self.air_then(&mut plan, Some(ShellStep::HoldETrim)).await
    }

    async fn l_bound_only(&mut self) -> Result<(), JobEnd> {
        let plan =
            self.sound_plan(self.design.joint(self.config.assembly.l_bound_mm), self.config.assembly.initial_e_mm)?;
        self.prepare(&plan).await?;
        self.measure_l_bound().await?;
        if let Some(sigma_mm) = self.findings.l_bound_sigma_mm {
            self.context.outcome(Outcome::LBound {
                l_bound_mm: self.motion.l_bound_mm(),
                sigma_mm,
                e_wall_mm: self.motion.e_wall_mm(),
            });
        }
        Ok(())
    }

    async fn calibration_only(&mut self, distance_mm: Option<f64>) -> Result<(), JobEnd> {
        self.context.stage(Stage::Survey);
        self.eye.check_camera()?;
        if !self.eye.has_white() {
            self.white_frame().await?;
        }
        let plan = self.plan(self.design.joint(self.motion.l_bound_mm()), self.config.assembly.initial_e_mm);
        let boards = plan.arrangement.about(distance_mm.unwrap_or(plan.solution.equivalent_distance));
        self.place(boards).await?;
        self.context.doing("calibration: measuring the board");
        // Where the axis's reading is unknown the camera may stand anywhere.
        let reading_mm = self.motion.position_mm(AxisName::Focus).unwrap_or(f64::INFINITY);
        let (known_b, hold_b) = (self.configured_b(), self.hold_b(reading_mm, &plan));
        let seen = self.context.unless_cancelled(self.eye.calibrate(boards, known_b, hold_b, VERIFY_FRAMES)).await?;
        let places_mm = plan.places_about(boards.middle_mm());
        let (camera, distances_mm) = match boards {
            AirBoards::Levels(levels_mm) => (seen.camera, levels_mm),
            AirBoards::Flat(distance_mm) => {
                let here = BoardSeen::at(distance_mm, &seen.middle.spacing);
                let camera = self.camera_in_turn(places_mm, here).await?.map_or(seen.camera, |(camera, _)| camera);
                let seen_at = |boards: [BoardSeen; 3]| boards.map(|board| board.distance_mm);
                (camera, camera.boards.map_or([distance_mm; 3], seen_at))
            }
        };
        self.context.outcome(Outcome::Calibration {
            distances_mm,
            lens_to_mla_mm: camera.lens_to_mla_mm,
            mla_to_sensor_mm: camera.mla_to_sensor_mm,
            image_distance_mm: camera.image_distance_mm,
            image_distance_sigma_mm: camera.image_distance_sigma_mm,
            delta_v_mm: camera.image_distance_mm - self.design.air_image_distance(),
        });
        Ok(())
    }

    async fn homing(&mut self, axes: &[AxisName]) -> Result<(), JobEnd> {
        self.context.stage(Stage::Preparation);
        self.context.begin(axes.len() as u32 + 1);
        self.context.step_of_bench("homing");
        for &axis in axes {
            self.home(axis).await?;
        }
        self.context.outcome(Outcome::Homing {
            focus_mm: self.motion.position_mm(AxisName::Focus).ok(),
            e_mm: self.motion.position_mm(AxisName::E).ok(),
        });
        Ok(())
    }
}
