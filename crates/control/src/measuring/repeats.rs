//! Frames that have the very picture of those before them: found out once a frame, away from the runtime's threads, however
//! many look at it.

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::Mutex;

use bench::device::Frame;

/// Frames of which it is kept: who looks at a picture that takes long to make is behind by fewer.
const KEPT: usize = 64;

/// What is known of the newest frames.
#[derive(Default)]
pub(crate) struct Repeats(Mutex<Known>);

#[derive(Default)]
struct Known {
    newest: Option<Arc<Frame>>,
    /// Frames, and the first of those in a row that have the picture of each; oldest first.
    firsts: VecDeque<[u64; 2]>,
}

impl Known {
    fn first(&self, seq: u64) -> Option<u64> {
        self.firsts.iter().find(|[known, _]| *known == seq).map(|[_, first]| *first)
    }

    /// The same of a frame that nobody has looked at, where those on both sides of it have one picture.
    fn first_between(&self, seq: u64) -> Option<u64> {
        let before = self.firsts.iter().rev().find(|[known, _]| *known < seq)?;
        let after = self.firsts.iter().find(|[known, _]| *known > seq)?;
        (before[1] == after[1]).then_some(before[1])
    }

    fn keep(&mut self, frame: &Arc<Frame>, first: u64) {
        self.newest = Some(Arc::clone(frame));
        if self.firsts.len() == KEPT {
            self.firsts.pop_front();
        }
        self.firsts.push_back([frame.seq, first]);
    }
}

impl Repeats {
    /// [`Eye::first_alike`](super::eye::Eye::first_alike), where `repeats` says of two frames whether the second has the picture of the first.
    pub(crate) async fn first(
        &self,
        frame: &Arc<Frame>,
        repeats: impl FnOnce(&Frame, &Frame) -> bool + Send + 'static,
    ) -> u64 {
        let mut known = self.0.lock().await;
        if known.newest.as_ref().is_some_and(|newest| newest.exposed_to < frame.exposed_to && newest.seq >= frame.seq) {
            // The camera counts anew.
            *known = Known::default();
        }
        if let Some(first) = known.first(frame.seq) {
            return first;
        }
        let first = match known.newest.clone() {
            // Too old to be compared with the one before it.
            Some(before) if before.exposed_to > frame.exposed_to => {
                return known.first_between(frame.seq).unwrap_or(frame.seq);
            }
            Some(before) => {
                let (earlier, taken) = (Arc::clone(&before), Arc::clone(frame));
                let same = tokio::task::spawn_blocking(move || repeats(&earlier, &taken)).await.unwrap_or(false);
                if same { known.first(before.seq).unwrap_or(before.seq) } else { frame.seq }
            }
            None => frame.seq,
        };
        known.keep(frame, first);
        first
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;
    use bench::device::AxisPose;
    use plenoptics::raw::RawImage;
    use tokio::time::Instant;

    fn frame(seq: u64, level: u8, exposed_to: Instant) -> Arc<Frame> {
        let pose = AxisPose { position: None, settled: true };
        Arc::new(Frame {
            image: Arc::new(RawImage::from_u8(8, 8, vec![level; 64])),
            seq,
            exposed_from: exposed_to,
            exposed_to,
            exposure_assumed: false,
            captured_at: jiff::Timestamp::now(),
            focus: pose,
            e: pose,
            preview: false,
            simulated: false,
            replayed: false,
        })
    }

    #[tokio::test]
    async fn frames_are_compared_once_however_many_look_and_on_no_thread_of_the_runtimes() {
        let (repeats, compared) = (Repeats::default(), Arc::new(AtomicU32::new(0)));
        let (runtimes, began) = (std::thread::current().id(), Instant::now());
        let at = |seq: u64, level| frame(seq, level, began + std::time::Duration::from_millis(seq));
        let first = async |frame: &Arc<Frame>| {
            let compared = Arc::clone(&compared);
            let same = move |before: &Frame, frame: &Frame| {
                assert_ne!(std::thread::current().id(), runtimes);
                compared.fetch_add(1, Ordering::Relaxed);
                before.image == frame.image
            };
            repeats.first(frame, same).await
        };
        let frames = [at(1, 120), at(2, 120), at(4, 120), at(5, 121), at(6, 120), at(8, 121)];
        for (frame, expected) in frames.iter().zip([1, 1, 1, 5, 6, 8]) {
            assert_eq!(tokio::join!(first(frame), first(frame), first(frame)), (expected, expected, expected));
        }
        assert_eq!(compared.load(Ordering::Relaxed), 5);
        // Who is behind is told what was found out; of a frame that nobody looked at what those beside it are.
        assert_eq!((first(&frames[1]).await, first(&at(3, 120)).await, first(&at(7, 120)).await), (1, 1, 7));
        // A camera that counts anew.
        let anew = frame(2, 120, began + std::time::Duration::from_secs(1));
        assert_eq!((first(&anew).await, first(&at(1003, 120)).await), (2, 2));
    }
}
