//! Searches for a switch that is not found: they are given up before they have done harm.

use std::time::Duration;

use plenalign::device::{DeviceError, Stage};
use plenalign::sim::plant::Slides;
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::firmware;
use tokio::time::Instant;

use super::super::until::elapse;
use super::kit::{Kit, START, every_protocol};

every_protocol!(a_search_that_finds_no_switch_ends_within_its_way_and_in_words);

/// The motor turns, the slide stands at its hard stop, and no switch closes.
async fn a_search_that_finds_no_switch_ends_within_its_way_and_in_words(driver: Protocol) {
    let mut kit = Kit::new(driver);
    kit.slides = Slides::without_switches(&[(&kit.bench.focus, START[0]), (&kit.bench.e, START[1])]);
    kit.twin = firmware(driver, &[&kit.bench.focus, &kit.bench.e], kit.slides.clone());
    let rig = kit.connect().await.unwrap();
    let config = &kit.bench.focus;
    let travel = config.high_limit_mm - config.low_limit_mm;
    let began = Instant::now();
    let error = rig.focus.home(rig.focus.generation()).await.unwrap_err();
    let (took, way) = (began.elapsed(), (rig.slides.at(0) - START[0]).abs() + rig.slides.lost(0).abs());
    println!("{driver:?}: a search on an axis of {travel} mm ended after {way:.1} mm and {took:.1?}: {error}");
    assert!(matches!(error, DeviceError::Alarm { .. }), "{error}");
    assert!(rig.slides.lost(0).abs() > 1.0, "it has come to the hard stop");
    // Grbl's own bound is the same but for its pull-off; a reading is 0.1 s at 5 mm/s and a stop 0.6 mm.
    assert!(way < 1.5 * travel + 12.0, "{way} mm on an axis of {travel} mm");
    assert!(took < Duration::from_secs(15), "{took:?}");
    let state = rig.focus.read_state().await.unwrap();
    assert!(!state.homed && !state.moving, "{state:?}");
    let lost = rig.slides.lost(0);
    elapse(Duration::from_secs(60)).await;
    assert_eq!(rig.slides.lost(0), lost, "it searches no more");
}
