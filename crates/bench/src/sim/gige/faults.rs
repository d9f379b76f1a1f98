//! What goes wrong with the camera, with what it sees, and with packets on their way.

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::device::faults::{CameraFaults, FaultPlan, FaultRange, Faults, Plannable, SceneFaults};

/// Most packets of which one goes wrong.
const ONE_IN: f64 = 1e6;

/// Everything that goes wrong at a time. By default nothing; what is not named goes right.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GigeFaults {
    /// The camera, as the simulated bench's can fail, too.
    pub camera: CameraFaults,
    /// What stands before it, likewise.
    pub scene: SceneFaults,
    /// What is between camera and program.
    pub link: LinkFaults,
}

/// What goes wrong between camera and program.
///
/// It is no part of the simulated bench's faults: those are the daemon's, whose camera sends no packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LinkFaults {
    /// One packet in so many is lost; 0 for none.
    pub lost_one_in: u32,
    /// One in so many comes after those that were sent later.
    pub late_one_in: u32,
    /// One in so many comes twice.
    pub doubled_one_in: u32,
    /// One in so many says that it is of another frame.
    pub misnumbered_one_in: u32,
    /// No frames come any more, while the camera answers as before.
    pub silent: bool,
    /// Nothing that is asked reaches the camera: its frames go on until it has missed its controller for too long.
    pub deaf: bool,
    /// Another program has control of the camera, and leaves its frames going.
    pub taken: Taken,
}

/// How another program has the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Taken {
    /// Not at all.
    #[default]
    No,
    /// It controls it, and others may look.
    Control,
    /// It has it for itself alone.
    Exclusive,
}

impl Plannable for GigeFaults {
    fn check(&self) -> Result<(), FaultRange> {
        self.seen().check()?;
        for (field, value) in [
            ("link.lost_one_in", self.link.lost_one_in),
            ("link.late_one_in", self.link.late_one_in),
            ("link.doubled_one_in", self.link.doubled_one_in),
            ("link.misnumbered_one_in", self.link.misnumbered_one_in),
        ] {
            let value = f64::from(value);
            if value > ONE_IN {
                return Err(FaultRange { field, value, low: 0.0, high: ONE_IN });
            }
        }
        Ok(())
    }
}

impl GigeFaults {
    /// What of them is seen in a picture.
    pub(super) fn seen(&self) -> Faults {
        Faults { camera: self.camera, scene: self.scene, ..Faults::default() }
    }
}

/// What is to go wrong with such a camera, and when: written as the simulated bench's plans are.
pub type GigeFaultPlan = FaultPlan<GigeFaults>;

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
    pub(super) fn sent(&mut self, packets: impl Iterator<Item = u32>, faults: &LinkFaults) -> Vec<Sending> {
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

    fn sent(faults: LinkFaults) -> Vec<Sending> {
        Chance::new(3).sent(0..10_000, &faults)
    }

    #[test]
    fn packets_go_wrong_as_often_as_they_are_told_to() {
        let good = sent(LinkFaults::default());
        assert!(good.iter().enumerate().all(|(n, &sending)| sending == Sending { packet: n as u32, misnumbered: 0 }));
        let lost = sent(LinkFaults { lost_one_in: 100, ..Default::default() });
        assert!((9850..9950).contains(&lost.len()), "{}", lost.len());
        let doubled = sent(LinkFaults { doubled_one_in: 100, ..Default::default() });
        assert!((10_050..10_150).contains(&doubled.len()), "{}", doubled.len());
        let late = sent(LinkFaults { late_one_in: 100, ..Default::default() });
        let overtaken = late.windows(2).filter(|pair| pair[0].packet > pair[1].packet).count();
        assert!(late.len() == 10_000 && (50..150).contains(&overtaken), "{overtaken}");
        let misnumbered = sent(LinkFaults { misnumbered_one_in: 100, ..Default::default() });
        let wrong = misnumbered.iter().filter(|sending| sending.misnumbered > 0).count();
        assert!((50..150).contains(&wrong), "{wrong}");
        assert_eq!(sent(LinkFaults { lost_one_in: 1, ..Default::default() }), []);
    }

    #[test]
    fn a_plan_is_written_as_the_benchs_and_takes_what_is_a_cameras() {
        let plan = r#"{"events": [
            {"at_s": 2, "lasts_s": 3, "faults": {"link": {"silent": true}, "camera": {"picture": "dark"}}},
            {"at_s": 4, "faults": {"link": {"lost_one_in": 200, "taken": "exclusive"}}}
        ]}"#;
        let plan: GigeFaultPlan = serde_json::from_str(plan).unwrap();
        assert_eq!(plan.check(), Ok(()));
        assert_eq!(plan.at(1.0), GigeFaults::default());
        let both = plan.at(4.5).link;
        assert_eq!((both.silent, both.lost_one_in, both.taken), (true, 200, Taken::Exclusive));
        assert_eq!(plan.at(5.0).link, LinkFaults { silent: false, ..both });
        let changes: Vec<f64> = std::iter::successors(plan.next_change(0.0), |&at| plan.next_change(at)).collect();
        assert_eq!(changes, [2.0, 4.0, 5.0]);
        let of_a_stage = r#"{"events": [{"at_s": 2, "faults": {"e": {"stalled": true}}}]}"#;
        let why = serde_json::from_str::<GigeFaultPlan>(of_a_stage).unwrap_err().to_string();
        assert!(why.contains("`e`, expected one of `camera`, `scene`, `link`"), "{why}");
        let rare = r#"{"events": [{"at_s": 2, "faults": {"link": {"late_one_in": 1000001}}}]}"#;
        let rare: GigeFaultPlan = serde_json::from_str(rare).unwrap();
        assert_eq!(rare.check().unwrap_err().field(), "events[0].faults.link.late_one_in");
    }
}
