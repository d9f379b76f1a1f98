//! Frame sources: what a driver's bytes and times mean, and the driver of Video4Linux2.

pub mod exposure;
pub mod unpack;
pub mod v4l2;
