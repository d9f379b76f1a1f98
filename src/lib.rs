//! Plenalign aligns underwater plenoptic cameras: it drives a bench's two motor axes, grabs raw frames, measures the
//! spacing of image points under adjacent microlenses, and moves the axes until that spacing says that the camera is in
//! focus.
//!
//! Who may call whom, downwards only:
//!
//! ```text
//!   cli   api   alpaca   arguments and wires to requests; results to text, JSON, problem details
//!     \   /
//!    control             what to do next and doing it: the one place that commands motion
//!    /     \
//! device  imaging        drivers and traits; pixels to numbers with uncertainties
//!    \     /
//!    optics              the model, pure
//!      |
//!  units, raw            lengths with units; a raw frame's pixels
//!
//!  sim                   twins of stages and camera behind the same traits; uses optics, never imaging
//!  access                who asks and what they may do; tokens, sessions, tickets
//!  store                 the history on disk: plain records in and out, used by control
//!  record                recordings on disk: MCAP files, written by control, played by device
//!  fleet                 what happens, published to an MQTT broker: follows control, takes no requests
//!  jpeg                  grey pictures to JPEG, for api
//!  config                read once, immutable afterwards
//!  telemetry             what the program counts about itself, called from anywhere
//! ```
//!
//! A room is compiled with its crate, each of which knows nothing of those above it:
//!
//! ```text
//!  plenalign             cli, api, alpaca, fleet, study, jpeg; every other room has its name here, too
//!  plenalign-control     control
//!  plenalign-bench       device, sim, config, record, store, access, state_folder, telemetry, whole
//!  plenoptics            imaging, optics, raw, units, and the renderer in sim: numbers only
//! ```
//!
//! Deliberately absent: `optics` and `imaging` know no I/O, clock or async; `sim` knows nothing of `imaging`; nothing
//! below `api` knows a status code; nothing but `control` commands motion.

pub mod alpaca;
pub mod api;
pub mod cli;
pub mod fleet;
pub mod jpeg;
pub mod study;
mod text;

pub use plenalign_bench::{access, config, device, record, sim, state_folder, store, telemetry, whole};
pub use plenalign_control as control;
pub use plenoptics::{imaging, optics, raw, units};
