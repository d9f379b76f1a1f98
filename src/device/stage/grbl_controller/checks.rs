//! A controller's settings against the configuration.

use super::super::axis::AxisSetup;
use super::super::grbl::{Letter, Settings};
use super::super::session::AxisFacts;
use crate::device::DeviceError;

/// What the settings say of an axis. `zero` says that the firmware was built to make home the machine's zero.
///
/// # Errors
/// [`DeviceError::Refused`] when the firmware's soft limits are wider than the configured limits and that is not accepted.
pub(super) fn facts(
    device: &str,
    setup: &AxisSetup,
    letter: Letter,
    settings: &Settings,
    zero: bool,
) -> Result<AxisFacts, DeviceError> {
    let mut disagreements = disagreements(setup, letter, settings);
    let limits_mm = soft_limits(setup, letter, settings, zero);
    if let Some((low, high)) = limits_mm {
        disagreements.extend(setup.compare_limits(device, low, high)?);
    }
    let rate = settings.of_axis(110, letter).map_or(f64::INFINITY, |rate| rate / 60.0);
    let acceleration = settings.of_axis(120, letter).unwrap_or(f64::INFINITY);
    Ok(AxisFacts {
        disagreements,
        homes_also: None,
        speed_mm_per_s: setup.config.speed_mm_per_s.min(rate).max(1e-6),
        acceleration_mm_per_s2: setup.config.acceleration_mm_per_s2.min(acceleration).max(1e-6),
        limits_mm,
    })
}

/// The soft limits in the axis's coordinate, where they are on.
fn soft_limits(setup: &AxisSetup, letter: Letter, settings: &Settings, zero: bool) -> Option<(f64, f64)> {
    if !settings.is_on(20) {
        return None;
    }
    let (travel, pull_off) = (settings.of_axis(130, letter)?, settings.get(27).unwrap_or(0.0));
    // Homing ends a pull-off from the switch. Machine space runs from -travel to 0, unless home was made its zero.
    let (low, high, home) = match (homes_negative(letter, settings), zero) {
        (true, false) => (-travel, 0.0, -travel + pull_off),
        (false, false) => (-travel, 0.0, -pull_off),
        (true, true) => (0.0, travel, 0.0),
        (false, true) => (-travel, 0.0, 0.0),
    };
    Some(setup.range((low, high), home))
}

fn homes_negative(letter: Letter, settings: &Settings) -> bool {
    settings.get(23).is_some_and(|mask| (mask as u32) & (1 << letter.index()) != 0)
}

/// What differs between a controller's settings and an axis's configuration, one sentence each.
fn disagreements(setup: &AxisSetup, letter: Letter, settings: &Settings) -> Vec<String> {
    let AxisSetup { axis, config } = setup;
    let number = |group: u16| group + letter.index() as u16;
    let mut sentences = Vec::new();
    match settings.of_axis(100, letter) {
        Some(steps) if (steps / config.steps_per_mm - 1.0).abs() > 1e-6 => sentences.push(format!(
            "The controller makes {steps} steps/mm on {} (${}), the configuration of the {axis} axis says {}.",
            letter.name(),
            number(100),
            config.steps_per_mm
        )),
        None => sentences.push(format!("The controller has no setting ${} for the {axis} axis.", number(100))),
        Some(_) => {}
    }
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
    if !settings.is_on(20) {
        sentences.push(format!("Soft limits are off in the controller ($20): it does not bound the {axis} axis."));
    }
    let homes_negative = homes_negative(letter, settings);
    if homes_negative != setup.homes_negative() {
        sentences.push(format!(
            "The controller homes the {axis} axis towards its {} end ($23), the configuration says the other.",
            if homes_negative { "negative" } else { "positive" }
        ));
    }
    sentences
}
