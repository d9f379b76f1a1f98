//! Every stage driver against its firmware's twin: the same list of behaviours for every protocol.

mod conformance;
mod contradictions;
mod examples;
mod faults;
mod fluidnc;
mod grbl_as_it_is;
mod grbl_firmware;
mod grblhal;
mod identify;
mod interleaved;
mod interrupted;
mod jogs;
pub(crate) mod kit;
mod leaving;
mod lines;
mod lost_at_every_poll;
mod program;
mod searches;
mod stopped_at_every_poll;
mod strangers;
mod stubborn;
mod terminal;
mod thorlabs;
