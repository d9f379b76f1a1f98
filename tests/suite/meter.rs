//! The meter: the spacing in every frame while somebody reads, lost at once and found again.

use std::sync::Arc;

use plenalign::control::Service;
use plenalign::control::events::ShellState;
use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::control::measuring::measurement::MeasurementRequest;
use plenalign::control::motion::lease::Permit;
use plenalign::control::reading::{NoReading, Reading};
use plenalign::device::AxisName;
use plenalign::device::faults::{Faults, PictureFault};
use plenalign::imaging::combined::{Combined, Since};
use plenalign::units::Millimetres;
use tokio::sync::watch;

use super::bench::{permit, quick_axes, run, service, small_config};
use super::until::until;

/// Where the focus axis goes from where it was homed, mm.
const BY_MM: [f64; 4] = [1.0, 2.5, 2.6, -0.6];

type Readings = watch::Receiver<Option<Arc<Reading>>>;

/// A bench with a white frame taken and a flat board before the camera, nearly in focus.
async fn ready() -> Arc<Service> {
    let mut config = small_config(3);
    quick_axes(&mut config.bench);
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

/// Homes the focus axis; where it then stands, mm.
async fn home(service: &Arc<Service>, permit: &Permit) -> f64 {
    service.home_axis(permit, AxisName::Focus).await.unwrap();
    until("the focus axis is homed", async || {
        let view = service.axis_view(AxisName::Focus);
        view.position_mm.filter(|_| view.homed && !view.moving)
    })
    .await
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
        let combined = reading.combined.unwrap();
        let off = (combined.value - reading.spacing_target_px).abs();
        assert_eq!(reading.in_focus, off <= service.config().assembly.blur_limit_px);
        let sigma = sigma_px.hypot(combined.sigma);
        assert!((combined.value - spacing_px).abs() < 4.0 * sigma, "{combined:?} for {spacing_px} ± {sigma_px}");
    }
}

/// Whether the focus axis stood at a place (mm) when a frame was taken.
fn stands_at(reading: &Reading, mm: f64) -> bool {
    reading.frame.focus.position.is_some_and(|at| (at.value() - mm).abs() < 0.002)
}

/// Readings up to the first whose combined frames are as wanted.
async fn up_to(readings: &mut Readings, wanted: impl Fn(&Reading, &Combined) -> bool) -> Vec<Arc<Reading>> {
    let mut read = Vec::new();
    loop {
        read.push(next(readings).await);
        if read.last().is_some_and(|last| last.combined.is_some_and(|combined| wanted(last, &combined))) {
            return read;
        }
    }
}

#[tokio::test]
async fn frames_are_combined_until_an_axis_or_the_picture_moves() {
    let service = ready().await;
    let permit = permit(&service);
    let at_mm = home(&service, &permit).await;
    let mut readings = service.readings();
    let first = next(&mut readings).await.combined.unwrap();
    assert_eq!((first.frames, first.span_s, first.since), (1, 0.0, Since::Start));
    up_to(&mut readings, |_, combined| combined.frames >= 8 && combined.sigma < first.sigma).await;

    let to_mm = at_mm + 0.03;
    service.move_axis(&permit, AxisName::Focus, Millimetres(to_mm)).await.unwrap();
    let there = |reading: &Reading| stands_at(reading, to_mm);
    // Homing, too, was a motion.
    let anew = |reading: &Reading, combined: &Combined| {
        there(reading) && combined.since == Since::Axis && combined.frames >= 5
    };
    let moved = up_to(&mut readings, anew).await;
    let spans_motion = |reading: &&Arc<Reading>| !reading.frame.focus.settled;
    assert!(moved.iter().filter(spans_motion).all(|reading| reading.combined.is_none_or(|c| c.frames == 1)));
    // Nothing of where the axis stood before is in it.
    let mut later = u32::MAX;
    let mut within =
        |combined: Combined| 1 < combined.frames && combined.frames < std::mem::replace(&mut later, combined.frames);
    let mut in_it = moved.iter().rev().take_while(|reading| reading.combined.is_some_and(&mut within));
    assert!(in_it.all(|reading| there(reading)), "{:?}", moved.last().unwrap().combined);

    let mut faults = Faults::default();
    faults.scene.board_displaced_mm = 2.0;
    set(&service, faults);
    let displaced = up_to(&mut readings, |_, combined| combined.since == Since::Picture).await;
    assert!(displaced.last().unwrap().combined.unwrap().frames == 1);
}

/// Of a white frame of another setting nothing is left in what is read once the axis rests.
#[tokio::test]
async fn at_rest_the_meter_reads_as_whole_measurements_do_wherever_the_axis_has_gone() {
    let service = ready().await;
    let permit = permit(&service);
    let at_mm = home(&service, &permit).await;
    let mut readings = service.readings();
    for by_mm in BY_MM {
        let to_mm = at_mm + by_mm;
        service.move_axis(&permit, AxisName::Focus, Millimetres(to_mm)).await.unwrap();
        let there = |reading: &Reading, combined: &Combined| {
            stands_at(reading, to_mm) && reading.frame.focus.settled && combined.frames >= 5
        };
        let read = up_to(&mut readings, there).await.last().unwrap().combined.unwrap();
        let (spacing_px, sigma_px) = whole(&service).await;
        let (off, sigma) = (read.value - spacing_px, sigma_px.hypot(read.sigma));
        println!("{by_mm:+} mm: {:.4} px, off by {off:+.4} ± {sigma:.4} px", read.value);
        assert!(off.abs() < 3.0 * sigma, "{by_mm} mm: {read:?} for {spacing_px} ± {sigma_px} px");
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
                // Nothing of the old board is in it.
                let combined = reading.combined.unwrap();
                let sigma = sigma_px.hypot(combined.sigma);
                assert!((combined.value - after_px).abs() < 4.0 * sigma, "{combined:?} for {after_px} ± {sigma_px}");
                found = true;
            }
            Err(NoReading::Lost(_)) => lost = true,
            Err(NoReading::Refused(why)) => panic!("{why}"),
        }
    }
}

#[tokio::test]
async fn an_old_picture_given_again_is_measured_in_whole_no_more() {
    let service = ready().await;
    let (_onlooker, mut readings) = (service.look_on(), service.readings());
    let began = jiff::Timestamp::now();
    let whole = || service.measurement().filter(|measured| measured.captured_at > began);
    while whole().is_none() {
        next(&mut readings).await;
    }
    let mut faults = Faults::default();
    faults.camera.frozen = true;
    set(&service, faults);
    let frozen = loop {
        let reading = next(&mut readings).await;
        if reading.spacing.is_err() {
            break reading.frame.captured_at;
        }
    };
    // Several times as many as there are from one whole measurement to the next.
    for _ in 0..300 {
        next(&mut readings).await;
    }
    assert!(whole().unwrap().captured_at <= frozen, "{:?}", whole());
    assert!(service.recent().clarities.iter().all(|then| then.at <= frozen), "an old picture's clarity is charted");
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
