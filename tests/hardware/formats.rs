//! Every format that vivid offers and this program reads, by what is in the frames.

use plenalign::device::camera::offer::offers;
use plenalign::raw::{Channel, PixelFormat};

use crate::Test;
use crate::bench::{BLACK, Camera, RED, SIZE, WEBCAM, WHITE, config, mean_over_white, show};

pub(crate) const TESTS: &[Test] = &[("formats_are_all_offered", offered), ("formats_hold_what_is_shown", shown)];

fn offered() {
    let device = v4l::Device::with_path(WEBCAM).unwrap();
    let offers = offers(&device);
    for name in ["GREY", "Y10", "Y12", "Y16", "Y16 -BE", "YUYV", "UYVY", "NV12", "RGB3", "BA81", "RG10", "GB12", "BYR2"]
    {
        let offer = offers.iter().find(|offer| offer.format == name).unwrap_or_else(|| panic!("{name}: {offers:?}"));
        assert!(offer.readable && !offer.recompressed, "{offer:?}");
        let size = offer.sizes.iter().find(|size| size.most_px == [640, 360]);
        assert!(size.is_some_and(|size| !size.rates_hz.is_empty()), "{offer:?}");
    }
    assert!(offers.iter().any(|offer| !offer.readable), "vivid has formats that are not read");
}

fn shown() {
    let device = v4l::Device::with_path(WEBCAM).unwrap();
    let readable: Vec<PixelFormat> =
        offers(&device).iter().filter_map(|offer| PixelFormat::from_name(&offer.format)).collect();
    drop(device);
    assert!(readable.len() > 30, "{readable:?}");
    for format in readable {
        let name = format.name();
        show(WEBCAM, WHITE);
        let camera = Camera::online(&config(WEBCAM, name));
        // What was shown before may still be on its way in the first frame.
        camera.frame();
        let frame = camera.frame();
        assert_eq!((frame.image.width(), frame.image.height()), SIZE, "{name}");
        assert_eq!(frame.image.bits(), format.bits(), "{name}");
        let bright = mean_over_white(&frame.image, |_, _| true);
        // Video levels end at 235 of 255.
        assert!(bright > 0.9, "{name}: white is {bright}");
        show(WEBCAM, BLACK);
        camera.frame();
        let dark = mean_over_white(&camera.frame().image, |_, _| true);
        assert!(dark < 0.08, "{name}: black is {dark}");
        if let Some(mosaic) = format.mosaic() {
            show(WEBCAM, RED);
            camera.frame();
            let red = camera.frame();
            let of = |channel: Channel| mean_over_white(&red.image, |x, y| mosaic.channel(x, y) == channel);
            let seen = Channel::ALL.map(of);
            assert!(seen[0] > 0.9 && seen[1] < 0.1 && seen[2] < 0.1, "{name}: red is {seen:?}");
        }
        let state = camera.state();
        assert_eq!((state.frames_damaged, state.size), (0, Some(SIZE)), "{name}: {state:?}");
        println!("{name}: white {bright:.3}, black {dark:.3}");
    }
}
