//! Plans of faults drawn from seeds, and by which words a job that ends for one of them names it.

use plenalign::device::faults::{FaultEvent, FaultPlan, Faults, PictureFault};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Within which a plan's faults begin, s: two whole alignments and the rest after each.
const PLAN_S: f64 = 90.0;
/// Faults that stay for good, of those that come.
const LASTING_SHARE: f64 = 0.05;

/// One thing that can go wrong, how it is drawn, and words by one of which a job that ends for it names it.
pub(super) struct Kind {
    pub(super) name: &'static str,
    /// How often it is drawn, beside the others.
    weight: u32,
    /// Longest that it lasts, s.
    longest_s: f64,
    draw: fn(&mut Pcg64, &mut Faults),
    pub(super) words: &'static [&'static str],
}

const LINE: &[&str] =
    &["controller", "serial", "answer", "connect", "homed", "position", "alarm", "reset", "stop", "motion"];
const MOTION: &[&str] = &[
    "does not move",
    "motion",
    "creeps",
    "wrong way",
    "picture shows",
    "moves",
    "settle",
    "not reached",
    "follow",
    "wall",
    "travel",
    "trimmed",
    "homing",
    "home switch",
    "tolerance",
    "e axis's zero",
    "contradict",
    "spacing",
];
const PICTURE: &[&str] = &[
    "blank",
    "dark",
    "saturated",
    "overexposed",
    "texture",
    "match",
    "white frame",
    "frame",
    "focus",
    "micro-image",
    "noise",
    "uncertain",
    "grid",
    "spacing",
    "picture",
    "board",
];

/// Everything that a plan is drawn from.
const KINDS: &[Kind] = &[
    Kind { name: "wire unplugged", weight: 1, longest_s: 6.0, draw: |_, f| f.serial.unplugged = true, words: LINE },
    Kind {
        name: "controller without power",
        weight: 1,
        longest_s: 4.0,
        draw: |_, f| f.serial.unpowered = true,
        words: LINE,
    },
    Kind {
        name: "late answers",
        weight: 5,
        longest_s: 20.0,
        draw: |r, f| f.serial.delay_ms = r.random_range(10..400),
        words: LINE,
    },
    Kind {
        name: "lost bytes",
        weight: 2,
        longest_s: 6.0,
        draw: |r, f| f.serial.lost_one_in = r.random_range(150..4000),
        words: LINE,
    },
    Kind {
        name: "garbled bytes",
        weight: 2,
        longest_s: 6.0,
        draw: |r, f| f.serial.garbled_one_in = r.random_range(150..4000),
        words: LINE,
    },
    Kind { name: "focus stalled", weight: 1, longest_s: 3.0, draw: |_, f| f.focus.stalled = true, words: MOTION },
    Kind { name: "e stalled", weight: 1, longest_s: 3.0, draw: |_, f| f.e.stalled = true, words: MOTION },
    Kind {
        name: "focus slips",
        weight: 2,
        longest_s: 5.0,
        draw: |r, f| f.focus.slip_share = r.random_range(0.01..0.4),
        words: MOTION,
    },
    Kind {
        name: "e slips",
        weight: 2,
        longest_s: 5.0,
        draw: |r, f| f.e.slip_share = r.random_range(0.01..0.4),
        words: MOTION,
    },
    Kind {
        name: "focus play",
        weight: 4,
        longest_s: 30.0,
        draw: |r, f| f.focus.backlash_growth_mm = r.random_range(0.0005..0.01),
        words: MOTION,
    },
    Kind {
        name: "e play",
        weight: 4,
        longest_s: 30.0,
        draw: |r, f| f.e.backlash_growth_mm = r.random_range(0.005..0.08),
        words: MOTION,
    },
    Kind {
        name: "focus creeps",
        weight: 3,
        longest_s: 10.0,
        draw: |r, f| f.focus.stops_late_ms = r.random_range(20..1000),
        words: MOTION,
    },
    Kind {
        name: "e creeps",
        weight: 3,
        longest_s: 10.0,
        draw: |r, f| f.e.stops_late_ms = r.random_range(20..1000),
        words: MOTION,
    },
    Kind {
        name: "focus limit",
        weight: 1,
        longest_s: 2.0,
        draw: |_, f| f.focus.limit_switch = true,
        words: &["limit", "alarm", "homed", "homing"],
    },
    Kind {
        name: "e limit",
        weight: 1,
        longest_s: 2.0,
        draw: |_, f| f.e.limit_switch = true,
        words: &["limit", "alarm", "homed", "homing"],
    },
    Kind {
        name: "camera unplugged",
        weight: 1,
        longest_s: 4.0,
        draw: |_, f| f.camera.unplugged = true,
        words: &["camera"],
    },
    Kind { name: "camera hangs", weight: 1, longest_s: 4.0, draw: |_, f| f.camera.frozen = true, words: &["camera"] },
    Kind {
        name: "dark",
        weight: 1,
        longest_s: 3.0,
        draw: |_, f| f.camera.picture = PictureFault::Dark,
        words: PICTURE,
    },
    Kind {
        name: "saturated",
        weight: 1,
        longest_s: 3.0,
        draw: |_, f| f.camera.picture = PictureFault::Saturated,
        words: PICTURE,
    },
    Kind {
        name: "blurred",
        weight: 1,
        longest_s: 3.0,
        draw: |_, f| f.camera.picture = PictureFault::Blurred,
        words: PICTURE,
    },
    Kind {
        name: "torn",
        weight: 1,
        longest_s: 3.0,
        draw: |_, f| f.camera.picture = PictureFault::Torn,
        words: PICTURE,
    },
    Kind {
        name: "bubbles",
        weight: 5,
        longest_s: 60.0,
        draw: |r, f| f.scene.bubbles = r.random_range(1..40),
        words: PICTURE,
    },
    Kind {
        name: "empty tank",
        weight: 1,
        longest_s: 40.0,
        draw: |_, f| f.scene.tank_empty = true,
        words: &["water", "tank", "shell", "spacing"],
    },
    Kind {
        name: "no shell",
        weight: 1,
        longest_s: 40.0,
        draw: |_, f| f.scene.no_shell = true,
        words: &["shell", "spacing"],
    },
    Kind {
        name: "another shell",
        weight: 1,
        longest_s: 60.0,
        draw: |r, f| f.scene.shell_radius_mm = r.random_range(-8.0..20.0),
        words: &["shell", "spacing"],
    },
    Kind {
        name: "board elsewhere",
        weight: 2,
        longest_s: 60.0,
        draw: |r, f| f.scene.board_displaced_mm = r.random_range(-60.0..300.0),
        words: &["board", "spacing", "trimmed", "wall", "picture shows", "focus", "match", "tolerance"],
    },
    Kind {
        name: "board turned",
        weight: 4,
        longest_s: 60.0,
        draw: |r, f| f.scene.board_turned_mrad = r.random_range(-150.0..150.0),
        words: PICTURE,
    },
    Kind { name: "full disk", weight: 1, longest_s: 3.0, draw: |_, f| f.disk.full = true, words: &["disk", "history"] },
    Kind {
        name: "slow disk",
        weight: 4,
        longest_s: 5.0,
        draw: |r, f| f.disk.delay_ms = r.random_range(1..8),
        words: &["disk", "history"],
    },
];

/// A plan, and what of [`KINDS`] its events are.
pub(super) fn plan_of(seed: u64) -> (FaultPlan, Vec<&'static Kind>) {
    let mut random = Pcg64::seed_from_u64(seed ^ 0x50a4_0000_0000_f417);
    let weights: u32 = KINDS.iter().map(|kind| kind.weight).sum();
    let mut kinds = Vec::new();
    let events = (0..random.random_range(20..38)).map(|_| {
        let mut left = random.random_range(0..weights);
        let kind = KINDS
            .iter()
            .find(|kind| {
                kind.weight > left || {
                    left -= kind.weight;
                    false
                }
            })
            .expect("the weights' sum is more than what is drawn");
        let mut faults = Faults::default();
        (kind.draw)(&mut random, &mut faults);
        kinds.push(kind);
        let lasts = random.random_range(0.02..kind.longest_s);
        FaultEvent {
            at_s: random.random_range(0.0..PLAN_S),
            lasts_s: (random.random::<f64>() >= LASTING_SHARE).then_some(lasts),
            faults,
        }
    });
    let events = events.collect();
    (FaultPlan { events }, kinds)
}
