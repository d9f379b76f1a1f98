//! Who asks, by what they are known, and what they may.

pub(in crate::api) mod client;
pub(in crate::api) mod credentials;
pub(in crate::api) mod guard;
pub(in crate::api) mod lease;
pub(in crate::api) mod origin;
pub(in crate::api) mod scopes;
pub(in crate::api) mod security;
pub(in crate::api) mod session;
pub(in crate::api) mod tickets;
pub(in crate::api) mod tokens;
