//! What a viewer sees of the raw frame: the whole of it coarser or finer, or a rectangle at so many pixels.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::picture::{Encoding, Quality, Reduce};
use crate::api::error::{Problem, Result};
use crate::api::proto;
use crate::api::types::Viewport;
use crate::raw::{RawImage, Window};

/// Most columns and rows of a picture that can be asked for: more than any screen has.
const MOST_PX: u32 = 16384;

/// What of the raw frame is shown, and at how many pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Part {
    /// The whole of it.
    Whole(Reduce),
    /// A rectangle of it.
    Viewport(Viewport),
}

/// A part of one raw frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::api) struct Shown {
    window: Window,
    /// Columns and rows of the picture.
    size: [usize; 2],
    quality: Quality,
}

impl Part {
    /// What a viewport comes to: the picture has no more pixels than the rectangle.
    pub(in crate::api) fn of_viewport(asked: Viewport) -> Result<Self> {
        for (field, pixels) in [("width_px", asked.width_px), ("height_px", asked.height_px)] {
            if pixels == 0 {
                let field = format!("viewport.{field}");
                return Err(Problem::invalid(&field, format!("{field}: 0 pixels show nothing; 1 is the least")));
            }
        }
        let sizes = [("picture_width_px", asked.picture_width_px), ("picture_height_px", asked.picture_height_px)];
        for (field, pixels) in sizes {
            if !(1..=MOST_PX).contains(&pixels) {
                let field = format!("viewport.{field}");
                return Err(Problem::invalid(&field, format!("{field}: {pixels} is not within 1 to {MOST_PX}")));
            }
        }
        let (width_px, height_px) = (asked.picture_width_px, asked.picture_height_px);
        if asked.lossless && (width_px < asked.width_px || height_px < asked.height_px) {
            let detail = format!(
                "viewport.lossless: {}x{} pixels of the frame have no room in a picture of {width_px}x{height_px}; ask \
                 for a smaller rectangle or a larger picture, or leave lossless out",
                asked.width_px, asked.height_px
            );
            return Err(Problem::invalid("viewport.lossless", detail));
        }
        Ok(Self::Viewport(Viewport {
            picture_width_px: width_px.min(asked.width_px),
            picture_height_px: height_px.min(asked.height_px),
            ..asked
        }))
    }

    /// The part of a frame, as a picture of a quality (unless that is to be without loss).
    ///
    /// # Errors
    /// The rectangle is not of the frame.
    pub(in crate::api) fn shown(self, image: &RawImage, quality: u8) -> Result<Shown> {
        match self {
            Self::Whole(reduce) => Ok(whole(image, reduce, quality)),
            Self::Viewport(viewport) if image.contains(window(viewport)) => Ok(Shown {
                window: window(viewport),
                size: [viewport.picture_width_px as usize, viewport.picture_height_px as usize],
                quality: if viewport.lossless { Quality::Lossless } else { Quality::Jpeg(quality) },
            }),
            Self::Viewport(Viewport { x_px, y_px, width_px, height_px, .. }) => {
                let (columns, rows) = (image.width(), image.height());
                let detail = format!(
                    "viewport: {width_px}x{height_px} pixels from column {x_px} and row {y_px} on are not within the \
                     frame, which has {columns} columns and {rows} rows, counted from 0"
                );
                Err(Problem::invalid("viewport", detail))
            }
        }
    }
}

const fn window(viewport: Viewport) -> Window {
    Window {
        x: viewport.x_px as usize,
        y: viewport.y_px as usize,
        width: viewport.width_px as usize,
        height: viewport.height_px as usize,
    }
}

/// The whole frame. What does not fill a pixel of the picture at its right and lower edge is left out.
pub(in crate::api) fn whole(image: &RawImage, reduce: Reduce, quality: u8) -> Shown {
    let n = reduce.number() as usize;
    let (width, height) = (image.width() / n, image.height() / n);
    let quality = Quality::Jpeg(quality);
    if width == 0 || height == 0 {
        return Shown { window: image.window(), size: [image.width(), image.height()], quality };
    }
    let window = Window { x: 0, y: 0, width: width * n, height: height * n };
    Shown { window, size: [width, height], quality }
}

impl Shown {
    pub(in crate::api) const fn encoding(self) -> Encoding {
        Encoding::Part { window: self.window, size: self.size, quality: self.quality }
    }

    /// As a picture's message says it.
    pub(in crate::api) fn message(self) -> proto::Viewport {
        let Self { window, size: [width, height], quality } = self;
        proto::Viewport {
            x_px: window.x as u32,
            y_px: window.y as u32,
            width_px: window.width as u32,
            height_px: window.height as u32,
            picture_width_px: width as u32,
            picture_height_px: height as u32,
            lossless: quality == Quality::Lossless,
        }
    }
}

/// A viewport, and the quality of its picture where that is with loss.
type Key = (Viewport, Option<u8>);

/// The different viewports that are watched, and how many viewers watch each.
pub(in crate::api) struct Viewports {
    most: usize,
    watched: Mutex<HashMap<Key, usize>>,
}

/// A viewer watches a viewport for as long as this lives.
pub(in crate::api) struct Watched {
    viewports: Arc<Viewports>,
    key: Key,
}

impl Viewports {
    /// At most so many.
    pub(in crate::api) fn new(most: usize) -> Arc<Self> {
        Arc::new(Self { most, watched: Mutex::default() })
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Key, usize>> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A viewer watches a part from now on in place of what it watched before, which it lets go of thereafter. The whole
    /// frame by `reduce` can always be had.
    ///
    /// # Errors
    /// There are too many different ones.
    pub(in crate::api) fn watch(
        self: &Arc<Self>,
        part: Part,
        quality: u8,
        before: Option<&Watched>,
    ) -> Result<Option<Watched>> {
        let Part::Viewport(viewport) = part else { return Ok(None) };
        let key = (viewport, (!viewport.lossless).then_some(quality));
        let mut watched = self.lock();
        let leaves = before.is_some_and(|before| watched.get(&before.key) == Some(&1));
        if !watched.contains_key(&key) && watched.len() - usize::from(leaves) >= self.most {
            return Err(Problem::too_many_viewports(self.most));
        }
        *watched.entry(key).or_default() += 1;
        drop(watched);
        Ok(Some(Watched { viewports: Arc::clone(self), key }))
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let mut watched = self.viewports.lock();
        if let Some(viewers) = watched.get_mut(&self.key) {
            *viewers -= 1;
            if *viewers == 0 {
                watched.remove(&self.key);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: Viewport = Viewport {
        x_px: 0,
        y_px: 0,
        width_px: 64,
        height_px: 48,
        picture_width_px: 64,
        picture_height_px: 48,
        lossless: false,
    };

    fn part(viewport: Viewport) -> Part {
        Part::of_viewport(viewport).unwrap()
    }

    #[test]
    fn reduce_is_a_viewport_of_the_whole_frame() {
        let image = RawImage::from_u8(65, 49, vec![0; 65 * 49]);
        let half = Viewport { picture_width_px: 32, picture_height_px: 24, ..WHOLE };
        let shown = |part: Part| part.shown(&image, 80).unwrap();
        assert_eq!(shown(Part::Whole(Reduce::Half)), shown(part(half)));
        assert_eq!(shown(Part::Whole(Reduce::Not)).size, [65, 49]);
        let narrow = RawImage::from_u8(3, 9, vec![0; 27]);
        assert_eq!(Part::Whole(Reduce::Quarter).shown(&narrow, 80).unwrap().size, [3, 9]);
    }

    #[test]
    fn a_picture_has_no_more_pixels_than_its_rectangle() {
        let large = Viewport { picture_width_px: 2000, picture_height_px: 24, ..WHOLE };
        assert_eq!(part(large), part(Viewport { picture_width_px: 64, picture_height_px: 24, ..WHOLE }));
    }

    #[test]
    fn a_viewport_that_shows_nothing_is_refused_by_name() {
        for (wrong, field) in [
            (Viewport { width_px: 0, ..WHOLE }, "viewport.width_px"),
            (Viewport { height_px: 0, ..WHOLE }, "viewport.height_px"),
            (Viewport { picture_width_px: 0, ..WHOLE }, "viewport.picture_width_px"),
            (Viewport { picture_height_px: 20_000, ..WHOLE }, "viewport.picture_height_px"),
            (Viewport { picture_width_px: 63, lossless: true, ..WHOLE }, "viewport.lossless"),
        ] {
            let problem = Part::of_viewport(wrong).unwrap_err();
            assert_eq!(problem.members["field"], field);
            assert!(problem.detail.starts_with(field), "{}", problem.detail);
        }
        let image = RawImage::from_u8(64, 48, vec![0; 64 * 48]);
        for wrong in [
            Viewport { x_px: 1, ..WHOLE },
            Viewport { y_px: u32::MAX, ..WHOLE },
            Viewport { width_px: 65, ..WHOLE },
            Viewport { height_px: u32::MAX, ..WHOLE },
        ] {
            let problem = part(wrong).shown(&image, 80).unwrap_err();
            assert!(problem.detail.contains("64 columns and 48 rows"), "{}", problem.detail);
        }
    }

    #[test]
    fn different_viewports_are_bounded_and_equal_ones_count_once() {
        let viewports = Viewports::new(2);
        let nth = |x_px| part(Viewport { x_px, ..WHOLE });
        let watch = |part, quality, before: Option<&Watched>| viewports.watch(part, quality, before);
        let one = watch(nth(1), 80, None).unwrap();
        let _equal = watch(nth(1), 80, None).unwrap();
        let two = watch(nth(2), 80, None).unwrap();
        for (another, quality) in [(nth(3), 80), (nth(1), 70)] {
            let problem = watch(another, quality, None).err().unwrap();
            assert_eq!((problem.status, problem.members["limit"].as_u64()), (429, Some(2)));
        }
        // The whole frame can be had all the same.
        assert!(watch(Part::Whole(Reduce::Half), 55, None).unwrap().is_none());
        // Who moves on makes room for itself, where nobody else stays behind.
        assert!(watch(nth(3), 80, one.as_ref()).is_err());
        let three = watch(nth(3), 80, two.as_ref()).unwrap();
        drop(two);
        assert!(watch(nth(4), 80, None).is_err());
        drop(three);
        assert!(watch(nth(4), 80, None).is_ok());
        // Without loss there is no quality to be different by.
        let lossless = part(Viewport { lossless: true, ..WHOLE });
        let _first = watch(lossless, 80, None).unwrap();
        assert!(watch(lossless, 30, None).is_ok());
    }
}
