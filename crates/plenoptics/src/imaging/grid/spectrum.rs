//! Lattices that a frame's Fourier spectrum could have.

use fourier::Complex;
use rayon::prelude::*;

use super::frame::Frame;
use crate::optics::ArrayKind;

/// Largest side of the part of the frame that is transformed, px: ten lens pitches of the greatest pitch.
const SIDE_MAX: usize = 1024;
/// Highest frequency at which peaks are looked for, cycles per px: second harmonics of the least pitch.
const FREQUENCY_MAX: f64 = 0.36;
/// Peaks kept for the search.
const PEAKS_MAX: usize = 60;
/// A peak stands this much above the mean power about its frequency. The greatest of half a million bins of pure noise
/// stands 13 above.
const SNR_LEAST: f64 = 25.0;
/// Peaks this much weaker than the strongest are its window's skirts.
const DYNAMIC_RANGE: f64 = 1e-5;

/// A possible lattice of a frame.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    pub array: ArrayKind,
    /// Two reciprocal vectors, cycles per px; 90° apart for a square, 60° for a hexagonal array.
    pub reciprocal: [[f64; 2]; 2],
    /// Share of the peaks' weight that lies on the lattice.
    pub score: f64,
}

#[derive(Debug, Clone, Copy)]
struct Peak {
    /// Cycles per px.
    f: [f64; 2],
    snr: f64,
}

/// The central part of the frame that [`candidates`] looks at: x, y, width, height.
pub(super) fn central_part(frame: &Frame) -> [usize; 4] {
    let (w, h) = (transform_size(frame.width), transform_size(frame.height));
    [(frame.width - w) / 2, (frame.height - h) / 2, w, h]
}

/// Possible lattices, the likeliest first.
pub(super) fn candidates(frame: &Frame, part: [usize; 4], pitch: [f64; 2]) -> Vec<Candidate> {
    let [_, _, w, h] = part;
    let power = power_spectrum(frame, part);
    let peaks = peaks(&power, w, h, 0.8 / pitch[1]);
    let total: f64 = peaks.iter().map(|p| p.snr.ln()).sum();
    let strongest = peaks.iter().map(|p| p.snr).fold(0.0, f64::max);
    // A bin's width along the shorter side: what a peak's place is uncertain by, generously.
    let bin = 1.0 / w.min(h) as f64;
    let mut found = Vec::new();
    for (n, a) in peaks.iter().enumerate() {
        for b in &peaks[n + 1..] {
            let (la, lb) = (length(a.f), length(b.f));
            let mean = f64::midpoint(la, lb);
            if (la - lb).abs() > 0.03 * mean + bin {
                continue;
            }
            let cosine = (a.f[0] * b.f[0] + a.f[1] * b.f[1]) / (la * lb);
            let slack = 0.04 + bin / mean;
            let (array, second, period) = if cosine.abs() < slack {
                (ArrayKind::Square, b.f, 1.0 / mean)
            } else if (cosine.abs() - 0.5).abs() < slack {
                let sign = cosine.signum();
                (ArrayKind::Hexagonal, [sign * b.f[0], sign * b.f[1]], 2.0 / (3f64.sqrt() * mean))
            } else {
                continue;
            };
            if period < 0.97 * pitch[0] || period > 1.03 * pitch[1] {
                continue;
            }
            let basis = [a.f, second];
            let mut weight = 0.0;
            let mut greatest = 0.0f64;
            let mut third = array == ArrayKind::Square;
            for p in &peaks {
                let [m, n] = solve(basis, p.f).map(f64::round);
                if m.abs().max(n.abs()) > 8.0 {
                    continue;
                }
                let off = [p.f[0] - m * a.f[0] - n * second[0], p.f[1] - m * a.f[1] - n * second[1]];
                if length(off) < bin * (0.7 + 0.3 * (m.abs() + n.abs())) {
                    weight += p.snr.ln();
                    greatest = greatest.max(p.snr);
                    third |= (m, n) == (1.0, -1.0) || (m, n) == (-1.0, 1.0);
                }
            }
            // A lattice's fundamentals are not drowned by its harmonics: weaker ones belong to a finer lattice that
            // chance has laid under the true one.
            if third && a.snr.min(b.snr) > 1e-3 * greatest {
                // Fundamentals among the strongest peaks of all break the ties.
                let score = weight / total + 0.2 * (a.snr * b.snr).ln() / (2.0 * strongest.ln());
                found.push(Candidate { array, reciprocal: basis, score });
            }
        }
    }
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    // The three pairs of a hexagonal ring are one lattice.
    let mut distinct: Vec<Candidate> = Vec::new();
    for c in found {
        let same = |d: &Candidate| {
            d.array == c.array
                && (determinant(d.reciprocal).abs() / determinant(c.reciprocal).abs() - 1.0).abs() < 0.1
                && {
                    let [m, n] = solve(d.reciprocal, c.reciprocal[0]);
                    (m - m.round()).abs().max((n - n.round()).abs()) < 0.1
                }
        };
        if !distinct.iter().any(same) {
            distinct.push(c);
        }
        if distinct.len() == 4 {
            break;
        }
    }
    distinct
}

fn length(v: [f64; 2]) -> f64 {
    v[0].hypot(v[1])
}

fn determinant(b: [[f64; 2]; 2]) -> f64 {
    b[0][0] * b[1][1] - b[0][1] * b[1][0]
}

/// (m, n) with `m basis[0] + n basis[1] = v`.
fn solve(basis: [[f64; 2]; 2], v: [f64; 2]) -> [f64; 2] {
    let area = determinant(basis);
    [(v[0] * basis[1][1] - v[1] * basis[1][0]) / area, (basis[0][0] * v[1] - basis[0][1] * v[0]) / area]
}

/// Largest even size up to `n` and [`SIDE_MAX`] that transforms fast.
fn transform_size(n: usize) -> usize {
    let smooth = |mut m: usize| {
        for p in [2, 3, 5] {
            while m.is_multiple_of(p) {
                m /= p;
            }
        }
        m == 1
    };
    (2..=n.min(SIDE_MAX)).rev().find(|&m| m % 2 == 0 && smooth(m)).unwrap_or(2)
}

fn hann(n: usize) -> Vec<f32> {
    (0..n).map(|i| ((std::f64::consts::PI * (i as f64 + 0.5) / n as f64).sin().powi(2)) as f32).collect()
}

/// Power at (kx, ky), kx from 0 to w/2, row by row of ky.
fn power_spectrum(frame: &Frame, [x0, y0, w, h]: [usize; 4]) -> Vec<f32> {
    let forward = fourier::real_forward(w);
    let half = w / 2 + 1;
    let mut values = vec![0.0f32; w * h];
    values.par_chunks_exact_mut(w).enumerate().for_each(|(y, row)| frame.row(y0 + y, x0, row));
    let mean = (values.iter().map(|&v| f64::from(v)).sum::<f64>() / (w * h) as f64) as f32;
    let (wx, wy) = (hann(w), hann(h));
    let mut rows = vec![Complex::new(0.0f32, 0.0); half * h];
    let whole = values
        .par_chunks_exact_mut(w)
        .zip(rows.par_chunks_exact_mut(half))
        .zip(&wy)
        .map_init(
            || forward.make_scratch_vec(),
            |scratch, ((line, transformed), &b)| {
                line.iter_mut().zip(&wx).for_each(|(v, &a)| *v = (*v - mean) * a * b);
                forward.process_with_scratch(line, transformed, scratch)
            },
        )
        .all(|done| done.is_ok());
    // Buffers have the sizes that the plan asks for, so that it cannot fail.
    if !whole {
        return vec![0.0; half * h];
    }
    let mut columns = vec![Complex::new(0.0f32, 0.0); half * h];
    for (y, row) in rows.chunks_exact(half).enumerate() {
        for (kx, &v) in row.iter().enumerate() {
            columns[kx * h + y] = v;
        }
    }
    let vertical = fourier::forward(h);
    columns.par_chunks_exact_mut(h).for_each_init(
        || vec![Complex::new(0.0f32, 0.0); vertical.get_inplace_scratch_len()],
        |scratch, column| vertical.process_with_scratch(column, scratch),
    );
    let mut power = vec![0.0; half * h];
    for kx in 0..half {
        for ky in 0..h {
            power[ky * half + kx] = columns[kx * h + ky].norm_sqr();
        }
    }
    power
}

fn peaks(power: &[f32], w: usize, h: usize, frequency_min: f64) -> Vec<Peak> {
    let half = w / 2 + 1;
    let signed = |ky: usize| if ky > h / 2 { ky as f64 - h as f64 } else { ky as f64 };
    let at = |kx: i64, ky: i64| {
        // The other half of a real picture's spectrum mirrors this one.
        let (kx, ky) = if kx < 0 { (-kx, -ky) } else { (kx, ky) };
        let kx = if kx as usize >= half { w as i64 - kx } else { kx };
        f64::from(power[ky.rem_euclid(h as i64) as usize * half + kx as usize])
    };
    // Mean power about a frequency, from the lower quartile of its ring: exponential statistics, quartile = ln 4/3 mean.
    // Of a narrow ring the half may lie on the peaks themselves.
    let ring_scale = w.max(h) as f64;
    // No overflow to fear: hypot, which minds it, takes much longer.
    let ring_of = |kx: usize, ky: usize| {
        (ring_scale * ((kx as f64 / w as f64).powi(2) + (signed(ky) / h as f64).powi(2)).sqrt()) as usize
    };
    let mut rings: Vec<Vec<f32>> = vec![Vec::new(); (FREQUENCY_MAX * ring_scale) as usize + 1];
    let (kx_max, frequency_max2) = (((FREQUENCY_MAX * w as f64) as usize).min(half - 2), FREQUENCY_MAX.powi(2));
    for ky in 0..h {
        for kx in 0..=kx_max {
            if let Some(ring) = rings.get_mut(ring_of(kx, ky)) {
                ring.push(power[ky * half + kx]);
            }
        }
    }
    let background: Vec<f64> = rings
        .iter_mut()
        .map(|ring| {
            if ring.is_empty() {
                return f64::INFINITY;
            }
            let quartile = ring.len() / 4;
            f64::from(*ring.select_nth_unstable_by(quartile, f32::total_cmp).1) / (4.0f64 / 3.0).ln()
        })
        .collect();
    let mut found: Vec<(f64, f64, usize, usize)> = Vec::new();
    for ky in 0..h {
        for kx in 0..=kx_max {
            let (fx, fy) = (kx as f64 / w as f64, signed(ky) / h as f64);
            let f2 = fx * fx + fy * fy;
            // Three bins from zero frequency the window's main lobe has ended.
            if f2 < frequency_min.powi(2) || f2 > frequency_max2 || (kx < 3 && signed(ky).abs() < 3.0) {
                continue;
            }
            if kx == 0 && signed(ky) < 0.0 {
                continue;
            }
            let p = f64::from(power[ky * half + kx]);
            let ring = ring_of(kx, ky).min(background.len() - 1);
            if p < SNR_LEAST * background[ring] {
                continue;
            }
            let (x, y) = (kx as i64, ky as i64);
            let summit = (-1..=1).all(|dy| (-1..=1).all(|dx| (dx == 0 && dy == 0) || at(x + dx, y + dy) <= p));
            if summit {
                found.push((p, background[ring], kx, ky));
            }
        }
    }
    let strongest = found.iter().map(|p| p.0).fold(0.0, f64::max);
    let vertex = |low: f64, middle: f64, high: f64| {
        let (l, m, h) = (low.max(1e-30).ln(), middle.max(1e-30).ln(), high.max(1e-30).ln());
        let curvature = l - 2.0 * m + h;
        if curvature < -1e-9 { (0.5 * (l - h) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let mut peaks: Vec<Peak> = found
        .iter()
        .filter_map(|&(p, background, kx, ky)| {
            let snr = p / background.max(DYNAMIC_RANGE * strongest);
            let (x, y) = (kx as i64, ky as i64);
            let fx = (kx as f64 + vertex(at(x - 1, y), p, at(x + 1, y))) / w as f64;
            let fy = (signed(ky) + vertex(at(x, y - 1), p, at(x, y + 1))) / h as f64;
            (snr > SNR_LEAST).then_some(Peak { f: [fx, fy], snr })
        })
        .collect();
    peaks.sort_by(|a, b| b.snr.total_cmp(&a.snr));
    peaks.truncate(PEAKS_MAX);
    peaks
}
