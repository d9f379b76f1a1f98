//! Spacing and distance of single micro-images on frames of the exact-ray renderer.

use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::clarity::{blockiness, eog_of_scene};
use plenalign::imaging::depth::{DepthMap, DepthOptions, DepthState};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, prepare_frame};
use plenalign::imaging::pictures::{Pictures, Pose};
use plenalign::imaging::view::{Blend, Patches, View, ViewFrame};
use plenalign::optics::{ArrayKind, CameraDesign, DistanceTable, ExactView};
use plenalign::raw::RawImage;
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, Strip, TripleBoard, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;
const SIDE: usize = 440;

/// A camera at its joint solution under water, before boards side by side: one at 500 mm, one at 700 mm, and one at
/// 900 mm behind them.
struct Steps {
    design: CameraDesign,
    delta_v: f64,
    strips: Vec<Strip>,
    texture: Texture,
    seed: u64,
}

impl Steps {
    fn new(array: ArrayKind, texture: Texture, seed: u64) -> Self {
        let mut config = Config::default();
        config.mla.array = array;
        let design = config.design();
        let medium = Medium::Water { shell: design.shell, e: 0.0, decentre: [0.0; 2] };
        let strip = |distance: f64, range: [f64; 2]| {
            let map = TextureMap::generate(texture, texel_for(&design, medium, distance, PIXEL_MM), seed);
            Strip { board: Board::new(distance, Arc::new(map)), range }
        };
        let strips = vec![
            strip(500.0, [5.0, f64::INFINITY]),
            strip(700.0, [f64::NEG_INFINITY, -7.0]),
            strip(900.0, [f64::NEG_INFINITY, f64::INFINITY]),
        ];
        Self { design, delta_v: design.joint(0.0).delta_v, strips, texture, seed }
    }

    fn view(&self) -> ExactView {
        self.design.exact_in_water(self.delta_v, 0.0)
    }

    /// A raw frame and what a white one says.
    fn shot(&self) -> (RawImage, WhiteModel) {
        let medium = Medium::Water { shell: self.design.shell, e: 0.0, decentre: [0.0; 2] };
        let camera = CameraTruth::from_design(&self.design, self.delta_v, medium, PIXEL_MM, SIDE, SIDE);
        let rays = RenderOptions { rays: 12, seed: self.seed };
        let noise = Noise { read_noise_levels: 2.0, ..Noise::default() };
        let frame = |scene: &Scene, seed: u64| expose(&render(&camera, scene, rays), SIDE, SIDE, &noise, seed);
        let white = frame(&Scene::Diffuser, 2 * self.seed);
        let raw = frame(&Scene::TripleBoard(TripleBoard { strips: self.strips.clone() }), 2 * self.seed + 1);
        (raw, WhiteModel::new(&white).unwrap())
    }

    fn options(&self) -> FrameOptions {
        FrameOptions { white_at_this_setting: true, ..FrameOptions::new(self.design.mla.pitch / PIXEL_MM) }
    }

    fn map(&self) -> DepthMap {
        let ((raw, white), options) = (self.shot(), self.options());
        let prepared = prepare_frame(&raw, Some(&white), &options).unwrap();
        let options = DepthOptions::new(self.design.mla.mode, options.spacing.mla_pitch_px);
        let frame = ViewFrame::new(&raw, None, &prepared.grid, Some(&prepared.light)).unwrap();
        frame.depth_map(&options).unwrap()
    }

    /// What the chief ray of a sensor point (mm from the axis) sees: its distance, if all that a micro-image there sees
    /// is as far away.
    fn distance(&self, sensor: [f64; 2]) -> Option<f64> {
        let seen = |sensor: [f64; 2]| {
            self.strips.iter().find_map(|strip| {
                let at = ExactView { board_distance: strip.board.distance, ..self.view() };
                let [x, _] = at.chief_board_point(sensor)?;
                (strip.range[0]..strip.range[1]).contains(&x).then_some(strip.board.distance)
            })
        };
        let [left, here, right] = [-0.1, 0.0, 0.1].map(|dx| seen([sensor[0] + dx, sensor[1]]));
        here.filter(|_| left == here && right == here)
    }
}

fn on_sensor(px: [f64; 2]) -> [f64; 2] {
    px.map(|x| (x - (SIDE as f64 - 1.0) / 2.0) * PIXEL_MM)
}

#[test]
fn distances_in_water_are_right_to_three_per_cent() {
    for (array, texture, seed) in [
        (ArrayKind::Square, Texture::Guppy, 3),
        (ArrayKind::Hexagonal, Texture::Natural, 4),
        (ArrayKind::Square, Texture::Oscar, 5),
    ] {
        let steps = Steps::new(array, texture, seed);
        let map = steps.map();
        let view = steps.view();
        let table = DistanceTable::new(&view, steps.design.mla.mode, 1.2);
        let ratio = view.lens_to_mla / (view.lens_to_mla + view.b);
        let (mut errors, mut covered, mut measured) = (Vec::new(), 0, 0);
        for lens in &map.lenses {
            if lens.state == DepthState::Measured {
                measured += 1;
            }
            let sensor = on_sensor(lens.centre_px);
            let Some(truth) = steps.distance(sensor).filter(|_| lens.state == DepthState::Measured) else { continue };
            let field = sensor.map(|x| x * ratio);
            let far = |spacing_px: f64| table.distance(spacing_px * PIXEL_MM, field);
            let found = far(lens.spacing_px).unwrap_or(f64::INFINITY);
            errors.push((found / truth - 1.0).abs());
            let sigma = far(lens.spacing_px - lens.sigma_px).map_or(f64::INFINITY, |z| (z - found).abs());
            covered += usize::from((found - truth).abs() < 2.0 * sigma);
        }
        errors.sort_unstable_by(f64::total_cmp);
        let (median, nineteenth) = (errors[errors.len() / 2], errors[errors.len() * 19 / 20]);
        println!(
            "{array:?} {:?}: {measured} of {} measured; |z/z_true − 1| {:.2} % in the median, {:.2} % at 95 %; {:.0} % within 2σ",
            steps.texture,
            map.lenses.len(),
            100.0 * median,
            100.0 * nineteenth,
            100.0 * covered as f64 / errors.len() as f64
        );
        assert!(median < 0.03, "{median}");
        assert!(2 * measured > map.lenses.len(), "{measured} of {}", map.lenses.len());
        assert!(10 * covered > 8 * errors.len(), "{covered} of {}", errors.len());
    }
}

#[test]
fn everything_in_focus_shows_more_of_the_scene_than_any_one_patch_size() {
    for (array, texture, seed) in [(ArrayKind::Square, Texture::Guppy, 3), (ArrayKind::Hexagonal, Texture::Oscar, 4)] {
        let steps = Steps::new(array, texture, seed);
        let (raw, white) = steps.shot();
        let (view, mode) = (steps.view(), steps.design.mla.mode);
        let pose = Pose { view, pixel_mm: PIXEL_MM };
        let pictures = Pictures::new(&raw, Some(&white), &steps.options(), mode, Some(&pose)).unwrap();
        let figures = |view: &View, patches: Patches| {
            let of_scene = eog_of_scene(view, pictures.grid(), patches, &pictures.depth).unwrap();
            (of_scene.sum, blockiness(view, pictures.grid()).unwrap())
        };
        let all = figures(&pictures.all_in_focus().unwrap(), Patches::Own(&pictures.depth));
        println!("{array:?} {texture:?}: EOG {:.3e}, block artefacts {:.3} all in focus", all.0, all.1);
        for distance in [500.0, 900.0] {
            let spacing_px = ExactView { board_distance: distance, ..view }.paraxial_spacing() / PIXEL_MM;
            let one = figures(&pictures.fixed(spacing_px, Blend::Abutting).unwrap(), Patches::Fixed(spacing_px));
            println!("{array:?} {texture:?}: EOG {:.3e}, block artefacts {:.3} for {distance} mm", one.0, one.1);
            // 1 where patches do not show; either way from there they do.
            assert!(all.0 > one.0 && (all.1 - 1.0).abs() < (one.1 - 1.0).abs(), "{all:?} {one:?}");
        }
    }
}
