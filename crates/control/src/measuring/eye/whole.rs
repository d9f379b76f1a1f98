//! Frames measured in whole, away from the runtime's threads.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::{Eye, Seen, SeenInAir, Unmeasured, blocking};
use crate::events::{FieldMap, InView, MeasurementView};
use crate::measuring::not_measured::NotMeasured;
use crate::measuring::sight::{CameraSeen, HoldB, Measured, Sight, Unseen};
use crate::plan::AirBoards;
use crate::recording::Happening;
use crate::spacing::SpacingReading;
use bench::device::{AxisPose, Frame};
use bench::telemetry;
use plenoptics::imaging::clarity::{self, Sharpness};
use plenoptics::imaging::grid::check_light;
use plenoptics::imaging::measurement::evened;
use plenoptics::raw::RawImage;
use plenoptics::units::Millimetres;

/// Frames that look as if the spacing had changed while the shutter was open are taken again this often: one alone may be
/// wrong about it, or have caught the last of a movement.
const SMEARED_TRIES: usize = 3;

/// So many standard uncertainties of their difference the spacings of frames may be apart that show the same.
const SMEARED_SIGMAS: f64 = 4.0;

/// What has a spacing in it that was seen.
trait Saw {
    /// The spacing.
    fn saw(&self) -> &SpacingReading;
}

impl Saw for Measured {
    fn saw(&self) -> &SpacingReading {
        &self.spacing
    }
}

impl Saw for (CameraSeen, Measured) {
    fn saw(&self) -> &SpacingReading {
        &self.1.spacing
    }
}

fn images(frames: &[Arc<Frame>]) -> Vec<&RawImage> {
    frames.iter().map(|frame| &*frame.image).collect()
}

impl Eye {
    /// Takes a white frame and learns grid and vignetting from it. Returns what was found, in words.
    pub(crate) async fn take_white(&self) -> Result<String, NotMeasured> {
        Ok(self.learn(self.frame().await?).await?.describe())
    }

    /// Whether the white frame no longer fits the camera as it stands: why, in words.
    pub(crate) async fn white_misfit(&self) -> Result<Option<String>, NotMeasured> {
        let sight = self.need_sight()?;
        let frame = self.frame().await?;
        blocking(move || sight.misfit(&frame.image)).await
    }

    /// How sharp the raw frame is that the camera gives at rest.
    pub(crate) async fn sharpness(&self) -> Result<Sharpness, NotMeasured> {
        let (frame, mosaic) = (self.frame().await?, self.config.sensor.mosaic);
        blocking(move || {
            // Noise is sharp as well.
            check_light(&frame.image).map_err(|error| error.to_string())?;
            Ok(clarity::sharpness(&evened(&frame.image, mosaic)))
        })
        .await
    }

    /// Whether the camera sees anything at all: nothing can be measured in the dark, wherever the axes stand.
    pub(crate) async fn check_light(&self) -> Result<(), NotMeasured> {
        let frame = self.frame().await?;
        blocking(move || check_light(&frame.image).map_err(|error| error.to_string())).await
    }

    /// The spacing of the flat board over so many frames, which is neither kept nor shown.
    pub(crate) async fn glance(&self, count: u32) -> Result<SpacingReading, NotMeasured> {
        let (_, seen) = self.unsmeared(count, Sight::spacing_alone).await?;
        Ok(seen.spacing)
    }

    /// Measures the spacing of the flat board over so many frames; `near_px` is what it was last seen to be (px).
    pub(crate) async fn spacing(&self, count: u32, near_px: Option<f64>) -> Result<Seen, NotMeasured> {
        let (frames, seen) = self
            .unsmeared(count, move |sight, images| {
                let from = Instant::now();
                let seen = sight.spacing(images, near_px);
                telemetry::measured(from.elapsed());
                seen
            })
            .await?;
        Ok(self.seen(&frames, seen.of_one_board()?))
    }

    /// Measures boards in air over so many frames: one with b held at what is known of it (mm), three levels with b held
    /// far from focus alone.
    pub(crate) async fn calibrate(
        &self,
        boards: AirBoards,
        known_b: (f64, f64),
        hold_b: Option<HoldB>,
        count: u32,
    ) -> Result<SeenInAir, NotMeasured> {
        let look = move |sight: &Sight, images: &[&RawImage]| match boards {
            AirBoards::Levels(levels_mm) => sight.triple(images, &levels_mm, hold_b),
            AirBoards::Flat(distance_mm) => sight.flat(images, distance_mm, known_b),
        };
        let (frames, (camera, middle)) = self.unsmeared(count, look).await?;
        let middle = match boards {
            AirBoards::Levels(_) => middle,
            AirBoards::Flat(_) => middle.of_one_board()?,
        };
        Ok(SeenInAir { camera, middle: self.seen(&frames, middle) })
    }

    /// So many frames and what is seen in them; others where they look smeared. Where all do, and yet show the same, nothing
    /// has moved.
    async fn unsmeared<T: Saw + Send + 'static>(
        &self,
        count: u32,
        look: impl Fn(&Sight, &[&RawImage]) -> Result<T, Unseen> + Copy + Send + 'static,
    ) -> Result<(Vec<Arc<Frame>>, T), NotMeasured> {
        let sight = self.need_sight()?;
        let mut before = Vec::new();
        loop {
            let frames = self.frames(count).await?;
            let last = before.len() + 1 == SMEARED_TRIES;
            let (taken, earlier, sight) = (frames.clone(), before.clone(), Arc::clone(&sight));
            let seen = blocking(move || match look(&sight, &images(&taken)) {
                Err(Unseen::Smeared(_)) if !last => Ok(None),
                Err(Unseen::Smeared(why)) => {
                    let still = sight.at_rest();
                    let seen = look(&still, &images(&taken))?;
                    let agree = |frames: &Vec<Arc<Frame>>| -> Result<bool, String> {
                        let (one, other) = (seen.saw(), look(&still, &images(frames))?.saw().clone());
                        let sigma = one.spacing_sigma_px.hypot(other.spacing_sigma_px);
                        Ok((one.spacing_px - other.spacing_px).abs() <= SMEARED_SIGMAS * sigma)
                    };
                    for frames in &earlier {
                        if !agree(frames)? {
                            return Err(why);
                        }
                    }
                    Ok(Some(seen))
                }
                seen => Ok(Some(seen?)),
            });
            if let Some(seen) = seen.await? {
                return Ok((frames, seen));
            }
            before.push(frames);
        }
    }

    pub(super) fn seen(&self, frames: &[Arc<Frame>], seen: Measured) -> Seen {
        let last = frames.last();
        let position =
            |pose: fn(&Frame) -> AxisPose| last.and_then(|frame| pose(frame).position).map(Millimetres::value);
        let (focus_mm, e_mm) = (position(|frame| frame.focus), position(|frame| frame.e));
        if let Some(frame) = last {
            let view = self.view(frame, &seen);
            self.journal.measured(&view);
            self.publish_map(frame, &seen);
            // Of three boards there is none.
            let map = seen.map.as_ref().and_then(|_| self.map.borrow().clone());
            self.journal.happened(|| Happening::Measured(Box::new(view.clone()), map));
            self.measured.send_replace(Some(view));
        }
        let eog = seen.eog.map(|eog| eog.mean_per_pixel);
        let taken = last.map_or_else(Instant::now, |frame| frame.exposed_to);
        let Measured { spacing, sigma_random_px, tilt_sigma_px, window_px, picture, .. } = seen;
        let target_px = self.target_px();
        let in_view = self.in_view();
        Seen {
            taken,
            spacing,
            in_view,
            target_px,
            focus_mm,
            e_mm,
            eog,
            sigma_random_px,
            tilt_sigma_px,
            window_px,
            picture,
        }
    }

    pub(super) fn view(&self, frame: &Frame, seen: &Measured) -> MeasurementView {
        let (spacing_target_px, spacing_target_source) = self.target();
        let spacing_px = seen.spacing.spacing_px;
        // One level alone has no map.
        let near = if seen.map.is_some() { self.is_field_in_focus(spacing_px) } else { self.is_in_focus(spacing_px) };
        MeasurementView {
            frame_seq: frame.seq,
            captured_at: frame.captured_at,
            focus_mm: frame.focus.position.map(Millimetres::value),
            e_mm: frame.e.position.map(Millimetres::value),
            settled: frame.is_settled(),
            spacing: seen.spacing.clone(),
            spacing_target_px,
            spacing_target_source,
            spacing_tolerance_px: Some(self.tolerance_px()),
            in_focus: seen.two_boards.is_none() && near,
            // A board of several levels is one that shows several.
            two_boards: seen.two_boards.filter(|_| self.in_view() != InView::SteppedBoard),
            micro_image_pitch_px: seen.micro_image_pitch_px,
            micro_image_pitch_sigma_px: Some(seen.micro_image_pitch_sigma_px),
            eog: seen.eog.map(|eog| eog.mean_per_pixel),
            eog_sum: seen.eog.map(|eog| eog.sum),
            ssim: seen.ssim,
        }
    }

    /// Measures the newest live frame, coarse as it may be; `None` where there is nothing to be measured, or the camera gives an
    /// old picture again. The error is why it cannot be, and whether nothing but motion is to blame.
    pub(crate) async fn measure_live(self: &Arc<Self>) -> Option<Result<MeasurementView, Unmeasured>> {
        self.sight()?;
        let mut live = self.bench.camera.live();
        let frame =
            tokio::time::timeout(Duration::from_secs(2), live.wait_for(Option::is_some)).await.ok()?.ok()?.clone()?;
        if !frame.replayed && self.first_alike(&frame).await != frame.seq {
            return None;
        }
        let at_rest = frame.is_settled();
        Some(self.measured_whole(&frame).await.map_err(|unseen| Unmeasured {
            by_motion: !at_rest || matches!(unseen, Unseen::Smeared(_)),
            why: unseen.into(),
        }))
    }

    /// Measures the spacing in one frame; the error is why it cannot be, in words.
    pub(crate) async fn measure_frame(&self, frame: &Arc<Frame>) -> Result<MeasurementView, String> {
        Ok(self.measured_whole(frame).await?)
    }

    pub(super) async fn measured_whole(&self, frame: &Arc<Frame>) -> Result<MeasurementView, Unseen> {
        let sight = self.sight().ok_or_else(|| "no white frame has been taken".to_owned())?;
        let (image, from) = (Arc::clone(&frame.image), Instant::now());
        let seen = tokio::task::spawn_blocking(move || sight.spacing(&[&image], None))
            .await
            .map_err(|error| format!("the measurement ended unexpectedly: {error}"))??;
        telemetry::measured(from.elapsed());
        self.publish_map(frame, &seen);
        Ok(self.view(frame, &seen))
    }

    pub(super) fn publish_map(&self, frame: &Frame, seen: &Measured) {
        if let Some(map) = &seen.map {
            self.map.send_replace(Some(Arc::new(FieldMap {
                frame_seq: frame.seq,
                captured_at: frame.captured_at,
                micro_image_pitch_px: seen.micro_image_pitch_px,
                spacing_target_px: self.target_px(),
                map: Arc::clone(map),
            })));
        }
    }
}
