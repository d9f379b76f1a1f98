//! What somebody who is not at the bench has to know: alerts that are on or off.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::Serialize;

use crate::control::events::BenchView;
use crate::device::AxisName;

/// Every alert.
pub const ALERTS: [&str; 6] =
    ["stop_latched", "camera_offline", "focus_offline", "e_offline", "history_unwritable", "disk_low"];

/// An alert as it is published.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Alert {
    pub(super) alert: &'static str,
    pub(super) active: bool,
    /// Since when it is on, or off; as far back as this run of the program knows.
    pub(super) since: Timestamp,
    /// What is wrong, in words; empty while nothing is.
    pub(super) detail: String,
}

/// What is wrong now, by alert. `disk_free` and `disk_kept` are in bytes: what is left, and what is to be left.
pub(super) fn wrong(bench: &BenchView, disk_free: Option<u64>, disk_kept: u64) -> BTreeMap<&'static str, String> {
    let mut wrong = BTreeMap::new();
    if bench.stop.latched {
        wrong.insert("stop_latched", "motion is refused until the stop is reset".to_owned());
    }
    if let Some(why) = bench.camera.absence() {
        wrong.insert("camera_offline", why.to_owned());
    }
    for axis in &bench.axes {
        let Some(why) = axis.absence() else { continue };
        let alert = match axis.axis {
            AxisName::Focus => "focus_offline",
            AxisName::E => "e_offline",
        };
        wrong.insert(alert, why.to_owned());
    }
    if let Some(why) = &bench.history_fault {
        wrong.insert("history_unwritable", why.clone());
    }
    if let Some(free) = disk_free.filter(|free| *free < disk_kept) {
        let (free, kept) = (free >> 20, disk_kept >> 20);
        wrong.insert("disk_low", format!("{free} MB are free, and record.keep_free_mb is {kept}: nothing is recorded"));
    }
    wrong
}

/// What is known of every alert.
#[derive(Default)]
pub(super) struct Alerts(BTreeMap<&'static str, Alert>);

impl Alerts {
    /// The alerts that are otherwise than before: at first all of them.
    pub(super) fn update(&mut self, now: Timestamp, mut wrong: BTreeMap<&'static str, String>) -> Vec<Alert> {
        let mut changed = Vec::new();
        for alert in ALERTS {
            let detail = wrong.remove(alert);
            let before = self.0.get(alert);
            let active = detail.is_some();
            if before.is_some_and(|before| before.active == active) {
                continue;
            }
            let alert = Alert { alert, active, since: now, detail: detail.unwrap_or_default() };
            self.0.insert(alert.alert, alert.clone());
            changed.push(alert);
        }
        if !wrong.is_empty() {
            tracing::error!(?wrong, "alerts that are not among all");
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alert_is_told_when_it_goes_on_and_off() {
        let mut alerts = Alerts::default();
        let at = |s| Timestamp::from_second(s).unwrap();
        let first = alerts.update(at(1), BTreeMap::new());
        assert_eq!(first.iter().map(|alert| alert.alert).collect::<Vec<_>>(), ALERTS);
        assert!(first.iter().all(|alert| !alert.active && alert.detail.is_empty()));
        let wrong = || BTreeMap::from([("camera_offline", "unplugged".to_owned())]);
        let on = alerts.update(at(2), wrong());
        let said = Alert { alert: "camera_offline", active: true, since: at(2), detail: "unplugged".to_owned() };
        assert_eq!(on, [said]);
        assert_eq!(alerts.update(at(3), wrong()), []);
        let off = alerts.update(at(4), BTreeMap::new());
        assert_eq!((off.len(), off[0].active, off[0].since), (1, false, at(4)));
    }
}
