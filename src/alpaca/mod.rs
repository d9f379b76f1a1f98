//! The facade for ASCOM Alpaca clients: both axes as Focusers and the camera as a Camera, on a port of its own.
//!
//! Everything goes the way of the REST API: moves through the motion rules and under the control lease, frames from the
//! camera's own source, what is done into the audit log. A client is known by its ClientID and where it asks from; its
//! `Connected = true` of a Focuser takes the lease (`seat`), and whatever it asks renews it. Alpaca knows no tokens:
//! who reaches the port may take the control, so that it is served on loopback alone unless the operator insists.
//!
//! The wire is that of the ASCOM Alpaca API reference, version 1: lowercase paths, the query of a GET in any case, the
//! form of a PUT in its own; errors of a device in an answer of status 200, other statuses only for what cannot be read.

mod answer;
mod camera;
mod common;
mod discovery;
mod exposure;
mod fault;
mod focuser;
mod ids;
mod image;
mod management;
mod request;
mod seat;
mod server;

pub use discovery::{PORT as DISCOVERY_PORT, answer_searches};
pub use ids::{IdsError, UniqueIds};
pub use server::{Alpaca, IN_RESERVE};
