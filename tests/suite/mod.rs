//! The suite, a module for each subject; `bench`, `daemon` and `fakes` are what they share.

mod alignment;
mod analytic;
mod api;
mod bench;
mod calibration;
mod config;
mod contract;
mod daemon;
mod daemon_signals;
mod design_cli;
mod fakes;
mod grbl;
mod grid;
mod grid_check;
mod live;
mod measure_cli;
mod optics;
mod rendered;
mod renderer;
mod spacing;
mod stages;
mod stop;
mod structure;
mod view;
mod vignetting;
mod websocket;
