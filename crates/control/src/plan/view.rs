//! A plan as a caller sees it: what the command line prints, the API serves, and a job's log begins with.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::boards::{AirBoards, Arrangement};
use super::expected::ExpectedBudget;
use super::obstacle::Obstacle;
use super::precision::{Precision, spacing_sigma_px};
use super::{Plan, Travel, spacing_in_water};
use crate::job::request::JobKind;
use crate::job::steps::PlannedStep;
use bench::config::{Config, ConfigOrigin, LBoundSource};
use bench::device::Setup;

/// A frame and its measurement, s, by the megapixel.
const MEASURED_S_PER_MEGAPIXEL: f64 = 0.35;
/// Frame, settling and the pauses of a move in pieces, s, by the measurement.
const PAUSES_S: f64 = 1.0;
/// Measurements in air, and through the shell, that an alignment takes as a rule.
const MEASUREMENTS: [f64; 2] = [6.0, 6.0];
/// The kinds of job besides the joint alignment that go by a plan.
const PARTS: [JobKind; 4] = [JobKind::AirOnly, JobKind::ShellOnly, JobKind::ClarityOnly, JobKind::LBoundMeasurement];

/// Whether a kind of job that goes by a plan brings the picture through the shell to its target.
pub(crate) const fn has_shell(kind: JobKind) -> bool {
    !matches!(kind, JobKind::AirOnly | JobKind::LBoundMeasurement)
}

/// Which boards a plan has in air.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlannedBoards {
    /// Three levels side by side.
    TripleLevel,
    /// One flat board, put to three places in turn.
    FlatInTurn,
}

/// A board in air and what is to be seen of it at the solution's Δv.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedBoard {
    /// From the main lens's principal point, mm.
    pub distance_mm: f64,
    /// Its spacing, px.
    pub spacing_px: f64,
}

impl PlannedStep {
    fn new(name: &str, value: Option<String>, setup: Setup) -> Self {
        Self { name: name.to_owned(), value, setup }
    }

    fn white_frame() -> Self {
        Self::new("white_frame", None, Setup::Diffuser)
    }

    fn boards(boards: AirBoards) -> Self {
        let (name, value) = match boards {
            AirBoards::Levels([near, middle, far]) => {
                ("triple_board_in_air", format!("{near:.1}, {middle:.1}, {far:.1} mm"))
            }
            AirBoards::Flat(distance) => ("board_in_air", format!("{distance:.1} mm")),
        };
        Self::new(name, Some(value), boards.setup())
    }
}

/// What a kind of job that goes by a plan will ask and take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlannedJob {
    /// Which kind.
    pub kind: JobKind,
    /// What stands in its way; nothing does where it is empty.
    pub obstacles: Vec<Obstacle>,
    /// Δv aimed at, mm.
    pub delta_v_mm: f64,
    /// e aimed at, mm; of a clarity job, the one that it holds where its request names none. Null where e is not aimed at.
    pub e_mm: Option<f64>,
    /// What the operator is asked to do.
    pub operator_steps: Vec<PlannedStep>,
    /// How long it takes besides the operator, about, s: as the newest such jobs of this bench took, where it is for the
    /// configuration in force and there are any.
    pub duration_s: f64,
}

/// What a joint alignment will do, worked out before anything moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlanView {
    /// Where the design's numbers come from.
    pub origin: String,
    /// Whether nothing stands in its way.
    pub possible: bool,
    /// What does.
    pub obstacles: Vec<Obstacle>,
    /// Δv aimed at, mm.
    pub delta_v_mm: f64,
    /// e aimed at, mm.
    pub e_mm: f64,
    /// Spacing aimed at in air, px.
    pub spacing_target_px: f64,
    /// Which boards stand before the lens in air.
    pub boards_in_air: PlannedBoards,
    /// Those, from the nearest to the furthest.
    pub boards: Vec<PlannedBoard>,
    /// Where the first board in air stands, mm: where the focus axis is after its homing, another may be in range.
    pub first_board_mm: Option<f64>,
    /// e at which the shell is mounted, mm.
    pub mount_e_mm: f64,
    /// Spacing through the shell there, px.
    pub mount_spacing_px: f64,
    /// What the shell's aberrations add to the spacing in focus over the estimator's window, px.
    pub aberrations_px: f64,
    /// Tolerance of Δv, mm.
    pub delta_v_tolerance_mm: f64,
    /// Tolerance of e, mm.
    pub e_tolerance_mm: f64,
    /// By how much e may end above what is aimed at even so, mm: the e axis's reading does not pass the wall, however far its
    /// zero and scale are off. Δv is trimmed for the e that there is then, and the picture is as sharp.
    pub e_above_mm: f64,
    /// By how much the spacing may be off its target at the end, px.
    pub spacing_tolerance_px: f64,
    /// First move of the focus axis, mm.
    pub focus_probe_mm: f64,
    /// First move of the e axis, mm.
    pub e_probe_mm: f64,
    /// From one place of the focus axis to the next, mm, where the picture is looked for that can be measured.
    pub search_step_mm: f64,
    /// Standard uncertainty expected of a spacing, px.
    pub spacing_sigma_px: f64,
    /// The same of Δv by the picture alone, mm.
    pub delta_v_sigma_mm: f64,
    /// The same of e by picture and axis, mm.
    pub e_sigma_mm: f64,
    /// The same with all that is taken for granted; null where it cannot be worked out.
    pub by_budget: Option<ExpectedBudget>,
    /// What these assume, in words.
    pub assumed: String,
    /// What the operator is asked to do.
    pub operator_steps: Vec<PlannedStep>,
    /// How long it takes besides the operator, about, s: as the newest such jobs of this bench took, where it is for the
    /// configuration in force and there are any.
    pub duration_s: f64,
    /// What the kinds of job that are parts of an alignment, or its like, will ask and take.
    pub parts: Vec<PlannedJob>,
}

impl PlanView {
    /// The plan of a joint alignment by a checked configuration, on a bench of which nothing else is known.
    #[must_use]
    pub fn of(config: &Config, origin: &ConfigOrigin) -> Self {
        Self::within(config, origin, Travel::configured(config))
    }

    /// The same on a bench whose axes travel so far.
    #[must_use]
    pub fn within(config: &Config, origin: &ConfigOrigin, travel: Travel) -> Self {
        let (assembly, design) = (&config.assembly, config.design());
        let of = |solution| Plan::new(config, solution, assembly.l_bound_mm, assembly.initial_e_mm).within(travel);
        let joint = of(design.joint(assembly.l_bound_mm));
        let clarity = of(design.clarity(assembly.initial_e_mm));
        let parts = PARTS.map(|kind| {
            let plan = if kind == JobKind::ClarityOnly { &clarity } else { &joint };
            plan.part(kind, config)
        });
        Self { parts: parts.to_vec(), ..joint.view(config, origin.describe(config)) }
    }

    /// In a sentence.
    pub(crate) fn summary(&self) -> String {
        let list = |of: fn(&PlannedBoard) -> String| self.boards.iter().map(of).collect::<Vec<_>>().join(", ");
        let boards = match self.boards_in_air {
            PlannedBoards::TripleLevel => "levels of one board at",
            PlannedBoards::FlatInTurn => "one flat board in turn at",
        };
        format!(
            "plan: Δv = {:.4} mm to ±{} mm and e = {:.3} mm to ±{} mm, or up to {:.1} mm more where the wall does not let its axis go further; in air {boards} {} mm, whose spacings are {} px; the shell is mounted at e = {:.1} mm, where the spacing is {:.2} px; a spacing is expected to be good to {:.4} px, which is {:.4} mm of Δv and {:.3} mm of e ({}){}",
            self.delta_v_mm,
            self.delta_v_tolerance_mm,
            self.e_mm,
            self.e_tolerance_mm,
            self.e_above_mm,
            list(|board| format!("{:.1}", board.distance_mm)),
            list(|board| format!("{:.2}", board.spacing_px)),
            self.mount_e_mm,
            self.mount_spacing_px,
            self.spacing_sigma_px,
            self.delta_v_sigma_mm,
            self.e_sigma_mm,
            self.assumed,
            self.by_budget.map_or_else(String::new, |budget| format!("; {budget}"))
        )
    }
}

impl Plan {
    /// As a caller sees it; `origin` is where the design's numbers come from.
    pub(crate) fn view(&self, config: &Config, origin: String) -> PlanView {
        let pitch_px = self.design.mla.pitch / config.pixel_pitch().millimetres();
        let solution = &self.solution;
        let precision = Precision::of(config, self);
        let obstacles = self.obstacles(config);
        let boards_in_air = match self.arrangement {
            Arrangement::Levels { .. } => PlannedBoards::TripleLevel,
            Arrangement::InTurn { .. } => PlannedBoards::FlatInTurn,
        };
        let boards = self.places_about(solution.equivalent_distance).map(|distance_mm| PlannedBoard {
            distance_mm,
            spacing_px: self.capture.spacing(distance_mm, solution.delta_v) * pitch_px,
        });
        let first = self.first_boards();
        PlanView {
            origin,
            possible: obstacles.is_empty(),
            obstacles,
            delta_v_mm: solution.delta_v,
            e_mm: solution.e,
            spacing_target_px: self.design.mla.target_spacing() / config.pixel_pitch().millimetres(),
            boards_in_air,
            boards: boards.to_vec(),
            first_board_mm: first.map(|boards| boards.middle_mm()),
            mount_e_mm: self.mount_e_mm,
            mount_spacing_px: spacing_in_water(&self.design, solution, self.mount_e_mm) * pitch_px,
            aberrations_px: self.aberrations_px(config),
            delta_v_tolerance_mm: self.delta_v_tolerance_mm,
            e_tolerance_mm: self.e_tolerance_mm,
            e_above_mm: self.e_above_mm(),
            spacing_tolerance_px: self.spacing_tolerance_px,
            focus_probe_mm: self.focus_probe_mm,
            e_probe_mm: self.e_probe_mm,
            search_step_mm: self.search_step_mm,
            spacing_sigma_px: precision.spacing_px,
            delta_v_sigma_mm: precision.delta_v_mm,
            e_sigma_mm: precision.e_mm,
            by_budget: ExpectedBudget::of(config, self, &precision),
            assumed: format!(
                "noise of {:.1} grey levels of 255, boards with {} (boards.texture), {:.0} micro-images",
                precision.noise_levels,
                precision.texture,
                f64::from(config.sensor.width_px) * f64::from(config.sensor.height_px) / (pitch_px * pitch_px)
            ),
            operator_steps: self.operator_steps(JobKind::JointAlignment, config),
            duration_s: self.duration_s(JobKind::JointAlignment, config),
            parts: Vec::new(),
        }
    }

    /// What a kind of job that goes by it will ask and take.
    fn part(&self, kind: JobKind, config: &Config) -> PlannedJob {
        // The shell step goes on from an air step that nothing stood in the way of.
        let mut obstacles = if kind == JobKind::ShellOnly { Vec::new() } else { self.obstacles(config) };
        if kind == JobKind::ClarityOnly && obstacles.is_empty() {
            let expected = ExpectedBudget::of(config, self, &Precision::of(config, self));
            obstacles.extend(expected.and_then(|expected| self.held_too_near(expected)));
        }
        PlannedJob {
            kind,
            obstacles,
            delta_v_mm: self.solution.delta_v,
            e_mm: has_shell(kind).then_some(self.solution.e),
            operator_steps: self.operator_steps(kind, config),
            duration_s: self.duration_s(kind, config),
        }
    }

    /// What the operator is asked in a kind of job that goes by this plan.
    pub(crate) fn operator_steps(&self, kind: JobKind, config: &Config) -> Vec<PlannedStep> {
        let (in_air, parking) = self.steps_in_air(config);
        let distance_mm = config.object.distance_mm;
        let in_water = || Some(format!("{distance_mm:.1} mm"));
        let shell = || PlannedStep::new("shell_and_water", in_water(), Setup::WaterBoard { distance_mm });
        if kind == JobKind::ShellOnly {
            return vec![shell()];
        }
        let mut steps = vec![PlannedStep::white_frame()];
        let l_bound_first = kind != JobKind::ClarityOnly && config.assembly.l_bound == LBoundSource::Measure;
        if kind == JobKind::LBoundMeasurement || l_bound_first {
            // The air step of the l_bound that is configured first; then all axes are homed again.
            steps.extend(in_air.iter().cloned());
            steps.push(PlannedStep::new("least_e_by_hand", in_water(), Setup::LeastE { distance_mm }));
            steps.push(PlannedStep::new("shell_off", None, Setup::ShellOff));
        }
        if kind == JobKind::LBoundMeasurement {
            return steps;
        }
        steps.extend(in_air);
        if has_shell(kind) {
            steps.extend(parking);
            steps.push(shell());
        }
        steps
    }

    /// What the operator is asked in an air step, and then while e goes to where the shell is mounted.
    pub(crate) fn steps_in_air(&self, config: &Config) -> (Vec<PlannedStep>, Vec<PlannedStep>) {
        let pitch_px = self.design.mla.pitch / config.pixel_pitch().millimetres();
        let (in_air, standing_mm) = self.air_step(self.first_boards(), spacing_sigma_px(config) / pitch_px);
        let places = self.boards_while_parking(standing_mm).into_iter();
        (in_air, places.map(|place| PlannedStep::boards(self.arrangement.about(place))).collect())
    }

    /// The steps of an air step, and where (mm) the board stands at its end.
    fn air_step(&self, first: Option<AirBoards>, spacing_sigma: f64) -> (Vec<PlannedStep>, f64) {
        let solution = &self.solution;
        let at_solution = self.boards_at_solution();
        let mut steps: Vec<PlannedStep> = first.map(PlannedStep::boards).into_iter().collect();
        if !self.grid_followed(self.focus.home_mm, solution.delta_v) {
            steps.push(PlannedStep::white_frame());
            steps.push(PlannedStep::boards(at_solution));
        } else if first != Some(at_solution) {
            steps.push(PlannedStep::boards(at_solution));
        }
        let ring = self.design.main_lens.ring_f_number(solution.aperture);
        let value = format!("{:.2} mm, f/{ring:.2}", solution.aperture);
        let setup = Setup::Aperture { diameter_mm: solution.aperture, ring_f_number: ring };
        let aperture = PlannedStep::new("aperture", Some(value), setup);
        // Where the first boards are all that is surely in range on arrival, the others are put up after the aperture is set.
        let stay = first.is_some() && first != Some(at_solution) && steps.len() == 2;
        let arrived = self.boards_at(solution.delta_v, self.unknown_on_arrival_mm(spacing_sigma), first);
        let place = if stay && arrived == first { 1 } else { steps.len() };
        steps.insert(place, aperture);
        let mut standing = solution.equivalent_distance;
        if let Arrangement::InTurn { places_mm } = self.arrangement {
            for place in places_mm.into_iter().filter(|&place| place != solution.equivalent_distance) {
                steps.push(PlannedStep::boards(AirBoards::Flat(place)));
                standing = place;
            }
        }
        (steps, standing)
    }

    /// Where a board is put anew while e is moved from its home to where the shell is mounted.
    fn boards_while_parking(&self, standing_mm: f64) -> Vec<f64> {
        let (mut places, mut standing, mut from) = (Vec::new(), standing_mm, self.e.home_mm);
        while (self.mount_e_mm - from).abs() > self.e_tolerance_mm {
            let Some((place, way)) = self.board_along(standing, self.mount_e_mm - from) else { break };
            if place != standing {
                places.push(place);
            }
            (standing, from) = (place + way, from + way);
        }
        places
    }

    fn duration_s(&self, kind: JobKind, config: &Config) -> f64 {
        let (focus, e) = (&config.bench.focus, &config.bench.e);
        let homing: f64 =
            [focus, e].iter().map(|axis| (axis.high_limit_mm - axis.low_limit_mm) / axis.speed_mm_per_s / 2.0).sum();
        let e_way = (e.home_position_mm - self.solution.e).abs() / e.speed_mm_per_s;
        let focus_way = (self.solution.delta_v - focus.home_position_mm).abs() / focus.speed_mm_per_s;
        let megapixels = f64::from(config.sensor.width_px) * f64::from(config.sensor.height_px) / 1e6;
        // A frame counts that was begun once both axes had settled.
        let settled_ms = focus.settle_ms.max(e.settle_ms) as f64;
        let frame_s = 2.0 / config.bench.camera.frame_rate_hz;
        let measured_s = PAUSES_S + settled_ms / 1000.0 + frame_s + MEASURED_S_PER_MEGAPIXEL * megapixels;
        let homing = if kind == JobKind::ShellOnly { 0.0 } else { homing };
        let in_air = if kind == JobKind::ShellOnly { 0.0 } else { 2.0 * focus_way + MEASUREMENTS[0] * measured_s };
        let through_shell = if has_shell(kind) { 2.0 * e_way + MEASUREMENTS[1] * measured_s } else { 0.0 };
        homing + in_air + through_shell
    }
}
