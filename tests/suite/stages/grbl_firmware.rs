//! The Grbl twin against what was measured on Grbl 1.1h in a simulated ATmega328P: bytes in, bytes and motion out.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{AxisConfig, BenchConfig};
use plenalign::sim::plant::Slides;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM};
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::{Instant, timeout_at};

use super::super::until::{elapse, until};

/// A twin as a stock build, its slides, and its wire.
fn firmware(start: [f64; 2]) -> (Arc<Slides>, DuplexStream) {
    let bench = BenchConfig::default();
    let axes: [(&AxisConfig, f64); 2] = [(&bench.focus, start[0]), (&bench.e, start[1])];
    let slides = Slides::new(&axes);
    let mut config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    config.single_axis_homing = false;
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let (near, far) = tokio::io::duplex(1024);
    tokio::spawn(async move { twin.serve(far).await });
    (slides, near)
}

/// Every line that comes within a time, with the milliseconds until it came.
async fn heard(wire: &mut DuplexStream, within: Duration) -> Vec<(u64, String)> {
    let (began, mut text, mut lines) = (Instant::now(), Vec::new(), Vec::new());
    let mut buffer = [0u8; 256];
    while let Ok(Ok(count @ 1..)) = timeout_at(began + within, wire.read(&mut buffer)).await {
        text.extend_from_slice(&buffer[..count]);
        while let Some(end) = text.iter().position(|&byte| byte == b'\n') {
            let line: Vec<u8> = text.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            if !line.is_empty() {
                lines.push((began.elapsed().as_millis() as u64, line));
            }
        }
    }
    lines
}

async fn told(wire: &mut DuplexStream, bytes: &[u8], within: Duration) -> Vec<(u64, String)> {
    wire.write_all(bytes).await.unwrap();
    heard(wire, within).await
}

fn words(lines: &[(u64, String)]) -> Vec<&str> {
    lines.iter().map(|(_, line)| line.as_str()).collect()
}

const LONG: Duration = Duration::from_secs(60);
const BANNER: &str = "Grbl 1.1h ['$' for help]";
const LOCKED: &str = "[MSG:'$H'|'$X' to unlock]";

#[tokio::test(start_paused = true)]
async fn homing_from_a_far_switch_goes_on_away_from_home() {
    let (slides, mut wire) = firmware([1.3, -6.3]);
    heard(&mut wire, Duration::from_millis(10)).await;
    for tries in 1..3 {
        let lines = told(&mut wire, b"$H\n", LONG).await;
        assert_eq!(words(&lines), ["ALARM:8", "ok", BANNER, "[MSG:Check Limits]", LOCKED]);
        // 499 ms after the alarm on the chip.
        assert!((490..=510).contains(&(lines[1].0 - lines[0].0)), "{lines:?}");
        // Against the hard stop in the end, where the motor turns on.
        let turned = slides.at(1) + slides.lost(1);
        assert!((turned - (-6.3 - PULL_OFF_MM * f64::from(tries))).abs() < 0.01, "{turned}");
    }
    let report = told(&mut wire, b"?", Duration::from_millis(10)).await;
    assert!(report[0].1.starts_with("<Alarm|") && report[0].1.contains("|Pn:Y"), "{report:?}");
}

#[tokio::test(start_paused = true)]
async fn nothing_but_a_reset_is_obeyed_in_homing_and_nothing_at_all_in_an_alarms_message() {
    let (slides, mut wire) = firmware([4.9, 10.0]);
    heard(&mut wire, Duration::from_millis(10)).await;
    assert_eq!(told(&mut wire, b"$H\n", Duration::from_secs(2)).await, []);
    assert_eq!(told(&mut wire, b"?!\x85", Duration::from_millis(500)).await, []);
    let before = slides.at(1);
    let lines = told(&mut wire, b"\x18?\n$X\n", Duration::from_secs(3)).await;
    assert_eq!(words(&lines), ["ALARM:6", "ok", BANNER, LOCKED], "what fell into the message is lost");
    assert!((slides.at(1) - before).abs() < 0.05, "it stopped at once");
    assert_eq!(words(&told(&mut wire, b"$H\n", LONG).await), ["ok"]);

    // A hard limit: a reset in its message is lost, the next one is obeyed.
    let (slides, mut wire) = firmware([1.3, 10.0]);
    heard(&mut wire, Duration::from_millis(10)).await;
    told(&mut wire, b"$20=0\n$X\n$J=G91 G21 X-5 F120\n", Duration::from_millis(100)).await;
    until("it has come to the switch", async || slides.at(0) <= -PULL_OFF_MM).await;
    let lines = told(&mut wire, b"\x18", Duration::from_secs(3)).await;
    assert_eq!(words(&lines), ["ALARM:1", "[MSG:Reset to continue]"]);
    let lines = told(&mut wire, b"\x18", Duration::from_secs(3)).await;
    assert_eq!(words(&lines), [BANNER, "[MSG:Check Limits]", LOCKED]);
    // The switch lets go: an alarm as well.
    let lines = told(&mut wire, b"$X\n$J=G91 G21 X1 F60\n", Duration::from_secs(3)).await;
    assert_eq!(words(&lines), ["[MSG:Caution: Unlocked]", "ok", "ok", "ALARM:1", "[MSG:Reset to continue]"]);
}

#[tokio::test(start_paused = true)]
async fn a_stop_takes_the_time_and_the_way_that_it_takes_on_the_chip() {
    // mm/s, ms to the last step and mm on the chip, at 20 mm/s².
    for (speed, chip_ms, chip_mm) in [(5.0, 288, 0.869), (3.0, 192, 0.365), (2.0, 136, 0.195)] {
        let (slides, mut wire) = firmware([1.3, 20.0]);
        heard(&mut wire, Duration::from_millis(10)).await;
        let jog = format!("$20=0\n$X\n$J=G91 G21 Y-20 F{}\n", speed * 60.0);
        told(&mut wire, jog.as_bytes(), Duration::from_millis(1200)).await;
        let (from, began) = (slides.at(1), Instant::now());
        wire.write_all(b"\x85!").await.unwrap();
        let (mut at, mut last) = (from, began);
        while last.elapsed() < Duration::from_millis(100) {
            elapse(Duration::from_millis(1)).await;
            if slides.at(1) != at {
                (at, last) = (slides.at(1), Instant::now());
            }
        }
        let took = (last - began).as_millis() as i64;
        // The twin's clock has a grain of 5 ms, and its last step is the ramp's end.
        assert!((took - chip_ms).abs() <= 25, "{speed} mm/s: {took} ms, {chip_ms} ms on the chip");
        assert!((from - at - chip_mm).abs() < 0.035, "{speed} mm/s: {} mm, {chip_mm} mm on the chip", from - at);
    }
}
