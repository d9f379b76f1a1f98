//! `[boards]`: which boards there are, and the room that they have.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which boards stand before the lens in air.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoardsInAir {
    /// Whichever of the others suits the camera, by the plan.
    Auto,
    /// One board of three levels side by side.
    TripleLevel,
    /// One flat board, put to three places in turn.
    FlatInTurn,
}

/// What is on a board: how well a spacing can be measured by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BoardTexture {
    /// Random, with the amplitude spectrum of natural scenes.
    Natural,
    /// A chessboard with marker-like squares.
    Charuco,
    /// Black print on white.
    Print,
}

/// `[boards]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BoardsConfig {
    /// Which boards stand before the lens in air.
    pub in_air: BoardsInAir,
    /// What is on them, which the plan's expected uncertainties go by.
    pub texture: BoardTexture,
    /// Distance between the levels of the triple-level board that there is, mm; left out, one is made as the plan wants
    /// it.
    pub level_step_mm: Option<f64>,
    /// From the nearest to the furthest level of a triple-level board, mm, at most.
    pub greatest_depth_mm: f64,
    /// How far from the lens a board in air may stand, mm.
    pub farthest_mm: f64,
    /// Shortest side of the boards, mm; left out, they fill the field wherever they stand.
    pub side_mm: Option<f64>,
    /// From the shell's outer vertex to the tank's far wall, mm; left out, the board in water has all the room it needs.
    pub tank_mm: Option<f64>,
}

impl Default for BoardsConfig {
    fn default() -> Self {
        Self {
            in_air: BoardsInAir::Auto,
            texture: BoardTexture::Natural,
            level_step_mm: None,
            greatest_depth_mm: 60.0,
            farthest_mm: 5000.0,
            side_mm: None,
            tank_mm: None,
        }
    }
}
