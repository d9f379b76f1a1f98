//! Where to start: the spacing at which neighbours correlate, looked for over the whole capture range.

use super::SpacingOptions;
use super::frame::SpacingFrame;
use super::solve::{Outcome, Solver};
use crate::imaging::calibration::Bin;
use crate::imaging::matching::model::Model;
use crate::imaging::matching::normal::LEAST_CORRELATION;
use crate::imaging::matching::plan::{Job, Pair};
use crate::imaging::matching::run::{Pass, contents, each};
use crate::imaging::matching::score::{Content, Contents};
use crate::imaging::matching::tile::Tile;
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

/// What a search comes to.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    /// Spacings at which neighbours match, by falling correlation.
    pub(super) candidates: Vec<Candidate>,
    /// The best of the spacings tried where that is the first or last of a range, and whether it is the last.
    pub(super) end: Option<(Candidate, bool)>,
    /// Whether neighbours show nothing beyond noise, over all of the spacings tried.
    pub(super) blank: bool,
}

/// The range in which a spacing is found without a starting value, in MLA pitches.
#[must_use]
pub const fn capture_range(mode: MlaMode) -> [f64; 2] {
    match mode {
        MlaMode::Galilean => GALILEAN_RANGE,
        MlaMode::Keplerian => KEPLERIAN_RANGE,
    }
}

/// The ranges that are searched, in MLA pitches.
pub(super) fn ranges(mode: Option<MlaMode>) -> Vec<[f64; 2]> {
    mode.map_or_else(|| vec![GALILEAN_RANGE, KEPLERIAN_RANGE], |mode| vec![capture_range(mode)])
}

/// The spacings to be tried for an MLA pitch (px), by rising spacing.
pub(super) fn trial_spacings(mla_pitch: f64, mode: Option<MlaMode>) -> Vec<Vec<f64>> {
    let ranges = ranges(mode);
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
fn textured_pairs(frame: &SpacingFrame, wanted: usize) -> Vec<Pair> {
    let textures = textures(frame);
    let texture = |pair: &Pair| textures[pair.first as usize].min(textures[pair.second as usize]);
    let mut pairs: Vec<(f64, Pair)> = frame.pairs().into_iter().map(|pair| (texture(&pair), pair)).collect();
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

/// Variance of the grey levels within the mask of each micro-image, vignetting divided out and noise taken out as far as
/// known; 0 where there is no more than that.
fn textures(frame: &SpacingFrame) -> Vec<f64> {
    let lenses: Vec<[u32; 1]> = (0..frame.micro_images.len() as u32).map(|lens| [lens]).collect();
    let radius = frame.largest_radius();
    let texture = |pass: &Pass<'_, f32>, tile: &Tile| {
        let (mut count, mut sum, mut squares, mut gains) = (0.0f64, 0.0, 0.0, 0.0);
        tile.disc(pass.shape, radius, |at, r| {
            if let Some(share) = tile.share(pass.shape, at, r) {
                let value = f64::from(tile.values[at]);
                count += 1.0;
                sum += value;
                squares += value * value;
                gains += (share * share).recip();
            }
        });
        let noise = frame.noise * frame.noise * gains;
        ((squares - sum * sum / count.max(1.0) - noise) / count.max(1.0)).max(0.0)
    };
    let look = |pass: &Pass<'_, f32>| each(pass, &lenses, |_, tiles| texture(pass, &tiles[0]));
    frame.at(&Model::flat(Vec::new()), radius, 1.0, look)
}

/// What the contents of pairs have in common at each of these spacings (px) all over a frame.
fn contents_at(frame: &SpacingFrame, pairs: &[Pair], spacings: &[f64]) -> Vec<Vec<Option<Content>>> {
    frame.at(&Model::flat(Vec::new()), frame.largest_radius(), 1.0, |pass| contents(pass, pairs, spacings))
}

/// Looks for the spacing; the candidates are refined on a part of the pairs.
pub(super) fn search(frames: &[SpacingFrame], mla_pitch: f64, mode: Option<MlaMode>) -> Found {
    let subsets: Vec<Vec<Pair>> = frames.iter().map(|f| textured_pairs(f, PAIRS / frames.len().min(PAIRS))).collect();
    let ranges = trial_spacings(mla_pitch, mode);
    let few: Vec<Vec<Pair>> = subsets.iter().map(|pairs| pairs.iter().copied().step_by(SPARSE).collect()).collect();
    let (mut found, mut blank) = peaks(frames, &few, &ranges);
    // Where the few know no match, the others may.
    if found.first().is_none_or(|best| best.correlation < LEAST_CORRELATION) {
        (found, blank) = peaks(frames, &subsets, &ranges);
    }
    found.truncate(CANDIDATES);
    let end = found.first().and_then(|best| {
        let is = |spacing: Option<&f64>| spacing == Some(&best.spacing);
        let at_end = ranges.iter().find_map(|r| is(r.last()).then_some(true).or(is(r.first()).then_some(false)));
        at_end.map(|last| (*best, last))
    });
    if frames.iter().any(|frame| frame.regions() > 1) {
        return Found { candidates: found, end, blank };
    }
    // The best is looked at in any case: what it comes to is what a refusal names.
    let hopeful = found.iter().skip(1).take_while(|peak| peak.correlation >= HOPELESS_CORRELATION).count();
    found.truncate(1 + hopeful);
    let single = |(frame, pairs): (&SpacingFrame, &Vec<Pair>)| -> Vec<Job> {
        pairs.iter().map(|&pair| frame.plan.job(&[pair])).collect()
    };
    let mut solver = Solver::new(frames, frames.iter().zip(&subsets).map(single).collect());
    let mut refined: Vec<Candidate> = found
        .iter()
        .filter_map(|peak| {
            let mut model = Model::flat(vec![peak.spacing]);
            let outcome = solver.iterate(&mut model, 3.0, 0.02, 12);
            let correlation = solver.normal.contents.correlation();
            (outcome == Outcome::Converged).then_some(Candidate { spacing: model.spacings[0], correlation })
        })
        .collect();
    refined.sort_unstable_by(|a, b| b.correlation.total_cmp(&a.correlation));
    Found { candidates: refined, end, blank }
}

/// Where the correlation of these pairs is higher than at the trials beside it, by falling correlation; and whether they show
/// nothing over all trials.
fn peaks(frames: &[SpacingFrame], subsets: &[Vec<Pair>], ranges: &[Vec<f64>]) -> (Vec<Candidate>, bool) {
    let (mut peaks, mut all) = (Vec::new(), Contents::default());
    for trials in ranges {
        let mut sums = vec![Contents::default(); trials.len()];
        for of_pair in frames.iter().zip(subsets).flat_map(|(f, s)| contents_at(f, s, trials)) {
            for (sum, content) in sums.iter_mut().zip(of_pair) {
                content.iter().for_each(|content| sum.add(content));
                content.iter().for_each(|content| all.add(content));
            }
        }
        let curve: Vec<f64> = sums.iter().map(Contents::correlation).collect();
        for k in 0..curve.len() {
            let before = k.checked_sub(1).map_or(f64::MIN, |k| curve[k]);
            let after = curve.get(k + 1).copied().unwrap_or(f64::MIN);
            if curve[k] > before && curve[k] >= after {
                peaks.push(Candidate { spacing: trials[k], correlation: curve[k] });
            }
        }
    }
    peaks.sort_unstable_by(|a, b| b.correlation.total_cmp(&a.correlation));
    (peaks, all.are_blank())
}

/// Trial spacings (px) over the capture range, and the correlation of neighbours at each in bins across the frame, one
/// micro-image pitch wide: along x, and along y.
#[must_use]
pub fn correlation_map(frame: &SpacingFrame, options: &SpacingOptions) -> (Vec<f64>, [Vec<Bin>; 2]) {
    let trials = trial_spacings(options.mla_pitch_px, options.mode).concat();
    let pairs = textured_pairs(frame, MAP_PAIRS);
    let found = contents_at(frame, &pairs, &trials);
    let bins = [frame.width, frame.height].map(|size| (size as f64 / frame.pitch).ceil().max(1.0) as usize);
    let maps = [0, 1].map(|axis| {
        let mut sums = vec![vec![Contents::default(); trials.len()]; bins[axis]];
        for (pair, of_pair) in pairs.iter().zip(&found) {
            let [a, b] = [pair.first, pair.second].map(|lens| frame.plan.centre(lens)[axis]);
            let bin = ((f64::midpoint(a, b) / frame.pitch).max(0.0) as usize).min(bins[axis] - 1);
            for (sum, content) in sums[bin].iter_mut().zip(of_pair) {
                content.iter().for_each(|content| sum.add(content));
            }
        }
        let bin = |sums: &Vec<Contents>| Bin {
            values: sums.iter().map(Contents::correlation).collect(),
            weight: sums.iter().map(Contents::texture).fold(0.0, f64::max),
        };
        sums.iter().map(bin).collect()
    });
    (trials, maps)
}
