//! The history: how control writes what it does, and how it is read again.

pub(crate) mod journal;
pub mod read;
