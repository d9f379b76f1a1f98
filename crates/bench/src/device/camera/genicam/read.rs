//! Reading what a camera offers without taking it from whoever has it: its description, of bounded length, in bounded time.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::Mutex;
use viva_genapi_xml::{XmlError, fetch_and_load_xml};
use viva_genicam::genapi::{NodeMap, RegisterIo as _};
use viva_genicam::gige::{GVCP_PORT, GigeDevice, consts};
use viva_genicam::{Camera, GigeRegisterIo};

use super::features::{self, Device, state};
use super::known::{self, Identity};

/// Bytes of the longest description that is read, as the camera sends it: those of real cameras are a tenth of that.
const MOST_BYTES: usize = 8 << 20;
/// How long a camera may take to send its description.
const READ_WITHIN: Duration = Duration::from_secs(10);

/// Whoever reads a camera, and changes nothing of it.
pub(super) struct Reader {
    runtime: Runtime,
    device: GigeDevice,
}

impl Reader {
    /// Reads the camera at this address. Nothing is asked of it yet.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn open(address: Ipv4Addr) -> Result<Self, String> {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(|error| format!("there is no thread to read it in: {error}"))?;
        let address = SocketAddr::new(IpAddr::V4(address), GVCP_PORT);
        let device = runtime.block_on(GigeDevice::open(address)).map_err(|error| features::why(&error))?;
        Ok(Self { runtime, device })
    }

    /// Whether somebody has control of the camera; `false` where it does not say.
    pub(super) fn is_controlled(&mut self) -> bool {
        let privilege = self.runtime.block_on(self.device.read_register(consts::CONTROL_CHANNEL_PRIVILEGE as u32));
        match privilege {
            Ok(bits) => bits & consts::CCP_CONTROLLER_BITS != 0,
            Err(error) => features::is_denied(&error),
        }
    }

    /// Where the camera says that its description is.
    fn place(&mut self) -> Result<Vec<u8>, String> {
        let place = self.runtime.block_on(self.device.read_mem(consts::FIRST_URL, consts::URL_LEN));
        place.map_err(|error| features::why(&error))
    }

    /// Reads the description, and looks at the camera by it.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn look<T>(self, look: impl FnOnce(&Device) -> Result<T, String>) -> Result<T, String> {
        let Self { runtime, device } = self;
        let device = Mutex::new(device);
        let fetched = runtime.block_on(async { tokio::time::timeout(READ_WITHIN, description(&device)).await });
        let description = fetched
            .map_err(|_| format!("its description does not come within {} s", READ_WITHIN.as_secs()))?
            .map_err(|error| features::why(&error))?;
        let unreadable = |why: String| format!("its description is not understood: {why}");
        let model = viva_genapi_xml::parse(&description).map_err(|error| unreadable(error.to_string()))?;
        let nodes = NodeMap::try_from_xml(model).map_err(|error| unreadable(error.to_string()))?;
        let transport = GigeRegisterIo::monitor(runtime.handle().clone(), device.into_inner());
        let camera = Camera::new(transport, nodes);
        look(&camera)
    }
}

/// What a camera offers: as it was read before, where its description is still the same, and else by reading it, if it
/// `may_be_read`; `None` where it may not.
///
/// # Errors
/// Why it cannot be read, and what to do, in words.
pub(super) fn offered(identity: &Identity, may_be_read: impl FnOnce() -> bool) -> Result<Option<Vec<String>>, String> {
    let mut reader = Reader::open(identity.address)?;
    let place = reader.place()?;
    if let Some(formats) = known::formats(identity, Some(&place)) {
        return Ok(Some(formats));
    }
    if !may_be_read() {
        return Ok(None);
    }
    let formats = reader.look(formats)?;
    known::keep(identity, &place, &formats);
    Ok(Some(formats))
}

/// A camera's description, of [`MOST_BYTES`] at most.
async fn description(device: &Mutex<GigeDevice>) -> Result<String, XmlError> {
    let mut left = MOST_BYTES;
    let part = |address, bytes| {
        let granted = left.checked_sub(bytes);
        left = granted.unwrap_or(0);
        async move {
            if granted.is_none() {
                let why = format!("it would be {bytes} bytes long, and {MOST_BYTES} are read at most");
                return Err(XmlError::transport(why));
            }
            device.lock().await.read_mem(address, bytes).await.map_err(XmlError::transport)
        }
    };
    fetch_and_load_xml(part).await
}

/// Where a camera says that its description is.
///
/// # Errors
/// Why it cannot be read, in words.
pub(super) fn place(device: &Device) -> Result<Vec<u8>, String> {
    device.transport().read(consts::FIRST_URL, consts::URL_LEN).map_err(|error| features::why(&error))
}

/// The formats that an open camera offers, by their PFNC names.
///
/// # Errors
/// Why they cannot be read, in words.
pub(super) fn formats(device: &Device) -> Result<Vec<String>, String> {
    Ok(state(device, "PixelFormat")?.and_then(|state| state.enum_entries).unwrap_or_default())
}
