//! The simulated bench: twins of stages and camera that share one truth.
//!
//! `sim` uses `optics` and never `imaging`: the renderer traces exact rays and shares no formula with the estimator.

pub mod bench;
pub mod camera;
pub mod exposure;
pub mod flaws;
mod picture;
pub mod plant;
pub mod renderer;
pub mod scene;
pub mod shutter;
pub mod stage;
pub mod texture;
pub mod truth;
