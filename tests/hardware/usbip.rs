//! A USB device that is a program's own: the guest's kernel attaches it by USB/IP, over a pair of sockets.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read as _, Write as _};
use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

const HOST: &str = "/sys/devices/platform/vhci_hcd.0";
/// Commands and their answers.
const SUBMIT: u32 = 1;
const UNLINK: u32 = 2;
const SUBMITTED: u32 = 3;
const UNLINKED: u32 = 4;
const HEADER: usize = 48;
/// Outcomes: an endpoint that stalls, a request that was taken back.
const PIPE: i32 = -32;
const RESET: i32 = -104;

/// How fast a device is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Speed {
    /// USB 2.
    High = 3,
    /// USB 3.
    Super = 5,
}

/// What a device does.
pub(crate) trait Device: Send + Sync + 'static {
    /// A descriptor, by kind and number.
    fn descriptor(&self, kind: u8, index: u8) -> Option<Vec<u8>>;

    /// Takes what is sent to an endpoint.
    fn take(&self, endpoint: u8, bytes: &[u8]);

    /// What an endpoint has now for a transfer of so many bytes: nothing yet, bytes, or `Err` where it stalls.
    fn give(&self, endpoint: u8, most: usize) -> Option<Result<Vec<u8>, ()>>;

    /// An endpoint begins anew.
    fn reset(&self, endpoint: u8);
}

/// Requests that wait for an endpoint's bytes, the oldest first: their number and most bytes.
type Waiting = BTreeMap<u8, VecDeque<(u32, usize)>>;

struct Port<D> {
    device: Arc<D>,
    socket: Mutex<UnixStream>,
    waiting: Mutex<(Waiting, bool)>,
    changed: Condvar,
}

/// A device that is plugged in until this is dropped.
pub(crate) struct Plugged {
    socket: UnixStream,
    end: Arc<dyn Fn() + Send + Sync>,
    threads: Vec<JoinHandle<()>>,
}

/// Plugs a device in.
pub(crate) fn plug<D: Device>(device: &Arc<D>, speed: Speed) -> Plugged {
    let (ours, kernels) = UnixStream::pair().unwrap();
    let number = free_port(speed);
    let order = format!("{number} {} {} {}", kernels.as_raw_fd(), 1, speed as u32);
    std::fs::write(format!("{HOST}/attach"), order).unwrap();
    drop(kernels);
    let port = Arc::new(Port {
        device: Arc::clone(device),
        socket: Mutex::new(ours.try_clone().unwrap()),
        waiting: Mutex::default(),
        changed: Condvar::new(),
    });
    let (hearing, giving, ended) = (Arc::clone(&port), Arc::clone(&port), Arc::clone(&port));
    let mut heard = ours.try_clone().unwrap();
    let threads = vec![
        std::thread::spawn(move || {
            // The other end is gone with the device.
            let _ = hearing.hear(&mut heard);
            hearing.end();
        }),
        std::thread::spawn(move || giving.give()),
    ];
    Plugged { socket: ours, end: Arc::new(move || ended.end()), threads }
}

impl Drop for Plugged {
    fn drop(&mut self) {
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
        (self.end)();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// A port of the host controller that nothing is plugged into.
fn free_port(speed: Speed) -> u32 {
    let wanted = if speed == Speed::Super { "ss" } else { "hs" };
    let status = std::fs::read_to_string(format!("{HOST}/status")).unwrap();
    let free = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        // The state of one that is free.
        (words.first() == Some(&wanted) && words.get(2) == Some(&"004")).then(|| words[1].parse().unwrap())
    };
    status.lines().find_map(free).unwrap_or_else(|| panic!("no port is free:\n{status}"))
}

fn word(header: &[u8; HEADER], at: usize) -> u32 {
    u32::from_be_bytes(header[at..at + 4].try_into().unwrap())
}

fn answer(command: u32, number: u32, status: i32, length: usize) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    for (at, value) in [(0, command), (4, number), (20, status as u32), (24, length as u32)] {
        header[at..at + 4].copy_from_slice(&value.to_be_bytes());
    }
    header
}

impl<D: Device> Port<D> {
    fn end(&self) {
        self.waiting.lock().unwrap().1 = true;
        self.changed.notify_all();
    }

    fn say(&self, header: &[u8; HEADER], bytes: &[u8]) -> io::Result<()> {
        let mut socket = self.socket.lock().unwrap();
        socket.write_all(header)?;
        socket.write_all(bytes)
    }

    /// Does what the kernel asks for, until it does not any more.
    fn hear(&self, socket: &mut UnixStream) -> io::Result<()> {
        let mut header = [0; HEADER];
        loop {
            socket.read_exact(&mut header)?;
            let [command, number, direction, endpoint] = [0, 4, 12, 16].map(|at| word(&header, at));
            if command == UNLINK {
                let of = word(&header, 20);
                let mut waiting = self.waiting.lock().unwrap();
                let before: usize = waiting.0.values().map(VecDeque::len).sum();
                waiting.0.values_mut().for_each(|queue| queue.retain(|(number, _)| *number != of));
                let after: usize = waiting.0.values().map(VecDeque::len).sum();
                let status = if after < before { RESET } else { 0 };
                self.say(&answer(UNLINKED, number, status, 0), &[])?;
                continue;
            }
            assert_eq!(command, SUBMIT, "the kernel asks for nothing else");
            let length = word(&header, 24) as usize;
            let mut bytes = vec![0; if direction == 0 { length } else { 0 }];
            socket.read_exact(&mut bytes)?;
            match (endpoint as u8, direction) {
                (0, _) => self.control(number, &header[40..48], length)?,
                (endpoint, 0) => {
                    self.device.take(endpoint, &bytes);
                    self.say(&answer(SUBMITTED, number, 0, length), &[])?;
                    self.changed.notify_all();
                }
                (endpoint, _) => {
                    self.waiting.lock().unwrap().0.entry(endpoint).or_default().push_back((number, length));
                    self.changed.notify_all();
                }
            }
        }
    }

    /// Answers a request of those that every device has.
    fn control(&self, number: u32, setup: &[u8], most: usize) -> io::Result<()> {
        let (to_host, request) = (setup[0] & 0x80 != 0, setup[1]);
        if to_host {
            let found = match request {
                // A state, a descriptor, the configuration.
                0 => Some(vec![0, 0]),
                6 => self.device.descriptor(setup[3], setup[2]),
                8 => Some(vec![1]),
                _ => None,
            };
            return match found {
                Some(mut bytes) => {
                    bytes.truncate(most);
                    self.say(&answer(SUBMITTED, number, 0, bytes.len()), &bytes)
                }
                None => self.say(&answer(SUBMITTED, number, PIPE, 0), &[]),
            };
        }
        // An endpoint that is halted, or set going again.
        if setup[0] == 2 && matches!(request, 1 | 3) {
            self.device.reset(setup[4] & 0x0f);
        }
        self.say(&answer(SUBMITTED, number, 0, most), &[])
    }

    /// Gives what endpoints have to whoever waits for it.
    fn give(&self) {
        let mut waiting = self.waiting.lock().unwrap();
        loop {
            if waiting.1 {
                return;
            }
            let mut gave = false;
            for (endpoint, queue) in &mut waiting.0 {
                let Some(&(number, most)) = queue.front() else { continue };
                let Some(given) = self.device.give(*endpoint, most) else { continue };
                queue.pop_front();
                gave = true;
                let done = match given {
                    Ok(bytes) => self.say(&answer(SUBMITTED, number, 0, bytes.len()), &bytes),
                    Err(()) => self.say(&answer(SUBMITTED, number, PIPE, 0), &[]),
                };
                if done.is_err() {
                    return;
                }
            }
            if !gave {
                waiting = self.changed.wait_timeout(waiting, Duration::from_millis(2)).unwrap().0;
            }
        }
    }
}
