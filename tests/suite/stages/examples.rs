//! Every example of a controller's configuration, accepted by that controller's twin as it leaves the factory.

use std::path::Path;

use clap::ValueEnum as _;
use plenalign::config::{Config, ControllerDriver};
use plenalign::device::Stage as _;
use plenalign::sim::stage::Protocol;
use plenalign::units::Millimetres;

use super::kit::{Kit, suit};

#[tokio::test(start_paused = true)]
async fn every_example_is_accepted_by_its_twin_and_homed() {
    for &driver in Protocol::value_variants() {
        // grblHAL is set as Grbl is, but for limits that begin where homing ends.
        let name = if driver == Protocol::GrblHal { "grbl" } else { driver.name() };
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("deploy/examples/{name}.toml"));
        let mut bench = Config::load(&file).unwrap().bench;
        if driver == Protocol::GrblHal {
            suit(driver, &mut bench);
        }
        let limits =
            [(bench.focus.low_limit_mm, bench.focus.high_limit_mm), (bench.e.low_limit_mm, bench.e.high_limit_mm)];
        let rig = Kit::with(driver, bench).connect().await.unwrap();
        for (stage, (low, high)) in [&rig.focus, &rig.e].into_iter().zip(limits) {
            assert_eq!(stage.info().contradictions, Vec::<String>::new(), "{name}");
            stage.home(stage.generation()).await.unwrap();
            // Grbl's own limit on the home side is the switch: those of the example can be gone to, and cost no reference.
            for end in [low, high].into_iter().filter(|_| driver.driver() == ControllerDriver::Grbl) {
                let end = Millimetres(end);
                let reached = stage.move_to(end, stage.generation()).await;
                assert!(reached.is_ok(), "{name}, {} to {end}: {reached:?}", stage.info().axis);
            }
        }
    }
}
