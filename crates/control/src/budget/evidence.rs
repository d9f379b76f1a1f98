//! What an alignment has seen.

use crate::loops::calibrated::CalibratedCamera;
use crate::loops::shell::ShellObservation;
use crate::spacing::{SpacingReading, TiltChange};

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

/// What an air step left: enough to go on with the shell in a later job.
#[derive(Debug, Clone)]
pub(crate) struct AirStep {
    /// Camera as calibrated.
    pub(crate) camera: CalibratedCamera,
    /// Δv at its end and its standard uncertainty, mm.
    pub(crate) delta_v: (f64, f64),
    /// The boards one by one, where they could be told apart.
    pub(crate) boards: Option<[BoardSeen; 3]>,
    /// Readback of the focus axis then, mm.
    pub(crate) focus_mm: f64,
    /// Travel of the focus axis over its reading, as the boards had it; `None` where it had not been moved.
    pub(crate) focus_scale: Option<f64>,
    /// What boards showed at other places of the axis.
    pub(crate) places: Vec<AirPlace>,
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
