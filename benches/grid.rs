//! Time to find, to follow and to check the grid, and to take and draw the vignetting profile.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::config::{Config, Texture};
use plenalign::imaging::grid::{GridOptions, check_grid, find_grid, refine_grid};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::optics::ArrayKind;
use plenalign::raw::RawImage;
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;

/// A white frame and one of a natural texture in focus, of the preset's camera at its joint solution in air.
fn frames(array: ArrayKind, width: usize, height: usize) -> [RawImage; 2] {
    let mut config = Config::default();
    config.mla.array = array;
    let design = config.design();
    let joint = design.joint(0.0);
    let mut camera = CameraTruth::from_design(&design, joint.delta_v, Medium::Air, PIXEL_MM, width, height);
    camera.rotation = 0.6f64.to_radians();
    camera.offset = [3.3, -7.7];
    let distance = joint.equivalent_distance;
    let texel = texel_for(&design, Medium::Air, distance, PIXEL_MM);
    let board = Board::new(distance, Arc::new(TextureMap::generate(Texture::Natural, texel, 3)));
    [Scene::Diffuser, Scene::Board(board)].map(|scene| {
        let irradiance = render(&camera, &scene, RenderOptions { rays: 8, seed: 3 });
        expose(&irradiance, width, height, &Noise::default(), 5)
    })
}

fn grid(c: &mut Criterion) {
    let mut group = c.benchmark_group("grid");
    group.sample_size(10);
    for (kind, array) in [("square", ArrayKind::Square), ("hexagonal", ArrayKind::Hexagonal)] {
        for (width, height) in [(1160, 1160), (4096, 3072)] {
            let [white, textured] = frames(array, width, height);
            let options = GridOptions::default();
            let known = find_grid(&white, &options).expect("a white frame's grid");
            let profile = Vignetting::from_white(&white, &known).expect("a profile");
            for (what, frame) in [("white", &white), ("textured", &textured)] {
                let label = format!("{what} {kind} {width}x{height}");
                group.bench_function(format!("find {label}"), |b| {
                    b.iter(|| find_grid(black_box(frame), &options).expect("a grid"));
                });
                group.bench_function(format!("refine {label}"), |b| {
                    b.iter(|| refine_grid(black_box(frame), &known, None).expect("a grid"));
                });
                group.bench_function(format!("check {label}"), |b| {
                    b.iter(|| check_grid(black_box(frame), &known, Some(&profile)).expect("a check"));
                });
            }
            if array == ArrayKind::Square {
                let label = format!("{width}x{height}");
                group.bench_function(format!("vignetting from white {label}"), |b| {
                    b.iter(|| Vignetting::from_white(black_box(&white), &known).expect("a profile"));
                });
                group.bench_function(format!("vignetting drawn {label}"), |b| {
                    b.iter(|| profile.render(black_box(&known)));
                });
                // The limit of the machine: a plain sum over the same frame.
                let values = white.to_view();
                group.bench_function(format!("plain sum {label}"), |b| {
                    b.iter(|| black_box(&values).iter().map(|&v| u64::from(v)).sum::<u64>());
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, grid);
criterion_main!(benches);
