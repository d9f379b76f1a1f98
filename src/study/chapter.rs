//! What an experiment comes to, as plain data.

use serde::{Deserialize, Serialize};

/// One experiment.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Chapter {
    /// Its name, as in file names.
    pub name: String,
    /// Its title.
    pub title: String,
    /// Paragraphs: what was done, and how to read it.
    pub text: Vec<String>,
    /// Single figures beside the paper's.
    pub findings: Vec<Finding>,
    /// Tables.
    pub tables: Vec<Table>,
    /// Charts.
    pub charts: Vec<Chart>,
    /// Pictures.
    pub pictures: Vec<Picture>,
    /// Wall time it took, s.
    pub seconds: f64,
}

/// Whether a figure agrees with the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As the paper has it, within rounding or what is said beside it.
    Agrees,
    /// Not as the paper has it; the remark says why.
    Differs,
    /// The paper has no such figure.
    New,
}

/// One figure beside the paper's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// What it is.
    pub what: String,
    /// What the paper has; empty where it has nothing.
    pub paper: String,
    /// What was found.
    pub ours: String,
    /// Whether they agree.
    pub verdict: Verdict,
    /// Why, or under which conditions.
    pub remark: String,
}

impl Finding {
    /// A figure that the paper has, too.
    pub(super) fn compared(
        what: impl Into<String>,
        paper: impl Into<String>,
        ours: impl Into<String>,
        agrees: bool,
        remark: impl Into<String>,
    ) -> Self {
        let verdict = if agrees { Verdict::Agrees } else { Verdict::Differs };
        Self { what: what.into(), paper: paper.into(), ours: ours.into(), verdict, remark: remark.into() }
    }

    /// A figure that the paper does not have.
    pub(super) fn new(what: impl Into<String>, ours: impl Into<String>, remark: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            paper: String::new(),
            ours: ours.into(),
            verdict: Verdict::New,
            remark: remark.into(),
        }
    }
}

/// A table: every row has a cell for each column.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Its name, as in file names.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// Headings, with units.
    pub columns: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table.
    pub(super) fn new(name: &str, title: impl Into<String>, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|&column| column.to_owned()).collect();
        Self { name: name.to_owned(), title: title.into(), columns, rows: Vec::new() }
    }

    /// Adds a row.
    pub(super) fn push<const N: usize>(&mut self, cells: [String; N]) {
        assert_eq!(N, self.columns.len());
        self.rows.push(cells.into());
    }
}

/// One line or cloud of points of a chart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curve {
    /// Its name in the legend.
    pub name: String,
    /// x and y.
    pub points: Vec<[f64; 2]>,
    /// Whether single points are drawn rather than a line.
    pub marks: bool,
}

impl Curve {
    /// A line.
    pub(super) fn line(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, marks: false }
    }

    /// Single points.
    pub(super) fn marks(name: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), points, marks: true }
    }
}

/// A chart of curves over a common pair of axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Chart {
    /// Its name, as in file names.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// The horizontal axis, with its unit.
    pub x: String,
    /// The vertical axis, with its unit.
    pub y: String,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// A picture, kept as a PNG file beside the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// Its name, as in file names.
    pub name: String,
    /// What it shows.
    pub caption: String,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The PNG itself; in a file of its own beside a chapter's.
    #[serde(skip)]
    pub png: Vec<u8>,
}
