//! What a person moves by hand: moves, homing and jogs of one axis, and the statement about the shell.

use std::collections::HashMap;
use std::panic::AssertUnwindSafe;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::Duration;

use futures_util::FutureExt as _;

use super::Service;
use crate::events::{BenchView, InView, ShellState};
use crate::motion::lease::Permit;
use crate::motion::{Admission, Claim};
use crate::{Acceptance, Refusal, ServiceError};
use bench::config::Side;
use bench::device::jog::{Grip, deadman};
use bench::device::{AxisName, DeviceError, StopDelivery};
use plenoptics::units::Millimetres;

/// How long a jog goes on from a request.
const JOG_HOLD: Duration = Duration::from_millis(300);

/// Why a command by hand did not end as commanded.
pub(super) struct Failure {
    pub(super) why: String,
    /// Whether a stop was why.
    stopped: bool,
}

impl From<ServiceError> for Failure {
    fn from(error: ServiceError) -> Self {
        let stopped = matches!(
            error,
            ServiceError::Refused(Refusal::Stopped) | ServiceError::Device(DeviceError::Stopped { .. })
        );
        Self { why: error.to_string(), stopped }
    }
}

/// A jog under way.
pub(super) struct Jogging {
    admission: Admission,
    towards: Side,
    speed: f64,
    grip: Grip,
}

impl Service {
    pub(super) fn failures(&self) -> MutexGuard<'_, HashMap<AxisName, Failure>> {
        self.failures.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// That a stop ended a command is no news once the stop has been reset: whoever did so has seen to it.
    pub(super) fn forget_stopped(&self) {
        self.failures().retain(|_, failure| !failure.stopped);
    }

    /// Carries a command by hand out in a task of its own, which holds its claim to the end.
    fn carry_out_by_hand(
        self: &Arc<Self>,
        claim: Claim,
        command: impl Future<Output = Result<(), ServiceError>> + Send + 'static,
    ) {
        for axis in claim.axes() {
            self.failures().remove(&axis);
        }
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let failure = match AssertUnwindSafe(command).catch_unwind().await {
                Ok(ended) => ended.err().map(Failure::from),
                Err(panic) => {
                    // Nobody watches what the axis does now.
                    service.motion.stop_axis(claim.axis()).await;
                    Some(Failure { why: broken(&*panic), stopped: false })
                }
            };
            service.ended_by_hand(claim, failure);
        });
    }

    /// Keeps how a command by hand ended, then gives the axis free: whoever finds it free knows how.
    fn ended_by_hand(&self, claim: Claim, failure: Option<Failure>) {
        let axis = claim.axis();
        if let Some(failure) = failure {
            tracing::warn!(%axis, failure = failure.why, "a command by hand did not end as commanded");
            self.failures().insert(axis, failure);
        }
        drop(claim);
        self.publish_bench();
    }

    /// No job may hold the bench, and the program must not be ending.
    pub(super) fn free_for_hand(&self) -> Result<(), ServiceError> {
        self.open_for_motion()?;
        match self.current() {
            Some(job) => Err(Refusal::Busy { job: job.snapshot().id }.into()),
            None => Ok(()),
        }
    }

    /// Takes an axis for a command by hand. A job is looked for again once the axis is taken: one that began meanwhile
    /// either found the axis taken or is seen here.
    fn claim_for_hand(&self, admission: &Admission, axis: AxisName) -> Result<Claim, ServiceError> {
        self.free_for_hand()?;
        let claim = self.motion.claim(admission, axis)?;
        self.free_for_hand()?;
        Ok(claim)
    }

    /// Starts a move by hand; its end is seen in the events.
    ///
    /// # Errors
    /// Every motion rule, before anything moves.
    pub async fn move_axis(
        self: &Arc<Self>,
        permit: &Permit,
        axis: AxisName,
        target: Millimetres,
    ) -> Result<BenchView, ServiceError> {
        let admission = self.motion.admit(permit);
        self.history_ready().await?;
        let claim = self.claim_for_hand(&admission, axis)?;
        self.motion.check(axis, target)?;
        let (motion, held) = (Arc::clone(&self.motion), claim.clone());
        self.carry_out_by_hand(claim, async move { motion.go_claimed(&held, target).await.map(drop) });
        Ok(self.bench_view())
    }

    /// Starts homing an axis; its end is seen in the events.
    ///
    /// # Errors
    /// A refusal before anything moves.
    pub async fn home_axis(self: &Arc<Self>, permit: &Permit, axis: AxisName) -> Result<BenchView, ServiceError> {
        let admission = self.motion.admit(permit);
        self.history_ready().await?;
        self.free_for_hand()?;
        let claim = self.motion.claim_homing(&admission, axis)?;
        self.free_for_hand()?;
        self.motion.check_home(axis)?;
        let (motion, held) = (Arc::clone(&self.motion), claim.clone());
        self.carry_out_by_hand(claim, async move { motion.home_claimed(&held).await });
        Ok(self.bench_view())
    }

    /// Starts moving an axis off the limit switch at the side that its operator says is pressed; its end is seen in the
    /// events.
    ///
    /// # Errors
    /// A refusal before anything moves.
    pub async fn leave_switch(
        self: &Arc<Self>,
        permit: &Permit,
        axis: AxisName,
        pressed: Side,
    ) -> Result<BenchView, ServiceError> {
        let admission = self.motion.admit(permit);
        self.history_ready().await?;
        let claim = self.claim_for_hand(&admission, axis)?;
        self.motion.check_leave(axis, pressed)?;
        let (motion, held) = (Arc::clone(&self.motion), claim.clone());
        self.carry_out_by_hand(claim, async move { motion.leave_switch_claimed(&held, pressed).await });
        Ok(self.bench_view())
    }

    fn jogs(&self) -> MutexGuard<'_, HashMap<AxisName, Jogging>> {
        self.jogs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves an axis towards a side for 0.3 s from now on: asked again in time, it goes on. At the
    /// greatest speed at which the axis jogs where none is given, or a greater one. `press` tells one press of a button from the next.
    ///
    /// # Errors
    /// Every motion rule, before anything moves; a jog another way while one is under way; a press that is over.
    pub async fn jog(
        self: &Arc<Self>,
        permit: &Permit,
        axis: AxisName,
        towards: Side,
        speed_mm_per_s: Option<f64>,
        press: Option<&str>,
    ) -> Result<(BenchView, Acceptance), ServiceError> {
        let admission = self.motion.admit(permit);
        // As of when it was asked: a press that a stop has overtaken is over, however late it is heard of.
        self.presses.go_on(axis, press, admission.turns())?;
        let greatest = self.motion.axis(axis).speed_mm_per_s;
        let speed = speed_mm_per_s.unwrap_or(greatest);
        if speed.is_nan() || speed <= 0.0 {
            let what = format!("{speed} is not above 0");
            return Err(ServiceError::Invalid { field: "speed_mm_per_s", what });
        }
        if speed > greatest {
            return Err(Refusal::Speed { axis, speed, max: greatest }.into());
        }
        if self.renew_jog(&admission, axis, towards, speed, press)? {
            return Ok((self.bench_view(), Acceptance::Before));
        }
        self.history_ready().await?;
        let mut jogs = self.jogs();
        // The disk took its time, in which the button may have been let go, or a stop have come and been reset.
        self.presses.go_on(axis, press, self.motion.turns())?;
        let claim = self.claim_for_hand(&admission, axis)?;
        self.motion.jog_end(axis, towards)?;
        self.presses.moves(axis, press);
        let (grip, deadman) = deadman(JOG_HOLD);
        jogs.insert(axis, Jogging { admission, towards, speed, grip });
        drop(jogs);
        let (service, held) = (Arc::clone(self), claim.clone());
        self.carry_out_by_hand(claim, async move {
            let ended = service.motion.jog_claimed(&held, towards, speed, deadman).await;
            service.jogs().remove(&axis);
            ended.map(drop)
        });
        Ok((self.bench_view(), Acceptance::Now))
    }

    /// Has a jog that is under way go on, where it began under the same lease and no stop has come since; the disk is
    /// not waited for. Returns whether there is one this way.
    ///
    /// # Errors
    /// A press that is over.
    fn renew_jog(
        &self,
        admission: &Admission,
        axis: AxisName,
        towards: Side,
        speed: f64,
        press: Option<&str>,
    ) -> Result<bool, ServiceError> {
        let jogs = self.jogs();
        self.presses.go_on(axis, press, self.motion.turns())?;
        let same = jogs.get(&axis).filter(|jog| (jog.towards, jog.speed) == (towards, speed));
        let same = same.filter(|jog| jog.admission == *admission && self.motion.in_force(admission, axis).is_ok());
        let renewed = same.inspect(|jog| jog.grip.renew(JOG_HOLD)).is_some();
        if renewed {
            self.presses.moves(axis, press);
        }
        Ok(renewed)
    }

    /// Lets a jog go: the axis is stopped. Nothing happens where there is none.
    pub fn end_jog(&self, axis: AxisName) -> BenchView {
        let jogs = self.jogs();
        self.presses.let_go(axis);
        if let Some(jog) = jogs.get(&axis) {
            jog.grip.renew(Duration::ZERO);
        }
        drop(jogs);
        self.bench_view()
    }

    /// Whether a command of motion has an axis, by hand or of a job: from its acceptance to its end.
    #[must_use]
    pub fn is_commanded(&self, axis: AxisName) -> bool {
        self.motion.is_commanded(axis)
    }

    /// Stops one axis (and whatever else its controller moves) at once, in every state and whoever asks, without
    /// latching: another command may follow. What the axis was under ends: a move, a jog, or the job that moves it, for
    /// which `why` is the reason. An axis that stands, and is known to, is left alone.
    pub async fn halt_axis(&self, axis: AxisName, why: &str) -> StopDelivery {
        let stands = {
            let state = self.bench.stage(axis).state();
            let state = state.borrow();
            state.connected && state.at_rest_since.is_some()
        };
        if stands && !self.is_commanded(axis) {
            return StopDelivery::Confirmed;
        }
        if let Some(job) = self.current() {
            job.cancel(why.to_owned());
        }
        self.end_jog(axis);
        let delivery = self.motion.halt_axis(axis).await;
        self.publish_bench();
        delivery
    }

    /// Takes the operator's statement about the shell.
    ///
    /// # Errors
    /// A refusal while a job holds the bench, or an axis is under a command that was admitted under the former one.
    pub fn set_shell(&self, _permit: &Permit, shell: ShellState) -> Result<BenchView, ServiceError> {
        self.free_for_hand()?;
        self.motion.set_shell_at_rest(shell)?;
        // Whoever takes it off or puts it on sets up what stands before it, too.
        self.eye.see(Some(InView::Unknown));
        self.publish_bench();
        Ok(self.bench_view())
    }
}

/// What a panic comes to, for whoever reads why something ended.
pub(super) fn broken(panic: &(dyn std::any::Any + Send)) -> String {
    let words = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("the program failed ({}); the axes were stopped: please report this", words.unwrap_or("it did not say how"))
}
