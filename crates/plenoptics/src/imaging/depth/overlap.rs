//! Which pixels two neighbouring micro-images have in common at a spacing, and reading them in vectors.

use pulp::Simd;

/// The pixels of a disc about a pixel.
#[derive(Debug, Clone)]
pub(super) struct Disc {
    radius: f64,
    /// Pixels to either side of the middle column, from the topmost row down.
    halves: Vec<i32>,
}

impl Disc {
    pub(super) fn new(radius: f64) -> Self {
        let reach = radius.floor() as i32;
        let half = |dy: i32| (radius * radius - f64::from(dy * dy)).max(0.0).sqrt() as i32;
        Self { radius, halves: (-reach..=reach).map(half).collect() }
    }

    pub(super) const fn radius(&self) -> f64 {
        self.radius
    }

    /// Rows above and below the middle one, and columns to either side of it.
    pub(super) const fn reach(&self) -> i32 {
        (self.halves.len() / 2) as i32
    }

    /// First column, row and number of pixels of each row of the disc about a pixel, which lies wholly in the frame.
    pub(super) fn rows(&self, [x, y]: [i32; 2]) -> impl Iterator<Item = (usize, usize, usize)> {
        let reach = self.reach();
        self.halves
            .iter()
            .zip(y - reach..)
            .map(move |(&half, row)| ((x - half) as usize, row as usize, (2 * half + 1) as usize))
    }
}

/// A micro-image and its neighbour's, moved back by a spacing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// Whole pixels from a pixel of the first to the one before its match in the second.
    pub(super) whole: [i32; 2],
    /// From there on, px.
    pub(super) fraction: [f32; 2],
    /// The pixel nearest the second's centre, as it lies in the first's coordinates.
    other: [i32; 2],
}

impl Shift {
    /// By `shift` (px), for a second centre at `second` (px).
    #[inline(always)]
    pub(super) fn new(second: [f64; 2], shift: [f64; 2]) -> Self {
        let whole = [shift[0].floor(), shift[1].floor()];
        Self {
            whole: [whole[0] as i32, whole[1] as i32],
            fraction: [(shift[0] - whole[0]) as f32, (shift[1] - whole[1]) as f32],
            other: [(second[0] - shift[0]).round() as i32, (second[1] - shift[1]).round() as i32],
        }
    }

    /// First and last row that both discs have.
    #[inline(always)]
    pub(super) fn rows(&self, disc: &Disc, first: [i32; 2]) -> [i32; 2] {
        let reach = disc.reach();
        [first[1].max(self.other[1]) - reach, first[1].min(self.other[1]) + reach]
    }

    /// First and last column that both discs have in a row of [`Shift::rows`]; the last is before the first where they
    /// have none.
    #[inline(always)]
    pub(super) fn columns(&self, disc: &Disc, first: [i32; 2], y: i32) -> [i32; 2] {
        let reach = disc.reach();
        let (own, other) =
            (disc.halves[(y - first[1] + reach) as usize], disc.halves[(y - self.other[1] + reach) as usize]);
        [(first[0] - own).max(self.other[0] - other), (first[0] + own).min(self.other[0] + other)]
    }
}

/// Pixels that the widest vectors hold.
pub(super) const WIDEST: usize = 16;

const ONES_AND_ZEROS: [f32; 2 * WIDEST] = {
    let mut mask = [0.0; 2 * WIDEST];
    let mut k = 0;
    while k < WIDEST {
        mask[k] = 1.0;
        k += 1;
    }
    mask
};

/// A vector with 1 in each of its first `count` lanes, 0 in the others.
#[inline(always)]
pub(super) fn lanes<S: Simd>(count: usize) -> S::f32s {
    load::<S>(&ONES_AND_ZEROS, WIDEST - count.min(S::F32_LANES))
}

/// The vector that begins at a place of a row.
#[inline(always)]
pub(super) fn load<S: Simd>(row: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&row[at..at + S::F32_LANES]).0[0]
}

/// A row's values between its pixels: those of four pixels about each place, weighted.
#[inline(always)]
pub(super) fn between<S: Simd>(simd: S, weights: &[S::f32s; 4], rows: [&[f32]; 4], at: usize) -> S::f32s {
    let even = simd.mul_f32s(weights[0], load::<S>(rows[0], at));
    let odd = simd.mul_f32s(weights[1], load::<S>(rows[1], at));
    let even = simd.mul_add_e_f32s(weights[2], load::<S>(rows[2], at), even);
    simd.add_f32s(even, simd.mul_add_e_f32s(weights[3], load::<S>(rows[3], at), odd))
}

/// The same number in every lane, four times.
#[inline(always)]
pub(super) fn splat<S: Simd>(simd: S, w: [f32; 4]) -> [S::f32s; 4] {
    [simd.splat_f32s(w[0]), simd.splat_f32s(w[1]), simd.splat_f32s(w[2]), simd.splat_f32s(w[3])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_shares_with_itself_all_and_with_a_far_one_nothing() {
        let disc = Disc::new(4.3);
        let whole: usize = disc.rows([20, 30]).map(|(.., n)| n).sum();
        let shared = |shift: [f64; 2]| -> i32 {
            let shift = Shift::new([20.0 + 9.0, 30.0], shift);
            let [top, bottom] = shift.rows(&disc, [20, 30]);
            (top..=bottom)
                .map(|y| {
                    let [left, right] = shift.columns(&disc, [20, 30], y);
                    (right + 1 - left).max(0)
                })
                .sum()
        };
        assert_eq!(shared([9.0, 0.0]) as usize, whole);
        assert_eq!(shared([0.0, 0.0]), 0);
        assert!((1..whole as i32).contains(&shared([5.0, 1.0])));
    }

    #[test]
    fn lanes_are_counted_from_the_first() {
        let simd = pulp::Scalar::new();
        let first = |count: usize| simd.reduce_sum_f32s(lanes::<pulp::Scalar>(count));
        assert_eq!([first(0), first(1), first(99)], [0.0, 1.0, 1.0]);
        assert_eq!(ONES_AND_ZEROS[WIDEST - 3..].iter().sum::<f32>(), 3.0);
    }
}
