//! Cameras on USB: which there are, what they say of themselves, and opening them. Which there are the kernel tells, and none
//! is disturbed for that; what a camera says of itself is read by opening it, which only one program can at a time.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use nix::errno::Errno;
use nix::unistd::{AccessFlags, eaccess};
use viva_genapi_xml::{XmlError, fetch_and_load_xml};
use viva_genicam::Camera;
use viva_genicam::U3vRegisterIo;
use viva_genicam::u3v::{self, NusbTransfer, U3vDevice, U3vDeviceInfo, U3vError, UsbSpeed, UsbTransfer};

use super::bounded::{OPEN_WITHIN, within};
use super::features;
use super::known;
use super::read::{self, MOST_BYTES, Opened};
use super::target::{Site, Target, given};
use super::transport::{Device, Transport};

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

/// The memory that the kernel gives all programs for what is under way on USB, MiB; 0: as much as they want; `None` where it
/// does not say.
#[must_use]
pub fn memory_mib() -> Option<u32> {
    std::fs::read_to_string(MEMORY).ok()?.trim().parse().ok()
}

/// The memory that a camera's stream has the kernel keep, bytes.
pub const STREAM_BYTES: u64 = u3v::DEFAULT_MAX_TRANSFER_SIZE as u64 * u3v::DEFAULT_TRANSFERS_IN_FLIGHT as u64;

/// What USB carries of frames at a speed, Mbit/s: what is left of it once its own framing is taken off; `None` for one that is
/// not known.
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

/// The cameras that are connected, with what they say of themselves where `asked` for: that takes opening them, those that this
/// program has in use excepted.
///
/// # Errors
/// As [`connected`].
pub(super) fn targets(asked: impl Fn(&[U3vDeviceInfo]) -> bool) -> Result<Vec<Target>, String> {
    let there = connected()?;
    let ask = asked(&there);
    let of = |info: U3vDeviceInfo| {
        let names = if ask { names(&info) } else { Ok(said(&info).unwrap_or_default()) };
        Target::Usb(info, names)
    };
    Ok(there.into_iter().map(of).collect())
}

fn said(info: &U3vDeviceInfo) -> Option<Names> {
    let said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
    said.iter().find(|(of, _)| of == info).map(|(_, names)| names.clone())
}

fn names(info: &U3vDeviceInfo) -> Result<Names, String> {
    let site = Site::Usb { bus: info.bus.clone(), address: info.address };
    // What this program has in use, or is just opening, is not disturbed.
    if known::is_in_use(&site) {
        return Ok(said(info).unwrap_or_default());
    }
    open_device(info).map(|_| said(info).unwrap_or_default())
}

/// Opens a camera, which takes a second for each thing that it does not answer.
///
/// # Errors
/// Why it cannot be opened, and what to do, in words.
fn open_device(info: &U3vDeviceInfo) -> Result<U3vDevice<NusbTransfer>, String> {
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
    let info = info.clone();
    within(OPEN_WITHIN, move |_| {
        let device = U3vDevice::open_device(&info).map_err(|error| features::why(&error))?;
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
        said.push((info, names));
        Ok(device)
    })
}

/// The first entry of a camera's manifest that is of a description: where that is, how long, and of which version.
///
/// # Errors
/// Why it cannot be read.
pub(super) fn manifest<T: UsbTransfer>(device: &mut U3vDevice<T>) -> Result<Vec<u8>, U3vError> {
    let table = device.abrm().manifest_table_address;
    let count = word(&device.read_mem(table, 8)?);
    for index in 0..count.min(MOST_ENTRIES) {
        let at = table.wrapping_add(ENTRIES + index * ENTRY_BYTES as u64);
        let entry = device.read_mem(at, ENTRY_BYTES)?;
        // Another kind describes what is sent with frames.
        if entry.get(4).is_some_and(|kind| kind & 0x07 == 0) {
            return Ok(entry);
        }
    }
    Err(U3vError::Device("names no description in its manifest"))
}

/// The number that bytes begin with.
fn word(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// A camera's description, of [`MOST_BYTES`] at most.
async fn description<T: UsbTransfer>(device: &mut U3vDevice<T>) -> Result<String, XmlError> {
    let entry = manifest(device).map_err(XmlError::transport)?;
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
            device.borrow_mut().read_mem(address, bytes).map_err(XmlError::transport)
        };
        async move { read }
    };
    fetch_and_load_xml(part).await
}

/// Opens a camera and reads its description.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(info: &U3vDeviceInfo) -> Result<Opened, String> {
    let device = open_device(info)?;
    within(OPEN_WITHIN, move |_| Ok(Opened::of_usb(described(device)?)))
}

/// A camera with the features that its description tells of.
fn described(mut device: U3vDevice<NusbTransfer>) -> Result<Device, String> {
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    let runtime = runtime.map_err(|error| format!("its description cannot be read: {error}"))?;
    let description = runtime.block_on(description(&mut device)).map_err(|error| features::why(&error))?;
    Ok(Camera::new(Transport::Usb(U3vRegisterIo::new(device)), read::nodes(&description)?))
}

/// What a camera offers, as [`read::offered`] has it.
///
/// # Errors
/// Why it cannot be read, and what to do, in words.
pub(super) fn offered(info: &U3vDeviceInfo, may_be_read: impl FnOnce() -> bool) -> Result<Option<Vec<String>>, String> {
    let mut device = open_device(info)?;
    let identity = known::Identity::of_usb(info);
    let place = manifest(&mut device).map_err(|error| features::why(&error))?;
    if let Some(formats) = known::formats(&identity, Some(&place)) {
        return Ok(Some(formats));
    }
    if !may_be_read() {
        return Ok(None);
    }
    let formats = within(OPEN_WITHIN, move |_| read::formats(&described(device)?))?;
    known::keep(&identity, &place, &formats);
    Ok(Some(formats))
}
