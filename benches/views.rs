//! How long central view and depth take on frames of 1160² and of 12 megapixels, grid and vignetting known from the frame
//! before, beside a plain sum over the same frame.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::config::{Config, Texture};
use plenalign::imaging::clarity::eog;
use plenalign::imaging::measurement::{FrameOptions, WhiteModel};
use plenalign::imaging::pictures::{LivePictures, Pose};
use plenalign::raw::{RawImage, Samples};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, Strip, TripleBoard, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;

/// A frame of the reference camera at its joint solution in water, before boards at 500, 700 and 900 mm, its white frame
/// and where it was. Few rays: the time does not depend on them.
fn frames(width: usize, height: usize) -> (RawImage, RawImage, Pose) {
    let design = Config::default().design();
    let medium = Medium::Water { shell: design.shell, e: 0.0, decentre: [0.0; 2] };
    let delta_v = design.joint(0.0).delta_v;
    let mut camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, width, height);
    camera.rotation = 0.3f64.to_radians();
    let rays = RenderOptions { rays: 4, seed: 1 };
    let strip = |distance: f64, range: [f64; 2]| {
        let map = TextureMap::generate(Texture::Guppy, texel_for(&design, medium, distance, PIXEL_MM), 1);
        Strip { board: Board::new(distance, Arc::new(map)), range }
    };
    let strips = vec![
        strip(500.0, [15.0, f64::INFINITY]),
        strip(700.0, [f64::NEG_INFINITY, -20.0]),
        strip(900.0, [f64::NEG_INFINITY, f64::INFINITY]),
    ];
    let frame = |scene: &Scene, seed| expose(&render(&camera, scene, rays), width, height, &Noise::default(), seed);
    let white = frame(&Scene::Diffuser, 1);
    let raw = frame(&Scene::TripleBoard(TripleBoard { strips }), 2);
    (raw, white, Pose { view: design.exact_in_water(delta_v, 0.0), pixel_mm: PIXEL_MM })
}

fn views(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("views");
    group.sample_size(20);
    let mla = Config::default().design().mla;
    for (label, width, height) in [("1160x1160", 1160, 1160), ("4096x3072", 4096, 3072)] {
        let (raw, white, pose) = frames(width, height);
        let model = WhiteModel::new(&white).expect("a white frame's grid");
        let options = FrameOptions::new(mla.pitch / PIXEL_MM);
        let mut live = LivePictures::new(Some(model), options, mla.mode);
        let first = live.next(&raw, Some(&pose)).expect("a frame");
        let figures = first.figures(mla.pitch / PIXEL_MM);
        println!("{label}: {} micro-images, {} measured", figures.micro_images, figures.measured);
        group.bench_function(format!("central view and depth {label}"), |b| {
            b.iter(|| {
                let pictures = live.next(black_box(&raw), Some(&pose)).expect("a frame");
                eog(&pictures.view([0.0; 2]).expect("a view"))
            });
        });
        group.bench_function(format!("all in focus {label}"), |b| b.iter(|| first.all_in_focus().expect("a view")));
        let view = first.view([0.0; 2]).expect("a view");
        group.bench_function(format!("coloured depth {label}"), |b| b.iter(|| first.painted_depth(view.extent())));
        // The limit of the machine: a plain sum over the same frame.
        let Samples::U8(samples) = raw.samples() else { panic!("an 8-bit frame") };
        group.bench_function(format!("plain sum {label}"), |b| {
            b.iter(|| black_box(samples).iter().map(|&v| u64::from(v)).sum::<u64>());
        });
    }
    group.finish();
}

criterion_group!(benches, views);
criterion_main!(benches);
