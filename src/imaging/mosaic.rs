//! Frames of a sensor with a Bayer mosaic, made fit for what measures grey frames.
//!
//! Grid and vignetting want the mosaic evened out: each colour's mean brought to that of green. The spacing is measured
//! on green alone, whose pixels are half of all and carry most of the light. Between them green is interpolated, but only
//! pixels that measured green are ever a reference. Red and blue are left out, because a lens bends them otherwise.

use rayon::prelude::*;

use crate::raw::{CfaPattern, Channel, RawImage};

/// The frame with every colour's mean brought to that of green, 16 bits deep; saturated pixels stay saturated.
#[must_use]
pub fn balanced(raw: &RawImage, pattern: CfaPattern) -> RawImage {
    let (width, height, white) = (raw.width(), raw.height(), raw.white_level());
    let samples = raw.to_f32();
    let mut sums = [(0.0f64, 0usize); 3];
    for (k, &sample) in samples.iter().enumerate() {
        let sum = &mut sums[pattern.channel(k % width, k / width).index()];
        sum.0 += f64::from(sample);
        sum.1 += 1;
    }
    let means = sums.map(|(sum, count)| sum / count.max(1) as f64);
    let green = means[Channel::Green.index()];
    let factors = means.map(|mean| if mean > 0.0 { green / mean } else { 1.0 });
    // The strongest factor must not push an unsaturated pixel over the top.
    let top = factors.iter().copied().fold(1.0, f64::max) * f64::from(white);
    let scale = f64::from(u16::MAX) / top;
    let evened = samples
        .iter()
        .enumerate()
        .map(|(k, &sample)| {
            if sample >= f32::from(white) {
                return u16::MAX;
            }
            let factor = factors[pattern.channel(k % width, k / width).index()];
            (f64::from(sample) * factor * scale).round().clamp(0.0, f64::from(u16::MAX - 1)) as u16
        })
        .collect();
    RawImage::from_u16(width, height, 16, evened)
}

/// Weights of the green pixels about one that is not green, by their distances along the axes (either way round, on both
/// sides). They are the least-squares fit to passing on unchanged every wave longer than 4.8 px, and do so to 0.5 % in the
/// root mean square; the mean of the four neighbours alone would weaken waves of 10 px by a tenth and, mixed with measured
/// pixels, shift them.
const GREEN_WEIGHTS: [([usize; 2], f32); 5] =
    [([1, 0], 0.358_33), ([1, 2], -0.066_33), ([3, 0], -0.004_57), ([3, 2], 0.012_19), ([1, 4], 0.003_57)];

/// Green at every pixel, in the frame's own grey levels: as measured where the mosaic is green, interpolated elsewhere.
#[must_use]
pub fn green(raw: &RawImage, pattern: CfaPattern) -> Vec<f32> {
    let (width, height) = (raw.width(), raw.height());
    let samples = raw.to_f32();
    let taps: Vec<([isize; 2], f32)> = GREEN_WEIGHTS
        .iter()
        .flat_map(|&([far, near], weight)| {
            let (far, near) = (far as isize, near as isize);
            let mut places: Vec<[isize; 2]> =
                [[far, near], [near, far]].iter().flat_map(|&[x, y]| [[x, y], [-x, y], [x, -y], [-x, -y]]).collect();
            places.sort_unstable();
            places.dedup();
            places.into_iter().map(move |place| (place, weight))
        })
        .collect();
    let mut plane = samples.clone();
    plane.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate().filter(|(x, _)| pattern.channel(*x, y) != Channel::Green) {
            let (mut sum, mut weights) = (0.0, 0.0);
            for &([dx, dy], weight) in &taps {
                let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                if x < width && y < height {
                    sum += weight * samples[y * width + x];
                    weights += weight;
                }
            }
            // What leaves the frame is left out; the nearest are always there, two at least.
            *value = sum / weights;
        }
    });
    plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raw::Samples;

    #[test]
    fn a_grey_scene_behind_coloured_filters_becomes_even() {
        let (width, height) = (8, 6);
        let level = |k: usize| match CfaPattern::Grbg.channel(k % width, k / width) {
            Channel::Red => 60,
            Channel::Green => 120,
            Channel::Blue => 40,
        };
        let raw = RawImage::from_u8(width, height, (0..width * height).map(level).collect());
        let Samples::U16(evened) = balanced(&raw, CfaPattern::Grbg).samples().clone() else { panic!("16 bits") };
        let (least, greatest) = (evened.iter().min().unwrap(), evened.iter().max().unwrap());
        assert!(greatest - least <= 1, "{least} to {greatest}");
        assert!(green(&raw, CfaPattern::Grbg).iter().all(|&v| (v - 120.0).abs() < 1e-3));
    }

    #[test]
    fn a_slope_of_green_goes_on_between_its_pixels() {
        let (width, height) = (17, 15);
        let level = |k: usize| (10 + 3 * (k % width) + 5 * (k / width)) as u8;
        let raw = RawImage::from_u8(width, height, (0..width * height).map(level).collect());
        let plane = green(&raw, CfaPattern::Rggb);
        for y in 4..height - 4 {
            for x in 4..width - 4 {
                let (value, truth) = (plane[y * width + x], (10 + 3 * x + 5 * y) as f32);
                assert!((value - truth).abs() < 1e-3, "{x}, {y}: {value} for {truth}");
            }
        }
    }

    #[test]
    fn saturated_pixels_stay_saturated() {
        let raw = RawImage::from_u8(2, 2, vec![255, 100, 50, 254]);
        let Samples::U16(evened) = balanced(&raw, CfaPattern::Rggb).samples().clone() else { panic!("16 bits") };
        assert_eq!(evened[0], u16::MAX);
        assert!(evened[1..].iter().all(|&v| v < u16::MAX));
    }
}
