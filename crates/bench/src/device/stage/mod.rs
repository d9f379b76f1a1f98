//! Drivers of motor stages. Of each protocol one file turns commands into bytes and bytes into meaning, without I/O; a
//! [`session::Driver`] drives a controller with it over any byte stream; [`supervisor::Controller`] connects it, watches
//! it and connects it again.

pub mod axis;
pub mod exchange;
pub mod grbl;
pub mod grbl_controller;
pub mod orders;
pub mod pi;
pub mod pi_controller;
pub mod polled;
pub mod session;
pub mod stopping;
pub mod strangers;
pub mod supervisor;
pub mod thorlabs;
pub mod thorlabs_controller;
pub mod tmcl;
pub mod tmcl_controller;
pub mod track;
pub mod zaber;
pub mod zaber_controller;
