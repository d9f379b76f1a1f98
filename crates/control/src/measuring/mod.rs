//! What the camera tells: frames taken at rest and in motion, and what is read from them.

pub(crate) mod at_rest;
pub(crate) mod eye;
pub mod measurement;
pub mod meter;
pub(crate) mod not_measured;
mod repeats;
pub(crate) mod sight;
