//! TMCL's answers name their command and nothing else, APT's their question and not which time it was asked: one that comes
//! doubled, late or not at all, at every place of a dialogue of two axes, a poller and a stop, is never taken for the answer
//! to another question.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::supervisor::ControllerStage;
use plenalign::device::stage::tmcl::{FRAME, Request, command};
use plenalign::device::{DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::TwinDial;
use plenalign::units::Millimetres;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, ReadHalf, duplex, split};
use tokio::time::timeout;

use super::super::bench::quick_axes;
use super::super::until::elapse;
use super::kit::{Kit, START, bench, near, wait_for};

/// What goes wrong with one answer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// It arrives again a while later, when the next question has been asked; what follows waits behind it.
    Doubled,
    /// It arrives after it was given up; what follows waits behind it.
    Late,
    /// It does not arrive.
    Lost,
}

/// Where the motors stand by their own count: far from each other, and from the zero of a motor at rest.
const MICROSTEPS: [i32; 2] = [1000, 9000];

/// A wire on which one answer, counted from 0, goes wrong.
struct Faulty {
    driver: Protocol,
    twin: TwinDial,
    fault: Fault,
    place: usize,
    passed: Arc<AtomicUsize>,
}

#[async_trait]
impl Dial for Faulty {
    fn location(&self) -> String {
        "faulty".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let twin = self.twin.open().await?;
        let (near, far) = duplex(4096);
        let (mut from_twin, mut to_twin) = split(twin);
        let (mut from_driver, mut to_driver) = split(far);
        tokio::spawn(async move { tokio::io::copy(&mut from_driver, &mut to_twin).await });
        let (fault, place, passed) = (self.fault, self.place, Arc::clone(&self.passed));
        let driver = self.driver;
        tokio::spawn(async move {
            while let Some(answer) = answer(driver, &mut from_twin).await {
                let wrong = passed.fetch_add(1, Ordering::SeqCst) == place;
                if wrong && fault == Fault::Lost {
                    continue;
                }
                if wrong && fault == Fault::Late {
                    elapse(Duration::from_millis(700)).await;
                }
                let _ = to_driver.write_all(&answer).await;
                if wrong && fault == Fault::Doubled {
                    elapse(Duration::from_millis(30)).await;
                    let _ = to_driver.write_all(&answer).await;
                }
            }
        });
        Ok(Box::new(near))
    }
}

/// The next message that a controller says.
async fn answer(driver: Protocol, from: &mut ReadHalf<Wire>) -> Option<Vec<u8>> {
    let mut answer = vec![0; if driver == Protocol::Tmcl { FRAME } else { 6 }];
    from.read_exact(&mut answer).await.ok()?;
    if driver == Protocol::Thorlabs && answer[4] & 0x80 != 0 {
        answer.resize(6 + usize::from(answer[2]), 0);
        from.read_exact(&mut answer[6..]).await.ok()?;
    }
    Some(answer)
}

/// Makes the positions known: by homing where that is the only way, and the wire goes wrong only after it.
async fn make_known(stage: &ControllerStage, at: f64, driver: Protocol) {
    if driver == Protocol::Thorlabs {
        stage.home(stage.generation()).await.unwrap();
        stage.move_to(Millimetres(at), stage.generation()).await.unwrap();
    } else if stage.set_position(Millimetres(at), stage.generation()).await.is_err() {
        // Its answer was lost: once more, as an operator would.
        stage.set_position(Millimetres(at), stage.generation()).await.unwrap();
    }
}

/// Two axes are set, read again and again by three tasks at once, moved, and stopped. Returns how many answers there were.
async fn dialogue(driver: Protocol, fault: Fault, place: usize) -> usize {
    let mut axes = bench(driver);
    quick_axes(&mut axes);
    let kit = Kit::with(driver, axes);
    for (motor, value) in MICROSTEPS.into_iter().enumerate().filter(|_| driver == Protocol::Tmcl) {
        let position = Request { address: 1, command: command::SAP, kind: 1, motor: motor as u8, value };
        kit.twin.receive(&position.frame());
    }
    let passed = Arc::<AtomicUsize>::default();
    if driver == Protocol::Thorlabs {
        // None is at fault before it is counted from here on.
        passed.store(usize::MAX / 2, Ordering::SeqCst);
    }
    let dial = Faulty { driver, twin: kit.twin.dial(), fault, place, passed: Arc::clone(&passed) };
    let rig = kit.rig(&kit.start_on(Arc::new(dial), None));
    let case = format!("{driver:?}, {fault:?} at {place}");
    for (stage, at) in [(&rig.focus, START[0]), (&rig.e, START[1])] {
        wait_for(stage, "connected", |state| state.connected).await;
        make_known(stage, at, driver).await;
    }
    if driver == Protocol::Thorlabs {
        passed.store(0, Ordering::SeqCst);
    }
    let reads = |stage: ControllerStage, axis: usize, times: usize| {
        let (slides, case) = (rig.slides.clone(), case.clone());
        async move {
            for _ in 0..times {
                let state = stage.read_state().await.unwrap();
                let at = slides.at(axis);
                // A reading takes its time, and so does an answer that is late: what the motors count is 20 mm apart. A stop that is
                // not seen to take effect in time leaves the position unknown.
                let unknown = !state.homed && matches!(fault, Fault::Late | Fault::Lost);
                let right = near(state.position.value(), at, 1.0);
                assert!(unknown || right, "{case}: axis {axis} at {at} reads {state:?}");
            }
        }
    };
    tokio::join!(
        reads(rig.focus.clone(), 0, 2),
        reads(rig.e.clone(), 1, 2),
        reads(rig.e.clone(), 1, 2),
        reads(rig.focus.clone(), 0, 2),
    );
    let (there, back) = (rig.e.clone(), rig.focus.clone());
    let (e, focus, (), ()) = tokio::join!(
        there.move_to(Millimetres(START[1] - 0.1), there.generation()),
        back.move_to(Millimetres(START[0] + 0.1), back.generation()),
        reads(rig.focus.clone(), 0, 1),
        reads(rig.e.clone(), 1, 1),
    );
    for (ended, axis, target) in [(focus, 0, START[0] + 0.1), (e, 1, START[1] - 0.1)] {
        match ended {
            Ok(readback) => assert!(
                near(readback.value(), target, 0.003) && near(rig.slides.at(axis), target, 0.003),
                "{case}: axis {axis} says {readback} at {}",
                rig.slides.at(axis)
            ),
            // A command whose answer does not come in time is not known to be carried out: all is stopped.
            Err(DeviceError::Timeout { .. } | DeviceError::Stopped { .. }) => {
                assert!(matches!(fault, Fault::Late | Fault::Lost), "{case}: axis {axis}");
            }
            Err(error) => panic!("{case}: axis {axis}: {error}"),
        }
    }
    let stop = async { (rig.focus.stop().await, rig.e.stop().await) };
    let (stopped, (), ()) = tokio::join!(stop, reads(rig.focus.clone(), 0, 1), reads(rig.e.clone(), 1, 1));
    assert_eq!(stopped, (StopDelivery::Confirmed, StopDelivery::Confirmed), "{case}");
    passed.load(Ordering::SeqCst)
}

async fn at_every_place(driver: Protocol, fault: Fault) {
    let answers = dialogue(driver, fault, usize::MAX).await;
    println!("{answers} answers");
    assert!(answers > 50, "{answers}");
    for place in 0..answers {
        let ended = timeout(Duration::from_secs(120), dialogue(driver, fault, place)).await;
        assert!(ended.is_ok(), "{driver:?}, {fault:?} at {place}: it never ends");
    }
}

macro_rules! without_numbers {
    ($($protocol:ident: $driver:ident),*) => {
        $(mod $protocol {
            use super::{Protocol::$driver, Fault, at_every_place};

            #[tokio::test(start_paused = true)]
            async fn a_doubled_answer_is_taken_for_no_other() {
                at_every_place($driver, Fault::Doubled).await;
            }

            #[tokio::test(start_paused = true)]
            async fn a_late_answer_is_taken_for_no_other() {
                at_every_place($driver, Fault::Late).await;
            }

            #[tokio::test(start_paused = true)]
            async fn a_lost_answer_puts_no_other_in_its_place() {
                at_every_place($driver, Fault::Lost).await;
            }
        })*
    };
}

without_numbers!(tmcl: Tmcl, thorlabs: Thorlabs);
