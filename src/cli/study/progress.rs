//! Progress of a study on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::study::{Source, Watch};

/// A line for every chapter, and a bar below the last one.
pub(super) struct Bar(ProgressBar);

impl Bar {
    pub(super) fn new() -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{elapsed:>4} [{bar:30}] {pos}/{len}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self(bar)
    }

    /// Takes the bar away.
    pub(super) fn end(&self) {
        self.0.finish_and_clear();
    }
}

impl Watch for Bar {
    fn chapter(&self, number: usize, of: usize, title: &str, source: Source) {
        let note = match source {
            Source::Made => "",
            Source::Kept => " (kept from an earlier run)",
            Source::Merged => " (of the merged parts)",
        };
        self.0.suspend(|| eprintln!("{number}/{of} {title}{note}"));
        self.0.set_position(0);
    }

    fn done(&self, steps: u64, of: u64) {
        self.0.set_length(of);
        self.0.set_position(steps);
    }
}
