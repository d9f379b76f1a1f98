//! The simulated camera as a GigE Vision device: control and stream as the standard has them, written from it and from
//! nothing that the driver uses, so that the two can be judged by each other.
//!
//! The protocol has no authentication: whoever reaches the camera's address has the camera.

mod addresses;
mod control;
mod description;
mod faults;
mod film;
mod format;
mod network;
mod registers;
mod settings;
mod slides;
mod stream;
mod wire;
mod world;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub use self::faults::{GigeFaultPlan, GigeFaults, LinkFaults, Taken};
pub use self::slides::SlideRecord;

use self::control::Control;
use self::faults::Chance;
use self::film::Film;
use self::format::Format;
use self::network::Interface;
use self::settings::Identity;
use self::world::World;
use crate::config::{Config, TimestampMeans};
use crate::device::Setup;

/// Ticks of the camera's clock a second.
const TICKS_A_SECOND: u64 = 1_000_000_000;
/// How long datagrams are waited for, before heartbeats are looked at.
const SLICE: Duration = Duration::from_millis(50);
/// Larger than any datagram that a client may send.
const DATAGRAM: usize = 2048;
/// So many datagrams of a socket are answered before the next one's.
const AT_A_TIME: usize = 64;
/// So many of the newest exposures are kept in mind.
const EXPOSURES: usize = 256;
/// Filters lie two by two.
const MOSAIC_STEP: u32 = 2;

/// What a simulated camera is to be.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its address, of which this machine has an interface.
    pub address: Ipv4Addr,
    /// Its serial number, at most 15 bytes.
    pub serial: String,
    /// The name that a user gave it, at most 15 bytes.
    pub user_name: String,
    /// What its stamps are of. With [`TimestampMeans::Arrival`] it has no clock.
    pub means: TimestampMeans,
    /// What its link carries, Mbit/s.
    pub link_mbit_s: f64,
    /// Whether it says which program has control of it, as not every camera does.
    pub names_controller: bool,
    /// What goes wrong from the beginning.
    pub faults: GigeFaults,
    /// What chance depends on.
    pub seed: u64,
    /// Records of the slides that it sees move; without, nothing moves.
    pub slides: Vec<SlideRecord>,
}

/// A simulated camera on the network. It ends when this is dropped.
pub struct GigeCamera {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

/// An exposure as it truly was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exposure {
    /// When it began.
    pub from: Instant,
    /// When it ended.
    pub to: Instant,
    /// The checksum of the frame's bytes, by which it is known again, and known to be whole.
    pub checksum: u32,
}

impl Exposure {
    /// The checksum of a frame's bytes as they are sent.
    #[must_use]
    pub fn checksum(bytes: &[u8]) -> u32 {
        crc32fast::hash(bytes)
    }
}

struct Shared {
    control: Mutex<Control>,
    exposures: Mutex<VecDeque<Exposure>>,
    changed: Condvar,
    ended: AtomicBool,
    faults: Mutex<GigeFaults>,
    /// How many frames are sent again and again.
    repeated: AtomicUsize,
    world: World,
    /// Whether slides are followed.
    follows: bool,
}

impl GigeCamera {
    /// Switches on a camera that sees what a configuration's simulated bench has before it.
    ///
    /// # Errors
    /// Where the address is not this machine's, or another camera has it.
    pub fn start(config: &Arc<Config>, options: Options) -> io::Result<Self> {
        let Options { address, serial, user_name, means, link_mbit_s, names_controller, faults, seed, slides } =
            options;
        let interface = Interface::of(address, &serial)?;
        let mosaic = config.sensor.mosaic;
        let identity = Identity {
            serial,
            user_name,
            ticks_a_second: if means == TimestampMeans::Arrival { 0 } else { TICKS_A_SECOND },
            sensor: [config.sensor.width_px, config.sensor.height_px],
            formats: Format::offered(mosaic),
            offset_step: mosaic.map_or(1, |_| MOSAIC_STEP),
            names_controller,
        };
        let mut sockets = vec![interface.control_socket()?];
        match interface.broadcast_sockets() {
            Ok(more) => sockets.extend(more),
            Err(error) => tracing::warn!(%error, "the camera hears no broadcasts: it is found by its address only"),
        }
        let bytes_per_s = link_mbit_s * 1e6 / 8.0;
        let mut control = Control::new(identity, interface, bytes_per_s, Chance::new(seed), Instant::now());
        control.set_link_faults(faults.link);
        let generation = Arc::clone(&control.generation);
        let shared = Arc::new(Shared {
            control: Mutex::new(control),
            exposures: Mutex::default(),
            changed: Condvar::new(),
            ended: AtomicBool::new(false),
            faults: Mutex::new(faults),
            repeated: AtomicUsize::new(0),
            follows: !slides.is_empty(),
            world: World::new(config, slides),
        });
        let (out, takes) = mpsc::sync_channel(0);
        let film = Film::new(Arc::clone(&shared), config, means);
        let (answering, sending, again) = (Arc::clone(&shared), Arc::clone(&shared), Arc::clone(&shared));
        let newest = Arc::clone(&generation);
        let threads = vec![
            thread("camera-control", move || answering.answer(&sockets))?,
            thread("camera-film", move || film.run(&out))?,
            thread("camera-send", move || film::send(&sending, &generation, &takes))?,
            thread("camera-again", move || film::send_again(&again, &newest))?,
        ];
        Ok(Self { shared, threads })
    }

    /// Sets up what stands before the camera, as an operator does.
    pub fn obey(&self, setup: &Setup) {
        self.shared.world.obey(setup);
    }

    /// The simulated truth as a JSON object.
    #[must_use]
    pub fn truth(&self) -> serde_json::Value {
        self.shared.world.truth()
    }

    /// Makes these things go wrong, and nothing else, from now on.
    pub fn set_faults(&self, faults: GigeFaults) {
        *self.shared.faults.lock().unwrap_or_else(PoisonError::into_inner) = faults;
        self.shared.control().set_link_faults(faults.link);
    }

    /// The newest exposures of frames that were sent, the oldest first.
    #[must_use]
    pub fn exposures(&self) -> Vec<Exposure> {
        self.shared.exposures.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }

    /// Has it send that many of its next frames again and again, as fast as its rate and link go: rendering them takes no time
    /// any more. 0 ends that.
    pub fn repeat(&self, frames: usize) {
        self.shared.repeated.store(frames, Ordering::SeqCst);
    }

    /// Takes its power away for so long.
    pub fn restart(&self, away: Duration) {
        self.shared.control().restart(away, Instant::now());
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        self.shared.ended.store(true, Ordering::SeqCst);
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn thread(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.to_owned()).spawn(work)
}

impl Shared {
    fn control(&self) -> MutexGuard<'_, Control> {
        self.control.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn has_ended(&self) -> bool {
        self.ended.load(Ordering::SeqCst)
    }

    fn note(&self, exposure: Exposure) {
        let mut exposures = self.exposures.lock().unwrap_or_else(PoisonError::into_inner);
        exposures.push_back(exposure);
        if exposures.len() > EXPOSURES {
            exposures.pop_front();
        }
    }

    fn faults(&self) -> GigeFaults {
        *self.faults.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, control: MutexGuard<'a, Control>, at_most: Duration) -> MutexGuard<'a, Control> {
        self.changed.wait_timeout(control, at_most).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Answers whatever is asked until the camera ends.
    fn answer(&self, sockets: &[UdpSocket]) {
        let Some(control_socket) = sockets.first() else { return };
        let all: Vec<&UdpSocket> = sockets.iter().collect();
        for socket in &all {
            let _ = socket.set_nonblocking(true);
        }
        let mut datagram = vec![0; DATAGRAM];
        while !self.has_ended() {
            if let Err(error) = network::wait(&all, SLICE) {
                tracing::error!(%error, "the camera's sockets cannot be waited for");
                return;
            }
            self.control().expire(Instant::now());
            for socket in &all {
                // In turns: whoever sends faster than it is answered does not keep the others out.
                for _ in 0..AT_A_TIME {
                    let Ok((length, SocketAddr::V4(from))) = socket.recv_from(&mut datagram) else { break };
                    let faults = self.faults();
                    let unheard = faults.camera.unplugged || faults.link.deaf;
                    let answer =
                        if unheard { None } else { self.control().hear(&datagram[..length], from, Instant::now()) };
                    self.changed.notify_all();
                    if let Some(answer) = answer {
                        let _ = control_socket.send_to(&answer, from);
                    }
                }
            }
        }
    }
}
