//! Whether it is in doubt that one board is in view.

/// An unevenness that begins a doubt, and one below which it has passed: about either it goes to and fro by noise.
const BEGINS: f64 = 1.0;
const PASSES: f64 = 0.5;

/// Since when frames are uneven: until a whole measurement of one of them says what they show, their spacing is none's as
/// far as is known.
#[derive(Debug, Default)]
pub(super) struct Doubt {
    /// The first frame's sequence number.
    since: Option<u64>,
}

impl Doubt {
    /// Takes a frame's unevenness; `measured` is the newest frame that was measured in whole. Whether what is in view is in
    /// doubt now.
    pub(super) fn take(&mut self, seq: u64, unevenness: f64, measured: Option<u64>) -> bool {
        if unevenness < PASSES {
            self.since = None;
        } else if unevenness >= BEGINS {
            self.since.get_or_insert(seq);
        }
        self.since.is_some_and(|since| measured.is_none_or(|measured| measured < since))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_in_doubt_until_a_frame_that_has_it_is_measured_in_whole() {
        let mut doubt = Doubt::default();
        assert!(!doubt.take(1, 0.9, None));
        assert!(doubt.take(2, 1.0, None));
        // What was measured before says nothing of it, and noise about the bound ends nothing.
        assert!(doubt.take(3, 0.6, Some(1)));
        assert!(!doubt.take(4, 2.0, Some(2)));
        assert!(!doubt.take(5, 0.6, Some(2)) && !doubt.take(6, 3.0, Some(2)));
        // Another one is in doubt again.
        assert!(!doubt.take(7, 0.4, Some(2)));
        assert!(doubt.take(8, 1.2, Some(2)));
    }
}
