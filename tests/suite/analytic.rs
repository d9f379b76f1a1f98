//! The spacing estimator against frames drawn from a formula: a texture of sine waves, seen by every microlens through
//! its own affine map, with a soft round vignette and Gaussian noise. Nothing here is shared with the renderer.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;

use plenalign::imaging::grid::Grid;
use plenalign::imaging::spacing::{
    LensState, Spacing, SpacingError, SpacingFrame, SpacingOptions, measure_spacing, measure_spacing_map,
};
use plenalign::optics::ArrayKind;
use plenalign::raw::{CfaPattern, Channel, RawImage};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

const SIDE: usize = 420;
const PITCH: f64 = 29.5;
/// Spacing in focus, px.
const IN_FOCUS: f64 = 19.7;
const NOISE: f64 = 2.0;
/// Standard deviation of the texture, grey levels.
const CONTRAST: f64 = 25.0;

/// Waves of a texture: wave vector (radians per px of the micro-image) and phase.
struct Waves(Vec<([f64; 2], f64)>);

impl Waves {
    /// Wavelengths of 6 to 20 px in all directions, or in one (radians) alone.
    fn new(seed: u64, direction: Option<f64>) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let wave = |_| {
            let k = TAU / random.random_range(6.0..20.0f64);
            let drawn = random.random_range(0.0..TAU);
            let angle = direction.unwrap_or(drawn);
            ([k * angle.cos(), k * angle.sin()], random.random_range(0.0..TAU))
        };
        Self((0..60).map(wave).collect())
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        let amplitude = CONTRAST * (2.0 / self.0.len() as f64).sqrt();
        self.0.iter().map(|([kx, ky], phase)| amplitude * (kx * x + ky * y + phase).cos()).sum()
    }

    /// Mean square of the slope along one axis, averaged over both, (grey levels per px)².
    fn slope_energy(&self) -> f64 {
        let mean: f64 = self.0.iter().map(|(k, _)| k[0] * k[0] + k[1] * k[1]).sum::<f64>() / self.0.len() as f64;
        CONTRAST * CONTRAST * mean / 2.0
    }
}

/// What a frame shows.
struct Scene {
    array: ArrayKind,
    /// Spacing as a symmetric matrix in the array's own axes, px: rows, columns, and their mix.
    spacing: [f64; 3],
    direction: Option<f64>,
}

impl Scene {
    fn plain(spacing: f64) -> Self {
        Self { array: ArrayKind::Square, spacing: [spacing, spacing, 0.0], direction: None }
    }
}

const ROTATION: f64 = 0.012;

fn grid(array: ArrayKind) -> Grid {
    let (sin, cos) = ROTATION.sin_cos();
    let turn = |x: f64, y: f64| [PITCH * (x * cos - y * sin), PITCH * (x * sin + y * cos)];
    let second = match array {
        ArrayKind::Square => turn(0.0, 1.0),
        ArrayKind::Hexagonal => turn(0.5, 0.75f64.sqrt()),
    };
    Grid::affine(array, [211.3, 208.8], [turn(1.0, 0.0), second], [SIDE, SIDE])
}

fn share(r: f64) -> f64 {
    1.0 / (1.0 + ((r - 0.46 * PITCH) / 0.6).exp())
}

/// Grey levels without noise, and each pixel's share of light.
fn draw(scene: &Scene, seed: u64) -> (Vec<f64>, Vec<f32>) {
    let (grid, waves) = (grid(scene.array), Waves::new(seed, scene.direction));
    let (sin, cos) = ROTATION.sin_cos();
    let [rows, columns, mix] = scene.spacing.map(|l| l / PITCH);
    // An object point at X, seen from the centre c, is at c + (1 − S/P)(X − c).
    let (a, b, c) = (1.0 - rows, -mix, 1.0 - columns);
    let determinant = a * c - b * b;
    let share_at = |k: usize| {
        let (x, y) = ((k % SIDE) as f64, (k / SIDE) as f64);
        let lens = grid.nearest(x, y);
        (lens, x - lens.x, y - lens.y)
    };
    let pixel = |k: usize| {
        let (lens, dx, dy) = share_at(k);
        let (u, v) = (dx * cos + dy * sin, dy * cos - dx * sin);
        let (cu, cv) = (lens.x * cos + lens.y * sin, lens.y * cos - lens.x * sin);
        let (ou, ov) = ((c * u - b * v) / determinant, (a * v - b * u) / determinant);
        // The texture's waves are given in px of a micro-image in focus: the object plane is that much larger.
        let scale = 1.0 - IN_FOCUS / PITCH;
        (128.0 + waves.at((cu + ou) * scale, (cv + ov) * scale)) * share(dx.hypot(dy))
    };
    let shares = (0..SIDE * SIDE)
        .map(|k| {
            let (_, dx, dy) = share_at(k);
            share(dx.hypot(dy)) as f32
        })
        .collect();
    ((0..SIDE * SIDE).map(pixel).collect(), shares)
}

fn exposed(levels: &[f64], seed: u64) -> RawImage {
    let mut random = Pcg64::seed_from_u64(seed);
    let noise = Normal::new(0.0, NOISE).unwrap();
    let samples = levels.iter().map(|v| (v + noise.sample(&mut random)).round().clamp(0.0, 255.0) as u8).collect();
    RawImage::from_u8(SIDE, SIDE, samples)
}

fn prepared(scene: &Scene, texture: u64, noise: u64) -> SpacingFrame {
    let (levels, shares) = draw(scene, texture);
    SpacingFrame::new(&exposed(&levels, noise), None, &shares, &grid(scene.array)).unwrap()
}

fn measured(scene: &Scene, texture: u64, noise: u64) -> Result<Spacing, SpacingError> {
    measure_spacing(&[prepared(scene, texture, noise)], &options())
}

fn options() -> SpacingOptions {
    SpacingOptions { bound: true, ..SpacingOptions::new(PITCH / 1.0175) }
}

#[test]
fn rows_and_columns_may_have_spacings_of_their_own() {
    for array in [ArrayKind::Square, ArrayKind::Hexagonal] {
        let scene = Scene { array, spacing: [19.9, 19.6, 0.07], direction: None };
        let found = measured(&scene, 1, 2).unwrap();
        assert!((found.on_axis_px - 19.75).abs() < 3.0 * found.sigma_px, "{found:?}");
        assert!((found.row_column_px - 0.3).abs() < 0.015, "{found:?}");
        // Along +45° the spacing is the mean plus the mix, along −45° the mean less it.
        assert!((found.diagonal_px - 0.14).abs() < 0.015, "{found:?}");
    }
}

#[test]
fn the_bound_is_what_theory_has_for_this_texture() {
    // Robinson and Milanfar's bound for one shift, with the texture itself unknown: a point is seen by all microlenses
    // within R/k of it, so that what tells is its place less the mean over its views.
    let found = measured(&Scene::plain(IN_FOCUS), 3, 4).unwrap();
    let k = 1.0 - 19.7 / PITCH;
    let radius = found.window_px;
    let lenses = (SIDE as f64 / PITCH - 1.5).powi(2);
    let pixels = lenses * std::f64::consts::PI * radius * radius;
    let spread = radius * radius / 4.0 * (1.0 - k * k);
    let variance = NOISE * NOISE * k * k / (pixels * 2.0 * Waves::new(3, None).slope_energy() * spread);
    // Curvature is unknown too: over a square field r² has the mean 2/3 and the variance 8/45, and takes its share.
    let theory = PITCH * (variance * (1.0 + (4.0 / 9.0) / (8.0 / 45.0))).sqrt();
    let bound = found.sigma_bound_px.unwrap();
    let ratio = bound / theory;
    // The micro-images at the frame's edge have fewer views, and gain and offset cost a little.
    assert!((0.97..1.2).contains(&ratio), "{bound:.6} px, theory {theory:.6} px");
}

#[test]
fn the_scatter_over_noise_is_what_the_frame_says_and_near_the_bound() {
    const SEEDS: u64 = 24;
    let scene = Scene::plain(IN_FOCUS);
    let (levels, shares) = draw(&scene, 5);
    let results: Vec<Spacing> = (0..SEEDS)
        .map(|seed| {
            let frame = SpacingFrame::new(&exposed(&levels, seed), None, &shares, &grid(scene.array));
            let options = SpacingOptions { start_px: Some(19.7), ..options() };
            measure_spacing(&[frame.unwrap()], &options).unwrap()
        })
        .collect();
    let n = results.len() as f64;
    let mean = results.iter().map(|s| s.on_axis_px).sum::<f64>() / n;
    let scatter = (results.iter().map(|s| (s.on_axis_px - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let random = results.iter().map(|s| s.sigma_random_px).sum::<f64>() / n;
    let bound = results.iter().map(|s| s.sigma_bound_px.unwrap()).sum::<f64>() / n;
    // The scatter of 24 frames is known to 15 %.
    assert!((0.6..1.6).contains(&(scatter / random)), "scatter {scatter:.6}, said {random:.6}");
    assert!(random > 0.95 * bound && random < 2.0 * bound, "random {random:.6}, bound {bound:.6}");
    assert!((mean - 19.7).abs() < 0.002, "mean {mean}");
}

#[test]
fn the_map_finds_the_micro_images_that_show_something_else() {
    let scene = Scene::plain(IN_FOCUS);
    let (mut levels, shares) = draw(&scene, 6);
    let (other, _) = draw(&scene, 77);
    let grid = grid(scene.array);
    // One micro-image looks elsewhere, one is dead.
    for (index, from) in [([2, 3], Some(&other)), ([-3, -2], None)] {
        for k in 0..SIDE * SIDE {
            if grid.index_of((k % SIDE) as f64, (k / SIDE) as f64) == index {
                levels[k] = from.map_or(2.0, |other| other[k]);
            }
        }
    }
    let frame = SpacingFrame::new(&exposed(&levels, 1), None, &shares, &grid).unwrap();
    let (spacing, map) = measure_spacing_map(&[frame], &options()).unwrap();
    assert!((spacing.on_axis_px - 19.7).abs() < 0.005, "{spacing:?}");
    let state = |index: [i32; 2]| map.lenses.iter().find(|l| l.index == index).unwrap().state;
    assert_eq!(state([2, 3]), LensState::Mismatched);
    assert_ne!(state([-3, -2]), LensState::Matched);
    let matched: Vec<_> = map.lenses.iter().filter(|l| l.state == LensState::Matched).collect();
    assert!(matched.len() + 4 > map.lenses.len(), "{} of {}", matched.len(), map.lenses.len());
    let wrong = matched.iter().filter(|l| (l.spacing_px - 19.7).abs() > 3.0 * l.sigma_px).count();
    assert!(wrong * 20 < matched.len(), "{wrong} of {}", matched.len());
    assert!(matched.iter().all(|l| l.sigma_px < 0.3));
}

#[test]
fn a_mosaic_is_measured_in_green() {
    let scene = Scene::plain(IN_FOCUS);
    let ((levels, shares), (other, _)) = (draw(&scene, 11), draw(&scene, 12));
    for pattern in CfaPattern::ALL {
        // Red and blue see another texture, weaker.
        let mosaic: Vec<f64> = (0..SIDE * SIDE)
            .map(|k| match pattern.channel(k % SIDE, k / SIDE) {
                Channel::Green => levels[k],
                Channel::Red => 0.5 * other[k],
                Channel::Blue => 0.35 * (levels[k] + other[k]),
            })
            .collect();
        let raw = exposed(&mosaic, 3);
        let frame = SpacingFrame::new(&raw, Some(pattern), &shares, &grid(scene.array)).unwrap();
        let found = measure_spacing(&[frame], &options()).unwrap();
        assert!((found.on_axis_px - 19.7).abs() < 3.0 * found.sigma_px, "{pattern:?}: {found:?}");
        assert!(found.sigma_px < 0.01 && found.sigma_random_px > found.sigma_bound_px.unwrap(), "{found:?}");
        assert!((found.noise_grey_levels / NOISE - 1.0).abs() < 0.5, "{found:?}");
    }
}

#[test]
fn a_spacing_that_changed_during_the_exposure_is_refused() {
    const MOMENTS: usize = 9;
    let smeared = |change: f64| {
        let mut mean = vec![0.0; SIDE * SIDE];
        for k in 0..MOMENTS {
            let share = (k as f64 + 0.5) / MOMENTS as f64 - 0.5;
            let (levels, _) = draw(&Scene::plain(IN_FOCUS + share * change), 13);
            mean.iter_mut().zip(levels).for_each(|(m, v)| *m += v / MOMENTS as f64);
        }
        let (_, shares) = draw(&Scene::plain(IN_FOCUS), 13);
        let frame = SpacingFrame::new(&exposed(&mean, 1), None, &shares, &grid(ArrayKind::Square)).unwrap();
        measure_spacing(&[frame], &options())
    };
    match smeared(2.0) {
        Err(SpacingError::Moved { change_px }) => assert!((change_px - 2.0).abs() < 0.5, "{change_px}"),
        other => panic!("{other:?}"),
    }
    let still = smeared(0.2).unwrap();
    assert!((still.on_axis_px - 19.7).abs() < 3.0 * still.sigma_px, "{still:?}");
}

#[test]
fn texture_in_one_direction_only_is_refused() {
    let stripes = Scene { direction: Some(ROTATION), ..Scene::plain(IN_FOCUS) };
    let refused = measured(&stripes, 8, 9).unwrap_err();
    assert_eq!(refused, SpacingError::OneDirection { along_rows: true });
}
