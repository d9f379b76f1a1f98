//! What callers ask of the history: jobs of this run and of earlier ones as one, and everything kept of a job.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde_json::Value;
use uuid::Uuid;

use super::Service;
use crate::events::{MeasurementView, SingleMeasurement};
use crate::history::read::{JobArchive, JobQuery, JobSummary, archive, job, measurements, page};
use crate::job::{Iteration, JobKind, JobRequest, JobSnapshot, word};
use crate::plan::PlanView;
use crate::{Refusal, ServiceError};
use bench::access::{AuditRecord, AuditSink, LogAudit};
use bench::store::records::{self, Audit};
use bench::store::{Page, StoreError, read};

/// How long a caller's own name for a request stands for it.
const KEY_HOLDS: Duration = Duration::from_hours(24);

/// Jobs of a kind that are looked at for how long one takes, and how many of the same request count.
const TIMES_LOOKED_AT: usize = 50;
const TIMES_COUNTED: usize = 5;

fn unreadable(error: StoreError) -> ServiceError {
    ServiceError::Unreadable { why: error.to_string() }
}

impl Service {
    /// A page of all jobs, newest first: those in memory as they are now, the others as the history has them. Where the
    /// history cannot be read, those in memory, and why.
    pub async fn job_page(&self, query: &JobQuery, limit: usize) -> (Page<JobSummary>, Option<String>) {
        let memory = self.jobs();
        let ids = memory.iter().map(|job| job.id).collect();
        let (kept, fault) = match page(self.journal.store(), query.filter(ids), limit).await {
            Ok(page) => (page, None),
            Err(error) => (Page { items: Vec::new(), more: false }, Some(error.to_string())),
        };
        let fitting = memory.iter().filter(|job| query.fits(job));
        let mut items: Vec<JobSummary> =
            fitting.map(|job| JobSummary::of(job, job.iterations.len() as u64)).chain(kept.items).collect();
        items.sort_by_key(|job| std::cmp::Reverse(job.id));
        let more = kept.more || items.len() > limit;
        items.truncate(limit);
        (Page { items, more }, fault)
    }

    /// A job of this run or an earlier one.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchJob`], or when the history cannot be read.
    pub async fn find_job(&self, id: Uuid) -> Result<JobSnapshot, ServiceError> {
        match self.job(id) {
            Ok(job) => Ok(job),
            Err(_) => job(self.journal.store(), id).await.map_err(unreadable)?.ok_or(ServiceError::NoSuchJob { id }),
        }
    }

    /// A job's iterations, in order.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn iterations(&self, id: Uuid) -> Result<Vec<Iteration>, ServiceError> {
        Ok(self.find_job(id).await?.iterations)
    }

    /// A job's measurements, in order.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn measurements(&self, id: Uuid) -> Result<Vec<MeasurementView>, ServiceError> {
        self.find_job(id).await?;
        measurements(self.journal.store(), id).await.map_err(unreadable)
    }

    /// A page of the measurements that belong to no job, newest first, each with its number; `before` is where the page
    /// before has ended. Those that a version of other documents has written are left out.
    ///
    /// # Errors
    /// When the history cannot be read.
    pub async fn measurements_alone(
        &self,
        before: Option<u64>,
        limit: usize,
    ) -> Result<Page<(u64, SingleMeasurement)>, ServiceError> {
        let read = move |connection: &_| read::measurements_alone(connection, before, limit);
        let found = self.journal.store().read(read).await.map_err(unreadable)?;
        let known = |entry: records::Entry| match serde_json::from_value(entry.document) {
            Ok(measured) => Some((entry.number, measured)),
            Err(error) => {
                tracing::warn!(%error, number = entry.number, "a measurement is left out of the list");
                None
            }
        };
        Ok(Page { items: found.items.into_iter().filter_map(known).collect(), more: found.more })
    }

    /// Everything that is kept of a job.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn archive(&self, id: Uuid) -> Result<JobArchive, ServiceError> {
        let found = archive(self.journal.store(), id).await.map_err(unreadable)?;
        let mut archive = found.ok_or(ServiceError::NoSuchJob { id })?;
        // What is in memory is newer.
        if let Ok(job) = self.job(id) {
            archive.job = job;
        }
        Ok(archive)
    }

    /// How long this bench takes by itself for what is asked for, s: the median of the newest such jobs that came to their
    /// end. `None` where there is none.
    pub(super) async fn usual_time_s(&self, request: &JobRequest) -> Option<f64> {
        let (bench, kind) = (self.journal.bench().clone(), word(&request.kind));
        let find = move |connection: &_| read::own_times(connection, &bench, &kind, TIMES_LOOKED_AT);
        let found = self.journal.store().read(find).await;
        let found = found.inspect_err(|error| tracing::warn!(%error, "how long a job takes is not known")).ok()?;
        // What it is for, and whether it is recorded, takes no time.
        let essence = |request: JobRequest| JobRequest { note: None, record: None, ..request };
        let wanted = essence(request.clone());
        let same = |of: Value| serde_json::from_value(of).is_ok_and(|of| essence(of) == wanted);
        let mut times: Vec<f64> =
            found.into_iter().filter_map(|(of, time_s)| same(of).then_some(time_s)).take(TIMES_COUNTED).collect();
        times.sort_unstable_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    }

    /// A plan for the configuration in force, each of its jobs as long as this bench has usually taken for it.
    pub async fn as_it_usually_took(&self, mut plan: PlanView) -> PlanView {
        let usual = async |kind, worked_out_s| self.usual_time_s(&JobRequest::of(kind)).await.unwrap_or(worked_out_s);
        plan.duration_s = usual(JobKind::JointAlignment, plan.duration_s).await;
        for part in &mut plan.parts {
            part.duration_s = usual(part.kind, part.duration_s).await;
        }
        plan
    }

    /// The job that the caller's own name for a request stands for.
    pub(super) async fn job_of_key(
        &self,
        request: &JobRequest,
        key: &str,
    ) -> Result<Option<JobSnapshot>, ServiceError> {
        let since = Timestamp::now() - KEY_HOLDS;
        let same = |job: Uuid, before: &JobRequest| {
            if before == request { Ok(()) } else { Err(Refusal::KeyReused { key: key.to_owned(), job }) }
        };
        let memory = self.all_jobs().iter().rev().find(|job| job.key() == Some(key)).cloned();
        if let Some(job) = memory {
            let found = job.snapshot();
            if found.created_at >= since {
                same(found.id, &found.request)?;
                return Ok(Some(found));
            }
        }
        self.history_ready().await?;
        let (bench, key_asked) = (self.journal.bench().clone(), key.to_owned());
        let find = move |connection: &_| read::find_key(connection, &bench, &key_asked, since);
        let kept = self.journal.store().read(find).await;
        // Nothing is begun twice because the history could not be asked.
        let Some(found) = kept.map_err(unreadable)? else { return Ok(None) };
        // What another version asked for is another request.
        match serde_json::from_value(found.request) {
            Ok(before) => same(found.id, &before)?,
            Err(_) => return Err(Refusal::KeyReused { key: key.to_owned(), job: found.id }.into()),
        }
        self.find_job(found.id).await.map(Some)
    }

    /// A page of the audit log, newest first, each entry with its number; `before` is where the page before has ended.
    ///
    /// # Errors
    /// When the history cannot be read.
    pub async fn audit_page(&self, before: Option<i64>, limit: usize) -> Result<Page<(i64, Audit)>, ServiceError> {
        let found = self.journal.store().read(move |connection| read::audit(connection, before, limit)).await;
        found.map_err(unreadable)
    }

    /// Adds to the audit log, without waiting.
    pub fn audit(&self, audit: Audit) {
        self.journal.audit(audit);
    }
}

/// The audit log of a service's history, beside the program's own log.
pub struct HistoryAudit(pub Arc<Service>);

impl AuditSink for HistoryAudit {
    fn record(&self, record: AuditRecord) {
        LogAudit.record(record.clone());
        let AuditRecord { at, who, what, detail, from } = record;
        let from = from.map(|address| address.to_string());
        self.0.audit(Audit { at, who, what: what.to_owned(), detail, from });
    }
}

#[cfg(test)]
mod tests;
