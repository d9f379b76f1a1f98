//! Which of a micro-image's pixels are compared.

use super::pupil::Pupil;

/// Share of the micro-image's radius that is used: beyond it vignetting falls steeply and neighbours leak in.
pub const MASK_FRACTION: f64 = 0.8;
/// Pixels of the frame that there have to be about a mask.
pub(in crate::imaging) const MARGIN_PX: f64 = 4.0;
/// Least half width (px) of the overlap of two masks.
const LEAST_OVERLAP_PX: f64 = 1.5;

/// Radius (px) of the masks for one spacing (px): as large as the main lens's aperture cuts nothing off, and never so
/// small that they hardly overlap.
///
/// Near the edge of its micro-image a pixel sees through a part of its microlens only, which pulls the spacing
/// ([`Pupil::corrected`]).
pub(in crate::imaging) fn mask_radius(pupil: &Pupil, spacing: f64) -> f64 {
    radius(pupil.pitch, pupil.whole, spacing)
}

/// The radius (px) that masks will have with a camera in focus: of its micro-images' pitch and its spacing (px) alone,
/// before any frame has shown what its aperture cuts off.
#[must_use]
pub fn nominal_mask_radius(pitch: f64, spacing: f64) -> f64 {
    // In focus the aperture's edge passes over a microlens while a pixel moves by what pitch and spacing differ by.
    radius(pitch, 1.0 - (spacing - pitch).abs() / pitch, spacing)
}

fn radius(pitch: f64, whole: f64, spacing: f64) -> f64 {
    // Masks a shift apart overlap by their diameter less the shift.
    let shift = (spacing - pitch).abs();
    let fraction = whole.max((shift / 2.0 + LEAST_OVERLAP_PX) / (pitch / 2.0)).min(MASK_FRACTION);
    fraction * pitch / 2.0
}
