//! Everything that a design comes to, in one value: what an optical engineer reads before building.

use super::{CameraDesign, DepthOfField, EInterval, SensorExtent, Solution};

/// What the design is judged against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignCriteria {
    /// The sensor's extent, mm.
    pub sensor: SensorExtent,
    /// Side of a pixel, mm.
    pub pixel: f64,
    /// e of the clarity solution: where the lens stands when the shell is mounted, mm.
    pub initial_e: f64,
    /// l_bound, mm.
    pub l_bound: f64,
    /// δ: diameter of the blur disc still called sharp, mm on the sensor.
    pub blur_limit: f64,
}

/// A solution with its fields of view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolutionReport {
    /// Δv, e and what follows paraxially.
    pub solution: Solution,
    /// f / D_aper: the number on the lens's ring.
    pub aperture_ring_f_number: f64,
    /// Inner field of view over the sensor's width, rad.
    pub fov_inner: f64,
    /// Field of view in water over the sensor's width, rad; `None` where the shell's rim cuts it.
    pub fov_water: Option<f64>,
    /// Half the width of board seen at the object distance in water, mm; `None` as for `fov_water`.
    pub half_width: Option<f64>,
}

/// Everything that a design comes to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignReport {
    /// v of the air design, mm from M.
    pub air_image_distance: f64,
    /// Inner field of view of the air design over the sensor's width, rad.
    pub air_fov: f64,
    /// Half the width of board that the air design sees at its own distance in air, mm.
    pub air_half_width: f64,
    /// D_aper of the air design, mm.
    pub air_aperture: f64,
    /// Field of view in water over the sensor's width with the shell added to the air design at the initial e and
    /// nothing optimised, rad; `None` where the shell's rim cuts it.
    pub direct_fov_water: Option<f64>,
    /// Half the width of board seen then at the object distance in water, mm; `None` likewise.
    pub direct_half_width: Option<f64>,
    /// FOV optimisation (Eq. 13): the e that keeps the field of view, mm.
    pub fov_optimal_e: f64,
    /// Clarity solution at the initial e (Eq. 8).
    pub clarity: SolutionReport,
    /// Joint solution (Eqs. 5, 8, 13).
    pub joint: SolutionReport,
    /// Eq. 16: the in-focus spacing, mm on the sensor.
    pub spacing_target: f64,
    /// Depth for half a pixel of parallax, over one and over three lens pitches, of the air design in air, mm.
    pub depth_resolution_air: [f64; 2],
    /// The same in water at the joint solution, mm.
    pub depth_resolution_water: [f64; 2],
    /// Greatest e that clears the shell's rim over the sensor's diagonal at the joint solution, mm.
    pub e_max: f64,
    /// Depth of field at the joint solution; `None` where nothing in the water is within the limit.
    pub depth_of_field: Option<DepthOfField>,
    /// Tolerance of e at the joint solution, Δv held; `None` where no e is within the limit.
    pub e_tolerance: Option<EInterval>,
}

impl SolutionReport {
    fn numbers(&self) -> [f64; 11] {
        let Solution { e, delta_v, equivalent_distance, image_distance, aperture, aperture_change, main_lens_f_number } =
            self.solution;
        [
            delta_v,
            e,
            equivalent_distance,
            image_distance,
            aperture,
            aperture_change,
            main_lens_f_number,
            self.aperture_ring_f_number,
            self.fov_inner,
            self.fov_water.unwrap_or(0.0),
            self.half_width.unwrap_or(0.0),
        ]
    }
}

impl DesignReport {
    /// Whether every number that there is is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let depth = self.depth_of_field.map(|depth| [Some(depth.near), depth.far]);
        let tolerance = self.e_tolerance.map(|e| [e.low, e.high]);
        let optional =
            [[self.direct_fov_water, self.direct_half_width], depth.unwrap_or_default(), tolerance.unwrap_or_default()];
        let alone = [
            self.air_image_distance,
            self.air_fov,
            self.air_half_width,
            self.air_aperture,
            self.fov_optimal_e,
            self.spacing_target,
            self.e_max,
        ];
        let all = [
            &alone[..],
            &self.clarity.numbers(),
            &self.joint.numbers(),
            &self.depth_resolution_air,
            &self.depth_resolution_water,
        ];
        all.concat().into_iter().chain(optional.into_iter().flatten().flatten()).all(f64::is_finite)
    }
}

impl CameraDesign {
    /// Works the whole design out.
    #[must_use]
    pub fn report(&self, criteria: &DesignCriteria) -> DesignReport {
        let width = criteria.sensor.width;
        let with_view = |solution: Solution| SolutionReport {
            solution,
            aperture_ring_f_number: self.main_lens.ring_f_number(solution.aperture),
            fov_inner: self.inner_fov(width, solution.delta_v),
            fov_water: self.fov_in_water(width, solution.delta_v, solution.e),
            half_width: self.half_width_in_water(width, solution.delta_v, solution.e),
        };
        let joint = self.joint(criteria.l_bound);
        let half_pixel = 0.5 * criteria.pixel;
        let in_air = |pitches| self.depth_resolution_in_air(self.air_distance, 0.0, half_pixel, pitches);
        let in_water =
            |pitches| self.depth_resolution_in_water(self.object_distance, joint.delta_v, joint.e, half_pixel, pitches);
        DesignReport {
            air_image_distance: self.air_image_distance(),
            air_fov: self.inner_fov(width, 0.0),
            air_half_width: self.half_width_in_air(width, 0.0, self.air_distance),
            air_aperture: self.aperture(0.0),
            direct_fov_water: self.fov_in_water(width, 0.0, criteria.initial_e),
            direct_half_width: self.half_width_in_water(width, 0.0, criteria.initial_e),
            fov_optimal_e: Self::fov_optimal_e(criteria.l_bound),
            clarity: with_view(self.clarity(criteria.initial_e)),
            joint: with_view(joint),
            spacing_target: self.mla.target_spacing(),
            depth_resolution_air: [1.0, 3.0].map(in_air),
            depth_resolution_water: [1.0, 3.0].map(in_water),
            e_max: self.e_bounds(&criteria.sensor, criteria.l_bound, joint.delta_v).high,
            depth_of_field: self.depth_of_field(joint.delta_v, joint.e, criteria.blur_limit),
            e_tolerance: self.e_tolerance(joint.delta_v, criteria.blur_limit),
        }
    }
}
