//! Means over the pixels of a frame, as few as a picture of it has.
//!
//! A pixel of a smaller picture is the mean of what it covers, pixels that it covers in part counted by that part: every
//! pixel of the part counts alike, and none is stepped over. Where a mosaic's colours would beat with the picture's
//! pixels, the mean goes half a pixel farther on either side, which leaves the colours' own alternation out of it whole.
//!
//! Means down the columns come first, then those across them of several rows at once, so that processors multiply side by
//! side in both: what it takes is hardly more than reading the frame.

use rayon::prelude::*;

/// Bits that a mean's weights are counted in.
const WEIGHT_BITS: u32 = 12;
/// Parts that a mean's weights are counted in.
const WHOLE: u32 = 1 << WEIGHT_BITS;
/// Bits below a grey level that means down the columns keep: with more they would not fit factors of 15 bits.
const FRACTION_BITS: u32 = 7;
/// What factors have no bits beyond: of numbers that are known to be no greater processors multiply the most at once.
const FACTOR: u16 = 0x7fff;
/// Columns that are set abreast at a time.
const STRETCH: usize = 64;
/// Rows of the picture that are made side by side.
const ABREAST: usize = 8;
/// Rows of the picture that a thread makes at least.
const BAND: usize = 4 * ABREAST;
/// Weights that are multiplied at a time.
const TAPS: usize = 4;

/// A frame's sample.
pub(super) trait Sample: Copy + Sync {
    /// Its 8 bits above the lowest `shift` ones; of 8 bits these are all there are.
    fn level(self, shift: u8) -> u8;
}

impl Sample for u8 {
    #[inline(always)]
    fn level(self, _shift: u8) -> u8 {
        self
    }
}

impl Sample for u16 {
    #[inline(always)]
    fn level(self, shift: u8) -> u8 {
        (self >> shift) as u8
    }
}

/// The pixels along a line that one of the picture covers, and how much of its mean each is; together [`WHOLE`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Cover {
    first: usize,
    weights: Vec<u16>,
}

/// What each of `count` pixels covers of `length` ones from `from` on, in a line of `all`.
pub(super) fn covers(from: usize, length: usize, count: usize, all: usize, mosaic: bool) -> Vec<Cover> {
    // An even number of whole pixels has as much of one colour as of the other.
    let even = length.is_multiple_of(count) && (length / count).is_multiple_of(2);
    let blurred = mosaic && length > count && !even;
    (0..count)
        .map(|k| {
            // In 1 / (2 count) of a pixel, from `from` on: all ends are whole numbers.
            let [begin, end] = [k, k + 1].map(|k| (2 * k * length) as i64);
            let half = count as i64;
            let shares = if blurred { [begin - half, begin + half] } else { [begin, begin] };
            cover(shares.map(|share| [share, share + end - begin]), 2 * half, from, all)
        })
        .collect()
}

/// The pixels that two stretches cover together, `pixel` being how long one is, counted from the pixel `from` on. What
/// leaves the line comes back into it, where the colours alternate the same way.
fn cover(stretches: [[i64; 2]; 2], pixel: i64, from: usize, all: usize) -> Cover {
    let [low, high] = [stretches[0][0].div_euclid(pixel), (stretches[1][1] - 1).div_euclid(pixel)];
    let last = all as i64 - 1;
    let place = |k: i64| {
        let at = from as i64 + k;
        let back = if at < 0 {
            -at
        } else if at > last {
            2 * last - at
        } else {
            at
        };
        back.clamp(0, last) as usize
    };
    let first = (low..=high).map(place).min().unwrap_or(from);
    let end = (low..=high).map(place).max().unwrap_or(from);
    let mut lengths = vec![0i64; end - first + 1];
    for k in low..=high {
        let overlap = |[begin, end]: [i64; 2]| (end.min((k + 1) * pixel) - begin.max(k * pixel)).max(0);
        lengths[place(k) - first] += stretches.map(overlap).iter().sum::<i64>();
    }
    // What the rounding of one leaves goes to the next: together they are whole.
    let total: i64 = lengths.iter().sum();
    let (mut covered, mut given) = (0, 0);
    let weights = lengths.into_iter().map(|length| {
        covered += length;
        let by_now = ((covered * i64::from(WHOLE) + total / 2) / total) as u16;
        by_now - std::mem::replace(&mut given, by_now)
    });
    Cover { first, weights: weights.collect() }
}

/// Means over what columns and rows cover, of samples without their lowest `shift` bits.
pub(super) fn scaled<T: Sample>(samples: &[T], width: usize, shift: u8, columns: &[Cover], rows: &[Cover]) -> Vec<u8> {
    let begin = columns.iter().map(|cover| cover.first).min().unwrap_or(0);
    let end = columns.iter().map(|cover| cover.first + cover.weights.len()).max().unwrap_or(begin);
    let as_it_is = |covers: &[Cover]| covers.iter().all(|cover| cover.weights.len() == 1);
    if as_it_is(columns) && as_it_is(rows) {
        let mut out = Vec::with_capacity(columns.len() * rows.len());
        for cover in rows {
            let row = &samples[cover.first * width + begin..cover.first * width + end];
            out.extend(row.iter().map(move |&sample| sample.level(shift)));
        }
        return out;
    }
    let across = Across::new(columns, begin);
    let mut out = vec![0; columns.len() * rows.len()];
    let arch = pulp::Arch::new();
    out.par_chunks_mut(BAND * columns.len()).zip(rows.par_chunks(BAND)).for_each(|(out, rows)| {
        arch.dispatch(Band {
            samples: &samples[begin..],
            columns: end - begin,
            width,
            shift,
            rows,
            across: &across,
            out,
        });
    });
    out
}

/// What pixels along a row of the picture cover, each by as many groups of weights.
struct Across {
    /// First column that each covers.
    firsts: Vec<usize>,
    /// Groups of weights each has.
    groups: usize,
    weights: Vec<[u16; TAPS]>,
}

impl Across {
    /// Columns counted from `begin` on.
    fn new(covers: &[Cover], begin: usize) -> Self {
        let groups = covers.iter().map(|cover| cover.weights.len().div_ceil(TAPS)).max().unwrap_or(1);
        let mut weights = vec![[0; TAPS]; covers.len() * groups];
        for (cover, to) in covers.iter().zip(weights.chunks_exact_mut(groups)) {
            to.as_flattened_mut()[..cover.weights.len()].copy_from_slice(&cover.weights);
        }
        Self { firsts: covers.iter().map(|cover| cover.first - begin).collect(), groups, weights }
    }
}

/// Some rows of the picture.
struct Band<'a, T> {
    /// The frame's samples from the first column on that the picture covers, and how many it covers.
    samples: &'a [T],
    columns: usize,
    /// Samples from one row of the frame to the next.
    width: usize,
    shift: u8,
    rows: &'a [Cover],
    across: &'a Across,
    out: &'a mut [u8],
}

impl<T: Sample> pulp::WithSimd for Band<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        let Self { samples, columns, width, shift, rows, across, out } = self;
        let (length, padded) = (across.firsts.len(), columns.next_multiple_of(STRETCH));
        let mut sums = vec![0; columns];
        let mut lines = vec![0; ABREAST * padded];
        // Weights beyond a pixel's own are 0, and may be those of columns that there are not.
        let mut means = vec![[0; ABREAST]; padded + TAPS * across.groups];
        let mut picture = vec![[0; ABREAST]; length];
        for (rows, out) in rows.chunks(ABREAST).zip(out.chunks_mut(ABREAST * length)) {
            for (line, cover) in lines.chunks_exact_mut(padded).zip(rows) {
                down(&samples[cover.first * width..], width, shift, &cover.weights, &mut sums, line);
            }
            set_abreast(&lines, &mut means);
            across.add_up(&means, &mut picture);
            for (k, out) in out.chunks_exact_mut(length).enumerate() {
                for (to, abreast) in out.iter_mut().zip(&picture) {
                    *to = (u64::from_le_bytes(*abreast) >> (8 * k)) as u8;
                }
            }
        }
    }
}

/// Means down columns.
#[inline(always)]
fn down<T: Sample>(samples: &[T], width: usize, shift: u8, weights: &[u16], sums: &mut [u32], means: &mut [u16]) {
    sums.fill(1 << (WEIGHT_BITS - FRACTION_BITS - 1));
    for (row, &weight) in samples.chunks(width).zip(weights) {
        for (sum, &sample) in sums.iter_mut().zip(row) {
            *sum += u32::from(weight & FACTOR) * u32::from(sample.level(shift));
        }
    }
    for (mean, &sum) in means.iter_mut().zip(&*sums) {
        *mean = (sum >> (WEIGHT_BITS - FRACTION_BITS)) as u16;
    }
}

/// Sets lines that are one after the other side by side.
#[inline(always)]
fn set_abreast(lines: &[u16], columns: &mut [[u16; ABREAST]]) {
    let length = lines.len() / ABREAST;
    for (k, columns) in columns.as_chunks_mut::<STRETCH>().0.iter_mut().take(length / STRETCH).enumerate() {
        let mut block = [[0; STRETCH]; ABREAST];
        for r in 0..ABREAST {
            block[r].copy_from_slice(&lines[r * length + k * STRETCH..][..STRETCH]);
        }
        for x in 0..STRETCH {
            for r in 0..ABREAST {
                columns[x][r] = block[r][x];
            }
        }
    }
}

impl Across {
    /// Means across the columns' means, of rows abreast.
    #[inline(always)]
    fn add_up(&self, means: &[[u16; ABREAST]], picture: &mut [[u8; ABREAST]]) {
        const BITS: u32 = WEIGHT_BITS + FRACTION_BITS;
        for ((&first, weights), to) in self.firsts.iter().zip(self.weights.chunks_exact(self.groups)).zip(picture) {
            let mut sums = [1u32 << (BITS - 1); ABREAST];
            for (means, weights) in means[first..].as_chunks::<TAPS>().0.iter().zip(weights) {
                for n in 0..TAPS {
                    for r in 0..ABREAST {
                        sums[r] += u32::from(weights[n] & FACTOR) * u32::from(means[n][r] & FACTOR);
                    }
                }
            }
            for r in 0..ABREAST {
                to[r] = (sums[r] >> BITS) as u8;
            }
        }
    }
}
