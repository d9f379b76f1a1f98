//! Boards in air as calibrations of d and b.

use nalgebra::{DMatrix, DVector};

use super::{CameraSeen, HoldB, Measured, Sight, Unseen};
use crate::budget::BoardSeen;
use crate::spacing::SpacingReading;
use plenoptics::imaging::calibration::{Boards, Calibration, CalibrationError, CalibrationOptions, Level, fit_line};
use plenoptics::imaging::measurement::MeasurementError;
use plenoptics::optics::mla::a_from_spacing;
use plenoptics::raw::RawImage;

/// The three boards as several frames have them, with the uncertainty of one frame: most of it is what the frames share.
fn boards_seen(seen: &[Calibration]) -> Option<[BoardSeen; 3]> {
    let levels = seen.first()?.line.levels.len();
    let boards: Option<Vec<BoardSeen>> = (0..levels)
        .map(|level| {
            let boards: Option<Vec<_>> = seen.iter().map(|seen| seen.line.levels.get(level)).collect();
            let boards = boards?;
            let mean = |value: fn(&&Level) -> f64| boards.iter().map(value).sum::<f64>() / boards.len() as f64;
            Some(BoardSeen {
                distance_mm: mean(|level| level.distance_mm),
                spacing_px: mean(|level| level.spacing_px),
                sigma_px: mean(|level| level.sigma_px),
            })
        })
        .collect();
    boards?.try_into().ok()
}

impl Sight {
    /// Calibrates the camera from several frames of a triple-level board, far from focus with b held. The reading is
    /// that of the middle level.
    ///
    /// # Errors
    /// Why there is no calibration to be had, in words.
    pub(crate) fn triple(
        &self,
        images: &[&RawImage],
        levels_mm: &[f64; 3],
        hold_b: Option<HoldB>,
    ) -> Result<(CameraSeen, Measured), Unseen> {
        // What the distances share is the caller's business: no frame can mend it.
        let options = CalibrationOptions::new(self.options(), self.pixel_mm, self.design.main_lens);
        let boards: Result<Vec<Boards>, CalibrationError> =
            images.iter().map(|image| Boards::measure(image, Some(&self.white), levels_mm.len(), &options)).collect();
        let calibrated = |hold_b: Option<(f64, f64)>| -> Result<Vec<Calibration>, CalibrationError> {
            let options = CalibrationOptions { hold_b, ..options.clone() };
            let boards = boards.as_ref().map_err(Clone::clone)?;
            boards.iter().map(|boards| boards.calibrate(levels_mm, &options)).collect()
        };
        let Some(hold) = hold_b else {
            return Ok(self.camera(&calibrated(None).map_err(|error| error.to_string())?)?);
        };
        let (triple, measured) = match calibrated(Some((self.design.mla.b(), hold.sigma_mm))) {
            Ok(seen) => match self.camera(&seen)? {
                (triple, _) if triple.image_distance_sigma_mm > self.spread_mm(levels_mm) => {
                    self.blurred_triple(images, levels_mm)?
                }
                camera => camera,
            },
            // Far from focus the levels' spacings differ by less than can be told apart.
            Err(
                CalibrationError::BoardsNotFound { .. }
                | CalibrationError::Degenerate { .. }
                | CalibrationError::CannotTellApart(_)
                | CalibrationError::NoSolution { .. }
                | CalibrationError::Measurement(MeasurementError::Spacing(_) | MeasurementError::WhiteMisfit(_)),
            ) => self.blurred_triple(images, levels_mm)?,
            Err(error) => return Err(error.to_string().into()),
        };
        let near = (triple.image_distance_mm - hold.image_distance_mm).abs() <= hold.beyond_mm;
        // Boards that were put up for another Δv may not be told apart yet.
        match near.then(|| calibrated(None)) {
            Some(Ok(seen)) => Ok(self.camera(&seen)?),
            Some(Err(_)) | None => Ok((triple, measured)),
        }
    }

    /// The camera as several frames of one pose have it.
    pub(super) fn camera(&self, seen: &[Calibration]) -> Result<(CameraSeen, Measured), String> {
        let Some(first) = seen.first() else { return Err("no frame was taken".to_owned()) };
        let resolution = self.design.mla.signed_resolution();
        let mean = |value: &dyn Fn(&Calibration) -> f64| seen.iter().map(value).sum::<f64>() / seen.len() as f64;
        // Uncertainties are mostly what the model leaves unexplained, which further frames do not mend: not averaged.
        let camera = CameraSeen {
            lens_to_mla_mm: mean(&|c| c.line.d_mm),
            mla_to_sensor_mm: mean(&|c| c.line.b_mm),
            image_distance_mm: mean(&|c| c.line.image_distance(resolution).0),
            image_distance_sigma_mm: mean(&|c| c.line.image_distance(resolution).1),
            repeatability_mm: None,
            boards: boards_seen(seen),
        };
        let middle = |c: &Calibration| c.line.levels[c.line.levels.len() / 2];
        let spacing = SpacingReading {
            spacing_px: mean(&|c| middle(c).spacing_px),
            spacing_sigma_px: mean(&|c| middle(c).sigma_px),
            tilt_x_px: mean(&|c| c.field_px[0]),
            tilt_y_px: mean(&|c| c.field_px[1]),
            curvature_px: mean(&|c| c.field_px[2]),
            pairs: 0,
            frames: seen.len() as u32,
        };
        // How much of that is noise the boards do not tell.
        let sigma_random_px = spacing.spacing_sigma_px;
        let tilt_sigmas_px = [0, 1].map(|tilt| mean(&|c| c.tilt_sigmas_px[tilt]));
        let measured = Measured::new(spacing, sigma_random_px, tilt_sigmas_px, &first.grid, first.window_px);
        Ok((camera, measured))
    }

    /// What one flat board in air says, with b held at a value and its standard uncertainty (mm).
    ///
    /// # Errors
    /// Why there is no number to be had, in words.
    pub(crate) fn flat(
        &self,
        images: &[&RawImage],
        distance_mm: f64,
        known_b: (f64, f64),
    ) -> Result<(CameraSeen, Measured), Unseen> {
        let measured = self.spacing_alone(images)?;
        Ok((self.camera_from(BoardSeen::at(distance_mm, &measured.spacing), known_b), measured))
    }

    /// The camera by one board, with b held at a value and its standard uncertainty (mm).
    pub(crate) fn camera_from(&self, board: BoardSeen, (b, b_sigma): (f64, f64)) -> CameraSeen {
        let pitch = self.design.mla.pitch;
        let a = a_from_spacing(pitch, board.spacing_px * self.pixel_mm, b);
        let resolution = self.design.mla.signed_resolution();
        let lens_to_mla_mm = self.design.main_lens.image_distance(board.distance_mm) - a;
        let by_spacing = a * a / (b * pitch) * board.sigma_px * self.pixel_mm;
        // d + N b changes with b but for what a takes of it, which is all at the design's N.
        let by_b = (resolution - a / b) * b_sigma;
        CameraSeen {
            lens_to_mla_mm,
            mla_to_sensor_mm: b,
            image_distance_mm: lens_to_mla_mm + resolution * b,
            image_distance_sigma_mm: by_spacing.hypot(by_b),
            repeatability_mm: Some(by_spacing),
            boards: None,
        }
    }

    /// b and its standard uncertainty (mm) from boards by rising distance, each seen alone, and what was known of it
    /// before (mm).
    ///
    /// # Errors
    /// Why there is none to be had, in words.
    pub(crate) fn b_from(&self, boards: &[BoardSeen; 3], known_b: (f64, f64)) -> Result<(f64, f64), String> {
        let options = CalibrationOptions {
            hold_b: Some(known_b),
            ..CalibrationOptions::new(self.options(), self.pixel_mm, self.design.main_lens)
        };
        let covariance = DMatrix::from_diagonal(&DVector::from_fn(boards.len(), |k, _| boards[k].sigma_px.powi(2)));
        let (distances, spacings) = (boards.map(|board| board.distance_mm), boards.map(|board| board.spacing_px));
        let line = fit_line(&distances, &spacings, &covariance, None, &options).map_err(|error| error.to_string())?;
        Ok((line.b_mm, line.b_sigma_mm()))
    }

    /// The three boards taken as one at the middle distance: d + N b to within what the levels lie apart, which is
    /// enough to come nearer.
    pub(super) fn blurred_triple(
        &self,
        images: &[&RawImage],
        levels_mm: &[f64; 3],
    ) -> Result<(CameraSeen, Measured), Unseen> {
        let measured = self.spacing_alone(images)?;
        let (pitch, b) = (self.design.mla.pitch, self.design.mla.b());
        let a = a_from_spacing(pitch, measured.spacing.spacing_px * self.pixel_mm, b);
        let image = |distance: f64| self.design.main_lens.image_distance(distance);
        let lens_to_mla_mm = image(levels_mm[1]) - a;
        let spread = self.spread_mm(levels_mm);
        let camera = CameraSeen {
            lens_to_mla_mm,
            mla_to_sensor_mm: b,
            image_distance_mm: lens_to_mla_mm + self.design.mla.a(),
            image_distance_sigma_mm: spread,
            boards: None,
            repeatability_mm: Some(spread.min(a * a / (b * pitch) * measured.spacing.spacing_sigma_px * self.pixel_mm)),
        };
        Ok((camera, measured))
    }

    /// What three boards taken as one may be off by, mm of image distance: the mean over boards that fill unequal parts
    /// of the field lies anywhere between them, at the middle most likely.
    pub(super) fn spread_mm(&self, levels_mm: &[f64; 3]) -> f64 {
        let image = |distance: f64| self.design.main_lens.image_distance(distance);
        (image(levels_mm[0]) - image(levels_mm[2])).abs() / 4.0
    }
}
