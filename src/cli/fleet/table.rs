//! What `plenalign fleet status` prints.

use std::fmt::Write as _;

use super::Status;
use super::ask::{AxisSeen, BenchSeen, CameraSeen, JobSeen, Seen, SpacingSeen};

const HEADS: [&str; 11] =
    ["NAME", "ADDRESS", "BENCH", "STATE", "STOP", "LEASE", "JOB", "SPACING", "CAMERA", "AXES", "VERSION"];
/// Longest text of a cell, characters.
const CELL: usize = 44;

/// The table, a row a daemon, and below it why one is not ready.
pub(super) fn text(status: &Status) -> String {
    let rows: Vec<[String; HEADS.len()]> = status.daemons.iter().map(row).collect();
    let heads = HEADS.map(str::to_owned);
    let widths: Vec<usize> = (0..HEADS.len())
        .map(|column| rows.iter().chain([&heads]).map(|row| row[column].chars().count()).max().unwrap_or(0))
        .collect();
    let mut out = String::new();
    for row in [&heads].into_iter().chain(&rows) {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        // Writing to a string does not fail.
        let _ = writeln!(out, "{}", cells.collect::<Vec<_>>().join("  ").trim_end());
    }
    for seen in &status.daemons {
        for reason in &seen.reasons {
            let _ = writeln!(out, "{}: {reason}", seen.name);
        }
    }
    let _ = writeln!(out, "{} of {} ready, {:.0}", status.ready, status.daemons.len(), status.at);
    out
}

fn row(seen: &Seen) -> [String; HEADS.len()] {
    let bench = |cell: fn(&BenchSeen) -> String| seen.bench.as_ref().map_or_else(|| "-".to_owned(), cell);
    [
        seen.name.clone(),
        seen.url.clone(),
        match seen.simulated {
            Some(true) => "SIMULATED".to_owned(),
            Some(false) => "real".to_owned(),
            None => "-".to_owned(),
        },
        seen.state.words().to_owned(),
        bench(|bench| if bench.stop_latched { "STOPPED" } else { "no" }.to_owned()),
        bench(|bench| bench.lease.as_deref().map_or_else(|| "free".to_owned(), short)),
        bench(|bench| bench.job.as_ref().map_or_else(|| "none".to_owned(), job)),
        bench(|bench| bench.spacing.as_ref().map_or_else(|| "none".to_owned(), spacing)),
        bench(|bench| camera(&bench.camera)),
        bench(|bench| axes(&bench.axes)),
        seen.version.clone().unwrap_or_else(|| "-".to_owned()),
    ]
}

fn short(text: &str) -> String {
    if text.chars().count() <= CELL {
        return text.to_owned();
    }
    text.chars().take(CELL - 1).chain(['…']).collect()
}

/// Such as `joint_alignment running 3/12: measuring`.
fn job(job: &JobSeen) -> String {
    let word = |value: serde_json::Result<serde_json::Value>| {
        value.ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
    };
    let (kind, state) = (word(serde_json::to_value(job.kind)), word(serde_json::to_value(job.state)));
    short(&format!("{kind} {state} {}/{}: {}", job.step, job.of, job.doing))
}

/// Such as `28.914 of 28.990 px, in focus`.
fn spacing(spacing: &SpacingSeen) -> String {
    let focus = if spacing.in_focus { ", in focus" } else { "" };
    format!("{:.3} of {:.3} px{focus}", spacing.spacing_px, spacing.target_px)
}

fn camera(camera: &CameraSeen) -> String {
    let what = match (camera.online, camera.replay) {
        (false, _) => return "OFFLINE".to_owned(),
        (true, true) => "replay",
        (true, false) => "online",
    };
    camera.frame_age_ms.map_or_else(|| what.to_owned(), |age| format!("{what}, {age:.0} ms"))
}

/// Such as `focus homed, e not homed`.
fn axes(axes: &[AxisSeen]) -> String {
    let axis = |axis: &AxisSeen| {
        let how = match (axis.connected, axis.homed) {
            (false, _) => "AWAY",
            (true, true) => "homed",
            (true, false) => "not homed",
        };
        format!("{} {how}", axis.axis)
    };
    axes.iter().map(axis).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::fleet::ask::State;
    use crate::control::job::{JobKind, JobState};
    use crate::device::AxisName;

    #[test]
    fn a_row_a_daemon_and_the_reasons_below() {
        let axis = |axis, connected, homed| AxisSeen { axis, connected, homed, moving: false, position_mm: None };
        let bench = BenchSeen {
            stop_latched: true,
            lease: Some("ana@lab (plenalign align), who has a very long name indeed".to_owned()),
            job: Some(JobSeen {
                id: uuid::Uuid::nil(),
                kind: JobKind::JointAlignment,
                state: JobState::Running,
                step: 3,
                of: 12,
                doing: "measuring".to_owned(),
            }),
            spacing: Some(SpacingSeen {
                spacing_px: 28.9137,
                spacing_sigma_px: 0.01,
                target_px: 28.99,
                in_focus: true,
                captured_at: jiff::Timestamp::UNIX_EPOCH,
            }),
            camera: CameraSeen { online: true, replay: false, frame_age_ms: Some(41.7) },
            axes: vec![axis(AxisName::Focus, true, true), axis(AxisName::E, false, false)],
        };
        let seen = |name: &str, state, bench: Option<BenchSeen>, reasons: &[&str]| Seen {
            name: name.to_owned(),
            url: format!("http://{name}:80"),
            state,
            reasons: reasons.iter().map(|&reason| reason.to_owned()).collect(),
            version: bench.is_some().then(|| "1.2.3".to_owned()),
            simulated: bench.is_some().then_some(true),
            bench,
        };
        let daemons = vec![
            seen("left", State::NotReady, Some(bench), &["the e axis is not connected"]),
            seen("right", State::Unreachable, None, &["no daemon answers"]),
        ];
        let text = text(&Status { at: jiff::Timestamp::UNIX_EPOCH, ready: 0, daemons });
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 6, "{text}");
        for column in HEADS {
            assert!(lines[0].contains(column), "{text}");
        }
        for cell in [
            "left ",
            "http://left:80",
            "SIMULATED",
            "NOT READY",
            "STOPPED",
            "ana@lab (plenalign align), who has a very l…",
            "joint_alignment running 3/12: measuring",
            "28.914 of 28.990 px, in focus",
            "online, 42 ms",
            "focus homed, e AWAY",
            "1.2.3",
        ] {
            assert!(lines[1].contains(cell), "{cell}\n{text}");
        }
        assert!(lines[2].contains("UNREACHABLE"), "{text}");
        // Every cell begins below its head.
        let at = |line: &str, word: &str| line.chars().count() - line[line.find(word).unwrap()..].chars().count();
        assert_eq!(at(lines[0], "STATE"), at(lines[2], "UNREACHABLE"));
        assert_eq!(lines[3], "left: the e axis is not connected");
        assert_eq!(lines[4], "right: no daemon answers");
        assert_eq!(lines[5], "0 of 2 ready, 1970-01-01T00:00:00Z");
    }
}
