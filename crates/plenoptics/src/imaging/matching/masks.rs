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
    // Masks a shift apart overlap by their diameter less the shift.
    let shift = (spacing - pupil.pitch).abs();
    let fraction = pupil.whole.max((shift / 2.0 + LEAST_OVERLAP_PX) / (pupil.pitch / 2.0)).min(MASK_FRACTION);
    fraction * pupil.pitch / 2.0
}
