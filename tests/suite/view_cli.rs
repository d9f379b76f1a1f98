//! `plenalign view` as a user runs it, on frames of a renderer that is not the project's own.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use serde_json::Value;

use super::measure_cli::{json, plenalign};

#[test]
fn pictures_and_distances_come_of_one_frame() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [out, sharp, png, tiff] = ["view.png", "sharp.png", "depth.png", "depth.tiff"].map(path);
    let frame = [
        "view",
        "water_hexagonal.png",
        "--white",
        "water_hexagonal_white.png",
        "--json",
        "--delta-v",
        "2.20504",
        "--e",
        "3",
    ];
    let report = json(&[&frame[..], &["--out", &out, "--all-in-focus", &sharp, "--depth", &tiff, "--lenses"]].concat());
    let number = |path: &str| report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}"));
    // The board is 800 mm from the shell.
    assert!((number("/distance_mm/median") / 800.0 - 1.0).abs() < 0.005, "{}", report["distance_mm"]);
    assert!((number("/distance_mm/lower_quartile") / 800.0 - 1.0).abs() < 0.02, "{}", report["distance_mm"]);
    assert!((number("/distance_mm/upper_quartile") / 800.0 - 1.0).abs() < 0.02, "{}", report["distance_mm"]);
    let count = report["micro_images"].as_u64().unwrap();
    assert!(count > 700 && report["measured"].as_u64().unwrap() * 10 > count * 9, "{report}");
    assert_eq!(report["lenses"].as_array().unwrap().len() as u64, count);
    assert_eq!(report["array"], "hexagonal");
    assert!(report["disagreements"].to_string().contains("hexagonal"), "{}", report["disagreements"]);
    let picture = image::open(&out).unwrap();
    assert_eq!(u64::from(picture.width()), report["view"]["width"].as_u64().unwrap());
    assert!(number("/all_in_focus/eog_mean_per_pixel") > 0.0 && Path::new(&sharp).exists());

    // The same distances in both kinds of file, as large as the view.
    json(&[&frame[..], &["--depth", &png]].concat());
    let levels = image::open(&png).unwrap().into_luma16();
    let image::DynamicImage::ImageLuma16(_) = image::open(&png).unwrap() else { panic!("16 bits") };
    let mut decoder =
        tiff::decoder::Decoder::new(std::io::BufReader::new(std::fs::File::open(&tiff).unwrap())).unwrap();
    let tiff::decoder::DecodingResult::F32(distances) = decoder.read_image().unwrap() else { panic!("32-bit float") };
    assert_eq!(levels.dimensions(), (picture.width(), picture.height()));
    assert_eq!(distances.len(), levels.as_raw().len());
    for (level, distance) in levels.as_raw().iter().zip(&distances) {
        let same = if distance.is_nan() { *level == 0 } else { (f32::from(*level) / 10.0 - distance).abs() <= 0.051 };
        assert!(same, "{level} and {distance}");
    }
}

#[test]
fn a_frame_is_refocused_and_seen_from_the_side() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("view.png");
    let out = out.to_str().unwrap();
    let frame = ["view", "air_charuco.png", "--white", "air_charuco_white.png", "--json", "--out", out];
    let air = ["--delta-v", "0", "--air"];
    let eog = |more: &[&str]| {
        let report = json(&[&frame[..], &air, more].concat());
        report["view"]["eog_mean_per_pixel"].as_f64().unwrap()
    };
    let (at, before) = (eog(&["--refocus", "820"]), eog(&["--refocus", "450"]));
    assert!(at > 1.5 * before, "{at} at the board, {before} before it");
    let (central, side) = (eog(&[]), eog(&["--angle", "0.4,-0.2"]));
    assert!(side > 0.5 * central, "{side} from the side of {central}");
}

#[test]
fn what_cannot_be_drawn_is_said() {
    for (arguments, wanted) in [
        (&["view", "air_charuco.png", "--depth", "d.png"][..], "--delta-v"),
        (&["view", "air_charuco.png", "--out", "v.bmp"], ".png"),
        (&["view", "air_charuco.png", "--delta-v", "0"], "--e or --air"),
        (&["view", "air_charuco.png", "--out", "/nowhere/v.png"], "/nowhere/v.png"),
        (&["view", "air_charuco.png", "--out", "/tmp/v.png", "--angle", "1,1"], "aperture"),
        (&["view", "air_charuco.png", "--out", "/tmp/v.png", "--refocus", "5", "--delta-v", "0", "--air"], "5 mm"),
        (&["view", "truth.json"], "truth.json"),
    ] {
        let output = plenalign(arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(wanted), "{arguments:?}: {said}");
    }
}
