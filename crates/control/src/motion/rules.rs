//! What an axis may be told now: latch, homing, limits, the e wall, the greatest step, and the side to approach from.

use super::{EKnown, Motion, State, index};
use crate::events::ShellState;
use crate::loops::axis_model::{AxisModel, READBACK_TOLERANCE_MM};
use crate::loops::room::{EAxis, Room};
use crate::plan::Travel;
use crate::refusal::{Refusal, ServiceError};
use bench::config::{AxisConfig, Config, Side};
use bench::device::{AxisName, DeviceError};
use plenoptics::units::Millimetres;

/// Positions are reported to a thousandth of a millimetre.
const READOUT_MM: f64 = 1e-3;
/// How far an axis stays from the switch that it homes to, mm: pressed in a motion it ends that, and the reference.
const SWITCH_CLEAR_MM: f64 = 1.0;
/// A wall that follows from uncertainties stands at a hundredth of a millimetre.
const WALL_PLACES: f64 = 100.0;

impl Motion {
    /// The e wall, mm of e.
    #[must_use]
    pub fn e_wall_mm(&self) -> f64 {
        self.config.assembly.e_wall_mm(self.l_bound_mm())
    }

    /// The least reading that the e axis may be sent to, mm: the wall, or with the shell on, and no loop that goes by the
    /// picture, where e may be too near the shell already by what is known of the axis's zero and scale.
    #[must_use]
    pub fn e_wall_reading_mm(&self) -> f64 {
        let wall = self.e_wall_mm();
        let State { shell, e_known, contact, .. } = *self.state();
        let e = match e_known {
            _ if shell == ShellState::Off => return wall,
            EKnown::Watched => return wall,
            EKnown::Configured => self.configured_e(),
            EKnown::Told(told) => told,
        };
        let highest = self.axis(AxisName::E).high_limit_mm;
        let room = Room { contact, e: EAxis::alone(e) };
        let least = room.least_mm(wall.max(e.reading_for(wall)), highest).unwrap_or(highest);
        // As it is shown.
        (least * WALL_PLACES - 1e-6).ceil() / WALL_PLACES
    }

    /// What the e axis's readings mean by the configuration alone.
    fn configured_e(&self) -> AxisModel {
        let axis = self.axis(AxisName::E);
        AxisModel::new(axis.home_position_mm, axis.home_position_mm, axis.zero_uncertainty_mm, axis.scale_uncertainty)
    }

    /// Whether the wall is further from the shell than it has to be, as nothing but the configuration tells what the e axis's
    /// readings mean.
    #[must_use]
    pub fn is_e_untold(&self) -> bool {
        matches!(self.state().e_known, EKnown::Configured) && self.e_wall_reading_mm() > self.e_wall_mm()
    }

    /// The positions an axis may be sent to now: least and greatest, mm.
    #[must_use]
    pub fn range_mm(&self, axis: AxisName) -> (f64, f64) {
        let (low, high) = self.travel_mm(axis, self.axis(axis));
        match axis {
            AxisName::Focus => (low, high),
            // A wall beyond the travel leaves its far end.
            AxisName::E => (low.max(self.e_wall_reading_mm()).min(high), high),
        }
    }

    /// How far an axis may travel: between its configured limits, and where those are beyond its controller's, no further
    /// than that lets it, and not up to the switch that it homes to.
    fn travel_mm(&self, axis: AxisName, config: &AxisConfig) -> (f64, f64) {
        let configured = (config.low_limit_mm, config.high_limit_mm);
        let Some((low, high)) = self.bench.stage(axis).info().firmware_limits else { return configured };
        let clear_mm = |side| if config.home_side == side { SWITCH_CLEAR_MM } else { 0.0 };
        let low = low.value() + if low.value() > configured.0 { clear_mm(Side::Low) } else { 0.0 };
        let high = high.value() - if high.value() < configured.1 { clear_mm(Side::High) } else { 0.0 };
        let narrowed = (configured.0.max(low), configured.1.min(high));
        // What leaves nothing is a contradiction, which is told elsewhere.
        if narrowed.0 < narrowed.1 { narrowed } else { configured }
    }

    /// How far the axes may travel by a configuration, with the shell off.
    #[must_use]
    pub fn travel(&self, config: &Config) -> Travel {
        Travel {
            focus_mm: self.travel_mm(AxisName::Focus, &config.bench.focus),
            e_mm: self.travel_mm(AxisName::E, &config.bench.e),
        }
    }

    /// Whether a move may start now.
    ///
    /// # Errors
    /// The first rule it breaks.
    pub fn check(&self, axis: AxisName, target: Millimetres) -> Result<(), ServiceError> {
        if !target.value().is_finite() {
            return Err(ServiceError::Invalid {
                field: "position_mm",
                what: format!("a position must be a finite number of mm, not {}", target.value()),
            });
        }
        self.check_latch()?;
        let state = self.bench.stage(axis).state().borrow().clone();
        if !state.connected {
            let reason = state.fault.unwrap_or_else(|| "the controller does not answer".to_owned());
            return Err(DeviceError::Disconnected { device: format!("the {axis} stage"), reason }.into());
        }
        self.check_controller(axis)?;
        if !state.homed {
            return Err(Refusal::NotHomed { axis }.into());
        }
        if state.moving {
            return Err(Refusal::Moving { axis }.into());
        }
        let from = state.position;
        self.check_range(axis, from, target)?;
        let config = self.axis(axis);
        let distance = (target - from).abs();
        if distance.value() > config.max_step_mm {
            return Err(Refusal::Step { axis, distance, max: Millimetres(config.max_step_mm) }.into());
        }
        Ok(())
    }

    /// Whether an axis's controller agrees with the configuration, as far as it was heard.
    fn check_controller(&self, axis: AxisName) -> Result<(), Refusal> {
        let contradictions = self.bench.stage(axis).info().contradictions;
        if contradictions.is_empty() { Ok(()) } else { Err(Refusal::Contradiction { axis, contradictions }) }
    }

    /// Limits and wall; a move that leads back towards them from outside is allowed.
    pub(super) fn check_range(&self, axis: AxisName, from: Millimetres, target: Millimetres) -> Result<(), Refusal> {
        let (low, high) = self.travel_mm(axis, self.axis(axis));
        let leads_back = |bound_low: f64, bound_high: f64| {
            (from.value() < bound_low && target > from && target.value() <= bound_high)
                || (from.value() > bound_high && target < from && target.value() >= bound_low)
        };
        let outside = target.value() < low - READOUT_MM || target.value() > high + READOUT_MM;
        if outside && !leads_back(low, high) {
            return Err(Refusal::Limit { axis, target, low: Millimetres(low), high: Millimetres(high) });
        }
        if axis == AxisName::E {
            let wall = self.e_wall_reading_mm();
            if target.value() < wall - READOUT_MM && !leads_back(wall, high) {
                return Err(Refusal::Wall { target, wall: Millimetres(wall), untold: self.is_e_untold() });
            }
        }
        Ok(())
    }

    /// The legs of a move: the target alone, or first a point beside it on the approach side.
    pub(super) fn legs(&self, axis: AxisName, from: Millimetres, target: Millimetres) -> Vec<Millimetres> {
        let config = self.axis(axis);
        let side = config.approach.sign();
        let comes_from_approach_side = (from - target).value() * side > 0.0;
        let approached = self.state().approached[index(axis)];
        if comes_from_approach_side && approached {
            return vec![target];
        }
        let (low, high) = self.range_mm(axis);
        if !(low - READOUT_MM..=high + READOUT_MM).contains(&target.value()) {
            // On the way back from outside nothing leads outwards again.
            return vec![target];
        }
        let margin = config.approach_leg_mm();
        if comes_from_approach_side && (from - target).abs().value() >= margin {
            // Long enough for the play to be taken up on the way.
            return vec![target];
        }
        let beside = Millimetres((target.value() + side * margin).clamp(low, high));
        if (beside - target).abs().value() < 1e-6 { vec![target] } else { vec![beside, target] }
    }

    /// Where a jog towards a side would end at the latest.
    ///
    /// # Errors
    /// The motion rule it breaks.
    pub fn jog_end(&self, axis: AxisName, towards: Side) -> Result<Millimetres, ServiceError> {
        let from = self.bench.stage(axis).state().borrow().position;
        let (low, high) = self.range_mm(axis);
        let far = from.value() + towards.sign() * self.axis(axis).max_step_mm;
        let end = Millimetres(far.clamp(low, high));
        self.check(axis, end)?;
        if (end - from).value() * towards.sign() < -READBACK_TOLERANCE_MM {
            // From outside the limits only the way back is open.
            let (low, high) = (Millimetres(low), Millimetres(high));
            return Err(Refusal::Limit { axis, target: Millimetres(far), low, high }.into());
        }
        Ok(end)
    }

    /// The shell's state in words, where it is not known to be off.
    fn shell_in_the_way(&self) -> Option<&'static str> {
        match self.shell() {
            ShellState::Off => None,
            ShellState::On => Some("on"),
            ShellState::Unknown => Some("not known to be off"),
        }
    }

    /// Whether an axis may be moved off a switch now: the e axis is not moved towards a shell that is on or may be.
    ///
    /// # Errors
    /// The rule it breaks.
    pub fn check_leave(&self, axis: AxisName, pressed: Side) -> Result<(), ServiceError> {
        self.check_latch()?;
        self.check_controller(axis)?;
        match self.shell_in_the_way() {
            Some(shell) if axis == AxisName::E && pressed == Side::High => {
                Err(Refusal::LeavingTowardsShell { pressed, shell }.into())
            }
            _ => Ok(()),
        }
    }

    /// Whether homing an axis may start now: the e axis is not homed towards a shell that is on or may be.
    ///
    /// # Errors
    /// The rule it breaks.
    pub fn check_home(&self, axis: AxisName) -> Result<(), ServiceError> {
        self.check_latch()?;
        self.check_controller(axis)?;
        let homed = [Some(axis), self.bench.stage(axis).homes_also()];
        for axis in homed.into_iter().flatten() {
            if let Some(why) = self.bench.stage(axis).homing_barred() {
                return Err(Refusal::SwitchPressed { axis, why }.into());
            }
        }
        let Some(shell) = self.shell_in_the_way() else { return Ok(()) };
        let homes_e = axis == AxisName::E || self.bench.stage(axis).homes_also() == Some(AxisName::E);
        if homes_e && self.axis(AxisName::E).home_side == Side::Low {
            return Err(Refusal::HomingTowardsShell { axis, shell }.into());
        }
        Ok(())
    }
}
