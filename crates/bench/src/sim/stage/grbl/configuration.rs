//! The twin's configuration where it is FluidNC: what a firmware configured for the bench's axes would tell.

use super::motion::HomingPhase;
use super::settings::FirmwareConfig;

/// Search over this many travels: the switch lies a pull-off beyond the travel, and short axes have little of it.
const SEEK_SCALER: f64 = 2.0;
/// The slow approach goes over this many pull-offs.
const FEED_SCALER: f64 = 1.5;

/// FluidNC's configuration and what it knows of homing.
pub(super) struct Fluid {
    /// Every key by its way from the root, in the order of the dump; sections have no value.
    items: Vec<(String, String)>,
    pub(super) homed: [bool; 3],
}

pub(super) fn letter(axis: usize) -> char {
    ['x', 'y', 'z'][axis.min(2)]
}

impl Fluid {
    pub(super) fn new(config: &FirmwareConfig) -> Self {
        let mut fluid = Self { items: Vec::new(), homed: [false; 3] };
        let mut add = |path: &str, value: String| fluid.items.push((path.to_owned(), value));
        let number = |value: f64| format!("{value:.6}");
        let flag = |value: bool| value.to_string();
        add("board", "None".to_owned());
        add("name", "a bench".to_owned());
        add("meta", String::new());
        for (path, value) in [
            ("stepping", ""),
            ("stepping/engine", "RMT"),
            ("stepping/idle_ms", "255"),
            ("stepping/pulse_us", "4"),
            ("stepping/dir_delay_us", "0"),
            ("stepping/disable_delay_us", "0"),
            ("stepping/segments", "12"),
            ("kinematics", ""),
            ("kinematics/Cartesian", ""),
            ("axes", ""),
            ("axes/shared_stepper_disable_pin", "gpio.13:low"),
            ("axes/shared_stepper_reset_pin", "NO_PIN"),
            ("axes/homing_runs", "2"),
        ] {
            add(path, value.to_owned());
        }
        for (axis, fitted) in config.axes.iter().enumerate() {
            let Some(fitted) = fitted else { continue };
            let begin = format!("axes/{}", letter(axis));
            let mut add = |key: &str, value: String| add(&format!("{begin}{key}"), value);
            add("", String::new());
            add("/steps_per_mm", number(fitted.steps_per_mm));
            add("/max_rate_mm_per_min", number(fitted.max_rate_mm_per_min));
            add("/acceleration_mm_per_sec2", number(fitted.acceleration_mm_per_s2));
            add("/max_travel_mm", number(fitted.travel_mm));
            add("/soft_limits", flag(true));
            add("/homing", String::new());
            add("/homing/cycle", "1".to_owned());
            add("/homing/allow_single_axis", flag(config.single_axis_homing));
            add("/homing/positive_direction", flag(!fitted.homes_negative));
            add("/homing/mpos_mm", number(fitted.home_mm));
            add("/homing/feed_mm_per_min", number(config.locate_rate_mm_per_min));
            add("/homing/seek_mm_per_min", number(config.seek_rate_mm_per_min.min(fitted.max_rate_mm_per_min)));
            add("/homing/settle_ms", "250".to_owned());
            add("/homing/seek_scaler", number(SEEK_SCALER));
            add("/homing/feed_scaler", number(FEED_SCALER));
            add("/motor0", String::new());
            let pin = |separate: bool, number: usize| match separate == config.separate_pins {
                true => format!("gpio.{number}:low:pu"),
                false => "NO_PIN".to_owned(),
            };
            add("/motor0/limit_neg_pin", pin(true, 32 + axis));
            add("/motor0/limit_pos_pin", pin(true, 25 + axis));
            add("/motor0/limit_all_pin", pin(false, 35 + axis));
            add("/motor0/hard_limits", flag(config.hard_limits));
            add("/motor0/pulloff_mm", number(config.pull_off_mm));
            add("/motor0/standard_stepper", String::new());
            add("/motor0/standard_stepper/step_pin", format!("gpio.{}", 16 + axis));
            let direction = format!("gpio.{}{}", 4 + axis, if fitted.motor_inverted { ":low" } else { "" });
            add("/motor0/standard_stepper/direction_pin", direction);
            add("/motor0/standard_stepper/disable_pin", "NO_PIN".to_owned());
        }
        for (path, value) in [
            ("control", ""),
            ("control/safety_door_pin", "NO_PIN"),
            ("control/feed_hold_pin", "NO_PIN"),
            ("macros", ""),
            ("macros/startup_line0", ""),
            ("macros/startup_line1", ""),
            ("macros/after_homing", ""),
            ("macros/after_reset", ""),
            ("macros/after_unlock", ""),
            ("start", ""),
        ] {
            add(path, value.to_owned());
        }
        add("start/must_home", flag(config.must_home));
        add("report_inches", flag(false));
        for (path, value) in &config.keys {
            match fluid.items.iter_mut().find(|(key, _)| key == path) {
                Some(item) => item.1.clone_from(value),
                None => {
                    // Behind the section that it is in.
                    let section = path.rsplit_once('/').map_or("", |(section, _)| section);
                    let at =
                        fluid.items.iter().position(|(key, _)| key == section).map_or(fluid.items.len(), |at| at + 1);
                    fluid.items.insert(at, (path.clone(), value.clone()));
                }
            }
        }
        fluid
    }

    fn get(&self, path: &str) -> &str {
        self.items.iter().find(|(key, _)| key.eq_ignore_ascii_case(path)).map_or("", |(_, value)| value)
    }

    /// A key with its value.
    pub(super) fn item(&mut self, path: &str) -> Option<&mut (String, String)> {
        self.items.iter_mut().find(|(key, _)| key.eq_ignore_ascii_case(path))
    }

    pub(super) fn axis_number(&self, axis: usize, key: &str) -> f64 {
        self.get(&format!("axes/{}/{key}", letter(axis))).parse().unwrap_or(0.0)
    }

    pub(super) fn axis_flag(&self, axis: usize, key: &str) -> bool {
        self.get(&format!("axes/{}/{key}", letter(axis))) == "true"
    }

    pub(super) fn must_home(&self) -> bool {
        self.get("start/must_home") == "true"
    }

    /// The lines of the dump.
    pub(super) fn dump(&self) -> impl Iterator<Item = String> {
        self.items.iter().map(|(path, value)| {
            let depth = path.matches('/').count();
            let key = path.rsplit('/').next().unwrap_or_default();
            let quote = if value.contains(':') { "'" } else { "" };
            format!("{:indent$}{key}: {quote}{value}{quote}", "", indent = 2 * depth)
        })
    }

    /// The rate (mm/s) and the longest way (mm) of an axis in a phase of homing: each axis has its own.
    pub(super) fn homing_line(&self, axis: usize, phase: HomingPhase) -> (f64, f64) {
        let number = |key: &str| self.axis_number(axis, key);
        let pull_off = number("motor0/pulloff_mm");
        let (rate, longest) = match phase {
            HomingPhase::Seek => ("homing/seek_mm_per_min", number("homing/seek_scaler") * number("max_travel_mm")),
            HomingPhase::Locate => ("homing/feed_mm_per_min", number("homing/feed_scaler") * pull_off),
            HomingPhase::Leave | HomingPhase::PullOff | HomingPhase::Settle => ("homing/feed_mm_per_min", pull_off),
        };
        (number(rate).min(number("max_rate_mm_per_min")) / 60.0, longest)
    }

    /// The soft limits of an axis, machine mm.
    pub(super) fn limits(&self, axis: usize) -> (f64, f64) {
        let (home, travel) = (self.axis_number(axis, "homing/mpos_mm"), self.axis_number(axis, "max_travel_mm"));
        if self.axis_flag(axis, "homing/positive_direction") { (home - travel, home) } else { (home, home + travel) }
    }
}
