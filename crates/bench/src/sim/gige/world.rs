//! What the camera sees: the simulated truth, with its carriages where the stages' twins have them.

use std::sync::{Arc, Mutex, PoisonError};

use super::slides::{SlideRecord, Slides};
use crate::config::Config;
use crate::device::{AxisName, Setup};
use crate::sim::truth::{Pose, Truth};

/// The world before the camera.
pub(super) struct World {
    truth: Arc<Truth>,
    state: Mutex<State>,
}

struct State {
    slides: Slides,
    /// When e was moved by hand, µs since 1970: it stays there until its motor turns.
    by_hand: Option<i64>,
}

impl World {
    /// A bench whose slides these records tell of; without, they stand where they are found.
    pub(super) fn new(config: &Arc<Config>, records: Vec<SlideRecord>) -> Self {
        let state = Mutex::new(State { slides: Slides::new(records), by_hand: None });
        Self { truth: Truth::new(config), state }
    }

    /// The poses at two moments, µs since 1970, none of them in the future.
    pub(super) fn poses(&self, moments: [i64; 2]) -> [Pose; 2] {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.slides.follow();
        moments.map(|moment| self.carried(&state, moment))
    }

    fn carried(&self, state: &State, moment: i64) -> Pose {
        for axis in AxisName::ALL {
            let held =
                axis == AxisName::E && state.by_hand.is_some_and(|hand| state.slides.moved_at(axis) <= Some(hand));
            if let Some(mm) = state.slides.at(axis, moment).filter(|_| !held) {
                self.truth.carry(axis, mm);
            }
        }
        self.truth.pose()
    }

    /// Sets the bench up as an operator does.
    pub(super) fn obey(&self, setup: &Setup) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.slides.follow();
        let now = now_us();
        // Boards are put up before the camera as it stands now.
        let _ = self.carried(&state, now);
        self.truth.obey(setup);
        if matches!(setup, Setup::LeastE { .. }) {
            state.by_hand = Some(now);
        }
    }

    /// The truth as it is now.
    pub(super) fn truth(&self) -> serde_json::Value {
        let _ = self.poses([now_us(); 2]);
        self.truth.report()
    }
}

/// Microseconds since 1970.
pub(super) fn now_us() -> i64 {
    jiff::Timestamp::now().as_microsecond()
}
