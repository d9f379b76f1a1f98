//! Whom and what a step means: filled in from what is known when it is asked.

use plenalign::device::AxisName;

use super::known::ConfirmKey;
use super::leases::Lease;
use super::requests::{Ask, Shown, Who};
use super::run::Run;
use super::steps::{By, Confirm, Key, Press, Wish};

impl Run {
    /// Who shows which keys.
    fn shown(&self, by: By) -> (Who, Shown) {
        let held = self.known.lease();
        let key_of = |lease: Option<&Lease>| lease.map(|lease| lease.key.clone());
        let confirm_key = |which: &dyn Fn(&ConfirmKey) -> bool| {
            self.known.confirm_keys.iter().rev().find(|known| which(known)).map(|known| known.key.clone())
        };
        let newest_job = self.known.confirm_keys.last().map(|known| known.job.clone());
        let of_newest = |known: &ConfirmKey| Some(&known.job) == newest_job.as_ref();
        let newest = || confirm_key(&|_| true);
        let guess = |text: &str| Some(text.to_owned());
        let by_lease = |lease| Shown { lease, confirm: None };
        let by_confirm = |confirm| Shown { lease: None, confirm };
        match by {
            By::Holder => (held.map_or(Who::Cleo, |lease| lease.owner), by_lease(key_of(held))),
            By::Other(who, Key::Newest) => (who, by_lease(key_of(held))),
            By::Other(who, Key::Former) => (who, by_lease(key_of(self.known.former()))),
            By::Other(who, Key::Confirm) => (who, by_lease(newest())),
            By::Other(who, Key::Guess) => (who, by_lease(guess("0123456789abcdef0123456789abcdef"))),
            By::Other(who, Key::None) => (who, Shown::default()),
            By::Confirmer(who, Confirm::Newest) => (who, by_confirm(newest())),
            By::Confirmer(who, Confirm::Replaced) => {
                (who, by_confirm(confirm_key(&|known| of_newest(known) && known.replaced)))
            }
            By::Confirmer(who, Confirm::Former) => (who, by_confirm(confirm_key(&|known| !of_newest(known)))),
            By::Confirmer(who, Confirm::Lease) => (who, by_confirm(key_of(held))),
            By::Confirmer(who, Confirm::Guess) => (who, by_confirm(guess(&format!("confirm_{:064x}", 7)))),
        }
    }

    /// Which name a jog of an axis gives its press.
    fn press_name(&self, axis: AxisName, press: Press) -> Option<String> {
        let mut named = self.known.presses.iter().rev().filter(|known| known.axis == axis);
        match press {
            Press::None => None,
            Press::Fresh => Some(format!("press {}", self.known.presses.len())),
            Press::Newest => named.next().map(|known| known.name.clone()),
            Press::Former => named.nth(1).map(|known| known.name.clone()),
        }
    }

    /// Who asks for what, with which keys.
    pub(super) async fn resolve(&self, by: By, wish: &Wish) -> Option<(Who, Shown, Ask)> {
        let (who, shown) = self.shown(by);
        let current = || self.bench["job"].as_str().map(str::to_owned);
        let newest = || self.view.jobs.first()?["id"].as_str().map(str::to_owned);
        let ask = match wish {
            Wish::Move(axis, share) => Ask::Move { axis: *axis, mm: self.target_mm(*axis, *share) },
            Wish::Home(axis) => Ask::Home(*axis),
            Wish::Jog(axis, towards, press) => Ask::Jog { axis: *axis, towards, press: self.press_name(*axis, *press) },
            Wish::EndJog(axis) => Ask::EndJog(*axis),
            Wish::Shell(state) => Ask::Shell(state),
            Wish::Stop => Ask::Stop,
            Wish::Reset { why } => Ask::Reset { why: *why },
            Wish::Take { ttl_s } => Ask::Take { ttl_s: f64::from(*ttl_s) },
            Wish::Renew => Ask::Renew,
            Wish::Release => Ask::Release,
            Wish::TakeOver { ttl_s } => Ask::TakeOver { ttl_s: f64::from(*ttl_s) },
            Wish::Job(kind) => Ask::Job(*kind),
            Wish::Cancel => Ask::Cancel { job: current().or_else(newest)? },
            Wish::Confirm { late, former } => {
                let before = || self.view.jobs.get(1)?["id"].as_str().map(str::to_owned);
                let job = before().filter(|_| *former).or_else(current).or_else(newest)?;
                let asked = self.life().read(&format!("/api/v1/jobs/{job}")).await;
                let step = asked.body["operator_step"]["number"].as_u64().unwrap_or(1) + u64::from(*late);
                Ask::Confirm { job, step }
            }
            Wish::NewKey => Ask::NewKey { job: current().or_else(newest)? },
            Wish::ReadStop => Ask::ReadStop,
            Wish::ReadLease => Ask::ReadLease,
            Wish::ReadAudit => Ask::ReadAudit,
            Wish::ReadTokens => Ask::ReadTokens,
        };
        Some((who, shown, ask))
    }

    /// A place along an axis's travel, or a little beyond.
    pub(super) fn target_mm(&self, axis: AxisName, share: u8) -> f64 {
        let limit = |name: &str| self.of_axis(axis)[name].as_f64().unwrap_or(0.0);
        let (low, high) = (limit("low_limit_mm"), limit("high_limit_mm"));
        let target = low + (f64::from(share) / 255.0 * 1.06 - 0.03) * (high - low);
        (target * 1000.0).round() / 1000.0
    }
}
