//! A USB3 Vision camera for the guest's kernel, of which nothing is shared with the driver: it counts frames and shows
//! their number.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::usbip::{Device, Speed};

/// Width and height of its sensor, px.
pub(crate) const SENSOR: (u32, u32) = (320, 200);
pub(crate) const SERIAL: &str = "U3V-0042";
pub(crate) const NAME: &str = "left";

/// Endpoints: answers, commands, frames.
const ANSWERS: u8 = 1;
const FRAMES: u8 = 2;
/// Where its registers are.
const BRIDGE: u64 = 0x1_0000;
const STREAM: u64 = 0x2_0000;
const MANIFEST: u64 = 0x3_0000;
const DESCRIPTION: u64 = 0x4_0000;
const FEATURES: u64 = 0x8_0000;
const TIME: u64 = 0x1f0;
const LATCH: u64 = 0x1f8;
const STREAM_CONTROL: u64 = STREAM + 4;
const PAYLOAD: u64 = STREAM + 8;
/// Its features: each a number of four bytes, the low one first; exposure, gain and rate not whole ones.
const WIDTH: u64 = FEATURES;
const HEIGHT: u64 = FEATURES + 0x04;
const OFFSET_X: u64 = FEATURES + 0x08;
const OFFSET_Y: u64 = FEATURES + 0x0c;
const FORMAT: u64 = FEATURES + 0x10;
const EXPOSURE_US: u64 = FEATURES + 0x14;
const GAIN: u64 = FEATURES + 0x18;
const RATE_HZ: u64 = FEATURES + 0x1c;
const START: u64 = FEATURES + 0x20;
const STOP: u64 = FEATURES + 0x24;
const PAYLOAD_SIZE: u64 = FEATURES + 0x28;
const LOCKED: u64 = FEATURES + 0x2c;

const MONO8: u32 = 0x0108_0001;
const MONO12P: u32 = 0x010c_0047;

/// Bytes of a leader and of a trailer.
const LEADER: usize = 52;
const TRAILER: usize = 32;
/// So many frames wait at most until they are fetched: what comes then is lost.
const KEPT: usize = 2;
/// So many of the newest exposures are kept in mind.
const EXPOSURES: usize = 256;

fn integer(name: &str, at: u64, range: &str) -> String {
    format!(
        "<Integer Name=\"{name}\"><pValue>{name}Reg</pValue>{range}</Integer>\
         <IntReg Name=\"{name}Reg\"><Address>{at:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>"
    )
}

fn command(name: &str, at: u64) -> String {
    format!(
        "<Command Name=\"{name}\"><pValue>{name}Reg</pValue><CommandValue>1</CommandValue></Command>\
         <IntReg Name=\"{name}Reg\"><Address>{at:#x}</Address><Length>4</Length><AccessMode>WO</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>LittleEndian</Endianess></IntReg>"
    )
}

fn float(name: &str, at: u64, range: &str) -> String {
    format!(
        "<Float Name=\"{name}\"><pValue>{name}Reg</pValue>{range}</Float>\
         <FloatReg Name=\"{name}Reg\"><Address>{at:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable><Endianess>LittleEndian</Endianess></FloatReg>"
    )
}

/// What it says of itself, in GenICam's words.
fn description() -> String {
    let (width, height) = SENSOR;
    let text = |name: &str, at: u64| {
        format!(
            "<StringReg Name=\"{name}\"><Address>{at:#x}</Address><Length>64</Length><AccessMode>RO</AccessMode>\
             <pPort>Device</pPort></StringReg>"
        )
    };
    let parts = [
        text("DeviceVendorName", 0x04),
        text("DeviceModelName", 0x44),
        text("DeviceSerialNumber", 0x144),
        text("DeviceUserID", 0x184),
        integer("Width", WIDTH, &format!("<Min>16</Min><Max>{width}</Max><Inc>4</Inc>")),
        integer("Height", HEIGHT, &format!("<Min>16</Min><Max>{height}</Max>")),
        integer("OffsetX", OFFSET_X, &format!("<Min>0</Min><Max>{width}</Max>")),
        integer("OffsetY", OFFSET_Y, &format!("<Min>0</Min><Max>{height}</Max>")),
        format!(
            "<Enumeration Name=\"PixelFormat\"><EnumEntry Name=\"Mono8\"><Value>{MONO8}</Value></EnumEntry>\
             <EnumEntry Name=\"Mono12p\"><Value>{MONO12P}</Value></EnumEntry><pValue>PixelFormatNumberReg</pValue>\
             </Enumeration>{}",
            integer("PixelFormatNumber", FORMAT, "")
        ),
        float("ExposureTime", EXPOSURE_US, "<Min>10</Min><Max>100000</Max><Unit>us</Unit>"),
        float("Gain", GAIN, "<Min>0</Min><Max>24</Max><Unit>dB</Unit>"),
        float("AcquisitionFrameRate", RATE_HZ, "<Min>1</Min><Max>100</Max><Unit>Hz</Unit>"),
        "<Enumeration Name=\"AcquisitionMode\"><EnumEntry Name=\"Continuous\"><Value>0</Value></EnumEntry>\
         <Value>0</Value></Enumeration>"
            .to_owned(),
        command("AcquisitionStart", START),
        command("AcquisitionStop", STOP),
        integer("PayloadSize", PAYLOAD_SIZE, ""),
        integer("TLParamsLocked", LOCKED, ""),
    ];
    let features = [
        "DeviceVendorName",
        "DeviceModelName",
        "DeviceSerialNumber",
        "DeviceUserID",
        "Width",
        "Height",
        "OffsetX",
        "OffsetY",
        "PixelFormat",
        "ExposureTime",
        "Gain",
        "AcquisitionFrameRate",
        "AcquisitionMode",
        "AcquisitionStart",
        "AcquisitionStop",
        "PayloadSize",
        "TLParamsLocked",
    ];
    let listed: String = features.iter().map(|name| format!("<pFeature>{name}</pFeature>")).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?><RegisterDescription ModelName=\"Counter\" VendorName=\"Plenalign\" \
         StandardNameSpace=\"USB\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" \
         MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" \
         ProductGuid=\"5d2a0a1c-0f0e-4b8d-9a53-6a1e7a5b7c11\" VersionGuid=\"0b6c2c2e-8f4f-4a40-8d1c-3f0d8a3f9e12\" \
         xmlns=\"http://www.genicam.org/GenApi/Version_1_1\"><Category Name=\"Root\"><pFeature>All</pFeature></Category>\
         <Category Name=\"All\">{listed}</Category>{}<Port Name=\"Device\"/></RegisterDescription>",
        parts.concat()
    )
}

/// What goes wrong.
#[derive(Debug, Default)]
pub(crate) struct Faults {
    /// So many of the next frames end in the middle.
    pub(crate) cut: AtomicU32,
    /// So many of the next frames are not sent.
    pub(crate) skipped: AtomicU32,
    /// The endpoint of the frames stalls, so often.
    pub(crate) stalls: AtomicU32,
    /// No frames are sent.
    pub(crate) silent: AtomicBool,
    /// Nothing is answered.
    pub(crate) deaf: AtomicBool,
    /// How long after their exposure began frames are sent, ms.
    pub(crate) late_ms: AtomicU32,
}

/// Whether one of so many is left, which it then takes.
fn taken(left: &AtomicU32) -> bool {
    left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1)).is_ok()
}

/// Bytes that are sent in one transfer, with whether it is a frame's last.
type Transfer = (Vec<u8>, bool);

struct State {
    /// Memory in parts, with where each begins.
    memory: Vec<(u64, Vec<u8>)>,
    answers: VecDeque<Vec<u8>>,
    /// Those of frames that wait to be fetched.
    transfers: VecDeque<Transfer>,
    /// Those of frames that are not sent before that moment, the oldest first.
    later: VecDeque<(Instant, [Transfer; 3])>,
    acquiring: bool,
    frames: u64,
    /// The frames whole, with when their exposure began, the oldest first.
    exposures: VecDeque<(u64, Instant)>,
}

/// The camera.
pub(crate) struct Camera {
    state: Mutex<State>,
    pub(crate) faults: Faults,
    speed: Speed,
    began: Instant,
    ended: AtomicBool,
}

/// The camera with its clockwork, which runs until this is dropped.
pub(crate) struct Running {
    pub(crate) camera: Arc<Camera>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    pub(crate) fn start(speed: Speed) -> Self {
        let camera = Arc::new(Camera {
            state: Mutex::new(State::new(speed)),
            faults: Faults::default(),
            speed,
            began: Instant::now(),
            ended: AtomicBool::new(false),
        });
        let runs = Arc::clone(&camera);
        let thread = std::thread::spawn(move || {
            let mut due = Instant::now();
            while !runs.ended.load(Ordering::SeqCst) {
                let rate_hz = runs.expose();
                due = (due + Duration::from_secs_f64(1.0 / rate_hz)).max(Instant::now());
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        });
        Self { camera, thread: Some(thread) }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.camera.ended.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl State {
    fn new(speed: Speed) -> Self {
        let xml = description().into_bytes();
        let length = xml.len() as u64;
        let memory = vec![
            (0, vec![0; 0x210]),
            (BRIDGE, vec![0; 0x48]),
            (STREAM, vec![0; 0x30]),
            (MANIFEST, vec![0; 8 + 64]),
            (DESCRIPTION, xml),
            (FEATURES, vec![0; 0x40]),
        ];
        let mut state = Self {
            memory,
            answers: VecDeque::new(),
            transfers: VecDeque::new(),
            later: VecDeque::new(),
            acquiring: false,
            frames: 0,
            exposures: VecDeque::new(),
        };
        let texts = [(0x04, "Plenalign"), (0x44, "Counter"), (0xc4, "1"), (0x144, SERIAL), (0x184, NAME)];
        for (at, text) in texts {
            state.put(at, text.as_bytes());
        }
        let words = [
            (0x00, 0x0001_0002),
            (0x1cc, 100),
            (BRIDGE, 0x0001_0000),
            (BRIDGE + 0x14, 512),
            (BRIDGE + 0x18, 512),
            (BRIDGE + 0x1c, 1),
            (BRIDGE + 0x28, 0x30),
            (BRIDGE + 0x40, if speed == Speed::Super { 8 } else { 4 }),
            (STREAM + 0x10, LEADER as u32),
            (STREAM + 0x14, TRAILER as u32),
            // A GenICam description, version 1.1, as it is.
            (MANIFEST + 8, 0x0001_0000),
            (MANIFEST + 12, 0x0101_0000),
            (WIDTH, SENSOR.0),
            (HEIGHT, SENSOR.1),
            (FORMAT, MONO8),
            (EXPOSURE_US, 5000_f32.to_bits()),
            (RATE_HZ, 10_f32.to_bits()),
        ];
        for (at, value) in words {
            state.put(at, &value.to_le_bytes());
        }
        // A user's name, a clock, registers of USB3 Vision; a stream.
        let longs = [
            (0x1c4, 1 << 9 | 1 << 3 | 1),
            (0x1d0, MANIFEST),
            (0x1d8, BRIDGE),
            (0x1fc, 1),
            (BRIDGE + 4, 1),
            (BRIDGE + 0x20, STREAM),
            (MANIFEST, 1),
            (MANIFEST + 16, DESCRIPTION),
            (MANIFEST + 24, length),
        ];
        for (at, value) in longs {
            state.put(at, &u64::to_le_bytes(value));
        }
        state.follow();
        state
    }

    fn place(&mut self, at: u64, count: usize) -> Option<&mut [u8]> {
        let part = self
            .memory
            .iter_mut()
            .find(|(begin, bytes)| at.checked_sub(*begin).is_some_and(|from| from as usize + count <= bytes.len()));
        part.map(|(begin, bytes)| &mut bytes[(at - *begin) as usize..][..count])
    }

    fn put(&mut self, at: u64, bytes: &[u8]) {
        self.place(at, bytes.len()).unwrap().copy_from_slice(bytes);
    }

    fn word(&mut self, at: u64) -> u32 {
        u32::from_le_bytes(self.place(at, 4).unwrap().try_into().unwrap())
    }

    /// Has what is due by now sent.
    fn send_due(&mut self) {
        let now = Instant::now();
        while let Some((_, transfers)) = self.later.pop_front_if(|(due, _)| *due <= now) {
            self.transfers.extend(transfers);
        }
    }

    /// Forgets the frames that are not sent yet.
    fn clear(&mut self) {
        self.transfers.clear();
        self.later.clear();
    }

    /// Sets what follows from other registers.
    fn follow(&mut self) {
        let pixels = self.word(WIDTH) * self.word(HEIGHT);
        let bytes = if self.word(FORMAT) == MONO12P { pixels * 3 / 2 } else { pixels };
        self.put(PAYLOAD_SIZE, &bytes.to_le_bytes());
        self.put(PAYLOAD, &u64::from(bytes).to_le_bytes());
    }

    /// Sets memory; the status of it.
    fn write(&mut self, at: u64, bytes: &[u8], now_ns: u64) -> u16 {
        const WRITE_PROTECTED: u16 = 0x8004;
        if self.place(at, bytes.len()).is_none() {
            return 0x8003;
        }
        match at {
            LATCH => self.put(TIME, &now_ns.to_le_bytes()),
            START => self.acquiring = true,
            STOP => self.acquiring = false,
            STREAM_CONTROL => {
                self.clear();
                self.put(at, bytes);
            }
            _ if at >= FEATURES || (STREAM + 0x18..MANIFEST).contains(&at) => self.put(at, bytes),
            _ => return WRITE_PROTECTED,
        }
        self.follow();
        0
    }
}

impl Camera {
    /// The frames that were taken, with when their exposure began.
    pub(crate) fn exposures(&self) -> Vec<(u64, Instant)> {
        self.state.lock().unwrap().exposures.iter().copied().collect()
    }

    /// The bytes of a frame that shows its number: each sample is that of its place and of the number.
    pub(crate) fn sample(number: u64, x: usize, y: usize, white: u16) -> u16 {
        ((number as usize * 7 + x + 3 * y) % (usize::from(white) + 1)) as u16
    }

    fn ns(&self, at: Instant) -> u64 {
        at.saturating_duration_since(self.began).as_nanos() as u64
    }

    /// Takes a frame, where one is to be taken; how many a second are.
    fn expose(&self) -> f64 {
        let exposed = Instant::now();
        let mut state = self.state.lock().unwrap();
        let rate_hz = f64::from(f32::from_bits(state.word(RATE_HZ)).clamp(1.0, 100.0));
        let enabled = state.word(STREAM_CONTROL) & 1 != 0;
        if !state.acquiring || !enabled || self.faults.silent.load(Ordering::SeqCst) {
            return rate_hz;
        }
        state.frames += 1;
        let number = state.frames;
        let (width, height, format) = (state.word(WIDTH), state.word(HEIGHT), state.word(FORMAT));
        let waiting = state.transfers.iter().filter(|(_, last)| *last).count();
        if taken(&self.faults.skipped) || waiting >= KEPT {
            return rate_hz;
        }
        let cut = taken(&self.faults.cut);
        let mut bytes = pixels(number, width as usize, height as usize, format == MONO12P);
        let whole = bytes.len();
        let mut leader = b"U3VL\0\0".to_vec();
        leader.extend((LEADER as u16).to_le_bytes());
        leader.extend(number.to_le_bytes());
        leader.extend([0, 0, 1, 0]);
        leader.extend(self.ns(exposed).to_le_bytes());
        for value in [format, width, height, state.word(OFFSET_X), state.word(OFFSET_Y), 0] {
            leader.extend(value.to_le_bytes());
        }
        if cut {
            bytes.truncate(whole / 2 + 1);
        } else {
            state.exposures.push_back((number, exposed));
            if state.exposures.len() > EXPOSURES {
                state.exposures.pop_front();
            }
        }
        let mut trailer = b"U3VT\0\0".to_vec();
        trailer.extend((TRAILER as u16).to_le_bytes());
        trailer.extend(number.to_le_bytes());
        // Data was overrun.
        trailer.extend([if cut { 0xa101u16 } else { 0 }, 0].iter().flat_map(|word| word.to_le_bytes()));
        trailer.extend((bytes.len() as u64).to_le_bytes());
        trailer.extend(height.to_le_bytes());
        let late = Duration::from_millis(self.faults.late_ms.load(Ordering::SeqCst).into());
        state.later.push_back((exposed + late, [(leader, false), (bytes, false), (trailer, true)]));
        state.send_due();
        rate_hz
    }

    /// Does a command and answers it.
    fn obey(&self, bytes: &[u8]) -> Vec<u8> {
        let half = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap());
        let (command, number) = (half(6), half(10));
        let at = u64::from_le_bytes(bytes[12..20].try_into().unwrap());
        let now_ns = self.ns(Instant::now());
        let mut state = self.state.lock().unwrap();
        let (status, answer) = match command {
            0x0800 => match state.place(at, usize::from(half(22))) {
                Some(bytes) => (0, bytes.to_vec()),
                None => (0x8003, Vec::new()),
            },
            0x0802 => {
                let status = state.write(at, &bytes[20..], now_ns);
                let written = if status == 0 { bytes.len() - 20 } else { 0 };
                (status, [[0, 0], (written as u16).to_le_bytes()].concat())
            }
            _ => (0x8001, Vec::new()),
        };
        let mut packet = b"U3VC".to_vec();
        for value in [status, command + 1, answer.len() as u16, number] {
            packet.extend(value.to_le_bytes());
        }
        packet.extend(answer);
        packet
    }
}

fn pixels(number: u64, width: usize, height: usize, packed: bool) -> Vec<u8> {
    let white = if packed { 4095 } else { 255 };
    let samples = (0..height).flat_map(|y| (0..width).map(move |x| Camera::sample(number, x, y, white)));
    if !packed {
        return samples.map(|sample| sample as u8).collect();
    }
    let samples: Vec<u16> = samples.collect();
    let pair = |pair: &[u16]| {
        let both = u32::from(pair[0]) | u32::from(pair[1]) << 12;
        [both as u8, (both >> 8) as u8, (both >> 16) as u8]
    };
    samples.chunks(2).flat_map(pair).collect()
}

impl Device for Camera {
    fn descriptor(&self, kind: u8, index: u8) -> Option<Vec<u8>> {
        let fast = self.speed == Speed::Super;
        let packet: u16 = if fast { 1024 } else { 512 };
        match kind {
            // A device of several interfaces, of a vendor's number that is free for tests.
            1 => {
                let [version, packet] = if fast { [3, 9] } else { [2, 64] };
                Some(vec![18, 1, 0, version, 0xef, 2, 1, packet, 0x09, 0x12, 1, 0, 0, 1, 1, 2, 3, 1])
            }
            2 => {
                let endpoint = |address: u8| {
                    let [low, high] = packet.to_le_bytes();
                    let mut endpoint = vec![7, 5, address, 2, low, high, 0];
                    if fast {
                        endpoint.extend([6, 0x30, 0, 0, 0, 0]);
                    }
                    endpoint
                };
                let interface = |number, endpoints, protocol| vec![9, 4, number, 0, endpoints, 0xef, 5, protocol, 0];
                // Which versions it is of, and the texts that say who it is.
                let mut about = vec![20, 0x24, 1, 2, 0, 1, 0, 0, 0, 1, 0];
                about.extend([4, 1, 2, 0, 5, 0, 3, 0, 0x0c]);
                let body = [
                    vec![8, 11, 0, 2, 0xef, 5, 0, 0],
                    interface(0, 2, 0),
                    about,
                    endpoint(0x80 | ANSWERS),
                    endpoint(ANSWERS),
                    interface(1, 1, 2),
                    endpoint(0x80 | FRAMES),
                ]
                .concat();
                let [low, high] = (9 + body.len() as u16).to_le_bytes();
                Some([vec![9, 2, low, high, 2, 1, 0, 0x80, 50], body].concat())
            }
            3 if index == 0 => Some(vec![4, 3, 9, 4]),
            3 => {
                let texts = ["Plenalign", "Counter", SERIAL, "120900000042", "1"];
                let text = texts.get(usize::from(index) - 1)?;
                let mut bytes = vec![2 + 2 * text.len() as u8, 3];
                bytes.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
                Some(bytes)
            }
            15 if fast => Some(vec![5, 15, 22, 0, 2, 7, 16, 2, 2, 0, 0, 0, 10, 16, 3, 0, 0x0e, 0, 3, 0, 0, 0]),
            _ => None,
        }
    }

    fn take(&self, _: u8, bytes: &[u8]) {
        if bytes.len() < 20 || self.faults.deaf.load(Ordering::SeqCst) {
            return;
        }
        let answer = self.obey(bytes);
        self.state.lock().unwrap().answers.push_back(answer);
    }

    fn give(&self, endpoint: u8, most: usize) -> Option<Result<Vec<u8>, ()>> {
        let mut state = self.state.lock().unwrap();
        if endpoint == ANSWERS {
            return state.answers.pop_front().map(Ok);
        }
        state.send_due();
        if !state.transfers.is_empty() && taken(&self.faults.stalls) {
            return Some(Err(()));
        }
        let (mut bytes, last) = state.transfers.pop_front()?;
        if bytes.len() > most {
            let rest = bytes.split_off(most);
            state.transfers.push_front((rest, last));
        }
        Some(Ok(bytes))
    }

    fn reset(&self, endpoint: u8) {
        if endpoint == FRAMES {
            self.state.lock().unwrap().clear();
        }
    }
}
