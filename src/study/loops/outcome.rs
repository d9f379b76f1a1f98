//! What a bench came to, as plain data.

use serde::{Deserialize, Serialize};

use crate::study::monte_carlo::exact;

/// What both strategies came to on a bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BenchOutcome {
    /// The plain strategy of Section 2.2.
    pub(crate) plain: Ended,
    /// This program's loops.
    pub(crate) ours: Ended,
}

/// How a strategy ended on a bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Ended {
    /// Both loops ran to their end, converged or not.
    Aligned(Aligned),
    /// A frame was refused, which ends the loops as it ends a job, and why.
    Refused(String),
}

/// What both loops took, and what they left.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Aligned {
    /// Δv in air.
    pub(crate) air: Taken,
    /// e with the shell.
    pub(crate) shell: Taken,
    /// True Δv at the end of the air loop, less its target, mm.
    #[serde(with = "exact")]
    pub(crate) delta_v_error_mm: f64,
    /// True paraxial spacing at the end of the shell loop, less its target, px.
    #[serde(with = "exact")]
    pub(crate) spacing_error_px: f64,
}

/// What a loop took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Taken {
    /// Moves of an axis.
    pub(crate) moves: u32,
    /// Their lengths together, mm.
    #[serde(with = "exact")]
    pub(crate) travel_mm: f64,
    /// Simulated time of moves, settling and measurements, s.
    #[serde(with = "exact")]
    pub(crate) seconds: f64,
    /// Least true e on the way, mm; without meaning for the air loop.
    #[serde(with = "exact")]
    pub(crate) least_e_mm: f64,
    /// Whether the loop met its tolerance.
    pub(crate) converged: bool,
}

impl BenchOutcome {
    /// What both loops came to by a strategy: 0 is the plain one, 1 this program's.
    pub(super) const fn by(&self, strategy: usize) -> &Ended {
        if strategy == 0 { &self.plain } else { &self.ours }
    }
}

impl Aligned {
    /// What a loop took: 0 is the air loop, 1 the shell loop.
    pub(super) const fn taken(&self, stage: usize) -> &Taken {
        if stage == 0 { &self.air } else { &self.shell }
    }

    /// What a loop left: Δv's error (mm) or the spacing's (px).
    pub(super) const fn error(&self, stage: usize) -> f64 {
        if stage == 0 { self.delta_v_error_mm } else { self.spacing_error_px }
    }
}
