//! Drivers of motor stages: one file per protocol that turns commands into bytes and lines into meaning, without I/O,
//! and one that drives a controller with it over any byte stream.

pub mod grbl;
pub mod grbl_controller;
