//! Pixel formats: how a camera's samples lie in the bytes that its driver hands over.

use super::CfaPattern;

/// A pixel format that this program reads, named as V4L2 does or, of a GenICam camera, as PFNC does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelFormat {
    name: &'static str,
    layout: Layout,
    bits: u8,
    mosaic: Option<CfaPattern>,
}

/// How samples lie in a row of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// One sample in one byte, the first at `first` and the next `step` bytes on. Of formats with colour this is the
    /// luma.
    Bytes {
        /// Where the first sample is.
        first: usize,
        /// From a sample to the next.
        step: usize,
    },
    /// One sample in two bytes, the value in the low bits.
    Words {
        /// Whether the first byte is the high one.
        big_endian: bool,
    },
    /// As MIPI CSI-2 sends them: the high eight bits of a group's samples, then their low bits together.
    Mipi,
    /// Samples without a gap, the highest bit first.
    Dense,
    /// Samples without a gap, the lowest bit first; from one row to the next, too, where rows are not padded.
    DenseLow,
    /// Two samples in three bytes, as GigE Vision packs them: the high eight bits of one in the first and of the other in the
    /// last, their low bits in the halves of the byte between, the first's in its low half. From one row to the next, too,
    /// where rows are not padded.
    Pairs,
    /// Three bytes a pixel, of which grey is made.
    Rgb {
        /// Whether red comes first, and not blue.
        red_first: bool,
    },
    /// A JPEG picture, of which the luma is read.
    Jpeg,
}

const fn format(name: &'static str, layout: Layout, bits: u8) -> PixelFormat {
    PixelFormat { name, layout, bits, mosaic: None }
}

const fn bayer(name: &'static str, layout: Layout, bits: u8, mosaic: CfaPattern) -> PixelFormat {
    PixelFormat { name, layout, bits, mosaic: Some(mosaic) }
}

const GREY: Layout = Layout::Bytes { first: 0, step: 1 };
const WORDS: Layout = Layout::Words { big_endian: false };
use CfaPattern::{Bggr, Gbrg, Grbg, Rggb};

/// Every format that is read.
const FORMATS: &[PixelFormat] = &[
    format("GREY", GREY, 8),
    format("Y10", WORDS, 10),
    format("Y12", WORDS, 12),
    format("Y14", WORDS, 14),
    format("Y16", WORDS, 16),
    format("Y16 -BE", Layout::Words { big_endian: true }, 16),
    format("Y10B", Layout::Dense, 10),
    format("Y10P", Layout::Mipi, 10),
    format("Y12P", Layout::Mipi, 12),
    format("Y14P", Layout::Mipi, 14),
    bayer("BA81", GREY, 8, Bggr),
    bayer("GBRG", GREY, 8, Gbrg),
    bayer("GRBG", GREY, 8, Grbg),
    bayer("RGGB", GREY, 8, Rggb),
    bayer("BG10", WORDS, 10, Bggr),
    bayer("GB10", WORDS, 10, Gbrg),
    bayer("BA10", WORDS, 10, Grbg),
    bayer("RG10", WORDS, 10, Rggb),
    bayer("BG12", WORDS, 12, Bggr),
    bayer("GB12", WORDS, 12, Gbrg),
    bayer("BA12", WORDS, 12, Grbg),
    bayer("RG12", WORDS, 12, Rggb),
    bayer("BG14", WORDS, 14, Bggr),
    bayer("GB14", WORDS, 14, Gbrg),
    bayer("GR14", WORDS, 14, Grbg),
    bayer("RG14", WORDS, 14, Rggb),
    bayer("BYR2", WORDS, 16, Bggr),
    bayer("GB16", WORDS, 16, Gbrg),
    bayer("GR16", WORDS, 16, Grbg),
    bayer("RG16", WORDS, 16, Rggb),
    bayer("pBAA", Layout::Mipi, 10, Bggr),
    bayer("pGAA", Layout::Mipi, 10, Gbrg),
    bayer("pgAA", Layout::Mipi, 10, Grbg),
    bayer("pRAA", Layout::Mipi, 10, Rggb),
    bayer("pBCC", Layout::Mipi, 12, Bggr),
    bayer("pGCC", Layout::Mipi, 12, Gbrg),
    bayer("pgCC", Layout::Mipi, 12, Grbg),
    bayer("pRCC", Layout::Mipi, 12, Rggb),
    bayer("pBEE", Layout::Mipi, 14, Bggr),
    bayer("pGEE", Layout::Mipi, 14, Gbrg),
    bayer("pgEE", Layout::Mipi, 14, Grbg),
    bayer("pREE", Layout::Mipi, 14, Rggb),
    format("YUYV", Layout::Bytes { first: 0, step: 2 }, 8),
    format("YVYU", Layout::Bytes { first: 0, step: 2 }, 8),
    format("UYVY", Layout::Bytes { first: 1, step: 2 }, 8),
    format("VYUY", Layout::Bytes { first: 1, step: 2 }, 8),
    // Planes of their own: the luma's comes first.
    format("NV12", GREY, 8),
    format("NV21", GREY, 8),
    format("NV16", GREY, 8),
    format("NV61", GREY, 8),
    format("NV24", GREY, 8),
    format("NV42", GREY, 8),
    format("422P", GREY, 8),
    format("YU12", GREY, 8),
    format("YV12", GREY, 8),
    format("RGB3", Layout::Rgb { red_first: true }, 8),
    format("BGR3", Layout::Rgb { red_first: false }, 8),
    format("MJPG", Layout::Jpeg, 8),
    format("JPEG", Layout::Jpeg, 8),
];

/// Every format that is read of a GenICam camera.
const GENICAM: &[PixelFormat] = &[
    format("Mono8", GREY, 8),
    format("Mono10", WORDS, 10),
    format("Mono12", WORDS, 12),
    format("Mono14", WORDS, 14),
    format("Mono16", WORDS, 16),
    format("Mono10p", Layout::DenseLow, 10),
    format("Mono12p", Layout::DenseLow, 12),
    format("Mono10Packed", Layout::Pairs, 10),
    format("Mono12Packed", Layout::Pairs, 12),
    bayer("BayerBG8", GREY, 8, Bggr),
    bayer("BayerGB8", GREY, 8, Gbrg),
    bayer("BayerGR8", GREY, 8, Grbg),
    bayer("BayerRG8", GREY, 8, Rggb),
    bayer("BayerBG10", WORDS, 10, Bggr),
    bayer("BayerGB10", WORDS, 10, Gbrg),
    bayer("BayerGR10", WORDS, 10, Grbg),
    bayer("BayerRG10", WORDS, 10, Rggb),
    bayer("BayerBG12", WORDS, 12, Bggr),
    bayer("BayerGB12", WORDS, 12, Gbrg),
    bayer("BayerGR12", WORDS, 12, Grbg),
    bayer("BayerRG12", WORDS, 12, Rggb),
    bayer("BayerBG16", WORDS, 16, Bggr),
    bayer("BayerGB16", WORDS, 16, Gbrg),
    bayer("BayerGR16", WORDS, 16, Grbg),
    bayer("BayerRG16", WORDS, 16, Rggb),
    bayer("BayerBG10p", Layout::DenseLow, 10, Bggr),
    bayer("BayerGB10p", Layout::DenseLow, 10, Gbrg),
    bayer("BayerGR10p", Layout::DenseLow, 10, Grbg),
    bayer("BayerRG10p", Layout::DenseLow, 10, Rggb),
    bayer("BayerBG12p", Layout::DenseLow, 12, Bggr),
    bayer("BayerGB12p", Layout::DenseLow, 12, Gbrg),
    bayer("BayerGR12p", Layout::DenseLow, 12, Grbg),
    bayer("BayerRG12p", Layout::DenseLow, 12, Rggb),
    bayer("BayerBG10Packed", Layout::Pairs, 10, Bggr),
    bayer("BayerGB10Packed", Layout::Pairs, 10, Gbrg),
    bayer("BayerGR10Packed", Layout::Pairs, 10, Grbg),
    bayer("BayerRG10Packed", Layout::Pairs, 10, Rggb),
    bayer("BayerBG12Packed", Layout::Pairs, 12, Bggr),
    bayer("BayerGB12Packed", Layout::Pairs, 12, Gbrg),
    bayer("BayerGR12Packed", Layout::Pairs, 12, Grbg),
    bayer("BayerRG12Packed", Layout::Pairs, 12, Rggb),
];

impl PixelFormat {
    /// Every format that is read of a V4L2 camera, raw ones first.
    #[must_use]
    pub const fn all() -> &'static [Self] {
        FORMATS
    }

    /// Every format that is read of a GenICam camera.
    #[must_use]
    pub const fn genicam() -> &'static [Self] {
        GENICAM
    }

    /// The format of a GenICam camera's name for it (PFNC), such as `Mono8` or `BayerRG12p`.
    #[must_use]
    pub fn from_genicam_name(name: &str) -> Option<Self> {
        GENICAM.iter().copied().find(|format| format.name == name)
    }

    /// The format of a V4L2 name, such as `GREY`, `Y10` or `Y16 -BE`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        FORMATS.iter().copied().find(|format| format.name == name.trim_end())
    }

    /// The format of a V4L2 four-character code.
    #[must_use]
    pub fn from_fourcc(code: [u8; 4]) -> Option<Self> {
        FORMATS.iter().copied().find(|format| format.fourcc() == code)
    }

    /// Its name: PFNC's, or V4L2's four-character code without trailing blanks, `-BE` added where the code has its top bit
    /// set.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.name
    }

    /// Its V4L2 four-character code; nothing that means anything for a GenICam camera's.
    #[must_use]
    pub fn fourcc(self) -> [u8; 4] {
        let mut code = [b' '; 4];
        for (place, letter) in code.iter_mut().zip(self.name.bytes()) {
            *place = letter;
        }
        if self.name.ends_with("-BE") {
            code[3] |= 0x80;
        }
        code
    }

    /// How samples lie in a row.
    #[must_use]
    pub const fn layout(self) -> Layout {
        self.layout
    }

    /// Significant bits of a sample.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.bits
    }

    /// The greatest value of a sample.
    #[must_use]
    pub const fn white_level(self) -> u16 {
        ((1u32 << self.bits) - 1) as u16
    }

    /// The mosaic that its pixels are behind, where the format says so.
    #[must_use]
    pub const fn mosaic(self) -> Option<CfaPattern> {
        self.mosaic
    }

    /// Whether the pixels are no longer what the sensor saw: a lossy code has been through them.
    #[must_use]
    pub const fn is_recompressed(self) -> bool {
        matches!(self.layout, Layout::Jpeg)
    }

    /// Whether a colour camera has already interpolated its pixels, so that no mosaic is left in them.
    #[must_use]
    pub fn is_interpolated(self) -> bool {
        match self.layout {
            Layout::Bytes { .. } => self.bits == 8 && self.mosaic.is_none() && !["GREY", "Mono8"].contains(&self.name),
            Layout::Rgb { .. } | Layout::Jpeg => true,
            Layout::Words { .. } | Layout::Mipi | Layout::Dense | Layout::DenseLow | Layout::Pairs => false,
        }
    }

    /// Bytes of a row of so many pixels without padding; 0 for a JPEG, which has no rows.
    #[must_use]
    pub const fn row_bytes(self, width: usize) -> usize {
        match self.layout {
            Layout::Bytes { step, .. } => width * step,
            Layout::Words { .. } => width * 2,
            Layout::Mipi => width.div_ceil(self.mipi_group().0) * self.mipi_group().1,
            Layout::Dense | Layout::DenseLow => (width * self.bits as usize).div_ceil(8),
            // A pair's second half may be missing, and is not sent.
            Layout::Pairs => (width * 12).div_ceil(8),
            Layout::Rgb { .. } => width * 3,
            Layout::Jpeg => 0,
        }
    }

    /// Samples and bytes of a MIPI group.
    #[must_use]
    pub const fn mipi_group(self) -> (usize, usize) {
        match self.bits {
            12 => (2, 3),
            14 => (4, 7),
            _ => (4, 5),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_codes_are_each_others() {
        for format in PixelFormat::all() {
            assert_eq!(PixelFormat::from_name(format.name()), Some(*format));
            assert_eq!(PixelFormat::from_fourcc(format.fourcc()), Some(*format), "{}", format.name());
        }
        let code = |name: &str| PixelFormat::from_name(name).unwrap().fourcc();
        assert_eq!(code("GREY"), *b"GREY");
        assert_eq!(code("Y10"), *b"Y10 ");
        assert_eq!(code("Y16 -BE"), [b'Y', b'1', b'6', b' ' | 0x80]);
        assert_eq!(PixelFormat::from_name("H264"), None);
    }

    #[test]
    fn a_genicam_name_tells_depth_and_mosaic() {
        for format in PixelFormat::genicam() {
            assert_eq!(PixelFormat::from_genicam_name(format.name()), Some(*format));
            let digits: String = format.name().chars().filter(char::is_ascii_digit).collect();
            assert_eq!(digits, format.bits().to_string(), "{}", format.name());
            assert_eq!(format.mosaic().is_some(), format.name().starts_with("Bayer"), "{}", format.name());
            assert!(!format.is_interpolated(), "{}", format.name());
        }
        assert_eq!(PixelFormat::from_genicam_name("BayerRG12p").unwrap().row_bytes(8), 12);
        for name in ["Mono10Packed", "BayerGB12Packed"] {
            // An odd number of pixels ends within a group: a camera was seen to send no more than its bits fill.
            let format = PixelFormat::from_genicam_name(name).unwrap();
            assert_eq!([4, 3, 1, 1_243_233].map(|pixels| format.row_bytes(pixels)), [6, 5, 2, 1_864_850], "{name}");
        }
        assert_eq!(PixelFormat::from_genicam_name("GREY"), None);
    }

    #[test]
    fn rows_have_the_bytes_of_the_kernels_tables() {
        for (name, bytes) in [("GREY", 8), ("Y10", 16), ("Y10P", 10), ("pRCC", 12), ("Y14P", 14), ("Y10B", 10)] {
            assert_eq!(PixelFormat::from_name(name).unwrap().row_bytes(8), bytes, "{name}");
        }
        assert_eq!(PixelFormat::from_name("Y10P").unwrap().row_bytes(5), 10, "groups are whole");
    }

    #[test]
    fn what_a_colour_camera_made_is_no_mosaic() {
        let interpolated = |name| PixelFormat::from_name(name).unwrap().is_interpolated();
        assert!(interpolated("YUYV") && interpolated("NV12") && interpolated("RGB3") && interpolated("MJPG"));
        assert!(!interpolated("GREY") && !interpolated("Y12P") && !interpolated("RGGB") && !interpolated("Y10B"));
    }
}
