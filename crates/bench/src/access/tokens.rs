//! Tokens and sessions: kept in one file, which the command line and the daemon both write.
//!
//! Who is asked about works on what is in memory, so that no request waits for a disk; the file is read again when it
//! has changed ([`TokenStore::refresh`]).

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use jiff::{SignedDuration, Timestamp};
use uuid::Uuid;

use super::name::name as possible;
use super::principal::{LOCAL, Scope};
use super::record::{Records, RevokedRecord, SessionRecord, TokenRecord};
use super::secret::{Digest, Secret};
use super::share::keep_share;
use super::state_file::write_private;
use crate::state_folder::{make_folder, open_private};

/// What every token begins with: by it, one that has leaked into a log or a repository is found.
const PREFIX: &str = "plenalign_";
/// Names that are not for tokens.
const RESERVED: [&str; 3] = [LOCAL, ONE_TIME, OWN];
/// Name of who came in by the one-time key.
pub(super) const ONE_TIME: &str = "one-time link";
/// Name of the program itself, and of its own client.
pub const OWN: &str = "plenalign";
/// Tokens kept at most.
const MOST: usize = 1000;
/// Sessions of one token, or by the one-time key, at most; beyond it their own oldest goes, and nobody else's.
const SESSIONS: usize = 32;
/// How exactly the last use is known.
const LAST_USE_STEP: SignedDuration = SignedDuration::from_secs(60);
const FILE: &str = "tokens.json";
const LOCK: &str = "tokens.lock";

/// Why tokens cannot be read or changed.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The name cannot be one.
    #[error("{0:?} cannot be a token's name: 1 to 64 letters, digits, blanks and .@_-")]
    Name(String),
    /// The program itself uses the name.
    #[error("the name {0:?} is taken by the program itself; choose another")]
    Reserved(String),
    /// Another token has the name.
    #[error("there is a token named {0:?} already; revoke it first, or choose another name")]
    Taken(String),
    /// No token has this name or id.
    #[error("there is no token {0:?}")]
    Unknown(String),
    /// The end lies in the past.
    #[error("the token would have expired already, at {0}")]
    Past(Timestamp),
    /// There is no room for another.
    #[error("there are {MOST} tokens already; revoke some")]
    Full,
    /// The file cannot be read or written.
    #[error("cannot use {path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

/// What tells one state of the file from another.
type Stamp = Option<(u64, u64, i64, i64)>;

#[derive(Default)]
struct Held {
    records: Records,
    stamp: Stamp,
    /// The last use of some token is newer here than in the file.
    used: bool,
}

/// Tokens and sessions.
pub struct TokenStore {
    folder: Option<PathBuf>,
    held: Mutex<Held>,
}

/// Why a secret that has let somebody in does so no more. Only whoever has the secret is told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// Its token was revoked.
    Revoked {
        /// Name of the token.
        name: String,
        /// When.
        at: Timestamp,
        /// By whom; `None` where it was done on the machine itself.
        by: Option<String>,
    },
    /// Its token has expired.
    Expired {
        /// Name of the token.
        name: String,
        /// When.
        at: Timestamp,
    },
}

/// Whom a secret belongs to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Holder {
    pub(super) name: String,
    pub(super) scope: Scope,
    pub(super) token: Option<Uuid>,
}

impl TokenStore {
    /// The tokens kept in a folder; none where it has no such file yet.
    ///
    /// # Errors
    /// When there is a file that cannot be read: to go on without it might let in whom it does not know.
    pub fn open(folder: &Path) -> Result<Self, TokenError> {
        let store = Self { folder: Some(folder.to_owned()), held: Mutex::default() };
        store.refresh()?;
        Ok(store)
    }

    /// Tokens kept in memory only.
    #[must_use]
    pub fn in_memory() -> Self {
        Self { folder: None, held: Mutex::default() }
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether a token has ever been made: the file is there, though the last token may have been revoked.
    #[must_use]
    pub fn ever_used(&self) -> bool {
        let held = self.held();
        held.stamp.is_some() || !held.records.tokens.is_empty()
    }

    /// Whether there is a token that opens anything now.
    #[must_use]
    pub fn has_any(&self) -> bool {
        let now = Timestamp::now();
        self.held().records.tokens.iter().any(|token| token.expires_at.is_none_or(|end| end > now))
    }

    /// Every token, oldest first.
    #[must_use]
    pub fn list(&self) -> Vec<TokenRecord> {
        self.held().records.tokens.clone()
    }

    /// Reads the file again if it has changed, and writes when tokens were last used. Does blocking I/O.
    ///
    /// # Errors
    /// When the file cannot be read: what was known stays in force.
    pub fn refresh(&self) -> Result<(), TokenError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let path = folder.join(FILE);
        let stamp = stamp(&path).map_err(|source| TokenError::File { path: path.clone(), source })?;
        // A file that is taken away opens no door: what was known stays in force until the daemon starts again.
        if stamp.is_some() && self.held().stamp != stamp {
            let mut records = read(&path)?;
            let mut held = self.held();
            keep_last_uses(&mut records, &held.records);
            held.records = records;
            held.stamp = stamp;
        }
        Ok(())
    }

    /// Writes when tokens were last used, if that has changed. Does blocking I/O.
    ///
    /// # Errors
    /// As the system says.
    pub fn keep_last_uses(&self) -> Result<(), TokenError> {
        if std::mem::take(&mut self.held().used) { self.change(|_| Ok(())) } else { Ok(()) }
    }

    /// Makes a token. The secret is known to nobody but the caller. Does blocking I/O.
    ///
    /// # Errors
    /// When the name is impossible or taken, the end is past, or the file cannot be written.
    pub fn create(
        &self,
        name: &str,
        scope: Scope,
        expires_at: Option<Timestamp>,
    ) -> Result<(Secret, TokenRecord), TokenError> {
        let Some(name) = possible(name) else { return Err(TokenError::Name(name.to_owned())) };
        if RESERVED.contains(&name) {
            return Err(TokenError::Reserved(name.to_owned()));
        }
        let now = Timestamp::now();
        if let Some(end) = expires_at.filter(|end| *end <= now) {
            return Err(TokenError::Past(end));
        }
        let secret = self.secret(PREFIX)?;
        let record = TokenRecord {
            id: Uuid::now_v7(),
            name: name.to_owned(),
            scope,
            sha256: secret.digest(),
            created_at: now,
            last_used_at: None,
            expires_at,
        };
        self.change(|records| {
            if records.tokens.iter().any(|token| token.name == name) {
                return Err(TokenError::Taken(name.to_owned()));
            }
            if records.tokens.len() >= MOST {
                return Err(TokenError::Full);
            }
            records.tokens.push(record.clone());
            Ok(())
        })?;
        Ok((secret, record))
    }

    /// Revokes a token by its name or id, with the sessions opened with it, and keeps who did so; `None` on the machine
    /// itself. Does blocking I/O.
    ///
    /// # Errors
    /// When there is no such token, or the file cannot be written.
    pub fn revoke(&self, which: &str, by: Option<&str>) -> Result<TokenRecord, TokenError> {
        self.change(|records| {
            let at = records.tokens.iter().position(|token| token.name == which || token.id.to_string() == which);
            let at = at.ok_or_else(|| TokenError::Unknown(which.to_owned()))?;
            let token = records.tokens.remove(at);
            let of_it = records.sessions.iter().filter(|session| session.token == Some(token.id));
            records.revoked.push(RevokedRecord {
                name: token.name.clone(),
                sha256: token.sha256,
                sessions: of_it.map(|session| session.sha256).collect(),
                at: Timestamp::now(),
                by: by.map(str::to_owned),
            });
            Ok(token)
        })
    }

    /// Why a token or a session opens nothing any more; `None` where it is not known to have opened anything.
    pub(super) fn ended(&self, digest: &Digest) -> Option<Ended> {
        let held = self.held();
        let Records { tokens, sessions, revoked } = &held.records;
        let mut found = None;
        for token in revoked {
            let is_it = std::iter::once(&token.sha256).chain(&token.sessions).any(|known| known.matches(digest));
            if is_it {
                found = Some(Ended::Revoked { name: token.name.clone(), at: token.at, by: token.by.clone() });
            }
        }
        let now = Timestamp::now();
        let of = sessions.iter().find(|session| session.sha256.matches(digest)).and_then(|session| session.token);
        for token in tokens {
            if let Some(at) = token.expires_at.filter(|end| *end <= now)
                && (token.sha256.matches(digest) || of == Some(token.id))
            {
                found = Some(Ended::Expired { name: token.name.clone(), at });
            }
        }
        found
    }

    /// Opens a session. It is kept if that is possible, and good until the program ends if it is not. Does blocking
    /// I/O.
    pub(super) fn open_session(
        &self,
        holder: &Holder,
        lasts: SignedDuration,
    ) -> Result<(Secret, Timestamp), TokenError> {
        let secret = self.secret("")?;
        let mut expires_at = Timestamp::now().saturating_add(lasts).unwrap_or(Timestamp::MAX);
        if let Some(token) = self.held().records.tokens.iter().find(|token| Some(token.id) == holder.token) {
            expires_at = token.expires_at.map_or(expires_at, |end| end.min(expires_at));
        }
        let record = SessionRecord {
            token: holder.token,
            name: holder.name.clone(),
            scope: holder.scope,
            sha256: secret.digest(),
            expires_at,
        };
        let kept = self.change(|records| {
            add_session(&mut records.sessions, record.clone());
            Ok(())
        });
        if let Err(error) = kept {
            tracing::warn!(%error, "a session is good until the program ends only");
            add_session(&mut self.held().records.sessions, record);
        }
        Ok((secret, expires_at))
    }

    /// Ends a session; nothing happens where it has ended. Does blocking I/O.
    pub(super) fn close_session(&self, secret: &str) {
        let digest = Digest::of(secret);
        self.held().records.sessions.retain(|session| !session.sha256.matches(&digest));
        let kept = self.change(|records| {
            records.sessions.retain(|session| !session.sha256.matches(&digest));
            Ok(())
        });
        if let Err(error) = kept {
            tracing::warn!(%error, "a session that has ended is still in the file");
        }
    }

    /// Whom a token belongs to.
    pub(super) fn holder(&self, digest: &Digest) -> Option<Holder> {
        let now = Timestamp::now();
        let mut held = self.held();
        // Every one is looked at, so that the time taken says nothing of which it was.
        let mut found = None;
        for (index, token) in held.records.tokens.iter().enumerate() {
            if token.sha256.matches(digest) && token.expires_at.is_none_or(|end| end > now) {
                found = Some(index);
            }
        }
        let token = held.records.tokens.get_mut(found?)?;
        let holder = Holder { name: token.name.clone(), scope: token.scope, token: Some(token.id) };
        let noted = note_use(token, now);
        held.used |= noted;
        Some(holder)
    }

    /// Whom a session belongs to. Its use is its token's.
    pub(super) fn session_holder(&self, digest: &Digest) -> Option<Holder> {
        let now = Timestamp::now();
        let mut held = self.held();
        let Held { records: Records { tokens, sessions, .. }, used, .. } = &mut *held;
        let mut found = None;
        for session in &*sessions {
            if session.sha256.matches(digest) && session.expires_at > now {
                found = Some(session);
            }
        }
        let session = found?;
        if let Some(id) = session.token {
            let alive = |token: &&mut TokenRecord| token.id == id && token.expires_at.is_none_or(|end| end > now);
            *used |= note_use(tokens.iter_mut().find(alive)?, now);
        }
        Some(Holder { name: session.name.clone(), scope: session.scope, token: session.token })
    }

    /// Whether anybody is let in under this name now.
    pub(super) fn knows(&self, name: &str) -> bool {
        let now = Timestamp::now();
        let Records { tokens, sessions, .. } = &self.held().records;
        tokens.iter().any(|token| token.name == name && token.expires_at.is_none_or(|end| end > now))
            || sessions
                .iter()
                .any(|session| session.token.is_none() && session.name == name && session.expires_at > now)
    }

    fn secret(&self, prefix: &str) -> Result<Secret, TokenError> {
        Secret::random(prefix)
            .map_err(|source| TokenError::File { path: PathBuf::from("the random number generator"), source })
    }

    /// Changes what is kept: the file, under its lock so that no other process's change is lost, then what is held.
    fn change<T>(&self, change: impl FnOnce(&mut Records) -> Result<T, TokenError>) -> Result<T, TokenError> {
        let now = Timestamp::now();
        let Some(folder) = &self.folder else {
            let mut held = self.held();
            let mut records = held.records.clone();
            let result = change(&mut records)?;
            records.tidy(now);
            held.records = records;
            return Ok(result);
        };
        let path = folder.join(FILE);
        let failed = |source| TokenError::File { path: path.clone(), source };
        let lock = lock(folder).map_err(failed)?;
        let mut records = if stamp(&path).map_err(failed)?.is_some() { read(&path)? } else { Records::default() };
        keep_last_uses(&mut records, &self.held().records);
        let result = change(&mut records)?;
        records.tidy(now);
        let text = serde_json::to_vec_pretty(&records).map_err(|error| failed(io::Error::other(error)))?;
        write_private(&path, &text).map_err(failed)?;
        let stamp = stamp(&path).map_err(failed)?;
        drop(lock);
        let mut held = self.held();
        held.records = records;
        held.stamp = stamp;
        Ok(result)
    }
}

/// Notes that a token is used now, where that is long enough after the last time; whether it was.
fn note_use(token: &mut TokenRecord, now: Timestamp) -> bool {
    let due = token.last_used_at.is_none_or(|last| now.duration_since(last) >= LAST_USE_STEP);
    if due {
        token.last_used_at = Some(now);
    }
    due
}

/// Adds a session, within its token's share.
fn add_session(sessions: &mut Vec<SessionRecord>, new: SessionRecord) {
    keep_share(sessions, SESSIONS, |session| session.token == new.token && session.name == new.name);
    sessions.push(new);
}

/// The newer of each token's last uses.
fn keep_last_uses(records: &mut Records, held: &Records) {
    for token in &mut records.tokens {
        if let Some(known) = held.tokens.iter().find(|known| known.id == token.id) {
            token.last_used_at = token.last_used_at.max(known.last_used_at);
        }
    }
}

/// Held for as long as the file returned is open.
fn lock(folder: &Path) -> io::Result<File> {
    make_folder(folder)?;
    // Its owner's alone: anybody who can open it can hold it.
    let file = open_private(&folder.join(LOCK))?;
    file.lock()?;
    Ok(file)
}

fn stamp(path: &Path) -> io::Result<Stamp> {
    match fs::metadata(path) {
        Ok(data) => Ok(Some((data.ino(), data.len(), data.mtime(), data.mtime_nsec()))),
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(None),
        Err(error) => Err(error),
    }
}

fn read(path: &Path) -> Result<Records, TokenError> {
    let failed = |source| TokenError::File { path: path.to_owned(), source };
    let text = fs::read(path).map_err(failed)?;
    serde_json::from_slice(&text).map_err(|error| failed(io::Error::new(ErrorKind::InvalidData, error)))
}

#[cfg(test)]
mod tests;
