//! Presses of a jog's button: one that a stop has ended does not go on after the reset, however often it is repeated.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use super::refusal::{Refusal, ServiceError};
use crate::device::AxisName;

/// Most characters of a press's name.
const MAX_NAME: usize = 64;

/// The newest press of each axis, and how often the bench had been stopped when it was first heard of.
#[derive(Debug, Default)]
pub(super) struct Presses {
    newest: Mutex<HashMap<AxisName, (String, u64)>>,
}

impl Presses {
    /// Lets a press go on, or begin; `stops` is how often the bench has been stopped by now.
    ///
    /// # Errors
    /// [`Refusal::PressEnded`] where it was heard of before the newest stop; [`ServiceError::Invalid`] where its name is
    /// none, or too long.
    pub(super) fn go_on(&self, axis: AxisName, press: Option<&str>, stops: u64) -> Result<(), ServiceError> {
        let Some(press) = press else { return Ok(()) };
        if press.is_empty() || press.chars().count() > MAX_NAME {
            return Err(ServiceError::Invalid {
                field: "press",
                what: format!("1 to {MAX_NAME} characters are needed"),
            });
        }
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        match newest.get(&axis) {
            Some((known, before)) if known == press && *before != stops => Err(Refusal::PressEnded { axis }.into()),
            Some((known, _)) if known == press => Ok(()),
            _ => {
                newest.insert(axis, (press.to_owned(), stops));
                Ok(())
            }
        }
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
        presses.go_on(e, None, 2).unwrap();
        assert_eq!(presses.go_on(focus, Some("f"), 2), Err(Refusal::PressEnded { axis: focus }.into()));
        for wrong in ["", &"x".repeat(MAX_NAME + 1)] {
            assert!(matches!(presses.go_on(e, Some(wrong), 2), Err(ServiceError::Invalid { field: "press", .. })));
        }
    }
}
