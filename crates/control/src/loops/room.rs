//! How near to the shell the lens may be taken: beside the wall, which allows for what the picture scatters by, e may be
//! wrong by all that is taken for granted, and a lens that touches the shell is scratched whatever the cause.

use super::axis_model::AxisModel;

/// Standard uncertainties of e that have to lie between the lens and where it touches: one in a thousand is nearer.
const CLEAR_SIGMAS: f64 = 3.0;
/// With fewer than this, where a later picture has made e smaller or less certain, the lens is taken back.
const BACK_SIGMAS: f64 = 2.5;

/// Where the lens touches the shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// e there, mm: l_bound less its clearance.
    pub e_mm: f64,
    /// Of a measured one the standard uncertainty by all that is taken for granted, mm; `None` where it is configured.
    pub measured_sigma_mm: Option<f64>,
}

impl Contact {
    /// Standard uncertainty of how far the lens is from there, e being uncertain by so much; mm.
    pub fn distance_sigma_mm(&self, e_sigma_mm: f64) -> f64 {
        e_sigma_mm.hypot(self.measured_sigma_mm.unwrap_or(0.0))
    }
}

/// What the e axis's readings mean, with all that is taken for granted. Picture and axis each tell e; where one of them is wrong
/// by more than is said of it, what both together tell is wrong by a part of that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EAxis {
    /// By all that was seen and is taken for granted.
    pub by_all: AxisModel,
    /// By the picture rather, with the axis's zero in doubt.
    pub by_picture: AxisModel,
    /// By the axis rather, with the shell's radii, and where the board stands in the water, in doubt.
    pub by_axis: AxisModel,
}

impl EAxis {
    /// Where there is nothing else that tells e.
    #[must_use]
    pub fn alone(e: AxisModel) -> Self {
        Self { by_all: e, by_picture: e, by_axis: e }
    }

    /// Each of them.
    fn each(self) -> [AxisModel; 3] {
        [self.by_all, self.by_picture, self.by_axis]
    }
}

/// The room between lens and shell. No single mistake has the lens touch: each of what tells e has to leave enough of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Where the lens touches.
    pub contact: Contact,
    /// What the e axis's readings mean. Much of what that is wrong by a contact that was measured is wrong by, too, and alike;
    /// it counts for both all the same.
    pub e: EAxis,
}

impl Room {
    /// How many of its standard uncertainties e is from where the lens touches, at a reading, mm, by what leaves the fewest.
    fn sigmas_left(&self, reading_mm: f64) -> f64 {
        self.sigmas_left_by(self.nearest(reading_mm), reading_mm)
    }

    /// By which of what tells e the fewest are left.
    fn nearest(&self, reading_mm: f64) -> AxisModel {
        let left = |e| self.sigmas_left_by(e, reading_mm);
        self.e.each().into_iter().fold(self.e.by_all, |near, e| if left(e) < left(near) { e } else { near })
    }

    fn sigmas_left_by(&self, e: AxisModel, reading_mm: f64) -> f64 {
        let (e_mm, sigma_mm) = e.predict(reading_mm);
        let sigma_mm = self.contact.distance_sigma_mm(sigma_mm);
        let left_mm = e_mm - self.contact.e_mm;
        if sigma_mm > 0.0 { left_mm / sigma_mm } else { left_mm.signum() * f64::INFINITY }
    }

    /// e and its standard uncertainty (mm) at a reading (mm), by what leaves the least room.
    #[must_use]
    pub fn nearest_e(&self, reading_mm: f64) -> (f64, f64) {
        self.nearest(reading_mm).predict(reading_mm)
    }

    /// Whether the lens may be taken there.
    #[must_use]
    pub fn lets(&self, reading_mm: f64) -> bool {
        self.sigmas_left(reading_mm) >= CLEAR_SIGMAS
    }

    /// Whether the lens, which stands there, has to be taken back.
    #[must_use]
    pub fn asks_back(&self, reading_mm: f64) -> bool {
        self.sigmas_left(reading_mm) < BACK_SIGMAS
    }

    /// The least reading, from one on (mm) up to a highest one, that the lens may be taken to; `None` where there is none.
    #[must_use]
    pub fn least_mm(&self, from_mm: f64, highest_mm: f64) -> Option<f64> {
        if self.lets(from_mm) {
            return Some(from_mm);
        }
        if highest_mm <= from_mm || !self.lets(highest_mm) {
            return None;
        }
        let (mut near, mut far) = (from_mm, highest_mm);
        for _ in 0..40 {
            let middle = f64::midpoint(near, far);
            if self.lets(middle) {
                far = middle;
            } else {
                near = middle;
            }
        }
        Some(far)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(sigma_mm: f64, measured_sigma_mm: Option<f64>) -> Room {
        let e = EAxis::alone(AxisModel::new(0.0, 0.1, sigma_mm, 0.0));
        Room { contact: Contact { e_mm: -0.5, measured_sigma_mm }, e }
    }

    #[test]
    fn each_of_what_tells_e_has_to_leave_room() {
        let near = AxisModel::new(0.0, -0.2, 0.15, 0.0);
        let EAxis { by_all, .. } = room(0.1, None).e;
        for e in [
            EAxis { by_all: near, ..EAxis::alone(by_all) },
            EAxis { by_picture: near, ..EAxis::alone(by_all) },
            EAxis { by_axis: near, ..EAxis::alone(by_all) },
        ] {
            let room = Room { e, ..room(0.1, None) };
            assert!(!room.lets(0.0) && room.asks_back(0.0) && room.lets(0.2), "{e:?}");
            assert_eq!(room.nearest_e(0.0), (-0.2, 0.15));
        }
        assert!(room(0.1, None).lets(0.0));
    }

    #[test]
    fn three_sigmas_are_left_and_two_and_a_half_ask_back() {
        // The lens is 0.6 mm from where it touches where the axis reads 0.
        for (sigma_mm, lets, asks_back) in
            [(0.0, true, false), (0.19, true, false), (0.22, false, false), (0.25, false, true)]
        {
            let room = room(sigma_mm, None);
            assert_eq!((room.lets(0.0), room.asks_back(0.0)), (lets, asks_back), "{sigma_mm}");
        }
        assert!(!room(0.0, None).lets(-0.7), "beyond it nothing is left, however well e is known");
        assert!(!room(0.15, Some(0.15)).lets(0.0), "a measured contact is uncertain, too");
    }

    #[test]
    fn the_least_reading_is_the_nearest_that_leaves_room() {
        let uncertain = room(0.4, None);
        let least = uncertain.least_mm(0.0, 30.0).unwrap();
        assert!((least - 0.6).abs() < 1e-6, "{least}");
        assert_eq!(uncertain.least_mm(2.0, 30.0), Some(2.0));
        assert_eq!(uncertain.least_mm(0.0, 0.5), None);
        assert_eq!(uncertain.least_mm(0.0, -1.0), None);
    }
}
