//! The unit of sensor and MLA as it is: dust before the pixels, and microlenses that are not all alike.

use super::camera::{CameraTruth, Lattice};
use crate::sim::flaws::{Flaws, MicrolensFlaws, MicrolensState};

/// Microlenses that differ and dust, ready for a frame.
pub(super) struct UnevenUnit<'a> {
    lattice: Lattice,
    camera: &'a CameraTruth,
    microlenses: &'a MicrolensFlaws,
    /// By type of microlens: what its power does, as [`power_as_shift`].
    shifts: [f32; 3],
    dust: Vec<Shade>,
    /// How far from its pixel, in y, a ray can be where it passes the highest speck, mm.
    spread: f64,
}

/// A speck as rays meet it.
#[derive(Debug, Clone, Copy)]
struct Shade {
    place: [f32; 2],
    radius_squared: f32,
    left: f32,
    /// The speck's height over b: 0 on the sensor, 1 at the array.
    share: f32,
}

/// How far `p` must seem to move, for each mm of u, so that a microlens of the camera's `mla_focal_length` bends a ray as
/// one of `focal_length` (mm) does.
pub(super) fn power_as_shift(camera: &CameraTruth, focal_length: f64) -> f64 {
    camera.mla_to_sensor * (1.0 / focal_length - 1.0 / camera.mla_focal_length)
}

impl<'a> UnevenUnit<'a> {
    /// `None` where the microlenses are all alike and clean, and nothing lies before the pixels.
    pub(super) fn new(camera: &'a CameraTruth, flaws: &'a Flaws) -> Option<Self> {
        let shifts = [0, 1, 2].map(|kind| power_as_shift(camera, camera.microlens_focal_length(kind)) as f32);
        if flaws.dust.is_empty() && flaws.microlenses.none() && shifts == [0.0; 3] {
            return None;
        }
        let dust = flaws
            .dust
            .iter()
            .map(|speck| Shade {
                place: speck.place.map(|place| place as f32),
                radius_squared: speck.radius.powi(2) as f32,
                left: (1.0 - speck.opacity) as f32,
                share: (speck.height / camera.mla_to_sensor) as f32,
            })
            .collect();
        // Without baffles a pixel's rays reach microlenses two and a half pitches away.
        let highest = flaws.dust.iter().map(|speck| speck.height).fold(0.0, f64::max);
        let spread = camera.pixel + 2.5 * camera.mla_pitch * highest / camera.mla_to_sensor;
        Some(Self { lattice: Lattice::new(camera), camera, microlenses: &flaws.microlenses, shifts, dust, spread })
    }

    /// What the pixels of the row at `y` (mm on the sensor) meet.
    pub(super) fn row(&self, y: f64) -> UnevenRow<'_> {
        let near = |shade: &&Shade| {
            (f64::from(shade.place[1]) - y).abs() < f64::from(shade.radius_squared.sqrt()) + self.spread
        };
        UnevenRow {
            unit: self,
            dust: self.dust.iter().filter(near).copied().collect(),
            centre: [f32::NAN; 2],
            shift: 0.0,
            state: MicrolensState::Clean,
        }
    }
}

/// What a row's rays meet between pixel and array.
pub(super) struct UnevenRow<'a> {
    unit: &'a UnevenUnit<'a>,
    dust: Vec<Shade>,
    /// The microlens met last, by its centre, and what it is like.
    centre: [f32; 2],
    shift: f32,
    state: MicrolensState,
}

/// What is left of a ray.
pub(super) struct Passed {
    /// The share of its light.
    pub(super) weight: f32,
    /// Where it seems to start, from the microlens's centre, for a microlens of the camera's f_MLA.
    pub(super) p: [f32; 2],
}

impl UnevenRow<'_> {
    /// Passes a ray from `p` through `u`, both from the microlens's centre `c`, all mm.
    pub(super) fn pass(&mut self, p: [f32; 2], u: [f32; 2], c: [f32; 2]) -> Passed {
        if self.centre != c {
            let index = self.unit.lattice.nearest(c.map(f64::from)).index.map(|index| index as i32);
            self.centre = c;
            self.state = self.unit.microlenses.state(index);
            self.shift = self.unit.shifts[self.unit.camera.microlens_type(index)];
        }
        let radius = (self.unit.camera.mla_pitch / 2.0) as f32;
        let mut weight = match self.state {
            MicrolensState::Clean => 1.0,
            MicrolensState::Dead => 0.0,
            MicrolensState::Dirty { mean, slope } => mean + (slope[0] * u[0] + slope[1] * u[1]) / radius,
        };
        for shade in &self.dust {
            let across = |k: usize| c[k] + p[k] + (u[k] - p[k]) * shade.share - shade.place[k];
            if across(0).powi(2) + across(1).powi(2) <= shade.radius_squared {
                weight *= shade.left;
            }
        }
        Passed { weight, p: [p[0] + self.shift * u[0], p[1] + self.shift * u[1]] }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::optics::tests::reference_camera;
    use crate::optics::{ArrayKind, MainLens};
    use crate::sim::flaws::Speck;
    use crate::sim::renderer::{Medium, RenderOptions, Renderer, Tracer};
    use crate::sim::scene::{Board, Scene};
    use crate::sim::texture::TextureMap;

    const PIXEL: f64 = 0.00345;

    fn camera(array: ArrayKind) -> CameraTruth {
        let design = reference_camera();
        let mut camera = CameraTruth::from_design(&design, 2.205, Medium::Air, PIXEL, 240, 180);
        camera.array = array;
        camera.rotation = 0.01;
        camera.offset = [4.0, -3.0];
        camera
    }

    fn scene() -> Scene {
        let values: Vec<f32> = (0..64 * 64).map(|k| ((k * 7919) % 101) as f32 / 101.0).collect();
        Scene::Board(Board::new(167.17, Arc::new(TextureMap::from_values(&values, 0.3))))
    }

    /// The microlens of a pixel, `None` where the pixel or one beside it straddles a border.
    fn microlens(tracer: &Tracer, x: usize, y: usize) -> Option<[i32; 2]> {
        let at = |dx: f64, dy: f64| tracer.index(tracer.microlens_at([x as f64 + dx, y as f64 + dy]));
        let here = at(0.0, 0.0);
        [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].iter().all(|d| at(d[0], d[1]) == here).then_some(here)
    }

    #[test]
    fn a_dead_microlens_is_dark_and_its_neighbours_are_as_before() {
        let renderer = Renderer::new(RenderOptions { rays: 16, seed: 3 });
        for array in [ArrayKind::Square, ArrayKind::Hexagonal] {
            let camera = camera(array);
            let tracer = Tracer::new(&camera);
            let microlenses = MicrolensFlaws { seed: 1, dead_share: 0.2, ..MicrolensFlaws::NONE };
            let flaws = Flaws { microlenses, ..Flaws::default() };
            let clean = renderer.render(&camera, &scene());
            let flawed = renderer.render_flawed(&camera, &scene(), &flaws, None);
            let (mut dead, mut alive) = (0, 0);
            for k in 0..clean.len() {
                let Some(index) = microlens(&tracer, k % 240, k / 240) else { continue };
                if microlenses.state(index) == MicrolensState::Dead {
                    assert_eq!(flawed[k], 0.0);
                    dead += usize::from(clean[k] > 0.0);
                } else {
                    assert_eq!(flawed[k], clean[k]);
                    alive += 1;
                }
            }
            assert!(dead > 2000 && alive > 10_000, "{dead} dark pixels, {alive} others");
        }
    }

    #[test]
    fn a_dirty_microlens_dims_its_micro_image_and_tips_its_pupil() {
        let renderer = Renderer::new(RenderOptions { rays: 256, seed: 3 });
        let camera = camera(ArrayKind::Square);
        let tracer = Tracer::new(&camera);
        let microlenses =
            MicrolensFlaws { seed: 2, dirty_share: 0.5, dirty_transmission: [0.2, 0.9], ..MicrolensFlaws::NONE };
        let clean = renderer.render(&camera, &Scene::Diffuser);
        let flawed =
            renderer.render_flawed(&camera, &Scene::Diffuser, &Flaws { microlenses, ..Flaws::default() }, None);
        let mut tips = [0.0f64; 2];
        for k in 0..clean.len() {
            let position = [(k % 240) as f64, (k / 240) as f64];
            let lens = tracer.microlens_at(position);
            let centre = tracer.micro_image_centre(lens);
            let MicrolensState::Dirty { mean, slope } = microlenses.state(tracer.index(lens)) else { continue };
            let away = [position[0] - centre[0], position[1] - centre[1]];
            let ratio = flawed[k] / clean[k];
            if away[0].hypot(away[1]) < 8.0 {
                // The whole pupil is seen: its mean counts.
                assert!((ratio - mean).abs() < 0.01, "{ratio} for {mean}");
            } else if away[0].hypot(away[1]) < 13.0 && clean[k] < 0.9 {
                // A part of it: the side that counts follows the pixel's, and with it the transmission.
                tips[0] += f64::from(ratio - mean) * (away[0] * f64::from(slope[0]) + away[1] * f64::from(slope[1]));
                tips[1] += f64::from(ratio - mean).abs();
            }
        }
        assert!(tips[0].abs() > 0.5 * tips[1], "{tips:?}");
    }

    #[test]
    fn dust_stays_in_its_pixels_whatever_the_frame_shows() {
        let renderer = Renderer::new(RenderOptions { rays: 64, seed: 3 });
        let camera = camera(ArrayKind::Square);
        let place = camera.sensor_from_frame([100.0, 60.0]);
        let speck = Speck { place, radius: 4.0 * PIXEL, opacity: 0.6, height: 0.0 };
        let flaws = Flaws { dust: vec![speck], ..Flaws::default() };
        let mut moved = camera;
        moved.lens_to_mla += 0.2;
        for (camera, scene) in [(camera, Scene::Diffuser), (camera, scene()), (moved, scene())] {
            let clean = renderer.render(&camera, &scene);
            let flawed = renderer.render_flawed(&camera, &scene, &flaws, None);
            for (k, (&flawed, &clean)) in flawed.iter().zip(&clean).enumerate() {
                let away = ((k % 240) as f64 - 100.0).hypot((k / 240) as f64 - 60.0);
                if away < 4.0 - 0.71 {
                    assert!((flawed - 0.4 * clean).abs() < 1e-6, "{flawed} for {clean} at {away} px");
                } else if away > 4.0 + 0.71 {
                    assert_eq!(flawed, clean);
                }
            }
        }
    }

    #[test]
    fn dust_on_the_cover_glass_casts_a_soft_shadow_of_the_same_darkness() {
        let renderer = Renderer::new(RenderOptions { rays: 256, seed: 3 });
        let camera = camera(ArrayKind::Square);
        let tracer = Tracer::new(&camera);
        let lens = tracer.microlens_at([120.0, 90.0]);
        let centre = tracer.micro_image_centre(lens);
        let (radius, share) = (0.01, 0.1);
        // On the line from the micro-image's centre to the microlens.
        let p = camera.sensor_from_frame(centre);
        let place = [0, 1].map(|k| p[k] + share * (lens.centre[k] - p[k]));
        let speck = Speck { place, radius, opacity: 1.0, height: share * camera.mla_to_sensor };
        let flaws = Flaws { dust: vec![speck], ..Flaws::default() };
        let clean = renderer.render(&camera, &Scene::Diffuser);
        let flawed = renderer.render_flawed(&camera, &Scene::Diffuser, &flaws, None);
        // Rays from p to u pass p (1 − s) + u s: each u sees a disc of radius r/(1 − s), about another place.
        let reach = (radius + share * camera.mla_pitch / 2.0) / (1.0 - share) / PIXEL;
        let mut lost = 0.0;
        for k in 0..clean.len() {
            let away = ((k % 240) as f64 - centre[0]).hypot((k / 240) as f64 - centre[1]);
            if away > reach + 0.75 {
                assert_eq!(flawed[k], clean[k], "{away} px");
            }
            lost += f64::from(clean[k] - flawed[k]);
        }
        let expected = std::f64::consts::PI * (radius / (1.0 - share) / PIXEL).powi(2);
        println!("shadow of {lost:.3} px² for {expected:.3} px², {reach:.2} px around");
        assert!((lost / expected - 1.0).abs() < 0.01, "{lost} for {expected}");
        // Without a height the shadow is sharp: here half of it lies beyond the speck's own edge.
        let inside = (0..clean.len())
            .filter(|k| ((k % 240) as f64 - centre[0]).hypot((k / 240) as f64 - centre[1]) < radius / PIXEL)
            .map(|k| f64::from(clean[k] - flawed[k]))
            .sum::<f64>();
        assert!(inside < 0.85 * lost, "{inside} of {lost}");
    }

    #[test]
    fn each_type_of_microlens_sees_as_an_array_of_its_focal_length() {
        let renderer = Renderer::new(RenderOptions { rays: 64, seed: 3 });
        for (array, types, factors) in
            [(ArrayKind::Square, 2, [1.1, 0.92, 1.0]), (ArrayKind::Hexagonal, 3, [1.0, 0.9, 1.12])]
        {
            let camera = CameraTruth { focal_factors: factors, ..camera(array) };
            let tracer = Tracer::new(&camera);
            let mixed = renderer.render(&camera, &scene());
            let mut seen = [0usize; 3];
            let mut worst = [0.0f32; 3];
            for (kind, factor) in factors.iter().enumerate().take(types) {
                let alone = CameraTruth {
                    focal_factors: [1.0; 3],
                    mla_focal_length: camera.mla_focal_length * factor,
                    ..camera
                };
                let alone = renderer.render(&alone, &scene());
                for k in 0..mixed.len() {
                    let Some(index) = microlens(&tracer, k % 240, k / 240) else { continue };
                    if camera.microlens_type(index) == kind {
                        seen[kind] += 1;
                        worst[kind] = worst[kind].max((mixed[k] - alone[k]).abs());
                    }
                }
            }
            println!("{array:?}: {seen:?} pixels, worst {worst:?}");
            // A ray at an edge of the aperture may round to its other side: one of 64.
            assert!(worst.iter().all(|&worst| worst < 0.02), "{worst:?}");
            let all: usize = seen.iter().sum();
            for &seen in &seen[..types] {
                assert!((seen as f64 / all as f64 - 1.0 / types as f64).abs() < 0.06, "{seen} of {all}");
            }
            let [i, j] = tracer.index(tracer.microlens_at([120.0, 90.0]));
            let neighbours: &[[i32; 2]] = match array {
                ArrayKind::Square => &[[1, 0], [0, 1], [-1, 0], [0, -1]],
                ArrayKind::Hexagonal => &[[1, 0], [0, 1], [-1, 1], [-1, 0], [0, -1], [1, -1]],
            };
            for step in neighbours {
                assert_ne!(camera.microlens_type([i, j]), camera.microlens_type([i + step[0], j + step[1]]));
            }
        }
    }

    #[test]
    fn a_type_is_sharp_where_its_focal_length_says() {
        let camera = CameraTruth { focal_factors: [1.0, 0.95, 1.0], ..camera(ArrayKind::Square) };
        let tracer = Tracer::new(&camera);
        let main_lens = MainLens { focal_length: camera.focal_length };
        let lens = tracer.microlens_at([120.0, 90.0]);
        for lens in [lens, tracer.step(lens, 1, 0)] {
            let f = camera.microlens_focal_length(camera.microlens_type(tracer.index(lens)));
            let a = 1.0 / (1.0 / camera.mla_to_sensor - 1.0 / f);
            let distance = main_lens.object_distance(camera.lens_to_mla + a);
            let board = Board::new(distance, Arc::new(TextureMap::from_values(&[1.0], 1.0)));
            let at = |u: f64| tracer.board_point(&board, lens, tracer.micro_image_centre(lens), [u, u]).unwrap();
            let (one, other) = (at(-0.03), at(0.03));
            assert!((one[0] - other[0]).hypot(one[1] - other[1]) < 1e-9, "{one:?} {other:?} at {distance} mm");
        }
    }
}
