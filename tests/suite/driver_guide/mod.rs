//! The driver that docs/write-a-driver.md has its readers write, compiled and tried: what the page shows is this.

mod fjell;
mod page;
mod twin;

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{BenchConfig, ControllerDriver, Side};
use plenalign::device::port::Protocol;
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::supervisor::{Controller, ControllerStage};
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::plant::{Plant, Slides};
use plenalign::sim::stage::drive::DriveConfig;
use plenalign::sim::stage::line::Line;
use plenalign::sim::stage::{ControllerTwin, firmware};
use plenalign::units::Millimetres;
use proptest::prelude::*;

use fjell::{Fjell, FjellDriver};
use twin::FjellTwin;

use super::until::elapse;

/// A bench whose axes a Fjell F2 can have: it homes to its negative end, so that the e axis is mounted the other way.
fn bench() -> BenchConfig {
    let mut bench = BenchConfig::default();
    for (axis, letter) in [(&mut bench.focus, "A"), (&mut bench.e, "B")] {
        letter.clone_into(&mut axis.axis);
        axis.steps_per_mm = 10_000.0;
    }
    bench.e.reversed = true;
    bench
}

/// A twin, and the slides that it moves: both off home.
fn twin(bench: &BenchConfig) -> (ControllerTwin, Arc<Slides>) {
    let axes = [&bench.focus, &bench.e];
    let slides = Slides::new(&[(axes[0], 1.3), (axes[1], 20.4)]);
    let plant: Arc<dyn Plant> = slides.clone();
    (ControllerTwin::new(FjellTwin::new(axes.map(DriveConfig::of).to_vec(), &plant)), slides)
}

/// Connects the driver to a twin, through a pipe.
async fn connect(bench: &BenchConfig, twin: &ControllerTwin) -> Result<[ControllerStage; 2], DeviceError> {
    let setups = [(AxisName::Focus, &bench.focus), (AxisName::E, &bench.e)];
    let setups = setups.map(|(axis, config)| AxisSetup::new(axis, config)).to_vec();
    let controller = Controller::start("controller `main`", Box::new(FjellDriver), Arc::new(twin.dial()), None, setups);
    controller.first_attempt().await?;
    Ok([AxisName::Focus, AxisName::E].map(|axis| controller.stage(axis).unwrap()))
}

#[tokio::test(start_paused = true)]
async fn it_homes_and_moves_to_where_it_says() {
    let bench = bench();
    let (twin, slides) = twin(&bench);
    let [focus, e] = connect(&bench, &twin).await.unwrap();
    assert_eq!(e.info().identity, "Fjell F2 1.04 00317");
    assert_eq!(e.info().disagreements, Vec::<String>::new());
    assert_eq!(e.move_to(Millimetres(12.0), e.generation()).await, Err(DeviceError::NotHomed { axis: AxisName::E }));
    for (stage, axis, home, target) in [(&focus, 0, 0.0, 2.2), (&e, 1, 30.0, 12.0)] {
        stage.home(stage.generation()).await.unwrap();
        assert!((slides.at(axis) - home).abs() < 0.004, "home: {}", slides.at(axis));
        let reached = stage.move_to(Millimetres(target), stage.generation()).await.unwrap();
        assert!((reached.value() - target).abs() < 0.001, "it says {reached}");
        assert!((slides.at(axis) - target).abs() < 0.004, "it is at {}", slides.at(axis));
    }
}

#[tokio::test(start_paused = true)]
async fn a_stop_ends_a_move_and_what_waits() {
    let bench = bench();
    let (twin, slides) = twin(&bench);
    let [focus, e] = connect(&bench, &twin).await.unwrap();
    focus.home(focus.generation()).await.unwrap();
    e.home(e.generation()).await.unwrap();
    let moving = tokio::spawn({
        let e = e.clone();
        async move { e.move_to(Millimetres(5.0), e.generation()).await }
    });
    elapse(Duration::from_secs(2)).await;
    let at = slides.at(1);
    assert!(at < 29.0, "it is on its way: {at}");
    assert_eq!(e.stop().await, StopDelivery::Confirmed);
    assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    let stopped = slides.at(1);
    assert!((stopped - at).abs() < 0.7, "5 mm/s and 20 mm/s² make 0.625 mm: {at} to {stopped}");
    elapse(Duration::from_secs(5)).await;
    assert_eq!(slides.at(1), stopped, "it stands");
    assert!(e.read_state().await.unwrap().homed, "a ramp loses no step");
}

#[tokio::test(start_paused = true)]
async fn a_bad_line_costs_time_and_nothing_else() {
    let bench = bench();
    for line in [
        Line { fragment: 1, pause: Duration::from_millis(2), ..Line::default() },
        Line { echo: true, ..Line::default() },
        Line { noise: b"A? +00000077 0 1 0\rB".to_vec(), ..Line::default() },
    ] {
        let (twin, slides) = twin(&bench);
        twin.set_line(line.clone());
        let [_, e] = connect(&bench, &twin).await.unwrap();
        e.home(e.generation()).await.unwrap();
        e.move_to(Millimetres(12.0), e.generation()).await.unwrap();
        assert!((slides.at(1) - 12.0).abs() < 0.004, "{line:?}: {}", slides.at(1));
    }
}

#[tokio::test(start_paused = true)]
async fn what_is_wrong_is_said() {
    let bench = bench();
    // Another kind of controller at the other end.
    let slides = Slides::new(&[(&bench.focus, 1.3), (&bench.e, 20.4)]);
    let pi = firmware(ControllerDriver::Pi, &[&bench.focus, &bench.e], slides);
    let error = connect(&bench, &pi).await.err().unwrap();
    assert!(matches!(error, DeviceError::WrongDevice { .. } | DeviceError::Timeout { .. }), "{error}");
    // An axis that it does not have.
    let mut other = bench.clone();
    "X".clone_into(&mut other.e.axis);
    let error = connect(&other, &twin(&bench).0).await.err().unwrap();
    assert!(error.to_string().contains("its axes are A to D"), "{error}");
    // Limits that are wider than the configured ones, and an end to home to that is not the configured one.
    let (mut narrow, mut other_end) = (bench.clone(), bench.clone());
    narrow.e.low_limit_mm += 1.0;
    other_end.e.home_side = Side::Low;
    for (contradicted, words) in [(narrow, "bench.e.accept_wider_firmware_limits"), (other_end, "negative end")] {
        let (twin, slides) = twin(&bench);
        let [_, e] = connect(&contradicted, &twin).await.unwrap();
        let (before, error) = (slides.at(1), e.home(e.generation()).await.unwrap_err());
        assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains(words)), "{error}");
        assert_eq!(slides.at(1), before);
    }
    // A target beyond them: its own words, and nothing moves.
    let (twin, slides) = twin(&bench);
    let [focus, _] = connect(&bench, &twin).await.unwrap();
    focus.home(focus.generation()).await.unwrap();
    let error = focus.move_to(Millimetres(7.0), focus.generation()).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("E3")), "{error}");
    assert!(slides.at(0).abs() < 0.004);
    // A motor that lost steps runs into its limit switch.
    twin.stall(0, true);
    focus.move_to(Millimetres(3.0), focus.generation()).await.unwrap();
    twin.stall(0, false);
    let error = focus.move_to(Millimetres(-2.0), focus.generation()).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains("limit switch")), "{error}");
    focus.home(focus.generation()).await.unwrap();
    assert!(focus.move_to(Millimetres(1.0), focus.generation()).await.is_ok());
}

proptest! {
    #[test]
    fn no_bytes_break_the_reader(noise in proptest::collection::vec(any::<u8>(), 0..2000), cut in 1usize..50) {
        let mut fjell = Fjell::default();
        for piece in noise.chunks(cut) {
            for line in fjell.frame(piece) {
                let _ = (fjell.classify(&line, Some(b"A?\r")), fjell.classify(&line, None), fjell.text(&line));
            }
        }
        fjell.frame(b"\r");
        prop_assert_eq!(fjell.frame(b"A? 1 0 1 0\r"), vec!["A? 1 0 1 0".to_owned()]);
    }
}
