//! In the guest: frames that come over the network from the host are written into a loopback, each acknowledged once it
//! is written, so that none waits on the way.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::ExitCode;

use plenalign::raw::PixelFormat;
use v4l::video::Output as _;
use v4l::{Device, Format, FourCC};

/// Feeds a loopback with grey frames from whoever connects to `address`; each connection begins with columns and rows.
pub(crate) fn run(address: &str, device: &str) -> ExitCode {
    let listener = TcpListener::bind(address).expect("the port is free");
    println!("feeder: listening");
    for stream in listener.incoming() {
        let mut stream = stream.expect("a connection");
        let mut size = [0u8; 8];
        if stream.read_exact(&mut size).is_err() {
            continue;
        }
        let side = |at: usize| u32::from_le_bytes([size[at], size[at + 1], size[at + 2], size[at + 3]]);
        let (width, height) = (side(0), side(4));
        let code = FourCC::new(&PixelFormat::from_name("GREY").expect("grey is read").fourcc());
        let mut loopback = Device::with_path(device).expect("a loopback");
        let set = loopback.set_format(&Format::new(width, height, code)).expect("a format");
        assert_eq!((set.width, set.height, set.fourcc), (width, height, code));
        let mut frame = vec![0; width as usize * height as usize];
        // The end of a connection is the camera's plug being pulled: the loopback is closed.
        while stream.read_exact(&mut frame).is_ok() {
            loopback.write_all(&frame).expect("the loopback takes a frame");
            if stream.write_all(&[1]).is_err() {
                break;
            }
        }
        println!("feeder: gone");
    }
    ExitCode::SUCCESS
}
