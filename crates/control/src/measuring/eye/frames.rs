//! Frames at rest: waited for, and taken for what they are only where they show something new.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tokio::time::Instant;

use super::Eye;
use crate::clock::{Part, enter};
use crate::measuring::not_measured::{NotMeasured, OLD_PICTURE};
use crate::recording::{Answer, Happening};
use bench::device::{DeviceError, Frame};
use plenoptics::raw::RawImage;

/// How long the axes may take to settle after a move that has ended.
const SETTLING_ALLOWED: Duration = Duration::from_secs(10);

/// A frame that spans motion is taken again this often.
const FRAME_TRIES: u32 = 5;

/// Levels between which a pixel's noise shows, as shares of white, and the share of such pixels by which a frame is known.
const NOISY: [f32; 2] = [0.1, 0.9];
const LEAST_NOISY: f64 = 0.01;

/// A frame has the very picture of one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OldPicture;

impl From<OldPicture> for DeviceError {
    fn from(_: OldPicture) -> Self {
        Self::Protocol { device: "the camera".to_owned(), detail: OLD_PICTURE.to_owned() }
    }
}

/// Whether two frames are the same to the last pixel, and noisy: a sensor that sees nothing but black or white may well
/// repeat itself. In the dark those pixels are noisy that are not as black as the blackest.
fn is_same_picture(one: &RawImage, other: &RawImage) -> bool {
    let white = f32::from(one.white_level());
    let is_noisy = |frame: &RawImage| {
        let levels = frame.to_f32();
        let blackest = levels.iter().copied().fold(f32::INFINITY, f32::min);
        let noisy = |&&level: &&f32| level < NOISY[1] * white && (level > blackest || level >= NOISY[0] * white);
        levels.iter().filter(noisy).count() as f64 >= LEAST_NOISY * levels.len() as f64
    };
    one == other && is_noisy(one)
}

impl Eye {
    /// Whether the camera's frames may be measured at all: asked before anything moves for them.
    pub(crate) fn check_camera(&self) -> Result<(), NotMeasured> {
        match &self.bench.camera.state().borrow().unfit {
            Some(why) => Err(NotMeasured::failed(format!("the camera's frames are not measured: {why}"))),
            None => Ok(()),
        }
    }

    /// A frame exposed wholly while both axes stood settled, with another picture than those before it.
    pub(super) async fn frame(&self) -> Result<Arc<Frame>, NotMeasured> {
        let mut ended = NotMeasured::failed(format!("{FRAME_TRIES} frames in a row spanned motion of an axis"));
        for _ in 0..FRAME_TRIES {
            let _settling = enter(Part::Settling);
            let settled = tokio::time::timeout(SETTLING_ALLOWED, async {
                loop {
                    if let Some(from) = self.motion.settled_from() {
                        return from;
                    }
                    tokio::time::sleep(Duration::from_millis(20)).await;
                }
            });
            let Ok(from) = settled.await else {
                let why = self.motion.unrest().join("; ");
                return Err(NotMeasured::failed(format!(
                    "the axes did not come to rest within {SETTLING_ALLOWED:?}: {why}"
                )));
            };
            let before = self.bench.camera.newest();
            let frame = match self.frame_from(from).await {
                Ok(frame) => frame,
                Err(error) => {
                    self.journal.happened(|| Happening::Answer(Answer::no_frame(error.clone())));
                    return Err(error.into());
                }
            };
            if frame.is_settled() {
                self.journal.happened(|| Happening::Frame(Arc::clone(&frame)));
                self.check_size(&frame)?;
                if self.check_new(before.as_deref(), &frame).is_ok() {
                    return Ok(frame);
                }
                ended = NotMeasured::OldPicture;
            }
        }
        Err(ended)
    }

    /// The camera's first frame from a moment on: until then what is waited for is that the axes settle.
    pub(super) async fn frame_from(&self, from: Instant) -> Result<Arc<Frame>, DeviceError> {
        let mut frame = self.bench.camera.frame(from.max(Instant::now()));
        if let Ok(frame) = tokio::time::timeout_at(from, &mut frame).await {
            return frame;
        }
        let _waiting = enter(Part::Frames);
        frame.await
    }

    /// Whether a frame is of the size that is configured.
    pub(crate) fn check_size(&self, frame: &Frame) -> Result<(), DeviceError> {
        let (width, height) = (self.config.sensor.width_px, self.config.sensor.height_px);
        if (frame.image.width(), frame.image.height()) == (width as usize, height as usize) {
            return Ok(());
        }
        Err(DeviceError::WrongDevice {
            device: "the camera".to_owned(),
            expected: format!("frames of {width}x{height} px"),
            found: format!("frames of {}x{} px", frame.image.width(), frame.image.height()),
        })
    }

    /// Whether a frame is a new picture, and not the one looked at last nor `before`: noise makes no two the same to the
    /// last pixel, unless the driver gives an old one again.
    pub(crate) fn check_new(&self, before: Option<&Frame>, frame: &Arc<Frame>) -> Result<(), OldPicture> {
        let looked_at = self.looked_at.lock().unwrap_or_else(PoisonError::into_inner).replace(Arc::clone(frame));
        if ![looked_at.as_deref(), before].into_iter().flatten().any(|old| self.repeats(old, frame)) {
            return Ok(());
        }
        Err(OldPicture)
    }

    /// The frame that was looked at last.
    pub(crate) fn looked_at(&self) -> Option<Arc<Frame>> {
        self.looked_at.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The first of the frames in a row, up to this one, that have its very picture, by its sequence number.
    pub(crate) async fn first_alike(self: &Arc<Self>, frame: &Arc<Frame>) -> u64 {
        let eye = Arc::clone(self);
        self.repeats.first(frame, move |before, frame| eye.repeats(before, frame)).await
    }

    /// Whether a frame has the very picture of one before it.
    pub(crate) fn repeats(&self, before: &Frame, frame: &Frame) -> bool {
        let simulation = &self.config.bench.simulation;
        let noiseless = frame.simulated && simulation.read_noise_levels == 0.0 && simulation.electrons_per_level == 0.0;
        !noiseless && before.seq != frame.seq && is_same_picture(&before.image, &frame.image)
    }

    pub(super) async fn frames(&self, count: u32) -> Result<Vec<Arc<Frame>>, NotMeasured> {
        let mut frames = Vec::with_capacity(count as usize);
        for _ in 0..count.max(1) {
            frames.push(self.frame().await?);
        }
        Ok(frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_known_again_by_its_noise() {
        let frame = |level: u8, one: u8| {
            let mut samples = vec![level; 100 * 100];
            samples[17] = one;
            RawImage::from_u8(100, 100, samples)
        };
        assert!(is_same_picture(&frame(120, 130), &frame(120, 130)));
        assert!(!is_same_picture(&frame(120, 130), &frame(120, 131)));
        // A cap on the lens, and a lamp in it.
        assert!(!is_same_picture(&frame(0, 130), &frame(0, 130)));
        assert!(!is_same_picture(&frame(255, 130), &frame(255, 130)));
        let dark = |seed: usize| {
            RawImage::from_u8(
                100,
                100,
                (0..100 * 100).map(|i| u8::from((i * 7919 + seed).is_multiple_of(23))).collect(),
            )
        };
        assert!(is_same_picture(&dark(1), &dark(1)));
        assert!(!is_same_picture(&dark(1), &dark(2)));
    }
}
