//! Bubbles between the camera and the board, by exact rays.
//!
//! A ray that meets one is refracted on the way in and on the way out, or totally reflected, and goes on to see the board
//! from where it leaves; bent out of the field it sees the dark around the board. So a bubble of air in water is a dark
//! ring about a small bright picture. A lamp above and behind the camera is mirrored by its front.

use super::camera::{CameraTruth, Medium};
use super::rays::{Ray, Vector, dot, snell};
use crate::optics::shell::N_AIR;
use crate::sim::flaws::Bubble;

/// Refractive index of drops in air: water.
const N_DROP: f64 = 1.333;
/// Towards the lamp, not of unit length: above (−y) and behind the camera.
const LAMP: [f64; 3] = [0.25, -0.6, -1.0];
/// Cosine of the lamp's angular radius, 8°.
const LAMP_COS: f32 = 0.990_268;
/// How much steeper than the frame's corner a ray may be and still meet the board.
const FIELD: f64 = 1.5;

/// The bubbles before one camera, the nearest first.
pub(super) struct Bubbles {
    spheres: Vec<Sphere>,
    /// Index of the medium over that inside.
    ratio: f32,
    lamp: Vector<f32>,
    steepest_squared: f32,
}

#[derive(Debug, Clone, Copy)]
struct Sphere {
    centre: Vector<f32>,
    radius: f32,
    highlight: f32,
}

impl Bubbles {
    /// The bubbles wholly before the nearest board, which is at `board` mm. `None` where there are none.
    pub(super) fn new(camera: &CameraTruth, bubbles: &[Bubble], board: f64) -> Option<Self> {
        let (datum, ratio) = match camera.medium {
            Medium::Air => (0.0, N_AIR / N_DROP),
            Medium::Water { shell, e, .. } => (e + shell.outer_radius, shell.n_water / N_AIR),
        };
        let mut before: Vec<&Bubble> =
            bubbles.iter().filter(|bubble| bubble.distance + bubble.radius < board).collect();
        if before.is_empty() {
            return None;
        }
        before.sort_by(|one, other| one.distance.total_cmp(&other.distance));
        let spheres = before.iter().map(|bubble| Sphere {
            centre: [bubble.place[0] as f32, bubble.place[1] as f32, (datum + bubble.distance) as f32],
            radius: bubble.radius as f32,
            highlight: bubble.highlight as f32,
        });
        let length = dot(LAMP, LAMP).sqrt();
        let corner = camera.half_field_slope() * (1.0 + (camera.height as f64 / camera.width as f64).powi(2)).sqrt();
        Some(Self {
            spheres: spheres.collect(),
            ratio: ratio as f32,
            lamp: LAMP.map(|part| (part / length) as f32),
            steepest_squared: (FIELD * corner).powi(2) as f32,
        })
    }

    /// The ray after all bubbles, its direction of any length, and the light it has met on the way.
    pub(super) fn pass(&self, ray: Ray<f32>) -> (Ray<f32>, f32) {
        if !ray.open {
            return (ray, 0.0);
        }
        let (mut ray, mut light, mut met) = (ray, 0.0, false);
        for sphere in &self.spheres {
            if let Some((bent, seen)) = self.meet(&ray, sphere) {
                ray = bent;
                light += seen;
                met = true;
            }
        }
        if met {
            let [x, y, z] = ray.along;
            ray.open = z > 0.0 && x * x + y * y <= self.steepest_squared * z * z;
        }
        (ray, light)
    }

    /// The ray after a bubble and what it mirrors; `None` where the ray misses it.
    fn meet(&self, ray: &Ray<f32>, sphere: &Sphere) -> Option<(Ray<f32>, f32)> {
        let to = [0, 1, 2].map(|k| sphere.centre[k] - ray.from[k]);
        let length_squared = dot(ray.along, ray.along);
        let reach = dot(to, ray.along) / length_squared;
        // From the centre to the ray's nearest point: by components, where squares would lose their digits.
        let aside = [0, 1, 2].map(|k| reach * ray.along[k] - to[k]);
        let half_squared = sphere.radius * sphere.radius - dot(aside, aside);
        if half_squared <= 0.0 || reach <= 0.0 {
            return None;
        }
        let unit = 1.0 / length_squared.sqrt();
        let along = ray.along.map(|part| part * unit);
        let half = half_squared.sqrt();
        let entry = [0, 1, 2].map(|k| aside[k] - half * along[k]);
        let inward = entry.map(|part| -part / sphere.radius);
        let cos = dot(along, inward);
        let mirrored = [0, 1, 2].map(|k| along[k] - 2.0 * cos * inward[k]);
        let light = if dot(mirrored, self.lamp) > LAMP_COS { sphere.highlight } else { 0.0 };
        let (inside, enters) = snell(along, inward, self.ratio);
        let (from, along) = if enters {
            let chord = -2.0 * dot(entry, inside);
            let exit = [0, 1, 2].map(|k| entry[k] + chord * inside[k]);
            let outward = exit.map(|part| part / sphere.radius);
            // What came in at this angle goes out at it.
            (exit, snell(inside, outward, 1.0 / self.ratio).0)
        } else {
            (entry, mirrored)
        };
        let from = [0, 1, 2].map(|k| from[k] + sphere.centre[k]);
        Some((Ray { from, along, open: true }, light))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::optics::tests::reference_camera;
    use crate::sim::flaws::Flaws;
    use crate::sim::renderer::{RenderOptions, Renderer, Tracer};
    use crate::sim::scene::{Board, Scene};
    use crate::sim::texture::TextureMap;

    fn bubbles(medium: Medium) -> Bubbles {
        let design = reference_camera();
        let camera = CameraTruth::from_design(&design, 0.0, medium, 0.00345, 1160, 1160);
        let bubble = Bubble { place: [0.0, 0.0], distance: 100.0, radius: 1.0, highlight: 8.0 };
        Bubbles::new(&camera, &[bubble], 800.0).unwrap()
    }

    /// The angle by which a ray parallel to the axis, at a height (radii), is bent away from or (negative) to the axis.
    fn deflection(bubbles: &Bubbles, height: f32) -> f64 {
        let ray = Ray { from: [0.0, height, 0.0], along: [0.0, 0.0, 2.0], open: true };
        let (bent, _) = bubbles.meet(&ray, &bubbles.spheres[0]).unwrap();
        f64::from(bent.along[1]).atan2(f64::from(bent.along[2]))
    }

    #[test]
    fn a_bubble_in_water_bends_rays_as_a_sphere_of_air_does() {
        let shell = reference_camera().shell;
        let found = bubbles(Medium::Water { shell, e: 0.0, decentre: [0.0; 2] });
        for height in [0.1, 0.4, 0.7f64] {
            // Two refractions, each by the difference of the angles inside and outside.
            let outside = height.asin();
            let expected = 2.0 * ((shell.n_water * height).asin() - outside);
            assert!((deflection(&found, height as f32) - expected).abs() < 1e-4, "{height}");
        }
        for height in [0.76, 0.9, 0.99f64] {
            // Beyond 1/n total reflection, by twice the angle to the tangent.
            let expected = std::f64::consts::PI - 2.0 * height.asin();
            assert!((deflection(&found, height as f32) - expected).abs() < 1e-3, "{height}");
        }
        let grazing = Ray { from: [0.0, 1.01, 0.0], along: [0.0, 0.0, 1.0], open: true };
        assert!(found.meet(&grazing, &found.spheres[0]).is_none());
    }

    #[test]
    fn a_drop_in_air_gathers_rays_to_the_focus_of_a_ball() {
        let found = bubbles(Medium::Air);
        // Paraxially f = n r/(2 (n − 1)) from its centre.
        let f = N_DROP / (2.0 * (N_DROP - 1.0));
        let bent = deflection(&found, 0.01);
        assert!((bent * f / -0.01 - 1.0).abs() < 2e-3, "{bent}");
    }

    #[test]
    fn the_lamp_shows_where_the_mirror_law_puts_it() {
        let found = bubbles(Medium::Air);
        // Seen along +z, the normal there halves the angle between −z and the lamp.
        let half = [found.lamp[0], found.lamp[1], found.lamp[2] - 1.0];
        let length = dot(half, half).sqrt();
        let light = |x: f32, y: f32| found.pass(Ray { from: [x, y, 0.0], along: [0.0, 0.0, 1.0], open: true }).1;
        let place = [half[0] / length, half[1] / length];
        assert_eq!(light(place[0], place[1]), 8.0);
        // The spot is about half the lamp's angular radius across from its middle: 0.07 radii.
        assert_eq!(light(place[0] + 0.1, place[1]), 0.0);
        assert_eq!(light(0.0, 0.0), 0.0);
        assert_eq!(light(-place[0], -place[1]), 0.0);
    }

    /// A bubble's shadow is where chief rays put a thing at its distance, which is not where they put the board.
    #[test]
    fn adjacent_micro_images_see_a_bubble_at_its_own_distance() {
        let design = reference_camera();
        let medium = Medium::Water { shell: design.shell, e: 0.0, decentre: [0.0; 2] };
        let mut camera = CameraTruth::from_design(&design, design.joint(0.0).delta_v, medium, 0.00345, 61, 31);
        camera.offset = [camera.mla_pitch / 2.0 / camera.pixel, 0.0];
        let grey = Arc::new(TextureMap::from_values(&[0.5], 1.0));
        let scene = Scene::Board(Board::new(800.0, Arc::clone(&grey)));
        let bubble = Bubble { place: [0.0, 0.0], distance: 300.0, radius: 0.2, highlight: 0.0 };
        let flaws = Flaws { bubbles: vec![bubble], ..Flaws::default() };
        let renderer = Renderer::new(RenderOptions { rays: 1024, seed: 2 });
        let clean = renderer.render(&camera, &scene);
        let flawed = renderer.render_flawed(&camera, &scene, &flaws, None);
        let tracer = Tracer::new(&camera);
        let lenses = [[15.0, 15.0], [45.0, 15.0]].map(|position| tracer.microlens_at(position));
        let shadow = |lens| {
            let centre = tracer.micro_image_centre(lens);
            let mut sums = [0.0f64; 2];
            for (k, (&flawed, &clean)) in flawed.iter().zip(&clean).enumerate() {
                let x = (k % 61) as f64;
                if (x - centre[0]).abs() < 14.0 {
                    sums[0] += f64::from(clean - flawed);
                    sums[1] += f64::from(clean - flawed) * x;
                }
            }
            assert!(sums[0] > 0.5, "no shadow: {sums:?}");
            sums[1] / sums[0]
        };
        let found = shadow(lenses[1]) - shadow(lenses[0]);
        let at = |distance| tracer.spacing(&Board::new(distance, Arc::clone(&grey)), lenses, [0.0, 0.0]).unwrap();
        let (bubble, board) = (at(300.0), at(800.0));
        println!("shadows {found:.3} px apart; chief rays: bubble {bubble:.3} px, board {board:.3} px");
        assert!((found - bubble).abs() < 0.1, "{found} for {bubble}");
        assert!((bubble - board).abs() > 1.0);
        // Behind the board, or before a diffuser, there is none.
        let near = Scene::Board(Board::new(300.1, grey));
        for scene in [near, Scene::Diffuser] {
            assert_eq!(renderer.render(&camera, &scene), renderer.render_flawed(&camera, &scene, &flaws, None));
        }
    }
}
