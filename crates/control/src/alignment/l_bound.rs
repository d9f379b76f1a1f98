//! Measuring l_bound, the least e that the lens's barrel allows, with the shell on.

use super::report::evidence;
use super::{Alignment, VERIFY_FRAMES};
use crate::budget::{Evidence, e_axis};
use crate::events::ShellState;
use crate::job::Stage;
use crate::loops::room::Contact;
use crate::loops::shell::ShellObservation;
use crate::measuring::eye::Seen;
use crate::running::end::JobEnd;
use bench::config::Config;
use bench::device::{AxisName, Setup};

/// An axis that is uncertain by so much says nothing, mm.
const UNTOLD_MM: f64 = 100.0;

impl Alignment<'_> {
    /// l_bound by Eqs. 9–12: d and b in air, then the spacing with the lens pushed by hand to the least e. Δv is brought
    /// first to where the configured l_bound would have it: at the Δv of the air design the spacing changes by 0.017
    /// px/mm of e only, there by ten times as much.
    pub(crate) async fn measure_l_bound(&mut self) -> Result<(), JobEnd> {
        self.context.stage(Stage::LBound);
        let mut plan = self.plan(self.design.joint(self.config.assembly.l_bound_mm), self.config.assembly.initial_e_mm);
        self.findings.solution = Some(plan.solution);
        self.air(&mut plan).await?;
        let Some(camera) = self.findings.camera else {
            return Err(JobEnd::failed("l_bound needs the calibration in air"));
        };
        // An axis that is let go of may take what the air step left with it.
        let in_air = evidence(self.eye, &self.findings, camera.window_px.unwrap_or_default());
        self.context.unless_cancelled(self.motion.release(self.admission, AxisName::E)).await?;
        // Its Δv is for the l_bound that was configured: nothing is to go on from it.
        self.eye.forget_air_step();
        let distance_mm = self.config.object.distance_mm;
        let instruction = format!(
            "The e axis's motor is off. Mount the shell, fill the tank, put the flat board {distance_mm:.1} mm from the shell's outer vertex, and push the camera by hand as near to the shell as the lens's barrel allows."
        );
        self.motion.shell_may_be_on();
        let value = Some(format!("{distance_mm:.1} mm"));
        self.ask("least_e_by_hand", instruction, value, Setup::LeastE { distance_mm }).await?;
        self.motion.set_shell(ShellState::On);
        self.context.doing("l_bound: measuring the spacing");
        let seen = self.context.unless_cancelled(self.eye.spacing(VERIFY_FRAMES, None)).await?;
        let least_e = camera.e_mm(seen.spacing.spacing_px, 0.0);
        let sigma = camera.e_sigma_mm(least_e, 0.0, seen.spacing.spacing_sigma_px);
        if !least_e.is_finite() || !sigma.is_finite() {
            return Err(JobEnd::failed(format!(
                "a spacing of {:.3} px gives no l_bound: shell, water or board are not what is configured",
                seen.spacing.spacing_px
            )));
        }
        let clearance = self.config.assembly.clearance_mm.max(3.0 * sigma);
        let (l_bound_mm, wall_mm) = (least_e + clearance, self.config.assembly.e_wall_mm(least_e + clearance));
        let (_, highest_mm) = self.motion.travel(self.config).e_mm;
        if wall_mm >= highest_mm {
            return Err(JobEnd::failed(format!(
                "an l_bound of {l_bound_mm:.2} mm was measured, which puts the e wall at {wall_mm:.2} mm, beyond the e axis's travel to {highest_mm} mm: shell, water or board are not what is configured, or the axis is too short"
            )));
        }
        let told = in_air.and_then(|in_air| self.contact_sigma_mm(in_air, least_e, &seen));
        let contact_sigma = told.ok_or_else(|| {
            JobEnd::failed("how well it is known where the lens touches cannot be told: the boards in air could not be told apart, or fit no camera like the configured one")
        })?;
        self.motion.set_l_bound(l_bound_mm, Contact { e_mm: least_e, measured_sigma_mm: Some(contact_sigma) });
        self.findings.l_bound_sigma_mm = Some(contact_sigma);
        // No minus before nothing.
        let said_mm = (100.0 * l_bound_mm).round() / 100.0 + 0.0;
        let note = format!(
            "l_bound: the lens touches at e = {least_e:.2} ± {contact_sigma:.2} mm, by the spacing alone ± {sigma:.2} mm (it changes by {:.3} px/mm there); with {clearance:.2} mm of clearance l_bound = {:.2} mm",
            camera.slope_e(least_e, 0.0).abs(),
            said_mm
        );
        self.note(note);
        // A controller that can switch off all of its motors only has lost the other axis, too.
        let focus_homed = self.context.unless_cancelled(self.motion.read_state(AxisName::Focus)).await?.homed;
        let homed_again = if focus_homed { "the e axis is" } else { "the focus axis and the e axis are" };
        let instruction = format!("Take the shell off and the tank away; {homed_again} homed again.");
        self.ask("shell_off", instruction, None, Setup::ShellOff).await?;
        self.motion.set_shell(ShellState::Off);
        for axis in AxisName::ALL {
            if !self.context.unless_cancelled(self.motion.read_state(axis)).await?.homed {
                self.context.log(format!("the {axis} axis lost its place while its motor was off: it is homed"));
                self.home(axis).await?;
            }
        }
        self.findings.delta_v_air = None;
        // For another solution from now on.
        self.aperture_set = false;
        Ok(())
    }

    /// Standard uncertainty (mm) of where the lens touches, with all that is taken for granted: the picture has told it, and no
    /// axis. `None` where what was seen fits nothing.
    fn contact_sigma_mm(&self, in_air: Evidence, least_e: f64, seen: &Seen) -> Option<f64> {
        let mut config = Config::clone(self.config);
        config.bench.e.zero_uncertainty_mm = UNTOLD_MM;
        let pose = ShellObservation {
            e_reading_mm: least_e,
            trim_mm: 0.0,
            spacing_px: seen.spacing.spacing_px,
            sigma_px: seen.spacing.spacing_sigma_px,
            sigma_random_px: seen.sigma_random_px,
        };
        let seen = Evidence { shell: vec![pose], window_px: seen.window_px, ..in_air };
        Some(e_axis(&config, &seen)?.by_all.predict(least_e).1)
    }
}
