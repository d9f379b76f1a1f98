//! What a viewer watches, and what comes of it next.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use super::{Frames, Maps, Readings};
use crate::api::pictures::picture::{Skipped, next};
use crate::api::pictures::viewed::Wanted;
use crate::api::pictures::viewport::Watched;
use crate::control::events::FieldMap;
use crate::control::reading::Reading;
use crate::device::Frame;
use crate::telemetry::Viewing;

/// What a viewer wants to see.
pub(super) struct Watching {
    pub(super) frames: Frames,
    /// The spacing over the field, where it was asked for.
    pub(super) map: Option<Maps>,
    pub(super) _viewing: Viewing,
    /// Has the spacing of what is seen measured.
    pub(super) _spacing: Arc<()>,
    pub(super) wanted: Wanted,
    /// The viewport among those that are watched, where it is one.
    pub(super) watched: Option<Watched>,
    /// Why the newest frame could not be shown, where that was so and the viewer was told.
    pub(super) told: Option<String>,
    /// At least so long between two pictures.
    pub(super) interval: Duration,
    pub(super) next_at: Instant,
    /// At most so many pictures on the way; 0 for no bound.
    pub(super) window: u32,
    /// Sequence numbers of the pictures on the way.
    pub(super) unseen: Vec<u64>,
    pub(super) skipped: Skipped,
}

impl Watching {
    pub(super) fn may_send(&self) -> bool {
        self.window == 0 || self.unseen.len() < self.window as usize
    }
}

/// What a viewer wants to read.
pub(super) struct Metering {
    pub(super) readings: Readings,
    /// Has frames measured in whole, too, where that was asked for.
    pub(super) _whole: Option<Arc<()>>,
    /// At least so long between two readings.
    pub(super) interval: Duration,
    pub(super) next_at: Instant,
}

/// How often a viewer has been shown the very same picture.
#[derive(Default)]
pub(super) struct Repeated {
    /// The frame shown last, and the first of those before it that have its picture.
    pub(super) last: Option<[u64; 2]>,
    /// In a row, the last one counted.
    pub(super) alike: u32,
}

impl Repeated {
    /// How many pictures in a row are the same, up to one of frame `seq`, whose picture was that of frame `first` already: 1
    /// where it is another than the one before.
    pub(super) fn note(&mut self, seq: u64, first: u64) -> u32 {
        self.alike = match self.last {
            // Another part of it, or another view.
            Some([last, _]) if last == seq => self.alike,
            Some([_, before]) if before == first => self.alike.saturating_add(1),
            _ => 1,
        };
        self.last = Some([seq, first]);
        self.alike
    }
}

/// What a viewer is to be shown next.
pub(super) enum See {
    Frame(Arc<Frame>),
    Map(Arc<FieldMap>),
}

/// The next thing for a viewer to see; never for one who wants no pictures. Nothing is lost when this is dropped
/// half-way.
pub(super) async fn next_seen(watching: &mut Option<Watching>) -> See {
    let Some(watching) = watching.as_mut() else { return std::future::pending().await };
    let may_send = watching.may_send();
    let Watching { frames, map, next_at, .. } = watching;
    tokio::select! {
        map = next_map(map) => See::Map(map),
        frame = next_frame(frames, *next_at), if may_send => See::Frame(frame),
    }
}

/// The newest reading once there is a new one and the viewer's rate allows it; never for one who wants none.
pub(super) async fn next_reading(metering: &mut Option<Metering>) -> Arc<Reading> {
    let Some(Metering { readings, interval, next_at, .. }) = metering else { return std::future::pending().await };
    tokio::time::sleep_until(*next_at).await;
    let reading = next_or_never(readings).await;
    *next_at = (*next_at + *interval).max(Instant::now());
    reading
}

pub(super) async fn next_map(map: &mut Option<Maps>) -> Arc<FieldMap> {
    let Some(map) = map else { return std::future::pending().await };
    next_or_never(map).await
}

/// The newest frame once there is a new one and the viewer's rate allows it.
pub(super) async fn next_frame(frames: &mut Frames, next_at: Instant) -> Arc<Frame> {
    tokio::time::sleep_until(next_at).await;
    next_or_never(frames).await
}

pub(super) async fn next_or_never<T>(source: &mut watch::Receiver<Option<Arc<T>>>) -> Arc<T> {
    match next(source).await {
        Some(newest) => newest,
        None => std::future::pending().await,
    }
}
