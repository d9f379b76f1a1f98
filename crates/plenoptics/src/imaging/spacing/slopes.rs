//! Slopes of a frame, slightly smoothed.

use rayon::prelude::*;

/// Slopes along x and y of the values smoothed by a Gaussian, and the noise the filter lets through.
///
/// The filters have no weight at the pixel itself, so that a pixel's noise never meets itself in a score.
pub(super) fn slopes(values: &[f32], width: usize, sigma: f64) -> ([Vec<f32>; 2], f64) {
    let reach = (3.0 * sigma).ceil().max(1.0) as usize;
    let offsets = || (0..=2 * reach).map(|k| k as f64 - reach as f64);
    let gauss: Vec<f64> = offsets().map(|x| (-0.5 * (x / sigma).powi(2)).exp()).collect();
    let total: f64 = gauss.iter().sum();
    let moment: f64 = gauss.iter().zip(offsets()).map(|(g, x)| g * x * x).sum();
    let smooth: Vec<f32> = gauss.iter().map(|g| (g / total) as f32).collect();
    let slope: Vec<f32> = gauss.iter().zip(offsets()).map(|(g, x)| (g * x / moment) as f32).collect();
    let energy = |filter: &[f32]| filter.iter().map(|f| f64::from(f * f)).sum::<f64>();
    let along_x = down(&along(values, width, &slope), width, &smooth);
    let along_y = down(&along(values, width, &smooth), width, &slope);
    ([along_x, along_y], energy(&smooth) * energy(&slope))
}

/// Correlates each row with a filter of odd length; the ends of rows, where it does not fit, stay zero.
fn along(values: &[f32], width: usize, filter: &[f32]) -> Vec<f32> {
    let reach = filter.len() / 2;
    let mut result = vec![0.0f32; values.len()];
    if width <= 2 * reach {
        return result;
    }
    result.par_chunks_mut(width).zip(values.par_chunks(width)).with_min_len(16).for_each(|(out, row)| {
        let n = width - 2 * reach;
        for (k, &weight) in filter.iter().enumerate() {
            for (o, v) in out[reach..reach + n].iter_mut().zip(&row[k..k + n]) {
                *o += weight * v;
            }
        }
    });
    result
}

/// Correlates each column with a filter of odd length; rows where it does not fit stay zero.
fn down(values: &[f32], width: usize, filter: &[f32]) -> Vec<f32> {
    let reach = filter.len() / 2;
    let height = values.len() / width;
    let mut result = vec![0.0f32; values.len()];
    result.par_chunks_mut(width).enumerate().with_min_len(16).for_each(|(y, out)| {
        if y >= reach && y + reach < height {
            for (k, &weight) in filter.iter().enumerate() {
                let row = &values[(y + k - reach) * width..][..width];
                for (o, v) in out.iter_mut().zip(row) {
                    *o += weight * v;
                }
            }
        }
    });
    result
}
