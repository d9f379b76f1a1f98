//! The paper's experimental section, run again on the simulated camera, and what the paper does not have.
//!
//! Every experiment is a chapter: it renders frames by exact rays, measures them with the same code that aligns cameras,
//! and sets what it finds beside what the paper says. Chapters are plain data, so that one writer makes the report, the
//! JSON and the tables of all of them.
//!
//! ```text
//!   chapter.rs        what an experiment comes to: findings, tables, charts, pictures
//!   archive.rs        a folder with finished chapters, so that an interrupted study goes on where it was
//!   studio.rs         frames of a case, and the pictures made of them
//!   case.rs           the paper's four cases
//!   on_board.rs       a view laid on the board that it shows
//!   table_2.rs        Table 2 and what it fixes
//!   clarity.rs        Figure 8: raw frames, central views, energy of gradient
//!   field_of_view.rs  Figure 3 and the field of view of each case
//!   blur.rs           Figure 6 and Section 2.3: blur, depth of field, re-optimising
//!   two_fish.rs       Section 3.3: depth and refocusing
//!   loops/            the plain strategy of Section 2.2 against this program's loops
//!   sensitivity.rs    temperature, salinity, the shell's parts; curvature of field; decentre
//!   assembly/         tolerances of parts: how many assemblies are sharp, before and after alignment
//!   second_camera.rs  Section 3.2: the chain from calibration to joint optimisation
//!   monte_carlo/      the chapters of many items, split among machines and put together
//!   report/           the report as one page
//! ```

mod archive;
mod assembly;
mod blur;
mod case;
mod chapter;
mod clarity;
mod field_of_view;
mod loops;
mod monte_carlo;
mod on_board;
mod report;
mod second_camera;
mod sensitivity;
mod studio;
mod table_2;
mod two_fish;

use std::io::ErrorKind;
use std::time::Instant;

pub use archive::Archive;
pub use chapter::{Chapter, Chart, Curve, Finding, Picture, Table, Verdict};
pub use monte_carlo::{Counts, Journal, Merged, Part, PartStatus, Shard, State, Status, merge, status};
pub use report::{csv, html};

use crate::config::Config;

/// How thorough a study is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StudyOptions {
    /// Small sensors and few seeds: minutes become seconds, and what needs statistics says little.
    pub quick: bool,
    /// Seed of everything drawn: textures, noise, parts, benches.
    pub seed: u64,
    /// How many items the Monte Carlos have.
    pub counts: Counts,
}

impl StudyOptions {
    /// A study with as many items as usual.
    #[must_use]
    pub const fn new(quick: bool, seed: u64) -> Self {
        Self { quick, seed, counts: Counts::usual(quick) }
    }
}

/// Why a study could not go on.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// A frame of the study's own could not be measured.
    #[error("{what}: {why}")]
    Unseen {
        /// What was to be measured.
        what: String,
        /// Why it could not be.
        why: String,
    },
    /// The study's folder cannot be used.
    #[error("{path}: {source}{}", room(source))]
    Folder {
        /// The file or folder.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A finished chapter in the folder cannot be read back.
    #[error("{path}: not a chapter of this program: {why}; move it away to have it made again")]
    Chapter {
        /// The file.
        path: String,
        /// What is wrong with it.
        why: String,
    },
    /// A part of the Monte Carlos cannot be used.
    #[error("{path}: {why}")]
    Part {
        /// The file.
        path: String,
        /// What is wrong with it.
        why: String,
    },
    /// Parts that are not the whole.
    #[error("the parts cannot be merged: {0}")]
    Merge(String),
}

/// What is to be done where a file finds no room.
fn room(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            "; make room there and give the same command again: it goes on from what is finished"
        }
        _ => "",
    }
}

impl StudyError {
    /// Something that could not be measured, and why.
    pub(crate) fn unseen(what: impl Into<String>, why: impl ToString) -> Self {
        Self::Unseen { what: what.into(), why: why.to_string() }
    }
}

/// Where a chapter comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// It is made now.
    Made,
    /// It is there from an earlier run.
    Kept,
    /// It is made of merged parts.
    Merged,
}

/// What is told while a study runs: how much of a chapter is done.
pub trait Watch: Sync {
    /// A chapter begins, of so many.
    fn chapter(&self, number: usize, of: usize, title: &str, source: Source);
    /// So much of the chapter's work is done.
    fn done(&self, steps: u64, of: u64);
}

/// What a chapter works with.
struct Desk<'a> {
    config: &'a Config,
    options: StudyOptions,
    watch: &'a dyn Watch,
    /// What the Monte Carlos came to, where others have worked it out.
    merged: Option<&'a Merged>,
    /// What is finished of a part, and where the rest is kept.
    journal: Option<&'a Journal>,
}

type Write = fn(&Desk<'_>) -> Result<Chapter, StudyError>;

/// Each chapter's name, title and maker, in the order of the report.
const CHAPTERS: [(&str, &str, Write); 9] = [
    ("table_2", "Table 2: Δv and e of the four cases", table_2::write),
    ("clarity", "Figure 8: raw frames and central views", clarity::write),
    ("field_of_view", "Figure 3: the field of view in water", field_of_view::write),
    ("blur", "Figure 6 and Section 2.3: blur and depth of field", blur::write),
    ("two_fish", "Section 3.3: depth and refocusing", two_fish::write),
    ("loops", "The loops: the plain strategy and this program's", loops::write),
    ("sensitivity", "What Δv and e depend on", sensitivity::write),
    ("assembly", "Tolerances of parts and the yield", assembly::write),
    ("second_camera", "Section 3.2: the second camera", second_camera::write),
];

/// Runs the study: chapters that the archive already has are taken from it, others are made and kept there as they end.
///
/// # Errors
/// [`StudyError`]; the chapters finished until then are in the archive.
pub fn run(
    config: &Config,
    options: StudyOptions,
    archive: &Archive,
    watch: &dyn Watch,
) -> Result<Vec<Chapter>, StudyError> {
    chapters(&Desk { config, options, watch, merged: None, journal: None }, archive, |_| true)
}

/// Makes the chapters that are no Monte Carlos, which parts do not have: the merge finds them in the archive.
///
/// # Errors
/// [`StudyError`]; the chapters finished until then are in the archive.
pub fn run_others(
    config: &Config,
    options: StudyOptions,
    archive: &Archive,
    watch: &dyn Watch,
) -> Result<Vec<Chapter>, StudyError> {
    let desk = Desk { config, options, watch, merged: None, journal: None };
    chapters(&desk, archive, |name| options.counts.of(name).is_none())
}

/// Runs the study that parts were made of: the Monte Carlos' chapters are made of these, the others as by [`run`].
///
/// # Errors
/// [`StudyError`]; the chapters finished until then are in the archive.
pub fn run_merged(
    config: &Config,
    merged: &Merged,
    archive: &Archive,
    watch: &dyn Watch,
) -> Result<Vec<Chapter>, StudyError> {
    chapters(&Desk { config, options: merged.options(), watch, merged: Some(merged), journal: None }, archive, |_| true)
}

/// Works out one part of the Monte Carlos, and nothing else: what its journal has is taken from there, and what is finished
/// is kept in it.
///
/// # Errors
/// [`StudyError`]; the benches finished until then are in the journal.
pub fn run_part(
    config: &Config,
    options: StudyOptions,
    journal: &Journal,
    watch: &dyn Watch,
) -> Result<Part, StudyError> {
    let shard = journal.shard();
    let desk = Desk { config, options, watch, merged: None, journal: Some(journal) };
    let begin = |number: usize, name: &str| {
        let title = CHAPTERS.iter().find(|chapter| chapter.0 == name).map_or(name, |chapter| chapter.1);
        watch.chapter(number, 2, title, Source::Made);
    };
    journal.beating(|| {
        begin(1, "loops");
        let benches = loops::judge(&desk, shard.range(options.counts.benches))?;
        begin(2, "assembly");
        let assemblies = assembly::judge(&desk, shard.range(options.counts.assemblies))?;
        Ok(Part::new(config, options, shard, benches, assemblies))
    })
}

fn chapters(desk: &Desk<'_>, archive: &Archive, wanted: impl Fn(&str) -> bool) -> Result<Vec<Chapter>, StudyError> {
    let mut chapters = Vec::new();
    for (number, (name, title, write)) in CHAPTERS.into_iter().enumerate().filter(|(_, (name, ..))| wanted(name)) {
        let merged = desk.merged.and_then(|merged| merged.seconds(name));
        let kept = if merged.is_some() { None } else { archive.chapter(name)? };
        let source = match (&merged, &kept) {
            (Some(_), _) => Source::Merged,
            (None, Some(_)) => Source::Kept,
            (None, None) => Source::Made,
        };
        desk.watch.chapter(number + 1, CHAPTERS.len(), title, source);
        let chapter = match kept {
            Some(chapter) => chapter,
            None => {
                let start = Instant::now();
                let mut chapter = write(desk)?;
                chapter.name = name.to_owned();
                chapter.title = title.to_owned();
                chapter.seconds = merged.unwrap_or_else(|| start.elapsed().as_secs_f64());
                archive.keep(&chapter)?;
                chapter
            }
        };
        chapters.push(chapter);
    }
    Ok(chapters)
}
