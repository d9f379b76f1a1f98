//! What an alignment keeps of every measurement: an iteration for whoever watches, and the findings for the report.

use super::Alignment;
use crate::job::{Iteration, IterationKind, Stage};
use crate::loops::air::{AirDecision, AirObservation};
use crate::loops::shell::{ShellDecision, ShellLoop};
use crate::measuring::eye::Seen;
use bench::config::ShellStep;
use bench::device::AxisName;

impl Alignment<'_> {
    pub(crate) fn record_air(
        &self,
        kind: IterationKind,
        seen: &Seen,
        here: AirObservation,
        predicted: Option<f64>,
        decision: &AirDecision,
    ) {
        let decision = match decision {
            AirDecision::Probe { to_mm } => format!("probe: focus axis to {to_mm:.4} mm"),
            AirDecision::Move { to_mm } => format!("move the focus axis to {to_mm:.4} mm"),
            AirDecision::MoreFrames => "measure again here: not certain enough".to_owned(),
            AirDecision::Verify => "within tolerance: measure again to verify".to_owned(),
            AirDecision::Done => "within tolerance, verified".to_owned(),
            AirDecision::TooUncertain { why } | AirDecision::NotConverged { why } => format!("not converged: {why}"),
            AirDecision::Fault(fault) => fault.to_string(),
        };
        self.context.record(Iteration {
            delta_v_mm: Some(here.delta_v_mm),
            delta_v_sigma_mm: Some(here.sigma_mm),
            delta_v_target_mm: self.findings.solution.map(|solution| solution.delta_v),
            e_estimate_mm: None,
            e_estimate_sigma_mm: None,
            spacing_predicted_px: predicted,
            ..self.iteration(Stage::Air, kind, AxisName::Focus, seen, decision)
        });
    }

    pub(crate) fn iteration(
        &self,
        stage: Stage,
        kind: IterationKind,
        axis: AxisName,
        seen: &Seen,
        decision: String,
    ) -> Iteration {
        let moved = matches!(kind, IterationKind::Probe | IterationKind::Move);
        Iteration {
            number: 0,
            stage,
            kind,
            axis: moved.then_some(axis),
            focus_mm: seen.focus_mm,
            e_mm: seen.e_mm,
            delta_v_mm: None,
            delta_v_sigma_mm: None,
            delta_v_target_mm: None,
            e_estimate_mm: None,
            e_estimate_sigma_mm: None,
            spacing: seen.spacing.clone(),
            spacing_predicted_px: None,
            spacing_target_px: seen.target_px,
            eog: seen.eog,
            decision,
            discarded: false,
            at: jiff::Timestamp::now(),
        }
    }

    /// Keeps what was measured, and where e is by it: nowhere that is known where the picture contradicts the axis.
    pub(crate) fn keep_shell(
        &mut self,
        shell: &ShellLoop,
        seen: &Seen,
        (e_reading_mm, trim_mm): (f64, f64),
        decision: &ShellDecision,
    ) {
        let findings = &mut self.findings;
        if let Some(here) = shell.here() {
            here.put_after(&mut findings.through_shell);
        }
        findings.moves_shell = shell.moves();
        let lost = matches!(decision, ShellDecision::Fault(fault) if fault.axis() == AxisName::E);
        findings.e_told = if lost { shell.when_homed() } else { shell.told() };
        findings.e = (!lost).then(|| shell.model().predict(e_reading_mm));
        findings.e_scale = shell.scale();
        findings.trim_mm = trim_mm;
        findings.seen = Some(seen.clone());
        findings.shell_step_done = Some("ended before the spacing was verified to meet its target".to_owned());
    }

    /// Keeps how the shell step has met its criterion, once it has.
    pub(crate) fn keep_shell_done(&mut self, shell: &ShellLoop, step: ShellStep) {
        let how = match (step, shell.trimmed()) {
            (_, true) => {
                let at = match (shell.held_off(), shell.walled_off()) {
                    (true, _) => "where it is known to be clear of the shell",
                    (false, true) => "at the wall, further from the shell than wanted",
                    (false, false) => "at its optimum",
                };
                let trim_mm = self.findings.trim_mm;
                format!("e held {at}, Δv trimmed by {trim_mm:+.4} mm (Eq. 8 with e fixed)")
            }
            (ShellStep::HoldETrim, false) => "e moved to its optimum; no trim of Δv was needed".to_owned(),
            (_, false) => "e translated until the spacing met its target".to_owned(),
        };
        self.findings.shell_step_done = Some(how);
    }

    pub(crate) fn record_shell(
        &self,
        kind: IterationKind,
        moved: AxisName,
        seen: &Seen,
        predicted: Option<f64>,
        decision: &ShellDecision,
    ) {
        let decision = match decision {
            ShellDecision::ProbeE { to_mm } => format!("probe: e axis to {to_mm:.3} mm"),
            ShellDecision::MoveE { to_mm, .. } => format!("move the e axis to {to_mm:.3} mm"),
            ShellDecision::Trim { by_mm, .. } => format!("hold e, trim Δv by {by_mm:+.4} mm"),
            ShellDecision::MoreFrames => "measure again here: not certain enough".to_owned(),
            ShellDecision::Verify => "the criterion is met: measure again to verify".to_owned(),
            ShellDecision::Done => "the criterion is met, verified".to_owned(),
            ShellDecision::NotConverged { why } => format!("not converged: {why}"),
            ShellDecision::Fault(fault) => fault.to_string(),
        };
        let (e, e_sigma) = self.findings.e.unzip();
        let delta_v = self.findings.delta_v_air.map(|(delta_v, sigma)| (delta_v + self.findings.trim_mm, sigma));
        self.context.record(Iteration {
            delta_v_mm: delta_v.map(|(value, _)| value),
            delta_v_sigma_mm: delta_v.map(|(_, sigma)| sigma),
            e_estimate_mm: e,
            e_estimate_sigma_mm: e_sigma,
            spacing_predicted_px: predicted,
            ..self.iteration(Stage::Shell, kind, moved, seen, decision)
        });
    }
}
