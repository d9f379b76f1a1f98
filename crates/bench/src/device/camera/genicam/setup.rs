//! Making a camera deliver what is configured, and refusing one that does not.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::Duration;

use viva_genicam::genapi::{FeatureState, FeatureValue};
use viva_genicam::gige::{self, Iface};
use viva_genicam::u3v::{DEFAULT_MAX_TRANSFER_SIZE, DEFAULT_TRANSFERS_IN_FLIGHT};
use viva_genicam::{GigeRegisterIo, ResendPolicy, StandardFeature, StreamOptions};

use super::clock::{DeviceClock, Latch};
use super::features::{self, number, set, standard, state};
use super::transport::{Device, Frames, Transport};
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
    notes.extend(of_usb(device, config));
    Ok(Agreed { interval, notes })
}

/// What is to be known of a camera on USB, one sentence each.
fn of_usb(device: &Device, config: &CameraConfig) -> Vec<String> {
    let Transport::Usb(usb) = device.transport() else { return Vec::new() };
    let mut notes = Vec::new();
    if config.packet_bytes.is_some() || config.packet_delay_us.is_some() {
        notes.push("packet_bytes and packet_delay_us are of a network: this camera is on USB".to_owned());
    }
    let speed = usb.lock_device().ok().and_then(|device| device.current_speed());
    if let Some(speed) = speed.filter(|speed| speed.is_below_superspeed()) {
        notes.push(format!("the camera is connected at {speed}: plug it into a USB 3 port, by a USB 3 cable"));
    }
    notes
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

/// How many frames wait at most between a camera on USB and this program, where frames are dated by their arrival: those that
/// the transfers hold which the kernel was given, and the one that is being sent. What a camera itself keeps back is not known.
pub(super) fn in_transfers(frame_bytes: usize) -> u32 {
    // A frame is a transfer before its pixels and one behind them, besides its own.
    let of_frame = 2 + frame_bytes.div_ceil(DEFAULT_MAX_TRANSFER_SIZE as usize);
    u32::try_from(DEFAULT_TRANSFERS_IN_FLIGHT.div_ceil(of_frame)).unwrap_or(u32::MAX).saturating_add(1)
}

/// Opens the stream, with so many bytes of `room` in the kernel's buffer where frames from the network are dated by their
/// arrival. What is lost is then not asked for again: a frame that was mended would look younger than it is. None is held back
/// for longer than `held` for one before it.
///
/// # Errors
/// Why it cannot be opened, in words.
pub(super) fn open_stream(
    device: &Device,
    config: &CameraConfig,
    room: Option<usize>,
    held: Duration,
) -> Result<Frames, String> {
    let options = match device.transport() {
        Transport::Gige(gige) => network_options(device, gige, config, room)?,
        Transport::Usb(_) => StreamOptions::new(),
    };
    // Without it frames are as large as they say themselves.
    let payload = state(device, "PayloadSize").ok().flatten().as_ref().and_then(number).filter(|bytes| *bytes >= 1.0);
    let opened = device.transport().open_stream(options, held, payload.map(|bytes| bytes as usize));
    opened.map_err(|error| format!("its stream does not open: {}", features::why(&error)))
}

fn network_options(
    device: &Device,
    gige: &GigeRegisterIo,
    config: &CameraConfig,
    room: Option<usize>,
) -> Result<StreamOptions, String> {
    let mut options = match room {
        None => StreamOptions::new().resend(ResendPolicy::Auto),
        Some(room) => StreamOptions::new().resend(ResendPolicy::Off).rcvbuf_bytes(room),
    };
    options = match packet_bytes(device, gige, config)? {
        Some(bytes) => options.packet_size(bytes),
        None => options.auto_packet_size(),
    };
    if let Some(delay_us) = config.packet_delay_us {
        options = options.packet_delay(Duration::try_from_secs_f64(delay_us * 1e-6).unwrap_or_default());
    }
    Ok(options)
}

/// How large a packet may be at most, where the camera or the configuration says so: else as the interface carries them. The
/// camera's own test packets then show what comes through.
///
/// # Errors
/// Where the camera does not take what is configured, in words.
fn packet_bytes(device: &Device, gige: &GigeRegisterIo, config: &CameraConfig) -> Result<Option<u32>, String> {
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
    let Ok(address) = gige.lock_device().map(|device| device.remote_addr()) else { return Ok(None) };
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
    let transport = device.transport();
    match transport
        .ticks_a_second()
        .and_then(|hz| if hz == 0 { Ok((0, None)) } else { Ok((hz, Some(transport.latch()?))) })
    {
        Ok((0, _)) | Ok((_, None)) => without("it does not say how fast they run"),
        Ok((_, Some(Latch { ticks: 0, .. }))) => without("its clock cannot be read"),
        Ok((hz, Some(latch))) => Ok(DeviceClock::new(hz as f64, latch)),
        Err(why) => without(&why),
    }
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

    #[test]
    fn a_frame_over_usb_counts_as_no_older_than_what_is_under_way_can_make_it() {
        // Eight transfers: of three a small frame, of fourteen one of 12 MiB.
        assert_eq!([in_transfers(51_200), in_transfers(12 << 20)], [4, 2]);
    }
}
