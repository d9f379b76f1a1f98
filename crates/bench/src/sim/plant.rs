//! The mechanics that a stage twin's motors turn: what a controller's firmware can act on and sense.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use super::stage::{FAR_SWITCH_MM, PULL_OFF_MM};
use crate::config::AxisConfig;

/// Motors and switches of one controller's axes, numbered from 0 as the controller numbers them.
pub trait Plant: Send + Sync {
    /// The motor of `axis` now stands `position_mm` from where it stood at power-up, by the firmware's own count of
    /// steps. Called in order, at least every 10 ms of motion and at every reversal.
    fn motor_moved(&self, axis: usize, position_mm: f64);

    /// Whether the home switch of `axis` is closed.
    fn home_switch_closed(&self, axis: usize) -> bool;

    /// Whether the axis stands against a limit switch (either end).
    fn limit_switch_closed(&self, axis: usize) -> bool;
}

/// Distance of a slide's hard stop beyond the switch before it, mm.
pub const END_MM: f64 = 1.0;

/// Plain slides, one an axis: a motor, a home switch, and a switch and a hard stop at either end, against which the
/// motor loses steps. Positions are the axes' own coordinates.
#[derive(Debug)]
pub struct Slides {
    slides: Vec<Slide>,
    at: Mutex<Vec<At>>,
}

/// Where a slide stands, and how far it stands from where its motor's steps would have brought it, mm.
#[derive(Debug)]
struct At {
    mm: f64,
    lost: f64,
}

#[derive(Debug)]
struct Slide {
    start: f64,
    direction: f64,
    home_switch: f64,
    homes_below: bool,
    far_switch: f64,
    /// Whether the switches close at all.
    switches: bool,
}

impl Slides {
    /// The slides of axes as configured, each standing at its start (mm) at power-up. The home switch closes
    /// [`PULL_OFF_MM`] beyond the home position, the other end's a millimetre beyond the limit of travel.
    #[must_use]
    pub fn new(axes: &[(&AxisConfig, f64)]) -> Arc<Self> {
        Self::made(axes, true)
    }

    /// The same with switches that never close.
    #[must_use]
    pub fn without_switches(axes: &[(&AxisConfig, f64)]) -> Arc<Self> {
        Self::made(axes, false)
    }

    fn made(axes: &[(&AxisConfig, f64)], switches: bool) -> Arc<Self> {
        let slides = axes.iter().map(|(config, start)| {
            let side = config.home_side.sign();
            Slide {
                start: *start,
                direction: if config.reversed { -1.0 } else { 1.0 },
                home_switch: config.home_position_mm + side * PULL_OFF_MM,
                homes_below: side < 0.0,
                far_switch: if side < 0.0 {
                    config.high_limit_mm + FAR_SWITCH_MM
                } else {
                    config.low_limit_mm - FAR_SWITCH_MM
                },
                switches,
            }
        });
        let slides: Vec<Slide> = slides.collect();
        let at = Mutex::new(slides.iter().map(|slide| At { mm: slide.start, lost: 0.0 }).collect());
        Arc::new(Self { slides, at })
    }

    /// Where a slide stands, mm.
    #[must_use]
    pub fn at(&self, axis: usize) -> f64 {
        self.at.lock().unwrap_or_else(PoisonError::into_inner).get(axis).map_or(f64::NAN, |at| at.mm)
    }

    /// How far an axis's motor has turned against a hard stop, mm: positive beyond the coordinate's upper end.
    #[must_use]
    pub fn lost(&self, axis: usize) -> f64 {
        self.at.lock().unwrap_or_else(PoisonError::into_inner).get(axis).map_or(f64::NAN, |at| at.lost)
    }
}

impl Plant for Slides {
    fn motor_moved(&self, axis: usize, position_mm: f64) {
        if let (Some(slide), Some(at)) =
            (self.slides.get(axis), self.at.lock().unwrap_or_else(PoisonError::into_inner).get_mut(axis))
        {
            let (a, b) = (slide.home_switch, slide.far_switch);
            let free = slide.start + slide.direction * position_mm - at.lost;
            at.mm = free.clamp(a.min(b) - END_MM, a.max(b) + END_MM);
            at.lost += free - at.mm;
        }
    }

    fn home_switch_closed(&self, axis: usize) -> bool {
        let at = self.at(axis);
        let closed = |s: &Slide| if s.homes_below { at <= s.home_switch } else { at >= s.home_switch };
        self.slides.get(axis).is_some_and(|s| s.switches && closed(s))
    }

    fn limit_switch_closed(&self, axis: usize) -> bool {
        let at = self.at(axis);
        self.slides.get(axis).is_some_and(|s| {
            if !s.switches {
                false
            } else if s.homes_below {
                at < s.home_switch - 1e-3 || at > s.far_switch
            } else {
                at > s.home_switch + 1e-3 || at < s.far_switch
            }
        })
    }
}

/// Slides that write down every motion: a line for each step told, with the time (microseconds since
/// 1970-01-01T00:00:00Z), the axis's number and where the slide stands, mm.
#[derive(Debug)]
pub struct RecordedSlides {
    slides: Arc<Slides>,
    record: Mutex<File>,
}

impl RecordedSlides {
    /// The slides with a record that begins anew.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub fn new(slides: Arc<Slides>, path: &Path) -> io::Result<Arc<Self>> {
        Ok(Arc::new(Self { slides, record: Mutex::new(File::create(path)?) }))
    }
}

impl Plant for RecordedSlides {
    fn motor_moved(&self, axis: usize, position_mm: f64) {
        self.slides.motor_moved(axis, position_mm);
        let (at, now) = (self.slides.at(axis), jiff::Timestamp::now().as_microsecond());
        let mut record = self.record.lock().unwrap_or_else(PoisonError::into_inner);
        // One write a line: whoever reads along never sees half of one.
        if let Err(error) = record.write_all(format!("{now} {axis} {at:.4}\n").as_bytes()) {
            tracing::error!(%error, "the stage's record cannot be written");
        }
    }

    fn home_switch_closed(&self, axis: usize) -> bool {
        self.slides.home_switch_closed(axis)
    }

    fn limit_switch_closed(&self, axis: usize) -> bool {
        self.slides.limit_switch_closed(axis)
    }
}
