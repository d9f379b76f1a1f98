//! Tickets: for what cannot send a header (`<img>`, a browser's WebSocket), a way in to one path, once, for seconds.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::principal::Principal;
use super::secret::{Digest, Secret};
use super::share::keep_share;

/// How long a ticket is good.
pub const LASTS: Duration = Duration::from_secs(30);
/// Tickets of one principal not yet used, at most; beyond it their own oldest goes, and nobody else's.
const SHARE: usize = 64;

#[derive(Debug)]
struct Ticket {
    digest: Digest,
    path: String,
    principal: Principal,
    until: Instant,
}

/// Tickets that have been given out and not been used.
#[derive(Debug, Default)]
pub struct Tickets(Mutex<Vec<Ticket>>);

impl Tickets {
    fn tickets(&self) -> MutexGuard<'_, Vec<Ticket>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives out a ticket to one path.
    ///
    /// # Errors
    /// When the system has no randomness to give.
    pub fn give(&self, path: &str, principal: Principal) -> std::io::Result<Secret> {
        let secret = Secret::random("")?;
        let now = Instant::now();
        let mut tickets = self.tickets();
        tickets.retain(|ticket| now < ticket.until);
        keep_share(&mut tickets, SHARE, |ticket| ticket.principal.name == principal.name);
        let (digest, path) = (secret.digest(), path.to_owned());
        tickets.push(Ticket { digest, path, principal, until: now + LASTS });
        Ok(secret)
    }

    /// Whose ticket to this path it is; it is used up by that. At another path it stays what it was.
    #[must_use]
    pub fn take(&self, presented: &Digest, path: &str) -> Option<Principal> {
        self.take_at(presented, path, Instant::now())
    }

    fn take_at(&self, presented: &Digest, path: &str, now: Instant) -> Option<Principal> {
        let mut tickets = self.tickets();
        let mut found = None;
        for (index, ticket) in tickets.iter().enumerate() {
            if ticket.digest.matches(presented) && ticket.path == path && now < ticket.until {
                found = Some(index);
            }
        }
        Some(tickets.remove(found?).principal)
    }
}

#[cfg(test)]
mod tests {
    use super::super::principal::Scope;
    use super::*;

    fn principal() -> Principal {
        Principal { name: "a".into(), scope: Scope::View, address: [127, 0, 0, 1].into() }
    }

    #[test]
    fn a_ticket_is_for_one_path_once() {
        let tickets = Tickets::default();
        let ticket = tickets.give("/a", principal()).unwrap().digest();
        assert_eq!(tickets.take(&ticket, "/b"), None);
        assert_eq!(tickets.take(&ticket, "/a"), Some(principal()));
        assert_eq!(tickets.take(&ticket, "/a"), None);
    }

    #[test]
    fn a_ticket_is_good_for_half_a_minute() {
        let tickets = Tickets::default();
        let (one, two) = (tickets.give("/a", principal()).unwrap(), tickets.give("/a", principal()).unwrap());
        let now = Instant::now();
        assert!(tickets.take_at(&one.digest(), "/a", now + Duration::from_secs(29)).is_some());
        assert!(tickets.take_at(&two.digest(), "/a", now + Duration::from_secs(31)).is_none());
    }

    #[test]
    fn of_too_many_the_same_principals_oldest_goes() {
        let tickets = Tickets::default();
        let other = Principal { name: "b".into(), ..principal() };
        let others = tickets.give("/a", other).unwrap().digest();
        let given: Vec<Digest> = (0..=SHARE).map(|_| tickets.give("/a", principal()).unwrap().digest()).collect();
        assert!(tickets.take(&others, "/a").is_some());
        assert!(tickets.take(&given[0], "/a").is_none());
        assert!(tickets.take(&given[1], "/a").is_some());
    }
}
