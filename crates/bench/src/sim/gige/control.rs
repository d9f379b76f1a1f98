//! GVCP: who may do what with the camera, and doing it.

use std::collections::VecDeque;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::addresses::{IDENTITY, PRIVILEGE, USER_NAME};
use super::faults::{Chance, LinkFaults, Sending, Taken};
use super::network::Interface;
use super::registers::Registers;
use super::settings::{Effect, Identity};
use super::stream::{Block, Link};
use super::wire::{Command, Refusal, Request};

/// Bits of the control privilege: one has the camera alone; one controls it, and others may look.
const EXCLUSIVE: u32 = 1;
const CONTROL: u32 = 2;
/// Another program, which nothing is heard of: its address is one that the standards leave for examples.
const STRANGER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(192, 0, 2, 1), 49_152);
/// So many of the newest frames can be sent again.
const KEPT: usize = 4;
/// So many requests for that wait at most: what comes beyond is asked for again.
const WAITING: usize = 64;

/// Packets of a frame that are to be sent again.
pub(super) struct Again {
    pub(super) block: Arc<Block>,
    pub(super) link: Arc<Link>,
    pub(super) packets: Vec<Sending>,
    /// The camera's generation when they were asked for.
    pub(super) generation: u64,
}

/// Whoever has control.
#[derive(Debug, Clone, Copy)]
struct Owner {
    address: SocketAddrV4,
    exclusive: bool,
    /// When it was last heard of.
    heard: Instant,
}

/// The camera's state between two datagrams.
pub(super) struct Control {
    pub(super) registers: Registers,
    interface: Interface,
    identity: Identity,
    /// Bytes a second that the link carries.
    bytes_per_s: f64,
    owner: Option<Owner>,
    /// When the clock began.
    pub(super) began: Instant,
    /// Goes up with each start and stop: a frame that was begun before is not sent.
    pub(super) generation: Arc<AtomicU64>,
    /// Frames that are to be taken when the camera waits for a trigger.
    pub(super) triggers: u32,
    /// The way to whoever takes the frames, while it does.
    pub(super) link: Option<Arc<Link>>,
    /// The newest frames.
    kept: VecDeque<Arc<Block>>,
    /// What is to be sent again, by another thread: at the link's pace that takes its time.
    again: VecDeque<Again>,
    last_block: u16,
    /// The last datagram with its answer: one that comes again is answered again, and not done.
    answered: Option<(SocketAddrV4, Vec<u8>, Vec<u8>)>,
    link_faults: LinkFaults,
    pub(super) chance: Chance,
    /// Until when the camera is without power.
    away_until: Option<Instant>,
}

impl Control {
    pub(super) fn new(
        identity: Identity,
        interface: Interface,
        bytes_per_s: f64,
        chance: Chance,
        now: Instant,
    ) -> Self {
        Self {
            registers: Registers::new(identity.clone(), &interface),
            interface,
            identity,
            bytes_per_s,
            owner: None,
            began: now,
            generation: Arc::default(),
            triggers: 0,
            link: None,
            kept: VecDeque::new(),
            again: VecDeque::new(),
            last_block: 0,
            answered: None,
            link_faults: LinkFaults::default(),
            chance,
            away_until: None,
        }
    }

    /// Switches the camera off and, after a while, on again: it has forgotten everything.
    pub(super) fn restart(&mut self, away: Duration, now: Instant) {
        let chance = std::mem::replace(&mut self.chance, Chance::new(0));
        let (generation, faults) = (Arc::clone(&self.generation), self.link_faults);
        generation.fetch_add(1, Ordering::SeqCst);
        let began = now + away;
        let anew = Self::new(self.identity.clone(), self.interface.clone(), self.bytes_per_s, chance, began);
        *self = Self { generation, away_until: Some(began), ..anew };
        self.set_link_faults(faults);
    }

    /// What goes wrong between camera and program.
    pub(super) const fn link_faults(&self) -> &LinkFaults {
        &self.link_faults
    }

    /// Makes that go wrong, and nothing else, from now on.
    pub(super) fn set_link_faults(&mut self, faults: LinkFaults) {
        let before = std::mem::replace(&mut self.link_faults, faults).taken;
        let privilege = match faults.taken {
            Taken::No if before == Taken::No => return,
            // Whoever had it lets it go.
            Taken::No => return self.release(),
            Taken::Control => CONTROL,
            Taken::Exclusive => EXCLUSIVE,
        };
        self.owner = None;
        self.answered = None;
        self.registers.set_control(privilege, Some((*STRANGER.ip(), STRANGER.port())));
    }

    /// Whether the camera is switched off.
    pub(super) fn is_away(&self, now: Instant) -> bool {
        self.away_until.is_some_and(|until| now < until)
    }

    /// What the clock reads at a moment.
    pub(super) fn ticks(&self, at: Instant) -> u64 {
        let passed = at.saturating_duration_since(self.began).as_nanos();
        u64::try_from(passed * u128::from(self.identity.ticks_a_second) / 1_000_000_000).unwrap_or(u64::MAX)
    }

    /// Takes control from whoever has not been heard of for too long.
    pub(super) fn expire(&mut self, now: Instant) {
        let allowed = Duration::from_millis(self.registers.heartbeat_ms());
        if self.owner.is_some_and(|owner| now.saturating_duration_since(owner.heard) > allowed) {
            self.release();
        }
    }

    fn release(&mut self) {
        self.owner = None;
        // What was granted is no more.
        self.answered = None;
        self.registers.set_control(0, None);
        self.stop();
    }

    /// Ends the frames.
    pub(super) fn stop(&mut self) {
        self.registers.acquiring = false;
        self.generation.fetch_add(1, Ordering::SeqCst);
        self.triggers = 0;
    }

    /// Numbers a frame and keeps it to be sent again.
    pub(super) fn keep(&mut self, block: Block) -> Arc<Block> {
        // Frames are numbered from 1 on, after the highest number, too.
        self.last_block = self.last_block.checked_add(1).unwrap_or(1);
        let block = Arc::new(Block { id: self.last_block, ..block });
        self.kept.push_back(Arc::clone(&block));
        if self.kept.len() > KEPT {
            self.kept.pop_front();
        }
        block
    }

    /// Does what a client asks for, and answers it where it wants that.
    pub(super) fn hear(&mut self, datagram: &[u8], from: SocketAddrV4, now: Instant) -> Option<Vec<u8>> {
        if self.is_away(now) {
            return None;
        }
        self.expire(now);
        if let Some(owner) = self.owner.as_mut().filter(|owner| owner.address == from) {
            owner.heard = now;
        }
        if let Some((client, before, answer)) = &self.answered
            && *client == from
            && before == datagram
        {
            return Some(answer.clone());
        }
        let request = match Request::read(datagram)? {
            Ok(request) => request,
            Err(refusal) => return Some(refusal),
        };
        let answer = self.follow(&request, from, now)?;
        if !request.wants_answer {
            return None;
        }
        self.answered = Some((from, datagram.to_vec(), answer.clone()));
        Some(answer)
    }

    fn follow(&mut self, request: &Request, from: SocketAddrV4, now: Instant) -> Option<Vec<u8>> {
        Some(match &request.command {
            Command::Discovery => match self.registers.bytes(IDENTITY.start, IDENTITY.len()) {
                Ok(identity) => request.answer(identity),
                Err(why) => request.refuse(why, &[]),
            },
            Command::Resend { block, first, last } => {
                self.send_again(*from.ip(), *block, *first, *last);
                return None;
            }
            Command::ReadRegisters(at) => self.read_registers(request, at, from),
            Command::WriteRegisters(writes) => self.write_registers(request, writes, from, now),
            Command::ReadMemory { at, count } => {
                match self.may_read(from).and_then(|()| self.registers.bytes(*at, *count)) {
                    Ok(bytes) => request.answer(&[&at.to_be_bytes(), bytes].concat()),
                    Err(why) => request.refuse(why, &[]),
                }
            }
            Command::WriteMemory { at, bytes } => {
                let done = match <[u8; 4]>::try_from(bytes.as_slice()) {
                    // A name is a text, however short.
                    Ok(word) if !USER_NAME.contains(at) => self.write(*at, u32::from_be_bytes(word), from, now),
                    _ => self.write_memory(*at, bytes, from, now),
                };
                let written = if done.is_ok() { u32::try_from(bytes.len()).unwrap_or(0) } else { 0 };
                match done {
                    Ok(()) => request.answer(&written.to_be_bytes()),
                    Err(why) => request.refuse(why, &written.to_be_bytes()),
                }
            }
            // Another address, too: it has the one that it was started with.
            Command::Other => request.refuse(Refusal::NOT_IMPLEMENTED, &[]),
        })
    }

    fn may_read(&self, from: SocketAddrV4) -> Result<(), Refusal> {
        let others = self.owner.is_some_and(|owner| owner.exclusive && owner.address != from);
        if others || self.link_faults.taken == Taken::Exclusive { Err(Refusal::ACCESS_DENIED) } else { Ok(()) }
    }

    fn may_write(&self, from: SocketAddrV4) -> Result<(), Refusal> {
        let own = self.owner.is_some_and(|owner| owner.address == from);
        if own { Ok(()) } else { Err(Refusal::ACCESS_DENIED) }
    }

    fn read_registers(&self, request: &Request, at: &[u32], from: SocketAddrV4) -> Vec<u8> {
        let mut values = Vec::new();
        for &at in at {
            match self.may_read(from).and_then(|()| self.registers.word(at)) {
                Ok(value) => values.extend(value.to_be_bytes()),
                Err(why) => return request.refuse(why, &values),
            }
        }
        request.answer(&values)
    }

    fn write_registers(
        &mut self,
        request: &Request,
        writes: &[(u32, u32)],
        from: SocketAddrV4,
        now: Instant,
    ) -> Vec<u8> {
        let mut written = 0u32;
        for &(at, value) in writes {
            if let Err(why) = self.write(at, value, from, now) {
                return request.refuse(why, &written.to_be_bytes());
            }
            written += 1;
        }
        request.answer(&written.to_be_bytes())
    }

    fn write(&mut self, at: u32, value: u32, from: SocketAddrV4, now: Instant) -> Result<(), Refusal> {
        if at == PRIVILEGE {
            return self.give_control(value, from, now);
        }
        self.may_write(from)?;
        let effect = self.registers.write(at, value)?;
        effect.into_iter().try_for_each(|effect| self.bring_about(effect, now))
    }

    fn write_memory(&mut self, at: u32, bytes: &[u8], from: SocketAddrV4, now: Instant) -> Result<(), Refusal> {
        self.may_write(from)?;
        let effects = self.registers.write_bytes(at, bytes)?;
        effects.into_iter().try_for_each(|effect| self.bring_about(effect, now))
    }

    fn give_control(&mut self, privilege: u32, from: SocketAddrV4, now: Instant) -> Result<(), Refusal> {
        if self.owner.is_some_and(|owner| owner.address != from) || self.link_faults.taken != Taken::No {
            return Err(Refusal::ACCESS_DENIED);
        }
        match privilege & (EXCLUSIVE | CONTROL) {
            0 => self.release(),
            granted => {
                self.owner = Some(Owner { address: from, exclusive: granted & EXCLUSIVE != 0, heard: now });
                self.registers.set_control(granted, Some((*from.ip(), from.port())));
            }
        }
        Ok(())
    }

    fn bring_about(&mut self, effect: Effect, now: Instant) -> Result<(), Refusal> {
        match effect {
            Effect::Start if self.registers.acquiring => {}
            Effect::Start => {
                self.open_link()?;
                self.registers.acquiring = true;
                self.generation.fetch_add(1, Ordering::SeqCst);
            }
            Effect::Stop => self.stop(),
            // Nobody waits for it.
            Effect::Trigger if !self.registers.acquiring => {}
            Effect::Trigger => self.triggers = self.triggers.saturating_add(1),
            Effect::TestPacket => self.open_link()?.test(),
            Effect::Latch => {
                let ticks = self.ticks(now);
                self.registers.set_timestamp(ticks);
            }
            Effect::ResetClock => self.began = now,
            Effect::Reset => self.restart(Duration::ZERO, now),
        }
        Ok(())
    }

    /// The way to where frames are to go at present.
    fn open_link(&mut self) -> Result<Arc<Link>, Refusal> {
        let to = self.registers.destination().ok_or(Refusal::INVALID_PARAMETER)?;
        let tick = Duration::from_nanos(1_000_000_000_u64.checked_div(self.identity.ticks_a_second).unwrap_or(0));
        let link = match self.link.take().filter(|link| link.leads_to(&to)) {
            Some(link) => link,
            None => {
                let link = Link::open(self.interface.address, to, self.bytes_per_s, tick);
                Arc::new(link.map_err(|_| Refusal::INVALID_PARAMETER)?)
            }
        };
        self.registers.set_source_port(link.port());
        self.link = Some(Arc::clone(&link));
        Ok(link)
    }

    fn send_again(&mut self, from: Ipv4Addr, block: u16, first: u32, last: u32) {
        let asks = self.owner.is_some_and(|owner| *owner.address.ip() == from);
        let Some(link) = self.link.clone().filter(|_| asks) else { return };
        let Some(block) = self.kept.iter().find(|kept| kept.id == block) else {
            link.miss(block, std::iter::once(first));
            return;
        };
        let packets = first..=last.min(link.packets(block) - 1);
        // What is asked for may be lost again, and nothing else goes wrong with it.
        let faults = LinkFaults { lost_one_in: self.link_faults.lost_one_in, ..LinkFaults::default() };
        if self.again.len() < WAITING {
            let (block, packets) = (Arc::clone(block), self.chance.sent(packets, &faults));
            let generation = self.generation.load(Ordering::SeqCst);
            self.again.push_back(Again { block, link, packets, generation });
        }
    }

    /// What is to be sent again next.
    pub(super) fn take_again(&mut self) -> Option<Again> {
        self.again.pop_front()
    }
}

#[cfg(test)]
mod tests;
