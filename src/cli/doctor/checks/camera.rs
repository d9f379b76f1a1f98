//! Cameras, and the configured one.

use std::path::Path;

use super::{genicam, permission, stages};
use crate::cli::doctor::facts::{CameraSource, DeviceFile, Facts, VideoFacts};
use crate::cli::doctor::finding::Finding;
use crate::config::Config;
use crate::device::camera::offer::{Offer, Size};

const ID: &str = "camera.device";

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let mut found = match (facts.configuration.config(), &facts.camera) {
        (Some(config), Some(CameraSource::Device(resolved))) => of_device(config, resolved, facts),
        (Some(config), Some(CameraSource::Genicam(found))) => genicam::check(config, found, facts),
        (Some(config), Some(CameraSource::Files(files))) => vec![of_files(config, files)],
        _ => Vec::new(),
    };
    let used = |video: &VideoFacts| match &facts.camera {
        Some(CameraSource::Device(Ok(path))) => is_at(video, path),
        _ => false,
    };
    found.extend(facts.cameras.iter().filter(|video| !used(video)).map(unused));
    if facts.cameras.is_empty() && !matches!(facts.camera, Some(CameraSource::Genicam(_))) {
        found.push(Finding::note("camera.found", "cameras", "none is connected"));
    }
    found
}

fn is_at(video: &VideoFacts, path: &Path) -> bool {
    video.node.path == path || video.file.path == path || video.node.by_id.iter().any(|link| link == path)
}

/// A camera that is not the configured one.
fn unused(video: &VideoFacts) -> Finding {
    let node = &video.node;
    let what = node.path.display().to_string();
    if let Some(why) = &node.unusable {
        return Finding::note("camera.found", what, format!("{}: no camera for this program: {why}", called(video)));
    }
    let steadiest = video.names.first().map_or("", String::as_str);
    Finding::note(
        "camera.found",
        what,
        format!("{}: offers {}; device = {steadiest:?} would name it", called(video), offered(&video.offers)),
    )
}

fn called(video: &VideoFacts) -> &str {
    if video.node.card.is_empty() { "a video device" } else { &video.node.card }
}

/// Formats and sizes that this program reads.
fn offered(offers: &[Offer]) -> String {
    let readable = offers.iter().filter(|offer| offer.readable).map(|offer| {
        let sizes: Vec<String> = offer.sizes.iter().map(ToString::to_string).collect();
        format!("{} {}", offer.format, sizes.join(" ")).trim_end().to_owned()
    });
    let readable: Vec<String> = readable.collect();
    if readable.is_empty() { "no format that this program reads".to_owned() } else { readable.join(", ") }
}

fn of_files(config: &Config, files: &Result<usize, String>) -> Finding {
    let pattern = &config.bench.camera.files;
    match files {
        Ok(count) => Finding::note(
            "camera.files",
            "camera",
            format!("plays {count} files of {pattern}: nothing of what it shows is now"),
        ),
        Err(why) => Finding::problem("camera.files", "camera", why, "[bench.camera] files = \"/FOLDER/WITH/FRAMES\""),
    }
}

fn of_device(config: &Config, resolved: &Result<std::path::PathBuf, String>, facts: &Facts) -> Vec<Finding> {
    let given = &config.bench.camera.device;
    let what = "camera";
    let path = match resolved {
        Ok(path) => path,
        Err(why) => return vec![Finding::problem(ID, what, format!("device = {given:?}: {why}"), connect(facts))],
    };
    let Some(video) = facts.cameras.iter().find(|video| is_at(video, path)) else {
        return vec![Finding::problem(ID, what, format!("device = {given:?} is no video device"), connect(facts))];
    };
    // What cannot be opened has no formats to be judged.
    if let Some(wrong) = permission::check("camera.permission", what, &video.file, facts) {
        let stop = !video.file.ours;
        let mut found = vec![wrong];
        if !stop {
            found.extend(of_video(config, video, facts));
        }
        return found;
    }
    let found = of_video(config, video, facts);
    if found.iter().any(|finding| finding.id == "camera.format" || finding.id == ID) {
        return found;
    }
    let camera = &config.bench.camera;
    let size = format!("{}x{}", config.sensor.width_px, config.sensor.height_px);
    let ok = format!("{} at {given}, {} {size} at {} Hz", called(video), camera.format, camera.frame_rate_hz);
    [vec![Finding::ok(ID, what, ok)], found].concat()
}

fn of_video(config: &Config, video: &VideoFacts, facts: &Facts) -> Vec<Finding> {
    let (what, given) = ("camera", &config.bench.camera.device);
    if let Some(why) = &video.node.unusable {
        return vec![Finding::problem(ID, what, format!("device = {given:?}: {why}"), "plenalign camera list")];
    }
    let mut found = Vec::new();
    found.extend(format_fault(config, &video.offers));
    found.extend(held(&video.file, facts));
    let steady = video.names.iter().find(|name| !name.starts_with("/dev/video"));
    if let Some(steady) = steady.filter(|_| given.starts_with("/dev/video")) {
        found.push(Finding::warning(
            "camera.name",
            what,
            format!("{given} may be another camera after a restart, or once it was unplugged"),
            format!("[bench.camera] device = {steady:?}"),
        ));
    }
    found.extend(stages::autosuspend("camera.autosuspend", what, &video.file));
    found
}

fn connect(facts: &Facts) -> String {
    let usable = facts.cameras.iter().filter(|video| video.node.unusable.is_none());
    let names: Vec<String> = usable.filter_map(|video| video.names.first()).map(|name| format!("{name:?}")).collect();
    if names.is_empty() {
        return "plenalign camera list    # connect the camera, and write its name: [bench.camera] device = \"...\""
            .to_owned();
    }
    format!("[bench.camera] device = {}    # or connect the one that is configured", names.join(" or "))
}

/// Why the camera does not deliver what is configured.
fn format_fault(config: &Config, offers: &[Offer]) -> Option<Finding> {
    const ID: &str = "camera.format";
    let camera = &config.bench.camera;
    // A driver that lists nothing may still take what it is told.
    if offers.is_empty() {
        return None;
    }
    let all = offered(offers);
    let Some(offer) = offers.iter().find(|offer| offer.format == camera.format) else {
        let mend = match offers.iter().find(|offer| offer.readable) {
            Some(offer) => format!("[bench.camera] format = {:?}", offer.format),
            None => "plenalign camera list".to_owned(),
        };
        let detail = format!("it does not offer {}: it offers {all}", camera.format);
        return Some(Finding::problem(ID, "camera", detail, mend));
    };
    let wanted = [config.sensor.width_px, config.sensor.height_px];
    let fits = offer.sizes.is_empty() || offer.sizes.iter().any(|size| has(size, wanted));
    // What is cropped is cut from a frame of the sensor's own size.
    if fits || camera.crop().is_some() {
        return None;
    }
    let most = offer.sizes.iter().map(|size| size.most_px).max_by_key(|[w, h]| u64::from(*w) * u64::from(*h))?;
    Some(Finding::problem(
        ID,
        "camera",
        format!("it does not offer {} at {}x{} px: it offers {all}", camera.format, wanted[0], wanted[1]),
        format!("[sensor] width_px = {}, height_px = {}", most[0], most[1]),
    ))
}

fn has(size: &Size, wanted: [u32; 2]) -> bool {
    (0..2).all(|side| {
        let (least, most, step) = (size.least_px[side], size.most_px[side], size.step_px[side].max(1));
        (least..=most).contains(&wanted[side]) && (wanted[side] - least).is_multiple_of(step)
    })
}

/// Who else has the camera.
fn held(file: &DeviceFile, facts: &Facts) -> Option<Finding> {
    let holder = file.open_in.first()?;
    let detail = format!("{} has {} open", holder.said(), file.path.display());
    if holder.is_plenalign() || facts.holder.as_ref().is_some_and(|of_bench| of_bench.pid == holder.pid) {
        return Some(Finding::ok("camera.held", "camera", detail));
    }
    Some(Finding::warning(
        "camera.held",
        "camera",
        format!("{detail}: only one program at a time gets frames of it"),
        format!("sudo fuser -v {}; kill {}", file.path.display(), holder.pid),
    ))
}
