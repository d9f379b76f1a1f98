//! Whether a frame is exposed so that it can be measured.

use plenoptics::raw::{CLIPPED_SHARE, RawImage, Samples, clipped_from};

/// A picture is dark when fewer than this share of its pixels ...
const LIT_SHARE: f64 = 0.01;
/// ... are brighter than this part of white.
const LIT_LEVEL: f64 = 0.1;

/// What is wrong with a frame's exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Exposure {
    /// Neither too bright nor too dark.
    Good,
    /// This share of the pixels is saturated.
    Saturated(f64),
    /// Nearly all pixels are near black.
    Dark,
}

/// Judges a frame whose scale ends at `white`.
#[must_use]
pub fn judge(image: &RawImage, white: u16) -> Exposure {
    let clipped = clipped_from(white);
    let lit = (f64::from(white) * LIT_LEVEL) as u16;
    let count = |of: &dyn Fn(u16) -> bool| match image.samples() {
        Samples::U8(samples) => samples.iter().filter(|&&sample| of(u16::from(sample))).count(),
        Samples::U16(samples) => samples.iter().filter(|&&sample| of(sample)).count(),
    } as f64 / (image.samples().len().max(1) as f64);
    let saturated = count(&|sample| sample >= clipped);
    if saturated > CLIPPED_SHARE {
        Exposure::Saturated(saturated)
    } else if count(&|sample| sample > lit) < LIT_SHARE {
        Exposure::Dark
    } else {
        Exposure::Good
    }
}

impl Exposure {
    /// Whether it says much the same as another, so that it need not be said again.
    #[must_use]
    pub fn is_like(self, other: Self) -> bool {
        match (self, other) {
            (Self::Saturated(now), Self::Saturated(before)) => (0.8..1.25).contains(&(now / before)),
            (now, before) => now == before,
        }
    }

    /// What is wrong and what to change: `controls` names the camera's controls of brightness.
    #[must_use]
    pub fn note(self, controls: &str) -> Option<String> {
        let change = |how: &str| match controls {
            "" => format!("{how} the light, the exposure at the camera, or the aperture's opening"),
            controls => format!("{how} {controls}"),
        };
        match self {
            Self::Good => None,
            Self::Saturated(share) => {
                Some(format!("{:.1} % of the pixels are saturated: {}", 100.0 * share, change("lower")))
            }
            Self::Dark => Some(format!(
                "the picture is dark, {:.0} % of it below {:.0} % of white: {}",
                100.0 * (1.0 - LIT_SHARE),
                100.0 * LIT_LEVEL,
                change("raise")
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(levels: impl Fn(usize) -> u16) -> RawImage {
        RawImage::from_u16(100, 10, 12, (0..1000).map(levels).collect())
    }

    #[test]
    fn saturation_is_counted_at_the_formats_white() {
        assert_eq!(judge(&RawImage::from_u8(4, 1, vec![254; 4]), 255), Exposure::Saturated(1.0));
        let bright = frame(|i| if i < 50 { 4095 } else { 2000 });
        let judged = judge(&bright, 4095);
        assert_eq!(judged, Exposure::Saturated(0.05));
        let note = judged.note("`gain` (now 3, 0 to 10)").unwrap();
        assert_eq!(note, "5.0 % of the pixels are saturated: lower `gain` (now 3, 0 to 10)");
        assert_eq!(judge(&frame(|i| if i < 2 { 4095 } else { 2000 }), 4095), Exposure::Good);
        // Video levels end at 235.
        let video = RawImage::from_u8(10, 1, vec![235; 10]);
        assert_eq!(judge(&video, 235), Exposure::Saturated(1.0));
        assert_eq!(judge(&video, 255), Exposure::Good);
    }

    #[test]
    fn a_dark_picture_with_hot_pixels_is_dark() {
        assert_eq!(judge(&frame(|i| if i < 2 { 4095 } else { 300 }), 4095), Exposure::Dark);
        assert!(Exposure::Dark.note("").unwrap().contains("raise the light"));
        assert_eq!(judge(&frame(|_| 500), 4095), Exposure::Good);
    }

    #[test]
    fn what_changed_little_is_like_before() {
        assert!(Exposure::Saturated(0.05).is_like(Exposure::Saturated(0.055)));
        assert!(!Exposure::Saturated(0.05).is_like(Exposure::Saturated(0.2)));
        assert!(!Exposure::Dark.is_like(Exposure::Good));
    }
}
