//! From the spacing of a micro-image to the distance of what it sees, by exact rays at its place in the field.
//!
//! The paraxial inverse of Eqs. 5, 8 and 16 knows nothing of the field: a shell bends a flat board's image, so that in the
//! corners it is wrong by some per cent. In air without a shell both agree.

use super::{ExactView, MlaMode};

/// Nodes over the field, evenly in the square of the distance from the axis.
const FIELD_NODES: usize = 9;
/// Nodes over the distance, evenly in its inverse.
const DISTANCE_NODES: usize = 160;
/// Nearest and farthest distance that a table holds, mm.
const RANGE_MM: [f64; 2] = [40.0, 20_000.0];
/// Places across the pupil, in microlens pitches from the axis of a pair: an estimator sees the whole micro-image.
const WINDOW: [[f64; 2]; 5] = [[0.0, 0.0], [0.0, 0.16], [0.0, -0.16], [0.1, 0.0], [-0.1, 0.0]];

/// Distances by spacing and place in the field, for a camera at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceTable {
    /// Square of the greatest distance from the axis on the MLA, mm².
    square_max: f64,
    /// For each field node the spacings (mm on the sensor) that bring light and their inverse distances (1/mm), spacings
    /// rising.
    columns: Vec<Vec<(f64, f64)>>,
}

impl DistanceTable {
    /// The table of a camera whose field reaches `radius_max` (mm on the MLA) from the axis. The view's own
    /// `board_distance` does not matter. The mode says on which side of the MLA the main lens's image lies: the same camera
    /// sees very near things on the other.
    #[must_use]
    pub fn new(view: &ExactView, mode: MlaMode, radius_max: f64) -> Self {
        let square_max = radius_max.powi(2).max(1e-12);
        let [near, far] = RANGE_MM;
        let columns = (0..FIELD_NODES)
            .map(|node| {
                let radius = (square_max * node as f64 / (FIELD_NODES - 1) as f64).sqrt();
                let mut column: Vec<(f64, f64)> = (0..DISTANCE_NODES)
                    .filter_map(|k| {
                        let share = k as f64 / (DISTANCE_NODES - 1) as f64;
                        let inverse = 1.0 / far + share * (1.0 / near - 1.0 / far);
                        let at = ExactView { board_distance: 1.0 / inverse, ..*view };
                        Some((mean_spacing(&at, mode, radius)?, inverse))
                    })
                    .collect();
                rising(&mut column);
                column
            })
            .collect();
        Self { square_max, columns }
    }

    /// The distance along the axis (mm: in water from O, in air from M) of what a micro-image sees whose spacing (mm on
    /// the sensor) is the mean over directions, `field` (mm on the MLA) from the axis. `None` beyond what the camera or
    /// the table can see.
    #[must_use]
    pub fn distance(&self, spacing: f64, field: [f64; 2]) -> Option<f64> {
        let inverse = self.across_field(field, |column| line_through(column, |&pair| pair, spacing))?;
        (inverse > 0.0).then(|| 1.0 / inverse)
    }

    /// The inverse of [`DistanceTable::distance`]: the spacing (mm on the sensor) of what is at a distance (mm). `None`
    /// beyond what the camera or the table can see.
    #[must_use]
    pub fn spacing(&self, distance: f64, field: [f64; 2]) -> Option<f64> {
        let turned = |&(spacing, inverse): &(f64, f64)| (inverse, spacing);
        self.across_field(field, |column| line_through(column, turned, 1.0 / distance))
    }

    /// What a place in the field has between its two nodes; a little beyond the last node the same line goes on.
    fn across_field(&self, field: [f64; 2], at_node: impl Fn(&[(f64, f64)]) -> Option<f64>) -> Option<f64> {
        let square = field[0].powi(2) + field[1].powi(2);
        let place = square / self.square_max * (FIELD_NODES - 1) as f64;
        let lower = (place.floor() as usize).min(FIELD_NODES - 2);
        let share = place - lower as f64;
        Some(at_node(&self.columns[lower])? * (1.0 - share) + at_node(&self.columns[lower + 1])? * share)
    }
}

/// Spacing of a board's image points at a distance from the axis (mm on the MLA), mean over directions and over the
/// middle of the micro-image. `None` where no light comes that way or the image is on the other side of the MLA.
fn mean_spacing(view: &ExactView, mode: MlaMode, radius: f64) -> Option<f64> {
    let paraxial = view.paraxial_spacing();
    let side = match mode {
        MlaMode::Galilean => 0.1..1.0,
        MlaMode::Keplerian => 1.0..3.0,
    };
    if !side.contains(&(paraxial / view.mla_pitch)) {
        return None;
    }
    let mut sum = 0.0;
    for direction in [[1.0, 0.0], [0.0, 1.0]] {
        for [along, across] in WINDOW {
            let offset = [along * direction[0] + across * direction[1], along * direction[1] + across * direction[0]];
            sum += view.spacing([radius, 0.0], direction, offset.map(|x| x * view.mla_pitch), [0.0; 2])?;
        }
    }
    let mean = sum / (2 * WINDOW.len()) as f64;
    mean.is_finite().then_some(mean)
}

/// Leaves of a column (by falling distance) the run about its middle in which the spacing rises with the inverse
/// distance, as it does wherever the main lens's image is real.
fn rising(column: &mut Vec<(f64, f64)>) {
    let mut best = 0..0;
    let mut start = 0;
    for k in 1..=column.len() {
        if k == column.len() || column[k].0 <= column[k - 1].0 {
            if k - start > best.len() {
                best = start..k;
            }
            start = k;
        }
    }
    *column = column[best].to_vec();
}

/// The value at `x` on the line through its neighbours in a column, of which `pair` makes abscissa and value, both rising;
/// `None` outside.
fn line_through(column: &[(f64, f64)], pair: impl Fn(&(f64, f64)) -> (f64, f64), x: f64) -> Option<f64> {
    let after = column.partition_point(|entry| pair(entry).0 < x);
    let ((x0, y0), (x1, y1)) = (pair(column.get(after.checked_sub(1)?)?), pair(column.get(after)?));
    Some(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::tests::{keplerian_camera, reference_camera};

    #[test]
    fn the_paraxial_inverse_holds_in_air() {
        for camera in [reference_camera(), keplerian_camera()] {
            let joint = camera.joint(0.0);
            let view = camera.exact_in_air(joint.delta_v, joint.equivalent_distance);
            let table = DistanceTable::new(&view, camera.mla.mode, 2.8);
            for share in [0.93, 1.0, 1.08] {
                let distance = share * joint.equivalent_distance;
                let spacing = ExactView { board_distance: distance, ..view }.paraxial_spacing();
                for field in [[0.0, 0.0], [1.0, 0.4], [2.0, 1.9]] {
                    let found = table.distance(spacing, field).unwrap();
                    assert!((found / distance - 1.0).abs() < 1e-3, "{found} instead of {distance} at {field:?}");
                }
            }
        }
    }

    #[test]
    fn the_exact_inverse_holds_in_the_corners_where_the_paraxial_one_does_not() {
        let camera = reference_camera();
        let view = camera.exact_in_water(camera.joint(0.0).delta_v, 0.0);
        let table = DistanceTable::new(&view, camera.mla.mode, 2.83);
        for distance in [450.0, 600.0, 800.0, 1000.0] {
            let at = ExactView { board_distance: distance, ..view };
            for field in [[0.3, 0.0], [2.0, 0.0], [1.9, 1.9]] {
                let spacing = |direction: [f64; 2]| at.spacing(field, direction, [0.0; 2], [0.0; 2]).unwrap();
                let seen = f64::midpoint(spacing([1.0, 0.0]), spacing([0.0, 1.0]));
                let found = table.distance(seen, field).unwrap();
                assert!((found / distance - 1.0).abs() < 0.005, "{found} instead of {distance} at {field:?}");
                assert!((table.spacing(found, field).unwrap() - seen).abs() < 1e-5, "{seen} at {field:?}");
            }
            // What the axis alone would make of the corner.
            let corner = f64::midpoint(
                at.spacing([1.9, 1.9], [1.0, 0.0], [0.0; 2], [0.0; 2]).unwrap(),
                at.spacing([1.9, 1.9], [0.0, 1.0], [0.0; 2], [0.0; 2]).unwrap(),
            );
            let paraxial = table.distance(corner, [0.0, 0.0]).unwrap();
            println!("{distance} mm: {paraxial:.1} by the axis");
            assert!((paraxial / distance - 1.0).abs() > 0.02, "{paraxial} for {distance}");
        }
    }

    #[test]
    fn what_no_camera_sees_has_no_distance() {
        let camera = reference_camera();
        let table = DistanceTable::new(&camera.exact_in_water(camera.joint(0.0).delta_v, 0.0), camera.mla.mode, 2.0);
        for spacing in [-0.01, 0.001, 0.0999, 0.2, f64::NAN] {
            assert_eq!(table.distance(spacing, [0.0, 0.0]), None, "{spacing}");
        }
    }
}
