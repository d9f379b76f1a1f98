//! How a step is played: who asks for what, and what is learnt from the answers.

use std::time::Duration;

use plenalign::device::AxisName;
use serde_json::Value;
use tokio::time::Instant;

use super::super::until::elapse;
use super::exchange::{Exchange, Mark, OfJob};
use super::requests::{Ask, Shown, Who};
use super::rig::{Seen, Trouble};
use super::run::Run;
use super::steps::{By, Key, Press, Step, Wish};

/// Between two requests of a jog that is held.
const HELD_EVERY: Duration = Duration::from_millis(100);

impl Run {
    /// Carries a step out; what it asked, and was answered.
    pub(super) async fn perform(&mut self, step: &Step) -> Vec<Exchange> {
        match step {
            Step::Ask(by, wish) => {
                let needs =
                    matches!(wish, Wish::Move(..) | Wish::Home(_) | Wish::Jog(..) | Wish::Job(_) | Wish::Shell(_));
                let mut all = if *by == By::Holder && needs { self.have_lease(3).await } else { Vec::new() };
                all.extend(self.ask(*by, wish).await);
                all
            }
            Step::Both((one_by, one), (two_by, two), ms) => {
                let (one, two) = (self.resolve(*one_by, one).await, self.resolve(*two_by, two).await);
                let (Some(one), Some(two)) = (one, two) else { return Vec::new() };
                self.tally.at_once += 2;
                let later = Duration::from_millis((*ms).into());
                let (one, two) = tokio::join!(
                    self.exchange(one.0, one.1, one.2, false, Duration::ZERO),
                    self.exchange(two.0, two.1, two.2, false, later)
                );
                self.learn(vec![one, two])
            }
            Step::During { axis, share, ms, then } => {
                let mut all = self.have_lease(if *share % 2 == 0 { 2 } else { 60 }).await;
                all.extend(self.ask(By::Holder, &Wish::Move(*axis, *share)).await);
                elapse(Duration::from_millis((*ms).into())).await;
                all.extend(self.ask(then.0, &then.1).await);
                all
            }
            Step::Fall { axis, share, ms, kill } => {
                let mut all = self.have_lease(60).await;
                all.extend(self.ask(By::Holder, &Wish::Move(*axis, *share)).await);
                elapse(Duration::from_millis((*ms).into())).await;
                self.restart(*kill).await;
                all
            }
            Step::Outlast { axis } => self.outlast(*axis).await,
            Step::DuringJob { kind, by, renewed, ms, then } => {
                let mut all = self.have_lease(2).await;
                all.extend(self.ask(By::Holder, &Wish::Job(*kind)).await);
                if *renewed {
                    self.bench = self.life().read("/api/v1/bench").await.body;
                    all.extend(self.ask(By::Other(Who::Root, Key::None), &Wish::NewKey).await);
                }
                all.extend(self.confirm_all(*by).await);
                elapse(Duration::from_millis((*ms).into())).await;
                all.extend(self.ask(then.0, &then.1).await);
                all
            }
            Step::GiveBack { kind, ms } => {
                let mut all = self.have_lease(60).await;
                for wish in [Wish::Job(*kind), Wish::Release, Wish::Renew, Wish::Cancel] {
                    all.extend(self.ask(By::Holder, &wish).await);
                    elapse(Duration::from_millis((*ms).into())).await;
                    self.bench = self.life().read("/api/v1/bench").await.body;
                }
                all
            }
            Step::Presses { axis, towards, ms } => {
                let mut all = self.have_lease(60).await;
                for press in [Press::Fresh, Press::Fresh, Press::Former] {
                    all.extend(self.ask(By::Holder, &Wish::Jog(*axis, towards, press)).await);
                    elapse(Duration::from_millis((*ms).into())).await;
                }
                all
            }
            Step::Ready { ttl_s } => self.ready(*ttl_s).await,
            Step::Hold { .. } => self.hold_jog(step).await,
            Step::Wait { ms } => {
                elapse(Duration::from_millis((*ms).into())).await;
                Vec::new()
            }
            Step::Expire => {
                self.expire().await;
                Vec::new()
            }
            Step::Rest => {
                self.rest().await;
                Vec::new()
            }
            Step::Connect(by) => {
                self.connect(*by).await;
                Vec::new()
            }
            Step::HangUp => {
                let before = self.mark();
                if self.life.as_mut().unwrap().hang_up().await > 0 {
                    // The daemon hears of it at once.
                    elapse(Duration::from_millis(20)).await;
                    let now = self.mark();
                    self.known.hung_up(before, now);
                }
                Vec::new()
            }
            Step::Trouble(trouble) => {
                self.trouble(*trouble);
                Vec::new()
            }
            Step::FillDisk | Step::FreeDisk => {
                self.fill_disk(*step == Step::FillDisk).await;
                Vec::new()
            }
            Step::Kill | Step::Restart => {
                self.restart(*step == Step::Kill).await;
                Vec::new()
            }
        }
    }

    pub(super) async fn exchange(&self, who: Who, shown: Shown, ask: Ask, alone: bool, later: Duration) -> Exchange {
        elapse(later).await;
        let sent = self.mark();
        let while_jogging = matches!(ask, Ask::Jog { axis, .. } if self.known.may_jog_on(axis));
        let of_job = match &ask {
            Ask::Confirm { job, .. } | Ask::NewKey { job } => self.known.of_job(job, &shown),
            _ => OfJob::default(),
        };
        let press_over = match &ask {
            Ask::Jog { axis, press: Some(name), .. } => self.known.is_press_over(*axis, name),
            _ => false,
        };
        let answer = self.life().ask(who, &shown, &ask).await;
        let while_latched = self.known.latched == Some(true) && alone;
        let (while_unwritable, answered) = (self.known.unwritable, self.mark());
        Exchange {
            who,
            ask,
            shown,
            sent,
            answered,
            answer,
            alone,
            while_latched,
            while_unwritable,
            while_jogging,
            of_job,
            press_over,
        }
    }

    /// Takes in what was answered, and counts it. What was in motion is told by what moved when it was asked.
    pub(super) fn learn(&mut self, exchanges: Vec<Exchange>) -> Vec<Exchange> {
        let now = self.mark();
        self.known.pass(now);
        for exchange in &exchanges {
            self.tally.requests += 1;
            let dead = exchange.of_job.replaced || exchange.of_job.ended && exchange.shown.confirm.is_some();
            self.tally.dead_confirm_keys += u64::from(dead);
            self.tally.presses_over += u64::from(exchange.press_over);
            if !exchange.answer.accepted() {
                self.tally.refusals += 1;
                continue;
            }
            let moving = self.moved_about(exchange.sent);
            match &exchange.ask {
                ask if ask.moves() => {
                    self.tally.commands += 1;
                    self.tally.jobs += u64::from(matches!(ask, Ask::Job(_)));
                }
                Ask::Stop => {
                    self.tally.stops += 1;
                    self.tally.stops_in_motion += u64::from(moving);
                }
                Ask::Reset { .. } => self.tally.resets += 1,
                Ask::Confirm { .. } => {
                    self.tally.confirmations += 1;
                    self.tally.by_confirm_key += u64::from(exchange.shown.lease.is_none());
                }
                Ask::NewKey { .. } => self.tally.new_confirm_keys += 1,
                Ask::Release => self.tally.releases_in_motion += u64::from(moving),
                Ask::TakeOver { .. } => self.tally.takeovers_in_motion += u64::from(moving),
                _ => {}
            }
        }
        self.known.take_in(&exchanges);
        exchanges
    }

    /// Whether an axis was moving at a moment.
    pub(super) fn moved_about(&self, mark: Mark) -> bool {
        let seen = self.rig.record.since(mark.index.saturating_sub(40));
        let near = Duration::from_millis(15);
        let moved = |(at, seen): &(Instant, Seen)| {
            matches!(seen, Seen::Moved { .. }) && *at + near >= mark.at && *at <= mark.at + near
        };
        seen.iter().any(moved)
    }

    /// Where nobody has the lease: somebody takes it, so that what comes next is not only refused.
    pub(super) async fn have_lease(&mut self, ttl_s: u8) -> Vec<Exchange> {
        let now = self.mark();
        self.known.pass(now);
        if self.known.lease().is_some() {
            return Vec::new();
        }
        self.ask(By::Other(Who::Cleo, Key::None), &Wish::Take { ttl_s }).await
    }

    pub(super) async fn ask(&mut self, by: By, wish: &Wish) -> Vec<Exchange> {
        let Some((who, key, ask)) = self.resolve(by, wish).await else { return Vec::new() };
        let exchange = self.exchange(who, key, ask, true, Duration::ZERO).await;
        self.learn(vec![exchange])
    }

    /// Confirms what a job that has just been started asks for, until it asks for nothing more or refuses.
    pub(super) async fn confirm_all(&mut self, by: By) -> Vec<Exchange> {
        let mut all = Vec::new();
        for _ in 0..3 {
            for _ in 0..40 {
                self.bench = self.life().read("/api/v1/bench").await.body;
                let Some(job) = self.bench["job"].as_str() else { return all };
                let job = self.life().read(&format!("/api/v1/jobs/{job}")).await;
                if job.body["state"] == "waiting_for_operator" {
                    break;
                }
                elapse(Duration::from_millis(250)).await;
            }
            let confirmed = self.ask(by, &Wish::Confirm { late: false, former: false }).await;
            let refused = confirmed.iter().all(|exchange| !exchange.answer.accepted());
            all.extend(confirmed);
            if refused {
                break;
            }
        }
        all
    }

    /// Puts everything right, by whoever may.
    pub(super) async fn ready(&mut self, ttl_s: u8) -> Vec<Exchange> {
        let root = By::Other(Who::Root, Key::None);
        if self.known.in_trouble(Instant::now()) {
            for trouble in [Trouble::PlugIn, Trouble::InTime] {
                self.trouble(trouble);
            }
        }
        self.fill_disk(false).await;
        let mut all = self.ask(root, &Wish::TakeOver { ttl_s: 60 }).await;
        all.extend(self.ask(root, &Wish::Reset { why: true }).await);
        // A controller that was gone comes back.
        for _ in 0..20 {
            self.bench = self.life().read("/api/v1/bench").await.body;
            let axes = self.bench["axes"].as_array().cloned().unwrap_or_default();
            if axes.iter().all(|axis| axis["connected"] == true) {
                break;
            }
            elapse(Duration::from_millis(500)).await;
        }
        if self.low {
            all.extend(self.ask(By::Holder, &Wish::Shell("off")).await);
        }
        for axis in AxisName::ALL {
            if self.of_axis(axis)["homed"] == false {
                all.extend(self.ask(By::Holder, &Wish::Home(axis)).await);
                self.rest().await;
            }
        }
        all.extend(self.ask(root, &Wish::TakeOver { ttl_s }).await);
        all
    }

    pub(super) fn of_axis(&self, axis: AxisName) -> &Value {
        let mut axes = self.bench["axes"].as_array().into_iter().flatten();
        axes.find(|found| found["axis"] == axis.name()).unwrap_or(&Value::Null)
    }

    pub(super) async fn hold_jog(&mut self, step: &Step) -> Vec<Exchange> {
        let Step::Hold { axis, towards, named, times, at, ms, then } = step else { return Vec::new() };
        let mut all = self.have_lease(3).await;
        for time in 0..*times {
            let press = match (named, time) {
                (false, _) => Press::None,
                (true, 0) => Press::Fresh,
                (true, _) => Press::Newest,
            };
            let Some(jog) = self.resolve(By::Holder, &Wish::Jog(*axis, towards, press)).await else { break };
            let other = if time == *at { self.resolve(then.0, &then.1).await } else { None };
            let alone = other.is_none();
            let jogged = async {
                let exchange = self.exchange(jog.0, jog.1, jog.2, alone, Duration::ZERO).await;
                elapse(HELD_EVERY).await;
                exchange
            };
            let others = async {
                let (who, key, ask) = other?;
                Some(self.exchange(who, key, ask, false, Duration::from_millis((*ms).into())).await)
            };
            let (jogged, other) = tokio::join!(jogged, others);
            let exchanges = [Some(jogged), other].into_iter().flatten().collect();
            all.extend(self.learn(exchanges));
        }
        all
    }

    /// Moves an axis from one end to the other under a short lease, which runs out on the way.
    pub(super) async fn outlast(&mut self, axis: AxisName) -> Vec<Exchange> {
        let mut all = self.ask(By::Other(Who::Root, Key::None), &Wish::TakeOver { ttl_s: 2 }).await;
        let limit = |name: &str| self.of_axis(axis)[name].as_f64().unwrap_or(0.0);
        let middle = (limit("low_limit_mm") + limit("high_limit_mm")) / 2.0;
        let at = self.rig.place_mm(axis);
        all.extend(self.ask(By::Holder, &Wish::Move(axis, if at < middle { 240 } else { 15 })).await);
        self.expire().await;
        all
    }
}
