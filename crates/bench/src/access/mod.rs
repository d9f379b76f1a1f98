//! Who asks, and what they may do: tokens and sessions, the one-time key, tickets, and how often one may ask.
//!
//! Nothing here knows HTTP: `api` reads credentials from requests and turns what is said here into answers. A secret is
//! shown once, where it is made; what is kept of it is its SHA-256, compared in constant time.

mod audit;
mod buckets;
mod gate;
mod name;
mod networks;
mod once;
mod principal;
mod record;
mod secret;
mod share;
mod state_file;
mod tickets;
mod tokens;

pub use audit::{AuditRecord, AuditSink, LogAudit};
pub use buckets::Buckets;
pub use gate::{Demand, Gate, GateSettings, Session, SignInError, TooMany, Unauthorised, VIEWED_MEASUREMENTS};
pub use name::{LONGEST as LONGEST_NAME, PATTERN as NAME_PATTERN};
pub use networks::Networks;
pub use once::OnceKey;
pub use principal::{LOCAL, Principal, Scope};
pub use record::TokenRecord;
pub use secret::{Digest, Secret};
pub use state_file::{write_private, write_whole};
pub use tickets::{LASTS as TICKET_LASTS, Tickets};
pub use tokens::{Ended, OWN as PROGRAM, TokenError, TokenStore};
