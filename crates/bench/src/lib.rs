//! What the crate `plenalign-control` stands on: what a bench is, and what is kept of it.
//!
//! ```text
//!        sim             twins of stages and camera behind device's traits
//!         |
//!       device           drivers and traits of a bench's stages and camera
//!      /   |   \
//! config record whole    what is configured; recordings on disk; whole numbers as such
//!     |
//!   access   store       who may do what; the history on disk
//!       \    /
//!    state_folder        where the program keeps what outlives it
//!
//!  telemetry             what the program counts about itself, called from anywhere
//! ```
//!
//! Absent: what to do next, the rules of motion, requests, the network. Nothing here commands motion of its own accord.

pub mod access;
pub mod config;
pub mod device;
pub mod record;
pub mod sim;
pub mod state_folder;
pub mod store;
pub mod telemetry;
pub mod whole;
