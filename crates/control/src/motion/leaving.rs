//! The way off a limit switch, where it is not known where the axis stands: in short pieces, away from the switch that the
//! operator says is pressed, and no further than a switch can need.

use super::{Claim, Motion, index, note_end};
use crate::refusal::ServiceError;
use bench::config::Side;
use bench::device::DeviceError;

/// Longest piece, mm.
const PIECE_MM: f64 = 0.2;
/// Most pieces: 3 mm in all.
const MOST_PIECES: usize = 15;

impl Motion {
    /// Moves an axis off the switch at the side that is said to be pressed, with a right taken before.
    ///
    /// # Errors
    /// A refusal before anything moves; a device's error, or a stop, in between; where the switch does not let go.
    pub async fn leave_switch_claimed(&self, claim: &Claim, pressed: Side) -> Result<(), ServiceError> {
        let axis = claim.axis();
        self.check_leave(axis, pressed)?;
        let underway = self.record(axis, "leave switch", None).await?;
        self.state().approached[index(axis)] = false;
        let ended = claim.judge("leave switch", self.leave_by_pieces(claim, pressed).await);
        self.answered(axis, "leave switch", None, ended.as_ref().map(|()| None));
        note_end(underway, ended.as_ref().map(|()| None));
        ended
    }

    async fn leave_by_pieces(&self, claim: &Claim, pressed: Side) -> Result<(), ServiceError> {
        let axis = claim.axis();
        let stage = self.bench.stage(axis);
        for _ in 0..MOST_PIECES {
            // Whatever could forbid it may have changed during the one before.
            self.in_force(claim.admission(), axis)?;
            self.check_leave(axis, pressed)?;
            if stage.step_off(pressed.opposite(), PIECE_MM, claim.generation()).await? {
                return Ok(());
            }
        }
        let moved = MOST_PIECES as f64 * PIECE_MM;
        let reason = format!("the switch is pressed still, {moved:.1} mm further: was it the {pressed} one? Look");
        Err(DeviceError::Refused { device: format!("the {axis} axis"), reason }.into())
    }
}
