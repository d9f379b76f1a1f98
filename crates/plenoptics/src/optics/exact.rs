//! The exact spacing: what the paraxial spacing of Eq. 16 becomes with rays traced exactly through the shell.
//!
//! Seen through a spherical shell the spacing depends on the height in the main lens's pupil, that is, on where within
//! the micro-image one looks, and on the place in the field. So an exact spacing belongs to a window: a set of places
//! within the micro-image with weights. An estimator's own window and weights give the target that it should reach when
//! Eq. 16 is met on axis. In air there is no difference.
//!
//! All lengths are mm, on the sensor unless said otherwise. x and y are those of [`super::trace`].

use nalgebra::{Matrix2, Vector2, Vector3};

use super::trace::Ray;
use super::{CameraDesign, MainLens, Shell};

/// Radial nodes (Gauss-Legendre in the square of the radius) of a disc-shaped window: abscissa and weight on [0, 1].
const RADIAL_NODES: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];
/// Equally spaced angles of a disc-shaped window.
const ANGLES: usize = 16;
/// Nodes of Gauss-Legendre on [−1, 1] and their weights.
const GAUSS_NODES: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_1),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];
/// Squared radii, of 1, of equally weighted rings that stand for a microlens: right to the sixth power of the radius.
const LENS_SQUARES: [f64; 2] = [0.211_324_865_405_187_13, 0.788_675_134_594_812_9];
/// Equally spaced angles of each.
const LENS_ANGLES: usize = 6;
/// Newton steps when a board point is sought on the sensor: convergence is quadratic from the paraxial start.
const NEWTON_STEPS: usize = 6;
/// Where Newton's steps count as arrived, mm on the sensor.
const NEWTON_ARRIVED: f64 = 1e-13;

/// A place within the micro-images and how much it counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowPoint {
    /// Mean of the two image points' offsets from their own micro-image centres, mm on the sensor. An estimator whose
    /// window is centred on the first micro-image of a pair looks at places shifted by half of spacing less
    /// micro-image pitch along the pair: add that.
    pub offset: [f64; 2],
    /// Where the ray passes the microlens, mm from its centre: the centre for a chief ray.
    pub lens: [f64; 2],
    /// Weight, ≥ 0; weights need not sum to 1.
    pub weight: f64,
}

/// A camera at one pose before a flat board square to its axis, by exact chief rays of the microlenses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExactView {
    /// The main lens.
    pub main_lens: MainLens,
    /// D_MLA, mm.
    pub mla_pitch: f64,
    /// b, mm.
    pub b: f64,
    /// f_MLA, mm: bends the rays beside a microlens's centre.
    pub mla_focal_length: f64,
    /// d, mm.
    pub lens_to_mla: f64,
    /// The shell and e (mm), or `None` in air without a shell.
    pub shell: Option<(Shell, f64)>,
    /// Distance of the board: in water from the outer vertex O, in air from M, mm.
    pub board_distance: f64,
}

impl CameraDesign {
    /// The camera under water at a Δv and e (mm), with the board at `object_distance` of the design.
    #[must_use]
    pub fn exact_in_water(&self, delta_v: f64, e: f64) -> ExactView {
        ExactView {
            main_lens: self.main_lens,
            mla_pitch: self.mla.pitch,
            b: self.mla.b(),
            mla_focal_length: self.mla.focal_length,
            lens_to_mla: self.lens_to_mla(delta_v),
            shell: Some((self.shell, e)),
            board_distance: self.object_distance,
        }
    }

    /// The camera in air without its shell at a Δv (mm), with the board at a distance from M (mm).
    #[must_use]
    pub fn exact_in_air(&self, delta_v: f64, board_distance: f64) -> ExactView {
        ExactView { shell: None, board_distance, ..self.exact_in_water(delta_v, 0.0) }
    }

    /// The exact target: the spacing (mm) that an estimator with this window measures on axis when Eq. 16 is met
    /// paraxially with the board at `object_distance`, e (mm) held and Δv that of [`CameraDesign::clarity`].
    ///
    /// `None` where a ray of the window brings no light.
    #[must_use]
    pub fn exact_target(&self, e: f64, window: &[WindowPoint]) -> Option<f64> {
        self.exact_in_water(self.clarity(e).delta_v, e).windowed_spacing(window)
    }
}

/// A round window of equal weights, `radius` in mm on the sensor, centred between the two image points: nodes that
/// integrate the aberrations of the shell up to the fourteenth power of the radius.
#[must_use]
pub fn disc_window(radius: f64) -> Vec<WindowPoint> {
    let mut window = Vec::with_capacity(RADIAL_NODES.len() * ANGLES);
    for (square, weight) in RADIAL_NODES {
        for offset in circle(radius * square.sqrt(), ANGLES) {
            window.push(WindowPoint { offset, lens: [0.0; 2], weight });
        }
    }
    window
}

/// So many points around a circle of `radius`, evenly.
fn circle(radius: f64, count: usize) -> impl Iterator<Item = [f64; 2]> {
    (0..count).map(move |step| {
        let (sin, cos) = (std::f64::consts::TAU * step as f64 / count as f64).sin_cos();
        [radius * cos, radius * sin]
    })
}

/// The window of a pair along x whose masks are discs of `radius` about the micro-images' centres, laid over each other
/// with the second moved by `shift` (both mm on the sensor): what both see, in equal weights. Empty where they do not
/// overlap.
#[must_use]
pub fn overlap_window(radius: f64, shift: f64) -> Vec<WindowPoint> {
    let half_shift = shift.abs() / 2.0;
    if half_shift >= radius {
        return Vec::new();
    }
    let height = (radius * radius - half_shift * half_shift).sqrt();
    let mut window = Vec::with_capacity(GAUSS_NODES.len() * GAUSS_NODES.len());
    for (up, weight_up) in GAUSS_NODES {
        let y = up * height;
        let width = (radius * radius - y * y).sqrt() - half_shift;
        for (along, weight_along) in GAUSS_NODES {
            let weight = weight_up * weight_along * width;
            window.push(WindowPoint { offset: [along * width, y], lens: [0.0; 2], weight });
        }
    }
    window
}

/// A window of chief rays widened to all the rays that reach its places through round microlenses of `radius` (mm).
#[must_use]
pub fn through_whole_lens(window: &[WindowPoint], radius: f64) -> Vec<WindowPoint> {
    let mut rays = Vec::with_capacity(window.len() * LENS_SQUARES.len() * LENS_ANGLES);
    for point in window {
        for square in LENS_SQUARES {
            for lens in circle(radius * square.sqrt(), LENS_ANGLES) {
                rays.push(WindowPoint { lens, ..*point });
            }
        }
    }
    rays
}

impl ExactView {
    /// By how much the spacing on axis that an estimator measures with masks of `radius` exceeds the paraxial spacing,
    /// mm on the sensor: over all rays that the main lens's aperture (Eq. 14) and the microlenses let through. `None` where
    /// none of them brings light.
    #[must_use]
    pub fn excess(&self, radius: f64) -> Option<f64> {
        let paraxial = self.paraxial_spacing();
        let micro_image = super::mla::micro_image_pitch(self.mla_pitch, self.lens_to_mla, self.b);
        let window = through_whole_lens(&overlap_window(radius, paraxial - micro_image), self.mla_pitch / 2.0);
        let aperture_radius = self.lens_to_mla * self.mla_pitch / self.b / 2.0;
        let (mut sum, mut weights) = (0.0, 0.0);
        for point in window.iter().filter(|point| self.is_within(point, paraxial, aperture_radius)) {
            let Some(spacing) = self.spacing([0.0; 2], [1.0, 0.0], point.offset, point.lens) else { continue };
            sum += point.weight * spacing;
            weights += point.weight;
        }
        (weights > 0.0).then(|| sum / weights - paraxial)
    }

    /// Whether both rays of a pair along x about the axis pass the main lens within a radius, mm.
    fn is_within(&self, point: &WindowPoint, paraxial: f64, radius: f64) -> bool {
        [-0.5, 0.5].into_iter().all(|side| {
            let microlens = [side * self.mla_pitch, 0.0];
            let sensor = [side * paraxial + point.offset[0], point.offset[1]];
            let at_lens = self.ray(sensor, microlens, point.lens).origin;
            at_lens.x.hypot(at_lens.y) <= radius
        })
    }

    /// The ray that a sensor point sees through a point of a microlens (`lens`, mm from its centre), as it leaves the
    /// main lens for the object.
    #[must_use]
    pub fn ray(&self, sensor: [f64; 2], microlens: [f64; 2], lens: [f64; 2]) -> Ray {
        let [mut x, mut y] = [microlens[0] + lens[0], microlens[1] + lens[1]];
        let slope = |axis: usize, at: f64| (at - sensor[axis]) / self.b - lens[axis] / self.mla_focal_length;
        let (mut slope_x, mut slope_y) = (slope(0, x), slope(1, y));
        x += slope_x * self.lens_to_mla;
        y += slope_y * self.lens_to_mla;
        slope_x -= x / self.main_lens.focal_length;
        slope_y -= y / self.main_lens.focal_length;
        Ray::from_slopes(Vector3::new(x, y, 0.0), slope_x, slope_y)
    }

    /// The point of the board (mm from the axis) that a sensor point sees through a point of a microlens (`lens`, mm
    /// from its centre). `None` where no light comes that way.
    #[must_use]
    pub fn board_point(&self, sensor: [f64; 2], microlens: [f64; 2], lens: [f64; 2]) -> Option<[f64; 2]> {
        let ray = self.ray(sensor, microlens, lens);
        match self.shell {
            None => ray.at_plane(self.board_distance),
            Some((shell, e)) => shell.trace(&ray, e)?.at_plane(e + shell.outer_radius + self.board_distance),
        }
    }

    /// The board point (mm from the axis) that the chief ray of the main lens sees from a sensor point: the ray through
    /// the principal point M. `None` where no light comes that way.
    #[must_use]
    pub fn chief_board_point(&self, sensor: [f64; 2]) -> Option<[f64; 2]> {
        let scale = self.lens_to_mla / (self.lens_to_mla + self.b);
        self.board_point(sensor, sensor.map(|coordinate| coordinate * scale), [0.0; 2])
    }

    /// The sensor point from which a board point is seen through a point of a microlens (`lens`, mm from its centre), by
    /// Newton's method from `start`. `None` where no light comes that way or the search does not settle.
    #[must_use]
    pub fn sensor_point(
        &self,
        board: [f64; 2],
        microlens: [f64; 2],
        lens: [f64; 2],
        start: [f64; 2],
    ) -> Option<[f64; 2]> {
        let wanted = Vector2::from(board);
        let seen = |sensor: Vector2<f64>| self.board_point(sensor.into(), microlens, lens).map(Vector2::from);
        let mut sensor = Vector2::from(start);
        let h = 1e-4 * self.mla_pitch;
        for _ in 0..NEWTON_STEPS {
            let along = |step: Vector2<f64>| Some((seen(sensor + step)? - seen(sensor - step)?) / (2.0 * h));
            let slope = Matrix2::from_columns(&[along(Vector2::new(h, 0.0))?, along(Vector2::new(0.0, h))?]);
            let step = slope.try_inverse()? * (wanted - seen(sensor)?);
            sensor += step;
            if step.norm() < NEWTON_ARRIVED {
                return Some(sensor.into());
            }
        }
        None
    }

    /// The exact spacing of one board point under a pair of adjacent microlenses, measured along the pair.
    ///
    /// `field` is the middle of the pair on the MLA, mm from the axis; `direction` the pair's unit vector; `offset` and
    /// `lens` as in [`WindowPoint`]. `None` where no light comes that way.
    #[must_use]
    pub fn spacing(&self, field: [f64; 2], direction: [f64; 2], offset: [f64; 2], lens: [f64; 2]) -> Option<f64> {
        let (field, direction, offset) = (Vector2::from(field), Vector2::from(direction), Vector2::from(offset));
        let micro_image = (self.lens_to_mla + self.b) / self.lens_to_mla;
        let [first, second] = [-0.5, 0.5].map(|side| field + direction * (side * self.mla_pitch));
        // Each image point half of spacing less micro-image pitch away from its place in the window, to first order.
        let paraxial = self.paraxial_spacing();
        let half = direction * (0.5 * (paraxial - self.mla_pitch * micro_image));
        let first_point = first * micro_image + offset - half;
        let board = self.board_point(first_point.into(), first.into(), lens)?;
        let start = first_point + direction * paraxial;
        let second_point = Vector2::from(self.sensor_point(board, second.into(), lens, start.into())?);
        Some((second_point - first_point).dot(&direction))
    }

    /// The exact spacing of the one chief-ray pair astride the axis.
    #[must_use]
    pub fn chief_pair_spacing(&self) -> Option<f64> {
        self.spacing([0.0; 2], [1.0, 0.0], [0.0; 2], [0.0; 2])
    }

    /// The exact spacing on axis averaged over a window, for a pair along x. `None` where a ray of the window brings no
    /// light or the weights sum to nothing.
    #[must_use]
    pub fn windowed_spacing(&self, window: &[WindowPoint]) -> Option<f64> {
        let (mut sum, mut weights) = (0.0, 0.0);
        for point in window {
            sum += point.weight * self.spacing([0.0; 2], [1.0, 0.0], point.offset, point.lens)?;
            weights += point.weight;
        }
        (weights > 0.0).then(|| sum / weights)
    }

    /// The paraxial spacing on axis of this board.
    #[must_use]
    pub fn paraxial_spacing(&self) -> f64 {
        let equivalent = match self.shell {
            None => self.board_distance,
            Some((shell, e)) => shell.equivalent_distance(self.board_distance, e),
        };
        let a = self.main_lens.image_distance(equivalent) - self.lens_to_mla;
        super::mla::spacing(self.mla_pitch, a, self.b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::tests::{keplerian_camera, reference_camera};

    const PIXEL: f64 = 0.003_45;

    #[test]
    fn the_excess_on_axis_grows_with_the_window() {
        let camera = reference_camera();
        let view = camera.exact_in_water(camera.joint(0.0).delta_v, 0.0);
        let excess = |spacing: f64| (spacing - view.paraxial_spacing()) / PIXEL;
        // Reference values, to the three decimals they are known to.
        assert!((excess(view.chief_pair_spacing().unwrap()) - 0.004).abs() < 5.1e-4);
        for (radius_px, expected) in [(4.0, 0.006), (6.0, 0.010), (9.0, 0.017), (11.5, 0.025)] {
            let found = excess(view.windowed_spacing(&disc_window(radius_px * PIXEL)).unwrap());
            assert!((found - expected).abs() < 5.1e-4, "{radius_px} px: {found}");
        }
    }

    #[test]
    fn the_exact_target_meets_the_criterion_paraxially() {
        let camera = reference_camera();
        let window = disc_window(9.0 * PIXEL);
        let target = camera.exact_target(0.0, &window).unwrap();
        assert!(((target - camera.mla.target_spacing()) / PIXEL - 0.017).abs() < 5.1e-4);
        assert_eq!(camera.exact_in_water(0.0, 0.0).windowed_spacing(&[]), None);
    }

    #[test]
    fn in_air_there_is_no_difference() {
        for camera in [reference_camera(), keplerian_camera()] {
            let joint = camera.joint(0.0);
            let view = camera.exact_in_air(joint.delta_v, joint.equivalent_distance);
            let exact = view.windowed_spacing(&disc_window(0.3 * camera.mla.pitch)).unwrap();
            assert!((exact / camera.mla.target_spacing() - 1.0).abs() < 1e-10, "{exact}");
            assert!(
                (view.spacing([1.5, -0.7], [0.6, 0.8], [0.01, 0.02], [0.03, -0.01]).unwrap() / exact - 1.0).abs()
                    < 1e-10
            );
        }
    }

    #[test]
    fn the_shell_bends_the_field() {
        let camera = reference_camera();
        let rise = |e: f64, field: [f64; 2], direction: [f64; 2]| {
            let view = camera.exact_in_water(camera.clarity(e).delta_v, e);
            (view.spacing(field, direction, [0.0; 2], [0.0; 2]).unwrap() - view.chief_pair_spacing().unwrap()) / PIXEL
        };
        // 2 mm off axis: mid-edge of a 4 mm frame; then its corner.
        for (e, field, direction, expected, tolerance) in [
            (0.0, [2.0, 0.0], [1.0, 0.0], 0.097, 5.1e-4),
            (0.0, [2.0, 2.0], [1.0, 0.0], 0.19, 5.1e-3),
            (30.0, [2.0, 0.0], [1.0, 0.0], 0.15, 5.1e-3),
            (30.0, [2.0, 0.0], [0.0, 1.0], 0.11, 5.1e-3),
        ] {
            let found = rise(e, field, direction);
            assert!((found - expected).abs() < tolerance, "e = {e}, {field:?}: {found} instead of {expected}");
        }
    }

    #[test]
    fn a_shell_without_power_changes_nothing() {
        let mut camera = reference_camera();
        camera.shell.n_shell = 1.0;
        camera.shell.n_water = 1.0;
        let equivalent = camera.shell.equivalent_distance(800.0, 7.0);
        let (water, air) = (camera.exact_in_water(0.3, 7.0), camera.exact_in_air(0.3, equivalent));
        assert!((equivalent - (800.0 + 59.0 + 7.0)).abs() < 1e-9);
        let window = disc_window(0.03);
        let difference = water.windowed_spacing(&window).unwrap() / air.windowed_spacing(&window).unwrap() - 1.0;
        assert!(difference.abs() < 1e-10, "{difference}");
    }

    #[test]
    fn the_overlap_window_is_a_mean_over_both_discs() {
        let whole = overlap_window(2.0, 0.0);
        let total: f64 = whole.iter().map(|p| p.weight).sum();
        assert!((total / std::f64::consts::TAU - 1.0).abs() < 0.01, "half the area: {total}");
        let square: f64 = whole.iter().map(|p| p.weight * (p.offset[0].powi(2) + p.offset[1].powi(2))).sum();
        assert!((square / total - 2.0).abs() < 0.02, "{}", square / total);
        for point in overlap_window(2.0, 1.5) {
            let [x, y] = point.offset;
            assert!((x.abs() + 0.75).hypot(y) <= 2.0 && point.weight > 0.0);
        }
        assert!(overlap_window(2.0, 4.5).is_empty());
        // In focus the overlap is smaller than the disc, and so is what its chief rays exceed the paraxial by.
        let camera = reference_camera();
        let view = camera.exact_in_water(camera.joint(0.0).delta_v, 0.0);
        let excess =
            |window: &[WindowPoint]| (view.windowed_spacing(window).unwrap() - view.paraxial_spacing()) / PIXEL;
        let window = overlap_window(11.5 * PIXEL, 10.0 * PIXEL);
        let (disc, overlap) = (excess(&disc_window(11.5 * PIXEL)), excess(&window));
        assert!(overlap > 0.4 * disc && overlap < disc, "{overlap} of {disc} px");
        // Rays beside the microlenses' centres pass further out in the main lens.
        let whole = excess(&through_whole_lens(&window, camera.mla.pitch / 2.0));
        assert!(whole > overlap + 0.002, "{whole} against {overlap} px");
    }

    #[test]
    fn the_disc_window_is_a_mean() {
        // The mean of r² over a disc is half the radius squared; of x² a quarter.
        let window = disc_window(2.0);
        let total: f64 = window.iter().map(|p| p.weight).sum();
        let mean = |f: &dyn Fn([f64; 2]) -> f64| window.iter().map(|p| p.weight * f(p.offset)).sum::<f64>() / total;
        assert!((mean(&|[x, y]| x * x + y * y) - 2.0).abs() < 1e-12 && (mean(&|[x, _]| x * x) - 1.0).abs() < 1e-12);
    }
}
