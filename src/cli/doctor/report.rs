//! What `plenalign doctor` prints.

use std::fmt::Write as _;

use serde::Serialize;

use super::finding::{Finding, Level};

/// Columns before the things themselves.
const LEVEL_WIDTH: usize = 8;
/// A thing with a longer name has its finding on the next line.
const LONGEST_NAME: usize = 26;
/// Columns of text, where that is not known of the terminal.
const WIDTH: usize = 110;

/// The findings, and what they come to.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    /// Version of the program.
    version: String,
    /// The worst of all.
    level: Level,
    problems: usize,
    warnings: usize,
    findings: Vec<Finding>,
}

impl Report {
    pub(super) fn new(version: String, findings: Vec<Finding>) -> Self {
        let count = |level| findings.iter().filter(|finding| finding.level == level).count();
        Self {
            version,
            level: findings.iter().map(|finding| finding.level).max().unwrap_or(Level::Ok),
            problems: count(Level::Problem),
            warnings: count(Level::Warning),
            findings,
        }
    }

    /// Whether something keeps the bench from working.
    pub(super) const fn has_problems(&self) -> bool {
        self.problems > 0
    }

    /// The table, and under each thing that is not right what to type.
    pub(super) fn text(&self) -> String {
        let names = self.findings.iter().map(|finding| finding.what.chars().count());
        let name_width = names.filter(|&width| width <= LONGEST_NAME).max().unwrap_or(0);
        let indent = LEVEL_WIDTH + 1 + name_width + 1;
        let mut out = String::new();
        for finding in &self.findings {
            let level = match finding.level {
                Level::Problem => "PROBLEM",
                other => other.word(),
            };
            let head = format!("{level:<LEVEL_WIDTH$} {:<name_width$}", finding.what);
            let lines = wrapped(&finding.detail, WIDTH.saturating_sub(indent));
            let mut lines = lines.iter();
            let beside = if finding.what.chars().count() <= name_width { lines.next() } else { None };
            // Writing to a string does not fail.
            let _ = writeln!(out, "{}", format!("{head} {}", beside.map_or("", String::as_str)).trim_end());
            for line in lines {
                let _ = writeln!(out, "{:indent$}{line}", "");
            }
            if let Some(mend) = &finding.mend {
                // Not wrapped: it is to be copied.
                let _ = writeln!(out, "{:indent$}-> {mend}", "");
            }
        }
        let _ = writeln!(out, "\n{}", self.verdict());
        out
    }

    fn verdict(&self) -> String {
        let many = |count: usize, what: &str| if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") };
        match (self.problems, self.warnings) {
            (0, 0) => "nothing is wrong".to_owned(),
            (0, warnings) => format!("nothing keeps the bench from working; {}", many(warnings, "warning")),
            (problems, warnings) => format!("{}, {}", many(problems, "problem"), many(warnings, "warning")),
        }
    }
}

/// Text in lines of at most so many characters, broken between words.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let Some(line) = lines.last_mut() else { break };
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= width {
            line.push(' ');
            line.push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn findings_are_a_table_with_what_to_type_under_them() {
        let long = "controller with quite a long name of its own";
        let findings = vec![
            Finding::ok("a", "clock", "is right"),
            Finding::problem("b", "camera", "is not there ".repeat(12).trim(), "plenalign camera list"),
            Finding::note("c", long, "rests"),
        ];
        let report = Report::new("1.2.3".to_owned(), findings);
        assert!(report.has_problems());
        let text = report.text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "ok       clock  is right");
        assert!(lines[1].starts_with("PROBLEM  camera is not there is"), "{text}");
        assert!(lines[2].starts_with(&" ".repeat(16)) && lines[2].ends_with("there"), "{text}");
        assert!(lines.contains(&"                -> plenalign camera list"), "{text}");
        let at = lines.iter().position(|line| *line == format!("note     {long}")).expect("it has a line of its own");
        assert_eq!(lines[at + 1], "                rests");
        assert_eq!(lines.last(), Some(&"1 problem, 0 warnings"));
        assert!(lines.iter().all(|line| line.chars().count() <= WIDTH), "{text}");
        let json = serde_json::to_value(&report).unwrap();
        assert_eq!((&json["level"], &json["problems"]), (&"problem".into(), &1.into()));
        assert_eq!(
            json["findings"][0],
            serde_json::json!({ "id": "a", "level": "ok", "what": "clock", "detail": "is right" })
        );
        assert_eq!(json["findings"][1]["mend"], "plenalign camera list");
    }

    #[test]
    fn nothing_wrong_is_said() {
        let report = Report::new("1".to_owned(), vec![Finding::ok("a", "clock", "is right")]);
        assert!(!report.has_problems() && report.text().ends_with("\nnothing is wrong\n"));
    }
}
