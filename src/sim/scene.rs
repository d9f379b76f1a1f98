//! What stands before the simulated camera.

use std::sync::Arc;

use super::renderer::{CameraTruth, Medium, Tracer};
use super::texture::TextureMap;
use crate::optics::CameraDesign;

/// A flat board that fills the field.
#[derive(Debug, Clone)]
pub struct Board {
    /// Distance of its centre along the axis, mm: in air from M, in water from the shell's outer vertex O.
    pub distance: f64,
    /// How fast the distance grows along +x and +y (slopes; about the board's centre).
    pub tilt: [f64; 2],
    /// What is on it.
    pub texture: Arc<TextureMap>,
    /// Where on the texture the board's centre is, mm.
    pub texture_origin: [f64; 2],
}

impl Board {
    /// An upright board with the texture's origin at its centre.
    #[must_use]
    pub fn new(distance: f64, texture: Arc<TextureMap>) -> Self {
        Self { distance, tilt: [0.0, 0.0], texture, texture_origin: [0.0, 0.0] }
    }
}

/// One of several boards side by side: an upright strip.
#[derive(Debug, Clone)]
pub struct Strip {
    /// The board, seen where its own x lies in `range`.
    pub board: Board,
    /// Left and right edge in the board's own x, mm; may be infinite.
    pub range: [f64; 2],
}

/// Boards side by side at several distances. Nearer strips hide farther ones; where a ray passes between two, the frame
/// is black.
#[derive(Debug, Clone)]
pub struct TripleBoard {
    /// Nearest first.
    pub strips: Vec<Strip>,
}

impl TripleBoard {
    /// Strips that share the field evenly, in the order given from the left of the raw frame to its right.
    ///
    /// `half_field_slope` is the field's half width as a slope at M (`CameraTruth::half_field_slope`): with it the edges
    /// lie on the same lines of sight through M, each strip on its own plane. The outer strips go on for ever. Each
    /// strip has its own patch of the texture.
    #[must_use]
    pub fn new(distances: &[f64], half_field_slope: f64, texture: &Arc<TextureMap>) -> Self {
        let count = distances.len();
        // The lens turns the picture round: the left of the raw frame is at the board's +x.
        let edge = |k: usize, distance: f64| {
            let share = 1.0 - 2.0 * k as f64 / count as f64;
            share * half_field_slope * distance
        };
        let mut strips: Vec<Strip> = distances
            .iter()
            .enumerate()
            .map(|(k, &distance)| Strip {
                board: Board {
                    texture_origin: [0.37 * k as f64 * texture.side(), 0.61 * k as f64 * texture.side()],
                    ..Board::new(distance, Arc::clone(texture))
                },
                range: [
                    if k + 1 == count { f64::NEG_INFINITY } else { edge(k + 1, distance) },
                    if k == 0 { f64::INFINITY } else { edge(k, distance) },
                ],
            })
            .collect();
        strips.sort_by(|one, other| one.board.distance.total_cmp(&other.board.distance));
        Self { strips }
    }
}

/// Something flat with an outline: a fish, a tuft of grass.
#[derive(Debug, Clone)]
pub struct Cutout {
    /// Where it is and what is on it.
    pub board: Board,
    /// What of it is there, on the texture's own coordinates: 1 hides what is behind, 0 lets it be seen. `None` for a
    /// whole board.
    pub outline: Option<Arc<TextureMap>>,
}

/// What the camera looks at.
#[derive(Debug, Clone)]
pub enum Scene {
    /// A diffuser on the lens: every ray that passes the aperture is white.
    Diffuser,
    /// Nothing: every ray ends in the dark.
    Dark,
    /// A board across the whole field.
    Board(Board),
    /// Boards side by side.
    TripleBoard(TripleBoard),
    /// Things one behind the other, nearest first. Nothing is behind the last: black.
    Cutouts(Vec<Cutout>),
}

impl Scene {
    fn boards_mut(&mut self) -> impl Iterator<Item = (&mut Board, Option<&mut [f64; 2]>)> {
        let (mut one, mut strips, mut cutouts) = (None, None, None);
        match self {
            Self::Diffuser | Self::Dark => {}
            Self::Board(board) => one = Some((board, None)),
            Self::TripleBoard(triple) => strips = Some(&mut triple.strips),
            Self::Cutouts(all) => cutouts = Some(all),
        }
        let strips = strips.into_iter().flatten().map(|strip| (&mut strip.board, Some(&mut strip.range)));
        // An outline is on the texture, which moves with its board.
        let cutouts = cutouts.into_iter().flatten().map(|cutout| (&mut cutout.board, None));
        one.into_iter().chain(strips).chain(cutouts)
    }

    /// The scene with its boards moved along their own x and y by `across` and away from the camera by `further`, mm.
    #[must_use]
    pub fn moved(&self, across: [f64; 2], further: f64) -> Self {
        let mut scene = self.clone();
        for (board, range) in scene.boards_mut() {
            board.distance += further;
            for (origin, across) in board.texture_origin.iter_mut().zip(across) {
                *origin -= across;
            }
            if let Some(range) = range {
                *range = range.map(|edge| edge + across[0]);
            }
        }
        scene
    }

    /// Distance of the nearest board, mm, as in [`Board`]; `None` where there is none.
    #[must_use]
    pub fn nearest_board(&self) -> Option<f64> {
        match self {
            Self::Diffuser | Self::Dark => None,
            Self::Board(board) => Some(board.distance),
            Self::TripleBoard(triple) => triple.strips.iter().map(|strip| strip.board.distance).reduce(f64::min),
            Self::Cutouts(all) => all.iter().map(|cutout| cutout.board.distance).reduce(f64::min),
        }
    }
}

/// The side of a texel, mm, that shows a texture's finest detail at the scale of a micro-image's pixels: half of what a
/// pixel covers on a board at `distance` (mm, as in [`Board`]) when the camera is focused on it. `pixel` in mm.
#[must_use]
pub fn texel_for(design: &CameraDesign, medium: Medium, distance: f64, pixel: f64) -> f64 {
    let equivalent = match medium {
        Medium::Air => distance,
        Medium::Water { shell, e, .. } => shell.equivalent_distance(distance, e),
    };
    let camera = CameraTruth::from_design(design, design.delta_v_for_equivalent(equivalent), medium, pixel, 1, 1);
    let probe = Board::new(distance, Arc::new(TextureMap::from_values(&[0.0], 1.0)));
    // Where no ray comes through any scale will do.
    Tracer::new(&camera).footprint(&probe).map_or(1.0, |footprint| footprint / 2.0)
}
