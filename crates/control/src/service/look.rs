//! Pictures of the newest frames, for who looks at them: a frame is made ready once, however many ask.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::Service;
use super::pose::PoseView;
use crate::Refusal;
use crate::measuring::sight;
use crate::measuring::sight::Sight;
use bench::device::Frame;
use bench::telemetry;
use plenoptics::imaging::clarity::{Eog, eog};
use plenoptics::imaging::pictures::{LivePictures, Pictures};
use plenoptics::imaging::view::View;

/// Rest between two frames that are made ready, at least; and as long as the last one took, so that whoever looks leaves
/// the loops half of the machine.
const REST_LEAST: Duration = Duration::from_millis(10);

/// A frame made ready for pictures.
pub struct Look {
    /// The frame.
    pub frame: Arc<Frame>,
    /// What can be made of it.
    pub pictures: Pictures,
    /// Its central view.
    pub central: View,
    /// How clear that is.
    pub eog: Eog,
    /// Where the camera was; the error says, in words, what is not known of it.
    pub pose: Result<PoseView, String>,
    /// Whether grid and vignetting come from a white frame; without, they come from the frame itself.
    pub white_frame: bool,
    /// D_MLA, px.
    pub mla_pitch_px: f64,
    /// Grey levels of a view that stand for a saturated pixel before its vignetting was taken out.
    pub white_level: u16,
}

/// The newest frame made ready, and what is kept for the next.
#[derive(Default)]
pub(super) struct Looks {
    /// What it was begun with, and what it has learnt since.
    live: Option<(Option<Arc<Sight>>, LivePictures)>,
    newest: Option<Newest>,
    rest_until: Option<Instant>,
}

/// A frame and what was made of it; the error says why nothing was.
type Newest = (Arc<Frame>, Result<Arc<Look>, String>);

impl Service {
    /// Makes a frame ready for pictures, or gives one that was made ready already and is no older. It is done away from
    /// the runtime's threads, one frame at a time, and between two of them it rests as long as the last one took.
    ///
    /// # Errors
    /// [`Refusal::NotViewable`] where no picture can be made of the frame.
    pub async fn look_at(&self, frame: &Arc<Frame>) -> Result<Arc<Look>, Refusal> {
        let not_viewable = |why: String| Refusal::NotViewable { why };
        let mut looks = self.looks.lock().await;
        if let Some((seen, look)) = &looks.newest
            && seen.exposed_to >= frame.exposed_to
        {
            return look.clone().map_err(not_viewable);
        }
        if let Some(until) = looks.rest_until {
            tokio::time::sleep_until(until).await;
        }
        let sight = self.eye.sight();
        let same = |begun: &Option<Arc<Sight>>| begun.as_ref().map(Arc::as_ptr) == sight.as_ref().map(Arc::as_ptr);
        let live = match looks.live.take().filter(|(begun, _)| same(begun)) {
            Some((_, live)) => live,
            None => self.live_pictures(sight.as_deref()),
        };
        let (pose, pose_view) =
            self.pose_of(frame).map_or_else(|why| (None, Err(why)), |(pose, view)| (Some(pose), Ok(view)));
        let (white_frame, mla_pitch_px) = (sight.is_some(), self.mla_pitch_px());
        let (taken, from) = (Arc::clone(frame), Instant::now());
        let mosaic = self.config.sensor.mosaic.is_some();
        let work = tokio::task::spawn_blocking(move || {
            let mut live = live;
            let made = live.next(&taken.image, pose.as_ref()).and_then(|pictures| {
                let central = pictures.view([0.0; 2])?;
                Ok(Arc::new(Look {
                    eog: eog(&central),
                    central,
                    pictures,
                    pose: pose_view,
                    white_frame,
                    mla_pitch_px,
                    // A mosaic is evened out in 16 bits.
                    white_level: if mosaic { u16::MAX } else { taken.image.white_level() },
                    frame: taken,
                }))
            });
            (live, made.map_err(|error| error.to_string()))
        });
        let (live, made) =
            work.await.map_err(|error| not_viewable(format!("making it ended unexpectedly: {error}")))?;
        let took = from.elapsed();
        telemetry::looked(took);
        looks.rest_until = Some(Instant::now() + took.max(REST_LEAST));
        looks.live = Some((sight, live));
        looks.newest = Some((Arc::clone(frame), made.clone()));
        made.map_err(not_viewable)
    }

    fn live_pictures(&self, sight: Option<&Sight>) -> LivePictures {
        let mode = self.config.design().mla.mode;
        match sight {
            Some(sight) => LivePictures::new(Some(sight.white().clone()), sight.options(), mode),
            None => LivePictures::new(None, sight::frame_options(&self.config), mode),
        }
    }

    fn mla_pitch_px(&self) -> f64 {
        self.config.design().mla.pitch / self.config.pixel_pitch().millimetres()
    }
}
