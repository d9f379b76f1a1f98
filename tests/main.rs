//! Integration tests: one binary, a file per subject.

// Helpers outside #[test] functions may fail a test by unwrapping, as the tests themselves do.
#![allow(clippy::unwrap_used)]

mod suite;
