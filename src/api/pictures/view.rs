//! Pictures and distances of the newest frame: what `plenalign view` makes of a file.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use utoipa::{IntoParams, ToSchema};

use super::frame::{frame_headers, insert, milliseconds};
use super::picture::{DEFAULT_QUALITY, Encoding, QUALITIES, age, fresh};
use super::scene::{Format, Scene, draw};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::Query;
use crate::control::service::look::Look;
use crate::control::service::pose::PoseView;
use crate::control::{Refusal, ServiceError};
use crate::imaging::pictures::{DepthFigures, LensFigures};

/// Where nothing is said, what a metric picture needs of a distance, mm.
const DISTANCES_MM: std::ops::RangeInclusive<f64> = 1.0..=100_000.0;

/// What is to be seen of the newest frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::api) enum ViewKind {
    /// The view from one place in the main lens's aperture, the middle where `angle` is not given.
    #[default]
    Central,
    /// Everything sharp.
    AllInFocus,
    /// What is at `distance_mm` sharp, the rest blurred.
    Refocus,
    /// How far away everything is.
    Depth,
}

/// Which picture of the newest frame.
#[derive(Debug, Clone, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct ViewAsked {
    /// What is to be seen.
    #[param(inline)]
    kind: Option<ViewKind>,
    /// `U,V`: from where in the main lens's aperture one looks, right and down; its edge is 1 from the middle, and what
    /// is beyond is taken for the nearest place on it. For `central`; nothing else is seen from an angle.
    #[param(example = "0.4,-0.2", pattern = "^-?(0(\\.[0-9]{1,4})?|1),-?(0(\\.[0-9]{1,4})?|1)$")]
    angle: Option<String>,
    /// Distance that is to be sharp, mm: in water from the shell's outer vertex, in air from the main lens. For
    /// `refocus`, which takes the configured one where none is given; nothing else has a distance.
    #[param(minimum = 1, maximum = 100_000)]
    distance_mm: Option<f64>,
    /// Quality of the JPEG, 10 to 100.
    #[param(default = 80, minimum = 10, maximum = 100)]
    quality: Option<u8>,
}

impl ViewAsked {
    /// `usual_mm` is the distance of the object that the bench is configured for.
    fn scene(&self, usual_mm: f64) -> Result<Scene> {
        let direction = self.angle.as_deref().map_or(Ok([0.0; 2]), direction)?;
        let distance_mm = self.distance_mm.unwrap_or(usual_mm);
        if !DISTANCES_MM.contains(&distance_mm) {
            let detail = format!("distance_mm: {distance_mm} is not within 1 to 100000");
            return Err(Problem::invalid("distance_mm", detail));
        }
        Ok(match self.kind.unwrap_or_default() {
            ViewKind::Central => Scene::central(direction),
            ViewKind::AllInFocus => Scene::AllInFocus,
            ViewKind::Depth => Scene::Depth,
            ViewKind::Refocus => Scene::refocused(distance_mm),
        })
    }

    fn quality(&self) -> Result<u8> {
        let quality = self.quality.unwrap_or(DEFAULT_QUALITY);
        if QUALITIES.contains(&quality) {
            return Ok(quality);
        }
        Err(Problem::invalid("quality", format!("quality: {quality} is not within 10 to 100")))
    }
}

/// A direction written `U,V`.
fn direction(text: &str) -> Result<[f64; 2]> {
    let wrong = || Problem::invalid("angle", format!("angle: {text:?} is not U,V, two numbers from -1 to 1"));
    let (u, v) = text.split_once(',').ok_or_else(wrong)?;
    let [u, v] = [u, v].map(|number| number.trim().parse::<f64>().unwrap_or(f64::NAN));
    // What is no number is no direction either.
    if ![u, v].iter().all(|x| (-1.0..=1.0).contains(x)) {
        return Err(wrong());
    }
    let beyond = u.hypot(v).max(1.0);
    Ok([u / beyond, v / beyond])
}

/// A picture of the scene, for looking at, as a JPEG; of a frame taken after it was asked for.
///
/// Depth is coloured, from dark violet for far to yellow for near, evenly in the spacing; grey stripes are where it is
/// unknown. It needs no pose. A frame is made ready once, however many ask, and frames are left out rather than queued.
#[utoipa::path(
    get, path = "/api/v1/view.jpg", operation_id = "get_view_jpeg", tag = "frames", params(ViewAsked),
    responses(
        (status = 200, body = [u8], content_type = "image/jpeg", description = "The headers are those of \
         `frame.png`; depth has `Plenalign-Near-Mm` and `Plenalign-Far-Mm` too, where the pose is known"),
        (status = 409, description = "Nothing can be made of the frame (`not-viewable`), or distances are asked for and \
         the pose is not known (`pose-unknown`)", body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "No frame came in time", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn jpeg(State(app): State<App>, Query(asked): Query<ViewAsked>) -> Result<Response> {
    answer(&app, asked.scene(usual_mm(&app))?, Format::Jpeg { quality: asked.quality()? }).await
}

/// A picture of the scene with exact values, as a PNG of 16 bits; of a frame taken after it was asked for.
///
/// Views are in grey levels with the vignetting taken out: 65535 stands for a pixel saturated in the middle of its
/// micro-image. Depth is in tenths of a millimetre, 0 where unknown, and needs the camera's pose.
#[utoipa::path(
    get, path = "/api/v1/view.png", operation_id = "get_view_png", tag = "frames", params(ViewAsked),
    responses(
        (status = 200, body = [u8], content_type = "image/png", description = "The headers are those of `frame.png`"),
        (status = 409, description = "Nothing can be made of the frame (`not-viewable`), or distances are asked for and \
         the pose is not known (`pose-unknown`)", body = Problem, content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "No frame came in time", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn png(State(app): State<App>, Query(asked): Query<ViewAsked>) -> Result<Response> {
    asked.quality()?;
    answer(&app, asked.scene(usual_mm(&app))?, Format::Png).await
}

fn usual_mm(app: &App) -> f64 {
    app.service.config().object.distance_mm
}

async fn answer(app: &App, scene: Scene, format: Format) -> Result<Response> {
    let look = look(app).await?;
    if let (true, Err(why)) = (scene.needs_pose(format), &look.pose) {
        return Err(ServiceError::from(Refusal::PoseUnknown { why: why.clone() }).into());
    }
    let picture = picture(app, &look, scene, format).await?;
    let mut headers = frame_headers(&look.frame);
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let content_type = if format == Format::Png { "image/png" } else { "image/jpeg" };
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(content_type));
    if scene == Scene::Depth {
        depth_headers(&mut headers, &look);
    }
    if look.frame.simulated {
        let extension = if format == Format::Png { "png" } else { "jpg" };
        let name = format!("inline; filename=\"simulated-view-{}.{extension}\"", look.frame.seq);
        insert(&mut headers, header::CONTENT_DISPOSITION, &name);
    }
    Ok((headers, picture).into_response())
}

/// The distances that the ends of a depth's colours stand for, mm: far and near, where they are known.
pub(in crate::api) fn ends_mm(look: &Look) -> [Option<f64>; 2] {
    look.pictures.scale().map_or([None; 2], |scale| scale.distance_mm)
}

fn depth_headers(headers: &mut HeaderMap, look: &Look) {
    let [far, near] = ends_mm(look);
    for (name, distance_mm) in [("plenalign-near-mm", near), ("plenalign-far-mm", far)] {
        if let Some(distance_mm) = distance_mm {
            insert(headers, HeaderName::from_static(name), &format!("{distance_mm:.1}"));
        }
    }
}

/// The newest frame, made ready.
async fn look(app: &App) -> Result<Arc<Look>> {
    let max_age = Duration::from_millis(app.service.config().bench.camera.timeout_ms);
    let camera = app.service.bench().camera.as_ref();
    let frame = fresh(camera, max_age, Some(Instant::now())).await.map_err(|age| {
        let fault = camera.state().borrow().fault.clone();
        let why = fault.unwrap_or_else(|| format!("no frame came within {} ms", max_age.as_millis()));
        Problem::no_frame(why, age.map(milliseconds))
    })?;
    Ok(app.service.look_at(&frame).await.map_err(ServiceError::from)?)
}

/// A picture of a frame made ready, drawn once however many ask.
pub(in crate::api) async fn picture(
    app: &App,
    look: &Arc<Look>,
    scene: Scene,
    format: Format,
) -> Result<axum::body::Bytes> {
    let drawn = Arc::clone(look);
    let made =
        app.pictures.made(Encoding::Scene { scene, format }, look.frame.seq, move || draw(&drawn, scene, format));
    made.await.map_err(|error| match error {
        Some(error) => ServiceError::from(Refusal::NotViewable { why: error.to_string() }).into(),
        None => Problem::internal(),
    })
}

/// What is known about the newest frame's micro-images, its views and distances.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewReport {
    /// Sequence number of the frame.
    pub frame_seq: u64,
    /// When it was taken, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub captured_at: jiff::Timestamp,
    /// Its age when this was said, ms.
    pub frame_age_ms: f64,
    /// Whether both axes were at rest during the whole exposure.
    pub settled: bool,
    /// Whether this is a coarse picture for viewing only.
    pub preview: bool,
    /// Whether the frame was simulated.
    pub simulated: bool,
    /// Whether the frame was recorded earlier and is played from a file.
    pub replayed: bool,
    /// Whether grid and vignetting come from a white frame; without, they come from the frame itself.
    pub white_frame: bool,
    /// The micro-images together.
    #[serde(flatten)]
    pub depth: DepthFigures,
    /// Columns and rows of the central view.
    pub view_px: [usize; 2],
    /// Energy of gradient of the central view scaled to [0, 255] (Eq. 20), sum over its pixels.
    pub eog_sum: f64,
    /// The same a pixel.
    pub eog_mean_per_pixel: f64,
    /// Where the camera was; absent where that is not known, and then there are no distances.
    pub pose: Option<PoseView>,
    /// What of the pose is not known, and what would make it known.
    pub pose_unknown: Option<String>,
    /// The micro-images one by one, where they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lenses: Option<Vec<LensFigures>>,
}

/// What is to be said of the newest frame.
#[derive(Debug, Clone, Copy, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct ReportAsked {
    /// Whether the micro-images are wanted one by one.
    #[param(default = false)]
    lenses: Option<bool>,
}

/// The figures of the newest frame's views: micro-images, sizes, depth, EOG and SSIM; of a frame taken after they were
/// asked for.
#[utoipa::path(
    get, path = "/api/v1/view", operation_id = "get_view", tag = "frames", params(ReportAsked),
    responses(
        (status = 200, body = ViewReport),
        (status = 409, description = "Nothing can be made of the frame (`not-viewable`)", body = Problem,
         content_type = "application/problem+json"),
        (status = 422, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "No frame came in time", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn report(
    State(app): State<App>,
    Query(asked): Query<ReportAsked>,
) -> Result<Json<ViewReport>> {
    let look = look(&app).await?;
    let frame = &look.frame;
    Ok(Json(ViewReport {
        frame_seq: frame.seq,
        captured_at: frame.captured_at,
        frame_age_ms: milliseconds(age(frame)),
        settled: frame.is_settled(),
        preview: frame.preview,
        simulated: frame.simulated,
        replayed: frame.replayed,
        white_frame: look.white_frame,
        depth: look.pictures.figures(look.mla_pitch_px),
        view_px: [look.central.width, look.central.height],
        eog_sum: look.eog.sum,
        eog_mean_per_pixel: look.eog.mean_per_pixel,
        pose: look.pose.as_ref().ok().copied(),
        pose_unknown: look.pose.as_ref().err().cloned(),
        lenses: (asked.lenses == Some(true)).then(|| look.pictures.lens_figures(look.mla_pitch_px).collect()),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(kind: ViewKind, angle: Option<&str>, distance_mm: Option<f64>) -> std::result::Result<Scene, String> {
        let asked = ViewAsked { kind: Some(kind), angle: angle.map(str::to_owned), distance_mm, quality: None };
        asked.scene(650.0).map_err(|problem| problem.detail)
    }

    #[test]
    fn what_is_no_direction_or_distance_is_refused_by_name() {
        assert_eq!(asked(ViewKind::Central, Some("0.4,-0.2"), None), Ok(Scene::central([0.4, -0.2])));
        assert_eq!(asked(ViewKind::Refocus, None, Some(800.0)), Ok(Scene::refocused(800.0)));
        assert_eq!(asked(ViewKind::Refocus, None, None), Ok(Scene::refocused(650.0)));
        let edge = std::f64::consts::FRAC_1_SQRT_2;
        assert_eq!(asked(ViewKind::Central, Some("1,1"), None), Ok(Scene::central([edge, edge])));
        for (kind, angle, distance_mm, field) in [
            (ViewKind::Central, Some("1.1,0"), None, "angle"),
            (ViewKind::Central, Some("a,b"), None, "angle"),
            (ViewKind::Central, Some("0.5"), None, "angle"),
            (ViewKind::Depth, Some("0;0"), None, "angle"),
            (ViewKind::Refocus, None, Some(f64::NAN), "distance_mm"),
            (ViewKind::Refocus, None, Some(0.2), "distance_mm"),
        ] {
            let refused = asked(kind, angle, distance_mm).unwrap_err();
            assert!(refused.contains(field), "{kind:?} {angle:?} {distance_mm:?}: {refused}");
        }
    }
}
