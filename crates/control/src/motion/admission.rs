//! Under what an axis moves: a command carries the lease and the stops of its admission, and ends with either.
//!
//! ```text
//!   asked      generations read
//!   claimed    the axis taken -> latch, lease, generation looked at     a stop, or the end of the lease, is seen here,
//!                                                                       or finds the command under way and ends it,
//!   each order carries the generation of its admission                  or outdates it below, in the controller
//! ```
//!
//! A stop latches first and outdates then; a lease is over first, and what moves under it is ended then. So nothing that
//! either of them concerns can slip between two of these looks.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::task::Poll;
use std::time::Duration;

use futures_util::future::join_all;
use tokio::sync::Notify;

use super::lease::Permit;
use super::{Motion, index};
use crate::events::ShellState;
use crate::refusal::{Refusal, ServiceError};
use bench::device::{AxisName, DeviceError, StopDelivery};

/// How long a command may take to end once its axis was stopped.
const END_ALLOWED: Duration = Duration::from_secs(1);

/// What commands are admitted under: a lease, and the stops that had been given by then. What is admitted may move as
/// long as that lease is in force and no other stop has come.
#[derive(Debug, Clone, PartialEq)]
pub struct Admission {
    permit: Permit,
    stops: Stops,
}

/// The stops that had been given at some moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stops {
    /// Of each axis: what commands of then carry.
    generations: [u64; 2],
    /// The stops and resets by then.
    turns: u64,
}

impl Admission {
    /// The stops and resets by then.
    pub(crate) const fn turns(&self) -> u64 {
        self.stops.turns
    }
}

/// The right to command motion of one axis, until every clone of it is dropped.
#[derive(Debug, Clone)]
pub struct Claim {
    command: Arc<Commanded>,
    /// The other axis, where its controller takes it along.
    along: Option<Arc<Commanded>>,
}

#[derive(Debug)]
struct Commanded {
    axis: AxisName,
    admission: Admission,
    /// Whether its lease ended under it.
    control_ended: AtomicBool,
    freed: Arc<Notify>,
}

impl Drop for Commanded {
    fn drop(&mut self) {
        self.freed.notify_waiters();
    }
}

/// The commands that have an axis.
#[derive(Debug, Default)]
pub(super) struct Commands {
    claimed: Mutex<[Weak<Commanded>; 2]>,
    /// Told whenever an axis is free again.
    freed: Arc<Notify>,
    /// One at a time ends commands without a lease: the next finds them ended.
    ending: tokio::sync::Mutex<()>,
}

impl Commands {
    fn claimed(&self) -> MutexGuard<'_, [Weak<Commanded>; 2]> {
        self.claimed.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Claim {
    /// Which axis.
    #[must_use]
    pub fn axis(&self) -> AxisName {
        self.command.axis
    }

    /// That axis, and the one that its controller takes along.
    pub(crate) fn axes(&self) -> impl Iterator<Item = AxisName> {
        std::iter::once(self.command.axis).chain(self.along.as_ref().map(|along| along.axis))
    }

    /// Under what it was admitted.
    #[must_use]
    pub fn admission(&self) -> &Admission {
        &self.command.admission
    }

    /// What its orders carry.
    pub(super) fn generation(&self) -> u64 {
        self.command.admission.stops.generations[index(self.command.axis)]
    }

    /// How a command ended: where its lease ended under it, that is why it did not end as commanded.
    pub(super) fn judge<T>(&self, what: &'static str, ended: Result<T, ServiceError>) -> Result<T, ServiceError> {
        ended.map_err(|error| match self.command.control_ended.load(Ordering::SeqCst) {
            true => Refusal::ControlEnded { axis: self.axis(), homing: what == "home" }.into(),
            false => error,
        })
    }
}

impl Motion {
    /// The stops that have been given by now.
    #[must_use]
    pub fn stops(&self) -> Stops {
        let turns = self.turns();
        Stops { generations: AxisName::ALL.map(|axis| self.bench.stage(axis).generation()), turns }
    }

    /// What the holder of a lease asks for now, or asked for when the permit says, is admitted under. Whether that may
    /// move is looked at when it takes an axis: a stop that comes from then on outdates it, also where it is reset
    /// before that.
    #[must_use]
    pub fn admit(&self, permit: &Permit) -> Admission {
        let (asked, permit) = permit.split();
        Admission { permit, stops: asked.unwrap_or_else(|| self.stops()) }
    }

    /// Whether what was admitted may move an axis now.
    ///
    /// # Errors
    /// [`Refusal::Stopped`] or [`DeviceError::Stopped`] after a stop, [`Refusal::LeaseLost`] where the lease is over.
    pub fn in_force(&self, admission: &Admission, axis: AxisName) -> Result<(), ServiceError> {
        self.check_latch()?;
        self.leases.check(&admission.permit)?;
        let is_newest = self.bench.stage(axis).generation() == admission.stops.generations[index(axis)];
        if is_newest && self.turns() == admission.turns() { Ok(()) } else { Err(DeviceError::Stopped { axis }.into()) }
    }

    /// Takes the right to command an axis, which a command that answers before its end holds until then.
    ///
    /// # Errors
    /// [`Refusal::Moving`] while another command has it, or has the one that it takes turns with, or one under an earlier
    /// lease has yet to end; those of [`Motion::in_force`].
    pub fn claim(&self, admission: &Admission, axis: AxisName) -> Result<Claim, ServiceError> {
        self.claim_with(admission, axis, None)
    }

    /// [`Motion::claim`] of an axis to be homed, with the other one where its controller homes both at once.
    ///
    /// # Errors
    /// Those of [`Motion::claim`].
    pub fn claim_homing(&self, admission: &Admission, axis: AxisName) -> Result<Claim, ServiceError> {
        self.claim_with(admission, axis, self.bench.stage(axis).homes_also())
    }

    /// [`Motion::claim`] of an axis, and of the one that its controller takes along.
    pub(super) fn claim_with(
        &self,
        admission: &Admission,
        axis: AxisName,
        along: Option<AxisName>,
    ) -> Result<Claim, ServiceError> {
        let taken_along = along.map(|other| self.take(admission, other, None)).transpose()?;
        Ok(Claim { command: self.take(admission, axis, along)?, along: taken_along })
    }

    /// Takes an axis for a command, which has the one along already.
    fn take(
        &self,
        admission: &Admission,
        axis: AxisName,
        along: Option<AxisName>,
    ) -> Result<Arc<Commanded>, ServiceError> {
        self.in_force(admission, axis)?;
        let command = Arc::new(Commanded {
            axis,
            admission: admission.clone(),
            control_ended: AtomicBool::new(false),
            freed: Arc::clone(&self.commands.freed),
        });
        // Between two pieces of its way an axis stands, and is under its command all the same.
        let turns = self.bench.stage(axis).takes_turns_with().filter(|&other| along != Some(other));
        {
            let mut claimed = self.commands.claimed();
            for (other, taken) in AxisName::ALL.into_iter().zip(claimed.iter().map(Weak::upgrade)) {
                let bars = other == axis || turns == Some(other);
                // Ending another lease's command may stop this axis, too.
                if taken.is_some_and(|taken| bars || taken.admission.permit != admission.permit) {
                    return Err(Refusal::Moving { axis: other }.into());
                }
            }
            claimed[index(axis)] = Arc::downgrade(&command);
        }
        // Once more now that the command is known: what comes from here on finds it.
        self.in_force(admission, axis)?;
        Ok(command)
    }

    /// Takes the operator's statement about the shell, while no axis is under a command.
    ///
    /// # Errors
    /// [`Refusal::Moving`] while one is: it was admitted under what was said before.
    pub(crate) fn set_shell_at_rest(&self, shell: ShellState) -> Result<(), Refusal> {
        let claimed = self.commands.claimed();
        for (axis, taken) in AxisName::ALL.into_iter().zip(claimed.iter()) {
            if taken.strong_count() > 0 {
                return Err(Refusal::Moving { axis });
            }
        }
        self.set_shell(shell);
        Ok(())
    }

    /// Whether a command of motion has the axis: from its acceptance to its end, also between two pieces of it.
    #[must_use]
    pub fn is_commanded(&self, axis: AxisName) -> bool {
        self.commands.claimed()[index(axis)].strong_count() > 0
    }

    /// Ends what moves under a lease that is over, and nothing else. Returns once it has ended, or does not in time.
    pub(crate) async fn end_uncontrolled(&self) {
        let _one = self.commands.ending.lock().await;
        let uncontrolled = |command: &Arc<Commanded>| self.leases.check(&command.admission.permit).is_err();
        let commands: Vec<_> =
            self.commands.claimed().iter().filter_map(Weak::upgrade).filter(|command| uncontrolled(command)).collect();
        let axes: Vec<_> = commands.iter().map(|command| command.axis).collect();
        for command in &commands {
            command.control_ended.store(true, Ordering::SeqCst);
        }
        let mut stops = Box::pin(join_all(axes.iter().map(|&axis| self.stop_axis(axis))));
        // Held on to until the stops have outdated what was ordered before: nothing else is outdated with it.
        let begun = futures_util::poll!(&mut stops);
        drop(commands);
        let stops = match begun {
            Poll::Ready(stops) => stops,
            Poll::Pending => stops.await,
        };
        for (axis, delivery) in axes.into_iter().zip(stops) {
            tracing::info!(%axis, ?delivery, "the control lease ended under a command: the axis was stopped");
            self.freed(axis).await;
        }
    }

    /// Stops one axis (and whatever else its controller moves) at once without latching.
    pub(crate) async fn stop_axis(&self, axis: AxisName) -> StopDelivery {
        self.state().approached[index(axis)] = false;
        self.bench.stage(axis).stop().await
    }

    /// Returns once no command has the axis, or does not end in time.
    pub(super) async fn freed(&self, axis: AxisName) {
        let free = async {
            loop {
                let freed = self.commands.freed.notified();
                if !self.is_commanded(axis) {
                    return;
                }
                freed.await;
            }
        };
        if tokio::time::timeout(END_ALLOWED, free).await.is_err() {
            tracing::error!(%axis, "a command did not end although its axis was stopped");
        }
    }
}
