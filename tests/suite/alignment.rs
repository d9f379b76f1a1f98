//! Whole alignments on the simulated bench, judged by the simulated truth.

use plenalign::config::{CameraDriver, Config, LBoundSource, ShellStep};
use plenalign::control::budget::Verdict;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::control::{Refusal, ServiceError};
use plenalign::device::AxisName;
use plenalign::device::faults::Faults;
use plenalign::optics::MlaMode;
use plenalign::units::Millimetres;

use super::bench::{align, permit, run, service, small_config};

fn truth(job: &JobSnapshot) -> &serde_json::Value {
    job.report.as_ref().unwrap().truth.as_ref().unwrap()
}

pub(super) fn number(value: &serde_json::Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {value}"))
}

/// Whether what the report says of Δv and e is true within three of its standard uncertainties.
fn covers(job: &JobSnapshot) {
    let budget = job.report.as_ref().unwrap().budget.as_ref().unwrap();
    for (name, value, sigma) in
        [("delta_v_mm", budget.delta_v_mm, budget.delta_v_sigma_mm), ("e_mm", budget.e_mm, budget.e_sigma_mm)]
    {
        let truth = number(truth(job), name);
        assert!((value - truth).abs() < 3.0 * sigma, "{name} is {truth}, said to be {value} ± {sigma}");
    }
}

/// What an alignment of the reference bench has to keep, whatever its seed.
fn judge(config: &Config, job: &JobSnapshot) {
    let log: Vec<&str> = job.log.iter().map(|line| line.message.as_str()).collect();
    let context = format!("{:?}: {:?}\n{}", job.state, job.reason, log.join("\n"));
    assert_eq!(job.state, JobState::Converged, "{context}");
    let report = job.report.as_ref().unwrap();
    let (end, air) = (truth(job), &truth(job)["air"]);
    assert!(number(air, "focus_error_mm").abs() < 0.010, "{air} {context}");
    assert!((report.spacing_px.unwrap() - report.spacing_target_px).abs() < 0.03, "{context}");
    let design = config.design();
    let spacing = design.spacing_at(
        design.shell.equivalent_distance(design.object_distance, number(end, "e_mm")),
        number(end, "delta_v_mm"),
    );
    // Near the axis: what the estimator's window adds is in the target that it was brought to.
    let true_error_px = spacing / config.pixel_pitch().millimetres() - report.spacing_targets.paraxial_px;
    assert!(true_error_px.abs() < 0.03, "{true_error_px} px; {context}");
    covers(job);
    assert!(report.moves_air <= 4 && report.moves_shell <= 5, "{context}");
    let wall = report.e_wall_mm - config.bench.e.zero_uncertainty_mm;
    assert!(number(end, "least_e_with_shell_mm") >= wall, "{end}");
    assert_eq!(end["touched_shell"], false);
}

#[tokio::test(start_paused = true)]
async fn the_reference_bench_converges() {
    for seed in [1, 2] {
        let config = small_config(seed);
        let job = align(&service(config.clone()).await).await;
        judge(&config, &job);
    }
}

/// In Keplerian mode the board of the solution is out of the range of focus at the Δv of the air design: the job has it
/// put where the lens is focused first.
#[tokio::test(start_paused = true)]
async fn a_keplerian_array_converges() {
    let mut config = small_config(3);
    config.mla.mode = MlaMode::Keplerian;
    let job = align(&service(config.clone()).await).await;
    judge(&config, &job);
    let asked = job.log.iter().filter(|line| line.message.contains("put the triple-level board")).count();
    assert_eq!(asked, 2, "{:?}", job.log);
}

/// Lens, boards and shell as far off as an ordinary bench has them: it focuses all the same, and says that Δv and e are
/// not known as well as the spacing is.
#[tokio::test(start_paused = true)]
async fn a_bench_that_is_off_says_how_little_it_knows() {
    let mut config = small_config(2);
    let simulation = &mut config.bench.simulation;
    simulation.focal_length_error = 0.005;
    simulation.board_placement_error_mm = 0.3;
    simulation.shell_decentre_mm = [0.4, 0.0];
    simulation.board_tilt_mrad = [5.0, 0.0];
    simulation.mla_tilt_mrad = [2.0, -1.0];
    simulation.lens_tilt_mrad = [-1.0, 2.0];
    let job = align(&service(config).await).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    covers(&job);
    let budget = job.report.as_ref().unwrap().budget.as_ref().unwrap();
    assert_eq!(budget.in_focus, Verdict::Within, "{}", budget.conclusion);
    assert_eq!(budget.delta_v, Verdict::CannotBeTold, "{}", budget.conclusion);
    // The spacing alone would say a hundredth of it.
    assert!(budget.delta_v_sigma_mm > 0.02 && budget.e_sigma_mm > 0.1, "{}", budget.conclusion);
}

#[tokio::test(start_paused = true)]
async fn an_axis_shorter_than_its_scale_never_passes_the_wall() {
    let mut config = small_config(3);
    config.bench.simulation.e_scale_error = -0.05;
    config.bench.simulation.focus_scale_error = -0.05;
    let job = align(&service(config.clone()).await).await;
    judge(&config, &job);
}

/// The configuration takes its scale to be known to 5 %.
#[tokio::test(start_paused = true)]
async fn an_e_axis_that_goes_further_than_it_reads_touches_nothing() {
    for (error, state) in [(0.3, JobState::Converged), (0.5, JobState::Failed), (0.8, JobState::Failed)] {
        let mut config = small_config(1);
        config.bench.simulation.e_scale_error = error;
        let (home_mm, contact_mm) = (config.bench.e.home_position_mm, config.assembly.contact_mm());
        let service = service(config).await;
        let job = align(&service).await;
        assert_eq!(job.state, state, "{error}: {:?}", job.reason);
        assert_eq!(truth(&job)["touched_shell"], false, "{error}: {:?}", job.iterations);
        assert!(number(truth(&job), "e_mm") > -0.1, "{error}: {:?}", truth(&job));
        // Nor does a hand, once the axis is homed: it goes as near as the job has left it to go, and no nearer.
        let homed = run(&service, JobRequest::of(JobKind::Homing)).await;
        assert_eq!(homed.state, JobState::Succeeded, "{error}: {:?}", homed.reason);
        let nearest_mm = service.bench_view().e_wall_mm;
        let e_mm = home_mm + (1.0 + error) * (nearest_mm - home_mm);
        assert!((contact_mm..10.0).contains(&e_mm), "{error}: {e_mm} at {nearest_mm}");
    }
}

/// Each is far beyond what is configured to be possible: 14 and 20 standard uncertainties, and 25 and three.
#[tokio::test(start_paused = true)]
async fn no_mistake_that_is_not_seen_has_the_lens_touch() {
    let mistakes = [(0.7, 0.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 25.0, -0.6)];
    for (radius_mm, board_mm, zero_mm) in mistakes {
        let mut config = small_config(2);
        config.assembly.initial_e_mm = 8.0;
        config.bench.simulation.water_board_error_mm = board_mm;
        config.bench.simulation.e_zero_offset_mm = zero_mm;
        let service = service(config).await;
        let mut faults = Faults::default();
        faults.scene.shell_radius_mm = radius_mm;
        service.set_faults(faults);
        let job = align(&service).await;
        let ended = format!("{radius_mm}, {board_mm}, {zero_mm} mm: {:?} {:?}", job.state, job.reason);
        assert_eq!(truth(&job)["touched_shell"], false, "{ended}\n{:?}", job.iterations);
    }
}

/// What a job has found out of an axis that goes further than it reads holds for whoever moves it by hand.
#[tokio::test(start_paused = true)]
async fn a_hand_goes_no_nearer_to_the_shell_than_the_picture_lets_it() {
    let mut config = small_config(1);
    config.bench.simulation.e_scale_error = 0.08;
    let wall_mm = config.assembly.e_wall_mm(config.assembly.l_bound_mm);
    let home_mm = config.bench.e.home_position_mm;
    let service = service(config).await;
    let job = align(&service).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    let shown = service.bench_view().e_wall_mm;
    assert!(shown > wall_mm + 1.5, "{shown}");
    let beyond = service.move_axis(&permit(&service), AxisName::E, Millimetres(0.5 * shown)).await;
    assert!(matches!(beyond, Err(ServiceError::Refused(Refusal::Wall { .. }))), "{beyond:?}");
    // As near as it may go, e is at the wall.
    service.move_axis(&permit(&service), AxisName::E, Millimetres(shown)).await.unwrap();
    let mut e = service.bench().e.state();
    let stood_mm =
        e.wait_for(|e| !e.moving && (e.position.value() - shown).abs() < 0.01).await.unwrap().position.value();
    let e_mm = home_mm + 1.08 * (stood_mm - home_mm);
    assert!((e_mm - wall_mm).abs() < 0.2, "{e_mm} at a wall of {wall_mm}");
}

#[tokio::test(start_paused = true)]
async fn a_reversed_e_axis_is_named_after_the_probe() {
    let mut config = small_config(4);
    config.bench.simulation.e_sign_flip = true;
    let job = align(&service(config).await).await;
    assert_eq!(job.state, JobState::Failed);
    let reason = job.reason.clone().unwrap();
    assert!(reason.contains("wrong way") && reason.contains("e axis"), "{reason}");
    // The probe is the only move that the e axis has made with the shell on.
    assert!(number(truth(&job), "e_mm") > 29.0);
}

#[tokio::test(start_paused = true)]
async fn a_reversed_focus_axis_is_named_after_the_probe() {
    let mut config = small_config(5);
    config.bench.simulation.focus_sign_flip = true;
    let job = align(&service(config).await).await;
    assert_eq!(job.state, JobState::Failed);
    let reason = job.reason.clone().unwrap();
    assert!(reason.contains("focus axis") && reason.contains("wrong way"), "{reason}");
    assert!(number(truth(&job), "delta_v_mm").abs() < 0.6, "nothing moves after the probe");
}

#[tokio::test(start_paused = true)]
async fn a_replay_moves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let frame = plenalign::raw::RawImage::from_u8(560, 560, vec![90; 560 * 560]);
    plenalign::raw::write(&folder.path().join("a.png"), &frame).unwrap();
    let mut config = small_config(6);
    config.bench.camera.driver = CameraDriver::Files;
    config.bench.camera.files = folder.path().display().to_string();
    let service = service(config).await;
    for kind in JobKind::ALL.into_iter().filter(|kind| *kind != JobKind::Homing) {
        let mut request = JobRequest::of(kind);
        if kind == JobKind::FocusSweep {
            (request.axis, request.from_mm, request.to_mm) = (Some(AxisName::Focus), Some(0.0), Some(1.0));
        }
        request.duration_s = (kind == JobKind::SpacingWatch).then_some(60.0);
        let refused = service.create_job(&permit(&service), request).await.unwrap_err();
        let ServiceError::Refused(Refusal::NotMeasurable { why }) = &refused else { panic!("{kind:?}: {refused:?}") };
        assert!(why.contains("no axis is driven by them"), "{why}");
    }
    assert!(service.bench_view().camera.unfit.is_some());
    assert!(service.jobs().is_empty(), "a job that cannot measure anything was begun");
    assert!(service.bench_view().axes.iter().all(|axis| !axis.homed), "an axis was homed for a replay");
}

#[tokio::test(start_paused = true)]
async fn the_papers_plain_step_ends_at_the_wall() {
    let mut config = small_config(6);
    config.assembly.shell_step = ShellStep::TranslateE;
    // A board that stands too near makes the criterion lie beyond the wall.
    config.bench.simulation.board_placement_error_mm = -40.0;
    let job = align(&service(config).await).await;
    let report = job.report.unwrap();
    assert_ne!(job.state, JobState::Converged, "{:?}", job.reason);
    assert!(report.e_readback_mm.unwrap() >= report.e_wall_mm - 1e-3);
}

#[tokio::test(start_paused = true)]
async fn l_bound_is_measured_before_the_air_step() {
    let mut config = small_config(7);
    config.assembly.l_bound = LBoundSource::Measure;
    config.bench.simulation.contact_e_mm = 4.0;
    let job = align(&service(config).await).await;
    let report = job.report.clone().unwrap();
    let log: Vec<&str> = job.log.iter().map(|line| line.message.as_str()).collect();
    assert_eq!(job.state, JobState::Converged, "{:?}\n{}", job.reason, log.join("\n"));
    // Near the Δv in question the spacing tells it to some hundredths of a millimetre; 0.5 mm of it is clearance.
    let (_, alone) = log.iter().find_map(|line| line.split_once("by the spacing alone ± ")).unwrap();
    let alone: f64 = alone.split_once(' ').unwrap().0.parse().unwrap();
    assert!((report.l_bound_mm - 4.5).abs() < 0.2 && alone < 0.2, "{} ± {alone}", report.l_bound_mm);
    // What is taken for granted, the shell above all, tells it less well, and nobody is to take it for better.
    assert!(report.l_bound_sigma_mm.unwrap() > alone, "{:?}", report.l_bound_sigma_mm);
    assert!(report.l_bound_mm > 4.0, "the clearance keeps the lens off the shell");
    assert_eq!(report.e_target_mm, report.l_bound_mm);
    assert_eq!(truth(&job)["touched_shell"], false);
}

/// Dust, dead microlenses and dirty ones tilt what three levels side by side show, by as much as is stated of it.
#[tokio::test(start_paused = true)]
async fn dust_and_dead_microlenses_turn_no_board() {
    let mut config = small_config(1);
    let simulation = &mut config.bench.simulation;
    simulation.dust.specks = 200;
    (simulation.microlenses.dead_share, simulation.microlenses.dirty_share) = (0.02, 0.05);
    let job = align(&service(config).await).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    covers(&job);
    let notes = job.report.unwrap().notes;
    assert!(!notes.iter().any(|note| note.contains("turned")), "{notes:?}");
}
