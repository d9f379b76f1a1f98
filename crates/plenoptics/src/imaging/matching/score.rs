//! What one pair says about the spacing, both orders taken together.

use super::compare::Moments;
use super::tile::SLOPE_NOISE;

/// What interpolation, vignetting and the pixels' own area leave of a content's energy where two micro-images do show
/// the same: no sign of a mismatch.
const MODEL_SHARE: f64 = 0.002;
/// Content beyond the noise's, in units of the noise's, below which a frame that does not match shows nothing.
const LEAST_CONTRAST: f64 = 0.25;

/// What one pair says.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct PairScore {
    /// Sums of the two orders' scores, along the pair and across it; NaN where the two could not be compared.
    pub(in crate::imaging) score: [f32; 2],
    /// Sums of their derivatives by a shift along and across: the information about the spacing.
    pub(in crate::imaging) information: [[f32; 2]; 2],
    /// Mean squared residual in units of the noise's.
    pub(in crate::imaging) residual: f32,
    /// The same in units of what noise and the model's limits leave: 1 and less where the two match.
    pub(in crate::imaging) misfit: f32,
    /// What the contents have in common.
    pub(in crate::imaging) content: Content,
    /// Sums of the weighted, squared slopes that the scores are made of: about what the noise of one grey level makes of
    /// their variances.
    pub(in crate::imaging) energy: [f32; 2],
}

/// What the contents of pairs have in common.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct Content {
    /// Noise-free covariance and variances, for the correlation.
    pub(in crate::imaging) covariance: f32,
    pub(in crate::imaging) variances: [f32; 2],
    /// The noise's share that was taken out of each.
    pub(in crate::imaging) noise: f32,
}

impl Content {
    /// Of both orders, at a noise of so many grey levels.
    #[inline(always)]
    pub(in crate::imaging) fn new([first, second]: &[Moments; 2], noise: f64) -> Self {
        let share = noise * noise * (first.pixels + second.pixels);
        Self {
            covariance: (first.ab + second.ab) as f32,
            variances: [(first.aa + second.aa - share) as f32, (first.bb + second.bb - share) as f32],
            noise: share as f32,
        }
    }
}

/// The contents of many pairs.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct Contents {
    covariance: f64,
    variances: [f64; 2],
    noise: f64,
    pairs: usize,
}

impl Contents {
    #[inline]
    pub(in crate::imaging) fn add(&mut self, content: &Content) {
        self.covariance += f64::from(content.covariance);
        self.variances[0] += f64::from(content.variances[0]);
        self.variances[1] += f64::from(content.variances[1]);
        self.noise += f64::from(content.noise);
        self.pairs += 1;
    }

    /// Their correlation, the noise's share of the variances taken out.
    pub(in crate::imaging) fn correlation(&self) -> f64 {
        let [aa, bb] = self.variances;
        if aa > 0.0 && bb > 0.0 { self.covariance / (aa * bb).sqrt() } else { 0.0 }
    }

    /// Variance beyond the noise's, in units of the noise's.
    fn contrast(&self) -> f64 {
        (self.variances[0] + self.variances[1]) / (2.0 * self.noise).max(1e-9)
    }

    /// Whether they show nothing beyond noise.
    pub(in crate::imaging) fn are_blank(&self) -> bool {
        self.contrast() < LEAST_CONTRAST
    }

    /// How many pairs' worth of texture above the noise there is.
    pub(in crate::imaging) fn texture(&self) -> f64 {
        let signal = self.variances[0];
        if signal > 0.0 { self.pairs as f64 * signal / (signal + self.noise) } else { 0.0 }
    }
}

impl<'a> FromIterator<&'a Content> for Contents {
    fn from_iter<I: IntoIterator<Item = &'a Content>>(contents: I) -> Self {
        let mut all = Self::default();
        contents.into_iter().for_each(|content| all.add(content));
        all
    }
}

/// The score of one order of a pair, along it and across it.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Order {
    pub(in crate::imaging) score: [f64; 2],
    pub(in crate::imaging) information: [[f64; 2]; 2],
    /// Sums of the weighted, squared slopes that the scores are made of.
    pub(in crate::imaging) energy: [f64; 2],
    residual: f64,
    misfit: f64,
    /// Gains of the slopes' orthogonalisation and the factors that keep pure noise from counting.
    pub(in crate::imaging) projection: [f64; 2],
    pub(in crate::imaging) trust: [f64; 2],
}

impl Order {
    /// From the moments, at a noise of so many grey levels.
    #[inline(always)]
    pub(in crate::imaging) fn new(m: &Moments, noise: f64) -> Self {
        let share = noise * noise * m.pixels;
        // Where a micro-image is flat, its moments are rounding errors: never less than the noise would make.
        let clean = |moment: f64| (moment - share).max(0.25 * moment).max(0.25 * share).max(1e-9);
        let (aa, bb) = (clean(m.aa), clean(m.bb));
        let gain = (aa / bb).sqrt().clamp(0.25, 4.0);
        let left = (m.aa - 2.0 * gain * m.ab + gain * gain * m.bb).max(0.0);
        let projection = m.ta.map(|ta| ta / aa);
        let trust = m.tt.map(|tt| (1.0 - share * SLOPE_NOISE / tt.max(1e-12)).clamp(0.0, 1.0));
        let score = |k: usize| trust[k] * ((m.ta[k] - projection[k] * m.aa) - gain * (m.tb[k] - projection[k] * m.ab));
        let information = |k: usize, l: usize| trust[k] * gain * (m.td[k][l] - projection[k] * m.ad[l]);
        let energy = |k: usize| trust[k] * trust[k] * (m.tt[k] - projection[k] * m.ta[k]).max(0.0);
        Self {
            score: [score(0), score(1)],
            information: [[information(0, 0), information(0, 1)], [information(1, 0), information(1, 1)]],
            energy: [energy(0), energy(1)],
            residual: left / (2.0 * share).max(1e-9),
            misfit: left / (2.0 * share + MODEL_SHARE * (m.aa + gain * gain * m.bb)).max(1e-9),
            projection,
            trust,
        }
    }
}

impl PairScore {
    /// A pair that could not be compared.
    pub(in crate::imaging) const NONE: Self = Self {
        score: [f32::NAN; 2],
        information: [[0.0; 2]; 2],
        residual: 0.0,
        misfit: 0.0,
        content: Content { covariance: 0.0, variances: [0.0; 2], noise: 0.0 },
        energy: [0.0; 2],
    };

    /// Both orders of a pair.
    #[inline(always)]
    pub(in crate::imaging) fn new(moments: &[Moments; 2], noise: f64) -> Self {
        let [a, b] = [Order::new(&moments[0], noise), Order::new(&moments[1], noise)];
        let sum = |a: f64, b: f64| (a + b) as f32;
        let row = |a: [f64; 2], b: [f64; 2]| [sum(a[0], b[0]), sum(a[1], b[1])];
        Self {
            score: row(a.score, b.score),
            information: [row(a.information[0], b.information[0]), row(a.information[1], b.information[1])],
            residual: 0.5 * sum(a.residual, b.residual),
            misfit: 0.5 * sum(a.misfit, b.misfit),
            content: Content::new(moments, noise),
            energy: row(a.energy, b.energy),
        }
    }

    pub(in crate::imaging) fn compared(&self) -> bool {
        !self.score[0].is_nan()
    }

    /// The misfit with so many times as much left to the model's limits.
    pub(in crate::imaging) fn misfit_with_limits(&self, times: f32) -> f32 {
        let noise = self.residual.recip();
        (noise + times * (self.misfit.recip() - noise).max(0.0)).recip()
    }
}
