//! A chessboard whose white squares carry markers.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Squares along a side; even, so that the board repeats.
const SQUARES: usize = 12;
/// Cells along a marker: a black border one cell wide around 5 by 5 random bits.
const CELLS: usize = 7;
/// Share of a square's side that its marker takes.
const MARKER: f64 = 0.76;
const PAPER: f32 = 0.97;
const INK: f32 = 0.03;
/// Samples along a texel's side.
const OVERSAMPLING: usize = 4;

pub(super) fn generate(side: usize, seed: u64) -> Vec<f32> {
    let mut random = Pcg64::seed_from_u64(seed);
    let bits: Vec<u32> = (0..SQUARES * SQUARES).map(|_| random.random()).collect();
    let mut values = vec![0.0; side * side];
    for (k, value) in values.iter_mut().enumerate() {
        let mut sum = 0.0;
        for sub in 0..OVERSAMPLING * OVERSAMPLING {
            let place = |texel: usize, sub: usize| {
                (texel as f64 + (sub as f64 + 0.5) / OVERSAMPLING as f64) * SQUARES as f64 / side as f64
            };
            sum += ink(&bits, place(k % side, sub % OVERSAMPLING), place(k / side, sub / OVERSAMPLING));
        }
        *value = sum / (OVERSAMPLING * OVERSAMPLING) as f32;
    }
    values
}

/// The board at a place in units of squares.
fn ink(bits: &[u32], x: f64, y: f64) -> f32 {
    let (column, row) = (x as usize, y as usize);
    if (column + row) % 2 == 1 {
        return INK;
    }
    let margin = (1.0 - MARKER) / 2.0;
    let cell = |t: f64| (t.fract() - margin) / MARKER * CELLS as f64;
    let (i, j) = (cell(x), cell(y));
    let cells = 0.0..CELLS as f64;
    if !cells.contains(&i) || !cells.contains(&j) {
        return PAPER;
    }
    let (i, j) = (i as usize, j as usize);
    let border = i == 0 || j == 0 || i == CELLS - 1 || j == CELLS - 1;
    let bit = !border && (bits[row * SQUARES + column] >> ((j - 1) * (CELLS - 2) + i - 1)) & 1 == 1;
    if bit { PAPER } else { INK }
}
