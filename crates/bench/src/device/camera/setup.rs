//! Making a camera deliver what is configured, and refusing one that does not.

use std::io;
use std::time::Duration;

use v4l::format::{FieldOrder, Quantization};
use v4l::parameters::Capabilities;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC, Fraction};

use super::kernel::{self, Rectangle, guarded};
use super::{controls, find, offer};
use crate::config::CameraConfig;
use plenoptics::raw::{Layout, PixelFormat};

/// Longest and shortest time between frames that is believed of a driver.
const INTERVALS: (f64, f64) = (1e-4, 100.0);
/// Relative difference of frame rates worth a word.
const RATE_OFF: f64 = 0.01;
/// White of video levels, which luma has unless a driver says that its range is full.
const VIDEO_WHITE: u16 = 235;

/// What a camera and this program have agreed on.
pub(super) struct Agreed {
    /// What the device says it is.
    pub(super) identity: String,
    /// Bytes from a row to the next; 0 where the driver does not say.
    pub(super) stride: usize,
    /// The time between frames.
    pub(super) interval: Duration,
    /// From this level on a pixel is saturated.
    pub(super) white: u16,
    /// What is to be known about it, one sentence each.
    pub(super) notes: Vec<String>,
}

/// Sets the camera up for frames of `size`.
///
/// # Errors
/// Why it cannot deliver what is configured, in words.
pub(super) fn agree(
    device: &Device,
    config: &CameraConfig,
    format: PixelFormat,
    size: (usize, usize),
) -> Result<Agreed, String> {
    let caps = guarded(|| device.query_caps()).map_err(|error| format!("it is no video device: {error}"))?;
    if let Some(why) = find::unusable(caps.capabilities) {
        return Err(format!("{} cannot be used: {why}", caps.card));
    }
    let cropped = set_crop(device, config, size)?;
    let got = set_format(device, format, size)?;
    let mut notes = check_crop(device, cropped, size)?;
    notes.extend(controls::apply(device, &config.controls)?);
    let (interval, rate_note) = set_rate(device, config);
    notes.extend(rate_note);
    if format.is_recompressed() {
        notes.push(format!(
            "the camera sends {}, which a lossy code has been through: its frames can be viewed and not measured; raw \
             formats of it: {}",
            format.name(),
            raw_formats(device)
        ));
    }
    let luma = matches!(format.layout(), Layout::Bytes { .. }) && format.is_interpolated();
    let video_levels = luma && !matches!(got.quantization, Quantization::FullRange);
    let white = if video_levels { VIDEO_WHITE } else { format.white_level() };
    let identity = format!("{} ({}, {})", caps.card, caps.driver, caps.bus);
    Ok(Agreed { identity, stride: got.stride as usize, interval, white, notes })
}

fn raw_formats(device: &Device) -> String {
    let raw = offer::offers(device).into_iter().filter(|offer| offer.readable && !offer.recompressed);
    let names: Vec<String> = raw.map(|offer| offer.format).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn set_format(device: &Device, format: PixelFormat, (width, height): (usize, usize)) -> Result<Format, String> {
    let code = FourCC::new(&format.fourcc());
    // Made anew, with stride and size zero: a driver keeps an old stride that it is handed.
    let asked = Format { field_order: FieldOrder::Progressive, ..Format::new(width as u32, height as u32, code) };
    let got = guarded(|| device.set_format(&asked)).map_err(|error| match error.kind() {
        io::ErrorKind::ResourceBusy => {
            "its format cannot be set: another program captures from it, or nothing feeds it, if it is a loopback"
                .to_owned()
        }
        _ => format!("its format cannot be set: {error}"),
    })?;
    if got.fourcc != code || (got.width as usize, got.height as usize) != (width, height) {
        return Err(format!(
            "it delivers {}x{} {} instead of the configured {width}x{height} {}; it offers {}",
            got.width,
            got.height,
            offer::name_of(got.fourcc),
            format.name(),
            offer::summary(device)
        ));
    }
    if !matches!(got.field_order, FieldOrder::Progressive | FieldOrder::Any) {
        return Err(format!("its frames are {}: fields of two moments are no frame", got.field_order));
    }
    Ok(got)
}

fn set_crop(device: &Device, config: &CameraConfig, size: (usize, usize)) -> Result<Option<Rectangle>, String> {
    let Some((left, top)) = config.crop() else { return Ok(None) };
    let whole = kernel::crop(device).map(|(_, whole)| whole);
    let origin = whole.map_or((0, 0), |whole| (whole.left, whole.top));
    let wanted = Rectangle {
        left: origin.0.saturating_add_unsigned(left),
        top: origin.1.saturating_add_unsigned(top),
        width: size.0 as u32,
        height: size.1 as u32,
    };
    let region = whole.map_or_else(String::new, |whole| format!(" of {}x{} px", whole.width, whole.height));
    kernel::set_crop(device, wanted)
        .map(|_| Some(wanted))
        .map_err(|error| format!("no region{region} can be cropped (crop_left_px, crop_top_px): {error}"))
}

/// Whether the region read out is the one wanted, once the format has had its say in it.
fn check_crop(device: &Device, wanted: Option<Rectangle>, size: (usize, usize)) -> Result<Vec<String>, String> {
    match (kernel::crop(device), wanted) {
        (Some((got, whole)), Some(wanted)) if got != wanted => Err(format!(
            "it reads out {}x{} px from column {} and row {} instead of {}x{} px from {} and {} (crop_left_px, \
             crop_top_px); of {}x{} px there are, some drivers take only even or coarser steps",
            got.width,
            got.height,
            got.left - whole.left,
            got.top - whole.top,
            wanted.width,
            wanted.height,
            wanted.left - whole.left,
            wanted.top - whole.top,
            whole.width,
            whole.height
        )),
        (Some((got, _)), None) if (got.width as usize, got.height as usize) != size => Ok(vec![format!(
            "the camera scales a region of {}x{} px to frames of {}x{}: sensor.pixel_um must be the scaled pixel's, or \
             set crop_left_px and crop_top_px to read {}x{} px out as they are",
            got.width, got.height, size.0, size.1, size.0, size.1
        )]),
        _ => Ok(Vec::new()),
    }
}

/// The time between frames as the driver grants it, or as configured where it does not say; and what is to be said of a
/// rate that was not granted.
fn set_rate(device: &Device, config: &CameraConfig) -> (Duration, Option<String>) {
    let rate = config.frame_rate_hz.clamp(0.01, 10_000.0);
    let asked =
        if rate.fract() == 0.0 { Fraction::new(1, rate as u32) } else { Fraction::new(1000, (rate * 1000.0) as u32) };
    let granted = guarded(|| device.set_params(&Parameters::new(asked)))
        .ok()
        .filter(|params| params.capabilities.contains(Capabilities::TIME_PER_FRAME))
        .map(|params| params.interval)
        .filter(|interval| interval.numerator > 0 && interval.denominator > 0)
        .map(|interval| f64::from(interval.numerator) / f64::from(interval.denominator));
    let seconds = granted.unwrap_or(1.0 / rate).clamp(INTERVALS.0, INTERVALS.1);
    let off = (rate * seconds - 1.0).abs() > RATE_OFF;
    let note = off.then(|| format!("{rate} frames a second were asked for, the driver grants {:.4}", 1.0 / seconds));
    (Duration::from_secs_f64(seconds), note)
}
