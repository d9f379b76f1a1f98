//! What a controller says: its status reports, alarms and restarts, and what they tell about the axes.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Weak};
use std::time::Duration;

use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use super::super::grbl::{self, Alarm, Mode};
use super::{ANSWER, Controller, POLL_MOVING, Reading, locked};
use crate::device::port::{Kind, Notice};
use crate::device::{DeviceError, StageState};
use plenoptics::units::Millimetres;

/// Time between status requests at rest: Grbl's interface document asks for 5 Hz at most as a rule.
const POLL_AT_REST: Duration = Duration::from_millis(200);
/// No board starts twice within this: the banner was doubled on its way.
const DOUBLED: Duration = Duration::from_millis(50);
/// Time between two readings of settings that another may have changed.
const RENEWAL: Duration = Duration::from_secs(2);
/// Silence after which the controller is shown as lost.
const SILENCE: Duration = Duration::from_millis(1500);
/// Silence after which the port is closed, to be opened anew.
const LOSS: Duration = Duration::from_secs(6);

/// Takes what the controller says by itself, until the port closes or every stage is dropped.
pub(super) async fn listen(
    controller: Weak<Controller>,
    mut notices: mpsc::Receiver<Notice>,
    mut closed: watch::Receiver<Option<String>>,
) {
    while let Some(notice) = notices.recv().await {
        let Some(controller) = controller.upgrade() else { return };
        controller.take_notice(&notice);
    }
    let reason = match closed.wait_for(Option::is_some).await {
        Ok(reason) => reason.clone(),
        Err(_) => None,
    };
    if let Some(controller) = controller.upgrade() {
        let reason = reason.unwrap_or_else(|| "the port is closed".to_owned());
        tracing::warn!(controller = %controller.name, reason = %reason, "a stage controller is lost");
        controller.forget_positions();
        controller.set_states(|state| {
            state.connected = false;
            state.moving = false;
            state.at_rest_since = None;
            state.fault = Some(reason.clone());
        });
    }
}

/// Asks for the status again and again, until the port closes or every stage is dropped.
pub(super) async fn poll(weak: Weak<Controller>, poll_now: Arc<Notify>) {
    let mut renewed = Instant::now();
    loop {
        let asked = Instant::now();
        let period = {
            let Some(controller) = weak.upgrade() else { return };
            if controller.port.closed().borrow().is_some() {
                return;
            }
            // In homing and after a critical alarm nothing is answered.
            let mute =
                controller.homing.load(Ordering::SeqCst) || controller.alarm.borrow().is_some_and(Alarm::is_mute);
            if !mute {
                // A full queue means that the device takes no bytes: the silence will tell.
                let _ = controller.port.urgent(&[grbl::STATUS], false);
                controller.note_silence();
                if renewed.elapsed() > RENEWAL && controller.renew_at_rest().await {
                    renewed = Instant::now();
                }
            }
            if controller.watched.load(Ordering::SeqCst) > 0 { POLL_MOVING } else { POLL_AT_REST }
        };
        tokio::select! {
            () = tokio::time::sleep_until(asked + period) => {}
            () = poll_now.notified() => tokio::time::sleep_until(asked + POLL_MOVING).await,
        }
    }
}

/// Asks for readings at the faster rate while it lives.
pub(super) struct Watching<'a>(&'a Controller);

impl Drop for Watching<'_> {
    fn drop(&mut self) {
        self.0.watched.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Controller {
    pub(super) fn watching(&self) -> Watching<'_> {
        self.watched.fetch_add(1, Ordering::SeqCst);
        self.poll_now.notify_one();
        Watching(self)
    }

    fn set_states(&self, change: impl Fn(&mut StageState)) {
        for axis in &self.axes {
            axis.link.modify(&change);
        }
    }

    pub(super) fn forget_positions(&self) {
        for axis in &self.axes {
            axis.link.forget_home();
        }
    }

    fn take_notice(&self, notice: &Notice) {
        *locked(&self.heard) = Instant::now();
        match notice.kind {
            Kind::Started => {
                let ours = self.restart_is_ours.swap(false, Ordering::SeqCst);
                let doubled = locked(&self.restarted).replace(Instant::now()).is_some_and(|at| at.elapsed() < DOUBLED);
                if !ours && !doubled && self.alarm.borrow().is_none() {
                    tracing::warn!(controller = %self.name, "a stage controller has restarted by itself");
                    self.forget_positions();
                    self.forget_ways();
                    self.shared_with_another("it restarted by itself");
                }
                if self.alarm.send_replace(None).is_some_and(Alarm::needs_reset) {
                    // That has been done: its next status says what is left to do.
                    self.set_states(|state| state.fault = None);
                }
                self.restarts.send_modify(|count| *count += 1);
            }
            Kind::Halted => {
                let alarm = Alarm::from_line(&notice.line, self.dialect).unwrap_or(Alarm::unknown(self.dialect));
                tracing::warn!(controller = %self.name, alarm = %alarm, "a stage controller is in alarm");
                self.forget_positions();
                let moved = self.axes.iter().any(|axis| axis.link.state().moving) || self.homing.load(Ordering::SeqCst);
                if !moved {
                    // A switch that changes at rest was reached by hand: which one is not known.
                    self.forget_ways();
                }
                let words = self.alarm_words(alarm);
                self.set_states(|state| {
                    state.moving = false;
                    state.fault = Some(words.clone());
                });
                self.alarm.send_replace(Some(alarm));
            }
            // The answer to what this program has not asked.
            Kind::Done | Kind::Refused => self.shared_with_another(&notice.line),
            _ => {
                if let Some(status) = grbl::status(&notice.line) {
                    if status.pendant == Some(true) {
                        self.shared_with_another("a pendant has it");
                    }
                    self.take_status(&status, notice.line_number);
                } else if Alarm::from_line(&notice.line, self.dialect).is_some_and(Alarm::is_unhomed) {
                    // What it says after its start; it takes lines all the same.
                    self.forget_positions();
                }
            }
        }
    }

    fn take_status(&self, status: &grbl::Status, line_number: u64) {
        let mut offset = locked(&self.work_offset);
        *offset = status.work_offset.or(*offset);
        let machine = status.machine.or_else(|| {
            let (work, offset) = (status.work?, (*offset)?);
            Some(std::array::from_fn(|i| work[i] + offset[i]))
        });
        drop(offset);
        let Some(machine) = machine else { return };
        let now = Instant::now();
        let quiet = self.alarm.borrow().is_none();
        if status.mode == Mode::Sleep {
            // The motors are off: the axes can be turned by hand.
            self.forget_positions();
            self.forget_ways();
        }
        for axis in &self.axes {
            let home = axis.link.home();
            let at = machine[axis.letter.index()];
            let pin = axis.note_pin(status.limits);
            let position = Millimetres(axis.link.setup().coordinate(at, home.unwrap_or(at)));
            axis.link.modify(|state| {
                let moved = state.position != position;
                // Why it was not there is no reason of now.
                let back = !std::mem::replace(&mut state.connected, true);
                state.position = position;
                state.moving = !status.mode.at_rest();
                state.limit_switch = axis.pressed(status.limits);
                if state.moving {
                    state.at_rest_since = None;
                } else if moved || state.at_rest_since.is_none() {
                    state.at_rest_since = Some(now);
                }
                if let Some(words) = &pin {
                    state.fault.clone_from(words);
                }
                match status.mode {
                    // Locked for another axis's sake, which is not homed.
                    Mode::Alarm if home.is_some() && quiet && !matches!(pin, Some(Some(_))) => state.fault = None,
                    Mode::Alarm | Mode::Idle if matches!(pin, Some(Some(_))) => {}
                    Mode::Alarm if back || state.fault.is_none() => {
                        state.fault = Some("the controller is locked until it is homed".to_owned());
                    }
                    Mode::Alarm => {}
                    Mode::Sleep => {
                        state.fault = Some(
                            "the controller is asleep, its motors without current: homing wakes it, and a stop does"
                                .to_owned(),
                        );
                    }
                    Mode::Door => state.fault = Some("the controller's safety door is open".to_owned()),
                    Mode::Hold(_) => state.fault = Some("the controller is held; stop to release it".to_owned()),
                    _ => state.fault = None,
                }
            });
        }
        self.readings.send_replace(Some(Reading {
            mode: status.mode,
            machine,
            limits: status.limits,
            hold_pressed: status.hold_pressed,
            line_number,
            at: now,
        }));
    }

    fn note_silence(&self) {
        let silent = locked(&self.heard).elapsed();
        if silent > LOSS {
            self.port.close("the controller does not answer");
        }
        if silent > SILENCE && self.axes.iter().any(|axis| axis.link.state().connected) {
            self.set_states(|state| {
                state.connected = false;
                state.at_rest_since = None;
                state.fault = Some("the controller does not answer".to_owned());
            });
        }
    }

    pub(super) fn latest_line(&self) -> u64 {
        self.readings.borrow().as_ref().map_or(0, |reading| reading.line_number)
    }

    pub(super) fn closed_error(&self) -> Option<DeviceError> {
        let reason = self.port.closed().borrow().clone()?;
        Some(DeviceError::Disconnected { device: self.name.clone(), reason })
    }

    pub(super) fn timeout(&self, what: &str, allowed: Duration) -> DeviceError {
        DeviceError::Timeout { device: self.name.clone(), what: what.to_owned(), allowed }
    }

    /// A reading later than a line.
    pub(super) async fn fresh_reading(&self, after_line: u64) -> Result<Reading, DeviceError> {
        let mut readings = self.readings.subscribe();
        let mut closed = self.port.closed();
        self.poll_now.notify_one();
        tokio::select! {
            reading = readings.wait_for(|r| r.as_ref().is_some_and(|r| r.line_number > after_line)) => {
                let reading = reading.ok().and_then(|reading| reading.clone());
                reading.ok_or_else(|| self.timeout("report its status", ANSWER))
            }
            _ = closed.wait_for(Option::is_some) => {
                Err(self.closed_error().unwrap_or_else(|| self.timeout("report its status", ANSWER)))
            }
            () = tokio::time::sleep(ANSWER) => Err(self.timeout("report its status", ANSWER)),
        }
    }

    /// Waits until two readings one after another, both later than a line, say rest at the same place.
    pub(super) async fn rest(&self, after_line: u64) -> Result<Reading, DeviceError> {
        self.rest_or_proof(after_line, |_| false).await
    }

    /// The same for the end of a stop, which a hold that is complete proves at once.
    pub(super) async fn rest_or_hold(&self, after_line: u64) -> Result<Reading, DeviceError> {
        self.rest_or_proof(after_line, |mode| mode == Mode::Hold(true)).await
    }

    async fn rest_or_proof(&self, mut after_line: u64, proof: impl Fn(Mode) -> bool) -> Result<Reading, DeviceError> {
        let mut last: Option<Reading> = None;
        loop {
            let reading = self.fresh_reading(after_line).await?;
            after_line = reading.line_number;
            if reading.mode == Mode::Door {
                let reason = "its safety door is open; close it, stop (which resets the controller), then home";
                return Err(DeviceError::Alarm { device: self.name.clone(), reason: reason.to_owned() });
            }
            // Locked but at rest: the alarm itself is reported by whoever asked for the motion.
            let resting = reading.mode.at_rest();
            let same = last.as_ref().is_some_and(|last| last.machine == reading.machine);
            if proof(reading.mode) || (resting && same) {
                return Ok(reading);
            }
            last = resting.then_some(reading);
        }
    }
}
