//! Physical sense: what no camera, shell or bench can be is refused, with the reason.

use toml::{Table, Value};

use super::schema::joined;
use super::{BenchConfig, Config, ConfigError, LBoundSource, Violation};
use plenoptics::optics::{CameraDesign, MlaMode, water};

/// Pixels of the largest frame that is believed: beyond it a slip of the keyboard is likelier than a sensor.
const MOST_PIXELS: u64 = 1 << 28;

/// Least width and height of a sensor, px: in less there is no grid of micro-images, however fine.
const LEAST_SIDE_PX: u32 = 16;

/// Greatest number that is believed of any key, whatever its unit: a thousand kilometres in mm. With more, or with less
/// than [`LEAST`] where 0 will not do, arithmetic comes to no finite numbers.
const GREATEST: f64 = 1e9;
/// Least number that is believed of a key that must be greater than 0.
const LEAST: f64 = 1e-9;

/// Gathers what is wrong.
#[derive(Default)]
pub(super) struct Faults(Vec<Violation>);

impl Faults {
    /// Notes a fault of a key.
    pub(super) fn add(&mut self, key: impl Into<String>, message: impl Into<String>) {
        self.0.push(Violation { key: key.into(), position: None, message: message.into() });
    }

    /// Notes a fault unless something holds.
    pub(super) fn require(&mut self, holds: bool, key: impl Into<String>, message: impl FnOnce() -> String) {
        if !holds {
            self.add(key, message());
        }
    }

    /// Whether a value is above 0, and not by next to nothing; a fault otherwise.
    pub(super) fn positive(&mut self, key: impl Into<String>, value: f64) -> bool {
        self.require(value >= LEAST, key, || match value > 0.0 {
            true => format!("must be at least {LEAST:e}, not {value:e}"),
            false => format!("must be greater than 0, not {value}"),
        });
        value >= LEAST
    }

    /// A fault where a value is below 0.
    pub(super) fn not_negative(&mut self, key: impl Into<String>, value: f64) {
        self.require(value >= 0.0, key, || format!("must not be negative, as {value} is"));
    }
}

impl Config {
    /// Whether the configuration makes physical sense.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] with everything that is wrong.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.violations().map_or(Ok(()), |violations| {
            Err(ConfigError::Invalid { origin: "the configuration".to_owned(), violations })
        })
    }

    /// What is allowed and yet worth a word to the operator, one sentence each.
    #[must_use]
    pub fn notices(&self) -> Vec<String> {
        let mut notices = self.bench.notices();
        let report = self.design().report(&self.design_criteria());
        let (focus, needed) = (&self.bench.focus, report.joint.solution.delta_v);
        if !(focus.low_limit_mm..=focus.high_limit_mm).contains(&needed) {
            notices.push(format!(
                "the joint solution needs Δv = {needed:.3} mm, which is beyond the focus axis's travel of {} to {} mm",
                focus.low_limit_mm, focus.high_limit_mm
            ));
        }
        if self.assembly.initial_e_mm > report.e_max {
            notices.push(format!(
                "at initial_e_mm = {} the shell's rim shows in the picture's corners: e_max is {:.1} mm",
                self.assembly.initial_e_mm, report.e_max
            ));
        }
        notices
    }

    /// Everything that is wrong; `None` where nothing is.
    pub(super) fn violations(&self) -> Option<Vec<Violation>> {
        self.found(|faults| {
            self.check_camera(faults);
            self.check_water(faults);
            self.check_assembly(faults);
            self.check_uncertainty(faults);
            self.check_travel(faults);
            self.bench.check(faults);
            self.server.check(faults);
            self.alpaca.check(faults);
            self.history.check(faults);
            self.record.check(faults);
            self.foxglove.check(faults);
            self.mqtt.check(faults);
            self.check_rotation(faults);
            self.check_mosaic(faults);
            // A design can be worked out only of parts that make sense each for itself.
            if faults.0.is_empty() {
                self.check_design(faults);
                let design = self.design();
                if design.air_lens_to_mla() > 0.0 {
                    self.check_simulated_optics(&design, faults);
                }
            }
        })
    }

    /// What is wrong with the camera alone, whatever bench is to align it; `None` where nothing is.
    pub(super) fn camera_violations(&self) -> Option<Vec<Violation>> {
        self.found(|faults| {
            self.check_camera(faults);
            self.check_water(faults);
            self.check_assembly(faults);
            self.check_uncertainty(faults);
            if faults.0.is_empty() {
                self.check_design(faults);
            }
        })
    }

    /// What `check` finds in a configuration whose numbers are believed.
    fn found(&self, check: impl FnOnce(&mut Faults)) -> Option<Vec<Violation>> {
        let mut faults = Faults::default();
        match Table::try_from(self) {
            Ok(table) => believed(&table, "", &mut faults),
            Err(error) => faults.add("the configuration", format!("cannot be written as TOML: {error}")),
        }
        // Comparisons with NaN or infinity would only repeat in other words that the number is none.
        if faults.0.is_empty() {
            check(&mut faults);
        }
        (!faults.0.is_empty()).then_some(faults.0)
    }

    fn check_uncertainty(&self, faults: &mut Faults) {
        for (key, sigma) in self.uncertainty.keyed() {
            faults.not_negative(key, sigma);
        }
        let shares = ["focal_length", "mla_pitch", "mla_focal_length", "mla_to_sensor"];
        for (key, share) in self.uncertainty.keyed() {
            let relative = shares.iter().any(|name| key.ends_with(&format!(".{name}")));
            faults
                .require(!relative || share < 0.5, key, || format!("{share} is not a share of a value that is known"));
        }
    }

    fn check_camera(&self, faults: &mut Faults) {
        let lens = &self.main_lens;
        faults.positive("main_lens.focal_length_mm", lens.focal_length_mm);
        if let Some(sigma) = lens.principal_from_mount_sigma_mm {
            faults.not_negative("main_lens.principal_from_mount_sigma_mm", sigma);
            faults.require(lens.principal_from_mount_mm.is_some(), "main_lens.principal_from_mount_sigma_mm", || {
                "is the uncertainty of principal_from_mount_mm, which is not given".to_owned()
            });
        }

        let mla = &self.mla;
        faults.positive("mla.pitch_mm", mla.pitch_mm);
        faults.positive("mla.focal_length_mm", mla.focal_length_mm);
        match mla.mode {
            MlaMode::Galilean => faults.require(mla.angular_resolution > 1.0, "mla.angular_resolution", || {
                format!(
                    "must be greater than 1 in Galilean mode, where b = f_MLA (1 - 1/N) would be 0 or less at {}",
                    mla.angular_resolution
                )
            }),
            MlaMode::Keplerian => {
                faults.positive("mla.angular_resolution", mla.angular_resolution);
            }
        }

        let sensor = &self.sensor;
        faults.positive("sensor.pixel_um", sensor.pixel_um);
        for (key, side_px) in [("sensor.width_px", sensor.width_px), ("sensor.height_px", sensor.height_px)] {
            faults.require(side_px >= LEAST_SIDE_PX, key, || {
                format!("must be at least {LEAST_SIDE_PX}: in a smaller frame no micro-images are found")
            });
        }
        faults.require(
            u64::from(sensor.width_px) * u64::from(sensor.height_px) <= MOST_PIXELS,
            "sensor.width_px",
            || format!("times height_px is more than {MOST_PIXELS} pixels, the largest frame handled"),
        );

        let shell = &self.shell;
        let inner = faults.positive("shell.inner_radius_mm", shell.inner_radius_mm);
        let outer = faults.positive("shell.outer_radius_mm", shell.outer_radius_mm);
        faults.require(
            !(inner && outer) || shell.inner_radius_mm < shell.outer_radius_mm,
            "shell.inner_radius_mm",
            || {
                format!(
                    "{} mm is not less than outer_radius_mm, {} mm: the shell would have no thickness",
                    shell.inner_radius_mm, shell.outer_radius_mm
                )
            },
        );
        index(faults, "shell.refractive_index", shell.refractive_index);
    }

    fn check_water(&self, faults: &mut Faults) {
        let water = &self.water;
        let conditions = [
            ("water.temperature_c", water.temperature_c, water::check_temperature as fn(f64) -> _),
            ("water.salinity_permille", water.salinity_permille, water::check_salinity),
            ("water.wavelength_nm", water.wavelength_nm, water::check_wavelength),
        ];
        for (key, value, check) in conditions {
            match value {
                None if water.refractive_index.is_none() => faults.add(
                    key,
                    "is missing: [water] needs refractive_index, or all of temperature_c, salinity_permille and \
                     wavelength_nm",
                ),
                None => {}
                Some(_) if water.refractive_index.is_some() => {
                    faults.add(key, "contradicts refractive_index: give one or the other");
                }
                Some(value) => {
                    if let Err(refusal) = check(value) {
                        faults.add(key, refusal.to_string());
                    }
                }
            }
        }
        if let Some(value) = water.refractive_index {
            index(faults, "water.refractive_index", value);
        }
    }

    fn check_assembly(&self, faults: &mut Faults) {
        let object = &self.object;
        faults.positive("object.distance_mm", object.distance_mm);
        faults.positive("object.air_distance_mm", object.air_distance_mm);

        let boards = &self.boards;
        faults.positive("boards.greatest_depth_mm", boards.greatest_depth_mm);
        faults.positive("boards.farthest_mm", boards.farthest_mm);
        for (key, length) in [
            ("boards.level_step_mm", boards.level_step_mm),
            ("boards.side_mm", boards.side_mm),
            ("boards.tank_mm", boards.tank_mm),
        ] {
            if let Some(length) = length {
                faults.positive(key, length);
            }
        }

        let assembly = &self.assembly;
        faults.not_negative("assembly.clearance_mm", assembly.clearance_mm);
        for (key, tolerance) in [
            ("assembly.delta_v_tolerance_mm", assembly.delta_v_tolerance_mm),
            ("assembly.e_tolerance_mm", assembly.e_tolerance_mm),
        ] {
            if let Some(tolerance) = tolerance {
                faults.positive(key, tolerance);
            }
        }
        faults.positive("assembly.blur_limit_px", assembly.blur_limit_px);
    }

    /// Whether the assembly is within the reach of the bench.
    fn check_travel(&self, faults: &mut Faults) {
        let assembly = &self.assembly;
        let (low, high) = (self.bench.e.low_limit_mm, self.bench.e.high_limit_mm);
        let travel = format!("the e axis's travel of {low} to {high} mm (bench.e)");
        let (l_bound, wall) = (assembly.l_bound_mm, assembly.e_wall_mm(assembly.l_bound_mm));
        if !(low..=high).contains(&l_bound) {
            faults.add("assembly.l_bound_mm", format!("{l_bound} mm is beyond {travel}"));
        } else if wall < low {
            faults.add(
                "assembly.l_bound_mm",
                format!(
                    "puts the e wall (l_bound_mm less e_tolerance_mm, or less 0.1, or less clearance_mm where that is \
                     less) at {wall} mm, beyond {travel}"
                ),
            );
        } else if CameraDesign::fov_optimal_e(l_bound) > high {
            faults.add("bench.e.high_limit_mm", format!("the joint solution's e = 0 is beyond {travel}"));
        }
        let initial = assembly.initial_e_mm;
        if !(low..=high).contains(&initial) {
            faults.add("assembly.initial_e_mm", format!("{initial} mm is beyond {travel}"));
        } else if assembly.l_bound == LBoundSource::Configured && l_bound <= high && initial < l_bound {
            faults.add(
                "assembly.initial_e_mm",
                format!("{initial} mm is less than l_bound_mm, {l_bound} mm: the lens would be too near the shell"),
            );
        }
    }

    /// A lattice repeats itself: rotations beyond half its symmetry are another name for one within.
    fn check_rotation(&self, faults: &mut Faults) {
        if let Some(rotation) = self.bench.simulation.array_rotation_deg {
            let limit = match self.mla.array {
                plenoptics::optics::ArrayKind::Square => 45.0,
                plenoptics::optics::ArrayKind::Hexagonal => 30.0,
            };
            faults.require(rotation > -limit && rotation <= limit, "bench.simulation.array_rotation_deg", || {
                format!("{rotation} is outside the ({}, {limit}] that a {} array has", -limit, self.mla.array.name())
            });
        }
    }

    /// What the parts come to together.
    fn check_design(&self, faults: &mut Faults) {
        let design = self.design();
        let f = design.main_lens.focal_length;
        if design.air_distance <= f {
            let message = format!("{} is not beyond the focal length, {f}: no real image", design.air_distance);
            faults.add("object.air_distance_mm", message);
            return;
        }
        let d = design.air_lens_to_mla();
        faults.require(d > 0.0, "mla.angular_resolution", || {
            format!("puts the MLA {:.3} mm in front of the main lens: a must be less than v", -d)
        });
        let (initial, inner) = (self.assembly.initial_e_mm, design.shell.inner_radius);
        faults.require(initial > -inner, "assembly.initial_e_mm", || {
            format!("{initial} puts the lens into the shell, whose inner radius is {inner}")
        });
        for (key, e) in [
            ("assembly.initial_e_mm", initial),
            ("assembly.l_bound_mm", CameraDesign::fov_optimal_e(self.assembly.l_bound_mm)),
        ] {
            let equivalent = design.shell.equivalent_distance(design.object_distance, e);
            faults.require(equivalent > f, key, || {
                format!(
                    "at e = {e} the object appears {equivalent:.1} mm from the lens, not beyond the focal length of {f}"
                )
            });
        }
        if faults.0.is_empty() && !design.report(&self.design_criteria()).is_finite() {
            faults.add("main_lens", "and the array, sensor, shell and distances come to no finite numbers together");
        }
    }
}

impl BenchConfig {
    fn notices(&self) -> Vec<String> {
        let mut notices = Vec::new();
        if self.e.home_side == super::Side::Low {
            notices.push(
                "bench.e.home_side = \"low\": homing the e axis runs towards the shell, and is refused unless the \
                 operator has said that the shell is off"
                    .to_owned(),
            );
        }
        notices
    }
}

/// A fault where a refractive index relative to air is below 1.
fn index(faults: &mut Faults, key: &str, value: f64) {
    faults.require(value >= 1.0, key, || format!("must be at least 1, relative to air, not {value}"));
}

/// A fault for every number of a section that is NaN, infinite or beyond all measure.
fn believed(table: &Table, path: &str, faults: &mut Faults) {
    let mut check = |key: &str, number: f64| {
        faults.require(number.abs() <= GREATEST, key, || match number.is_finite() {
            true => format!("must be within ±{GREATEST:e}, not {number:e}"),
            false => format!("must be a finite number, not {number}"),
        });
    };
    for (key, value) in table {
        let full = joined(path, key);
        match value {
            Value::Float(number) => check(&full, *number),
            Value::Array(items) => items.iter().filter_map(Value::as_float).for_each(|number| check(&full, number)),
            _ => {}
        }
    }
    for (key, value) in table {
        if let Value::Table(inner) = value {
            believed(inner, &joined(path, key), faults);
        }
    }
}
