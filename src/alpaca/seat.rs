//! The seat of the one client that may move: its hold on the control lease.
//!
//! A client that connects a Focuser takes the lease as `alpaca:` and its ClientID, and keeps it for as long as it asks
//! anything in time; with its last Focuser disconnected it is given back. A lease that has run out, or was taken over,
//! leaves its client disconnected.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use super::fault::Fault;
use super::request::Caller;
use crate::control::Service;
use crate::control::events::LeaseView;
use crate::control::motion::lease::{LeaseRequest, Permit};
use crate::device::AxisName;

/// A lease is renewed so often at most: each renewal is written down.
const RENEWED: Duration = Duration::from_secs(1);

/// Who has the seat, if anybody.
pub(super) struct Seat {
    service: Arc<Service>,
    ttl: Duration,
    taken: Mutex<Option<Taken>>,
}

struct Taken {
    caller: Caller,
    /// Key of the lease.
    key: String,
    renewed: Instant,
    /// The Focusers that the client has connected.
    connected: [bool; 2],
    /// Those whose last command was the client's own, and was not halted: it is told how that ended.
    commanded: [bool; 2],
}

fn index(axis: AxisName) -> usize {
    match axis {
        AxisName::Focus => 0,
        AxisName::E => 1,
    }
}

impl Seat {
    pub(super) fn new(service: Arc<Service>, ttl: Duration) -> Self {
        Self { service, ttl, taken: Mutex::default() }
    }

    /// Who has it now; nobody any more once the lease is gone.
    fn taken(&self) -> MutexGuard<'_, Option<Taken>> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if taken.as_ref().is_some_and(|taken| self.service.leases().permit(Some(&taken.key)).is_err()) {
            *taken = None;
        }
        taken
    }

    /// Renews the lease, where the caller has it.
    pub(super) fn renew(&self, caller: Caller) {
        if let Some(taken) = self.taken().as_mut().filter(|taken| taken.caller == caller)
            && taken.renewed.elapsed() >= RENEWED.min(self.ttl / 8)
            && self.service.leases().renew(Some(&taken.key)).is_ok()
        {
            taken.renewed = Instant::now();
        }
    }

    /// Connects a Focuser. Returns the lease where it was taken by this.
    pub(super) fn connect(&self, caller: Caller, axis: AxisName) -> Result<Option<LeaseView>, Fault> {
        if caller.id == 0 {
            return Err(Fault::invalid_operation(
                "a Focuser is connected by a client that tells a ClientID above 0: who may move has to be told from others",
            ));
        }
        let mut taken = self.taken();
        if let Some(taken) = taken.as_mut().filter(|taken| taken.caller == caller) {
            taken.connected[index(axis)] = true;
            return Ok(None);
        }
        let note = format!("ASCOM Alpaca from {}", caller.address);
        let request = LeaseRequest::new(caller.name(), Some(note), Some(self.ttl.as_secs_f64()))?;
        let grant = self.service.leases().acquire(request)?;
        let mut connected = [false; 2];
        connected[index(axis)] = true;
        *taken = Some(Taken { caller, key: grant.key, renewed: Instant::now(), connected, commanded: [false; 2] });
        Ok(Some(grant.lease))
    }

    /// Disconnects a Focuser. Returns the lease where it was given back by this.
    pub(super) fn disconnect(&self, caller: Caller, axis: AxisName) -> Option<LeaseView> {
        let mut taken = self.taken();
        let held = taken.as_mut().filter(|taken| taken.caller == caller)?;
        held.connected[index(axis)] = false;
        if held.connected != [false; 2] {
            return None;
        }
        let released = self.service.leases().release(Some(&held.key)).ok().flatten();
        *taken = None;
        released
    }

    pub(super) fn is_connected(&self, caller: Caller, axis: AxisName) -> bool {
        self.taken().as_ref().is_some_and(|taken| taken.caller == caller && taken.connected[index(axis)])
    }

    /// The right to move an axis.
    pub(super) fn permit(&self, caller: Caller, axis: AxisName) -> Result<Permit, Fault> {
        match self.taken().as_ref() {
            Some(taken) if taken.caller == caller && taken.connected[index(axis)] => {
                Ok(self.service.leases().permit(Some(&taken.key))?)
            }
            _ => Err(self.not_connected(axis)),
        }
    }

    /// That a caller is not connected to a Focuser, and who stands in its way.
    pub(super) fn not_connected(&self, axis: AxisName) -> Fault {
        let holder = self.service.leases().view();
        let holder = holder.map(|lease| format!("; {} has the control lease", lease.owner)).unwrap_or_default();
        let ttl = self.ttl.as_secs_f64();
        Fault::not_connected(format!(
            "this client is not connected to the {axis} axis: set Connected to True, and ask something every {ttl} s to \
             stay so{holder}"
        ))
    }

    /// Notes that an axis goes by the caller's command.
    pub(super) fn commands(&self, caller: Caller, axis: AxisName) {
        if let Some(taken) = self.taken().as_mut().filter(|taken| taken.caller == caller) {
            taken.commanded[index(axis)] = true;
        }
    }

    /// Notes that an axis was halted: that its command did not end as commanded is no news.
    pub(super) fn halted(&self, axis: AxisName) {
        if let Some(taken) = self.taken().as_mut() {
            taken.commanded[index(axis)] = false;
        }
    }

    /// Whether an axis went by the caller's command last.
    pub(super) fn has_commanded(&self, caller: Caller, axis: AxisName) -> bool {
        self.taken().as_ref().is_some_and(|taken| taken.caller == caller && taken.commanded[index(axis)])
    }
}
