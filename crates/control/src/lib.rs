//! What to do next, and doing it: the one place that commands motion.
//!
//! [`Service`] is what callers (the API, the command line) hold. It owns the bench's motion rules ([`motion`]), runs at
//! most one job at a time ([`job`]), and publishes what happens ([`events`]). The decisions of the loops are pure
//! functions ([`loops`]).

pub(crate) mod alignment;
mod bench_name;
pub mod budget;
pub mod design;
pub mod events;
pub mod history;
pub mod job;
pub mod loops;
pub mod measuring;
pub mod motion;
mod open;
pub mod plan;
pub mod recording;
mod refusal;
pub mod replay;
pub mod service;
mod set_up;
pub use bench_name::bench_name;
pub use motion::StopReport;
pub use open::open_bench;
pub use refusal::{Refusal, ServiceError};
pub use service::Service;
pub use service::confirm_key::Shown;
pub use service::jobs::Acceptance;
