//! What the meter combines: the spacing in frames that were exposed with nothing moving.

use std::time::Duration;

use tokio::time::Instant;

use bench::device::Frame;
use plenoptics::imaging::combined::{Combined, Combining, Since};
use plenoptics::imaging::live::LiveSpacing;
use plenoptics::imaging::stillness::Stillness;
use plenoptics::units::Millimetres;

/// Longest time that is combined: what changes more slowly than can be seen in it is lived with.
const WINDOW: Duration = Duration::from_secs(5);
/// An axis stands while its readback changes by no more, mm: an encoder's last digit.
const STANDS_MM: f64 = 0.0005;

/// Frames at rest, up to the newest.
pub(crate) struct AtRest {
    combining: Combining,
    stillness: Stillness,
    /// The first frame of what is combined: where the axes stood, and whether it is coarse.
    first: Option<Posture>,
    /// What times are counted from.
    origin: Option<Instant>,
}

#[derive(Debug, Clone, Copy)]
struct Posture {
    axes_mm: [Option<f64>; 2],
    preview: bool,
}

impl Posture {
    fn of(frame: &Frame) -> Self {
        Self {
            axes_mm: [frame.focus, frame.e].map(|pose| pose.position.map(Millimetres::value)),
            preview: frame.preview,
        }
    }

    fn axis_stands(one: Option<f64>, other: Option<f64>) -> bool {
        match (one, other) {
            (Some(one), Some(other)) => (one - other).abs() <= STANDS_MM,
            (None, None) => true,
            _ => false,
        }
    }

    /// What is no longer as it was.
    fn changed(&self, now: &Self) -> Option<Since> {
        let stand = self.axes_mm.iter().zip(now.axes_mm).all(|(&one, other)| Self::axis_stands(one, other));
        if !stand {
            return Some(Since::Axis);
        }
        (self.preview != now.preview).then_some(Since::Picture)
    }
}

impl AtRest {
    /// Nothing combined yet.
    pub(crate) fn new() -> Self {
        Self {
            combining: Combining::over(WINDOW.as_secs_f64()),
            stillness: Stillness::default(),
            first: None,
            origin: None,
        }
    }

    /// The spacing could not be followed: what is found again is combined anew.
    pub(crate) fn lost(&mut self) {
        self.combining.begin_anew(Since::Lost);
    }

    /// Something else stands in view: nothing of before says anything of it.
    pub(crate) fn set_up(&mut self) {
        self.combining.begin_anew(Since::Picture);
    }

    /// What there is with the spacing in another frame. One that spans motion stands alone.
    pub(crate) fn take(&mut self, frame: &Frame, spacing: &LiveSpacing) -> Combined {
        let now = Posture::of(frame);
        let moved = self.stillness.has_moved(&frame.image);
        let settled = frame.is_settled();
        let ended = match &self.first {
            _ if !settled => Some(Since::Axis),
            Some(first) => first.changed(&now).or(moved.then_some(Since::Picture)),
            None => None,
        };
        if let Some(since) = ended {
            self.combining.begin_anew(since);
        }
        if ended.is_some() || self.first.is_none() {
            self.first = Some(now);
        }
        let origin = *self.origin.get_or_insert(frame.exposed_to);
        let at = frame.exposed_to.saturating_duration_since(origin);
        self.combining.take(spacing.single(at.as_secs_f64()))
    }
}
