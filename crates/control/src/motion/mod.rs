//! The motion rules: the one way to command an axis. A move is checked against latch, lease, homing, limits, the e wall
//! and the greatest step before it starts, once more after the last wait before it, and before each of its pieces;
//! backlash is taken out by approaching every target from the same side.
//!
//! What moves does so under an [`Admission`], which a stop and the end of a lease make void.

pub mod lease;

mod admission;
mod halt;
mod latch;
mod leaving;
mod moving;
mod pieces;
mod rules;

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;
use tokio::time::Instant;

use crate::clock::{Part, enter};
use crate::events::ShellState;
use crate::history::journal::{Journal, Underway};
use crate::loops::axis_model::AxisModel;
use crate::loops::room::Contact;
use crate::motion::admission::Commands;
pub use crate::motion::admission::{Admission, Claim, Stops};
pub use crate::motion::halt::StopReport;
use crate::motion::latch::Latch;
use crate::motion::lease::Leases;
use crate::recording::{Answer, Happening};
use crate::refusal::{Refusal, ServiceError};
use crate::set_up::Moment;
use bench::config::{AxisConfig, Config};
use bench::device::{AxisName, Bench, DeviceError, StageInfo, StageState};
use plenoptics::units::Millimetres;

/// The bench's stages behind the motion rules.
pub struct Motion {
    config: Arc<Config>,
    bench: Bench,
    leases: Arc<Leases>,
    stopped: AtomicBool,
    state: Mutex<State>,
    /// Whether the shell is on has been said anew.
    shell_said: Notify,
    /// One command of motion at a time on each axis: a second is refused, never queued.
    commands: Commands,
    /// What every motion is written to before it begins; none for a bench of a test's own.
    journal: Option<Arc<Journal>>,
}

#[derive(Debug)]
struct State {
    latch: Latch,
    shell: ShellState,
    shell_since: Moment,
    /// Whether the last motion of an axis ended from its approach side.
    approached: [bool; 2],
    l_bound_mm: f64,
    contact: Contact,
    e_known: EKnown,
}

/// By what it is known where e is.
#[derive(Debug, Clone, Copy)]
enum EKnown {
    /// By the axis's readings, as the configuration has them.
    Configured,
    /// By the picture, which whoever moves it keeps to at every move.
    Watched,
    /// By the axis's readings, as the picture has told them through the shell.
    Told(AxisModel),
}

/// While it lives, whoever moves e keeps it off the shell by the picture.
#[must_use]
pub(super) struct WatchedE<'a>(&'a Motion);

impl Drop for WatchedE<'_> {
    fn drop(&mut self) {
        self.0.state().e_known = EKnown::Configured;
    }
}

fn note_end(underway: Option<Underway>, end: Result<Option<Millimetres>, &ServiceError>) {
    if let Some(underway) = underway {
        underway.ended(end);
    }
}

fn index(axis: AxisName) -> usize {
    match axis {
        AxisName::Focus => 0,
        AxisName::E => 1,
    }
}

impl Motion {
    /// The rules of a configuration over a bench, whose axes move for who holds the lease. The shell's state is unknown,
    /// which counts as on.
    #[must_use]
    pub fn new(config: Arc<Config>, bench: Bench, leases: Arc<Leases>) -> Self {
        let (l_bound_mm, contact_mm) = (config.assembly.l_bound_mm, config.assembly.contact_mm());
        Self {
            config,
            bench,
            leases,
            stopped: AtomicBool::new(false),
            state: Mutex::new(State {
                latch: Latch::default(),
                shell: ShellState::Unknown,
                shell_since: Moment::now(),
                approached: [false; 2],
                l_bound_mm,
                contact: Contact { e_mm: contact_mm, measured_sigma_mm: None },
                e_known: EKnown::Configured,
            }),
            shell_said: Notify::new(),
            commands: Commands::default(),
            journal: None,
        }
    }

    /// The same with a history, which every motion is written to before it begins. It counts as stopped until what an
    /// earlier run left of the stop has been read from it.
    pub(super) fn recorded(mut self, journal: Arc<Journal>) -> Self {
        self.state().latch = Latch::unread();
        self.stopped = AtomicBool::new(true);
        self.journal = Some(journal);
        self
    }

    /// Writes a motion that is about to begin.
    async fn record(
        &self,
        axis: AxisName,
        what: &'static str,
        to: Option<Millimetres>,
    ) -> Result<Option<Underway>, Refusal> {
        let Some(journal) = &self.journal else { return Ok(None) };
        let from = self.position_mm(axis).ok().map(Millimetres);
        Ok(Some(journal.begin_motion(axis, what, from, to).await?))
    }

    /// Hands what an axis answered to a job's recording, and with a homing or a release the state of the other one,
    /// which its controller may have taken along.
    fn answered(
        &self,
        axis: AxisName,
        asked: &'static str,
        target: Option<Millimetres>,
        end: Result<Option<Millimetres>, &ServiceError>,
    ) {
        let Some(journal) = &self.journal else { return };
        let state = |axis| Some(self.bench.stage(axis).state().borrow().clone());
        let error = match end {
            Err(ServiceError::Device(error)) => Some(error.clone()),
            _ => None,
        };
        let readback = end.ok().flatten();
        journal.happened(|| {
            Happening::Answer(Answer { axis: Some(axis), asked, target, readback, state: state(axis), error })
        });
        if matches!(asked, "home" | "release") {
            let other = if axis == AxisName::E { AxisName::Focus } else { AxisName::E };
            journal.happened(|| {
                let (target, readback, error) = (None, None, None);
                Happening::Answer(Answer {
                    axis: Some(other),
                    asked: "beside",
                    target,
                    readback,
                    state: state(other),
                    error,
                })
            });
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An axis's configuration.
    #[must_use]
    pub fn axis(&self, axis: AxisName) -> &AxisConfig {
        match axis {
            AxisName::Focus => &self.config.bench.focus,
            AxisName::E => &self.config.bench.e,
        }
    }

    /// Whether the shell is on.
    #[must_use]
    pub fn shell(&self) -> ShellState {
        self.state().shell
    }

    /// Takes the operator's statement about the shell.
    pub fn set_shell(&self, shell: ShellState) {
        let mut state = self.state();
        if state.shell != shell {
            (state.shell, state.shell_since) = (shell, Moment::now());
        }
        drop(state);
        self.shell_said.notify_one();
    }

    /// The operator is asked to mount the shell: from now on it may be on, whatever becomes of the confirmation.
    pub(super) fn shell_may_be_on(&self) {
        if self.shell() == ShellState::Off {
            self.set_shell(ShellState::Unknown);
        }
    }

    /// Since when the shell is on, or off, or that is not known.
    pub(super) fn shell_since(&self) -> Moment {
        self.state().shell_since
    }

    /// Returns once somebody has said anew whether the shell is on.
    pub(super) async fn shell_said(&self) {
        self.shell_said.notified().await;
    }

    /// l_bound in force, mm.
    #[must_use]
    pub fn l_bound_mm(&self) -> f64 {
        self.state().l_bound_mm
    }

    /// Where the lens touches the shell, as far as is known.
    #[must_use]
    pub fn contact(&self) -> Contact {
        self.state().contact
    }

    /// Puts a measured l_bound (clearance included, mm) in the place of the configured one, with where the lens touches.
    pub fn set_l_bound(&self, l_bound_mm: f64, contact: Contact) {
        let mut state = self.state();
        (state.l_bound_mm, state.contact) = (l_bound_mm, contact);
    }

    /// Forgets what was told of the e axis's readings, and lets the wall be kept to by the picture alone.
    pub(super) fn watch_e(&self) -> WatchedE<'_> {
        self.state().e_known = EKnown::Watched;
        WatchedE(self)
    }

    /// Keeps what the picture has told of the e axis's readings, for whoever moves it from here on.
    pub(super) fn set_e_told(&self, told: AxisModel) {
        self.state().e_known = EKnown::Told(told);
    }

    /// Counts where an axis stands as unknown until it is homed, or until that is said: it was seen not to follow.
    pub(super) fn forget_position(&self, axis: AxisName) {
        self.state().approached[index(axis)] = false;
        self.bench.stage(axis).forget_position();
    }

    /// Asks an axis's controller for its state.
    ///
    /// # Errors
    /// When the controller does not answer.
    pub async fn read_state(&self, axis: AxisName) -> Result<StageState, DeviceError> {
        let _moving = enter(Part::Motion);
        let read = self.bench.stage(axis).read_state().await;
        let end = read.as_ref().map(|_| None::<Millimetres>).map_err(|error| ServiceError::Device(error.clone()));
        self.answered(axis, "read", None, end.as_ref().copied());
        read
    }

    /// What the stage of an axis is.
    #[must_use]
    pub fn stage_info(&self, axis: AxisName) -> StageInfo {
        self.bench.stage(axis).info()
    }

    /// The last readback of an axis, mm.
    ///
    /// # Errors
    /// [`DeviceError::NotHomed`] while the position is unknown.
    pub fn position_mm(&self, axis: AxisName) -> Result<f64, DeviceError> {
        let state = self.bench.stage(axis).state().borrow().clone();
        if state.homed { Ok(state.position.value()) } else { Err(DeviceError::NotHomed { axis }) }
    }

    /// From when on a frame counts as taken at rest: both axes at rest, and settled. `None` while one moves.
    #[must_use]
    pub fn settled_from(&self) -> Option<Instant> {
        let at_rest = |axis: AxisName| {
            let state = self.bench.stage(axis).state().borrow().at_rest_since?;
            Some(state + Duration::from_millis(self.axis(axis).settle_ms))
        };
        Some(at_rest(AxisName::Focus)?.max(at_rest(AxisName::E)?))
    }

    /// Why axes are not known to stand, in words.
    pub(super) fn unrest(&self) -> Vec<String> {
        let of = |axis: AxisName| {
            let state = self.bench.stage(axis).state().borrow().clone();
            let why = match (state.connected, state.fault) {
                (false, fault) => {
                    format!("its controller is not connected: {}", fault.as_deref().unwrap_or("it is gone"))
                }
                (true, Some(fault)) => fault,
                (true, None) => "it moves, by what its controller says".to_owned(),
            };
            format!("the {axis} axis: {why}")
        };
        self.moving().into_iter().map(of).collect()
    }

    /// The axes that move, or are not known to stand.
    pub(super) fn moving(&self) -> Vec<AxisName> {
        let stands = |axis: AxisName| self.bench.stage(axis).state().borrow().at_rest_since.is_some();
        AxisName::ALL.into_iter().filter(|&axis| !stands(axis)).collect()
    }
}
