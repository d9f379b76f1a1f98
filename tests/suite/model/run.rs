//! One sequence carried out on a daemon of its own, and judged after every step.

use std::path::Path;

use plenalign::device::AxisName;
use serde_json::Value;
use tokio::time::Instant;

use super::exchange::{Exchange, Mark};
use super::invariants::{ALL, Moment, View};
use super::known::Known;
use super::life::Life;
use super::requests::Who;
use super::rig::{Rig, Seen};
use super::steps::{By, Key, Sequence, Step, Wish};
use super::tally::Tally;

/// A promise that was not kept.
#[derive(Debug, Clone)]
pub(super) struct Broken {
    pub(super) name: &'static str,
    pub(super) told: String,
}

/// What came of a sequence.
pub(super) struct Outcome {
    pub(super) tally: Tally,
    pub(super) broken: Vec<Broken>,
}

/// A daemon, its bench, and what is known of both.
pub(super) struct Run {
    pub(super) rig: Rig,
    pub(super) state: tempfile::TempDir,
    pub(super) life: Option<Life>,
    pub(super) known: Known,
    /// What the daemon said of itself after the step before.
    pub(super) view: View,
    /// The bench as it was seen last, in the middle of a step, too.
    pub(super) bench: Value,
    /// How much of what was seen has been judged.
    judged: usize,
    /// Whether the daemon has started since it was judged last.
    pub(super) anew: bool,
    /// Whether it has since it was last judged with a history that could be read.
    pub(super) restarted: bool,
    pub(super) low: bool,
    pub(super) tally: Tally,
}

/// Carries a sequence out. Ends with the first step after which an invariant named by `counts` is broken.
pub(super) async fn run(sequence: &Sequence, counts: impl Fn(&str) -> bool, go_on: bool) -> Outcome {
    let mut run = Run::begin(sequence).await;
    let mut broken = Vec::new();
    broken.extend(run.judge(&[], None).await.into_iter().filter(|b| counts(b.name)));
    let steps = run.prelude(sequence).into_iter().map(|step| (None, step));
    let steps: Vec<_> = steps.chain(sequence.steps.iter().cloned().enumerate().map(|(n, s)| (Some(n), s))).collect();
    for (number, step) in &steps {
        let exchanges = run.perform(step).await;
        run.tally.steps += 1;
        let place = number.map_or_else(|| "before the first step".to_owned(), |number| format!("step {}", number + 1));
        let found = run.judge(&exchanges, None).await;
        broken.extend(
            found
                .into_iter()
                .filter(|b| counts(b.name))
                .map(|b| Broken { told: format!("{place}, {step:?}: {}", b.told), ..b }),
        );
        if !broken.is_empty() && !go_on {
            break;
        }
    }
    if broken.is_empty() || go_on {
        let files = run.files_with_a_key();
        let found = run.judge(&[], Some(&files)).await;
        broken.extend(found.into_iter().filter(|b| counts(b.name)));
    }
    run.tally.sequences = 1;
    run.tally.of_protocol[sequence.driver as usize] = 1;
    run.tally.orders = run.orders();
    if let Some(life) = run.life.take() {
        life.kill(false).await;
    }
    Outcome { tally: run.tally, broken }
}

/// A folder for the state; in memory where the system has one there, since how slow the disk is is not what is tried.
fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory).unwrap() } else { tempfile::tempdir().unwrap() }
}

impl Run {
    async fn begin(sequence: &Sequence) -> Self {
        let low = sequence.low;
        let (rig, state) = (Rig::new(1, low, sequence.driver), folder());
        let life = Life::start(&rig, &state.path().join("state")).await;
        let mut known = Known::new();
        known.secrets.extend(life.tokens.values().cloned());
        let at = Mark { index: rig.record.len(), at: Instant::now() };
        let view = View { at, bench: Value::Null, jobs: Vec::new(), audit: None };
        let tally = Tally::default();
        let mut run = Self {
            rig,
            state,
            life: Some(life),
            known,
            view,
            bench: Value::Null,
            judged: 0,
            anew: true,
            restarted: true,
            low,
            tally,
        };
        run.view = run.look().await;
        run.bench = run.view.bench.clone();
        run
    }

    /// What a sequence begins with where both axes are to be homed.
    fn prelude(&self, sequence: &Sequence) -> Vec<Step> {
        if !sequence.homed {
            return Vec::new();
        }
        let by = |wish| Step::Ask(By::Holder, wish);
        let mut steps = vec![Step::Ask(By::Other(Who::Cleo, Key::None), Wish::Take { ttl_s: 60 })];
        steps.extend(sequence.low.then(|| by(Wish::Shell("off"))));
        for axis in AxisName::ALL {
            steps.extend([by(Wish::Home(axis)), Step::Rest]);
        }
        steps.extend(sequence.low.then(|| by(Wish::Shell("on"))));
        steps
    }

    pub(super) fn life(&self) -> &Life {
        self.life.as_ref().unwrap()
    }

    pub(super) fn mark(&self) -> Mark {
        Mark { index: self.rig.record.len(), at: Instant::now() }
    }

    pub(super) fn in_motion(&self) -> bool {
        AxisName::ALL.into_iter().any(|axis| self.rig.record.moves(axis))
    }

    fn orders(&self) -> u64 {
        self.rig.record.since(0).iter().filter(|(_, seen)| matches!(seen, Seen::Order { .. })).count() as u64
    }

    pub(super) async fn look(&self) -> View {
        let audit = if self.known.unwritable { None } else { self.life().audit().await };
        let jobs = self.life().read("/api/v1/jobs?limit=20").await.body["jobs"].as_array().cloned().unwrap_or_default();
        let bench = self.life().read("/api/v1/bench").await.body;
        View { at: self.mark(), bench, jobs, audit }
    }

    /// The files of the history in which a lease's key stands, and a confirm key.
    fn files_with_a_key(&self) -> [Option<String>; 2] {
        let folder = if self.known.unwritable { self.state.path().join("away") } else { self.folder() };
        let leases: Vec<&str> = self.known.leases.iter().map(|lease| lease.key.as_str()).collect();
        let confirm: Vec<&str> = self.known.confirm_keys.iter().map(|known| known.key.as_str()).collect();
        [leases, confirm].map(|keys| {
            let holds =
                |bytes: &[u8]| keys.iter().any(|key| bytes.windows(key.len()).any(|window| window == key.as_bytes()));
            let files = std::fs::read_dir(&folder).ok()?.flatten();
            let named = files.filter(|file| file.file_name().to_string_lossy().starts_with("history.db"));
            let mut found = named.filter(|file| std::fs::read(file.path()).is_ok_and(|bytes| holds(&bytes)));
            found.next().map(|file| file.file_name().to_string_lossy().into_owned())
        })
    }

    /// Checks every invariant on what the step has left, then takes that in.
    async fn judge(&mut self, exchanges: &[Exchange], on_disk: Option<&[Option<String>; 2]>) -> Vec<Broken> {
        let after = self.look().await;
        self.known.pass(after.at);
        let seen = self.rig.record.since(self.judged)[..after.at.index - self.judged].to_vec();
        let strays = self.known.strays(self.judged, &seen);
        let moment = Moment {
            known: &self.known,
            exchanges,
            seen: &seen,
            strays: &strays,
            before: &self.view,
            after: &after,
            anew: std::mem::take(&mut self.anew),
            restarted: self.restarted && !self.known.unwritable,
            driver: self.rig.driver,
            low: self.low,
            places_mm: AxisName::ALL.map(|axis| self.rig.place_mm(axis)),
            lease_key_on_disk: on_disk.and_then(|[lease, _]| lease.as_deref()),
            confirm_key_on_disk: on_disk.and_then(|[_, confirm]| confirm.as_deref()),
        };
        let mut broken = Vec::new();
        for invariant in ALL {
            self.tally.checks += 1;
            broken.extend((invariant.broken)(&moment).map(|told| Broken { name: invariant.name, told }));
        }
        self.restarted &= self.known.unwritable;
        self.known.absorb(&after.bench, &after.jobs, after.at, self.view.at);
        self.judged = after.at.index;
        self.bench = after.bench.clone();
        self.view = after;
        broken
    }
}
