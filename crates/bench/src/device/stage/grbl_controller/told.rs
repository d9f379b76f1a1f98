//! What a controller is set to: numbered settings, or FluidNC's configuration.

use std::time::Duration;

use super::super::axis::AxisSetup;
use super::super::grbl::{self, Dialect, Letter, Settings, Tree};
use super::super::session::AxisFacts;
use super::switches::blocks_time;
use super::{checks, fluidnc};
use crate::device::AxisName;

/// Longest time that homing is given.
const LONGEST_HOMING_S: f64 = 1800.0;

/// What a controller has told of what it is set to.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Told {
    /// Settings by number, of a firmware that was built (grblHAL: is set) as these say.
    Settings {
        /// The answer to `$$`.
        settings: Settings,
        /// Grbl or grblHAL.
        dialect: Dialect,
        /// Whether homing makes home the machine's zero.
        zero: bool,
        /// Whether it homes single axes.
        single: bool,
    },
    /// FluidNC's configuration, and which of its axes are this bench's.
    Tree(Tree, Vec<Letter>),
}

impl Told {
    /// Settings, with what the answer to `$I` says of the firmware.
    pub(super) fn built(settings: Settings, dialect: Dialect, options: &[String]) -> Self {
        let (zero, single) = (grbl::homes_to_zero(options), grbl::homes_single_axes(options));
        Self::Settings { settings, dialect, zero, single }
    }

    /// Whether it reports inches.
    pub(super) fn reports_inches(&self) -> bool {
        match self {
            Self::Settings { settings, .. } => settings.is_on(13),
            Self::Tree(tree, _) => tree.flag("report_inches") == Some(true),
        }
    }

    /// What is known of an axis by it, but for what it has to share with the other one.
    pub(super) fn facts(&self, setup: &AxisSetup, letter: Letter, others: &[AxisName]) -> AxisFacts {
        let facts = match self {
            Self::Settings { settings, dialect, zero, .. } => checks::facts(setup, letter, settings, *dialect, *zero),
            Self::Tree(tree, letters) => fluidnc::facts(setup, letter, tree, letters),
        };
        let takes_turns_with = others.iter().copied().find(|other| *other != setup.axis);
        let homes_also = takes_turns_with.filter(|_| !self.homes_single_axes());
        AxisFacts { homes_also, takes_turns_with, ..facts }
    }

    /// Whether the bench's axes are homed one by one.
    pub(super) fn homes_single_axes(&self) -> bool {
        match self {
            Self::Settings { single, .. } => *single,
            Self::Tree(tree, letters) => letters.iter().all(|&letter| fluidnc::homes_alone(tree, letter)),
        }
    }

    /// How long the controller says nothing after each motion: it waits to switch its motors off ($1, ms; 255 for never).
    pub(super) fn silence(&self) -> Duration {
        let ms = match self {
            Self::Settings { settings, .. } => settings.get(1).filter(|ms| (0.0..255.0).contains(ms)),
            Self::Tree(..) => None,
        };
        Duration::from_secs_f64(ms.unwrap_or(0.0) / 1000.0)
    }

    /// How long steps that are worked out ahead are carried out before the controller decelerates.
    pub(super) fn buffered(&self) -> Duration {
        let segments = match self {
            Self::Settings { .. } => 5.0,
            // What is told is believed up to the most that it can be set to.
            Self::Tree(tree, _) => tree.number("stepping/segments").unwrap_or(20.0).clamp(5.0, 20.0),
        };
        Duration::from_secs_f64(segments * 0.010)
    }

    /// Longest time that homing one axis, or all, can take by it.
    pub(super) fn homing_time(&self, letter: Option<Letter>) -> Duration {
        let longest = match self {
            Self::Settings { settings, .. } => settings_homing_time(settings, letter),
            Self::Tree(tree, _) => fluidnc::homing_time(tree, letter),
        };
        Duration::from_secs_f64((10.0 + 1.2 * longest).min(LONGEST_HOMING_S))
    }

    /// The way off the switch, with which every homing ends, takes at least this: an answer that comes sooner has homed
    /// nothing.
    pub(super) fn least_homing_time(&self, letter: Letter) -> Duration {
        match self {
            Self::Settings { .. } => Duration::ZERO,
            Self::Tree(tree, _) => fluidnc::least_homing_time(tree, letter),
        }
    }

    /// Where homing ends, machine mm.
    pub(super) fn home_mm(&self, letter: Letter) -> Option<f64> {
        match self {
            Self::Settings { settings, zero, .. } => checks::home_mm(letter, settings, *zero),
            Self::Tree(tree, _) => fluidnc::home_mm(tree, letter),
        }
    }

    /// How far the home switch lies beyond home, mm, where a move can be told to go there.
    pub(super) fn switch_mm(&self) -> Option<f64> {
        match self {
            Self::Settings { settings, .. } => settings.get(27),
            Self::Tree(..) => None,
        }
    }

    /// The least and the greatest machine position that an axis is to be told to go to, where the controller itself would
    /// quietly make another target of one beyond them.
    pub(super) fn bounds_mm(&self, letter: Letter) -> Option<(f64, f64)> {
        match self {
            Self::Settings { .. } => None,
            Self::Tree(tree, _) => fluidnc::bounds_mm(tree, letter),
        }
    }

    /// Whether, against what was told before, the same count of steps is another place now.
    pub(super) fn displaces(&self, before: &Self) -> bool {
        match (self, before) {
            (Self::Settings { settings: now, .. }, Self::Settings { settings: before, .. }) => {
                let moved = |number| now.get(number) != before.get(number);
                moved(3) || moved(13) || Letter::ALL.iter().any(|letter| moved(100 + letter.index() as u16))
            }
            (Self::Tree(now, _), Self::Tree(before, _)) => now.differences(before).any(fluidnc::displaces),
            _ => true,
        }
    }
}

fn settings_homing_time(settings: &Settings, letter: Option<Letter>) -> f64 {
    let setting = |number, otherwise| settings.get(number).filter(|v| *v > 0.0).unwrap_or(otherwise);
    let (locate, seek, pull_off) = (setting(24, 25.0) / 60.0, setting(25, 500.0) / 60.0, setting(27, 1.0));
    let debounce = setting(26, 250.0) / 1000.0;
    // A block of axes is one line to Grbl: the slowest governs its rate, the longest travel its way.
    let block = |letters: &[Letter]| {
        let of = |group: u16| letters.iter().filter_map(|&letter| settings.of_axis(group, letter)).collect::<Vec<_>>();
        let slowest = of(110).into_iter().fold(f64::INFINITY, f64::min) / 60.0;
        let travel = of(130).into_iter().reduce(f64::max).unwrap_or(200.0);
        let rate = seek.min(slowest).max(1e-3);
        // Grbl searches over 1.5 travels and approaches slowly over five pull-offs, at most.
        1.5 * travel / rate + 2.0 * pull_off / rate + 5.0 * pull_off / locate.min(rate) + 4.0 * debounce
    };
    match letter {
        Some(letter) => block(&[letter]),
        None => blocks_time(block),
    }
}
