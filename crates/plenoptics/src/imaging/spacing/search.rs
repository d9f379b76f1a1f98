//! Where to start: the spacing at which neighbours correlate, looked for over the whole capture range.

use super::SpacingOptions;
use super::frame::{Pair, SpacingFrame};
use super::model::Model;
use super::score::{Content, content_of_pairs, correlation};
use super::solve::{Outcome, iterate};
use crate::imaging::calibration::Bin;
use crate::optics::MlaMode;

/// Capture range in Galilean mode, in MLA pitches.
pub const GALILEAN_RANGE: [f64; 2] = [0.35, 0.95];
/// Capture range in Keplerian mode, in MLA pitches.
pub const KEPLERIAN_RANGE: [f64; 2] = [1.05, 1.5];
/// Pairs that the search looks at, over all frames.
const PAIRS: usize = 600;
/// Every how many of them it looks at first: no divisor of what a micro-image has of pairs, so that all directions are
/// among them.
const SPARSE: usize = 5;
/// Pairs that a map of the field looks at.
const MAP_PAIRS: usize = 1500;
/// Peaks of the correlation that are looked at more closely.
const CANDIDATES: usize = 5;
/// Correlation below which a peak is not. A trial spacing lies within a quarter of a pixel of a peak's top, where texture
/// as sharp as pixels show has lost a fifth of its correlation: from here no top is as high as a match must be.
const HOPELESS_CORRELATION: f64 = 0.5 * super::LEAST_CORRELATION;

/// A spacing at which neighbours match.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) spacing: f64,
    pub(super) correlation: f64,
}

/// The range in which a spacing is found without a starting value, in MLA pitches.
#[must_use]
pub const fn capture_range(mode: MlaMode) -> [f64; 2] {
    match mode {
        MlaMode::Galilean => GALILEAN_RANGE,
        MlaMode::Keplerian => KEPLERIAN_RANGE,
    }
}

/// The spacings to be tried for an MLA pitch (px), by rising spacing.
pub(super) fn trial_spacings(mla_pitch: f64, mode: Option<MlaMode>) -> Vec<Vec<f64>> {
    let ranges = match mode {
        Some(mode) => vec![capture_range(mode)],
        None => vec![GALILEAN_RANGE, KEPLERIAN_RANGE],
    };
    // Half a pixel finds the sharpest texture; large micro-images have none that sharp.
    let step = (mla_pitch / 60.0).max(0.5);
    ranges
        .iter()
        .map(|[low, high]| {
            let count = ((high - low) * mla_pitch / step).ceil() as usize;
            (0..=count).map(|k| low * mla_pitch + k as f64 * (high - low) * mla_pitch / count as f64).collect()
        })
        .collect()
}

/// The pairs with the most texture, spread over the frame.
pub(super) fn textured_pairs(frame: &SpacingFrame, wanted: usize) -> Vec<Pair> {
    let mut pairs: Vec<(f32, Pair)> = frame
        .pairs
        .iter()
        .map(|&p| (frame.micro_images[p.first].texture.min(frame.micro_images[p.second].texture), p))
        .filter(|(_, p)| frame.region_of(*p).is_some())
        .collect();
    // The better half, and of it every so many: the most textured alone may all lie on one object.
    let half = pairs.len() / 2;
    if half > 0 {
        pairs.select_nth_unstable_by(half, |a, b| b.0.total_cmp(&a.0));
        pairs.truncate(half.max(wanted.min(pairs.len())));
    }
    pairs.sort_unstable_by_key(|(_, p)| (p.first, p.direction));
    let stride = (pairs.len() as f64 / wanted.max(1) as f64).max(1.0);
    (0..).map(|k| (f64::from(k) * stride) as usize).take_while(|&k| k < pairs.len()).map(|k| pairs[k].1).collect()
}

/// Candidates by falling correlation, refined on a part of the pairs.
pub(super) fn search(frames: &[SpacingFrame], mla_pitch: f64, mode: Option<MlaMode>) -> Vec<Candidate> {
    let subsets: Vec<Vec<Pair>> = frames.iter().map(|f| textured_pairs(f, PAIRS / frames.len().min(PAIRS))).collect();
    let regions = frames.iter().flat_map(|f| &f.micro_images).filter_map(|m| m.region).max().map_or(1, |r| r + 1);
    let flat = |spacing: f64| Model::flat(vec![spacing; regions]);
    let ranges = trial_spacings(mla_pitch, mode);
    let few: Vec<Vec<Pair>> = subsets.iter().map(|pairs| pairs.iter().copied().step_by(SPARSE).collect()).collect();
    let mut found = peaks(frames, &few, &ranges);
    // Where the few know no match, the others may.
    if found.first().is_none_or(|best| best.correlation < super::LEAST_CORRELATION) {
        found = peaks(frames, &subsets, &ranges);
    }
    found.truncate(CANDIDATES);
    if regions > 1 {
        return found;
    }
    // The best is looked at in any case: what it comes to is what a refusal names.
    let hopeful = found.iter().skip(1).take_while(|peak| peak.correlation >= HOPELESS_CORRELATION).count();
    found.truncate(1 + hopeful);
    let mut refined: Vec<Candidate> = found
        .iter()
        .filter_map(|peak| {
            let mut model = flat(peak.spacing);
            let (outcome, normal) = iterate(frames, Some(&subsets), &mut model, 3.0, 0.02, 12);
            (outcome == Outcome::Converged)
                .then_some(Candidate { spacing: model.spacings[0], correlation: normal.correlation })
        })
        .collect();
    refined.sort_unstable_by(|a, b| b.correlation.total_cmp(&a.correlation));
    refined
}

/// Where the correlation of these pairs is higher than at the trials beside it, by falling correlation.
fn peaks(frames: &[SpacingFrame], subsets: &[Vec<Pair>], ranges: &[Vec<f64>]) -> Vec<Candidate> {
    let mut peaks = Vec::new();
    for trials in ranges {
        let curve: Vec<f64> = trials
            .iter()
            .map(|&spacing| {
                let contents = frames.iter().zip(subsets).flat_map(|(f, s)| content_of_pairs(f, s, spacing));
                correlation(&contents.flatten().collect::<Vec<_>>())
            })
            .collect();
        for k in 0..curve.len() {
            let before = k.checked_sub(1).map_or(f64::MIN, |k| curve[k]);
            let after = curve.get(k + 1).copied().unwrap_or(f64::MIN);
            if curve[k] > before && curve[k] >= after {
                peaks.push(Candidate { spacing: trials[k], correlation: curve[k] });
            }
        }
    }
    peaks.sort_unstable_by(|a, b| b.correlation.total_cmp(&a.correlation));
    peaks
}

/// Trial spacings (px) over the capture range, and the correlation of neighbours at each in bins across the frame, one
/// micro-image pitch wide: along x, and along y.
#[must_use]
pub fn correlation_map(frame: &SpacingFrame, options: &SpacingOptions) -> (Vec<f64>, [Vec<Bin>; 2]) {
    let trials = trial_spacings(options.mla_pitch_px, options.mode).concat();
    let pairs = textured_pairs(frame, MAP_PAIRS);
    let bins = [frame.width, frame.height].map(|size| (size as f64 / frame.pitch).ceil().max(1.0) as usize);
    let mut maps = bins.map(|n| vec![Bin { values: Vec::with_capacity(trials.len()), weight: 0.0 }; n]);
    let places: Vec<[f64; 2]> = pairs.iter().map(|&pair| frame.position(frame.place_of(pair).at)).collect();
    for &spacing in &trials {
        let contents = content_of_pairs(frame, &pairs, spacing);
        for (axis, map) in maps.iter_mut().enumerate() {
            let mut members: Vec<Vec<&Content>> = vec![Vec::new(); map.len()];
            for (content, position) in contents.iter().zip(&places) {
                let place = position[axis] / frame.pitch;
                members[(place.max(0.0) as usize).min(bins[axis] - 1)].extend(content);
            }
            for (bin, members) in map.iter_mut().zip(&members) {
                bin.values.push(correlation(members.iter().copied()));
                bin.weight = bin.weight.max(texture(members));
            }
        }
    }
    (trials, maps)
}

/// How many pairs' worth of texture above the noise there is.
fn texture(contents: &[&Content]) -> f64 {
    let signal: f64 = contents.iter().map(|c| c.variances[0].max(0.0)).sum();
    let noise: f64 = contents.iter().map(|c| c.noise).sum();
    if signal > 0.0 { contents.len() as f64 * signal / (signal + noise) } else { 0.0 }
}
