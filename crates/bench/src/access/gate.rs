//! The gate: one place that says who somebody is.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::time::{Instant, MissedTickBehavior};

use super::audit::{AuditRecord, AuditSink};
use super::buckets::Buckets;
use super::networks::Networks;
use super::once::OnceKey;
use super::principal::{LOCAL, Principal, Scope};
use super::record::EXPIRED;
use super::secret::{Digest, Secret};
use super::tickets::Tickets;
use super::tokens::{Ended, Holder, ONE_TIME, OWN, TokenError, TokenStore};

/// Between two looks at the file of tokens: a token revoked on the command line is dead after it.
const REFRESH: Duration = Duration::from_millis(250);
/// Between two times that the last uses of tokens are written.
const KEEP_USES: Duration = Duration::from_secs(60);
/// Longest wait for the file of tokens when a token is not known.
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// How long a browser stays signed in.
const SESSION: SignedDuration = SignedDuration::from_hours(30 * 24);
/// Wrong credentials an address may present at once, and each second in the long run: ten a minute.
const FAILURES: f64 = 10.0;
const FAILURES_PER_SECOND: f64 = 10.0 / 60.0;
/// How many times a second's requests may come at once.
const BURST_SECONDS: f64 = 4.0;
/// Measurements that a principal of scope `view` may have kept at once, and a minute in the long run.
pub const VIEWED_MEASUREMENTS: u32 = 10;

/// When a token is demanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Demand {
    /// Of everybody.
    Always,
    /// Of everybody once there is a token; until then whoever asks from this machine may do everything.
    OnceATokenExists,
}

/// What a gate is told.
#[derive(Debug, Clone)]
pub struct GateSettings {
    /// When a token is demanded.
    pub demand: Demand,
    /// Proxies whose word on whom they ask for is taken. With any, a token is demanded of everybody.
    pub trusted_proxies: Networks,
    /// Names by which the daemon may be addressed.
    pub names: Vec<String>,
    /// Requests a second of one principal, in the long run.
    pub requests_per_s: f64,
}

impl Default for GateSettings {
    fn default() -> Self {
        Self {
            demand: Demand::OnceATokenExists,
            trusted_proxies: Networks::default(),
            names: Vec::new(),
            requests_per_s: 100.0,
        }
    }
}

/// Something comes too often; when to try again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooMany(pub Duration);

/// Why somebody is not let in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unauthorised {
    /// Nothing was presented, and something is demanded.
    Nothing,
    /// What was presented opens nothing.
    Wrong,
    /// What was presented opens nothing any more.
    Ended(Ended),
    /// Too much has been presented that opens nothing.
    TooMany(TooMany),
}

/// A browser that has just signed in.
#[derive(Debug)]
pub struct Session {
    /// For its cookie.
    pub secret: Secret,
    /// Until when its cookie is worth bringing: whose session has ended with its token is told so by it.
    pub remembered_until: Timestamp,
    /// Who it is.
    pub principal: Principal,
}

/// Says who somebody is.
pub struct Gate {
    settings: GateSettings,
    tokens: TokenStore,
    once: OnceKey,
    tickets: Tickets,
    failures: Buckets<IpAddr>,
    rates: Buckets<(IpAddr, String)>,
    /// By name, of those who may but look.
    measurements: Buckets<String>,
    own: Option<Secret>,
    audit: Box<dyn AuditSink>,
}

impl Gate {
    /// A gate over the tokens there are.
    #[must_use]
    pub fn new(settings: GateSettings, tokens: TokenStore, audit: Box<dyn AuditSink>) -> Self {
        let rates = Buckets::new(settings.requests_per_s, settings.requests_per_s * BURST_SECONDS);
        Self {
            settings,
            tokens,
            once: OnceKey::default(),
            tickets: Tickets::default(),
            failures: Buckets::new(FAILURES_PER_SECOND, FAILURES),
            rates,
            measurements: Buckets::new(f64::from(VIEWED_MEASUREMENTS) / 60.0, f64::from(VIEWED_MEASUREMENTS)),
            own: Secret::random("").ok(),
            audit,
        }
    }

    /// What it was told.
    #[must_use]
    pub fn settings(&self) -> &GateSettings {
        &self.settings
    }

    /// The tokens.
    #[must_use]
    pub fn tokens(&self) -> &TokenStore {
        &self.tokens
    }

    /// The one-time key.
    #[must_use]
    pub fn once(&self) -> &OnceKey {
        &self.once
    }

    /// The tickets.
    #[must_use]
    pub fn tickets(&self) -> &Tickets {
        &self.tickets
    }

    /// A token for this program's own client, good until the program ends.
    #[must_use]
    pub fn own_token(&self) -> Option<&Secret> {
        self.own.as_ref()
    }

    /// Writes what somebody did into the audit log.
    pub fn audit(&self, record: AuditRecord) {
        self.audit.record(record);
    }

    /// Whether a token is demanded now.
    #[must_use]
    pub fn demands(&self) -> bool {
        self.settings.demand == Demand::Always || !self.settings.trusted_proxies.is_empty() || self.tokens.ever_used()
    }

    /// Whoever asks without a credential.
    ///
    /// # Errors
    /// [`Unauthorised::Nothing`] where one is demanded.
    pub fn stranger(&self, address: IpAddr) -> Result<Principal, Unauthorised> {
        if self.demands() || !address.is_loopback() {
            return Err(Unauthorised::Nothing);
        }
        Ok(Principal { name: LOCAL.to_owned(), scope: Scope::Admin, address })
    }

    /// Whoever presents a token.
    ///
    /// # Errors
    /// When it opens nothing.
    pub async fn by_token(self: &Arc<Self>, token: &str, address: IpAddr) -> Result<Principal, Unauthorised> {
        let holder = self.holder_of_token(&Digest::of(token), address).await?;
        Ok(Principal { name: holder.name, scope: holder.scope, address })
    }

    /// Whoever presents a session's cookie.
    ///
    /// # Errors
    /// When it opens nothing. A browser that brings an old cookie is no attack, so this is not counted.
    pub fn by_session(&self, session: &str, address: IpAddr) -> Result<Principal, Unauthorised> {
        let digest = Digest::of(session);
        let holder = self.tokens.session_holder(&digest).ok_or_else(|| self.wrong(&digest))?;
        Ok(Principal { name: holder.name, scope: holder.scope, address })
    }

    /// Whoever presents a ticket to a path; it is used up by that.
    ///
    /// # Errors
    /// When it opens nothing.
    pub fn by_ticket(&self, ticket: &str, path: &str, address: IpAddr) -> Result<Principal, Unauthorised> {
        // A ticket ends with the token that it was asked for with.
        match self.tickets.take(&Digest::of(ticket), path).filter(|principal| self.knows(principal)) {
            Some(principal) => Ok(Principal { address, ..principal }),
            None => {
                self.note_wrong(address);
                Err(Unauthorised::Wrong)
            }
        }
    }

    /// Whether somebody who has been let in still would be: for what outlasts a request.
    #[must_use]
    pub fn knows(&self, principal: &Principal) -> bool {
        match principal.name.as_str() {
            LOCAL => !self.demands(),
            OWN => true,
            name => self.tokens.knows(name),
        }
    }

    /// Signs a browser in, with a token or the one-time key.
    ///
    /// # Errors
    /// When it opens nothing, or too many of that address have opened nothing.
    pub async fn sign_in(self: &Arc<Self>, key: &str, address: IpAddr) -> Result<Session, SignInError> {
        // Strict: an address that has guessed too often has to wait, whatever it presents now.
        self.failures.look(&address).map_err(|wait| Unauthorised::TooMany(TooMany(wait)))?;
        let digest = Digest::of(key);
        let holder = if self.once.take(&digest) {
            Holder { name: ONE_TIME.to_owned(), scope: Scope::Admin, token: None }
        } else {
            self.holder_of_token(&digest, address).await?
        };
        let (gate, of) = (Arc::clone(self), holder.clone());
        let opened = tokio::task::spawn_blocking(move || gate.tokens.open_session(&of, SESSION)).await;
        let (secret, expires_at) = opened.map_err(|error| std::io::Error::other(error.to_string()))??;
        let principal = Principal { name: holder.name, scope: holder.scope, address };
        self.audit(AuditRecord::of(&principal, "session.open", serde_json::json!({})));
        let remembered_until = expires_at.saturating_add(EXPIRED).unwrap_or(Timestamp::MAX);
        Ok(Session { secret, remembered_until, principal })
    }

    /// Signs a browser out.
    pub async fn sign_out(self: &Arc<Self>, session: String) {
        let gate = Arc::clone(self);
        let _ = tokio::task::spawn_blocking(move || gate.tokens.close_session(&session)).await;
    }

    /// Counts a request of somebody.
    ///
    /// # Errors
    /// When they come too often.
    pub fn count(&self, address: IpAddr, name: Option<&str>) -> Result<(), TooMany> {
        // One name from many places is one principal; who has none is told by the address.
        let address = if name.is_some_and(|name| name != LOCAL) { IpAddr::from([0, 0, 0, 0]) } else { address };
        self.rates.take(&(address, name.unwrap_or_default().to_owned())).map_err(TooMany)
    }

    /// Counts a measurement that somebody asks for, which is kept: who may only look does not fill the history.
    ///
    /// # Errors
    /// Where they are of scope `view` and ask for more than [`VIEWED_MEASUREMENTS`].
    pub fn count_measurement(&self, principal: &Principal) -> Result<(), TooMany> {
        if principal.scope > Scope::View {
            return Ok(());
        }
        self.measurements.take(&principal.name).map_err(TooMany)
    }

    async fn holder_of_token(self: &Arc<Self>, digest: &Digest, address: IpAddr) -> Result<Holder, Unauthorised> {
        if self.own.as_ref().is_some_and(|own| own.digest().matches(digest)) {
            return Ok(Holder { name: OWN.to_owned(), scope: Scope::Admin, token: None });
        }
        if let Some(holder) = self.tokens.holder(digest) {
            return Ok(holder);
        }
        // It may have been made a moment ago, on the command line. Who only guesses does not keep the disk busy.
        if self.failures.look(&address).is_ok() {
            let gate = Arc::clone(self);
            let refreshed = tokio::task::spawn_blocking(move || gate.refresh());
            if tokio::time::timeout(LOOK_AGAIN, refreshed).await.is_ok()
                && let Some(holder) = self.tokens.holder(digest)
            {
                return Ok(holder);
            }
        }
        self.note_wrong(address);
        Err(self.wrong(digest))
    }

    /// Why a token or a session that opens nothing does not.
    fn wrong(&self, digest: &Digest) -> Unauthorised {
        self.tokens.ended(digest).map_or(Unauthorised::Wrong, Unauthorised::Ended)
    }

    /// Counts a wrong token or ticket. Whoever has used up their guesses still learns only that this one was wrong; signing in
    /// makes them wait.
    fn note_wrong(&self, address: IpAddr) {
        let _ = self.failures.take(&address);
    }

    /// Counts a wrong key of another kind than a token like a wrong token.
    ///
    /// # Errors
    /// When an address has presented too many.
    pub fn wrong_key(&self, address: IpAddr) -> Result<(), TooMany> {
        self.failures.take(&address).map_err(TooMany)
    }

    fn refresh(&self) {
        self.once.expire();
        if let Err(error) = self.tokens.refresh() {
            tracing::error!(%error, "the tokens known so far stay in force");
        }
    }

    /// Follows the file of tokens, for ever.
    pub async fn follow(self: Arc<Self>) {
        let mut tick = tokio::time::interval(REFRESH);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut kept_at = Instant::now();
        loop {
            tick.tick().await;
            let keep = kept_at.elapsed() >= KEEP_USES;
            if keep {
                kept_at = Instant::now();
            }
            let gate = Arc::clone(&self);
            let _ = tokio::task::spawn_blocking(move || {
                gate.refresh();
                if keep && let Err(error) = gate.tokens.keep_last_uses() {
                    tracing::warn!(%error, "when tokens were last used cannot be kept");
                }
            })
            .await;
        }
    }
}

/// Why a browser is not signed in.
#[derive(Debug)]
pub enum SignInError {
    /// It may not be.
    Unauthorised(Unauthorised),
    /// Something failed here.
    Failed(std::io::Error),
}

impl From<Unauthorised> for SignInError {
    fn from(error: Unauthorised) -> Self {
        Self::Unauthorised(error)
    }
}

impl From<std::io::Error> for SignInError {
    fn from(error: std::io::Error) -> Self {
        Self::Failed(error)
    }
}

impl From<TokenError> for SignInError {
    fn from(error: TokenError) -> Self {
        Self::Failed(std::io::Error::other(error))
    }
}
