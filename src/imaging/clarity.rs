//! How sharp a view is: the energy of its gradient.

use super::view::View;

/// Energy of gradient of a view scaled to [0, 255], Eq. 20.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eog {
    /// Σ [(f(x+1, y) − f(x, y))² + (f(x, y+1) − f(x, y))²], grey levels squared: the paper's figure, which grows with
    /// the picture's size.
    pub sum: f64,
    /// The sum over the number of pixels that enter it, grey levels squared: comparable between pictures of different
    /// size. Noise of σ grey levels adds 4 σ².
    pub mean_per_pixel: f64,
}

/// Energy of gradient (Eq. 20) of a view, its darkest pixel taken as 0 and its brightest as 255. Pixels without a right
/// and a lower neighbour do not enter; a view of one grey level has none.
#[must_use]
pub fn eog(view: &View) -> Eog {
    let (w, h) = (view.width, view.height);
    let (least, greatest) =
        view.values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, g), &v| (l.min(v), g.max(v)));
    if w < 2 || h < 2 || greatest.partial_cmp(&least) != Some(std::cmp::Ordering::Greater) {
        return Eog { sum: 0.0, mean_per_pixel: 0.0 };
    }
    let scale = 255.0 / f64::from(greatest - least);
    let mut sum = 0.0;
    for y in 0..h - 1 {
        let (row, below) = (&view.values[y * w..][..w], &view.values[(y + 1) * w..][..w]);
        for (pair, under) in row.windows(2).zip(below) {
            sum += f64::from(pair[1] - pair[0]).powi(2) + f64::from(under - pair[0]).powi(2);
        }
    }
    sum *= scale * scale;
    Eog { sum, mean_per_pixel: sum / ((w - 1) * (h - 1)) as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkerboard_has_the_most_and_a_plain_picture_none() {
        let board = View { width: 4, height: 3, values: (0..12).map(|k| ((k % 4 + k / 4) % 2) as f32 * 7.0).collect() };
        // Six pixels have both neighbours, and each differs from both by the full scale.
        let found = eog(&board);
        assert!((found.sum - 6.0 * 2.0 * 255.0 * 255.0).abs() < 1e-6, "{found:?}");
        assert!((found.mean_per_pixel - 2.0 * 255.0 * 255.0).abs() < 1e-6);
        let plain = View { width: 4, height: 3, values: vec![9.0; 12] };
        assert_eq!(eog(&plain).sum, 0.0);
        let ramp = View { width: 256, height: 2, values: (0..512).map(|k| (k % 256) as f32).collect() };
        assert!((eog(&ramp).mean_per_pixel - 1.0).abs() < 1e-9);
    }
}
