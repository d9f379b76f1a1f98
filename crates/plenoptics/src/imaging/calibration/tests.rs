//! The fit against exact spacings, the figures of the reference, its own stated uncertainties, and set-ups that cannot tell.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::line::checked;
use super::*;
use crate::optics::mla::spacing;

const F: f64 = 20.0;
const B: f64 = 0.340_255_6;
/// d of the joint solution and of the air design.
const FOCUSED: f64 = 21.652_860_5;
const AIR: f64 = 19.447_82;
const MIDDLE: f64 = 167.174_586;
const PITCH: f64 = 0.1 / 0.00345;
const N: f64 = 3.13;

fn options() -> CalibrationOptions {
    CalibrationOptions::new(FrameOptions::new(PITCH), 0.00345, MainLens { focal_length: F })
}

fn boards(step: f64) -> [f64; 3] {
    [MIDDLE - step, MIDDLE, MIDDLE + step]
}

/// Spacings (px) that boards at these distances have in a camera with this d, b and f.
fn spacings(distances: &[f64], d: f64, b: f64, f: f64) -> Vec<f64> {
    let lens = MainLens { focal_length: f };
    distances.iter().map(|&l| spacing(0.1, lens.image_distance(l) - d, b) / 0.00345).collect()
}

fn independent(count: usize, sigma_px: f64) -> DMatrix<f64> {
    DMatrix::from_diagonal_element(count, count, sigma_px * sigma_px)
}

fn ratio(d: f64, b: f64, sigma_px: f64) -> Option<MicroImagePitch> {
    Some(MicroImagePitch { pitch_px: PITCH * (1.0 + b / d), sigma_px })
}

/// The fit of exact spacings at these distances, with 0.005 px of claimed uncertainty.
fn exact(
    distances: &[f64],
    d: f64,
    pitch: Option<MicroImagePitch>,
    options: &CalibrationOptions,
) -> Result<ConjugateLine, CalibrationError> {
    let l = spacings(distances, d, B, F);
    fit_line(distances, &l, &independent(l.len(), 0.005), pitch, options)
}

#[test]
fn exact_spacings_give_d_and_b_back() {
    for d in [FOCUSED, AIR, 24.3] {
        let distances = boards(8.0);
        let c = exact(&distances, d, None, &options()).unwrap();
        assert!((c.d_mm - d).abs() < 1e-9 && (c.b_mm - B).abs() < 1e-9, "{c:?}");
        assert!((c.image_distance(N).0 - d - N * B).abs() < 1e-9);
        assert_eq!((c.shift, c.focal_length, c.micro_image_pitch), (None, None, None));
    }
}

#[test]
fn exact_spacings_give_every_further_unknown_back() {
    let wide = [120.0, 150.0, 190.0, 260.0];
    let unknown = CalibrationOptions { distances: Known::NotAtAll, ..options() };
    let fit_f = CalibrationOptions { focal_length: Known::NotAtAll, ..options() };
    let both = CalibrationOptions { focal_length: Known::NotAtAll, ..unknown };
    // In Galilean and in Keplerian mode; f is configured 3 % off, the boards' places are counted from anywhere.
    for d in [FOCUSED, 24.3] {
        for (distances, options, pitch) in [
            (&boards(8.0)[..], &unknown, None),
            (&boards(25.0)[..2], &unknown, ratio(d, B, 1e-5)),
            (&wide[..], &unknown, None),
            (&wide[..3], &fit_f, ratio(d, B, 1e-5)),
            (&wide[..], &fit_f, ratio(d, B, 1e-5)),
            (&wide[..], &both, ratio(d, B, 1e-5)),
        ] {
            let l = spacings(distances, d, B, F);
            let covariance = independent(l.len(), 1e-4);
            let mut options = options.clone();
            if options.focal_length.free() {
                options.main_lens.focal_length = 1.03 * F;
            }
            for origin in [0.0, -500.0, 30.0] {
                let from = if options.distances.free() { distances[0] - origin } else { 0.0 };
                let given: Vec<f64> = distances.iter().map(|l| l - from).collect();
                let c = fit_line(&given, &l, &covariance, pitch, &options).unwrap();
                // To rounding, times what the condition makes of it.
                let close = |found: f64, true_: f64| (found - true_).abs() < 1e-6;
                assert!(close(c.d_mm, d) && close(c.b_mm, B), "{origin} {options:?} {c:?}");
                assert!(c.shift.is_none_or(|s| (s.value_mm - from).abs() < 1e-5), "{origin} {c:?}");
                assert!(c.focal_length.is_none_or(|f| close(f.value_mm, F)), "{c:?}");
                assert!((c.levels[0].distance_mm - distances[0]).abs() < 1e-5, "{c:?}");
                assert!(c.micro_image_pitch.is_none_or(|p| close(p.fitted_px, p.measured.pitch_px)), "{c:?}");
            }
        }
    }
}

#[test]
fn known_distances_give_the_weighted_straight_line() {
    // The closed form of a straight line with correlated, slightly contradictory spacings.
    let distances = [150.0, 160.0, 170.0, 185.0];
    let mut l = spacings(&distances, FOCUSED, B, F);
    l.iter_mut().zip([0.006, -0.004, 0.003, -0.007]).for_each(|(l, error)| *l += error);
    let covariance = DMatrix::from_fn(4, 4, |i, j| 2e-5 / (1.0 + (i as f64 - j as f64).powi(2)));
    for held in [None, Some((0.341, 0.0004))] {
        let mut options = CalibrationOptions { hold_b: held, ..options() };
        let c = fit_line(&distances, &l, &covariance, None, &options).unwrap();
        let n = |k: usize| PITCH / (PITCH - l[k]);
        let v = nalgebra::DVector::from_fn(4, |k, _| options.main_lens.image_distance(distances[k]));
        let design = DMatrix::from_fn(4, 2, |k, j| if j == 0 { 1.0 } else { n(k) });
        let slope = |k: usize| c.b_mm * n(k).powi(2) / PITCH;
        let weight = DMatrix::from_fn(4, 4, |i, j| slope(i) * slope(j) * covariance[(i, j)]).try_inverse().unwrap();
        let mut normal = design.transpose() * &weight * &design;
        let mut right = design.transpose() * &weight * &v;
        if let Some((b, sigma)) = held {
            normal[(1, 1)] += 1.0 / (sigma * sigma);
            right[1] += b / (sigma * sigma);
        }
        let inverse = normal.try_inverse().unwrap();
        let solution = &inverse * right;
        assert!((c.d_mm - solution[0]).abs() < 1e-9 && (c.b_mm - solution[1]).abs() < 1e-9, "{c:?} {solution}");
        let left = &v - &design * &solution;
        let chi_squared = (left.transpose() * &weight * &left)[(0, 0)];
        assert!((c.chi_squared / chi_squared - 1.0).abs() < 1e-6, "{} {chi_squared}", c.chi_squared);
        assert_eq!(c.degrees_of_freedom, 2 + usize::from(held.is_some()));
        let widening = (chi_squared / c.degrees_of_freedom as f64).max(1.0);
        for (i, row) in c.covariance.iter().enumerate() {
            for (j, term) in row.iter().enumerate() {
                assert!((term / (inverse[(i, j)] * widening) - 1.0).abs() < 1e-6, "{term} {inverse}");
            }
        }
        // What all distances share comes on top, as far as dv/dL carries it.
        options.distances = Known::Within(0.05);
        let shared = fit_line(&distances, &l, &covariance, None, &options).unwrap();
        assert!(shared.d_sigma_mm() > c.d_sigma_mm());
    }
}

#[test]
fn uncertainties_are_those_of_the_reference() {
    let near = |value: f64, expected: f64| (value / expected - 1.0).abs() < 0.06;
    let line = |distances: &[f64], d: f64, pitch, options: &CalibrationOptions| {
        let c = exact(distances, d, pitch, options).unwrap();
        (c.d_sigma_mm(), c.image_distance(N).1, c)
    };
    // optics.md: boards at 167 ± 8 mm and 0.005 px give σ(d) = 2.9 µm and σ(d + N b) = 0.34 µm.
    let (d, v, _) = line(&boards(8.0), FOCUSED, None, &options());
    assert!(near(d, 2.9e-3) && near(v, 0.34e-3), "{d} {v}");
    // At Δv = 0: 85 and 57 µm, or 3 µm with b held.
    let (d, v, _) = line(&boards(8.0), AIR, None, &options());
    assert!(near(d, 85e-3) && near(v, 57e-3), "{d} {v}");
    let held = CalibrationOptions { hold_b: Some((B, 0.0)), ..options() };
    let (_, v, _) = line(&boards(8.0), AIR, None, &held);
    assert!((v - 3e-3).abs() < 0.5e-3, "{v}");
    // Boards at 700, 800, 900 mm before the air design: 7 µm, and 0.7 µm with 0.0005 px.
    let (d, ..) = line(&[700.0, 800.0, 900.0], AIR, None, &options());
    assert!(near(d, 6.6e-3), "{d}");
    // An unknown distance: 242 µm with boards ±8 mm apart, 28 µm with ±25 mm.
    let unknown = CalibrationOptions { distances: Known::NotAtAll, ..options() };
    let (_, v, c) = line(&boards(8.0), FOCUSED, None, &unknown);
    assert!(near(v, 242e-3) && near(c.shift.unwrap().sigma_mm, 13.06), "{c:?}");
    let (_, v, _) = line(&boards(25.0), FOCUSED, None, &unknown);
    assert!(near(v, 28e-3), "{v}");
    // With the micro-image pitch to 1e-4 px: 4.0 and 1.3 µm.
    let (_, v, _) = line(&boards(8.0), FOCUSED, ratio(FOCUSED, B, 1e-4), &unknown);
    assert!(near(v, 4.0e-3), "{v}");
    let (_, v, _) = line(&boards(25.0), FOCUSED, ratio(FOCUSED, B, 1e-4), &unknown);
    assert!(near(v, 1.3e-3), "{v}");
    // And f: 50 µm, 19 µm.
    let fit_f = CalibrationOptions { focal_length: Known::NotAtAll, ..options() };
    for (step, expected) in [(8.0, 49.8e-3), (25.0, 19.3e-3)] {
        let (.., c) = line(&boards(step), FOCUSED, ratio(FOCUSED, B, 1e-4), &fit_f);
        assert!(near(c.focal_length.unwrap().sigma_mm, expected), "{c:?}");
    }
    // 1 mm of error in the distance is 18.5 µm in v.
    let shared = CalibrationOptions { distances: Known::Within(1.0), ..options() };
    let (_, v, c) = line(&boards(8.0), FOCUSED, None, &shared);
    assert!(near(v, 18.5e-3) && near(c.shift.unwrap().sigma_mm, 1.0), "{c:?}");
}

#[test]
fn stated_uncertainties_cover_the_truth() {
    let unknown = CalibrationOptions { distances: Known::NotAtAll, ..options() };
    let fit_f = CalibrationOptions { focal_length: Known::NotAtAll, ..options() };
    let five: Vec<f64> = (-2..=2).map(|k| MIDDLE + 12.5 * f64::from(k)).collect();
    let three = boards(25.0).to_vec();
    let within = CalibrationOptions { distances: Known::Within(0.3), ..options() };
    let each = CalibrationOptions { distance_each_sigma_mm: 0.05, ..options() };
    let lens = CalibrationOptions { focal_length: Known::Within(0.1), ..options() };
    let mla = CalibrationOptions { mla_pitch_relative_sigma: 2e-5, ..unknown };
    for (case, distances, pitch_sigma, options) in [
        ("known", &three, None, &options()),
        ("unknown distance", &three, None, &unknown),
        ("unknown distance, five boards", &five, None, &unknown),
        ("unknown distance and pitch", &three, Some(1e-4), &unknown),
        ("uncertain MLA pitch", &three, Some(1e-4), &mla),
        ("f and pitch, five boards", &five, Some(1e-4), &fit_f),
        ("uncertain distance", &three, None, &within),
        ("uncertain steps", &five, None, &each),
        ("uncertain f and pitch", &three, Some(3e-4), &lens),
    ] {
        covers(case, distances, pitch_sigma, options);
    }
}

/// Fits noisy spacings of a camera whose lens, boards and pitch are off by what the options allow.
fn covers(case: &str, distances: &[f64], pitch_sigma: Option<f64>, options: &CalibrationOptions) {
    const DRAWS: usize = 400;
    let mut random = Pcg64::seed_from_u64(7);
    let mut normal = |sigma: f64| sigma * Distribution::<f64>::sample(&StandardNormal, &mut random);
    // Draws within one and within two standard uncertainties, for d, b, d + N b and the further unknowns.
    let mut within = [[0usize; 2]; 5];
    let mut drawn = [0usize; 5];
    let mut degrees_of_freedom = 0;
    for _ in 0..DRAWS {
        let f = F + normal(options.focal_length.prior_mm().unwrap_or(0.0));
        let shift = normal(options.distances.prior_mm().unwrap_or(0.0));
        let stood: Vec<f64> = distances.iter().map(|l| l + shift + normal(options.distance_each_sigma_mm)).collect();
        let l: Vec<f64> = spacings(&stood, FOCUSED, B, f).into_iter().map(|l| l + normal(0.005)).collect();
        let pitch = pitch_sigma.map(|sigma_px| {
            let true_px = PITCH * (1.0 + B / FOCUSED) * (1.0 + normal(options.mla_pitch_relative_sigma));
            MicroImagePitch { pitch_px: true_px + normal(sigma_px), sigma_px }
        });
        let c = fit_line(distances, &l, &independent(l.len(), 0.005), pitch, options).unwrap();
        degrees_of_freedom = c.degrees_of_freedom;
        let (v, v_sigma) = c.image_distance(N);
        let mut deviations =
            vec![(c.d_mm - FOCUSED) / c.d_sigma_mm(), (c.b_mm - B) / c.b_sigma_mm(), (v - FOCUSED - N * B) / v_sigma];
        deviations.push(c.shift.map_or(f64::NAN, |e| (e.value_mm - shift) / e.sigma_mm));
        deviations.push(c.focal_length.map_or(f64::NAN, |e| (e.value_mm - f) / e.sigma_mm));
        for (k, deviation) in deviations.into_iter().enumerate().filter(|(_, deviation)| !deviation.is_nan()) {
            drawn[k] += 1;
            within[k][0] += usize::from(deviation.abs() < 1.0);
            within[k][1] += usize::from(deviation.abs() < 2.0);
        }
    }
    for (k, &[one, two]) in within.iter().enumerate().filter(|(k, _)| drawn[*k] > 0) {
        let (one, two) = (one as f64 / DRAWS as f64, two as f64 / DRAWS as f64);
        println!("{case}, {degrees_of_freedom} beyond: unknown {k}: {one:.3} {two:.3}");
        // 68.3 and 95.4 % of 400 draws, ± 3 of their own standard deviations; up to 73.3 and 97 % where a residual
        // widens by chance.
        let most = if degrees_of_freedom == 0 { 0.753 } else { 0.80 };
        assert!((0.613..most).contains(&one), "{case}: unknown {k}: {one}");
        assert!((0.922..=0.995).contains(&two), "{case}: unknown {k}: {two}");
    }
}

fn refused(result: Result<ConjugateLine, CalibrationError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn what_cannot_be_told_apart_is_refused_by_name() {
    let unknown = CalibrationOptions { distances: Known::NotAtAll, ..options() };
    let fit_f = CalibrationOptions { focal_length: Known::NotAtAll, ..options() };
    let both = CalibrationOptions { focal_length: Known::NotAtAll, ..unknown };
    let many: Vec<f64> = (0..9).map(|k| MIDDLE - 24.0 + 6.0 * f64::from(k)).collect();
    // f as an unknown needs more than spacings against distance, however many boards within a bench's reach.
    for distances in [&boards(8.0)[..], &boards(25.0), &many] {
        let said = refused(exact(distances, FOCUSED, None, &fit_f));
        assert!(said.starts_with("f, b and d cannot be told apart from spacings against distance alone"), "{said}");
    }
    // Without a held b or the pitch, nothing tells f and distance together: said before anything is measured, and
    // found from the equations themselves.
    let said = checked(&many, &both).unwrap_err().to_string();
    assert!(said.starts_with("f, the boards' distance, b and d cannot") && said.contains("however many"), "{said}");
    assert_eq!(refused(exact(&many, FOCUSED, None, &both)), said);
    // With the pitch they still lie too near each other.
    let said = refused(exact(&boards(8.0), FOCUSED, ratio(FOCUSED, B, 1e-4), &both));
    assert!(said.starts_with("f, the boards' distance, b and d cannot"), "{said}");
    assert!(said.contains("and the micro-image pitch (") && said.contains("further apart"), "{said}");
    // Far from focus the curvature of N over the distance is lost.
    let said = refused(exact(&boards(8.0), AIR, None, &unknown));
    assert!(said.starts_with("the boards' distance, b and d cannot be told apart from spacings against the steps"));
    assert!(said.contains("add the micro-image pitch"), "{said}");
    // Boards at nearly one distance.
    let said = refused(exact(&[MIDDLE, MIDDLE + 0.02], FOCUSED, None, &options()));
    assert!(said.contains("put the boards further apart"), "{said}");
    // A pitch too uncertain to help.
    let said = refused(exact(&[MIDDLE], FOCUSED, ratio(FOCUSED, B, 0.3), &options()));
    assert!(said.starts_with("b and d cannot be told apart from spacings against distance and the micro-image"));
    assert!(exact(&[MIDDLE], FOCUSED, ratio(FOCUSED, B, 1e-4), &options()).is_ok());
    // No camera has a farther board's spacing the larger.
    let l = spacings(&boards(25.0), FOCUSED, B, F);
    let turned: Vec<f64> = l.iter().rev().copied().collect();
    let options = CalibrationOptions { hold_b: Some((B, 0.0)), ..unknown };
    let wrong = fit_line(&boards(25.0), &turned, &independent(3, 0.005), None, &options);
    assert!(wrong.is_err() || wrong.as_ref().is_ok_and(|c| c.chi_squared > 1e3), "{wrong:?}");
    let below = MicroImagePitch { pitch_px: 28.9, sigma_px: 1e-3 };
    let said = refused(fit_line(&boards(25.0), &l, &independent(3, 0.005), Some(below), &options));
    assert!(said.contains("28.9") && said.contains("above the MLA pitch"), "{said}");
}

#[test]
fn degenerate_levels_are_refused() {
    let refused = |levels: &[f64]| checked(levels, &options()).unwrap_err();
    assert!(matches!(refused(&[700.0]), CalibrationError::TooFewLevels { needed: 2, .. }));
    assert!(matches!(refused(&[700.0, 800.0, 700.0]), CalibrationError::EqualLevels { .. }));
    assert!(matches!(refused(&[700.0, 15.0]), CalibrationError::ImpossibleLevel { .. }));
    assert!(matches!(refused(&[700.0, f64::NAN]), CalibrationError::ImpossibleLevel { .. }));
    let close = fit_line(&[700.0, 701.0], &[20.0, 19.99], &independent(2, 0.01), None, &options());
    assert!(matches!(close, Err(CalibrationError::Degenerate { .. })), "{close:?}");
    // Steps may be counted from anywhere, but three boards are needed, or two and the pitch.
    let mut unknown = CalibrationOptions { distances: Known::NotAtAll, ..options() };
    let said = checked(&[0.0, 8.0], &unknown).unwrap_err().to_string();
    assert!(said.contains("the boards' distance, b and d") && said.contains("at least 3"), "{said}");
    assert_eq!(checked(&[8.0, 0.0, -8.0], &unknown).unwrap(), [-8.0, 0.0, 8.0]);
    unknown.micro_image_pitch = Some(PitchSource::Frame);
    assert!(checked(&[0.0, 8.0], &unknown).is_ok());
}

#[test]
fn any_start_ends_in_a_number_or_an_error() {
    let mut random = Pcg64::seed_from_u64(3);
    for _ in 0..300 {
        let distances: Vec<f64> = (0..3).map(|k| 50.0 * f64::from(k) + random.random_range(0.0..40.0)).collect();
        let l: Vec<f64> = (0..3).map(|_| random.random_range(2.0..60.0)).collect();
        let pitch = random
            .random_bool(0.5)
            .then(|| MicroImagePitch { pitch_px: PITCH * random.random_range(0.9..1.2), sigma_px: 1e-3 });
        let options = CalibrationOptions {
            distances: if random.random_bool(0.7) { Known::NotAtAll } else { Known::Within(1.0) },
            focal_length: if random.random_bool(0.5) { Known::NotAtAll } else { Known::Exactly },
            ..options()
        };
        if let Ok(c) = fit_line(&distances, &l, &independent(3, 0.01), pitch, &options) {
            assert!(c.d_sigma_mm().is_finite() && c.b_sigma_mm().is_finite() && c.condition.is_finite(), "{c:?}");
            assert!(c.levels.iter().all(|level| level.distance_mm > 0.0 && level.residual_mm.is_finite()), "{c:?}");
        }
    }
}
