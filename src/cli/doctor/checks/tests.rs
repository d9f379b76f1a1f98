//! Facts of machines that are well, and that are not.

use jiff::Timestamp;

use super::all;
use crate::cli::doctor::facts::{
    Account, CameraSource, CertificateFacts, ConfigurationFacts, ControllerFacts, DaemonFacts, DeviceFile, Facts,
    FolderFacts, FolderKind, PortFacts, PortState, Process, ServerFacts, StateFacts, SystemFacts, TokenFacts, UsbFacts,
    VideoFacts,
};
use crate::cli::doctor::finding::{Finding, Level};
use crate::config::Config;
use crate::device::camera::find::Node;
use crate::device::camera::offer::{Offer, Size};
use crate::device::connected::ConnectedPort;
use crate::store::Inspection;

const BY_ID: &str = "/dev/serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0";

/// What has to be said of a hardware bench's camera.
const CAMERA: &str = "[main_lens]\nfocal_length_mm = 20\n\
    [mla]\narray = \"square\"\npitch_mm = 0.1\nfocal_length_mm = 0.5\nangular_resolution = 3.13\nmode = \"galilean\"\n\
    [sensor]\npixel_um = 3.45\nwidth_px = 1160\nheight_px = 1160\n\
    [shell]\nouter_radius_mm = 59\ninner_radius_mm = 51\nrefractive_index = 1.49\n";

fn config(text: &str) -> Config {
    Config::from_toml(text, "bench.toml").unwrap()
}

/// A hardware bench with one controller.
fn hardware() -> Config {
    config(&format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\nport = {BY_ID:?}\n\
         [bench.camera]\ndevice = \"usb:A1\"\n"
    ))
}

fn device(path: &str, group: (&str, u32)) -> DeviceFile {
    DeviceFile {
        path: path.into(),
        is_device: true,
        mode: 0o660,
        uid: 0,
        gid: group.1,
        group: group.0.to_owned(),
        ours: true,
        open_in: Vec::new(),
        usb: Some(UsbFacts {
            folder: "/sys/bus/usb/devices/1-2".into(),
            autosuspend: false,
            modem_manager_ignores: false,
        }),
    }
}

fn tty() -> DeviceFile {
    device("/dev/ttyUSB0", ("dialout", 20))
}

fn video() -> VideoFacts {
    VideoFacts {
        node: Node {
            path: "/dev/video0".into(),
            by_id: vec!["/dev/v4l/by-id/usb-Mono-index0".into()],
            card: "Mono".to_owned(),
            driver: "uvcvideo".to_owned(),
            bus: "usb-1".to_owned(),
            usb_serial: Some("A1".to_owned()),
            unusable: None,
        },
        names: ["/dev/v4l/by-id/usb-Mono-index0", "usb:A1", "/dev/video0"].map(str::to_owned).to_vec(),
        offers: vec![Offer {
            format: "GREY".to_owned(),
            description: "8-bit Greyscale".to_owned(),
            readable: true,
            recompressed: false,
            sizes: vec![Size { least_px: [1160, 1160], most_px: [1160, 1160], step_px: [0, 0], rates_hz: vec![30.0] }],
        }],
        file: device("/dev/video0", ("video", 44)),
    }
}

fn folder(path: &str) -> FolderFacts {
    FolderFacts {
        path: path.into(),
        kind: FolderKind::Folder,
        nearest: path.into(),
        unwritable: None,
        read_only: false,
        free_bytes: Some(100_000_000_000),
    }
}

/// A machine on which a hardware bench works.
pub(super) fn well() -> Facts {
    let config = hardware();
    let controller = config.bench.controllers["main"].clone();
    let names = [BY_ID, "usb:A50285BI", "/dev/ttyUSB0"].map(str::to_owned).to_vec();
    Facts {
        system: SystemFacts {
            version: "1.2.3".to_owned(),
            system: "Debian GNU/Linux 13 (trixie)".to_owned(),
            kernel: "6.12.0".to_owned(),
            architecture: "x86_64".to_owned(),
            udev: true,
            now: "2026-05-06T07:08:09Z".parse().unwrap(),
            synchronised: Some(true),
            turbo_fault: None,
        },
        user: Account { name: "ana".to_owned(), uid: 1000, gids: vec![1000, 20, 44], listed_gids: vec![1000, 20, 44] },
        service: None,
        configuration: ConfigurationFacts { file: Some("bench.toml".into()), service_file: None, config: Ok(config) },
        state: Ok(StateFacts {
            folder: folder("/var/lib/plenalign"),
            recordings: None,
            history: Ok(Some(Inspection { version: 1, newest: 1, bytes: 12_000_000 })),
            tokens: Ok(TokenFacts { valid: 2, expired: 0 }),
        }),
        ports: vec![PortFacts {
            port: ConnectedPort { path: "/dev/ttyUSB0".into(), names, product: Some("FT232R".to_owned()) },
            file: tty(),
        }],
        controllers: vec![ControllerFacts {
            name: "main".to_owned(),
            config: controller,
            port: Ok(tty()),
            identity: None,
        }],
        cameras: vec![video()],
        camera: Some(CameraSource::Device(Ok("/dev/video0".into()))),
        holder: None,
        meddlers: Vec::new(),
        server: ServerFacts {
            listen: "127.0.0.1:8080".to_owned(),
            address: Ok("127.0.0.1:8080".parse().unwrap()),
            port: PortState::Free,
            certificate: None,
            open_files: Some(524_288),
        },
    }
}

/// Those of the findings that are not as they should be, each with its level.
fn wrong(facts: &Facts) -> Vec<(&'static str, Level)> {
    let findings = all(facts);
    findings.iter().filter(|finding| finding.level > Level::Note).map(|finding| (finding.id, finding.level)).collect()
}

fn well_enough(facts: &Facts) {
    let wrong = wrong(facts);
    assert!(wrong.is_empty(), "{wrong:?}");
}

/// The one finding that is wrong.
fn only(facts: &Facts, id: &str, level: Level) -> Finding {
    let found: Vec<Finding> = all(facts).into_iter().filter(|finding| finding.level > Level::Note).collect();
    let [one] = &found[..] else { panic!("one finding is wrong: {found:#?}") };
    assert_eq!((one.id, one.level), (id, level), "{one:?}");
    assert!(one.mend.as_ref().is_some_and(|mend| !mend.is_empty()), "what to type: {one:?}");
    one.clone()
}

fn problem(facts: &Facts, id: &str, said: &str, typed: &str) {
    judged(facts, id, Level::Problem, said, typed);
}

fn warning(facts: &Facts, id: &str, said: &str, typed: &str) {
    judged(facts, id, Level::Warning, said, typed);
}

fn judged(facts: &Facts, id: &str, level: Level, said: &str, typed: &str) {
    let found = only(facts, id, level);
    assert!(found.detail.contains(said), "{said}: {found:?}");
    assert!(found.mend.as_ref().is_some_and(|mend| mend.contains(typed)), "{typed}: {found:?}");
}

fn state(facts: &mut Facts) -> &mut StateFacts {
    facts.state.as_mut().unwrap()
}

#[test]
fn nothing_is_wrong_with_a_machine_that_is_well() {
    let facts = well();
    well_enough(&facts);
    let found = all(&facts);
    for (id, said) in [
        ("program.version", "Linux 6.12.0"),
        ("configuration.file", "is read"),
        ("bench.driver", "hardware"),
        ("bench.lock", "no process"),
        ("stages.port", "grbl at /dev/serial/by-id"),
        ("camera.device", "Mono at usb:A1, GREY 1160x1160"),
        ("state.folder", "can be written"),
        ("state.history", "version 1"),
        ("state.tokens", "2 tokens"),
        ("server.port", "is free"),
    ] {
        let one = found.iter().find(|finding| finding.id == id).unwrap_or_else(|| panic!("{id} is looked at"));
        assert!(one.level == Level::Ok && one.detail.contains(said), "{one:?}");
    }
}

#[test]
fn a_simulated_bench_needs_no_device() {
    let mut facts = well();
    facts.configuration = ConfigurationFacts { file: None, service_file: None, config: Ok(Config::default()) };
    (facts.ports, facts.controllers, facts.cameras, facts.camera) = (Vec::new(), Vec::new(), Vec::new(), None);
    facts.meddlers = vec![Process { pid: 7, name: "ModemManager".to_owned(), command: String::new() }];
    well_enough(&facts);
    assert!(all(&facts).iter().any(|finding| finding.id == "bench.driver" && finding.detail.contains("SIMULATED")));
}

#[test]
fn what_is_wrong_with_the_configuration_is_told_key_by_key() {
    let mut facts = well();
    let refused = |text: &str| {
        let config = Config::from_toml(text, "bench.toml");
        ConfigurationFacts { file: Some("bench.toml".into()), service_file: None, config }
    };
    (facts.controllers, facts.camera) = (Vec::new(), None);
    facts.configuration = refused("[shell]\ninner_radius_mm = 70.0\n[sensor]\npixel_um = -1.0\n");
    let found: Vec<Finding> = all(&facts).into_iter().filter(|finding| finding.level == Level::Problem).collect();
    let keys: Vec<(&str, &str)> = found.iter().map(|finding| (finding.id, finding.what.as_str())).collect();
    assert_eq!(keys, [("configuration.key", "shell.inner_radius_mm"), ("configuration.key", "sensor.pixel_um")]);
    assert!(found[0].detail.starts_with("line 2, column"), "{found:?}");
    assert_eq!(found[1].mend.as_deref(), Some("${EDITOR:-nano} +4 bench.toml"));

    facts.configuration = refused("[shell\n");
    problem(&facts, "configuration.syntax", "not TOML", "${EDITOR:-nano} +1 bench.toml");
    let missing = Config::open(Some("/nowhere/bench.toml".as_ref()), &[]).map(|(config, _)| config);
    facts.configuration.config = missing;
    problem(&facts, "configuration.file", "is not there", "ls -l bench.toml");
    facts.configuration.config = Config::open(None, &["a.b".to_owned()]).map(|(config, _)| config);
    problem(&facts, "configuration.set", "expected KEY=VALUE", "--set assembly.initial_e_mm=25");
    // The devices there are are listed all the same.
    assert!(all(&facts).iter().any(|finding| finding.id == "stages.found" && finding.detail.contains(BY_ID)));
}

#[test]
fn what_is_allowed_and_worth_a_word_is_a_warning() {
    let mut facts = well();
    facts.configuration.config =
        Ok(config(&toml::to_string(&hardware()).unwrap().replace("high_limit_mm = 5.0", "high_limit_mm = 0.01")));
    assert!(wrong(&facts).contains(&("configuration.notice", Level::Warning)), "{:?}", all(&facts));
}

#[test]
fn a_port_that_is_not_there_is_named_with_those_that_are() {
    let mut facts = well();
    facts.controllers[0].port = Err("there is no /dev/ttyUSB7".to_owned());
    problem(&facts, "stages.port", "there is no /dev/ttyUSB7", BY_ID);
    facts.ports.clear();
    problem(&facts, "stages.port", "there is no /dev/ttyUSB7", "ls -l /dev/serial/by-id/");
    let mut facts = well();
    facts.controllers[0].port.as_mut().unwrap().is_device = false;
    problem(&facts, "stages.port", "is no device", BY_ID);
}

#[test]
fn a_port_that_may_not_be_opened_says_what_gives_the_right() {
    let mut facts = well();
    facts.controllers[0].port.as_mut().unwrap().ours = false;
    (facts.user.gids, facts.user.listed_gids) = (vec![1000], vec![1000]);
    problem(&facts, "stages.permission", "not in the group dialout", "sudo usermod -aG dialout ana");
    // The group is given, and this login is older.
    facts.user.listed_gids.push(20);
    problem(&facts, "stages.permission", "from the next login", "newgrp dialout");
    facts.controllers[0].port.as_mut().unwrap().mode = 0o600;
    problem(&facts, "stages.permission", "nor by its group", "udev");
    // This user may, the service's may not.
    let mut facts = well();
    facts.service = Some(Account { name: "plenalign".to_owned(), uid: 990, gids: vec![44], listed_gids: vec![44] });
    warning(&facts, "stages.permission", "user plenalign", "sudo usermod -aG dialout plenalign");
    facts.service.as_mut().unwrap().gids.push(20);
    well_enough(&facts);
}

#[test]
fn a_port_that_another_program_has_is_told_with_its_name() {
    let mut facts = well();
    let holder = |name: &str| Process { pid: 412, name: name.to_owned(), command: format!("/usr/sbin/{name}") };
    let hold = |facts: &mut Facts, name: &str| facts.controllers[0].port.as_mut().unwrap().open_in = vec![holder(name)];
    hold(&mut facts, "minicom");
    problem(&facts, "stages.held", "pid 412 (/usr/sbin/minicom)", "kill 412");
    hold(&mut facts, "ModemManager");
    problem(&facts, "stages.held", "ModemManager", "systemctl disable --now ModemManager");
    hold(&mut facts, "plenalign");
    well_enough(&facts);
}

#[test]
fn programs_that_meddle_with_ports_are_told_of() {
    let mut facts = well();
    let runs = |name: &str| Process { pid: 7, name: name.to_owned(), command: String::new() };
    facts.meddlers = vec![runs("ModemManager")];
    warning(&facts, "stages.meddler", "pid 7 (ModemManager)", "systemctl disable --now ModemManager");
    facts.controllers[0].port.as_mut().unwrap().usb.as_mut().unwrap().modem_manager_ignores = true;
    well_enough(&facts);
    facts.meddlers = vec![runs("brltty")];
    warning(&facts, "stages.meddler", "brltty", "brltty-udev");
}

#[test]
fn names_that_change_and_devices_that_sleep_are_warned_of() {
    let mut facts = well();
    facts.controllers[0].config.port = "/dev/ttyUSB0".into();
    warning(&facts, "stages.name", "/dev/ttyUSB0 may be another", &format!("port = {BY_ID:?}"));
    let mut facts = well();
    facts.controllers[0].port.as_mut().unwrap().usb.as_mut().unwrap().autosuspend = true;
    warning(&facts, "stages.autosuspend", "autosuspend", "sudo tee /sys/bus/usb/devices/1-2/power/control");
    let mut facts = well();
    facts.cameras[0].file.usb.as_mut().unwrap().autosuspend = true;
    warning(&facts, "camera.autosuspend", "autosuspend", "sudo tee /sys/bus/usb/devices/1-2/power/control");
    let mut facts = well();
    facts.ports[0].port.names.remove(0);
    warning(&facts, "stages.by_id", "/dev/ttyUSB0 has no name", "udevadm trigger");
}

#[test]
fn what_a_controller_says_is_told_and_what_it_does_not_say_is_a_problem() {
    let mut facts = well();
    facts.controllers[0].identity = Some(Ok("Grbl 1.1h".to_owned()));
    well_enough(&facts);
    let found = all(&facts);
    assert!(found.iter().any(|finding| finding.id == "stages.identity" && finding.detail == "Grbl 1.1h"), "{found:?}");
    assert!(found.iter().any(|finding| finding.id == "stages.port" && finding.level == Level::Ok));
    facts.controllers[0].identity = Some(Err("controller `main` did not say what it is within 2s".to_owned()));
    problem(&facts, "stages.identity", "did not say what it is", "baud");
}

#[test]
fn a_camera_that_is_not_there_or_offers_something_else() {
    let mut facts = well();
    facts.camera = Some(CameraSource::Device(Err("no camera is \"usb:A1\"".to_owned())));
    problem(&facts, "camera.device", "no camera is", "/dev/v4l/by-id/usb-Mono-index0");
    facts.cameras.clear();
    problem(&facts, "camera.device", "no camera is", "plenalign camera list");
    let mut facts = well();
    facts.cameras[0].offers[0].format = "MJPG".to_owned();
    problem(&facts, "camera.format", "does not offer GREY: it offers MJPG 1160x1160", "format = \"MJPG\"");
    let mut facts = well();
    facts.cameras[0].offers[0].sizes[0] =
        Size { least_px: [640, 480], most_px: [1920, 1080], step_px: [2, 2], rates_hz: Vec::new() };
    problem(&facts, "camera.format", "at 1160x1160 px", "width_px = 1920, height_px = 1080");
    let mut facts = well();
    facts.cameras[0].file.ours = false;
    facts.user.listed_gids = vec![1000];
    facts.user.gids = vec![1000];
    problem(&facts, "camera.permission", "not in the group video", "sudo usermod -aG video ana");
    let mut facts = well();
    facts.cameras[0].node.unusable = Some("it captures no video now".to_owned());
    problem(&facts, "camera.device", "captures no video", "plenalign camera list");
    let mut facts = well();
    facts.cameras[0].file.open_in = vec![Process { pid: 9, name: "cheese".to_owned(), command: String::new() }];
    warning(&facts, "camera.held", "pid 9 (cheese)", "kill 9");
    let mut facts = well();
    let Ok(config) = &mut facts.configuration.config else { panic!("it is read") };
    config.bench.camera.device = "/dev/video0".to_owned();
    warning(&facts, "camera.name", "another camera after a restart", "device = \"/dev/v4l/by-id/usb-Mono-index0\"");
    let mut facts = well();
    facts.camera = Some(CameraSource::Files(Err("there is no frame at /data".to_owned())));
    problem(&facts, "camera.files", "there is no frame", "files = ");
}

#[test]
fn a_state_folder_that_cannot_be_written_keeps_the_bench_still() {
    let mut facts = well();
    state(&mut facts).folder.unwritable = Some("/var/lib/plenalign: permission denied".to_owned());
    problem(&facts, "state.folder", "nothing moves", "sudo chown -R ana: /var/lib/plenalign");
    let mut facts = well();
    state(&mut facts).folder.read_only = true;
    problem(&facts, "state.folder", "read-only", "remount,rw");
    let mut facts = well();
    state(&mut facts).folder.kind = FolderKind::Other;
    problem(&facts, "state.folder", "is no folder", "ls -ld /var/lib/plenalign");
    let mut facts = well();
    state(&mut facts).folder.kind = FolderKind::Missing;
    well_enough(&facts);
    state(&mut facts).folder.unwritable = Some("/var/lib: permission denied".to_owned());
    problem(&facts, "state.folder", "cannot make it", "sudo install -d -m 750 -o ana /var/lib/plenalign");
    let mut facts = well();
    facts.state = Err("no state folder: neither PLENALIGN_STATE_DIR nor HOME is set".to_owned());
    problem(&facts, "state.folder", "no state folder", "export PLENALIGN_STATE_DIR=");
}

#[test]
fn a_disk_without_room_and_a_history_that_is_none() {
    let mut facts = well();
    state(&mut facts).folder.free_bytes = Some(1_000_000);
    problem(&facts, "state.room", "1.0 MB are free", "df -h /var/lib/plenalign");
    state(&mut facts).folder.free_bytes = Some(500_000_000);
    warning(&facts, "state.room", "record.keep_free_mb", "df -h");
    let mut facts = well();
    state(&mut facts).history = Ok(Some(Inspection { version: 7, newest: 1, bytes: 1 }));
    problem(&facts, "state.history", "newer version", "history.db.newer");
    state(&mut facts).history = Ok(Some(Inspection { version: 1, newest: 7, bytes: 1 }));
    well_enough(&facts);
    state(&mut facts).history = Err("file is not a database".to_owned());
    problem(&facts, "state.history", "not a database", "history.db.damaged");
    let mut facts = well();
    state(&mut facts).tokens = Err("cannot use tokens.json".to_owned());
    problem(&facts, "state.tokens", "tokens.json", "ls -l");
    let mut facts = well();
    state(&mut facts).recordings = Some(FolderFacts { read_only: true, ..folder("/data") });
    problem(&facts, "state.recordings", "/data", "remount,rw");
}

#[test]
fn a_clock_that_is_wrong_is_told_of() {
    let mut facts = well();
    facts.system.synchronised = Some(false);
    warning(&facts, "clock.synchronised", "drift", "timedatectl set-ntp true");
    let mut facts = well();
    facts.system.now = Timestamp::UNIX_EPOCH;
    problem(&facts, "clock.year", "1970-01-01", "date --set");
}

#[test]
fn a_library_that_is_missing_costs_time_only() {
    let mut facts = well();
    facts.system.turbo_fault = Some("cannot open shared object file".to_owned());
    well_enough(&facts);
    let found = all(&facts).into_iter().find(|finding| finding.id == "library.turbojpeg").unwrap();
    assert_eq!((found.level, found.mend.as_deref()), (Level::Note, Some("sudo apt install libturbojpeg0")));
}

#[test]
fn a_bench_that_another_process_has_is_told_from_one_that_the_daemon_has() {
    let mut facts = well();
    let align = Process { pid: 99, name: "plenalign".to_owned(), command: "plenalign align".to_owned() };
    facts.holder = Some(align);
    problem(&facts, "bench.lock", "pid 99 (plenalign align)", "kill 99");
    let daemon = DaemonFacts { version: "1.2.3".to_owned(), simulated: false, hindrances: Vec::new() };
    facts.server.port = PortState::Taken { url: "http://127.0.0.1:8080".to_owned(), daemon: Ok(daemon) };
    well_enough(&facts);
}

#[test]
fn a_daemon_that_runs_is_asked_how_it_is() {
    let mut facts = well();
    let url = "http://127.0.0.1:8080".to_owned();
    let hindrances = vec!["the camera is not online: no frame comes".to_owned()];
    let daemon = DaemonFacts { version: "1.2.3".to_owned(), simulated: false, hindrances };
    facts.server.port = PortState::Taken { url: url.clone(), daemon: Ok(daemon) };
    problem(&facts, "server.ready", "no frame comes", "journalctl -u plenalign");
    let daemon = DaemonFacts { version: "1.0.0".to_owned(), simulated: false, hindrances: Vec::new() };
    facts.server.port = PortState::Taken { url: url.clone(), daemon: Ok(daemon) };
    warning(&facts, "server.version", "is version 1.0.0", "systemctl restart plenalign");
    facts.server.port = PortState::Taken { url, daemon: Err("404 Not Found".to_owned()) };
    problem(&facts, "server.port", "404 Not Found", "sport = :8080");
    facts.server.port = PortState::Refused("permission denied".to_owned());
    problem(&facts, "server.port", "permission denied", "--listen");
}

#[test]
fn too_few_open_files_for_the_connections_are_told_with_what_they_need() {
    let mut facts = well();
    facts.server.open_files = Some(736);
    well_enough(&facts);
    facts.server.open_files = Some(735);
    warning(&facts, "server.open_files", "server.max_connections = 256 needs 736", "LimitNOFILE=736");
    facts.server.open_files = None;
    well_enough(&facts);
}

#[test]
fn beyond_loopback_nothing_is_open() {
    let mut facts = well();
    (facts.server.listen, facts.server.address) = ("0.0.0.0:8443".to_owned(), Ok("0.0.0.0:8443".parse().unwrap()));
    problem(&facts, "server.access", "no certificate", "plenalign tls init");
    let at = |text: &str| Some(text.parse::<Timestamp>().unwrap());
    let good = |until: &str| CertificateFacts {
        path: "/var/lib/plenalign/tls/server.pem".into(),
        own: true,
        fault: None,
        from: at("2025-01-01T00:00:00Z"),
        until: at(until),
    };
    facts.server.certificate = Some(good("2027-01-01T00:00:00Z"));
    well_enough(&facts);
    facts.server.certificate = Some(good("2026-05-20T00:00:00Z"));
    warning(&facts, "server.certificate", "expires on 2026-05-20", "plenalign tls init");
    facts.server.certificate = Some(good("2026-05-01T00:00:00Z"));
    problem(&facts, "server.certificate", "expired on 2026-05-01", "plenalign tls init");
    facts.server.certificate =
        Some(CertificateFacts { from: at("2026-06-01T00:00:00Z"), ..good("2027-01-01T00:00:00Z") });
    problem(&facts, "server.certificate", "good from 2026-06-01", "date -u");
    let fault = Some("holds no private key".to_owned());
    facts.server.certificate = Some(CertificateFacts { fault, own: false, ..good("2027-01-01T00:00:00Z") });
    problem(&facts, "server.certificate", "no private key", "openssl x509");
    facts.server.certificate = Some(good("2027-01-01T00:00:00Z"));
    state(&mut facts).tokens = Ok(TokenFacts::default());
    warning(&facts, "server.access", "no token yet", "plenalign token create");
    let mut facts = well();
    let Ok(config) = &mut facts.configuration.config else { panic!("it is read") };
    config.alpaca.listen = "0.0.0.0:11111".to_owned();
    problem(&facts, "server.alpaca", "neither tokens nor TLS", "listen = \"127.0.0.1:11111\"");
}

#[test]
fn several_things_wrong_at_once_are_each_told_with_what_to_type() {
    let mut facts = well();
    facts.controllers[0].port = Err("there is no /dev/ttyUSB7".to_owned());
    facts.camera = Some(CameraSource::Device(Err("no camera".to_owned())));
    state(&mut facts).folder.read_only = true;
    facts.system.synchronised = Some(false);
    let found: Vec<Finding> = all(&facts).into_iter().filter(|finding| finding.level > Level::Note).collect();
    assert_eq!(found.len(), 4);
    for finding in found {
        assert!(finding.mend.as_ref().is_some_and(|mend| !mend.trim().is_empty()), "{finding:?}");
    }
}
