//! The model of an underwater plenoptic camera: pure functions, no I/O, clock, async or logging.
//!
//! The source is *Underwater plenoptic cameras optimized for water refraction*, Optics Express 31(13), 21464 (2023);
//! equation numbers in this module are that paper's. All lengths are millimetres and all angles radians unless a name
//! says otherwise.
//!
//! ```text
//!   board         shell              main lens        MLA  sensor
//!     A        O ( O' (    C           M               |    |
//!     |          (    (    +           |               |    |
//!     |<--d_OBJ->|    |<-->|<--- e --->|<----- d ----->|<-b>|
//!     |          |<-->|<R_i>                           |<----- a ----->A'''  (Galilean: the main lens's image is
//!     |        thickness               |<------------ v ------------->|       behind the MLA)
//! ```
//!
//! | paper | identifier | meaning | sign and plane |
//! |---|---|---|---|
//! | d_OBJ | `object_distance` | object distance; in water from O, the shell's outer vertex; in air from M | > 0 |
//! | l_OC, l_O'C | `outer_radius`, `inner_radius` | radii of the shell's concentric spheres about C | > 0 |
//! | l_O'O | `thickness()` | outer less inner radius | > 0 |
//! | e | `e` | from C back to the main lens's principal point M | > 0: lens further from the water |
//! | l_A''M | `equivalent_distance` | where the main lens believes the object is | from M, > 0 |
//! | f | `focal_length` | focal length of the main lens | > 0 |
//! | v | `image_distance` | image distance of the main lens | from M |
//! | Δv | `delta_v` | image distance less that of the air design | > 0: MLA and sensor further from the lens |
//! | d | `lens_to_mla` | main lens to MLA | v = d + a with a signed |
//! | a | `a` | MLA object distance | signed: Galilean > 0, Keplerian < 0 |
//! | b | `b` | MLA to sensor | > 0 |
//! | f_MLA | `focal_length` of [`Mla`] | focal length of a microlens | > 0 |
//! | N | `angular_resolution` | a / b, reported positive | > 1 in Galilean mode |
//! | D_MLA | `pitch` of [`Mla`] | made pitch of the microlenses, not the pitch of the micro-images | > 0 |
//! | l_P0P1 | `spacing` | distance on the sensor between the image points of one object point under adjacent microlenses | > 0 |
//! | D_aper | `aperture` | diameter of the main lens's aperture | > 0 |
//! | l_bound | `l_bound` | least e that the lens's barrel allows before it touches the shell | may be < 0 |
//!
//! With a signed a (Keplerian a < 0) one set of formulas serves both modes: 1/b − 1/a = 1/f_MLA and v = d + a.

pub mod curves;
pub mod decentred;
pub mod design;
pub mod distance;
pub mod exact;
pub mod field_of_view;
pub mod main_lens;
pub mod mla;
pub mod report;
pub mod shell;
pub mod tolerance;
pub mod trace;
pub mod train;
pub mod water;

pub use curves::{AtE, distances_about};
pub use decentred::Decentring;
pub use design::{CameraDesign, Solution};
pub use distance::DistanceTable;
pub use exact::{ExactView, WindowPoint, disc_window, overlap_window, through_whole_lens};
pub use field_of_view::{EBounds, SensorExtent};
pub use main_lens::MainLens;
pub use mla::{ArrayKind, Mla, MlaMode};
pub use report::{DesignReport, SolutionReport};
pub use shell::Shell;
pub use tolerance::{DepthOfField, EInterval};
pub use trace::Ray;
pub use train::{RayBundle, TrainPoint, TrainPose};

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The reference camera, inferred from the paper's Table 2.
    pub(crate) fn reference_camera() -> CameraDesign {
        CameraDesign {
            main_lens: MainLens { focal_length: 20.0 },
            mla: Mla {
                array: ArrayKind::Square,
                pitch: 0.1,
                focal_length: 0.5,
                angular_resolution: 3.13,
                mode: MlaMode::Galilean,
            },
            shell: Shell { outer_radius: 59.0, inner_radius: 51.0, n_shell: 1.49, n_water: 1.333 },
            air_distance: 800.0,
            object_distance: 800.0,
        }
    }

    /// A Keplerian camera behind a thin shell.
    pub(crate) fn keplerian_camera() -> CameraDesign {
        CameraDesign {
            main_lens: MainLens { focal_length: 25.0 },
            mla: Mla {
                array: ArrayKind::Hexagonal,
                pitch: 0.15,
                focal_length: 0.6,
                angular_resolution: 4.0,
                mode: MlaMode::Keplerian,
            },
            shell: Shell { outer_radius: 75.0, inner_radius: 72.0, n_shell: 1.49, n_water: 1.333 },
            air_distance: 600.0,
            object_distance: 600.0,
        }
    }
}
