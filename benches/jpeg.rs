//! How long a picture for viewers takes to encode, by libjpeg-turbo and without it, of 1160² and of 12 megapixels; and what
//! the larger one costs on a smaller screen, beside a part of it that fills that screen and one of 2 megapixels.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use plenalign::jpeg::{Encoder, TurboJpeg};
use plenalign::raw::{RawImage, Window};

/// Micro-images with noise over them: what a plenoptic camera's pictures cost to encode.
fn samples(width: usize, height: usize) -> Vec<u8> {
    let mut noise = 1u32;
    let pixel = |index: usize| {
        let (x, y) = ((index % width) as f64, (index / width) as f64);
        let disc = if (x % 29.0 - 14.5).hypot(y % 29.0 - 14.5) < 13.0 { 150.0 } else { 12.0 };
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (disc + 60.0 * (x / 3.7).sin() * (y / 5.1).cos() + f64::from(noise >> 24) / 32.0 - 4.0).clamp(0.0, 255.0) as u8
    };
    (0..width * height).map(pixel).collect()
}

fn jpeg(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("jpeg");
    group.sample_size(20);
    let encoders: Vec<Encoder> = match TurboJpeg::load() {
        Ok(turbo) => vec![Encoder::Turbo(turbo), Encoder::Rust],
        Err(error) => {
            println!("{error}");
            vec![Encoder::Rust]
        }
    };
    for (label, width, height) in [("1160x1160", 1160, 1160), ("4096x3072", 4096, 3072)] {
        let raw = samples(width, height);
        // The limit of the machine: a plain sum over the same frame.
        group.bench_function(format!("plain sum {label}"), |b| {
            b.iter(|| black_box(&raw).iter().map(|&v| u64::from(v)).sum::<u64>());
        });
        for encoder in &encoders {
            group.bench_function(format!("{} {label}", encoder.name()), |b| {
                b.iter(|| encoder.grey(black_box(&raw), width, height, 80).expect("a picture"));
            });
        }
    }
    let frame = RawImage::from_u8(4096, 3072, samples(4096, 3072));
    let (encoder, size) = (Encoder::here(), [1440, 1080]);
    let middle = |width, height| Window { x: (4096 - width) / 2, y: (3072 - height) / 2, width, height };
    for (label, window) in [
        ("4096x3072 at 1440x1080", frame.window()),
        ("1632x1224 at 1440x1080", middle(1632, 1224)),
        ("1440x1080 of 4096x3072", middle(1440, 1080)),
    ] {
        let part = |frame: &RawImage| frame.to_view_of(window, size, false).expect("a part of the frame");
        group.bench_function(format!("part {label}"), |b| b.iter(|| part(black_box(&frame))));
        group.bench_function(format!("part {label}, encoded"), |b| {
            b.iter(|| encoder.grey(&part(black_box(&frame)), size[0], size[1], 80).expect("a picture"));
        });
    }
    group.finish();
}

criterion_group!(benches, jpeg);
criterion_main!(benches);
