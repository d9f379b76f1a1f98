//! Which boards stand before the lens in air, and how far apart.

use super::capture::Capture;
use bench::config::{BoardsInAir, Config};
use bench::device::Setup;
use plenoptics::optics::mla::micro_image_pitch;
use plenoptics::optics::{CameraDesign, Solution};

/// Difference of the spacings of neighbouring levels side by side, in MLA pitches: told apart many times over, and all
/// of them still sharp.
const LEVELS_APART: f64 = 0.044;
/// The same in pixels, at the least, for levels to be told apart side by side.
const LEVELS_APART_PX: f64 = 1.1;
/// The same where one board is put to three places in turn: each is seen alone, and b is told by what lies between them.
const PLACES_APART: f64 = 0.08;
/// Micro-images that a level's strip has to be wide: at its boundaries they see two boards.
const STRIP_MICRO_IMAGES: f64 = 6.0;

/// Boards before the lens in air; distances from the main lens's principal point, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AirBoards {
    /// Three levels side by side, from the nearest to the furthest.
    Levels([f64; 3]),
    /// One flat board.
    Flat(f64),
}

impl AirBoards {
    /// Distance of the middle one, mm.
    #[must_use]
    pub const fn middle_mm(&self) -> f64 {
        match self {
            Self::Levels([_, middle, _]) | Self::Flat(middle) => *middle,
        }
    }

    /// The set-up that puts them up.
    #[must_use]
    pub const fn setup(&self) -> Setup {
        match *self {
            Self::Levels(distances_mm) => Setup::AirTripleBoard { distances_mm },
            Self::Flat(distance_mm) => Setup::AirTripleBoard { distances_mm: [distance_mm; 3] },
        }
    }
}

/// How the boards of the air step are arranged about a distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Arrangement {
    /// Three levels side by side, so far apart, mm.
    Levels {
        /// From one to the next, mm.
        step_mm: f64,
    },
    /// One flat board, put to these places in turn, from the nearest to the furthest, mm.
    InTurn {
        /// The places, mm; the middle one is the solution's.
        places_mm: [f64; 3],
    },
}

impl Arrangement {
    /// The boards about a distance, mm.
    #[must_use]
    pub fn about(&self, middle_mm: f64) -> AirBoards {
        match *self {
            Self::Levels { step_mm } => AirBoards::Levels([middle_mm - step_mm, middle_mm, middle_mm + step_mm]),
            Self::InTurn { .. } => AirBoards::Flat(middle_mm),
        }
    }

    /// One flat board in turn.
    pub(super) fn in_turn(solution: &Solution, capture: &Capture) -> Self {
        Self::InTurn { places_mm: places_mm(solution, capture) }
    }

    /// The one that suits a camera at a solution; as configured where that is.
    /// `parked_mm` is how far e is moved while the boards stand.
    pub(super) fn of(config: &Config, solution: &Solution, capture: &Capture, parked_mm: f64) -> Self {
        let design = config.design();
        let step_mm = config.boards.level_step_mm.unwrap_or_else(|| {
            let deepest_mm = 0.5 * config.boards.greatest_depth_mm;
            level_step_mm(&design, solution).min(deepest_mm)
        });
        let levels = Self::Levels { step_mm };
        let in_turn = Self::in_turn(solution, capture);
        match config.boards.in_air {
            BoardsInAir::TripleLevel => levels,
            BoardsInAir::FlatInTurn => in_turn,
            // While e goes far the levels would leave the range in which they are told apart.
            BoardsInAir::Auto if parked_mm <= step_mm && levels.suits(config, &design, solution, capture) => levels,
            BoardsInAir::Auto => in_turn,
        }
    }

    /// Whether levels so far apart can be made, stand, and are told apart side by side.
    fn suits(&self, config: &Config, design: &CameraDesign, solution: &Solution, capture: &Capture) -> bool {
        let Self::Levels { step_mm } = *self else { return true };
        let across =
            f64::from(config.sensor.width_px.min(config.sensor.height_px)) * config.pixel_pitch().millimetres();
        let pitch = micro_image_pitch(design.mla.pitch, design.lens_to_mla(solution.delta_v), design.mla.b());
        // Of a mosaic's green pixels a strip has too few to be told from the next.
        config.sensor.mosaic.is_none()
            && across / pitch >= 3.0 * STRIP_MICRO_IMAGES
            && levels_fault(config, solution, capture, step_mm, LEVELS_APART_PX).is_none()
    }
}

/// Why levels a step apart (mm) cannot be made, stand, be in the range of focus or be told apart, in words. Neighbours are
/// told apart whose spacings differ by `least_px` or more.
pub(super) fn levels_fault(
    config: &Config,
    solution: &Solution,
    capture: &Capture,
    step_mm: f64,
    least_px: f64,
) -> Option<String> {
    let (boards, middle_mm) = (&config.boards, solution.equivalent_distance);
    let levels = format!("levels {step_mm} mm apart");
    let (depth_mm, furthest_mm) = (2.0 * step_mm, middle_mm + step_mm);
    if depth_mm > boards.greatest_depth_mm {
        return Some(format!(
            "{levels} are {depth_mm} mm deep, and boards.greatest_depth_mm is {}",
            boards.greatest_depth_mm
        ));
    }
    if furthest_mm > boards.farthest_mm {
        return Some(format!(
            "the furthest level would stand at {furthest_mm:.0} mm, and boards.farthest_mm is {}",
            boards.farthest_mm
        ));
    }
    let seen = |level: &f64| capture.sees(*level, solution.delta_v, 0.0);
    if ![middle_mm - step_mm, furthest_mm].iter().all(seen) {
        return Some(format!("{levels} do not all lie in the range of focus"));
    }
    let pitch_px = config.mla.pitch_mm / config.pixel_pitch().millimetres();
    let apart_px = capture.levels_apart(middle_mm, step_mm, solution.delta_v) * pitch_px;
    (apart_px < least_px)
        .then(|| format!("{levels} differ by {apart_px:.3} px only, and {least_px:.3} px are told apart side by side"))
}

/// The step between levels whose spacings lie [`LEVELS_APART`], mm: to a half, or to two digits where it is short.
fn level_step_mm(design: &CameraDesign, solution: &Solution) -> f64 {
    let by_distance = design.spacing_per_equivalent(solution.equivalent_distance, solution.delta_v).abs();
    let step = LEVELS_APART * design.mla.pitch / by_distance;
    let unit = if step >= 4.0 { 0.5 } else { 0.1 };
    ((step / unit).round() * unit).max(unit)
}

/// Three places whose spacings lie [`PLACES_APART`], the middle one the solution's; where the lens sees no further, both
/// others are nearer.
fn places_mm(solution: &Solution, capture: &Capture) -> [f64; 3] {
    let middle = solution.equivalent_distance;
    let spacing = capture.spacing(middle, solution.delta_v);
    // The nearer a board, the larger its spacing.
    let place = |spacing: f64| {
        let distance = capture.distance_mm(spacing, solution.delta_v)?;
        (capture.holds(spacing) && capture.stands(distance)).then_some((distance * 10.0).round() / 10.0)
    };
    let sought = |way: f64| (0..8).find_map(|k| place(spacing + way * PLACES_APART * 0.8f64.powi(k)));
    match (sought(1.0), sought(-1.0)) {
        (Some(near), Some(far)) => [near, middle, far],
        (Some(near), None) => [near, f64::midpoint(near, middle), middle],
        (None, Some(far)) => [middle, f64::midpoint(middle, far), far],
        (None, None) => [middle; 3],
    }
}
