//! The picture shown where there is no live one: it says so, and why.

use std::convert::Infallible;

use axum::body::Bytes;
use embedded_graphics::Drawable as _;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::{FONT_9X15, FONT_10X20};
use embedded_graphics::pixelcolor::{Gray8, GrayColor as _};
use embedded_graphics::text::{Baseline, Text};

use super::picture::grey_jpeg;

/// Columns and rows.
const SIZE: (usize, usize) = (640, 360);
/// Left and right of the text, px.
const MARGIN: usize = 24;
/// Width of a letter of the explanation, px.
const LETTER: usize = 9;

struct Canvas(Vec<u8>);

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(SIZE.0 as u32, SIZE.1 as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Gray8;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Gray8>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(point, colour) in pixels {
            let (Ok(x), Ok(y)) = (usize::try_from(point.x), usize::try_from(point.y)) else { continue };
            if x < SIZE.0 && y < SIZE.1 {
                self.0[y * SIZE.0 + x] = colour.luma();
            }
        }
        Ok(())
    }
}

/// A greyscale JPEG that says that there is no live picture, why, and when that was said.
///
/// # Errors
/// What the encoder says.
pub(in crate::api) fn jpeg(why: &str, at: jiff::Timestamp) -> Result<Bytes, String> {
    let mut canvas = Canvas(vec![24; SIZE.0 * SIZE.1]);
    let title = MonoTextStyle::new(&FONT_10X20, Gray8::new(255));
    let body = MonoTextStyle::new(&FONT_9X15, Gray8::new(200));
    let left = MARGIN as i32;
    let mut write = |text: &str, top: i32, style: MonoTextStyle<'_, Gray8>| {
        // Drawing into memory cannot fail.
        let _ = Text::with_baseline(text, Point::new(left, top), style, Baseline::Top).draw(&mut canvas);
    };
    write("NO LIVE PICTURE", 40, title);
    let columns = (SIZE.0 - 2 * MARGIN) / LETTER;
    let mut top = 90;
    for line in wrapped(why, columns).iter().take(12) {
        write(line, top, body);
        top += 20;
    }
    write(&at.strftime("%Y-%m-%d %H:%M:%S UTC").to_string(), SIZE.1 as i32 - 40, body);
    grey_jpeg(&canvas.0, SIZE.0, SIZE.1, 80)
}

/// Words in lines of at most so many letters; a longer word is cut. Letters that the font lacks become question marks.
fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    let plain: String = text.chars().map(|c| if c.is_ascii() && !c.is_ascii_control() { c } else { '?' }).collect();
    for word in plain.split_whitespace() {
        let mut rest = word;
        while !rest.is_empty() {
            let Some(line) = lines.last_mut() else { break };
            let space = usize::from(!line.is_empty());
            if line.len() + space + rest.len() <= columns {
                line.push_str(&" "[..space]);
                line.push_str(rest);
                rest = "";
            } else if line.is_empty() {
                let (now, later) = rest.split_at(columns);
                line.push_str(now);
                rest = later;
                lines.push(String::new());
            } else {
                lines.push(String::new());
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_wrapped_and_long_ones_cut() {
        assert_eq!(wrapped("the camera is not there", 10), ["the camera", "is not", "there"]);
        assert_eq!(wrapped("/dev/v4l/by-id/usb", 8), ["/dev/v4l", "/by-id/u", "sb"]);
        assert_eq!(wrapped("grüße\u{1b}", 20), ["gr??e?"]);
    }

    #[test]
    fn the_picture_has_ink_where_the_text_is() {
        let blank = jpeg("", jiff::Timestamp::UNIX_EPOCH).unwrap();
        let full = jpeg("the camera was unplugged; connect it", jiff::Timestamp::UNIX_EPOCH).unwrap();
        let ink = |bytes: &Bytes| {
            let picture = image::load_from_memory(bytes).unwrap().into_luma8();
            assert_eq!((picture.width(), picture.height()), (640, 360));
            picture.rows().skip(85).take(60).flatten().filter(|pixel| pixel.0[0] > 120).count()
        };
        assert!(ink(&blank) == 0 && ink(&full) > 300, "{} {}", ink(&blank), ink(&full));
    }
}
