//! Why a spacing could not be measured.

use crate::optics::MlaMode;

/// Why a spacing could not be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpacingError {
    /// Frame, grid and vignetting do not belong together.
    #[error("the frame is {}x{} px but its grid or vignetting is for {}x{} px: take a white frame of the same size", frame[0], frame[1], grid[0], grid[1])]
    WrongSize {
        /// Columns and rows of the frame.
        frame: [usize; 2],
        /// Columns and rows the grid is for.
        grid: [usize; 2],
    },
    /// The frame shows too few neighbouring micro-images.
    #[error("only {pairs} pairs of neighbouring micro-images lie in the frame or region; {needed} are needed")]
    TooFewMicroImages {
        /// Pairs found.
        pairs: usize,
        /// Pairs needed.
        needed: usize,
    },
    /// Too many pixels are at the white level.
    #[error("{:.0} % of the pixels within the micro-images are saturated: shorten the exposure or dim the light", share * 100.0)]
    Saturated {
        /// Share of saturated pixels within the micro-images.
        share: f64,
    },
    /// Hardly any light.
    #[error("the micro-images average {mean:.1} grey levels, at least {least:.1} are needed: lengthen the exposure")]
    Dark {
        /// Mean grey level within the micro-images.
        mean: f64,
        /// Grey level needed.
        least: f64,
    },
    /// The board shows nothing that could be matched.
    #[error("no texture stands out of the noise ({noise:.1} grey levels): put a textured board in view")]
    NoTexture {
        /// Noise of the frame, grey levels.
        noise: f64,
    },
    /// Only one lattice direction has texture across it.
    #[error("the texture runs in one direction only: micro-images differ along {} alone; turn the board or use another", if *along_rows { "rows" } else { "columns" })]
    OneDirection {
        /// Whether pairs along rows (x) can be matched, and those along columns cannot.
        along_rows: bool,
    },
    /// No spacing in the capture range makes neighbours match.
    #[error(
        "neighbouring micro-images do not match at any spacing from {from_px:.1} to {to_px:.1} px (best correlation {correlation:.2}): out of the range of focus, or no plenoptic frame of this array"
    )]
    NoMatch {
        /// Least spacing tried, px.
        from_px: f64,
        /// Largest spacing tried, px.
        to_px: f64,
        /// Best correlation found.
        correlation: f64,
    },
    /// Neighbours match better and better towards an end of the capture range: the spacing is beyond it.
    #[error(
        "neighbouring micro-images match best at {} px, the {} spacing of those searched ({from_px:.1} to {to_px:.1} px, for an MLA pitch of {mla_pitch_px:.2} px): the spacing lies {} the range; {}, or correct mla.pitch_mm or sensor.pixel_um",
        format_args!("{:.1}", if *above { to_px } else { from_px }),
        if *above { "greatest" } else { "least" },
        if *above { "above" } else { "below" },
        if *above { "raise Δv or take the board further away" } else { "lower Δv or bring the board nearer" }
    )]
    BeyondRange {
        /// Least spacing tried, px.
        from_px: f64,
        /// Largest spacing tried, px.
        to_px: f64,
        /// Whether the spacing lies above the range, not below it.
        above: bool,
        /// D_MLA that the range is of, px.
        mla_pitch_px: f64,
    },
    /// Neighbours match at a spacing of the other mode only.
    #[error(
        "neighbouring micro-images match at {spacing_px:.2} px, {} the MLA pitch of {mla_pitch_px:.2} px, and at no spacing of the configured {mode:?} mode: the board's image lies on the other side of the array (move Δv or the board), or mla.mode, mla.pitch_mm or sensor.pixel_um is another",
        if spacing_px < mla_pitch_px { "below" } else { "above" }
    )]
    OtherMode {
        /// Where they match, px.
        spacing_px: f64,
        /// D_MLA, px.
        mla_pitch_px: f64,
        /// The mode that the caller says it is.
        mode: MlaMode,
    },
    /// Neighbours match, but not at spacings of one field.
    #[error(
        "neighbouring micro-images match near {near_px:.2} px (correlation {correlation:.2}), but no one spacing with tilt and curvature fits all of the field: boards at several distances, an object in front, or a grid that is off"
    )]
    Unsettled {
        /// Where they match, px.
        near_px: f64,
        /// How well.
        correlation: f64,
    },
    /// The only match is that of the micro-images as they lie.
    #[error(
        "neighbouring micro-images match only as they lie, {pitch_px:.2} px apart: what repeats is the array itself, not a board behind it; take a white frame of this very camera, clean the sensor, and see that the frame is a raw plenoptic one"
    )]
    FixedPattern {
        /// Distance of the micro-images, px.
        pitch_px: f64,
    },
    /// Two spacings explain the frame alike.
    #[error(
        "spacings of {first_px:.2} and {second_px:.2} px explain the frame alike: the texture repeats itself, use another board"
    )]
    Ambiguous {
        /// The better, px.
        first_px: f64,
        /// The other, px.
        second_px: f64,
    },
    /// The spacing changed while the shutter was open.
    #[error(
        "the picture is smeared as by a change of the spacing of {change_px:.1} px while the shutter was open: wait until the stage has settled, or shorten the exposure"
    )]
    Moved {
        /// The change, px.
        change_px: f64,
    },
    /// A number given by the caller is impossible.
    #[error("{what} of {value} is not possible: it must be positive and finite")]
    Impossible {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
}
