//! Underwater plenoptic cameras in numbers: the model, raw frames, what they say, and how they come about.
//!
//! ```text
//!    imaging     sim       pixels to numbers with uncertainties; raw frames by exact rays
//!      |  \     / |
//!      |   optics |        the model, pure
//!      |     |    |
//!    raw   units  raw      a raw frame's pixels and files; lengths with units
//! ```
//!
//! `imaging` and `sim` know nothing of each other: the renderer shares no formula with the estimator. Absent: devices,
//! configuration, clock, async, logging; files, but for those of raw frames. Fourier transforms are planned by the crate
//! `fourier`, for the compiler's sake.

pub mod imaging;
pub mod optics;
pub mod raw;
pub mod sim;
pub mod units;
