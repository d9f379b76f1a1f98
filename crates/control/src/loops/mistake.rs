//! An assembler's mistakes, told by a look through the shell: from where the air step and the e axis say that
//! the camera is, the picture follows; what it shows instead names what was set up otherwise.

use super::calibrated::CalibratedCamera;
use crate::spacing::{SpacingReading, TiltChange};
use bench::config::AxisConfig;
use plenoptics::optics::{CameraDesign, Shell};

/// How many standard uncertainties of e, as the picture has it, are no contradiction.
const SIGMAS: f64 = 4.0;
/// Share of its distance within which a board in a tank is put.
const BOARD_PLACED_WITHIN: f64 = 0.02;
/// Without water, or without the shell, the spacing is foretold to this share of how far it is from what it should be: rays
/// far from the axis are bent otherwise than through the shell in water.
const OTHER_MEDIUM_WITHIN: f64 = 0.1;
/// Radius of a window that is as good as flat, mm.
const FLAT_MM: f64 = 1e5;
/// By which shares of its outer radius a shell may be another than the configured one, and how finely they are looked
/// through.
const OTHER_RADIUS: [f64; 2] = [-0.42, 4.2];
const RADIUS_STEPS: u32 = 550;
/// Distances at which a board may have been forgotten, as shares of the one asked for.
const OTHER_DISTANCE: [f64; 2] = [0.1, 5.0];
/// By which share of its distance a board in air may have been put elsewhere than was asked.
const BOARDS_DISPLACED: f64 = 0.25;
/// A change of tilt is beyond so many standard uncertainties by what the field's parts scatter by: three levels side by side
/// scatter more than they are uncertain by, so that four would let a board turned by 14° pass.
const SCATTER_SIGMAS: f64 = 2.5;
/// Least turn of a board that is worth a word, degrees.
const TURN_NAMED_DEG: f64 = 1.0;

/// A look through the shell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ShellLook<'a> {
    /// The camera as the air step left it.
    pub(crate) camera: &'a CalibratedCamera,
    /// The e axis.
    pub(crate) axis: &'a AxisConfig,
    /// Its reading, mm.
    pub(crate) e_mm: f64,
    /// Δv less that of the air step, mm.
    pub(crate) trim_mm: f64,
    /// By how much that may be off, mm.
    pub(crate) trim_bound_mm: f64,
}

impl ShellLook<'_> {
    /// What contradicts the configuration in a spacing seen, in words; `None` where nothing does.
    pub(crate) fn contradiction(&self, seen: &SpacingReading) -> Option<String> {
        let shown = self.camera.e_mm(seen.spacing_px, self.trim_mm);
        let sigma = self.camera.e_sigma_mm(self.e_mm, self.trim_mm, seen.spacing_sigma_px);
        let allowed = self.axis_bound_mm() + self.board_bound_mm() + self.trim_as_e_mm() + SIGMAS * sigma;
        if (shown - self.e_mm).abs() <= allowed {
            return None;
        }
        let (low_mm, high_mm) = (self.axis.low_limit_mm, self.axis.high_limit_mm);
        let travel_mm = high_mm - low_mm;
        let found = if (low_mm - travel_mm..=high_mm + travel_mm).contains(&shown) {
            format!("it is what would be seen with e at {shown:.1} ± {sigma:.1} mm")
        } else {
            "it is what would be seen with no e that the axis can have".to_owned()
        };
        // Led to where it can be measured.
        let led = if self.trim_bound_mm > 0.0 {
            format!(" with Δv {:+.2} mm from where the air step left it", self.trim_mm)
        } else {
            String::new()
        };
        let explanations = self.explanations(seen.spacing_px, allowed);
        let fits = if explanations.is_empty() {
            "shell, water, board or the e axis's zero are not what the configuration says".to_owned()
        } else {
            format!("it fits {}", explanations.join("; or "))
        };
        Some(format!(
            "the picture through the shell is not what the configuration says: the spacing is {:.3} px{led}, and with the e axis at {:.1} mm it should be {:.3} px; {found}; {fits}. Put it right, or correct the configuration, and begin again",
            seen.spacing_px,
            self.e_mm,
            self.camera.spacing_px(self.e_mm, self.trim_mm),
        ))
    }

    /// What to look at where the picture cannot be measured at all.
    pub(crate) fn unmeasurable(&self, why: &str) -> String {
        format!(
            "the first picture through the shell cannot be measured: {why}. Is the tank filled, is the shell mounted, and does the board stand {:.0} mm from its vertex in the light?",
            self.camera.design.object_distance
        )
    }

    /// By how much the axis's reading may be off, mm.
    fn axis_bound_mm(&self) -> f64 {
        let from_home = (self.e_mm - self.axis.home_position_mm).abs();
        3.0 * (self.axis.zero_uncertainty_mm + self.axis.scale_uncertainty * from_home) + self.axis.backlash_mm
    }

    /// By how much e would have to be off to look like a trim that is, mm.
    fn trim_as_e_mm(&self) -> f64 {
        let by_trim = self.camera.slope_delta_v(self.e_mm, self.trim_mm) / self.camera.slope_e(self.e_mm, self.trim_mm);
        by_trim.abs() * self.trim_bound_mm
    }

    /// By how much a board that is put up with care may change e as the picture has it, mm.
    fn board_bound_mm(&self) -> f64 {
        let design = &self.camera.design;
        BOARD_PLACED_WITHIN * design.object_distance * design.shell.longitudinal_magnification(design.object_distance)
    }

    /// What would be seen like that, in words, the plainest first. `allowed_mm` is how well e has to agree.
    fn explanations(&self, spacing_px: f64, allowed_mm: f64) -> Vec<String> {
        let design = &self.camera.design;
        let slope = self.camera.slope_e(self.e_mm, self.trim_mm).abs();
        let contradicts_px = (self.camera.spacing_px(self.e_mm, self.trim_mm) - spacing_px).abs();
        let within_px = (slope * allowed_mm).max(OTHER_MEDIUM_WITHIN * contradicts_px);
        let looks_so = |(shell, e_mm): (Shell, f64)| {
            let other = CalibratedCamera { design: CameraDesign { shell, ..*design }, ..*self.camera };
            (other.spacing_px(e_mm, self.trim_mm) - spacing_px).abs() <= within_px
        };
        let mut explanations = Vec::new();
        if looks_so((Shell { n_water: 1.0, ..design.shell }, self.e_mm)) {
            explanations.push("a tank with no water in it".to_owned());
        }
        if looks_so(self.with_radius(FLAT_MM - design.shell.outer_radius)) {
            explanations.push("water without the shell".to_owned());
        }
        let equivalent =
            design.shell.equivalent_distance(design.object_distance, self.camera.e_mm(spacing_px, self.trim_mm));
        if let Some(larger) = self.other_radius_mm(equivalent) {
            let radius = design.shell.outer_radius;
            explanations.push(format!("a shell of {:.0} mm outer radius instead of {radius:.0} mm", radius + larger));
        }
        let distance = design.shell.object_distance(equivalent, self.e_mm);
        let [near, far] = OTHER_DISTANCE.map(|share| share * design.object_distance);
        if (near..=far).contains(&distance) {
            explanations
                .push(format!("a board {distance:.0} mm from the shell instead of {:.0} mm", design.object_distance));
        }
        explanations.extend(self.boards_displaced_mm(equivalent).map(|displaced| {
            let way = if displaced > 0.0 { "further from" } else { "nearer to" };
            format!("boards that stood {:.0} mm {way} the lens in air than was asked", displaced.abs())
        }));
        explanations
    }

    /// By how much further from the lens the boards would have to have stood in air (mm) for the picture to look like an
    /// object at an equivalent distance (mm): the air step has the camera wrong then by what their image was off. `None` where
    /// they cannot have.
    fn boards_displaced_mm(&self, equivalent_mm: f64) -> Option<f64> {
        let CalibratedCamera { design, lens_to_mla_mm, mla_to_sensor_mm, .. } = *self.camera;
        let lens = design.main_lens;
        let image_mm = lens_to_mla_mm + design.mla.signed_resolution() * mla_to_sensor_mm;
        let foretold = design.shell.equivalent_distance(design.object_distance, self.e_mm);
        let off_mm = lens.image_distance(foretold) - lens.image_distance(equivalent_mm);
        let [asked, stood] = [image_mm, image_mm + off_mm].map(|image| lens.object_distance(image));
        let displaced = stood - asked;
        (stood > lens.focal_length && displaced.abs() <= BOARDS_DISPLACED * asked).then_some(displaced)
    }

    /// The shell with its radii so much larger (mm) and its vertex in its place, and e with it, mm.
    fn with_radius(&self, larger: f64) -> (Shell, f64) {
        let shell = self.camera.design.shell;
        let other =
            Shell { outer_radius: shell.outer_radius + larger, inner_radius: shell.inner_radius + larger, ..shell };
        (other, self.e_mm - larger)
    }

    /// By how much the shell's radii would have to be larger (mm) for an equivalent distance (mm); the least change.
    fn other_radius_mm(&self, equivalent_mm: f64) -> Option<f64> {
        let off = |larger: f64| {
            let (shell, e_mm) = self.with_radius(larger);
            shell.equivalent_distance(self.camera.design.object_distance, e_mm) - equivalent_mm
        };
        let [low, high] = OTHER_RADIUS.map(|share| share * self.camera.design.shell.outer_radius);
        let step = (high - low) / f64::from(RADIUS_STEPS);
        let crossings = (0..RADIUS_STEPS).map(|index| low + step * f64::from(index)).filter_map(|from| {
            let (a, b) = (off(from), off(from + step));
            // Within a step the distance is as good as straight.
            (a * b <= 0.0 && a != b).then(|| from + step * a / (a - b))
        });
        crossings.min_by(|one, other| one.abs().total_cmp(&other.abs()))
    }

    /// That a board is turned, in words, from how the spacing's tilt has changed since air: lens and array have the same in
    /// both. `half_width_mm` is half the sensor's width. `None` where the difference is within what either is good to.
    pub(crate) fn turned_board(&self, changed: &TiltChange, half_width_mm: f64) -> Option<String> {
        let [in_water, _] = self.camera.tilt_of_turned_board_px(self.e_mm, self.trim_mm, half_width_mm);
        let change = changed.px[0].hypot(changed.px[1]);
        let turn_deg = (change / in_water).atan().to_degrees().abs();
        let told = change > SIGMAS * changed.least_sigma_px && change > SCATTER_SIGMAS * changed.sigma_px;
        (told && turn_deg >= TURN_NAMED_DEG).then(|| {
            format!(
                "a board is turned, or the shell is off the axis: between air and water the spacing's tilt has changed by {change:.3} px, and lens and array have not; it would be {turn_deg:.1}° of the board in the water"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loops::calibrated::tests::preset;
    use bench::config::Config;

    const E_MM: f64 = 30.0;

    fn reading(spacing_px: f64) -> SpacingReading {
        SpacingReading {
            spacing_px,
            spacing_sigma_px: 0.005,
            tilt_x_px: 0.0,
            tilt_y_px: 0.0,
            curvature_px: 0.0,
            pairs: 1000,
            frames: 1,
        }
    }

    /// What is said where the picture is that of another design.
    fn said(change: impl FnOnce(&mut CameraDesign, &mut f64)) -> Option<String> {
        let (camera, axis) = (preset(), Config::default().bench.e);
        let (mut other, mut e) = (camera, E_MM);
        change(&mut other.design, &mut e);
        let look = ShellLook { camera: &camera, axis: &axis, e_mm: E_MM, trim_mm: 0.0, trim_bound_mm: 0.0 };
        look.contradiction(&reading(other.spacing_px(e, 0.0)))
    }

    #[test]
    fn what_is_set_up_as_asked_is_no_contradiction() {
        assert_eq!(said(|_, _| {}), None);
        assert_eq!(said(|_, e| *e += 0.6), None, "three of what the axis's zero is uncertain by");
        assert_eq!(said(|design, _| design.object_distance += 10.0), None, "a board put up with care");
    }

    #[test]
    fn mistakes_are_named() {
        let empty = said(|design, _| design.shell.n_water = 1.0).unwrap();
        assert!(empty.contains("no water"), "{empty}");
        let board = said(|design, _| design.object_distance = 400.0).unwrap();
        assert!(board.contains("a board 4") && board.contains("instead of 800 mm"), "{board}");
        let shell = said(|design, e| {
            design.shell.outer_radius += 12.0;
            design.shell.inner_radius += 12.0;
            *e -= 12.0;
        })
        .unwrap();
        assert!(shell.contains("a shell of 71 mm outer radius instead of 59 mm"), "{shell}");
        let none = said(|design, e| {
            let larger = FLAT_MM - design.shell.outer_radius;
            design.shell.outer_radius += larger;
            design.shell.inner_radius += larger;
            *e -= larger;
        })
        .unwrap();
        assert!(none.contains("water without the shell"), "{none}");
    }

    /// An air step by boards that stood elsewhere has d wrong, and all that is seen since.
    #[test]
    fn boards_that_stood_elsewhere_in_air_are_named() {
        let (camera, axis) = (preset(), Config::default().bench.e);
        let lens = camera.design.main_lens;
        for (displaced, said) in [(25.0, "25 mm further from the lens"), (-20.0, "20 mm nearer to the lens")] {
            let asked = camera.design.joint(0.0).equivalent_distance;
            let off = lens.image_distance(asked + displaced) - lens.image_distance(asked);
            let there = CalibratedCamera { lens_to_mla_mm: camera.lens_to_mla_mm + off, ..camera };
            let look = ShellLook { camera: &camera, axis: &axis, e_mm: E_MM, trim_mm: 0.0, trim_bound_mm: 0.0 };
            let why = look.contradiction(&reading(there.spacing_px(E_MM, 0.0))).unwrap();
            assert!(why.contains(&format!("boards that stood {said} in air than was asked")), "{why}");
        }
    }

    #[test]
    fn a_turned_board_is_told_from_a_tilted_lens() {
        let (camera, axis) = (preset(), Config::default().bench.e);
        let look = ShellLook { camera: &camera, axis: &axis, e_mm: E_MM, trim_mm: 0.0, trim_bound_mm: 0.0 };
        let changed = |px, sigma_px| TiltChange { px: [px, 0.0], sigma_px, least_sigma_px: 0.003 };
        assert_eq!(look.turned_board(&changed(0.0, 0.012), 2.0), None);
        let turned = look.turned_board(&changed(0.2, 0.012), 2.0).unwrap();
        assert!(turned.contains("of the board in the water"), "{turned}");
        // Within four of the least, or within what the parts scatter by.
        assert_eq!(look.turned_board(&changed(0.011, 0.003), 2.0), None);
        assert_eq!(look.turned_board(&changed(0.02, 0.012), 2.0), None);
    }
}
