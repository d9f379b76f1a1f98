//! The camera's registers: those that every GigE Vision device has at their places, and its own features' behind them.

use std::net::Ipv4Addr;

use super::addresses::{
    ACQUISITION_MODE, ACQUISITION_START, ACQUISITION_STOP, BOOTSTRAP, DESCRIPTION, EXPOSURE_US, FEATURES, GAIN_DB,
    HEARTBEAT, HEIGHT, HEIGHT_MAX, LOCKED, OFFSET_STEP, OFFSET_X, OFFSET_X_MAX, OFFSET_Y, OFFSET_Y_MAX, PACKET_DELAY,
    PACKET_SIZE, PAYLOAD_SIZE, PIXEL_FORMAT, PRIMARY_ADDRESS, PRIMARY_PORT, PRIVILEGE, RATE_HZ, RATE_MAX_HZ, RESET,
    SENSOR_HEIGHT, SENSOR_WIDTH, STREAM_ADDRESS, STREAM_PORT, STREAM_SOURCE_PORT, TICKS_A_SECOND, TIMESTAMP,
    TIMESTAMP_CONTROL, TRIGGER, TRIGGER_MODE, TRIGGER_SELECTOR, TRIGGER_SOURCE, USER_NAME, WIDTH, WIDTH_MAX,
};
use super::description::Description;
use super::format::Region;
use super::network::Interface;
use super::settings::{Destination, Effect, Identity, Settings};
use super::wire::Refusal;

/// Least side of a region, px.
const LEAST_SIDE: u32 = 16;
/// Exposures, µs, gains, dB, and rates, Hz, that can be set, as the description has them.
const EXPOSURES_US: (f64, f64) = (100.0, 100_000.0);
const GAINS_DB: (f64, f64) = (0.0, 24.0);
const RATES_HZ: (f64, f64) = (0.01, 1000.0);
/// Sizes of packets, headers and all.
const PACKET_BYTES: (u32, u32) = (256, 9000);
/// Heartbeats, ms.
const HEARTBEATS_MS: (u32, u32) = (500, 600_000);
/// The bits of the packet size's register that have a test packet sent, and packets not be cut up on the way.
const FIRE_TEST_PACKET: u32 = 1 << 31;
const DO_NOT_FRAGMENT: u32 = 1 << 30;
/// Users' names, serial numbers, resends, writing memory, several registers at once; and the primary application's address.
const ABILITIES: u32 = 1 << 31 | 1 << 30 | 1 << 2 | 1 << 1 | 1;
const NAMES_CONTROLLER: u32 = 1 << 27;

/// The camera's memory.
#[derive(Debug)]
pub(super) struct Registers {
    identity: Identity,
    bootstrap: Vec<u8>,
    features: Vec<u8>,
    description: Vec<u8>,
    /// Whether frames are being taken, which keeps their size and format from being set.
    pub(super) acquiring: bool,
}

impl Registers {
    /// The registers of a camera that has just been switched on.
    pub(super) fn new(identity: Identity, interface: &Interface) -> Self {
        let description = Description::of(&identity).bytes();
        let mut registers = Self {
            bootstrap: vec![0; BOOTSTRAP.len()],
            features: vec![0; FEATURES.len()],
            description,
            acquiring: false,
            identity,
        };
        registers.set_bootstrap(interface);
        registers.set_features();
        registers
    }

    fn set_bootstrap(&mut self, interface: &Interface) {
        let (high, low) = interface.mac.split_at(2);
        let word = |bytes: &[u8]| bytes.iter().fold(0, |word, &byte| word << 8 | u32::from(byte));
        let (address, mask) = (u32::from(interface.address), u32::from(interface.mask));
        let ticks = self.identity.ticks_a_second;
        let abilities = ABILITIES | if self.identity.names_controller { NAMES_CONTROLLER } else { 0 };
        // Version 1.2, big-endian with texts in UTF-8, one interface, whose address can be set in no other way than here.
        for (at, value) in [
            (0x0000, 0x0001_0002),
            (0x0004, 0x8000_0001),
            (0x0008, word(high)),
            (0x000c, word(low)),
            (0x0010, 0x4),
            (0x0014, 0x4),
            (0x0024, address),
            (0x0034, mask),
            (0x0600, 1),
            (0x0900, 0),
            (0x0904, 1),
            (0x0934, abilities),
            (HEARTBEAT, 3000),
            (TICKS_A_SECOND, (ticks >> 32) as u32),
            (TICKS_A_SECOND + 4, (ticks & 0xffff_ffff) as u32),
            (PACKET_SIZE, DO_NOT_FRAGMENT | 1500),
        ] {
            self.put(at, &value.to_be_bytes());
        }
        let url = format!("Local:plenalign-simulated.xml;{DESCRIPTION:x};{:x}", self.description.len());
        let (serial, user_name) = (self.identity.serial.clone(), self.identity.user_name.clone());
        for (at, room, text) in [
            (0x0048, 32, "Plenalign"),
            (0x0068, 32, "SimulatedCamera"),
            (0x0088, 32, env!("CARGO_PKG_VERSION")),
            (0x00a8, 48, "SIMULATED: it renders what it sees"),
            (0x00d8, 16, &serial),
            (USER_NAME.start, USER_NAME.len(), &user_name),
            (0x0200, 512, &url),
        ] {
            // The last byte stays 0, where the text ends.
            let length = text.floor_char_boundary(room - 1);
            self.put(at, &text.as_bytes()[..length]);
        }
    }

    fn set_features(&mut self) {
        let [width, height] = self.identity.sensor;
        for (at, value) in [
            (SENSOR_WIDTH, width),
            (SENSOR_HEIGHT, height),
            (WIDTH, width),
            (HEIGHT, height),
            (PIXEL_FORMAT, self.identity.formats[0].code),
            (OFFSET_STEP, self.identity.offset_step),
        ] {
            self.put(at, &value.to_be_bytes());
        }
        for (at, value) in [(EXPOSURE_US, 10_000.0_f64), (GAIN_DB, 0.0), (RATE_HZ, 10.0)] {
            self.put(at, &value.to_be_bytes());
        }
        self.follow();
    }

    /// Where bytes lie, and in what.
    fn place(&self, at: u32, count: usize) -> Option<(&[u8], usize)> {
        let parts = [(0, &self.bootstrap), (FEATURES.start, &self.features), (DESCRIPTION, &self.description)];
        let fits = |&(start, bytes): &(u32, &Vec<u8>)| {
            at.checked_sub(start).is_some_and(|from| from as usize + count <= bytes.len())
        };
        parts.into_iter().find(fits).map(|(start, bytes)| (bytes.as_slice(), (at - start) as usize))
    }

    /// Bytes of memory.
    pub(super) fn bytes(&self, at: u32, count: usize) -> Result<&[u8], Refusal> {
        if !at.is_multiple_of(4) || !count.is_multiple_of(4) {
            return Err(Refusal::BAD_ALIGNMENT);
        }
        let (bytes, from) = self.place(at, count).ok_or(Refusal::INVALID_ADDRESS)?;
        Ok(&bytes[from..from + count])
    }

    /// A register's value.
    pub(super) fn word(&self, at: u32) -> Result<u32, Refusal> {
        Ok(self.bytes(at, 4)?.iter().fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }

    /// A register that is known to be there.
    fn own(&self, at: u32) -> u32 {
        self.word(at).unwrap_or(0)
    }

    fn float(&self, at: u32) -> f64 {
        self.bytes(at, 8).ok().and_then(|bytes| bytes.try_into().ok()).map_or(0.0, f64::from_be_bytes)
    }

    fn put(&mut self, at: u32, bytes: &[u8]) {
        let (part, start) =
            if at < FEATURES.start { (&mut self.bootstrap, 0) } else { (&mut self.features, FEATURES.start) };
        let from = (at - start) as usize;
        part[from..from + bytes.len()].copy_from_slice(bytes);
    }

    fn put_word(&mut self, at: u32, value: u32) {
        self.put(at, &value.to_be_bytes());
    }

    /// Sets what follows from other registers.
    fn follow(&mut self) {
        let [width, height] = self.identity.sensor;
        let (left, top) = (self.own(OFFSET_X), self.own(OFFSET_Y));
        self.put_word(WIDTH_MAX, width - left);
        self.put_word(HEIGHT_MAX, height - top);
        self.put_word(OFFSET_X_MAX, width - self.own(WIDTH));
        self.put_word(OFFSET_Y_MAX, height - self.own(HEIGHT));
        let settings = self.settings();
        let bytes = settings.format.bytes(settings.region.width * settings.region.height);
        self.put_word(PAYLOAD_SIZE, u32::try_from(bytes).unwrap_or(u32::MAX));
        let most = RATES_HZ.1.min(1e6 / settings.exposure_us);
        self.put(RATE_MAX_HZ, &most.to_be_bytes());
        self.put(RATE_HZ, &settings.rate_hz.min(most).to_be_bytes());
    }

    /// How frames are taken.
    pub(super) fn settings(&self) -> Settings {
        let [left, top, width, height] = [OFFSET_X, OFFSET_Y, WIDTH, HEIGHT].map(|at| self.own(at) as usize);
        let code = self.own(PIXEL_FORMAT);
        let formats = self.identity.formats;
        Settings {
            region: Region { left, top, width, height },
            format: formats.iter().find(|format| format.code == code).copied().unwrap_or(formats[0]),
            exposure_us: self.float(EXPOSURE_US),
            gain_db: self.float(GAIN_DB),
            rate_hz: self.float(RATE_HZ),
            triggered: self.own(TRIGGER_MODE) != 0,
            single: self.own(ACQUISITION_MODE) != 0,
        }
    }

    /// Where frames go; `None` where nobody has said.
    pub(super) fn destination(&self) -> Option<Destination> {
        let address = Ipv4Addr::from(self.own(STREAM_ADDRESS));
        let port = (self.own(STREAM_PORT) & 0xffff) as u16;
        let size = self.own(PACKET_SIZE);
        (port != 0 && !address.is_unspecified()).then_some(Destination {
            address,
            port,
            packet_bytes: (size & 0xffff) as usize,
            whole: size & DO_NOT_FRAGMENT != 0,
            delay_ticks: self.own(PACKET_DELAY),
        })
    }

    /// After how long without a word of whoever has control nobody has it any more, ms.
    pub(super) fn heartbeat_ms(&self) -> u64 {
        self.own(HEARTBEAT).into()
    }

    /// What the clock read.
    pub(super) fn set_timestamp(&mut self, ticks: u64) {
        self.put(TIMESTAMP, &ticks.to_be_bytes());
    }

    /// From which port frames come.
    pub(super) fn set_source_port(&mut self, port: u16) {
        self.put_word(STREAM_SOURCE_PORT, port.into());
    }

    /// Who has control, and how: nobody where the privilege is 0.
    pub(super) fn set_control(&mut self, privilege: u32, owner: Option<(Ipv4Addr, u16)>) {
        self.put_word(PRIVILEGE, privilege);
        let named = owner.filter(|_| self.identity.names_controller);
        let (address, port) = named.map_or((0, 0), |(address, port)| (u32::from(address), u32::from(port)));
        self.put_word(PRIMARY_PORT, port);
        self.put_word(PRIMARY_ADDRESS, address);
        if owner.is_none() {
            self.put_word(STREAM_PORT, 0);
            self.put_word(LOCKED, 0);
        }
    }

    /// Sets memory, whole registers each; those before one that is refused stay set.
    pub(super) fn write_bytes(&mut self, at: u32, bytes: &[u8]) -> Result<Vec<Effect>, Refusal> {
        if !at.is_multiple_of(4) || !bytes.len().is_multiple_of(4) {
            return Err(Refusal::BAD_ALIGNMENT);
        }
        if USER_NAME.contains(&at) && bytes.len() <= (USER_NAME.end - at) as usize {
            self.put(at, bytes);
            // The last byte stays 0, where the text ends.
            self.put(USER_NAME.end - 1, &[0]);
            return Ok(Vec::new());
        }
        if let Ok(float) = bytes.try_into() {
            let range = match at {
                EXPOSURE_US => Some(EXPOSURES_US),
                GAIN_DB => Some(GAINS_DB),
                RATE_HZ => Some((RATES_HZ.0, self.float(RATE_MAX_HZ))),
                _ => None,
            };
            if let Some((least, most)) = range {
                return self.write_float(at, f64::from_be_bytes(float), least, most).map(|()| Vec::new());
            }
        }
        let words = bytes.as_chunks().0.iter().map(|bytes| u32::from_be_bytes(*bytes));
        (at..).step_by(4).zip(words).filter_map(|(at, value)| self.write(at, value).transpose()).collect()
    }

    fn write_float(&mut self, at: u32, value: f64, least: f64, most: f64) -> Result<(), Refusal> {
        if !(least..=most).contains(&value) {
            return Err(Refusal::INVALID_PARAMETER);
        }
        self.put(at, &value.to_be_bytes());
        self.follow();
        Ok(())
    }

    /// Sets a register. Who may is not asked here, nor is who has control set.
    pub(super) fn write(&mut self, at: u32, value: u32) -> Result<Option<Effect>, Refusal> {
        let known = self.place(at, 4).is_some();
        let value = match at {
            ACQUISITION_START => return Ok((value == 1).then_some(Effect::Start)),
            ACQUISITION_STOP => return Ok((value == 1).then_some(Effect::Stop)),
            TRIGGER => return Ok((value == 1).then_some(Effect::Trigger)),
            RESET => return Ok((value == 1).then_some(Effect::Reset)),
            TIMESTAMP_CONTROL if value & 1 != 0 => return Ok(Some(Effect::ResetClock)),
            TIMESTAMP_CONTROL => return Ok((value & 2 != 0).then_some(Effect::Latch)),
            HEARTBEAT => value.clamp(HEARTBEATS_MS.0, HEARTBEATS_MS.1),
            STREAM_PORT if value & 0xffff == 0 => {
                self.put_word(at, 0);
                return Ok(Some(Effect::Stop));
            }
            PACKET_SIZE => return self.write_packet_size(value),
            STREAM_PORT | PACKET_DELAY | STREAM_ADDRESS => value,
            WIDTH | HEIGHT | OFFSET_X | OFFSET_Y | PIXEL_FORMAT if self.acquiring => return Err(Refusal::BUSY),
            WIDTH => Self::within(value, LEAST_SIDE, self.own(WIDTH_MAX))?,
            HEIGHT => Self::within(value, LEAST_SIDE, self.own(HEIGHT_MAX))?,
            OFFSET_X => self.stepped(value, self.own(OFFSET_X_MAX))?,
            OFFSET_Y => self.stepped(value, self.own(OFFSET_Y_MAX))?,
            PIXEL_FORMAT if self.identity.formats.iter().any(|format| format.code == value) => value,
            ACQUISITION_MODE | TRIGGER_MODE | LOCKED => Self::within(value, 0, 1)?,
            TRIGGER_SELECTOR | TRIGGER_SOURCE => Self::within(value, 0, 0)?,
            PIXEL_FORMAT => return Err(Refusal::INVALID_PARAMETER),
            _ if known => return Err(Refusal::WRITE_PROTECTED),
            _ => return Err(Refusal::INVALID_ADDRESS),
        };
        self.put_word(at, value);
        self.follow();
        Ok(None)
    }

    /// Sets the nearest size that there is. No packet is sent to try another than was asked for.
    fn write_packet_size(&mut self, value: u32) -> Result<Option<Effect>, Refusal> {
        let wanted = value & 0xffff;
        let bytes = wanted.clamp(PACKET_BYTES.0, PACKET_BYTES.1);
        let bytes = bytes - bytes % 4;
        self.put_word(PACKET_SIZE, value & DO_NOT_FRAGMENT | bytes);
        Ok((value & FIRE_TEST_PACKET != 0 && bytes == wanted).then_some(Effect::TestPacket))
    }

    fn within(value: u32, least: u32, most: u32) -> Result<u32, Refusal> {
        if (least..=most).contains(&value) { Ok(value) } else { Err(Refusal::INVALID_PARAMETER) }
    }

    fn stepped(&self, value: u32, most: u32) -> Result<u32, Refusal> {
        let value = Self::within(value, 0, most)?;
        if value.is_multiple_of(self.identity.offset_step) { Ok(value) } else { Err(Refusal::INVALID_PARAMETER) }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::addresses::IDENTITY;
    use super::super::format::Format;
    use super::*;

    /// A camera of 120 by 90 pixels.
    pub(in super::super) fn identity() -> Identity {
        Identity {
            serial: "T-1".to_owned(),
            user_name: String::new(),
            ticks_a_second: 1_000_000_000,
            sensor: [120, 90],
            formats: Format::offered(None),
            offset_step: 1,
            names_controller: true,
        }
    }

    fn registers() -> Registers {
        let mask = Ipv4Addr::new(255, 0, 0, 0);
        let interface =
            Interface { name: "lo".to_owned(), address: Ipv4Addr::LOCALHOST, mask, broadcast: None, mac: [2; 6] };
        Registers::new(identity(), &interface)
    }

    #[test]
    fn the_first_registers_say_who_it_is_and_where_its_description_lies() {
        let registers = registers();
        let identity = registers.bytes(IDENTITY.start, IDENTITY.len()).unwrap();
        assert_eq!(identity[..16], [0, 1, 0, 2, 0x80, 0, 0, 1, 0, 0, 2, 2, 2, 2, 2, 2]);
        assert_eq!(identity[0x24..0x28], [127, 0, 0, 1]);
        assert!(identity[0x48..].starts_with(b"Plenalign\0") && identity[0xd8..].starts_with(b"T-1\0"));
        let url = registers.bytes(0x200, 512).unwrap();
        let url = std::str::from_utf8(url).unwrap().trim_end_matches('\0');
        let [at, length] = url.rsplit_once(".xml;").unwrap().1.split_once(';').map(|(a, b)| [a, b]).unwrap();
        let [at, length] = [at, length].map(|hex| u32::from_str_radix(hex, 16).unwrap());
        let description = registers.bytes(at, length as usize).unwrap();
        assert!(description.starts_with(b"<?xml"));
    }

    #[test]
    fn a_region_stays_on_the_sensor() {
        let mut registers = registers();
        assert_eq!(registers.write(OFFSET_X, 4), Err(Refusal::INVALID_PARAMETER));
        assert_eq!(registers.write(WIDTH, 100), Ok(None));
        assert_eq!(registers.write(OFFSET_X, 20), Ok(None));
        assert_eq!((registers.own(WIDTH_MAX), registers.own(OFFSET_X_MAX)), (100, 20));
        assert_eq!(registers.write(WIDTH, 101), Err(Refusal::INVALID_PARAMETER));
        assert_eq!(registers.own(PAYLOAD_SIZE), 100 * 90);
        assert_eq!(registers.write(PIXEL_FORMAT, Format::offered(None)[4].code), Ok(None));
        assert_eq!(registers.own(PAYLOAD_SIZE), 100 * 90 * 3 / 2);
        registers.acquiring = true;
        assert_eq!(registers.write(WIDTH, 90), Err(Refusal::BUSY));
    }

    #[test]
    fn a_long_exposure_lowers_the_rate() {
        let mut registers = registers();
        assert_eq!(registers.write_bytes(RATE_HZ, &90.0_f64.to_be_bytes()), Ok(vec![]));
        assert_eq!(registers.write_bytes(EXPOSURE_US, &50_000.0_f64.to_be_bytes()), Ok(vec![]));
        assert_eq!(registers.settings().rate_hz, 20.0);
        assert_eq!(registers.write_bytes(RATE_HZ, &20.1_f64.to_be_bytes()), Err(Refusal::INVALID_PARAMETER));
        assert_eq!(registers.write_bytes(EXPOSURE_US, &f64::NAN.to_be_bytes()), Err(Refusal::INVALID_PARAMETER));
    }

    #[test]
    fn what_cannot_be_written_or_read_is_refused_by_its_code() {
        let mut registers = registers();
        assert_eq!(registers.write(0, 5), Err(Refusal::WRITE_PROTECTED));
        assert_eq!(registers.write(0x7000, 5), Err(Refusal::INVALID_ADDRESS));
        assert_eq!(registers.bytes(2, 4), Err(Refusal::BAD_ALIGNMENT));
        assert_eq!(registers.bytes(0x7000, 4), Err(Refusal::INVALID_ADDRESS));
        assert_eq!(registers.bytes(u32::MAX - 3, 536), Err(Refusal::INVALID_ADDRESS));
        assert_eq!(registers.write(PACKET_SIZE, FIRE_TEST_PACKET | 1500), Ok(Some(Effect::TestPacket)));
        assert_eq!(registers.write(PACKET_SIZE, FIRE_TEST_PACKET | 60_000), Ok(None));
        assert_eq!(registers.own(PACKET_SIZE), 9000);
        assert_eq!(registers.write_bytes(USER_NAME.start, b"sixteen letters!"), Ok(vec![]));
        assert_eq!(registers.bytes(USER_NAME.start, 16).unwrap(), b"sixteen letters\0");
    }
}
