//! An axis as a Focuser: absolute, one step 1 µm, step 0 at the axis's lower limit of travel.

use serde_json::{Value, json};

use super::answer::Answer;
use super::common::Device;
use super::fault::{Fault, Refused};
use super::request::{Call, Caller, Verb, Verbs};
use super::server::Facade;
use crate::access::{AuditRecord, Principal, Scope};
use crate::config::AxisConfig;
use crate::device::{AxisName, StopDelivery};
use crate::units::Millimetres;

/// Members of a Focuser alone.
pub(super) const MEMBERS: &[(&str, Verbs)] = &[
    ("absolute", Verbs::Get),
    ("halt", Verbs::Put),
    ("ismoving", Verbs::Get),
    ("maxincrement", Verbs::Get),
    ("maxstep", Verbs::Get),
    ("move", Verbs::Put),
    ("position", Verbs::Get),
    ("stepsize", Verbs::Get),
    ("tempcomp", Verbs::Both),
    ("tempcompavailable", Verbs::Get),
    ("temperature", Verbs::Get),
];

/// The action that homes the axis, for which a Focuser has no member.
pub(super) const HOME: &str = "Home";

/// Steps a millimetre.
const STEPS_PER_MM: f64 = 1000.0;

/// The steps of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Steps {
    /// Where step 0 is, mm.
    zero_mm: f64,
    /// The greatest step: the last whole one within the limits of travel.
    last: i32,
    /// Steps of the longest single move.
    longest: i32,
}

impl Steps {
    fn of(axis: &AxisConfig) -> Self {
        // A whole number of steps, but for the last bits of a double.
        let whole = |mm: f64| (mm * STEPS_PER_MM + 1e-6).floor() as i32;
        let last = whole(axis.high_limit_mm - axis.low_limit_mm);
        Self { zero_mm: axis.low_limit_mm, last, longest: whole(axis.max_step_mm).min(last) }
    }

    fn millimetres(self, step: i32) -> f64 {
        self.zero_mm + f64::from(step) / STEPS_PER_MM
    }

    /// The nearest step.
    fn nearest(self, mm: f64) -> i32 {
        ((mm - self.zero_mm) * STEPS_PER_MM).round() as i32
    }
}

impl Facade {
    fn steps(&self, axis: AxisName) -> Steps {
        let bench = &self.service.config().bench;
        Steps::of(match axis {
            AxisName::Focus => &bench.focus,
            AxisName::E => &bench.e,
        })
    }

    /// Writes into the audit log what a client did.
    fn audit(&self, caller: Caller, what: &'static str, detail: Value) {
        let principal = Principal { name: caller.name(), scope: Scope::Control, address: caller.address };
        self.gate.audit(AuditRecord::of(&principal, what, detail));
    }

    pub(super) fn connect_focuser(&self, axis: AxisName, caller: Caller) -> Result<(), Fault> {
        self.answers(axis)?;
        if let Some(lease) = self.seat.connect(caller, axis)? {
            let detail = json!({ "lease": lease.id, "owner": lease.owner, "note": lease.note });
            self.audit(caller, "lease.take", detail);
        }
        Ok(())
    }

    pub(super) fn disconnect_focuser(&self, axis: AxisName, caller: Caller) {
        if let Some(lease) = self.seat.disconnect(caller, axis) {
            self.audit(caller, "lease.release", json!({ "lease": lease.id, "owner": lease.owner }));
        }
    }

    /// That the axis's controller answers.
    fn answers(&self, axis: AxisName) -> Result<(), Fault> {
        let state = self.service.bench().stage(axis).state().borrow().clone();
        if state.connected {
            return Ok(());
        }
        let why = state.fault.unwrap_or_else(|| "the controller does not answer".to_owned());
        Err(Fault::device(format!("the {axis} stage is not connected: {why}")))
    }

    pub(super) async fn answer_focuser(&self, axis: AxisName, call: &Call) -> Result<Answer, Refused> {
        match (call.member, call.verb) {
            // Whoever sees the bench may stop it.
            ("halt", _) => return Ok(self.halt(axis, call.caller).await.map(|()| Answer::Done)?),
            ("move", _) => {
                let step = call.params.int("Position")?;
                return Ok(self.move_to_step(axis, call, step).await.map(|()| Answer::Done)?);
            }
            ("tempcomp", Verb::Put) => {
                call.params.flag("TempComp")?;
                return Err(Fault::not_implemented("TempComp", "the axis follows no temperature").into());
            }
            _ => {}
        }
        self.need_connection(Device::Focuser(axis), call.caller)?;
        let steps = self.steps(axis);
        Ok(match call.member {
            "absolute" => Answer::of(true),
            "ismoving" => Answer::of(self.is_moving(axis, call.caller)?),
            "maxincrement" => Answer::of(steps.longest),
            "maxstep" => Answer::of(steps.last),
            "position" => Answer::of(self.position(axis)?),
            // Micrometres.
            "stepsize" => Answer::of(1.0),
            "tempcomp" | "tempcompavailable" => Answer::of(false),
            member => return Err(Fault::not_implemented(member, "the bench has no such sensor").into()),
        })
    }

    /// What the axis does, as far as it is known.
    pub(super) fn focuser_states(&self, axis: AxisName) -> Vec<(&'static str, Value)> {
        let moving = self.service.is_commanded(axis) || self.service.axis_view(axis).moving;
        let mut states = vec![("IsMoving", json!(moving))];
        states.extend(self.position(axis).ok().map(|step| ("Position", json!(step))));
        states
    }

    /// Whether the axis moves, from the acceptance of a move to its end, also between two legs of it.
    fn is_moving(&self, axis: AxisName, caller: Caller) -> Result<bool, Fault> {
        self.answers(axis)?;
        // In this order: a command's failure is noted before the axis is given free.
        let commanded = self.service.is_commanded(axis);
        let view = self.service.axis_view(axis);
        if commanded || view.moving {
            return Ok(true);
        }
        match view.failure.filter(|_| self.seat.has_commanded(caller, axis)) {
            Some(_) if self.service.bench_view().stop.latched => {
                Err(Fault::cancelled(format!("the stop ended the move of the {axis} axis; reset it, then move again")))
            }
            Some(failure) => Err(Fault::device(format!("the {axis} axis did not go as commanded: {failure}"))),
            None => Ok(false),
        }
    }

    fn position(&self, axis: AxisName) -> Result<i32, Fault> {
        self.answers(axis)?;
        let Some(mm) = self.service.axis_view(axis).position_mm else {
            return Err(Fault::not_set(format!("the {axis} axis is not homed: home it by the action {HOME} first")));
        };
        let steps = self.steps(axis);
        let step = steps.nearest(mm);
        if step < 0 {
            return Err(Fault::not_set(format!(
                "the {axis} axis stands at {mm:.3} mm, below its lower limit of {} mm, where step 0 is",
                steps.zero_mm
            )));
        }
        Ok(step)
    }

    async fn move_to_step(&self, axis: AxisName, call: &Call, step: i32) -> Result<(), Fault> {
        let caller = call.caller;
        let permit = self.seat.permit(caller, axis)?.asked_at(call.asked);
        let steps = self.steps(axis);
        if !(0..=steps.last).contains(&step) {
            return Err(Fault::invalid_value(format!("Position: {step} is not within 0 to MaxStep, {}", steps.last)));
        }
        let target = steps.millimetres(step);
        self.service.move_axis(&permit, axis, Millimetres(target)).await?;
        self.seat.commands(caller, axis);
        self.audit(caller, "axis.move", json!({ "axis": axis, "position_mm": target }));
        Ok(())
    }

    pub(super) async fn home(&self, axis: AxisName, call: &Call) -> Result<Answer, Refused> {
        let permit = self.seat.permit(call.caller, axis)?.asked_at(call.asked);
        self.service.home_axis(&permit, axis).await?;
        self.seat.commands(call.caller, axis);
        self.audit(call.caller, "axis.home", json!({ "axis": axis }));
        Ok(Answer::of("homing has begun; IsMoving says when it has ended"))
    }

    async fn halt(&self, axis: AxisName, caller: Caller) -> Result<(), Fault> {
        let why = format!("the {axis} axis was halted by {}", caller.name());
        let delivery = self.service.halt_axis(axis, &why).await;
        self.seat.halted(axis);
        self.audit(caller, "axis.halt", json!({ "axis": axis, "delivery": delivery }));
        if delivery == StopDelivery::Undeliverable {
            return Err(Fault::device(format!(
                "the {axis} axis's controller could not be told to stop: use the bench's emergency stop"
            )));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BenchConfig;

    #[test]
    fn step_zero_is_the_lower_limit_and_none_is_outside_the_travel() {
        let bench = BenchConfig::default();
        let focus = Steps::of(&bench.focus);
        assert_eq!((focus.last, focus.longest), (7000, 7000));
        assert_eq!((focus.millimetres(0), focus.millimetres(7000)), (-2.0, 5.0));
        let e = Steps::of(&AxisConfig { max_step_mm: 1.5, ..bench.e });
        assert_eq!((e.last, e.longest), (37_000, 1500));
        assert_eq!((e.nearest(-5.0), e.nearest(-0.1), e.nearest(-5.0006)), (0, 4900, -1));
        // 0.3 is no number of doubles: neither is 299.99999999999994 steps.
        let odd = Steps::of(&AxisConfig { low_limit_mm: 0.1, high_limit_mm: 0.4, ..AxisConfig::default() });
        assert_eq!(odd.last, 300);
        for step in 0..=7000 {
            assert_eq!(focus.nearest(focus.millimetres(step)), step);
        }
    }
}
