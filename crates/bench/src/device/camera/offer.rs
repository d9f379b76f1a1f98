//! What a camera offers: formats, sizes and frame rates.

use serde::Serialize;
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::video::Capture;
use v4l::{Device, FourCC, Fraction};

use super::kernel::guarded;
use plenoptics::raw::PixelFormat;

/// A pixel format that a camera offers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Offer {
    /// V4L2 name, as configured.
    pub format: String,
    /// The driver's words for it.
    pub description: String,
    /// Whether this program reads it.
    pub readable: bool,
    /// Whether it has been through a lossy code: for viewing, not for measuring.
    pub recompressed: bool,
    /// Sizes of frames.
    pub sizes: Vec<Size>,
}

/// A size of frames, or a range of sizes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Size {
    /// Columns and rows, the least of them.
    pub least_px: [u32; 2],
    /// The greatest; the same where there is one size.
    pub most_px: [u32; 2],
    /// Between sizes.
    pub step_px: [u32; 2],
    /// Frames a second that the driver lists for it, of the greatest size; empty where it lists none.
    pub rates_hz: Vec<f64>,
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([w, h], [most_w, most_h]) = (self.least_px, self.most_px);
        if self.least_px == self.most_px { write!(f, "{w}x{h}") } else { write!(f, "{w}x{h} to {most_w}x{most_h}") }
    }
}

/// The V4L2 name of a four-character code.
#[must_use]
pub fn name_of(code: FourCC) -> String {
    let mut letters = code.repr;
    let big_endian = letters[3] & 0x80 != 0;
    letters[3] &= 0x7f;
    let name = String::from_utf8_lossy(&letters);
    if big_endian { format!("{name}-BE") } else { name.trim_end().to_owned() }
}

/// Every format that a device offers. A list that the driver leaves out is empty.
#[must_use]
pub fn offers(device: &Device) -> Vec<Offer> {
    let formats = guarded(|| device.enum_formats()).unwrap_or_default();
    let offer = |description: v4l::format::Description| {
        let known = PixelFormat::from_fourcc(description.fourcc.repr);
        Offer {
            format: name_of(description.fourcc),
            description: description.description,
            readable: known.is_some(),
            recompressed: known.is_some_and(PixelFormat::is_recompressed),
            sizes: sizes(device, description.fourcc),
        }
    };
    formats.into_iter().map(offer).collect()
}

fn sizes(device: &Device, code: FourCC) -> Vec<Size> {
    let sizes = guarded(|| device.enum_framesizes(code)).unwrap_or_default();
    let size = |size: v4l::FrameSize| {
        let (least_px, most_px, step_px) = match size.size {
            FrameSizeEnum::Discrete(of) => ([of.width, of.height], [of.width, of.height], [0, 0]),
            FrameSizeEnum::Stepwise(of) => {
                ([of.min_width, of.min_height], [of.max_width, of.max_height], [of.step_width, of.step_height])
            }
        };
        Size { least_px, most_px, step_px, rates_hz: rates(device, code, most_px) }
    };
    sizes.into_iter().map(size).collect()
}

fn rates(device: &Device, code: FourCC, [width, height]: [u32; 2]) -> Vec<f64> {
    let rate = |of: &Fraction| f64::from(of.denominator) / f64::from(of.numerator.max(1));
    let intervals = guarded(|| device.enum_frameintervals(code, width, height)).unwrap_or_default();
    intervals
        .iter()
        .flat_map(|of| match &of.interval {
            FrameIntervalEnum::Discrete(interval) => vec![rate(interval)],
            // From the slowest to the fastest.
            FrameIntervalEnum::Stepwise(range) => vec![rate(&range.max), rate(&range.min)],
        })
        .collect()
}

/// Formats and sizes that are read, in one line for an error.
#[must_use]
pub fn summary(device: &Device) -> String {
    let readable = offers(device).into_iter().filter(|offer| offer.readable);
    let listed = readable.map(|offer| {
        let sizes: Vec<String> = offer.sizes.iter().map(ToString::to_string).collect();
        format!("{} {}", offer.format, sizes.join(" ")).trim_end().to_owned()
    });
    let listed: Vec<String> = listed.collect();
    if listed.is_empty() { "no format that this program reads".to_owned() } else { listed.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_the_names_that_are_configured() {
        for format in PixelFormat::all() {
            assert_eq!(name_of(FourCC::new(&format.fourcc())), format.name());
        }
        assert_eq!(name_of(FourCC::new(b"H264")), "H264");
        assert_eq!(name_of(FourCC::new(&[0xff, 0x01, b'A', b'B'])), "\u{fffd}\u{1}AB");
    }

    #[test]
    fn a_range_of_sizes_shows_both_ends() {
        let size = |least_px, most_px| Size { least_px, most_px, step_px: [2, 2], rates_hz: vec![] }.to_string();
        assert_eq!(size([640, 480], [640, 480]), "640x480");
        assert_eq!(size([2, 2], [8192, 8192]), "2x2 to 8192x8192");
    }
}
