//! `[bench.camera]`: where frames come from.

use std::collections::BTreeMap;
use std::fmt;
use std::net::Ipv4Addr;

use schemars::JsonSchema;
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::check::Faults;
use super::{BenchDriver, Config};
use plenoptics::raw::PixelFormat;

/// Where frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraDriver {
    /// Video4Linux2 (on a simulated bench: its own camera).
    V4l2,
    /// A GenICam camera over GigE Vision (on a simulated bench: its own camera).
    Genicam,
    /// Frames kept in files, played again.
    Files,
}

/// The moment that a GenICam camera's timestamps are of, which differs by vendor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
#[value(rename_all = "snake_case")]
pub enum TimestampMeans {
    /// The exposure's start.
    ExposureStart,
    /// The exposure's end.
    ExposureEnd,
    /// Some moment from the exposure's start to the end of read-out: the earliest exposure that fits is assumed.
    Readout,
    /// Nothing of use: the time of a frame's arrival stands in for them.
    Arrival,
}

/// `[bench.camera]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Driver. On a simulated bench `v4l2` and `genicam` stand for the simulated camera.
    pub driver: CameraDriver,
    /// Which device. With `v4l2` a device file, best by its `/dev/v4l/by-id` name; `card:NAME`, by the name that its driver
    /// gives it; or `usb:SERIAL`, by its USB serial number. With `genicam` `serial:NUMBER`; `name:NAME`, by the name that
    /// a user gave it; its IPv4 address; or `usb:VENDOR:PRODUCT`, by the numbers of a camera on USB.
    pub device: String,
    /// Network interfaces on which cameras are looked for, such as `eth1`; on no other. Those on USB are found without
    /// (genicam only).
    pub interfaces: Vec<String>,
    /// Pixel format, by its V4L2 name, or PFNC's (genicam).
    pub format: String,
    /// Left column of the region read out, px from the left of what the driver can crop from; without it and
    /// `crop_top_px` nothing is cropped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop_left_px: Option<u32>,
    /// Top row of the region read out, px.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop_top_px: Option<u32>,
    /// Frames a second asked for, or played.
    pub frame_rate_hz: f64,
    /// Longest wait for a frame before the camera counts as lost, ms.
    pub timeout_ms: u64,
    /// Time a picture spends between exposure and the driver's timestamp, ms.
    pub pipeline_delay_ms: u64,
    /// What the camera's timestamps are of (genicam only).
    pub timestamp_means: TimestampMeans,
    /// Bytes of a packet with its headers, at most; left out: as many as the network carries (genicam only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packet_bytes: Option<u32>,
    /// The camera's pause between two packets, µs; left out: as it is set (genicam only).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub packet_delay_us: Option<f64>,
    /// Controls set before frames are taken, by the driver's or the camera's names for them.
    pub controls: BTreeMap<String, ControlValue>,
    /// The frames to play: a folder, or a pattern such as `/data/run-7/*.png` (files only).
    pub files: String,
    /// Whether they are played again and again, and not once (files only).
    pub repeat: bool,
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self {
            driver: CameraDriver::V4l2,
            device: "/dev/video0".to_owned(),
            interfaces: Vec::new(),
            format: "GREY".to_owned(),
            crop_left_px: None,
            crop_top_px: None,
            frame_rate_hz: 30.0,
            timeout_ms: 2000,
            pipeline_delay_ms: 0,
            timestamp_means: TimestampMeans::Readout,
            packet_bytes: None,
            packet_delay_us: None,
            controls: BTreeMap::new(),
            files: String::new(),
            repeat: true,
        }
    }
}

impl CameraConfig {
    /// Left column and top row of the region read out, px, where one is configured.
    #[must_use]
    pub fn crop(&self) -> Option<(u32, u32)> {
        match (self.crop_left_px, self.crop_top_px) {
            (None, None) => None,
            (left, top) => Some((left.unwrap_or(0), top.unwrap_or(0))),
        }
    }

    /// The pixel format, where it is one that is read of such a camera.
    #[must_use]
    pub fn pixel_format(&self) -> Option<PixelFormat> {
        match self.driver {
            CameraDriver::Genicam => PixelFormat::from_genicam_name(&self.format),
            CameraDriver::V4l2 | CameraDriver::Files => PixelFormat::from_name(&self.format),
        }
    }

    pub(super) fn check(&self, faults: &mut Faults) {
        faults.require(self.pixel_format().is_some(), "bench.camera.format", || {
            let readable = match self.driver {
                CameraDriver::Genicam => PixelFormat::genicam(),
                CameraDriver::V4l2 | CameraDriver::Files => PixelFormat::all(),
            };
            let names: Vec<&str> = readable.iter().map(|format| format.name()).collect();
            format!("{:?} is not understood; these are: {}", self.format, names.join(", "))
        });
        faults.positive("bench.camera.frame_rate_hz", self.frame_rate_hz);
        faults.require(self.timeout_ms > 0, "bench.camera.timeout_ms", || "must be at least 1".to_owned());
        for (name, value) in &self.controls {
            let whole = self.driver == CameraDriver::Genicam || !matches!(value, ControlValue::Real(_));
            faults.require(whole, format!("bench.camera.controls.{name}"), || {
                format!("{value} must be true, false, a whole number or the name of a menu's item: V4L2 has no others")
            });
        }
        if let Some(bytes) = self.packet_bytes {
            faults.require(PACKET_BYTES.contains(&bytes), "bench.camera.packet_bytes", || {
                format!("must be {} to {}, not {bytes}", PACKET_BYTES.start(), PACKET_BYTES.end())
            });
        }
        if let Some(delay) = self.packet_delay_us {
            faults.not_negative("bench.camera.packet_delay_us", delay);
        }
    }

    /// Whether the source of the frames is named.
    pub(super) fn check_source(&self, faults: &mut Faults) {
        match self.driver {
            CameraDriver::V4l2 => {
                let (form, rest) = self.device.split_once(':').unwrap_or(("", &self.device));
                let named = form.contains('/') || (matches!(form, "" | "card" | "usb") && !rest.trim().is_empty());
                faults.require(named, "bench.camera.device", || {
                    format!(
                        "{:?} names no device: give a device file such as /dev/v4l/by-id/..., card:NAME or usb:SERIAL; \
                         `plenalign camera list` shows what there is",
                        self.device
                    )
                });
            }
            CameraDriver::Genicam => self.check_genicam(faults),
            CameraDriver::Files => faults.require(!self.files.is_empty(), "bench.camera.files", || {
                "is empty: driver = \"files\" plays a folder, or a pattern such as \"/data/run-7/*.png\"".to_owned()
            }),
        }
    }

    fn check_genicam(&self, faults: &mut Faults) {
        let named = GenicamName::of(&self.device).is_some();
        faults.require(named, "bench.camera.device", || {
            format!(
                "{:?} names no GenICam camera: give serial:NUMBER, name:NAME, its IPv4 address, or usb:VENDOR:PRODUCT \
                 of one on USB; `plenalign camera list` shows what there is on USB and on bench.camera.interfaces",
                self.device
            )
        });
    }
}

/// Sizes of packets that are believed: less holds no leader, more is no IPv4 datagram.
const PACKET_BYTES: std::ops::RangeInclusive<u32> = 576..=65_535;

/// What `device` says of a GenICam camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum GenicamName {
    /// Its serial number.
    Serial(String),
    /// The name that a user gave it.
    Name(String),
    /// Its address.
    Address(Ipv4Addr),
    /// Its vendor's number and the product's, on USB.
    Product(u16, u16),
}

impl GenicamName {
    /// Reads a configured `device`; `None` where it names no GenICam camera.
    #[must_use]
    pub fn of(device: &str) -> Option<Self> {
        let given = |name: &str| Some(name.trim().to_owned()).filter(|name| !name.is_empty());
        match device.split_once(':') {
            Some(("serial", serial)) => given(serial).map(Self::Serial),
            Some(("name", name)) => given(name).map(Self::Name),
            Some(("usb", product)) => {
                let (vendor, product) = product.split_once(':')?;
                let [vendor, product] = [vendor, product].map(|number| u16::from_str_radix(number.trim(), 16).ok());
                Some(Self::Product(vendor?, product?))
            }
            _ => device.trim().parse().ok().map(Self::Address),
        }
    }
}

impl Config {
    /// Whether format and sensor agree on the mosaic: green read where red is would be a number that looks right.
    pub(super) fn check_mosaic(&self, faults: &mut Faults) {
        let camera = &self.bench.camera;
        if self.bench.driver != BenchDriver::Hardware || camera.driver == CameraDriver::Files {
            return;
        }
        let Some(format) = camera.pixel_format() else { return };
        match (format.mosaic(), self.sensor.mosaic) {
            (Some(of_format), of_sensor) if of_sensor != Some(of_format) => {
                let set = of_sensor.map_or_else(|| "is left out".to_owned(), |set| format!("says {:?}", set.name()));
                faults.add(
                    "bench.camera.format",
                    format!(
                        "{} is a mosaic that begins {}, and sensor.mosaic {set}: set sensor.mosaic = {:?}",
                        format.name(),
                        of_format.name(),
                        of_format.name()
                    ),
                );
            }
            (None, Some(_)) if format.is_interpolated() => faults.add(
                "bench.camera.format",
                format!(
                    "{} holds pixels that the camera has already interpolated: with sensor.mosaic a format of raw \
                     pixels is needed; without one, leave sensor.mosaic out",
                    format.name()
                ),
            ),
            _ => {}
        }
    }
}

/// The value of a camera's control.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum ControlValue {
    /// On or off.
    Switch(bool),
    /// A number, or the number of a menu's item.
    Number(i64),
    /// A number that is not whole, where the control takes such.
    Real(f64),
    /// A menu's item by its name.
    Item(String),
}

impl fmt::Display for ControlValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Switch(on) => write!(f, "{on}"),
            Self::Number(number) => write!(f, "{number}"),
            Self::Real(number) => write!(f, "{number}"),
            Self::Item(name) => write!(f, "{name:?}"),
        }
    }
}

impl<'de> Deserialize<'de> for ControlValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OfControl;
        impl Visitor<'_> for OfControl {
            type Value = ControlValue;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true, false, a number or the name of a menu's item")
            }

            fn visit_bool<E: Error>(self, on: bool) -> Result<ControlValue, E> {
                Ok(ControlValue::Switch(on))
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<ControlValue, E> {
                Ok(ControlValue::Number(number))
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<ControlValue, E> {
                i64::try_from(number)
                    .map(ControlValue::Number)
                    .map_err(|_| E::invalid_value(serde::de::Unexpected::Unsigned(number), &self))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<ControlValue, E> {
                Ok(ControlValue::Real(number))
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<ControlValue, E> {
                Ok(ControlValue::Item(name.to_owned()))
            }
        }
        deserializer.deserialize_any(OfControl)
    }
}
