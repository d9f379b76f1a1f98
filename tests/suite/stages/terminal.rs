//! Every driver over a pseudo-terminal, in real time: opened by a name that stays, lost, and found again under another.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{ControllerConfig, ControllerDriver};
use plenalign::device::open::open_stages;
use plenalign::device::serial::{Dial, SerialDial};
use plenalign::device::{DeviceError, Stage, StageState, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::line::Line;
use plenalign::units::Millimetres;
use tokio::time::timeout;

use super::super::bench::quick_axes;
use super::kit::{Kit, bench, near, wait_for};

/// Points a link at another path.
fn point(link: &Path, at: &Path) {
    let _ = std::fs::remove_file(link);
    std::os::unix::fs::symlink(at, link).unwrap();
}

async fn works_over_a_terminal(driver: Protocol) {
    let mut bench = bench(driver);
    // This runs in real time.
    quick_axes(&mut bench);
    let kit = Kit::with(driver, bench);
    let folder = tempfile::tempdir().unwrap();
    // As /dev/serial/by-id has it: a link whose name stays while the terminal's does not.
    let link = folder.path().join("usb-controller");
    point(&link, &kit.twin.serve_on_terminal().unwrap());
    let (device, port) = ("controller `main`".to_owned(), link.clone());
    let dial = SerialDial { device, port, baud: 115_200, handshake: driver.driver().handshake() };
    let controller = kit.start_on(Arc::new(dial.clone()), None);
    controller.first_attempt().await.unwrap();
    let busy = dial.open().await.err().unwrap();
    assert!(matches!(busy, DeviceError::Busy { .. }), "{busy}");
    let rig = kit.rig(&controller);
    rig.focus.home(rig.focus.generation()).await.unwrap();
    let readback = rig.focus.move_to(Millimetres(3.0), rig.focus.generation()).await.unwrap();
    assert!(near(readback.value(), 3.0, 0.003) && near(rig.slides.at(0), 3.0, 0.006), "{readback}");
    let mover = rig.focus.clone();
    let moving = tokio::spawn(async move { mover.move_at(Millimetres(1.0), 1.0, mover.generation()).await });
    wait_for(&rig.focus, "on its way", |state| state.position.value() < 2.9).await;
    assert_eq!(rig.focus.stop().await, StopDelivery::Confirmed);
    assert!(matches!(moving.await.unwrap(), Err(DeviceError::Stopped { .. })));

    if !rig.focus.state().borrow().homed {
        // On a machine with much else to do the stop may have been seen too late to believe the position.
        rig.focus.home(rig.focus.generation()).await.unwrap();
    }
    kit.twin.unplug();
    let mut state = rig.focus.state();
    let lost = timeout(Duration::from_secs(5), state.wait_for(|state| !state.connected)).await.is_ok();
    assert!(lost, "the loss of the terminal is seen");
    std::fs::remove_file(&link).unwrap();
    let name = link.display().to_string();
    let looked_for = |state: &StageState| state.fault.as_ref().is_some_and(|fault| fault.contains(&name));
    wait_for(&rig.focus, "looked for", looked_for).await;
    kit.twin.plug_in();
    point(&link, &kit.twin.serve_on_terminal().unwrap());
    let found = timeout(Duration::from_secs(10), state.wait_for(|state| state.connected)).await.is_ok();
    assert!(found, "it is found under its new name: {:?}", rig.focus.state().borrow().clone());
    let kept = matches!(driver, Protocol::Zaber | Protocol::Pi);
    assert_eq!(rig.focus.read_state().await.unwrap().homed, kept);

    // The same over a bad line.
    kit.twin.unplug();
    assert!(timeout(Duration::from_secs(5), state.wait_for(|state| !state.connected)).await.is_ok());
    kit.twin.set_line(Line { noise: b"\xff\x00~Gr\r\n@01".to_vec(), fragment: 3, echo: true, ..Line::default() });
    kit.twin.plug_in();
    point(&link, &kit.twin.serve_on_terminal().unwrap());
    let found = timeout(Duration::from_secs(10), state.wait_for(|state| state.connected)).await.is_ok();
    assert!(found, "{:?}", rig.focus.state().borrow().clone());
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.focus.move_to(Millimetres(2.0), rig.focus.generation()).await.unwrap().value(), 2.0, 0.003));
    assert!(near(rig.slides.at(0), 2.0, 0.006));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_bench_of_two_kinds_of_controllers_opens_with_one_of_them_absent() {
    let kit = Kit::new(Protocol::Zaber);
    let port = kit.twin.serve_on_terminal().unwrap();
    let controller = |driver, port: &Path| ControllerConfig {
        driver,
        port: port.to_owned(),
        baud: None,
        identity: None,
        address: 1,
    };
    let mut bench = kit.bench.clone();
    "lens".clone_into(&mut bench.focus.controller);
    "shell".clone_into(&mut bench.e.controller);
    bench.controllers = BTreeMap::from([
        ("lens".to_owned(), controller(ControllerDriver::Zaber, &port)),
        ("shell".to_owned(), controller(ControllerDriver::Tmcl, Path::new("usb:there-is-none"))),
    ]);
    let (focus, e) = open_stages(&bench).await.unwrap();
    assert!(focus.read_state().await.unwrap().connected);
    assert_eq!((focus.info().driver.as_str(), e.info().driver.as_str()), ("zaber", "tmcl"));
    let state = e.state().borrow().clone();
    assert!(!state.connected && state.fault.as_ref().is_some_and(|fault| fault.contains("there-is-none")), "{state:?}");
    let error = e.home(e.generation()).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Disconnected { device, .. } if device.contains("shell")), "{error}");
}

macro_rules! over_a_terminal {
    ($($name:ident: $driver:ident),*) => {
        $(#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
        async fn $name() {
            works_over_a_terminal(Protocol::$driver).await;
        })*
    };
}

over_a_terminal!(grbl: Grbl, fluidnc: FluidNc, zaber: Zaber, pi: Pi, tmcl: Tmcl, thorlabs: Thorlabs);
