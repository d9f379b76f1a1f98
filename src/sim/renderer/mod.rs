//! Raw frames by exact rays: what a plenoptic camera's sensor would see of a scene.
//!
//! A pixel looks through the microlens in whose cell the chief ray from the pixel to M crosses the array (without
//! baffles: through every microlens whose rays pass the aperture, added up). Its value is the mean over its own area and
//! over the microlens's round aperture, jointly, of what the rays meet; a ray blocked by the main lens's aperture or by
//! the shell's rim counts as black, which is the vignetting. A value of 1 is a white board seen with nothing blocked.
//!
//! On the way a ray passes what [`Flaws`] puts there: dust before the sensor, microlenses that are dead or dirty, bubbles
//! before the board; and the aberrations and types of microlenses that [`CameraTruth`] gives. Where there is nothing of
//! the kind frames are the same to the bit as without this.
//!
//! Nothing here knows a conjugate distance, a spacing or anything of `imaging`. Frames depend on the seed alone, not on
//! how many threads share the rows.

mod batch;
mod bubbles;
mod camera;
mod rays;
mod sampling;
mod tracer;
mod unit;

use std::ops::Range;

use rayon::prelude::*;

pub use camera::{CameraTruth, Medium};
pub use tracer::{Microlens, Tracer};

use self::batch::{Batch, Layer};
use self::bubbles::Bubbles;
use self::camera::Lattice;
use self::rays::{Path, Plane};
use self::sampling::Patterns;
use self::unit::{UnevenRow, UnevenUnit};
use super::flaws::Flaws;
use super::scene::{Board, Scene};
use super::texture::TextureMap;
use crate::raw::Channel;

/// The range of a board across the whole field.
const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// How a frame is rendered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RenderOptions {
    /// Rays a pixel, at least 1; powers of two fill pixel and microlens most evenly.
    pub rays: u32,
    /// Seed of where the rays start.
    pub seed: u64,
}

/// A renderer with its sampling patterns made: keep it for many frames of one quality.
#[derive(Debug, Clone)]
pub struct Renderer {
    options: RenderOptions,
    patterns: Patterns,
}

impl Renderer {
    /// Makes the sampling patterns. No rays count as one.
    #[must_use]
    pub fn new(options: RenderOptions) -> Self {
        let options = RenderOptions { rays: options.rays.max(1), ..options };
        Self { options, patterns: Patterns::new(options.rays as usize, options.seed) }
    }

    /// The options in force.
    #[must_use]
    pub const fn options(&self) -> RenderOptions {
        self.options
    }

    /// Noise-free irradiance, row by row from the top; 1 is white seen with nothing blocked. Empty for an empty frame.
    #[must_use]
    pub fn render(&self, camera: &CameraTruth, scene: &Scene) -> Vec<f32> {
        self.render_flawed(camera, scene, &Flaws::default(), None)
    }

    /// As [`Self::render`] with something in the light's way, and as a colour channel sees the boards (`None`: grey).
    #[must_use]
    pub fn render_flawed(
        &self,
        camera: &CameraTruth,
        scene: &Scene,
        flaws: &Flaws,
        channel: Option<Channel>,
    ) -> Vec<f32> {
        let mut frame = vec![0.0f32; camera.width * camera.height];
        if frame.is_empty() || matches!(scene, Scene::Dark) {
            return frame;
        }
        let rows = Rows {
            camera,
            lattice: Lattice::new(camera),
            exact: Path::new(camera),
            path: Path::new(camera),
            layers: self.layers(camera, scene, channel),
            diffuse: matches!(scene, Scene::Diffuser),
            bubbles: scene.nearest_board().and_then(|board| Bubbles::new(camera, &flaws.bubbles, board)),
            unit: UnevenUnit::new(camera, flaws),
            reach: reach(camera),
            patterns: &self.patterns,
            rays: self.options.rays as usize,
        };
        let arch = pulp::Arch::new();
        frame.par_chunks_mut(camera.width).enumerate().for_each(|(y, row)| {
            arch.dispatch(RowTask { rows: &rows, y, row });
        });
        frame
    }

    fn layers<'a>(&self, camera: &CameraTruth, scene: &'a Scene, channel: Option<Channel>) -> Vec<Layer<'a>> {
        let layer = |board: &'a Board, range: [f64; 2], outline: Option<&'a TextureMap>| {
            let level = self.level(camera, board);
            Layer {
                plane: Plane::new(camera, board),
                range: [range[0] as f32, range[1] as f32],
                origin: [board.texture_origin[0] as f32, board.texture_origin[1] as f32],
                level: board.texture.in_channel(channel).level(level),
                outline: outline.map(|outline| outline.level(0)),
            }
        };
        match scene {
            Scene::Diffuser | Scene::Dark => Vec::new(),
            Scene::Board(board) => vec![layer(board, EVERYWHERE, None)],
            Scene::TripleBoard(triple) => {
                triple.strips.iter().map(|strip| layer(&strip.board, strip.range, None)).collect()
            }
            Scene::Cutouts(all) => {
                all.iter().map(|cutout| layer(&cutout.board, EVERYWHERE, cutout.outline.as_deref())).collect()
            }
        }
    }

    /// The level of the texture whose texels are as wide as the rays of a pixel lie apart on the board: a coarser one
    /// would blur, a finer one alias.
    fn level(&self, camera: &CameraTruth, board: &Board) -> usize {
        let tracer = Tracer::new(camera);
        let apart = tracer.pixel_area(board).map_or(0.0, |area| (area / f64::from(self.options.rays)).sqrt());
        let level = (apart / board.texture.texel()).log2().round();
        if level.is_finite() { level.max(0.0) as usize } else { 0 }
    }
}

/// Renders one frame; for many frames keep a [`Renderer`].
#[must_use]
pub fn render(camera: &CameraTruth, scene: &Scene, options: RenderOptions) -> Vec<f32> {
    Renderer::new(options).render(camera, scene)
}

/// How far from a micro-image's centre its microlens's light can fall, mm.
fn reach(camera: &CameraTruth) -> f64 {
    let (d, b) = (camera.lens_to_mla, camera.mla_to_sensor);
    // A microlens of radius r is a disc of radius |1 + d/b − d/f_MLA| r on the main lens; a pixel moves it by d/b.
    let disc = (0..3).map(|kind| (1.0 + d / b - d / camera.microlens_focal_length(kind)).abs()).fold(0.0, f64::max)
        * camera.mla_pitch
        / 2.0;
    // A twentieth more, for tilts.
    1.05 * (camera.aperture / 2.0 + disc) * b / d + camera.pixel
}

/// What all rows of a frame share.
struct Rows<'a> {
    camera: &'a CameraTruth,
    lattice: Lattice,
    exact: Path<f64>,
    path: Path<f32>,
    layers: Vec<Layer<'a>>,
    diffuse: bool,
    bubbles: Option<Bubbles>,
    unit: Option<UnevenUnit<'a>>,
    reach: f64,
    patterns: &'a Patterns,
    rays: usize,
}

/// One row, to be compiled for each instruction set: a closure would not be inlined into every one of them.
struct RowTask<'a> {
    rows: &'a Rows<'a>,
    y: usize,
    row: &'a mut [f32],
}

impl pulp::WithSimd for RowTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        self.rows.render(self.y, self.row);
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn render(&self, y: usize, row: &mut [f32]) {
        let camera = self.camera;
        let radius = (camera.mla_pitch / 2.0) as f32;
        let mut batch = Batch::new(camera.pixel as f32, radius);
        let place = |x: usize| camera.sensor_from_frame([x as f64, y as f64]);
        // Chief rays of neighbouring pixels cross the array so far apart.
        let step = self.exact.chief_on_mla([camera.pixel, 0.0])[0] - self.exact.chief_on_mla([0.0; 2])[0];
        // Half a pixel's diagonal: no part of a pixel so far inside a cell looks through another microlens.
        let margin = 0.71 * camera.pixel;
        // Where the pupil wanders chief rays do not cross the array evenly: each pixel looks for its own microlens.
        let even = !self.exact.aberrated;
        let mut uneven = self.unit.as_ref().map(|unit| unit.row(place(0)[1]));
        let mut x = 0;
        while x < row.len() {
            let p = place(x);
            let chief = self.exact.chief_on_mla(p);
            let nearest = self.lattice.nearest(chief);
            if !camera.baffled {
                let pattern = self.patterns.of_pixel(x, y);
                self.add_neighbours(&mut batch, x, p, nearest.index, pattern, row, &mut uneven);
                x += 1;
            } else if nearest.margin > margin {
                let inside = if even { self.lattice.steps_inside(nearest.centre, chief, step, margin) } else { 0 };
                let end = (x + 1 + inside).min(row.len());
                for x in x..end {
                    let pattern = self.patterns.of_pixel(x, y);
                    self.add_all(&mut batch, row, &mut uneven, |batch, rays| {
                        batch.add(x, [place(x)[0], p[1]], nearest.centre, pattern, rays)
                    });
                }
                x = end;
            } else {
                // The pixel straddles a border between cells: each ray belongs to its own.
                let pattern = self.patterns.of_pixel(x, y);
                self.add_all(&mut batch, row, &mut uneven, |batch, rays| {
                    batch.add_each(x, pattern, rays, |jitter| {
                        let place = [p[0] + jitter[0] * camera.pixel, p[1] + jitter[1] * camera.pixel];
                        let centre = self.lattice.nearest_centre(self.exact.chief_on_mla(place));
                        ([place[0] - centre[0], place[1] - centre[1]], centre)
                    })
                });
                x += 1;
            }
        }
        self.finish(&mut batch, row, uneven.is_some());
    }

    /// Adds all rays of a pixel, finishing the batch whenever it is full.
    #[inline(always)]
    fn add_all(
        &self,
        batch: &mut Batch,
        row: &mut [f32],
        uneven: &mut Option<UnevenRow<'_>>,
        add: impl Fn(&mut Batch, Range<usize>) -> usize,
    ) {
        let mut rest = 0..self.rays;
        while !rest.is_empty() {
            if batch.is_full() {
                self.finish(batch, row, uneven.is_some());
            }
            let from = batch.len();
            rest.start += add(batch, rest.clone());
            if let Some(uneven) = uneven {
                batch.dim(from, uneven);
            }
        }
    }

    /// Without baffles: the pixel's rays through every microlens whose light can reach it.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)] // one call, in the innermost loop
    fn add_neighbours(
        &self,
        batch: &mut Batch,
        x: usize,
        p: [f64; 2],
        index: [f64; 2],
        pattern: &sampling::Pattern,
        row: &mut [f32],
        uneven: &mut Option<UnevenRow<'_>>,
    ) {
        // In skewed coordinates two steps hold every microlens within 1.7 pitches.
        for di in -2..=2 {
            for dj in -2..=2 {
                let centre = self.lattice.centre(index[0] + f64::from(di), index[1] + f64::from(dj));
                let image = self.exact.chief_on_sensor(centre);
                if (p[0] - image[0]).hypot(p[1] - image[1]) > self.reach {
                    continue;
                }
                self.add_all(batch, row, uneven, |batch, rays| batch.add(x, p, centre, pattern, rays));
            }
        }
    }

    #[inline(always)]
    fn finish(&self, batch: &mut Batch, row: &mut [f32], weighted: bool) {
        batch.trace(&self.path, self.diffuse, &self.layers, self.bubbles.as_ref());
        if weighted {
            batch.apply_weights();
        }
        batch.collect(row, 1.0 / self.rays as f32);
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;
    use crate::config::Config;

    /// A camera with nothing but what this renderer has had from the start gives the frames it always gave, to the bit:
    /// arithmetic without libraries only, so that every machine agrees.
    #[test]
    fn frames_without_flaws_are_pinned() {
        let design = Config::default().design();
        let mut state = 1u32;
        let values: Vec<f32> = (0..64 * 64)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 24) as f32 / 255.0
            })
            .collect();
        let texture = std::sync::Arc::new(TextureMap::from_values(&values, 0.2));
        let water = Medium::Water { shell: design.shell, e: 3.0, decentre: [0.3, -0.2] };
        let camera = |medium| {
            let mut camera = CameraTruth::from_design(&design, 2.2, medium, 0.00345, 150, 90);
            camera.offset = [3.3, -7.1];
            camera.mla_tilt = [0.001, 0.002];
            camera.lens_tilt = [0.002, -0.001];
            camera
        };
        let hexagonal = |camera| CameraTruth { array: crate::optics::ArrayKind::Hexagonal, ..camera };
        let open = |camera| CameraTruth { baffled: false, ..camera };
        let board = Scene::Board(Board { tilt: [0.01, 0.0], ..Board::new(800.0, std::sync::Arc::clone(&texture)) });
        let air = camera(Medium::Air);
        let triple = crate::sim::scene::TripleBoard::new(&[159.0, 175.0, 167.0], air.half_field_slope(), &texture);
        let hash = |camera: &CameraTruth, scene: &Scene, rays| {
            let frame = render(camera, scene, RenderOptions { rays, seed: 7 });
            frame
                .iter()
                .flat_map(|value| value.to_bits().to_le_bytes())
                .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
        };
        let found = [
            hash(&camera(water), &board, 4),
            hash(&camera(water), &board, 50),
            hash(&open(camera(water)), &Scene::Diffuser, 4),
            hash(&hexagonal(air), &Scene::TripleBoard(triple), 16),
        ];
        assert_eq!(
            found,
            [0x458c_05c8_fee8_7dd2, 0x1c47_f28c_4644_5d5c, 0xbe94_cd74_1da6_ff62, 0x7374_2eb7_6cdc_c22c],
            "{found:#x?}"
        );
    }

    /// The fast path's rays end where those in double precision do.
    #[test]
    fn single_precision_is_far_better_than_a_pixel() {
        let design = Config::default().design();
        let board = Board::new(800.0, std::sync::Arc::new(TextureMap::from_values(&[0.5], 1.0)));
        for e in [0.0, 30.0] {
            let medium = Medium::Water { shell: design.shell, e, decentre: [0.3, -0.2] };
            let mut camera = CameraTruth::from_design(&design, design.clarity(e).delta_v, medium, 0.00345, 1160, 1160);
            camera.rotation = 0.01;
            camera.mla_tilt = [0.001, 0.002];
            let lattice = Lattice::new(&camera);
            let exact = Path::<f64>::new(&camera);
            let fast = Path::<f32>::new(&camera);
            let footprint = Tracer::new(&camera).footprint(&board).unwrap();
            let mut random = Pcg64::seed_from_u64(1);
            let (mut sum, mut worst, mut rays) = ([0.0f64; 2], 0.0f64, 0.0f64);
            for _ in 0..50_000 {
                let p = [random.random_range(-2.0..2.0), random.random_range(-2.0..2.0)];
                let c = lattice.nearest(exact.chief_on_mla(p)).centre;
                let u = [random.random_range(-0.035..0.035), random.random_range(-0.035..0.035)];
                let p = [p[0] - c[0], p[1] - c[1]];
                let ray = exact.spheres.unwrap().refract(exact.through_lens(p, u, c));
                let truth = Plane::new(&camera, &board).meet(&ray);
                let single = |v: [f64; 2]| v.map(|t| t as f32);
                let ray32 = fast.spheres.unwrap().refract(fast.through_lens(single(p), single(u), single(c)));
                let found = Plane::new(&camera, &board).meet(&ray32);
                if !ray.open {
                    continue;
                }
                for k in 0..2 {
                    let miss = (f64::from(found[k]) - truth[k]) / footprint;
                    sum[k] += miss;
                    worst = worst.max(miss.abs());
                }
                rays += 1.0;
            }
            println!("e = {e}: mean {:?} px, worst {worst:.1e} px over {rays} rays", sum.map(|s| s / rays));
            assert!(rays > 30_000.0);
            assert!(sum.iter().all(|s| (s / rays).abs() < 2e-5), "{sum:?} over {rays}");
            assert!(worst < 1e-3, "{worst}");
        }
    }
}
