//! Frames of a sensor with a Bayer mosaic, made fit for what measures grey frames.
//!
//! Grid and vignetting want the mosaic evened out: each colour's mean brought to that of green. The spacing is measured
//! on green alone, whose pixels are half of all and carry most of the light. Between them green is interpolated, but only
//! pixels that measured green are ever a reference. Red and blue are left out, because a lens bends them otherwise.

use rayon::prelude::*;

use super::grid::Grid;
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

/// Red, green and blue at every pixel of a frame (row by row), each filled in where the mosaic has another colour, from
/// the pixels of the same micro-image alone: a neighbour across the gap sees another part of the scene.
///
/// Green comes first, along the direction in which it changes less; red and blue follow as their differences from green,
/// which change less than they do themselves.
#[must_use]
pub fn colours(values: &[f32], pattern: CfaPattern, grid: &Grid) -> [Vec<f32>; 3] {
    let [width, height] = grid.frame_size;
    let owner: Vec<[i32; 2]> = (0..height)
        .into_par_iter()
        .flat_map_iter(|y| (0..width).map(move |x| grid.index_of(x as f64, y as f64)))
        .collect();
    let neighbour = |x: usize, y: usize, dx: isize, dy: isize| {
        let (nx, ny) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
        let inside = nx < width && ny < height;
        (inside && owner[ny * width + nx] == owner[y * width + x]).then(|| ny * width + nx)
    };
    let fill = |value: &(dyn Fn(usize, usize) -> f32 + Sync)| -> Vec<f32> {
        (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| value(x, y))).collect()
    };
    let green = fill(&|x, y| {
        if pattern.channel(x, y) == Channel::Green {
            return values[y * width + x];
        }
        let pair = |dx: isize, dy: isize| Some((values[neighbour(x, y, dx, dy)?], values[neighbour(x, y, -dx, -dy)?]));
        match (pair(1, 0), pair(0, 1)) {
            (Some((left, right)), Some((up, down))) => {
                let (across, along) = ((left - right).abs() + 1e-3, (up - down).abs() + 1e-3);
                // Each direction by how little it changes.
                let share = along / (across + along);
                share * f32::midpoint(left, right) + (1.0 - share) * f32::midpoint(up, down)
            }
            _ => {
                let near = [[1, 0], [-1, 0], [0, 1], [0, -1]].map(|[dx, dy]| neighbour(x, y, dx, dy));
                mean(near.into_iter().flatten().map(|at| values[at])).unwrap_or(values[y * width + x])
            }
        }
    });
    let other = |channel: Channel| {
        fill(&|x, y| {
            let here = y * width + x;
            if pattern.channel(x, y) == channel {
                return values[here];
            }
            // The nearest ring that has the colour: beside or diagonal, else two away at a micro-image's edge.
            let difference = [1isize, 2].into_iter().find_map(|reach| {
                let ring = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| [dx, dy]));
                mean(
                    ring.filter_map(|[dx, dy]| neighbour(x, y, dx, dy))
                        .filter(|&at| pattern.channel(at % width, at / width) == channel)
                        .map(|at| values[at] - green[at]),
                )
            });
            green[here] + difference.unwrap_or(0.0)
        })
    };
    let (red, blue) = (other(Channel::Red), other(Channel::Blue));
    [red, green, blue]
}

fn mean(values: impl Iterator<Item = f32>) -> Option<f32> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f32)
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
