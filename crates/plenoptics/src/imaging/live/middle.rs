//! The middle of a large frame, where its spacing is looked for: that takes as long as in a small one.

use super::LiveOptions;
use crate::imaging::grid::Grid;
use crate::imaging::matching::model::FIELD_TERMS;
use crate::imaging::spacing::{SpacingFrame, SpacingOptions, find_spacing};
use crate::imaging::vignetting::Vignetting;
use crate::raw::{RawImage, Window};

/// How long a side of the middle is, pitches of the micro-images: many more show no more of where the spacing is.
const SIDE: f64 = 48.0;
/// How many times as many pixels a frame has at least, of which the middle is looked at first.
const WORTH: usize = 2;

/// A frame's middle.
#[derive(Debug, Clone)]
pub(super) struct Middle {
    window: Window,
    /// The frame's columns and rows.
    of: [usize; 2],
    /// The frame's grid by the window's pixels.
    grid: Grid,
}

impl Middle {
    /// The middle of a frame with this grid; `None` where the frame is hardly larger.
    pub(super) fn of(grid: &Grid) -> Option<Self> {
        let wanted = (SIDE * grid.pitch_px()).ceil() as usize;
        let of = grid.frame_size;
        // Whole colours of a mosaic are left out, as many on either side: the axis stays in the middle.
        let [width, height] = of.map(|length| length - length.saturating_sub(wanted) / 4 * 4);
        if WORTH * width * height > of[0] * of[1] {
            return None;
        }
        let window = Window { x: (of[0] - width) / 2, y: (of[1] - height) / 2, width, height };
        let centre = [grid.centre[0] - window.x as f64, grid.centre[1] - window.y as f64];
        Some(Self { window, of, grid: Grid { centre, frame_size: [width, height], ..grid.clone() } })
    }

    /// Looks for the spacing of a frame in its middle, as if nothing were known of it: near enough to follow it from there
    /// (px), with tilt x, tilt y and curvature over the frame. `None` where the middle does not show it.
    pub(super) fn find(
        &self,
        raw: &RawImage,
        profile: &Vignetting,
        options: &LiveOptions,
    ) -> Option<(f64, [f64; FIELD_TERMS])> {
        let Self { window, of, grid } = self;
        let light = profile.render_part(grid, [window.x, window.y], *of);
        let frame = SpacingFrame::new(&raw.cropped(*window)?, options.mosaic, &light, grid).ok()?;
        let wider = of[0] as f64 / window.width as f64;
        let field_held = options.field_held.map(|field| over(field, wider.recip()));
        let options = SpacingOptions { field_held, ..options.of_spacing() };
        let (spacing_px, field) = find_spacing(&frame, &options).ok()?;
        Some((spacing_px, over(field, wider)))
    }
}

/// Tilt x, tilt y and curvature by half the width of a frame that is so many times as wide.
fn over([tilt_x, tilt_y, curvature]: [f64; FIELD_TERMS], wider: f64) -> [f64; FIELD_TERMS] {
    [wider * tilt_x, wider * tilt_y, wider * wider * curvature]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::grid::GridSigma;
    use crate::optics::ArrayKind;

    #[test]
    fn the_middle_has_the_frames_axis_and_its_micro_images() {
        let [width, height] = [961, 880];
        let grid = Grid {
            array: ArrayKind::Square,
            centre: [477.0, 441.5],
            basis: [[12.0, 0.1], [-0.1, 12.0]],
            frame_size: [width, height],
            distortion: None,
            residual_px: 0.0,
            scatter_px: 0.0,
            coherence: 1.0,
            sigma: GridSigma::default(),
        };
        let middle = Middle::of(&grid).unwrap();
        let Window { x, y, width: across, height: down } = middle.window;
        assert!((576..600).contains(&across) && (576..600).contains(&down), "{:?}", middle.window);
        // As much is left out on either side, and the mosaic's colours stay where they are.
        assert_eq!([2 * x + across, 2 * y + down, x % 2, y % 2], [width, height, 0, 0]);
        let [here, there] = [[300.0, 260.0], [300.0 - x as f64, 260.0 - y as f64]];
        let [wanted, found] = [grid.indices_at(here[0], here[1]), middle.grid.indices_at(there[0], there[1])];
        assert!((wanted[0] - found[0]).hypot(wanted[1] - found[1]) < 1e-9, "{found:?} for {wanted:?}");
        assert!(Middle::of(&Grid { frame_size: [700, 700], ..grid }).is_none());
    }

    #[test]
    fn a_field_is_told_by_half_the_width_of_its_frame() {
        // px per half width, and per half width squared.
        assert_eq!(over([0.1, -0.2, 0.05], 2.0), [0.2, -0.4, 0.2]);
        assert_eq!(over(over([0.1, -0.2, 0.05], 4.0), 0.25), [0.1, -0.2, 0.05]);
    }
}
