//! The configuration: the shipped files load, and everything wrong is refused with its key, its place and the reason.

use std::path::Path;

use clap::ValueEnum as _;
use plenalign::config::{
    BenchDriver, CameraDriver, Config, ConfigError, ConfigOrigin, ControlValue, ControllerDriver, Position, Side,
    TimestampMeans,
};

fn shipped(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(name)
}

/// The faults of a text as `line:column key: message`.
/// What has to be said of a hardware bench's camera.
pub(crate) const CAMERA: &str = "[main_lens]\nfocal_length_mm = 20\n\
    [mla]\narray = \"square\"\npitch_mm = 0.1\nfocal_length_mm = 0.5\nangular_resolution = 3.13\nmode = \"galilean\"\n\
    [sensor]\npixel_um = 3.45\nwidth_px = 1160\nheight_px = 1160\n\
    [shell]\nouter_radius_mm = 59\ninner_radius_mm = 51\nrefractive_index = 1.49\n";

fn faults(text: &str) -> Vec<String> {
    let error = Config::from_toml(text, "test.toml").expect_err(text);
    assert!(!error.to_string().contains('\n'), "an error is one line: {error}");
    assert!(error.to_string().starts_with("test.toml: "), "{error}");
    let line = |fault: &plenalign::config::Violation| {
        let place = fault.position.map_or_else(|| "-".to_owned(), |p| format!("{}:{}", p.line, p.column));
        format!("{place} {}: {}", fault.key, fault.message)
    };
    error.violations().iter().map(line).collect()
}

/// Asserts that a text has exactly one fault, of this key and with these words.
#[track_caller]
fn refused(text: &str, key: &str, words: &str) {
    let faults = faults(text);
    assert_eq!(faults.len(), 1, "{text}: {faults:?}");
    assert!(faults[0].contains(&format!(" {key}: ")) && faults[0].contains(words), "{text}: {faults:?}");
}

#[test]
fn the_shipped_file_is_the_preset() {
    let (config, origin) = Config::open(Some(&shipped("plenalign.toml")), &[]).unwrap();
    assert_eq!(config, Config::default());
    assert!(origin.describe(&config).ends_with("which holds the reference preset, inferred from Table 2"));
    let (preset, origin) = Config::open(None, &[]).unwrap();
    assert_eq!((&preset, &origin), (&Config::default(), &ConfigOrigin::Preset));
    assert_eq!(origin.describe(&preset), "reference preset, inferred from Table 2");
}

#[test]
fn the_shipped_file_shows_every_key() {
    // Optional keys are shown commented out: uncommented, each must be known.
    let text = std::fs::read_to_string(shipped("plenalign.toml")).unwrap();
    let mut uncommented = 0;
    let every: String = text
        .lines()
        .map(|line| match line.strip_prefix("# ") {
            Some(key)
                if key.split_once(" = ").is_some_and(|(name, _)| name.len() > 1 && !name.contains([' ', '"'])) =>
            {
                uncommented += 1;
                format!("{key}\n")
            }
            Some(section) if section.starts_with("[bench.controllers.") => format!("{section}\n"),
            _ => format!("{line}\n"),
        })
        .collect();
    assert_eq!(uncommented, 25);
    // Only the water, given twice over, is at fault then.
    let faults = faults(&every);
    assert!(faults.len() == 3 && faults.iter().all(|fault| fault.contains("water.")), "{faults:?}");
    let written = toml::from_str::<toml::Table>(&every).unwrap();
    let known = toml::Table::try_from(Config::default()).unwrap();
    fn missing(known: &toml::Table, written: &toml::Table, path: &str, found: &mut Vec<String>) {
        for (key, value) in known {
            match (value, written.get(key)) {
                (_, None) => found.push(format!("{path}{key}")),
                (toml::Value::Table(known), Some(toml::Value::Table(written))) => {
                    missing(known, written, &format!("{path}{key}."), found);
                }
                _ => {}
            }
        }
    }
    let mut found = Vec::new();
    missing(&known, &written, "", &mut found);
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn the_camera_examples_load() {
    let config = Config::load(&shipped("examples/v4l2.toml")).unwrap();
    let camera = &config.bench.camera;
    assert_eq!((config.bench.driver, camera.driver), (BenchDriver::Hardware, CameraDriver::V4l2));
    assert_eq!((camera.format.as_str(), camera.crop()), ("Y12", Some((380, 0))));
    assert_eq!(camera.controls["auto_exposure"], ControlValue::Item("Manual Mode".to_owned()));
    assert_eq!(config.notices(), Vec::<String>::new());
    let config = Config::load(&shipped("examples/genicam.toml")).unwrap();
    let camera = &config.bench.camera;
    assert_eq!((camera.driver, camera.timestamp_means), (CameraDriver::Genicam, TimestampMeans::ExposureStart));
    assert_eq!((camera.interfaces.as_slice(), camera.packet_bytes), (["eth1".to_owned()].as_slice(), Some(9000)));
    assert_eq!(camera.controls["ExposureTime"], ControlValue::Real(12_000.5));
    assert_eq!(config.notices(), Vec::<String>::new());
    let config = Config::load(&shipped("examples/files.toml")).unwrap();
    assert_eq!(config.bench.camera.driver, CameraDriver::Files);
    assert_eq!(config.notices(), Vec::<String>::new());
}

#[test]
fn the_hardware_example_loads() {
    let config = Config::load(&shipped("examples/grbl.toml")).unwrap();
    assert_eq!(config.bench.driver, BenchDriver::Hardware);
    assert_eq!(config.bench.controllers["main"].baud(), 115_200);
    assert_eq!(config.notices(), Vec::<String>::new());
    // Quan and Fry at 20 °C, fresh, 550 nm.
    assert!((config.water.index() - 1.334_338_19).abs() < 5e-9, "{}", config.water.index());
    assert_eq!(config.design().shell.n_water, config.water.index());
}

#[test]
fn the_package_s_configuration_loads_as_it_is_and_with_its_hardware() {
    let file = shipped("debian/plenalign.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    // A bench is simulated because somebody says so, not because nobody says anything.
    assert!(text.contains("\ndriver = \"simulated\"\n"), "{text}");
    assert_eq!(Config::load(&file).unwrap().bench.driver, BenchDriver::Simulated);
    let is_key =
        |line: &str| line.starts_with('[') || line.split_once(" = ").is_some_and(|(key, _)| !key.contains(' '));
    let uncommented: Vec<&str> =
        text.lines().map(|line| line.strip_prefix("# ").filter(|key| is_key(key)).unwrap_or(line)).collect();
    let config =
        Config::from_toml(&uncommented.join("\n").replace("\"simulated\"", "\"hardware\""), "hardware").unwrap();
    assert_eq!(config.bench.driver, BenchDriver::Hardware);
    assert!(config.bench.controllers["main"].port.starts_with("/dev/plenalign"), "{:?}", config.bench.controllers);
    assert!(config.bench.camera.device.starts_with("/dev/plenalign/camera-"), "{}", config.bench.camera.device);
    assert_eq!(config.notices(), Vec::<String>::new());
}

/// A hardware bench whose camera has these keys.
fn hardware(camera: &str) -> String {
    format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\nport = \"/dev/ttyUSB0\"\n\
         [bench.camera]\n{camera}\n"
    )
}

#[test]
fn a_camera_is_named_by_file_card_or_serial_number() {
    for device in ["/dev/video2", "/dev/v4l/by-path/pci-0000:00:14.0-usb", "card:Mono Camera", "usb:SN 42"] {
        let config = Config::from_toml(&hardware(&format!("device = {device:?}")), "t").unwrap();
        assert_eq!(config.bench.camera.device, device);
    }
    for device in ["", "card:", "usb: ", "serial:12"] {
        refused(&hardware(&format!("device = {device:?}")), "bench.camera.device", "names no device");
    }
    refused(&hardware("driver = \"files\""), "bench.camera.files", "is empty");
}

#[test]
fn a_genicam_camera_is_named_by_serial_number_name_address_or_product() {
    let genicam = |keys: &str| hardware(&format!("driver = \"genicam\"\nformat = \"Mono12p\"\n{keys}"));
    for device in ["serial:40012345", "name:bench 2", "192.168.7.20"] {
        let text = genicam(&format!("interfaces = [\"eth1\"]\ndevice = {device:?}"));
        assert_eq!(Config::from_toml(&text, "t").unwrap().bench.camera.device, device);
    }
    Config::from_toml(&genicam("device = \"192.168.7.20\""), "t").unwrap();
    // One on USB is found without an interface.
    for device in ["serial:1", "usb:2676:BA02"] {
        Config::from_toml(&genicam(&format!("device = {device:?}")), "t").unwrap();
    }
    for device in ["", "serial:", "usb:1", "/dev/video0", "192.168.7"] {
        refused(&genicam(&format!("device = {device:?}")), "bench.camera.device", "names no GenICam camera");
    }
    refused(&genicam("device = \"10.0.0.2\"\npacket_bytes = 100"), "bench.camera.packet_bytes", "576 to 65535");
    refused(&genicam("device = \"10.0.0.2\"\npacket_delay_us = -1.0"), "bench.camera.packet_delay_us", "negative");
    let of_format =
        |format: &str| hardware(&format!("driver = \"genicam\"\ndevice = \"10.0.0.2\"\nformat = {format:?}"));
    refused(&of_format("GREY"), "bench.camera.format", "Mono8, Mono10");
    refused(&of_format("BayerRG12p"), "bench.camera.format", "set sensor.mosaic = \"rggb\"");
}

#[test]
fn controls_are_numbers_switches_and_items() {
    let text = "[bench.camera.controls]\ngain = -3\nauto_exposure = \"Manual Mode\"\ntrigger = true\n";
    let mut config = Config::from_toml(text, "t").unwrap();
    let controls = &config.bench.camera.controls;
    assert_eq!(controls["gain"], ControlValue::Number(-3));
    assert_eq!(controls["auto_exposure"], ControlValue::Item("Manual Mode".to_owned()));
    assert_eq!(controls["trigger"], ControlValue::Switch(true));
    config.set("bench.camera.controls.gain", "12").unwrap();
    config.set("bench.camera.controls.white_balance_automatic", "false").unwrap();
    assert_eq!(config.bench.camera.controls["gain"], ControlValue::Number(12));
    assert_eq!(config.bench.camera.controls["white_balance_automatic"], ControlValue::Switch(false));
    refused("[bench.camera.controls]\ngain = 1.5\n", "bench.camera.controls.gain", "a whole number or the name");
}

#[test]
fn format_and_sensor_agree_on_the_mosaic() {
    let with = |format: &str, mosaic: &str| {
        hardware(&format!("format = {format:?}")).replace("[sensor]\n", &format!("[sensor]\n{mosaic}\n"))
    };
    for (format, mosaic) in [("RG10", "mosaic = \"rggb\""), ("pBCC", "mosaic = \"bggr\""), ("GREY", ""), ("YUYV", "")] {
        Config::from_toml(&with(format, mosaic), "t").unwrap();
    }
    // A mosaic camera that calls its pixels grey is believed.
    Config::from_toml(&with("Y12", "mosaic = \"gbrg\""), "t").unwrap();
    refused(&with("RG10", ""), "bench.camera.format", "set sensor.mosaic = \"rggb\"");
    refused(&with("BG12", "mosaic = \"rggb\""), "bench.camera.format", "set sensor.mosaic = \"bggr\"");
    refused(&with("YUYV", "mosaic = \"rggb\""), "bench.camera.format", "already interpolated");
}

#[test]
fn every_kind_of_stage_has_an_example_that_loads() {
    for &driver in ControllerDriver::value_variants() {
        let name = driver.name();
        let config = Config::load(&shipped(&format!("examples/{name}.toml"))).unwrap();
        assert_eq!(config.bench.driver, BenchDriver::Hardware, "{name}");
        for axis in [&config.bench.focus, &config.bench.e] {
            assert_eq!(config.bench.controllers[&axis.controller].driver, driver, "{name}");
        }
        assert_eq!(config.notices(), Vec::<String>::new(), "{name}");
    }
}

#[test]
fn axes_that_a_controller_cannot_have_are_refused() {
    for (driver, axis, words) in [
        ("grbl", "A", "X, Y or Z"),
        ("zaber", "0", "1 to 9"),
        ("pi", "1-2", "letters and digits"),
        ("tmcl", "6", "0 to 5"),
        ("thorlabs", "4", "1 to 3"),
    ] {
        let text = format!(
            "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"{driver}\"\nport = \"/dev/x\"\n\
             [bench.focus]\naxis = \"1\"\n[bench.e]\naxis = \"{axis}\"\n"
        );
        let text = if driver == "grbl" { text.replace("axis = \"1\"", "axis = \"X\"") } else { text };
        refused(&text, "bench.e.axis", words);
    }
    let text = "[bench.controllers.main]\ndriver = \"pi\"\nport = \"usb:\"\n";
    refused(text, "bench.controllers.main.port", "USB serial number");
}

#[test]
fn a_part_of_a_section_keeps_the_rest_of_the_preset() {
    let config = Config::from_toml("[bench.e]\nbacklash_mm = 0.1\n[mla]\nfocal_length_mm = 1\n", "t").unwrap();
    let mut expected = Config::default();
    expected.bench.e.backlash_mm = 0.1;
    expected.mla.focal_length_mm = 1.0;
    assert_eq!(config, expected);
    assert_eq!(config.bench.e.home_side, Side::High);
    assert_eq!(Config::from_toml("", "empty").unwrap(), Config::default());
}

#[test]
fn a_missing_or_broken_file_says_so() {
    let error = Config::load(Path::new("/nonexistent/plenalign.toml")).unwrap_err();
    assert!(matches!(error, ConfigError::Read { .. }) && error.to_string().contains("/nonexistent/plenalign.toml"));
    let error = Config::from_toml("[mla]\npitch_mm = = 2\n", "t").unwrap_err();
    let ConfigError::Syntax { position, .. } = &error else { panic!("{error}") };
    assert_eq!(position.line, 2);
    // The parser takes this for a boolean: the line itself, and how one is written, say more.
    for written in ["width_px = twelve", "width_px = 1,5", "wi\u{1}dth_px 5"] {
        let said = Config::from_toml(&format!("[sensor]\n  {written}\n"), "t").unwrap_err().to_string();
        assert!(said.contains(&format!("`{}`", written.replace('\u{1}', "\u{fffd}"))), "{said}");
        assert!(said.ends_with("a text in quotes, a decimal with a point"), "{said}");
    }
    let twice = Config::from_toml("[mla]\npitch_mm = 1\npitch_mm = 2\n", "t").unwrap_err();
    assert!(matches!(twice, ConfigError::Syntax { position: Position { line: 3, .. }, .. }), "{twice}");
}

#[test]
fn unknown_keys_are_all_named_with_their_place() {
    let found = faults("[mla]\npitch_mm = 0.1\n  pich_mm = 0.2\n[sensr]\npixel_um = 3\n[bench.e]\nxyzzy = 1\n");
    assert_eq!(found.len(), 3, "{found:?}");
    assert_eq!(found[0], "3:3 mla.pich_mm: unknown key; did you mean mla.pitch_mm?");
    assert!(found[1].starts_with("4:2 sensr: ") && found[1].ends_with("did you mean sensor?"), "{found:?}");
    assert!(found[2].starts_with("7:1 bench.e.xyzzy: unknown key; known here: "), "{found:?}");
}

#[test]
fn wrong_types_are_named_with_their_place() {
    let found = faults("[mla]\npitch_mm = \"0.1\"\n");
    assert_eq!(found, ["2:12 mla.pitch_mm: invalid type: string \"0.1\", expected a number"]);
    assert_eq!(faults("[mla]\narray = \"round\"\n").len(), 1);
    assert!(faults("[mla]\narray = \"round\"\n")[0].contains("mla.array: unknown variant `round`, expected `square`"));
    assert!(faults("mla = 3\n")[0].starts_with("1:7 mla: "));
    assert!(faults("[sensor]\nwidth_px = -1\n")[0].contains("sensor.width_px"));
    assert!(faults("[bench.controllers.main]\nport = \"/dev/x\"\n")[0].contains("bench.controllers.main: missing"));
}

#[test]
fn impossible_values_are_refused_with_the_reason() {
    for (text, key, words) in [
        ("[main_lens]\nfocal_length_mm = 0", "main_lens.focal_length_mm", "greater than 0"),
        ("[main_lens]\nfocal_length_mm = nan", "main_lens.focal_length_mm", "finite"),
        ("[main_lens]\nprincipal_from_mount_sigma_mm = 0.1", "main_lens.principal_from_mount_sigma_mm", "not given"),
        ("[mla]\nangular_resolution = 1", "mla.angular_resolution", "Galilean"),
        ("[mla]\nangular_resolution = 50", "mla.angular_resolution", "in front of the main lens"),
        ("[mla]\nmode = \"keplerian\"\nangular_resolution = 0", "mla.angular_resolution", "greater than 0"),
        ("[mla]\npitch_mm = -0.1", "mla.pitch_mm", "greater than 0"),
        ("[sensor]\npixel_um = 0", "sensor.pixel_um", "greater than 0"),
        ("[sensor]\nwidth_px = 0", "sensor.width_px", "at least 16"),
        ("[sensor]\nheight_px = 10", "sensor.height_px", "at least 16"),
        ("[sensor]\nwidth_px = 100000\nheight_px = 100000", "sensor.width_px", "largest frame"),
        ("[shell]\ninner_radius_mm = 59", "shell.inner_radius_mm", "no thickness"),
        ("[shell]\ninner_radius_mm = -1", "shell.inner_radius_mm", "greater than 0"),
        ("[shell]\nrefractive_index = 0.9", "shell.refractive_index", "at least 1"),
        ("[water]\nrefractive_index = 0.5", "water.refractive_index", "at least 1"),
        ("[water]\nrefractive_index = 1.3\ntemperature_c = 20", "water.temperature_c", "one or the other"),
        ("[water]\ntemperature_c = 20\nsalinity_permille = 0", "water.wavelength_nm", "is missing"),
        (
            "[water]\ntemperature_c = 31\nsalinity_permille = 0\nwavelength_nm = 500",
            "water.temperature_c",
            "0 to 30 °C",
        ),
        ("[object]\ndistance_mm = inf", "object.distance_mm", "finite"),
        ("[object]\nair_distance_mm = 19", "object.air_distance_mm", "focal length"),
        ("[assembly]\nl_bound_mm = 33", "assembly.l_bound_mm", "beyond the e axis's travel"),
        ("[assembly]\nl_bound_mm = -4.95", "assembly.l_bound_mm", "e wall"),
        ("[assembly]\ninitial_e_mm = 40", "assembly.initial_e_mm", "beyond the e axis's travel"),
        ("[assembly]\ninitial_e_mm = -1", "assembly.initial_e_mm", "too near the shell"),
        ("[assembly]\ne_tolerance_mm = 0", "assembly.e_tolerance_mm", "greater than 0"),
        ("[assembly]\ndelta_v_tolerance_mm = -1", "assembly.delta_v_tolerance_mm", "greater than 0"),
        ("[boards]\nlevel_step_mm = 0", "boards.level_step_mm", "greater than 0"),
        ("[boards]\nside_mm = -1", "boards.side_mm", "greater than 0"),
        ("[boards]\ntank_mm = 0", "boards.tank_mm", "greater than 0"),
        ("[boards]\nfarthest_mm = 0", "boards.farthest_mm", "greater than 0"),
        ("[boards]\ngreatest_depth_mm = 0", "boards.greatest_depth_mm", "greater than 0"),
        ("[boards]\nin_air = \"four\"", "boards.in_air", "triple_level"),
        ("[assembly]\nblur_limit_px = 0", "assembly.blur_limit_px", "greater than 0"),
        ("[assembly]\nclearance_mm = -0.5", "assembly.clearance_mm", "negative"),
        ("[bench.focus]\nlow_limit_mm = 5", "bench.focus.low_limit_mm", "not less than"),
        ("[bench.e]\nhome_position_mm = 33", "bench.e.home_position_mm", "outside the limits"),
        ("[bench.e]\nspeed_mm_per_s = 0", "bench.e.speed_mm_per_s", "greater than 0"),
        ("[bench.e]\nbacklash_mm = -0.1", "bench.e.backlash_mm", "negative"),
        ("[bench.e]\nscale_uncertainty = 1", "bench.e.scale_uncertainty", "relative"),
        ("[bench.camera]\nformat = \"H264\"", "bench.camera.format", "these are: GREY, Y10"),
        ("[bench.camera]\nframe_rate_hz = 0", "bench.camera.frame_rate_hz", "greater than 0"),
        ("[bench.simulation]\ne_scale_error = -1", "bench.simulation.e_scale_error", "relative"),
        ("[bench.simulation]\nrays = 0", "bench.simulation.rays", "at least 1"),
        ("[bench.simulation]\nmla_tilt_mrad = [0, nan]", "bench.simulation.mla_tilt_mrad", "finite"),
        ("[bench.simulation]\narray_rotation_deg = -45", "bench.simulation.array_rotation_deg", "square array"),
        ("[bench.simulation]\nbits = 7", "bench.simulation.bits", "8 to 16 bits"),
        ("[bench.simulation]\ndistortion_k1 = -2.5", "bench.simulation.distortion_k1", "at most ±2.1"),
        ("[bench.simulation]\nexit_pupil_walk_mm = 1.5", "bench.simulation.exit_pupil_walk_mm", "at most ±0.9"),
    ] {
        refused(text, key, words);
    }
}

#[test]
fn flaws_that_cannot_be_are_refused_with_the_reason() {
    for (section, line, key, words) in [
        ("microlenses", "focal_factors = [1.0, 0.9, 1.1]", "focal_factors", "has 3: a square array has 2 types"),
        ("microlenses", "focal_factors = [1.0, 0.0]", "focal_factors", "greater than 0"),
        ("microlenses", "dead_share = 1.1", "dead_share", "share from 0 to 1"),
        ("microlenses", "dead_share = 0.6\ndirty_share = 0.5", "dirty_share", "more than all"),
        ("microlenses", "dirty_transmission = [0.9, 0.3]", "dirty_transmission", "in this order"),
        ("dust", "specks = 30000", "specks", "20000 handled"),
        ("dust", "opacity = [0.5, 1.5]", "opacity", "from 0 to 1"),
        ("dust", "height_um = 341", "height_um", "340 µm apart"),
        ("bubbles", "radius_mm = [0, 1]", "radius_mm", "greater than 0"),
        ("bubbles", "distance_mm = [0.5, 100]", "distance_mm", "beyond the greatest radius"),
        ("bubbles", "highlight = -1", "highlight", "negative"),
        ("motion", "steps = 0", "steps", "from 1 to 256"),
        ("motion", "e_um = 5", "steps", "2 or more"),
        ("motion", "steps = 2\ndelta_v_um = 5001", "delta_v_um", "at most ±5000"),
        ("motion", "board_um = [nan, 0]", "board_um", "finite"),
        ("mosaic", "sensitivities = [0.5, 0, 0.5]", "sensitivities", "greater than 0"),
        ("mosaic", "colour = 2", "colour", "share from 0 to 1"),
    ] {
        let key = format!("bench.simulation.{section}.{key}");
        refused(&format!("[bench.simulation.{section}]\n{line}"), &key, words);
    }
    let mut config = Config::default();
    config.set("sensor.mosaic", "gbrg").unwrap();
    config.set("mla.array", "hexagonal").unwrap();
    config.set("bench.simulation.microlenses.focal_factors", "[1.0, 0.9, 1.1]").unwrap();
    let error = config.set("sensor.mosaic", "rgbg").unwrap_err().to_string();
    assert!(error.contains("rggb") && error.contains("gbrg"), "{error}");
    let error = config.set("bench.simulation.mosaic.sensitivities", "[1, 2]").unwrap_err().to_string();
    assert!(error.contains("three numbers"), "{error}");
}

#[test]
fn hardware_needs_its_controllers() {
    let found = faults(&format!("{CAMERA}[bench]\ndriver = \"hardware\"\n"));
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].contains("bench.focus.controller") && found[0].contains("[bench.controllers.main]"), "{found:?}");
    let wired = format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\nport = \"/dev/ttyACM0\"\n"
    );
    assert!(Config::from_toml(&wired, "t").is_ok());
    refused(&format!("{wired}[bench.e]\naxis = \"X\"\n"), "bench.e.axis", "focus axis's");
    refused(&format!("{wired}[bench.e]\naxis = \"W\"\n"), "bench.e.axis", "X, Y or Z");
}

#[test]
fn a_server_that_could_let_in_the_wrong_ones_or_nobody_is_refused() {
    for (line, key, words) in [
        ("auth = \"none\"", "server.auth", "required"),
        ("names = [\"https://bench.lab\"]", "server.names", "without scheme and port"),
        ("trusted_proxies = [\"proxy\"]", "server.trusted_proxies", "10.0.0.0/8"),
        ("max_connections = 0", "server.max_connections", "1 to 512"),
        ("max_connections_per_address = 1000", "server.max_connections_per_address", "1 to 512"),
        ("idle_timeout_s = 0.0", "server.idle_timeout_s", "1 to 3600"),
        ("requests_per_s = 0.0", "server.requests_per_s", "1 to 1000000"),
        ("max_viewports = 0", "server.max_viewports", "1 to 256"),
        ("tls.certificate = \"a.pem\"", "server.tls.key", "is missing"),
        ("tls.key = \"a.key\"", "server.tls.certificate", "is missing"),
    ] {
        refused(&format!("[server]\n{line}\n"), key, words);
    }
    for (line, key, words) in [
        ("listen = \"localhost\"", "alpaca.listen", "such as 127.0.0.1:11111"),
        ("listen = \":11111\"", "alpaca.listen", "such as 127.0.0.1:11111"),
        ("lease_ttl_s = 1.0", "alpaca.lease_ttl_s", "2 to 3600"),
    ] {
        refused(&format!("[alpaca]\n{line}\n"), key, words);
    }
}

#[test]
fn all_faults_are_told_at_once_in_the_order_of_the_file() {
    let found = faults("[shell]\ninner_radius_mm = 60\n[mla]\npitch_mm = 0\nangular_resolution = 0.5\n");
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(
        found[0].starts_with("2:19 shell.inner_radius_mm: 60 mm is not less than outer_radius_mm, 59 mm"),
        "{found:?}"
    );
    assert!(
        found[1].starts_with("4:12 mla.pitch_mm") && found[2].starts_with("5:22 mla.angular_resolution"),
        "{found:?}"
    );
}

#[test]
fn overrides_set_keys_with_the_same_checks() {
    let mut config = Config::default();
    config.set("bench.simulation.e_scale_error", "0.03").unwrap();
    config.set("bench.simulation.mla_tilt_mrad", "[1, 0.5]").unwrap();
    config.set("bench.simulation.texture", "guppy").unwrap();
    config.set("mla.array", "\"hexagonal\"").unwrap();
    config.set("bench.e.axis", "2").unwrap();
    config.set("bench.simulation.seed", "7").unwrap();
    let simulation = &config.bench.simulation;
    assert_eq!((simulation.e_scale_error, simulation.mla_tilt_mrad, simulation.seed), (0.03, [1.0, 0.5], 7));
    assert_eq!((config.mla.array.name(), config.bench.e.axis.as_str()), ("hexagonal", "2"));
    config
        .set_all([
            ("water.refractive_index", ""),
            ("water.temperature_c", "10"),
            ("water.salinity_permille", "35"),
            ("water.wavelength_nm", "532"),
        ])
        .unwrap();
    assert!((config.water.index() - 1.342_395).abs() < 1e-6);

    let before = config.clone();
    for (key, value, words) in [
        ("bench.simulation.e_scale_eror", "0.03", "did you mean bench.simulation.e_scale_error?"),
        ("e_scale_error", "0.03", "did you mean bench.simulation.e_scale_error?"),
        ("bench.e", "3", "section"),
        ("mla.pitch_mm", "wide", "expected a number"),
        ("mla.pitch_mm", "-1", "greater than 0"),
        ("mla.pitch_mm", "1\nfocal_length_mm = 3", "expected a number"),
        ("sensor.width_px", "1.5", "whole number"),
        ("water.temperature_c", "99", "0 to 30 °C"),
        ("mla..pitch_mm", "1", "unknown key"),
        ("", "1", "unknown key"),
    ] {
        let error = config.set(key, value).unwrap_err();
        assert!(error.to_string().contains(words), "{key}={value}: {error}");
        assert!(!error.to_string().contains('\n'), "{error}");
        assert_eq!(config, before, "{key}={value} changed something");
    }
}

#[test]
fn homing_towards_the_shell_is_allowed_and_said() {
    let config = Config::from_toml("[bench.e]\nhome_side = \"low\"\nhome_position_mm = 0\n", "t").unwrap();
    assert!(config.notices().iter().any(|notice| notice.contains("towards the shell")), "{:?}", config.notices());
    assert_eq!(Config::default().notices(), Vec::<String>::new());
    let far = Config::from_toml("[bench.focus]\nhigh_limit_mm = 2\n", "t").unwrap();
    assert!(far.notices()[0].contains("Δv = 2.205 mm"), "{:?}", far.notices());
}

/// A file with this text, and what `--set` of these comes to with it.
fn opened(text: &str, set: &[&str]) -> Result<Config, plenalign::config::ConfigError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(&file, text).unwrap();
    let set: Vec<String> = set.iter().map(|&one| one.to_owned()).collect();
    Config::open(Some(file.path()), &set).map(|(config, _)| config)
}

#[test]
fn what_is_in_force_is_checked_and_not_the_file_alone() {
    let text = "[assembly]\ninitial_e_mm = 40\n";
    assert!(
        opened(text, &[])
            .unwrap_err()
            .to_string()
            .contains("line 2, column 16: assembly.initial_e_mm: 40 mm is beyond")
    );
    let config = opened(text, &["bench.e.high_limit_mm=80"]).unwrap();
    assert_eq!((config.assembly.initial_e_mm, config.bench.e.high_limit_mm), (40.0, 80.0));
    // What is wrong says where it came from.
    let still = opened(text, &["bench.e.high_limit_mm=35"]).unwrap_err().to_string();
    assert!(
        still.contains("line 2, column 16: assembly.initial_e_mm: 40 mm is beyond") && still.contains("to 35"),
        "{still}"
    );
    let set = opened("[mla]\npitch_mm = 0.1\n", &["mla.pitch_mm=-1"]).unwrap_err();
    assert!(set.to_string().contains(": mla.pitch_mm: must be greater than 0, not -1 (from --set)"), "{set}");
    assert_eq!(set.violations()[0].position, None, "the file's value is not to blame");
    let none = Config::open(None, &["mla.pitch_mm=-1".to_owned()]).unwrap_err().to_string();
    assert!(none.starts_with("--set: mla.pitch_mm: "), "{none}");
    for (wrong, words) in [("mla.pitch_mm", "expected KEY=VALUE"), ("mla.pich_mm=1", "did you mean mla.pitch_mm?")] {
        let error = opened("", &[wrong]).unwrap_err().to_string();
        assert!(error.starts_with("--set: mla.pi") && error.contains(words), "{error}");
    }
    // A file's own mistakes are none of --set's.
    assert!(opened("[mla]\npich_mm = 1\n", &["mla.pitch_mm=0.1"]).unwrap_err().to_string().contains("mla.pich_mm"));
}

#[test]
fn on_hardware_lens_array_sensor_and_shell_have_no_defaults() {
    let bench = "[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\nport = \"/dev/x\"\n";
    let keys = [
        "main_lens.focal_length_mm",
        "mla.array",
        "mla.pitch_mm",
        "mla.focal_length_mm",
        "mla.angular_resolution",
        "mla.mode",
        "sensor.pixel_um",
        "sensor.width_px",
        "sensor.height_px",
        "shell.outer_radius_mm",
        "shell.inner_radius_mm",
        "shell.refractive_index",
    ];
    let missing = |text: &str, set: &[&str]| -> Vec<String> {
        let error = opened(text, set).unwrap_err();
        assert!(error.violations().iter().all(|fault| fault.message.contains("on a hardware bench")), "{error}");
        error.violations().iter().map(|fault| fault.key.clone()).collect()
    };
    let mut all = missing(bench, &[]);
    all.sort_by_key(|key| keys.iter().position(|known| known == key));
    assert_eq!(all, keys, "every one at once");
    // One by one, and wherever it is said.
    let preset = toml::Table::try_from(Config::default()).unwrap();
    assert!(opened(&format!("{CAMERA}{bench}"), &[]).is_ok());
    for key in keys {
        let (_, name) = key.split_once('.').unwrap();
        let section = format!("[{}]", key.split_once('.').unwrap().0);
        let mut within = false;
        let without: Vec<&str> = CAMERA
            .lines()
            .filter(|line| {
                within = if line.starts_with('[') { *line == section } else { within };
                !(within && line.starts_with(&format!("{name} =")))
            })
            .collect();
        let text = format!("{}\n{bench}", without.join("\n"));
        assert_eq!(missing(&text, &[]), [key]);
        let value = &preset[key.split_once('.').unwrap().0][name];
        assert!(opened(&text, &[&format!("{key}={value}")]).is_ok(), "{key} by --set");
    }
    // A simulated bench has them, and so has not a simulated file made hardware by --set.
    assert!(opened("", &[]).is_ok());
    let set = ["bench.driver=hardware", "bench.focus.axis=X"];
    let wired = bench.replace("driver = \"hardware\"\n", "");
    assert_eq!(missing(&wired, &set).len(), keys.len());
    // The stop of a bench whose camera is not said is not kept from it.
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(&file, bench).unwrap();
    assert!(Config::open_to_stop(Some(file.path()), &[]).is_ok());
}

/// Every key of the schema that holds a number with a fraction, and how many numbers it holds.
fn fractions(table: &toml::Table, path: &str, found: &mut Vec<(String, usize)>) {
    for (key, value) in table {
        let full = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        match value {
            toml::Value::Table(inner) => fractions(inner, &full, found),
            toml::Value::Float(_) => found.push((full, 0)),
            toml::Value::Array(items) if items.iter().any(toml::Value::is_float) => found.push((full, items.len())),
            _ => {}
        }
    }
}

#[test]
fn no_number_of_any_key_comes_to_one_that_is_none() {
    use plenalign::control::design::draft::DraftView;
    let mut found = Vec::new();
    fractions(&toml::Table::try_from(Config::default()).unwrap(), "", &mut found);
    let optional = [
        "main_lens.principal_from_mount_mm",
        "main_lens.principal_from_mount_sigma_mm",
        "water.refractive_index",
        "bench.simulation.array_rotation_deg",
    ];
    found.extend(optional.map(|key| (key.to_owned(), 0)));
    found.push(("bench.simulation.microlenses.focal_factors".to_owned(), 2));
    assert!(found.len() > 80, "{}", found.len());
    let numbers =
        ["1e308", "-1e308", "1e-308", "-1e-308", "0.0", "-0.0", "nan", "inf", "-inf", "1e9", "-1e9", "1e-9", "1e5"];
    for (key, many) in &found {
        for number in numbers {
            let value = if *many == 0 { number.to_owned() } else { format!("[{}]", vec![number; *many].join(", ")) };
            let mut config = Config::default();
            if key == "main_lens.principal_from_mount_sigma_mm" {
                config.set("main_lens.principal_from_mount_mm", "1.0").unwrap();
            }
            if let Err(error) = config.set(key, &value) {
                let section = key.rsplit_once('.').map_or("", |(section, _)| section);
                // A number that is believed may not go together with another key's, which then is named.
                let said =
                    |fault: &plenalign::config::Violation| fault.key == *key || fault.to_string().contains(section);
                let named = error.violations().iter().any(said);
                let believed = number.parse::<f64>().is_ok_and(|number| (1e-9..=1e9).contains(&number.abs()));
                assert!(named || believed, "{key} = {value}: {error}");
                continue;
            }
            let magnitude: f64 = number.parse().unwrap();
            assert!(magnitude.abs() <= 1e9, "{key} = {value} is taken");
            let view = DraftView::of(&config, &ConfigOrigin::Preset);
            let told = format!("{view:?}").replace("inferred", "");
            assert!(view.is_some() && !told.contains("NaN") && !told.contains("inf"), "{key} = {value}: {told}");
            assert!(!config.notices().join(" ").contains("NaN"), "{key} = {value}: {:?}", config.notices());
        }
    }
}
