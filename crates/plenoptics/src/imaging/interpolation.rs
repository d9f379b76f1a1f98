//! Cubic B-spline interpolation: coefficients of a frame, and the weights that sample them between pixels.
//!
//! The interpolating spline is exact at the pixels and smooth between them; linear or cubic convolution blurs by an
//! amount that depends on the fraction of a pixel, which all pairs of a frame share and which would pull the spacing.

use rayon::prelude::*;

/// The pole of the cubic B-spline's prefilter, √3 − 2.
const POLE: f32 = -0.267_949_2;
/// Terms after which the pole's powers are below single precision.
const HORIZON: usize = 14;
/// Columns filtered together down a frame: a few cache lines wide.
const STRIP: usize = 64;

/// Coefficients of the cubic B-spline that interpolates `samples` (row by row, `width` columns), mirrored at the edges.
#[must_use]
pub fn spline_coefficients(samples: &[f32], width: usize) -> Vec<f32> {
    let mut coefficients = samples.to_vec();
    let height = samples.len().checked_div(width).unwrap_or(0);
    if width < 2 || height < 2 {
        return coefficients;
    }
    coefficients.par_chunks_mut(width).for_each(filter_row);
    filter_columns(&mut coefficients, width, height);
    coefficients
}

/// Weights of the four coefficients around a position whose fraction of a pixel is `t` in [0, 1): those at offsets −1,
/// 0, 1 and 2.
#[must_use]
pub fn weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    let (t3, s3) = (t * t * t, s * s * s);
    [s3 / 6.0, (4.0 - 6.0 * t * t + 3.0 * t3) / 6.0, (4.0 - 6.0 * s * s + 3.0 * s3) / 6.0, t3 / 6.0]
}

/// The derivative of [`weights`] with respect to the position, per pixel.
#[must_use]
pub fn slope_weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [-0.5 * s * s, -2.0 * t + 1.5 * t * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t]
}

/// The second derivative of [`weights`], per square pixel.
pub(super) const fn bend_weights(t: f32) -> [f32; 4] {
    [1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t]
}

/// Value at (x, y), px, of the spline with these coefficients; `None` within two pixels of the edge or beyond it.
#[must_use]
pub fn sample(coefficients: &[f32], width: usize, x: f64, y: f64) -> Option<f32> {
    let height = coefficients.len().checked_div(width)?;
    let (column, row) = (x.floor(), y.floor());
    if !(column >= 1.0 && row >= 1.0 && column + 2.0 < width as f64 && row + 2.0 < height as f64) {
        return None;
    }
    let (across, down) = (weights((x - column) as f32), weights((y - row) as f32));
    let corner = (row as usize - 1) * width + column as usize - 1;
    let line = |k: usize| {
        let line = &coefficients[corner + k * width..corner + k * width + 4];
        line.iter().zip(across).map(|(c, w)| c * w).sum::<f32>()
    };
    Some((0..4).map(|k| line(k) * down[k]).sum())
}

/// The gain that makes the filter's response to a constant one: (1 − z)(1 − 1/z) for z = [`POLE`].
const GAIN: f32 = 6.0;

fn filter_row(row: &mut [f32]) {
    let last = row.len() - 1;
    let mut power = 1.0;
    let mut first = 0.0;
    for sample in row.iter().take(HORIZON) {
        first += sample * power;
        power *= POLE;
    }
    row[0] = first;
    for x in 1..=last {
        row[x] += POLE * row[x - 1];
    }
    row[last] = GAIN * (POLE / (POLE * POLE - 1.0)) * (row[last] + POLE * row[last - 1]);
    for x in (0..last).rev() {
        // The gain enters here once: the value at `last` carries it already.
        row[x] = POLE * (row[x + 1] - GAIN * row[x]);
    }
}

/// The same filter down the columns, a strip of columns at a time so that memory is walked row by row.
fn filter_columns(samples: &mut [f32], width: usize, height: usize) {
    // Strips are gathered, filtered and put back: strips share rows, so they cannot be borrowed apart.
    let starts: Vec<usize> = (0..width).step_by(STRIP).collect();
    let source = &*samples;
    let strips: Vec<Vec<f32>> = starts
        .par_iter()
        .map(|&start| {
            let columns = STRIP.min(width - start);
            let mut strip: Vec<f32> = (0..height)
                .flat_map(|y| source[y * width + start..y * width + start + columns].iter().copied())
                .collect();
            filter_strip(&mut strip, columns);
            strip
        })
        .collect();
    samples.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        for (strip, &start) in strips.iter().zip(&starts) {
            let columns = STRIP.min(width - start);
            row[start..start + columns].copy_from_slice(&strip[y * columns..(y + 1) * columns]);
        }
    });
}

fn filter_strip(strip: &mut [f32], columns: usize) {
    let height = strip.len() / columns;
    let mut first = vec![0.0f32; columns];
    let mut power = 1.0;
    for row in strip.chunks_exact(columns).take(HORIZON) {
        for (sum, sample) in first.iter_mut().zip(row) {
            *sum += sample * power;
        }
        power *= POLE;
    }
    strip[..columns].copy_from_slice(&first);
    for y in 1..height {
        let (above, below) = strip.split_at_mut(y * columns);
        for (sample, before) in below[..columns].iter_mut().zip(&above[(y - 1) * columns..]) {
            *sample += POLE * before;
        }
    }
    let (above, last) = strip.split_at_mut((height - 1) * columns);
    for (sample, before) in last.iter_mut().zip(&above[(height - 2) * columns..]) {
        *sample = GAIN * (POLE / (POLE * POLE - 1.0)) * (*sample + POLE * before);
    }
    for y in (0..height - 1).rev() {
        let (above, below) = strip.split_at_mut((y + 1) * columns);
        for (sample, after) in above[y * columns..].iter_mut().zip(&below[..columns]) {
            *sample = POLE * (after - GAIN * *sample);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(x: f64, y: f64) -> f64 {
        100.0 + 40.0 * (0.5 * x + 0.2).sin() * (0.4 * y - 0.3).cos()
    }

    #[test]
    fn the_spline_passes_through_the_samples() {
        let (width, height) = (90, 70);
        let samples: Vec<f32> = (0..width * height).map(|k| ((k * 7919) % 251) as f32).collect();
        let coefficients = spline_coefficients(&samples, width);
        for y in 1..height - 2 {
            for x in 1..width - 2 {
                let value = sample(&coefficients, width, x as f64, y as f64).unwrap();
                assert!((value - samples[y * width + x]).abs() < 2e-3, "at {x}, {y}: {value}");
            }
        }
        assert_eq!(sample(&coefficients, width, 0.5, 10.0), None);
        assert_eq!(sample(&coefficients, width, 10.0, f64::NAN), None);
    }

    #[test]
    fn a_smooth_picture_is_met_between_the_samples() {
        let (width, height) = (80, 60);
        let samples: Vec<f32> =
            (0..width * height).map(|k| wave((k % width) as f64, (k / width) as f64) as f32).collect();
        let coefficients = spline_coefficients(&samples, width);
        for k in 0..200 {
            let (x, y) = (10.0 + 0.29 * f64::from(k), 8.0 + 0.21 * f64::from(k));
            let value = f64::from(sample(&coefficients, width, x, y).unwrap());
            assert!((value - wave(x, y)).abs() < 0.02, "at {x}, {y}: {value} for {}", wave(x, y));
        }
    }

    #[test]
    fn slopes_are_the_derivative_of_the_weights() {
        for k in 1..20 {
            let t = 0.05 * k as f32 - 0.01;
            let (low, high) = (weights(t - 5e-3), weights(t + 5e-3));
            assert!((weights(t).iter().sum::<f32>() - 1.0).abs() < 1e-6);
            for (slope, (l, h)) in slope_weights(t).iter().zip(low.iter().zip(high)) {
                assert!((slope - (h - l) / 1e-2).abs() < 1e-3);
            }
        }
    }
}
