//! The design as a caller sees it: what the command line prints and the API serves.

pub mod draft;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::job::Interval;
use bench::config::{Config, ConfigOrigin};
use plenoptics::optics::{DesignReport, SolutionReport};
use plenoptics::units::Millimetres;

/// A solution: Δv and e that put the object in focus, and what follows from them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SolutionView {
    /// Δv, mm: positive where MLA and sensor move away from the lens.
    pub delta_v_mm: f64,
    /// e, mm: positive where the lens is behind the shell's centre.
    pub e_mm: f64,
    /// l_A''M, where the lens believes the object is, mm from the lens.
    pub equivalent_distance_mm: f64,
    /// v + Δv, mm.
    pub image_distance_mm: f64,
    /// Aperture diameter after the change, mm.
    pub aperture_mm: f64,
    /// Change of the aperture diameter against the air design, mm.
    pub aperture_change_mm: f64,
    /// Working f-number: image distance over aperture diameter.
    pub main_lens_f_number: f64,
    /// The number on the lens's ring: focal length over aperture diameter.
    pub aperture_ring_f_number: f64,
    /// Field of view inside the shell over the sensor's width, degrees.
    pub fov_inner_deg: f64,
    /// Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it.
    pub fov_water_deg: Option<f64>,
    /// Half the width of board seen at the object distance in water, mm; null as for `fov_water_deg`.
    pub half_width_mm: Option<f64>,
}

/// The air design, from which the solutions depart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AirDesignView {
    /// Object distance in air, mm from the lens.
    pub object_distance_mm: f64,
    /// v, mm.
    pub image_distance_mm: f64,
    /// Aperture diameter, mm.
    pub aperture_mm: f64,
    /// Field of view over the sensor's width, degrees.
    pub fov_deg: f64,
    /// Half the width of board seen at the object distance in air, mm.
    pub half_width_mm: f64,
}

/// The air design with the shell added at the initial e and nothing optimised.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DirectView {
    /// e, mm.
    pub e_mm: f64,
    /// Field of view in water over the sensor's width, degrees; null where the shell's rim cuts it.
    pub fov_water_deg: Option<f64>,
    /// Half the width of board seen at the object distance in water, mm; null as for `fov_water_deg`.
    pub half_width_mm: Option<f64>,
}

/// The microlens array at the design point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MlaView {
    /// a, mm, reported positive in both modes.
    pub a_mm: f64,
    /// b, mm.
    pub b_mm: f64,
    /// b over the pitch.
    pub f_number: f64,
}

/// Object distances in water between which the picture is sharp.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DepthOfFieldView {
    /// Nearest, mm from the shell's outer vertex.
    pub near_mm: f64,
    /// Furthest, mm from the shell's outer vertex; null for infinity.
    pub far_mm: Option<f64>,
}

/// Everything that the configured design comes to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DesignView {
    /// Where the design's numbers come from.
    pub origin: String,
    /// The air design.
    pub air: AirDesignView,
    /// The shell added directly.
    pub direct: DirectView,
    /// FOV optimisation (Eq. 13): the e that keeps the field of view, mm.
    pub fov_optimal_e_mm: f64,
    /// Clarity optimisation: Δv for the initial e (Eq. 8).
    pub clarity: SolutionView,
    /// Joint optimisation: e of the FOV optimisation and the Δv that belongs to it.
    pub joint: SolutionView,
    /// The microlens array.
    pub mla: MlaView,
    /// Spacing in focus (Eq. 16), px.
    pub spacing_target_px: f64,
    /// Depth for half a pixel of parallax of the air design in air, mm: between adjacent lenses, and between lenses
    /// three pitches apart, as the paper's figure is.
    pub depth_resolution_mm: [f64; 2],
    /// The same in water at the joint solution, mm.
    pub depth_resolution_water_mm: [f64; 2],
    /// Greatest e that keeps the shell's rim out of the picture's corners, mm.
    pub e_max_mm: f64,
    /// Diameter of the blur disc still called sharp, px.
    pub blur_limit_px: f64,
    /// Depth of field at the joint solution; null where nothing is sharp.
    pub depth_of_field: Option<DepthOfFieldView>,
    /// e values between which the blur stays within the limit at the joint solution, Δv held.
    pub e_tolerance: Interval,
    /// Refractive index of the water, relative to air.
    pub water_refractive_index: f64,
    /// What is allowed and yet worth a word, one sentence each.
    pub notices: Vec<String>,
}

impl DesignView {
    /// The design of a checked configuration.
    #[must_use]
    pub fn of(config: &Config, origin: &ConfigOrigin) -> Self {
        let design = config.design();
        let report: DesignReport = design.report(&config.design_criteria());
        Self {
            origin: origin.describe(config),
            air: AirDesignView {
                object_distance_mm: design.air_distance,
                image_distance_mm: report.air_image_distance,
                aperture_mm: report.air_aperture,
                fov_deg: report.air_fov.to_degrees(),
                half_width_mm: report.air_half_width,
            },
            direct: DirectView {
                e_mm: config.assembly.initial_e_mm,
                fov_water_deg: report.direct_fov_water.map(f64::to_degrees),
                half_width_mm: report.direct_half_width,
            },
            fov_optimal_e_mm: report.fov_optimal_e,
            clarity: solution_view(&report.clarity),
            joint: solution_view(&report.joint),
            mla: MlaView { a_mm: design.mla.a().abs(), b_mm: design.mla.b(), f_number: design.mla.f_number() },
            spacing_target_px: config.pixel_pitch().to_pixels(Millimetres(report.spacing_target)).value(),
            depth_resolution_mm: report.depth_resolution_air,
            depth_resolution_water_mm: report.depth_resolution_water,
            e_max_mm: report.e_max,
            blur_limit_px: config.assembly.blur_limit_px,
            depth_of_field: report
                .depth_of_field
                .map(|depth| DepthOfFieldView { near_mm: depth.near, far_mm: depth.far }),
            e_tolerance: Interval {
                low_mm: report.e_tolerance.and_then(|interval| interval.low),
                high_mm: report.e_tolerance.and_then(|interval| interval.high),
            },
            water_refractive_index: design.shell.n_water,
            notices: config.notices(),
        }
    }
}

fn solution_view(report: &SolutionReport) -> SolutionView {
    let solution = &report.solution;
    SolutionView {
        delta_v_mm: solution.delta_v,
        e_mm: solution.e,
        equivalent_distance_mm: solution.equivalent_distance,
        image_distance_mm: solution.image_distance,
        aperture_mm: solution.aperture,
        aperture_change_mm: solution.aperture_change,
        main_lens_f_number: solution.main_lens_f_number,
        aperture_ring_f_number: report.aperture_ring_f_number,
        fov_inner_deg: report.fov_inner.to_degrees(),
        fov_water_deg: report.fov_water.map(f64::to_degrees),
        half_width_mm: report.half_width,
    }
}
