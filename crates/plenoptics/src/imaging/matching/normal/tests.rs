//! Normal equations beside those worked out plainly.

use super::*;
use crate::imaging::grid::Grid;
use crate::imaging::matching::model::{Directions, USUAL_TERMS};
use crate::imaging::matching::plan::{Link, Pair, Row};
use crate::imaging::matching::score::Content;
use crate::optics::ArrayKind;

fn pair(at: [f64; 2], direction: u8, block: u8, region: u8) -> Pair {
    let basis = [[20.0, 1.0], [10.0 - 0.866_025_4, 17.320_508 + 0.5]];
    let grid = Grid::affine(ArrayKind::Hexagonal, [200.0, 200.0], basis, [400, 400]);
    let place = Directions::new(&grid).place(at, usize::from(direction));
    Pair { first: 0, second: 1, unit: [1.0, 0.0], place, direction, block, region }
}

/// Pairs all over two regions whose scores are those of a departure from the model: along the pair alone, or across
/// it, too.
fn job(model: &Model, departure: &DVector<f64>, across: bool) -> Job {
    let (mut links, mut scores) = (Vec::new(), Vec::new());
    for k in 0..720u32 {
        let at = [f64::from(k % 20) / 10.0 - 0.95, f64::from(k / 20 % 18) / 9.0 - 0.95];
        let pair = pair(at, (k % 3) as u8, (k % 36) as u8, (k / 360) as u8);
        let region = usize::from(pair.region);
        let [along, perpendicular] = model.derivatives(region, &pair.place);
        let local = model.local(departure, region);
        let shift = [local.dot(&along), local.dot(&perpendicular)];
        let (ii, mixed, jj) = (50.0 + f64::from(k % 7), 4.0 - f64::from(k % 5), 40.0 + f64::from(k % 3));
        let information = if across { [[ii, mixed], [mixed, jj]] } else { [[ii, 0.0], [0.0, 0.0]] };
        links.push(Link { pair, slots: [0, 1] });
        scores.push(PairScore {
            score: information.map(|row| (row[0] * shift[0] + row[1] * shift[1]) as f32),
            information: information.map(|row| row.map(|v| v as f32)),
            misfit: 0.9,
            content: Content { covariance: 90.0, variances: [100.0, 100.0], noise: 10.0 },
            ..PairScore::default()
        });
    }
    scores[7] = PairScore::NONE;
    Job { rows: vec![Row { tiles: Vec::new(), links }], slots: 2, scores }
}

#[test]
fn the_step_leads_to_the_unknowns_that_made_the_scores() {
    for across in [false, true] {
        let model = Model { scales: vec![1.0, 0.7], free: (0..USUAL_TERMS).collect(), ..Model::flat(vec![0.0; 2]) };
        let truth = DVector::from_vec(vec![0.02, -0.03, -0.01, 0.005, 0.03, 0.008, 0.0, 0.0]);
        let jobs = [job(&model, &truth, across)];
        let mut normal = Normal::default();
        normal.gather(&[Compared { jobs: &jobs, noise: 2.0 }], &model);
        assert_eq!(normal.region_pairs, [359, 360]);
        let contents = &normal.contents;
        assert!((contents.correlation() - 0.9).abs() < 1e-9 && !contents.are_blank());
        let inverse = normal.inverse().unwrap();
        let step = normal.step(&inverse);
        // What arrays are like pulls a little at the terms that are about it.
        assert!((&step - &truth).amax() < 2e-4, "{step}");
        // Nothing but that is left to scatter once the step is made.
        assert!(normal.scatter(&model, &inverse, &step).amax() < 1e-8);
        // A term that is held does not move.
        let held = Model { free: vec![0, 1, 3], ..model };
        normal.gather(&[Compared { jobs: &jobs, noise: 2.0 }], &held);
        assert_eq!(normal.step(&normal.inverse().unwrap()).len(), 5);
    }
}

#[test]
fn a_wide_field_demands_its_terms_and_no_other_does() {
    let wide = Model { free: (0..USUAL_TERMS + 3).collect(), ..Model::flat(vec![0.0; 2]) };
    let model = Model { free: (0..USUAL_TERMS).collect(), ..wide.clone() };
    // Spacings, tilts, curvature, then the terms that are nil in both, and those of a wide field.
    let demanded = |fourth: f64, sixth: f64, model: &Model| {
        let usual = [0.02, -0.03, -0.01, 0.005, 0.03, 0.0, 0.0, 0.0];
        let truth = DVector::from_vec([&usual[..], &[fourth, 0.0, sixth]].concat());
        let mut job = job(&wide, &truth, true);
        let mut seed = 7u32;
        for score in &mut job.scores {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            score.score[0] += ((f64::from(seed) / f64::from(u32::MAX) - 0.5) * 4.0) as f32;
        }
        let mut normal = Normal::default();
        normal.gather(&[Compared { jobs: &[job], noise: 2.0 }], model);
        normal.demanded(model)
    };
    assert_eq!(demanded(0.0, 0.0, &model), None);
    let wider = demanded(0.1, 0.0, &model).unwrap();
    assert_eq!(wider, (0..USUAL_TERMS + 2).collect::<Vec<_>>());
    let model = Model { free: wider, ..model };
    assert_eq!(demanded(0.1, 0.0, &model), None);
    assert_eq!(demanded(0.1, 0.1, &model), Some((0..USUAL_TERMS + 3).collect()));
}

#[test]
fn strict_weights_take_out_what_pulls_and_leave_a_clean_frame_alone() {
    let model = Model { free: (0..USUAL_TERMS).collect(), ..Model::flat(vec![0.0; 2]) };
    let truth = DVector::zeros(model.unknowns());
    let refined = |pulled_one_in: usize| {
        let mut job = job(&model, &truth, true);
        for (k, score) in job.scores.iter_mut().enumerate() {
            let pulled = k % pulled_one_in == 1;
            score.misfit = if pulled { 5.0 } else { 0.9 };
            score.residual = score.misfit;
            score.energy = [50.0, 40.0];
            score.score[0] += if pulled { 0.5 * score.information[0][0] } else { 0.0 };
        }
        let (jobs, mut normal) = ([job], Normal::default());
        let compared = [Compared { jobs: &jobs, noise: 2.0 }];
        normal.gather(&compared, &model);
        let step = normal.step(&normal.inverse().unwrap());
        normal.refined(&compared, &model).map(|refined| (step[0], refined))
    };
    assert!(refined(80).is_none());
    let (pulled, Refined { change, covariance, noise }) = refined(10).unwrap();
    assert!(pulled > 0.01 && (pulled + change[0]).abs() < 1e-3, "{pulled} {}", change[0]);
    assert!(covariance[(0, 0)].sqrt() >= PULL_LEFT * change[0].abs() && (0.8..1.5).contains(&noise), "{noise}");
}

#[test]
fn pairs_that_match_badly_count_little() {
    let normal = Normal { halves: vec![12.0, 4.0], ..Normal::default() };
    let weight = |misfit| normal.weight(1, &PairScore { misfit, ..PairScore::default() });
    assert!(weight(0.5) > 0.98 && weight(4.0) == 0.5 && weight(40.0) < 0.01);
}
