//! Cameras on USB: which there are, what they say of themselves, and opening them. Which there are the kernel tells,
//! and none is disturbed for that; what a camera says of itself is read by opening it, which only one program can at a
//! time.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use nix::errno::Errno;
use nix::unistd::{AccessFlags, eaccess};
use viva_genapi_xml::{XmlError, fetch_and_load_xml};
use viva_genicam::Camera;
use viva_genicam::U3vRegisterIo;
use viva_genicam::u3v::{self, NusbTransfer, U3vDevice, U3vDeviceInfo, UsbSpeed, UsbTransfer};

use super::allowance::left;
use super::bounded::{Wanted, within};
use super::features;
use super::known;
use super::read::{self, MOST_BYTES, Opened};
use super::target::{Site, Target, given};
use super::transport::{Device, Transport};
use super::turn::Turn;

/// Where the kernel shows what is on USB.
const DEVICES: &str = "/sys/bus/usb/devices";
/// How much memory the kernel gives all programs for what is under way on USB, MiB.
const MEMORY: &str = "/sys/module/usbcore/parameters/usbfs_memory_mb";
/// What a description's address is read by, in place of a register that a camera on USB has not.
const FIRST_URL: u64 = 0x0200;
/// A manifest begins with the number of its entries, which are so many bytes each, of which so many are looked at.
const ENTRIES: u64 = 8;
const ENTRY_BYTES: usize = 64;
const MOST_ENTRIES: u64 = 16;
/// So many bytes of a description are read before it is asked whether they are wanted still.
const PIECE: usize = 4096;
/// How long a camera may say that its answers take, ms.
const MOST_ANSWER_MS: u32 = 5000;
/// What a camera says of itself is kept of so many.
const KEPT: usize = 16;

/// What a camera says of itself that the kernel does not know.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Names {
    /// Its serial number, where it has another than its USB device has.
    pub(super) serial: Option<String>,
    /// The name that a user gave it.
    pub(super) user_name: Option<String>,
}

/// What the cameras said when they were last read: of one that is in use it is not read again.
static SAID: Mutex<Vec<(U3vDeviceInfo, Names)>> = Mutex::new(Vec::new());

/// The memory that the kernel gives all programs for what is under way on USB, MiB; 0: as much as they want; `None`
/// where it does not say.
#[must_use]
pub fn memory_mib() -> Option<u32> {
    std::fs::read_to_string(MEMORY).ok()?.trim().parse().ok()
}

/// The memory that a camera's stream has the kernel keep, bytes.
pub const STREAM_BYTES: u64 = u3v::DEFAULT_MAX_TRANSFER_SIZE as u64 * u3v::DEFAULT_TRANSFERS_IN_FLIGHT as u64;

/// What USB carries of frames at a speed, Mbit/s: what is left of it once its own framing is taken off; `None` for one
/// that is not known.
pub(super) const fn carried_mbit_per_s(speed: UsbSpeed) -> Option<u32> {
    match speed {
        UsbSpeed::Low | UsbSpeed::Full => Some(8),
        UsbSpeed::High => Some(320),
        UsbSpeed::Super => Some(3200),
        UsbSpeed::SuperPlus => Some(7600),
        _ => None,
    }
}

/// The device file of what is at an address of a bus.
pub(super) fn device_file(info: &U3vDeviceInfo) -> PathBuf {
    Path::new("/dev/bus/usb").join(&info.bus).join(format!("{:03}", info.address))
}

/// The USB3 Vision cameras that are connected.
///
/// # Errors
/// Why that cannot be told, in words.
pub(super) fn connected() -> Result<Vec<U3vDeviceInfo>, String> {
    // A machine, or a container, without USB has none.
    if !Path::new(DEVICES).exists() {
        return Ok(Vec::new());
    }
    u3v::discover().map_err(|error| format!("cameras on USB cannot be looked for: {error}"))
}

/// The cameras that are connected, none of which is asked: of those that this program has in use, with what they said
/// of themselves.
///
/// # Errors
/// As [`connected`].
pub(super) fn targets() -> Result<Vec<Target>, String> {
    let of = |info: U3vDeviceInfo| {
        let names = if known::is_in_use(&site(&info)) { said(&info).unwrap_or_default() } else { Names::default() };
        Target::Usb(info, Ok(names))
    };
    Ok(connected()?.into_iter().map(of).collect())
}

/// Where a camera is.
pub(super) fn site(info: &U3vDeviceInfo) -> Site {
    Site::Usb { bus: info.bus.clone(), address: info.address }
}

/// What a camera said of itself when it was last opened.
pub(super) fn said(info: &U3vDeviceInfo) -> Option<Names> {
    let said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.iter().find(|(of, _)| of == info).map(|(_, names)| names.clone())
}

/// What a camera says of itself, asked until then: that takes opening it, except where this program has it in use.
///
/// # Errors
/// Why it cannot be opened, in words.
pub(super) fn names(info: &U3vDeviceInfo, until: Instant) -> Result<Names, String> {
    let asked = info.clone();
    within(left(until), move |wanted| {
        let _turn = Turn::at(site(&asked), wanted)?;
        if known::is_in_use(&site(&asked)) {
            return Ok(());
        }
        open_device(&asked, wanted).map(drop)
    })?;
    Ok(said(info).unwrap_or_default())
}

/// Opens a camera at this program's [`Turn`], which takes a second for each thing that it does not answer: to be done
/// [`within`] bounded time.
///
/// # Errors
/// Why it cannot be opened, and what to do, in words.
fn open_device(info: &U3vDeviceInfo, wanted: &Wanted) -> Result<U3vDevice<NusbTransfer>, String> {
    let file = device_file(info);
    match eaccess(&file, AccessFlags::R_OK | AccessFlags::W_OK) {
        Err(Errno::ENOENT) => return Err(features::UNPLUGGED.to_owned()),
        Err(Errno::EACCES) => {
            return Err(format!(
                "{} may not be opened by this user: put deploy/udev/70-plenalign.rules into /etc/udev/rules.d, and plug \
                 the camera in again",
                file.display()
            ));
        }
        _ => {}
    }
    wanted.check()?;
    let device = U3vDevice::open_device(info).map_err(|error| features::why(&error))?;
    let abrm = device.abrm();
    // By this number the library waits for every answer.
    if abrm.max_device_response_time_ms > MOST_ANSWER_MS {
        return Err(format!(
            "it says that its answers may take {} ms: no more than {MOST_ANSWER_MS} ms are waited for",
            abrm.max_device_response_time_ms
        ));
    }
    let names = Names { serial: given(Some(&abrm.serial_number)), user_name: given(Some(&abrm.user_defined_name)) };
    let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.retain(|(of, _)| (&of.bus, of.address) != (&info.bus, info.address));
    if said.len() >= KEPT {
        said.remove(0);
    }
    said.push((info.clone(), names));
    Ok(device)
}

/// The first entry of a camera's manifest that is of a description: where that is, how long, and of which version. It
/// is read while that is `wanted`.
///
/// # Errors
/// Why it cannot be read, in words.
pub(super) fn manifest<T: UsbTransfer>(device: &mut U3vDevice<T>, wanted: &Wanted) -> Result<Vec<u8>, String> {
    let table = device.abrm().manifest_table_address;
    let mut read = |at, bytes| {
        wanted.check()?;
        device.read_mem(at, bytes).map_err(|error| features::why(&error))
    };
    let count = word(&read(table, 8)?);
    for index in 0..count.min(MOST_ENTRIES) {
        let at = table.wrapping_add(ENTRIES + index * ENTRY_BYTES as u64);
        let entry = read(at, ENTRY_BYTES)?;
        // Another kind describes what is sent with frames.
        if entry.get(4).is_some_and(|kind| kind & 0x07 == 0) {
            return Ok(entry);
        }
    }
    Err("it names no description in its manifest".to_owned())
}

/// The number that bytes begin with.
fn word(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// A camera's description, of [`MOST_BYTES`] at most, fetched while it is `wanted`.
async fn description<T: UsbTransfer>(device: &mut U3vDevice<T>, wanted: &Wanted) -> Result<String, XmlError> {
    let entry = manifest(device, wanted).map_err(XmlError::transport)?;
    let (at, length) = (word(entry.get(8..).unwrap_or_default()), word(entry.get(16..).unwrap_or_default()));
    if length > MOST_BYTES as u64 {
        return Err(XmlError::transport(format!("it would be {length} bytes long, and {MOST_BYTES} are read at most")));
    }
    let device = std::cell::RefCell::new(device);
    // The library looks for it as on a network, in a register that says where it is.
    let part = |address, bytes: usize| {
        let read = if address == FIRST_URL && bytes > 0 {
            let mut url = format!("Local:description.zip;{at:x};{length:x}").into_bytes();
            url.resize(bytes, 0);
            Ok(url)
        } else {
            read_while(&mut device.borrow_mut(), (address, bytes), wanted).map_err(XmlError::transport)
        };
        async move { read }
    };
    fetch_and_load_xml(part).await
}

/// Reads so many bytes of memory while they are `wanted`: each piece may take as long as the camera may for an answer.
fn read_while<T: UsbTransfer>(
    device: &mut U3vDevice<T>,
    (at, bytes): (u64, usize),
    wanted: &Wanted,
) -> Result<Vec<u8>, String> {
    let mut memory = Vec::with_capacity(bytes);
    while memory.len() < bytes {
        wanted.check()?;
        let piece = PIECE.min(bytes - memory.len());
        let from = at.wrapping_add(memory.len() as u64);
        memory.extend(device.read_mem(from, piece).map_err(|error| features::why(&error))?);
    }
    Ok(memory)
}

/// Opens a camera at this program's [`Turn`] and reads its description: to be done [`within`] bounded time.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(info: &U3vDeviceInfo, wanted: &Wanted) -> Result<Opened, String> {
    let device = open_device(info, wanted)?;
    Ok(Opened::of_usb(described(device, wanted)?))
}

/// A camera with the features that its description tells of. It is let go of as soon as it is not `wanted` any more,
/// even where its description is worked out for ever; looking features up by it is not covered by that.
fn described(mut device: U3vDevice<NusbTransfer>, wanted: &Wanted) -> Result<Device, String> {
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    let runtime = runtime.map_err(|error| format!("its description cannot be read: {error}"))?;
    let description = runtime.block_on(description(&mut device, wanted)).map_err(|error| features::why(&error))?;
    let nodes = wanted.part(move || read::nodes(&description))?;
    Ok(Camera::new(Transport::Usb(U3vRegisterIo::new(device)), nodes))
}

/// What a camera offers, as [`read::offered`] has it; of one that this program has in use, as it was read last.
///
/// # Errors
/// Why it cannot be read, and what to do, in words.
pub(super) fn offered(
    info: &U3vDeviceInfo,
    until: Instant,
    may_be_read: impl FnOnce() -> bool,
) -> Result<Option<Vec<String>>, String> {
    let identity = known::Identity::of_usb(info);
    let (asked, asked_identity) = (info.clone(), identity.clone());
    let unread = within(left(until), move |wanted| {
        let turn = Turn::at(site(&asked), wanted)?;
        if known::is_in_use(&site(&asked)) {
            return Ok(Err(known::formats(&asked_identity, None)));
        }
        let mut device = open_device(&asked, wanted)?;
        let place = manifest(&mut device, wanted)?;
        Ok(match known::formats(&asked_identity, Some(&place)) {
            Some(formats) => Err(Some(formats)),
            None => Ok((device, turn, place)),
        })
    })?;
    let (device, turn, place) = match unread {
        Ok(unread) => unread,
        Err(formats) => return Ok(formats),
    };
    if !may_be_read() {
        // The turn ends once the camera is let go of.
        drop((device, turn));
        return Ok(None);
    }
    let formats = within(left(until), move |wanted| {
        // It ends once the camera is let go of.
        let _turn = turn;
        read::formats(&described(device, wanted)?)
    })?;
    known::keep(&identity, &place, &formats);
    Ok(Some(formats))
}
