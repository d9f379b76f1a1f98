//! The capture queue: buffers shared with the driver, of which the newest is handed out.

use std::ffi::c_void;
use std::io;
use std::ptr::NonNull;
use std::sync::Arc;
use std::time::{Duration, Instant};

use v4l::Device;
use v4l::device::Handle;
use v4l::v4l_sys::{
    V4L2_BUF_FLAG_ERROR, v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE as CAPTURE, v4l2_buffer,
    v4l2_memory_V4L2_MEMORY_MMAP as MMAP, v4l2_requestbuffers,
};
use v4l::v4l2::{self, vidioc};

use super::{call, empty};

/// A mapping of one of the driver's buffers.
struct Map {
    at: NonNull<c_void>,
    length: usize,
}

// SAFETY: a mapping belongs to the process, not to the thread that made it.
unsafe impl Send for Map {}

impl Drop for Map {
    fn drop(&mut self) {
        // SAFETY: mapped by `Queue::map` with this length and unmapped nowhere else. A failure leaves it mapped: no harm.
        let _ = unsafe { v4l2::munmap(self.at.as_ptr(), self.length) };
    }
}

/// What a driver says of a buffer that it has filled.
#[derive(Debug, Clone, Copy)]
pub(in crate::device::camera) struct Filled {
    index: u32,
    used: usize,
    /// `V4L2_BUF_FLAG_*`.
    pub(in crate::device::camera) flags: u32,
    /// The timestamp, s.
    pub(in crate::device::camera) at_s: f64,
    /// The driver's count of frames.
    pub(in crate::device::camera) sequence: u32,
}

impl Filled {
    /// One of a test.
    #[cfg(test)]
    pub(in crate::device::camera) const fn of(flags: u32, at_s: f64, sequence: u32) -> Self {
        Self { index: 0, used: 0, flags, at_s, sequence }
    }

    /// Whether the driver itself says that the frame is damaged.
    pub(in crate::device::camera) fn is_damaged(&self) -> bool {
        self.flags & V4L2_BUF_FLAG_ERROR != 0
    }
}

/// A running capture queue of buffers shared with the driver.
pub(in crate::device::camera) struct Queue {
    handle: Arc<Handle>,
    maps: Vec<Map>,
    /// When the queue was last seen empty: what is taken from it has arrived since.
    empty_at: Instant,
}

impl Queue {
    /// Maps `count` buffers (or as many as the driver grants), queues them and starts the stream.
    ///
    /// # Errors
    /// What the driver refused.
    pub(in crate::device::camera) fn start(device: &Device, count: u32) -> io::Result<Self> {
        let mut queue = Self { handle: device.handle(), maps: Vec::new(), empty_at: Instant::now() };
        let granted = queue.request(count)?;
        for index in 0..granted {
            queue.map(index)?;
        }
        if granted < 2 {
            return Err(io::Error::other(format!("the driver grants {granted} buffers; at least 2 are needed")));
        }
        for index in 0..granted {
            queue.enqueue(index)?;
        }
        queue.stream(vidioc::VIDIOC_STREAMON)?;
        queue.empty_at = Instant::now();
        Ok(queue)
    }

    fn request(&self, count: u32) -> io::Result<u32> {
        let mut request = v4l2_requestbuffers { count, type_: CAPTURE, memory: MMAP, ..empty() };
        // SAFETY: the structure of this request, without pointers.
        unsafe { call(self.handle.fd(), vidioc::VIDIOC_REQBUFS, &mut request)? };
        Ok(request.count)
    }

    fn map(&mut self, index: u32) -> io::Result<()> {
        let mut buffer = v4l2_buffer { index, type_: CAPTURE, memory: MMAP, ..empty() };
        // SAFETY: the structure of this request; its pointers are null, and not followed for buffers of one plane.
        unsafe { call(self.handle.fd(), vidioc::VIDIOC_QUERYBUF, &mut buffer)? };
        let length = buffer.length as usize;
        let (protection, flags) = (nix::libc::PROT_READ | nix::libc::PROT_WRITE, nix::libc::MAP_SHARED);
        // SAFETY: for mapped memory the kernel has filled in the offset. The mapping is new, at a place of the kernel's
        // choice, and outlives the handle's closing.
        let at = unsafe {
            let offset = nix::libc::off_t::from(buffer.m.offset);
            v4l2::mmap(std::ptr::null_mut(), length, protection, flags, self.handle.fd(), offset)?
        };
        let at = NonNull::new(at).ok_or_else(|| io::Error::other("a buffer was mapped to nowhere"))?;
        self.maps.push(Map { at, length });
        Ok(())
    }

    fn enqueue(&mut self, index: u32) -> io::Result<()> {
        let mut buffer = v4l2_buffer { index, type_: CAPTURE, memory: MMAP, ..empty() };
        // SAFETY: as in `map`. From here on the driver writes into the mapping: `&mut self` rules out that somebody reads.
        unsafe { call(self.handle.fd(), vidioc::VIDIOC_QBUF, &mut buffer) }
    }

    fn dequeue(&mut self) -> io::Result<Option<Filled>> {
        let mut buffer = v4l2_buffer { type_: CAPTURE, memory: MMAP, ..empty() };
        // SAFETY: as in `map`.
        match unsafe { call(self.handle.fd(), vidioc::VIDIOC_DQBUF, &mut buffer) } {
            Ok(()) => Ok(Some(Filled {
                index: buffer.index,
                used: buffer.bytesused as usize,
                flags: buffer.flags,
                at_s: buffer.timestamp.tv_sec as f64 + buffer.timestamp.tv_usec as f64 * 1e-6,
                sequence: buffer.sequence,
            })),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn stream(&self, request: vidioc::_IOC_TYPE) -> io::Result<()> {
        let mut kind = CAPTURE;
        // SAFETY: both calls take a number.
        unsafe { call(self.handle.fd(), request, &mut kind) }
    }

    /// Waits until a buffer is filled or something is wrong, at most so long; whether that came.
    ///
    /// # Errors
    /// What the kernel says.
    pub(in crate::device::camera) fn wait(&mut self, longest: Duration) -> io::Result<bool> {
        let until = Instant::now() + longest;
        let mut left = Duration::ZERO;
        loop {
            let asked_at = Instant::now();
            let ready = match self.handle.poll(nix::libc::POLLIN, left.as_millis().min(60_000) as i32) {
                Ok(ready) => ready > 0,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => false,
                Err(error) => return Err(error),
            };
            if ready {
                return Ok(true);
            }
            self.empty_at = asked_at;
            left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            // A poll of zero would turn the wait's last millisecond into a busy loop.
            left = left.max(Duration::from_millis(1));
        }
    }

    /// Takes every buffer that is filled, hands `see` what the driver says of them, oldest first, and the bytes of the
    /// newest that is not damaged, and gives all of them back to the driver. `None` where no buffer is filled.
    ///
    /// # Errors
    /// What the driver says: the queue is of no use then, and is to be dropped.
    pub(in crate::device::camera) fn take<R>(&mut self, see: impl FnOnce(&Taken<'_>) -> R) -> io::Result<Option<R>> {
        let arrived_after = self.empty_at;
        let mut filled: Vec<Filled> = Vec::new();
        // A driver that fills faster than this takes cannot keep it here.
        for _ in 0..=self.maps.len() {
            let asked_at = Instant::now();
            match self.dequeue()? {
                Some(buffer) => filled.push(buffer),
                None => {
                    self.empty_at = asked_at;
                    break;
                }
            }
        }
        let Some(last) = filled.len().checked_sub(1) else { return Ok(None) };
        let newest = filled.iter().rposition(|buffer| !buffer.is_damaged()).unwrap_or(last);
        // The others go back at once, so that the driver has where to put what comes while this one is read.
        for (_, buffer) in filled.iter().enumerate().filter(|(index, _)| *index != newest) {
            self.enqueue(buffer.index)?;
        }
        let bytes = self.bytes(&filled[newest])?;
        let seen = see(&Taken { filled: &filled, newest, bytes, arrived_after });
        self.enqueue(filled[newest].index)?;
        Ok(Some(seen))
    }

    fn bytes(&self, buffer: &Filled) -> io::Result<&[u8]> {
        let map = self.maps.get(buffer.index as usize);
        let map =
            map.ok_or_else(|| io::Error::other(format!("the driver filled a buffer {} of its own", buffer.index)))?;
        // Some drivers leave the count of raw formats 0.
        let used = if buffer.used == 0 { map.length } else { buffer.used.min(map.length) };
        // SAFETY: the mapping is `length` bytes long and lives as long as `self`. The buffer is dequeued, so the driver
        // does not write to it until it is queued again, which needs `&mut self`.
        Ok(unsafe { std::slice::from_raw_parts(map.at.as_ptr().cast::<u8>(), used) })
    }
}

impl Drop for Queue {
    fn drop(&mut self) {
        // What a lost device refuses here was lost with it.
        let _ = self.stream(vidioc::VIDIOC_STREAMOFF);
        self.maps.clear();
        let _ = self.request(0);
    }
}

/// What was taken from a queue at once.
pub(in crate::device::camera) struct Taken<'q> {
    /// Every buffer, oldest first.
    pub(in crate::device::camera) filled: &'q [Filled],
    /// Which of them the bytes are of.
    pub(in crate::device::camera) newest: usize,
    /// The bytes.
    pub(in crate::device::camera) bytes: &'q [u8],
    /// All of them arrived after this.
    pub(in crate::device::camera) arrived_after: Instant,
}
