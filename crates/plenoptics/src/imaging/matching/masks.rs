//! Which of a micro-image's pixels are compared.

/// Share of the micro-image's radius that is used: beyond it vignetting falls steeply and neighbours leak in.
pub const MASK_FRACTION: f64 = 0.8;
/// Pixels of the frame that there have to be about a mask.
pub(in crate::imaging) const MARGIN_PX: f64 = 4.0;
/// The smallest masks, as a part of the micro-image's radius, where the profile falls from its centre on.
const LEAST_MASK_FRACTION: f64 = 0.5;
/// Share of the centre's light from which on a pixel counts as seeing through its whole microlens.
const WHOLE_SHARE: f64 = 0.985;
/// Least half width (px) of the overlap of two masks.
const LEAST_OVERLAP_PX: f64 = 1.5;

/// Radius (px) of the masks for one spacing, where pixels see through their whole microlens within the part `whole` of
/// the micro-image's radius: as large as the main lens's aperture cuts nothing off, and never so small that they hardly
/// overlap.
///
/// Near the edge of its micro-image a pixel sees through a part of its microlens only. Out of focus its blur is then
/// lopsided, which pulls the spacing towards the one in focus (by 0.06 px of 6 px at Δv = 0, 0.2 of 7 px at e = 30);
/// in focus the light lies lopsided on the pixel itself (0.006 px).
pub(in crate::imaging) fn mask_radius(whole: f64, pitch: f64, spacing: f64) -> f64 {
    // Masks a shift apart overlap by their diameter less the shift.
    let shift = (spacing - pitch).abs();
    let fraction = whole.max((shift / 2.0 + LEAST_OVERLAP_PX) / (pitch / 2.0)).min(MASK_FRACTION);
    fraction * pitch / 2.0
}

/// Part of the micro-image's radius within which no light is cut off, from the profile's mean around circles about
/// micro-image centres: `share` has the light that reaches the pixel in a column and row.
pub(in crate::imaging) fn whole_fraction(
    centres: &[[f64; 2]],
    pitch: f64,
    share: impl Fn([f64; 2], [usize; 2]) -> f32,
) -> f64 {
    const DIRECTIONS: usize = 24;
    let every = (centres.len() / 64).max(1);
    let ring = |fraction: f64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for &centre in centres.iter().step_by(every) {
            for k in 0..DIRECTIONS {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
                let reach = fraction * pitch / 2.0;
                let pixel = [centre[0] + reach * cos, centre[1] + reach * sin].map(|v| v.round() as usize);
                sum += f64::from(share(centre, pixel));
                count += 1.0;
            }
        }
        sum / f64::max(count, 1.0)
    };
    let least = WHOLE_SHARE * f64::midpoint(ring(0.1), ring(0.25));
    (0..)
        .map(|k| MASK_FRACTION - 0.02 * f64::from(k))
        .take_while(|&fraction| fraction > LEAST_MASK_FRACTION)
        .find(|&fraction| ring(fraction) >= least)
        .unwrap_or(LEAST_MASK_FRACTION)
}
