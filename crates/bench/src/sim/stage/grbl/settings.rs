//! The twin's settings: what a firmware built and configured for the bench's axes would hold.

use std::collections::BTreeMap;

use crate::config::AxisConfig;
use crate::sim::stage::PULL_OFF_MM;

/// Which firmware it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heir {
    /// Grbl 1.1 itself.
    Grbl,
    /// grblHAL: other alarms, and reports in all of them.
    GrblHal,
    /// FluidNC: a configuration file, and much of its own.
    FluidNc,
}

/// One axis of the machine that the firmware is configured for.
#[derive(Debug, Clone, PartialEq)]
pub struct FirmwareAxis {
    /// Motor steps a millimetre.
    pub steps_per_mm: f64,
    /// Greatest rate, mm/min.
    pub max_rate_mm_per_min: f64,
    /// Acceleration, mm/s².
    pub acceleration_mm_per_s2: f64,
    /// Travel from the home switch to the other end, mm.
    pub travel_mm: f64,
    /// Whether the home switch is at the firmware's negative end.
    pub homes_negative: bool,
    /// Whether its motor is wired the other way round, which the firmware makes good.
    pub motor_inverted: bool,
    /// Machine position after homing, mm (FluidNC; Grbl's follows from its travel).
    pub home_mm: f64,
}

/// What the firmware was built with and configured for.
#[derive(Debug, Clone, PartialEq)]
pub struct FirmwareConfig {
    /// Which firmware it is.
    pub heir: Heir,
    /// Axes X, Y, Z; absent ones have no motor, no switch, and are not homed.
    pub axes: [Option<FirmwareAxis>; 3],
    /// Distance from the home switch after homing, mm.
    pub pull_off_mm: f64,
    /// Rate of the search for the switch, mm/min (and never faster than the axis goes).
    pub seek_rate_mm_per_min: f64,
    /// Rate of the slow approach to the switch, mm/min.
    pub locate_rate_mm_per_min: f64,
    /// Whether the firmware was built with single-axis homing, `$HX` (stock builds are not).
    pub single_axis_homing: bool,
    /// Whether the hard limit switches are wired and on.
    pub hard_limits: bool,
    /// Whether its settings memory was blank when it was powered up: it says so, with every setting.
    pub blank_settings: bool,
    /// Whether each end's switch has an input of its own, as FluidNC can have it.
    pub separate_pins: bool,
    /// Keys of FluidNC's configuration with other values than it would have, e.g. `axes/x/homing/cycle`.
    pub keys: Vec<(String, String)>,
    /// Whether it is locked at its start until every axis has been homed (FluidNC; Grbl is while homing is on).
    pub must_home: bool,
    /// What the firmware calls itself, e.g. `Grbl 1.1h`.
    pub version: String,
}

impl FirmwareConfig {
    /// A firmware that suits the bench's axes, each at the letter it is configured for.
    #[must_use]
    pub fn for_axes(axes: &[&AxisConfig]) -> Self {
        let fitted = |letter: &str| axes.iter().copied().find(|axis| axis.axis.eq_ignore_ascii_case(letter));
        // Quick axes are homed quickly: 600 and 60 mm/min where the slowest goes at 2 mm/s.
        let slowest_mm_per_min = 60.0 * axes.iter().map(|axis| axis.speed_mm_per_s).fold(f64::INFINITY, f64::min);
        Self {
            heir: Heir::Grbl,
            axes: ["X", "Y", "Z"].map(|letter| fitted(letter).map(FirmwareAxis::of)),
            pull_off_mm: PULL_OFF_MM,
            seek_rate_mm_per_min: 5.0 * slowest_mm_per_min,
            locate_rate_mm_per_min: 0.5 * slowest_mm_per_min,
            single_axis_homing: true,
            hard_limits: true,
            blank_settings: false,
            separate_pins: false,
            keys: Vec::new(),
            must_home: true,
            version: "Grbl 1.1h".to_owned(),
        }
    }

    /// The same with grblHAL, whose soft limits end a pull-off before its travel.
    #[must_use]
    pub fn grblhal(axes: &[&AxisConfig]) -> Self {
        let mut config = Self::for_axes(axes);
        for axis in config.axes.iter_mut().flatten() {
            axis.travel_mm += PULL_OFF_MM;
        }
        Self { heir: Heir::GrblHal, version: "GrblHAL 1.1f".to_owned(), ..config }
    }

    /// The same with FluidNC, whose travel begins where homing ends.
    #[must_use]
    pub fn fluidnc(axes: &[&AxisConfig]) -> Self {
        let mut config = Self::for_axes(axes);
        for axis in config.axes.iter_mut().flatten() {
            axis.travel_mm -= PULL_OFF_MM;
        }
        Self { heir: Heir::FluidNc, separate_pins: true, version: "FluidNC v3.9.1".to_owned(), ..config }
    }
}

impl FirmwareAxis {
    fn of(axis: &AxisConfig) -> Self {
        let direction = if axis.reversed { -1.0 } else { 1.0 };
        let far = match axis.home_side.sign() > 0.0 {
            true => axis.home_position_mm - axis.low_limit_mm,
            false => axis.high_limit_mm - axis.home_position_mm,
        };
        Self {
            steps_per_mm: axis.steps_per_mm,
            max_rate_mm_per_min: axis.speed_mm_per_s * 60.0,
            acceleration_mm_per_s2: axis.acceleration_mm_per_s2,
            // What lies beyond the switch is none of it.
            travel_mm: far.max(0.0) + PULL_OFF_MM,
            homes_negative: axis.home_side.sign() * direction < 0.0,
            motor_inverted: axis.motor_inverted,
            home_mm: direction * axis.home_position_mm,
        }
    }
}

/// The settings by number, as `$$` lists them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Settings(BTreeMap<u16, f64>);

impl Settings {
    pub(super) fn new(config: &FirmwareConfig) -> Self {
        let mask = |is: fn(&FirmwareAxis) -> bool| -> f64 {
            (0..3).filter(|&i| config.axes[i].as_ref().is_some_and(is)).map(|i| f64::from(1u8 << i)).sum()
        };
        let mut values = BTreeMap::from([
            (0, 10.0),
            (1, 255.0),
            (2, 0.0),
            (3, mask(|axis| axis.motor_inverted)),
            (4, 0.0),
            (5, 0.0),
            (6, 0.0),
            (10, if config.heir == Heir::GrblHal { 511.0 } else { 1.0 }),
            (11, 0.010),
            (12, 0.002),
            (13, 0.0),
            (20, 1.0),
            (21, if config.hard_limits { 1.0 } else { 0.0 }),
            (22, if config.heir == Heir::GrblHal && config.single_axis_homing { 3.0 } else { 1.0 }),
            (23, mask(|axis| axis.homes_negative)),
            (24, config.locate_rate_mm_per_min),
            (25, config.seek_rate_mm_per_min),
            (26, 250.0),
            (27, config.pull_off_mm),
            (30, 1000.0),
            (31, 0.0),
            (32, 0.0),
        ]);
        if config.heir == Heir::GrblHal {
            // Jogs are refused; Z is homed first, then X and Y together.
            values.extend([(40, 0.0), (44, 4.0), (45, 3.0), (46, 0.0), (47, 0.0), (48, 0.0), (49, 0.0)]);
        }
        for (number, axis) in (0u16..).zip(&config.axes) {
            // Grbl's own defaults stand where no axis is fitted.
            values.insert(100 + number, axis.as_ref().map_or(250.0, |axis| axis.steps_per_mm));
            values.insert(110 + number, axis.as_ref().map_or(500.0, |axis| axis.max_rate_mm_per_min));
            values.insert(120 + number, axis.as_ref().map_or(10.0, |axis| axis.acceleration_mm_per_s2));
            values.insert(130 + number, axis.as_ref().map_or(200.0, |axis| axis.travel_mm));
        }
        Self(values)
    }

    pub(super) fn get(&self, number: u16) -> f64 {
        self.0.get(&number).copied().unwrap_or(0.0)
    }

    pub(super) fn is_on(&self, number: u16) -> bool {
        self.get(number) != 0.0
    }

    /// Whether a bit of a setting is set.
    pub(super) fn has_bit(&self, number: u16, bit: usize) -> bool {
        (self.get(number) as u32) & (1 << bit) != 0
    }

    pub(super) fn of_axis(&self, group: u16, axis: usize) -> f64 {
        self.get(group + axis as u16)
    }

    /// Sets a value that another form of configuration has.
    pub(super) fn follow(&mut self, number: u16, value: f64) {
        self.0.insert(number, value);
    }

    /// Writes a setting, or says which of Grbl's errors it is.
    pub(super) fn set(&mut self, number: u16, value: f64) -> Result<(), u8> {
        if value < 0.0 {
            return Err(4);
        }
        if matches!(number, 20 | 40) && value != 0.0 && !self.is_on(22) {
            return Err(10);
        }
        // A divisor of zero would stop the firmware's arithmetic.
        if (100..133).contains(&number) && value == 0.0 {
            return Err(4);
        }
        match self.0.get_mut(&number) {
            Some(slot) => {
                *slot = value;
                if number == 22 && value == 0.0 {
                    self.0.insert(20, 0.0);
                }
                Ok(())
            }
            None => Err(3),
        }
    }

    /// The lines of `$$`.
    pub(super) fn lines(&self) -> impl Iterator<Item = String> {
        self.0.iter().map(|(&number, &value)| match number {
            0..=6 | 10 | 13 | 20..=23 | 26 | 30..=32 | 40..=49 => format!("${number}={value:.0}"),
            _ => format!("${number}={value:.3}"),
        })
    }
}
