//! Serial ports and the controllers at them.

use std::path::Path;

use super::permission;
use crate::cli::doctor::facts::{ControllerFacts, DeviceFile, Facts, PortFacts, Process, quoted};
use crate::cli::doctor::finding::Finding;
use crate::config::BenchDriver;

/// Where udev puts names that stay.
const STEADY: [&str; 2] = ["/dev/serial/by-id/", "/dev/serial/by-path/"];

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let mut found: Vec<Finding> =
        facts.controllers.iter().flat_map(|controller| of_controller(controller, facts)).collect();
    let used = |port: &PortFacts| {
        facts
            .controllers
            .iter()
            .any(|controller| controller.port.as_ref().is_ok_and(|file| file.path == port.file.path))
    };
    found.extend(facts.ports.iter().filter(|port| !used(port)).map(unused));
    if facts.ports.is_empty() {
        found.push(Finding::note("stages.found", "serial ports", "none is connected"));
    }
    found.extend(by_id(facts));
    let hardware = facts.configuration.config().is_some_and(|config| config.bench.driver == BenchDriver::Hardware);
    if hardware {
        found.extend(facts.meddlers.iter().filter_map(|meddler| meddles(meddler, facts)));
    }
    found
}

/// A port that no controller is configured on.
fn unused(port: &PortFacts) -> Finding {
    let product = port.port.product.as_ref().map_or_else(String::new, |product| format!(" ({product})"));
    let steadiest = port.port.names.first().map_or("", String::as_str);
    let detail = format!("no controller is configured on it{product}; port = {steadiest:?} would name it");
    Finding::note("stages.found", port.port.path.display().to_string(), detail)
}

fn of_controller(controller: &ControllerFacts, facts: &Facts) -> Vec<Finding> {
    const ID: &str = "stages.port";
    let what = format!("controller {}", controller.name);
    let given = controller.config.port.display();
    let file = match &controller.port {
        Ok(file) => file,
        Err(why) => {
            return vec![Finding::problem(ID, what, format!("port = \"{given}\": {why}"), connect(controller, facts))];
        }
    };
    if !file.is_device {
        return vec![Finding::problem(
            ID,
            what,
            format!("port = \"{given}\" is no device, but a file or a folder"),
            connect(controller, facts),
        )];
    }
    let mut found: Vec<Finding> = permission::check("stages.permission", &what, file, facts).into_iter().collect();
    found.extend(held(&what, file, facts));
    found.extend(unsteady(&what, controller, file, facts));
    found.extend(autosuspend("stages.autosuspend", &what, file));
    if let Some(said) = &controller.identity {
        found.push(identity(&what, said));
    }
    if found.iter().all(|finding| finding.id == "stages.identity") {
        let detail = format!("{} at {given}, {} baud", controller.config.driver.name(), controller.config.baud());
        found.insert(0, Finding::ok(ID, what, detail));
    }
    found
}

fn identity(what: &str, said: &Result<String, String>) -> Finding {
    const ID: &str = "stages.identity";
    match said {
        Ok(identity) => Finding::ok(ID, what, identity),
        Err(why) => Finding::problem(
            ID,
            what,
            why,
            "check its power, its cable, and `driver`, `baud` and `address` in the configuration; then again: plenalign \
             doctor --identify",
        ),
    }
}

/// What to type where a port is missing: the ports that there are.
fn connect(controller: &ControllerFacts, facts: &Facts) -> String {
    let names: Vec<String> =
        facts.ports.iter().filter_map(|port| port.port.names.first()).map(|name| format!("{name:?}")).collect();
    let key = format!("[bench.controllers.{}] port", controller.name);
    if names.is_empty() {
        return format!(
            "ls -l /dev/serial/by-id/    # connect it, and write its name: {key} = \"/dev/serial/by-id/...\""
        );
    }
    format!("{key} = {}    # or connect the one that is configured", names.join(" or "))
}

/// Who else has the port.
fn held(what: &str, file: &DeviceFile, facts: &Facts) -> Option<Finding> {
    const ID: &str = "stages.held";
    let holder = file.open_in.first()?;
    let path = quoted(&file.path);
    if holder.is_plenalign() || facts.holder.as_ref().is_some_and(|of_bench| of_bench.pid == holder.pid) {
        return Some(Finding::ok(ID, what, format!("{} has it open", holder.said())));
    }
    let mend = match meddler_mend(&holder.name) {
        Some(mend) => mend.to_owned(),
        None => format!("sudo fuser -v {path}; kill {}", holder.pid),
    };
    Some(Finding::problem(ID, what, format!("{} has {} open", holder.said(), file.path.display()), mend))
}

/// A name that may mean another port after the next start.
fn unsteady(what: &str, controller: &ControllerFacts, file: &DeviceFile, facts: &Facts) -> Option<Finding> {
    let given = &controller.config.port;
    let name = given.to_str().unwrap_or_default();
    // Only what the kernel numbers as it comes.
    if given != &file.path || !(name.starts_with("/dev/ttyUSB") || name.starts_with("/dev/ttyACM")) {
        return None;
    }
    let port = facts.ports.iter().find(|port| port.file.path == file.path);
    let steady = port.and_then(|port| port.port.names.iter().find(|other| Path::new(other) != given))?;
    Some(Finding::warning(
        "stages.name",
        what,
        format!("{name} may be another port after a restart, or once it was unplugged"),
        format!("[bench.controllers.{}] port = {steady:?}", controller.name),
    ))
}

/// Whether a USB device may be switched off while nobody uses it.
pub(super) fn autosuspend(id: &'static str, what: &str, file: &DeviceFile) -> Option<Finding> {
    let usb = file.usb.as_ref().filter(|usb| usb.autosuspend)?;
    Some(Finding::warning(
        id,
        what,
        "its USB device may be switched off by the kernel while it rests (autosuspend)",
        format!("echo on | sudo tee {}    # and for good: a udev rule, docs/doctor.md", quoted(&usb.power_control())),
    ))
}

/// Whether the ports have the names that udev makes.
fn by_id(facts: &Facts) -> Option<Finding> {
    const ID: &str = "stages.by_id";
    let usb: Vec<&PortFacts> = facts.ports.iter().filter(|port| port.file.usb.is_some()).collect();
    let nameless: Vec<String> = usb
        .iter()
        .filter(|port| !port.port.names.iter().any(|name| STEADY.iter().any(|steady| name.starts_with(steady))))
        .map(|port| port.port.path.display().to_string())
        .collect();
    if nameless.is_empty() {
        return (!usb.is_empty()).then(|| Finding::ok(ID, "names of ports", "udev makes those that stay"));
    }
    let mend = if facts.system.udev {
        "sudo udevadm trigger --subsystem-match=tty"
    } else {
        "sudo systemctl start systemd-udevd"
    };
    Some(Finding::warning(
        ID,
        "names of ports",
        format!("{} has no name in /dev/serial/by-id: udev makes them", nameless.join(", ")),
        format!("{mend}    # meanwhile port = \"usb:SERIAL\" means a USB device by its serial number"),
    ))
}

/// A program that is known to get hold of serial ports.
fn meddles(meddler: &Process, facts: &Facts) -> Option<Finding> {
    let mend = meddler_mend(&meddler.name)?;
    let heeded = |controller: &ControllerFacts| {
        let usb = controller.port.as_ref().ok().and_then(|file| file.usb.as_ref());
        // What is no USB device is not tried.
        usb.is_none_or(|usb| usb.modem_manager_ignores)
    };
    if meddler.name == "ModemManager" && facts.controllers.iter().all(heeded) {
        return Some(Finding::ok(
            "stages.meddler",
            meddler.name.clone(),
            "runs, and is told by udev to leave the configured controllers alone",
        ));
    }
    Some(Finding::warning(
        "stages.meddler",
        meddler.name.clone(),
        format!(
            "{} runs: it is known to write to serial ports that are none of its own, or to take them",
            meddler.said()
        ),
        mend,
    ))
}

fn meddler_mend(name: &str) -> Option<&'static str> {
    match name {
        "ModemManager" => {
            Some("sudo systemctl disable --now ModemManager    # or a udev rule with ENV{ID_MM_DEVICE_IGNORE}=\"1\"")
        }
        "brltty" => Some("sudo systemctl disable --now brltty brltty-udev    # or: sudo apt remove brltty"),
        _ => None,
    }
}
