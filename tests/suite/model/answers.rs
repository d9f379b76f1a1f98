//! What is learnt from requests that were answered.

use std::time::Duration;

use plenalign::device::AxisName;
use serde_json::Value;

use super::commands::{Command, Death, REST_ALLOWED, What};
use super::exchange::Exchange;
use super::known::{ConfirmKey, Entry, Known, LONGEST, NamedPress};
use super::leases::{Lease, Why};
use super::requests::{Answer, Ask, Who};

/// How long a jog goes on from a request, with the time of an answer.
const JOG_HELD: Duration = Duration::from_millis(330);

impl Known {
    fn expect(&mut self, what: &'static str, who: Who, optional: bool) {
        self.expected.push(Entry { what, who: who.name(), group: self.group, optional });
    }

    /// Takes in what was asked at a time and answered.
    pub(super) fn take_in(&mut self, exchanges: &[Exchange]) {
        self.group += 1;
        let mut sorted: Vec<&Exchange> = exchanges.iter().collect();
        sorted.sort_by_key(|exchange| (exchange.answered.index, exchange.answered.at));
        for exchange in &sorted {
            self.take_in_one(exchange);
        }
        self.end_presses(&sorted);
        let accepted = |wanted: fn(&Ask) -> bool| sorted.iter().any(|e| e.answer.accepted() && wanted(&e.ask));
        if accepted(|ask| matches!(ask, Ask::Stop)) && accepted(|ask| matches!(ask, Ask::Reset { .. })) {
            (self.latched, self.kept_latch) = (None, None);
        }
    }

    fn take_in_one(&mut self, exchange: &Exchange) {
        let Exchange { who, ask, shown, sent, answered, answer, .. } = exchange;
        if let Ask::Jog { axis, press: Some(name), .. } = ask
            && !self.presses.iter().any(|known| (known.axis, &known.name) == (*axis, name))
        {
            self.presses.push(NamedPress { axis: *axis, name: name.clone(), over: false });
        }
        if !answer.accepted() {
            if matches!(ask, Ask::TakeOver { .. }) && answer.status == 409 {
                self.expect("lease.take_over", *who, true);
            }
            return;
        }
        let lease = self.leases.iter().position(|lease| Some(&lease.key) == shown.lease.as_ref());
        match ask {
            Ask::Stop => {
                self.expect("stop", *who, false);
                self.set_latch(true);
                let past = answered.at - LONGEST;
                let far = answered.at + 2 * LONGEST;
                let rest = |axis| if answer.body[axis] == "confirmed" { past } else { far };
                let rest_until = [rest("focus"), rest("e")];
                let death = Death { index: answered.index, order_until: past, rest_until, why: Why::Stopped };
                // Also what had ended otherwise: a confirmed stop leaves nothing to come to rest.
                for command in &mut self.commands {
                    match &mut command.death {
                        None => command.death = Some(death),
                        Some(before) if before.why != Why::Ended => {
                            for (until, stopped) in before.rest_until.iter_mut().zip(rest_until) {
                                *until = (*until).min(stopped.max(answered.at));
                            }
                        }
                        Some(_) => {}
                    }
                }
            }
            Ask::Reset { .. } => {
                if self.latched != Some(false) {
                    let optional = self.latched.is_none();
                    self.expect("stop.reset", *who, optional);
                }
                self.set_latch(false);
            }
            Ask::Take { ttl_s } | Ask::TakeOver { ttl_s } => {
                if matches!(ask, Ask::TakeOver { .. }) {
                    self.expect("lease.take_over", *who, false);
                    for at in 0..self.leases.len() {
                        self.lease_over(at, *answered, Why::TakenOver);
                    }
                } else {
                    self.expect("lease.take", *who, false);
                    // Another can only have run out.
                    for at in 0..self.leases.len() {
                        self.lease_over(at, *sent, Why::Expired);
                    }
                }
                let ttl = Duration::from_secs_f64(*ttl_s);
                let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
                let key = text(&answer.body["key"]);
                self.secrets.push(key.clone());
                self.leases.push(Lease {
                    id: text(&answer.body["lease"]["id"]),
                    key,
                    owner: *who,
                    ttl,
                    until: (sent.at + ttl, answered.at + ttl),
                    job: None,
                    connections: 0,
                    given_back: false,
                    over: None,
                    restored: false,
                });
            }
            Ask::Renew => {
                if let Some(lease) = lease.and_then(|at| self.leases.get_mut(at)) {
                    lease.until = (sent.at + lease.ttl, answered.at + lease.ttl);
                }
            }
            Ask::Release => {
                let Some(at) = lease else { return };
                if let Some((end, why)) = self.leases[at].over {
                    // What moved had to come to rest before the answer, and the lease would have run out meanwhile.
                    if why == Why::Expired && end.at >= sent.at {
                        self.expect("lease.release", *who, false);
                        let id = self.leases[at].id.clone();
                        self.run_out.remove(&id);
                    }
                    return;
                }
                // Given back before, it is there to be given back again only until its job has come to rest.
                let sure = self.leases[at].surely_at(answered.at) && !self.leases[at].given_back;
                self.expect("lease.release", *who, !sure);
                let lease = &mut self.leases[at];
                if lease.job.is_some() {
                    (lease.given_back, lease.connections) = (true, 0);
                } else {
                    let why = if sure { Why::Released } else { Why::Expired };
                    self.lease_over(at, *answered, why);
                    if !sure {
                        // One or the other.
                        let id = self.leases[at].id.clone();
                        self.run_out.remove(&id);
                    }
                }
            }
            Ask::Shell(_) => self.expect("shell.set", *who, false),
            Ask::Cancel { job } => {
                let running = self.own_jobs.contains(job) && !self.ended.contains_key(job);
                self.expect("job.cancel", *who, !running || !exchange.alone || answer.body["state"] != "cancelling");
            }
            Ask::Confirm { .. } => self.expect("job.confirm", *who, false),
            Ask::EndJog(axis) => {
                for command in &mut self.commands {
                    if let What::Jog { until } = &mut command.what
                        && command.axis == Some(*axis)
                    {
                        *until = (*until).min(answered.at + Duration::from_millis(20));
                    }
                }
            }
            Ask::Move { axis, .. } => self.command(exchange, Some(*axis), What::Move, lease, "axis.move"),
            Ask::Home(axis) => self.command(exchange, Some(*axis), What::Home, lease, "axis.home"),
            Ask::Jog { axis, .. } => {
                let until = answered.at + JOG_HELD;
                match self.jog(*axis) {
                    Some(at) => {
                        // At the end of its way it begins anew each time.
                        self.expect("axis.jog", *who, true);
                        self.commands[at].what = What::Jog { until };
                    }
                    None => {
                        self.command(exchange, Some(*axis), What::Jog { until }, lease, "axis.jog");
                    }
                }
            }
            Ask::Job(_) => {
                let id = answer.body["id"].as_str().unwrap_or_default().to_owned();
                self.confirm_key(&id, answer);
                if let Some(lease) = lease.and_then(|at| self.leases.get_mut(at)) {
                    lease.job = Some(id.clone());
                }
                self.own_jobs.insert(id.clone());
                self.command(exchange, None, What::Job(id), lease, "job.create");
            }
            Ask::NewKey { job } => {
                self.expect("job.confirm_key", *who, false);
                self.confirm_key(job, answer);
            }
            Ask::ReadStop | Ask::ReadLease | Ask::ReadAudit | Ask::ReadTokens => {}
        }
    }

    /// A confirm key was told, in the place of what the job had before.
    fn confirm_key(&mut self, job: &str, answer: &Answer) {
        let Some(key) = answer.body["confirm_key"].as_str().map(str::to_owned) else { return };
        for known in self.confirm_keys.iter_mut().filter(|known| known.job == job) {
            known.replaced = true;
        }
        self.secrets.push(key.clone());
        self.confirm_keys.push(ConfirmKey { job: job.to_owned(), key, replaced: false });
    }

    /// What was asked at a time ends presses. Which of two that came together gave way to the other cannot be told.
    fn end_presses(&mut self, exchanges: &[&Exchange]) {
        let jogs: Vec<_> = exchanges
            .iter()
            .filter_map(|exchange| match &exchange.ask {
                Ask::Jog { axis, press, .. } => Some((*axis, press.as_ref())),
                _ => None,
            })
            .collect();
        for exchange in exchanges.iter().filter(|exchange| exchange.answer.accepted()) {
            for known in &mut self.presses {
                known.over |= match &exchange.ask {
                    Ask::Stop => true,
                    Ask::Jog { axis, .. } | Ask::EndJog(axis) => {
                        *axis == known.axis && !jogs.contains(&(known.axis, Some(&known.name)))
                    }
                    _ => false,
                };
            }
        }
    }

    fn set_latch(&mut self, latched: bool) {
        self.latched = Some(latched);
        // What is kept of it while nothing can be written is what was kept before.
        self.kept_latch = if self.unwritable { None } else { Some(latched) };
    }

    fn command(
        &mut self,
        exchange: &Exchange,
        axis: Option<AxisName>,
        what: What,
        lease: Option<usize>,
        entry: &'static str,
    ) {
        // A jog that goes on is no further entry, and one that had just ended is.
        self.expect(entry, exchange.who, entry == "axis.jog");
        let mut command = Command { axis, what, lease, start: exchange.sent, death: None };
        // Accepted beside what ended it: it has ended with that.
        let past = exchange.answered.at - LONGEST;
        if self.latched == Some(true) {
            let far = exchange.answered.at + LONGEST;
            let (index, why) = (exchange.answered.index, Why::Stopped);
            command.death = Some(Death { index, order_until: past, rest_until: [far; 2], why });
        } else if let Some((end, why)) = lease.and_then(|at| self.leases[at].over) {
            let rest = end.at + REST_ALLOWED;
            command.death = Some(Death { index: end.index, order_until: end.at, rest_until: [rest; 2], why });
        }
        self.commands.push(command);
    }
}
