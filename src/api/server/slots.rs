//! Places for connections: so many overall, so many for each address, and a reserve beyond both for the stop. Every
//! listener takes its places here, so that none can use up what another needs.
//!
//! A connection for which there is no ordinary place gets one in the reserve. There it is served nothing but the stop,
//! and not for long. When the reserve is full, too, the newcomer takes the place of a connection of the address that
//! has most there: whoever fills the reserve is who loses by it. Of these one that has just gone through with its
//! handshake is spared before the others, and one that carries out a stop before all.

use std::cmp::Reverse;
use std::collections::{HashMap, VecDeque};
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

/// Places in the reserve: so many that a flood of hundreds a second leaves a stop the time for its handshake.
pub const RESERVE: usize = 128;
/// Connections that have lost their places and may still be open while others are accepted.
const MOST_LEAVING: usize = 16;
/// How long a connection that has gone through with its handshake is spared: its request comes within that.
const SPARED: Duration = Duration::from_secs(1);

/// The places there are.
pub(super) struct Slots {
    connections: usize,
    per_address: usize,
    taken: Mutex<Taken>,
    /// Woken when one that was evicted has been closed.
    left: Notify,
}

#[derive(Default)]
struct Taken {
    ordinary: usize,
    by_address: HashMap<IpAddr, usize>,
    /// Oldest first.
    reserve: VecDeque<Reserved>,
    /// Evicted, and not yet closed.
    leaving: usize,
    next: u64,
}

struct Reserved {
    number: u64,
    address: IpAddr,
    evicted: CancellationToken,
    spared_until: Option<Instant>,
    stops: bool,
}

/// A connection's hold on its place in the reserve.
#[derive(Clone)]
pub(super) struct Reservation {
    slots: Arc<Slots>,
    number: u64,
    evicted: CancellationToken,
}

impl Reservation {
    /// Cancelled when the place is needed for another.
    pub(super) fn evicted(&self) -> &CancellationToken {
        &self.evicted
    }

    /// Says that the handshake is over.
    pub(super) fn shook_hands(&self) {
        self.change(|reserved| reserved.spared_until = Some(Instant::now() + SPARED));
    }

    /// Says that a stop is being carried out.
    pub(super) fn stops(&self) {
        self.change(|reserved| reserved.stops = true);
    }

    fn change(&self, change: impl FnOnce(&mut Reserved)) {
        let mut taken = self.slots.taken();
        if let Some(reserved) = taken.reserve.iter_mut().find(|reserved| reserved.number == self.number) {
            change(reserved);
        }
    }
}

/// A connection's place, given back when this is dropped.
pub(super) struct Slot {
    slots: Arc<Slots>,
    address: IpAddr,
    /// Its number, if it is in the reserve.
    reserved: Option<u64>,
}

/// Which kind of place a connection has got.
pub(super) enum Place {
    /// One for everything.
    Ordinary(Slot),
    /// One for the stop.
    Reserve(Slot, Reservation),
}

impl Slots {
    pub(super) fn new(connections: usize, per_address: usize) -> Self {
        Self { connections, per_address, taken: Mutex::default(), left: Notify::new() }
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until few enough of those evicted are still open: a flood must not take more descriptors than there are
    /// places.
    pub(super) async fn few_leaving(&self) {
        loop {
            let left = self.left.notified();
            if self.taken().leaving <= MOST_LEAVING {
                return;
            }
            left.await;
        }
    }

    /// A place for a connection of an address. There always is one.
    pub(super) fn take(self: &Arc<Self>, address: IpAddr) -> Place {
        let address = neighbourhood(address);
        let mut taken = self.taken();
        let of_address = taken.by_address.get(&address).copied().unwrap_or(0);
        if taken.ordinary < self.connections && of_address < self.per_address {
            taken.ordinary += 1;
            *taken.by_address.entry(address).or_default() += 1;
            return Place::Ordinary(Slot { slots: Arc::clone(self), address, reserved: None });
        }
        if taken.reserve.len() >= RESERVE {
            taken.evict();
        }
        taken.next += 1;
        let (number, evicted) = (taken.next, CancellationToken::new());
        let reserved = Reserved { number, address, evicted: evicted.clone(), spared_until: None, stops: false };
        taken.reserve.push_back(reserved);
        let slot = Slot { slots: Arc::clone(self), address, reserved: Some(number) };
        Place::Reserve(slot, Reservation { slots: Arc::clone(self), number, evicted })
    }
}

impl Taken {
    /// Takes a place from whoever has most in the reserve.
    fn evict(&mut self) {
        let now = Instant::now();
        let mut counts: HashMap<IpAddr, usize> = HashMap::new();
        for reserved in &self.reserve {
            *counts.entry(reserved.address).or_default() += 1;
        }
        let rank = |reserved: &Reserved| {
            let spared = reserved.spared_until.is_some_and(|until| now < until);
            let count = counts.get(&reserved.address).copied().unwrap_or(0);
            (reserved.stops, Reverse(count), spared, reserved.number)
        };
        let victim = self.reserve.iter().enumerate().min_by_key(|(_, reserved)| rank(reserved)).map(|(index, _)| index);
        if let Some(reserved) = victim.and_then(|index| self.reserve.remove(index)) {
            self.leaving += 1;
            reserved.evicted.cancel();
        }
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut taken = self.slots.taken();
        match self.reserved {
            Some(number) => match taken.reserve.iter().position(|reserved| reserved.number == number) {
                Some(index) => drop(taken.reserve.remove(index)),
                // It has been evicted.
                None => {
                    taken.leaving = taken.leaving.saturating_sub(1);
                    self.slots.left.notify_waiters();
                }
            },
            None => {
                taken.ordinary = taken.ordinary.saturating_sub(1);
                if let Some(count) = taken.by_address.get_mut(&self.address) {
                    *count = count.saturating_sub(1);
                    if *count == 0 {
                        taken.by_address.remove(&self.address);
                    }
                }
            }
        }
    }
}

/// What counts as one address: an IPv6 host has a whole /64 to itself.
fn neighbourhood(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from(u128::from(address) & !u128::from(u64::MAX)).into(),
        address => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    fn reservation(place: &Place) -> Reservation {
        match place {
            Place::Reserve(_, reservation) => reservation.clone(),
            Place::Ordinary(_) => panic!("there is no ordinary place"),
        }
    }

    #[test]
    fn who_has_shaken_hands_is_spared_before_the_others_and_a_stop_before_all() {
        let slots = Arc::new(Slots::new(0, 0));
        let flood: Vec<Place> = (0..RESERVE).map(|_| slots.take(address(2))).collect();
        reservation(&flood[0]).shook_hands();
        reservation(&flood[1]).stops();
        let more: Vec<Place> = (0..RESERVE - 2).map(|_| slots.take(address(2))).collect();
        let gone = |place: &Place| reservation(place).evicted.is_cancelled();
        assert!(!gone(&flood[0]) && !gone(&flood[1]) && flood[2..].iter().all(gone));
        reservation(&flood[0]).change(|reserved| reserved.spared_until = Some(Instant::now()));
        let _one_more = slots.take(address(2));
        assert!(gone(&flood[0]) && !gone(&flood[1]) && !more.iter().any(gone));
    }

    fn is_ordinary(place: &Place) -> bool {
        matches!(place, Place::Ordinary(_))
    }

    #[test]
    fn places_are_bounded_overall_and_for_each_address_and_come_free_again() {
        let slots = Arc::new(Slots::new(3, 2));
        let one = slots.take(address(1));
        let two = slots.take(address(1));
        assert!(is_ordinary(&one) && is_ordinary(&two));
        assert!(!is_ordinary(&slots.take(address(1))));
        let three = slots.take(address(2));
        assert!(is_ordinary(&three));
        assert!(!is_ordinary(&slots.take(address(3))));
        drop(one);
        assert!(is_ordinary(&slots.take(address(3))));
        drop((two, three));
        assert!(slots.taken().by_address.is_empty() && slots.taken().ordinary == 0);
        assert!(slots.taken().reserve.is_empty());
    }

    #[test]
    fn a_full_reserve_gives_way_at_the_cost_of_who_fills_it() {
        let slots = Arc::new(Slots::new(0, 0));
        let token = |place: &Place| reservation(place).evicted;
        let friend = slots.take(address(1));
        let flood: Vec<Place> = (1..RESERVE).map(|_| slots.take(address(2))).collect();
        assert!(!token(&friend).is_cancelled());
        let next = slots.take(address(2));
        assert!(!token(&friend).is_cancelled() && !token(&next).is_cancelled());
        assert!(token(&flood[0]).is_cancelled() && !token(&flood[1]).is_cancelled());
        assert_eq!(slots.taken().reserve.len(), RESERVE);
    }

    #[tokio::test]
    async fn no_more_are_accepted_until_those_evicted_are_closed() {
        let slots = Arc::new(Slots::new(0, 0));
        let mut flood: VecDeque<Place> = (0..RESERVE + MOST_LEAVING).map(|_| slots.take(address(2))).collect();
        slots.few_leaving().await;
        flood.push_back(slots.take(address(2)));
        let waiting = {
            let slots = Arc::clone(&slots);
            tokio::spawn(async move { slots.few_leaving().await })
        };
        tokio::task::yield_now().await;
        assert!(!waiting.is_finished());
        drop(flood.pop_front());
        waiting.await.unwrap();
        drop(flood);
        assert_eq!(slots.taken().leaving, 0);
    }

    #[test]
    fn an_ipv6_host_is_one_address_however_many_it_uses() {
        let slots = Arc::new(Slots::new(9, 1));
        let one = slots.take("2001:db8::1".parse().unwrap());
        assert!(!is_ordinary(&slots.take("2001:db8::ffff:1".parse().unwrap())));
        assert!(is_ordinary(&slots.take("2001:db8:0:1::1".parse().unwrap())));
        assert!(is_ordinary(&slots.take("::ffff:192.0.2.1".parse().unwrap())));
        drop(one);
    }
}
