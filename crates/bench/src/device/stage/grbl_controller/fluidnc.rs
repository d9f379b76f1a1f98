//! FluidNC's configuration against this program's. Nothing in it is assumed: what decides where an axis goes and cannot be
//! read is a contradiction.

use std::time::Duration;

use super::super::axis::AxisSetup;
use super::super::grbl::{Letter, Tree};
use super::super::session::AxisFacts;

/// FluidNC keeps a number in 32 bits and tells six decimals: it may be this much off, relative and absolute.
const KEPT: f64 = 1.2e-7;
const PRINTED: f64 = 1e-6;
/// What it names a pin that is not there.
const NO_PIN: &str = "NO_PIN";
/// The motors are never switched off by themselves.
const NEVER_MS: f64 = 255.0;
/// G-code that it runs without being asked to.
const BY_ITSELF: [&str; 5] = ["after_homing", "after_reset", "after_unlock", "startup_line0", "startup_line1"];

/// The key of an axis, e.g. `axes/x/homing/cycle`.
fn path(letter: Letter, key: &str) -> String {
    format!("axes/{}/{key}", letter.name().to_ascii_lowercase())
}

/// Whether an axis may be homed by itself.
pub(super) fn homes_alone(tree: &Tree, letter: Letter) -> bool {
    tree.flag(&path(letter, "homing/allow_single_axis")) == Some(true)
}

/// Where homing ends, machine mm: the pull-off is behind it then.
pub(super) fn home_mm(tree: &Tree, letter: Letter) -> Option<f64> {
    tree.number(&path(letter, "homing/mpos_mm"))
}

/// The soft limits, machine mm, whether or not they are on: from home as far as the axis travels, away from its switch.
fn range_mm(tree: &Tree, letter: Letter) -> Option<(f64, f64)> {
    let (home, travel) = (home_mm(tree, letter)?, tree.number(&path(letter, "max_travel_mm"))?);
    Some(match tree.flag(&path(letter, "homing/positive_direction"))? {
        true => (home - travel, home),
        false => (home, home + travel),
    })
}

/// The soft limits, machine mm, where they are on. A jog beyond them is not refused but shortened, or drawn into them from
/// outside, which may be any distance: nothing beyond them is asked for.
pub(super) fn bounds_mm(tree: &Tree, letter: Letter) -> Option<(f64, f64)> {
    match tree.flag(&path(letter, "soft_limits")) {
        Some(false) => None,
        // Not readable: no place is within them.
        _ => Some(range_mm(tree, letter).filter(|_| on(tree, letter)).unwrap_or((f64::INFINITY, f64::NEG_INFINITY))),
    }
}

fn on(tree: &Tree, letter: Letter) -> bool {
    tree.flag(&path(letter, "soft_limits")) == Some(true)
}

/// Whether a change of a key makes the same count of steps another place.
pub(super) fn displaces(path: &str) -> bool {
    ["steps_per_mm", "direction_pin", "mpos_mm", "report_inches"].iter().any(|key| path.ends_with(key))
        || path.starts_with("kinematics")
}

/// Seconds that homing an axis, or all of them, can take.
pub(super) fn homing_time(tree: &Tree, letter: Option<Letter>) -> f64 {
    let of = |letter: Letter| {
        let number = |key: &str, otherwise: f64| {
            tree.number(&path(letter, key)).filter(|value| *value > 0.0).unwrap_or(otherwise)
        };
        let most = number("max_rate_mm_per_min", 1000.0);
        let rate = |key: &str, otherwise: f64| (number(key, otherwise).min(most) / 60.0).max(1e-3);
        let (seek, feed) = (rate("homing/seek_mm_per_min", 200.0), rate("homing/feed_mm_per_min", 50.0));
        let pull_off = number("motor0/pulloff_mm", 1.0);
        let search = number("homing/seek_scaler", 1.1) * number("max_travel_mm", 1000.0) / seek;
        let runs = tree.number("axes/homing_runs").unwrap_or(5.0);
        // Off a switch first, then to it and off it, once fast and then as often as it is set to.
        let off = pull_off / feed;
        let settle = number("homing/settle_ms", 1000.0) / 1000.0;
        search + 2.0 * off + (runs + 1.0) * (1.0 + number("homing/feed_scaler", 1.1)) * (off + settle) + 4.0 * settle
    };
    match letter {
        Some(letter) => of(letter),
        // Axes of one cycle end together, and their motion is planned anew where the first has ended: the sum is enough.
        None => 2.0 * Letter::ALL.into_iter().filter(|&l| tree.has(&path(l, "homing"))).map(of).sum::<f64>(),
    }
}

/// The time of the way off the switch that ends homing.
pub(super) fn least_homing_time(tree: &Tree, letter: Letter) -> Duration {
    let number = |key: &str| tree.number(&path(letter, key)).filter(|value| *value > 0.0);
    let (Some(pull_off), Some(feed)) = (number("motor0/pulloff_mm"), number("homing/feed_mm_per_min")) else {
        return Duration::ZERO;
    };
    // Half of it: its clock is another.
    Duration::from_secs_f64((0.5 * pull_off / feed * 60.0).clamp(0.0, 60.0))
}

/// What a configuration says of an axis.
pub(super) fn facts(setup: &AxisSetup, letter: Letter, tree: &Tree, letters: &[Letter]) -> AxisFacts {
    let number = |key: &str| tree.number(&path(letter, key));
    let rate = number("max_rate_mm_per_min").map_or(f64::INFINITY, |rate| rate / 60.0);
    let acceleration = number("acceleration_mm_per_sec2").unwrap_or(f64::INFINITY);
    let together = !letters.iter().all(|&letter| homes_alone(tree, letter));
    let mut checked = Checked { setup, letter, tree, contradictions: Vec::new(), disagreements: Vec::new() };
    checked.machine();
    checked.motor();
    checked.homing(together);
    checked.harmless();
    let Checked { contradictions, disagreements, .. } = checked;
    let limits_mm = match (on(tree, letter), home_mm(tree, letter), range_mm(tree, letter)) {
        (true, Some(home), Some(range)) => Some(setup.range(range, home)),
        _ => None,
    };
    let mut facts = AxisFacts {
        disagreements,
        contradictions,
        speed_mm_per_s: setup.config.speed_mm_per_s.min(rate).max(1e-6),
        acceleration_mm_per_s2: setup.config.acceleration_mm_per_s2.min(acceleration).max(1e-6),
        limits_mm,
        ..AxisFacts::default()
    };
    if let Some((low, high)) = limits_mm {
        facts.note(setup.compare_limits(low, high));
    }
    facts
}

/// An axis that is being compared.
struct Checked<'a> {
    setup: &'a AxisSetup,
    letter: Letter,
    tree: &'a Tree,
    contradictions: Vec<String>,
    disagreements: Vec<String>,
}

impl Checked<'_> {
    fn contradicts(&mut self, sentence: String) {
        self.contradictions.push(sentence);
    }

    /// Says that a key is not told, or not as what it ought to be.
    fn unread(&mut self, key: &str) {
        let (path, axis) = (path(self.letter, key), self.setup.axis);
        let told = match self.tree.get(&path) {
            Some(value) => format!("tells `{value}` as {path}, which this program cannot read"),
            None => format!("does not tell {path}"),
        };
        self.contradicts(format!("FluidNC {told}: where it would take the {axis} axis is not known."));
    }

    fn number(&mut self, key: &str) -> Option<f64> {
        let value = self.tree.number(&path(self.letter, key));
        if value.is_none() {
            self.unread(key);
        }
        value
    }

    fn flag(&mut self, key: &str) -> Option<bool> {
        let value = self.tree.flag(&path(self.letter, key));
        if value.is_none() {
            self.unread(key);
        }
        value
    }

    /// What is the whole machine's.
    fn machine(&mut self) {
        let axis = self.setup.axis;
        match self.tree.flag("report_inches") {
            Some(false) => {}
            Some(true) => self.contradicts("FluidNC reports inches; set report_inches: false.".to_owned()),
            None => self.contradicts("FluidNC does not tell whether it reports inches (report_inches).".to_owned()),
        }
        let systems: Vec<&str> =
            self.tree.below("kinematics").map(|(key, _)| key).filter(|key| !key.contains('/')).collect();
        if !matches!(systems[..], [system] if system == "cartesian") {
            let told = if systems.is_empty() { "none".to_owned() } else { systems.join(", ") };
            self.contradicts(format!(
                "FluidNC's kinematics are not known to be Cartesian (it tells {told}): what a motor of the {axis} axis does \
                 would not be what the axis does."
            ));
        }
        for name in BY_ITSELF {
            let macros = self.tree.get(&format!("macros/{name}")).unwrap_or_default().trim().to_owned();
            if !macros.is_empty() {
                self.contradicts(format!(
                    "FluidNC runs `{macros}` by itself (macros/{name}), which may move the {axis} axis: leave it empty."
                ));
            }
        }
    }

    /// Scale and direction.
    fn motor(&mut self) {
        let AxisSetup { axis, config } = self.setup;
        if let Some(steps) = self.number("steps_per_mm")
            && (steps - config.steps_per_mm).abs() > PRINTED + KEPT * config.steps_per_mm
        {
            self.contradicts(format!(
                "FluidNC makes {steps} steps/mm on {} ({}), the configuration of the {axis} axis says {} \
                 (bench.{axis}.steps_per_mm).",
                self.letter.name(),
                path(self.letter, "steps_per_mm"),
                config.steps_per_mm
            ));
        }
        if self.tree.has(&path(self.letter, "motor1")) {
            self.contradicts(format!(
                "FluidNC has two motors on {} (motor1): this program knows axes with one.",
                self.letter.name()
            ));
        }
        let pins: Vec<&str> = self
            .tree
            .below(&path(self.letter, "motor0"))
            .filter(|(key, _)| key.ends_with("/direction_pin"))
            .map(|(_, pin)| pin)
            .collect();
        let [pin] = pins[..] else {
            return self.contradicts(format!(
                "FluidNC tells no direction_pin of {}, by which the direction of the {axis} axis is known.",
                self.letter.name()
            ));
        };
        let Some(inverted) = inverted(pin) else {
            return self.contradicts(format!(
                "FluidNC tells `{pin}` as the direction_pin of {}, by which the direction of the {axis} axis is not known.",
                self.letter.name()
            ));
        };
        if inverted != config.motor_inverted {
            self.contradicts(format!(
                "FluidNC {} the direction of {} (direction_pin: {pin}), the configuration of the {axis} axis says that it \
                 {} (bench.{axis}.motor_inverted).",
                if inverted { "inverts" } else { "does not invert" },
                self.letter.name(),
                if inverted { "does not" } else { "does" },
            ));
        }
    }

    /// The end that the axis homes to, and that it finds a switch there.
    fn homing(&mut self, together: bool) {
        let axis = self.setup.axis;
        for key in
            ["homing/mpos_mm", "max_travel_mm", "motor0/pulloff_mm", "homing/feed_mm_per_min", "homing/seek_mm_per_min"]
        {
            let _ = self.number(key);
        }
        let alone = self.flag("homing/allow_single_axis");
        match self.number("homing/cycle") {
            Some(cycle) if cycle < 0.0 => self.contradicts(format!(
                "FluidNC does not move {} to home it, but takes it for homed where it stands (cycle: {cycle}): set a cycle of \
                 1 or more.",
                self.letter.name()
            )),
            Some(cycle) if cycle == 0.0 && (together || alone == Some(false)) => self.contradicts(format!(
                "FluidNC does not home {} with the other axes (cycle: 0), and does not let each axis be homed by itself \
                 (allow_single_axis): the {axis} axis cannot be homed.",
                self.letter.name()
            )),
            _ => {}
        }
        let Some(positive) = self.flag("homing/positive_direction") else { return };
        if positive == self.setup.homes_negative() {
            self.contradicts(format!(
                "FluidNC homes the {axis} axis towards its {} end ({}: {positive}), the configuration says the other \
                 (bench.{axis}.home_side and reversed).",
                if positive { "positive" } else { "negative" },
                path(self.letter, "homing/positive_direction")
            ));
        }
        let pin = |key: &str| self.tree.get(&path(self.letter, key)).map(|pin| pin != NO_PIN && !pin.is_empty());
        let end = if positive { "motor0/limit_pos_pin" } else { "motor0/limit_neg_pin" };
        match (pin(end), pin("motor0/limit_all_pin")) {
            (Some(true), _) | (_, Some(true)) => {}
            _ => self.contradicts(format!(
                "FluidNC tells no limit switch at the end that the {axis} axis homes to ({} or limit_all_pin): its search \
                 would find none.",
                path(self.letter, end)
            )),
        }
    }

    /// What differs and does no harm.
    fn harmless(&mut self) {
        let AxisSetup { axis, config } = self.setup;
        let (tree, letter) = (self.tree, self.letter);
        let number = |key: &str| tree.number(&path(letter, key));
        let mut sentences = Vec::new();
        match number("max_rate_mm_per_min").map(|rate| rate / 60.0) {
            Some(rate) if rate < config.speed_mm_per_s * (1.0 - KEPT) => sentences.push(format!(
                "FluidNC moves the {axis} axis at {rate:.3} mm/s at most (max_rate_mm_per_min), the configuration says {} \
                 mm/s.",
                config.speed_mm_per_s
            )),
            _ => {}
        }
        match number("acceleration_mm_per_sec2") {
            Some(acceleration) if (acceleration / config.acceleration_mm_per_s2 - 1.0).abs() > 1e-6 => {
                sentences.push(format!(
                    "FluidNC accelerates the {axis} axis at {acceleration} mm/s² (acceleration_mm_per_sec2), the \
                     configuration says {} mm/s².",
                    config.acceleration_mm_per_s2
                ));
            }
            _ => {}
        }
        if tree.flag(&path(letter, "motor0/hard_limits")) != Some(true) {
            sentences.push(format!(
                "Hard limits are off in FluidNC: a switch of the {axis} axis does not stop it. Set {}: true.",
                path(letter, "motor0/hard_limits")
            ));
        }
        if tree.number("stepping/idle_ms") != Some(NEVER_MS) && tree.flag(&path(letter, "idle_disable")) != Some(false)
        {
            sentences.push(format!(
                "FluidNC switches its motors off some time after each motion: the {axis} axis may creep. Set stepping/idle_ms: \
                 255."
            ));
        }
        if !on(tree, letter) {
            sentences.push(format!(
                "Soft limits are off in FluidNC: it does not bound the {axis} axis. Set {}: true.",
                path(letter, "soft_limits")
            ));
        }
        if let (Some(scaler), Some(travel), Some(pull_off)) =
            (number("homing/seek_scaler"), number("max_travel_mm"), number("motor0/pulloff_mm"))
            && scaler * travel < travel + pull_off
        {
            sentences.push(format!(
                "FluidNC searches the home switch of the {axis} axis over {:.3} mm, which does not reach it from the other \
                 end: make {} greater.",
                scaler * travel,
                path(letter, "homing/seek_scaler")
            ));
        }
        self.disagreements = sentences;
    }
}

/// Whether a direction pin turns the motor the other way round; `None` where that cannot be said.
fn inverted(pin: &str) -> Option<bool> {
    let mut parts = pin.split(':');
    let name = parts.next().filter(|name| !name.is_empty() && *name != NO_PIN)?;
    if name.contains(char::is_whitespace) {
        return None;
    }
    let mut inverted = false;
    for attribute in parts {
        match attribute {
            "low" => inverted = true,
            // Pull-up and drive strength do not turn it.
            "high" | "pu" | "pd" => {}
            other if other.len() == 3 && other.starts_with("ds") => {}
            _ => return None,
        }
    }
    Some(inverted)
}
