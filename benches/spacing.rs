//! How long a frame takes: preparing it, measuring it from a known start, and searching.

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, prepare_frame};
use plenalign::imaging::spacing::{SpacingFrame, SpacingOptions, measure_spacing};
use plenalign::raw::{self, Samples};

fn spacing(criterion: &mut Criterion) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/referee");
    let (Ok(white), Ok(frame)) =
        (raw::read(&data.join("air_square_white.png")), raw::read(&data.join("air_square.png")))
    else {
        panic!("the referee frames are missing from tests/data/referee")
    };
    let Ok(white) = WhiteModel::new(&white) else { panic!("the white frame has no grid") };
    let options = FrameOptions::new(0.1 / 0.00345);
    let Ok(prepared) = prepare_frame(&frame, Some(&white), &options) else { panic!("the frame cannot be prepared") };
    let map = white.vignetting.render(&prepared.grid);
    let frames = [prepared.frame];
    let mut group = criterion.benchmark_group("spacing 900x900");
    group.sample_size(20);
    group.bench_function("prepare, grid known", |b| {
        b.iter(|| SpacingFrame::new(black_box(&frame), None, &map, &prepared.grid));
    });
    let known = SpacingOptions { start_px: Some(19.9), ..options.spacing };
    group.bench_function("measure, start known", |b| b.iter(|| measure_spacing(black_box(&frames), &known)));
    group.bench_function("measure, search", |b| b.iter(|| measure_spacing(black_box(&frames), &options.spacing)));
    // The limit of the machine: a plain sum over the same frame.
    let Samples::U8(samples) = frame.samples() else { panic!("an 8-bit frame") };
    group.bench_function("plain sum 900x900", |b| {
        b.iter(|| black_box(samples).iter().map(|&v| u64::from(v)).sum::<u64>());
    });
    group.finish();
}

criterion_group!(benches, spacing);
criterion_main!(benches);
