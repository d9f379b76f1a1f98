//! Confirming what a job asks of its operator: by its lease, or by the confirm key that whoever started it hands on.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::time::{Instant, timeout_at};
use uuid::Uuid;

use super::Service;
use crate::job::JobSnapshot;
use crate::refusal::{Refusal, ServiceError};
use crate::running::job::Job;
use bench::access::{Digest, Secret};

/// What a confirm key begins with.
const PREFIX: &str = "confirm_";
/// So many characters of a key are shown to everybody; those that are left are as good as all.
const BEGINS: usize = PREFIX.len() + 4;
/// How long a new picture is waited for: of a camera that is slower the job finds out what it gives.
const PATIENCE: Duration = Duration::from_secs(2);

/// What a request shows to be let confirm.
#[derive(Debug, Clone, Copy, Default)]
pub struct Shown<'a> {
    /// A key of the control lease.
    pub lease: Option<&'a str>,
    /// A confirm key.
    pub confirm: Option<&'a str>,
}

/// The confirm key of the newest job, of which its hash and its beginning are kept and nothing else. A bench does one job at
/// a time, and a job that has ended waits for nothing: its key opens nothing from then on.
#[derive(Debug, Default)]
pub(super) struct ConfirmKeys {
    newest: Mutex<Option<Newest>>,
}

#[derive(Debug)]
struct Newest {
    job: Uuid,
    digest: Digest,
    begins: String,
}

impl ConfirmKeys {
    /// Makes a job's key, in the place of one made before.
    fn make(&self, job: Uuid) -> std::io::Result<Secret> {
        let key = Secret::random(PREFIX)?;
        let begins = key.reveal().chars().take(BEGINS).collect();
        *self.newest.lock().unwrap_or_else(PoisonError::into_inner) =
            Some(Newest { job, digest: key.digest(), begins });
        Ok(key)
    }

    fn opens(&self, job: Uuid, key: &str) -> bool {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.as_ref().is_some_and(|newest| newest.job == job && newest.digest.matches(&Digest::of(key)))
    }

    /// How a job's key begins.
    pub(super) fn begins(&self, job: Uuid) -> Option<String> {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        newest.as_ref().filter(|newest| newest.job == job).map(|newest| newest.begins.clone())
    }
}

impl Service {
    /// Makes the key that confirms what a job asks, and nothing else, until the job has ended. One made before is dead.
    ///
    /// # Errors
    /// When there is no such job, it has ended, or the system has no random numbers to give.
    pub fn make_confirm_key(&self, id: Uuid) -> Result<Secret, ServiceError> {
        let job = self.find(id)?.snapshot();
        if job.state.is_final() {
            let why = "it has ended, and asks nothing any more".to_owned();
            return Err(Refusal::JobState { state: job.state, why }.into());
        }
        let key = self.confirm_keys.make(id).map_err(|error| Refusal::NoConfirmKey { why: error.to_string() })?;
        self.publish_bench();
        Ok(key)
    }

    /// Whether a key is that of the lease that a job has.
    ///
    /// # Errors
    /// [`Refusal::LeaseLost`] where it is of no lease in force.
    pub fn is_lease_of_job(&self, id: Uuid, key: &str) -> Result<bool, ServiceError> {
        self.leases.permit(Some(key))?;
        Ok(self.leases.view().is_some_and(|lease| lease.job == Some(id)))
    }

    /// Confirms the operator step that a job waits for.
    ///
    /// # Errors
    /// When there is no such job, it does not wait for that step, neither its lease nor its confirm key is shown, or the
    /// camera gives an old picture again.
    pub async fn confirm(&self, id: Uuid, step: u32, shown: Shown<'_>) -> Result<JobSnapshot, ServiceError> {
        let job = self.find(id)?;
        self.may_answer(&job, shown)?;
        if job.snapshot().waits_for(step) && self.gives_old_picture().await {
            return Err(Refusal::OldPicture.into());
        }
        // Another key may have been made meanwhile.
        self.may_answer(&job, shown)?;
        job.confirm(step)?;
        Ok(job.snapshot())
    }

    /// Asks a job for an earlier operator step again, in place of confirming the one that it waits for. What depends on that
    /// step is measured anew.
    ///
    /// # Errors
    /// When there is no such job, it does not wait where that step can be asked for again, or neither its lease nor its
    /// confirm key is shown.
    pub fn repeat(&self, id: Uuid, step: u32, shown: Shown<'_>) -> Result<JobSnapshot, ServiceError> {
        let job = self.find(id)?;
        self.may_answer(&job, shown)?;
        job.repeat(step)?;
        Ok(job.snapshot())
    }

    /// Whether the next frame that comes by itself has the very picture of the one before it.
    async fn gives_old_picture(&self) -> bool {
        let mut live = self.bench.camera.live();
        let until = Instant::now() + PATIENCE;
        let mut before = live.borrow_and_update().clone();
        loop {
            let Ok(Ok(())) = timeout_at(until, live.changed()).await else { return false };
            let frame = live.borrow_and_update().clone();
            if let (Some(before), Some(frame)) = (&before, &frame) {
                self.eye.first_alike(before).await;
                return !frame.replayed && self.eye.first_alike(frame).await != frame.seq;
            }
            before = frame;
        }
    }

    fn may_answer(&self, job: &Job, shown: Shown<'_>) -> Result<(), Refusal> {
        let JobSnapshot { id, state, .. } = job.snapshot();
        // What has ended waits for nothing, whatever is shown, and says so.
        if state.is_final() {
            return Ok(());
        }
        let by_lease = shown.lease.is_some_and(|key| self.is_lease_of_job(id, key).unwrap_or(false));
        if by_lease || shown.confirm.is_some_and(|key| self.confirm_keys.opens(id, key)) {
            return Ok(());
        }
        let nothing = shown.lease.is_none() && shown.confirm.is_none();
        Err(if nothing { Refusal::ConfirmKeyRequired } else { Refusal::ConfirmKeyWrong })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_opens_its_job_alone_until_another_is_made_and_is_kept_as_a_hash() {
        let (keys, one, two) = (ConfirmKeys::default(), Uuid::now_v7(), Uuid::now_v7());
        let first = keys.make(one).unwrap();
        assert!(first.reveal().starts_with(PREFIX) && first.reveal().len() == PREFIX.len() + 64);
        assert!(keys.opens(one, first.reveal()) && !keys.opens(two, first.reveal()));
        assert!(!format!("{keys:?} {first:?}").contains(&first.reveal()[PREFIX.len()..]));
        assert_eq!(keys.begins(one).unwrap(), first.reveal()[..PREFIX.len() + 4]);
        assert_eq!(keys.begins(two), None);
        let second = keys.make(one).unwrap();
        assert!(second.reveal().starts_with(&keys.begins(one).unwrap()));
        assert!(!keys.opens(one, first.reveal()) && keys.opens(one, second.reveal()));
        for wrong in ["", PREFIX, &second.reveal()[PREFIX.len()..], &second.reveal().to_uppercase()] {
            assert!(!keys.opens(one, wrong), "{wrong}");
        }
        keys.make(two).unwrap();
        assert!(!keys.opens(one, second.reveal()), "the next job's ends it");
    }
}
