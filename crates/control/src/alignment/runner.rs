//! The one task that drives a job: runs it, stops the axes whatever the end, and writes its report.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use futures_util::FutureExt as _;

use super::{Alignment, Findings, report};
use crate::clock::{Part, enter};
use crate::job::{JobKind, JobState, word};
use crate::measuring::eye::Eye;
use crate::motion::{Admission, Motion};
use crate::running::context::JobContext;
use crate::running::end::JobEnd;
use bench::config::Config;
use bench::device::AxisName;
use bench::telemetry;

/// How long reading one axis's position at the end may take.
const READ_ALLOWED: Duration = Duration::from_secs(1);

/// Runs a job to its end.
pub(crate) async fn run(
    context: &JobContext,
    motion: &Motion,
    admission: &Admission,
    eye: &Eye,
    config: &Arc<Config>,
    design_origin: &str,
) {
    context.begin(usual_steps(context.snapshot().kind));
    if context.snapshot().simulated {
        context.log("SIMULATED bench: no real device is driven");
    }
    context.log(format!("design: {design_origin}"));
    let mut alignment = Alignment {
        context,
        motion,
        admission,
        eye,
        config,
        design: config.design(),
        findings: Findings::default(),
        aperture_set: false,
    };
    let ended = alignment.carry_out().await;
    let kind = context.snapshot().kind;
    let findings = alignment.findings;
    let mut astray = None;
    let (state, reason) = match ended {
        // Whatever a device says of a motion that a stop has cut short, it was the stop.
        Err(JobEnd::Failed { .. } | JobEnd::NotMeasured(_) | JobEnd::NotFollowed(_)) if motion.stop_view().latched => {
            (JobState::Cancelled, context.cancelled_why().unwrap_or_else(|| "stopped".to_owned()))
        }
        Ok(()) => done(kind),
        // A stop cancels the job that it cuts short, but what was asked before it is why the job ends.
        Err(JobEnd::Cancelled { why }) => (JobState::Cancelled, context.cancelled_why().unwrap_or(why)),
        Err(JobEnd::NotConverged { why }) => (JobState::NotConverged, why),
        Err(end) => {
            if let JobEnd::NotFollowed(fault) = &end {
                astray = fault.is_astray().then(|| fault.axis());
            }
            (JobState::Failed, end.why())
        }
    };
    let good = matches!(state, JobState::Converged | JobState::Succeeded);
    bring_to_rest(context, motion, !good).await;
    let report = is_alignment(kind)
        .then(|| report::report(context, motion, eye, config, design_origin, &findings, astray, state, &reason));
    // No rule may go by its reading from here on.
    if let Some(axis) = astray {
        motion.forget_position(axis);
        context.log(format!("the {axis} axis is not where it reads: its position is unknown until it is homed"));
    }
    if let Some(told) = findings.e_told {
        motion.set_e_told(told);
    }
    context.log(if reason == state.to_string() { reason.clone() } else { format!("{state}: {reason}") });
    telemetry::job_ended(&word(&kind), &state.to_string());
    context.end(state, reason, report).await;
}

/// Ends a job whose task has failed: the axes are stopped, and whoever looks learns why.
pub(crate) async fn break_off(context: &JobContext, motion: &Motion, why: String) {
    tracing::error!(%why, "a job's task has failed");
    // Another failure here must not keep the job from its end.
    let stopped = AssertUnwindSafe(motion.halt()).catch_unwind().await;
    match stopped {
        Ok(stopped) => context.log(format!("focus axis: {}; e axis: {}", stopped.focus, stopped.e)),
        Err(_) => context.log("the axes could not be told to stop"),
    }
    if !context.snapshot().state.is_final() {
        telemetry::job_ended(&word(&context.snapshot().kind), &JobState::Failed.to_string());
        context.end(JobState::Failed, why, None).await;
    }
}

/// So many steps a job of a kind usually has, for the progress bar; what can be counted beforehand is when it begins.
fn usual_steps(kind: JobKind) -> u32 {
    match kind {
        JobKind::JointAlignment | JobKind::ClarityOnly => 22,
        JobKind::AirOnly | JobKind::ShellOnly => 12,
        JobKind::LBoundMeasurement => 8,
        JobKind::Calibration => 5,
        JobKind::FocusSweep | JobKind::SpacingWatch | JobKind::Homing => 1,
    }
}

/// Whether a kind of job is an alignment, or a step of one, with a criterion to meet.
fn is_alignment(kind: JobKind) -> bool {
    matches!(kind, JobKind::JointAlignment | JobKind::AirOnly | JobKind::ShellOnly | JobKind::ClarityOnly)
}

/// How a job of a kind ends when all went well.
fn done(kind: JobKind) -> (JobState, String) {
    match kind {
        JobKind::AirOnly => (JobState::Converged, "Δv is within its tolerance, verified".to_owned()),
        _ if is_alignment(kind) => (JobState::Converged, "the spacing meets its target, verified".to_owned()),
        _ => (JobState::Succeeded, "done".to_owned()),
    }
}

/// Stops the axes and reads where they are. After a converged job they stand still already: only an axis that says
/// otherwise is stopped, because a stop may cost the position.
async fn bring_to_rest(context: &JobContext, motion: &Motion, stop_always: bool) {
    let _moving = enter(Part::Motion);
    let mut stop = stop_always;
    if !stop {
        for axis in AxisName::ALL {
            let read = tokio::time::timeout(READ_ALLOWED, motion.read_state(axis)).await;
            stop |= !matches!(read, Ok(Ok(state)) if !state.moving);
        }
    }
    // At once after a step that was given up: what it had ordered must not begin any more.
    if stop {
        let stopped = motion.halt().await;
        context.log(format!("focus axis: {}; e axis: {}", stopped.focus, stopped.e));
    }
    for axis in AxisName::ALL {
        match tokio::time::timeout(READ_ALLOWED, motion.read_state(axis)).await {
            Ok(Ok(state)) if state.homed => context.log(format!("the {axis} axis stands at {:.3}", state.position)),
            Ok(Ok(_)) => context.log(format!("the {axis} axis's position is unknown until it is homed")),
            Ok(Err(error)) => context.log(format!("the {axis} axis's position could not be read: {error}")),
            Err(_) => context.log(format!("the {axis} axis did not say where it stands")),
        }
    }
}
