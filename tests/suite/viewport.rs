//! Viewports: what of the frame a viewer is shown, at how many pixels, made once for all who see the same.

use std::collections::BTreeSet;

use plenalign::api::proto::{self, viewed::What};
use plenalign::config::Config;
use plenalign::raw::RawImage;
use prost::Message as _;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;

use super::daemon::{Daemon, client};
use super::fakes::fakes;
use super::program::{Program, serve};
use super::until::until;
use super::websocket::{Socket, next, next_picture, next_problem, open, open_at, say};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

/// Every sample its own, 12 bits deep.
fn samples() -> Vec<u16> {
    (0..WIDTH * HEIGHT).map(|k| (k * 4093 % 4096) as u16).collect()
}

fn asked(viewport: Value) -> Value {
    json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "viewport": viewport })
}

/// The rectangle of 20 x 10 pixels at (8, 4), with so much room.
fn part(width: u32, height: u32, lossless: bool) -> Value {
    json!({ "x_px": 8, "y_px": 4, "width_px": 20, "height_px": 10,
            "picture_width_px": width, "picture_height_px": height, "lossless": lossless })
}

#[tokio::test]
async fn a_viewport_shows_its_rectangle_and_without_loss_the_cameras_own_samples() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let mut socket = open(&daemon).await;
    let samples = samples();
    fakes.camera.take_image(7, RawImage::from_u16(WIDTH, HEIGHT, 12, samples.clone()));
    // There is room for more pixels than there are.
    say(&mut socket, asked(part(400, 300, true))).await;
    let exact = next_picture(&mut socket).await;
    let shown = proto::Viewport {
        x_px: 8,
        y_px: 4,
        width_px: 20,
        height_px: 10,
        picture_width_px: 20,
        picture_height_px: 10,
        lossless: true,
    };
    assert_eq!((exact.seq, exact.viewport.unwrap(), exact.reduce, exact.sample_bits), (7, shown, 0, 12));
    assert_eq!((exact.width_px, exact.height_px, exact.jpeg.len()), (64, 48, 0));
    let found: Vec<u16> =
        image::load_from_memory(&exact.png).unwrap().into_luma16().into_raw().iter().map(|high| high >> 4).collect();
    let wanted: Vec<u16> =
        (4..14).flat_map(|y| (8..28).map(move |x| (x, y))).map(|(x, y)| samples[y * WIDTH + x]).collect();
    assert_eq!(found, wanted);

    // The same frame again at once, coarser.
    say(&mut socket, asked(part(5, 2, false))).await;
    let coarse = next_picture(&mut socket).await;
    let viewport = coarse.viewport.unwrap();
    assert_eq!((coarse.seq, coarse.png.len(), viewport.lossless), (7, 0, false));
    assert_eq!((viewport.picture_width_px, viewport.picture_height_px), (5, 2));
    let jpeg = image::load_from_memory(&coarse.jpeg).unwrap();
    assert_eq!((jpeg.width(), jpeg.height()), (5, 2));

    // The whole frame says so, too.
    say(&mut socket, json!({ "type": "pictures", "on": true, "reduce": 2 })).await;
    let whole = next_picture(&mut socket).await;
    let viewport = whole.viewport.unwrap();
    assert_eq!((whole.reduce, viewport.width_px, viewport.picture_width_px), (2, 64, 32));
}

#[tokio::test]
async fn a_viewport_that_cannot_be_shown_is_answered_and_what_was_sent_before_goes_on() {
    let fakes = fakes();
    let camera = fakes.camera.clone();
    let daemon = Daemon::start(fakes.bench).await;
    let mut socket = open(&daemon).await;
    camera.take(1);
    say(&mut socket, asked(part(20, 10, false))).await;
    assert_eq!(next_picture(&mut socket).await.seq, 1);
    let with = |field: &str, value: Value| {
        let mut viewport = part(20, 10, false);
        viewport[field] = value;
        asked(viewport)
    };
    let beside = |field: &str, value: Value| {
        let mut message = asked(part(20, 10, false));
        message[field] = value;
        message
    };
    for (message, field, words) in [
        (with("x_px", json!(45)), "viewport", "64 columns and 48 rows"),
        (with("height_px", json!(45)), "viewport", "64 columns and 48 rows"),
        (with("width_px", json!(0)), "viewport.width_px", "1 is the least"),
        (with("picture_height_px", json!(0)), "viewport.picture_height_px", "1 to 16384"),
        (with("picture_width_px", json!(1e6)), "viewport.picture_width_px", "1 to 16384"),
        (with("x_px", json!(-1)), "viewport.x_px", "whole number"),
        (with("y_px", json!(0.5)), "viewport.y_px", "whole number"),
        (with("width_px", json!(1e12)), "viewport.width_px", "fits"),
        // What JSON has for not a number.
        (with("width_px", Value::Null), "viewport.width_px", "whole number"),
        (asked(part(19, 10, true)), "viewport.lossless", "smaller rectangle"),
        (with("zoom", json!(2)), "viewport.zoom", "unknown field"),
        (asked(json!({ "x_px": 0 })), "viewport.y_px", "missing field"),
        (asked(json!([0, 0, 20, 10])), "viewport", "invalid length"),
        (asked(json!("all")), "viewport", "invalid type"),
        (beside("reduce", json!(2)), "viewport", "leave reduce out"),
        (beside("show", json!("depth")), "viewport", "show raw"),
    ] {
        say(&mut socket, message.clone()).await;
        let problem = next_problem(&mut socket).await["problem"].take();
        assert_eq!(problem["status"], 422, "{message}: {problem}");
        assert_eq!(problem["field"], field, "{message}: {problem}");
        assert!(problem["detail"].as_str().unwrap().contains(words), "{message}: {problem}");
    }
    camera.take(2);
    assert_eq!(next_picture(&mut socket).await.seq, 2);
    // The camera's frames become smaller than what is looked at, and as large again.
    camera.take_sized(3, 16, 16);
    let problem = next_problem(&mut socket).await["problem"].take();
    assert!(problem["detail"].as_str().unwrap().contains("16 columns and 16 rows"), "{problem}");
    camera.take(4);
    assert_eq!(next_picture(&mut socket).await.seq, 4);
}

#[tokio::test]
async fn more_different_viewports_than_are_allowed_are_refused_and_the_whole_frame_is_not() {
    let fakes = fakes();
    let mut config = Config::default();
    config.server.max_viewports = 2;
    let daemon = Daemon::start_with(config, fakes.bench).await;
    fakes.camera.take(1);
    let watch = async |message: Value| {
        let mut socket = open(&daemon).await;
        say(&mut socket, message).await;
        socket
    };
    let mut one = watch(asked(part(20, 10, false))).await;
    next_picture(&mut one).await;
    for message in [asked(part(20, 10, false)), asked(part(10, 5, false))] {
        next_picture(&mut watch(message).await).await;
    }
    // The two last have gone, and with them the second viewport.
    let mut two = open(&daemon).await;
    until("there is room for another", async || {
        say(&mut two, asked(part(7, 5, false))).await;
        say(&mut two, json!({ "type": "nonsense" })).await;
        next_problem(&mut two).await["problem"]["status"] == 422
    })
    .await;
    let mut three = watch(asked(part(6, 5, false))).await;
    let problem = next_problem(&mut three).await["problem"].take();
    assert_eq!(problem["type"], "urn:plenalign:problem:too-many-viewports", "{problem}");
    assert_eq!((problem["status"].as_u64(), problem["limit"].as_u64()), (Some(429), Some(2)));
    assert!(problem["detail"].as_str().unwrap().contains("reduce"), "{problem}");
    say(&mut three, json!({ "type": "pictures", "on": true, "reduce": 4, "quality": 33 })).await;
    assert_eq!(next_picture(&mut three).await.reduce, 4);
    // Whoever watches one already may move on.
    say(&mut one, asked(part(9, 9, false))).await;
    assert_eq!(next_picture(&mut one).await.viewport.unwrap().picture_width_px, 9);
}

/// Pictures that come to a viewer, by frame and columns, until it wants no more.
async fn watch(mut socket: Socket, viewport: Value, count: usize) -> Vec<(u64, u32)> {
    say(&mut socket, asked(viewport)).await;
    let mut seen = Vec::new();
    loop {
        match next(&mut socket).await {
            Message::Binary(bytes) => {
                let What::Frame(frame) = proto::Viewed::decode(bytes).unwrap().what.unwrap() else { continue };
                seen.push((frame.seq, frame.viewport.unwrap().picture_width_px));
                if seen.len() == count {
                    say(&mut socket, json!({ "type": "pictures", "on": false })).await;
                    // What is said of this comes after every picture.
                    say(&mut socket, json!({ "type": "nonsense" })).await;
                }
            }
            Message::Text(text) if text.contains("\"type\":\"problem\"") => return seen,
            _ => {}
        }
    }
}

#[tokio::test]
async fn equal_viewports_are_made_once_a_frame_and_none_for_nobody() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(serve(state.path(), &[]));
    let address = program.address().to_owned();
    let viewport = |columns: u32| {
        json!({ "x_px": 10, "y_px": 20, "width_px": 300, "height_px": 200,
                "picture_width_px": columns, "picture_height_px": 90 })
    };
    let watching = (0..6).map(async |k| watch(open_at(&address).await, viewport(100 + k % 2), 12).await);
    let seen: Vec<(u64, u32)> = futures_util::future::join_all(watching).await.concat();
    let different: BTreeSet<_> = seen.iter().copied().collect();
    assert!(seen.len() >= 72 && different.len() < seen.len() / 2, "{} of {}", different.len(), seen.len());
    let metrics = client().get(format!("http://{address}/metrics")).send().await.unwrap().text().await.unwrap();
    let count = metrics.lines().find_map(|line| line.strip_prefix("plenalign_picture_seconds_count ")).unwrap();
    assert_eq!(count.parse::<usize>().unwrap(), different.len());

    // What makes them gives way, to as much as there is room for below the daemon itself.
    let threads = priorities(program.id());
    let own = threads.iter().find(|(name, _)| name == "plenalign").unwrap().1;
    let making: Vec<i32> =
        threads.iter().filter(|(name, _)| name.starts_with("picture-")).map(|(_, nice)| *nice).collect();
    assert!(!making.is_empty() && making.iter().all(|nice| *nice == (own + 10).min(19)), "{own} and {threads:?}");
}

/// Name and nice value of each thread of a process.
fn priorities(pid: u32) -> Vec<(String, i32)> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let stats = threads.filter_map(|thread| std::fs::read_to_string(thread.unwrap().path().join("stat")).ok());
    stats
        .map(|stat| {
            let (begin, rest) = stat.rsplit_once(") ").unwrap();
            // The 19th of proc(5), of which two stand before.
            (begin.split_once('(').unwrap().1.to_owned(), rest.split(' ').nth(16).unwrap().parse().unwrap())
        })
        .collect()
}
