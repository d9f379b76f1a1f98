//! A controller's settings against the configuration.

use super::super::axis::AxisSetup;
use super::super::grbl::{Dialect, Letter, Settings};
use super::super::session::AxisFacts;
use crate::config::Side;

/// What the configured limit should keep from the home switch, mm: switches do not trip at the same place for ever.
const CLEARANCE_MM: f64 = 1.0;
/// The bit of grblHAL's $10 that has its reports tell the pins; Grbl's always do.
const PINS_REPORTED: u32 = 16;
/// Which axes grblHAL homes in each of its cycles.
const HOMING_CYCLES: std::ops::RangeInclusive<u16> = 44..=49;
/// Grbl prints a setting rounded to three decimals: it may differ by half of the last one.
const PRINTED: f64 = 0.5e-3;
/// Grbl keeps a setting in 32 bits: a number of any size may be this much off, relative.
const KEPT: f64 = 1.2e-7;

/// What the settings say of an axis. `zero` says that the firmware was built to make home the machine's zero.
pub(super) fn facts(setup: &AxisSetup, letter: Letter, settings: &Settings, dialect: Dialect, zero: bool) -> AxisFacts {
    let limits_mm = soft_limits(setup, letter, settings, dialect, zero);
    let rate = settings.of_axis(110, letter).map_or(f64::INFINITY, |rate| rate / 60.0);
    let acceleration = settings.of_axis(120, letter).unwrap_or(f64::INFINITY);
    let mut facts = AxisFacts {
        disagreements: disagreements(setup, letter, settings),
        contradictions: contradictions(setup, letter, settings, dialect),
        speed_mm_per_s: setup.config.speed_mm_per_s.min(rate).max(1e-6),
        acceleration_mm_per_s2: setup.config.acceleration_mm_per_s2.min(acceleration).max(1e-6),
        limits_mm,
        ..AxisFacts::default()
    };
    facts.disagreements.extend(near_switch(setup, settings));
    if let Some((low, high)) = limits_mm {
        // On the home side stock Grbl's limit is where the switch trips: the configured one keeps a distance from it, and
        // the switch is what bounds the axis there.
        let config = &setup.config;
        let (low, high) = match config.home_side {
            Side::Low => (low.max(config.low_limit_mm), high),
            Side::High => (low, high.min(config.high_limit_mm)),
        };
        facts.note(setup.compare_limits(low, high));
    }
    facts
}

/// The soft limits in the axis's coordinate, where they are on. grblHAL keeps a pull-off from the switches of both ends
/// where those are on.
fn soft_limits(
    setup: &AxisSetup,
    letter: Letter,
    settings: &Settings,
    dialect: Dialect,
    zero: bool,
) -> Option<(f64, f64)> {
    if !settings.is_on(20) {
        return None;
    }
    let kept = if dialect == Dialect::GrblHal && settings.is_on(21) { settings.get(27)? } else { 0.0 };
    let reach = settings.of_axis(130, letter)? - kept;
    let ends = match (zero, homes_negative(letter, settings)) {
        (true, true) => (0.0, reach),
        (true, false) => (-reach, 0.0),
        (false, _) => (-reach, -kept),
    };
    Some(setup.range(ends, home_mm(letter, settings, zero)?))
}

/// Where homing ends, machine mm: a pull-off from the switch. Machine space runs from minus the travel to 0, unless home was
/// made its zero.
pub(super) fn home_mm(letter: Letter, settings: &Settings, zero: bool) -> Option<f64> {
    let (travel, pull_off) = (settings.of_axis(130, letter)?, settings.get(27)?);
    Some(match (zero, homes_negative(letter, settings)) {
        (true, _) => 0.0,
        (false, true) => -travel + pull_off,
        (false, false) => -pull_off,
    })
}

/// A sentence where the configured limit is on the home switch, or nearer to it than a switch is exact.
fn near_switch(setup: &AxisSetup, settings: &Settings) -> Option<String> {
    let AxisSetup { axis, config } = setup;
    let side = config.home_side;
    let switch = config.home_position_mm + side.sign() * settings.get(27)?;
    let limit = match side {
        Side::Low => config.low_limit_mm,
        Side::High => config.high_limit_mm,
    };
    let clear_mm = side.sign() * (switch - limit);
    // A limit well beyond the switch is told as travel that the controller does not have.
    let near = (-PRINTED..CLEARANCE_MM - PRINTED).contains(&clear_mm);
    near.then(|| {
        let keep = switch - side.sign() * CLEARANCE_MM;
        format!(
            "The configured {side} limit of the {axis} axis, {limit} mm, is {:.3} mm from its home switch at {switch:.3} mm, \
             where a move ends in an alarm and both references are lost: keep it a millimetre off \
             (bench.{axis}.{side}_limit_mm = {keep:.3}), or have homing pull off farther ($27).",
            clear_mm.abs()
        )
    })
}

/// An axis's bit in a setting that is a mask.
fn bit(letter: Letter, settings: &Settings, number: u16) -> Option<bool> {
    settings.get(number).map(|mask| (mask as u32) & (1 << letter.index()) != 0)
}

fn homes_negative(letter: Letter, settings: &Settings) -> bool {
    bit(letter, settings, 23).unwrap_or(false)
}

/// Where the settings would take an axis elsewhere than its configuration says, one sentence each.
fn contradictions(setup: &AxisSetup, letter: Letter, settings: &Settings, dialect: Dialect) -> Vec<String> {
    let AxisSetup { axis, config } = setup;
    let mut sentences = Vec::new();
    if let (Dialect::GrblHal, Some(reported)) = (dialect, settings.get(10))
        && (reported as u32) & PINS_REPORTED == 0
    {
        sentences.push(format!(
            "The controller's reports do not tell which limit switch is pressed ($10={reported}), from which the {axis} axis \
             must not be homed; set $10={}.",
            (reported as u32) | PINS_REPORTED
        ));
    }
    if dialect == Dialect::GrblHal && settings.is_on(40) {
        sentences.push(format!(
            "The controller takes a motion beyond its soft limits for another one, of the {axis} axis and of whichever stands \
             outside them ($40); set $40=0."
        ));
    }
    let mut cycles = HOMING_CYCLES.filter(|&cycle| settings.get(cycle).is_some()).peekable();
    if cycles.peek().is_some() && !cycles.any(|cycle| bit(letter, settings, cycle) == Some(true)) {
        sentences.push(format!(
            "The controller homes {} in none of its cycles ($44 to $49), by which the {axis} axis may count as homed where it \
             stands.",
            letter.name()
        ));
    }
    let number = 100 + letter.index() as u16;
    match settings.of_axis(100, letter) {
        Some(steps) if (steps - config.steps_per_mm).abs() > PRINTED + KEPT * config.steps_per_mm => {
            sentences.push(format!(
                "The controller makes {steps} steps/mm on {} (${number}), the configuration of the {axis} axis says {} \
                 (bench.{axis}.steps_per_mm).",
                letter.name(),
                config.steps_per_mm
            ));
        }
        Some(_) => {}
        None => sentences.push(format!("The controller tells no setting ${number}, the scale of the {axis} axis.")),
    }
    if settings.is_on(13) {
        sentences.push("The controller reports inches ($13); set $13=0.".to_owned());
    }
    match bit(letter, settings, 3) {
        Some(inverted) if inverted != config.motor_inverted => sentences.push(format!(
            "The controller {} the direction of {} ($3), the configuration of the {axis} axis says that it {} \
             (bench.{axis}.motor_inverted).",
            if inverted { "inverts" } else { "does not invert" },
            letter.name(),
            if inverted { "does not" } else { "does" },
        )),
        Some(_) => {}
        None => sentences.push(format!("The controller tells no setting $3, the direction of the {axis} axis.")),
    }
    match bit(letter, settings, 23) {
        Some(negative) if negative != setup.homes_negative() => sentences.push(format!(
            "The controller homes the {axis} axis towards its {} end ($23), the configuration says the other \
             (bench.{axis}.home_side and reversed).",
            if negative { "negative" } else { "positive" }
        )),
        None if settings.is_on(22) => {
            sentences.push(format!("The controller tells no setting $23, the end that the {axis} axis homes to."));
        }
        _ => {}
    }
    sentences
}

/// What else differs between a controller's settings and an axis's configuration, one sentence each.
fn disagreements(setup: &AxisSetup, letter: Letter, settings: &Settings) -> Vec<String> {
    let AxisSetup { axis, config } = setup;
    let number = |group: u16| group + letter.index() as u16;
    let mut sentences = Vec::new();
    if let Some(rate) = settings.of_axis(110, letter).map(|rate| rate / 60.0).filter(|r| *r < config.speed_mm_per_s) {
        sentences.push(format!(
            "The controller moves the {axis} axis at {rate:.3} mm/s at most (${}), the configuration says {} mm/s.",
            number(110),
            config.speed_mm_per_s
        ));
    }
    match settings.of_axis(120, letter) {
        Some(acceleration) if (acceleration / config.acceleration_mm_per_s2 - 1.0).abs() > 1e-6 => {
            sentences.push(format!(
                "The controller accelerates the {axis} axis at {acceleration} mm/s² (${}), the configuration says {} \
                 mm/s².",
                number(120),
                config.acceleration_mm_per_s2
            ));
        }
        _ => {}
    }
    if !settings.is_on(22) {
        sentences.push(format!("Homing is off in the controller ($22): the {axis} axis cannot be homed."));
    }
    if !settings.is_on(21) {
        sentences.push(format!(
            "Hard limits are off in the controller ($21): a switch of the {axis} axis does not stop it. Set $21=1."
        ));
    }
    match settings.get(1) {
        Some(ms) if ms < 255.0 => sentences.push(format!(
            "The controller switches its motors off {ms} ms after each motion ($1): the {axis} axis may creep. Set $1=255."
        )),
        _ => {}
    }
    if !settings.is_on(20) {
        sentences.push(format!("Soft limits are off in the controller ($20): it does not bound the {axis} axis."));
    }
    sentences
}
