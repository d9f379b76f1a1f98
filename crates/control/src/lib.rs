//! What to do next, and doing it: the one place that commands motion.
//!
//! [`Service`] is what callers (the API, the command line) hold. Its rooms, each of which may name those on the lines below
//! its own:
//!
//! ```text
//!  replay                                      a recorded job done once more, and compared
//!  service                                     what callers ask for: jobs, moves by hand, stops, measurements, the history
//!  alignment                                   the jobs from their first step to their report
//!  running                                     a job as it runs: what it is told and says, how it ends
//!  measuring                                   what the camera tells: frames at rest and in motion, what is read from them
//!  motion                                      rules, leases and latch under which an axis moves, and moving it
//!  history                                     how what is done is written down, and read again
//!  recording                                   a job as it is recorded
//!  set_up                                      what stands before the lens, and since when
//!  plan, design, events, clock, refusal        what will be done; what is published; where time goes; what is refused
//!  job                                         a job as data: request, states, steps, iterations, report
//!  budget                                      how sure Δv and e are, and why
//!  loops                                       what is decided from what was measured: pure functions
//!  spacing, reading, field, bench_name, open   words that all the others share, and the way to a bench
//! ```

mod alignment;
mod bench_name;
pub mod budget;
mod clock;
pub mod design;
pub mod events;
pub mod field;
pub mod history;
pub mod job;
pub mod loops;
pub mod measuring;
pub mod motion;
mod open;
pub mod plan;
pub mod reading;
pub mod recording;
mod refusal;
pub mod replay;
mod running;
pub mod service;
mod set_up;
pub mod spacing;
pub use bench_name::bench_name;
pub use motion::StopReport;
pub use open::open_bench;
pub use refusal::{Refusal, ServiceError};
pub use service::Service;
pub use service::confirm_key::Shown;
pub use service::jobs::Acceptance;
