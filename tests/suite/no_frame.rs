//! Pictures that are no raw plenoptic frames: none of them is given a spacing.

use plenalign::imaging::measurement::{FrameOptions, WhiteModel, measure_frame};
use plenalign::raw::RawImage;

use super::rendered::{Rendered, random};

const SIDE: usize = 590;
const PITCH: f64 = 29.5;

/// A picture of soft blobs and hard-edged boxes, 0 to 1.
fn scene(seed: u64) -> impl Fn(f64, f64) -> f64 {
    let mut state = seed;
    let mut any = |least: f64, most: f64| least + (most - least) * random(&mut state);
    let side = SIDE as f64;
    let boxes: Vec<[f64; 5]> = (0..70)
        .map(|_| [any(-60.0, side), any(-60.0, side), any(5.0, 150.0), any(5.0, 150.0), any(0.1, 0.9)])
        .collect();
    let blobs: Vec<[f64; 4]> =
        (0..150).map(|_| [any(0.0, side), any(0.0, side), any(3.0, 60.0), any(-0.2, 0.2)]).collect();
    move |x, y| {
        let on = |b: &&[f64; 5]| x > b[0] && x < b[0] + b[2] && y > b[1] && y < b[1] + b[3];
        let base = boxes.iter().rev().find(on).map_or(0.2, |b| b[4]);
        let soft: f64 =
            blobs.iter().map(|b| b[3] * (-((x - b[0]).powi(2) + (y - b[1]).powi(2)) / (2.0 * b[2] * b[2])).exp()).sum();
        (base + soft).clamp(0.02, 1.0)
    }
}

fn picture(level: impl Fn(f64, f64) -> f64) -> RawImage {
    let mut state = 11;
    let values = (0..SIDE * SIDE)
        .map(|k| {
            let noise = 6.0 * (random(&mut state) - 0.5);
            (220.0 * level((k % SIDE) as f64, (k / SIDE) as f64) + 10.0 + noise).clamp(0.0, 255.0) as u8
        })
        .collect();
    RawImage::from_u8(SIDE, SIDE, values)
}

/// Distance from the centre of the cell that a place is in, pitches, in x and y of a lattice turned by an angle.
fn in_cell(x: f64, y: f64, degrees: f64) -> [f64; 2] {
    let (sine, cosine) = degrees.to_radians().sin_cos();
    let turned = [(x * cosine + y * sine) / PITCH, (y * cosine - x * sine) / PITCH];
    turned.map(|u| u - u.floor() - 0.5)
}

/// The middle of the cell that a place is in, px.
fn cell_middle(x: f64, y: f64) -> [f64; 2] {
    [x, y].map(|u| PITCH * ((u / PITCH).floor() + 0.5))
}

#[test]
fn pictures_that_are_no_plenoptic_frames_get_no_spacing() {
    let photograph = scene(3);
    let soft = |x: f64, edge: f64| (1.0 / (1.0 + ((x - edge) * PITCH).exp())).clamp(0.0, 1.0);
    let pictures = [
        ("a photograph", picture(&photograph)),
        ("noise", {
            let mut state = 5;
            RawImage::from_u8(SIDE, SIDE, (0..SIDE * SIDE).map(|_| (255.0 * random(&mut state)) as u8).collect())
        }),
        (
            "a screen's pixels",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 0.0);
                let [a, b] = cell_middle(x, y);
                photograph(a, b) * soft(u.abs(), 0.4) * soft(v.abs(), 0.4)
            }),
        ),
        (
            "a screen's three colours",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 0.0);
                let [a, b] = cell_middle(x, y);
                let third = ((u + 0.5) * 3.0).floor();
                let w = (u + 0.5) * 3.0 - third - 0.5;
                photograph(a + 40.0 * third, b) * soft(w.abs() / 3.0, 0.12) * soft(v.abs(), 0.4)
            }),
        ),
        (
            "a halftone",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 0.0);
                soft(-u.hypot(v), -0.6 * photograph(x, y).sqrt())
            }),
        ),
        (
            "a halftone at 45°",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 45.0);
                0.1 + 0.9 * soft(u.hypot(v), 0.6 * photograph(x, y).sqrt())
            }),
        ),
        (
            "a chequered board",
            picture(|x, y| {
                let [a, b] = [x, y].map(|u| (u / PITCH).floor() as i64);
                if (a + b) % 2 == 0 { 0.9 } else { 0.1 }
            }),
        ),
        (
            "a board of dots",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 3.0);
                if u.hypot(v) < 0.25 { 0.1 } else { 0.9 }
            }),
        ),
        (
            "a photograph through a mesh",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 2.0);
                photograph(x, y) * soft(u.abs(), 0.42) * soft(v.abs(), 0.42)
            }),
        ),
        ("stripes", picture(|x, _| 0.5 + 0.4 * (x * 0.213).sin())),
        (
            "a woven cloth",
            picture(|x, y| {
                let [u, v] = in_cell(x, y, 1.0);
                0.3 + 0.3 * (std::f64::consts::TAU * u).cos() * (std::f64::consts::TAU * v).cos()
                    + 0.3 * photograph(x, y)
            }),
        ),
    ];
    let white = WhiteModel::new(&Rendered { size: [SIDE, SIDE], ..Rendered::default() }.white()).unwrap();
    let options = FrameOptions::new(PITCH / 1.015);
    let mut bad = Vec::new();
    for (name, image) in &pictures {
        for (how, white) in [("alone", None), ("with a white frame", Some(&white))] {
            match measure_frame(image, white, &options) {
                Err(refusal) => println!("{name}, {how}: {refusal}"),
                Ok(m) => bad.push(format!(
                    "{name}, {how}: spacing {:.3} ± {:.3} px, pitch {:.2} px",
                    m.spacing.on_axis_px,
                    m.spacing.sigma_px,
                    m.grid.pitch_px()
                )),
            }
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}
