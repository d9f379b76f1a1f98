//! How clear a view is: the energy of its gradient, how like another it is, and how much its patches show.

use super::depth::{DepthMap, DepthState};
use super::grid::Grid;
use super::view::{Patches, View};
use crate::raw::RawImage;

/// Energy of gradient of a view scaled to [0, 255], Eq. 20.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eog {
    /// Σ [(f(x+1, y) − f(x, y))² + (f(x, y+1) − f(x, y))²], grey levels squared: the paper's figure, which grows with
    /// the picture's size.
    pub sum: f64,
    /// The sum over the number of pixels that enter it, grey levels squared: comparable between pictures of different
    /// size. Noise of σ grey levels adds 4 σ².
    pub mean_per_pixel: f64,
}

/// Energy of gradient (Eq. 20) of a view's luminance, its darkest pixel taken as 0 and its brightest as 255. Pixels
/// without a right and a lower neighbour do not enter; a view of one grey level has none.
#[must_use]
pub fn eog(view: &View) -> Eog {
    let values = view.luminance();
    let (least, greatest) = range(&values);
    if view.width < 2 || view.height < 2 || greatest.partial_cmp(&least) != Some(std::cmp::Ordering::Greater) {
        return Eog { sum: 0.0, mean_per_pixel: 0.0 };
    }
    let scale = 255.0 / f64::from(greatest - least);
    let mean_per_pixel = scale * scale * gradient_energy(view);
    Eog { sum: mean_per_pixel * ((view.width - 1) * (view.height - 1)) as f64, mean_per_pixel }
}

/// The sum of Eq. 20 over the number of pixels that enter it, of a view's luminance as it is, its range not scaled: for
/// views whose luminance has been brought to a common one. NaN without a pixel that has both neighbours.
#[must_use]
pub fn gradient_energy(view: &View) -> f64 {
    let (w, h) = (view.width, view.height);
    let sum: f64 = gradient_squares(&view.luminance(), [w, h]).sum();
    sum / (w.saturating_sub(1) * h.saturating_sub(1)) as f64
}

/// The terms of Eq. 20, row by row: of every pixel that has a right and a lower neighbour.
fn gradient_squares(values: &[f32], [w, h]: [usize; 2]) -> impl Iterator<Item = f64> + '_ {
    (0..h.saturating_sub(1)).flat_map(move |y| {
        let (row, below) = (&values[y * w..][..w], &values[(y + 1) * w..][..w]);
        row.windows(2)
            .zip(below)
            .map(|(pair, under)| f64::from(pair[1] - pair[0]).powi(2) + f64::from(under - pair[0]).powi(2))
    })
}

/// How sharp a raw frame is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sharpness {
    /// Energy of gradient (Eq. 20), mean per pixel, grey levels of 255 squared: of the micro-images' rims, of the texture
    /// in them, and of noise, of which only the second changes with focus.
    pub energy: f64,
    /// What noise changes it by, standard, grey levels squared: at most, as how it differs over the frame says.
    pub sigma: f64,
}

/// How sharp a raw frame is, the micro-images left as they are: comparable between frames of one board in one light.
#[must_use]
pub fn sharpness(raw: &RawImage) -> Sharpness {
    let (w, h) = (raw.width(), raw.height());
    let scale = (255.0 / f64::from(raw.white_level())).powi(2);
    let (mut sum, mut square) = (0.0, 0.0);
    for energy in gradient_squares(&raw.to_f32(), [w, h]) {
        sum += energy;
        square += energy * energy;
    }
    let count = (w.saturating_sub(1) * h.saturating_sub(1)) as f64;
    let mean = sum / count;
    Sharpness { energy: scale * mean, sigma: scale * ((square / count - mean * mean) / count).max(0.0).sqrt() }
}

/// The least and the greatest of some values.
fn range(values: &[f32]) -> (f32, f32) {
    values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(least, greatest), &v| (least.min(v), greatest.max(v)))
}

/// Side of the windows that structural similarity is taken over, px.
const SSIM_WINDOW: usize = 8;

/// Structural similarity of two views' luminances, −1 to 1, mean over windows of 8×8 pixels every four; the constants are
/// its authors' (0.01 and 0.03 of the range of the first). `None` where the sizes differ or no window fits.
#[must_use]
pub fn ssim(one: &View, other: &View) -> Option<f64> {
    let (w, h) = (one.width, one.height);
    if [other.width, other.height] != [w, h] || w < SSIM_WINDOW || h < SSIM_WINDOW {
        return None;
    }
    let (a, b) = (one.luminance(), other.luminance());
    let (least, greatest) = range(&a);
    let range = f64::from(greatest - least).max(1e-9);
    let [c1, c2] = [0.01, 0.03].map(|k: f64| (k * range).powi(2));
    let (mut total, mut windows) = (0.0, 0.0);
    for top in (0..=h - SSIM_WINDOW).step_by(SSIM_WINDOW / 2) {
        for left in (0..=w - SSIM_WINDOW).step_by(SSIM_WINDOW / 2) {
            let mut sums = [0.0f64; 5];
            for y in top..top + SSIM_WINDOW {
                for k in y * w + left..y * w + left + SSIM_WINDOW {
                    let (x, y) = (f64::from(a[k]), f64::from(b[k]));
                    for (sum, term) in sums.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                        *sum += term;
                    }
                }
            }
            let [x, y, xx, yy, xy] = sums.map(|sum| sum / (SSIM_WINDOW * SSIM_WINDOW) as f64);
            let (vx, vy, cov) = (xx - x * x, yy - y * y, xy - x * y);
            total += (2.0 * x * y + c1) * (2.0 * cov + c2) / ((x * x + y * y + c1) * (vx + vy + c2));
            windows += 1.0;
        }
    }
    Some(total / windows)
}

/// How much the borders between a view's patches show: the mean step from pixel to pixel across them over the mean step
/// within patches. 1 where they do not show; block artefacts raise it. `None` where there is no step to compare with.
#[must_use]
pub fn blockiness(view: &View, grid: &Grid) -> Option<f64> {
    let [within, across] = steps(view, grid, |_| 1.0);
    let ratio = (across.absolute / across.count) / (within.absolute / within.count);
    ratio.is_finite().then_some(ratio)
}

/// Energy of gradient (Eq. 20) of what a view shows of its scene: without the steps across the borders of its patches,
/// which block artefacts make, and with what several patches show counted once. `patches` are those that it was drawn
/// with, `known` the spacings of the scene. `None` where there is no step within a patch.
///
/// A patch too large for what it shows has at its edges what its neighbours show, too; of its energy counts the part
/// that a patch of the right size would have.
#[must_use]
pub fn eog_of_scene(view: &View, grid: &Grid, patches: Patches, known: &DepthMap) -> Option<Eog> {
    let share = |index: [i32; 2]| -> f64 {
        let Patches::Fixed(drawn_px) = patches else { return 1.0 };
        let lens = known.lens(index).filter(|lens| lens.state != DepthState::Unknown);
        lens.map_or(1.0, |lens| {
            let patch = |spacing_px: f64| grid.pitch_px() - spacing_px;
            (patch(lens.spacing_px) / patch(drawn_px)).powi(2).min(1.0)
        })
    };
    let [within, _] = steps(view, grid, share);
    let values = view.luminance();
    let (least, greatest) = range(&values);
    let scale = 255.0 / f64::from(greatest - least);
    // A pixel enters Eq. 20 with two steps.
    let mean_per_pixel = 2.0 * within.square / within.count * scale * scale;
    let pixels = view.width.saturating_sub(1) * view.height.saturating_sub(1);
    mean_per_pixel.is_finite().then_some(Eog { sum: mean_per_pixel * pixels as f64, mean_per_pixel })
}

/// Steps from pixel to pixel: how many, and the sums of their size and of its square.
#[derive(Debug, Clone, Copy, Default)]
struct Steps {
    count: f64,
    absolute: f64,
    square: f64,
}

/// The steps to the right and down within a view's patches, and those across their borders; of the squares each patch's
/// share counts.
fn steps(view: &View, grid: &Grid, share: impl Fn([i32; 2]) -> f64) -> [Steps; 2] {
    let (w, h) = (view.width, view.height);
    let values = view.luminance();
    let owners: Vec<[i32; 2]> = view.extent().owners(grid).collect();
    let mut found = [Steps::default(); 2];
    for y in 0..h {
        for x in 0..w {
            let here = y * w + x;
            let right = (x + 1 < w).then_some(here + 1);
            let below = (y + 1 < h).then_some(here + w);
            for next in [right, below].into_iter().flatten() {
                let steps = &mut found[usize::from(owners[here] != owners[next])];
                let step = f64::from((values[here] - values[next]).abs());
                steps.count += 1.0;
                steps.absolute += step;
                steps.square += share(owners[here]) * step * step;
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::depth::LensDepth;
    use crate::optics::ArrayKind;

    #[test]
    fn a_checkerboard_has_the_most_and_a_plain_picture_none() {
        let board = View::grey(4, 3, (0..12).map(|k| ((k % 4 + k / 4) % 2) as f32 * 7.0).collect());
        // Six pixels have both neighbours, and each differs from both by the full scale.
        let found = eog(&board);
        assert!((found.sum - 6.0 * 2.0 * 255.0 * 255.0).abs() < 1e-6, "{found:?}");
        assert!((found.mean_per_pixel - 2.0 * 255.0 * 255.0).abs() < 1e-6);
        let plain = View::grey(4, 3, vec![9.0; 12]);
        assert_eq!(eog(&plain).sum, 0.0);
        let ramp = View::grey(256, 2, (0..512).map(|k| (k % 256) as f32).collect());
        assert!((eog(&ramp).mean_per_pixel - 1.0).abs() < 1e-9);
    }

    #[test]
    fn sharpness_is_the_raw_frames_own_whatever_its_depth() {
        let stripes = |light: u16| (0..64 * 64).map(move |k| if k % 64 % 8 < 4 { 100 } else { 100 + light });
        let eight = sharpness(&RawImage::from_u8(64, 64, stripes(51).map(|level| level as u8).collect()));
        // Of 63 steps along a row 15 go over an edge.
        assert!((eight.energy - 15.0 / 63.0 * 51.0 * 51.0).abs() < 1e-6, "{eight:?}");
        let sixteen = sharpness(&RawImage::from_u16(64, 64, 16, stripes(51).map(|level| level * 257).collect()));
        assert!((sixteen.energy / eight.energy - 1.0).abs() < 1e-6, "{sixteen:?}");
        let fainter = sharpness(&RawImage::from_u8(64, 64, stripes(20).map(|level| level as u8).collect()));
        assert!(eight.energy - fainter.energy > 4.0 * eight.sigma.hypot(fainter.sigma));
        let plain = sharpness(&RawImage::from_u8(64, 64, vec![80; 64 * 64]));
        assert_eq!((plain.energy, plain.sigma), (0.0, 0.0));
    }

    /// Patches of a grid 4 px apart, each darker by a step than the last one: what is within them is what is measured.
    #[test]
    fn steps_across_patches_are_told_from_those_within() {
        let grid = Grid::affine(ArrayKind::Square, [17.5, 17.5], [[4.0, 0.0], [0.0, 4.0]], [32, 32]);
        let of = |value: &dyn Fn(usize, usize) -> f32| {
            let values = (0..32 * 32).map(|k| value(k % 32, k / 32)).collect();
            View::grey(32, 32, values)
        };
        let fine = |x: usize, y: usize| ((x + y) % 2) as f32;
        let plain = of(&|x, y| 100.0 * fine(x, y));
        assert!((blockiness(&plain, &grid).unwrap() - 1.0).abs() < 1e-6);
        let lens = |index: [i32; 2], spacing_px: f64, state: DepthState| {
            let [x, y] = grid.position(index[0], index[1]);
            LensDepth { index, centre_px: [x, y], spacing_px, sigma_px: 0.1, ssim: 1.0, state }
        };
        let everywhere = |spacing_px: f64, state: DepthState| {
            let indices = (-9..9).flat_map(|j| (-9..9).map(move |i| [i, j]));
            DepthMap::of(&grid, indices.map(|index| lens(index, spacing_px, state)).collect())
        };
        let right = everywhere(2.0, DepthState::Measured);
        let of_scene = |view: &View, patches: Patches| eog_of_scene(view, &grid, patches, &right).unwrap();
        let (all, within) = (eog(&plain), of_scene(&plain, Patches::Own(&right)));
        assert!((within.mean_per_pixel / all.mean_per_pixel - 1.0).abs() < 1e-6);
        // Steps of 20 levels within patches, of 100 or more between them.
        let blocks = of(&|x, y| 20.0 * fine(x, y) + 120.0 * fine(x / 4, y / 4));
        assert!(blockiness(&blocks, &grid).unwrap() > 4.0);
        let within = of_scene(&blocks, Patches::Own(&right));
        let scale = (255.0f64 / 140.0).powi(2);
        assert!((within.mean_per_pixel / (2.0 * 400.0 * scale) - 1.0).abs() < 1e-6, "{within:?}");
        // Patches of 3 px where 2 px are right show more than half of what they show twice; those of 1.5 px nothing.
        let once = of_scene(&plain, Patches::Fixed(1.0)).sum / all.sum;
        assert!((once - 4.0 / 9.0).abs() < 1e-6, "{once}");
        assert!((of_scene(&plain, Patches::Fixed(2.5)).sum / all.sum - 1.0).abs() < 1e-6);
        // Of what nothing is known nothing is taken away.
        let unknown = everywhere(2.0, DepthState::Unknown);
        let whole = eog_of_scene(&plain, &grid, Patches::Fixed(1.0), &unknown).unwrap();
        assert!((whole.sum / all.sum - 1.0).abs() < 1e-6);
    }

    #[test]
    fn similarity_falls_with_noise_and_turns_with_the_sign() {
        let wave = |k: usize| 100.0 + 50.0 * ((k % 32) as f32 * 0.7).sin() * ((k / 32) as f32 * 0.5).cos();
        let of = |value: &dyn Fn(usize) -> f32| View::grey(32, 32, (0..1024).map(value).collect());
        let original = of(&wave);
        assert!((ssim(&original, &original).unwrap() - 1.0).abs() < 1e-6);
        let noisy = ssim(&original, &of(&|k| wave(k) + if k * 7 % 3 == 0 { 12.0 } else { -6.0 })).unwrap();
        let noisier = ssim(&original, &of(&|k| wave(k) + if k * 7 % 3 == 0 { 48.0 } else { -24.0 })).unwrap();
        assert!(noisier < noisy && noisy < 0.99, "{noisier} {noisy}");
        assert!(ssim(&original, &of(&|k| 200.0 - wave(k))).unwrap() < -0.5);
        assert_eq!(ssim(&original, &View::grey(16, 64, vec![0.0; 1024])), None);
    }
}
