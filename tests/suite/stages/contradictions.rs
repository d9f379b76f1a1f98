//! A controller that contradicts the configuration about where an axis would go: nothing moves, all else works.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{Config, Side};
use plenalign::control::events::ShellState;
use plenalign::control::{Refusal, ServiceError};
use plenalign::device::jog::deadman;
use plenalign::device::stage::tmcl::{Request, command};
use plenalign::device::{AxisName, Bench, DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::{ControllerTwin, Protocol};
use plenalign::units::Millimetres;

use super::super::bench::rules;
use super::super::fakes::fakes;
use super::kit::{Kit, START, every_protocol, near, wait_for};

/// What a controller and the configuration of the e axis contradict each other about.
struct Contradiction {
    /// In what the refusal says.
    words: &'static str,
    make: fn(&mut Kit),
    /// Changes one of the two.
    mend: fn(&mut Kit),
}

fn set_shaft(kit: &mut Kit, value: i32) {
    kit.twin.receive(&Request { address: 1, command: command::SAP, kind: 251, motor: 1, value }.frame());
}

/// Sets how the second bay of a Thorlabs controller homes: the direction, and the switch.
pub(super) fn set_homing(twin: &ControllerTwin, direction: u8, switch: u8) {
    let header = [0x40, 0x04, 14, 0, 0x80 | 0x22, 0x01];
    // At 5 mm/s.
    let speed = (5.0 * 409_600.0 * 53.68_f64).round() as i32;
    twin.receive(&[&header[..], &[1, 0, direction, 0, switch, 0], &speed.to_le_bytes(), &[0; 4]].concat());
}

fn contradictions(driver: Protocol) -> Vec<Contradiction> {
    match driver {
        Protocol::FluidNc => vec![
            Contradiction {
                words: "positive_direction",
                make: |kit| kit.twin.receive(b"$/axes/y/homing/positive_direction=false\n"),
                mend: |kit| kit.twin.receive(b"$/axes/y/homing/positive_direction=true\n"),
            },
            Contradiction {
                words: "direction_pin",
                make: |kit| kit.bench.e.motor_inverted = true,
                mend: |kit| kit.bench.e.motor_inverted = false,
            },
            Contradiction {
                words: "axes/y/steps_per_mm",
                make: |kit| kit.twin.receive(b"$/axes/y/steps_per_mm=800\n"),
                mend: |kit| kit.twin.receive(b"$/axes/y/steps_per_mm=400\n"),
            },
            Contradiction {
                words: "tells `x` as axes/y/homing/mpos_mm",
                make: |kit| kit.twin.receive(b"$/axes/y/homing/mpos_mm=x\n"),
                mend: |kit| kit.twin.receive(b"$/axes/y/homing/mpos_mm=30\n"),
            },
            Contradiction {
                words: "cycle: -1",
                make: |kit| kit.twin.receive(b"$/axes/y/homing/cycle=-1\n"),
                mend: |kit| kit.twin.receive(b"$/axes/y/homing/cycle=2\n"),
            },
        ],
        Protocol::Grbl | Protocol::GrblHal => vec![
            Contradiction {
                words: "$23",
                make: |kit| kit.twin.receive(b"$23=3\n"),
                mend: |kit| kit.twin.receive(b"$23=1\n"),
            },
            Contradiction {
                words: "$3",
                make: |kit| kit.twin.receive(b"$3=2\n"),
                mend: |kit| kit.twin.receive(b"$3=0\n"),
            },
            Contradiction {
                words: "$101",
                make: |kit| kit.twin.receive(b"$101=800\n"),
                mend: |kit| kit.twin.receive(b"$101=400\n"),
            },
            Contradiction {
                words: "bench.e.steps_per_mm",
                make: |kit| kit.bench.e.steps_per_mm = 80.0,
                mend: |kit| kit.bench.e.steps_per_mm = 400.0,
            },
        ],
        Protocol::Zaber => vec![
            Contradiction {
                words: "negative end",
                make: |kit| kit.bench.e.home_side = Side::Low,
                mend: |kit| kit.bench.e.home_side = Side::High,
            },
            Contradiction {
                words: "negative end",
                make: |kit| kit.bench.e.reversed = false,
                mend: |kit| kit.bench.e.reversed = true,
            },
        ],
        Protocol::Pi => vec![Contradiction {
            words: "PUN?",
            make: |kit| kit.bench.e.steps_per_mm = 1000.0,
            mend: |kit| kit.bench.e.steps_per_mm = 1.0,
        }],
        Protocol::Tmcl => vec![Contradiction {
            words: "axis parameter 251",
            make: |kit| set_shaft(kit, 1),
            mend: |kit| set_shaft(kit, 0),
        }],
        Protocol::Thorlabs => vec![
            Contradiction {
                words: "to its reverse limit switch",
                make: |kit| set_homing(&kit.twin, 2, 1),
                mend: |kit| set_homing(&kit.twin, 1, 4),
            },
            Contradiction {
                words: "direction 2 and limit switch 4",
                make: |kit| set_homing(&kit.twin, 2, 4),
                mend: |kit| set_homing(&kit.twin, 1, 4),
            },
            Contradiction {
                words: "to its forward limit switch",
                make: |kit| kit.bench.e.home_side = Side::Low,
                mend: |kit| kit.bench.e.home_side = Side::High,
            },
            Contradiction {
                words: "to its forward limit switch",
                make: |kit| kit.bench.e.reversed = true,
                mend: |kit| kit.bench.e.reversed = false,
            },
        ],
    }
}

every_protocol!(
    a_contradicted_axis_is_read_and_stopped_and_never_moved,
    whatever_is_said_of_the_shell_the_rules_refuse_it_too,
);

async fn a_contradicted_axis_is_read_and_stopped_and_never_moved(driver: Protocol) {
    for Contradiction { words, make, mend } in contradictions(driver) {
        let mut kit = Kit::new(driver);
        make(&mut kit);
        // Who accepts wider limits has accepted nothing else.
        kit.bench.e.accept_wider_firmware_limits = true;
        let rig = kit.connect().await.unwrap();
        let refused =
            |error: &DeviceError| matches!(error, DeviceError::Refused { reason, .. } if reason.contains(words));
        for error in [
            rig.e.home(rig.e.generation()).await.unwrap_err(),
            rig.e.set_position(Millimetres(20.0), rig.e.generation()).await.unwrap_err(),
            rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err(),
            rig.e.move_at(Millimetres(29.0), 0.5, rig.e.generation()).await.unwrap_err(),
        ] {
            assert!(refused(&error), "{words}: {error}");
        }
        assert_eq!(rig.slides.at(1), START[1], "{words}: not by a micrometre");
        let state = rig.e.read_state().await.unwrap();
        assert!(state.connected && !state.moving, "{words}: {state:?}");
        assert!(!rig.e.info().identity.is_empty());
        assert_eq!(rig.e.stop().await, StopDelivery::Confirmed, "{words}");
        // The other axis, which nothing contradicts, is driven.
        rig.focus.home(rig.focus.generation()).await.unwrap();
        assert!(
            refused(&rig.e.home(rig.e.generation()).await.unwrap_err()),
            "{words}: after the stop and the other's homing"
        );
        assert_eq!(rig.slides.at(1), START[1], "{words}");

        drop(rig);
        mend(&mut kit);
        let rig = kit.rig(&kit.start());
        wait_for(&rig.e, "connected", |state| state.connected).await;
        rig.e.home(rig.e.generation()).await.unwrap();
        let readback = rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap();
        assert!(near(readback.value(), 20.0, 0.003) && near(rig.slides.at(1), 20.0, 0.006), "{words}: {readback}");
    }
}

async fn whatever_is_said_of_the_shell_the_rules_refuse_it_too(driver: Protocol) {
    for Contradiction { words, make, .. } in contradictions(driver) {
        let mut kit = Kit::new(driver);
        make(&mut kit);
        // Who accepts wider limits has accepted nothing else.
        kit.bench.e.accept_wider_firmware_limits = true;
        let rig = kit.connect().await.unwrap();
        let bench = Bench { focus: Arc::new(rig.focus), e: Arc::new(rig.e), ..fakes().bench };
        let (motion, admit) = rules(Config { bench: kit.bench.clone(), ..Config::default() }, bench);
        for shell in [ShellState::Unknown, ShellState::On, ShellState::Off] {
            motion.set_shell(shell);
            let (_grip, dead) = deadman(Duration::from_secs(60));
            for refused in [
                motion.home(&admit(), AxisName::E).await.unwrap_err(),
                motion.go(&admit(), AxisName::E, Millimetres(20.0)).await.unwrap_err(),
                motion.jog(&admit(), AxisName::E, Side::High, 1.0, dead).await.unwrap_err(),
            ] {
                let ServiceError::Refused(Refusal::Contradiction { axis, contradictions }) = &refused else {
                    panic!("{words}: {refused}")
                };
                assert!(*axis == AxisName::E && contradictions.join(" ").contains(words), "{refused}");
            }
        }
        assert_eq!(rig.slides.at(1), START[1], "{words}: not by a micrometre");
    }
}
