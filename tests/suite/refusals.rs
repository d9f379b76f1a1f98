//! Whatever is wrong with a frame is the reason that its refusal gives.

use plenalign::config::Texture;
use plenalign::imaging::live::{LiveMeter, LiveOptions};
use plenalign::imaging::measurement::{FrameMeasurement, FrameOptions, MeasurementError, WhiteModel, measure_frame};
use plenalign::imaging::spacing::SpacingError;
use plenalign::raw::RawImage;

use super::rendered::Rendered;

/// Apertures of a white frame, in units of the frames': micro-images with gaps between them, and such as overlap.
const OTHER_APERTURES: [f64; 4] = [0.8, 0.9, 1.12, 1.25];

fn frame(seed: u64) -> Rendered {
    Rendered { seed, size: [360, 300], rays: 16, ..Rendered::default() }
}

fn measured(frame: &Rendered, raw: &RawImage, white: &RawImage) -> Result<FrameMeasurement, MeasurementError> {
    measure_frame(raw, Some(&WhiteModel::new(white).unwrap()), &FrameOptions::new(frame.mla_pitch_px()))
}

/// A frame with its grey levels changed.
fn changed(raw: &RawImage, change: impl Fn(f64) -> f64) -> RawImage {
    let levels = raw.to_view().into_iter().map(|level| change(f64::from(level)).clamp(0.0, 255.0) as u8);
    RawImage::from_u8(raw.width(), raw.height(), levels.collect())
}

#[test]
fn a_frame_is_refused_for_what_was_done_to_it() {
    // Of a chequered board the black half stands a lot of light.
    for (seed, texture, bright) in [(1, Texture::Natural, [4.0, 10.0]), (2, Texture::Charuco, [20.0, 40.0])] {
        let frame = frame(seed);
        let (raw, white) = (frame.textured(texture), frame.white());
        assert!(measured(&frame, &raw, &white).is_ok_and(|seen| seen.vignetting_fit.is_some_and(|fit| fit.fits())));
        // Too little light, down to none; and too much.
        for share in [0.02, 0.005, 0.0] {
            let why = measured(&frame, &changed(&raw, |level| share * level), &white).unwrap_err().to_string();
            assert!(why.contains("lengthen the exposure"), "{share} {texture:?}: {why}");
        }
        for share in bright {
            let why = measured(&frame, &changed(&raw, |level| share * level), &white).unwrap_err().to_string();
            assert!(why.contains("saturated") && why.contains("shorten the exposure"), "{share} {texture:?}: {why}");
        }
        // Nothing on the board: few rays make a texture of their own where the aperture cuts in.
        let blank = Rendered { seed: seed + 10, noise: 6.0, rays: 128, ..self::frame(seed) };
        let why = measured(&frame, &blank.white(), &Rendered { rays: 128, ..self::frame(seed) }.white()).unwrap_err();
        assert!(matches!(why, MeasurementError::Spacing(SpacingError::NoTexture { .. })), "{texture:?}: {why}");
    }
}

/// A white frame of another aperture leaves the same in every micro-image: it is the white frame that is blamed, with
/// texture and without, in whole and live.
#[test]
fn a_white_frame_of_another_aperture_is_blamed_for_what_it_does() {
    for aperture in OTHER_APERTURES {
        let frame = frame(3);
        let white = Rendered { aperture, ..self::frame(3) }.white();
        let blames =
            |why: &str| assert!(why.contains("white frame") && why.contains("at this setting"), "{aperture}: {why}");
        // The edges of a chequered board hide even this in a frame so small.
        for texture in [Texture::Natural, Texture::Guppy, Texture::Oscar] {
            match measured(&frame, &frame.textured(texture), &white) {
                Ok(seen) => {
                    let fit = seen.vignetting_fit.unwrap();
                    assert!(!fit.fits(), "{aperture} {texture:?}: not noticed, {fit}");
                }
                Err(why) => blames(&why.to_string()),
            }
        }
        let blank = Rendered { seed: 13, ..self::frame(3) }.white();
        blames(&measured(&frame, &blank, &white).unwrap_err().to_string());
        let (model, options) = (WhiteModel::new(&white).unwrap(), LiveOptions::new(frame.mla_pitch_px()));
        let mut meter = LiveMeter::new(&model.grid, &model.vignetting, options).unwrap();
        blames(&meter.acquire(&blank).unwrap_err().to_string());
    }
}

/// Texture is not taken for a white frame that does not fit.
#[test]
fn a_white_frame_that_fits_is_not_doubted() {
    for seed in 1..=6 {
        for texture in [Texture::Natural, Texture::Charuco, Texture::Guppy, Texture::Oscar] {
            let frame = frame(seed);
            let fit = measured(&frame, &frame.textured(texture), &frame.white()).unwrap().vignetting_fit.unwrap();
            assert!(fit.fits(), "{texture:?} of seed {seed}: {fit}");
        }
    }
}
