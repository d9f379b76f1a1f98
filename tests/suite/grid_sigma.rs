//! Whether the errors of a grid are what it says of them.

use plenalign::imaging::grid::{Grid, GridError, GridOptions, find_grid};
use plenalign::optics::ArrayKind;

use super::rendered::{Rendered, random};

/// Least share of errors within two standard uncertainties, and bounds of their root mean squares' ratio.
const WITHIN_TWO: f64 = 0.93;
const RATIO: std::ops::Range<f64> = 0.7..1.2;

/// Errors of pitch, rotation (as px a pitch) and both coordinates of the centre with their standard uncertainties.
#[derive(Default)]
struct Errors([Vec<[f64; 2]>; 3]);

impl Errors {
    fn add(&mut self, found: &Grid, truth: &Grid) {
        let pitch = truth.pitch_px();
        let turn = (found.rotation() - truth.rotation()) * pitch;
        self.0[0].push([found.pitch_px() - pitch, found.sigma.pitch_px]);
        self.0[1].push([turn, found.sigma.rotation_rad * pitch]);
        let nearest = truth.nearest(found.centre[0], found.centre[1]);
        for error in [found.centre[0] - nearest.x, found.centre[1] - nearest.y] {
            self.0[2].push([error, found.sigma.centre_px]);
        }
    }

    /// What is wrong with them, after saying what they are.
    fn wrong(&self, what: &str) -> Vec<String> {
        let mut wrong = Vec::new();
        for (errors, name) in self.0.iter().zip(["pitch", "rotation", "centre"]) {
            let rms = |k: usize| (errors.iter().map(|e| e[k] * e[k]).sum::<f64>() / errors.len() as f64).sqrt();
            let within = errors.iter().filter(|[error, sigma]| error.abs() < 2.0 * sigma).count();
            let (share, ratio) = (within as f64 / errors.len() as f64, rms(0) / rms(1));
            println!(
                "{what}, {name}: {:.5} px rms, {ratio:.2} of sigma, {:.0} % of {} within two",
                rms(0),
                100.0 * share,
                errors.len()
            );
            if share < WITHIN_TWO || !RATIO.contains(&ratio) {
                wrong.push(format!("{what}, {name}: {share:.3} within two sigma, rms {ratio:.2} of sigma"));
            }
        }
        wrong
    }
}

/// A camera by chance, of a pitch between two.
fn camera(seed: u64, [least, most]: [f64; 2], micro_images_across: f64) -> Rendered {
    let mut state = seed;
    for _ in 0..4 {
        random(&mut state);
    }
    let array = if seed.is_multiple_of(2) { ArrayKind::Square } else { ArrayKind::Hexagonal };
    let pitch_px = least * (most / least).powf(random(&mut state));
    let turned = if array == ArrayKind::Square { 80.0 } else { 50.0 };
    let side = (micro_images_across * pitch_px) as usize;
    Rendered {
        array,
        pitch_px,
        rotation_deg: turned * (random(&mut state) - 0.5),
        offset: [0, 1].map(|_| pitch_px * (random(&mut state) - 0.5)),
        size: [side, side - 15],
        noise: [2.0, 4.0, 8.0][seed as usize / 2 % 3],
        seed,
        ..Rendered::default()
    }
}

fn white(seed: u64, errors: &mut Errors) -> Result<(), GridError> {
    let camera = camera(seed, [10.0, 90.0], 9.0);
    errors.add(&find_grid(&camera.white(), &GridOptions::default())?, &camera.grid());
    Ok(())
}

#[test]
fn grids_of_white_frames_know_their_errors() {
    let mut errors = Errors::default();
    for seed in 0..90 {
        white(seed, &mut errors).unwrap();
    }
    assert_eq!(errors.wrong("white frames"), Vec::<String>::new());
}
