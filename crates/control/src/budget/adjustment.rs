//! Measurements and what was known before, put together: the most probable values, what they are uncertain by, and what
//! each thing known or measured has a part in.

use nalgebra::{DMatrix, DVector};

/// Rounds of Gauss and Newton at the most: an alignment's equations are nearly straight, so that three do as a rule.
const ROUNDS: usize = 12;
/// How often a step is halved that leads uphill, as the equations bend on its way.
const HALVINGS: usize = 10;
/// A round that moves no unknown by more than this, in units of its standard uncertainty beforehand, is the last: the slopes
/// where it began are those where it ended.
const SETTLED: f64 = 1e-5;
/// By how much an unknown is moved for a slope, in units of its standard uncertainty beforehand.
const STEP: f64 = 1e-3;
/// What is no further off than so many standard uncertainties goes together: of some ten that could be, one is in ten cases.
const GOES_TOGETHER: f64 = 2.5;

/// A measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// What was measured.
    pub(super) value: f64,
    /// Its standard uncertainty, in the same unit.
    pub(super) sigma: f64,
}

/// The most probable values.
#[derive(Debug, Clone)]
pub(super) struct Adjusted {
    /// The unknowns, in units of what each was uncertain by beforehand: 0 is as was thought.
    pub(super) unknowns: DVector<f64>,
    /// Their covariance.
    pub(super) covariance: DMatrix<f64>,
    /// By what each measurement moves them, times its standard uncertainty: a column a measurement.
    moves: DMatrix<f64>,
    /// What is left of each measurement, in units of what can be expected of it.
    pub(super) left: Vec<f64>,
    /// By how much more than its standard uncertainties say each result is uncertain: where what was thought and what was
    /// measured do not go together, one of them is wrong by what they are apart, and nobody knows which.
    strain: f64,
}

impl Adjusted {
    /// The unknowns of which `predicted` says what is measured, each known beforehand to be 0 ± 1. `None` where it has no
    /// finite solution.
    pub(super) fn find(
        count: usize,
        measured: &[Measured],
        predicted: impl Fn(&DVector<f64>) -> Vec<f64>,
    ) -> Option<Self> {
        let mut unknowns = DVector::zeros(count);
        // Weighted: every measurement in units of its own uncertainty.
        let weighted = |values: Vec<f64>| {
            DVector::from_iterator(measured.len(), values.iter().zip(measured).map(|(value, m)| value / m.sigma))
        };
        let seen = weighted(measured.iter().map(|m| m.value).collect());
        let slopes = |at: &DVector<f64>| slopes(at, measured.len(), |unknowns| weighted(predicted(unknowns)));
        let off = |at: &DVector<f64>| (&seen - weighted(predicted(at))).norm_squared() + at.norm_squared();
        let mut settled = None;
        for _ in 0..ROUNDS {
            let slopes = slopes(&unknowns);
            let residual = &seen - weighted(predicted(&unknowns));
            let normal = DMatrix::identity(count, count) + slopes.transpose() * &slopes;
            let mut step = normal.cholesky()?.solve(&(slopes.transpose() * residual - &unknowns));
            let here = off(&unknowns);
            for _ in 0..HALVINGS {
                if off(&(&unknowns + &step)) <= here {
                    break;
                }
                step *= 0.5;
            }
            unknowns += &step;
            if step.amax() < SETTLED {
                settled = Some(slopes);
                break;
            }
        }
        let slopes = settled.unwrap_or_else(|| slopes(&unknowns));
        let covariance = (DMatrix::identity(count, count) + slopes.transpose() * &slopes).cholesky()?.inverse();
        let residual = seen - weighted(predicted(&unknowns));
        let expected = DMatrix::identity(measured.len(), measured.len()) - &slopes * &covariance * slopes.transpose();
        let left = residual.iter().enumerate().map(|(k, left)| left / expected[(k, k)].max(f64::EPSILON).sqrt());
        let left: Vec<f64> = left.collect();
        let moves = &covariance * slopes.transpose();
        let mut found = Self { unknowns, covariance, moves, left, strain: 1.0 };
        let pulls = (0..count).map(|unknown| found.pull(unknown));
        let furthest = pulls.chain(found.left.iter().copied()).fold(0.0, |most: f64, off| most.max(off.abs()));
        found.strain = (furthest / GOES_TOGETHER).max(1.0);
        found.unknowns.iter().all(|unknown| unknown.is_finite()).then_some(found)
    }

    /// By how many standard uncertainties what was thought of an unknown is away from what the measurements say of it.
    pub(super) fn pull(&self, unknown: usize) -> f64 {
        self.unknowns[unknown] / self.told(unknown).max(f64::EPSILON).sqrt()
    }

    /// What the measurements alone say of an unknown, in units of what it was uncertain by; `None` where they say nothing.
    pub(super) fn without(&self, unknown: usize) -> Option<Measured> {
        const SAYS: f64 = 0.01;
        let told = self.told(unknown);
        (told > SAYS).then(|| Measured {
            value: self.unknowns[unknown] / told,
            sigma: (self.covariance[(unknown, unknown)] / told).sqrt(),
        })
    }

    /// The share of an unknown's variance beforehand that the measurements have taken away.
    fn told(&self, unknown: usize) -> f64 {
        1.0 - self.covariance[(unknown, unknown)]
    }

    /// What a result with these slopes against the unknowns is uncertain by.
    pub(super) fn sigma(&self, slopes: &DVector<f64>) -> f64 {
        self.covariance_of(slopes, slopes).max(0.0).sqrt()
    }

    /// The covariance of two results.
    pub(super) fn covariance_of(&self, one: &DVector<f64>, other: &DVector<f64>) -> f64 {
        self.strain.powi(2) * (one.transpose() * &self.covariance * other)[0]
    }

    /// What a result is uncertain by because an unknown was: these, and those of the measurements, squared add up to its
    /// variance.
    pub(super) fn by_unknown(&self, slopes: &DVector<f64>, unknown: usize) -> f64 {
        self.strain * (slopes.transpose() * self.covariance.column(unknown))[0].abs()
    }

    /// What a result is uncertain by because a measurement was.
    pub(super) fn by_measurement(&self, slopes: &DVector<f64>, measurement: usize) -> f64 {
        self.strain * (slopes.transpose() * self.moves.column(measurement))[0].abs()
    }
}

/// How so many values change with the unknowns: a row a value.
pub(super) fn slopes(at: &DVector<f64>, rows: usize, values: impl Fn(&DVector<f64>) -> DVector<f64>) -> DMatrix<f64> {
    let mut slopes = DMatrix::zeros(rows, at.len());
    for unknown in 0..at.len() {
        let beside = |way: f64| {
            let mut moved = at.clone();
            moved[unknown] += way;
            values(&moved)
        };
        slopes.set_column(unknown, &((beside(STEP) - beside(-STEP)) / (2.0 * STEP)));
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two unknowns of which only the sum is measured, and one of them besides.
    fn adjusted(sum: f64, one: f64) -> Adjusted {
        let measured = [Measured { value: sum, sigma: 0.1 }, Measured { value: one, sigma: 0.5 }];
        Adjusted::find(2, &measured, |u| vec![u[0] + u[1], u[0]]).unwrap()
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        let adjusted = adjusted(0.3, -0.2);
        for slopes in [[1.0, 0.0], [1.0, 1.0], [0.5, -2.0]] {
            let slopes = DVector::from_row_slice(&slopes);
            let by_unknowns: f64 = (0..2).map(|k| adjusted.by_unknown(&slopes, k).powi(2)).sum();
            let by_measurements: f64 = (0..2).map(|k| adjusted.by_measurement(&slopes, k).powi(2)).sum();
            let whole = adjusted.sigma(&slopes).powi(2);
            assert!(
                ((by_unknowns + by_measurements) / whole - 1.0).abs() < 1e-9,
                "{by_unknowns} {by_measurements} {whole}"
            );
        }
        // Their sum is known as well as it is measured, either alone hardly better than one of them is.
        assert!(adjusted.sigma(&DVector::from_row_slice(&[1.0, 1.0])) < 0.1);
        assert!(adjusted.sigma(&DVector::from_row_slice(&[1.0, 0.0])) > 0.4);
    }

    #[test]
    fn a_contradiction_is_seen() {
        let fits = adjusted(0.3, -0.2);
        assert!((0..2).all(|k| fits.pull(k).abs() < 1.0) && fits.left.iter().all(|left| left.abs() < 1.0), "{fits:?}");
        let not = adjusted(12.0, 6.0);
        assert!(not.pull(1).abs() > 4.0, "{not:?}");
        let alone = not.without(1).unwrap();
        assert!((alone.value - 6.0).abs() < 3.0 * alone.sigma, "{alone:?}");
        // Whichever of the two is wrong, results are as uncertain as that makes them.
        let of = DVector::from_row_slice(&[1.0, 0.0]);
        assert!(not.sigma(&of) > 1.5 * fits.sigma(&of), "{} {}", not.sigma(&of), fits.sigma(&of));
    }

    #[test]
    fn a_step_that_is_too_long_is_shortened() {
        let measured = [Measured { value: 0.0, sigma: 0.01 }];
        let adjusted = Adjusted::find(1, &measured, |u| vec![(3.0 * (u[0] - 2.0)).atan()]).unwrap();
        assert!((adjusted.unknowns[0] - 2.0).abs() < 1e-3 && adjusted.left[0].abs() < 3.0, "{adjusted:?}");
    }

    #[test]
    fn what_is_measured_alone_is_what_is_measured() {
        let measured = [Measured { value: 2.0, sigma: 0.5 }];
        let adjusted = Adjusted::find(1, &measured, |u| vec![u[0]]).unwrap();
        let alone = adjusted.without(0).unwrap();
        assert!((alone.value - 2.0).abs() < 1e-9 && (alone.sigma - 0.5).abs() < 1e-9, "{alone:?}");
        assert!((adjusted.unknowns[0] - 1.6).abs() < 1e-9, "{adjusted:?}");
    }
}
