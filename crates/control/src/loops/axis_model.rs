//! What an axis's readings mean: a straight line from reading to true position, learnt from the picture.
//!
//! The prior is the configuration's (scale 1, zero as homed, with their uncertainties); every measurement of the true
//! position sharpens it. Readings are always taken after an approach from the same side, so that backlash is part of
//! the zero.

use bench::device::AxisName;

/// A readback this far from its target means that the controller did not do what it was told, mm.
pub(crate) const READBACK_TOLERANCE_MM: f64 = 0.01;

/// True position against reading: `value = offset + scale (reading − reference)`, with the covariance of offset and
/// scale. Readings and values in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisModel {
    reference: f64,
    mean: [f64; 2],
    covariance: [[f64; 2]; 2],
}

impl AxisModel {
    /// The prior: at the reading `reference` the value is `value` with the standard uncertainty `value_sigma`, and the
    /// scale is 1 with the standard uncertainty `scale_sigma`.
    #[must_use]
    pub fn new(reference: f64, value: f64, value_sigma: f64, scale_sigma: f64) -> Self {
        assert!(value_sigma >= 0.0 && scale_sigma >= 0.0, "an uncertainty is not negative");
        Self {
            reference,
            mean: [value, 1.0],
            covariance: [[value_sigma * value_sigma, 0.0], [0.0, scale_sigma * scale_sigma]],
        }
    }

    /// A line that is known: its value at `reference`, its scale, and their covariance.
    #[must_use]
    pub const fn known(reference: f64, mean: [f64; 2], covariance: [[f64; 2]; 2]) -> Self {
        Self { reference, mean, covariance }
    }

    /// Takes in a measurement of the true position at a reading (a Kalman update).
    pub fn observe(&mut self, reading: f64, value: f64, sigma: f64) {
        assert!(sigma > 0.0, "a measurement needs a positive uncertainty");
        let h = [1.0, reading - self.reference];
        let p = self.covariance;
        let ph = [p[0][0] * h[0] + p[0][1] * h[1], p[1][0] * h[0] + p[1][1] * h[1]];
        let variance = h[0] * ph[0] + h[1] * ph[1] + sigma * sigma;
        let innovation = value - (self.mean[0] + self.mean[1] * h[1]);
        for i in 0..2 {
            self.mean[i] += ph[i] / variance * innovation;
            for j in 0..2 {
                self.covariance[i][j] = p[i][j] - ph[i] * ph[j] / variance;
            }
        }
    }

    /// The value expected at a reading and its standard uncertainty, mm.
    #[must_use]
    pub fn predict(&self, reading: f64) -> (f64, f64) {
        let x = reading - self.reference;
        let p = self.covariance;
        let variance = p[0][0] + 2.0 * x * p[0][1] + x * x * p[1][1];
        (self.mean[0] + self.mean[1] * x, variance.max(0.0).sqrt())
    }

    /// True travel over commanded travel, and its standard uncertainty.
    #[must_use]
    pub fn scale(&self) -> (f64, f64) {
        (self.mean[1], self.covariance[1][1].max(0.0).sqrt())
    }

    /// That all moves together have shown another scale than can be learnt, where each was too short to tell: which axis, and its
    /// reading now, mm.
    #[must_use]
    pub fn fault(&self, axis: AxisName, reading: f64) -> Option<MoveFault> {
        let (scale, sigma) = self.scale();
        let expected_mm = reading - self.reference;
        let beyond = (scale - 1.0).abs() - 4.0 * sigma > SCALE_FAULT;
        beyond.then_some(MoveFault::WrongScale { axis, expected_mm, measured_mm: scale * expected_mm })
    }

    /// The reading at which the value is expected, mm.
    #[must_use]
    pub fn reading_for(&self, value: f64) -> f64 {
        self.reference + (value - self.mean[0]) / self.mean[1]
    }
}

/// Why a picture does not show the move that was made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MoveFault {
    /// The picture did not change.
    #[error(
        "the {axis} axis does not move: the picture shows {measured_mm:.3} mm of the {expected_mm:.3} mm commanded; check the motor, its driver and the coupling, and home the axis before anything else, as it may not stand where it reads"
    )]
    NotMoving {
        /// Which axis.
        axis: AxisName,
        /// The travel expected, mm.
        expected_mm: f64,
        /// The travel seen, mm.
        measured_mm: f64,
    },
    /// The picture changed the other way.
    #[error(
        "the {axis} axis moves the wrong way: the picture shows {measured_mm:.3} mm for {expected_mm:.3} mm commanded; change `reversed` in [bench.{axis}]"
    )]
    Reversed {
        /// Which axis.
        axis: AxisName,
        /// The travel expected, mm.
        expected_mm: f64,
        /// The travel seen, mm.
        measured_mm: f64,
    },
    /// The picture changed by another amount.
    #[error(
        "the {axis} axis has the wrong scale or slips: the picture shows {measured_mm:.3} mm for {expected_mm:.3} mm expected; check `steps_per_mm` in [bench.{axis}] and the coupling, and home the axis before anything else, as it may not stand where it reads"
    )]
    WrongScale {
        /// Which axis.
        axis: AxisName,
        /// The travel expected, mm.
        expected_mm: f64,
        /// The travel seen, mm.
        measured_mm: f64,
    },
}

impl MoveFault {
    /// The axis that did not follow.
    #[must_use]
    pub const fn axis(&self) -> AxisName {
        match *self {
            Self::NotMoving { axis, .. } | Self::Reversed { axis, .. } | Self::WrongScale { axis, .. } => axis,
        }
    }

    /// Whether the picture shows less of a way than was made.
    #[must_use]
    pub fn is_short(&self) -> bool {
        match *self {
            Self::NotMoving { .. } => true,
            Self::Reversed { .. } => false,
            Self::WrongScale { expected_mm, measured_mm, .. } => measured_mm.abs() < expected_mm.abs(),
        }
    }

    /// Whether the axis stands so far from where it reads that no rule may go by that. A trim that sticks is no such case.
    #[must_use]
    pub fn is_astray(&self) -> bool {
        match *self {
            Self::NotMoving { expected_mm, measured_mm, .. }
            | Self::Reversed { expected_mm, measured_mm, .. }
            | Self::WrongScale { expected_mm, measured_mm, .. } => (expected_mm - measured_mm).abs() > ASTRAY_MM,
        }
    }
}

/// A tenth of what is usually kept clear between the lens and where it touches the shell, mm.
const ASTRAY_MM: f64 = 0.05;
/// Travel that says something about a scale must be this many times its uncertainty.
pub(crate) const TELLING: f64 = 6.0;
/// One that is seen to follow, this many times.
const FOLLOWED: f64 = 2.0;
/// A scale error beyond this, relative to the travel expected, is a fault and not a calibration.
pub(crate) const SCALE_FAULT: f64 = 0.3;

/// Compares the travel the picture shows with the one expected. `sigma_mm` is the standard uncertainty of
/// `measured_mm`, `slack_mm` what backlash may take away. `None` where they agree or nothing can be told.
#[must_use]
pub fn check_move(
    axis: AxisName,
    expected_mm: f64,
    measured_mm: f64,
    sigma_mm: f64,
    slack_mm: f64,
) -> Option<MoveFault> {
    if agrees(expected_mm, measured_mm, sigma_mm, slack_mm) {
        return None;
    }
    let telling = expected_mm.abs() > TELLING * sigma_mm;
    if telling && measured_mm.abs() <= 3.0 * sigma_mm + slack_mm.min(0.3 * expected_mm.abs()) {
        return Some(MoveFault::NotMoving { axis, expected_mm, measured_mm });
    }
    if measured_mm * expected_mm < 0.0 {
        return Some(MoveFault::Reversed { axis, expected_mm, measured_mm });
    }
    Some(MoveFault::WrongScale { axis, expected_mm, measured_mm })
}

/// Whether the travel that the picture shows is the one expected, as far as can be told.
fn agrees(expected_mm: f64, measured_mm: f64, sigma_mm: f64, slack_mm: f64) -> bool {
    (measured_mm - expected_mm).abs() <= SCALE_FAULT * expected_mm.abs() + 4.0 * sigma_mm + slack_mm
}

/// Whether the picture has followed a move: it says enough of it to tell, does not contradict it, and is nearer to what was
/// expected than to no move at all. `sigma_mm` is the standard uncertainty of `measured_mm`.
#[must_use]
pub(crate) fn follows(expected_mm: f64, measured_mm: f64, sigma_mm: f64) -> bool {
    expected_mm.abs() > FOLLOWED * sigma_mm
        && measured_mm * expected_mm.signum() > 0.5 * expected_mm.abs()
        && agrees(expected_mm, measured_mm, sigma_mm, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_measurements_give_zero_and_scale() {
        let mut model = AxisModel::new(0.0, 0.0, 0.2, 0.05);
        let truth = |x: f64| 0.031 + 1.05 * x;
        model.observe(0.0, truth(0.0), 0.001);
        model.observe(0.5, truth(0.5), 0.001);
        let (scale, scale_sigma) = model.scale();
        assert!((scale - 1.05).abs() < 3.0 * scale_sigma && scale_sigma < 0.003, "{scale} ± {scale_sigma}");
        let reading = model.reading_for(2.0);
        let (value, sigma) = model.predict(reading);
        assert!((value - 2.0).abs() < 1e-12);
        assert!((truth(reading) - 2.0).abs() < 3.0 * sigma, "{}", truth(reading) - 2.0);
    }

    #[test]
    fn without_measurements_the_configuration_stands() {
        let model = AxisModel::new(30.0, 30.0, 0.2, 0.05);
        let (value, sigma) = model.predict(0.0);
        assert!((value - 0.0).abs() < 1e-12);
        assert!((sigma - (0.04f64 + 2.25).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn faults_are_told_apart() {
        assert_eq!(check_move(AxisName::E, -0.5, -0.52, 0.01, 0.05), None);
        assert_eq!(check_move(AxisName::E, -0.5, -0.47, 0.01, 0.05), None);
        assert!(matches!(check_move(AxisName::E, -0.5, 0.001, 0.01, 0.05), Some(MoveFault::NotMoving { .. })));
        assert!(matches!(check_move(AxisName::E, -0.5, 0.5, 0.01, 0.05), Some(MoveFault::Reversed { .. })));
        assert!(matches!(check_move(AxisName::E, -0.5, -1.0, 0.01, 0.05), Some(MoveFault::WrongScale { .. })));
        // Nothing can be told from a move that drowns in its uncertainty.
        assert_eq!(check_move(AxisName::E, -0.02, 0.03, 0.02, 0.05), None);
        // An axis that does not move is not where it reads; by what a trim of it sticks it is.
        assert!(check_move(AxisName::Focus, -0.5, 0.001, 0.01, 0.05).unwrap().is_astray());
        assert!(!check_move(AxisName::Focus, 0.03, 0.0, 0.001, 0.002).unwrap().is_astray());
        assert!(follows(-0.5, -0.55, 0.01) && !follows(-0.5, -0.55, 0.3));
        // Neither a dead axis nor a reversed one is followed, however little is known.
        for sigma in [0.02, 0.05, 0.1, 0.2] {
            assert!(
                !follows(-0.5, 0.001, sigma) && !follows(-0.5, 0.5, sigma) && follows(-0.5, -0.5, sigma),
                "{sigma}"
            );
        }
    }
}
