//! The control lease: who may move the axes. One at a time; reading and stopping never need it.
//!
//! A lease lives for its time to live from the last heartbeat. One that a connection holds lives as long as that
//! connection, and [`GRACE`] longer. While a job runs, the job holds the lease of its starter, heartbeat or not.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio::time::Instant;
use utoipa::ToSchema;
use uuid::Uuid;

use super::Stops;
use crate::events::LeaseView;
use crate::field::words;
use crate::refusal::{Refusal, ServiceError};
use bench::access::Digest;

/// How long a lease outlives the connection or the job that held it, unless renewed otherwise.
pub const GRACE: Duration = Duration::from_secs(10);
/// Shortest and longest time to live that may be asked for, s.
pub const TTL_RANGE_S: [f64; 2] = [2.0, 3600.0];
/// Time to live where none is asked for, s.
pub const DEFAULT_TTL_S: f64 = 30.0;

/// A lease just granted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseGrant {
    /// What shows that a request comes from the holder. Said once, to the holder alone.
    pub key: String,
    /// The lease.
    pub lease: LeaseView,
}

/// Who asks for a lease, and for how long.
#[derive(Debug, Clone, PartialEq)]
pub struct LeaseRequest {
    /// Who.
    pub owner: String,
    /// What for.
    pub note: Option<String>,
    /// Time to live from a heartbeat.
    pub ttl: Duration,
}

impl LeaseRequest {
    /// A request that makes sense, for [`DEFAULT_TTL_S`] where no time to live is given.
    ///
    /// # Errors
    /// [`ServiceError::Invalid`] names the field: owner and note are short and printable, the time to live is within
    /// [`TTL_RANGE_S`].
    pub fn new(owner: String, note: Option<String>, ttl_s: Option<f64>) -> Result<Self, ServiceError> {
        words("owner", &owner)?;
        note.as_deref().map_or(Ok(()), |note| words("note", note))?;
        let ttl_s = ttl_s.unwrap_or(DEFAULT_TTL_S);
        let [low, high] = TTL_RANGE_S;
        if !(low..=high).contains(&ttl_s) {
            return Err(ServiceError::Invalid {
                field: "ttl_s",
                what: format!("{ttl_s} is not within {low} to {high}"),
            });
        }
        Ok(Self { owner, note, ttl: Duration::from_secs_f64(ttl_s) })
    }
}

/// That the holder of the lease asks: what every command of motion needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Permit {
    lease: Uuid,
    owner: String,
    /// The stops when it was asked, where that is known to be earlier than now.
    asked: Option<Stops>,
}

impl Permit {
    /// For what was asked for when these were all the stops that had been given: what has stopped since ends it.
    #[must_use]
    pub fn asked_at(self, stops: Stops) -> Self {
        Self { asked: Some(stops), ..self }
    }

    /// The stops when it was asked, and the permit of whatever the holder asks.
    pub(crate) fn split(&self) -> (Option<Stops>, Self) {
        (self.asked, Self { asked: None, ..self.clone() })
    }

    /// Whose lease it is.
    #[must_use]
    pub fn owner(&self) -> &str {
        &self.owner
    }
}

/// A lease as it is kept over a restart.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct KeptLease {
    id: Uuid,
    /// What is kept of its key.
    key: Digest,
    owner: String,
    note: Option<String>,
    since: jiff::Timestamp,
    ttl_s: f64,
    expires_at: jiff::Timestamp,
}

struct Held {
    id: Uuid,
    key: Digest,
    owner: String,
    note: Option<String>,
    since: jiff::Timestamp,
    ttl: Duration,
    until: Instant,
    connections: usize,
    job: Option<Uuid>,
    /// Given back while a job still holds it: its end is no surprise.
    given_back: bool,
}

impl Held {
    /// When it runs out; `None` while something holds it that needs no heartbeat.
    fn runs_out(&self) -> Option<Instant> {
        (self.job.is_none() && self.connections == 0).then_some(self.until)
    }

    fn expires_at(&self) -> jiff::Timestamp {
        let left = self.until.saturating_duration_since(Instant::now());
        jiff::Timestamp::now().checked_add(left).unwrap_or(jiff::Timestamp::MAX)
    }

    fn view(&self) -> LeaseView {
        LeaseView {
            id: self.id,
            owner: self.owner.clone(),
            note: self.note.clone(),
            since: self.since,
            ttl_s: self.ttl.as_secs_f64(),
            expires_at: self.runs_out().map(|_| self.expires_at()),
            job: self.job,
        }
    }
}

/// The one lease of a bench.
#[derive(Default)]
pub struct Leases {
    held: Mutex<Option<Held>>,
    /// Those that have run out, for whoever writes it down.
    run_out: Mutex<Vec<LeaseView>>,
    /// Whether there has been one in this run: then what an earlier run left no longer counts.
    begun: AtomicBool,
    /// Counts the changes, for whoever publishes them.
    changes: watch::Sender<u64>,
}

impl Leases {
    /// The lease as it is now, an expired one already gone.
    fn now(&self) -> MutexGuard<'_, Option<Held>> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(lease) = &*held
            && lease.runs_out().is_some_and(|until| until <= Instant::now())
        {
            if !lease.given_back {
                self.ran_out(lease.view());
            }
            *held = None;
            self.changed();
        }
        held
    }

    fn ran_out(&self, lease: LeaseView) {
        tracing::info!(owner = %lease.owner, "the control lease ran out");
        self.run_out.lock().unwrap_or_else(PoisonError::into_inner).push(lease);
    }

    /// The leases that have run out since this was last asked, though nobody gave them back or took them over.
    #[must_use]
    pub fn take_run_out(&self) -> Vec<LeaseView> {
        std::mem::take(&mut *self.run_out.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn changed(&self) {
        self.changes.send_modify(|count| *count += 1);
    }

    /// Changes of the lease from now on: granted, renewed, released, run out.
    #[must_use]
    pub fn changes(&self) -> watch::Receiver<u64> {
        self.changes.subscribe()
    }

    /// Who holds it.
    #[must_use]
    pub fn view(&self) -> Option<LeaseView> {
        self.now().as_ref().map(Held::view)
    }

    /// When the lease runs out, if it can.
    #[must_use]
    pub fn runs_out(&self) -> Option<Instant> {
        self.now().as_ref().and_then(Held::runs_out)
    }

    /// Grants the lease where nobody has it.
    ///
    /// # Errors
    /// [`Refusal::LeaseHeld`], naming the holder.
    pub fn acquire(&self, request: LeaseRequest) -> Result<LeaseGrant, Refusal> {
        let mut held = self.now();
        match &*held {
            Some(lease) => Err(held_by(lease)),
            None => Ok(self.grant(&mut held, request)),
        }
    }

    /// Grants the lease to another than who has it, be it a job: from here on the former key opens nothing. What moves
    /// under it is the caller's to end.
    pub fn take_over(&self, request: LeaseRequest) -> LeaseGrant {
        self.grant(&mut self.now(), request)
    }

    fn grant(&self, held: &mut Option<Held>, request: LeaseRequest) -> LeaseGrant {
        self.begun.store(true, Ordering::SeqCst);
        let key = format!("{:032x}", rand::random::<u128>());
        let lease = Held {
            id: Uuid::now_v7(),
            key: Digest::of(&key),
            owner: request.owner,
            note: request.note,
            since: jiff::Timestamp::now(),
            ttl: request.ttl,
            until: Instant::now() + request.ttl,
            connections: 0,
            job: None,
            given_back: false,
        };
        let grant = LeaseGrant { key, lease: lease.view() };
        *held = Some(lease);
        self.changed();
        grant
    }

    /// Runs `change` on the lease that `key` opens.
    fn with<T>(&self, key: Option<&str>, change: impl FnOnce(&mut Held) -> T) -> Result<T, Refusal> {
        let key = key.ok_or(Refusal::LeaseRequired)?;
        match &mut *self.now() {
            Some(lease) if lease.key.matches(&Digest::of(key)) => Ok(change(lease)),
            other => Err(lost_to(other.as_ref())),
        }
    }

    /// Whether a permit's lease is still in force.
    ///
    /// # Errors
    /// [`Refusal::LeaseLost`] where it is over.
    pub fn check(&self, permit: &Permit) -> Result<(), Refusal> {
        match &*self.now() {
            Some(lease) if lease.id == permit.lease => Ok(()),
            other => Err(lost_to(other.as_ref())),
        }
    }

    /// Whether `key` is the holder's.
    ///
    /// # Errors
    /// [`Refusal::LeaseRequired`] without a key, [`Refusal::LeaseLost`] with one that is not the holder's.
    pub fn permit(&self, key: Option<&str>) -> Result<Permit, Refusal> {
        self.with(key, |lease| Permit { lease: lease.id, owner: lease.owner.clone(), asked: None })
    }

    /// Runs `change` on the lease that `key` opens and that was not given back: one that was ends with the job that
    /// still holds it, whoever asks for more.
    fn with_kept<T>(&self, key: Option<&str>, change: impl FnOnce(&mut Held) -> T) -> Result<T, Refusal> {
        let given_back = |lease: &Held| Refusal::LeaseLost { holder: Some(lease.owner.clone()) };
        self.with(key, |lease| if lease.given_back { Err(given_back(lease)) } else { Ok(change(lease)) })?
    }

    /// Renews the lease for its time to live.
    ///
    /// # Errors
    /// As [`Leases::permit`], and [`Refusal::LeaseLost`] where it was given back.
    pub fn renew(&self, key: Option<&str>) -> Result<LeaseView, Refusal> {
        let view = self.with_kept(key, |lease| {
            lease.until = Instant::now() + lease.ttl;
            lease.view()
        })?;
        self.changed();
        Ok(view)
    }

    /// Gives the lease back; where a job holds it, at that job's end. Returns what is given back: a key that is not the
    /// holder's has nothing to give. The service, which watches the [changes](Self::changes), ends what moves under it.
    ///
    /// # Errors
    /// [`Refusal::LeaseRequired`] without a key.
    pub fn release(&self, key: Option<&str>) -> Result<Option<LeaseView>, Refusal> {
        let key = key.ok_or(Refusal::LeaseRequired)?;
        let mut held = self.now();
        let shown = Digest::of(key);
        let Some(lease) = held.as_mut().filter(|lease| lease.key.matches(&shown)) else { return Ok(None) };
        let released = lease.view();
        if lease.job.is_some() {
            lease.connections = 0;
            lease.until = Instant::now();
            lease.given_back = true;
        } else {
            *held = None;
        }
        self.changed();
        Ok(Some(released))
    }

    /// A connection holds the lease until [`Leases::disconnect`].
    ///
    /// # Errors
    /// As [`Leases::renew`].
    pub fn connect(&self, key: &str) -> Result<Permit, Refusal> {
        let permit = self.with_kept(Some(key), |lease| {
            lease.connections += 1;
            Permit { lease: lease.id, owner: lease.owner.clone(), asked: None }
        })?;
        self.changed();
        Ok(permit)
    }

    /// A connection that held the lease is gone: after [`GRACE`] it runs out, unless it is renewed.
    pub fn disconnect(&self, permit: &Permit) {
        if let Some(lease) = &mut *self.now()
            && lease.id == permit.lease
        {
            lease.connections = lease.connections.saturating_sub(1);
            if lease.connections == 0 && !lease.given_back {
                lease.until = Instant::now() + GRACE;
            }
            self.changed();
        }
    }

    /// A job holds the lease from now on.
    ///
    /// # Errors
    /// [`Refusal::LeaseLost`] where the permit's lease is over.
    pub fn bind(&self, permit: &Permit, job: Uuid) -> Result<(), Refusal> {
        match &mut *self.now() {
            Some(lease) if lease.id == permit.lease => {
                lease.job = Some(job);
                self.changed();
                Ok(())
            }
            other => Err(lost_to(other.as_ref())),
        }
    }

    /// The job has ended: its starter has the lease again for as long as it lives, and [`GRACE`] at least where it was
    /// not given back.
    pub fn unbind(&self, job: Uuid) {
        let mut held = self.now();
        if let Some(lease) = &mut *held
            && lease.job == Some(job)
        {
            lease.job = None;
            if !lease.given_back {
                lease.until = lease.until.max(Instant::now() + GRACE);
            }
            self.changed();
        }
    }

    /// What to keep over a restart: nothing of a lease that was given back, whose job ends with the program.
    #[must_use]
    pub fn keep(&self) -> Option<KeptLease> {
        self.now().as_ref().filter(|lease| !lease.given_back).map(|lease| KeptLease {
            id: lease.id,
            key: lease.key,
            owner: lease.owner.clone(),
            note: lease.note.clone(),
            since: lease.since,
            ttl_s: lease.ttl.as_secs_f64(),
            expires_at: if lease.runs_out().is_some() {
                lease.expires_at()
            } else {
                jiff::Timestamp::now().checked_add(lease.ttl.max(GRACE)).unwrap_or(jiff::Timestamp::MAX)
            },
        })
    }

    /// Takes a kept lease up again, once a run and before any other, where it has not run out meanwhile. Its job is over,
    /// and so are its connections.
    pub fn restore(&self, kept: KeptLease) {
        let left = kept.expires_at.duration_since(jiff::Timestamp::now());
        let ttl = Duration::from_secs_f64(kept.ttl_s.clamp(TTL_RANGE_S[0], TTL_RANGE_S[1]));
        let left = Duration::try_from(left).unwrap_or_default();
        let mut held = self.now();
        if self.begun.swap(true, Ordering::SeqCst) {
            return;
        }
        if left.is_zero() {
            let KeptLease { id, owner, note, since, ttl_s, expires_at, .. } = kept;
            self.ran_out(LeaseView { id, owner, note, since, ttl_s, expires_at: Some(expires_at), job: None });
            self.changed();
        } else {
            *held = Some(Held {
                id: kept.id,
                key: kept.key,
                owner: kept.owner,
                note: kept.note,
                since: kept.since,
                ttl,
                // A clock set back meanwhile does not prolong it.
                until: Instant::now() + left.min(ttl.max(GRACE)),
                connections: 0,
                job: None,
                given_back: false,
            });
            self.changed();
        }
    }
}

fn lost_to(now: Option<&Held>) -> Refusal {
    Refusal::LeaseLost { holder: now.map(|lease| lease.owner.clone()) }
}

fn held_by(lease: &Held) -> Refusal {
    Refusal::LeaseHeld { owner: lease.owner.clone(), note: lease.note.clone(), job: lease.job }
}

#[cfg(test)]
mod tests;
