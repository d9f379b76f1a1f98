//! What an alignment's measurements would be, were each part a little off: Gauss, the shell and the microlenses, with what
//! the steps have in common kept in common.

use nalgebra::DVector;

use super::adjustment::{Adjusted, Measured};
use super::evidence::{BoardSeen, Evidence};
use super::part::{LEVELS, Part};
use crate::loops::axis_model::AxisModel;
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::shell::ShellObservation;
use bench::config::Config;
use plenoptics::optics::{CameraDesign, Decentring, MainLens, Mla, Shell, mla};

/// Standard uncertainty of d before the boards were looked at, mm: next to nothing is known of it.
const LENS_TO_MLA_SIGMA_MM: f64 = 10.0;

/// What a spacing is uncertain by out of focus, as a share of what it differs by from the one in focus.
const BLUR_SHARE: f64 = 0.01;
/// Where a part is in doubt, its standard uncertainty is so many times as large.
const DOUBT: f64 = 5.0;

/// An alignment's equations. Unknown are the parts, in units of their standard uncertainties, and d at the end of the air
/// step, in units of [`LENS_TO_MLA_SIGMA_MM`].
#[derive(Clone)]
pub(super) struct Model<'a> {
    config: &'a Config,
    design: CameraDesign,
    seen: &'a Evidence,
    /// The parts that are not exact, with their standard uncertainties.
    pub(super) parts: Vec<(Part, f64)>,
    /// The square of the decentre that is likeliest, mm².
    decentre_squared: f64,
    /// By how much the estimator's window exceeds the axis at every pose of the shell step, and the standard uncertainty of
    /// that, px.
    excess_px: Vec<(f64, f64)>,
    /// What a decentred shell does at each of them.
    decentring: Vec<Decentring>,
}

impl<'a> Model<'a> {
    /// The equations of what was seen. `None` where no light comes to the camera as configured.
    pub(super) fn new(config: &'a Config, seen: &'a Evidence) -> Option<Self> {
        let design = config.design();
        let decentring: Option<Vec<_>> = seen.shell.iter().map(|pose| design.decentring(pose.e_reading_mm)).collect();
        let mut model = Self {
            config,
            design,
            seen,
            parts: Vec::new(),
            decentre_squared: 0.0,
            excess_px: Vec::new(),
            decentring: decentring?,
        };
        let decentre = model.decentre()?;
        model.decentre_squared = decentre.value;
        let sigma = |part: Part| match part {
            Part::Decentre => decentre.sigma,
            part => part.sigma(config),
        };
        let parts = Part::all().into_iter().map(|part| (part, sigma(part)));
        model.parts = parts.filter(|(_, sigma)| *sigma > 0.0).collect();
        // Where the spacing says that the camera is: with a large aperture behind a small shell it changes by much out of focus,
        // and hardly with what else may be off as long as the spacing is the same.
        let camera = CalibratedCamera { window_px: Some(seen.window_px), ..seen.air };
        let excess = seen.shell.iter().map(|pose| {
            let shown_mm = camera.e_mm(pose.spacing_px, pose.trim_mm);
            let e_mm = if shown_mm.is_finite() { shown_mm } else { pose.e_reading_mm };
            (camera.excess_px(e_mm, pose.trim_mm), camera.excess_sigma_px(e_mm, pose.trim_mm))
        });
        model.excess_px = excess.collect();
        Some(model)
    }

    /// The same equations where some parts are in doubt. One that is exact stays so.
    pub(super) fn in_doubt_of(&self, doubtful: &[Part]) -> Self {
        let mut model = self.clone();
        for (part, sigma) in &mut model.parts {
            if doubtful.contains(part) {
                *sigma *= DOUBT;
            }
        }
        model
    }

    /// How many unknowns there are.
    fn unknowns(&self) -> usize {
        self.parts.len() + 1
    }

    /// By how much a part is off, in its own unit.
    fn off(&self, unknowns: &DVector<f64>, part: Part) -> f64 {
        let at = self.parts.iter().position(|(other, _)| *other == part);
        at.map_or(0.0, |at| unknowns[at] * self.parts[at].1)
    }

    /// The camera at the end of the air step.
    fn camera(&self, unknowns: &DVector<f64>) -> CalibratedCamera {
        let off = |part| self.off(unknowns, part);
        let (design, air) = (self.design, self.seen.air);
        let from_lens = unknowns[self.parts.len()] * LENS_TO_MLA_SIGMA_MM;
        CalibratedCamera {
            design: CameraDesign {
                main_lens: MainLens { focal_length: design.main_lens.focal_length + off(Part::FocalLength) },
                mla: Mla { pitch: design.mla.pitch + off(Part::MlaPitch), ..design.mla },
                shell: Shell {
                    outer_radius: design.shell.outer_radius + off(Part::OuterRadius),
                    inner_radius: design.shell.inner_radius + off(Part::InnerRadius),
                    n_shell: design.shell.n_shell + off(Part::ShellIndex),
                    n_water: design.shell.n_water + off(Part::WaterIndex),
                },
                object_distance: design.object_distance + off(Part::BoardInWater),
                ..design
            },
            lens_to_mla_mm: air.lens_to_mla_mm + from_lens,
            mla_to_sensor_mm: design.mla.b() + off(Part::MlaToSensor),
            image_distance_sigma_mm: 0.0,
            pixel_mm: air.pixel_mm,
            window_px: None,
            aberrations_sigma: 0.0,
        }
    }

    /// How far the focus axis truly moves for a way of its reading, mm.
    fn focus_moved_mm(&self, unknowns: &DVector<f64>, reading_mm: f64) -> f64 {
        (1.0 + self.off(unknowns, Part::FocusScale)) * reading_mm
    }

    /// How far the focus axis truly stands from the end of the air step at a pose of the shell step, mm.
    fn trim_mm(&self, unknowns: &DVector<f64>, pose: &ShellObservation) -> f64 {
        self.focus_moved_mm(unknowns, pose.trim_mm / self.seen.focus_scale)
    }

    /// The spacing of a board in air with the focus axis's reading so far from the end of the air step's, px. Of a board
    /// `level` is the one of a stepped board; one that stands alone has no step.
    fn board_px(
        &self,
        unknowns: &DVector<f64>,
        camera: &CalibratedCamera,
        moved_mm: f64,
        distance_mm: f64,
        level: Option<usize>,
    ) -> f64 {
        let step_mm = level.map_or(0.0, |level| self.off(unknowns, Part::BoardStep(level)));
        let distance_mm = distance_mm + self.off(unknowns, Part::BoardsInAir) + step_mm;
        let d = camera.lens_to_mla_mm + self.focus_moved_mm(unknowns, moved_mm);
        let a = camera.design.main_lens.image_distance(distance_mm) - d;
        mla::spacing(camera.design.mla.pitch, a, camera.mla_to_sensor_mm) / camera.pixel_mm
    }

    /// Every board that was seen elsewhere than at the end of the air step: by how far the focus axis's reading was away, mm,
    /// which level it was, and what was seen of it.
    fn elsewhere(&self) -> impl Iterator<Item = (f64, Option<usize>, BoardSeen)> {
        self.seen.places.iter().flat_map(|place| {
            let moved_mm = place.focus_mm - self.seen.focus_mm;
            let stepped = place.boards.len() == LEVELS;
            place.boards.iter().enumerate().map(move |(at, board)| (moved_mm, stepped.then_some(at), *board))
        })
    }

    /// What the spacing of a board elsewhere is uncertain by, px: out of focus its image's shape counts, and one that is put
    /// up alone stands where it does by a step of its own.
    fn elsewhere_sigma_px(&self, (moved_mm, level, board): (f64, Option<usize>, BoardSeen)) -> f64 {
        let as_thought = DVector::zeros(self.unknowns());
        let camera = self.camera(&as_thought);
        let at = |distance_mm| self.board_px(&as_thought, &camera, moved_mm, distance_mm, None);
        let step_mm = if level.is_none() { self.config.uncertainty.board_steps_mm } else { 0.0 };
        let by_step = at(board.distance_mm + step_mm) - at(board.distance_mm);
        board.sigma_px.hypot(by_step).hypot(self.blurred_px(board.spacing_px))
    }

    /// What a spacing is uncertain by because it is not the one in focus, px.
    fn blurred_px(&self, spacing_px: f64) -> f64 {
        BLUR_SHARE * (spacing_px - self.design.mla.target_spacing() / self.seen.air.pixel_mm)
    }

    /// e where the axis reads `reading_mm`, mm.
    fn e_mm(&self, unknowns: &DVector<f64>, reading_mm: f64) -> f64 {
        let home = self.config.bench.e.home_position_mm;
        home + self.off(unknowns, Part::EZero) + (1.0 + self.off(unknowns, Part::EScale)) * (reading_mm - home)
    }

    /// What the e axis's readings mean.
    pub(super) fn e_axis(&self, adjusted: &Adjusted) -> AxisModel {
        let home = self.config.bench.e.home_position_mm;
        let line = [Part::EZero, Part::EScale];
        // Each is an unknown itself, or exact.
        let slopes = line.map(|part| {
            DVector::from_fn(self.unknowns(), |at, _| {
                self.parts.get(at).filter(|(other, _)| *other == part).map_or(0.0, |(_, sigma)| *sigma)
            })
        });
        let covariance = [0, 1].map(|i| [0, 1].map(|j| adjusted.covariance_of(&slopes[i], &slopes[j])));
        let [zero, scale] = line.map(|part| self.off(&adjusted.unknowns, part));
        AxisModel::known(home, [home + zero, 1.0 + scale], covariance)
    }

    /// The spacing near the axis at a pose of the shell step, px: a decentred shell brings the board's image nearer, as if
    /// e were smaller.
    fn paraxial_px(&self, unknowns: &DVector<f64>, camera: &CalibratedCamera, pose: usize) -> f64 {
        let at = self.seen.shell[pose];
        let decentre_squared = (self.decentre_squared + self.off(unknowns, Part::Decentre)).max(0.0);
        let e = self.e_mm(unknowns, at.e_reading_mm) - self.decentring[pose].nearer * decentre_squared;
        camera.spacing_px(e, self.trim_mm(unknowns, &at))
    }

    /// What each measurement is called, and the most probable values. `None` where what was seen fits nothing.
    pub(super) fn adjusted(&self) -> Option<(Vec<&'static str>, Adjusted)> {
        let (measurements, measured) = self.measured();
        let adjusted = Adjusted::find(self.unknowns(), &measured, |unknowns| self.predicted(unknowns))?;
        Some((measurements, adjusted))
    }

    /// What was measured: what each measurement is called, and what came of it.
    fn measured(&self) -> (Vec<&'static str>, Vec<Measured>) {
        let named = |name, value, sigma| (name, Measured { value, sigma });
        let boards = self.seen.boards.iter().map(|b| named("spacings of the boards in air", b.spacing_px, b.sigma_px));
        let elsewhere = self
            .elsewhere()
            .map(|seen| named("spacings of the boards in air", seen.2.spacing_px, self.elsewhere_sigma_px(seen)));
        let pitch = self.seen.pitch.iter().map(|p| named("pitch of the micro-images", p.pitch_px, p.sigma_px));
        // Beside what all poses share the window is another at each; and far from focus its shape counts for more.
        let shell = self.seen.shell.iter().zip(&self.excess_px).map(|(seen, (_, excess_sigma_px))| {
            let sigma_px = seen.sigma_px.hypot(*excess_sigma_px).hypot(self.blurred_px(seen.spacing_px));
            named("spacings through the shell", seen.spacing_px, sigma_px)
        });
        boards.chain(elsewhere).chain(pitch).chain(shell).unzip()
    }

    /// The same as the unknowns would have them.
    fn predicted(&self, unknowns: &DVector<f64>) -> Vec<f64> {
        let camera = self.camera(unknowns);
        let (design, b) = (&camera.design, camera.mla_to_sensor_mm);
        let board_px = |moved_mm: f64, board: &BoardSeen, level: Option<usize>| {
            self.board_px(unknowns, &camera, moved_mm, board.distance_mm, level)
        };
        let boards = self.seen.boards.iter().enumerate().map(|(level, board)| board_px(0.0, board, Some(level)));
        let elsewhere = self.elsewhere().map(|(moved_mm, level, board)| board_px(moved_mm, &board, level));
        let pitch = self.seen.pitch.iter().map(|pitch| {
            let moved_mm = self.focus_moved_mm(unknowns, pitch.focus_mm - self.seen.focus_mm);
            let from_pupil = camera.lens_to_mla_mm + moved_mm + self.off(unknowns, Part::ExitPupil);
            mla::micro_image_pitch(design.mla.pitch, from_pupil, b) / camera.pixel_mm
        });
        let window = 1.0 + self.off(unknowns, Part::Aberrations);
        let shell = (0..self.seen.shell.len())
            .map(|pose| self.paraxial_px(unknowns, &camera, pose) + window * self.excess_px[pose].0);
        boards.chain(elsewhere).chain(pitch).chain(shell).collect()
    }

    /// What the alignment came to at its last pose, as the unknowns would have it: Δv, mm, which is d + N b less the air
    /// design's v; e, mm; and the spacing near the axis less that at which the microlenses focus, px.
    pub(super) fn results(&self, unknowns: &DVector<f64>) -> Option<[f64; 3]> {
        let last = self.seen.shell.last()?;
        let camera = self.camera(unknowns);
        let d = camera.lens_to_mla_mm + self.trim_mm(unknowns, last);
        let resolution = self.design.mla.signed_resolution();
        let focal_length = self.design.mla.focal_length + self.off(unknowns, Part::MlaFocalLength);
        // Eq. 16 with 1/b − 1/a = 1/f_MLA.
        let in_focus = camera.design.mla.pitch * camera.mla_to_sensor_mm / focal_length / camera.pixel_mm;
        Some([
            d + resolution * camera.mla_to_sensor_mm - self.design.air_image_distance(),
            self.e_mm(unknowns, last.e_reading_mm),
            self.paraxial_px(unknowns, &camera, self.seen.shell.len() - 1) - in_focus,
        ])
    }

    /// The square of the shell's decentre, mm²: from what it may be, and from how the spacing's tilt has changed between air
    /// and water, which a board that is not square to the axis changes, too.
    fn decentre(&self) -> Option<Measured> {
        let (known, seen) = (&self.config.uncertainty, self.seen);
        let (last, decentring) = seen.shell.last().zip(self.decentring.last())?;
        let mut variance = known.shell_decentre_mm.powi(2);
        let mut likeliest = [0.0; 2];
        if let Some(change) = seen.tilt_change {
            let camera = &seen.air;
            let (e, trim) = (last.e_reading_mm, last.trim_mm);
            let half_width_mm = self.config.sensor_extent().width / 2.0;
            let seen_slope = half_width_mm / (camera.lens_to_mla_mm + camera.mla_to_sensor_mm);
            let by_decentre = camera.slope_e(e, trim) * decentring.tilt * seen_slope;
            let turn = known.board_tilt_deg.to_radians();
            let by_boards = camera.tilt_of_turned_board_px(e, trim, half_width_mm).map(|px| px * turn);
            let noise = change.sigma_px.powi(2) + by_boards[0].powi(2) + by_boards[1].powi(2);
            let gain = variance * by_decentre / (by_decentre * by_decentre * variance + noise);
            likeliest = change.px.map(|px| gain * px);
            variance *= 1.0 - gain * by_decentre;
        }
        // The mean and the variance of the sum of two squares of normal laws.
        let squared = likeliest[0].powi(2) + likeliest[1].powi(2);
        Some(Measured {
            value: squared + 2.0 * variance,
            sigma: (4.0 * variance * squared + 4.0 * variance * variance).sqrt(),
        })
    }
}
