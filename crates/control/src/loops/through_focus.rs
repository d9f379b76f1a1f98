//! Best focus by a sweep: curves through what was seen on the way, and what their scatter makes of it. Pure.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Points of a curve that is drawn.
const DRAWN: u32 = 41;
/// Highest degree of the curve through the spacings.
const MOST_DEGREE: usize = 3;
/// A further degree has to lower the scatter to this share.
const WORTH: f64 = 0.7;
/// Least points of a curve more than it has terms.
const SPARE: usize = 2;
/// EOGs above this share of the way from the least to the greatest are at the peak.
const PEAK_ABOVE: f64 = 0.5;
/// A peak is so many times higher than the sweep's least EOG, and bends so many of its standard uncertainties down: noise
/// alone has a greatest value, too.
const PEAK_RISE: f64 = 1.1;
const PEAK_SIGMAS: f64 = 4.0;

/// What was seen at a position of the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    pub(crate) position_mm: f64,
    pub(crate) value: f64,
    /// Its standard uncertainty; where only the scatter tells that, how it compares with the others'.
    pub(crate) sigma: f64,
}

/// A place of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CurvePoint {
    /// Position of the axis, mm.
    pub position_mm: f64,
    /// The curve there, in the unit of what it goes through.
    pub value: f64,
}

/// A place of the swept axis, by a curve fitted to what was seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FittedPlace {
    /// Position of the axis, mm.
    pub position_mm: f64,
    /// Its standard uncertainty, by the points' own or by their scatter about the curve, whichever is greater, mm; a peak's
    /// with what the curve's shape may be other than a peak's.
    pub sigma_mm: f64,
    /// Points that the curve goes through.
    pub points: u32,
    /// The curve, over those.
    pub curve: Vec<CurvePoint>,
}

/// Where a curve through spacings meets the target, and how steep it is there.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct BestFocus {
    pub(crate) place: FittedPlace,
    /// The spacing's change by the axis, in the spacing's unit per mm.
    pub(crate) slope: f64,
}

/// A polynomial in t, which is −1 and 1 at the ends of the points.
struct Polynomial {
    middle_mm: f64,
    half_mm: f64,
    terms: DVector<f64>,
    /// Their covariance, scatter counted.
    covariance: DMatrix<f64>,
    /// χ² by the degrees of freedom.
    scatter: f64,
}

impl Polynomial {
    /// The weighted least-squares fit; `None` where the points do not tell it. Where the uncertainties are `known`, scatter
    /// beyond them adds to the terms' own; otherwise it is all that they go by.
    fn fit(points: &[Point], degree: usize, known: bool) -> Option<Self> {
        let terms = degree + 1;
        let spare = points.len().checked_sub(terms).filter(|spare| *spare > 0)?;
        let places = || points.iter().map(|point| point.position_mm);
        let (low, high) = (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
        let (middle_mm, half_mm) = (f64::midpoint(low, high), (high - low) / 2.0);
        if half_mm <= 0.0 {
            return None;
        }
        let weight = |point: &Point| 1.0 / point.sigma;
        let design = DMatrix::from_fn(points.len(), terms, |row, term| {
            let point = &points[row];
            weight(point) * ((point.position_mm - middle_mm) / half_mm).powi(term as i32)
        });
        let values = DVector::from_iterator(points.len(), points.iter().map(|point| weight(point) * point.value));
        let inverse = (design.transpose() * &design).try_inverse()?;
        let fitted = &inverse * design.transpose() * &values;
        let scatter = (&design * &fitted - &values).norm_squared() / spare as f64;
        let factor = if known { scatter.max(1.0) } else { scatter };
        Some(Self { middle_mm, half_mm, terms: fitted, covariance: inverse * factor, scatter })
    }

    fn t(&self, position_mm: f64) -> f64 {
        (position_mm - self.middle_mm) / self.half_mm
    }

    fn at(&self, t: f64) -> f64 {
        self.terms.iter().rev().fold(0.0, |sum, term| sum * t + term)
    }

    fn slope(&self, t: f64) -> f64 {
        self.terms.iter().enumerate().skip(1).map(|(n, term)| n as f64 * term * t.powi(n as i32 - 1)).sum()
    }

    fn curvature(&self, t: f64) -> f64 {
        let of = |n: usize| (n * (n - 1)) as f64 * t.powi(n as i32 - 2);
        self.terms.iter().enumerate().skip(2).map(|(n, term)| of(n) * term).sum()
    }

    /// Where a curve of the second or third degree is greatest; `None` where it nowhere is.
    fn top(&self) -> Option<f64> {
        let (slope, bend, twist) =
            (self.slope(0.0), self.curvature(0.0), self.terms.get(3).map_or(0.0, |term| 6.0 * term));
        // The slope is slope + bend·t + twist·t²/2, and falls through zero there.
        let root = bend.mul_add(bend, -2.0 * twist * slope).sqrt();
        let t = 2.0 * slope / (root - bend);
        t.is_finite().then_some(t)
    }

    /// Standard uncertainty of the curvature in the middle.
    fn curvature_sigma(&self) -> f64 {
        2.0 * self.covariance[(2, 2)].sqrt()
    }

    /// The place `at_t`, uncertain by what the terms are: t changes by −gradient/steepness of each.
    fn place(
        &self,
        at_t: f64,
        gradient: impl Fn(usize) -> f64,
        steepness: f64,
        points: &[Point],
        drawn: impl Fn(f64) -> f64,
    ) -> Option<FittedPlace> {
        let gradient = DVector::from_fn(self.terms.len(), |term, _| gradient(term) / steepness);
        let variance = (gradient.transpose() * &self.covariance * &gradient)[(0, 0)];
        let sigma_mm = variance.sqrt() * self.half_mm;
        let step = |n: u32| self.half_mm.mul_add(2.0 * f64::from(n) / f64::from(DRAWN - 1) - 1.0, self.middle_mm);
        let curve = (0..DRAWN)
            .map(|n| CurvePoint { position_mm: step(n), value: drawn(self.at(self.t(step(n)))) })
            .filter(|point| point.value.is_finite())
            .collect();
        let position_mm = self.half_mm.mul_add(at_t, self.middle_mm);
        let found = FittedPlace { position_mm, sigma_mm, points: points.len() as u32, curve };
        (position_mm.is_finite() && sigma_mm.is_finite()).then_some(found)
    }
}

/// Where a curve through the spacings meets the target, for microlenses `pitch` apart, all in one unit. The curve is one of
/// N = pitch/(pitch − spacing), which is a straight line over the focus axis's travel, and of the lowest degree that leaves
/// no more scatter than it has to. `None` where there are too few, or it does not.
pub(crate) fn by_spacing(points: &[Point], target: f64, pitch: f64) -> Option<BestFocus> {
    let n_of = |spacing: f64| pitch / (pitch - spacing);
    let points: Vec<Point> = points
        .iter()
        .map(|point| {
            let n = n_of(point.value);
            Point { value: n, sigma: n * n * point.sigma / pitch, ..*point }
        })
        .filter(|point| point.value.is_finite())
        .collect();
    let most = MOST_DEGREE.min(points.len().checked_sub(1 + SPARE)?);
    let mut curve = Polynomial::fit(&points, 1, true).filter(|_| most >= 1)?;
    for degree in 2..=most {
        let Some(finer) = Polynomial::fit(&points, degree, true) else { break };
        if finer.scatter < WORTH * curve.scatter && curve.scatter > 1.0 {
            curve = finer;
        }
    }
    let n = n_of(target);
    let t = crossing(&curve, n)?;
    let place = curve.place(t, |term| t.powi(term as i32), curve.slope(t), &points, |n| pitch * (1.0 - 1.0 / n))?;
    Some(BestFocus { place, slope: pitch / (n * n) * curve.slope(t) / curve.half_mm })
}

/// Where a curve meets a value between −1 and 1, the place nearest to the middle.
fn crossing(curve: &Polynomial, value: f64) -> Option<f64> {
    const PIECES: u32 = 200;
    let ends = |n: u32| 2.0 * f64::from(n) / f64::from(PIECES) - 1.0;
    let off = |t: f64| curve.at(t) - value;
    let found = (0..PIECES).filter_map(|n| {
        let (mut low, mut high) = (ends(n), ends(n + 1));
        if off(low) * off(high) > 0.0 {
            return None;
        }
        for _ in 0..50 {
            let middle = f64::midpoint(low, high);
            if off(low) * off(middle) > 0.0 { low = middle } else { high = middle }
        }
        Some(f64::midpoint(low, high))
    });
    found.min_by(|one, other| one.abs().total_cmp(&other.abs()))
}

/// Where a curve through the logarithms of the greatest EOGs is greatest. A parabola tells whether there is a peak, and a
/// cubic where: on one side of focus the EOG falls faster than on the other. What the third degree moves the peak by, the
/// degrees after it may move it by half. `None` where the greatest is at an end of the sweep, or stands out too little for a
/// peak. All EOGs count as equally uncertain, and so their logarithms the more the less they are.
pub(crate) fn by_eog(points: &[Point]) -> Option<FittedPlace> {
    let mut points: Vec<Point> = points.iter().copied().filter(|point| point.value > 0.0).collect();
    points.sort_by(|one, other| one.position_mm.total_cmp(&other.position_mm));
    let best = (0..points.len()).max_by(|&one, &other| points[one].value.total_cmp(&points[other].value))?;
    let least = points.iter().map(|point| point.value).fold(f64::INFINITY, f64::min);
    let above = least + PEAK_ABOVE * (points[best].value - least);
    let low = points[..best].iter().rposition(|point| point.value < above).map_or(0, |place| place + 1);
    let high = points[best..].iter().position(|point| point.value < above).map_or(points.len(), |place| best + place);
    // A narrow peak takes its feet along: two points on either side at the least.
    let (low, high) = (low.min(best.saturating_sub(2)), high.max((best + 3).min(points.len())));
    let peak: Vec<Point> = points[low..high]
        .iter()
        .map(|point| Point { value: point.value.ln(), sigma: 1.0 / point.value, ..*point })
        .collect();
    let (parabola, cubic) = (Polynomial::fit(&peak, 2, false)?, Polynomial::fit(&peak, 3, false)?);
    let stands_out =
        points[best].value > PEAK_RISE * least && -parabola.curvature(0.0) > PEAK_SIGMAS * parabola.curvature_sigma();
    let (even, t) = (parabola.top()?, cubic.top()?);
    if !stands_out || even.abs() >= 1.0 || t.abs() >= 1.0 {
        return None;
    }
    let gradient = |term: usize| if term == 0 { 0.0 } else { term as f64 * t.powi(term as i32 - 1) };
    let found = cubic.place(t, gradient, cubic.curvature(t), &peak, f64::exp)?;
    let beyond_mm = (t - even) / 2.0 * cubic.half_mm;
    Some(FittedPlace { sigma_mm: found.sigma_mm.hypot(beyond_mm), ..found })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scatter of one standard deviation, about the same each time.
    fn scatter(n: usize) -> f64 {
        [0.9, -1.2, 0.3, 1.1, -0.7, -1.0, 1.3, 0.2, -0.4, 0.8, -1.3][n % 11]
    }

    fn sweep(count: usize, from: f64, to: f64, sigma: f64, value: impl Fn(f64) -> f64) -> Vec<Point> {
        let place = |n: usize| from + (to - from) * n as f64 / (count - 1) as f64;
        (0..count)
            .map(|n| Point { position_mm: place(n), value: value(place(n)) + sigma * scatter(n), sigma })
            .collect()
    }

    #[test]
    fn the_spacings_curve_meets_the_target_within_its_uncertainty_and_better_than_two_points_tell() {
        // 1/(c − x), as of a camera whose array is moved.
        let spacing = |x: f64| 24.0 - 30.0 / (9.0 - x);
        let truth = 9.0 - 30.0 / (24.0 - 19.7);
        // With another pitch N is bent, as along the other axis: more terms follow it.
        for (count, pitch) in [(5, 24.0), (11, 24.0), (21, 24.0), (11, 29.0), (21, 29.0)] {
            let points = sweep(count, 1.0, 3.0, 0.002, spacing);
            let BestFocus { place: best, slope } = by_spacing(&points, 19.7, pitch).unwrap();
            let steep = -30.0 / (9.0f64 - truth).powi(2);
            assert!((slope / steep - 1.0).abs() < 0.01, "{count}, {pitch}: {slope} for {steep} px/mm");
            assert!((best.position_mm - truth).abs() < 3.0 * best.sigma_mm, "{count}: {best:?} for {truth}");
            let of_two = 0.002 / 0.6;
            assert!((0.1 * of_two..of_two).contains(&best.sigma_mm), "{count}, {pitch}: {best:?}");
            let off = best.curve.iter().map(|at| (at.value - spacing(at.position_mm)).abs()).fold(0.0, f64::max);
            assert!(best.curve.len() == DRAWN as usize && off < 0.01, "{off}");
        }
        assert_eq!(by_spacing(&sweep(11, 1.0, 3.0, 0.002, spacing), 25.0, 24.0), None);
        assert_eq!(by_spacing(&sweep(3, 1.0, 3.0, 0.002, spacing), 19.7, 24.0), None, "three points show no scatter");
        // What no curve follows makes it uncertain.
        let rough = by_spacing(
            &sweep(11, 1.0, 3.0, 0.1, spacing).iter().map(|p| Point { sigma: 0.002, ..*p }).collect::<Vec<_>>(),
            19.7,
            24.0,
        );
        assert!(rough.unwrap().place.sigma_mm > 0.03);
        // Noise has left no two points astride the target, and the curve meets it all the same.
        let mut beside: Vec<Point> =
            sweep(11, 1.0, 3.0, 0.0, spacing).into_iter().map(|point| Point { sigma: 0.02, ..point }).collect();
        beside[10].value += 0.03;
        assert!(beside.iter().all(|point| point.value > 19.02));
        let met = by_spacing(&beside, 19.02, 24.0).unwrap();
        assert!((met.place.position_mm - 3.0).abs() < 0.03 && (met.slope + 30.0 / 36.0).abs() < 0.05, "{met:?}");
    }

    #[test]
    fn the_eogs_peak_is_found_within_its_uncertainty_and_none_where_there_is_none() {
        let eog = |x: f64| 40.0 + 300.0 / (1.0 + (x - 2.2) * (x - 2.2) / 0.16);
        for count in [11, 15, 31] {
            let best = by_eog(&sweep(count, 1.0, 3.0, 2.0, eog)).unwrap();
            assert!((best.position_mm - 2.2).abs() < 3.0 * best.sigma_mm, "{count}: {best:?}");
            assert!(best.sigma_mm < 0.1, "{count}: {best:?}");
        }
        // One that is wider on one side.
        let skewed = |x: f64| {
            let width = 0.4 * 0.3f64.mul_add(((x - 2.2) / 0.4).tanh(), 1.0);
            40.0 + 300.0 / (1.0 + ((x - 2.2) / width).powi(2))
        };
        for (count, from) in [(7, 1.2), (11, 1.0), (11, 1.1), (21, 1.0), (21, 1.3), (31, 1.0)] {
            let best = by_eog(&sweep(count, from, from + 2.0, 2.0, skewed)).unwrap();
            assert!((best.position_mm - 2.2).abs() < 2.0 * best.sigma_mm, "{count} from {from}: {best:?}");
        }
        assert_eq!(by_eog(&sweep(11, 2.4, 4.0, 0.0, eog)), None, "it only falls");
        assert_eq!(by_eog(&sweep(4, 1.0, 3.0, 0.0, eog)), None);
        for count in [7, 11, 21] {
            assert_eq!(by_eog(&sweep(count, 1.0, 3.0, 2.0, |_| 200.0)), None, "noise of a hundredth has no peak");
            assert_eq!(by_eog(&sweep(count, 1.0, 3.0, 20.0, |_| 200.0)), None, "nor has one of a tenth");
        }
        assert_eq!(by_eog(&[]), None);
    }
}
