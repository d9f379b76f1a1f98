//! What carries a camera's registers and its frames: GigE Vision or USB3 Vision. What is done with a camera is the same
//! by either; what differs between the two in an open camera is here and in [`super::hold`].

use std::time::{Duration, Instant};

use viva_genicam::genapi::{GenApiError, RegisterIo};
use viva_genicam::gige::consts;
use viva_genicam::u3v::NusbTransfer;
use viva_genicam::u3v::registers::{abrm, capability};
use viva_genicam::{
    Camera, Frame, FrameStream, GenicamError, GigeRegisterIo, StreamOptions, StreamStats, U3vFrameStream,
    U3vRegisterIo, U3vStreamBuilder, U3vStreamOptions,
};

use super::bounded::Wanted;
use super::clock::Latch;
use super::features;

/// An open camera.
pub(super) type Device = Camera<Transport>;

/// GigE Vision's registers of a camera's clock.
const TICKS_A_SECOND: u64 = 0x093c;
const TIMESTAMP_CONTROL: u64 = 0x0944;
const TIMESTAMP: u64 = 0x0948;
/// What, written to the timestamps' control, keeps the present one to be read.
const LATCH: u32 = 2;
/// The same of one on USB.
const USB_LATCH: u32 = 1;
/// USB3 Vision's clocks count nanoseconds.
const NANOSECONDS: u64 = 1_000_000_000;

/// The way to an open camera's registers.
pub(super) enum Transport {
    /// Over a network.
    Gige(GigeRegisterIo),
    /// Over USB.
    Usb(U3vRegisterIo<NusbTransfer>),
}

impl RegisterIo for Transport {
    fn read(&self, at: u64, bytes: usize) -> Result<Vec<u8>, GenApiError> {
        match self {
            Self::Gige(gige) => gige.read(at, bytes),
            Self::Usb(usb) => usb.read(at, bytes),
        }
    }

    fn write(&self, at: u64, bytes: &[u8]) -> Result<(), GenApiError> {
        match self {
            Self::Gige(gige) => gige.write(at, bytes),
            Self::Usb(usb) => usb.write(at, bytes),
        }
    }
}

impl Transport {
    /// What the camera says of where its description is, read while that is `wanted`: another when the description is.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn place(&self, wanted: &Wanted) -> Result<Vec<u8>, String> {
        match self {
            Self::Gige(gige) => gige.read(consts::FIRST_URL, consts::URL_LEN).map_err(|error| features::why(&error)),
            Self::Usb(usb) => {
                let mut device = usb.lock_device().map_err(|error| features::why(&error))?;
                super::usb::manifest(&mut device, wanted)
            }
        }
    }

    /// Ticks of the camera's clock a second; 0 where it has none.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn ticks_a_second(&self) -> Result<u64, String> {
        match self {
            Self::Gige(_) => self.long(TICKS_A_SECOND),
            Self::Usb(usb) => {
                let device = usb.lock_device().map_err(|error| features::why(&error))?;
                let has = device.abrm().device_capability & capability::TIMESTAMP != 0;
                Ok(if has { NANOSECONDS } else { 0 })
            }
        }
    }

    /// Reads the camera's clock.
    ///
    /// # Errors
    /// Why it cannot be read, in words.
    pub(super) fn latch(&self) -> Result<Latch, String> {
        let (control, value) = match self {
            Self::Gige(_) => (TIMESTAMP_CONTROL, LATCH.to_be_bytes()),
            Self::Usb(_) => (abrm::TIMESTAMP_LATCH, USB_LATCH.to_le_bytes()),
        };
        let before = Instant::now();
        self.write(control, &value).map_err(|error| features::why(&error))?;
        let after = Instant::now();
        let ticks = match self {
            Self::Gige(_) => self.long(TIMESTAMP)?,
            Self::Usb(_) => u64::from_le_bytes(self.register(abrm::TIMESTAMP)?),
        };
        Ok(Latch { ticks, before, after })
    }

    fn register<const BYTES: usize>(&self, at: u64) -> Result<[u8; BYTES], String> {
        let bytes = self.read(at, BYTES).map_err(|error| features::why(&error))?;
        bytes.try_into().map_err(|_| "no register".to_owned())
    }

    /// A number of two registers, the high one first.
    fn long(&self, at: u64) -> Result<u64, String> {
        let half = |at| self.register(at).map(|bytes| u64::from(u32::from_be_bytes(bytes)));
        Ok(half(at)? << 32 | half(at + 4)?)
    }

    /// Opens a stream of frames of `payload` bytes each, where the camera says how many. `options` are those of a
    /// network.
    ///
    /// # Errors
    /// Why it cannot be opened.
    pub(super) fn open_stream(
        &self,
        options: StreamOptions,
        held: Duration,
        payload: Option<usize>,
    ) -> Result<Frames, GenicamError> {
        match self {
            Self::Gige(gige) => {
                let options = match payload {
                    Some(bytes) => options.payload_size(bytes),
                    None => options,
                };
                let mut frames = gige.open_stream(options)?;
                frames.set_block_timeout(held);
                Ok(Frames::Gige(frames))
            }
            Self::Usb(usb) => {
                let hint = payload.map_or(0, |bytes| bytes as u64);
                let options = U3vStreamOptions { payload_size_hint: hint, ..U3vStreamOptions::default() };
                U3vStreamBuilder::new(usb).options(options).build().map(Frames::Usb)
            }
        }
    }
}

/// The stream of an open camera's frames.
pub(super) enum Frames {
    /// Over a network.
    Gige(FrameStream),
    /// Over USB.
    Usb(U3vFrameStream),
}

impl Frames {
    /// Waits so long for the next frame; `None` once the stream has ended.
    ///
    /// # Errors
    /// [`GenicamError::Timeout`] where none came, else why none will.
    pub(super) fn next(&mut self, wait: Duration) -> Result<Option<Frame>, GenicamError> {
        match self {
            Self::Gige(frames) => frames.next_frame_blocking(wait),
            Self::Usb(frames) => frames.next_frame_blocking(wait),
        }
    }

    /// What was counted since the stream was opened.
    pub(super) fn stats(&self) -> StreamStats {
        match self {
            Self::Gige(frames) => frames.stats(),
            Self::Usb(frames) => frames.stats(),
        }
    }
}
