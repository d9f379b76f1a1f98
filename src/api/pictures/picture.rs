//! Pictures for viewers: a raw frame to JPEG or PNG, each encoded once however many watch.
//!
//! They are made by threads of their own, which give way to everything else: measuring comes first, and so does a stop.

use std::collections::HashMap;
use std::io::Cursor;
use std::ops::RangeInclusive;
use std::sync::{Arc, OnceLock, PoisonError};
use std::thread::available_parallelism;
use std::time::Duration;

use axum::body::Bytes;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::{ThreadPool, ThreadPoolBuilder};
use tokio::sync::{Mutex, oneshot, watch};
use tokio::time::Instant;

use super::scene::{Format, Scene};
use crate::device::{Frame, FrameSource};
use crate::jpeg::Encoder;
use crate::raw::{RawImage, Samples, Window};
use crate::telemetry;

/// JPEG quality of pictures where none is asked for: blur and micro-images show, noise costs little.
pub(in crate::api) const DEFAULT_QUALITY: u8 = 80;
/// JPEG qualities that may be asked for.
pub(in crate::api) const QUALITIES: RangeInclusive<u8> = 10..=100;
/// Encodings kept beside those of viewports; the least recently made go first.
const MORE_ENCODINGS: usize = 16;
/// Threads that make pictures, at most.
const MOST_THREADS: usize = 4;
/// How far they give way: of a core that others want, they get a tenth.
const NICE: i32 = 10;

/// How a picture is encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Encoding {
    /// A part of the raw frame, in grey, at so many columns and rows.
    Part { window: Window, size: [usize; 2], quality: Quality },
    /// PNG with the raw frame's own samples.
    Png,
    /// A picture of the scene.
    Scene { scene: Scene, format: Format },
}

/// How exact a picture of the raw frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Quality {
    /// JPEG of 8 bits.
    Jpeg(u8),
    /// PNG with the samples in the high bits, so that it is as bright as the JPEG.
    Lossless,
}

/// Raw pixels to a picture pixel, each way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Reduce {
    Not,
    Half,
    Quarter,
}

impl Reduce {
    pub(in crate::api) const fn from_number(number: u32) -> Option<Self> {
        match number {
            1 => Some(Self::Not),
            2 => Some(Self::Half),
            4 => Some(Self::Quarter),
            _ => None,
        }
    }

    pub(in crate::api) const fn number(self) -> u32 {
        match self {
            Self::Not => 1,
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }
}

/// A picture's bytes and the sequence number of the frame they show.
type Slot = Mutex<Option<(u64, Bytes)>>;

/// The newest picture of each encoding. A slot is locked while its picture is encoded, so that whoever else wants the
/// same one waits for it instead of doing the work again.
pub(in crate::api) struct Pictures {
    slots: std::sync::Mutex<HashMap<Encoding, (u64, Arc<Slot>)>>,
    /// Encodings kept.
    most: usize,
    /// Whether the raw frame's pixels have colours.
    mosaic: bool,
}

/// Threads of the pictures' own.
fn pool() -> Option<&'static ThreadPool> {
    static POOL: OnceLock<Option<ThreadPool>> = OnceLock::new();
    let give_way = |_| {
        if let Err(error) = rustix::process::nice(NICE) {
            tracing::warn!(%error, "pictures are made at the priority of everything else");
        }
    };
    let build = || {
        ThreadPoolBuilder::new()
            .num_threads(available_parallelism().map_or(1, usize::from).min(MOST_THREADS))
            .thread_name(|k| format!("picture-{k}"))
            .start_handler(give_way)
            .panic_handler(|_| tracing::error!("making a picture ended unexpectedly"))
            .build()
    };
    POOL.get_or_init(|| build().inspect_err(|error| tracing::error!(%error, "pictures have no threads")).ok()).as_ref()
}

impl Pictures {
    /// With room for so many viewports, of frames whose pixels have colours or not.
    pub(in crate::api) fn new(viewports: usize, mosaic: bool) -> Self {
        Self { slots: std::sync::Mutex::default(), most: viewports + MORE_ENCODINGS, mosaic }
    }

    /// The slot of an encoding, for a picture of frame `seq`.
    fn slot(&self, encoding: Encoding, seq: u64) -> Arc<Slot> {
        let mut slots = self.slots.lock().unwrap_or_else(PoisonError::into_inner);
        if slots.len() >= self.most && !slots.contains_key(&encoding) {
            let oldest = slots.iter().min_by_key(|(_, (seq, _))| *seq).map(|(encoding, _)| *encoding);
            oldest.map(|oldest| slots.remove(&oldest));
        }
        let (newest, slot) = slots.entry(encoding).or_default();
        *newest = (*newest).max(seq);
        Arc::clone(slot)
    }

    /// The frame's picture; an error is a picture that no encoder takes, in words.
    pub(in crate::api) async fn encode(&self, frame: &Arc<Frame>, encoding: Encoding) -> Result<Bytes, String> {
        let (image, mosaic) = (frame.image.clone(), self.mosaic);
        let made = self.made(encoding, frame.seq, move || {
            match encoding {
                Encoding::Part { window, size, quality } => part(&image, window, size, quality, mosaic),
                Encoding::Png => png(&image, false),
                Encoding::Scene { .. } => Err("a raw frame is no picture of the scene".to_owned()),
            }
            .map_err(Some)
        });
        made.await.map_err(|error| error.unwrap_or_else(|| "encoding ended unexpectedly".to_owned()))
    }

    /// What `make` makes of frame `seq`, made once however many ask; an error without a value is one of `make`'s own, or
    /// that it ended unexpectedly.
    pub(in crate::api) async fn made<E: Send + 'static>(
        &self,
        encoding: Encoding,
        seq: u64,
        make: impl FnOnce() -> Result<Bytes, Option<E>> + Send + 'static,
    ) -> Result<Bytes, Option<E>> {
        let slot = self.slot(encoding, seq);
        let mut held = slot.lock().await;
        if let Some((made, bytes)) = held.as_ref()
            && *made == seq
        {
            return Ok(bytes.clone());
        }
        let Some(pool) = pool() else { return Err(None) };
        let (tell, made) = oneshot::channel();
        pool.spawn(move || {
            // Whoever asked may have gone while others' pictures were made: none is made for nobody.
            if tell.is_closed() {
                return;
            }
            let began = Instant::now();
            let picture = make();
            telemetry::picture_made(began.elapsed());
            // Gone meanwhile.
            let _ = tell.send(picture);
        });
        // Nothing is told where making it has ended unexpectedly, of which the pool's handler has said.
        let bytes = made.await.map_err(|_| None)??;
        *held = Some((seq, bytes.clone()));
        Ok(bytes)
    }
}

fn part(image: &RawImage, window: Window, size: [usize; 2], quality: Quality, mosaic: bool) -> Result<Bytes, String> {
    let outside = || format!("{window:?} is not of a frame of {}x{}", image.width(), image.height());
    match quality {
        Quality::Jpeg(quality) => {
            let samples = image.to_view_of(window, size, mosaic).ok_or_else(outside)?;
            grey_jpeg(&samples, size[0], size[1], quality)
        }
        Quality::Lossless => png(&image.cropped(window).ok_or_else(outside)?, true),
    }
}

/// A greyscale JPEG of 8-bit samples.
pub(in crate::api) fn grey_jpeg(samples: &[u8], width: usize, height: usize, quality: u8) -> Result<Bytes, String> {
    Encoder::here().grey(samples, width, height, quality).map(Bytes::from)
}

/// A JPEG in colour of 8-bit samples, red, green and blue of a pixel together. A view is small: the encoder in Rust is fast
/// enough.
pub(in crate::api) fn coloured_jpeg(samples: &[u8], width: usize, height: usize, quality: u8) -> Result<Bytes, String> {
    let too_large = |_| format!("a view of {width}x{height} is too large for JPEG");
    let (w, h) = (u16::try_from(width).map_err(too_large)?, u16::try_from(height).map_err(too_large)?);
    let mut bytes = Vec::with_capacity(samples.len() / 4);
    jpeg_encoder::Encoder::new(&mut bytes, quality)
        .encode(samples, w, h, jpeg_encoder::ColorType::Rgb)
        .map_err(|error| error.to_string())?;
    Ok(bytes.into())
}

/// A frame's samples as a PNG, in the low bits as they are, or in the high ones.
fn png(image: &RawImage, high: bool) -> Result<Bytes, String> {
    let (width, height) = (image.width() as u32, image.height() as u32);
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(Cursor::new(&mut bytes), CompressionType::Fast, FilterType::Up);
    match image.samples() {
        Samples::U8(samples) => encoder.write_image(samples, width, height, ExtendedColorType::L8),
        Samples::U16(samples) => {
            let shift = if high { 16 - image.bits() } else { 0 };
            // The encoder takes samples in the machine's own byte order.
            let native: Vec<u8> = samples.iter().flat_map(|sample| (sample << shift).to_ne_bytes()).collect();
            encoder.write_image(&native, width, height, ExtendedColorType::L16)
        }
    }
    .map_err(|error| error.to_string())?;
    Ok(bytes.into())
}

/// The next thing that a source has; `None` once the source has ended. Nothing is lost when this is dropped half-way.
pub(in crate::api) async fn next<T>(source: &mut watch::Receiver<Option<Arc<T>>>) -> Option<Arc<T>> {
    loop {
        source.changed().await.ok()?;
        let newest = source.borrow_and_update().clone();
        if newest.is_some() {
            return newest;
        }
    }
}

/// The frames between those that a viewer was sent.
#[derive(Debug, Default)]
pub(in crate::api) struct Skipped {
    last_seq: Option<u64>,
    /// How many, since it began to watch.
    pub(in crate::api) total: u64,
}

impl Skipped {
    /// Whether this frame is the one that was sent last.
    pub(in crate::api) fn has(&self, seq: u64) -> bool {
        self.last_seq == Some(seq)
    }

    /// Another frame is sent: how many there were since the one before.
    pub(in crate::api) fn until(&mut self, seq: u64) -> u64 {
        let between = self.last_seq.replace(seq).map_or(0, |last| seq.saturating_sub(last + 1));
        self.total += between;
        between
    }
}

/// Age of a frame, from the end of its exposure.
pub(in crate::api) fn age(frame: &Frame) -> Duration {
    Instant::now().saturating_duration_since(frame.exposed_to)
}

/// The newest frame that ended its exposure at `not_before` or later, or is no older than `max_age` where that is not
/// given; waits so long for one, since a source that nobody watched may have none.
///
/// The error is the age of what there is.
pub(in crate::api) async fn fresh(
    camera: &dyn FrameSource,
    max_age: Duration,
    not_before: Option<Instant>,
) -> Result<Arc<Frame>, Option<Duration>> {
    let mut frames = camera.live();
    let wait = async {
        loop {
            let newest = frames.borrow_and_update().clone();
            let wanted = |frame: &Arc<Frame>| match not_before {
                Some(from) => frame.exposed_to >= from,
                None => age(frame) <= max_age,
            };
            if let Some(frame) = newest.filter(wanted) {
                return Some(frame);
            }
            frames.changed().await.ok()?;
        }
    };
    match tokio::time::timeout(max_age, wait).await {
        Ok(Some(frame)) => Ok(frame),
        _ => Err(camera.live().borrow().as_ref().map(|frame| age(frame))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::AxisPose;

    fn frame(seq: u64, image: RawImage) -> Arc<Frame> {
        let pose = AxisPose { position: None, settled: true };
        Arc::new(Frame {
            image: Arc::new(image),
            seq,
            exposed_from: Instant::now(),
            exposed_to: Instant::now(),
            exposure_assumed: false,
            captured_at: jiff::Timestamp::UNIX_EPOCH,
            focus: pose,
            e: pose,
            preview: false,
            simulated: true,
            replayed: false,
        })
    }

    fn whole(raw: &Frame, reduce: Reduce) -> Encoding {
        crate::api::pictures::viewport::whole(&raw.image, reduce, 80).encoding()
    }

    #[tokio::test]
    async fn a_png_holds_the_samples_and_a_jpeg_the_size() {
        let samples: Vec<u16> = (0..64 * 48).map(|i| i % 4096).collect();
        let raw = frame(1, RawImage::from_u16(64, 48, 12, samples.clone()));
        let pictures = Pictures::new(1, false);
        let png = pictures.encode(&raw, Encoding::Png).await.unwrap();
        assert_eq!(image::load_from_memory(&png).unwrap().into_luma16().into_raw(), samples);
        let jpeg = pictures.encode(&raw, whole(&raw, Reduce::Half)).await.unwrap();
        let jpeg = image::load_from_memory(&jpeg).unwrap();
        assert_eq!((jpeg.width(), jpeg.height()), (32, 24));
    }

    #[tokio::test]
    async fn a_frame_is_encoded_once() {
        let pictures = Pictures::new(1, false);
        let black = frame(7, RawImage::from_u8(8, 8, vec![0; 64]));
        let encoding = whole(&black, Reduce::Not);
        let one = pictures.encode(&black, encoding).await.unwrap();
        let other = RawImage::from_u8(8, 8, vec![255; 64]);
        let same = pictures.encode(&frame(7, other.clone()), encoding).await.unwrap();
        assert_eq!(one.as_ptr(), same.as_ptr());
        assert_ne!(one, pictures.encode(&frame(8, other), encoding).await.unwrap());
    }

    #[tokio::test]
    async fn nothing_is_made_for_who_has_gone() {
        let pictures = Arc::new(Pictures::new(1, false));
        let (first, second, third) = (Encoding::Png, Encoding::Scene { scene: Scene::Depth, format: Format::Png }, {
            let quality = Quality::Lossless;
            Encoding::Part { window: Window { x: 0, y: 0, width: 1, height: 1 }, size: [1, 1], quality }
        });
        // Every thread is kept until both others have asked, and one of them has gone.
        let (release, held) = std::sync::mpsc::channel::<()>();
        let held = Arc::new(std::sync::Mutex::new(held));
        let threads = pool().unwrap().current_num_threads();
        for _ in 0..threads {
            let held = Arc::clone(&held);
            pool().unwrap().spawn(move || held.lock().unwrap().recv().unwrap());
        }
        let (made, count) = std::sync::mpsc::channel();
        let ask = |encoding, what: &'static str| {
            let (pictures, made) = (Arc::clone(&pictures), made.clone());
            tokio::spawn(async move {
                let make = move || {
                    made.send(what).unwrap();
                    Ok::<_, Option<()>>(Bytes::new())
                };
                pictures.made(encoding, 1, make).await
            })
        };
        let gone = ask(first, "for nobody");
        let stays = [ask(second, "for one"), ask(third, "for another")];
        // Each has asked once it has been polled.
        tokio::task::yield_now().await;
        gone.abort();
        assert!(gone.await.unwrap_err().is_cancelled());
        (0..threads).for_each(|_| release.send(()).unwrap());
        for one in stays {
            one.await.unwrap().unwrap();
        }
        let mut made: Vec<_> = count.try_iter().collect();
        made.sort_unstable();
        assert_eq!(made, ["for another", "for one"]);
    }
}
