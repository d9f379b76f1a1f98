//! Reading a frame between its pixels.

/// The pixels about a place of the frame, and their weights.
pub(super) trait Taps {
    /// The value at the place.
    fn read(&self, plane: &[f32]) -> f32;
}

/// A place within the frame: the pixel before it along each axis, and how far it is from there on.
#[inline(always)]
fn split([w, h]: [usize; 2], x: f32, y: f32) -> ([usize; 2], [f32; 2]) {
    let (x, y) = (x.clamp(0.0, (w - 1) as f32), y.clamp(0.0, (h - 1) as f32));
    let (x0, y0) = (x as usize, y as usize);
    ([x0, y0], [x - x0 as f32, y - y0 as f32])
}

/// The four pixels about a place; outside the frame, its edge. For places that few micro-images show: noise does not grow
/// in it.
pub(super) struct Linear {
    /// First pixel of the upper and of the lower two, and from there to its right neighbour.
    rows: [usize; 2],
    right: usize,
    weights: [f32; 4],
}

impl Linear {
    #[inline(always)]
    pub(super) fn new([w, h]: [usize; 2], x: f32, y: f32) -> Self {
        let ([x0, y0], [s, t]) = split([w, h], x, y);
        let below = if y0 + 1 < h { w } else { 0 };
        Self {
            rows: [y0 * w + x0, y0 * w + x0 + below],
            right: usize::from(x0 + 1 < w),
            weights: [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
        }
    }
}

impl Taps for Linear {
    #[inline(always)]
    fn read(&self, plane: &[f32]) -> f32 {
        let [upper, lower] = self.rows;
        let [a, b, c, d] = self.weights;
        a * plane[upper] + b * plane[upper + self.right] + c * plane[lower] + d * plane[lower + self.right]
    }
}

/// The sixteen pixels about a place by cubic convolution (Keys); outside the frame, its edge. For places that many
/// micro-images show: it keeps the finest detail, and what it adds in noise their number takes out again.
pub(super) struct Cubic {
    rows: [usize; 4],
    columns: [usize; 4],
    weights: [[f32; 4]; 2],
}

impl Cubic {
    #[inline(always)]
    pub(super) fn new([w, h]: [usize; 2], x: f32, y: f32) -> Self {
        let ([x0, y0], [s, t]) = split([w, h], x, y);
        let around = |first: usize, count: usize| {
            [first.saturating_sub(1), first, (first + 1).min(count - 1), (first + 2).min(count - 1)]
        };
        Self { rows: around(y0, h).map(|row| row * w), columns: around(x0, w), weights: [keys(s), keys(t)] }
    }
}

impl Taps for Cubic {
    #[inline(always)]
    fn read(&self, plane: &[f32]) -> f32 {
        let [across, down] = &self.weights;
        let along = |row: usize| -> f32 {
            let pixels = self.columns.map(|column| plane[row + column]);
            across[0] * pixels[0] + across[1] * pixels[1] + across[2] * pixels[2] + across[3] * pixels[3]
        };
        let lines = self.rows.map(along);
        down[0] * lines[0] + down[1] * lines[1] + down[2] * lines[2] + down[3] * lines[3]
    }
}

/// Weights of cubic convolution for the pixels at −1, 0, 1 and 2 about a position at `t` in [0, 1).
#[inline(always)]
pub(in crate::imaging) fn keys(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [9, 7];

    fn plane(value: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        (0..SIZE[0] * SIZE[1]).map(|k| value((k % SIZE[0]) as f32, (k / SIZE[0]) as f32)).collect()
    }

    #[test]
    fn both_hit_pixels_and_follow_a_slope_and_the_cubic_a_parabola_too() {
        let slope = plane(|x, y| 3.0 + 2.0 * x - 0.5 * y);
        let bowl = plane(|x, y| x * x + 0.5 * y * y);
        for (x, y) in [(3.0, 4.0), (3.25, 2.75), (4.5, 3.5)] {
            let (linear, cubic) = (Linear::new(SIZE, x, y), Cubic::new(SIZE, x, y));
            for read in [linear.read(&slope), cubic.read(&slope)] {
                assert!((read - (3.0 + 2.0 * x - 0.5 * y)).abs() < 1e-4, "{read} at {x}, {y}");
            }
            assert!((cubic.read(&bowl) - (x * x + 0.5 * y * y)).abs() < 1e-3);
        }
        // Beyond the frame, its edge.
        assert_eq!(Cubic::new(SIZE, -3.0, 90.0).read(&bowl), bowl[6 * 9]);
        assert_eq!(Linear::new(SIZE, 90.0, -3.0).read(&bowl), bowl[8]);
    }
}
