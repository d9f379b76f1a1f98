//! What a budget claims, on rendered frames: whole alignments of simulated benches of which nothing is quite as the
//! program is told. What they truly are is drawn from what the configuration says that it is uncertain by.

use std::path::PathBuf;
use std::sync::Arc;

use plenalign::config::Config;
use plenalign::control::job::{JobSnapshot, JobState};
use plenalign::control::{Service, open_bench};
use plenalign::store::Store;

use super::alignment::number;
use super::bench::{align, small_config};
use super::budget::{Aligned, Bench, Coverage, TILT_SIGMA};

/// The program's configuration of a bench.
fn configured(seed: u64) -> Config {
    let mut config = small_config(seed);
    // The simulated pupil is where the configured one is.
    config.uncertainty.exit_pupil_mm = 0.0;
    config
}

/// A bench as it truly is, as the configuration that the simulation is made from.
fn simulated(bench: &Bench) -> Config {
    let mut config = bench.config.clone();
    config.main_lens.focal_length_mm = bench.focal_length;
    config.mla.pitch_mm = bench.mla_pitch;
    config.mla.focal_length_mm = bench.mla_focal_length;
    // b is what f_MLA and the angular resolution make it (Eqs. 6 and 7).
    let signed = 1.0 / (1.0 - bench.mla_to_sensor / bench.mla_focal_length);
    config.mla.angular_resolution = signed.abs();
    config.shell.outer_radius_mm = bench.shell.outer_radius;
    config.shell.inner_radius_mm = bench.shell.inner_radius;
    config.shell.refractive_index = bench.shell.n_shell;
    config.water.refractive_index = Some(bench.shell.n_water);
    let at_zero = config.design().air_lens_to_mla();
    let mrad = |tilt: [f64; 2]| tilt.map(|tilt| 1000.0 * tilt);
    let simulation = &mut config.bench.simulation;
    simulation.lens_to_mla_error_mm = bench.lens_to_mla - at_zero;
    simulation.mla_tilt_mrad = mrad(bench.mla_tilt);
    simulation.lens_tilt_mrad = mrad(bench.lens_tilt);
    simulation.shell_decentre_mm = bench.decentre;
    simulation.level_errors_mm = bench.boards_in_air;
    simulation.water_board_error_mm = bench.board_in_water;
    // One board for both media.
    simulation.board_tilt_mrad = mrad(bench.board_tilt[0]);
    simulation.focus_scale_error = bench.focus_scale - 1.0;
    simulation.e_scale_error = bench.e_scale - 1.0;
    simulation.e_zero_offset_mm = bench.e_zero;
    config
}

/// What a job truly came to, and what its budget says of it.
fn judged(bench: &Bench, job: &JobSnapshot) -> Result<Aligned, String> {
    if job.state != JobState::Converged {
        return Err(job.reason.clone().unwrap_or_else(|| job.state.to_string()));
    }
    let report = job.report.as_ref().ok_or("no report")?;
    let (truth, budget) = (report.truth.as_ref().ok_or("no truth")?, report.budget.clone().ok_or("no budget")?);
    if truth["touched_shell"] != false {
        return Err("the lens has touched the shell".to_owned());
    }
    let (d, e) = (number(truth, "lens_to_mla_mm"), number(truth, "e_mm"));
    Ok(Aligned { truth: [bench.delta_v(d), e, bench.off_focus_px(d, e)], budget })
}

/// What is kept of a bench: the errors of Δv, e and focus in units of their uncertainties, or why it was refused; and
/// whether Δv was trimmed in the end.
type CameTo = (Result<[f64; 3], String>, bool);

async fn aligned(seed: u64) -> (Result<Aligned, String>, bool) {
    let bench = Bench::draw(configured(seed), TILT_SIGMA, seed);
    let opened = open_bench(&Arc::new(simulated(&bench))).await.expect("a simulated bench opens");
    let told = Arc::new(bench.config.clone());
    let service = Service::start(told, "a test's configuration".to_owned(), opened, Store::in_memory());
    let job = align(&service).await;
    let trimmed = job.report.as_ref().is_some_and(|report| report.shell_step_done.contains("Δv trimmed"));
    (judged(&bench, &job), trimmed)
}

/// Of this one e is wrong by more than twice what the picture scatters by, towards the shell: by axis, water and boards
/// together.
#[tokio::test(start_paused = true)]
async fn what_a_rendered_bench_comes_to_is_covered() {
    let (aligned, _) = aligned(13).await;
    let errors = aligned.unwrap().errors_in_sigmas();
    assert!(errors.iter().all(|error| error.abs() < 3.0), "Δv, e and focus are {errors:.2?} sigmas off");
}

/// `RENDERED=1-500`: the promised coverage, and no more than one in twenty refused. What each bench came to is kept in the
/// folder `RENDERED_RESULTS`, so that a broken run goes on where it ended.
#[tokio::test(start_paused = true)]
#[ignore = "seconds a bench: tests/long.sh"]
async fn many_rendered_benches_are_covered() {
    let range = std::env::var("RENDERED").unwrap_or_else(|_| "1-500".to_owned());
    let (first, last) = range.split_once('-').expect("a range such as 1-500");
    let results = PathBuf::from(std::env::var_os("RENDERED_RESULTS").expect("RENDERED_RESULTS names a folder"));
    let (mut all, mut trims) = (Coverage::default(), 0);
    for seed in first.parse().unwrap()..=last.parse().unwrap() {
        let file = results.join(format!("rendered-{seed}.json"));
        if !file.exists() {
            let (aligned, trimmed) = aligned(seed).await;
            let came_to: CameTo = (aligned.map(|aligned| aligned.errors_in_sigmas()), trimmed);
            std::fs::write(&file, serde_json::to_vec(&came_to).unwrap()).unwrap();
        }
        let (errors, trimmed): CameTo = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        println!("{seed}: {errors:.2?}");
        trims += u32::from(trimmed);
        all.take(seed, errors);
    }
    println!("of {trims} Δv was trimmed in the end");
    all.judge();
}
