//! A first picture that cannot be measured: the focus axis is led to where one can.

use plenalign::config::Config;
use plenalign::control::job::{JobSnapshot, JobState};
use plenalign::device::AxisName;
use plenalign::device::faults::Faults;
use plenalign::optics::MlaMode;

use super::bench::{align, service, small_config};

/// A bench whose array stands so much further from the lens (mm) than its focus axis reads.
fn reads_otherwise(by_mm: f64) -> Config {
    let mut config = small_config(4);
    config.bench.simulation.lens_to_mla_error_mm = by_mm;
    (config.bench.focus.low_limit_mm, config.bench.focus.high_limit_mm) = (-8.0, 12.0);
    config
}

fn said(job: &JobSnapshot, words: &str) -> bool {
    job.log.iter().any(|line| line.message.contains(words))
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_stands_out_of_the_range_of_focus_is_led_into_it() {
    let mut keplerian = reads_otherwise(-3.5);
    keplerian.mla.mode = MlaMode::Keplerian;
    for config in [reads_otherwise(3.0), keplerian] {
        let mode = config.mla.mode;
        let job = align(&service(config).await).await;
        assert_eq!(job.state, JobState::Converged, "{mode:?}: {:?}\n{:#?}", job.reason, job.log);
        assert!(said(&job, "led by the picture's sharpness"), "{mode:?}: {:#?}", job.log);
    }
}

/// The aperture is set for the Δv that the picture shows, whatever the axis reads there.
#[tokio::test(start_paused = true)]
async fn the_aperture_is_set_where_the_axis_reads_otherwise() {
    let job = align(&service(reads_otherwise(-2.5)).await).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    assert!(said(&job, "Set the aperture"), "{:#?}", job.log);
}

/// Where nothing can be measured within the travel, it is said where it was looked for.
#[tokio::test(start_paused = true)]
async fn no_way_in_is_said_with_where_it_was_looked_for() {
    let mut config = reads_otherwise(10.0);
    (config.bench.focus.low_limit_mm, config.bench.focus.high_limit_mm) = (-1.3, 2.8);
    let job = align(&service(config).await).await;
    let reason = job.reason.clone().unwrap();
    assert_eq!(job.state, JobState::Failed, "{reason}");
    assert!(reason.contains("nowhere from -1.30 to 2.80 mm") && reason.contains("sharpest at"), "{reason}");
}

/// Through the shell the same search says what was not set up as asked, and leaves the focus axis where it was.
#[tokio::test(start_paused = true)]
async fn what_cannot_be_measured_through_the_shell_is_still_named() {
    let service = service(small_config(4)).await;
    let mut faults = Faults::default();
    faults.scene.tank_empty = true;
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
    let job = align(&service).await;
    let reason = job.reason.clone().unwrap();
    assert!(said(&job, "led by the picture's sharpness"), "{reason}");
    assert!(reason.contains("a tank with no water in it"), "{reason}");
    let report = job.report.unwrap();
    // The spacing is that in air, where the shell's target is none.
    assert_eq!(report.spacing_target_px, report.spacing_targets.paraxial_px);
    assert_ne!(report.spacing_targets.window_px, Some(report.spacing_target_px));
    assert!((report.spacing_px.unwrap() - report.spacing_target_px).abs() < 0.03, "{report:?}");
    let kept = report.focus_readback_mm;
    let focus = service.bench_view().axes.iter().find(|axis| axis.axis == AxisName::Focus).unwrap().position_mm;
    assert!((focus.unwrap() - kept.unwrap()).abs() < 0.01, "{focus:?} {kept:?}");
}
