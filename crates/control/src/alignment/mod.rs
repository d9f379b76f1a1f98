//! The joint alignment, from the first homing to the report: the order of steps, the operator's part, and what is kept
//! of each. Its two loops are carried out in [`crate::alignment::air_step`] and [`crate::alignment::shell_step`].

mod air_step;
mod l_bound;
mod record;
mod report;
pub(crate) mod runner;
mod shell_step;
mod survey;
mod tasks;
mod way_in;

use std::sync::Arc;

use crate::budget::{AirPlace, BoardSeen};
use crate::events::{InView, ShellState};
use crate::job::steps::Repeatable;
use crate::job::{JobKind, Stage};
use crate::loops::air::FREE_PROBES;
use crate::loops::axis_model::AxisModel;
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::shell::ShellObservation;
use crate::measuring::eye::{Eye, Seen};
use crate::measuring::not_measured::NotMeasured;
use crate::motion::{Admission, Motion};
use crate::plan::{AirBoards, Obstacle, Plan};
use crate::refusal::{Refusal, ServiceError};
use crate::running::context::JobContext;
use crate::running::end::JobEnd;
use crate::spacing::TiltChange;
use bench::config::{Config, LBoundSource, ShellStep, Side};
use bench::device::{AxisName, Setup};
use plenoptics::optics::{CameraDesign, Solution};
use plenoptics::units::Millimetres;

/// So many lengths of its first move e may be moved with the shell off: the boards, which stay where they are, can then
/// still be measured.
const FOLLOWED_IN_AIR: f64 = 10.0;
/// Frames combined in a verifying measurement.
pub(super) const VERIFY_FRAMES: u32 = 2;
/// Times that a white frame is asked for, one after another, while what is taken cannot be one.
const WHITE_TRIES: u32 = 3;
/// What is said before it is asked for once more.
const OLD_WHITE: &str = "The camera gave an old picture again as if it were new: unplug it and plug it in again";
/// How often a step is asked for again because nothing could be seen.
const DARK_TRIES: u32 = 2;
/// Measurements of a loop before it is cut off, whatever its decisions.
pub(super) const MAX_MEASUREMENTS: u32 = 60;

/// What an alignment has found so far: enough for a report at any moment.
#[derive(Debug, Clone, Default)]
pub(super) struct Findings {
    /// Solution aimed for.
    pub(super) solution: Option<Solution>,
    /// Δv as the air step has it and its standard uncertainty, mm.
    pub(super) delta_v_air: Option<(f64, f64)>,
    /// Whether the air step has come to its end.
    pub(super) air_done: bool,
    /// The boards one by one in the newest frames of the air step, where they could be told apart.
    pub(super) boards: Option<[BoardSeen; 3]>,
    /// What boards in air showed, place of the focus axis by place.
    pub(super) air_places: Vec<AirPlace>,
    /// b and its standard uncertainty, mm: as configured, or as one board at three places told it.
    pub(super) known_b: Option<(f64, f64)>,
    /// Trim of Δv since, mm.
    pub(super) trim_mm: f64,
    /// Camera as calibrated.
    pub(super) camera: Option<CalibratedCamera>,
    /// What the readings of the e axis mean, as the picture has told; where it contradicts them, what they will mean once
    /// the axis has been homed.
    pub(super) e_told: Option<AxisModel>,
    /// e as the picture has it and its standard uncertainty, mm.
    pub(super) e: Option<(f64, f64)>,
    /// The last measurement.
    pub(super) seen: Option<Seen>,
    /// What was measured at each pose through the shell.
    pub(super) through_shell: Vec<ShellObservation>,
    /// How the spacing's tilt has changed since air.
    pub(super) tilt_change: Option<TiltChange>,
    /// Moves in the air step.
    pub(super) moves_air: u32,
    /// Moves in the shell step.
    pub(super) moves_shell: u32,
    /// Scale of the focus axis, once it has been seen to move.
    pub(super) focus_scale: Option<f64>,
    /// The same of the e axis.
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
    /// What everything that it moves is admitted under.
    pub(super) admission: &'a Admission,
    pub(super) eye: &'a Eye,
    pub(super) config: &'a Arc<Config>,
    pub(super) design: CameraDesign,
    pub(super) findings: Findings,
    /// Whether the aperture is set for the solution aimed for.
    pub(super) aperture_set: bool,
}

impl Alignment<'_> {
    /// The joint alignment.
    pub(super) async fn joint(&mut self) -> Result<(), JobEnd> {
        let mut plan = self.joint_plan()?;
        self.prepare(&plan).await?;
        if self.config.assembly.l_bound == LBoundSource::Measure {
            self.measure_l_bound().await?;
            plan = self.joint_plan()?;
        }
        self.withdraw_e(&plan).await?;
        self.air_then(&mut plan, Some(self.config.assembly.shell_step)).await
    }

    /// The air step and what comes after it, begun anew as often as the operator asks for its white frame or its board
    /// again. Nothing has been moved towards the shell by then.
    pub(super) async fn air_then(&mut self, plan: &mut Plan, shell: Option<ShellStep>) -> Result<(), JobEnd> {
        self.findings.solution = Some(plan.solution);
        // What an l_bound was measured by is not measured again.
        self.context.let_repeat(self.findings.l_bound_sigma_mm.is_none());
        let (mut again, as_planned) = (None, *plan);
        loop {
            match self.air_once(plan, shell, again).await {
                Err(JobEnd::Repeat(what)) => again = Some(what),
                ended => return ended,
            }
            // Levels that a flat board stands in for by now are tried once more.
            if again != Some(Repeatable::FlatBoard) {
                *plan = as_planned;
                self.tell_boards(plan);
            }
        }
    }

    async fn air_once(
        &mut self,
        plan: &mut Plan,
        shell: Option<ShellStep>,
        again: Option<Repeatable>,
    ) -> Result<(), JobEnd> {
        self.context.stage(Stage::Air);
        self.eye.aim_at(plan.solution.e);
        if let Some(what) = again {
            self.forget_air_step();
            if what == Repeatable::WhiteFrame {
                self.white_frame().await?;
            }
        }
        let boards = self.air(plan).await?;
        let Some(step) = shell else { return Ok(()) };
        self.park_e(plan, boards).await?;
        self.context.stage(Stage::Shell);
        self.shell(plan, step).await
    }

    /// What the boards in air have shown counts no more. The aperture stays as it was set.
    fn forget_air_step(&mut self) {
        self.eye.forget_air_step();
        let findings = &mut self.findings;
        (findings.delta_v_air, findings.boards, findings.camera, findings.seen) = (None, None, None, None);
        (findings.focus_scale, findings.air_done) = (None, false);
        findings.air_places.clear();
    }

    pub(super) async fn prepare(&mut self, plan: &Plan) -> Result<(), JobEnd> {
        self.context.stage(Stage::Preparation);
        self.context.step_of_bench("preparation");
        self.eye.check_camera()?;
        self.context.doing("devices and homing");
        for axis in AxisName::ALL {
            let state = self.context.unless_cancelled(self.motion.read_state(axis)).await?;
            for disagreement in self.motion.stage_info(axis).disagreements {
                self.context.log(format!("{axis} axis: {disagreement}"));
            }
            if !state.homed {
                self.context.log(format!("homing the {axis} axis"));
                self.home(axis).await?;
            }
            let state = self.context.unless_cancelled(self.motion.read_state(axis)).await?;
            self.context.log(format!("the {axis} axis stands at {:.3}", state.position));
        }
        self.home_where_cramped(AxisName::Focus, plan.focus_probe_mm).await?;
        self.white_frame().await?;
        // A line that was out meanwhile may have cost the controller its count. No shell is in the way now.
        for axis in AxisName::ALL {
            self.home_where_lost(axis).await?;
        }
        Ok(())
    }

    /// Homes an axis.
    pub(super) async fn home(&self, axis: AxisName) -> Result<(), JobEnd> {
        self.context.doing(format!("homing the {axis} axis"));
        self.context.unless_cancelled(self.motion.home(self.admission, axis)).await
    }

    /// Homes an axis whose place is not known.
    async fn home_where_lost(&self, axis: AxisName) -> Result<(), JobEnd> {
        if self.motion.position_mm(axis).is_ok() {
            return Ok(());
        }
        self.context.log(format!("where the {axis} axis stands is not known: it is homed"));
        self.home(axis).await
    }

    /// How far an axis stands from the nearer end of its travel, and how far it would have to for a first move of so much; all mm.
    /// `None` where it stands far enough away.
    pub(super) fn too_little_room_mm(&self, axis: AxisName, probe_mm: f64) -> Result<Option<(f64, f64)>, JobEnd> {
        let (at_mm, (low_mm, high_mm)) = (self.motion.position_mm(axis)?, self.motion.range_mm(axis));
        let (free, needed) = ((at_mm - low_mm).min(high_mm - at_mm), FREE_PROBES * probe_mm);
        Ok((free < needed).then_some((free, needed)))
    }

    /// Homes an axis that stands too near an end of its travel for a first move of so much (mm), which the job would end at
    /// once the operator has set everything up. An axis that homes towards the shell is left where it is, and so is one that
    /// takes it along.
    async fn home_where_cramped(&mut self, axis: AxisName, probe_mm: f64) -> Result<(), JobEnd> {
        let Some((free, needed)) = self.too_little_room_mm(axis, probe_mm)? else { return Ok(()) };
        let with_e = axis == AxisName::E || self.eye.bench().stage(axis).homes_also().is_some();
        if with_e && self.config.bench.e.home_side != Side::High {
            return Ok(());
        }
        self.context.log(format!(
            "the {axis} axis stands {free:.2} mm from an end of its travel, and its first move needs {needed:.2} mm free on both sides: it is homed"
        ));
        self.home(axis).await
    }

    /// Takes e back from where an earlier alignment left it nearer to the shell than it is to be parked, by homing: that
    /// way is the same whatever the axis's coordinate is like, and makes its zero new. So does it where e stands too near an
    /// end of its travel to be parked. An axis that homes on the shell's side is left where it is. One whose place is not known
    /// is homed, where no shell is in its way.
    pub(super) async fn withdraw_e(&mut self, plan: &Plan) -> Result<(), JobEnd> {
        self.home_where_lost(AxisName::E).await?;
        let nearer_mm = plan.mount_e_mm - self.motion.position_mm(AxisName::E)?;
        if nearer_mm.abs() <= plan.e_tolerance_mm {
            return Ok(());
        }
        if nearer_mm <= FOLLOWED_IN_AIR * plan.e_probe_mm || self.config.bench.e.home_side != Side::High {
            return self.home_where_cramped(AxisName::E, plan.e_probe_mm).await;
        }
        self.context.log(format!(
            "the e axis stands {nearer_mm:.3} mm nearer to the shell than where it is to be parked: it is homed"
        ));
        self.home(AxisName::E).await
    }

    /// Says something in the job's log and in its report.
    pub(super) fn note(&mut self, said: String) {
        self.context.log(said.clone());
        self.findings.notes.push(said);
    }

    /// Moves an axis to a reading, mm.
    pub(super) async fn go(&self, axis: AxisName, to_mm: f64) -> Result<(), JobEnd> {
        self.context.unless_cancelled(self.motion.go(self.admission, axis, Millimetres(to_mm))).await.map(drop)
    }

    /// [Asks](JobContext::ask) the operator to set something up, and keeps what stands before the lens then.
    pub(super) async fn ask(
        &self,
        name: &str,
        instruction: String,
        value: Option<String>,
        setup: Setup,
    ) -> Result<(), JobEnd> {
        let view = InView::after(&setup, self.eye.aimed().equivalent_distance);
        self.eye.see(view.map(|_| InView::Unknown));
        // After these the axes are homed, or are where the operator's hand has left them.
        let needs_places = !matches!(setup, Setup::Diffuser | Setup::LeastE { .. } | Setup::ShellOff);
        let asked = tokio::select! {
            asked = self.context.ask(name, instruction, value, setup) => asked,
            lost = self.lost(), if needs_places => Err(lost),
        };
        // Not confirmed, it is anything: no board that was asked for.
        self.eye.see(view.map(|view| if asked.is_ok() { view } else { InView::Other }));
        asked
    }

    /// Waits until an axis that is homed is so no more: nobody is to set up what the job can no longer use.
    async fn lost(&self) -> JobEnd {
        let gone = AxisName::ALL.map(|axis| {
            let mut state = self.eye.bench().stage(axis).state();
            Box::pin(async move {
                let homed = state.borrow().homed;
                if !homed || state.wait_for(|state| state.connected && !state.homed).await.is_err() {
                    std::future::pending::<()>().await;
                }
                axis
            })
        });
        let (axis, ..) = futures_util::future::select_all(gone).await;
        JobEnd::failed(format!(
            "where the {axis} axis stands was lost while the operator was at work: its controller was off, or its line"
        ))
    }

    /// Has another white frame taken where the one that there is fits no more.
    pub(super) async fn another_white_frame(&mut self) -> Result<(), JobEnd> {
        self.white_frame_asked_for("The white frame no longer fits what the camera shows as it is set now. ").await
    }

    pub(super) async fn white_frame(&mut self) -> Result<(), JobEnd> {
        self.white_frame_asked_for("").await
    }

    /// `why`: a sentence before what the operator is asked to do; empty where it explains itself.
    async fn white_frame_asked_for(&mut self, why: &str) -> Result<(), JobEnd> {
        let (mut tries, mut why) = (WHITE_TRIES, why);
        let found = loop {
            let instruction = format!(
                "{why}Put the diffuser on the lens, without the shell, and light it evenly: a white frame is taken."
            );
            why = "";
            self.ask("white_frame", instruction, None, Setup::Diffuser).await?;
            self.motion.set_shell(ShellState::Off);
            self.context.doing("white frame");
            tries -= 1;
            match self.context.unless_cancelled(self.eye.take_white()).await {
                // It may have hung since long before, and be of anything.
                Err(JobEnd::NotMeasured(NotMeasured::OldPicture)) if tries > 0 => self.context.once_more(OLD_WHITE),
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) if tries > 0 => {
                    self.context.once_more(&why);
                }
                found => break found?,
            }
        };
        self.context.log(found);
        let set = self.context.unless_cancelled(async { Ok::<_, JobEnd>(self.eye.camera_set().await) }).await?;
        if let Some(set) = set {
            self.context.log(format!("the camera is set to {set}"));
        }
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

    /// Whether what was `looked` at could not be measured because nothing can be seen, whatever the focus: it is dark, or far
    /// too bright. The step is to be asked for once more then. `before` counts how often it was why, and after
    /// [`DARK_TRIES`] it is the job's end.
    pub(super) async fn was_dark<T>(&self, looked: &Result<T, JobEnd>, before: &mut u32) -> Result<bool, JobEnd> {
        if !matches!(looked, Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { .. }))) {
            return Ok(false);
        }
        match self.context.unless_cancelled(self.eye.check_light()).await {
            Ok(()) => Ok(false),
            Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) if *before < DARK_TRIES => {
                *before += 1;
                self.context.once_more(&why);
                Ok(true)
            }
            Err(end) => Err(end),
        }
    }

    /// Has boards put up in air, with the shell off.
    pub(super) async fn place(&mut self, boards: AirBoards) -> Result<(), JobEnd> {
        match boards {
            AirBoards::Levels(levels) => {
                let instruction = format!(
                    "Take the diffuser off if it is on. With the shell off, in air, put the triple-level board's levels at {}.",
                    self.board_place(&levels)
                );
                let value = format!("{:.1}, {:.1}, {:.1} mm", levels[0], levels[1], levels[2]);
                self.ask("triple_board_in_air", instruction, Some(value), boards.setup()).await?;
            }
            AirBoards::Flat(distance_mm) => {
                let instruction = format!(
                    "Take the diffuser off if it is on. With the shell off, in air, put a flat board {}.",
                    self.board_place(&[distance_mm])
                );
                self.ask("board_in_air", instruction, Some(format!("{distance_mm:.1} mm")), boards.setup()).await?;
            }
        }
        self.motion.set_shell(ShellState::Off);
        Ok(())
    }

    /// How an alignment that aims at a solution is led, with the shell mounted at e (mm) or nearer.
    pub(super) fn plan(&self, solution: Solution, mount_e_mm: f64) -> Plan {
        let travel = self.motion.travel(self.config);
        Plan::new(self.config, solution, self.motion.l_bound_mm(), mount_e_mm).within(travel)
    }

    /// The [sound plan](Self::sound_plan) of the joint solution for l_bound as it is known.
    pub(super) fn joint_plan(&self) -> Result<Plan, JobEnd> {
        self.sound_plan(self.design.joint(self.motion.l_bound_mm()), self.config.assembly.initial_e_mm)
    }

    /// What the homing that a job begins with would be refused for, before another axis has been homed.
    fn homes_towards_shell(&self) -> Option<Obstacle> {
        if self.motion.position_mm(AxisName::E).is_ok() {
            return None;
        }
        match self.motion.check_home(AxisName::E) {
            Err(ServiceError::Refused(Refusal::HomingTowardsShell { shell, .. })) => {
                Some(Obstacle::homes_towards_shell(shell))
            }
            _ => None,
        }
    }

    /// A [plan](Self::plan), said, and refused where something stands in its way: before anything moves or the operator is asked.
    pub(super) fn sound_plan(&self, solution: Solution, mount_e_mm: f64) -> Result<Plan, JobEnd> {
        let plan = self.plan(solution, mount_e_mm);
        // The job's log has said where the design comes from.
        let view = plan.view(self.config, String::new());
        let kind = self.context.snapshot().kind;
        let held = view.by_budget.filter(|_| kind == JobKind::ClarityOnly);
        let held = held.and_then(|expected| plan.held_too_near(expected));
        let obstacles = view.obstacles.iter().cloned().chain(held).chain(self.homes_towards_shell());
        let said: Vec<String> = obstacles.map(|obstacle| obstacle.to_string()).collect();
        if !said.is_empty() {
            return Err(JobEnd::failed(format!("this cannot be aligned as it is configured: {}", said.join("; "))));
        }
        self.context.log(view.summary());
        self.context.expect(plan.operator_steps(kind, self.config));
        Ok(plan)
    }
}
