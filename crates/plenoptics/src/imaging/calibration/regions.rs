//! Where in the picture the boards of a multi-level target are: side by side, told apart by their spacing alone.

use crate::imaging::spacing::{SpacingFrame, SpacingOptions, correlation_map};

/// Least width of a board in the picture, micro-image pitches.
const LEAST_WIDTH: usize = 4;
/// Micro-images nearer than this to a boundary between boards, in pitches, may see both.
const MARGIN: f64 = 2.0;

/// Boards side by side along one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Strips {
    /// 0: side by side along x (vertical strips); 1: along y.
    pub axis: usize,
    /// Where each board begins and ends along that axis, px, in the order of the picture.
    pub ranges_px: Vec<[f64; 2]>,
    /// Approximate spacing of each, px.
    pub spacings_px: Vec<f64>,
    /// Correlation of neighbours within each, noise taken out.
    pub correlations: Vec<f64>,
}

impl Strips {
    /// The strip that a place in the frame (px) belongs to, away from the boundaries between boards.
    #[must_use]
    pub fn of(&self, place: [f64; 2], pitch_px: f64) -> Option<usize> {
        let (at, last) = (place[self.axis], self.ranges_px.len() - 1);
        self.ranges_px.iter().enumerate().position(|(k, range)| {
            let low = if k == 0 { f64::NEG_INFINITY } else { range[0] + MARGIN * pitch_px };
            let high = if k == last { f64::INFINITY } else { range[1] - MARGIN * pitch_px };
            at >= low && at <= high
        })
    }
}

/// Correlation beyond which it is interpolation and noise that say how well two micro-images match.
const MOST_CORRELATION: f64 = 0.99;

/// Divides the frame into `count` strips of different spacing, whichever way they lie.
#[must_use]
pub fn find_strips(frame: &SpacingFrame, options: &SpacingOptions, count: usize) -> Option<Strips> {
    let (spacings, maps) = correlation_map(frame, options);
    let mut best: Option<(f64, Strips)> = None;
    for (axis, map) in maps.iter().enumerate() {
        let Some((reward, path)) = segment(map, count) else { continue };
        let pitch = frame.micro_image_pitch_px();
        let mut strips = Strips { axis, ranges_px: Vec::new(), spacings_px: Vec::new(), correlations: Vec::new() };
        for (state, from, to) in path {
            strips.ranges_px.push([from as f64 * pitch, to as f64 * pitch]);
            strips.spacings_px.push(spacings[state]);
            let (sum, weight) = map[from..to]
                .iter()
                .fold((0.0, 0.0), |(s, w), bin| (s + bin.weight * bin.values[state], w + bin.weight));
            strips.correlations.push(if weight > 0.0 { sum / weight } else { 0.0 });
        }
        if best.as_ref().is_none_or(|(other, _)| reward > *other) {
            best = Some((reward, strips));
        }
    }
    best.map(|(_, strips)| strips)
}

/// One bin across the frame, a micro-image pitch wide.
#[derive(Debug, Clone, Default)]
pub struct Bin {
    /// Correlation of neighbours at each trial spacing, noise taken out.
    pub values: Vec<f64>,
    /// How much texture the bin has, in pairs.
    pub weight: f64,
}

/// A run of bins: its trial spacing, its first bin, and the bin after its last.
type Run = (usize, usize, usize);

/// The best division of the bins into `count` runs, each with one trial spacing, different from its neighbours':
/// dynamic programming over (run, bin, spacing). Returns the reward and each run's spacing and bounds.
fn segment(bins: &[Bin], count: usize) -> Option<(f64, Vec<Run>)> {
    let states = bins.iter().map(|b| b.values.len()).max()?;
    if count == 0 || bins.len() < count * LEAST_WIDTH || states == 0 {
        return None;
    }
    // Sums along the bins, so that a run's reward is a difference.
    let mut sums = vec![vec![0.0; states]];
    for bin in bins {
        let before = &sums[sums.len() - 1];
        let value = |state: usize| matching(bin.values.get(state).copied().unwrap_or(0.0));
        let after = before.iter().enumerate().map(|(state, sum)| sum + bin.weight * value(state)).collect();
        sums.push(after);
    }
    // best[run][end][state]: reward of bins ..end in run + 1 runs, the last of this state; and where it began, after
    // which state.
    let nothing = (f64::NEG_INFINITY, 0usize, 0usize);
    let mut best = vec![vec![vec![nothing; states]; bins.len() + 1]; count];
    for run in 0..count {
        for end in (run + 1) * LEAST_WIDTH..=bins.len() {
            for state in 0..states {
                let mut chosen = nothing;
                if run == 0 {
                    chosen = (sums[end][state], 0, 0);
                } else {
                    for begin in run * LEAST_WIDTH..=end - LEAST_WIDTH {
                        for (before, &(reward, _, _)) in best[run - 1][begin].iter().enumerate() {
                            let total = reward + sums[end][state] - sums[begin][state];
                            if before != state && total > chosen.0 {
                                chosen = (total, begin, before);
                            }
                        }
                    }
                }
                best[run][end][state] = chosen;
            }
        }
    }
    let (mut state, &(reward, ..)) =
        best[count - 1][bins.len()].iter().enumerate().max_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    let mut end = bins.len();
    let mut path = Vec::new();
    for run in (0..count).rev() {
        let (_, begin, before) = best[run][end][state];
        path.push((state, begin, end));
        (end, state) = (begin, before);
    }
    path.reverse();
    reward.is_finite().then_some((reward, path))
}

/// How much more likely a correlation is where two micro-images show the same than where they do not: minus the logarithm
/// of what one leaves unexplained of the other.
fn matching(correlation: f64) -> f64 {
    -(1.0 - correlation.clamp(0.0, MOST_CORRELATION).powi(2)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_found_whatever_their_order() {
        let truth = [vec![5; 8], vec![2; 6], vec![9; 10]].concat();
        let bins: Vec<Bin> = truth
            .iter()
            .map(|&state| {
                let values = (0..12).map(|s: i32| 1.0 - 0.1 * f64::from((s - state).abs())).collect();
                Bin { values, weight: 10.0 }
            })
            .collect();
        let (_, path) = segment(&bins, 3).unwrap();
        assert_eq!(path, [(5, 0, 8), (2, 8, 14), (9, 14, 24)]);
        assert_eq!(segment(&bins[..11], 3), None);
    }
}
