//! Tolerances of parts: how many assemblies meet the blur limit as built, and how many after both loops.
//!
//! ```text
//!   parts.rs     one assembly: its parts drawn by its index, and its blur
//!   chapter.rs   the chapter that all blurs make
//! ```

mod chapter;
mod parts;

use std::ops::Range;

use serde::{Deserialize, Serialize};

use self::parts::Parts;
use super::chapter::Chapter;
use super::monte_carlo::{self, Block, exact};
use super::{Desk, StudyError};

/// What an assembly came to: the blur of the object on the axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Blur {
    /// With Δv and e set by ruler and readback, mm.
    #[serde(with = "exact")]
    pub(crate) as_built_mm: f64,
    /// After both loops, mm.
    #[serde(with = "exact")]
    pub(crate) aligned_mm: f64,
}

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    match desk.merged {
        Some(merged) => Ok(chapter::chapter(desk.config, desk.options.seed, &merged.assemblies.outcomes)),
        None => {
            let all = judge(desk, 0..desk.options.counts.assemblies)?;
            Ok(chapter::chapter(desk.config, desk.options.seed, &all.outcomes))
        }
    }
}

/// Draws the assemblies of these indices and works out the blur of each, which depends on the study's seed and its own
/// index, and on nothing else.
pub(super) fn judge(desk: &Desk<'_>, indices: Range<u64>) -> Result<Block<Blur>, StudyError> {
    let design = desk.config.design();
    let pixel = desk.config.pixel_pitch().millimetres();
    let l_bound = desk.config.assembly.l_bound_mm;
    monte_carlo::judged(indices, desk.options.counts.assemblies, desk.watch, |index| {
        let parts = Parts::draw(&design, seed(desk.options.seed, index), None);
        Ok(Blur { as_built_mm: parts.as_built(&design, l_bound), aligned_mm: parts.aligned(&design, l_bound, pixel) })
    })
}

/// The seed of an assembly's parts.
const fn seed(study: u64, index: u64) -> u64 {
    study.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(index)
}
