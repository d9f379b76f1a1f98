//! Through how much of its microlens a pixel sees, and what it does to the spacing that it does not see through all of it.
//!
//! Towards the edge of its micro-image the main lens's aperture cuts off one side of a pixel's microlens. Two things move
//! what the pixel shows from where its chief ray goes. Out of focus every part of the microlens shows another place, and
//! what is left of it lies outwards of its centre (Galilean): by u of its diameter D, the picture is moved by
//! (l_target − l) u/D. And on the pixel itself more light falls on the side towards the centre, in focus or not.
//!
//! Neighbours show one thing on opposite sides of their centres, so that the spacing is pulled towards the one in focus,
//! and by the second effect to a little less. How much follows from the profile alone: the aperture's edge passes over the
//! microlens while a pixel moves by as much as, in focus, the spacing is away from the micro-image pitch.

use std::f64::consts::{PI, TAU};

use super::masks::MASK_FRACTION;

/// The smallest masks, as a part of the micro-image's radius, where the profile falls from its centre on.
const LEAST_WHOLE: f64 = 0.5;
/// Share of the centre's light from which on a pixel counts as seeing through its whole microlens.
const WHOLE_SHARE: f64 = 0.985;
/// Rings of the profile, and from one to the next, in parts of the micro-image's radius: nearer to the border neighbours
/// leak in.
const RINGS: usize = 46;
const STEP: f64 = 0.02;
/// Shares of light that tell where the aperture's edge lies on a microlens: nearer to all and to nothing a pixel's own
/// area counts.
const TELLING: [f64; 2] = [0.4, 0.9];
/// Rings that have to tell.
const LEAST_RINGS: usize = 3;
/// Rounds of the edge's fit, and the step of its derivatives, px.
const FIT_ROUNDS: usize = 12;
const FIT_STEP_PX: f64 = 0.01;
/// Half the distance, px, of two points that spread as far as a pixel does.
const HALF_PIXEL: f64 = 0.288_675;
/// Blur (px) at which a picture is moved by half of what the middle of its blur is: what is finer than the blur goes by
/// the part of its rim that is not cut off.
const FINE_PX: f64 = 8.0;
/// Shares of the corrections that are in doubt: of that out of focus, which depends on how fine the texture is, and of
/// that for light on a pixel, whose profile the white frame's own pixels blur.
const DOUBTS: [f64; 2] = [0.3, 0.5];
/// Points across an overlap of two masks.
const POINTS: usize = 16;

/// Through how much of their microlens the pixels of a micro-image see.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Pupil {
    /// Micro-image pitch, px.
    pub(in crate::imaging) pitch: f64,
    /// Part of the micro-image's radius within which nothing is cut off.
    pub(in crate::imaging) whole: f64,
    /// While the aperture's edge passes over the whole microlens a pixel moves by this, px; `None` where no edge is seen.
    width: Option<f64>,
    /// By ring: the share of light, how far outwards what is left of the microlens has its middle, in its diameters, and
    /// the middle of the light on the pixel, px.
    rings: Vec<[f64; 3]>,
}

/// A spacing freed of what the aperture's edge does to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Corrected {
    /// The spacing, px.
    pub(in crate::imaging) spacing: f64,
    /// By how much it grows with the spacing as measured.
    pub(in crate::imaging) slope: f64,
    /// Standard uncertainty of the correction, px.
    pub(in crate::imaging) sigma: f64,
}

impl Pupil {
    /// From the profile's mean around circles about micro-image centres: `share` has the light that reaches the pixel in a
    /// column and row.
    pub(in crate::imaging) fn new(
        centres: &[[f64; 2]],
        pitch: f64,
        share: impl Fn([f64; 2], [usize; 2]) -> f32,
    ) -> Self {
        const DIRECTIONS: usize = 24;
        let every = (centres.len() / 64).max(1);
        let ring = |fraction: f64| {
            let (mut sum, mut count) = (0.0, 0.0);
            for &centre in centres.iter().step_by(every) {
                for k in 0..DIRECTIONS {
                    let (sin, cos) = (TAU * k as f64 / DIRECTIONS as f64).sin_cos();
                    let reach = fraction * pitch / 2.0;
                    let pixel = [centre[0] + reach * cos, centre[1] + reach * sin].map(|v| v.round() as usize);
                    sum += f64::from(share(centre, pixel));
                    count += 1.0;
                }
            }
            sum / f64::max(count, 1.0)
        };
        let plateau = f64::midpoint(ring(0.1), ring(0.25)).max(1e-6);
        let shares: Vec<f64> = (0..RINGS).map(|k| ring(k as f64 * STEP) / plateau).collect();
        let largest = (MASK_FRACTION / STEP).round() as usize;
        let least = (LEAST_WHOLE / STEP).round() as usize;
        let whole = (least + 1..=largest).rev().find(|&k| shares[k] >= WHOLE_SHARE).unwrap_or(least);
        let edge = edge(&shares, pitch);
        let rings = (0..RINGS).map(|k| edge.map_or([1.0, 0.0, 0.0], |edge| edge.at(radius(k, pitch)))).collect();
        Self { pitch, whole: whole as f64 * STEP, width: edge.map(|edge| edge.width), rings }
    }

    /// A spacing that was measured as `apparent` (px) with masks of this radius (px).
    pub(in crate::imaging) fn corrected(&self, apparent: f64, radius: f64) -> Corrected {
        let untouched = Corrected { spacing: apparent, slope: 1.0, sigma: 0.0 };
        let Some(width) = self.width else { return untouched };
        let shift = apparent - self.pitch;
        let Some([lever, inwards]) = self.pulls(shift, radius) else { return untouched };
        let sign = -shift.signum();
        let target = self.in_focus(width, shift);
        let lever = sign * lever;
        let (mut spacing, mut share) = (apparent, 0.0);
        for _ in 0..4 {
            let blur = target - spacing;
            share = lever / (1.0 + (blur / FINE_PX).powi(2));
            spacing = apparent - inwards - share * blur;
        }
        let pull = share * (target - spacing);
        Corrected { spacing, slope: 1.0 / (1.0 - share).max(0.5), sigma: (DOUBTS[0] * pull).hypot(DOUBTS[1] * inwards) }
    }

    /// How far from the one in focus a spacing is, px: how wide a point is spread out. 0 where no edge is seen.
    pub(in crate::imaging) fn blur(&self, spacing: f64) -> f64 {
        self.width.map_or(0.0, |width| (spacing - self.in_focus(width, spacing - self.pitch)).abs())
    }

    /// In focus the spacing is the pitch less, or more, what a pixel moves by while the edge passes (`width`), as micro-images
    /// are a `shift` apart, px.
    fn in_focus(&self, width: f64, shift: f64) -> f64 {
        self.pitch + shift.signum() * width
    }

    /// What the two effects make of a spacing whose micro-images are a shift (px) apart: px for each px out of focus, and
    /// px. `None` where masks do not overlap.
    fn pulls(&self, shift: f64, radius: f64) -> Option<[f64; 2]> {
        let edge = radius + 0.5;
        // Across the overlap, from the middle between the centres.
        let [half_x, half_y] = [edge - 0.5 * shift.abs(), (edge * edge - 0.25 * shift * shift).max(0.0).sqrt()];
        if half_x <= 0.0 {
            return None;
        }
        let (mut sum, mut weights) = ([0.0; 2], 0.0);
        let place = |k: usize| (k as f64 + 0.5) / POINTS as f64 * 2.0 - 1.0;
        for i in 0..POINTS {
            let x = half_x * place(i);
            for j in 0..POINTS / 2 {
                let y = half_y * place(j);
                let ends = [x - 0.5 * shift, x + 0.5 * shift];
                let (mut weight, mut moved) = (1.0, [0.0; 2]);
                for (end, sign) in ends.into_iter().zip([1.0, -1.0]) {
                    let r = end.hypot(y);
                    let mask = ((edge * edge - r * r) / (2.0 * edge - 1.0)).clamp(0.0, 1.0);
                    let [share, outwards, on_pixel] = self.ring(r);
                    weight *= mask * share;
                    let along = sign * end / r.max(1e-9);
                    moved[0] += along * outwards;
                    moved[1] += along * on_pixel;
                }
                weights += weight;
                sum = [sum[0] + weight * moved[0], sum[1] + weight * moved[1]];
            }
        }
        (weights > 0.0).then(|| [sum[0] / weights, sum[1] / weights])
    }

    fn ring(&self, r: f64) -> [f64; 3] {
        let at = (r / (0.5 * STEP * self.pitch)).min((RINGS - 1) as f64 - 1e-9);
        let (k, t) = (at as usize, at.fract());
        std::array::from_fn(|n| self.rings[k][n] * (1.0 - t) + self.rings[k + 1][n] * t)
    }
}

/// Radius of a ring, px.
fn radius(ring: usize, pitch: f64) -> f64 {
    0.5 * STEP * pitch * ring as f64
}

/// What a pixel sees through: the part of its microlens within the aperture, both as discs about the places that a pixel
/// at the micro-image's centre, and one elsewhere, have on the microlens.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Radius of the aperture's picture, px: a pixel so far out sees through half of its microlens, or a little less.
    aperture: f64,
    /// While the aperture's edge passes over the whole microlens a pixel moves by this, px.
    width: f64,
}

impl Edge {
    /// The share of light at a radius (px), how far outwards the rest of the microlens has its middle, in its diameters,
    /// and how far outwards the light has its middle on the pixel, px.
    fn at(&self, r: f64) -> [f64; 3] {
        let [inner, outer] = [r - HALF_PIXEL, r + HALF_PIXEL].map(|r| self.left(r.abs())[0].max(0.02));
        let [share, middle] = self.left(r);
        [share.max(0.02), middle / self.width, HALF_PIXEL * (outer - inner) / (outer + inner)]
    }

    /// The share of light at a radius (px) and how far outwards what is left of the microlens has its middle, px.
    fn left(&self, r: f64) -> [f64; 2] {
        let (lens, aperture) = (0.5 * self.width, self.aperture);
        let whole = lens.min(aperture).powi(2);
        if r <= (aperture - lens).abs() {
            // One disc lies within the other.
            return [1.0, if aperture < lens { r } else { 0.0 }];
        }
        if r >= aperture + lens {
            return [0.0, 0.0];
        }
        // The discs' rims cross on a chord; on either side of it lies a segment of one of them.
        let chord = (r * r + lens * lens - aperture * aperture) / (2.0 * r);
        let ([of_lens, about_lens], [of_aperture, about_aperture]) =
            (segment(lens, chord), segment(aperture, r - chord));
        let area = of_lens + of_aperture;
        [area / (PI * whole), (about_lens + r * of_aperture - about_aperture) / area.max(1e-12)]
    }

    /// The one that fits the shares of light by ring best, from this one on.
    fn fitted(mut self, rings: &[(f64, f64)]) -> Self {
        for _ in 0..FIT_ROUNDS {
            // Normal equations of the two radii.
            let (mut normal, mut right) = ([0.0; 3], [0.0; 2]);
            for &(r, share) in rings {
                let along = |edge: Self| edge.left(r)[0];
                let off = share - along(self);
                let [up, down] = [FIT_STEP_PX, -FIT_STEP_PX];
                let by_aperture = along(Self { aperture: self.aperture + up, ..self })
                    - along(Self { aperture: self.aperture + down, ..self });
                let by_width =
                    along(Self { width: self.width + up, ..self }) - along(Self { width: self.width + down, ..self });
                let [a, w] = [by_aperture, by_width].map(|by| by / (2.0 * FIT_STEP_PX));
                normal = [normal[0] + a * a, normal[1] + a * w, normal[2] + w * w];
                right = [right[0] + a * off, right[1] + w * off];
            }
            let determinant = normal[0] * normal[2] - normal[1] * normal[1];
            if determinant <= 1e-12 * normal[0] * normal[2] {
                break;
            }
            let most = 0.2 * self.width;
            self.aperture += ((right[0] * normal[2] - right[1] * normal[1]) / determinant).clamp(-most, most);
            self.width += ((right[1] * normal[0] - right[0] * normal[1]) / determinant).clamp(-most, most);
        }
        self
    }
}

/// Area of a disc's segment beyond a chord at a distance from its centre, px², and its moment about the centre, px³.
fn segment(radius: f64, chord: f64) -> [f64; 2] {
    let x = (chord / radius).clamp(-1.0, 1.0);
    let rest = (1.0 - x * x).sqrt();
    [radius.powi(2) * (x.acos() - x * rest), 2.0 / 3.0 * radius.powi(3) * rest.powi(3)]
}

/// Where the aperture's edge lies, from the shares of light by ring.
fn edge(shares: &[f64], pitch: f64) -> Option<Edge> {
    let telling: Vec<(f64, f64)> = shares
        .iter()
        .enumerate()
        .filter(|(_, share)| (TELLING[0]..TELLING[1]).contains(*share))
        .map(|(k, &share)| (radius(k, pitch), share))
        .collect();
    let (&[first, .., last], true) = (&telling[..], telling.len() >= LEAST_RINGS) else { return None };
    // As if the light fell evenly from all to nothing.
    let slope = (first.1 - last.1) / (last.0 - first.0);
    let half = last.0 + (last.1 - 0.5) / slope;
    let edge = Edge { aperture: half, width: 0.8 / slope }.fitted(&telling);
    // A microlens of no real array is passed over in less than a tenth of the pitch, or not within it.
    (slope > 0.0 && edge.aperture > 0.0 && (0.1..1.0).contains(&(edge.width / pitch))).then_some(edge)
}

#[cfg(test)]
mod tests {
    use super::super::masks::mask_radius;
    use super::*;

    const PITCH: f64 = 40.0;

    /// The profile of an aperture with a picture of this radius, whose edge passes over a microlens in `width` (px).
    fn profile(aperture: f64, width: f64) -> Pupil {
        let edge = Edge { aperture, width };
        let share =
            |centre: [f64; 2], [x, y]: [usize; 2]| edge.at((x as f64 - centre[0]).hypot(y as f64 - centre[1]))[0];
        let centres: Vec<[f64; 2]> =
            (0..40).map(|k| [100.0 + 0.37 * f64::from(k), 90.0 + 0.61 * f64::from(k)]).collect();
        Pupil::new(&centres, PITCH, |centre, pixel| share(centre, pixel) as f32)
    }

    #[test]
    fn the_edge_is_found_in_its_profile() {
        for (aperture, width) in [(20.0, 12.0), (20.0, 18.0), (17.0, 9.0), (18.0, 22.0), (17.0, 24.0)] {
            let found = profile(aperture, width).width.unwrap();
            assert!((found / width - 1.0).abs() < 0.02, "{found} for {width}");
        }
        assert_eq!(profile(40.0, 10.0).width, None, "nothing is cut off");
    }

    #[test]
    fn what_is_left_of_a_disc_has_its_middle_where_sums_have_it() {
        for (aperture, r) in [(40.0, 32.0), (12.0, 7.0), (12.0, 13.0), (7.0, 2.0), (7.0, 9.0), (25.0, 3.0)] {
            let edge = Edge { aperture, width: 20.0 };
            let (mut count, mut sum, mut all) = (0.0, 0.0, 0.0);
            for k in 0..400 * 400 {
                let [x, y] = [k % 400, k / 400].map(|n| (f64::from(n) + 0.5) / 20.0 - 10.0);
                if x.hypot(y) < 10.0 {
                    all += f64::from(u8::from(x.hypot(y) < aperture));
                    if (x - r).hypot(y) < aperture {
                        count += 1.0;
                        sum += x;
                    }
                }
            }
            let [share, outwards, _] = edge.at(r);
            assert!((share - count / all).abs() < 2e-3, "{share} of an aperture of {aperture} at {r}");
            assert!((outwards - sum / count / 20.0).abs() < 2e-3, "{outwards} of an aperture of {aperture} at {r}");
        }
    }

    #[test]
    fn spacings_are_pulled_towards_the_one_in_focus_in_both_modes_and_freed_of_it() {
        let pupil = profile(20.0, 18.0);
        for target in [PITCH - 18.0, PITCH + 18.0] {
            for off in [-3.0, 3.0] {
                // What the measurement would say of a spacing so far off focus.
                let radius = mask_radius(&pupil, target + off);
                let freed = |apparent: f64| pupil.corrected(apparent, radius);
                let pull = freed(target + off).spacing - (target + off);
                assert!(pull * off > 0.0, "{pull} px at {off} px from {target}");
                assert!(freed(target + off).sigma > 0.2 * pull.abs());
            }
            // In focus what is left is the light's middle on the pixel.
            let radius = mask_radius(&pupil, target);
            let at_focus = pupil.corrected(target, radius).spacing - target;
            assert!(at_focus.abs() < 0.05 && at_focus != 0.0, "{at_focus}");
        }
        let open = profile(40.0, 10.0).corrected(25.0, 16.0);
        assert_eq!(open, Corrected { spacing: 25.0, slope: 1.0, sigma: 0.0 });
    }
}
