//! Time to find and to follow the grid, and to take and draw the vignetting profile.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::imaging::grid::{GridOptions, find_grid, refine_grid};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::raw::{self, RawImage};

/// A referee frame continued to a larger one, by whole lattice steps so that the lattice goes on: 59 of the least
/// rotated frame's micro-images are 1740 px, 30 are 885 px to within a quarter of a pixel.
fn frame(name: &str, width: usize, height: usize) -> RawImage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"));
    let tile = raw::read(&path).expect("a referee frame");
    let values = tile.to_view();
    let period = 885;
    let all = (0..width * height).map(|k| values[(k / width % period) * 900 + k % width % period]).collect();
    RawImage::from_u8(width, height, all)
}

fn grid(c: &mut Criterion) {
    let mut group = c.benchmark_group("grid");
    group.sample_size(10);
    for (label, width, height) in [("1160x1160", 1160, 1160), ("4096x3072", 4096, 3072)] {
        let white = frame("triple_air_white", width, height);
        let textured = frame("triple_air", width, height);
        let options = GridOptions { degree_max: 1, ..GridOptions::default() };
        let known = find_grid(&white, &options).expect("a white frame's grid");
        group.bench_function(format!("find white {label}"), |b| {
            b.iter(|| find_grid(black_box(&white), &options).expect("a grid"));
        });
        group.bench_function(format!("refine textured {label}"), |b| {
            b.iter(|| refine_grid(black_box(&textured), &known).expect("a grid"));
        });
        if width < 2000 {
            let profile = Vignetting::from_white(&white, &known).expect("a profile");
            group.bench_function(format!("vignetting from white {label}"), |b| {
                b.iter(|| Vignetting::from_white(black_box(&white), &known).expect("a profile"));
            });
            group.bench_function(format!("vignetting drawn {label}"), |b| b.iter(|| profile.render(black_box(&known))));
        }
        // The limit of the machine: a plain sum over the same frame.
        let values = white.to_view();
        group.bench_function(format!("plain sum {label}"), |b| {
            b.iter(|| black_box(&values).iter().map(|&v| u64::from(v)).sum::<u64>());
        });
    }
    group.finish();
}

criterion_group!(benches, grid);
criterion_main!(benches);
