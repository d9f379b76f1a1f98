//! What stands in the way of a plan: told before anything moves, with the key that would have to be otherwise.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::boards::{Arrangement, levels_fault};
use super::expected::ExpectedBudget;
use super::precision::Precision;
use super::{FREE_PROBES, Plan, spacing_in_water};
use crate::loops::calibrated::CalibratedCamera;
use bench::config::{BoardsInAir, Config};
use plenoptics::optics::mla::micro_image_pitch;

/// Fewer micro-images across the frame than this are no field.
const LEAST_ACROSS: f64 = 8.0;
/// Micro-images smaller than this are not measured, px.
const LEAST_PITCH_PX: f64 = 10.0;
/// Greatest b as a share of d: the micro-images' pitch exceeds the MLA's by as much.
const MOST_B_OF_D: f64 = 0.2;
/// Standard uncertainties by which the spacings of neighbouring levels have to differ.
const LEVELS_TOLD: f64 = 10.0;
/// Least difference of the spacings of neighbouring levels, px, at which they are told apart side by side.
const LEVELS_TOLD_PX: f64 = 0.9;
/// Coarsest axes.
const LEAST_STEPS_PER_MM: f64 = 50.0;
/// Most that the shell's aberrations may add to the spacing, px.
const MOST_EXCESS_PX: f64 = 0.7;
/// So many times larger at most is a shell proposed.
const MOST_LARGER: f64 = 5.0;
/// The way from where the shell is mounted to the optimum must be at least this long, mm, for e to be led by the picture.
const LEAST_WAY_MM: f64 = 0.3;

/// A key of the configuration, or what was asked for, that keeps an alignment from its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Obstacle {
    /// The key, dotted, or the request's `e_mm`.
    pub key: String,
    /// Its value now, in words.
    pub value: String,
    /// What it would have to be, in words.
    pub needed: String,
    /// Why, in a sentence.
    pub why: String,
}

impl Obstacle {
    /// That homing the e axis would run it towards a shell that is `state`, in words.
    pub(crate) fn homes_towards_shell(state: &str) -> Self {
        obstacle(
            "bench.e.home_side",
            "\"low\"",
            "\"high\", or the shell said to be off (PUT /api/v1/shell)",
            format!("the job begins with a homing, which runs the e axis towards the shell, and the shell is {state}"),
        )
    }
}

impl std::fmt::Display for Obstacle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} is {}, and would have to be {}: {}", self.key, self.value, self.needed, self.why)
    }
}

fn obstacle(key: &str, value: impl ToString, needed: impl Into<String>, why: impl Into<String>) -> Obstacle {
    Obstacle { key: key.to_owned(), value: value.to_string(), needed: needed.into(), why: why.into() }
}

/// A limit of an axis's travel, mm, in words, and what its controller's own leaves of it.
fn left(configured_mm: f64, left_mm: f64) -> String {
    if configured_mm == left_mm {
        configured_mm.to_string()
    } else {
        format!("{configured_mm}, of which the axis's controller leaves {left_mm:.2}")
    }
}

/// A lower bound to so many places, rounded upwards: what is said to be enough is.
fn at_least(value: f64, places: i32) -> f64 {
    let unit = 10f64.powi(places);
    (value * unit).ceil() / unit
}

/// An upper bound to so many places, rounded downwards.
fn at_most(value: f64, places: i32) -> f64 {
    let unit = 10f64.powi(places);
    (value * unit).floor() / unit
}

impl Plan {
    /// What stands in its way, in the order in which it would be met.
    pub(super) fn obstacles(&self, config: &Config) -> Vec<Obstacle> {
        let mut found = Vec::new();
        self.check_camera(config, &mut found);
        // Of a camera that cannot be measured nothing else can be said.
        if found.is_empty() {
            self.check_focus_travel(config, &mut found);
            self.check_e_travel(config, &mut found);
            self.check_steps(config, &mut found);
            self.check_boards(config, &mut found);
            self.check_room(config, &mut found);
            self.check_aberrations(config, &mut found);
            self.check_way_in(config, &mut found);
            self.check_tolerance(config, &mut found);
        }
        found
    }

    fn check_camera(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let mla = &self.design.mla;
        let pitch_px = mla.pitch / config.pixel_pitch().millimetres();
        if pitch_px < LEAST_PITCH_PX {
            let least = LEAST_PITCH_PX * config.pixel_pitch().millimetres();
            found.push(obstacle(
                "mla.pitch_mm",
                mla.pitch,
                format!("at least {}", at_least(least, 4)),
                format!("micro-images of {pitch_px:.1} px are too small to be measured"),
            ));
        }
        let (d, b) = (self.design.lens_to_mla(self.solution.delta_v.min(0.0)), mla.b());
        if b > MOST_B_OF_D * d {
            let signed = mla.signed_resolution();
            // v = d + N b.
            let most_b = MOST_B_OF_D * (d + signed * b) / (1.0 + MOST_B_OF_D * signed);
            found.push(obstacle(
                "mla.focal_length_mm",
                mla.focal_length,
                format!("at most {}", at_most(most_b / (1.0 - 1.0 / signed), 3)),
                format!("the array would stand {d:.2} mm behind the lens and {b:.2} mm before the sensor: every move of the focus axis would change the micro-images' pitch"),
            ));
        }
        let target = mla.target_spacing() / mla.pitch;
        let [low, high] = self.capture.range();
        if !self.capture.holds(target) {
            let resolutions = [low, high].map(|end| (1.0 / (1.0 - end)).abs());
            found.push(obstacle(
                "mla.angular_resolution",
                mla.angular_resolution,
                format!(
                    "from {} to {}",
                    at_least(resolutions[0].min(resolutions[1]), 2),
                    at_most(resolutions[0].max(resolutions[1]), 2)
                ),
                format!(
                    "the spacing in focus, {target:.2} of the MLA's pitch, is outside of what is found in a frame, {low:.2} to {high:.2}"
                ),
            ));
        }
        let pitch = micro_image_pitch(mla.pitch, self.design.lens_to_mla(self.solution.delta_v), mla.b());
        for (key, pixels) in
            [("sensor.width_px", config.sensor.width_px), ("sensor.height_px", config.sensor.height_px)]
        {
            let needed = (LEAST_ACROSS * pitch / config.pixel_pitch().millimetres()).ceil();
            if f64::from(pixels) < needed {
                found.push(obstacle(
                    key,
                    pixels,
                    format!("at least {needed}"),
                    format!("a field of fewer than {LEAST_ACROSS} micro-images across says nothing"),
                ));
            }
        }
    }

    fn check_focus_travel(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let (axis, delta_v) = (&config.bench.focus, self.solution.delta_v);
        let unknown = self.focus.unknown_mm(delta_v);
        let why = format!(
            "Δv = {delta_v:.3} mm is wanted, and may lie {unknown:.2} mm beside the axis's reading (zero_uncertainty_mm and twice scale_uncertainty)"
        );
        let (least, most) = (delta_v - unknown, delta_v + unknown);
        let low = left(axis.low_limit_mm, self.focus.low_mm);
        let high = left(axis.high_limit_mm, self.focus.high_mm);
        if most > self.focus.high_mm {
            let needed = format!("at least {:.1}", at_least(most, 1));
            found.push(obstacle("bench.focus.high_limit_mm", &high, needed, why.clone()));
        }
        if least < self.focus.low_mm {
            let needed = format!("at most {:.1}", at_most(least, 1));
            found.push(obstacle("bench.focus.low_limit_mm", &low, needed, why));
        }
        let free = FREE_PROBES * self.focus_probe_mm;
        let why = format!("the first move after the homing needs {free:.2} mm free on both sides");
        if axis.home_position_mm - self.focus.low_mm < free {
            let needed = format!("at most {:.2}", axis.home_position_mm - free);
            found.push(obstacle("bench.focus.low_limit_mm", low, needed, why.clone()));
        }
        if self.focus.high_mm - axis.home_position_mm < free {
            let needed = format!("at least {:.2}", axis.home_position_mm + free);
            found.push(obstacle("bench.focus.high_limit_mm", high, needed, why));
        }
    }

    /// Whether the e axis comes to where the shell is mounted.
    fn check_e_travel(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let (axis, mount_mm) = (&config.bench.e, self.mount_e_mm);
        let why = format!("the shell is mounted at e = {mount_mm:.1} mm");
        if mount_mm > self.e.high_mm {
            let needed = format!("at least {:.1}", at_least(mount_mm, 1));
            found.push(obstacle("bench.e.high_limit_mm", left(axis.high_limit_mm, self.e.high_mm), needed, why));
        } else if mount_mm < self.e.low_mm {
            let needed = format!("at most {:.1}", at_most(mount_mm, 1));
            found.push(obstacle("bench.e.low_limit_mm", left(axis.low_limit_mm, self.e.low_mm), needed, why));
        }
    }

    /// Whether the axes' steps are as fine as an arrival is told by, and long enough at once for a first move.
    fn check_steps(&self, config: &Config, found: &mut Vec<Obstacle>) {
        for (name, axis, room, probe_mm) in [
            ("focus", &config.bench.focus, &self.focus, self.focus_probe_mm),
            ("e", &config.bench.e, &self.e, self.e_probe_mm),
        ] {
            if axis.steps_per_mm < LEAST_STEPS_PER_MM {
                found.push(obstacle(
                    &format!("bench.{name}.steps_per_mm"),
                    axis.steps_per_mm,
                    format!("at least {LEAST_STEPS_PER_MM}"),
                    "an axis has arrived within a hundredth of a millimetre, which half a step must not exceed",
                ));
            }
            if room.most_mm < probe_mm {
                let least = at_least(axis.max_step_mm + probe_mm - room.most_mm, 2);
                found.push(obstacle(
                    &format!("bench.{name}.max_step_mm"),
                    axis.max_step_mm,
                    format!("at least {least}"),
                    format!("the first move is {probe_mm:.2} mm long, and play is taken up besides"),
                ));
            }
        }
    }

    fn check_boards(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let (wanted, nearest) = (self.solution.equivalent_distance, self.capture.nearest_mm());
        let focal_length = self.design.main_lens.focal_length;
        if wanted < nearest {
            found.push(obstacle(
                "main_lens.focal_length_mm",
                focal_length,
                format!("at most {:.1}", focal_length * wanted / nearest),
                format!(
                    "behind the shell the board appears {wanted:.1} mm from the lens, where no board can be put in air"
                ),
            ));
            return;
        }
        if wanted > config.boards.farthest_mm {
            found.push(obstacle(
                "boards.farthest_mm",
                config.boards.farthest_mm,
                format!("at least {:.0}", wanted.ceil()),
                "the board in air stands where the one in water appears",
            ));
            return;
        }
        let start = self.focus.home_mm;
        if self.first_boards().is_none() {
            let anywhere = self.capture.anywhere().place_mm(wanted, start, self.focus.unknown_mm(start));
            found.push(match anywhere {
                Some(place) => obstacle(
                    "boards.farthest_mm",
                    config.boards.farthest_mm,
                    format!("at least {:.0}", place.ceil()),
                    "where the focus axis stands after its homing no nearer board is in the range of focus",
                ),
                None => obstacle(
                    "bench.focus.zero_uncertainty_mm",
                    config.bench.focus.zero_uncertainty_mm,
                    format!("at most {:.3}", self.known_enough_mm(start)),
                    "the range of focus is so short that no board is within it wherever the axis may stand after its homing",
                ),
            });
        }
        if let (BoardsInAir::TripleLevel, Arrangement::Levels { step_mm }) = (config.boards.in_air, self.arrangement) {
            self.check_levels(config, step_mm, found);
        }
    }

    /// Whether levels so far apart (mm) can be made, stand, are in range and are told apart.
    fn check_levels(&self, config: &Config, step_mm: f64, found: &mut Vec<Obstacle>) {
        let needed_px = (LEVELS_TOLD * Precision::of(config, self).spacing_px).max(LEVELS_TOLD_PX);
        let why = |step_mm: f64| levels_fault(config, &self.solution, &self.capture, step_mm, needed_px);
        let Some(now) = why(step_mm) else { return };
        // The longest step that would do.
        let other = (1..=2000).rev().map(|k| 0.5 * f64::from(k)).find(|&step_mm| why(step_mm).is_none());
        let needed = other.map_or_else(
            || "\"flat_in_turn\"".to_owned(),
            |step_mm| format!("\"flat_in_turn\", or boards.level_step_mm {step_mm}"),
        );
        found.push(obstacle("boards.in_air", "\"triple_level\"", needed, now));
    }

    /// Whether the boards fill the field where they stand, and the tank holds the one in water.
    fn check_room(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let (boards, water_mm) = (&config.boards, config.object.distance_mm);
        if let Some(tank_mm) = boards.tank_mm.filter(|&tank_mm| tank_mm < water_mm) {
            found.push(obstacle(
                "boards.tank_mm",
                tank_mm,
                format!("at least {water_mm}, or object.distance_mm {tank_mm} at most"),
                format!("the board in water stands {water_mm} mm from the shell's outer vertex"),
            ));
        }
        let Some(side_mm) = boards.side_mm else { return };
        let (sensor, solution) = (config.sensor_extent(), &self.solution);
        let extent = sensor.width.max(sensor.height);
        let in_water = self.design.half_width_in_water(extent, solution.delta_v, solution.e).map_or(f64::NAN, f64::abs);
        let [.., farthest_mm] = self.places_about(solution.equivalent_distance);
        let in_air = self.design.half_width_in_air(extent, solution.delta_v, farthest_mm);
        // Of a field whose edge no light reaches nothing can be said.
        let needed_mm = 2.0 * in_water.max(in_air);
        if side_mm < needed_mm {
            let wider = if in_water > in_air {
                format!("{water_mm} mm from the shell in water")
            } else {
                format!("{farthest_mm:.1} mm from the lens in air")
            };
            found.push(obstacle(
                "boards.side_mm",
                side_mm,
                format!("at least {:.0}", needed_mm.ceil()),
                format!(
                    "the field is {needed_mm:.0} mm wide {wider}, and what is seen beside a board is measured with it"
                ),
            ));
        }
    }

    /// How well Δv must be known at a reading (mm) for some board to be in range, mm.
    fn known_enough_mm(&self, reading_mm: f64) -> f64 {
        let seen = |within: f64| self.boards_at(reading_mm, within, None).is_some();
        let mut within = self.focus.unknown_mm(reading_mm);
        while within > 1e-3 && !seen(within) {
            within *= 0.7;
        }
        within
    }

    /// Whether the shell can be mounted where the picture through it can be measured.
    fn check_way_in(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let goal = self.solution.e;
        let seen = |e_mm: f64| self.capture.holds(spacing_in_water(&self.design, &self.solution, e_mm));
        // Where e is to be held there is no way to it.
        let held = self.wanted_mount_e_mm <= goal;
        if (held || self.mount_e_mm - goal >= LEAST_WAY_MM) && seen(self.mount_e_mm) {
            return;
        }
        let steps = 400;
        let reach = (0..=steps)
            .map(|k| goal + f64::from(k) / f64::from(steps) * (self.wanted_mount_e_mm - goal).max(0.0))
            .take_while(|&e_mm| seen(e_mm))
            .last()
            .map_or(0.0, |e_mm| e_mm - goal);
        found.push(obstacle(
            "bench.e.zero_uncertainty_mm",
            config.bench.e.zero_uncertainty_mm,
            format!("less than {:.2}, with bench.e.scale_uncertainty to match", (0.5 * reach).max(0.01)),
            format!(
                "through the shell the board is in the range of focus only within {reach:.2} mm of e = {goal:.2} mm, and the axis is known to ±{:.2} mm there",
                self.e.unknown_mm(goal + reach)
            ),
        ));
    }

    /// That the shell would be mounted, with e held, where the lens may touch it.
    pub(crate) fn held_too_near(&self, expected: ExpectedBudget) -> Option<Obstacle> {
        let ExpectedBudget { e_held_off_mm, .. } = expected;
        (e_held_off_mm > 0.0).then(|| {
            obstacle(
                "e_mm",
                format!("{:.3}", self.solution.e),
                format!("at least {}", at_least(self.solution.e + e_held_off_mm, 2)),
                "the shell is mounted with e there, and between the lens and where it touches the shell have to lie three of the standard uncertainties that e is expected to have",
            )
        })
    }

    /// What the shell's aberrations add to the spacing in focus over the estimator's window, px.
    pub(super) fn aberrations_px(&self, config: &Config) -> f64 {
        let e_mm = self.solution.e;
        CalibratedCamera::designed(config, e_mm).excess_px(e_mm, 0.0)
    }

    /// Whether the lens is too fast for the shell: what rays far from the axis add to the spacing is known to a share of it.
    fn check_aberrations(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let excess_px = |config: &Config| self.aberrations_px(config).abs();
        let now_px = excess_px(config);
        if now_px <= MOST_EXCESS_PX {
            return;
        }
        let mut larger = config.clone();
        let radius_mm = config.shell.outer_radius_mm;
        while excess_px(&larger) > MOST_EXCESS_PX && larger.shell.outer_radius_mm < MOST_LARGER * radius_mm {
            larger.shell.outer_radius_mm *= 1.05;
            larger.shell.inner_radius_mm *= 1.05;
        }
        found.push(obstacle(
            "shell.outer_radius_mm",
            radius_mm,
            format!(
                "at least {:.0} with shell.inner_radius_mm {:.0}, or main_lens.focal_length_mm shorter",
                larger.shell.outer_radius_mm.ceil(),
                larger.shell.outer_radius_mm.ceil() * larger.shell.inner_radius_mm / larger.shell.outer_radius_mm
            ),
            format!(
                "an aperture of {:.1} mm is so large for the shell that its aberrations add {now_px:.2} px to the spacing, and no more than {MOST_EXCESS_PX} px can be allowed for",
                self.solution.aperture
            ),
        ));
    }

    fn check_tolerance(&self, config: &Config, found: &mut Vec<Obstacle>) {
        let precision = Precision::of(config, self);
        let half_step_mm = 0.5 / config.bench.focus.steps_per_mm;
        let needed = half_step_mm + 2.5 * precision.delta_v_mm;
        if self.delta_v_tolerance_mm < needed {
            found.push(obstacle(
                "assembly.delta_v_tolerance_mm",
                self.delta_v_tolerance_mm,
                format!("at least {}", at_least(needed, 4)),
                format!(
                    "Δv is expected to be good to {:.4} mm (a spacing to {:.4} px), and twice that, beside half a step of the focus axis ({half_step_mm:.4} mm), has to lie within the tolerance",
                    precision.delta_v_mm, precision.spacing_px
                ),
            ));
        }
    }
}
