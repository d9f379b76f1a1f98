//! How long frames of the reference preset take: 1160 × 1160 px, through the shell, in water.

use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::config::{Config, Texture};
use plenalign::sim::configured;
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use plenalign::sim::scene::{Board, Scene, TripleBoard, texel_for};
use plenalign::sim::texture::TextureMap;

fn frames(criterion: &mut Criterion) {
    let config = Config::default();
    let design = config.design();
    let pixel = config.pixel_pitch().millimetres();
    let camera = |medium, delta_v| {
        let camera = CameraTruth::from_design(&design, delta_v, medium, pixel, 1160, 1160);
        configured::camera(camera, &config.bench.simulation, 1)
    };
    let water = |e| Medium::Water { shell: design.shell, e, decentre: [0.0; 2] };
    let joint = design.joint(0.0);
    let texture = Arc::new(TextureMap::generate(Texture::Natural, texel_for(&design, water(0.0), 800.0, pixel), 1));
    let board = Scene::Board(Board::new(800.0, texture));
    let air_texel = texel_for(&design, Medium::Air, joint.equivalent_distance, pixel);
    let air_texture = Arc::new(TextureMap::generate(Texture::Natural, air_texel, 1));
    let in_water = camera(water(0.0), joint.delta_v);
    let in_air = camera(Medium::Air, joint.delta_v);
    let triple = Scene::TripleBoard(TripleBoard::new(&[159.2, 167.2, 175.2], in_air.half_field_slope(), &air_texture));
    let full = Renderer::new(RenderOptions { rays: 64, seed: 1 });
    let preview = Renderer::new(RenderOptions { rays: 4, seed: 1 });

    let mut group = criterion.benchmark_group("frame 1160x1160");
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    group.bench_function("water, 64 rays", |b| b.iter(|| full.render(black_box(&in_water), &board)));
    group.bench_function("white, 64 rays", |b| b.iter(|| full.render(black_box(&in_water), &Scene::Diffuser)));
    group.bench_function("triple board in air, 64 rays", |b| b.iter(|| full.render(black_box(&in_air), &triple)));
    let mut step = 0;
    group.bench_function("preview, 4 rays, moving, exposed", |b| {
        b.iter(|| {
            step = (step + 1) % 100;
            let share = f64::from(step) / 100.0;
            let camera = camera(water(30.0 * share), joint.delta_v - 0.4 * share);
            let irradiance = preview.render(black_box(&camera), &board);
            expose(&irradiance, camera.width, camera.height, &Noise::default(), step as u64)
        });
    });
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
