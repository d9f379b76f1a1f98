//! What a sequence is made of, and how it is drawn.

use clap::ValueEnum as _;
use plenalign::config::ControllerDriver;
use plenalign::device::AxisName;
use proptest::prelude::*;

use super::requests::{Kind, Who};
use super::rig::Trouble;

/// Who asks, and with which key: told by what is known when it is asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum By {
    /// Whoever has the lease, with its key.
    Holder,
    /// Somebody, with a key.
    Other(Who, Key),
    /// Somebody with what they take for a confirm key, and with no lease.
    Confirmer(Who, Confirm),
}

/// Which key is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Key {
    /// That of the lease in force.
    Newest,
    /// That of the lease before.
    Former,
    /// The newest confirm key: another kind of key.
    Confirm,
    Guess,
    None,
}

/// Which confirm key is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Confirm {
    /// The newest.
    Newest,
    /// One of the newest job's that another has replaced.
    Replaced,
    /// That of the job before.
    Former,
    /// The key of the lease in force: another kind of key.
    Lease,
    Guess,
}

/// Which name a jog gives its press of the button.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Press {
    None,
    Fresh,
    /// The newest of its axis.
    Newest,
    /// One before the newest.
    Former,
}

/// What is asked for; what depends on the bench's state is filled in when it is asked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Wish {
    /// To a share of the axis's travel, a little beyond it at both ends.
    Move(AxisName, u8),
    Home(AxisName),
    Jog(AxisName, &'static str, Press),
    EndJog(AxisName),
    Shell(&'static str),
    Stop,
    Reset {
        why: bool,
    },
    Take {
        ttl_s: u8,
    },
    Renew,
    Release,
    TakeOver {
        ttl_s: u8,
    },
    Job(Kind),
    Cancel,
    /// Of the step that is asked for, or of the one after; of the job before, or of the newest.
    Confirm {
        late: bool,
        former: bool,
    },
    /// Another confirm key.
    NewKey,
    ReadStop,
    ReadLease,
    ReadAudit,
    ReadTokens,
}

/// One step of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Ask(By, Wish),
    /// Two requests at a time, the second so many ms after the first.
    Both((By, Wish), (By, Wish), u8),
    /// A jog asked for again and again, every 100 ms, whatever is answered; something else so many ms after one of them.
    Hold {
        axis: AxisName,
        towards: &'static str,
        named: bool,
        times: u8,
        at: u8,
        ms: u8,
        then: (By, Wish),
    },
    Wait {
        ms: u16,
    },
    /// A move by the holder, and something else while the axis is on its way.
    During {
        axis: AxisName,
        share: u8,
        ms: u16,
        then: (By, Wish),
    },
    /// A job by the holder, whose confirm key is replaced or not, each of its steps confirmed by somebody as it comes, and
    /// something else so many ms later.
    DuringJob {
        kind: Kind,
        by: By,
        renewed: bool,
        ms: u16,
        then: (By, Wish),
    },
    /// The lease given back under a job, a heartbeat so many ms later all the same, and the job's end.
    GiveBack {
        kind: Kind,
        ms: u16,
    },
    /// A press of a jog's button, another one so many ms later, and a late word of the first.
    Presses {
        axis: AxisName,
        towards: &'static str,
        ms: u16,
    },
    /// A move by the holder, and the end of the daemon meanwhile, orderly or not.
    Fall {
        axis: AxisName,
        share: u8,
        ms: u16,
        kill: bool,
    },
    /// A move from one end of the axis to the other under a lease that runs out meanwhile.
    Outlast {
        axis: AxisName,
    },
    /// Everything is put right: nothing in the way, the stop reset, both axes homed, a lease with this time to live.
    Ready {
        ttl_s: u8,
    },
    /// Until the lease in force has run out, where it can.
    Expire,
    /// Until no axis moves.
    Rest,
    Connect(By),
    HangUp,
    Trouble(Trouble),
    FillDisk,
    FreeDisk,
    Kill,
    Restart,
}

/// A whole sequence.
#[derive(Debug, Clone)]
pub(super) struct Sequence {
    pub(super) driver: ControllerDriver,
    /// Whether e homes towards the shell.
    pub(super) low: bool,
    /// Whether both axes are homed under a lease before it begins.
    pub(super) homed: bool,
    pub(super) steps: Vec<Step>,
}

fn axis() -> impl Strategy<Value = AxisName> {
    prop_oneof![2 => Just(AxisName::E), 1 => Just(AxisName::Focus)]
}

fn by() -> impl Strategy<Value = By> {
    let key = prop_oneof![
        3 => Just(Key::Former), 2 => Just(Key::None), 1 => Just(Key::Guess), 2 => Just(Key::Newest),
        1 => Just(Key::Confirm),
    ];
    prop_oneof![
        16 => Just(By::Holder),
        1 => confirmer(),
        4 => (prop::sample::select(&Who::ALL[..]), key).prop_map(|(who, key)| By::Other(who, key)),
    ]
}

/// Whoever stands at the bench with a confirm key, the right one as a rule.
fn confirmer() -> impl Strategy<Value = By> {
    let key = prop_oneof![
        6 => Just(Confirm::Newest), 2 => Just(Confirm::Replaced), 2 => Just(Confirm::Former), 1 => Just(Confirm::Lease),
        1 => Just(Confirm::Guess),
    ];
    let who = prop_oneof![6 => Just(Who::Carl), 2 => Just(Who::Cleo), 1 => Just(Who::Vera), 1 => Just(Who::Nobody)];
    (who, key).prop_map(|(who, key)| By::Confirmer(who, key))
}

/// Somebody who may, as a rule.
fn anybody() -> impl Strategy<Value = By> {
    let who = prop_oneof![
        5 => Just(Who::Cleo), 5 => Just(Who::Carl), 5 => Just(Who::Root), 2 => Just(Who::Vera),
        1 => Just(Who::Guesser), 1 => Just(Who::Nobody),
    ];
    who.prop_map(|who| By::Other(who, Key::None))
}

fn towards() -> impl Strategy<Value = &'static str> {
    prop_oneof![Just("low"), Just("high")]
}

fn ttl() -> impl Strategy<Value = u8> {
    prop_oneof![4 => 2u8..5, 2 => 5u8..15, 2 => Just(60u8)]
}

fn kind() -> impl Strategy<Value = Kind> {
    prop_oneof![
        2 => Just(Kind::HomeBoth),
        2 => axis().prop_map(Kind::HomeOne),
        4 => axis().prop_map(Kind::Sweep),
        1 => Just(Kind::Alignment),
    ]
}

/// What is asked while something moves.
fn meanwhile() -> impl Strategy<Value = (By, Wish)> {
    prop_oneof![
        3 => (anybody(), Just(Wish::Stop)),
        2 => (Just(By::Holder), Just(Wish::Release)),
        2 => (Just(By::Other(Who::Root, Key::None)), ttl().prop_map(|ttl_s| Wish::TakeOver { ttl_s })),
        1 => (Just(By::Holder), Just(Wish::Cancel)),
        3 => asked(),
    ]
}

/// As a rule of what is asked for now.
fn confirm() -> impl Strategy<Value = Wish> {
    let rarely = || prop_oneof![6 => Just(false), 1 => Just(true)];
    (rarely(), rarely()).prop_map(|(late, former)| Wish::Confirm { late, former })
}

fn press() -> impl Strategy<Value = Press> {
    prop_oneof![4 => Just(Press::None), 2 => Just(Press::Fresh), 2 => Just(Press::Newest), 1 => Just(Press::Former)]
}

/// A wish and who may have it, drawn as often as it teaches something.
fn asked() -> impl Strategy<Value = (By, Wish)> {
    prop_oneof![
        12 => (by(), (axis(), any::<u8>()).prop_map(|(axis, share)| Wish::Move(axis, share))),
        6 => (by(), axis().prop_map(Wish::Home)),
        5 => (by(), (axis(), towards(), press()).prop_map(|(axis, towards, press)| Wish::Jog(axis, towards, press))),
        1 => (by(), axis().prop_map(Wish::EndJog)),
        2 => (by(), prop_oneof![Just("off"), Just("on"), Just("unknown")].prop_map(Wish::Shell)),
        6 => (anybody(), Just(Wish::Stop)),
        7 => (anybody(), prop_oneof![5 => Just(true), 1 => Just(false)].prop_map(|why| Wish::Reset { why })),
        9 => (anybody(), ttl().prop_map(|ttl_s| Wish::Take { ttl_s })),
        2 => (by(), Just(Wish::Renew)),
        3 => (by(), Just(Wish::Release)),
        3 => (anybody(), ttl().prop_map(|ttl_s| Wish::TakeOver { ttl_s })),
        7 => (by(), kind().prop_map(Wish::Job)),
        2 => (by(), Just(Wish::Cancel)),
        5 => (by(), confirm()),
        4 => (confirmer(), confirm()),
        2 => (prop_oneof![3 => by(), 2 => Just(By::Other(Who::Root, Key::None))], Just(Wish::NewKey)),
        1 => (anybody(), prop_oneof![
            Just(Wish::ReadStop), Just(Wish::ReadLease), Just(Wish::ReadAudit), Just(Wish::ReadTokens)
        ]),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    let trouble = prop_oneof![
        2 => Just(Trouble::Unplug), 4 => Just(Trouble::PlugIn), 2 => Just(Trouble::PowerCycle),
        1 => (5u16..150).prop_map(Trouble::Late), 2 => Just(Trouble::InTime),
    ];
    let during = (axis(), any::<u8>(), 1u16..1500, meanwhile());
    let during_job = (kind(), prop_oneof![by(), confirmer()], any::<bool>(), 1u16..6000, meanwhile());
    let fall = (axis(), any::<u8>(), 1u16..1500, any::<bool>());
    let hold = (axis(), towards(), any::<bool>(), 2u8..10, (0u8..8, 0u8..100), meanwhile());
    let held = |(axis, towards, named, times, (at, ms), then)| Step::Hold { axis, towards, named, times, at, ms, then };
    prop_oneof![
        26 => asked().prop_map(|(by, wish)| Step::Ask(by, wish)),
        6 => (asked(), asked(), 0u8..4).prop_map(|(one, two, ms)| Step::Both(one, two, ms)),
        14 => during.prop_map(|(axis, share, ms, then)| Step::During { axis, share, ms, then }),
        7 => during_job.prop_map(|(kind, by, renewed, ms, then)| Step::DuringJob { kind, by, renewed, ms, then }),
        2 => (kind(), 1u16..500).prop_map(|(kind, ms)| Step::GiveBack { kind, ms }),
        2 => (axis(), towards(), 1u16..500).prop_map(|(axis, towards, ms)| Step::Presses { axis, towards, ms }),
        3 => axis().prop_map(|axis| Step::Outlast { axis }),
        2 => fall.prop_map(|(axis, share, ms, kill)| Step::Fall { axis, share, ms, kill }),
        7 => ttl().prop_map(|ttl_s| Step::Ready { ttl_s }),
        6 => hold.prop_map(held),
        7 => prop_oneof![3 => 1u16..300, 1 => 300u16..3000].prop_map(|ms| Step::Wait { ms }),
        2 => Just(Step::Expire),
        2 => Just(Step::Rest),
        2 => by().prop_map(Step::Connect),
        1 => Just(Step::HangUp),
        2 => trouble.prop_map(Step::Trouble),
        1 => Just(Step::FillDisk),
        2 => Just(Step::FreeDisk),
        1 => Just(Step::Kill),
        1 => Just(Step::Restart),
    ]
}

/// A sequence of so many steps at most.
pub(super) fn sequence(most: usize) -> impl Strategy<Value = Sequence> {
    let driver = prop::sample::select(ControllerDriver::value_variants());
    let low = prop_oneof![3 => Just(false), 1 => Just(true)];
    let homed = prop_oneof![4 => Just(true), 1 => Just(false)];
    let steps = prop::collection::vec(step(), 1..=most);
    (driver, low, homed, steps).prop_map(|(driver, low, homed, steps)| Sequence { driver, low, homed, steps })
}
