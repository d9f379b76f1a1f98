//! What must hold whatever is asked and whatever goes wrong: one list, each with the sentence that promises it. All of
//! them are checked after every step.

use plenalign::config::ControllerDriver;
use serde_json::Value;
use tokio::time::Instant;

use super::checks::*;
use super::commands::Stray;
use super::confirming::*;
use super::exchange::{Exchange, Mark, told};
use super::known::Known;
use super::leases::Why;
use super::requests::Ask;
use super::rig::Seen;

/// What a daemon says of itself.
#[derive(Debug, Clone)]
pub(super) struct View {
    pub(super) at: Mark,
    pub(super) bench: Value,
    pub(super) jobs: Vec<Value>,
    /// The audit log, oldest first; `None` where it cannot be read.
    pub(super) audit: Option<Vec<Value>>,
}

/// A step as it is judged.
pub(super) struct Moment<'a> {
    pub(super) known: &'a Known,
    pub(super) exchanges: &'a [Exchange],
    /// What was seen below the daemon since the step before.
    pub(super) seen: &'a [(Instant, Seen)],
    pub(super) strays: &'a [Stray],
    pub(super) before: &'a View,
    pub(super) after: &'a View,
    /// Whether the daemon was started anew in this step.
    pub(super) anew: bool,
    /// Whether this is the first step since a start after which the history can be read.
    pub(super) restarted: bool,
    pub(super) driver: ControllerDriver,
    /// Whether e homes towards the shell.
    pub(super) low: bool,
    /// Where each axis truly stands, mm.
    pub(super) places_mm: [f64; 2],
    /// A lease's key was found in the history's files.
    pub(super) lease_key_on_disk: Option<&'a str>,
    /// A confirm key was.
    pub(super) confirm_key_on_disk: Option<&'a str>,
}

/// Where a promise stands: the document, and its words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Said(pub(super) &'static str, pub(super) &'static str);

/// A promise, and whether it is kept.
pub(super) struct Invariant {
    pub(super) name: &'static str,
    pub(super) said: Said,
    pub(super) broken: fn(&Moment) -> Option<String>,
}

const API: &str = "docs/api.md";
const HISTORY: &str = "docs/history.md";
const SECURITY: &str = "docs/security.md";

/// Every promise.
pub(super) const ALL: &[Invariant] = &[
    Invariant {
        name: "after a stop nothing moves until the reset",
        said: Said(API, "Resetting moves nothing, and nothing goes on that was held meanwhile"),
        broken: after_a_stop,
    },
    Invariant {
        name: "a confirmed stop stands",
        said: Said(API, "`confirmed` means that the controller said that the axis stands"),
        broken: |moment| stray(moment, |stray| is_motion(stray) && stray.last == Some(Why::Stopped)),
    },
    Invariant {
        name: "a stop is obeyed in every state",
        said: Said(API, "It needs no lease and the least of tokens, is obeyed in every state"),
        broken: a_stop_is_obeyed,
    },
    Invariant {
        name: "a reset says why",
        said: Said(API, "so a **reset** has to say why, and who"),
        broken: |m| accepted(m).find(|e| matches!(e.ask, Ask::Reset { why: false })).map(told),
    },
    Invariant {
        name: "motion needs the lease in force",
        said: Said(API, "Anyone who takes the lease gets a key and shows it with everything that moves"),
        broken: motion_needs_the_lease,
    },
    Invariant {
        name: "motion ends with its lease",
        said: Said(API, "What moves by hand ends with its lease"),
        broken: |moment| {
            let over = [Some(Why::Expired), Some(Why::Released), Some(Why::TakenOver)];
            stray(moment, |stray| over.contains(&stray.last))
        },
    },
    Invariant {
        name: "one has control at a time",
        said: Said(API, "One has control at a time."),
        broken: one_has_control,
    },
    Invariant {
        name: "a lease lives as long as it says",
        said: Said(API, "It lives for `ttl_s` (30 s unless given) from the last `POST /api/v1/lease/heartbeat`"),
        broken: a_lease_lives,
    },
    Invariant {
        name: "a job holds its starter's lease",
        said: Said(API, "A job holds its starter's lease to its end, and leaves it 10 s at least."),
        broken: a_job_holds_its_lease,
    },
    Invariant {
        name: "a jog ends when nobody asks",
        said: Said(API, "A program that dies stops it by saying nothing."),
        broken: |moment| stray(moment, |stray| stray.last == Some(Why::LetGo)),
    },
    Invariant {
        name: "nothing moves by itself",
        said: Said(HISTORY, "Nothing moves by itself"),
        broken: |moment| {
            let by_itself = [None, Some(Why::Ended), Some(Why::Killed)];
            stray(moment, |stray| by_itself.contains(&stray.last))
        },
    },
    Invariant {
        name: "an axis is homed before it is moved",
        said: Said(HISTORY, "every axis has to be homed before it can be moved"),
        broken: homed_before_moved,
    },
    Invariant {
        name: "a position shown is true",
        said: Said(API, "A position is shown where it is known; of an axis that is not homed it is `null`."),
        broken: a_position_is_true,
    },
    Invariant {
        name: "nothing passes the e wall",
        said: Said("SECURITY.md", "the e wall and limits hold for everybody"),
        broken: nothing_passes_the_wall,
    },
    Invariant {
        name: "e is not homed towards a shell",
        said: Said(API, "Homing that runs towards the shell is refused until somebody says that it is off"),
        broken: not_homed_towards_a_shell,
    },
    Invariant {
        name: "one job at a time",
        said: Said("proto/openapi.json", "A bench does one job at a time"),
        broken: one_job,
    },
    Invariant {
        name: "a job ended stays ended",
        said: Said(API, "ended: `converged`, `succeeded`, `not_converged`, `cancelled`, `failed`, `interrupted`."),
        broken: ended_stays_ended,
    },
    Invariant {
        name: "a confirmation shows the job's lease or its confirm key",
        said: Said(SECURITY, "It takes the job's lease, or its confirm key"),
        broken: confirmed_by_a_key,
    },
    Invariant {
        name: "a confirm key confirms for anyone who has it",
        said: Said(API, "to be handed on to anyone who stands at the bench: it answers this job's prompts"),
        broken: a_confirm_key_confirms,
    },
    Invariant {
        name: "a confirm key opens nothing else",
        said: Said(API, "it answers this job's prompts, does nothing else, and ends with the job"),
        broken: a_confirm_key_opens_nothing_else,
    },
    Invariant {
        name: "a confirm key ends with its job",
        said: Said(SECURITY, "It confirms what this job asks, opens nothing else, and ends with the job."),
        broken: a_confirm_key_ends_with_its_job,
    },
    Invariant {
        name: "a replaced confirm key is dead",
        said: Said(SECURITY, "A lost one is replaced, which is audited, and confirms nothing from then on."),
        broken: a_replaced_confirm_key_is_dead,
    },
    Invariant {
        name: "a confirm key is made for administrators and the job's lease",
        said: Said(API, "`POST …/confirm-key`, for administrators and anyone who shows the job's lease"),
        broken: who_gets_a_confirm_key,
    },
    Invariant {
        name: "no confirm key is in the history",
        said: Said(SECURITY, "of which the SHA-256 is kept in memory"),
        broken: |m| m.confirm_key_on_disk.map(|file| format!("a confirm key stands in {file}")),
    },
    Invariant {
        name: "a lease given back ends with its job",
        said: Said(API, "under a job it ends with the job then, heartbeats or not"),
        broken: given_back_is_over,
    },
    Invariant {
        name: "a press that is over does not go on",
        said: Said(API, "a jog that names its `press` goes on only until another press, its end or a stop"),
        broken: |m| accepted(m).find(|e| e.press_over).map(told),
    },
    Invariant {
        name: "a latched stop outlives the program",
        said: Said(HISTORY, "A stop that was latched is latched again, and one that cannot be read counts as latched."),
        broken: |m| {
            let kept = m.known.kept_latch.filter(|_| m.restarted && !m.known.unwritable)?;
            let found = m.after.bench["stop"]["latched"] == true;
            (kept != found).then(|| format!("latched was {kept} before and is {found} after the start"))
        },
    },
    Invariant {
        name: "jobs of an earlier run are over",
        said: Said(HISTORY, "jobs become `interrupted`, with the time of their last record"),
        broken: |m| {
            let open = |job: &&Value| job["ended_at"].is_null();
            let job = m.after.jobs.iter().find(open).filter(|_| m.restarted && !m.known.unwritable)?;
            Some(format!("{job} goes on after the start"))
        },
    },
    Invariant {
        name: "without a history nothing begins",
        said: Said(HISTORY, "jobs, moves and homing are refused with"),
        broken: |m| {
            let begins = |e: &&Exchange| e.ask.moves() && e.while_unwritable && !e.while_jogging;
            accepted(m).find(begins).map(told)
        },
    },
    Invariant {
        name: "a refused request changes nothing",
        said: Said(API, "Every refusal is a problem (RFC 9457)"),
        broken: refused_changes_nothing,
    },
    Invariant {
        name: "nobody does what their scope does not allow",
        said: Said(
            API,
            "`view` reads and stops, `control` commands, `admin` makes tokens and writes the configuration",
        ),
        broken: scopes_hold,
    },
    Invariant {
        name: "no secret is in an answer",
        said: Said(SECURITY, "nor told by any answer but the one that makes it"),
        broken: no_secret_in_an_answer,
    },
    Invariant {
        name: "no lease's key is in the history",
        said: Said(SECURITY, "A lease's key is kept as a hash."),
        broken: |m| m.lease_key_on_disk.map(|file| format!("a key stands in {file}")),
    },
    Invariant {
        name: "every action is in the audit log, once and in order",
        said: Said(SECURITY, "has name, address and time of every stop and its reset"),
        broken: audited,
    },
    Invariant {
        name: "a lease that ran out is in the audit log once",
        said: Said(SECURITY, "lease taken, released, taken over or run out"),
        broken: expiries_are_audited,
    },
];
