//! Tiles beside what they are made from.

use super::super::compare::{Moments, Overlap, Warp};
use super::*;
use crate::imaging::grid::Grid;
use crate::imaging::matching::compare::BOTH;
use crate::imaging::matching::gains::Gains;
use crate::imaging::vignetting::Vignetting;
use crate::optics::ArrayKind;

const SIDE: usize = 260;

/// What both micro-images show, a spacing of `L` px apart.
fn content(x: f64, y: f64) -> f64 {
    110.0 + 40.0 * (0.55 * x + 0.3 * y).sin() + 30.0 * (0.2 * x - 0.5 * y).cos()
}

/// The tiles of a pair, and the moments of both orders.
type Compared = ([Tile; 2], [Option<Moments>; 2]);

/// Two tiles of a pair, and both orders of their comparison.
struct Two<'a> {
    frame: &'a Frame<'a, u16>,
    lenses: &'a [Lens; 2],
    light: Light<'a>,
    shape: Shape,
    unit: [f64; 2],
    spacing: f64,
}

impl pulp::WithSimd for Two<'_> {
    type Output = Compared;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let (mut tiles, mut work) = ([Tile::default(), Tile::default()], Workspace::default());
        tiles[0].prepare(simd, self.frame, (&self.lenses[0], self.light), &self.shape, &mut work);
        tiles[1].prepare(simd, self.frame, (&self.lenses[1], self.light), &self.shape, &mut work);
        let (mut moments, mut warp) = ([None; 2], Warp::default());
        for k in 0..2 {
            let (a, b) = (&tiles[k], &tiles[1 - k]);
            let unit = if k == 0 { self.unit } else { [-self.unit[0], -self.unit[1]] };
            if let Some(overlap) = Overlap::new(a, b, &self.shape, unit, [self.spacing, 0.0]) {
                moments[k] = overlap.compare::<S, BOTH>(simd, a, b, &self.shape, &mut warp);
            }
        }
        (tiles, moments)
    }
}

fn lens(x: f64, y: f64) -> Lens {
    Lens { nearest: [x.round() as i32, y.round() as i32], fraction: [x - x.round(), y - y.round()] }
}

/// Micro-images about two centres, `unit` apart in direction; the second shows what the first shows a spacing on.
fn two(radius: f64, unit: [f64; 2], bends: bool) -> (Compared, Compared, Shape) {
    let pitch = 2.6 * radius;
    let spacing = 0.7 * pitch;
    let a = [128.3 - pitch * unit[0] / 2.0, 127.6 - pitch * unit[1] / 2.0];
    let b = [a[0] + pitch * unit[0], a[1] + pitch * unit[1]];
    let samples: Vec<u16> = (0..SIDE * SIDE)
        .map(|k| {
            let (x, y) = ((k % SIDE) as f64, (k / SIDE) as f64);
            let second = (x - b[0]).hypot(y - b[1]) < (x - a[0]).hypot(y - a[1]);
            let shift = if second { spacing } else { 0.0 };
            (16.0 * content(x - shift * unit[0], y - shift * unit[1])).round() as u16
        })
        .collect();
    let lenses = [lens(a[0], a[1]), lens(b[0], b[1])];
    let shape = Shape::new(radius);
    // Tiles smaller than the largest, as masks change with the spacing.
    let grid = Grid::affine(ArrayKind::Square, a, [[pitch, 0.0], [0.0, pitch]], [SIDE, SIDE]);
    let even = Vignetting::from_terms(4, vec![[1.0, 0.0, 0.0, 0.0]; 16], bends);
    let gains = Gains::new(&even, &grid, radius + 2.5);
    let frame = Frame { samples: &samples, width: SIDE, height: SIDE, white: 4095, mosaic: None };
    let task = || Two { frame: &frame, lenses: &lenses, light: Light::Drawn(&gains), shape, unit, spacing };
    let fast = pulp::Arch::new().dispatch(task());
    let plain = pulp::WithSimd::with_simd(task(), pulp::Scalar::new());
    (fast, plain, shape)
}

#[test]
fn tiles_of_any_size_hold_their_spline_and_slopes() {
    for k in 0..60 {
        let radius = 3.0 + 0.6 * f64::from(k);
        let ((tiles, moments), (plain, plain_moments), shape) = two(radius, [0.8, 0.6], k % 2 == 1);
        let tile = &tiles[0];
        let [column, row] = shape.middle();
        let at = |plane: &[f32], dx: isize, dy: isize| {
            f64::from(plane[((row as isize + dy) as usize) * shape.stride + (column as isize + dx) as usize])
        };
        let reach = shape.disc as isize;
        for (dx, dy) in [(0, 0), (1 - reach, 0), (reach - 1, 1), (0, reach - 1), (-reach / 2, 1 - reach / 2)] {
            // The spline's value at a pixel: [1 4 6] weights along both axes.
            let mut value = 0.0;
            for (y, wy) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                for (x, wx) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                    value += wx * wy / 36.0 * at(&tile.coefficients, dx + x, dy + y);
                }
            }
            let own = at(&tile.values, dx, dy);
            assert!((value - own).abs() < 6.0, "radius {radius}: {value} for {own} at {dx}, {dy}");
            // The binomial filters, written out.
            let (mut along_x, mut along_y) = (0.0, 0.0);
            let (steep, smooth) = ([-1.0, -2.0, 0.0, 2.0, 1.0], [1.0, 4.0, 6.0, 4.0, 1.0]);
            for (j, y) in (-2..=2).enumerate() {
                for (i, x) in (-2..=2).enumerate() {
                    let value = at(&tile.values, dx + x, dy + y) / 128.0;
                    along_x += steep[i] * smooth[j] * value;
                    along_y += smooth[i] * steep[j] * value;
                }
            }
            let found = [at(&tile.slopes[0], dx, dy), at(&tile.slopes[1], dx, dy)];
            assert!((found[0] - along_x).abs() < 1e-2 && (found[1] - along_y).abs() < 1e-2, "radius {radius}");
        }
        assert_eq!(at(&tile.amplitudes, 0, 0), 1.0);
        assert!(tile.amplitudes.iter().all(|a| (0.0..=1.0).contains(a)));
        // The disc's area, to the pixels of its edge.
        let area: f32 = tile.amplitudes.iter().sum();
        assert!(
            (f64::from(area) / (std::f64::consts::PI * radius * radius) - 1.0).abs() < 0.2 / radius + 0.02,
            "{area}"
        );
        // Every instruction set says the same, and the two micro-images match.
        for (a, b) in moments.iter().zip(&plain_moments) {
            let (Some(a), Some(b)) = (a, b) else {
                assert!(a.is_none() && b.is_none() && radius < 6.0, "radius {radius}");
                continue;
            };
            assert!((a.ab / b.ab - 1.0).abs() < 1e-3 && (a.pixels - b.pixels).abs() < 1e-2);
            assert!(a.ab / (a.aa * a.bb).sqrt() > 0.99, "radius {radius}: {a:?}");
        }
        assert!((plain[1].values[0] - tiles[1].values[0]).abs() < 1e-2);
    }
}

#[test]
fn the_score_vanishes_at_the_true_spacing() {
    for unit in [[1.0, 0.0], [0.0, 1.0], [0.8, -0.6], [-0.6, 0.8]] {
        let ((_, moments), _, _) = two(11.3, unit, false);
        let [Some(there), Some(back)] = moments else { panic!("no overlap") };
        let step = ((there.ta[0] - there.tb[0]) + (back.ta[0] - back.tb[0])) / (there.td[0][0] + back.td[0][0]);
        assert!(step.abs() < 2e-3, "{unit:?}: {step} px");
        assert!(there.td[0][0] > 0.0 && back.td[0][0] > 0.0);
    }
}
