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

/// What is wrong now, in words, in the order of [`ALERTS`]. `disk_free` and `disk_kept` are in bytes: what is left, and
/// what is to be left.
pub(super) fn wrong(bench: &BenchView, disk_free: Option<u64>, disk_kept: u64) -> [Option<String>; ALERTS.len()] {
    let absent = |name: AxisName| bench.axes.iter().find(|axis| axis.axis == name)?.absence().map(str::to_owned);
    let disk_low = disk_free.filter(|free| *free < disk_kept).map(|free| {
        let (free, kept) = (free >> 20, disk_kept >> 20);
        format!("{free} MB are free, and record.keep_free_mb is {kept}: nothing is recorded")
    });
    [
        bench.stop.latched.then(|| "motion is refused until the stop is reset".to_owned()),
        bench.camera.absence().map(str::to_owned),
        absent(AxisName::Focus),
        absent(AxisName::E),
        bench.history_fault.clone(),
        disk_low,
    ]
}

/// What is known of every alert.
#[derive(Default)]
pub(super) struct Alerts(BTreeMap<&'static str, Alert>);

impl Alerts {
    /// The alerts that are otherwise than before: at first all of them.
    pub(super) fn update(&mut self, now: Timestamp, wrong: [Option<String>; ALERTS.len()]) -> Vec<Alert> {
        let mut changed = Vec::new();
        for (alert, detail) in ALERTS.into_iter().zip(wrong) {
            let before = self.0.get(alert);
            let active = detail.is_some();
            if before.is_some_and(|before| before.active == active) {
                continue;
            }
            let alert = Alert { alert, active, since: now, detail: detail.unwrap_or_default() };
            self.0.insert(alert.alert, alert.clone());
            changed.push(alert);
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
        let none = || [const { None }; ALERTS.len()];
        let first = alerts.update(at(1), none());
        assert_eq!(first.iter().map(|alert| alert.alert).collect::<Vec<_>>(), ALERTS);
        assert!(first.iter().all(|alert| !alert.active && alert.detail.is_empty()));
        let wrong = || ALERTS.map(|alert| (alert == "camera_offline").then(|| "unplugged".to_owned()));
        let on = alerts.update(at(2), wrong());
        let said = Alert { alert: "camera_offline", active: true, since: at(2), detail: "unplugged".to_owned() };
        assert_eq!(on, [said]);
        assert_eq!(alerts.update(at(3), wrong()), []);
        let off = alerts.update(at(4), none());
        assert_eq!((off.len(), off[0].active, off[0].since), (1, false, at(4)));
    }
}
