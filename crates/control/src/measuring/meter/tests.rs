//! The meter beside whole measurements.

use super::*;
use crate::budget::AirStep;
use crate::events::{Event, InView, ShellState, TargetSource, TwoBoardsView};
use crate::job::{JobKind, JobRequest};
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::calibrated::tests::preset;
use crate::motion::lease::LeaseRequest;
use crate::{Service, open_bench};
use bench::config::Config;
use bench::device::Setup;
use bench::store::Store;
use plenoptics::imaging::combined::Since;
use plenoptics::raw::RawImage;

/// A small simulated bench whose white frame is known.
async fn ready() -> Arc<Service> {
    ready_with(|_| ()).await
}

/// The same, with some of it configured otherwise.
async fn ready_with(otherwise: impl FnOnce(&mut Config)) -> Arc<Service> {
    let mut config = Config::default();
    otherwise(&mut config);
    (config.sensor.width_px, config.sensor.height_px) = (420, 420);
    let simulation = &mut config.bench.simulation;
    (simulation.rays, simulation.preview_rays, simulation.preview_rate_hz) = (16, 16, 100.0);
    let config = Arc::new(config);
    let bench = open_bench(&config).await.unwrap();
    let service = Service::start(config, "a test's configuration".to_owned(), bench, Store::in_memory());
    let request = LeaseRequest { owner: "a test".to_owned(), note: None, ttl: Duration::from_secs(3600) };
    let grant = service.leases().acquire(request).unwrap();
    let permit = service.leases().permit(Some(&grant.key)).unwrap();
    service.set_shell(&permit, ShellState::Off).unwrap();
    let mut events = service.subscribe();
    let watch = JobRequest { duration_s: Some(1.0), ..JobRequest::of(JobKind::SpacingWatch) };
    let id = service.create_job(&permit, watch).await.unwrap().id;
    while !matches!(events.recv().await.unwrap(), Event::Job { job } if job.id == id && job.state.is_final()) {}
    service
}

/// What a frame measured in whole would say, had it this spacing (px).
async fn measured(service: &Service, frame_seq: u64, spacing_px: f64) -> MeasurementView {
    let mut view = service.eye.measure_live().await.unwrap().unwrap();
    (view.frame_seq, view.spacing.spacing_px) = (frame_seq, spacing_px);
    view
}

/// The next reading's spacing (px), its frame, and since when it is combined.
async fn next(readings: &mut watch::Receiver<Option<Arc<Reading>>>) -> (f64, u64, Since) {
    loop {
        readings.changed().await.unwrap();
        if let Some(reading) = readings.borrow_and_update().clone() {
            let spacing_px = reading.spacing.as_ref().unwrap().on_axis_px;
            return (spacing_px, reading.frame.seq, reading.combined.unwrap().since);
        }
    }
}

#[tokio::test]
async fn a_match_that_a_whole_measurement_contradicts_is_followed_no_further() {
    let service = ready().await;
    let mut readings = service.readings();
    for (off_px, searched) in [(0.9 * SAME_PX, false), (-0.9 * SAME_PX, false), (1.1 * SAME_PX, true)] {
        let (spacing_px, seq, since) = next(&mut readings).await;
        assert_eq!(since, Since::Start);
        service.readings.compare(&measured(&service, seq, spacing_px + off_px).await);
        // A frame may be under way already.
        let mut then = [Since::Start; 3];
        for since in &mut then {
            *since = next(&mut readings).await.2;
        }
        assert_eq!(then.contains(&Since::Lost), searched, "{off_px} px off: {then:?}");
    }
    // Who looks on has frames measured in whole, and each of these is compared.
    let mut compared = service.readings.whole.subscribe();
    let _looking = service.look_on();
    compared.changed().await.unwrap();
    let whole_px = compared.borrow().unwrap().spacing_px;
    let (spacing_px, ..) = next(&mut readings).await;
    assert!((spacing_px - whole_px).abs() < 0.1, "{spacing_px} px read, {whole_px} px in whole");
}

#[tokio::test]
async fn why_a_spacing_is_lost_is_said_between_two_searches_too() {
    let service = ready().await;
    let (sight, white) = (service.eye.sight().unwrap(), service.eye.white_frame().unwrap());
    let newest = service.eye.bench().camera.live().borrow().clone().unwrap();
    let mut followed = Followed::new(&sight).unwrap();
    let mut read = |frame: &Frame| followed.read(frame, Duration::ZERO);
    assert!(read(&newest).is_ok());
    // Every micro-image shows something else.
    let (width, mut seed) = (white.image.width(), 7u32);
    let mut speckle = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        0.5 + 0.5 * f64::from(seed) / f64::from(u32::MAX)
    };
    let speckles: Vec<f64> = (0..width * width / 16 + width).map(|_| speckle()).collect();
    let samples = white.image.to_f32().into_iter().enumerate();
    let samples =
        samples.map(|(at, level)| (f64::from(level) * speckles[at / width / 4 * (width / 4) + at % width / 4]) as u8);
    let image = RawImage::from_u8(width, white.image.height(), samples.collect());
    let otherwise = Frame { image: Arc::new(image), ..(*newest).clone() };
    let mut lost = || match read(&otherwise) {
        Err(NoReading::Lost(why)) => why,
        read => panic!("{read:?}"),
    };
    let [unseen, unfound] = [lost(), lost()];
    assert!(unseen != SEARCHING && unfound != SEARCHING && unseen != unfound, "{unseen}, {unfound}");
    // A search rests for as long as it took.
    assert_eq!(read(&newest).unwrap_err(), NoReading::Lost(unfound));
}

#[tokio::test]
async fn a_calibrated_camera_has_its_target_still_when_the_place_of_its_focus_axis_is_lost() {
    let service = ready().await;
    let camera = preset();
    let camera = CalibratedCamera { mla_to_sensor_mm: camera.mla_to_sensor_mm * 1.01, ..camera };
    let delta_v = (2.2, 0.001);
    let step = AirStep { camera, delta_v, boards: None, focus_mm: 2.1, focus_scale: Some(1.0), places: Vec::new() };
    service.eye.motion().set_shell(ShellState::On);
    let (designed_px, source) = service.eye.target();
    assert_eq!(source, TargetSource::Design);
    service.eye.keep_air_step(step);
    let (target_px, source) = service.eye.target();
    assert!(source == TargetSource::Calibration && (target_px - designed_px).abs() > 1e-3, "{target_px} px");
    service.eye.lose_air_step();
    assert_eq!(service.eye.target(), (target_px, TargetSource::Calibration));
    assert!(service.eye.air_step().is_none(), "no job goes on from it");
}

#[tokio::test]
async fn what_can_be_read_and_not_measured_in_whole_is_in_doubt_with_the_reason() {
    let service = ready().await;
    let mut readings = service.readings();
    let doubted = async |readings: &mut watch::Receiver<Option<Arc<Reading>>>, wanted: bool| loop {
        readings.changed().await.unwrap();
        let newest = readings.borrow_and_update().clone();
        if let Some(reading) = newest.filter(|reading| reading.spacing.is_ok() && reading.doubted == wanted) {
            return reading;
        }
    };
    let failed = |by_motion| Unmeasured { why: "it is torn".to_owned(), by_motion };
    // A single frame may be, and one of a motion says nothing.
    service.readings.not_measured(failed(false));
    (0..5).for_each(|_| service.readings.not_measured(failed(true)));
    assert!(!service.readings.fails_in_whole());
    service.readings.not_measured(failed(false));
    assert_eq!(doubted(&mut readings, true).await.unresolved.as_deref(), Some("it is torn"));
    // That has frames measured in whole, and one that can be ends it.
    doubted(&mut readings, false).await;
    (0..2).for_each(|_| service.readings.not_measured(failed(false)));
    service.eye.see(None);
    assert!(!next_in_focus(&service, &mut readings).await);
    assert!(!service.readings.fails_in_whole(), "what was set up before says nothing of what is there now");
}

/// Whether the reading of the next frame that is taken from now on says that it is in focus.
async fn next_in_focus(service: &Service, readings: &mut watch::Receiver<Option<Arc<Reading>>>) -> bool {
    let now = Timestamp::now();
    loop {
        readings.changed().await.unwrap();
        let reading = readings.borrow_and_update().clone().unwrap();
        if reading.frame.captured_at > now && reading.spacing.is_ok() {
            assert!(service.eye.in_view() != InView::SteppedBoard || !reading.in_focus, "{reading:?}");
            return reading.in_focus;
        }
    }
}

#[tokio::test]
async fn what_is_no_one_board_is_in_focus_neither_by_frames_nor_by_whole_measurements() {
    let service = ready_with(|config| config.assembly.blur_limit_px = 30.0).await;
    let mut readings = service.readings();
    assert!(next_in_focus(&service, &mut readings).await);
    let whole = service.eye.measure_live().await.unwrap().unwrap();
    assert!(whole.in_focus && whole.two_boards.is_none());

    // Two boards, as a whole measurement has them, until something is set up anew.
    let two = TwoBoardsView { spacings_px: [20.0, 19.0], difference_sigma_px: 0.01, share: 0.3 };
    service.readings.compare(&MeasurementView { two_boards: Some(two), ..whole });
    assert!(!next_in_focus(&service, &mut readings).await);
    service.eye.see(None);
    assert!(next_in_focus(&service, &mut readings).await);

    // A board of several levels: what the whole field has is the spacing of none.
    service.eye.see(Some(InView::SteppedBoard));
    assert!(!next_in_focus(&service, &mut readings).await);
    assert!(!service.eye.measure_live().await.unwrap().unwrap().in_focus);
    service.eye.see(Some(InView::FlatBoard));
    assert!(next_in_focus(&service, &mut readings).await);
}

#[tokio::test]
async fn a_doubt_is_ended_by_a_whole_measurement_though_nobody_but_a_reader_looks_on() {
    let service = ready().await;
    service.eye.see(Some(InView::FlatBoard));
    let mut each = service.each_reading();
    assert!(!each.recv().await.unwrap().doubted);
    // Boards side by side, which the program is not told of.
    let setup = Setup::AirTripleBoard { distances_mm: [167.2, 200.0, 200.0] };
    service.eye.bench().simulated.as_ref().unwrap().obey(&setup);
    let reading = loop {
        let reading = each.recv().await.unwrap();
        if reading.doubted {
            break reading;
        }
    };
    assert!(!reading.in_focus && reading.why.is_empty(), "{reading:?}");
    while !service.readings.whole.borrow().is_some_and(|whole| whole.two_boards) {
        each.recv().await.unwrap();
    }
    while each.recv().await.unwrap().doubted {}
}

#[tokio::test]
async fn what_stood_in_view_before_a_set_up_is_in_no_reading_after_it() {
    let service = ready().await;
    let mut readings = service.readings();
    while readings.borrow_and_update().clone().and_then(|reading| reading.combined).is_none_or(|it| it.frames < 20) {
        readings.changed().await.unwrap();
    }
    service.eye.see(Some(InView::FlatBoard));
    let since = service.eye.set_up_at();
    loop {
        readings.changed().await.unwrap();
        let reading = readings.borrow_and_update().clone().unwrap();
        // One may have been under way.
        if reading.combined.is_some_and(|it| it.frames < 20) {
            assert!(reading.frame.captured_at >= since, "{reading:?}");
            let combined = reading.combined.unwrap();
            assert_eq!(combined.since, Since::Picture);
            break;
        }
    }
}
