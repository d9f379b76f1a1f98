//! `plenalign sim-stage`: the real drivers at the twin that the program serves.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::ValueEnum as _;
use plenalign::device::Stage;
use plenalign::device::serial::SerialDial;
use plenalign::sim::stage::Protocol;
use tokio::time::timeout;

use super::kit::Kit;
use crate::suite::program::{Program, plenalign};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_program_serves_a_twin_of_every_protocol() {
    let folder = tempfile::tempdir().unwrap();
    for &driver in Protocol::value_variants() {
        let link = folder.path().join(driver.name());
        // Left over from an earlier run.
        std::os::unix::fs::symlink("/nowhere", &link).unwrap();
        let mut command = plenalign(folder.path());
        command.args(["sim-stage", "--json", "--protocol", driver.name(), "--link"]).arg(&link);
        let program = Program::start(command);
        let said = program.said.clone();
        assert_eq!(said["protocol"], driver.name());
        let port = PathBuf::from(said["port"].as_str().unwrap());
        assert_eq!(port, link);

        let mut kit = Kit::new(driver);
        // The program's limits are the preset's, whose low ends homing on Zaber and PI begins at.
        (kit.bench.focus.accept_wider_firmware_limits, kit.bench.e.accept_wider_firmware_limits) = (true, true);
        let (device, handshake) = ("controller `main`".to_owned(), driver.driver().handshake());
        let dial = SerialDial { device, port, baud: 115_200, handshake };
        let controller = kit.start_on(Arc::new(dial), None);
        timeout(Duration::from_secs(20), controller.first_attempt()).await.unwrap().unwrap();
        let stage = kit.rig(&controller).focus;
        assert!(stage.read_state().await.unwrap().connected);
        assert!(!stage.info().identity.is_empty());
        drop(program);
    }
}
