//! Physical sense of `[bench.simulation]`.

use super::check::Faults;
use super::{
    BubblesConfig, Config, DustConfig, MicrolensesConfig, MosaicConfig, MotionConfig, ReelConfig, SimulationConfig,
};
use plenoptics::optics::{ArrayKind, CameraDesign};

/// Travel of an axis in one exposure beyond which a wrong unit is likelier than a wish, µm.
const MOST_TRAVEL_UM: f64 = 5000.0;
/// Specks or bubbles beyond which a slip of the keyboard is likelier than a wish.
const MOST_SPECKS: u32 = 20_000;
/// As [`MOST_SPECKS`]; a bubble costs every ray a look.
const MOST_BUBBLES: u32 = 500;

impl SimulationConfig {
    pub(super) fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.{name}");
        for (name, error) in [
            ("focal_length_error", self.focal_length_error),
            ("focus_scale_error", self.focus_scale_error),
            ("e_scale_error", self.e_scale_error),
        ] {
            faults.require(error > -1.0, key(name), || {
                format!("{error} would leave nothing: it is relative, 0.05 for 5 %, and greater than -1")
            });
        }
        for (name, value) in [
            ("focus_backlash_mm", self.focus_backlash_mm),
            ("e_backlash_mm", self.e_backlash_mm),
            ("friction_step_mm", self.friction_step_mm),
            ("read_noise_levels", self.read_noise_levels),
            ("electrons_per_level", self.electrons_per_level),
        ] {
            faults.not_negative(key(name), value);
        }
        faults.require(self.rays > 0, key("rays"), || "must be at least 1".to_owned());
        faults.require(self.preview_rays > 0, key("preview_rays"), || "must be at least 1".to_owned());
        faults.positive(key("preview_rate_hz"), self.preview_rate_hz);
        faults.require((8..=16).contains(&self.bits), key("bits"), || {
            format!("{} is no depth of a frame: 8 to 16 bits", self.bits)
        });
        self.microlenses.check(faults);
        self.dust.check(faults);
        self.bubbles.check(faults);
        self.motion.check(faults);
        self.reel.check(faults);
        self.mosaic.check(faults);
    }
}

/// A fault unless a range is two numbers in order, the first at least `least`.
fn range(faults: &mut Faults, key: String, [low, high]: [f64; 2], least: f64, most: f64) {
    faults.require(least <= low && low <= high && high <= most, key, || {
        let bounds = if most.is_finite() { format!("from {least} to {most}") } else { format!("of at least {least}") };
        format!("[{low}, {high}] is not the least and the greatest of values {bounds}, in this order")
    });
}

/// Whether a value is a share; a fault otherwise.
fn share(faults: &mut Faults, key: String, value: f64) -> bool {
    let is_share = (0.0..=1.0).contains(&value);
    faults.require(is_share, key, || format!("{value} is not a share from 0 to 1"));
    is_share
}

impl MicrolensesConfig {
    fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.microlenses.{name}");
        faults.require(self.focal_factors.iter().all(|&factor| factor > 0.0), key("focal_factors"), || {
            "must each be greater than 0: they are focal lengths over f_MLA".to_owned()
        });
        let shares =
            share(faults, key("dead_share"), self.dead_share) & share(faults, key("dirty_share"), self.dirty_share);
        faults.require(!shares || self.dead_share + self.dirty_share <= 1.0, key("dirty_share"), || {
            format!("{} and dead_share, {}, are more than all microlenses", self.dirty_share, self.dead_share)
        });
        range(faults, key("dirty_transmission"), self.dirty_transmission, 0.0, 1.0);
    }
}

impl DustConfig {
    fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.dust.{name}");
        faults.require(self.specks <= MOST_SPECKS, key("specks"), || {
            format!("{} is more than the {MOST_SPECKS} handled", self.specks)
        });
        range(faults, key("radius_um"), self.radius_um, 0.0, f64::INFINITY);
        range(faults, key("opacity"), self.opacity, 0.0, 1.0);
        faults.not_negative(key("height_um"), self.height_um);
    }
}

impl BubblesConfig {
    fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.bubbles.{name}");
        faults.require(self.count <= MOST_BUBBLES, key("count"), || {
            format!("{} is more than the {MOST_BUBBLES} handled", self.count)
        });
        if faults.positive(key("radius_mm"), self.radius_mm[0]) {
            range(faults, key("radius_mm"), self.radius_mm, 0.0, f64::INFINITY);
        }
        range(faults, key("distance_mm"), self.distance_mm, 0.0, f64::INFINITY);
        faults.require(self.distance_mm[0] > self.radius_mm[1], key("distance_mm"), || {
            format!("{} is not beyond the greatest radius, {}", self.distance_mm[0], self.radius_mm[1])
        });
        faults.not_negative(key("highlight"), self.highlight);
    }
}

impl MotionConfig {
    fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.motion.{name}");
        faults.require((1..=256).contains(&self.steps), key("steps"), || {
            format!("{} moments of an exposure: from 1 to 256 are rendered", self.steps)
        });
        for (name, way) in [("delta_v_um", self.delta_v_um), ("e_um", self.e_um)] {
            faults.require(way.abs() <= MOST_TRAVEL_UM, key(name), || {
                format!("{way} is further than an axis goes in one exposure: at most ±{MOST_TRAVEL_UM}")
            });
        }
        let moves = [self.delta_v_um, self.e_um, self.board_um[0], self.board_um[1]].iter().any(|&way| way != 0.0);
        faults.require(self.steps != 1 || !moves, key("steps"), || {
            "1 is a single moment, in which nothing moves: give 2 or more, or no movement".to_owned()
        });
    }
}

impl ReelConfig {
    fn check(&self, faults: &mut Faults) {
        faults.not_negative("bench.simulation.reel.step_um".to_owned(), self.step_um);
        faults.require(self.poses > 0, "bench.simulation.reel.poses".to_owned(), || "must be at least 1".to_owned());
    }
}

impl MosaicConfig {
    fn check(&self, faults: &mut Faults) {
        let key = |name: &str| format!("bench.simulation.mosaic.{name}");
        faults.require(self.sensitivities.iter().all(|&factor| factor > 0.0), key("sensitivities"), || {
            "must each be greater than 0".to_owned()
        });
        share(faults, key("colour"), self.colour);
    }
}

impl Config {
    /// What the simulated camera is told of its optics against what they are.
    pub(super) fn check_simulated_optics(&self, design: &CameraDesign, faults: &mut Faults) {
        let simulation = &self.bench.simulation;
        let key = |name: &str| format!("bench.simulation.{name}");
        let (array, types) = (self.mla.array, simulation.microlenses.focal_factors.len());
        let expected = match array {
            ArrayKind::Square => 2,
            ArrayKind::Hexagonal => 3,
        };
        faults.require(types == 0 || types == expected, key("microlenses.focal_factors"), || {
            format!("has {types}: a {} array has {expected} types, or none given where all are alike", array.name())
        });
        let (b, height) = (design.mla.b(), simulation.dust.height_um / 1000.0);
        faults.require(height < b, key("dust.height_um"), || {
            format!("{} is not between sensor and MLA, which are {:.0} µm apart", simulation.dust.height_um, 1000.0 * b)
        });
        let sensor = self.sensor_extent();
        let d = design.air_lens_to_mla();
        let corner = sensor.width.hypot(sensor.height) / (2.0 * (d + b));
        // Beyond a change of the slope by 4/27 a barrel's law has no inverse; half as far out again as the corner there
        // are rays, and below a tenth the law is one that lenses have.
        let most = 0.1 / (1.5 * corner).powi(2);
        faults.require(simulation.distortion_k1.abs() <= most, key("distortion_k1"), || {
            format!(
                "{} bends the rays beyond the corners by more than a tenth: at most ±{most:.3} here",
                simulation.distortion_k1
            )
        });
        let most = 0.1 * d / (corner / 0.1).powi(2);
        faults.require(simulation.exit_pupil_walk_mm.abs() <= most, key("exit_pupil_walk_mm"), || {
            format!(
                "{} moves the pupil by more than a tenth of d for the corners: at most ±{most:.3} mm here",
                simulation.exit_pupil_walk_mm
            )
        });
    }
}
