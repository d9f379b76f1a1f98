//! The pixel formats that the camera offers, and how samples lie in the bytes that it sends.

use plenoptics::raw::{CfaPattern, RawImage, Samples};

/// How samples lie in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    /// Each in as many whole bytes as it needs, the low one first.
    Whole,
    /// Without a gap, the lowest bit first, from one row to the next, too.
    Dense,
}

/// A pixel format, named and numbered by the PFNC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Format {
    /// Its name.
    pub(super) name: &'static str,
    /// Its number.
    pub(super) code: u32,
    /// Significant bits of a sample.
    pub(super) bits: u8,
    packing: Packing,
}

const fn whole(name: &'static str, code: u32, bits: u8) -> Format {
    Format { name, code, bits, packing: Packing::Whole }
}

const fn dense(name: &'static str, code: u32, bits: u8) -> Format {
    Format { name, code, bits, packing: Packing::Dense }
}

const MONO: [Format; 6] = [
    whole("Mono8", 0x0108_0001, 8),
    whole("Mono10", 0x0110_0003, 10),
    dense("Mono10p", 0x010a_0046, 10),
    whole("Mono12", 0x0110_0005, 12),
    dense("Mono12p", 0x010c_0047, 12),
    whole("Mono16", 0x0110_0007, 16),
];
const RGGB: [Format; 6] = [
    whole("BayerRG8", 0x0108_0009, 8),
    whole("BayerRG10", 0x0110_000d, 10),
    dense("BayerRG10p", 0x010a_0058, 10),
    whole("BayerRG12", 0x0110_0011, 12),
    dense("BayerRG12p", 0x010c_0059, 12),
    whole("BayerRG16", 0x0110_002f, 16),
];
const BGGR: [Format; 6] = [
    whole("BayerBG8", 0x0108_000b, 8),
    whole("BayerBG10", 0x0110_000f, 10),
    dense("BayerBG10p", 0x010a_0052, 10),
    whole("BayerBG12", 0x0110_0013, 12),
    dense("BayerBG12p", 0x010c_0053, 12),
    whole("BayerBG16", 0x0110_0031, 16),
];
const GRBG: [Format; 6] = [
    whole("BayerGR8", 0x0108_0008, 8),
    whole("BayerGR10", 0x0110_000c, 10),
    dense("BayerGR10p", 0x010a_0056, 10),
    whole("BayerGR12", 0x0110_0010, 12),
    dense("BayerGR12p", 0x010c_0057, 12),
    whole("BayerGR16", 0x0110_002e, 16),
];
const GBRG: [Format; 6] = [
    whole("BayerGB8", 0x0108_000a, 8),
    whole("BayerGB10", 0x0110_000e, 10),
    dense("BayerGB10p", 0x010a_0054, 10),
    whole("BayerGB12", 0x0110_0012, 12),
    dense("BayerGB12p", 0x010c_0055, 12),
    whole("BayerGB16", 0x0110_0030, 16),
];

impl Format {
    /// What a sensor with these filters, or without any, offers.
    pub(super) const fn offered(mosaic: Option<CfaPattern>) -> &'static [Self; 6] {
        match mosaic {
            None => &MONO,
            Some(CfaPattern::Rggb) => &RGGB,
            Some(CfaPattern::Bggr) => &BGGR,
            Some(CfaPattern::Grbg) => &GRBG,
            Some(CfaPattern::Gbrg) => &GBRG,
        }
    }

    /// Bytes of so many samples.
    pub(super) fn bytes(&self, samples: usize) -> usize {
        match self.packing {
            Packing::Whole => samples * usize::from(self.bits).div_ceil(8),
            Packing::Dense => (samples * usize::from(self.bits)).div_ceil(8),
        }
    }

    /// The bytes of a region of a frame whose depth is the format's.
    pub(super) fn pack(&self, image: &RawImage, region: &Region) -> Vec<u8> {
        let rows = (region.top..region.top + region.height)
            .map(|y| y * image.width() + region.left..y * image.width() + region.left + region.width);
        let mut packed = Vec::with_capacity(self.bytes(region.width * region.height));
        match image.samples() {
            Samples::U8(samples) => rows.for_each(|row| packed.extend_from_slice(&samples[row])),
            Samples::U16(samples) => {
                let samples = rows.flat_map(|row| samples[row].iter().copied());
                match self.packing {
                    Packing::Whole => packed.extend(samples.flat_map(u16::to_le_bytes)),
                    Packing::Dense => push_dense(&mut packed, samples, self.bits),
                }
            }
        }
        packed
    }
}

fn push_dense(packed: &mut Vec<u8>, samples: impl Iterator<Item = u16>, bits: u8) {
    let (mut pending, mut held) = (0u32, 0);
    for sample in samples {
        pending |= u32::from(sample) << held;
        held += u32::from(bits);
        while held >= 8 {
            packed.push((pending & 0xff) as u8);
            pending >>= 8;
            held -= 8;
        }
    }
    if held > 0 {
        packed.push(pending as u8);
    }
}

/// A part of the sensor, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Region {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn format(name: &str) -> Format {
        let mosaics = [None].into_iter().chain(CfaPattern::ALL.map(Some));
        mosaics.flat_map(Format::offered).find(|format| format.name == name).copied().unwrap()
    }

    #[test]
    fn samples_lie_as_the_pfnc_has_them() {
        let image = RawImage::from_u16(2, 2, 12, vec![0x123, 0x456, 0x789, 0xabc]);
        let all = Region { left: 0, top: 0, width: 2, height: 2 };
        assert_eq!(format("Mono12").pack(&image, &all), [0x23, 0x01, 0x56, 0x04, 0x89, 0x07, 0xbc, 0x0a]);
        assert_eq!(format("Mono12p").pack(&image, &all), [0x23, 0x61, 0x45, 0x89, 0xc7, 0xab]);
        let image = RawImage::from_u16(4, 1, 10, vec![0x3ff, 0, 0x3ff, 1]);
        let row = Region { left: 0, top: 0, width: 4, height: 1 };
        assert_eq!(format("Mono10p").pack(&image, &row), [0xff, 0x03, 0xf0, 0x7f, 0x00]);
        let three = Region { width: 3, ..row };
        assert_eq!(format("BayerGR10p").pack(&image, &three), [0xff, 0x03, 0xf0, 0x3f]);
    }

    #[test]
    fn a_region_is_cut_out_of_the_frame() {
        let image = RawImage::from_u8(4, 3, (0..12).collect());
        let region = Region { left: 1, top: 1, width: 2, height: 2 };
        assert_eq!(format("Mono8").pack(&image, &region), [5, 6, 9, 10]);
    }

    #[test]
    fn a_formats_number_tells_its_bits() {
        for format in [None].into_iter().chain(CfaPattern::ALL.map(Some)).flat_map(Format::offered) {
            let taken = (format.bytes(8)) as u32;
            assert_eq!(format.code >> 16 & 0xff, taken, "{}", format.name);
        }
    }
}
