//! The paper's four cases: the air camera for reference, the shell added to it directly, clarity and joint optimisation.

use crate::config::Config;
use crate::optics::{CameraDesign, ExactView};
use crate::sim::renderer::Medium;

/// A camera at one of its stages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Case {
    /// The paper's name, in short.
    pub(super) name: &'static str,
    /// Δv, mm.
    pub(super) delta_v: f64,
    /// e (mm) behind the shell under water; `None` in air without a shell.
    pub(super) e: Option<f64>,
}

impl Case {
    /// What is before the main lens.
    pub(super) const fn medium(&self, design: &CameraDesign) -> Medium {
        match self.e {
            None => Medium::Air,
            Some(e) => Medium::Water { shell: design.shell, e, decentre: [0.0; 2] },
        }
    }

    /// The camera before a board at its design's distance.
    pub(super) fn view(&self, design: &CameraDesign) -> ExactView {
        match self.e {
            None => design.exact_in_air(self.delta_v, design.air_distance),
            Some(e) => design.exact_in_water(self.delta_v, e),
        }
    }

    /// The design's distance of the board: in air from M, in water from O, mm.
    pub(super) const fn distance(&self, design: &CameraDesign) -> f64 {
        match self.e {
            None => design.air_distance,
            Some(_) => design.object_distance,
        }
    }
}

/// The four cases of a configuration, in the paper's order.
pub(super) fn cases(config: &Config) -> [Case; 4] {
    let (design, assembly) = (config.design(), &config.assembly);
    let (clarity, joint) = (design.clarity(assembly.initial_e_mm), design.joint(assembly.l_bound_mm));
    [
        Case { name: "air", delta_v: 0.0, e: None },
        Case { name: "direct", delta_v: 0.0, e: Some(assembly.initial_e_mm) },
        Case { name: "clarity", delta_v: clarity.delta_v, e: Some(clarity.e) },
        Case { name: "joint", delta_v: joint.delta_v, e: Some(joint.e) },
    ]
}
