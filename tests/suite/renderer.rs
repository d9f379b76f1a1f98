//! The renderer against the referee frames, the paraxial model and the documented figures of exact rays.

// Helpers of tests are tests too.
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

use plenalign::config::Config;
use plenalign::optics::{ArrayKind, CameraDesign, Shell};
use plenalign::raw;
use plenalign::sim::renderer::{CameraTruth, Medium, Microlens, RenderOptions, Tracer, render};
use plenalign::sim::scene::{Board, Scene, TripleBoard};
use plenalign::sim::texture::TextureMap;
use serde_json::Value;

const PIXEL: f64 = 0.00345;

fn design() -> CameraDesign {
    Config::default().design()
}

fn plain(distance: f64) -> Board {
    Board::new(distance, Arc::new(TextureMap::from_values(&[1.0], 1.0)))
}

fn water(e: f64) -> Medium {
    Medium::Water { shell: design().shell, e, decentre: [0.0; 2] }
}

fn referee(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/referee").join(name)
}

/// Every referee frame's name, truth, and the camera that the truth describes.
fn referees() -> Vec<(String, Value, CameraTruth)> {
    let text = std::fs::read_to_string(referee("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&text).unwrap();
    let number = |frame: &Value, key: &str| frame[key].as_f64().unwrap();
    let frames = truth["frames"].as_object().unwrap();
    assert_eq!(frames.len(), 5);
    let camera = |frame: &Value| {
        let medium = frame["e_mm"].as_f64().map_or(Medium::Air, water);
        let (d, b) = (number(frame, "lens_to_mla_mm"), number(frame, "mla_to_sensor_mm"));
        let pixel = number(frame, "pixel_um") / 1000.0;
        let centre = |k: usize| frame["a_micro_image_centre_px"][k].as_f64().unwrap();
        let offset = [0, 1].map(|k| (centre(k) - 449.5) * d / (d + b));
        let mut camera = CameraTruth::from_design(&design(), number(frame, "delta_v_mm"), medium, pixel, 900, 900);
        camera.array = if frame["array"] == "hexagonal" { ArrayKind::Hexagonal } else { ArrayKind::Square };
        camera.lens_to_mla = d;
        camera.aperture = d * camera.mla_pitch / b;
        camera.rotation = number(frame, "rotation_deg").to_radians();
        camera.offset = offset;
        camera
    };
    frames.iter().map(|(name, frame)| (name.clone(), frame.clone(), camera(frame))).collect()
}

#[test]
fn micro_images_lie_where_the_referee_has_them() {
    for (name, frame, camera) in referees() {
        let tracer = Tracer::new(&camera);
        let given = [0, 1].map(|k| frame["a_micro_image_centre_px"][k].as_f64().unwrap());
        let lens = tracer.microlens_at(given);
        let centre = tracer.micro_image_centre(lens);
        assert!((centre[0] - given[0]).hypot(centre[1] - given[1]) < 1e-9, "{name}: {centre:?}");
        let next = tracer.micro_image_centre(tracer.step(lens, 1, 0));
        let step = [next[0] - centre[0], next[1] - centre[1]];
        let pitch = frame["micro_image_pitch_px"].as_f64().unwrap();
        assert!((step[0].hypot(step[1]) - pitch).abs() < 1e-9, "{name}: {step:?}");
        let rotation = step[1].atan2(step[0]).to_degrees();
        assert!((rotation - frame["rotation_deg"].as_f64().unwrap()).abs() < 1e-9, "{name}: {rotation}");
    }
}

#[test]
fn white_frames_agree_with_the_referee_to_its_noise() {
    for (name, _, camera) in referees() {
        let irradiance = render(&camera, &Scene::Diffuser, RenderOptions { rays: 64, seed: 2 });
        let theirs = raw::read(&referee(&format!("{name}_white.png"))).unwrap().to_f32();
        let tracer = Tracer::new(&camera);
        // By distance from the micro-image's centre: pixels, their sum, ours, and their squares.
        let mut rings = [[0.0f64; 4]; 18];
        let mut shift = [[0.0f64; 2]; 2];
        for (k, (&t, &i)) in theirs.iter().zip(&irradiance).enumerate() {
            let (x, y) = (k % 900, k / 900);
            let (t, i) = (f64::from(t), f64::from(i));
            let position = [x as f64, y as f64];
            let centre = tracer.micro_image_centre(tracer.microlens_at(position));
            let radius = (position[0] - centre[0]).hypot(position[1] - centre[1]);
            if let Some(ring) = rings.get_mut(radius as usize) {
                for (sum, value) in ring.iter_mut().zip([1.0, t, i, t * t]) {
                    *sum += value;
                }
            }
            if x > 0 && y > 0 && x < 899 && y < 899 && radius < 13.0 {
                let slope = |step: usize| f64::from(irradiance[k + step] - irradiance[k - step]) / 2.0;
                for (sums, slope) in shift.iter_mut().zip([slope(1), slope(900)]) {
                    sums[0] += slope * (t / 216.6 - i);
                    sums[1] += slope * slope;
                }
            }
        }
        let mean = |ring: &[f64; 4], k: usize| ring[k] / ring[0];
        let white = mean(&rings[2], 1) / mean(&rings[2], 2);
        let noise = (mean(&rings[5], 3) - mean(&rings[5], 1).powi(2)).sqrt();
        let worst = |rings: &[[f64; 4]]| {
            rings.iter().map(|ring| (mean(ring, 1) - white * mean(ring, 2)).abs()).fold(0.0, f64::max)
        };
        // From 14 px on pixels straddle the cells' borders, where the referee gives a whole pixel to one microlens and
        // this renderer each ray to its own.
        let worst = [worst(&rings[..14]), worst(&rings[14..])];
        let shift = shift.map(|sums| sums[0] / sums[1]);
        println!("{name}: white {white:.2}, noise {noise:.2}, worst rings {worst:.2?} levels, shift {shift:.4?} px");
        assert!((noise - 2.0).abs() < 0.1, "{name}: {noise}");
        assert!(worst[0] < 0.6 && worst[1] < 2.0, "{name}: {worst:?} levels");
        assert!(shift.iter().all(|shift| shift.abs() < 0.01), "{name}: {shift:?}");
    }
}

/// Two neighbouring microlenses along x (or y) astride a place on the array, and the board's point seen between them.
fn spacing_at(camera: &CameraTruth, board: &Board, place: [f64; 2], axis: usize) -> f64 {
    let tracer = Tracer::new(camera);
    let between = Microlens { centre: place };
    let point = tracer.board_point(board, between, tracer.micro_image_centre(between), [0.0; 2]).unwrap();
    let lens = |sign: f64| {
        let mut centre = place;
        centre[axis] += sign * camera.mla_pitch / 2.0;
        Microlens { centre }
    };
    tracer.spacing(board, [lens(-1.0), lens(1.0)], point).unwrap()
}

#[test]
fn spacing_in_air_is_the_paraxial_one() {
    for (distance, delta_v) in [(800.0, 0.0), (167.17, 2.205), (167.17, 0.0), (300.0, 0.7)] {
        let camera = CameraTruth::from_design(&design(), delta_v, Medium::Air, PIXEL, 1160, 1160);
        let expected = design().spacing_at(distance, delta_v) / PIXEL;
        for place in [[0.0, 0.0], [1.7, -0.4]] {
            for axis in [0, 1] {
                let found = spacing_at(&camera, &plain(distance), place, axis);
                assert!((found - expected).abs() < 1e-6, "{distance}, {delta_v}: {found} for {expected}");
            }
        }
    }
}

#[test]
fn the_shell_bends_the_field_as_documented() {
    let design = design();
    let target = design.mla.target_spacing() / PIXEL;
    // e; tangential and sagittal excess over the paraxial spacing at 2 mm off axis, and their last digit, px.
    for (e, rise, digit) in [(0.0, [0.097, 0.097], 0.001), (30.0, [0.15, 0.11], 0.005)] {
        let camera = CameraTruth::from_design(&design, design.clarity(e).delta_v, water(e), PIXEL, 1160, 1160);
        let on_axis = spacing_at(&camera, &plain(800.0), [0.0; 2], 0);
        let off = 2.0 * camera.lens_to_mla / (camera.lens_to_mla + camera.mla_to_sensor);
        let found = [0, 1].map(|axis| spacing_at(&camera, &plain(800.0), [off, 0.0], axis) - target);
        println!("e = {e}: on axis {:+.4} px, at 2 mm {found:.4?} px", on_axis - target);
        if e == 0.0 {
            assert!((on_axis - target - 0.004).abs() < 0.0006, "{on_axis} for {target}");
        }
        for (found, rise) in found.iter().zip(rise) {
            assert!((found - rise).abs() < digit, "{found} for {rise} at e = {e}");
        }
    }
}

#[test]
fn a_shell_and_water_of_air_are_not_there() {
    let mut camera = CameraTruth::from_design(&design(), 2.2, Medium::Air, PIXEL, 1160, 1160);
    camera.mla_tilt = [0.002, 0.001];
    camera.lens_tilt = [0.003, -0.004];
    let shell = Shell { n_shell: 1.0, n_water: 1.0, ..design().shell };
    let nothing = CameraTruth { medium: Medium::Water { shell, e: 12.0, decentre: [2.0, -1.0] }, ..camera };
    let (near, far) = (plain(800.0 + 59.0 + 12.0), plain(800.0));
    for position in [[579.5, 579.5], [100.0, 900.0], [1100.0, 50.0]] {
        let tracer = Tracer::new(&camera);
        let lens = tracer.microlens_at(position);
        let one = tracer.board_point(&near, lens, position, [0.01, 0.0]).unwrap();
        let other = Tracer::new(&nothing).board_point(&far, lens, position, [0.01, 0.0]).unwrap();
        assert!((one[0] - other[0]).hypot(one[1] - other[1]) < 1e-9, "{one:?} {other:?}");
    }
}

#[test]
fn tilts_change_the_spacing_across_the_field() {
    let upright = CameraTruth::from_design(&design(), 2.205, Medium::Air, PIXEL, 1160, 1160);
    let mla = CameraTruth { mla_tilt: [0.001, 0.0], ..upright };
    let change = |camera: &CameraTruth, board: &Board, x: f64| {
        spacing_at(camera, board, [x, 0.0], 1) - spacing_at(&upright, &plain(167.17), [x, 0.0], 1)
    };
    // d grows along +x, and dl/dΔv is −8.7 px/mm. What counts is how much nearer the array's plane is to the image
    // point, which lies v/d further from the axis than the microlens.
    let right = change(&mla, &plain(167.17), 1.5);
    let expected = -8.7 * 0.001 * 1.5 * 22.718 / 21.653;
    assert!((right / expected - 1.0).abs() < 0.01, "{right} for {expected}");
    assert!((change(&mla, &plain(167.17), -1.5) + right).abs() < 0.05 * right.abs());
    // One degree of the board acts like 2.4 mrad of the MLA; the lens turns the picture round, hence the sign.
    let board = Board { tilt: [1f64.to_radians().tan(), 0.0], ..plain(167.17) };
    let by_board = change(&upright, &board, 1.5) - change(&upright, &board, -1.5);
    let by_mla = 2.4 * 2.0 * right;
    assert!((by_board / by_mla + 1.0).abs() < 0.06, "{by_board} and {by_mla}");
}

/// Own and neighbours' light at a distance from a micro-image's centre, of an array without baffles.
#[test]
fn pupils_fill_and_neighbours_shine_in_as_documented() {
    let figures = [(9.0, 1.0, 0.0), (11.0, 0.9, 0.04), (12.0, 0.78, 0.12), (13.0, 0.66, 0.22), (14.7, 0.44, 0.43)];
    for (distance, own, neighbour) in figures {
        // A hundredth of a pixel, because the figures are for places rather than areas.
        let mut camera = CameraTruth::from_design(&design(), 0.0, Medium::Air, PIXEL / 100.0, 61, 1);
        let stretch = (camera.lens_to_mla + camera.mla_to_sensor) / camera.lens_to_mla;
        camera.offset = [-100.0 * distance / stretch, 0.0];
        let options = RenderOptions { rays: 1024, seed: 1 };
        let baffled = render(&camera, &Scene::Diffuser, options)[30];
        let open = render(&CameraTruth { baffled: false, ..camera }, &Scene::Diffuser, options)[30];
        println!("{distance} px: own {baffled:.3}, neighbours {:.3}", open - baffled);
        assert!((f64::from(baffled) - own).abs() < 0.011, "{distance} px: own {baffled}");
        assert!((f64::from(open - baffled) - neighbour).abs() < 0.011, "{distance} px: {open} in all");
    }
}

/// A rendered edge lies where single rays say, in each of two neighbouring micro-images.
#[test]
fn an_edge_is_rendered_where_rays_put_it() {
    let design = design();
    let side = 256;
    let edge: Vec<f32> = (0..side * side).map(|k| if k % side < side / 2 { 1.0 } else { 0.0 }).collect();
    let texture = Arc::new(TextureMap::from_values(&edge, 1.0));
    let mut camera = CameraTruth::from_design(&design, 2.205, water(0.0), PIXEL, 61, 17);
    // Two microlenses side by side, and the edge at the middle of the field.
    camera.offset = [camera.mla_pitch / 2.0 / PIXEL, 0.0];
    let board = Board { texture_origin: [128.0, 0.0], ..Board::new(800.0, texture) };
    let options = RenderOptions { rays: 256, seed: 5 };
    let picture = render(&camera, &Scene::Board(board.clone()), options);
    let white = render(&camera, &Scene::Diffuser, options);
    let profile: Vec<f64> = (0..61)
        .map(|x| {
            let sum = |frame: &[f32]| (0..17).map(|y| f64::from(frame[y * 61 + x])).sum::<f64>();
            sum(&picture) / sum(&white).max(1e-9)
        })
        .collect();
    let tracer = Tracer::new(&camera);
    for start in [3usize, 33] {
        // Texture is white at negative x of the board, which the lens puts to the right.
        let cross = (start..start + 24).find(|&x| profile[x] < 0.5 && profile[x + 1] >= 0.5).unwrap();
        let found = cross as f64 + (0.5 - profile[cross]) / (profile[cross + 1] - profile[cross]);
        let lens = tracer.microlens_at([start as f64 + 12.0, 8.0]);
        let expected = tracer.image_point(&board, lens, [0.0, 0.0]).unwrap()[0];
        println!("edge at {found:.4} px, rays say {expected:.4} px");
        assert!((found - expected).abs() < 0.02, "{found} for {expected}");
    }
}

#[test]
fn a_frame_is_the_same_on_any_number_of_threads() {
    let texture = Arc::new(TextureMap::from_values(&[0.1, 0.9, 0.4, 0.7], 0.5));
    let mut camera = CameraTruth::from_design(&design(), 2.2, Medium::Air, PIXEL, 200, 120);
    camera.rotation = 0.02;
    let scene = Scene::TripleBoard(TripleBoard::new(&[175.0, 159.0, 167.0], camera.half_field_slope(), &texture));
    let options = RenderOptions { rays: 16, seed: 11 };
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&camera, &scene, options))
    };
    let frame = on(1);
    assert_eq!(frame, on(3));
    assert_ne!(frame, render(&camera, &scene, RenderOptions { seed: 12, ..options }));
    assert!(render(&camera, &Scene::Dark, options).iter().all(|&value| value == 0.0));
}

#[test]
fn strips_share_the_field_in_the_order_given() {
    let texture = Arc::new(TextureMap::from_values(&[1.0], 1.0));
    let camera = CameraTruth::from_design(&design(), 2.2, Medium::Air, PIXEL, 900, 30);
    let mut triple = TripleBoard::new(&[175.0, 159.0, 167.0], camera.half_field_slope(), &texture);
    assert_eq!(triple.strips.iter().map(|s| s.board.distance).collect::<Vec<_>>(), [159.0, 167.0, 175.0]);
    let options = RenderOptions { rays: 4, seed: 1 };
    // With one strip taken away at a time, the third of the frame where it was goes dark.
    for (strip, third) in [(0, 1), (1, 2), (2, 0)] {
        let kept = triple.strips.remove(strip);
        let frame = render(&camera, &Scene::TripleBoard(triple.clone()), options);
        triple.strips.insert(strip, kept);
        let light = [0, 1, 2].map(|k| {
            let columns = k * 300 + 40..k * 300 + 260;
            frame.iter().enumerate().filter(|(i, _)| columns.contains(&(i % 900))).map(|(_, &v)| v).sum::<f32>()
        });
        for (k, light) in light.iter().enumerate() {
            assert_eq!(*light < 1.0, k == third, "strip {strip}: {light} in third {k}");
        }
    }
}

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plenalign")).arg("render").args(arguments).output().unwrap()
}

#[test]
fn the_command_writes_a_frame_and_says_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("frame.png");
    let output = run(&["--out", file.to_str().unwrap(), "--rays", "1", "--seed", "4", "--json"]);
    assert!(output.status.success(), "{output:?}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["medium"], "water");
    assert!((report["delta_v_mm"].as_f64().unwrap() - 2.205_040_030_732_693).abs() < 1e-9);
    let frame = raw::read(&file).unwrap();
    assert_eq!((frame.width(), frame.height()), (1160, 1160));
}

#[test]
fn the_command_renders_every_flaw_that_is_configured() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["--set", "sensor.width_px=300", "--set", "sensor.height_px=200", "--rays", "4", "--json"];
    let full = |key: &str| if key.starts_with("sensor.") { key.to_owned() } else { format!("bench.simulation.{key}") };
    let render = |name: &str, white: bool, keys: &[&str]| {
        let file = folder.path().join(name);
        let mut arguments = vec!["--out".to_owned(), file.to_str().unwrap().to_owned()];
        arguments.extend(small.map(str::to_owned));
        arguments.extend(white.then(|| "--white".to_owned()));
        arguments.extend(keys.iter().flat_map(|key| ["--set".to_owned(), full(key)]));
        let output = run(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(output.status.success(), "{output:?}");
        (raw::read(&file).unwrap(), serde_json::from_slice::<Value>(&output.stdout).unwrap())
    };
    for (white, flaws) in [
        // What is seen on a board only, and what a white frame shows.
        (false, vec!["distortion_k1=-1.5", "bubbles.count=30", "motion.steps=3 motion.board_um=[200.0,0.0]"]),
        (
            true,
            vec![
                "exit_pupil_walk_mm=0.5",
                "microlenses.focal_factors=[1.0,0.9]",
                "microlenses.dead_share=0.2",
                "microlenses.dirty_share=0.3",
                "dust.specks=40 dust.height_um=50",
                "sensor.mosaic=rggb",
            ],
        ),
    ] {
        let (plain, report) = render("plain.png", white, &["read_noise_levels=0"]);
        assert_eq!((plain.bits(), &report["cfa"]), (8, &Value::Null));
        let mut frames = vec![plain];
        for flaw in flaws {
            let keys: Vec<&str> = ["read_noise_levels=0"].into_iter().chain(flaw.split(' ')).collect();
            let (frame, _) = render("flawed.png", white, &keys);
            assert!(!frames.contains(&frame), "{flaw} changed nothing");
            frames.push(frame);
        }
    }
    for name in ["deep.png", "deep.tiff", "deep.pgm"] {
        let (deep, report) = render(name, true, &["bits=12", "sensor.mosaic=grbg"]);
        assert_eq!((deep.white_level(), &report["bits"], &report["cfa"]), (4095, &12.into(), &"grbg".into()));
        let brightest = deep.to_f32().into_iter().fold(0.0, f32::max);
        assert!((3500.0..3900.0).contains(&brightest), "{name}: {brightest}");
    }
}

#[test]
fn the_command_refuses_what_cannot_be() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("frame.png");
    let out = file.to_str().unwrap();
    let missing = folder.path().join("none/frame.png");
    for (arguments, says) in [
        (vec!["--out", out, "--e", "3", "--air"], "--air"),
        (vec!["--out", out, "--distance", "0"], "above 0 mm"),
        (vec!["--out", out, "--distance", "-5"], "above 0 mm"),
        (vec!["--out", out, "--air", "--levels", "160,0,170"], "above 0 mm"),
        (vec!["--out", out, "--delta-v", "nan"], "--delta-v"),
        (vec!["--out", out, "--delta-v", "-30"], "--delta-v"),
        (vec!["--out", out, "--e", "60"], "inner radius"),
        (vec!["--out", out, "--rays", "0"], "--rays"),
        (vec!["--out", out, "--texture", "cat"], "cat"),
        (vec!["--out", missing.to_str().unwrap(), "--white", "--rays", "1"], "none/frame.png"),
        (vec!["--out", "frame.gif", "--white", "--rays", "1"], ".png, .tiff or .pgm"),
    ] {
        let output = run(&arguments);
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}");
        assert!(error.contains(says), "{arguments:?}: {error}");
        assert!(!file.exists(), "{arguments:?}");
    }
}
