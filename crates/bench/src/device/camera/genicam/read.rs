//! Reading the description of a camera on the network, of bounded length, in bounded time: without taking the camera
//! from whoever has it, or once it is this program's own.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use tokio::runtime::{Builder, Runtime};
use tokio::sync::Mutex;
use viva_genapi_xml::{XmlError, fetch_and_load_xml};
use viva_genicam::genapi::NodeMap;
use viva_genicam::gige::{GVCP_PORT, GigeDevice, GigeError, consts};
use viva_genicam::{Camera, GigeRegisterIo};

use super::allowance::left;
use super::bounded::{Wanted, within};
use super::features::{self, state};
use super::known::{self, Identity};
use super::transport::{Device, Transport};

/// Bytes of the longest description that is read, as the camera sends it: those of real cameras are a tenth of that.
pub(super) const MOST_BYTES: usize = 8 << 20;
/// How long a camera may take to send its description, or to say where it is.
const READ_WITHIN: Duration = Duration::from_secs(10);

/// Whoever reads a camera, and changes nothing of it.
pub(super) struct Reader {
    runtime: Runtime,
    device: GigeDevice,
}

/// A camera that is this program's own. The library's part of it works in a thread that ends with this.
pub(super) struct Opened {
    pub(super) device: Device,
    _runtime: Background,
}

impl Opened {
    /// One on USB, for which nothing works but what it is asked.
    pub(super) const fn of_usb(device: Device) -> Self {
        Self { device, _runtime: Background(None) }
    }
}

/// A runtime whose end is not waited for.
struct Background(Option<Runtime>);

impl Drop for Background {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
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
        let privilege = self.device.read_register(consts::CONTROL_CHANNEL_PRIVILEGE as u32);
        match self.runtime.block_on(async { tokio::time::timeout(READ_WITHIN, privilege).await }) {
            Ok(Ok(bits)) => bits & consts::CCP_CONTROLLER_BITS != 0,
            Ok(Err(error)) => features::is_denied(&error),
            Err(_) => false,
        }
    }

    /// Where the camera says that its description is.
    fn place(&mut self, allowed: Duration) -> Result<Vec<u8>, String> {
        let place = self.device.read_mem(consts::FIRST_URL, consts::URL_LEN);
        let place = self.runtime.block_on(async { tokio::time::timeout(allowed, place).await });
        place.map_err(|_| too_late("where its description is", allowed))?.map_err(|error| features::why(&error))
    }

    /// Reads the description until then, and looks at the camera by it.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn look<T: Send + 'static>(
        mut self,
        until: Instant,
        look: impl FnOnce(&Device) -> Result<T, String> + Send + 'static,
    ) -> Result<T, String> {
        let description = self.fetched(left(until).min(READ_WITHIN))?;
        within(left(until), move |_| {
            let Self { runtime, device } = self;
            let nodes = nodes(&description)?;
            let transport = Transport::Gige(GigeRegisterIo::monitor(runtime.handle().clone(), device));
            look(&Camera::new(transport, nodes))
        })
    }

    /// Takes control of the camera, while that is `wanted`, and reads its description: to be done [`within`] bounded
    /// time.
    ///
    /// # Errors
    /// Why not, in words; the camera is then let go.
    pub(super) fn take(mut self, wanted: &Wanted) -> Result<Opened, String> {
        wanted.check()?;
        wanted.speaks(self.runtime.handle());
        let claimed = self.runtime.block_on(async {
            let claim = async {
                self.device.claim_control().await?;
                // For what takes it longer. One that does not have it is asked again.
                let _ = self.device.enable_pending_ack().await;
                Ok::<(), GigeError>(())
            };
            tokio::time::timeout(READ_WITHIN, claim).await
        });
        let claimed = match claimed {
            Ok(claimed) => claimed.map_err(|error| features::why(&error)),
            Err(_) => Err(too_late("whether this program may have it", READ_WITHIN)),
        };
        let description = claimed.and_then(|()| self.fetched(READ_WITHIN)).inspect_err(|_| {
            // It may have been granted all the same.
            let _runtime = self.runtime.enter();
            let _ = self.device.try_send_release();
        })?;
        let Self { runtime, device } = self;
        let transport = Transport::Gige(GigeRegisterIo::new(runtime.handle().clone(), device));
        Ok(Opened { device: Camera::new(transport, nodes(&description)?), _runtime: Background(Some(runtime)) })
    }

    fn fetched(&mut self, allowed: Duration) -> Result<String, String> {
        let device = Mutex::new(&mut self.device);
        let fetched = self.runtime.block_on(async { tokio::time::timeout(allowed, description(&device)).await });
        fetched.map_err(|_| too_late("its description", allowed))?.map_err(|error| features::why(&error))
    }
}

fn too_late(what: &str, allowed: Duration) -> String {
    format!("{what} does not come within {:.0} s", allowed.as_secs_f64().ceil())
}

/// The features that a description tells of.
///
/// # Errors
/// Why it is not understood, in words.
pub(super) fn nodes(description: &str) -> Result<NodeMap, String> {
    let unreadable = |why: String| format!("its description is not understood: {why}");
    let model = viva_genapi_xml::parse(description).map_err(|error| unreadable(error.to_string()))?;
    NodeMap::try_from_xml(model).map_err(|error| unreadable(error.to_string()))
}

/// What a camera offers, asked until then: as it was read before, where its description is still the same, and else by
/// reading it, if it `may_be_read`; `None` where it may not.
///
/// # Errors
/// Why it cannot be read, and what to do, in words.
pub(super) fn offered(
    address: Ipv4Addr,
    identity: &Identity,
    until: Instant,
    may_be_read: impl FnOnce() -> bool,
) -> Result<Option<Vec<String>>, String> {
    let mut reader = Reader::open(address)?;
    let place = reader.place(left(until).min(READ_WITHIN))?;
    if let Some(formats) = known::formats(identity, Some(&place)) {
        return Ok(Some(formats));
    }
    if !may_be_read() {
        return Ok(None);
    }
    let formats = reader.look(until, formats)?;
    known::keep(identity, &place, &formats);
    Ok(Some(formats))
}

/// A camera's description, of [`MOST_BYTES`] at most.
async fn description(device: &Mutex<&mut GigeDevice>) -> Result<String, XmlError> {
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

/// The formats that an open camera offers, by their PFNC names.
///
/// # Errors
/// Why they cannot be read, in words.
pub(super) fn formats(device: &Device) -> Result<Vec<String>, String> {
    Ok(state(device, "PixelFormat")?.and_then(|state| state.enum_entries).unwrap_or_default())
}
