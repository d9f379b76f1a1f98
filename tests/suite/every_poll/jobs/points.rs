//! The points of a job at which its right to move can end, in the order in which it passes them.

use std::sync::Mutex;

use plenalign::device::AxisName;

/// A place in a job's run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Point {
    /// A command that moves has come to the stage, and the driver does not have it yet.
    Arrived(AxisName, &'static str),
    /// An order that moves has just been written to the controller.
    Written(AxisName, &'static str),
    /// A frame to be measured is asked for.
    Asked,
    /// It has been taken, and is about to be measured.
    Taken,
    /// The operator is waited for.
    Prompted,
}

/// What was seen, in order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Seen {
    At(Point),
    /// From here on nothing may move.
    Ended,
}

type Act = Box<dyn FnOnce() + Send>;

#[derive(Default)]
struct Inner {
    seen: Vec<Seen>,
    /// What is done when so much has been seen.
    cut: Option<(usize, Act)>,
}

/// What a job passes, and what is done to it at one of these points.
#[derive(Default)]
pub(super) struct Points(Mutex<Inner>);

impl Points {
    /// Has `act` done at the point that so many more come before, before anything else goes on.
    pub(super) fn cut(&self, after: usize, act: Act) {
        let mut inner = self.0.lock().unwrap();
        inner.cut = Some((inner.seen.len() + after, act));
    }

    /// A point is reached.
    pub(super) fn pass(&self, point: Point) {
        let act = {
            let mut inner = self.0.lock().unwrap();
            let here = inner.seen.len();
            inner.seen.push(Seen::At(point));
            inner.cut.take_if(|(at, _)| *at == here)
        };
        if let Some((_, act)) = act {
            act();
        }
    }

    pub(super) fn ended(&self) {
        self.0.lock().unwrap().seen.push(Seen::Ended);
    }

    /// What has been seen from a place on.
    pub(super) fn since(&self, from: usize) -> Vec<Seen> {
        self.0.lock().unwrap().seen[from..].to_vec()
    }

    pub(super) fn len(&self) -> usize {
        self.0.lock().unwrap().seen.len()
    }
}
