//! The simulated bench: twins of stages and camera that share one truth.
//!
//! `sim` uses `optics` and never `imaging`: the renderer traces exact rays and shares no formula with the estimator.

pub mod bench;
pub mod camera;
pub mod configured;
pub mod gige;
mod picture;
pub mod plant;
mod reel;
pub mod stage;
pub mod truth;

pub use plenoptics::sim::{exposure, flaws, renderer, scene, shutter, texture};
