//! A frame as ImageArray has it: in JSON, or as the bytes of ImageBytes.

use std::io::Write as _;
use std::sync::Arc;

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

use super::answer::Transaction;
use super::fault::Fault;
use crate::device::Frame;
use crate::raw::Samples;

/// The content type of ImageBytes, which a client asks for in `Accept`.
pub(super) const IMAGE_BYTES: &str = "application/imagebytes";

/// Version of the metadata before an image's bytes, and their length.
const METADATA_VERSION: i32 = 1;
const METADATA_LENGTH: i32 = 44;
/// Types of elements, by the specification's numbers: of the image, which is of whole numbers, and on the wire.
const INT_32: i32 = 2;
const BYTE: i32 = 6;
const UINT_16: i32 = 8;
/// Columns and rows.
const RANK: i32 = 2;

/// A part of the sensor, in pixels from its upper left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) start_x: i32,
    pub(super) start_y: i32,
    pub(super) num_x: i32,
    pub(super) num_y: i32,
}

impl Window {
    /// The whole of a sensor.
    pub(super) fn whole(columns: u32, rows: u32) -> Self {
        let whole = |count: u32| i32::try_from(count).unwrap_or(i32::MAX);
        Self { start_x: 0, start_y: 0, num_x: whole(columns), num_y: whole(rows) }
    }

    /// That it is within a sensor of so many columns and rows.
    ///
    /// # Errors
    /// Which part is not.
    pub(super) fn check(self, columns: usize, rows: usize) -> Result<(), Fault> {
        let within = |name: &str, start: i32, num: i32, size: usize| {
            let end = i64::from(start) + i64::from(num);
            if start < 0 || num < 1 || usize::try_from(end).is_ok_and(|end| end > size) {
                return Err(Fault::invalid_value(format!(
                    "Start{name} = {start} and Num{name} = {num} are not within the sensor's {size} pixels"
                )));
            }
            Ok(())
        };
        within("X", self.start_x, self.num_x, columns)?;
        within("Y", self.start_y, self.num_y, rows)
    }
}

/// A window of a frame.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    frame: Arc<Frame>,
    window: Window,
}

impl Picture {
    /// # Errors
    /// The window is not within the frame.
    pub(super) fn new(frame: Arc<Frame>, window: Window) -> Result<Self, Fault> {
        window.check(frame.image.width(), frame.image.height())?;
        Ok(Self { frame, window })
    }

    pub(super) fn frame(&self) -> &Arc<Frame> {
        &self.frame
    }

    /// The samples of each column from the top, column by column from the left: as the specification has an image.
    fn columns(&self) -> impl Iterator<Item = impl Iterator<Item = u16> + '_> + '_ {
        let width = self.frame.image.width();
        let samples = self.frame.image.samples();
        let range = |start: i32, num: i32| {
            let start = usize::try_from(start).unwrap_or(0);
            start..start + usize::try_from(num).unwrap_or(0)
        };
        let rows = range(self.window.start_y, self.window.num_y);
        range(self.window.start_x, self.window.num_x).map(move |x| {
            rows.clone().map(move |y| match samples {
                Samples::U8(samples) => u16::from(samples[y * width + x]),
                Samples::U16(samples) => samples[y * width + x],
            })
        })
    }

    /// In JSON.
    pub(super) fn json(&self, transaction: Transaction) -> std::io::Result<Vec<u8>> {
        let mut out = Vec::with_capacity(self.frame.image.samples().len() * 4 + 256);
        write!(out, "{{\"Type\":{INT_32},\"Rank\":{RANK},\"Value\":[")?;
        for (x, column) in self.columns().enumerate() {
            out.extend_from_slice(if x == 0 { b"[" } else { b",[" });
            for (y, sample) in column.enumerate() {
                if y > 0 {
                    out.push(b',');
                }
                write!(out, "{sample}")?;
            }
            out.push(b']');
        }
        let Transaction { client, server } = transaction;
        write!(
            out,
            "],\"ClientTransactionID\":{client},\"ServerTransactionID\":{server},\"ErrorNumber\":0,\"ErrorMessage\":\"\"}}"
        )?;
        Ok(out)
    }

    /// As ImageBytes: metadata, then the samples in as many bytes as they need.
    pub(super) fn bytes(&self, transaction: Transaction) -> Vec<u8> {
        let narrow = matches!(self.frame.image.samples(), Samples::U8(_));
        let mut out = Vec::with_capacity(self.frame.image.samples().len() * 2 + 64);
        for number in [METADATA_VERSION, 0] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        for number in [transaction.client, transaction.server] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        let on_the_wire = if narrow { BYTE } else { UINT_16 };
        for number in [METADATA_LENGTH, INT_32, on_the_wire, RANK, self.window.num_x, self.window.num_y, 0] {
            out.extend_from_slice(&number.to_le_bytes());
        }
        for column in self.columns() {
            for sample in column {
                match sample.to_le_bytes() {
                    [low, _] if narrow => out.push(low),
                    both => out.extend_from_slice(&both),
                }
            }
        }
        out
    }
}

/// The answer that carries an image.
pub(super) fn respond(body: Vec<u8>, as_bytes: bool) -> Response {
    let kind = if as_bytes { IMAGE_BYTES } else { "application/json" };
    ([(header::CONTENT_TYPE, HeaderValue::from_static(kind))], body).into_response()
}

#[cfg(test)]
mod tests {
    use tokio::time::Instant;

    use super::*;
    use crate::device::AxisPose;
    use crate::raw::RawImage;

    fn picture(image: RawImage, window: Window) -> Result<Picture, Fault> {
        let pose = AxisPose { position: None, settled: true };
        let frame = Frame {
            image: Arc::new(image),
            seq: 1,
            exposed_from: Instant::now(),
            exposed_to: Instant::now(),
            exposure_assumed: false,
            captured_at: jiff::Timestamp::now(),
            focus: pose,
            e: pose,
            preview: false,
            simulated: true,
            replayed: false,
        };
        Picture::new(Arc::new(frame), window)
    }

    const IDS: Transaction = Transaction { client: 7, server: 9 };

    #[test]
    fn an_image_goes_column_by_column_on_both_wires() {
        // Three columns and two rows.
        let image = RawImage::from_u16(3, 2, 12, vec![1, 2, 3, 400, 500, 600]);
        let whole = picture(image, Window::whole(3, 2)).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&whole.json(IDS).unwrap()).unwrap();
        assert_eq!(json["Value"], serde_json::json!([[1, 400], [2, 500], [3, 600]]));
        assert_eq!((&json["Type"], &json["Rank"], &json["ClientTransactionID"]), (&2.into(), &2.into(), &7.into()));
        let bytes = whole.bytes(IDS);
        let word = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let head: Vec<i32> = (0..11).map(|index| word(4 * index)).collect();
        assert_eq!(head, [1, 0, 7, 9, 44, 2, 8, 2, 3, 2, 0]);
        assert_eq!(bytes[44..], [1, 0, 144, 1, 2, 0, 244, 1, 3, 0, 88, 2]);
    }

    #[test]
    fn a_window_is_cut_out_and_one_beyond_the_sensor_refused() {
        let image = RawImage::from_u8(4, 3, (0..12).collect());
        let window = Window { start_x: 1, start_y: 1, num_x: 2, num_y: 2 };
        let bytes = picture(image.clone(), window).unwrap().bytes(IDS);
        assert_eq!((bytes.len(), bytes[24], &bytes[44..]), (48, 6, &[5, 9, 6, 10][..]));
        for (start_x, num_x) in [(-1, 2), (0, 0), (3, 2), (0, 5), (i32::MAX, i32::MAX)] {
            let fault = picture(image.clone(), Window { start_x, num_x, ..window }).unwrap_err();
            assert!(fault.number == 0x401 && fault.message.contains("StartX"), "{fault:?}");
        }
        assert!(picture(image, Window { start_y: 2, ..window }).unwrap_err().message.contains("StartY"));
    }
}
