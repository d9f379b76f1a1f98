//! Commands of motion that were accepted, and which of what is seen below the daemon is theirs.

use std::time::Duration;

use plenalign::device::AxisName;
use tokio::time::Instant;

use super::exchange::Mark;
use super::leases::Why;
use super::rig::Seen;

/// How long an axis may take to come to rest once its command has ended: what the stop of its controller may take.
pub(super) const REST_ALLOWED: Duration = Duration::from_millis(700);

/// What a command of motion is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum What {
    Move,
    Home,
    /// For as long as it is asked for.
    Jog {
        until: Instant,
    },
    Job(String),
}

/// A command of motion that was accepted.
#[derive(Debug, Clone)]
pub(super) struct Command {
    /// Which axis; `None` for a job, which has both.
    pub(super) axis: Option<AxisName>,
    pub(super) what: What,
    pub(super) lease: Option<usize>,
    pub(super) start: Mark,
    pub(super) death: Option<Death>,
}

/// The end of a command.
#[derive(Debug, Clone, Copy)]
pub(super) struct Death {
    /// What had been seen by then is within it.
    pub(super) index: usize,
    /// Until when an order may still go out.
    pub(super) order_until: Instant,
    /// Until when an axis may still move.
    pub(super) rest_until: [Instant; 2],
    pub(super) why: Why,
}

fn index(axis: AxisName) -> usize {
    usize::from(axis == AxisName::E)
}

impl Command {
    pub(super) fn has(&self, axis: AxisName) -> bool {
        self.axis.is_none_or(|own| own == axis)
    }

    /// Whether an order or a motion is its own.
    pub(super) fn covers(&self, place: usize, at: Instant, seen: &Seen, trouble: bool) -> bool {
        let (axis, order) = match seen {
            Seen::Order { axis, .. } => (*axis, true),
            Seen::Moved { axis, .. } => (*axis, false),
        };
        if !self.has(axis) || place < self.start.index {
            return false;
        }
        let held = match self.what {
            What::Jog { until } if order => at <= until,
            What::Jog { until } => trouble || at <= until + REST_ALLOWED,
            _ => true,
        };
        let alive = self.death.is_none_or(|death| {
            let until = if order { death.order_until } else { death.rest_until[index(axis)] };
            place < death.index || at <= until
        });
        held && alive
    }

    /// Why it no longer moves anything.
    pub(super) fn why(&self) -> Why {
        self.death.map_or(Why::LetGo, |death| death.why)
    }
}

/// An order or a motion that no command accounts for.
#[derive(Debug, Clone)]
pub(super) struct Stray {
    pub(super) seen: Seen,
    pub(super) at: Instant,
    /// How the last command that could have been its own had ended; `None` where there was none.
    pub(super) last: Option<Why>,
}
