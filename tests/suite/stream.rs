//! The MJPEG stream, read as a generic viewer reads it.

use std::time::Duration;

use futures_util::StreamExt as _;
use reqwest::Response;
use serde_json::Value;

use super::daemon::{Daemon, problem};
use super::fakes::fakes;

/// Reads the parts of a stream: headers as text, and the JPEG.
struct Parts {
    stream: std::pin::Pin<Box<dyn futures_util::Stream<Item = reqwest::Result<axum::body::Bytes>>>>,
    buffer: Vec<u8>,
}

impl Parts {
    fn of(response: Response) -> Self {
        assert_eq!(response.status(), 200);
        assert_eq!(response.headers()["content-type"], "multipart/x-mixed-replace;boundary=plenalign-frame");
        Self { stream: Box::pin(response.bytes_stream()), buffer: Vec::new() }
    }

    async fn next(&mut self) -> (String, Vec<u8>) {
        loop {
            if let Some(end) = self.buffer.windows(4).position(|four| four == b"\r\n\r\n") {
                let head = String::from_utf8(self.buffer[..end].to_vec()).unwrap();
                assert!(head.trim_start().starts_with("--plenalign-frame\r\ncontent-type: image/jpeg\r\n"), "{head}");
                let length: usize = header(&head, "content-length").parse().unwrap();
                if self.buffer.len() >= end + 4 + length + 2 {
                    let jpeg = self.buffer[end + 4..end + 4 + length].to_vec();
                    self.buffer.drain(..end + 4 + length + 2);
                    return (head, jpeg);
                }
            }
            let more = tokio::time::timeout(Duration::from_secs(5), self.stream.next()).await.expect("a part in 5 s");
            self.buffer.extend_from_slice(&more.expect("the stream goes on").unwrap());
        }
    }
}

fn header<'a>(head: &'a str, name: &str) -> &'a str {
    let line = head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
    line.unwrap_or_else(|| panic!("no {name} in {head}"))
}

#[tokio::test]
async fn the_newest_frame_comes_and_what_was_left_out_is_counted() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    fakes.camera.take(1);
    let mut parts = Parts::of(daemon.get("/api/v1/stream.mjpg?max_rate_hz=10&reduce=2&quality=60").await);
    let (head, jpeg) = parts.next().await;
    assert_eq!((header(&head, "plenalign-frame-seq"), header(&head, "plenalign-online")), ("1", "true"));
    assert!(header(&head, "x-timestamp").parse::<f64>().unwrap() > 1.7e9);
    let picture = image::load_from_memory(&jpeg).unwrap();
    assert_eq!((picture.width(), picture.height()), (32, 24));
    for seq in 2..=7 {
        fakes.camera.take(seq);
    }
    let (head, _) = parts.next().await;
    assert_eq!((header(&head, "plenalign-frame-seq"), header(&head, "plenalign-dropped")), ("7", "5"));
    problem(daemon.get("/api/v1/stream.mjpg?max_rate_hz=0").await, 422, "invalid").await;
}

#[tokio::test]
async fn where_no_frame_comes_a_picture_says_why_and_the_next_frame_is_live_again() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let mut parts = Parts::of(daemon.get("/api/v1/stream.mjpg").await);
    for _ in 0..2 {
        let (head, jpeg) = parts.next().await;
        assert_eq!(header(&head, "plenalign-online"), "false");
        assert!(!head.contains("plenalign-frame-seq"), "{head}");
        let picture = image::load_from_memory(&jpeg).unwrap();
        assert_eq!((picture.width(), picture.height()), (640, 360));
    }
    // An old frame is not live.
    fakes.camera.take(3);
    loop {
        let (head, _) = parts.next().await;
        if header(&head, "plenalign-online") == "true" {
            assert_eq!(header(&head, "plenalign-frame-seq"), "3");
            break;
        }
    }
    assert_eq!(header(&parts.next().await.0, "plenalign-online"), "false");
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(bench["camera"]["frame_seq"], 3);
    daemon.api.closing().cancel();
    let ended = tokio::time::timeout(Duration::from_secs(3), async { while parts.stream.next().await.is_some() {} });
    ended.await.expect("the stream ends with the program");
}
