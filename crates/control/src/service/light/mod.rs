//! The camera's exposure and gain: read, set by hand, and found for a white frame.
//!
//! A job sets neither: it takes its frames as the camera is set when it begins. So they are set between jobs only, and
//! whatever was learnt of the camera by a white frame is dropped when they change.

mod search;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use utoipa::ToSchema;
use uuid::Uuid;

use super::Service;
use crate::motion::lease::Permit;
use crate::{Refusal, ServiceError};
use bench::device::light::{ControlName, LightControl};
use bench::device::{DeviceError, Frame};
use plenoptics::raw::Histogram;
use search::{Lit, MOST_FRAMES, Next, Search};

/// How long a search for the exposure may take.
const SEARCH_ALLOWED: Duration = Duration::from_secs(60);

/// What the camera's pictures are exposed by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LightView {
    /// Exposure and gain, as far as the camera has them; empty where it has neither.
    pub controls: Vec<LightControl>,
    /// Whether a white frame was taken with the camera set as it is: what is measured rests on it, and a change of a
    /// control drops it.
    pub white_frame: bool,
    /// The job that keeps them from being set until its end; null where none does.
    pub job: Option<Uuid>,
}

/// What came of a search for the exposure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AutoExposureView {
    /// How the camera is set now.
    #[serde(flatten)]
    pub light: LightView,
    /// Whether anything was changed: a picture that is exposed as it should be is left as it is.
    pub changed: bool,
    /// Frames that it took.
    pub frames: u32,
    /// Level of the bright pixels in the last of them, as a part of white: 99.5 % of all pixels are at or below it. From
    /// 0.7 to 0.9; where no step of the camera's controls comes there, from 0.5 to 0.7.
    pub bright_level: f64,
    /// Share of its pixels that are clipped.
    pub clipped_share: f64,
}

impl Service {
    /// The camera's exposure and gain.
    ///
    /// # Errors
    /// The camera's own error.
    pub async fn light(&self) -> Result<LightView, ServiceError> {
        let controls = self.bench.camera.controls().await?;
        let job = self.current().map(|job| job.snapshot().id);
        Ok(LightView { controls, white_frame: self.eye.has_white(), job })
    }

    /// Whether a frame was exposed with the camera set as it is.
    #[must_use]
    pub fn is_exposed_so(&self, frame: &Frame) -> bool {
        self.light_set_at().is_none_or(|set_at| frame.exposed_from >= set_at)
    }

    /// When the camera's exposure or gain was set last; `None` where that has not happened.
    #[must_use]
    pub fn light_set_at(&self) -> Option<Instant> {
        *self.light_set_at.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the camera's exposure or gain to the value nearest to `wanted` that it takes. Where that is another than
    /// before, the white frame is dropped, and what was read of the scene is of another set-up from then on. Whether or
    /// not somebody waits for the end, `tell` gets what came of it, unless it was refused before anything was done.
    ///
    /// # Errors
    /// A refusal while a job holds the bench or the exposure is searched for, for a value outside the limits, or where
    /// the camera has no such control; the camera's own error.
    pub async fn set_light(
        self: &Arc<Self>,
        permit: &Permit,
        name: ControlName,
        wanted: f64,
        tell: impl FnOnce(&Result<LightView, ServiceError>) + Send + 'static,
    ) -> Result<LightView, ServiceError> {
        let (service, permit) = (Arc::clone(self), permit.clone());
        self.carry_out(async move {
            service.not_searching()?;
            // No job is accepted meanwhile.
            let _accepting = service.accepting.lock().await;
            service.may_set(&permit)?;
            let controls = service.bench.camera.controls().await?;
            let control = settable(&controls, name)?;
            let value = control.nearest(wanted).ok_or(Refusal::ControlRange {
                control: name,
                value: wanted,
                minimum: control.minimum,
                maximum: control.maximum,
                unit: control.unit,
            })?;
            let set = async {
                if control.value != Some(value) {
                    service.change(name, value).await?;
                }
                service.light().await
            };
            let done = set.await;
            tell(&done);
            done
        })
        .await
    }

    /// Finds exposure and gain for a white frame by the camera's own pictures: the brightest micro-images at four fifths of
    /// white, none of them clipped, with the least gain. The diffuser is on the lens, or whatever is to be seen is before
    /// it. No job is accepted until its end. `tell` gets what came of it, as in [`Service::set_light`].
    ///
    /// # Errors
    /// As [`Service::set_light`]; [`Refusal::NotExposed`] where there is too much light or too little, and the camera is
    /// then set as before.
    pub async fn auto_expose(
        self: &Arc<Self>,
        permit: &Permit,
        tell: impl FnOnce(&Result<AutoExposureView, ServiceError>) + Send + 'static,
    ) -> Result<AutoExposureView, ServiceError> {
        let (service, permit) = (Arc::clone(self), permit.clone());
        self.carry_out(async move {
            let _searching = Searching::begin(&service.searching)?;
            let _accepting = service.accepting.lock().await;
            service.may_set(&permit)?;
            let before = service.bench.camera.controls().await?;
            if !before.iter().any(|control| control.locked.is_none()) {
                settable(&before, ControlName::Exposure)?;
            }
            let done = service.exposed(&permit, &before).await;
            tell(&done);
            done
        })
        .await
    }

    /// Searches, and sets the camera as it was `before` where nothing is found.
    async fn exposed(&self, permit: &Permit, before: &[LightControl]) -> Result<AutoExposureView, ServiceError> {
        match self.search(permit, before).await {
            Ok((frames, bright_level, clipped_share)) => {
                let light = self.light().await?;
                let value = |controls: &[LightControl]| -> Vec<Option<f64>> {
                    controls.iter().map(|control| control.value).collect()
                };
                let changed = value(&light.controls) != value(before);
                Ok(AutoExposureView { light, changed, frames, bright_level, clipped_share })
            }
            Err(error) => {
                self.set_back(before).await;
                Err(error)
            }
        }
    }

    /// Frame after frame until one is right: how many, the last one's bright level, and its clipped share.
    async fn search(&self, permit: &Permit, controls: &[LightControl]) -> Result<(u32, f64, f64), ServiceError> {
        let mut search = Search::new(controls, 1000.0 / self.config.bench.camera.frame_rate_hz);
        let until = Instant::now() + SEARCH_ALLOWED;
        for frames in 1..=MOST_FRAMES {
            // A frame may be given up, a setting is carried to its end.
            let exposed = tokio::time::timeout_at(until, self.expose()).await.map_err(|_| {
                let what = "give the frames of an exposure search".to_owned();
                DeviceError::Timeout { device: "the camera".to_owned(), what, allowed: SEARCH_ALLOWED }
            })?;
            let frame = exposed?;
            let histogram = self.histogram_of(&frame).await?;
            let lit = Lit::of(&histogram);
            match search.next(lit) {
                Next::Right => return Ok((frames, lit.level(), histogram.clipped_share())),
                Next::Impossible(why) => return Err(Refusal::NotExposed { why }.into()),
                Next::Set(name, value) => {
                    self.may_set(permit)?;
                    self.change(name, value).await?;
                }
            }
        }
        let why = format!("the light changes from frame to frame: no exposure was right in {MOST_FRAMES} frames");
        Err(Refusal::NotExposed { why }.into())
    }

    /// Sets what a search has changed as it was before.
    async fn set_back(&self, before: &[LightControl]) {
        let Ok(now) = self.bench.camera.controls().await else { return };
        for control in before {
            let changed = now.iter().any(|other| other.name == control.name && other.value != control.value);
            if let Some(value) = control.value.filter(|_| changed)
                && let Err(error) = self.change(control.name, value).await
            {
                tracing::warn!(%error, control = %control.name, "the camera could not be set as it was before");
            }
        }
    }

    /// Runs a command to its end, whether or not whoever gave it waits for that: a camera is not left half-way.
    async fn carry_out<T: Send + 'static>(
        &self,
        command: impl Future<Output = Result<T, ServiceError>> + Send + 'static,
    ) -> Result<T, ServiceError> {
        tokio::spawn(command).await.unwrap_or_else(|error| {
            let detail = format!("setting it ended unexpectedly: {error}");
            Err(DeviceError::Protocol { device: "the camera".to_owned(), detail }.into())
        })
    }

    /// The exposure must not be searched for.
    fn not_searching(&self) -> Result<(), Refusal> {
        if self.searching.load(Ordering::Acquire) { Err(Refusal::Searching) } else { Ok(()) }
    }

    fn may_set(&self, permit: &Permit) -> Result<(), ServiceError> {
        self.leases.check(permit)?;
        self.free_for_hand()
    }

    /// Sets a control, and drops what was learnt and read of the camera as it was set before.
    async fn change(&self, name: ControlName, value: f64) -> Result<(), ServiceError> {
        let before = if self.eye.has_white() { self.eye.camera_set().await } else { None };
        // Whatever comes of it: a camera that gives no answer may have been set all the same.
        self.forget_as_set(before);
        let set = self.bench.camera.set_control(name, value).await;
        // What was read meanwhile may be of either.
        self.forget_as_set(None);
        set?;
        if self.eye.take_white_back(self.eye.camera_set().await.as_deref()) {
            self.publish_bench();
        }
        tracing::info!(control = %name, value, "the camera was set");
        Ok(())
    }

    /// Forgets what was learnt and read of the camera while it was set as these words say.
    fn forget_as_set(&self, set: Option<String>) {
        *self.light_set_at.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        self.eye.drop_white(set);
        self.readings.forget();
        // Whatever a frame of before showed, the camera now shows otherwise.
        self.eye.see(None);
        self.publish_bench();
    }

    /// How many pixels of a frame of this camera have which grey level, counted away from the runtime's threads.
    ///
    /// # Errors
    /// [`DeviceError::Protocol`] where counting ended unexpectedly.
    pub async fn histogram_of(&self, frame: &Frame) -> Result<Histogram, ServiceError> {
        let image = Arc::clone(&frame.image);
        let white = self.bench.camera.state().borrow().white.unwrap_or_else(|| image.white_level());
        let count = tokio::task::spawn_blocking(move || Histogram::of(&image, white));
        count.await.map_err(|error| {
            DeviceError::Protocol { device: "the camera".to_owned(), detail: error.to_string() }.into()
        })
    }
}

/// Says that the exposure is searched for, for as long as it is there.
struct Searching<'a>(&'a AtomicBool);

impl<'a> Searching<'a> {
    fn begin(searching: &'a AtomicBool) -> Result<Self, Refusal> {
        if searching.swap(true, Ordering::AcqRel) { Err(Refusal::Searching) } else { Ok(Self(searching)) }
    }
}

impl Drop for Searching<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

/// The control of that name, where it can be set.
fn settable(controls: &[LightControl], name: ControlName) -> Result<&LightControl, Refusal> {
    let no = |why: String| Refusal::NoControl { control: name, why };
    let control = controls.iter().find(|control| control.name == name);
    let control = control.ok_or_else(|| no("it has none that the daemon knows".to_owned()))?;
    match &control.locked {
        Some(why) => Err(no(why.clone())),
        None => Ok(control),
    }
}
