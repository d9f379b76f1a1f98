//! How the promises about confirming are looked for: who answers what a job asks, and with which key.

use super::checks::accepted;
use super::exchange::{Exchange, told};
use super::invariants::Moment;
use super::requests::{Ask, Who};

fn confirmations<'a>(moment: &'a Moment) -> impl Iterator<Item = &'a Exchange> {
    moment.exchanges.iter().filter(|exchange| matches!(exchange.ask, Ask::Confirm { .. }))
}

/// The job's lease or its confirm key, and nothing else.
pub(super) fn confirmed_by_a_key(moment: &Moment) -> Option<String> {
    let stranger = |e: &&Exchange| e.answer.accepted() && !e.of_job.lease && !e.of_job.confirm;
    confirmations(moment).find(stranger).map(told)
}

/// Whoever has it is let confirm: where the job does not wait for that, it says so, and not that the key is wrong.
pub(super) fn a_confirm_key_confirms(moment: &Moment) -> Option<String> {
    let about_the_key = |e: &&Exchange| {
        let may = e.alone && e.of_job.confirm && e.who.scope().is_some_and(|scope| scope >= e.ask.needs());
        may && matches!(e.answer.status, 401 | 403 | 428 | 429)
    };
    confirmations(moment).find(about_the_key).map(told)
}

/// Shown as what it is or as a lease's key: nothing but its job's prompts is opened by it.
pub(super) fn a_confirm_key_opens_nothing_else(moment: &Moment) -> Option<String> {
    let known = |key: &Option<String>| moment.known.confirm_keys.iter().any(|known| Some(&known.key) == key.as_ref());
    let by_it = |e: &&Exchange| {
        let as_lease = known(&e.shown.lease);
        let alone = e.shown.lease.is_none() && e.shown.confirm.is_some();
        let needs = match &e.ask {
            Ask::NewKey { .. } => e.who != Who::Root,
            Ask::Confirm { .. } => as_lease && !e.of_job.confirm,
            ask => ask.needs_lease(),
        };
        needs && (as_lease || alone && !matches!(e.ask, Ask::Confirm { .. }))
    };
    accepted(moment).find(by_it).map(told)
}

/// Nothing of a job that has ended is confirmed, and no key is made for it.
pub(super) fn a_confirm_key_ends_with_its_job(moment: &Moment) -> Option<String> {
    let late = |e: &&Exchange| e.of_job.ended && matches!(e.ask, Ask::Confirm { .. } | Ask::NewKey { .. });
    accepted(moment).find(late).map(told)
}

/// One that another has replaced is dead.
pub(super) fn a_replaced_confirm_key_is_dead(moment: &Moment) -> Option<String> {
    let dead = |e: &&Exchange| e.answer.accepted() && e.of_job.replaced && !e.of_job.lease;
    confirmations(moment).find(dead).map(told)
}

/// Another is made for an administrator, or for whoever has the job's lease.
pub(super) fn who_gets_a_confirm_key(moment: &Moment) -> Option<String> {
    let other = |e: &&Exchange| matches!(e.ask, Ask::NewKey { .. }) && e.who != Who::Root && !e.of_job.lease;
    accepted(moment).find(other).map(told)
}
