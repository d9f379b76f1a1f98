//! The shell step: shell on, tank filled, the moves of [`crate::loops::shell`] carried out.

use std::time::Duration;

use super::report::{MOVED_MM, evidence};
use super::{Alignment, MAX_MEASUREMENTS, VERIFY_FRAMES};
use crate::budget::e_axis;
use crate::events::ShellState;
use crate::job::IterationKind;
use crate::loops::axis_model::MoveFault;
use crate::loops::mistake::ShellLook;
use crate::loops::room::{Contact, Room};
use crate::loops::shell::{ShellDecision, ShellLoop, ShellObservation};
use crate::measuring::eye::Seen;
use crate::measuring::not_measured::NotMeasured;
use crate::plan::Plan;
use crate::running::end::JobEnd;
use bench::config::ShellStep;
use bench::device::{AxisName, Setup};

/// Between two looks at whether the picture stands still: longer than an axis rests between two pieces of its way, so
/// that a carriage a second late is seen to move.
const CREEP_LOOK: Duration = Duration::from_millis(600);
/// How often it is looked again, and how many standard uncertainties of their difference two spacings of one place may be
/// apart.
const CREEP_LOOKS: u32 = 8;
const CREEP_SIGMAS: f64 = 4.0;
/// An axis that stops short this near to where the lens touches may have been kept by the shell, mm.
const NEAR_SHELL_MM: f64 = 1.0;

impl Alignment<'_> {
    /// Has the shell mounted, the tank filled and the board put up in it.
    async fn ask_for_shell(&self) -> Result<(), JobEnd> {
        let distance_mm = self.config.object.distance_mm;
        let instruction = format!(
            "Take the diffuser off if it is on. Mount the shell, fill the tank, and put the flat board {distance_mm:.1} mm from the shell's outer vertex."
        );
        let value = Some(format!("{distance_mm:.1} mm"));
        self.ask("shell_and_water", instruction, value, Setup::WaterBoard { distance_mm }).await?;
        self.motion.set_shell(ShellState::On);
        Ok(())
    }

    pub(crate) async fn shell(&mut self, plan: &Plan, step: ShellStep) -> Result<(), JobEnd> {
        let Some(camera) = self.findings.camera else {
            return Err(JobEnd::failed("the shell step needs the air step's calibration"));
        };
        let here_mm = self.motion.position_mm(AxisName::Focus)?;
        let focus_at_air = self.eye.air_step().map_or(here_mm, |air| air.focus_mm);
        if (here_mm - focus_at_air).abs() > MOVED_MM {
            self.context.log(format!(
                "the focus axis stands at {here_mm:.4} mm: it goes back to {focus_at_air:.4} mm, where the air step left it"
            ));
            self.go(AxisName::Focus, focus_at_air).await?;
        }
        self.motion.shell_may_be_on();
        self.findings.shell_step_done = Some("ended before anything was measured through the shell".to_owned());
        self.ask_for_shell().await?;
        let _watched = self.motion.watch_e();
        self.eye.aim_at(plan.solution.e);
        let axis = &self.config.bench.e;
        let (mut first_look, mut dark, mut led) = (true, 0, None);
        let in_air = self.findings.seen.clone();
        let mut shell = ShellLoop::new(plan.shell_goal(self.eye.target_px(), step), camera);
        let (mut kind, mut predicted, mut frames, mut moved) = (IterationKind::Start, None, 1, AxisName::E);
        for _ in 0..MAX_MEASUREMENTS {
            self.context.doing(format!("shell: measuring the spacing ({})", kind.word()));
            let e_reading_mm = self.motion.position_mm(AxisName::E)?;
            let focus_scale = self.findings.focus_scale.unwrap_or(1.0);
            let trim_mm = (self.motion.position_mm(AxisName::Focus)? - focus_at_air) * focus_scale;
            let seen = self.spacing_at_rest(kind, frames).await;
            let look = ShellLook { camera: &camera, axis, e_mm: e_reading_mm, trim_mm, trim_bound_mm: 0.0 };
            if first_look && self.was_dark(&seen, &mut dark).await? {
                self.ask_for_shell().await?;
                continue;
            }
            let seen = match seen {
                Err(JobEnd::NotMeasured(NotMeasured::Unmeasurable { why })) if first_look => {
                    if let Some(named) = led {
                        return Err(self.contradicted(named));
                    }
                    led = Some(self.look_through_shell(&look, plan, why).await?);
                    continue;
                }
                seen => seen?,
            };
            // Before anything moves on the strength of it.
            if std::mem::take(&mut first_look)
                && let Some(why) = look.contradiction(&seen.spacing)
            {
                return Err(self.contradicted(why));
            }
            if let Some(picture) = &seen.picture {
                // The first stays; of the others the last.
                self.context.keep_picture(if self.findings.eog_before.is_none() { "before" } else { "after" }, picture);
            }
            if self.findings.eog_before.is_none() {
                self.findings.eog_before = seen.eog;
            }
            self.findings.eog_after = seen.eog;
            self.findings.tilt_change = in_air.as_ref().map(|in_air| seen.tilt_change_since(in_air));
            let observation = ShellObservation {
                e_reading_mm,
                trim_mm,
                spacing_px: seen.spacing.spacing_px,
                sigma_px: seen.spacing.spacing_sigma_px,
                sigma_random_px: seen.sigma_random_px,
            };
            let decision = shell.next(observation, |here| self.room(here, seen.window_px));
            self.keep_shell(&shell, &seen, (e_reading_mm, trim_mm), &decision);
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
                    self.context.doing(format!("shell: trimming Δv by {by_mm:+.4} mm"));
                    self.go(AxisName::Focus, to).await?;
                }
                ShellDecision::MoreFrames => (kind, predicted) = (IterationKind::Verify, None),
                ShellDecision::Verify => (kind, predicted, frames) = (IterationKind::Verify, None, VERIFY_FRAMES),
                ShellDecision::Done => {
                    self.keep_shell_done(&shell, step);
                    self.note_turned_board(&look, in_air.as_ref(), &seen);
                    self.note_held_off(&shell);
                    return Ok(());
                }
                ShellDecision::NotConverged { why } => return Err(JobEnd::NotConverged { why }),
                ShellDecision::Fault(fault) => {
                    self.note_touching(&fault, &shell);
                    return Err(fault.into());
                }
            }
        }
        Err(JobEnd::failed("the shell loop did not end; this is a defect of the program"))
    }

    /// The room between lens and shell, with what was measured at this pose. `None` where what was seen is not enough to say.
    fn room(&self, here: ShellObservation, window_px: f64) -> Option<Room> {
        let mut seen = evidence(self.eye, &self.findings, window_px)?;
        here.put_after(&mut seen.shell);
        Some(Room { contact: self.motion.contact(), e: e_axis(self.config, &seen)? })
    }

    /// How the job ends where the picture is not what the configuration says, in words: nobody is to move anything by it either.
    pub(super) fn contradicted(&self, why: String) -> JobEnd {
        self.eye.contradict(&why);
        JobEnd::failed(why)
    }

    /// The spacing over so many frames, after a move once the picture stands still: a controller may say that an axis
    /// stands while its carriage creeps on, and what is decided near the shell would be of where it no longer is.
    async fn spacing_at_rest(&self, kind: IterationKind, frames: u32) -> Result<Seen, JobEnd> {
        if !matches!(kind, IterationKind::Probe | IterationKind::Move) {
            return self.context.unless_cancelled(self.eye.spacing(frames, None)).await;
        }
        let mut before = self.context.unless_cancelled(self.eye.glance(frames)).await?;
        for _ in 0..CREEP_LOOKS {
            let pause = async {
                tokio::time::sleep(CREEP_LOOK).await;
                Ok::<(), JobEnd>(())
            };
            self.context.unless_cancelled(pause).await?;
            let seen = self.context.unless_cancelled(self.eye.spacing(frames, Some(before.spacing_px))).await?;
            let sigma = before.spacing_sigma_px.hypot(seen.spacing.spacing_sigma_px);
            if (before.spacing_px - seen.spacing.spacing_px).abs() <= CREEP_SIGMAS * sigma {
                return Ok(seen);
            }
            before = seen.spacing;
            self.context.log("the picture still changes after the move: the axis creeps on, though its controller says that it stands");
        }
        Err(JobEnd::failed(
            "the picture does not come to rest after a move: the axis creeps on, though its controller says that it stands; check the coupling and the controller's settings",
        ))
    }

    /// Notes where the spacing's tilt says that a board is turned.
    fn note_turned_board(&mut self, look: &ShellLook<'_>, in_air: Option<&Seen>, seen: &Seen) {
        let half_width_mm = self.config.sensor_extent().width / 2.0;
        let turned = in_air.and_then(|in_air| look.turned_board(&seen.tilt_change_since(in_air), half_width_mm));
        if let Some(turned) = turned {
            self.note(turned);
        }
    }

    /// Notes where an axis that went less far than it was sent may have been kept by the shell.
    fn note_touching(&mut self, fault: &MoveFault, shell: &ShellLoop) {
        let (Some(camera), Some(here)) = (self.findings.camera, shell.here()) else { return };
        let e_mm = camera.e_mm(here.spacing_px, here.trim_mm);
        let sigma_mm = camera.e_sigma_mm(e_mm, here.trim_mm, here.sigma_px);
        let left_mm = e_mm - self.motion.contact().e_mm;
        if fault.axis() == AxisName::E && fault.is_short() && left_mm < NEAR_SHELL_MM + 3.0 * sigma_mm {
            self.note(format!(
                "the lens may stand against the shell: by the picture e is {e_mm:.2} ± {sigma_mm:.2} mm, and it touches at {:.2} mm; look before anything is moved",
                self.motion.contact().e_mm
            ));
        }
    }

    /// Notes where e is further from the shell than wanted.
    fn note_held_off(&mut self, shell: &ShellLoop) {
        let (Some(room), Some(wanted)) = (shell.room().filter(|_| shell.held_off()), self.findings.solution) else {
            return;
        };
        let Some(here) = shell.here() else { return };
        let (e_mm, _) = room.e.by_all.predict(here.e_reading_mm);
        let (nearest_mm, sigma_mm) = room.nearest_e(here.e_reading_mm);
        let touches = match room.contact {
            Contact { e_mm, measured_sigma_mm: None } => {
                format!("three of those have to lie between the lens and where it touches the shell, e = {e_mm:.2} mm")
            }
            Contact { e_mm, measured_sigma_mm: Some(measured_mm) } => format!(
                "the lens touches the shell at e = {e_mm:.2} ± {measured_mm:.2} mm, as was measured: three times both together, {:.2} mm, have to lie between",
                3.0 * room.contact.distance_sigma_mm(sigma_mm)
            ),
        };
        self.note(format!(
            "e is {e_mm:.2} mm and not {:.2} mm: as picture or axis has it, whichever is nearer, it is {nearest_mm:.2} ± {sigma_mm:.2} mm, and {touches}; the largest parts of the budget say what would bring it nearer",
            wanted.e
        ));
    }

    async fn move_e(&self, to_mm: f64) -> Result<(), JobEnd> {
        self.context.doing(format!("shell: e axis to {to_mm:.3} mm"));
        self.go(AxisName::E, to_mm).await
    }
}
