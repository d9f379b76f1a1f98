//! A view laid on the board that it shows: the same piece of board at the same scale, whichever camera saw it.

use super::studio::Shot;
use crate::imaging::interpolation::{sample, spline_coefficients};
use crate::imaging::view::View;
use crate::optics::ExactView;

/// Places along the radius at which rays are traced; between them the map from board to sensor is interpolated.
const TRACED: usize = 200;
/// Finer than the raster by this factor while the view is smoothed.
const FINER: usize = 4;

/// A piece of board about the axis as a raster.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Raster {
    /// Half of its width and height, mm.
    pub(super) half_mm: f64,
    /// Side of its pixels, mm. The view is smoothed by a Gaussian of half of that before it is sampled.
    pub(super) pixel_mm: f64,
}

/// A view on a raster of the board, its luminance brought to a mean of 128; `None` where the view does not cover it.
pub(super) fn on_board(shot: &Shot, view: &View, raster: Raster) -> Option<View> {
    let side = (2.0 * raster.half_mm / raster.pixel_mm).floor() as usize;
    let fine = side * FINER;
    let step = raster.pixel_mm / FINER as f64;
    let radii = Radii::new(&shot.view, 1.5 * raster.half_mm, &shot.camera)?;
    let luminance = view.luminance();
    let coefficients = spline_coefficients(&luminance, view.width);
    let mut values = Vec::with_capacity(fine * fine);
    for row in 0..fine {
        for column in 0..fine {
            let place = [column, row].map(|k| (k as f64 + 0.5 - fine as f64 / 2.0) * step);
            let sensor = radii.sensor(place);
            let [x, y] = in_view(view, shot.camera.frame_from_sensor(sensor));
            values.push(sample(&coefficients, view.width, x, y)?);
        }
    }
    let smooth = smoothed(&values, fine, 0.5 * FINER as f64);
    let mut picked: Vec<f32> = (0..side * side)
        .map(|k| smooth[(k / side * FINER + FINER / 2) * fine + k % side * FINER + FINER / 2])
        .collect();
    let mean = picked.iter().map(|&v| f64::from(v)).sum::<f64>() / picked.len().max(1) as f64;
    for value in &mut picked {
        *value *= (128.0 / mean) as f32;
    }
    Some(View::grey(side, side, picked))
}

/// A place of the frame (px) in the upright view, px of it.
fn in_view(view: &View, [x, y]: [f64; 2]) -> [f64; 2] {
    let turned = |place: f64, count: usize| count as f64 - 1.0 - ((place + 0.5) * view.scale - 0.5);
    [turned(x, view.width), turned(y, view.height)]
}

/// The map from the board's radius to the sensor's, both mm, of a camera that is round about its axis.
struct Radii {
    /// Radius on the board and on the sensor, both rising.
    points: Vec<[f64; 2]>,
}

impl Radii {
    /// Traces up to a radius on the board, mm; `None` where light does not come from so far out.
    fn new(view: &ExactView, board_most: f64, camera: &crate::sim::renderer::CameraTruth) -> Option<Self> {
        let corner = 0.75 * camera.width as f64 * camera.pixel;
        let mut points = vec![[0.0, 0.0]];
        for k in 1..=TRACED {
            let sensor = corner * k as f64 / TRACED as f64;
            let Some([x, _]) = view.chief_board_point([sensor, 0.0]) else { break };
            points.push([x.abs(), sensor]);
            if x.abs() > board_most {
                return Some(Self { points });
            }
        }
        // As far as the sensor sees.
        (points.len() > 1).then_some(Self { points })
    }

    /// The sensor place (mm from the axis) of a board place (mm from the axis): the lens turns the picture round.
    fn sensor(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let radius = x.hypot(y);
        if radius == 0.0 {
            return [0.0; 2];
        }
        let next = self.points.partition_point(|point| point[0] < radius).clamp(1, self.points.len() - 1);
        let ([b0, s0], [b1, s1]) = (self.points[next - 1], self.points[next]);
        let scale = -(s0 + (radius - b0) / (b1 - b0) * (s1 - s0)) / radius;
        [x * scale, y * scale]
    }
}

/// A square picture smoothed by a Gaussian of `sigma` px, mirrored at its edges.
pub(super) fn smoothed(values: &[f32], side: usize, sigma: f64) -> Vec<f32> {
    let reach = (3.0 * sigma).ceil() as isize;
    let weights: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp() as f32).collect();
    let total: f32 = weights.iter().sum();
    let mirrored = |k: isize| {
        let last = side as isize - 1;
        let k = if k < 0 { -k } else { k };
        (if k > last { (2 * last - k).max(0) } else { k }) as usize
    };
    let along = |values: &[f32], at: &dyn Fn(usize, usize) -> usize| {
        let mut smooth = vec![0.0; values.len()];
        for line in 0..side {
            for k in 0..side {
                let sum: f32 = weights
                    .iter()
                    .zip(-reach..)
                    .map(|(weight, shift)| weight * values[at(line, mirrored(k as isize + shift))])
                    .sum();
                smooth[at(line, k)] = sum / total;
            }
        }
        smooth
    };
    let rows = along(values, &|line, k| line * side + k);
    along(&rows, &|line, k| k * side + line)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn smoothing_keeps_the_mean_and_takes_the_finest_detail() {
        let side = 32;
        let chequered: Vec<f32> = (0..side * side).map(|k| ((k % side + k / side) % 2) as f32).collect();
        let smooth = smoothed(&chequered, side, 2.0);
        assert!(smooth.iter().all(|value| (value - 0.5).abs() < 1e-3), "{smooth:?}");
        let mut spot = vec![0.0; side * side];
        spot[16 * side + 16] = 1.0;
        let spread = smoothed(&spot, side, 2.0);
        assert!((spread.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((spread[16 * side + 16] - 1.0 / (2.0 * std::f32::consts::PI * 4.0)).abs() < 1e-3);
    }

    /// The map from the board to the sensor undoes the rays from the sensor to the board.
    #[test]
    fn the_board_is_where_the_rays_end() {
        let design = Config::default().design();
        let view = design.exact_in_water(design.clarity(30.0).delta_v, 30.0);
        let camera = crate::sim::renderer::CameraTruth::from_design(
            &design,
            design.clarity(30.0).delta_v,
            crate::sim::renderer::Medium::Water { shell: design.shell, e: 30.0, decentre: [0.0; 2] },
            0.003_45,
            1160,
            1160,
        );
        let radii = Radii::new(&view, 120.0, &camera).unwrap();
        for sensor in [[0.3, -0.2], [1.9, 0.4], [-1.2, 1.6]] {
            let board = view.chief_board_point(sensor).unwrap();
            let [x, y] = radii.sensor(board);
            assert!((x - sensor[0]).hypot(y - sensor[1]) < 2e-4, "{sensor:?} {x} {y}");
        }
        // The view's places are those of its own account of which pixel shows what.
        let shown = View { scale: 0.25, ..View::grey(100, 100, vec![0.0; 10_000]) };
        let [x, y] = in_view(&shown, [399.5, -0.5]);
        assert!((x - -0.5).abs() < 1e-9 && (y - 99.5).abs() < 1e-9, "{x} {y}");
    }
}
