//! Presses of a jog's button: one that is over does not go on, however often it is repeated.

use std::collections::{HashMap, VecDeque};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::refusal::{Refusal, ServiceError};
use bench::device::AxisName;

/// Most characters of a press's name.
const MAX_NAME: usize = 64;
/// So many presses of an axis are remembered: more than can be on their way.
const REMEMBERED: usize = 256;

/// A press that was heard of.
#[derive(Debug)]
struct Press {
    name: String,
    /// How often the bench had been stopped when it was.
    stops: u64,
    over: bool,
}

/// The newest presses of each axis, the newest last.
#[derive(Debug, Default)]
pub(super) struct Presses {
    heard: Mutex<HashMap<AxisName, VecDeque<Press>>>,
}

impl Presses {
    fn heard(&self) -> MutexGuard<'_, HashMap<AxisName, VecDeque<Press>>> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a press go on, or begin; `stops` is how often the bench has been stopped by now.
    ///
    /// # Errors
    /// [`Refusal::PressEnded`] where it was heard of before the newest stop, was let go, or has given way to another;
    /// [`ServiceError::Invalid`] where its name is none, or too long.
    pub(super) fn go_on(&self, axis: AxisName, press: Option<&str>, stops: u64) -> Result<(), ServiceError> {
        let Some(name) = press else { return Ok(()) };
        if name.is_empty() || name.chars().count() > MAX_NAME {
            return Err(ServiceError::Invalid {
                field: "press",
                what: format!("1 to {MAX_NAME} characters are needed"),
            });
        }
        let mut heard = self.heard();
        let presses = heard.entry(axis).or_default();
        match presses.iter().find(|known| known.name == name) {
            Some(known) if known.over || known.stops != stops => Err(Refusal::PressEnded { axis }.into()),
            Some(_) => Ok(()),
            None => {
                if presses.len() >= REMEMBERED {
                    presses.pop_front();
                }
                presses.push_back(Press { name: name.to_owned(), stops, over: false });
                Ok(())
            }
        }
    }

    /// A press moves the axis: every other one has given way to it.
    pub(super) fn moves(&self, axis: AxisName, press: Option<&str>) {
        for known in self.heard().get_mut(&axis).into_iter().flatten() {
            known.over |= press != Some(known.name.as_str());
        }
    }

    /// The button was let go.
    pub(super) fn let_go(&self, axis: AxisName) {
        self.moves(axis, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_press_ends_with_the_stop_and_another_begins() {
        let presses = Presses::default();
        let (e, focus) = (AxisName::E, AxisName::Focus);
        let ended = Err(Refusal::PressEnded { axis: e }.into());
        presses.go_on(e, Some("a"), 0).unwrap();
        presses.go_on(e, Some("a"), 0).unwrap();
        presses.go_on(focus, Some("f"), 0).unwrap();
        assert_eq!(presses.go_on(e, Some("a"), 1), ended);
        assert_eq!(presses.go_on(e, Some("a"), 1), ended, "it stays ended");
        presses.go_on(e, Some("b"), 1).unwrap();
        assert_eq!(presses.go_on(e, Some("a"), 1), ended, "also after another one");
        presses.go_on(e, None, 2).unwrap();
        assert_eq!(presses.go_on(focus, Some("f"), 2), Err(Refusal::PressEnded { axis: focus }.into()));
        for wrong in ["", &"x".repeat(MAX_NAME + 1)] {
            assert!(matches!(presses.go_on(e, Some(wrong), 2), Err(ServiceError::Invalid { field: "press", .. })));
        }
    }

    #[test]
    fn a_press_that_gave_way_or_was_let_go_does_not_go_on() {
        let presses = Presses::default();
        let (e, focus) = (AxisName::E, AxisName::Focus);
        let ended = Err(Refusal::PressEnded { axis: e }.into());
        let go_on = |press: &str| presses.go_on(e, Some(press), 0);
        go_on("a").unwrap();
        presses.moves(e, Some("a"));
        presses.go_on(focus, Some("a"), 0).unwrap();
        go_on("b").unwrap();
        go_on("a").expect("one that was refused ends no other");
        presses.moves(e, Some("b"));
        assert_eq!(go_on("a"), ended);
        go_on("b").unwrap();
        presses.let_go(e);
        assert_eq!((go_on("a"), go_on("b")), (ended.clone(), ended));
        presses.go_on(focus, Some("a"), 0).expect("it is another axis's");
        for n in 0..2 * REMEMBERED {
            go_on(&format!("c{n}")).unwrap();
        }
        assert_eq!(presses.heard()[&e].len(), REMEMBERED);
    }
}
