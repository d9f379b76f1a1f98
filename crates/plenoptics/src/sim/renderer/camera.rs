//! The camera as it truly is, and the lattice of its microlenses.

use crate::optics::{ArrayKind, CameraDesign, Shell};

/// What is between the main lens and the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Medium {
    /// Air only: a board's distance is from M.
    Air,
    /// The shell, and water beyond it: a board's distance is from the outer vertex O.
    Water {
        /// The shell and the indices.
        shell: Shell,
        /// From the shell's centre C back to M, mm.
        e: f64,
        /// Where C is off the nominal axis, x and y, mm.
        decentre: [f64; 2],
    },
}

/// Everything that a ray meets between sensor and board, as it truly is. Lengths in mm, angles in radians.
///
/// The world's z axis is the nominal optical axis, from M towards the board; x and y are the sensor's right and down.
/// MLA and sensor are one rigid unit, tilted about the point where the axis meets the array. The main lens is a thin
/// lens with its aperture in its plane, tilted about M: a ray is bent in the lens's own frame, where its slope falls by
/// the height over f.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraTruth {
    /// f of the main lens, mm.
    pub focal_length: f64,
    /// d on the axis: main lens to MLA, mm.
    pub lens_to_mla: f64,
    /// b: MLA to sensor, mm.
    pub mla_to_sensor: f64,
    /// Arrangement of the microlenses. A hexagonal array has its rows, whose lenses touch, along its x axis.
    pub array: ArrayKind,
    /// D_MLA: made pitch, mm; also the diameter of a microlens's round aperture.
    pub mla_pitch: f64,
    /// f_MLA, mm.
    pub mla_focal_length: f64,
    /// Rotation of the array from +x towards +y, radians.
    pub rotation: f64,
    /// Where a microlens's centre is on the array, x and y from the axis, in sensor pixels. Its micro-image centre is
    /// that times (d + b)/d from the frame's centre.
    pub offset: [f64; 2],
    /// Side of a pixel, mm.
    pub pixel: f64,
    /// Columns of a frame.
    pub width: usize,
    /// Rows of a frame.
    pub height: usize,
    /// D_aper: diameter of the main lens's aperture, mm.
    pub aperture: f64,
    /// Tilt of MLA and sensor: d grows along +x and +y by these slopes.
    pub mla_tilt: [f64; 2],
    /// Tilt of the main lens: its +x and +y sides go towards the board by these slopes.
    pub lens_tilt: [f64; 2],
    /// Brown's k1 of the main lens: a chief ray's slope t on the object side leaves it as t (1 + k1 t²) on the image side.
    /// The law is one between directions before the lens and directions that an ideal lens would have had there, so that
    /// far objects stay sharp; near ones get the astigmatism that comes with it.
    pub distortion_k1: f64,
    /// How far the exit pupil's centre moves from M along the lens's axis, towards the board, for the field of slope 0.1
    /// on the object side (before distortion), mm; it grows with the slope's square (spherical aberration of the pupil).
    /// The stop's edge moves with its centre. Positive brings the outer micro-images nearer to the axis.
    pub pupil_walk: f64,
    /// Focal lengths of the types of microlenses over `mla_focal_length`: two types chequered in a square array, three in
    /// a hexagonal one ([`Self::microlens_type`]).
    pub focal_factors: [f64; 3],
    /// Whether a pixel sees through the microlens of its own micro-image only.
    pub baffled: bool,
    /// What is before the main lens.
    pub medium: Medium,
}

impl CameraTruth {
    /// The camera that a design describes, at a Δv (mm) and in a medium, with its aperture filling the micro-images
    /// (Eq. 14), an array without rotation or offset, baffled, and nothing tilted. `pixel` in mm.
    #[must_use]
    pub fn from_design(
        design: &CameraDesign,
        delta_v: f64,
        medium: Medium,
        pixel: f64,
        width: usize,
        height: usize,
    ) -> Self {
        Self {
            focal_length: design.main_lens.focal_length,
            lens_to_mla: design.lens_to_mla(delta_v),
            mla_to_sensor: design.mla.b(),
            array: design.mla.array,
            mla_pitch: design.mla.pitch,
            mla_focal_length: design.mla.focal_length,
            rotation: 0.0,
            offset: [0.0, 0.0],
            pixel,
            width,
            height,
            aperture: design.aperture(delta_v),
            mla_tilt: [0.0, 0.0],
            lens_tilt: [0.0, 0.0],
            distortion_k1: 0.0,
            pupil_walk: 0.0,
            focal_factors: [1.0; 3],
            baffled: true,
            medium,
        }
    }

    /// A place on the sensor, mm from the axis, for a position in the frame, px (pixel centres at integers).
    #[must_use]
    pub fn sensor_from_frame(&self, position: [f64; 2]) -> [f64; 2] {
        [
            (position[0] - (self.width as f64 - 1.0) / 2.0) * self.pixel,
            (position[1] - (self.height as f64 - 1.0) / 2.0) * self.pixel,
        ]
    }

    /// The inverse of [`Self::sensor_from_frame`].
    #[must_use]
    pub fn frame_from_sensor(&self, place: [f64; 2]) -> [f64; 2] {
        [
            place[0] / self.pixel + (self.width as f64 - 1.0) / 2.0,
            place[1] / self.pixel + (self.height as f64 - 1.0) / 2.0,
        ]
    }

    /// The type, 0 to 2, of the microlens with these lattice indices; (0, 0) is the one at `offset`. Chequered in a square
    /// array, types 0 and 1; in a hexagonal one three types of which no two alike are neighbours.
    #[must_use]
    pub const fn microlens_type(&self, index: [i32; 2]) -> usize {
        let [i, j] = index;
        match self.array {
            ArrayKind::Square => (i.wrapping_add(j)).rem_euclid(2) as usize,
            ArrayKind::Hexagonal => (i.wrapping_sub(j)).rem_euclid(3) as usize,
        }
    }

    /// f_MLA of a type of microlens, mm.
    #[must_use]
    pub const fn microlens_focal_length(&self, kind: usize) -> f64 {
        self.mla_focal_length * self.focal_factors[kind]
    }

    /// Half of the frame's width as a slope at M: the inner field's edge.
    #[must_use]
    pub fn half_field_slope(&self) -> f64 {
        self.width as f64 * self.pixel / (2.0 * (self.lens_to_mla + self.mla_to_sensor))
    }
}

/// Centres of the microlenses on the array's plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    origin: [f64; 2],
    basis: [[f64; 2]; 2],
    inverse: [[f64; 2]; 2],
    /// Directions of the microlenses around one, each with half its distance, mm.
    around: [([f64; 2], f64); 8],
}

/// The microlens nearest to a place on the array.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    /// Its lattice indices.
    pub(super) index: [f64; 2],
    /// Its centre, mm.
    pub(super) centre: [f64; 2],
    /// How far the place is from the border to the next nearest microlens, mm.
    pub(super) margin: f64,
}

impl Lattice {
    pub(super) fn new(camera: &CameraTruth) -> Self {
        let (sin, cos) = camera.rotation.sin_cos();
        let turn = |x: f64, y: f64| [camera.mla_pitch * (x * cos - y * sin), camera.mla_pitch * (x * sin + y * cos)];
        let second = match camera.array {
            ArrayKind::Square => turn(0.0, 1.0),
            ArrayKind::Hexagonal => turn(0.5, 0.75f64.sqrt()),
        };
        let basis = [turn(1.0, 0.0), second];
        let determinant = basis[0][0] * basis[1][1] - basis[1][0] * basis[0][1];
        let inverse = [
            [basis[1][1] / determinant, -basis[1][0] / determinant],
            [-basis[0][1] / determinant, basis[0][0] / determinant],
        ];
        let around =
            [(1.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, -1.0), (-1.0, -1.0)].map(
                |(i, j)| {
                    let to = [i * basis[0][0] + j * basis[1][0], i * basis[0][1] + j * basis[1][1]];
                    let length = to[0].hypot(to[1]);
                    ([to[0] / length, to[1] / length], length / 2.0)
                },
            );
        let origin = [camera.offset[0] * camera.pixel, camera.offset[1] * camera.pixel];
        Self { origin, basis, inverse, around }
    }

    /// Centre of the microlens with these indices, mm.
    #[inline(always)]
    pub(super) fn centre(&self, i: f64, j: f64) -> [f64; 2] {
        [
            self.origin[0] + i * self.basis[0][0] + j * self.basis[1][0],
            self.origin[1] + i * self.basis[0][1] + j * self.basis[1][1],
        ]
    }

    /// How many steps of `step` mm along +x from `place` stay more than `margin` mm inside the cell of the microlens at
    /// `centre`; none where `place` itself does not lie so.
    #[inline(always)]
    pub(super) fn steps_inside(&self, centre: [f64; 2], place: [f64; 2], step: f64, margin: f64) -> usize {
        let mut steps = f64::INFINITY;
        for (direction, border) in &self.around {
            let along = (place[0] - centre[0]) * direction[0] + (place[1] - centre[1]) * direction[1];
            let nearing = step * direction[0];
            if nearing > 0.0 {
                steps = steps.min((border - margin - along) / nearing);
            }
        }
        steps.max(0.0) as usize
    }

    /// Centre of the microlens nearest to `place` alone, mm: without branches, which border pixels would mispredict.
    #[inline(always)]
    pub(super) fn nearest_centre(&self, place: [f64; 2]) -> [f64; 2] {
        let x = place[0] - self.origin[0];
        let y = place[1] - self.origin[1];
        let i = (self.inverse[0][0] * x + self.inverse[0][1] * y).floor();
        let j = (self.inverse[1][0] * x + self.inverse[1][1] * y).floor();
        let corner = self.centre(i, j);
        let from = [place[0] - corner[0], place[1] - corner[1]];
        let (mut found_i, mut found_j, mut least) = (0.0, 0.0, f64::INFINITY);
        for (di, dj) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let dx = di * self.basis[0][0] + dj * self.basis[1][0] - from[0];
            let dy = di * self.basis[0][1] + dj * self.basis[1][1] - from[1];
            let distance = dx * dx + dy * dy;
            let nearer = distance < least;
            found_i = if nearer { di } else { found_i };
            found_j = if nearer { dj } else { found_j };
            least = if nearer { distance } else { least };
        }
        self.centre(i + found_i, j + found_j)
    }

    /// The microlens nearest to `place` (mm): among the corners of the cell the place is in, for both arrays.
    #[inline(always)]
    pub(super) fn nearest(&self, place: [f64; 2]) -> Nearest {
        let x = place[0] - self.origin[0];
        let y = place[1] - self.origin[1];
        let i = (self.inverse[0][0] * x + self.inverse[0][1] * y).floor();
        let j = (self.inverse[1][0] * x + self.inverse[1][1] * y).floor();
        let corner = self.centre(i, j);
        let from = [place[0] - corner[0], place[1] - corner[1]];
        let mut found = [0.0, 0.0];
        let (mut least, mut second) = ((f64::INFINITY, [0.0; 2]), (f64::INFINITY, [0.0; 2]));
        for (di, dj) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let to = [
                di * self.basis[0][0] + dj * self.basis[1][0] - from[0],
                di * self.basis[0][1] + dj * self.basis[1][1] - from[1],
            ];
            let distance = to[0] * to[0] + to[1] * to[1];
            if distance < least.0 {
                second = least;
                least = (distance, to);
                found = [i + di, j + dj];
            } else if distance < second.0 {
                second = (distance, to);
            }
        }
        // How far the bisector of the two nearest is.
        let apart = ((second.1[0] - least.1[0]).powi(2) + (second.1[1] - least.1[1]).powi(2)).sqrt();
        Nearest { index: found, centre: self.centre(found[0], found[1]), margin: (second.0 - least.0) / (2.0 * apart) }
    }
}
