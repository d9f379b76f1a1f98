//! The meter: the spacing in every frame while somebody reads, lost at once and found again.

use std::sync::Arc;

use plenalign::control::Service;
use plenalign::control::events::ShellState;
use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::control::measurement::MeasurementRequest;
use plenalign::control::meter::{NoReading, Reading};
use plenalign::device::faults::{Faults, PictureFault};
use tokio::sync::watch;

use super::bench::{permit, run, service, small_config};

type Readings = watch::Receiver<Option<Arc<Reading>>>;

/// A bench with a white frame taken and a flat board before the camera, nearly in focus.
async fn ready() -> Arc<Service> {
    let mut config = small_config(3);
    let simulation = &mut config.bench.simulation;
    (simulation.preview_rate_hz, simulation.preview_rays) = (100.0, simulation.rays);
    let service = service(config).await;
    service.set_shell(&permit(&service), ShellState::Off).unwrap();
    let watch = JobRequest { duration_s: Some(1.0), ..JobRequest::of(JobKind::SpacingWatch) };
    assert_eq!(run(&service, watch).await.state, JobState::Succeeded);
    service
}

async fn next(readings: &mut Readings) -> Arc<Reading> {
    loop {
        readings.changed().await.unwrap();
        if let Some(reading) = readings.borrow_and_update().clone() {
            return reading;
        }
    }
}

fn set(service: &Service, faults: Faults) {
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
}

/// The spacing (px) that a whole measurement finds, and its standard uncertainty.
async fn whole(service: &Service) -> (f64, f64) {
    let measured = service.measure(MeasurementRequest { settled: true, max_age: None }).await.unwrap();
    (measured.measurement.spacing.spacing_px, measured.measurement.spacing.spacing_sigma_px)
}

#[tokio::test]
async fn frames_are_read_as_whole_measurements_have_them() {
    let service = ready().await;
    let (spacing_px, sigma_px) = whole(&service).await;
    let mut readings = service.readings();
    let mut before = None;
    for _ in 0..20 {
        let reading = next(&mut readings).await;
        assert!(before < Some(reading.frame.seq), "frames come in order");
        before = Some(reading.frame.seq);
        let read = reading.spacing.as_ref().unwrap();
        let sigma = sigma_px.hypot(read.sigma_px);
        assert!((read.on_axis_px - spacing_px).abs() < 4.0 * sigma, "{} for {spacing_px} ± {sigma}", read.on_axis_px);
        let off = (read.on_axis_px - reading.spacing_target_px).abs();
        assert_eq!(reading.in_focus, off <= service.config().assembly.blur_limit_px);
    }
}

#[tokio::test]
async fn another_board_is_lost_at_once_and_found_again() {
    let service = ready().await;
    let (before_px, _) = whole(&service).await;
    let mut readings = service.readings();
    next(&mut readings).await.spacing.as_ref().unwrap();
    let mut faults = Faults::default();
    faults.scene.board_displaced_mm = 500.0;
    set(&service, faults);
    let (after_px, sigma_px) = whole(&service).await;
    assert!((after_px - before_px).abs() > 2.0, "{before_px} and {after_px} px");
    // What was under way shows the old board still; from the first frame of the new one on there is no spacing but its.
    let (mut lost, mut found) = (false, false);
    while !found {
        let reading = next(&mut readings).await;
        match &reading.spacing {
            Ok(read) if !lost && (read.on_axis_px - before_px).abs() < 0.1 => {}
            Ok(read) => {
                let sigma = sigma_px.hypot(read.sigma_px);
                let off = read.on_axis_px - after_px;
                assert!(off.abs() < 4.0 * sigma, "{} for {after_px} ± {sigma}", read.on_axis_px);
                found = true;
            }
            Err(NoReading::Lost(_)) => lost = true,
            Err(NoReading::Refused(why)) => panic!("{why}"),
        }
    }
}

#[tokio::test]
async fn frames_that_cannot_be_measured_are_refused_with_the_reason() {
    let service = ready().await;
    let mut readings = service.readings();
    let faulty = |picture, frozen| {
        let mut faults = Faults::default();
        (faults.camera.picture, faults.camera.frozen) = (picture, frozen);
        faults
    };
    for (faults, word) in [
        (faulty(PictureFault::Dark, false), "lengthen the exposure"),
        (faulty(PictureFault::Saturated, false), "saturated"),
        (faulty(PictureFault::None, true), "old picture"),
    ] {
        set(&service, faults);
        loop {
            match &next(&mut readings).await.spacing {
                Ok(_) => {}
                Err(NoReading::Refused(why) | NoReading::Lost(why)) => {
                    assert!(why.contains(word), "{word}: {why}");
                    break;
                }
            }
        }
        set(&service, Faults::default());
        while next(&mut readings).await.spacing.is_err() {}
    }
}
