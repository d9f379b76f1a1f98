//! What is kept of tokens and sessions.

use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use uuid::Uuid;

use super::principal::Scope;
use super::secret::Digest;

/// Revoked tokens that are remembered.
const REVOKED: usize = 100;
/// How long a session that has ended with its token is remembered.
pub(super) const EXPIRED: SignedDuration = SignedDuration::from_hours(30 * 24);

/// A token as it is kept: everything but the secret.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TokenRecord {
    /// Names it for good.
    pub id: Uuid,
    /// What its holder is called; no two tokens have the same.
    pub name: String,
    /// What it allows.
    pub scope: Scope,
    /// SHA-256 of the secret.
    pub sha256: Digest,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it was last used, to the minute.
    #[serde(default)]
    pub last_used_at: Option<Timestamp>,
    /// When it ends by itself.
    #[serde(default)]
    pub expires_at: Option<Timestamp>,
}

/// A browser that has signed in.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct SessionRecord {
    /// The token it was opened with, and ends with; none for the one-time key.
    pub(super) token: Option<Uuid>,
    pub(super) name: String,
    pub(super) scope: Scope,
    pub(super) sha256: Digest,
    pub(super) expires_at: Timestamp,
}

/// A token that was revoked, for whoever still has it, or is signed in with it, to be told.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct RevokedRecord {
    pub(super) name: String,
    pub(super) sha256: Digest,
    /// SHA-256 of the sessions that were open by it.
    pub(super) sessions: Vec<Digest>,
    pub(super) at: Timestamp,
    /// Who revoked it; nobody is named who did it on the machine itself.
    pub(super) by: Option<String>,
}

/// The whole of what is kept.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Records {
    pub(super) tokens: Vec<TokenRecord>,
    #[serde(default)]
    pub(super) sessions: Vec<SessionRecord>,
    /// The newest last.
    #[serde(default)]
    pub(super) revoked: Vec<RevokedRecord>,
}

impl Records {
    /// Takes away what has expired, and sessions of tokens that are gone. A token that has expired stays in the list, and for a
    /// while the sessions that ended with it, so that its holder can be told why it no longer opens.
    pub(super) fn tidy(&mut self, now: Timestamp) {
        let Self { tokens, sessions, revoked } = self;
        revoked.drain(..revoked.len().saturating_sub(REVOKED));
        let remembered = |end: Timestamp| end.saturating_add(EXPIRED).is_ok_and(|until| until > now);
        sessions.retain(|session| match session.token {
            None => session.expires_at > now,
            Some(id) => tokens.iter().any(|token| {
                let with_it = token.expires_at.is_some_and(|end| session.expires_at >= end && remembered(end));
                token.id == id && (session.expires_at > now || with_it)
            }),
        });
    }
}
