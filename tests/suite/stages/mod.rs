//! Every stage driver against its firmware's twin: the same list of behaviours for every protocol.

mod conformance;
mod contradictions;
mod faults;
mod grbl_as_it_is;
mod identify;
mod interleaved;
mod interrupted;
mod jogs;
pub(crate) mod kit;
mod lines;
mod lost_at_every_poll;
mod program;
mod searches;
mod stopped_at_every_poll;
mod stubborn;
mod terminal;
