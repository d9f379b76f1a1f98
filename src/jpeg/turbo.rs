//! libjpeg-turbo by its TurboJPEG interface, loaded while the program runs: it is used where it is installed, and nothing
//! has to be there to build or to start.

// A library's functions, and memory handed to them.
#![expect(unsafe_code)]

use std::ffi::{CStr, c_char, c_int, c_uchar, c_ulong, c_void};
use std::ptr::NonNull;

use libloading::Library;

/// The library's name since its version 1.2; 2.x and 3.x have kept these functions.
const LIBRARY: &str = "libturbojpeg.so.0";
/// `TJPF_GRAY`: one byte a pixel.
const PIXELS_GREY: c_int = 6;
/// `TJSAMP_GRAY`: luminance alone.
const SAMPLING_GREY: c_int = 3;
/// `TJFLAG_NOREALLOC`: the caller's memory is used, and no other.
const NO_REALLOC: c_int = 1024;
/// `TJFLAG_ACCURATEDCT`: the exact transform; with SIMD it costs next to nothing.
const ACCURATE_DCT: c_int = 4096;

type Init = unsafe extern "C" fn() -> *mut c_void;
type Destroy = unsafe extern "C" fn(*mut c_void) -> c_int;
type BufferSize = unsafe extern "C" fn(c_int, c_int, c_int) -> c_ulong;
type ErrorText = unsafe extern "C" fn(*mut c_void) -> *mut c_char;
/// Handle, pixels, width, pitch, height, pixel format, JPEG, its size, subsampling, quality, flags.
type Compress = unsafe extern "C" fn(
    *mut c_void,
    *const c_uchar,
    c_int,
    c_int,
    c_int,
    c_int,
    *mut *mut c_uchar,
    *mut c_ulong,
    c_int,
    c_int,
    c_int,
) -> c_int;

/// Why libjpeg-turbo is not used, or has not encoded.
#[derive(Debug, thiserror::Error)]
pub enum TurboError {
    /// It is not installed, or is another than it says.
    #[error("{LIBRARY} cannot be used: {0}")]
    Absent(#[from] libloading::Error),
    /// There are not as many samples as pixels.
    #[error("{found} samples are not {width}x{height}")]
    Samples {
        /// Samples given.
        found: usize,
        /// Columns.
        width: u16,
        /// Rows.
        height: u16,
    },
    /// What the library says.
    #[error("libjpeg-turbo: {0}")]
    Refused(String),
}

/// libjpeg-turbo, loaded.
pub struct TurboJpeg {
    init: Init,
    destroy: Destroy,
    buffer_size: BufferSize,
    error_text: ErrorText,
    compress: Compress,
    /// What the functions above are in: it stays loaded for as long as they can be called.
    _library: Library,
}

/// One compressor of the library; not to be used by two threads at once.
struct Compressor<'a> {
    turbo: &'a TurboJpeg,
    handle: NonNull<c_void>,
}

impl Drop for Compressor<'_> {
    fn drop(&mut self) {
        // SAFETY: the handle came from `tjInitCompress` and is given back here only.
        unsafe { (self.turbo.destroy)(self.handle.as_ptr()) };
    }
}

impl Compressor<'_> {
    /// What the library says of the last failure.
    fn failure(&self) -> TurboError {
        // SAFETY: the handle is valid. The text is the handle's own, ends with a zero and is copied before the handle is
        // used again.
        let said = unsafe {
            let text = (self.turbo.error_text)(self.handle.as_ptr());
            if text.is_null() { None } else { Some(CStr::from_ptr(text).to_string_lossy().into_owned()) }
        };
        TurboError::Refused(said.unwrap_or_else(|| "it does not say why it failed".to_owned()))
    }
}

impl TurboJpeg {
    /// Loads the library from where the system has it.
    ///
    /// # Errors
    /// [`TurboError::Absent`] where it is not installed, or lacks a function.
    pub fn load() -> Result<Self, TurboError> {
        // SAFETY: the library named is libjpeg-turbo's, whose loading does nothing but load it. The types are those of
        // its header turbojpeg.h, unchanged since its version 1.4; `_library` keeps the functions loaded.
        unsafe {
            let library = Library::new(LIBRARY)?;
            Ok(Self {
                init: *library.get::<Init>(b"tjInitCompress\0")?,
                destroy: *library.get::<Destroy>(b"tjDestroy\0")?,
                buffer_size: *library.get::<BufferSize>(b"tjBufSize\0")?,
                error_text: *library.get::<ErrorText>(b"tjGetErrorStr2\0")?,
                compress: *library.get::<Compress>(b"tjCompress2\0")?,
                _library: library,
            })
        }
    }

    fn compressor(&self) -> Result<Compressor<'_>, TurboError> {
        // SAFETY: takes nothing; what it gives is null or a handle.
        let handle = unsafe { (self.init)() };
        match NonNull::new(handle) {
            Some(handle) => Ok(Compressor { turbo: self, handle }),
            None => Err(TurboError::Refused("no compressor: out of memory".to_owned())),
        }
    }

    /// A greyscale JPEG of 8-bit samples, row after row from the top, at a quality of 1 to 100.
    ///
    /// # Errors
    /// [`TurboError`] when the samples do not fill the picture, or the library refuses.
    pub fn grey(&self, samples: &[u8], width: u16, height: u16, quality: u8) -> Result<Vec<u8>, TurboError> {
        let pixels = usize::from(width) * usize::from(height);
        if samples.len() != pixels || pixels == 0 {
            return Err(TurboError::Samples { found: samples.len(), width, height });
        }
        let compressor = self.compressor()?;
        let (w, h) = (c_int::from(width), c_int::from(height));
        // SAFETY: takes numbers and gives one.
        let room = unsafe { (self.buffer_size)(w, h, SAMPLING_GREY) };
        let room = usize::try_from(room).ok().filter(|_| room != c_ulong::MAX);
        let Some(room) = room else { return Err(compressor.failure()) };
        // Only what the picture takes of it is ever touched.
        let mut jpeg = vec![0u8; room];
        let (mut at, mut length) = (jpeg.as_mut_ptr(), room as c_ulong);
        // SAFETY: the handle is valid and this thread's own. `samples` holds `height` rows of `width` bytes, which is the
        // pitch, as checked above. `at` and `length` describe `jpeg`, which is as large as the library asks for and lives
        // beyond the call; with `TJFLAG_NOREALLOC` nothing else is written to, and nothing is kept.
        let failed = unsafe {
            (self.compress)(
                compressor.handle.as_ptr(),
                samples.as_ptr(),
                w,
                w,
                h,
                PIXELS_GREY,
                &raw mut at,
                &raw mut length,
                SAMPLING_GREY,
                c_int::from(quality.clamp(1, 100)),
                NO_REALLOC | ACCURATE_DCT,
            )
        };
        if failed != 0 {
            return Err(compressor.failure());
        }
        jpeg.truncate(usize::try_from(length).unwrap_or(room));
        // Pictures are kept for a while: not with the room that they did not need.
        jpeg.shrink_to_fit();
        Ok(jpeg)
    }
}
