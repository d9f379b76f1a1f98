//! Frame sources: what a driver's bytes and times mean, the drivers of Video4Linux2 and of GenICam, and
//! frames played from files.

pub mod brightness;
mod capture;
pub mod controls;
pub mod exposure;
mod feed;
pub mod files;
pub mod find;
pub mod genicam;
mod kernel;
pub mod offer;
pub mod poses;
mod setup;
pub mod unpack;
pub mod v4l2;
