//! A draft of a camera, worked out: nothing of it is kept, and nothing moves.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::{DepthOfFieldView, DesignView};
use crate::job::Interval;
use bench::config::{Config, ConfigOrigin, Violation};
use plenoptics::optics::{AtE, CameraDesign, DepthOfField, RayBundle, TrainPose, distances_about};
use plenoptics::units::Millimetres;

/// The sections of the configuration that describe the camera.
pub const SECTIONS: [&str; 8] = ["main_lens", "mla", "sensor", "shell", "water", "object", "boards", "assembly"];
/// Places on the curves over e, and on those over the distance.
const PLACES: usize = 121;
/// The curves over the distance run from this part of the object distance to this multiple.
const DISTANCE_FACTOR: f64 = 4.0;
/// By how much the curves over e go beyond the values of e that the design names, mm.
const E_MARGIN_MM: f64 = 5.0;

/// Which of a camera's states.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DraftStateName {
    /// The air design, in air and without the shell.
    Reference,
    /// The shell added to the air design at the initial e, in water, nothing optimised.
    Direct,
    /// Clarity optimisation: Δv for the initial e.
    Clarity,
    /// Joint optimisation: Δv and e.
    Joint,
}

/// When Δv has to be re-optimised, e held: once the object is beyond an end of the depth of field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReoptimiseView {
    /// Δv that focuses on the near end, mm; null where nothing is too near.
    pub near_delta_v_mm: Option<f64>,
    /// Δv that focuses on the far end, mm; null where nothing is too far.
    pub far_delta_v_mm: Option<f64>,
}

/// A ray: points from the sensor to the object, each as a distance along the axis from the main lens, positive towards
/// the object, and one beside the axis, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RayView {
    /// Where on the sensor its image lies: -1 and 1 are the edges, 0 the axis.
    pub field: f64,
    /// The points.
    pub points_mm: Vec<[f64; 2]>,
}

/// A camera's state and what it comes to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DraftStateView {
    /// Which state.
    pub state: DraftStateName,
    /// Δv, mm: positive where MLA and sensor move away from the lens.
    pub delta_v_mm: f64,
    /// e, mm: positive where the lens is behind the shell's centre; null in air.
    pub e_mm: Option<f64>,
    /// From the main lens to the MLA, mm.
    pub lens_to_mla_mm: f64,
    /// Where the object is focused, mm from the main lens; null where nowhere.
    pub image_distance_mm: Option<f64>,
    /// Aperture diameter, mm.
    pub aperture_mm: f64,
    /// The number on the lens's ring: focal length over aperture diameter.
    pub aperture_ring_f_number: f64,
    /// Field of view over the sensor's width, degrees, in air for the air design and in water for the rest; null where
    /// the shell's rim cuts it.
    pub fov_deg: Option<f64>,
    /// Width of board seen at the object distance, mm; null likewise.
    pub board_width_mm: Option<f64>,
    /// Diameter of the blur disc of the object at its distance, px.
    pub blur_px: f64,
    /// Between which distances it is sharp; null where nothing is.
    pub depth_of_field: Option<DepthOfFieldView>,
    /// Values of e between which the object stays sharp, Δv held; null in air, and where no e makes it sharp.
    pub e_tolerance: Option<Interval>,
    /// When Δv has to be re-optimised; null where nothing is sharp.
    pub reoptimise: Option<ReoptimiseView>,
    /// Rays of three points of the object, three each, as far as light comes that way.
    pub rays: Vec<RayView>,
}

/// Figures over e, with Δv re-optimised at each.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OverEView {
    /// e, mm.
    pub e_mm: Vec<f64>,
    /// Δv in focus, mm; null where nothing is imaged.
    pub delta_v_mm: Vec<Option<f64>>,
    /// Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it.
    pub fov_deg: Vec<Option<f64>>,
}

/// The blur over the object distance: of the air design in air from the lens, of the rest in water from the shell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OverDistanceView {
    /// Object distance, mm.
    pub distance_mm: Vec<f64>,
    /// Diameter of the blur disc of the air design, px; null where nothing is imaged, here and below.
    pub reference_px: Vec<Option<f64>>,
    /// Of the shell added directly, px.
    pub direct_px: Vec<Option<f64>>,
    /// Of the clarity solution, px.
    pub clarity_px: Vec<Option<f64>>,
    /// Of the joint solution, px.
    pub joint_px: Vec<Option<f64>>,
}

/// Something that keeps a draft from being the bench's camera.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ObstacleView {
    /// The key of the configuration, dotted from the root.
    pub key: String,
    /// What is in the way.
    pub message: String,
}

impl From<&Violation> for ObstacleView {
    fn from(violation: &Violation) -> Self {
        Self { key: violation.key.clone(), message: violation.message.clone() }
    }
}

/// What a draft comes to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DraftView {
    /// The camera's sections of the configuration with every value, those left out filled in.
    #[schema(value_type = Object)]
    pub config: Value,
    /// The design's figures.
    pub design: DesignView,
    /// The camera's states: air design, shell added directly, clarity, joint.
    pub states: Vec<DraftStateView>,
    /// Δv and field of view over e.
    pub over_e: OverEView,
    /// Blur over the object distance.
    pub over_distance: OverDistanceView,
    /// Why this bench could not align this camera; empty where it could.
    pub obstacles: Vec<ObstacleView>,
}

impl DraftView {
    /// Works out the camera of a configuration that [`Config::drafted`] gave, or of a checked one. `None` where its
    /// numbers, though each could be, come to no finite ones.
    #[must_use]
    pub fn of(config: &Config, origin: &ConfigOrigin) -> Option<Self> {
        let design = config.design();
        let view = DesignView::of(config, origin);
        let mut sections = serde_json::to_value(config).ok()?;
        sections.as_object_mut()?.retain(|name, _| SECTIONS.contains(&name.as_str()));
        let states = states(config, &design, &view);
        let named = [view.clarity.e_mm, view.joint.e_mm, config.assembly.l_bound_mm];
        let low = named.into_iter().fold(0.0, f64::min) - E_MARGIN_MM;
        let high = named.into_iter().fold(0.0, f64::max) + E_MARGIN_MM;
        let curve = design.over_e(config.sensor_extent().width, low, high, PLACES);
        let obstacles = config.validate().err().map(|error| error.violations().iter().map(Into::into).collect());
        let draft = Self {
            config: sections,
            over_e: over_e(&curve),
            over_distance: over_distance(config, &design, &states),
            design: view,
            states,
            obstacles: obstacles.unwrap_or_default(),
        };
        // JSON has no number for what is not finite, and a client reads none: such an answer would not be what it is
        // said to be.
        let written = serde_json::to_value(&draft).ok()?;
        Self::deserialize(&written).is_ok().then_some(draft)
    }
}

fn states(config: &Config, design: &CameraDesign, view: &DesignView) -> Vec<DraftStateView> {
    use DraftStateName::{Clarity, Direct, Joint, Reference};
    let initial = config.assembly.initial_e_mm;
    [
        (Reference, 0.0, None, view.air.aperture_mm, Some(view.air.fov_deg), Some(view.air.half_width_mm)),
        (Direct, 0.0, Some(initial), view.air.aperture_mm, view.direct.fov_water_deg, view.direct.half_width_mm),
        solution(Clarity, &view.clarity),
        solution(Joint, &view.joint),
    ]
    .map(|(state, delta_v, e, aperture, fov_deg, half_width)| {
        let limit = config.blur_limit().value();
        let equivalent = match e {
            None => design.air_distance,
            Some(e) => design.shell.equivalent_distance(design.object_distance, e),
        };
        let depth = match e {
            None => design.depth_of_field_in_air(delta_v, limit),
            Some(e) => design.depth_of_field(delta_v, e, limit),
        };
        let tolerance = e.and_then(|_| design.e_tolerance(delta_v, limit));
        let pose = TrainPose { delta_v, e, aperture, sensor_width: config.sensor_extent().width };
        DraftStateView {
            state,
            delta_v_mm: delta_v,
            e_mm: e,
            lens_to_mla_mm: design.lens_to_mla(delta_v),
            image_distance_mm: (equivalent > design.main_lens.focal_length)
                .then(|| design.main_lens.image_distance(equivalent)),
            aperture_mm: aperture,
            aperture_ring_f_number: design.main_lens.ring_f_number(aperture),
            fov_deg,
            board_width_mm: half_width.map(|half| 2.0 * half),
            blur_px: blur_px(config, design, delta_v, e, e.map_or(design.air_distance, |_| design.object_distance)),
            depth_of_field: depth.map(|depth| DepthOfFieldView { near_mm: depth.near, far_mm: depth.far }),
            e_tolerance: tolerance.map(|interval| Interval { low_mm: interval.low, high_mm: interval.high }),
            reoptimise: depth.map(|depth| reoptimise(design, &depth, e)),
            rays: design.optical_train(&pose).into_iter().flat_map(rays).collect(),
        }
    })
    .into()
}

/// State, Δv, e, aperture, field of view and half the width of board.
type Known = (DraftStateName, f64, Option<f64>, f64, Option<f64>, Option<f64>);

fn solution(state: DraftStateName, view: &super::SolutionView) -> Known {
    (state, view.delta_v_mm, Some(view.e_mm), view.aperture_mm, view.fov_water_deg, view.half_width_mm)
}

fn reoptimise(design: &CameraDesign, depth: &DepthOfField, e: Option<f64>) -> ReoptimiseView {
    let delta_v = |distance: f64| match e {
        None => design.delta_v_for_equivalent(distance),
        Some(e) => design.reoptimised(distance, e).delta_v,
    };
    ReoptimiseView {
        near_delta_v_mm: (depth.near > 0.0).then(|| delta_v(depth.near)),
        far_delta_v_mm: depth.far.map(delta_v),
    }
}

fn rays(bundle: RayBundle) -> impl Iterator<Item = RayView> {
    let field = bundle.field;
    bundle.rays.into_iter().map(move |points_mm| RayView { field, points_mm })
}

/// Diameter of the blur disc, px, of an object at a distance (mm), in air where there is no e.
fn blur_px(config: &Config, design: &CameraDesign, delta_v: f64, e: Option<f64>, distance: f64) -> f64 {
    let blur = match e {
        None => design.blur_in_air(distance, delta_v),
        Some(e) => design.blur_at(distance, delta_v, e),
    };
    config.pixel_pitch().to_pixels(Millimetres(blur)).value()
}

fn over_e(curve: &[AtE]) -> OverEView {
    OverEView {
        e_mm: curve.iter().map(|at| at.e).collect(),
        delta_v_mm: curve.iter().map(|at| at.delta_v).collect(),
        fov_deg: curve.iter().map(|at| at.fov_water.map(f64::to_degrees)).collect(),
    }
}

fn over_distance(config: &Config, design: &CameraDesign, states: &[DraftStateView]) -> OverDistanceView {
    let distances = distances_about(design.object_distance, DISTANCE_FACTOR, PLACES);
    let blurs = |name: DraftStateName| {
        let Some(state) = states.iter().find(|state| state.state == name) else { return Vec::new() };
        let imaged = |distance: f64| match state.e_mm {
            None => distance > design.main_lens.focal_length,
            Some(e) => design.shell.equivalent_distance(distance, e) > design.main_lens.focal_length,
        };
        let blur =
            |&distance: &f64| imaged(distance).then(|| blur_px(config, design, state.delta_v_mm, state.e_mm, distance));
        distances.iter().map(blur).collect()
    };
    OverDistanceView {
        reference_px: blurs(DraftStateName::Reference),
        direct_px: blurs(DraftStateName::Direct),
        clarity_px: blurs(DraftStateName::Clarity),
        joint_px: blurs(DraftStateName::Joint),
        distance_mm: distances,
    }
}
