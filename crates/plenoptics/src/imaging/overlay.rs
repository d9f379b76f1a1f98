//! A raw frame with what was measured in it drawn over: micro-images, pairs, and how far each spacing is from a wanted
//! one.
//!
//! Every micro-image has its circle and is tinted by its spacing less the wanted one: blue below, orange above (told
//! apart by every kind of colour vision), pale where its own uncertainty is as large. A mark between two circles stands
//! for a pair, white where it counts, dark where it hardly does. Micro-images that do not show what their neighbours
//! show are crossed out in magenta; those without texture have a dashed circle and no tint. Microlenses that the white
//! frame shows to be dead, missing or dirty are framed in yellow.

use image::{Rgb, RgbImage};

use super::microlenses::FlaggedMicrolens;
use super::spacing::{LensState, SpacingMap};
use crate::raw::RawImage;

/// Tints of a spacing below and above the wanted one.
const BELOW: [f64; 3] = [40.0, 110.0, 255.0];
const ABOVE: [f64; 3] = [255.0, 140.0, 0.0];
const CIRCLE: [f64; 3] = [90.0, 220.0, 200.0];
const CROSS: [f64; 3] = [255.0, 0.0, 200.0];
const FRAME: [f64; 3] = [255.0, 230.0, 0.0];
const PAIR: [f64; 3] = [255.0, 255.0, 255.0];
const WEAK_PAIR: [f64; 3] = [70.0, 70.0, 70.0];
/// How strongly the strongest tint covers the frame.
const TINT: f64 = 0.6;
/// Weight below which a pair hardly counts.
const LEAST_WEIGHT: f64 = 0.2;
/// Frames with a pitch below this are drawn enlarged, so that circles can be told apart, px.
const PITCH_MIN_PX: f64 = 24.0;

/// The spacing whose micro-images have no tint, and how far from it the tint is strongest, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tint {
    /// No tint.
    pub wanted_px: f64,
    /// Strongest tint this far from it.
    pub range_px: f64,
}

/// Draws `map` and the `flagged` microlenses over `raw`, whose micro-image pitch is `pitch_px`. The picture is a whole
/// number of times as large as the frame.
#[must_use]
pub fn draw(raw: &RawImage, map: &SpacingMap, flagged: &[FlaggedMicrolens], pitch_px: f64, tint: Tint) -> RgbImage {
    let Tint { wanted_px, range_px } = tint;
    let enlarged = (PITCH_MIN_PX / pitch_px).ceil().clamp(1.0, 4.0);
    let mut canvas = Canvas::new(raw, enlarged as usize);
    let radius = 0.46 * pitch_px;
    for pair in &map.pairs {
        let [a, b] = pair.centres_px;
        let at = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
        let colour = if pair.weight < LEAST_WEIGHT { WEAK_PAIR } else { PAIR };
        canvas.line(at(0.42), at(0.58), colour, 0.9);
    }
    for lens in &map.lenses {
        let centre = lens.centre_px;
        match lens.state {
            LensState::Matched => {
                let departure = (lens.spacing_px - wanted_px) / range_px.max(1e-6);
                let certainty = departure.abs() / (departure.abs() + lens.sigma_px / range_px.max(1e-6));
                let strength = TINT * departure.abs().min(1.0) * certainty;
                canvas.disc(centre, radius, if departure < 0.0 { BELOW } else { ABOVE }, strength);
                canvas.circle(centre, radius, CIRCLE, 1);
            }
            LensState::Blank => canvas.circle(centre, radius, CIRCLE, 4),
            LensState::Mismatched => {
                canvas.circle(centre, radius, CROSS, 1);
                let r = 0.6 * radius;
                let corner = |x: f64, y: f64| [centre[0] + x * r, centre[1] + y * r];
                canvas.line(corner(-1.0, -1.0), corner(1.0, 1.0), CROSS, 1.0);
                canvas.line(corner(-1.0, 1.0), corner(1.0, -1.0), CROSS, 1.0);
            }
        }
    }
    for microlens in flagged {
        let [x, y] = microlens.centre_px;
        let corners =
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[u, v]| [x + u * radius, y + v * radius]);
        for k in 0..4 {
            canvas.line(corners[k], corners[(k + 1) % 4], FRAME, 1.0);
        }
    }
    canvas.picture
}

/// A picture in the frame's coordinates.
struct Canvas {
    picture: RgbImage,
    scale: f64,
}

impl Canvas {
    fn new(raw: &RawImage, enlarged: usize) -> Self {
        let grey = raw.to_view();
        let (width, height) = (raw.width() * enlarged, raw.height() * enlarged);
        let picture = RgbImage::from_fn(width as u32, height as u32, |x, y| {
            let value = grey[y as usize / enlarged * raw.width() + x as usize / enlarged];
            Rgb([value; 3])
        });
        Self { picture, scale: enlarged as f64 }
    }

    /// Place on the picture of a place in the frame: pixel centres at integers in both.
    fn place(&self, v: f64) -> f64 {
        (v + 0.5) * self.scale - 0.5
    }

    fn blend(&mut self, x: f64, y: f64, colour: [f64; 3], strength: f64) {
        let (x, y) = (x.round(), y.round());
        if x < 0.0 || y < 0.0 || x >= f64::from(self.picture.width()) || y >= f64::from(self.picture.height()) {
            return;
        }
        let pixel = self.picture.get_pixel_mut(x as u32, y as u32);
        for (value, colour) in pixel.0.iter_mut().zip(colour) {
            *value = (f64::from(*value) * (1.0 - strength) + colour * strength).round().clamp(0.0, 255.0) as u8;
        }
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: [f64; 3], strength: f64) {
        let (from, to) = (from.map(|v| self.place(v)), to.map(|v| self.place(v)));
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0) as usize;
        for k in 0..=steps {
            let t = k as f64 / steps as f64;
            self.blend(from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]), colour, strength);
        }
    }

    /// A circle; of every `dash` parts one is drawn.
    fn circle(&mut self, centre: [f64; 2], radius: f64, colour: [f64; 3], dash: usize) {
        let (x, y, radius) = (self.place(centre[0]), self.place(centre[1]), radius * self.scale);
        let steps = (std::f64::consts::TAU * radius).ceil() as usize;
        let part = (steps / 32).max(1);
        for k in (0..steps).filter(|k| (k / part).is_multiple_of(dash)) {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / steps as f64).sin_cos();
            self.blend(x + radius * cos, y + radius * sin, colour, 0.55);
        }
    }

    fn disc(&mut self, centre: [f64; 2], radius: f64, colour: [f64; 3], strength: f64) {
        let (x, y, radius) = (self.place(centre[0]), self.place(centre[1]), radius * self.scale);
        let reach = radius.ceil() as i64;
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let (px, py) = (x.round() + dx as f64, y.round() + dy as f64);
                if (px - x).hypot(py - y) < radius {
                    self.blend(px, py, colour, strength);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::microlenses::MicrolensFlag;
    use crate::imaging::spacing::{LensSpacing, PairMatch};

    #[test]
    fn what_is_drawn_says_what_was_measured() {
        let raw = RawImage::from_u8(90, 30, vec![100; 2700]);
        let lens = |x: f64, spacing_px: f64, state: LensState| LensSpacing {
            index: [0, 0],
            centre_px: [x, 15.0],
            spacing_px,
            sigma_px: 0.001,
            state,
        };
        let map = SpacingMap {
            lenses: vec![
                lens(14.0, 19.0, LensState::Matched),
                lens(44.0, 20.0, LensState::Matched),
                lens(74.0, 19.5, LensState::Mismatched),
            ],
            pairs: vec![PairMatch { centres_px: [[14.0, 15.0], [44.0, 15.0]], weight: 1.0 }],
        };
        let flagged = FlaggedMicrolens {
            index: [0, 0],
            centre_px: [44.0, 15.0],
            flag: MicrolensFlag::Dirty,
            transmission: 0.5,
            misfit: 0.0,
        };
        let tint = Tint { wanted_px: 19.5, range_px: 0.4 };
        let picture = draw(&raw, &map, &[flagged], 30.0, tint);
        let at = |x: u32, y: u32| picture.get_pixel(x, y).0;
        assert_eq!(picture.dimensions(), (90, 30));
        assert!(at(14, 15)[2] > at(14, 15)[0] + 80, "below is blue: {:?}", at(14, 15));
        assert!(at(44, 15)[0] > at(44, 15)[2] + 60, "above is orange: {:?}", at(44, 15));
        assert_eq!(at(74, 15), [255, 0, 200]);
        assert_eq!(at(44, 1), [255, 230, 0], "its microlens is dirty");
        assert!(at(29, 15).iter().all(|&v| v > 200), "the pair: {:?}", at(29, 15));
        assert_eq!(draw(&raw, &map, &[], 10.0, tint).dimensions(), (270, 90));
    }
}
