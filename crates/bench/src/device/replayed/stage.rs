//! Stages that answer from a recording.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::device::{AxisName, DeviceError, MoveTime, Stage, StageInfo, StageState, StopDelivery};
use crate::record::messages::{Answer, AxisState, JobStart};
use plenoptics::units::Millimetres;

/// Positions that differ by less are one, mm: a pose is told to a thousandth of that by every controller.
const SAME_MM: f64 = 1e-9;

/// What the stages answered, in order, and where that leaves them.
pub(super) struct Tape {
    answers: Mutex<VecDeque<Answer>>,
    states: [watch::Sender<StageState>; 2],
    start: [AxisState; 2],
}

const fn index(axis: AxisName) -> usize {
    match axis {
        AxisName::Focus => 0,
        AxisName::E => 1,
    }
}

fn state_of(state: &AxisState) -> StageState {
    StageState {
        connected: state.connected,
        homed: state.homed,
        position: Millimetres(state.position_mm),
        moving: false,
        at_rest_since: Some(Instant::now()),
        limit_switch: false,
        fault: state.fault.clone(),
    }
}

impl Tape {
    pub(super) fn new(start: &JobStart, answers: Vec<Answer>) -> Self {
        let start = [start.focus.clone().unwrap_or_default(), start.e.clone().unwrap_or_default()];
        Self {
            answers: Mutex::new(answers.into()),
            states: [watch::Sender::new(state_of(&start[0])), watch::Sender::new(state_of(&start[1]))],
            start,
        }
    }

    fn answers(&self) -> MutexGuard<'_, VecDeque<Answer>> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, axis: AxisName, state: Option<&AxisState>) {
        if let Some(state) = state {
            self.states[index(axis)].send_replace(state_of(state));
        }
    }

    /// The next answer, where it is one of this axis to this question.
    fn next(&self, axis: AxisName, asked: &str, target: Option<Millimetres>) -> Option<Answer> {
        let mut answers = self.answers();
        // Whoever else looked at the axes then left readings that nobody asks for now.
        while asked != "read" && answers.front().is_some_and(|next| next.asked == "read" && next.error_json.is_none()) {
            answers.pop_front();
        }
        let fits = |next: &Answer| {
            let there = |target: Millimetres| next.target_mm.is_some_and(|to| (to - target.value()).abs() < SAME_MM);
            next.device == axis.name() && next.asked == asked && target.is_none_or(there)
        };
        let answer = answers.front().is_some_and(fits).then(|| answers.pop_front()).flatten()?;
        self.put(axis, answer.state.as_ref());
        let other = if axis == AxisName::E { AxisName::Focus } else { AxisName::E };
        if answers.front().is_some_and(|next| next.device == other.name() && next.asked == "beside") {
            let beside = answers.pop_front();
            self.put(other, beside.as_ref().and_then(|beside| beside.state.as_ref()));
        }
        Some(answer)
    }
}

/// One axis of a recording.
pub(super) struct ReplayedStage {
    axis: AxisName,
    tape: std::sync::Arc<Tape>,
    path: PathBuf,
}

impl ReplayedStage {
    pub(super) fn new(axis: AxisName, tape: std::sync::Arc<Tape>, path: &Path) -> Self {
        Self { axis, tape, path: path.to_owned() }
    }

    fn now(&self) -> StageState {
        self.tape.states[index(self.axis)].borrow().clone()
    }

    /// What it answered to a question that cannot be answered without the recording.
    fn recorded(&self, asked: &str) -> Result<(), DeviceError> {
        match self.tape.next(self.axis, asked, None) {
            Some(answer) => super::error_of(&answer).map_or(Ok(()), Err),
            None => Err(DeviceError::Protocol {
                device: super::NAME.to_owned(),
                detail: format!("it has no answer of the {} axis to {asked} here", self.axis),
            }),
        }
    }
}

#[async_trait]
impl Stage for ReplayedStage {
    fn info(&self) -> StageInfo {
        let start = &self.tape.start[index(self.axis)];
        StageInfo {
            axis: self.axis,
            driver: "replayed".to_owned(),
            identity: "REPLAY".to_owned(),
            location: self.path.display().to_string(),
            disagreements: start.disagreements.clone(),
            contradictions: vec![],
            firmware_limits: match *start.firmware_limits_mm {
                [low, high] => Some((Millimetres(low), Millimetres(high))),
                _ => None,
            },
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.tape.states[index(self.axis)].subscribe()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        let answer = self.tape.next(self.axis, "read", None);
        answer.and_then(|answer| super::error_of(&answer)).map_or_else(|| Ok(self.now()), Err)
    }

    fn homes_also(&self) -> Option<AxisName> {
        let also = self.tape.start[index(self.axis)].homes_also.as_deref()?;
        AxisName::ALL.into_iter().find(|axis| axis.name() == also)
    }

    /// What is replayed moves nothing: there is nothing to stop.
    fn generation(&self) -> u64 {
        0
    }

    fn move_time(&self, _: Millimetres, _: Millimetres) -> MoveTime {
        MoveTime { predicted: Duration::ZERO, maximum: Duration::ZERO }
    }

    async fn home(&self, _: u64) -> Result<(), DeviceError> {
        self.recorded("home")
    }

    async fn set_position(&self, _: Millimetres, _: u64) -> Result<(), DeviceError> {
        self.recorded("set_position")
    }

    /// At the end of a recorded move the axis stands where it stood then; on the way there, where it is sent.
    async fn move_at(&self, target: Millimetres, _: f64, _: u64) -> Result<Millimetres, DeviceError> {
        let Some(answer) = self.tape.next(self.axis, "move", Some(target)) else {
            self.tape.states[index(self.axis)].send_modify(|state| state.position = target);
            return Ok(target);
        };
        match super::error_of(&answer) {
            Some(error) => Err(error),
            None => Ok(answer.readback_mm.map_or(target, Millimetres)),
        }
    }

    fn forget_position(&self) {
        self.tape.states[index(self.axis)].send_modify(|state| state.homed = false);
    }

    async fn release(&self, _: u64) -> Result<(), DeviceError> {
        self.recorded("release")
    }

    async fn stop(&self) -> StopDelivery {
        StopDelivery::Confirmed
    }
}
