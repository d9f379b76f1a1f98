//! What is known of the bench from the requests that were answered and the time that has passed: what may be true now.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use plenalign::device::AxisName;
use serde_json::Value;
use tokio::time::Instant;

use super::commands::{Command, Death, REST_ALLOWED, Stray, What};
use super::exchange::{Mark, OfJob};
use super::leases::{Lease, NOTICED, Why};
use super::requests::Shown;
use super::rig::Seen;

/// How long a lease outlives a connection or a job that held it.
pub(super) const GRACE: Duration = Duration::from_secs(10);
/// How long a controller may go on by itself: the longest motion there is, a homing.
pub(super) const LONGEST: Duration = Duration::from_secs(60);
/// Longest piece of a move, with its ramps: what a controller goes on with when the program is killed.
const PIECE: Duration = Duration::from_millis(1800);

/// An entry that the audit log must have, or may.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    pub(super) what: &'static str,
    pub(super) who: String,
    /// Entries of one group come in any order.
    pub(super) group: usize,
    pub(super) optional: bool,
}

/// A confirm key that was told.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ConfirmKey {
    pub(super) job: String,
    pub(super) key: String,
    /// Whether another of its job's was made later.
    pub(super) replaced: bool,
}

/// A press of a jog's button that was named in this life.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NamedPress {
    pub(super) axis: AxisName,
    pub(super) name: String,
    /// Whether it is over for certain.
    pub(super) over: bool,
}

/// Everything that is known.
pub(super) struct Known {
    pub(super) leases: Vec<Lease>,
    pub(super) commands: Vec<Command>,
    /// Whether the stop is latched; `None` where that cannot be told.
    pub(super) latched: Option<bool>,
    /// What a restart must find of the stop; `None` where that cannot be told.
    pub(super) kept_latch: Option<bool>,
    pub(super) unwritable: bool,
    pub(super) expected: Vec<Entry>,
    /// Ids of leases that ran out and must be in the audit log once.
    pub(super) run_out: BTreeSet<String>,
    /// What each ended job was when it was first seen so.
    pub(super) ended: BTreeMap<String, Value>,
    /// Jobs of this life.
    pub(super) own_jobs: BTreeSet<String>,
    pub(super) secrets: Vec<String>,
    /// Oldest first.
    pub(super) confirm_keys: Vec<ConfirmKey>,
    /// Oldest first.
    pub(super) presses: Vec<NamedPress>,
    /// From which place on an order to home an axis makes its place known.
    pub(super) unknown_since: [usize; 2],
    /// Until when a controller may go its own way.
    trouble_until: Option<Instant>,
    pub(super) group: usize,
}

impl Known {
    pub(super) fn new() -> Self {
        Self {
            leases: Vec::new(),
            commands: Vec::new(),
            latched: Some(false),
            kept_latch: Some(false),
            unwritable: false,
            expected: Vec::new(),
            run_out: BTreeSet::new(),
            ended: BTreeMap::new(),
            own_jobs: BTreeSet::new(),
            secrets: Vec::new(),
            confirm_keys: Vec::new(),
            presses: Vec::new(),
            unknown_since: [0; 2],
            trouble_until: None,
            group: 0,
        }
    }

    /// The lease that is or may be in force.
    pub(super) fn lease(&self) -> Option<&Lease> {
        self.leases.iter().rev().find(|lease| lease.over.is_none())
    }

    /// The lease before the newest.
    pub(super) fn former(&self) -> Option<&Lease> {
        self.leases.iter().rev().nth(usize::from(self.lease().is_some()))
    }

    pub(super) fn by_key(&self, key: Option<&str>) -> Option<&Lease> {
        self.leases.iter().find(|lease| Some(lease.key.as_str()) == key)
    }

    /// The key of the lease that a job of this life was started with.
    pub(super) fn key_of_job(&self, job: &str) -> Option<String> {
        let of = |command: &&Command| matches!(&command.what, What::Job(id) if id == job);
        let lease = self.commands.iter().find(of)?.lease?;
        Some(self.leases[lease].key.clone())
    }

    /// What a request shows of a job.
    pub(super) fn of_job(&self, job: &str, shown: &Shown) -> OfJob {
        let ended = self.ended.contains_key(job) || !self.own_jobs.contains(job);
        let told =
            self.confirm_keys.iter().filter(|known| known.job == job && Some(&known.key) == shown.confirm.as_ref());
        let replaced = told.clone().any(|known| known.replaced);
        OfJob {
            lease: shown.lease.is_some() && shown.lease == self.key_of_job(job),
            confirm: !ended && !replaced && told.count() > 0,
            replaced,
            ended,
        }
    }

    /// Whether a press is over for certain.
    pub(super) fn is_press_over(&self, axis: AxisName, name: &str) -> bool {
        self.presses.iter().any(|known| known.axis == axis && known.name == name && known.over)
    }

    pub(super) fn in_trouble(&self, at: Instant) -> bool {
        self.trouble_until.is_some_and(|until| at <= until)
    }

    /// A jog of an axis that goes on.
    pub(super) fn jog(&self, axis: AxisName) -> Option<usize> {
        let now = Instant::now();
        let jogs = |command: &Command| matches!(command.what, What::Jog { until } if now <= until);
        self.commands.iter().rposition(|c| jogs(c) && c.axis == Some(axis) && c.death.is_none())
    }

    /// Whether an axis has a jog that goes on, or whose last piece may still be under way: asked again, it goes on.
    pub(super) fn may_jog_on(&self, axis: AxisName) -> bool {
        let now = Instant::now();
        let on = |command: &Command| matches!(command.what, What::Jog { until } if now <= until + REST_ALLOWED);
        self.commands.iter().any(|command| command.axis == Some(axis) && on(command))
    }

    /// The controller may go its own way for a while.
    pub(super) fn suffer(&mut self, now: Mark, forgets: bool, lasts: bool) {
        self.trouble_until = Some(now.at + if lasts { Duration::from_hours(24) } else { LONGEST });
        if forgets {
            self.unknown_since = [now.index; 2];
        }
    }

    fn end(&mut self, which: impl Fn(&Command) -> bool, death: Death) {
        for command in &mut self.commands {
            if command.death.is_none() && which(command) {
                command.death = Some(death);
            }
        }
    }

    /// A lease is over: so is what was commanded under it.
    pub(super) fn lease_over(&mut self, at: usize, end: Mark, why: Why) {
        let Some(lease) = self.leases.get_mut(at).filter(|lease| lease.over.is_none()) else { return };
        lease.over = Some((end, why));
        // One that was there over a restart may not have come through it.
        if why == Why::Expired && !lease.restored && !lease.given_back {
            self.run_out.insert(lease.id.clone());
        }
        let trouble = self.in_trouble(end.at);
        let rest = end.at + if trouble { LONGEST } else { REST_ALLOWED + NOTICED };
        let order_until = if why == Why::Expired { end.at + NOTICED } else { end.at };
        // A lease runs out by the clock, wherever that falls among what was seen.
        let index = if why == Why::Expired { 0 } else { end.index };
        self.end(|c| c.lease == Some(at), Death { index, order_until, rest_until: [rest; 2], why });
    }

    /// Time has passed: what runs out by itself has.
    pub(super) fn pass(&mut self, now: Mark) {
        for at in 0..self.leases.len() {
            let lease = &self.leases[at];
            if lease.over.is_none() && !lease.is_held() && now.at > lease.until.1 {
                let end = Mark { index: now.index, at: lease.until.1 };
                self.lease_over(at, end, Why::Expired);
            }
        }
    }

    /// Takes in what the daemon says of itself: what has ended by itself, and what can be told only so.
    pub(super) fn absorb(&mut self, bench: &Value, jobs: &[Value], now: Mark, before: Mark) {
        let far = if self.in_trouble(now.at) { now.at + LONGEST } else { now.at };
        let ended = Death { index: now.index, order_until: now.at, rest_until: [far; 2], why: Why::Ended };
        for axis in bench["axes"].as_array().into_iter().flatten() {
            let name = if axis["axis"] == "e" { AxisName::E } else { AxisName::Focus };
            if axis["moving"] == false {
                self.end(|command| command.axis == Some(name), ended);
            }
        }
        for job in jobs.iter().filter(|job| !job["ended_at"].is_null()) {
            let id = job["id"].as_str().unwrap_or_default();
            self.ended.entry(id.to_owned()).or_insert_with(|| job.clone());
            self.end(|command| matches!(&command.what, What::Job(of) if of == id), ended);
            let held = self.leases.iter().position(|lease| lease.job.as_deref() == Some(id));
            let Some(at) = held else { continue };
            let lease = &mut self.leases[at];
            lease.job = None;
            if lease.given_back {
                self.lease_over(at, now, Why::Released);
            } else {
                lease.until = (lease.until.0.max(before.at + GRACE), lease.until.1.max(now.at + GRACE));
            }
        }
        let id = bench["lease"]["id"].as_str();
        for at in 0..self.leases.len() {
            let lease = &self.leases[at];
            if lease.over.is_none() && id != Some(lease.id.as_str()) {
                let why = if lease.given_back { Why::Released } else { Why::Expired };
                self.lease_over(at, now, why);
            }
        }
        // What the history cannot be asked for counts as latched, and is not known by that.
        if self.latched.is_none() && !self.unwritable {
            self.latched = bench["stop"]["latched"].as_bool();
            self.kept_latch = self.latched;
        }
    }

    /// A connection holds the newest lease, or connections have gone.
    pub(super) fn connected(&mut self, key: &str) {
        if let Some(lease) = self.leases.iter_mut().find(|lease| lease.key == key) {
            lease.connections += 1;
        }
    }

    pub(super) fn hung_up(&mut self, before: Mark, now: Mark) {
        for lease in self.leases.iter_mut().filter(|lease| lease.connections > 0) {
            lease.connections = 0;
            lease.until = (before.at + GRACE, now.at + GRACE);
        }
    }

    /// The daemon was killed, or ended and started again. What may be lost with it is what was not written.
    pub(super) fn restarted(&mut self, down: Mark, up: Mark, killed: bool) {
        let (order_until, why) = (down.at, Why::Killed);
        let homing = |command: &Command| !matches!(command.what, What::Move | What::Jog { .. });
        let rest = |after| Death { index: down.index, order_until, rest_until: [down.at + after; 2], why };
        if killed {
            self.end(homing, rest(LONGEST));
        }
        self.end(|_| true, rest(PIECE));
        for lease in self.leases.iter_mut().filter(|lease| lease.over.is_none()) {
            (lease.job, lease.connections, lease.given_back, lease.restored) = (None, 0, false, true);
            lease.until = (up.at, up.at + lease.ttl.max(GRACE) + Duration::from_secs(1));
        }
        if self.unwritable {
            self.ended.clear();
            for entry in &mut self.expected {
                entry.optional = true;
            }
            self.run_out.clear();
            // What the file has of the stop is what was kept before.
        }
        self.latched = None;
        self.own_jobs.clear();
        self.presses.clear();
        self.unknown_since = [up.index; 2];
    }

    /// What was seen that no command accounts for.
    pub(super) fn strays(&self, from: usize, seen: &[(Instant, Seen)]) -> Vec<Stray> {
        let mut strays = Vec::new();
        for (place, (at, seen)) in (from..).zip(seen) {
            let trouble = self.in_trouble(*at);
            if self.commands.iter().any(|command| command.covers(place, *at, seen, trouble)) {
                continue;
            }
            let (Seen::Order { axis, .. } | Seen::Moved { axis, .. }) = seen;
            let last = self.commands.iter().rev().find(|c| c.has(*axis) && c.start.index <= place).map(Command::why);
            strays.push(Stray { seen: seen.clone(), at: *at, last });
        }
        strays
    }
}
