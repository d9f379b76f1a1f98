//! Every stage driver against its firmware's twin: the same list of behaviours for every protocol.

mod conformance;
mod contradictions;
mod faults;
mod identify;
mod kit;
mod lines;
mod program;
mod stubborn;
mod terminal;
