//! What the facts mean. Every check is a function of the facts alone.

mod bench;
mod camera;
mod configuration;
mod genicam;
mod machine;
mod network;
mod permission;
mod server;
mod stages;
mod state;
#[cfg(test)]
mod tests;
mod usb;

use super::facts::Facts;
use super::finding::Finding;

/// Every finding, in the order in which they are read.
pub(super) fn all(facts: &Facts) -> Vec<Finding> {
    let checks =
        [machine::check, configuration::check, bench::check, stages::check, camera::check, state::check, server::check];
    checks.into_iter().flat_map(|check| check(facts)).collect()
}
