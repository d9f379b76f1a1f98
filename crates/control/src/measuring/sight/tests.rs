//! Whether a white frame is known to fit.

use super::*;

const SIDE: usize = 400;

/// Discs of this radius on a square lattice of this pitch, px, white or with waves of a board's texture in them.
fn frame(pitch: f64, radius: f64, board: bool) -> RawImage {
    let level = |n: usize| {
        let [x, y] = [n % SIDE, n / SIDE].map(|k| k as f64 - 0.5 * SIDE as f64);
        let from_middle = [x, y].map(|k| k - pitch * (k / pitch).round());
        let light = (0.5 + (radius - from_middle[0].hypot(from_middle[1])) / 5.0).clamp(0.0, 1.0);
        let wave = (0.21 * x).sin() * (0.17 * y + 0.03 * x).cos();
        let noise = (n.wrapping_mul(2_654_435_761) >> 7) % 5;
        light * if board { 120.0 + 50.0 * wave } else { 180.0 } + noise as f64
    };
    RawImage::from_u8(SIDE, SIDE, (0..SIDE * SIDE).map(|n| level(n) as u8).collect())
}

#[test]
fn a_white_frame_that_no_longer_fits_is_known_by_its_profile_and_by_its_pitch() {
    let config = Config::default();
    let sight = Sight::from_white(&frame(29.5, 13.0, false), &config).unwrap();
    let misfit = |pitch, radius| sight.misfit(&frame(pitch, radius, true)).unwrap();
    assert_eq!(misfit(29.5, 13.0), None);
    for (pitch, radius, said) in [(29.5, 11.0, "its profile is off by"), (30.2, 13.0, "the known grid no longer fits")]
    {
        let misfit = misfit(pitch, radius).unwrap();
        assert!(misfit.starts_with("the white frame no longer fits: ") && misfit.contains(said), "{misfit}");
    }
    // No white frame mends that there is no light.
    assert!(sight.misfit(&RawImage::from_u8(SIDE, SIDE, vec![3; SIDE * SIDE])).is_err());
}
