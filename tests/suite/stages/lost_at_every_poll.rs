//! A controller that is unplugged, or reset, after each poll of what switches a motor off or sets a position: what was
//! commanded before does not go out to the controller that comes back, and nothing moves.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::thorlabs::{Body, Message, id};
use plenalign::device::stage::tmcl::{command, parameter};
use plenalign::device::{DeviceError, Stage};
use plenalign::sim::stage::Protocol;
use tokio::time::timeout;

use super::super::steps::{Steps, stepwise};
use super::super::until::elapse;
use super::kit::{Kit, Rig, wait_for};
use super::stopped_at_every_poll::{Command, Tapped, Written, give, orders};

/// How the controller is lost.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Loss {
    Unplugged,
    Reset,
}

/// How much had been written each time that the wire was opened.
type Openings = Arc<Mutex<Vec<usize>>>;

struct Marked(Tapped, Openings);

#[async_trait]
impl Dial for Marked {
    fn location(&self) -> String {
        self.0.location()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let wire = self.0.open().await?;
        self.1.lock().unwrap().push(self.0.1.lock().unwrap().len());
        Ok(wire)
    }
}

/// How many orders to switch a motor off begin in what was written.
fn switched_off(driver: Protocol, written: &[u8]) -> usize {
    let text = String::from_utf8_lossy(written);
    match driver {
        Protocol::Grbl | Protocol::GrblHal | Protocol::FluidNc => text.matches("$SLP").count(),
        Protocol::Zaber => text.matches("driver disable").count(),
        Protocol::Pi => text.lines().filter(|line| line.contains("SVO ") && line.ends_with(" 0")).count(),
        Protocol::Tmcl => {
            let off = |frame: &[u8]| {
                frame[1] == command::SAP && frame[2] == parameter::STANDBY_CURRENT && frame[4..8] == [0; 4]
            };
            written.chunks_exact(9).filter(|frame| off(frame)).count()
        }
        Protocol::Thorlabs => {
            let off = |message: &Message| message.id == id::SET_ENABLED && matches!(message.body, Body::Short(_, 2));
            Message::all(written).filter(off).count()
        }
    }
}

/// Gives a command and loses the controller after so many polls. Returns whether it had not ended before, and whether it
/// had gone out before.
async fn lost(
    steps: &Steps,
    driver: Protocol,
    rig: &Rig,
    (written, openings): (&Written, &Openings),
    (what, loss): (Command, Loss),
    polls: usize,
) -> Option<bool> {
    let case = format!("{driver:?}, {what:?}, {loss:?} after {polls} polls");
    let begun = written.lock().unwrap().len();
    let stage = &rig.focus;
    let given = tokio::spawn(give(stage.clone(), what, stage.generation()));
    if !steps.after(polls, || given.is_finished()).await {
        return None;
    }
    let (at, stood) = (written.lock().unwrap().len(), rig.slides.at(0));
    match loss {
        Loss::Unplugged => rig.twin.unplug(),
        Loss::Reset => rig.twin.power_cycle(),
    }
    assert!(timeout(Duration::from_secs(60), given).await.is_ok(), "{case}: it never ends");
    if loss == Loss::Unplugged {
        wait_for(stage, "disconnected", |state| !state.connected).await;
        rig.twin.plug_in();
    }
    wait_for(stage, "connected", |state| state.connected).await;
    elapse(Duration::from_secs(1)).await;
    let written = written.lock().unwrap();
    let told = || format!("{case}: {}", String::from_utf8_lossy(&written[at..]));
    assert_eq!(rig.slides.at(0), stood, "{}: it moved", told());
    let went_out = |written: &[u8]| orders(driver, written) + switched_off(driver, written);
    // One may be on its way as it happens: setting a position may begin with an unlocking.
    assert!(went_out(&written[at..]) <= 1, "{}", told());
    if loss == Loss::Unplugged {
        let again = *openings.lock().unwrap().last().unwrap();
        assert!(again >= at, "{case}: it was not connected again");
        assert_eq!(went_out(&written[again..]), 0, "{}", told());
    }
    Some(switched_off(driver, &written[begun..at]) > 0)
}

fn at_every_poll(driver: Protocol) {
    let (points, out) = stepwise(|steps| async move {
        let kit = Kit::new(driver);
        let (written, openings) = (Written::default(), Openings::default());
        let tapped = Tapped(kit.twin.dial(), Arc::clone(&written));
        let controller = kit.start_on(Arc::new(Marked(tapped, Arc::clone(&openings))), None);
        controller.first_attempt().await.unwrap();
        let rig = kit.rig(&controller);
        let (mut points, mut out) = (0, 0);
        for what in [Command::SetPosition, Command::Release] {
            for loss in [Loss::Unplugged, Loss::Reset] {
                for polls in 0.. {
                    match lost(&steps, driver, &rig, (&written, &openings), (what, loss), polls).await {
                        None => break,
                        Some(before) => out += usize::from(before),
                    }
                    points += 1;
                }
            }
        }
        (points, out)
    });
    println!("{driver:?}: 2 commands x 2 losses, {points} points, {out} of them with a motor being switched off");
    assert!(points > 40 && out > 0, "{points}, {out}");
}

#[test]
fn grbl() {
    at_every_poll(Protocol::Grbl);
}

#[test]
fn fluidnc() {
    at_every_poll(Protocol::FluidNc);
}

#[test]
fn zaber() {
    at_every_poll(Protocol::Zaber);
}

#[test]
fn pi() {
    at_every_poll(Protocol::Pi);
}

#[test]
fn tmcl() {
    at_every_poll(Protocol::Tmcl);
}

#[test]
fn thorlabs() {
    at_every_poll(Protocol::Thorlabs);
}
