//! What a person moves by hand: moves, homing and jogs of one axis, and the statement about the shell.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::Duration;

use super::events::{BenchView, ShellState};
use super::lease::Permit;
use super::motion::Claim;
use super::service::Service;
use super::{Acceptance, Refusal, ServiceError};
use crate::config::Side;
use crate::device::jog::{Grip, deadman};
use crate::device::{AxisName, StopDelivery};
use crate::units::Millimetres;

/// How long a jog goes on from a request.
const JOG_HOLD: Duration = Duration::from_millis(300);

/// A jog under way.
pub(super) struct Jogging {
    towards: Side,
    speed: f64,
    grip: Grip,
}

impl Service {
    pub(super) fn failures(&self) -> MutexGuard<'_, HashMap<AxisName, String>> {
        self.failures.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn by_hand(&self) -> MutexGuard<'_, HashSet<AxisName>> {
        self.by_hand.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// From here on an axis counts as moving, until it [has ended](Self::ended_by_hand).
    fn begins_by_hand(&self, axis: AxisName) {
        self.failures().remove(&axis);
        self.by_hand().insert(axis);
    }

    /// Keeps how a command by hand ended, then gives the axis free: whoever finds it free knows how.
    fn ended_by_hand(&self, claim: Claim, ended: Result<(), ServiceError>) {
        let axis = claim.axis();
        if let Err(error) = ended {
            tracing::warn!(%axis, %error, "a command by hand did not end as commanded");
            self.failures().insert(axis, error.to_string());
        }
        {
            // Whoever takes the axis next begins only after this.
            let mut by_hand = self.by_hand();
            drop(claim);
            by_hand.remove(&axis);
        }
        self.publish_bench();
    }

    /// No job may hold the bench, and the program must not be ending.
    fn free_for_hand(&self) -> Result<(), ServiceError> {
        self.open_for_motion()?;
        match self.current() {
            Some(job) => Err(Refusal::Busy { job: job.snapshot().id }.into()),
            None => Ok(()),
        }
    }

    /// Takes an axis for a command by hand. A job is looked for again once the axis is taken: one that began meanwhile
    /// either found the axis taken or is seen here.
    fn claim_for_hand(&self, axis: AxisName) -> Result<Claim, ServiceError> {
        self.free_for_hand()?;
        let claim = self.motion.claim(axis)?;
        self.free_for_hand()?;
        Ok(claim)
    }

    /// Starts a move by hand; its end is seen in the events.
    ///
    /// # Errors
    /// Every motion rule, before anything moves.
    pub async fn move_axis(
        self: &Arc<Self>,
        _permit: &Permit,
        axis: AxisName,
        target: Millimetres,
    ) -> Result<BenchView, ServiceError> {
        let claim = self.claim_for_hand(axis)?;
        self.motion.check(axis, target)?;
        self.history_ready().await?;
        self.begins_by_hand(axis);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.go_claimed(&claim, target).await;
            service.ended_by_hand(claim, ended.map(drop));
        });
        Ok(self.bench_view())
    }

    /// Starts homing an axis; its end is seen in the events.
    ///
    /// # Errors
    /// A refusal before anything moves.
    pub async fn home_axis(self: &Arc<Self>, _permit: &Permit, axis: AxisName) -> Result<BenchView, ServiceError> {
        let claim = self.claim_for_hand(axis)?;
        self.motion.check_home(axis)?;
        self.history_ready().await?;
        self.begins_by_hand(axis);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.home_claimed(&claim).await;
            service.ended_by_hand(claim, ended);
        });
        Ok(self.bench_view())
    }

    fn jogs(&self) -> MutexGuard<'_, HashMap<AxisName, Jogging>> {
        self.jogs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves an axis towards a side for 0.3 s from now on: asked again in time, it goes on. At the axis's
    /// greatest speed where none is given.
    ///
    /// # Errors
    /// Every motion rule, before anything moves; a jog another way while one is under way.
    pub async fn jog(
        self: &Arc<Self>,
        _permit: &Permit,
        axis: AxisName,
        towards: Side,
        speed_mm_per_s: Option<f64>,
    ) -> Result<(BenchView, Acceptance), ServiceError> {
        let greatest = self.motion.axis(axis).speed_mm_per_s;
        let speed = speed_mm_per_s.unwrap_or(greatest);
        if speed.is_nan() || speed <= 0.0 {
            let what = format!("{speed} is not above 0");
            return Err(ServiceError::Invalid { field: "speed_mm_per_s", what });
        }
        if speed > greatest {
            return Err(Refusal::Speed { axis, speed, max: greatest }.into());
        }
        if self.renew_jog(axis, towards, speed) {
            return Ok((self.bench_view(), Acceptance::Before));
        }
        self.history_ready().await?;
        let mut jogs = self.jogs();
        let claim = self.claim_for_hand(axis)?;
        self.motion.jog_end(axis, towards)?;
        self.begins_by_hand(axis);
        let (grip, deadman) = deadman(JOG_HOLD);
        jogs.insert(axis, Jogging { towards, speed, grip });
        drop(jogs);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.jog_claimed(&claim, towards, speed, deadman).await;
            service.jogs().remove(&axis);
            service.ended_by_hand(claim, ended.map(drop));
        });
        Ok((self.bench_view(), Acceptance::Now))
    }

    /// Has a jog that is under way go on; the disk is not waited for. Returns whether there is one this way.
    fn renew_jog(&self, axis: AxisName, towards: Side, speed: f64) -> bool {
        let jogs = self.jogs();
        let same = jogs.get(&axis).filter(|jog| (jog.towards, jog.speed) == (towards, speed));
        same.inspect(|jog| jog.grip.renew(JOG_HOLD)).is_some()
    }

    /// Lets a jog go: the axis is stopped. Nothing happens where there is none.
    pub fn end_jog(&self, axis: AxisName) -> BenchView {
        if let Some(jog) = self.jogs().get(&axis) {
            jog.grip.renew(Duration::ZERO);
        }
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
    /// A refusal while a job holds the bench.
    pub fn set_shell(&self, _permit: &Permit, shell: ShellState) -> Result<BenchView, ServiceError> {
        self.free_for_hand()?;
        self.motion.set_shell(shell);
        self.publish_bench();
        Ok(self.bench_view())
    }
}
