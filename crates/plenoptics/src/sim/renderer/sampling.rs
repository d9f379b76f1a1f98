//! Where in its area and in its microlens each ray of a pixel starts: seeded low-discrepancy patterns.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// How many patterns a frame's pixels share. Half of them mirror the other half, so that no pattern's own bias adds up.
const PATTERNS: usize = 32;

/// One pixel's rays: structure of arrays, each `rays` long.
#[derive(Debug, Clone, Default)]
pub(super) struct Pattern {
    /// Within the pixel, in pixels, −0.5 to 0.5.
    pub(super) pixel: [Vec<f32>; 2],
    /// On the microlens, in radii, within the unit disc.
    pub(super) lens: [Vec<f32>; 2],
}

/// The patterns of a seed.
#[derive(Debug, Clone)]
pub(super) struct Patterns {
    patterns: Vec<Pattern>,
    seed: u64,
}

impl Patterns {
    pub(super) fn new(rays: usize, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0x5eed_0f5a_3b1e_c0de);
        let mut patterns = Vec::with_capacity(PATTERNS);
        for _ in 0..PATTERNS / 2 {
            let scrambles: [u32; 4] = random.random();
            let mut pattern = Pattern::default();
            let mut mirrored = Pattern::default();
            for ray in 0..rays {
                let s = sample(ray as u32, &scrambles);
                let lens = disc(s[2], s[3]);
                for k in 0..2 {
                    pattern.pixel[k].push((s[k] - 0.5) as f32);
                    pattern.lens[k].push(lens[k] as f32);
                    mirrored.pixel[k].push((0.5 - s[k]) as f32);
                    mirrored.lens[k].push(-lens[k] as f32);
                }
            }
            patterns.push(pattern);
            patterns.push(mirrored);
        }
        Self { patterns, seed }
    }

    /// The pattern of a pixel, the same for every frame of this seed.
    #[inline]
    pub(super) fn of_pixel(&self, x: usize, y: usize) -> &Pattern {
        let mut hash = self.seed ^ ((x as u64) << 32 | y as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
        &self.patterns[(hash >> 40) as usize % PATTERNS]
    }
}

/// Direction numbers of Sobol's sequence in four dimensions (primitive polynomials 1, x + 1, x² + x + 1, x³ + x + 1
/// with the starting values of Joe and Kuo, 2008).
fn directions(dimension: usize) -> [u32; 32] {
    let (degree, inner, start): (usize, u32, &[u32]) = match dimension {
        0 => return std::array::from_fn(|i| 1 << (31 - i)),
        1 => (1, 0, &[1]),
        2 => (2, 1, &[1, 3]),
        _ => (3, 1, &[1, 3, 1]),
    };
    let mut v = [0u32; 32];
    for i in 0..32 {
        if i < degree {
            v[i] = start[i] << (31 - i);
            continue;
        }
        v[i] = v[i - degree] ^ (v[i - degree] >> degree);
        for k in 1..degree {
            if (inner >> (degree - 1 - k)) & 1 == 1 {
                v[i] ^= v[i - k];
            }
        }
    }
    v
}

/// One Owen-scrambled Sobol point in [0, 1)⁴.
fn sample(index: u32, scrambles: &[u32; 4]) -> [f64; 4] {
    std::array::from_fn(|dimension| {
        let v = directions(dimension);
        let point = (0..32).filter(|i| (index >> i) & 1 == 1).fold(0, |sum, i| sum ^ v[i]);
        f64::from(scramble(point, scrambles[dimension])) / 4_294_967_296.0
    })
}

/// Nested uniform scrambling by hashing (Laine and Karras, 2011, with the constants of Burley, 2020).
fn scramble(point: u32, seed: u32) -> u32 {
    let mut x = point.reverse_bits();
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^= x.wrapping_mul(0x8d22_f6e6);
    x.reverse_bits()
}

/// The square to the unit disc, keeping areas and neighbourhoods (Shirley and Chiu, 1997).
fn disc(x: f64, y: f64) -> [f64; 2] {
    let (a, b) = (2.0 * x - 1.0, 2.0 * y - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0, 0.0];
    }
    let quarter = std::f64::consts::FRAC_PI_4;
    let (radius, angle) = if a.abs() > b.abs() { (a, quarter * b / a) } else { (b, 2.0 * quarter - quarter * a / b) };
    [radius * angle.cos(), radius * angle.sin()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_fill_every_plane_of_pixel_and_lens_evenly() {
        for seed in 0..8u32 {
            let points: Vec<[f64; 4]> =
                (0..64).map(|i| sample(i, &[seed * 7 + 1, seed * 13 + 2, seed * 29 + 3, seed * 31 + 4])).collect();
            for dimension in 0..4 {
                let mut strata = [0; 64];
                points.iter().for_each(|p| strata[(p[dimension] * 64.0) as usize] += 1);
                assert_eq!(strata, [1; 64], "dimension {dimension}");
            }
            for (a, b) in [(0, 1), (2, 3)] {
                let mut cells = [0; 16];
                points.iter().for_each(|p| cells[(p[a] * 4.0) as usize * 4 + (p[b] * 4.0) as usize] += 1);
                assert_eq!(cells, [4; 16], "plane {a}, {b}");
            }
        }
    }

    #[test]
    fn patterns_have_no_mean_and_the_disc_its_second_moment() {
        let patterns = Patterns::new(64, 3);
        let mut sums = [0.0f64; 5];
        for pattern in &patterns.patterns {
            for ray in 0..64 {
                sums[0] += f64::from(pattern.pixel[0][ray]);
                sums[1] += f64::from(pattern.pixel[1][ray]);
                sums[2] += f64::from(pattern.lens[0][ray]);
                sums[3] += f64::from(pattern.lens[1][ray]);
                sums[4] += f64::from(pattern.lens[0][ray]).powi(2) + f64::from(pattern.lens[1][ray]).powi(2);
            }
        }
        assert!(sums[..4].iter().all(|s| s.abs() < 1e-4), "{sums:?}");
        // The mean square radius of a uniform unit disc is a half.
        assert!((sums[4] / (64.0 * PATTERNS as f64) - 0.5).abs() < 0.005, "{sums:?}");
    }
}
