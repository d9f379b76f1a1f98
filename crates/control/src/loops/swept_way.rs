//! The way of an axis that is swept, as the picture has it beside the axis's own readings. Pure.

use super::axis_model::{MoveFault, READBACK_TOLERANCE_MM, SCALE_FAULT, TELLING, check_move};
use super::calibrated::CalibratedCamera;
use bench::device::AxisName;
use plenoptics::optics::mla;

/// What a spacing says of where an axis is.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shows {
    /// The focus axis: the MLA moves, and the image of the board stays.
    Focus(CalibratedCamera),
    /// The e axis in air: the distance of the board.
    EInAir(CalibratedCamera),
    /// The e axis with the shell on: e itself.
    EThroughShell(CalibratedCamera),
}

impl Shows {
    /// Where the axis is by a spacing, from a zero of its own, and the standard uncertainty of that; both mm.
    fn place_mm(&self, spacing_px: f64, sigma_px: f64) -> (f64, f64) {
        match self {
            Self::Focus(camera) => {
                let (pitch, b) = (camera.design.mla.pitch, camera.mla_to_sensor_mm);
                let a = mla::a_from_spacing(pitch, spacing_px * camera.pixel_mm, b);
                // l = D (a − b) / a, and a shrinks as the MLA moves towards the image.
                (-a, sigma_px * camera.pixel_mm * a * a / (pitch * b))
            }
            Self::EInAir(camera) => {
                let (distance_mm, slope) = camera.air_distance_mm(spacing_px);
                (distance_mm, slope.abs() * sigma_px)
            }
            Self::EThroughShell(camera) => {
                let e_mm = camera.e_mm(spacing_px, 0.0);
                (e_mm, sigma_px / camera.slope_e(e_mm, 0.0).abs())
            }
        }
    }

    const fn axis(&self) -> AxisName {
        match self {
            Self::Focus(_) => AxisName::Focus,
            Self::EInAir(_) | Self::EThroughShell(_) => AxisName::E,
        }
    }
}

/// A place of the axis.
#[derive(Debug, Clone, Copy)]
struct Place {
    reading_mm: f64,
    shown_mm: f64,
    sigma_mm: f64,
    /// What play the axis may have had there, mm.
    play_mm: f64,
}

/// The places that an axis has been at, in their order.
#[derive(Debug)]
pub(crate) struct SweptWay {
    shows: Shows,
    /// Whether the picture tells how far the axis has gone, and not only that it has: the camera is calibrated, or it does
    /// not matter.
    to_scale: bool,
    /// The axis's play, mm: where it stood at first it may have come to from either side.
    play_mm: f64,
    places: Vec<Place>,
}

impl SweptWay {
    /// A way that has not begun. `to_scale` says that the camera's d is known well enough for lengths.
    pub(crate) fn new(shows: Shows, to_scale: bool, play_mm: f64) -> Self {
        Self { shows, to_scale, play_mm, places: Vec::new() }
    }

    /// Takes in the spacing (px) seen with the axis's reading at a place (mm). What contradicts that the axis has got there,
    /// as seen from the last place that is far enough away for an axis that stands still to be told from one that moves.
    pub(crate) fn see(&mut self, reading_mm: f64, spacing_px: f64, sigma_px: f64) -> Option<MoveFault> {
        let (shown_mm, sigma_mm) = self.shows.place_mm(spacing_px, sigma_px);
        if !shown_mm.is_finite() || !sigma_mm.is_finite() {
            return None;
        }
        let play_mm = if self.places.is_empty() { self.play_mm } else { 0.0 };
        let here = Place { reading_mm, shown_mm, sigma_mm, play_mm };
        let before = self.places.iter().rev().find(|before| tells(before, &here)).copied();
        self.places.push(here);
        let before = before?;
        let fault = check_move(
            self.shows.axis(),
            here.reading_mm - before.reading_mm,
            here.shown_mm - before.shown_mm,
            before.sigma_mm.hypot(here.sigma_mm),
            slack(&before),
        );
        fault.filter(|fault| self.to_scale || !matches!(fault, MoveFault::WrongScale { .. }))
    }
}

/// What of a way from there readings and play may take away, mm.
fn slack(before: &Place) -> f64 {
    READBACK_TOLERANCE_MM.max(before.play_mm)
}

/// Whether an axis that stood still between two places would be told from one that moved.
fn tells(before: &Place, here: &Place) -> bool {
    let (expected, sigma) = ((here.reading_mm - before.reading_mm).abs(), before.sigma_mm.hypot(here.sigma_mm));
    (1.0 - SCALE_FAULT) * expected > 4.0 * sigma + slack(before) && expected > TELLING * sigma
}

#[cfg(test)]
mod tests {
    use super::*;
    use bench::config::Config;

    fn camera() -> CalibratedCamera {
        let config = Config::default();
        let e_mm = config.design().joint(0.0).e;
        CalibratedCamera::designed(&config, e_mm)
    }

    /// What is found fault with when the axis is at these readings and truly at these places, mm.
    fn faults(shows: Shows, spacing: impl Fn(f64) -> f64, places: &[(f64, f64)]) -> Vec<MoveFault> {
        let mut way = SweptWay::new(shows, true, 0.05);
        places.iter().filter_map(|&(reading, truly)| way.see(reading, spacing(truly), 0.004)).collect()
    }

    /// The spacing (px) of a board that stands still, with the MLA moved by so much from the design point (mm).
    fn by_focus(camera: &CalibratedCamera) -> impl Fn(f64) -> f64 {
        let (mla, pixel_mm) = (camera.design.mla, camera.pixel_mm);
        move |moved_mm| mla.spacing(mla.a() - moved_mm) / pixel_mm
    }

    #[test]
    fn a_step_that_was_not_made_is_seen_whatever_the_steps_are() {
        let camera = camera();
        let (shows, spacing) = (Shows::Focus(camera), by_focus(&camera));
        for step in [0.003, 0.02, 0.1] {
            let at = |n: usize, lost: usize| (step * n as f64, step * (n - lost) as f64);
            let healthy: Vec<_> = (0..40).map(|n| at(n, 0)).collect();
            assert_eq!(faults(shows, &spacing, &healthy), [], "{step}");
            let dead: Vec<_> = (0..40).map(|n| at(n, n.saturating_sub(4))).collect();
            let found = faults(shows, &spacing, &dead);
            assert!(
                found.iter().any(|fault| matches!(fault, MoveFault::NotMoving { axis: AxisName::Focus, .. })),
                "{step}"
            );
            let reversed: Vec<_> = healthy.iter().map(|&(reading, truly)| (reading, -truly)).collect();
            assert!(matches!(faults(shows, &spacing, &reversed)[0], MoveFault::Reversed { .. }), "{step}");
        }
        // Freed again after two steps.
        let freed: Vec<_> = (0..21).map(|n: usize| (0.09 * n as f64, 0.09 * (n - n.min(2)) as f64)).collect();
        assert!(matches!(faults(shows, &spacing, &freed)[0], MoveFault::NotMoving { .. }));
    }

    #[test]
    fn e_is_followed_through_the_shell_and_in_air() {
        let camera = camera();
        let places = [(12.0, 12.0), (11.0, 11.1), (10.0, 10.0), (9.0, 10.0)];
        let found = faults(Shows::EThroughShell(camera), |e_mm| camera.spacing_px(e_mm, 0.0), &places);
        assert!(matches!(found[..], [MoveFault::NotMoving { axis: AxisName::E, .. }]), "{found:?}");
        let (design, d) = (camera.design, camera.lens_to_mla_mm);
        let far_mm = design.main_lens.object_distance(d + design.mla.a());
        let spacing = |e_mm: f64| {
            let a = design.main_lens.image_distance(far_mm + e_mm) - d;
            design.mla.spacing(a) / camera.pixel_mm
        };
        let places = [(0.0, 0.0), (2.0, 2.1), (4.0, 4.0), (8.0, 4.0)];
        let found = faults(Shows::EInAir(camera), spacing, &places);
        assert!(matches!(found[..], [MoveFault::NotMoving { axis: AxisName::E, .. }]), "{found:?}");
    }
}
