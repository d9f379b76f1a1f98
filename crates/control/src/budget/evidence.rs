//! What an alignment has seen.

use crate::job::SpacingReading;
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::shell::ShellObservation;
use crate::measuring::eye::Seen;

/// A board in air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardSeen {
    /// How far from the lens's principal point it was asked to be, mm.
    pub distance_mm: f64,
    /// Its spacing, px.
    pub spacing_px: f64,
    /// The standard uncertainty of that, px.
    pub sigma_px: f64,
}

impl BoardSeen {
    /// One at a distance (mm), by its spacing.
    pub(crate) const fn at(distance_mm: f64, seen: &SpacingReading) -> Self {
        Self { distance_mm, spacing_px: seen.spacing_px, sigma_px: seen.spacing_sigma_px }
    }
}

/// What boards in air showed where the focus axis stood.
#[derive(Debug, Clone, PartialEq)]
pub struct AirPlace {
    /// Readback of the focus axis, mm.
    pub focus_mm: f64,
    /// All levels of a stepped board, nearest first, or one board.
    pub boards: Vec<BoardSeen>,
}

/// The pitch of a white frame's micro-images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PitchSeen {
    /// The pitch, px.
    pub pitch_px: f64,
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
    /// Readback of the focus axis when the frame was taken, mm.
    pub focus_mm: f64,
}

/// How the spacing's tilt differs through the shell from what it was in air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltChange {
    /// Along x and y, px per half frame width.
    pub px: [f64; 2],
    /// The standard uncertainty of each, px, with what the field's parts scatter by.
    pub sigma_px: f64,
    /// The least that it can be, by the spacings' own uncertainty, px.
    pub least_sigma_px: f64,
}

impl TiltChange {
    /// From boards in air to one through the shell.
    pub(crate) fn between(in_air: &Seen, seen: &Seen) -> Self {
        let (one, other) = (&in_air.spacing, &seen.spacing);
        Self {
            px: [other.tilt_x_px - one.tilt_x_px, other.tilt_y_px - one.tilt_y_px],
            sigma_px: in_air.tilt_sigma_px.hypot(seen.tilt_sigma_px),
            least_sigma_px: one.least_tilt_sigma_px().hypot(other.least_tilt_sigma_px()),
        }
    }
}

/// What an alignment has seen, from the end of its air step on.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// The camera as the air step left it.
    pub air: CalibratedCamera,
    /// Readback of the focus axis then, mm.
    pub focus_mm: f64,
    /// Travel of the focus axis over its reading, as the trims through the shell were reckoned.
    pub focus_scale: f64,
    /// The boards at other places of the focus axis: what they tell of its scale, and by that of where the white frame was
    /// taken.
    pub places: Vec<AirPlace>,
    /// The three boards of the triple-level board at the end of the air step, nearest first.
    pub boards: [BoardSeen; 3],
    /// The white frame's pitch.
    pub pitch: Option<PitchSeen>,
    /// What was measured at each pose through the shell, in order.
    pub shell: Vec<ShellObservation>,
    /// How the tilt has changed since air.
    pub tilt_change: Option<TiltChange>,
    /// Radius of the masks that pairs were compared with, px.
    pub window_px: f64,
}
