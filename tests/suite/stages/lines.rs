//! Bad lines: fragments, noise, echo, delays, doubled and lost bytes, the wrong baud rate.

use std::time::Duration;

use plenalign::config::ControllerDriver;
use plenalign::device::{DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::line::Line;
use plenalign::units::Millimetres;

use super::super::until::elapse;
use super::kit::{Kit, START, every_protocol, near};

every_protocol!(
    single_bytes_with_pauses_do_no_harm,
    noise_before_the_first_answer_does_no_harm,
    an_echo_does_no_harm,
    late_answers_do_no_harm,
    doubled_answers_do_no_harm,
    lost_bytes_cost_commands_but_never_the_truth,
    the_wrong_baud_rate_is_told,
);

/// Homes and moves over a line, and stops in mid-move.
async fn works_over(driver: Protocol, line: Line) {
    let kit = Kit::new(driver);
    kit.twin.set_line(line);
    let rig = kit.connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    for target in [2.5, 1.0] {
        let readback = rig.focus.move_to(Millimetres(target), rig.focus.generation()).await.unwrap();
        assert!(near(readback.value(), target, 0.003) && near(rig.slides.at(0), target, 0.006), "{readback}");
    }
    let mover = rig.focus.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(4.9), mover.generation()).await });
    elapse(Duration::from_secs(1)).await;
    assert_eq!(rig.focus.stop().await, StopDelivery::Confirmed);
    assert!(matches!(moving.await.unwrap(), Err(DeviceError::Stopped { .. })));
    let at = rig.slides.at(0);
    assert!(at < 4.0, "{at}");
    elapse(Duration::from_secs(3)).await;
    assert_eq!(rig.slides.at(0), at);
    assert!(rig.focus.read_state().await.unwrap().homed);
}

async fn single_bytes_with_pauses_do_no_harm(driver: Protocol) {
    works_over(driver, Line { fragment: 1, pause: Duration::from_micros(300), ..Line::default() }).await;
}

async fn noise_before_the_first_answer_does_no_harm(driver: Protocol) {
    let noise = b"\xff\x00\xfe~~\x80Grb\r\n<Idle|MPos:1,2\r\n@01 1\n1=\n\xffxx".to_vec();
    works_over(driver, Line { noise, ..Line::default() }).await;
}

async fn an_echo_does_no_harm(driver: Protocol) {
    works_over(driver, Line { echo: true, ..Line::default() }).await;
}

async fn late_answers_do_no_harm(driver: Protocol) {
    works_over(driver, Line { delay: Duration::from_millis(30), ..Line::default() }).await;
}

async fn doubled_answers_do_no_harm(driver: Protocol) {
    if driver == Protocol::FluidNc {
        // Its configuration has no ends by which a doubled piece of it could be told: it is not believed.
        let kit = Kit::new(driver);
        kit.twin.set_line(Line { doubled: true, ..Line::default() });
        let error = kit.connect().await.err().unwrap();
        assert!(matches!(&error, DeviceError::Protocol { detail, .. } if detail.contains("twice alike")), "{error}");
        assert_eq!([kit.slides.at(0), kit.slides.at(1)], START);
        return;
    }
    works_over(driver, Line { doubled: true, ..Line::default() }).await;
}

async fn lost_bytes_cost_commands_but_never_the_truth(driver: Protocol) {
    // Each loses other bytes of the same answers.
    // FluidNC's configuration is two thousand bytes in one answer, and has to be told twice alike.
    let rates: &[usize] = if driver == Protocol::FluidNc { &[4999, 7919] } else { &[211, 257, 307, 331, 401, 509] };
    for &loses_one_in in rates {
        loses_bytes(driver, loses_one_in).await;
    }
}

/// More bytes than any answer that has to be whole.
const LONG_ANSWER: usize = 300;

async fn loses_bytes(driver: Protocol, loses_one_in: usize) {
    let kit = Kit::new(driver);
    kit.twin.set_line(Line { loses_one_in, ..Line::default() });
    let controller = kit.start();
    let rig = kit.rig(&controller);
    let (mut reached, mut tries) = (0, 0);
    for target in [2.5, 1.0, 3.0, 0.5].iter().cycle() {
        tries += 1;
        if tries == 200 && loses_one_in < LONG_ANSWER {
            // What says that it cannot be connected has claimed nothing.
            break;
        }
        assert!(tries < 200, "one in {loses_one_in} lost: {reached} moves of {tries} arrived");
        let state = rig.focus.state().borrow().clone();
        if !state.connected {
            elapse(Duration::from_secs(1)).await;
        } else if !state.homed {
            if rig.focus.home(rig.focus.generation()).await.is_err() {
                // What was damaged on its way is asked for again.
                elapse(Duration::from_secs(1)).await;
            }
        } else if let Ok(readback) = rig.focus.move_to(Millimetres(*target), rig.focus.generation()).await {
            // What is said to have arrived has.
            assert!(near(readback.value(), *target, 0.003) && near(rig.slides.at(0), *target, 0.006), "{readback}");
            reached += 1;
        }
        if reached == 4 {
            break;
        }
        let state = rig.focus.state().borrow().clone();
        if state.homed && !state.moving {
            assert!(
                near(state.position.value(), rig.slides.at(0), 0.7),
                "one in {loses_one_in} lost: {state:?} at {}",
                rig.slides.at(0)
            );
        }
    }
}

async fn the_wrong_baud_rate_is_told(driver: Protocol) {
    let kit = Kit::new(driver);
    kit.twin.set_line(Line { garbled: true, ..Line::default() });
    let error = kit.connect().await.err().unwrap();
    assert!(matches!(error, DeviceError::WrongDevice { .. } | DeviceError::Timeout { .. }), "{error}");
    if driver.driver() == ControllerDriver::Grbl {
        let words = error.to_string();
        for part in ["nothing readable", "115200 baud", "baud = 250000", "controller `main`"] {
            assert!(words.contains(part), "{words}");
        }
    }
    assert_eq!([kit.slides.at(0), kit.slides.at(1)], START, "nothing moved");
}
