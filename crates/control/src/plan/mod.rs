//! What an alignment will do, worked out from the configuration before anything moves: where the boards go, how the axes
//! are tried and led, and what stands in the way.

mod boards;
mod capture;
mod expected;
mod obstacle;
mod precision;
mod view;

pub use boards::{AirBoards, Arrangement};
pub use expected::ExpectedBudget;
pub use obstacle::Obstacle;
pub(crate) use view::has_shell;
pub use view::{PlanView, PlannedBoard, PlannedBoards, PlannedJob};

use crate::loops::air::{AirGoal, FREE_PROBES};
use crate::loops::shell::ShellGoal;
use bench::config::{AxisConfig, Config, ShellStep, Side};
use capture::Capture;
use plenoptics::imaging::grid::PITCH_FOLLOWED;
use plenoptics::optics::mla::micro_image_pitch;
use plenoptics::optics::{CameraDesign, Mla, Solution};

/// By how much the first, short move of an axis changes the spacing, in MLA pitches: enough to be seen many times over.
const FOCUS_PROBE: f64 = 0.016;
const E_PROBE: f64 = 0.006;
/// By how much a step of the search for a picture that can be measured changes the spacing near focus, in MLA pitches: the
/// range that is measured is several times as wide.
const SEARCH_STEP: f64 = 0.1;
/// Least and greatest first move, mm: a first move is short whatever the picture could show.
const PROBE_MM: [f64; 2] = [0.02, 1.0];
/// Between the Δv where boards begin to tell b and the solution, as a difference of the spacing in MLA pitches.
const B_TOLD_WITHIN: f64 = 0.06;
/// Share of what a step of the focus axis changes the spacing by that it may be off its target.
const STEP_SHARE: f64 = 0.75;
/// Share of d that the focus axis may be off the solution when the aperture is set for it.
const APERTURE_WITHIN: f64 = 0.023;
/// Share of the change of pitch over which a grid is followed that a plan relies on.
const FOLLOWED_SHARE: f64 = 0.6;
/// By how much less than its greatest step an axis is moved at once, mm, besides its play.
const PLAY_MM: f64 = 0.5;
/// By how much the spacing of a single frame out of focus is less certain than what is planned with.
const SINGLE_FRAME: f64 = 1.5;
/// Standard uncertainties of an axis's scale that a plan allows for.
const SCALE_SIGMAS: f64 = 2.0;

/// How often a way of e in air is shortened until a board can be measured at both of its ends.
const MOST_PIECES: i32 = 10;
/// Standard uncertainties of two spacings that a way of e in air is good to.
const PARKED_SIGMAS: f64 = 5.0;
/// Most that e is ever taken from its optimum to meet the criterion, mm: it is there for the field of view.
const MOST_DEPARTURE_MM: f64 = 1.0;
/// How often, and by which share of it, a way of the focus axis is shortened for boards that stand to be in range.
const SHORTER: u32 = 12;
const SHORTER_BY: f64 = 0.05;
/// How finely the e at which the shell is mounted is looked for.
const MOUNTS: u32 = 60;

/// How an alignment that aims at a solution is led.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    design: CameraDesign,
    capture: Capture,
    /// Δv and e aimed at.
    pub solution: Solution,
    /// The boards in air.
    pub arrangement: Arrangement,
    /// e at which the shell is mounted, mm.
    pub mount_e_mm: f64,
    /// Tolerance of Δv, mm.
    pub delta_v_tolerance_mm: f64,
    /// Tolerance of e, mm.
    pub e_tolerance_mm: f64,
    /// By how much the spacing may be off its target through the shell, px.
    pub spacing_tolerance_px: f64,
    /// First move of the focus axis, mm.
    pub focus_probe_mm: f64,
    /// First move of the e axis, mm.
    pub e_probe_mm: f64,
    /// From one place of the focus axis to the next where the picture is looked for that can be measured, mm.
    pub search_step_mm: f64,
    /// Further from the solution than this (mm of Δv) the boards cannot tell b.
    pub b_told_within_mm: f64,
    /// The focus axis is so near to the solution, mm, when the aperture is set.
    pub aperture_within_mm: f64,
    /// Longest trim of Δv behind the shell, mm.
    pub most_trim_mm: f64,
    /// How far from its optimum e may be taken to meet the criterion before Δv is trimmed instead, mm.
    pub e_departure_mm: f64,
    /// e at which the shell was to be mounted, mm.
    wanted_mount_e_mm: f64,
    l_bound_mm: f64,
    wall_mm: f64,
    focus: AxisRoom,
    e: AxisRoom,
}

/// What is known of an axis before it moves.
#[derive(Debug, Clone, Copy)]
struct AxisRoom {
    low_mm: f64,
    high_mm: f64,
    home_mm: f64,
    zero_mm: f64,
    scale_sigma: f64,
    backlash_mm: f64,
    /// How far below a target it goes on its way there.
    leg_below_mm: f64,
    most_mm: f64,
}

/// How far the axes travel, mm: least and greatest reading of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel {
    /// Of the focus axis.
    pub focus_mm: (f64, f64),
    /// Of the e axis.
    pub e_mm: (f64, f64),
}

impl Travel {
    /// As it is configured.
    #[must_use]
    pub const fn configured(config: &Config) -> Self {
        let (focus, e) = (&config.bench.focus, &config.bench.e);
        Self { focus_mm: (focus.low_limit_mm, focus.high_limit_mm), e_mm: (e.low_limit_mm, e.high_limit_mm) }
    }
}

impl AxisRoom {
    fn of(axis: &AxisConfig) -> Self {
        Self {
            low_mm: axis.low_limit_mm,
            high_mm: axis.high_limit_mm,
            home_mm: axis.home_position_mm,
            zero_mm: axis.zero_uncertainty_mm,
            scale_sigma: axis.scale_uncertainty,
            backlash_mm: axis.backlash_mm,
            leg_below_mm: if axis.approach == Side::Low { axis.approach_leg_mm() } else { 0.0 },
            // An approach begins beside its target, on the far side of the play.
            most_mm: axis.max_step_mm - 2.0 * axis.backlash_mm - PLAY_MM,
        }
    }

    /// How far the true position may be from a reading, mm, before a picture has shown it.
    fn unknown_mm(&self, reading_mm: f64) -> f64 {
        self.zero_mm + SCALE_SIGMAS * self.scale_sigma * (reading_mm - self.home_mm).abs()
    }
}

/// By how much a spacing may be off its target where a job accepts it, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AcceptedWithin {
    /// In air: the tolerance of Δv.
    pub in_air_px: f64,
    /// Through the shell: that of e.
    pub through_shell_px: f64,
}

impl AcceptedWithin {
    /// For jobs that aim at a solution.
    #[must_use]
    pub fn of(config: &Config, solution: &Solution) -> Self {
        let (design, tolerances) = (config.design(), config.tolerances());
        let [by_delta_v, by_e] =
            design.spacing_slopes(solution).map(|slope| slope / config.pixel_pitch().millimetres());
        // A step of the focus axis is to be told from the next.
        let step_px = by_delta_v / config.bench.focus.steps_per_mm;
        Self {
            in_air_px: tolerances.delta_v_mm * by_delta_v,
            through_shell_px: (tolerances.e_mm * by_e).max(bench::config::E_SPACING_PX).max(STEP_SHARE * step_px),
        }
    }
}

impl Plan {
    /// The plan of an alignment that aims at a solution, with l_bound at `l_bound_mm` and the shell mounted at `mount_e_mm`
    /// or, where nothing could be measured through it there, nearer to the solution.
    #[must_use]
    pub fn new(config: &Config, solution: Solution, l_bound_mm: f64, mount_e_mm: f64) -> Self {
        let wall_mm = config.assembly.e_wall_mm(l_bound_mm);
        let design = config.design();
        let capture = Capture::new(design, config.boards.farthest_mm);
        let tolerances = config.tolerances();
        let [by_delta_v, by_e] = design.spacing_slopes(&solution).map(|slope| slope / design.mla.pitch);
        let image_by_object = by_e / by_delta_v;
        let pitch_px = design.mla.pitch / config.pixel_pitch().millimetres();
        let [least, most] = PROBE_MM;
        let focus = AxisRoom::of(&config.bench.focus);
        let e = AxisRoom::of(&config.bench.e);
        let wanted_mount_e_mm = mount_e_mm;
        let spacing_sigma_px = precision::spacing_sigma_px(config);
        // On its way there the picture in air has shown how far e goes for a reading.
        let seen_mm = e.zero_mm + e.backlash_mm + PARKED_SIGMAS * spacing_sigma_px / (by_e * pitch_px);
        let unknown = |e_mm: f64| e.unknown_mm(e_mm).min(seen_mm);
        let mount_e_mm = mount_at(&design, &capture, &solution, mount_e_mm, unknown);
        let parked_mm = (config.bench.e.home_position_mm - mount_e_mm).abs();
        let mut plan = Self {
            design,
            capture,
            solution,
            arrangement: Arrangement::of(config, &solution, &capture, parked_mm),
            mount_e_mm,
            delta_v_tolerance_mm: tolerances.delta_v_mm,
            e_tolerance_mm: tolerances.e_mm,
            spacing_tolerance_px: AcceptedWithin::of(config, &solution).through_shell_px,
            focus_probe_mm: least,
            e_probe_mm: least,
            search_step_mm: SEARCH_STEP / by_delta_v,
            b_told_within_mm: B_TOLD_WITHIN / by_delta_v,
            aperture_within_mm: APERTURE_WITHIN * design.lens_to_mla(solution.delta_v),
            most_trim_mm: most_trim_mm(config, &solution),
            e_departure_mm: (2.0 * tolerances.delta_v_mm / image_by_object + tolerances.e_mm).min(MOST_DEPARTURE_MM),
            wanted_mount_e_mm,
            l_bound_mm,
            wall_mm,
            focus,
            e,
        };
        plan.focus_probe_mm = (FOCUS_PROBE / plan.slope_at_start()).clamp(least, most);
        // Twice as much has to be free of the wall.
        plan.e_probe_mm =
            (E_PROBE / plan.slope_e(plan.mount_e_mm)).clamp(least, most).min(0.25 * (plan.mount_e_mm - wall_mm));
        plan
    }

    /// The same where the axes' controllers may let them travel less far than is configured.
    #[must_use]
    pub fn within(self, travel: Travel) -> Self {
        let room = |axis: AxisRoom, (low_mm, high_mm)| AxisRoom { low_mm, high_mm, ..axis };
        Self { focus: room(self.focus, travel.focus_mm), e: room(self.e, travel.e_mm), ..self }
    }

    /// The goal of the air loop.
    #[must_use]
    pub fn air_goal(&self) -> AirGoal {
        AirGoal {
            delta_v_mm: self.solution.delta_v,
            tolerance_mm: self.delta_v_tolerance_mm,
            low_limit_mm: self.focus.low_mm,
            high_limit_mm: self.focus.high_mm,
            scale_sigma: self.focus.scale_sigma,
            zero_sigma_mm: self.focus.zero_mm,
            backlash_mm: self.focus.backlash_mm,
            probe_mm: self.focus_probe_mm,
            most_mm: self.focus.most_mm,
        }
    }

    /// The goal of the shell loop: a spacing (px), by what may be changed.
    #[must_use]
    pub fn shell_goal(&self, spacing_px: f64, step: ShellStep) -> ShellGoal {
        ShellGoal {
            e_mm: self.solution.e,
            wall_mm: self.wall_mm.max(self.e.low_mm),
            tolerance_mm: self.e_tolerance_mm,
            spacing_px,
            spacing_tolerance_px: self.spacing_tolerance_px,
            step,
            high_limit_mm: self.e.high_mm,
            scale_sigma: self.e.scale_sigma,
            zero_sigma_mm: self.e.zero_mm,
            backlash_mm: self.e.backlash_mm,
            leg_mm: self.e.leg_below_mm,
            home_mm: self.e.home_mm,
            probe_mm: self.e_probe_mm,
            most_mm: self.e.most_mm,
            most_trim_mm: self.most_trim_mm,
            departure_mm: self.e_departure_mm,
        }
    }

    /// The same with one flat board in turn.
    #[must_use]
    pub fn with_flat_board(&self) -> Self {
        Self { arrangement: Arrangement::in_turn(&self.solution, &self.capture), ..*self }
    }

    /// The boards to be measured with the camera at Δv (mm), known to `within_mm`: where the solution has them, or, while
    /// that is out of the range of focus, those that stand there already or as near to focus as can be. `None` where none
    /// can be measured.
    #[must_use]
    pub fn boards_at(&self, delta_v_mm: f64, within_mm: f64, present: Option<AirBoards>) -> Option<AirBoards> {
        let wanted = self.solution.equivalent_distance;
        let seen = |distance: f64| self.capture.sees(distance, delta_v_mm, within_mm);
        if !seen(wanted)
            && let Some(present) = present.filter(|boards| seen(boards.middle_mm()))
        {
            return Some(present);
        }
        self.capture.place_mm(wanted, delta_v_mm, within_mm).map(|place| self.arrangement.about(place))
    }

    /// The boards in air where the solution has them.
    #[must_use]
    pub fn boards_at_solution(&self) -> AirBoards {
        self.arrangement.about(self.solution.equivalent_distance)
    }

    /// Where to go of a way of the focus axis (from and to, readings in mm) for the boards that stand, or those at the
    /// solution, to be in range at its end: all of it, or less where the camera is not known well enough yet to see them at
    /// once, and others would have to be put up just for that. `expected` is Δv and how well it is known at a reading, mm.
    #[must_use]
    pub fn without_other_boards(
        &self,
        (from_mm, to_mm): (f64, f64),
        expected: impl Fn(f64) -> (f64, f64),
        standing: AirBoards,
    ) -> f64 {
        let serves = |at_mm: &f64| {
            let (delta_v_mm, within_mm) = expected(*at_mm);
            let boards = self.boards_at(delta_v_mm, within_mm, Some(standing));
            boards.is_some_and(|boards| boards == standing || boards == self.boards_at_solution())
        };
        (0..SHORTER).map(|k| to_mm - f64::from(k) * SHORTER_BY * (to_mm - from_mm)).find(serves).unwrap_or(to_mm)
    }

    /// By how much e may end above what is aimed at, mm: its axis's reading does not pass the wall, where the true e is
    /// the greater by as much as the axis's zero and scale are off.
    fn e_above_mm(&self) -> f64 {
        let wall_mm = self.wall_mm.max(self.e.low_mm);
        (wall_mm + self.e.unknown_mm(wall_mm) - self.solution.e).max(0.0)
    }

    /// The levels, or the places of one board, about a distance (mm), by rising distance, mm.
    #[must_use]
    pub fn places_about(&self, middle_mm: f64) -> [f64; 3] {
        match self.arrangement {
            Arrangement::Levels { step_mm } => [-step_mm, 0.0, step_mm].map(|step| middle_mm + step),
            Arrangement::InTurn { places_mm } => {
                let scale = middle_mm / self.solution.equivalent_distance;
                places_mm.map(|place| place * scale)
            }
        }
    }

    /// Whether a grid that was found at one reading of the focus axis is followed to another (both mm).
    #[must_use]
    pub fn grid_followed(&self, from_mm: f64, to_mm: f64) -> bool {
        let Mla { pitch, .. } = self.design.mla;
        let at = |reading: f64| micro_image_pitch(pitch, self.design.lens_to_mla(reading), self.design.mla.b());
        (at(to_mm) / at(from_mm) - 1.0).abs() <= FOLLOWED_SHARE * PITCH_FOLLOWED
    }

    /// How far Δv may be from a reading of the focus axis, mm, before a picture has shown it.
    #[must_use]
    pub fn unknown_delta_v_mm(&self, reading_mm: f64) -> f64 {
        self.focus.unknown_mm(reading_mm)
    }

    /// How far Δv may be from where it is wanted once the focus axis has gone there, mm: by its scale, as the first move has
    /// told it by spacings that are good to `spacing_sigma`, in MLA pitches.
    fn unknown_on_arrival_mm(&self, spacing_sigma: f64) -> f64 {
        let told = SINGLE_FRAME * std::f64::consts::SQRT_2 * spacing_sigma / FOCUS_PROBE;
        SCALE_SIGMAS * self.focus.scale_sigma.min(told) * (self.solution.delta_v - self.focus.home_mm).abs()
    }

    /// A place (mm) from which a board in air is measured both before and after e is moved, and how far it may be moved
    /// then (mm) of the way wanted: the board that stands where it serves for the whole way. The camera's distance from it
    /// grows with e.
    #[must_use]
    pub fn board_along(&self, standing_mm: f64, way_mm: f64) -> Option<(f64, f64)> {
        let sees = |place: f64| self.capture.sees(place, self.solution.delta_v, self.delta_v_tolerance_mm);
        let serves = |place: f64, way: f64| sees(place) && sees(place + way);
        let way_mm = way_mm.clamp(-self.e.most_mm, self.e.most_mm);
        if serves(standing_mm, way_mm) {
            return Some((standing_mm, way_mm));
        }
        (0..MOST_PIECES).map(|k| way_mm * 0.7f64.powi(k)).find_map(|way| {
            // About the solution's place, as much to one side as to the other, or all to one.
            let places = [0.5, 0.0, 1.0].map(|share| self.solution.equivalent_distance - share * way);
            places.into_iter().find(|&place| serves(place, way)).map(|place| (place, way))
        })
    }

    /// How the spacing through the shell changes with e there, MLA pitches a millimetre, > 0.
    fn slope_e(&self, e_mm: f64) -> f64 {
        let equivalent = self.design.shell.equivalent_distance(self.design.object_distance, e_mm);
        self.design.spacing_per_equivalent(equivalent, self.solution.delta_v).abs() / self.design.mla.pitch
    }

    /// Where boards stand first: where the focus axis is after its homing. `None` where none can be measured.
    fn first_boards(&self) -> Option<AirBoards> {
        let start = self.focus.home_mm;
        self.boards_at(start, self.focus.unknown_mm(start), None)
    }

    /// How the spacing of the first board changes with Δv where the focus axis stands after its homing, MLA pitches a
    /// millimetre, > 0.
    fn slope_at_start(&self) -> f64 {
        let place = self.first_boards().map_or(self.solution.equivalent_distance, |boards| boards.middle_mm());
        self.design.spacing_per_delta_v(place, self.focus.home_mm).abs() / self.design.mla.pitch
    }
}

/// Longest trim of Δv behind the shell, mm, for jobs that aim at a solution.
#[must_use]
pub fn most_trim_mm(config: &Config, solution: &Solution) -> f64 {
    let design = config.design();
    let [by_delta_v, by_e] = design.spacing_slopes(solution);
    let e_off_mm = AxisRoom::of(&config.bench.e).unknown_mm(solution.e) + 1.0;
    2.0 * by_e / by_delta_v * e_off_mm + 10.0 * config.tolerances().delta_v_mm
}

/// The spacing through the shell at e (mm) with Δv at the solution's, in MLA pitches.
fn spacing_in_water(design: &CameraDesign, solution: &Solution, e_mm: f64) -> f64 {
    let equivalent = design.shell.equivalent_distance(design.object_distance, e_mm);
    design.spacing_at(equivalent, solution.delta_v) / design.mla.pitch
}

/// The greatest e, up to the one wanted (mm), at which the board can be measured through the shell, as far as e is known
/// there.
fn mount_at(
    design: &CameraDesign,
    capture: &Capture,
    solution: &Solution,
    wanted_mm: f64,
    unknown_mm: impl Fn(f64) -> f64,
) -> f64 {
    let goal = solution.e;
    let seen = |e_mm: f64| {
        let unknown = unknown_mm(e_mm);
        let ends = [(e_mm - unknown).max(goal), e_mm + unknown];
        ends.iter().all(|&e_mm| capture.holds(spacing_in_water(design, solution, e_mm)))
    };
    if seen(wanted_mm) {
        return wanted_mm;
    }
    (1..=MOUNTS)
        .map(|k| wanted_mm - f64::from(k) / f64::from(MOUNTS) * (wanted_mm - goal))
        .find(|&e_mm| seen(e_mm))
        .map_or(goal, |e_mm| (e_mm * 10.0).floor() / 10.0)
}
