//! What one pair says about the spacing, both orders taken together.

use super::compare::Moments;
use super::tile::SLOPE_NOISE;
use crate::imaging::spacing::MODEL_SHARE;

/// What one pair says.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PairScore {
    /// Sum of the two scores; NaN where the two could not be compared.
    pub(super) score: f32,
    /// Sum of their derivatives: the information about the spacing.
    pub(super) information: f32,
    /// Mean squared residual in units of the noise's.
    pub(super) residual: f32,
    /// The same in units of what noise and the model's limits leave: 1 and less where the two match.
    pub(super) misfit: f32,
    /// Noise-free covariance and variances of the contents, for the correlation.
    pub(super) covariance: f32,
    pub(super) variances: [f32; 2],
    /// The noise's share that was taken out of each.
    pub(super) noise: f32,
    /// About what the noise of one grey level makes of the score's variance.
    pub(super) random: f32,
}

/// The score of one order of a pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Order {
    pub(super) score: f64,
    pub(super) information: f64,
    residual: f64,
    misfit: f64,
    /// Gain of the slope's orthogonalisation and the factor that keeps pure noise from counting.
    pub(super) projection: f64,
    pub(super) trust: f64,
}

impl Order {
    /// From the moments, at a noise of so many grey levels.
    #[inline(always)]
    pub(super) fn new(m: &Moments, noise: f64) -> Self {
        let share = noise * noise * m.pixels;
        // Where a micro-image is flat, its moments are rounding errors: never less than the noise would make.
        let clean = |moment: f64| (moment - share).max(0.25 * moment).max(0.25 * share).max(1e-9);
        let (aa, bb) = (clean(m.aa), clean(m.bb));
        let gain = (aa / bb).sqrt().clamp(0.25, 4.0);
        let projection = m.ta / aa;
        let left = (m.aa - 2.0 * gain * m.ab + gain * gain * m.bb).max(0.0);
        let trust = (1.0 - share * SLOPE_NOISE / m.tt.max(1e-12)).clamp(0.0, 1.0);
        Self {
            score: trust * ((m.ta - projection * m.aa) - gain * (m.tb - projection * m.ab)),
            information: trust * gain * (m.td - projection * m.ad),
            residual: left / (2.0 * share).max(1e-9),
            misfit: left / (2.0 * share + MODEL_SHARE * (m.aa + gain * gain * m.bb)).max(1e-9),
            projection,
            trust,
        }
    }

    /// About what the noise of one grey level makes of the score's variance.
    #[inline(always)]
    pub(super) fn random(&self, m: &Moments) -> f64 {
        self.trust * self.trust * m.tt
    }
}

impl PairScore {
    /// A pair that could not be compared.
    pub(super) const NONE: Self = Self {
        score: f32::NAN,
        information: 0.0,
        residual: 0.0,
        misfit: 0.0,
        covariance: 0.0,
        variances: [0.0; 2],
        noise: 0.0,
        random: 0.0,
    };

    /// Both orders of a pair.
    #[inline(always)]
    pub(super) fn new(moments: &[Moments; 2], noise: f64) -> Self {
        let [first, second] = moments;
        let orders = [Order::new(first, noise), Order::new(second, noise)];
        let share = noise * noise * (first.pixels + second.pixels);
        Self {
            score: (orders[0].score + orders[1].score) as f32,
            information: (orders[0].information + orders[1].information) as f32,
            residual: (0.5 * (orders[0].residual + orders[1].residual)) as f32,
            misfit: (0.5 * (orders[0].misfit + orders[1].misfit)) as f32,
            covariance: (first.ab + second.ab) as f32,
            variances: [(first.aa + second.aa - share) as f32, (first.bb + second.bb - share) as f32],
            noise: share as f32,
            random: (orders[0].random(first) + orders[1].random(second)) as f32,
        }
    }

    pub(super) fn compared(&self) -> bool {
        !self.score.is_nan()
    }
}
