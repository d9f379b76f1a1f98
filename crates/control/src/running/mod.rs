//! A job as it runs: what it is told, what it says, and how it ends.

pub(crate) mod context;
pub(crate) mod end;
pub(crate) mod job;
