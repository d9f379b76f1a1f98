//! Moving an axis: by legs and pieces, jogged, homed, let go.

use std::sync::Arc;

use super::{Admission, Claim, Motion, index, note_end, pieces};
use crate::clock::{Part, enter};
use crate::events::ShellState;
use crate::loops::axis_model::READBACK_TOLERANCE_MM;
use crate::motion::pieces::{Ahead, Pieces};
use crate::refusal::ServiceError;
use bench::config::Side;
use bench::device::jog::{Deadman, Seen, jog};
use bench::device::{AxisName, DeviceError};
use plenoptics::units::Millimetres;

impl Motion {
    /// Moves an axis to `target` with its approach leg and returns the readback.
    ///
    /// # Errors
    /// A refusal before anything moves; a device's error, or a stop, in mid-move.
    pub async fn go(
        &self,
        admission: &Admission,
        axis: AxisName,
        target: Millimetres,
    ) -> Result<Millimetres, ServiceError> {
        self.go_claimed(&self.claim(admission, axis)?, target).await
    }

    /// [`Motion::go`] with a right taken before.
    ///
    /// # Errors
    /// Those of [`Motion::go`].
    pub async fn go_claimed(&self, claim: &Claim, target: Millimetres) -> Result<Millimetres, ServiceError> {
        let _moving = enter(Part::Motion);
        let axis = claim.axis();
        self.check(axis, target)?;
        let underway = self.record(axis, "move", Some(target)).await?;
        let ended = claim.judge("move", self.go_by_legs(claim, target).await);
        self.answered(axis, "move", Some(target), ended.as_ref().map(|readback| Some(*readback)));
        note_end(underway, ended.as_ref().map(|readback| Some(*readback)));
        ended
    }

    pub(super) async fn go_by_legs(&self, claim: &Claim, target: Millimetres) -> Result<Millimetres, ServiceError> {
        let axis = claim.axis();
        // The disk took its time, in which anything may have changed.
        self.check(axis, target)?;
        let from = self.bench.stage(axis).state().borrow().position;
        let mut readback = from;
        let legs = self.legs(axis, from, target);
        self.state().approached[index(axis)] = false;
        for leg in legs {
            readback = self.go_straight(claim, readback, leg).await?;
        }
        self.state().approached[index(axis)] = true;
        Ok(readback)
    }

    /// One leg, in pieces.
    pub(super) async fn go_straight(
        &self,
        claim: &Claim,
        from: Millimetres,
        target: Millimetres,
    ) -> Result<Millimetres, ServiceError> {
        let axis = claim.axis();
        let stage = self.bench.stage(axis);
        let mut at = from;
        loop {
            let wall = self.may_go_on(claim, at, target)?;
            at = Pieces::within(pieces::MOVE, &**stage, wall).next(at, target);
            let readback = stage.move_to(at, claim.generation()).await?;
            if (readback - at).abs().value() > READBACK_TOLERANCE_MM {
                return Err(DeviceError::Protocol {
                    device: format!("the {axis} stage"),
                    detail: format!("it was sent to {at:.4} and says it stands at {readback:.4}"),
                }
                .into());
            }
            if at == target {
                return Ok(readback);
            }
        }
    }

    /// Whether the next piece on the way to `target` may begin: whatever could forbid it may have changed during the one
    /// before. Returns the wall that it must be told little at a time towards.
    pub(super) fn may_go_on(
        &self,
        claim: &Claim,
        at: Millimetres,
        target: Millimetres,
    ) -> Result<Option<f64>, ServiceError> {
        let axis = claim.axis();
        self.in_force(claim.admission(), axis)?;
        self.position_mm(axis)?;
        self.check_range(axis, at, target)?;
        let guarded = axis == AxisName::E && self.shell() != ShellState::Off;
        Ok(guarded.then(|| self.e_wall_reading_mm()))
    }

    /// The greatest speed (mm/s) at which an axis jogs: its own, or what it can keep while it is told so little at a time
    /// that it is at rest in time whatever becomes of the program.
    #[must_use]
    pub fn jog_speed_mm_per_s(&self, axis: AxisName) -> f64 {
        pieces::jog_speed(self.bench.stage(axis).ramp(), self.axis(axis).speed_mm_per_s)
    }

    /// Moves an axis towards a side at `speed_mm_per_s`, or [as fast as it jogs](Motion::jog_speed_mm_per_s) where that is
    /// less, while the deadman is held: no further than the limit of travel, the e wall or the greatest step, and not at all
    /// while another command has the axis. Returns where it stands.
    ///
    /// # Errors
    /// A refusal before anything moves; a device's error, or a stop, in mid-move.
    pub async fn jog(
        self: &Arc<Self>,
        admission: &Admission,
        axis: AxisName,
        towards: Side,
        speed_mm_per_s: f64,
        deadman: Deadman,
    ) -> Result<Millimetres, ServiceError> {
        self.jog_claimed(&self.claim(admission, axis)?, towards, speed_mm_per_s, deadman).await
    }

    /// [`Motion::jog`] with a right taken before.
    ///
    /// # Errors
    /// Those of [`Motion::jog`].
    pub async fn jog_claimed(
        self: &Arc<Self>,
        claim: &Claim,
        towards: Side,
        speed_mm_per_s: f64,
        deadman: Deadman,
    ) -> Result<Millimetres, ServiceError> {
        let axis = claim.axis();
        let underway = self.record(axis, "jog", Some(self.jog_end(axis, towards)?)).await?;
        let ended = claim.judge("jog", self.jog_by_pieces(claim, towards, speed_mm_per_s, deadman).await);
        note_end(underway, ended.as_ref().map(|readback| Some(*readback)));
        ended
    }

    pub(super) async fn jog_by_pieces(
        self: &Arc<Self>,
        claim: &Claim,
        towards: Side,
        speed: f64,
        deadman: Deadman,
    ) -> Result<Millimetres, ServiceError> {
        let axis = claim.axis();
        // The disk took its time, in which anything may have changed.
        let end = self.jog_end(axis, towards)?;
        self.state().approached[index(axis)] = false;
        let (motion, held) = (Arc::clone(self), claim.clone());
        let next = move |seen: Seen| {
            let wall = motion.may_go_on(&held, seen.at, end)?;
            Ok::<_, ServiceError>(Ahead::new(motion.bench.stage(axis).ramp(), speed, wall).next(seen, end))
        };
        jog(self.bench.stage(axis), end, deadman, claim.generation(), next).await
    }

    /// Homes an axis.
    ///
    /// # Errors
    /// A refusal before anything moves, or the device's error.
    pub async fn home(&self, admission: &Admission, axis: AxisName) -> Result<(), ServiceError> {
        self.home_claimed(&self.claim_homing(admission, axis)?).await
    }

    /// [`Motion::home`] with a right taken before.
    ///
    /// # Errors
    /// Those of [`Motion::home`].
    pub async fn home_claimed(&self, claim: &Claim) -> Result<(), ServiceError> {
        let _moving = enter(Part::Motion);
        let axis = claim.axis();
        self.check_home(axis)?;
        let underway = self.record(axis, "home", None).await?;
        let ended = claim.judge("home", self.home_now(claim).await);
        let at = self.position_mm(axis).ok().map(Millimetres);
        self.answered(axis, "home", None, ended.as_ref().map(|()| at));
        note_end(underway, ended.as_ref().map(|()| at));
        ended?;
        for axis in [Some(axis), self.bench.stage(axis).homes_also()].into_iter().flatten() {
            let config = self.axis(axis);
            // Pulling off the switch moves away from the home side, which is an approach from it.
            self.state().approached[index(axis)] = config.home_side == config.approach;
        }
        Ok(())
    }

    pub(super) async fn home_now(&self, claim: &Claim) -> Result<(), ServiceError> {
        let axis = claim.axis();
        // The disk took its time, in which anything may have changed.
        self.in_force(claim.admission(), axis)?;
        self.check_home(axis)?;
        Ok(self.bench.stage(axis).home(claim.generation()).await?)
    }

    /// Switches an axis's motor off, so that it can be moved by hand; its position is unknown until homed.
    ///
    /// # Errors
    /// A latched stop, a lease that is over, another command that has the axis, or the device's error.
    pub async fn release(&self, admission: &Admission, axis: AxisName) -> Result<(), ServiceError> {
        let _moving = enter(Part::Motion);
        // A controller may be able to switch off all of its motors only.
        let claim = self.claim_with(admission, axis, AxisName::ALL.into_iter().find(|&other| other != axis))?;
        let underway = self.record(axis, "release", None).await?;
        self.state().approached[index(axis)] = false;
        let ended = claim.judge("release", self.release_now(&claim).await);
        self.answered(axis, "release", None, ended.as_ref().map(|()| None));
        note_end(underway, ended.as_ref().map(|()| None));
        ended
    }

    pub(super) async fn release_now(&self, claim: &Claim) -> Result<(), ServiceError> {
        self.in_force(claim.admission(), claim.axis())?;
        Ok(self.bench.stage(claim.axis()).release(claim.generation()).await?)
    }
}
