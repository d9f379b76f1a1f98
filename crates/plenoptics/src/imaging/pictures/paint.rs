//! Depth as a coloured picture, for looking at.

use super::Pictures;
use crate::imaging::depth::DepthState;
use crate::imaging::view::Extent;

/// From far to near, evenly in the spacing: viridis, whose lightness rises all along, so that every kind of colour vision
/// can read it. Nothing in it is grey.
const COLOURS: [[u8; 3]; 9] = [
    [0x44, 0x01, 0x54],
    [0x47, 0x2d, 0x7b],
    [0x3b, 0x52, 0x8b],
    [0x2c, 0x72, 0x8e],
    [0x21, 0x91, 0x8c],
    [0x28, 0xae, 0x80],
    [0x5e, 0xc9, 0x62],
    [0xad, 0xdc, 0x30],
    [0xfd, 0xe7, 0x25],
];
/// Where nothing is known: grey stripes.
const UNKNOWN: [[u8; 3]; 2] = [[0x3c; 3], [0x64; 3]];
/// Width of a stripe, px.
const STRIPE_PX: usize = 4;
/// Shares of the micro-images beyond which the colours do not go.
const ENDS: [f64; 2] = [0.02, 0.98];
/// The colours span at least so much, px of spacing: a flat board is not to look like a mountain.
const LEAST_SPAN_PX: f64 = 1.0;

/// What the first and the last colour stand for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Spacings, px: of what is farthest and of what is nearest.
    pub spacing_px: [f64; 2],
    /// The distances that go with them on the axis, mm; absent without a pose.
    pub distance_mm: [Option<f64>; 2],
}

/// A picture in colour of 8 bits.
#[derive(Debug, Clone, PartialEq)]
pub struct Painted {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row.
    pub rgb: Vec<u8>,
}

impl Pictures {
    /// The depth of what each pixel of a view so large shows, by its nearest micro-image: from dark violet for far to
    /// yellow for near, striped in grey where it is unknown. It needs no pose.
    #[must_use]
    pub fn painted_depth(&self, extent: Extent) -> Painted {
        let scale = self.scale();
        let colour = |index: [i32; 2]| -> Option<[u8; 3]> {
            let lens = self.depth.lens(index).filter(|lens| lens.state != DepthState::Unknown)?;
            let [far, near] = scale?.spacing_px;
            Some(coloured((lens.spacing_px - far) / (near - far)))
        };
        let rgb = extent
            .owners(self.grid())
            .enumerate()
            .flat_map(|(k, index)| {
                let stripe = (k % extent.width + k / extent.width) / STRIPE_PX % 2;
                colour(index).unwrap_or(UNKNOWN[stripe])
            })
            .collect();
        Painted { width: extent.width, height: extent.height, rgb }
    }

    /// What the colours of a painted depth stand for; `None` where nothing is known anywhere.
    #[must_use]
    pub fn scale(&self) -> Option<Scale> {
        let known = self.depth.lenses.iter().filter(|lens| lens.state != DepthState::Unknown);
        let mut spacings: Vec<f64> = known.map(|lens| lens.spacing_px).collect();
        spacings.sort_unstable_by(f64::total_cmp);
        let last = spacings.len().checked_sub(1)?;
        let [far, near] = ENDS.map(|share| spacings[(share * last as f64).round() as usize]);
        let more = (LEAST_SPAN_PX - (near - far)).max(0.0) / 2.0;
        let spacing_px = [far - more, near + more];
        let distance = |spacing_px: f64| {
            let table = self.table.as_deref()?;
            table.distances.distance(spacing_px * table.pose.pixel_mm, [0.0; 2])
        };
        Some(Scale { spacing_px, distance_mm: spacing_px.map(distance) })
    }
}

/// The colour of a share of the scale.
fn coloured(share: f64) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let lower = (place as usize).min(COLOURS.len() - 2);
    let part = place - lower as f64;
    let mix = |one: u8, other: u8| (f64::from(one) * (1.0 - part) + f64::from(other) * part).round() as u8;
    let (one, other) = (COLOURS[lower], COLOURS[lower + 1]);
    [mix(one[0], other[0]), mix(one[1], other[1]), mix(one[2], other[2])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearer_is_lighter_and_no_depth_is_grey() {
        let light = |[r, g, b]: [u8; 3]| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b);
        let shades: Vec<[u8; 3]> = (0..=40).map(|k| coloured(f64::from(k) / 40.0)).collect();
        assert!(shades.windows(2).all(|pair| light(pair[0]) < light(pair[1])));
        let grey = |[r, g, b]: [u8; 3]| r.abs_diff(g).max(g.abs_diff(b)) < 16;
        assert!(UNKNOWN.iter().all(|&colour| grey(colour)) && !shades.iter().any(|&shade| grey(shade)));
        assert_eq!([coloured(-3.0), coloured(7.0)], [COLOURS[0], COLOURS[8]]);
    }
}
