//! A part of a raw frame, at as many pixels as it is looked at with.

use super::scaled::{covers, scaled};
use super::{RawImage, Samples};

/// A rectangle of a frame's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl RawImage {
    /// All of it.
    #[must_use]
    pub const fn window(&self) -> Window {
        Window { x: 0, y: 0, width: self.width, height: self.height }
    }

    /// Whether a window is of the frame: not empty, and nowhere outside.
    #[must_use]
    pub fn contains(&self, window: Window) -> bool {
        let within = |from: usize, length: usize, all: usize| length > 0 && length <= all && from <= all - length;
        within(window.x, window.width, self.width) && within(window.y, window.height, self.height)
    }

    /// The frame within a window, sample for sample; none where that is not of the frame.
    #[must_use]
    pub fn cropped(&self, window: Window) -> Option<Self> {
        if !self.contains(window) {
            return None;
        }
        let samples = match &self.samples {
            Samples::U8(samples) => Samples::U8(rows(samples, self.width, window).flatten().copied().collect()),
            Samples::U16(samples) => Samples::U16(rows(samples, self.width, window).flatten().copied().collect()),
        };
        Some(Self::new(window.width, window.height, self.bits, samples))
    }

    /// The frame within a window as a grey picture of so many columns and rows, each at most the window's, scaled to 8
    /// bits: for viewing and never for measuring. `mosaic` says that the frame's pixels have colours. None where there
    /// is no such picture of the frame.
    #[must_use]
    pub fn to_view_of(&self, window: Window, size: [usize; 2], mosaic: bool) -> Option<Vec<u8>> {
        let [width, height] = size;
        if !self.contains(window) || !(1..=window.width).contains(&width) || !(1..=window.height).contains(&height) {
            return None;
        }
        let columns = covers(window.x, window.width, width, self.width, mosaic);
        let rows = covers(window.y, window.height, height, self.height, mosaic);
        Some(match &self.samples {
            Samples::U8(samples) => scaled(samples, self.width, 0, &columns, &rows),
            Samples::U16(samples) => scaled(samples, self.width, self.bits - 8, &columns, &rows),
        })
    }
}

/// The rows of a window.
fn rows<T>(samples: &[T], width: usize, window: Window) -> impl Iterator<Item = &[T]> {
    let within = window.x..window.x + window.width;
    samples.chunks_exact(width).skip(window.y).take(window.height).map(move |row| &row[within.clone()])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels without a pattern, of a fixed seed.
    fn noise(width: usize, height: usize) -> RawImage {
        let mut state = 7u32;
        let level = |_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        RawImage::from_u8(width, height, (0..width * height).map(level).collect())
    }

    fn samples(image: &RawImage) -> Vec<u8> {
        let Samples::U8(samples) = image.samples() else { panic!("8 bits") };
        samples.clone()
    }

    /// The mean over what a pixel covers, by the integral over the frame up to each place.
    fn by_integrals(image: &RawImage, window: Window, [width, height]: [usize; 2]) -> Vec<f64> {
        let (values, across) = (samples(image), image.width());
        let sum_to = |x: f64, y: f64| {
            let mut sum = 0.0;
            for row in 0..image.height() {
                for column in 0..across {
                    let [w, h] = [(x - column as f64).clamp(0.0, 1.0), (y - row as f64).clamp(0.0, 1.0)];
                    sum += w * h * f64::from(values[row * across + column]);
                }
            }
            sum
        };
        let edge =
            |from: usize, length: usize, k: usize, count: usize| from as f64 + (k * length) as f64 / count as f64;
        let mut means = Vec::new();
        for y in 0..height {
            let [top, bottom] = [y, y + 1].map(|k| edge(window.y, window.height, k, height));
            for x in 0..width {
                let [left, right] = [x, x + 1].map(|k| edge(window.x, window.width, k, width));
                let sum = sum_to(right, bottom) - sum_to(left, bottom) - sum_to(right, top) + sum_to(left, top);
                means.push(sum / ((right - left) * (bottom - top)));
            }
        }
        means
    }

    #[test]
    fn a_smaller_picture_holds_the_means_of_what_its_pixels_cover() {
        let image = noise(31, 23);
        let part = Window { x: 3, y: 2, width: 25, height: 17 };
        for (window, size) in
            [(image.window(), [13, 9]), (part, [25, 17]), (part, [24, 5]), (part, [1, 1]), (part, [7, 17])]
        {
            check_means(&image, window, size);
        }
        // More columns and rows than are added up at once, and no multiple of these.
        let large = noise(141, 49);
        check_means(&large, Window { x: 2, y: 1, width: 137, height: 47 }, [70, 43]);
        // The levels of deeper samples are their highest bits.
        let deep = samples(&large).iter().zip(0..).map(|(&level, k)| (u16::from(level) << 4) | (k % 16)).collect();
        let deep = RawImage::from_u16(141, 49, 12, deep);
        assert_eq!(deep.to_view_of(deep.window(), [50, 20], true), large.to_view_of(large.window(), [50, 20], true));
    }

    fn check_means(image: &RawImage, window: Window, size: [usize; 2]) {
        let view = image.to_view_of(window, size, false).unwrap();
        assert_eq!(view.len(), size[0] * size[1]);
        for (found, wanted) in view.iter().zip(by_integrals(image, window, size)) {
            // Half a level by its own rounding; the rest by that of the weights.
            assert!((f64::from(*found) - wanted).abs() <= 0.6, "{found} for {wanted}, {size:?}");
        }
    }

    #[test]
    fn at_its_own_size_a_part_is_the_samples_within_it() {
        let deep: Vec<u16> = (0..20 * 10).map(|k| k * 20).collect();
        let image = RawImage::from_u16(20, 10, 12, deep.clone());
        let window = Window { x: 4, y: 3, width: 9, height: 5 };
        let within: Vec<u16> =
            (3..8).flat_map(|y| (4..13).map(move |x| (x, y))).map(|(x, y)| deep[y * 20 + x]).collect();
        let cropped = image.cropped(window).unwrap();
        assert_eq!((cropped.samples(), cropped.bits()), (&Samples::U16(within.clone()), 12));
        let view = image.to_view_of(window, [9, 5], true).unwrap();
        assert_eq!(view, within.iter().map(|sample| (sample >> 4) as u8).collect::<Vec<_>>());
        assert_eq!(image.to_view_of(image.window(), [20, 10], false).unwrap(), image.to_view());
    }

    #[test]
    fn what_is_not_of_the_frame_is_no_picture() {
        let image = noise(20, 10);
        let window = |x, y, width, height| Window { x, y, width, height };
        for bad in [
            window(0, 0, 0, 1),
            window(0, 0, 1, 0),
            window(20, 0, 1, 1),
            window(12, 0, 9, 1),
            window(0, 5, 1, 6),
            window(usize::MAX, 0, 2, 1),
            window(0, 0, usize::MAX, 1),
        ] {
            assert!(image.cropped(bad).is_none() && image.to_view_of(bad, [1, 1], false).is_none(), "{bad:?}");
        }
        for size in [[0, 1], [1, 0], [21, 1], [1, 11]] {
            assert!(image.to_view_of(image.window(), size, false).is_none(), "{size:?}");
        }
    }

    #[test]
    fn a_wave_too_fine_for_the_picture_does_not_come_back_as_a_coarse_one() {
        let wave = |k: usize| (128.0 + 100.0 * (std::f64::consts::TAU * (k % 240) as f64 / 3.1).cos()).round() as u8;
        let image = RawImage::from_u8(240, 4, (0..960).map(wave).collect());
        let view = image.to_view_of(image.window(), [80, 1], false).unwrap();
        let far = view.iter().map(|&level| (f64::from(level) - 128.0).abs()).fold(0.0, f64::max);
        // Every third pixel alone would show a wave of 93 px at its full strength.
        assert!(far < 4.5, "{far} of 100 come back");
    }

    #[test]
    fn a_mosaics_colours_leave_no_pattern_at_any_size() {
        let level = |k: usize| match (k % 60 % 2, k / 60 % 2) {
            (0, 0) => 200,
            (1, 1) => 40,
            _ => 120,
        };
        let image = RawImage::from_u8(60, 42, (0..60 * 42).map(level).collect());
        let part = Window { x: 1, y: 3, width: 51, height: 33 };
        for window in [image.window(), part] {
            for size in [[30, 21], [20, 14], [41, 23], [50, 32], [7, 3], [1, 1]] {
                let view = image.to_view_of(window, size, true).unwrap();
                let (least, most) = (view.iter().min().unwrap(), view.iter().max().unwrap());
                assert!(most - least <= 1 && (119..=121).contains(least), "{size:?}: {least} to {most}");
            }
        }
        // What is shown pixel by pixel is shown as the sensor has it.
        assert_eq!(image.to_view_of(image.window(), [60, 42], true).unwrap(), samples(&image));
    }
}
