//! How each of the [`super::invariants`] is looked for: what a step shows of its being broken, in words.

use std::time::Duration;

use plenalign::config::ControllerDriver;
use plenalign::device::AxisName;
use serde_json::Value;

use super::commands::Stray;
use super::exchange::{Exchange, told};
use super::invariants::{Moment, View};
use super::known::GRACE;
use super::leases::Why;
use super::requests::Ask;
use super::rig::Seen;

/// Shortest time to live that a lease can be asked for with.
const LEAST_TTL: Duration = Duration::from_secs(2);

pub(super) fn accepted<'a>(moment: &'a Moment) -> impl Iterator<Item = &'a Exchange> {
    moment.exchanges.iter().filter(|exchange| exchange.answer.accepted())
}

pub(super) const fn is_motion(stray: &Stray) -> bool {
    matches!(stray.seen, Seen::Moved { .. })
}

pub(super) fn stray(moment: &Moment, which: impl Fn(&Stray) -> bool) -> Option<String> {
    let found: Vec<&Stray> = moment.strays.iter().filter(|stray| which(stray)).collect();
    let (first, last) = (found.first()?, found.last()?);
    let tell = |stray: &Stray| {
        let ago = moment.after.at.at.saturating_duration_since(stray.at).as_secs_f64();
        format!("{:?}, {ago:.3} s before the step's end", stray.seen)
    };
    Some(format!(
        "{} times, from {} to {} (the command before: {:?})",
        found.len(),
        tell(first),
        tell(last),
        first.last
    ))
}

pub(super) fn after_a_stop(moment: &Moment) -> Option<String> {
    let latched = accepted(moment).find(|e| e.while_latched && e.ask.moves()).map(told);
    latched.or_else(|| stray(moment, |stray| !is_motion(stray) && stray.last == Some(Why::Stopped)))
}

pub(super) fn a_stop_is_obeyed(moment: &Moment) -> Option<String> {
    let stop = moment.exchanges.iter().find(|e| matches!(e.ask, Ask::Stop) && e.who.scope().is_some())?;
    if !stop.answer.accepted() {
        return Some(told(stop));
    }
    let reset = accepted(moment).any(|e| matches!(e.ask, Ask::Reset { .. }));
    let latched = moment.after.bench["stop"]["latched"] == true;
    (!reset && !latched).then(|| format!("not latched after {}", told(stop)))
}

pub(super) fn motion_needs_the_lease(moment: &Moment) -> Option<String> {
    let without = |exchange: &&Exchange| {
        let lease = moment.known.by_key(exchange.shown.lease.as_deref());
        exchange.ask.needs_lease() && lease.is_none_or(|lease| !lease.maybe_at(exchange.sent))
    };
    accepted(moment).find(without).map(told)
}

pub(super) fn one_has_control(moment: &Moment) -> Option<String> {
    let taken: Vec<&Exchange> = accepted(moment).filter(|e| matches!(e.ask, Ask::Take { .. })).collect();
    let first = taken.first()?;
    let given_back = accepted(moment).any(|e| matches!(e.ask, Ask::Release | Ask::TakeOver { .. }));
    // Sooner than any lease runs out.
    let soon = |pair: &[&Exchange]| pair[1].sent.at < pair[0].sent.at + LEAST_TTL;
    let others = !given_back && taken.windows(2).any(soon);
    let before = &moment.before.bench["lease"];
    let had = moment.known.leases.iter().find(|lease| before["id"] == lease.id.as_str());
    // As it was before this step; what has ended it since is a time or a request.
    let alive = had
        .is_some_and(|lease| !given_back && !lease.restored && !lease.given_back && lease.until.0 > first.answered.at);
    (others || alive).then(|| told(first))
}

pub(super) fn a_lease_lives(moment: &Moment) -> Option<String> {
    let lease = moment.known.lease()?;
    let there = moment.after.bench["lease"]["id"] == lease.id.as_str();
    let now = moment.after.at.at;
    // While a job's end is not yet known to the model its lease's is not either.
    let job_over = lease
        .job
        .as_ref()
        .is_some_and(|id| moment.after.jobs.iter().any(|job| job["id"] == id.as_str() && !job["ended_at"].is_null()));
    let short = now < moment.before.at.at + GRACE;
    let graced = job_over && !lease.given_back && !moment.anew && short;
    let sure = if job_over { graced } else { lease.surely_at(now) };
    let ends = lease.until.0.saturating_duration_since(now);
    (sure && !there).then(|| {
        let held = if graced { "its job has just ended".to_owned() } else { format!("it had {ends:?} to live") };
        format!("the lease of {:?} is gone; {held}: {}", lease.owner, moment.after.bench["lease"])
    })
}

pub(super) fn a_job_holds_its_lease(moment: &Moment) -> Option<String> {
    let open = moment.after.jobs.iter().find(|job| job["ended_at"].is_null())?;
    let id = open["id"].as_str()?;
    let key = moment.known.key_of_job(id)?;
    let lease = moment.known.by_key(Some(&key))?;
    let holder = &moment.after.bench["lease"]["id"];
    // The list and the bench are read one after the other.
    let taken = lease.over.is_some_and(|(_, why)| why == Why::TakenOver);
    let still = moment.after.bench["job"] == id && !taken;
    (still && holder != lease.id.as_str()).then(|| format!("job {id} runs and the lease is {holder}"))
}

pub(super) fn given_back_is_over(moment: &Moment) -> Option<String> {
    let renewed = accepted(moment).find(|e| {
        let lease = moment.known.by_key(e.shown.lease.as_deref());
        e.alone && matches!(e.ask, Ask::Renew) && lease.is_some_and(|lease| lease.given_back)
    });
    let there = &moment.after.bench["lease"];
    // Its end may have been seen between the job's and this.
    let stays = moment.known.leases.iter().find(|lease| {
        let job_over = lease.job.is_none() && lease.over.is_some();
        lease.given_back && job_over && there["id"] == lease.id.as_str()
    });
    renewed.map(told).or_else(|| stays.map(|_| format!("given back, its job over, and there is {there}")))
}

pub(super) fn homed_before_moved(moment: &Moment) -> Option<String> {
    for exchange in accepted(moment).filter(|e| e.alone && !moment.anew) {
        let (Ask::Move { axis, .. } | Ask::Jog { axis, .. }) = &exchange.ask else { continue };
        if axis_of(&moment.before.bench, *axis)["homed"] == false && moment.known.jog(*axis).is_none() {
            // It may have been homed in between, by what was commanded before.
            let homed = axis_of(&moment.after.bench, *axis)["homed"] == true;
            if !homed {
                return Some(told(exchange));
            }
        }
    }
    let homed_since = accepted(moment).any(|e| matches!(e.ask, Ask::Home(_) | Ask::Job(_)));
    // It may have kept its reference, which is for ever the same place; where that is not true the position shows it.
    let kept = moment.driver == ControllerDriver::Zaber;
    if !moment.restarted || homed_since || kept {
        return None;
    }
    let known = |axis: &AxisName| axis_of(&moment.after.bench, *axis)["homed"] == true;
    let axis = AxisName::ALL.into_iter().find(known)?;
    Some(format!("the {axis} axis counts as homed right after the start"))
}

pub(super) fn axis_of(bench: &Value, axis: AxisName) -> &Value {
    let mut axes = bench["axes"].as_array().into_iter().flatten();
    axes.find(|found| found["axis"] == axis.name()).unwrap_or(&Value::Null)
}

pub(super) fn a_position_is_true(moment: &Moment) -> Option<String> {
    if moment.known.in_trouble(moment.after.at.at) {
        return None;
    }
    for (axis, place) in AxisName::ALL.into_iter().zip(moment.places_mm) {
        let view = axis_of(&moment.after.bench, axis);
        let Some(shown) = view["position_mm"].as_f64().filter(|_| view["moving"] == false) else { continue };
        if (shown - place).abs() > 0.05 {
            return Some(format!("the {axis} axis is shown at {shown} mm and stands at {place:.4} mm"));
        }
    }
    None
}

pub(super) fn nothing_passes_the_wall(moment: &Moment) -> Option<String> {
    // The shell is taken off and put on meanwhile, and a shell step goes by the picture.
    let [before, after] = [moment.before, moment.after].map(|view| view.bench["e_wall_mm"].as_f64());
    let wall = before?.min(after?);
    let beyond = moment.seen.iter().find_map(|(_, seen)| match seen {
        Seen::Moved { axis: AxisName::E, at_mm } if *at_mm < wall - 0.005 => Some(*at_mm),
        _ => None,
    })?;
    Some(format!("e stood at {beyond:.4} mm, the wall being at {wall:.4} mm"))
}

pub(super) fn not_homed_towards_a_shell(moment: &Moment) -> Option<String> {
    let off = |view: &View| view.bench["shell"] == "off";
    let said_off = accepted(moment).any(|e| matches!(e.ask, Ask::Shell("off")));
    if !moment.low || off(moment.before) || off(moment.after) || said_off {
        return None;
    }
    let homing =
        moment.seen.iter().find(|(_, seen)| matches!(seen, Seen::Order { axis: AxisName::E, homing: true, .. }));
    homing.map(|(_, order)| format!("{order:?} with the shell {}", moment.after.bench["shell"]))
}

pub(super) fn one_job(moment: &Moment) -> Option<String> {
    let open: Vec<&Value> = moment.after.jobs.iter().filter(|job| job["ended_at"].is_null()).collect();
    (open.len() > 1).then(|| format!("{open:?}"))
}

pub(super) fn ended_stays_ended(moment: &Moment) -> Option<String> {
    let fields = ["state", "ended_at", "reason"];
    let other = moment.after.jobs.iter().find_map(|job| {
        let was = moment.known.ended.get(job["id"].as_str()?)?;
        fields.iter().any(|field| was[field] != job[field]).then_some((was, job))
    });
    other.map(|(was, is)| {
        let said = |job: &Value| fields.map(|field| job[field].to_string()).join(", ");
        format!("a job had ended as {} and is {}", said(was), said(is))
    })
}

pub(super) fn refused_changes_nothing(moment: &Moment) -> Option<String> {
    let [exchange] = moment.exchanges else { return None };
    if exchange.answer.accepted() || moment.anew {
        return None;
    }
    if exchange.answer.problem().is_empty() || exchange.answer.body["detail"].as_str().is_none_or(str::is_empty) {
        return Some(format!("not a problem: {}", told(exchange)));
    }
    let (before, after) = (&moment.before.bench, &moment.after.bench);
    let same = |field: &str| before[field] == after[field];
    // What may end or begin by itself meanwhile is no change of the refused request's.
    let job_ended = after["job"].is_null();
    let lease_ended = after["lease"].is_null() || before["lease"]["job"] != after["lease"]["job"];
    let lease = before["lease"]["id"] == after["lease"]["id"] || lease_ended;
    let shell = same("shell") || !before["job"].is_null();
    // A job goes by the picture at times, and tells more of the axis.
    let wall = same("e_wall_mm") || !before["job"].is_null();
    let changed = if !same("stop") && moment.known.latched.is_some() {
        "stop"
    } else if !lease {
        "lease"
    } else if !same("job") && !job_ended {
        "job"
    } else if !shell {
        "shell"
    } else if !wall {
        "e wall"
    } else {
        return None;
    };
    // A takeover that cannot have the lease in time has cancelled the job all the same, and says so.
    let takeover = matches!(exchange.ask, Ask::TakeOver { .. }) && exchange.answer.status == 409;
    (!takeover).then(|| format!("the {changed} changed though {}", told(exchange)))
}

pub(super) fn scopes_hold(moment: &Moment) -> Option<String> {
    let wrong = |exchange: &&Exchange| {
        let status = exchange.answer.status;
        match exchange.who.scope() {
            None => status != 401,
            Some(scope) if scope < exchange.ask.needs() => status != 403,
            Some(_) => matches!(status, 401 | 403) && !matches!(exchange.ask, Ask::Confirm { .. } | Ask::NewKey { .. }),
        }
    };
    moment.exchanges.iter().find(wrong).map(told)
}

pub(super) fn no_secret_in_an_answer(moment: &Moment) -> Option<String> {
    let telling = moment.exchanges.iter().find(|exchange| {
        // Said once, to whoever it is made for.
        let made = match exchange.ask {
            Ask::Take { .. } | Ask::TakeOver { .. } => exchange.answer.body["key"].as_str(),
            Ask::Job(_) | Ask::NewKey { .. } => exchange.answer.body["confirm_key"].as_str(),
            _ => None,
        };
        let mut others = moment.known.secrets.iter().filter(|secret| made != Some(secret.as_str()));
        others.any(|secret| exchange.answer.text.contains(secret.as_str()))
    });
    let views = [
        Some(moment.after.bench.to_string()),
        moment.after.audit.as_ref().map(|log| Value::from(log.clone()).to_string()),
    ];
    let view = views
        .into_iter()
        .flatten()
        .find(|text| moment.known.secrets.iter().any(|secret| text.contains(secret.as_str())));
    telling.map(told).or_else(|| view.map(|text| format!("a secret stands in {text}")))
}

/// What of the log is compared; what is done by the program itself is elsewhere.
const COMPARED: [&str; 13] = [
    "stop",
    "stop.reset",
    "lease.take",
    "lease.release",
    "lease.take_over",
    "axis.move",
    "axis.home",
    "axis.jog",
    "shell.set",
    "job.create",
    "job.cancel",
    "job.confirm",
    "job.confirm_key",
];

pub(super) fn audited(moment: &Moment) -> Option<String> {
    let log = moment.after.audit.as_ref().filter(|_| !moment.known.unwritable)?;
    let compared = |entry: &&Value| COMPARED.iter().any(|what| entry["what"] == *what);
    let found: Vec<(String, String)> = log
        .iter()
        .filter(compared)
        .map(|entry| {
            (
                entry["what"].as_str().unwrap_or_default().to_owned(),
                entry["who"].as_str().unwrap_or_default().to_owned(),
            )
        })
        .collect();
    let expected = &moment.known.expected;
    let (mut next, mut at) = (0, 0);
    while at < expected.len() {
        let group = expected[at].group;
        let size = expected[at..].iter().take_while(|entry| entry.group == group).count();
        let mut left: Vec<_> = expected[at..at + size].iter().collect();
        while let Some((what, who)) = found.get(next)
            && let Some(place) = left.iter().position(|entry| (entry.what, &entry.who) == (what.as_str(), who))
        {
            left.remove(place);
            next += 1;
        }
        if let Some(missing) = left.iter().find(|entry| !entry.optional) {
            let around = &found[next.saturating_sub(3)..(next + 3).min(found.len())];
            return Some(format!("{missing:?} is not where it should be; there is {around:?}"));
        }
        at += size;
    }
    let last = &expected[expected.len().saturating_sub(3)..];
    (next < found.len())
        .then(|| format!("entries that nobody can have caused, or twice, after {last:?}: {:?}", &found[next..]))
}

pub(super) fn expiries_are_audited(moment: &Moment) -> Option<String> {
    let log = moment.after.audit.as_ref().filter(|_| !moment.known.unwritable)?;
    let times =
        |id: &str| log.iter().filter(|entry| entry["what"] == "lease.expire" && entry["detail"]["lease"] == id).count();
    // What has just run out may have yet to be noticed.
    let due = |id: &&String| {
        let lease = moment.known.leases.iter().find(|lease| lease.id == **id);
        let end = lease.and_then(|lease| lease.over);
        end.is_some_and(|(end, _)| end.at + Duration::from_millis(700) < moment.after.at.at)
    };
    let wrong = moment.known.run_out.iter().filter(due).find(|id| times(id) != 1);
    let twice = moment.known.leases.iter().map(|lease| &lease.id).find(|id| times(id) > 1);
    wrong.or(twice).map(|id| format!("lease {id} ran out and is {} times in the log", times(id)))
}
