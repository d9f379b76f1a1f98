//! Making a camera deliver what is configured, and refusing one that does not.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use viva_genicam::genapi::{FeatureState, FeatureValue, RegisterIo as _};
use viva_genicam::gige::{self, Iface};
use viva_genicam::{FrameStream, ResendPolicy, StandardFeature, StreamOptions};

use super::clock::{DeviceClock, Latch};
use super::features::{self, Device, number, set, standard, state};
use crate::config::{CameraConfig, ControlValue, TimestampMeans};
use plenoptics::raw::PixelFormat;

/// Longest and shortest time between frames that is believed of a camera.
const INTERVALS: (f64, f64) = (1e-4, 100.0);
/// Relative difference of frame rates worth a word.
const RATE_OFF: f64 = 0.01;
/// What leaves the pixels as the sensor has them.
const PLAIN: [(&str, &str); 9] = [
    ("BinningHorizontal", "1"),
    ("BinningVertical", "1"),
    ("DecimationHorizontal", "1"),
    ("DecimationVertical", "1"),
    ("ReverseX", "false"),
    ("ReverseY", "false"),
    ("TestPattern", "Off"),
    ("GammaEnable", "false"),
    ("LUTEnable", "false"),
];
/// The least room for packets in the kernel's buffer, bytes.
const LEAST_ROOM: usize = 1 << 20;
/// The feature of a packet's size with all its headers.
const PACKET_SIZE: &str = "GevSCPSPacketSize";
/// Registers that every GigE Vision device has at these places.
const TICKS_A_SECOND: u64 = 0x093c;
const TIMESTAMP_CONTROL: u64 = 0x0944;
const TIMESTAMP: u64 = 0x0948;
/// What, written to the timestamps' control, keeps the present one to be read.
const LATCH: u32 = 2;

/// What a camera and this program have agreed on.
pub(super) struct Agreed {
    /// The time between frames; an exposure is no longer.
    pub(super) interval: Duration,
    /// What is to be known about it, one sentence each.
    pub(super) notes: Vec<String>,
}

/// Sets the camera up for frames of `size`, with what is configured and `controls`.
///
/// # Errors
/// Why it cannot deliver what is configured, in words.
pub(super) fn agree(
    device: &mut Device,
    config: &CameraConfig,
    controls: &BTreeMap<String, ControlValue>,
    format: PixelFormat,
    size: (usize, usize),
) -> Result<Agreed, String> {
    // Whoever had it before may have left it running, which keeps format and size from being set.
    let _ = device.acquisition_stop();
    let mut notes = triggers_off(device)?;
    set_where_there(device, StandardFeature::AcquisitionMode, "Continuous")?;
    set(device, "PixelFormat", format.name()).map_err(|why| format!("{why} (bench.camera.format)"))?;
    notes.extend(undone(device, controls)?);
    set_region(device, config.crop(), size)?;
    // How long an exposure may be hangs on the rate in force, and the rate on the exposure.
    let _ = set_rate(device, config.frame_rate_hz)?;
    notes.extend(features::apply(device, controls)?);
    let (interval, note) = set_rate(device, config.frame_rate_hz)?;
    notes.extend(note);
    Ok(Agreed { interval, notes })
}

/// Sets back what another program may have left on, and what changes the pixels' places or values. Returns what could not
/// be, one sentence each.
fn undone(device: &mut Device, controls: &BTreeMap<String, ControlValue>) -> Result<Vec<String>, String> {
    let mut notes = Vec::new();
    for (name, value) in PLAIN {
        let left = features::set_unless_wanted(device, controls, name, value)?;
        notes.extend(left.map(|why| format!("the camera changes its pictures: {why}")));
    }
    Ok(notes)
}

fn set_where_there(device: &mut Device, feature: StandardFeature, value: &str) -> Result<(), String> {
    match standard(device, feature)? {
        Some((name, _)) => set(device, name, value),
        None => Ok(()),
    }
}

/// Has the camera run by itself, whatever it waited for.
fn triggers_off(device: &mut Device) -> Result<Vec<String>, String> {
    let mut notes = Vec::new();
    let selectors = state(device, "TriggerSelector")?.and_then(|state| state.enum_entries).unwrap_or_default();
    let off = |device: &mut Device| set_where_there(device, StandardFeature::TriggerMode, "Off");
    if selectors.is_empty() {
        off(device)?;
    }
    for selector in selectors {
        if let Err(why) = set(device, "TriggerSelector", &selector).and_then(|()| off(device)) {
            notes.push(format!("the camera may wait for a trigger ({selector}): {why}"));
        }
    }
    Ok(notes)
}

fn set_region(device: &mut Device, crop: Option<(u32, u32)>, (width, height): (usize, usize)) -> Result<(), String> {
    let (left, top) = crop.unwrap_or_default();
    let sides = [("OffsetX", "Width", left, width), ("OffsetY", "Height", top, height)];
    for (offset, side, at, pixels) in sides {
        // What there is room for depends on where the region begins.
        if state(device, offset)?.is_some() {
            set(device, offset, "0").or_else(|why| if at == 0 { Ok(()) } else { Err(why) })?;
        }
        set(device, side, &pixels.to_string()).map_err(|why| format!("{why} (sensor.{})", key_of(side)))?;
        if at > 0 {
            set(device, offset, &at.to_string()).map_err(|why| format!("{why} (bench.camera.{})", key_of(offset)))?;
        }
        let got = |state: Option<FeatureState>| state.as_ref().and_then(number);
        let (got_at, got_pixels) = (got(state(device, offset)?).unwrap_or(0.0), got(state(device, side)?));
        if got_pixels != Some(pixels as f64) || got_at != f64::from(at) {
            return Err(format!(
                "`{side}` and `{offset}` were set to {pixels} and {at}, and read {} and {got_at}: some cameras take only \
                 coarser steps",
                got_pixels.unwrap_or(f64::NAN)
            ));
        }
    }
    Ok(())
}

/// The key of the configuration that a feature of the region is from.
fn key_of(feature: &str) -> &'static str {
    match feature {
        "Width" => "width_px",
        "Height" => "height_px",
        "OffsetX" => "crop_left_px",
        _ => "crop_top_px",
    }
}

/// The time between frames as the camera grants it, or as configured where it does not say; and what is to be said of a rate
/// that was not granted.
fn set_rate(device: &mut Device, wanted_hz: f64) -> Result<(Duration, Option<String>), String> {
    if let Some((enable, state)) = standard(device, StandardFeature::FrameRateEnable)?
        && !matches!(state.value, FeatureValue::Boolean(true))
    {
        // Without it the rate is what exposure and link allow, which the stream shows.
        let _ = set(device, enable, "true");
    }
    let mut refused = None;
    if let Some((rate, state)) = standard(device, StandardFeature::FrameRate)? {
        let within = state.range.map_or(wanted_hz, |range| wanted_hz.clamp(range.min, range.max));
        refused = set(device, rate, &within.to_string()).err();
    }
    let granted = standard(device, StandardFeature::FrameRate)?.and_then(|(_, state)| number(&state));
    let seconds = granted.filter(|hz| *hz > 0.0).map_or(1.0 / wanted_hz, |hz| 1.0 / hz).clamp(INTERVALS.0, INTERVALS.1);
    let off = (wanted_hz * seconds - 1.0).abs() > RATE_OFF;
    let note = match (off, refused) {
        (false, None) => None,
        (_, Some(why)) => Some(format!("{wanted_hz} frames a second were asked for: {why}")),
        (true, None) => {
            Some(format!("{wanted_hz} frames a second were asked for, the camera grants {:.4}", 1.0 / seconds))
        }
    };
    Ok((Duration::from_secs_f64(seconds.max(features::exposure_s(device)?)), note))
}

/// The room (bytes) in the kernel's buffer of a stream whose frames are dated by their arrival: what waits there longer is
/// lost rather than taken for younger than it is. No more than the kernel gives, `most`, since a frame counts as so much older.
pub(super) fn room_by_arrival(frame_bytes: usize, most: Option<u64>) -> usize {
    let most = most.and_then(|most| usize::try_from(most).ok()).unwrap_or(usize::MAX);
    frame_bytes.max(LEAST_ROOM).min(most)
}

/// How many frames such a buffer holds, which Linux makes twice as large as it is asked for.
pub(super) fn buffered(room: usize, frame_bytes: usize) -> u32 {
    u32::try_from((2 * room).div_ceil(frame_bytes.max(1))).unwrap_or(u32::MAX)
}

/// Opens the stream, with so many bytes of `room` in the kernel's buffer where frames are dated by their arrival. What is
/// lost is then not asked for again: a frame that was mended would look younger than it is.
///
/// # Errors
/// Why it cannot be opened, in words.
pub(super) fn open_stream(
    device: &mut Device,
    config: &CameraConfig,
    room: Option<usize>,
) -> Result<FrameStream, String> {
    let mut options = match room {
        None => StreamOptions::new().resend(ResendPolicy::Auto),
        Some(room) => StreamOptions::new().resend(ResendPolicy::Off).rcvbuf_bytes(room),
    };
    options = match packet_bytes(device, config)? {
        Some(bytes) => options.packet_size(bytes),
        None => options.auto_packet_size(),
    };
    if let Some(delay_us) = config.packet_delay_us {
        options = options.packet_delay(Duration::try_from_secs_f64(delay_us * 1e-6).unwrap_or_default());
    }
    device.open_stream(options).map_err(|error| format!("its stream does not open: {}", features::why(&error)))
}

/// How large a packet may be at most, where the camera or the configuration says so: else as the interface carries them. The
/// camera's own test packets then show what comes through.
///
/// # Errors
/// Where the camera does not take what is configured, in words.
fn packet_bytes(device: &Device, config: &CameraConfig) -> Result<Option<u32>, String> {
    // Without the feature, or where it cannot be read, the register itself shows what the camera takes.
    let Ok(Some(state)) = state(device, PACKET_SIZE) else { return Ok(config.packet_bytes) };
    let Some(range) = state.range else { return Ok(config.packet_bytes) };
    let step = range.inc.filter(|step| *step >= 1.0).unwrap_or(1.0);
    let taken = |bytes: f64| range.min + ((bytes.clamp(range.min, range.max) - range.min) / step).floor() * step;
    if let Some(bytes) = config.packet_bytes {
        if taken(f64::from(bytes)) != f64::from(bytes) {
            let choices = features::choices(&state);
            return Err(format!(
                "`{PACKET_SIZE}` is not set to {bytes}: it takes {choices} (bench.camera.packet_bytes)"
            ));
        }
        return Ok(Some(bytes));
    }
    let Ok(address) = device.transport().lock_device().map(|device| device.remote_addr()) else { return Ok(None) };
    let IpAddr::V4(address) = address.ip() else { return Ok(None) };
    let carried =
        Iface::from_remote_ipv4(address).map(|interface| gige::best_packet_size(gige::mtu(&interface).bytes()));
    let Ok(carried) = carried else { return Ok(None) };
    Ok(Some(taken(carried.into()) as u32).filter(|bytes| *bytes < carried))
}

/// The camera's clock, where it has one that can be read and its timestamps are to be believed; else why not.
pub(super) fn clock(device: &Device, config: &CameraConfig) -> Result<DeviceClock, Option<String>> {
    if config.timestamp_means == TimestampMeans::Arrival {
        return Err(None);
    }
    let without = |why: &str| {
        Err(Some(format!(
            "the camera's timestamps are of no use: {why}; the time of a frame's arrival stands in for them"
        )))
    };
    match long(device, TICKS_A_SECOND).and_then(|hz| Ok((hz, latch(device)?))) {
        Ok((0, _)) => without("it does not say how fast they run"),
        Ok((_, Latch { ticks: 0, .. })) => without("its clock cannot be read"),
        Ok((hz, latch)) => Ok(DeviceClock::new(hz as f64, latch)),
        Err(why) => without(&why),
    }
}

/// Reads the camera's clock.
///
/// # Errors
/// Why it cannot be read, in words.
pub(super) fn latch(device: &Device) -> Result<Latch, String> {
    let before = Instant::now();
    device.transport().write(TIMESTAMP_CONTROL, &LATCH.to_be_bytes()).map_err(|error| error.to_string())?;
    let after = Instant::now();
    Ok(Latch { ticks: long(device, TIMESTAMP)?, before, after })
}

/// A number of two registers, the high one first.
fn long(device: &Device, at: u64) -> Result<u64, String> {
    let half = |at: u64| -> Result<u64, String> {
        let bytes = device.transport().read(at, 4).map_err(|error| error.to_string())?;
        bytes.try_into().map(|bytes| u64::from(u32::from_be_bytes(bytes))).map_err(|_| "no register".to_owned())
    };
    Ok(half(at)? << 32 | half(at + 4)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_by_arrival_counts_as_no_older_than_the_kernels_buffer_can_make_it() {
        let held = |frame_bytes, most| buffered(room_by_arrival(frame_bytes, most), frame_bytes);
        assert_eq!(held(12_582_912, Some(64 << 20)), 2);
        // 51 200 bytes, of which 2 MiB hold 41 and what Linux gives by default 9.
        assert_eq!([held(51_200, Some(64 << 20)), held(51_200, None), held(51_200, Some(212_992))], [41, 41, 9]);
    }
}
