//! Who the camera is, how it is set, and what setting it brings about.

use std::net::Ipv4Addr;

use super::format::{Format, Region};

/// What a write brings about besides the register's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effect {
    /// Frames begin.
    Start,
    /// Frames end.
    Stop,
    /// A frame is taken.
    Trigger,
    /// A packet is sent, to see whether its like come through.
    TestPacket,
    /// The clock is read.
    Latch,
    /// The clock begins anew.
    ResetClock,
    /// The camera begins anew.
    Reset,
}

/// Who the camera is.
#[derive(Debug, Clone)]
pub(super) struct Identity {
    pub(super) serial: String,
    pub(super) user_name: String,
    /// Ticks of its clock a second; 0 for a camera without one.
    pub(super) ticks_a_second: u64,
    pub(super) sensor: [u32; 2],
    pub(super) formats: &'static [Format],
    /// To what whole steps a region's place is bound, px.
    pub(super) offset_step: u32,
    /// Whether it says which program has control of it.
    pub(super) names_controller: bool,
}

/// How frames are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settings {
    pub(super) region: Region,
    pub(super) format: Format,
    pub(super) exposure_us: f64,
    pub(super) gain_db: f64,
    pub(super) rate_hz: f64,
    pub(super) triggered: bool,
    pub(super) single: bool,
}

/// Where frames go, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Destination {
    pub(super) address: Ipv4Addr,
    pub(super) port: u16,
    /// Bytes of a packet with all its headers.
    pub(super) packet_bytes: usize,
    /// Whether nothing on the way may cut it up.
    pub(super) whole: bool,
    /// What passes between two packets besides, ticks.
    pub(super) delay_ticks: u32,
}
