//! What to do next, and doing it: the one place that commands motion.
//!
//! [`Service`] is what callers (the API, the command line) hold. It owns the bench's motion rules ([`motion`]), runs at
//! most one job at a time ([`job`]), and publishes what happens ([`events`]). The decisions of the loops are pure
//! functions ([`air`], [`shell`]).

pub mod air;
mod air_step;
mod alignment;
mod at_pose;
mod at_rest;
pub mod axis_model;
mod bench_name;
pub mod budget;
mod by_hand;
pub mod calibrated;
mod clock;
mod confirm_key;
mod context;
pub mod design;
pub mod draft;
pub mod events;
mod exposure;
mod eye;
mod health;
pub mod history;
pub mod job;
mod jobs;
mod journal;
mod l_bound;
pub mod lease;
pub mod light;
pub mod look;
pub mod measurement;
pub mod meter;
mod mistake;
pub mod motion;
mod open;
pub mod outcome;
pub mod plan;
pub mod pose;
mod press;
pub mod recent;
mod record;
pub mod recording;
mod refusal;
pub mod replay;
mod report;
mod request;
mod retention;
mod runner;
mod service;
mod set_up;
pub mod shell;
mod shell_step;
mod sight;
mod simulated;
mod stopping;
mod survey;
mod tasks;
mod watchers;
mod way_in;
pub use bench_name::bench_name;
pub use confirm_key::Shown;
pub use jobs::Acceptance;
pub use motion::StopReport;
pub use open::open_bench;
pub use refusal::{Refusal, ServiceError};
pub use service::Service;
