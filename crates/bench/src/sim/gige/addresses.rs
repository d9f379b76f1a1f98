//! Where the camera's registers are: the standard's own, and its features', which the description names.

use std::ops::Range;

/// What a discovery is answered with: the registers from the first on.
pub(super) const IDENTITY: Range<u32> = 0..0xf8;
/// Who has control of the camera.
pub(super) const PRIVILEGE: u32 = 0x0a00;
/// Where the description begins.
pub(super) const DESCRIPTION: u32 = 0x1_0000;

pub(super) const HEARTBEAT: u32 = 0x0938;
pub(super) const TICKS_A_SECOND: u32 = 0x093c;
pub(super) const TIMESTAMP_CONTROL: u32 = 0x0944;
pub(super) const TIMESTAMP: u32 = 0x0948;
pub(super) const PRIMARY_PORT: u32 = 0x0a04;
pub(super) const PRIMARY_ADDRESS: u32 = 0x0a14;
pub(super) const STREAM_PORT: u32 = 0x0d00;
pub(super) const PACKET_SIZE: u32 = 0x0d04;
pub(super) const PACKET_DELAY: u32 = 0x0d08;
pub(super) const STREAM_ADDRESS: u32 = 0x0d18;
pub(super) const STREAM_SOURCE_PORT: u32 = 0x0d1c;
pub(super) const USER_NAME: Range<u32> = 0xe8..0xf8;
/// The registers that every device has, and where the camera's own are.
pub(super) const BOOTSTRAP: Range<u32> = 0..0x0e00;
pub(super) const FEATURES: Range<u32> = 0x8000..0x8100;

pub(super) const SENSOR_WIDTH: u32 = 0x8000;
pub(super) const SENSOR_HEIGHT: u32 = 0x8004;
pub(super) const WIDTH: u32 = 0x8008;
pub(super) const HEIGHT: u32 = 0x800c;
pub(super) const OFFSET_X: u32 = 0x8010;
pub(super) const OFFSET_Y: u32 = 0x8014;
pub(super) const WIDTH_MAX: u32 = 0x8018;
pub(super) const HEIGHT_MAX: u32 = 0x801c;
pub(super) const OFFSET_X_MAX: u32 = 0x8020;
pub(super) const OFFSET_Y_MAX: u32 = 0x8024;
pub(super) const PIXEL_FORMAT: u32 = 0x8028;
pub(super) const PAYLOAD_SIZE: u32 = 0x802c;
pub(super) const OFFSET_STEP: u32 = 0x8030;
pub(super) const ACQUISITION_MODE: u32 = 0x8034;
pub(super) const ACQUISITION_START: u32 = 0x8038;
pub(super) const ACQUISITION_STOP: u32 = 0x803c;
pub(super) const TRIGGER_SELECTOR: u32 = 0x8040;
pub(super) const TRIGGER_MODE: u32 = 0x8044;
pub(super) const TRIGGER_SOURCE: u32 = 0x8048;
pub(super) const TRIGGER: u32 = 0x804c;
pub(super) const LOCKED: u32 = 0x8050;
pub(super) const RESET: u32 = 0x805c;
pub(super) const EXPOSURE_US: u32 = 0x8060;
pub(super) const GAIN_DB: u32 = 0x8068;
pub(super) const RATE_HZ: u32 = 0x8070;
pub(super) const RATE_MAX_HZ: u32 = 0x8078;
