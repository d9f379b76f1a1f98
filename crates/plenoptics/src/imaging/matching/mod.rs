//! How neighbouring micro-images are matched: what every measurement of the spacing is made of.
//!
//! ```text
//!   samples.rs, gains.rs      a frame, and what takes its vignetting out
//!            |
//!   pupil.rs                  through how much of their microlenses pixels see, and what that does to a spacing
//!            |
//!   plan.rs                   its micro-images and pairs, and the order in which they are worked through
//!            |
//!   run.rs                    tile.rs -> compare.rs -> score.rs, in the cache
//!            |
//!   normal.rs                 one Newton step for the unknowns of model.rs; scatter between field blocks
//!   damping.rs                where steps go to and fro, they are shortened
//!            |
//!   random.rs                 what pixel noise alone makes of it, from a sample
//! ```
//!
//! Matching is inverse-compositional: the slope comes from the un-interpolated reference, so the fixed point does not
//! depend on how interpolation treats noise. A pair's score is Σ w T (A − g B − h), T the reference's slope along the
//! pair made orthogonal to the pair's gain and offset; its derivative with respect to the spacing is taken against the
//! *neighbour's* slope, whose noise is independent of the reference's: gradient energy without the noise's share.

pub(super) mod compare;
pub(super) mod damping;
pub(super) mod exposure;
pub(super) mod gains;
pub(super) mod masks;
pub(super) mod model;
pub(super) mod motion;
pub(super) mod normal;
pub(super) mod plan;
pub(super) mod pupil;
pub(super) mod random;
pub(super) mod run;
pub(super) mod samples;
pub(super) mod score;
pub(super) mod shape;
pub(super) mod smeared;
pub(super) mod tile;
pub(super) mod vector;
