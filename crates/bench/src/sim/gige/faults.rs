//! What goes wrong with packets on their way.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Packets that go wrong: one in so many, at random; 0 for none.
///
/// They are no part of the simulated bench's faults: those are the daemon's, whose camera sends no packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PacketFaults {
    /// Are lost.
    pub lost_one_in: u32,
    /// Come after those that were sent later.
    pub late_one_in: u32,
    /// Come twice.
    pub doubled_one_in: u32,
    /// Say that they are of another frame.
    pub misnumbered_one_in: u32,
}

/// A packet as it is to be sent: its number, and by how many its frame's number is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sending {
    pub(super) packet: u32,
    pub(super) misnumbered: u16,
}

/// How many packets overtake a late one.
const OVERTAKEN_BY: usize = 40;

/// Chance, which depends on its seed alone.
#[derive(Debug)]
pub(super) struct Chance(Pcg64);

impl Chance {
    pub(super) fn new(seed: u64) -> Self {
        Self(Pcg64::seed_from_u64(seed))
    }

    fn is(&mut self, one_in: u32) -> bool {
        one_in > 0 && self.0.random_range(0..one_in) == 0
    }

    /// These packets, as they arrive.
    pub(super) fn sent(&mut self, packets: impl Iterator<Item = u32>, faults: &PacketFaults) -> Vec<Sending> {
        let mut sent: Vec<(usize, Sending)> = Vec::new();
        for (order, packet) in packets.enumerate() {
            if self.is(faults.lost_one_in) {
                continue;
            }
            let place = if self.is(faults.late_one_in) { order + OVERTAKEN_BY } else { order };
            let misnumbered = if self.is(faults.misnumbered_one_in) { self.0.random_range(1..1000) } else { 0 };
            let sending = Sending { packet, misnumbered };
            sent.push((place, sending));
            if self.is(faults.doubled_one_in) {
                sent.push((place, sending));
            }
        }
        // Stable: of two at one place the earlier comes first.
        sent.sort_by_key(|&(place, _)| place);
        sent.into_iter().map(|(_, sending)| sending).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(faults: PacketFaults) -> Vec<Sending> {
        Chance::new(3).sent(0..10_000, &faults)
    }

    #[test]
    fn packets_go_wrong_as_often_as_they_are_told_to() {
        let good = sent(PacketFaults::default());
        assert!(good.iter().enumerate().all(|(n, &sending)| sending == Sending { packet: n as u32, misnumbered: 0 }));
        let lost = sent(PacketFaults { lost_one_in: 100, ..Default::default() });
        assert!((9850..9950).contains(&lost.len()), "{}", lost.len());
        let doubled = sent(PacketFaults { doubled_one_in: 100, ..Default::default() });
        assert!((10_050..10_150).contains(&doubled.len()), "{}", doubled.len());
        let late = sent(PacketFaults { late_one_in: 100, ..Default::default() });
        let overtaken = late.windows(2).filter(|pair| pair[0].packet > pair[1].packet).count();
        assert!(late.len() == 10_000 && (50..150).contains(&overtaken), "{overtaken}");
        let misnumbered = sent(PacketFaults { misnumbered_one_in: 100, ..Default::default() });
        let wrong = misnumbered.iter().filter(|sending| sending.misnumbered > 0).count();
        assert!((50..150).contains(&wrong), "{wrong}");
        assert_eq!(sent(PacketFaults { lost_one_in: 1, ..Default::default() }), []);
    }
}
