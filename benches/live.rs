//! How long a live measurement takes on frames of 1160² and of 12 megapixels, beside the full measurement and a plain
//! sum over the frame.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::config::{Config, Texture};
use plenalign::imaging::live::{LiveMeter, LiveOptions};
use plenalign::imaging::measurement::WhiteModel;
use plenalign::imaging::spacing::{SpacingFrame, SpacingOptions, measure_spacing};
use plenalign::raw::{RawImage, Samples};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;

/// A frame of the reference camera in focus, in air, and its white frame. Few rays: the time does not depend on them.
fn frames(width: usize, height: usize) -> (RawImage, RawImage) {
    let design = Config::default().design();
    let (medium, distance) = (Medium::Air, design.joint(0.0).equivalent_distance);
    let mut camera = CameraTruth::from_design(&design, design.joint(0.0).delta_v, medium, PIXEL_MM, width, height);
    camera.rotation = 0.3f64.to_radians();
    let rays = RenderOptions { rays: 4, seed: 1 };
    let map = Arc::new(TextureMap::generate(Texture::Natural, texel_for(&design, medium, distance, PIXEL_MM), 1));
    let noise = Noise::default();
    let white = expose(&render(&camera, &Scene::Diffuser, rays), width, height, &noise, 1);
    let raw = expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), width, height, &noise, 2);
    (raw, white)
}

fn live(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("live");
    group.sample_size(20);
    let pitch = 0.1 / PIXEL_MM;
    for (label, width, height) in [("1160x1160", 1160, 1160), ("4096x3072", 4096, 3072)] {
        let (raw, white) = frames(width, height);
        let model = WhiteModel::new(&white).expect("a white frame's grid");
        let vignetting = model.vignetting.render(&model.grid);
        let options = LiveOptions::new(pitch);
        let mut meter = LiveMeter::new(&model.grid, &model.vignetting, options).expect("a meter");
        let first = meter.acquire(&raw).expect("a spacing");
        println!("{label}: {:.5} ± {:.5} px", first.on_axis_px, first.sigma_px);
        group.bench_function(format!("measure {label}"), |b| b.iter(|| meter.measure(black_box(&raw))));
        if width < 2000 {
            let start = SpacingOptions { start_px: Some(first.on_axis_px), ..SpacingOptions::new(pitch) };
            group.bench_function(format!("full measurement, start and grid known {label}"), |b| {
                b.iter(|| {
                    let frame = SpacingFrame::new(black_box(&raw), None, &vignetting, &model.grid);
                    measure_spacing(&[frame.expect("a frame")], &start)
                });
            });
        }
        // The limit of the machine: a plain sum over the same frame.
        let Samples::U8(samples) = raw.samples() else { panic!("an 8-bit frame") };
        group.bench_function(format!("plain sum {label}"), |b| {
            b.iter(|| black_box(samples).iter().map(|&v| u64::from(v)).sum::<u64>());
        });
    }
    group.finish();
}

criterion_group!(benches, live);
criterion_main!(benches);
