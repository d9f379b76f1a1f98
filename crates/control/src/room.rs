//! How near to the shell the lens may be taken: beside the wall, which allows for what the picture scatters by, e may be
//! wrong by all that is taken for granted, and a lens that touches the shell is scratched whatever the cause.

use super::axis_model::AxisModel;

/// Standard uncertainties of e that have to lie between the lens and where it touches: one in a thousand is nearer.
pub const CLEAR_SIGMAS: f64 = 3.0;
/// With fewer than this, where a later picture has made e smaller or less certain, the lens is taken back.
const BACK_SIGMAS: f64 = 2.5;

/// Where the lens touches the shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// e there, mm: l_bound less its clearance.
    pub e_mm: f64,
    /// Of a measured one the standard uncertainty by its picture, mm; `None` where it is configured.
    pub measured_sigma_mm: Option<f64>,
}

/// The room between lens and shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Where the lens touches.
    pub contact: Contact,
    /// What the e axis's readings mean, with all that is taken for granted: against a contact that was measured, with what
    /// both are wrong by alike left out.
    pub e: AxisModel,
}

impl Room {
    /// e (mm) at a reading (mm), and how many of its standard uncertainties it is from where the lens touches.
    fn clear(&self, reading_mm: f64) -> (f64, f64) {
        let (e_mm, sigma_mm) = self.e.predict(reading_mm);
        let sigma_mm = sigma_mm.hypot(self.contact.measured_sigma_mm.unwrap_or(0.0));
        let left_mm = e_mm - self.contact.e_mm;
        (left_mm, if sigma_mm > 0.0 { left_mm / sigma_mm } else { left_mm.signum() * f64::INFINITY })
    }

    /// Whether the lens may be taken there.
    #[must_use]
    pub fn lets(&self, reading_mm: f64) -> bool {
        self.clear(reading_mm).1 >= CLEAR_SIGMAS
    }

    /// Whether the lens, which stands there, has to be taken back.
    #[must_use]
    pub fn asks_back(&self, reading_mm: f64) -> bool {
        self.clear(reading_mm).1 < BACK_SIGMAS
    }

    /// The least reading, from one on (mm) up to a highest one, that the lens may be taken to; the highest where there is none.
    #[must_use]
    pub fn least_mm(&self, from_mm: f64, highest_mm: f64) -> f64 {
        if self.lets(from_mm) || highest_mm <= from_mm {
            return from_mm;
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
        far
    }
}
