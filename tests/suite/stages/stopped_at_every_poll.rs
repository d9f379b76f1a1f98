//! A stop after each poll of what a command takes, over the real drivers' wires: no order that moves is written after it.

use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::config::Side;
use plenalign::device::jog::{Next, Seen};
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::supervisor::ControllerStage;
use plenalign::device::stage::thorlabs::{Message, id};
use plenalign::device::stage::tmcl::command;
use plenalign::device::{DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::TwinDial;
use plenalign::units::Millimetres;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::super::steps::{Steps, stepwise};
use super::super::until::elapse;
use super::kit::{Kit, Rig, START, bench};

/// Every byte that was written.
pub(super) type Written = Arc<Mutex<Vec<u8>>>;

pub(super) struct Tapped(pub(super) TwinDial, pub(super) Written);

#[async_trait]
impl Dial for Tapped {
    fn location(&self) -> String {
        "tapped".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        Ok(Box::new(TappedWire(self.0.open().await?, Arc::clone(&self.1))))
    }
}

struct TappedWire(Wire, Written);

impl AsyncRead for TappedWire {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_read(cx, buf)
    }
}

impl AsyncWrite for TappedWire {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<std::io::Result<usize>> {
        let wrote = Pin::new(&mut self.0).poll_write(cx, bytes);
        if let Poll::Ready(Ok(count)) = wrote {
            self.1.lock().unwrap().extend(&bytes[..count]);
        }
        wrote
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_shutdown(cx)
    }
}

/// How many orders that move begin in what was written.
pub(super) fn orders(driver: Protocol, written: &[u8]) -> usize {
    let words: &[&str] = match driver {
        Protocol::Grbl | Protocol::GrblHal | Protocol::FluidNc => &["$J=", "$H", "$X"],
        Protocol::Zaber => &[" move ", " home"],
        Protocol::Pi => &["MOV ", "FNL ", "FPL ", "FRF "],
        Protocol::Tmcl => {
            let moves = |frame: &[u8]| frame[1] == command::MVP || (frame[1] == command::RFS && frame[2] == 0);
            return written.chunks_exact(9).filter(|frame| moves(frame)).count();
        }
        Protocol::Thorlabs => {
            let moves = [id::MOVE_HOME, id::MOVE_RELATIVE, id::MOVE_ABSOLUTE, id::MOVE_VELOCITY, id::MOVE_JOG];
            return Message::all(written).filter(|message| moves.contains(&message.id)).count();
        }
    };
    let text = String::from_utf8_lossy(written);
    words.iter().map(|word| text.matches(word).count()).sum()
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Command {
    Home,
    Move,
    Follow,
    Release,
    SetPosition,
    StepOff,
}

pub(super) async fn give(stage: ControllerStage, command: Command, generation: u64) {
    let at = stage.state().borrow().position;
    // Whether it is carried out or refused is not the point here.
    let _ = match command {
        Command::Home => stage.home(generation).await,
        Command::Move => stage.move_to(at + Millimetres(0.05), generation).await.map(drop),
        Command::Follow => {
            let end = at + Millimetres(0.3);
            let course = move |seen: Seen| {
                let to = Millimetres((seen.at.value() + 0.1).min(end.value()));
                (seen.at < end).then_some(Next { to, speed_mm_per_s: 2.0 })
            };
            stage.follow(Box::new(course), generation).await.map(drop)
        }
        Command::Release => stage.release(generation).await,
        Command::SetPosition => stage.set_position(at, generation).await,
        Command::StepOff => stage.step_off(Side::High, 0.01, generation).await.map(drop),
    };
}

/// Gives a command and stops it after so many polls. Returns whether it had not ended before, and how many orders were
/// written before.
async fn stopped(
    steps: &Steps,
    driver: Protocol,
    rig: &Rig,
    written: &Written,
    what: Command,
    polls: usize,
) -> Option<usize> {
    let begun = written.lock().unwrap().len();
    let stage = &rig.focus;
    let given = tokio::spawn(give(stage.clone(), what, stage.generation()));
    let reached = steps.after(polls, || given.is_finished()).await;
    if !reached {
        return None;
    }
    let stopping = stage.clone();
    let mut stop: Pin<Box<dyn Future<Output = StopDelivery> + Send>> = Box::pin(async move { stopping.stop().await });
    assert!(stop.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
    let at = written.lock().unwrap().len();
    assert_eq!(tokio::spawn(stop).await.unwrap(), StopDelivery::Confirmed);
    given.await.unwrap();
    let stood = rig.slides.at(0);
    elapse(Duration::from_secs(1)).await;
    assert_eq!(rig.slides.at(0), stood, "{driver:?}, {what:?}: it moved after a confirmed stop, {polls} polls in");
    let written = written.lock().unwrap();
    let after = orders(driver, &written[at..]);
    assert_eq!(after, 0, "{driver:?}, {what:?} after {polls} polls: {}", String::from_utf8_lossy(&written[at..]));
    Some(orders(driver, &written[begun..at]))
}

fn at_every_poll(driver: Protocol) {
    let (points, amid) = stepwise(|steps| async move {
        let kit = Kit::new(driver);
        let written = Written::default();
        let controller = kit.start_on(Arc::new(Tapped(kit.twin.dial(), Arc::clone(&written))), None);
        controller.first_attempt().await.unwrap();
        let rig = kit.rig(&controller);
        let (mut points, mut amid) = (0, 0);
        for what in [Command::Move, Command::Follow, Command::SetPosition, Command::Release, Command::Home] {
            let mut polls = 0;
            loop {
                let homed = rig.focus.state().borrow().homed;
                if matches!(what, Command::Move | Command::Follow) && !homed
                    || (rig.focus.state().borrow().position.value() - START[0]).abs() > 2.0
                {
                    rig.focus.home(rig.focus.generation()).await.unwrap();
                }
                match stopped(&steps, driver, &rig, &written, what, polls).await {
                    None => break,
                    Some(before) => amid += usize::from(before > 0),
                }
                points += 1;
                // Until the order is written every one; while the axis moves, a hundredth further on each time.
                polls += 1 + if polls > 60 { polls / 50 } else { 0 };
            }
        }
        (points, amid)
    });
    println!("{driver:?}: 5 commands, {points} points, {amid} of them with an order on its way");
    assert!(points > 100 && amid > points / 10, "{points}, {amid}");
}

/// The way off a switch, whose orders need no reference: an axis that stands on its switch, and stays there.
#[test]
fn grbl_on_a_switch() {
    let (points, amid) = stepwise(|steps| async move {
        let driver = Protocol::Grbl;
        let kit = Kit::standing(driver, bench(driver), [-3.9, START[1]]);
        // Powered up there, its soft limits would not allow the way off.
        kit.twin.receive(b"$20=0\n");
        let written = Written::default();
        let controller = kit.start_on(Arc::new(Tapped(kit.twin.dial(), Arc::clone(&written))), None);
        controller.first_attempt().await.unwrap();
        let rig = kit.rig(&controller);
        let (mut points, mut amid) = (0, 0);
        while let Some(before) = stopped(&steps, driver, &rig, &written, Command::StepOff, points).await {
            amid += usize::from(before > 0);
            points += 1;
        }
        assert!(rig.slides.at(0) < -3.0 && rig.slides.at(0) > -3.9, "{}", rig.slides.at(0));
        (points, amid)
    });
    println!("Grbl on a switch: {points} points, {amid} of them with an order on its way");
    assert!(points > 20 && amid > points / 10, "{points}, {amid}");
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
