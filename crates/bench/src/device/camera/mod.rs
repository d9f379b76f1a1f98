//! Frame sources: what a driver's bytes and times mean, the driver of Video4Linux2, and frames played from files.

pub mod brightness;
mod capture;
pub mod controls;
pub mod exposure;
pub mod files;
pub mod find;
mod kernel;
pub mod offer;
mod setup;
pub mod unpack;
pub mod v4l2;
