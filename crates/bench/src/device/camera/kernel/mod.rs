//! The kernel's calls that the `v4l` crate lacks or cannot be used for, on the crate's handle; the one module with
//! unsafe code.
//!
//! What is wrong with the crate (0.14), and so is not used of it:
//! - Its stream requeues the last buffer at each call, so that after one time-out or one failed start every later call
//!   fails; it waits for ever unless told otherwise; its drop panics on any error but `ENODEV`; and it has no newest
//!   frame. [`Queue`] is used instead.
//! - Its list of controls panics on a control of a type that it does not know, on a menu without step and on a name that
//!   is not UTF-8, and buttons and bit masks cannot be read. [`controls`] is used instead.
//! - It has no selection API. [`crop`] and [`set_crop`] are.
//!
//! Formats are asked for with stride and size zero, because `set_format` hands a driver back the stride it had before.
//! Where the crate panics on an answer (a colour space newer than itself), the panic is caught by whoever calls it:
//! [`guarded`].

// Buffers are memory shared with the kernel, and its calls take pointers.
#![expect(unsafe_code)]

mod queue;

use std::ffi::c_void;
use std::io;
use std::mem;
use std::os::fd::RawFd;
use std::panic::{AssertUnwindSafe, catch_unwind};

use v4l::Device;
use v4l::v4l_sys::{
    V4L2_CTRL_FLAG_NEXT_COMPOUND, V4L2_CTRL_FLAG_NEXT_CTRL, V4L2_SEL_TGT_CROP, V4L2_SEL_TGT_CROP_BOUNDS,
    v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE as CAPTURE, v4l2_buffer, v4l2_ext_control, v4l2_ext_controls,
    v4l2_query_ext_ctrl, v4l2_querymenu, v4l2_rect, v4l2_requestbuffers, v4l2_selection,
};
use v4l::v4l2::{self, vidioc};

pub(super) use queue::{Filled, Queue, Taken};

/// From the kernel's `videodev2.h`, in the crate's own words for such numbers.
const VIDIOC_G_SELECTION: vidioc::_IOC_TYPE = selection_call(94);
const VIDIOC_S_SELECTION: vidioc::_IOC_TYPE = selection_call(95);

/// `_IOWR('V', number, struct v4l2_selection)`.
const fn selection_call(number: u8) -> vidioc::_IOC_TYPE {
    let read_and_write = 3;
    read_and_write << 30
        | (mem::size_of::<v4l2_selection>() as vidioc::_IOC_TYPE) << 16
        | (b'V' as vidioc::_IOC_TYPE) << 8
        | number as vidioc::_IOC_TYPE
}

/// Calls the kernel, again where a signal interrupted it.
///
/// # Safety
/// `T` must be the structure of `request`, and every pointer in it valid for what the kernel does with it.
unsafe fn call<T>(fd: RawFd, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
    loop {
        // SAFETY: as the caller promises; the reference is valid during the call.
        match unsafe { v4l2::ioctl(fd, request, (&raw mut *argument).cast::<c_void>()) } {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            done => return done,
        }
    }
}

/// A structure of the kernel's with nothing in it.
fn empty<T: Kernel>() -> T {
    // SAFETY: the types that are `Kernel` are plain C structures of integers and nullable pointers, for which all bits
    // zero is a value.
    unsafe { mem::zeroed() }
}

/// Plain structures of the kernel's.
trait Kernel {}
impl Kernel for v4l2_buffer {}
impl Kernel for v4l2_requestbuffers {}
impl Kernel for v4l2_selection {}
impl Kernel for v4l2_query_ext_ctrl {}
impl Kernel for v4l2_querymenu {}
impl Kernel for v4l2_ext_control {}
impl Kernel for v4l2_ext_controls {}

/// Runs what uses the crate where it may panic on a driver's answer.
///
/// # Errors
/// Its own, or that it panicked.
pub(super) fn guarded<T>(of_crate: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    catch_unwind(AssertUnwindSafe(of_crate))
        .unwrap_or_else(|_| Err(io::Error::other("the driver's answer is not understood")))
}

/// A control as its driver describes it.
#[derive(Debug, Clone)]
pub(super) struct RawControl {
    pub(super) id: u32,
    /// `V4L2_CTRL_TYPE_*`.
    pub(super) kind: u32,
    pub(super) name: String,
    pub(super) minimum: i64,
    pub(super) maximum: i64,
    pub(super) step: u64,
    pub(super) default: i64,
    /// `V4L2_CTRL_FLAG_*`.
    pub(super) flags: u32,
    /// Whether it is an array or a structure, and not one number.
    pub(super) compound: bool,
}

/// Every control of a device, headings of classes included.
pub(super) fn controls(device: &Device) -> Vec<RawControl> {
    let next = V4L2_CTRL_FLAG_NEXT_CTRL | V4L2_CTRL_FLAG_NEXT_COMPOUND;
    let mut found: Vec<RawControl> = Vec::new();
    let mut query = v4l2_query_ext_ctrl { id: next, ..empty() };
    // SAFETY: the structure of this request, without pointers.
    while unsafe { call(device.handle().fd(), vidioc::VIDIOC_QUERY_EXT_CTRL, &mut query) }.is_ok() {
        // Ids grow: a driver that does not keep to it would be asked for ever.
        if found.last().is_some_and(|last| query.id <= last.id) {
            break;
        }
        let name: Vec<u8> = query.name.iter().map(|&c| c as u8).collect();
        found.push(RawControl {
            id: query.id,
            kind: query.type_,
            name: text(&name),
            minimum: query.minimum,
            maximum: query.maximum,
            step: query.step,
            default: query.default_value,
            flags: query.flags,
            compound: query.nr_of_dims > 0 || query.type_ >= 0x100,
        });
        query = v4l2_query_ext_ctrl { id: query.id | next, ..empty() };
    }
    found
}

/// Name and number of a menu's item; `None` where the driver has no such item. `numbers`: the items are numbers.
pub(super) fn menu_item(device: &Device, id: u32, index: u32, numbers: bool) -> Option<String> {
    let mut menu = v4l2_querymenu { id, index, ..empty() };
    // SAFETY: the structure of this request, without pointers.
    unsafe { call(device.handle().fd(), vidioc::VIDIOC_QUERYMENU, &mut menu) }.ok()?;
    // SAFETY: the kernel has filled in the member that the control's type says; both are plain bytes.
    Some(unsafe {
        if numbers {
            let value = menu.__bindgen_anon_1.value;
            value.to_string()
        } else {
            let name = menu.__bindgen_anon_1.name;
            text(&name)
        }
    })
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// The value of a control that is one number; `wide`: of 64 bits.
///
/// # Errors
/// What the driver says.
pub(super) fn control(device: &Device, id: u32, wide: bool) -> io::Result<i64> {
    let mut control = v4l2_ext_control { id, ..empty() };
    access(device, vidioc::VIDIOC_G_EXT_CTRLS, &mut control)?;
    // SAFETY: a control that is one number has it in the member of its width; both are plain numbers.
    Ok(unsafe { if wide { control.__bindgen_anon_1.value64 } else { i64::from(control.__bindgen_anon_1.value) } })
}

/// Sets a control that is one number; `wide`: of 64 bits.
///
/// # Errors
/// What the driver says.
pub(super) fn set_control(device: &Device, id: u32, value: i64, wide: bool) -> io::Result<()> {
    let mut control = v4l2_ext_control { id, ..empty() };
    if wide {
        control.__bindgen_anon_1.value64 = value;
    } else {
        control.__bindgen_anon_1.value =
            i32::try_from(value).map_err(|_| io::Error::from(io::ErrorKind::InvalidInput))?;
    }
    access(device, vidioc::VIDIOC_S_EXT_CTRLS, &mut control)
}

fn access(device: &Device, request: vidioc::_IOC_TYPE, control: &mut v4l2_ext_control) -> io::Result<()> {
    let mut controls = v4l2_ext_controls { count: 1, controls: &raw mut *control, ..empty() };
    // SAFETY: the structure of both requests; its pointer is to the one control that is counted, whose own pointers the
    // kernel does not follow, because size 0 says that it holds a number.
    unsafe { call(device.handle().fd(), request, &mut controls) }
}

/// A rectangle of the sensor's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rectangle {
    pub(super) left: i32,
    pub(super) top: i32,
    pub(super) width: u32,
    pub(super) height: u32,
}

/// The region read out, and the whole that it can be chosen from, where the driver tells.
pub(super) fn crop(device: &Device) -> Option<(Rectangle, Rectangle)> {
    let get = |target| {
        let mut selection = v4l2_selection { type_: CAPTURE, target, ..empty() };
        // SAFETY: the structure of this request, without pointers.
        unsafe { call(device.handle().fd(), VIDIOC_G_SELECTION, &mut selection) }.ok()?;
        let v4l2_rect { left, top, width, height } = selection.r;
        Some(Rectangle { left, top, width, height })
    };
    Some((get(V4L2_SEL_TGT_CROP)?, get(V4L2_SEL_TGT_CROP_BOUNDS)?))
}

/// Asks for a region to be read out and returns the one granted.
///
/// # Errors
/// What the driver says.
pub(super) fn set_crop(device: &Device, to: Rectangle) -> io::Result<Rectangle> {
    let Rectangle { left, top, width, height } = to;
    let mut selection = v4l2_selection { type_: CAPTURE, target: V4L2_SEL_TGT_CROP, ..empty() };
    selection.r = v4l2_rect { left, top, width, height };
    // SAFETY: the structure of this request, without pointers.
    unsafe { call(device.handle().fd(), VIDIOC_S_SELECTION, &mut selection)? };
    let v4l2_rect { left, top, width, height } = selection.r;
    Ok(Rectangle { left, top, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_calls_have_the_headers_numbers() {
        // From `printf("%lx")` of the kernel's macros.
        assert_eq!((VIDIOC_G_SELECTION, VIDIOC_S_SELECTION), (0xc040_565e, 0xc040_565f));
        assert_eq!(vidioc::VIDIOC_DQBUF, 0xc058_5611);
    }

    #[test]
    fn what_panics_is_an_error() {
        assert!(guarded(|| -> io::Result<()> { panic!("as the crate does") }).is_err());
        assert_eq!(guarded(|| Ok(3)).unwrap(), 3);
    }

    #[test]
    fn names_end_at_their_zero() {
        assert_eq!(text(b"Gain\0rest"), "Gain");
        assert_eq!(text(&[b'G', 0xff]), "G\u{fffd}");
    }
}
