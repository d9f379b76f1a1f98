//! What is not the controller that is configured, and is told by name; a wrong baud rate; silence. The daemon and `doctor
//! --identify` say the same.

use std::sync::Mutex;

use async_trait::async_trait;
use plenalign::config::{BenchConfig, ControllerConfig, ControllerDriver};
use plenalign::device::open::driver;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::supervisor::Controller;
use plenalign::device::{AxisName, DeviceError};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, duplex};

/// Leads to a stream, once.
struct Once(Mutex<Option<Wire>>);

#[async_trait]
impl Dial for Once {
    fn location(&self) -> String {
        "pipe".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let gone = || DeviceError::Disconnected { device: "pipe".to_owned(), reason: "used up".to_owned() };
        self.0.lock().unwrap().take().ok_or_else(gone)
    }
}

/// A firmware that says something when its port is opened, and something to every line.
#[derive(Debug, Clone, Copy)]
struct Stranger {
    start: &'static [u8],
    answer: &'static [u8],
}

async fn play(stranger: Stranger, mut far: DuplexStream) {
    let _ = far.write_all(stranger.start).await;
    let mut buffer = [0u8; 64];
    while let Ok(count @ 1..) = far.read(&mut buffer).await {
        for _ in buffer[..count].iter().filter(|&&byte| byte == b'\n') {
            if far.write_all(stranger.answer).await.is_err() {
                return;
            }
        }
    }
}

/// What the daemon says, and what is said where it is asked only.
async fn told(stranger: Stranger, baud: Option<u32>) -> [String; 2] {
    let config =
        ControllerConfig { driver: ControllerDriver::Grbl, port: "/dev/null".into(), baud, identity: None, address: 1 };
    let bench = BenchConfig::default();
    let setups = vec![AxisSetup::new(AxisName::Focus, &bench.focus), AxisSetup::new(AxisName::E, &bench.e)];
    let (near, far) = duplex(4096);
    tokio::spawn(play(stranger, far));
    let dial = Once(Mutex::new(Some(Box::new(near))));
    let controller = Controller::start("controller `main`", driver(&config), std::sync::Arc::new(dial), None, setups);
    let daemon = controller.first_attempt().await.unwrap_err().to_string();
    let fault = controller.stage(AxisName::E).unwrap();
    assert!(!plenalign::device::Stage::state(&fault).borrow().connected);
    let (near, far) = duplex(4096);
    tokio::spawn(play(stranger, far));
    let asked = driver(&config).identify(Box::new(near), "controller `main`").await.unwrap_err().to_string();
    [daemon, asked]
}

const MARLIN: Stranger = Stranger {
    start: b"start\r\necho:Marlin 2.1.2.5\r\necho: Last Updated: 2024-11-01 | Author: (none, default config)\r\n",
    answer: b"echo:Unknown command: \"$I\"\r\nok\r\n",
};

#[tokio::test(start_paused = true)]
async fn other_firmwares_are_told_by_name() {
    let cases = [
        (MARLIN, "Marlin", "echo:Marlin 2.1.2.5"),
        (Stranger { start: b"", ..MARLIN }, "Marlin", "echo:Unknown command"),
        (Stranger { start: b"start\n", answer: b"" }, "Marlin", "`start`"),
        (Stranger { start: b"", answer: b"// Unknown command:\"$I\"\nok\n" }, "Klipper", "// Unknown command"),
        (Stranger { start: b"Smoothie\r\nok\r\n", answer: b"ok\r\n" }, "Smoothieware", "`Smoothie`"),
        (Stranger { start: b"", answer: b"RepRapFirmware for Duet 2\nok\n" }, "RepRapFirmware", "Duet 2"),
    ];
    for (stranger, name, heard) in cases {
        let told = told(stranger, None).await;
        for words in &told {
            assert!(words.contains("expected Grbl 1.1, grblHAL, or FluidNC 3.7 to 4, found "), "{words}");
            assert!(words.contains(name) && words.contains(heard) && words.contains("cannot be driven"), "{words}");
        }
        assert_eq!(told[0], told[1], "the same words");
    }
}

/// What a UART makes of a line sent at 115200 baud when it samples at a rate below or above: bits are missed or taken twice,
/// and stop bits are met where data is.
const GARBAGE: &[u8] = b"\x00\xe6\x18\x80\xfe\x9e\x00\xf8\x06\x98\xe0\xfe\x80\x66\x1e\x00\x78\x86\xf8\x00\xfe\xe6\x98";

#[tokio::test(start_paused = true)]
async fn a_wrong_baud_rate_is_told_with_what_to_type() {
    let stranger = Stranger { start: GARBAGE, answer: GARBAGE };
    for (baud, now, right) in [(Some(9600), "9600 baud", "baud = 115200"), (None, "115200 baud", "baud = 250000")] {
        for words in told(stranger, baud).await {
            assert!(words.contains("nothing readable") && words.contains(now) && words.contains(right), "{words}");
            assert!(words.contains("in the configuration of controller `main`"), "{words}");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn silence_is_told_from_noise() {
    let [daemon, asked] = told(Stranger { start: b"", answer: b"" }, None).await;
    for (words, what) in [(daemon, "did not answer a reset"), (asked, "did not say what it is")] {
        assert!(words.contains(what) && words.contains("not a single byte") && words.contains("115200 now"), "{words}");
        assert!(["power", "cable", "`port`"].iter().all(|part| words.contains(part)), "{words}");
    }
}

/// A line whose ends are joined brings back what was sent.
#[tokio::test(start_paused = true)]
async fn an_echo_alone_is_no_controller() {
    let config = ControllerConfig {
        driver: ControllerDriver::Grbl,
        port: "/dev/null".into(),
        baud: None,
        identity: None,
        address: 1,
    };
    let (near, far) = duplex(4096);
    tokio::spawn(async move {
        let (mut from, mut to) = tokio::io::split(far);
        let _ = tokio::io::copy(&mut from, &mut to).await;
    });
    let error = driver(&config).identify(Box::new(near), "controller `main`").await.unwrap_err().to_string();
    assert!(error.contains("echo"), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_line_of_somebody_unknown_is_shown() {
    for words in told(Stranger { start: b"", answer: b"+++ out of cheese error +++\r\n" }, None).await {
        assert!(words.contains("something that says `+++ out of cheese error +++`"), "{words}");
    }
}
