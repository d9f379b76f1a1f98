//! The simulated camera's parts as `[bench.simulation]` has them.

use plenoptics::sim::exposure::Noise;
use plenoptics::sim::flaws::{Bubble, Flaws, MicrolensFlaws, Speck};
use plenoptics::sim::renderer::{CameraTruth, Medium};
use plenoptics::sim::shutter::{Displacement, Mosaic, Shutter};
use plenoptics::sim::texture::TextureMap;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::config::{Config, SimulationConfig, Texture};

/// The configured number of flaws, spread by the seed: dust over the frame, bubbles over the field that it sees. They
/// depend on nothing that moves.
#[must_use]
pub fn flaws(config: &Config, in_water: bool, seed: u64) -> Flaws {
    let simulation = &config.bench.simulation;
    let sensor = config.sensor_extent();
    let mut random = Pcg64::seed_from_u64(seed ^ 0xd057_0f5a_3b1e_c0de);
    let dust = &simulation.dust;
    let dust = (0..dust.specks)
        .map(|_| Speck {
            place: [sensor.width, sensor.height].map(|side| side * random.random_range(-0.5..0.5)),
            radius: between(&mut random, dust.radius_um) / 1000.0,
            opacity: between(&mut random, dust.opacity),
            height: dust.height_um / 1000.0,
        })
        .collect();
    let mut random = Pcg64::seed_from_u64(seed ^ 0xb0bb_1e50_0000_f100);
    let bubbles = &simulation.bubbles;
    let bubbles = (0..bubbles.count)
        .map(|_| {
            let distance = between(&mut random, bubbles.distance_mm);
            // Rays of the field part from near the shell's centre, or from the lens.
            let away = distance + if in_water { config.shell.outer_radius_mm } else { 0.0 };
            let seen = away / config.main_lens.focal_length_mm;
            Bubble {
                place: [sensor.width, sensor.height].map(|side| side * seen * random.random_range(-0.5..0.5)),
                distance,
                radius: between(&mut random, bubbles.radius_mm),
                highlight: bubbles.highlight,
            }
        })
        .collect();
    let microlenses = MicrolensFlaws {
        seed: seed ^ 0x1e45_dead_d127_0000,
        dead_share: simulation.microlenses.dead_share,
        dirty_share: simulation.microlenses.dirty_share,
        dirty_transmission: simulation.microlenses.dirty_transmission,
    };
    Flaws { dust, bubbles, microlenses }
}

/// A value drawn evenly from a range.
fn between(random: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * random.random::<f64>()
}

/// The camera with its array lying and its parts sitting as simulated: the array's rotation (configured, or drawn from
/// `seed` within ±1°) and offset (drawn from `seed` within half a pitch), the tilts, the shell's decentre, the main
/// lens's aberrations, the microlenses' types, and whether they let neighbours' light through.
#[must_use]
pub fn camera(mut camera: CameraTruth, simulation: &SimulationConfig, seed: u64) -> CameraTruth {
    let mut random = Pcg64::seed_from_u64(seed ^ 0xa77a_11e5_0f5e_7000);
    let drawn: f64 = random.random_range(-1.0..1.0);
    let pitch = camera.mla_pitch / camera.pixel;
    camera.rotation = simulation.array_rotation_deg.unwrap_or(drawn).to_radians();
    camera.offset = [random.random_range(-0.5..0.5) * pitch, random.random_range(-0.5..0.5) * pitch];
    camera.mla_tilt = simulation.mla_tilt_mrad.map(|tilt| tilt / 1000.0);
    camera.lens_tilt = simulation.lens_tilt_mrad.map(|tilt| tilt / 1000.0);
    camera.distortion_k1 = simulation.distortion_k1;
    camera.pupil_walk = simulation.exit_pupil_walk_mm;
    for (factor, configured) in camera.focal_factors.iter_mut().zip(&simulation.microlenses.focal_factors) {
        *factor = *configured;
    }
    camera.baffled = !simulation.cross_talk;
    if let Medium::Water { decentre, .. } = &mut camera.medium {
        *decentre = simulation.shell_decentre_mm;
    }
    camera
}

/// How frames are exposed.
#[must_use]
pub fn noise(simulation: &SimulationConfig) -> Noise {
    Noise {
        read_noise_levels: simulation.read_noise_levels,
        electrons_per_level: simulation.electrons_per_level,
        bits: simulation.bits,
        ..Noise::default()
    }
}

/// How frames are exposed for so many times as long, and amplified so many times as much: longer, there are more
/// electrons to a level; amplified, levels and read noise grow alike, and a level is made of fewer electrons.
#[must_use]
pub fn exposed(noise: Noise, longer: f64, gain: f64) -> Noise {
    Noise {
        exposure_gain: noise.exposure_gain * longer * gain,
        read_noise_levels: noise.read_noise_levels * gain,
        electrons_per_level: noise.electrons_per_level / gain,
        ..noise
    }
}

/// The exposure, centred on the pose.
#[must_use]
pub fn shutter(config: &Config) -> Shutter {
    const MICROMETRE: f64 = 1e-3;
    let simulation = &config.bench.simulation;
    let motion = &simulation.motion;
    let half = |sign: f64| Displacement {
        delta_v: sign * 0.5 * motion.delta_v_um * MICROMETRE,
        e: sign * 0.5 * motion.e_um * MICROMETRE,
        board: motion.board_um.map(|way| sign * 0.5 * way * MICROMETRE),
    };
    let sensitivities = simulation.mosaic.sensitivities;
    let mosaic = config.sensor.mosaic.map(|pattern| Mosaic { pattern, sensitivities });
    Shutter { steps: motion.steps, from: half(-1.0), to: half(1.0), mosaic }
}

/// A board's texture, with its colours where the sensor has filters to see them. `texel` in mm.
#[must_use]
pub fn texture(config: &Config, texture: Texture, texel: f64, seed: u64) -> TextureMap {
    if config.sensor.mosaic.is_some() {
        TextureMap::generate_coloured(texture, texel, seed, config.bench.simulation.mosaic.colour)
    } else {
        TextureMap::generate(texture, texel, seed)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use plenoptics::sim::renderer::{RenderOptions, Renderer};
    use plenoptics::sim::scene::{Board, Scene, texel_for};

    use super::*;

    #[test]
    fn with_nothing_configured_a_frame_is_the_plain_one_to_the_bit() {
        let mut config = Config::default();
        let design = config.design();
        let medium = Medium::Water { shell: design.shell, e: 2.0, decentre: [0.0; 2] };
        let truth = CameraTruth::from_design(&design, design.joint(0.0).delta_v, medium, 0.00345, 120, 60);
        let texel = texel_for(&design, medium, 800.0, truth.pixel);
        let scene = Scene::Board(Board::new(800.0, Arc::new(TextureMap::generate(Texture::Natural, texel, 1))));
        let renderer = Renderer::new(RenderOptions { rays: 8, seed: 4 });
        let plain = renderer.render(&truth, &scene);
        let flaws = flaws(&config, true, 1);
        assert_eq!(plain, shutter(&config).collect(&renderer, &truth, &scene, &flaws));
        config.bench.simulation.motion.steps = 5;
        assert_eq!(plain, shutter(&config).collect(&renderer, &truth, &scene, &flaws));
        let seeded = camera(truth, &config.bench.simulation, 1);
        let explicit = CameraTruth { distortion_k1: 0.0, pupil_walk: 0.0, focal_factors: [1.0; 3], ..seeded };
        assert_eq!(seeded, explicit);
    }

    #[test]
    fn seeded_flaws_lie_where_configured() {
        let mut config = Config::default();
        let none = flaws(&config, true, 5);
        assert_eq!(none, Flaws { microlenses: none.microlenses, ..Flaws::default() });
        config.bench.simulation.dust.specks = 300;
        config.bench.simulation.bubbles.count = 40;
        let some = flaws(&config, true, 5);
        assert_eq!(some, flaws(&config, true, 5));
        assert_ne!(some, flaws(&config, true, 6));
        assert_eq!(some.dust, flaws(&config, false, 5).dust);
        assert_eq!((some.dust.len(), some.bubbles.len()), (300, 40));
        for speck in &some.dust {
            assert!(speck.place.iter().all(|place| place.abs() <= 2.001) && (0.002..=0.012).contains(&speck.radius));
        }
        for bubble in &some.bubbles {
            assert!((60.0..=400.0).contains(&bubble.distance) && (0.2..=0.8).contains(&bubble.radius));
        }
    }
}
