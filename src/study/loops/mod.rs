//! The loops: the plain strategy of Section 2.2 (fixed steps, the other way after an overshoot) against this program's,
//! on benches whose axes have their own scale and zero, with the same estimator on frames rendered by exact rays.
//!
//! ```text
//!   bench.rs     one bench: drawn by its index, and aligned by both strategies
//!   outcome.rs   what a bench came to, as plain data
//!   chapter.rs   the chapter that all outcomes make
//! ```

mod bench;
mod chapter;
mod outcome;

use std::ops::Range;
use std::sync::Arc;

pub(super) use outcome::BenchOutcome;
#[cfg(test)]
pub(super) use outcome::{Aligned, Ended, Taken};

use super::chapter::Chapter;
use super::monte_carlo::{self, Block};
use super::studio::Studio;
use super::{Desk, StudyError};
use crate::config::Texture;
use crate::sim::renderer::Medium;
use crate::sim::scene::texel_for;
use crate::sim::texture::TextureMap;

/// Side of the frames, px.
const SIDE: usize = 300;
/// First steps of the plain strategy, mm; every overshoot halves them.
const PLAIN_STEP_MM: [f64; 2] = [0.2, 2.0];
/// Time to take and measure a frame, s.
const MEASUREMENT_S: f64 = 0.25;
/// Standard deviation of the axes' scale and zero about what is configured.
const SCALE_SIGMA: f64 = 0.01;
const ZERO_SIGMA_MM: f64 = 0.1;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    match desk.merged {
        Some(merged) => Ok(chapter::chapter(desk.config, &merged.benches.outcomes)),
        None => {
            let all = judge(desk, 0..desk.options.counts.benches)?;
            Ok(chapter::chapter(desk.config, &all.outcomes))
        }
    }
}

/// Draws the benches of these indices and aligns each by both strategies. What a bench comes to depends on the study's
/// seed and its own index, and on nothing else: those that the desk's journal has are not aligned again.
pub(super) fn judge(desk: &Desk<'_>, indices: Range<u64>) -> Result<Block<BenchOutcome>, StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let studio = Studio { design, pixel, side: SIDE, rays: 8, noise: 2.0, seed: desk.options.seed };
    let joint = design.joint(config.assembly.l_bound_mm);
    let medium = Medium::Water { shell: design.shell, e: joint.e, decentre: [0.0; 2] };
    let texel = texel_for(&design, medium, design.object_distance, pixel);
    let align = |index: u64| {
        let seed = desk.options.seed.wrapping_add(index);
        let texture = Arc::new(TextureMap::generate(Texture::Natural, texel, seed));
        bench::Bench::draw(&studio, config, texture, seed).align()
    };
    let count = desk.options.counts.benches;
    let Some(journal) = desk.journal else { return monte_carlo::judged(indices, count, desk.watch, align) };
    let mut block = monte_carlo::judged(indices, count, desk.watch, |index| match journal.bench(index) {
        Some(outcome) => Ok(outcome.clone()),
        None => {
            let outcome = align(index)?;
            journal.finish(index, &outcome)?;
            Ok(outcome)
        }
    })?;
    block.seconds += journal.seconds();
    Ok(block)
}
