//! Pictures and distances of the newest frame over HTTP and the WebSocket.

use std::sync::Arc;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use plenalign::api::proto::{self, viewed::What};
use plenalign::control::open_bench;
use plenalign::device::Setup;
use prost::Message as _;
use reqwest::{Method, Response, StatusCode};
use serde_json::{Value, json};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

use super::bench::{quick_axes, small_config};
use super::daemon::{Daemon, problem};
use super::fakes::fakes;

/// A simulated bench with the shell off and a board in air; its axes are not homed yet.
async fn before_a_board() -> Daemon {
    let mut config = small_config(3);
    config.bench.simulation.rays = 4;
    quick_axes(&mut config.bench);
    let distance_mm = config.design().joint(0.0).equivalent_distance;
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    bench.simulated.as_ref().unwrap().obey(&Setup::AirTripleBoard { distances_mm: [distance_mm; 3] });
    Daemon::start_with(config, bench).await
}

async fn home(daemon: &Daemon) {
    let off = daemon.command(Method::PUT, "/api/v1/shell", &json!({ "state": "off" })).await;
    assert!(off.status().is_success(), "{}", off.text().await.unwrap());
    let response = daemon.command(Method::POST, "/api/v1/axes/focus/home", &Value::Null).await;
    assert_eq!(response.status(), StatusCode::ACCEPTED, "{}", response.text().await.unwrap());
    let homed = |bench: &Value| bench["axes"][0]["homed"] == true && bench["axes"][0]["moving"] == false;
    daemon.until("/api/v1/bench", "homed", homed).await;
}

async fn picture(response: Response) -> (image::DynamicImage, reqwest::header::HeaderMap) {
    let (status, headers) = (response.status(), response.headers().clone());
    let bytes = response.bytes().await.unwrap();
    assert_eq!(status, StatusCode::OK, "{}", String::from_utf8_lossy(&bytes));
    (image::load_from_memory(&bytes).unwrap(), headers)
}

#[tokio::test]
async fn the_newest_frame_is_seen_in_every_way() {
    let daemon = before_a_board().await;
    let asked = jiff::Timestamp::now();
    let report = daemon.get("/api/v1/view?lenses=true").await;
    let report: Value = report.json().await.unwrap();
    let captured: jiff::Timestamp =
        report["captured_at"].as_str().unwrap_or_else(|| panic!("{report}")).parse().unwrap();
    assert!(captured >= asked, "a frame of before it was asked for: {report}");
    let count = report["micro_images"].as_u64().unwrap();
    assert!(count > 50 && report["lenses"].as_array().unwrap().len() as u64 == count, "{report}");
    assert!(report["ssim_mean"].as_f64().unwrap() > 0.3, "{report}");
    assert!(report["eog_sum"].as_f64().unwrap() > report["eog_mean_per_pixel"].as_f64().unwrap());
    // Nothing is homed, so that nobody knows where the camera was.
    assert_eq!((&report["pose"], &report["distance_mm"]), (&Value::Null, &Value::Null));
    assert!(report["pose_unknown"].as_str().unwrap().contains("home it"), "{report}");
    for metric in ["view.png?kind=depth", "view.jpg?kind=refocus&distance_mm=800"] {
        let refused = problem(daemon.get(&format!("/api/v1/{metric}")).await, 409, "pose-unknown").await;
        assert!(refused["detail"].as_str().unwrap().contains("home it"), "{refused}");
    }
    // Colours stand for spacings, and need no pose.
    let (depth, headers) = picture(daemon.get("/api/v1/view.jpg?kind=depth").await).await;
    assert!(matches!(depth, image::DynamicImage::ImageRgb8(_)) && !headers.contains_key("plenalign-near-mm"));

    home(&daemon).await;
    let report: Value = daemon.get("/api/v1/view").await.json().await.unwrap();
    assert_eq!(report["pose"]["medium"], "air", "{report}");
    assert!(report.get("lenses").is_none() && report["distance_mm"]["median"].as_f64().unwrap() > 0.0, "{report}");
    let size = [0, 1].map(|k| report["view_px"][k].as_u64().unwrap() as u32);
    let near = |picture: &image::DynamicImage| {
        picture.width().abs_diff(size[0]) <= 2 && picture.height().abs_diff(size[1]) <= 2
    };
    for (query, exact) in [
        ("", image::ColorType::L16),
        ("?angle=0.3,-0.2", image::ColorType::L16),
        ("?kind=all_in_focus", image::ColorType::L16),
        ("?kind=depth", image::ColorType::L16),
    ] {
        let (png, headers) = picture(daemon.get(&format!("/api/v1/view.png{query}")).await).await;
        assert!(png.color() == exact && near(&png), "{query}: {:?} {}x{}", png.color(), png.width(), png.height());
        assert_eq!(
            (&headers["content-type"], &headers["plenalign-simulated"]),
            (&"image/png".parse().unwrap(), &"true".parse().unwrap())
        );
        assert!(headers.contains_key("plenalign-captured-monotonic-ms"));
        let (jpeg, _) = picture(daemon.get(&format!("/api/v1/view.jpg{query}")).await).await;
        assert!(near(&jpeg), "{query}");
    }
    // Tenths of a millimetre about the distance that the figures say.
    let (depth, headers) = picture(daemon.get("/api/v1/view.png?kind=depth").await).await;
    let mut levels: Vec<u16> = depth.into_luma16().into_raw().into_iter().filter(|&level| level > 0).collect();
    levels.sort_unstable();
    let (median, said) =
        (f64::from(levels[levels.len() / 2]) / 10.0, report["distance_mm"]["median"].as_f64().unwrap());
    assert!((median / said - 1.0).abs() < 0.1, "{median} in the picture, {said} in the figures");
    let end = |name: &str| headers[name].to_str().unwrap().parse::<f64>().unwrap();
    assert!(end("plenalign-near-mm") < end("plenalign-far-mm"));
    let sharp = format!("/api/v1/view.jpg?kind=refocus&distance_mm={said:.1}");
    assert!(near(&picture(daemon.get(&sharp).await).await.0));
}

#[tokio::test]
async fn what_cannot_be_seen_is_said() {
    let daemon = before_a_board().await;
    for (query, field) in [("kind=oblique", "kind"), ("angle=2,0", "angle"), ("quality=3", "quality")] {
        let refused = problem(daemon.get(&format!("/api/v1/view.jpg?{query}")).await, 422, "invalid").await;
        assert!(refused["detail"].as_str().unwrap().contains(field), "{query}: {refused}");
    }
    home(&daemon).await;
    let refused = problem(daemon.get("/api/v1/view.jpg?kind=refocus&distance_mm=2").await, 409, "not-viewable").await;
    assert!(refused["detail"].as_str().unwrap().contains("2 mm"), "{refused}");

    let fakes = fakes();
    let camera = Arc::clone(&fakes.camera);
    let daemon = Daemon::start(fakes.bench).await;
    let taking = tokio::spawn(async move { camera.film(1.., [64, 48], Duration::from_millis(20)).await });
    let refused = problem(daemon.get("/api/v1/view").await, 409, "not-viewable").await;
    assert!(refused["detail"].as_str().unwrap().contains("grid"), "{refused}");
    taking.abort();
}

#[tokio::test]
async fn a_viewer_switches_between_pictures() {
    let daemon = before_a_board().await;
    let (mut socket, _) = connect_async(format!("ws://{}/api/v1/ws", daemon.address)).await.unwrap();
    for (show, wanted) in [
        ("raw", proto::Picture::Raw),
        ("central", proto::Picture::Central),
        ("depth", proto::Picture::Depth),
        ("all_in_focus", proto::Picture::AllInFocus),
    ] {
        let ask = json!({ "type": "pictures", "on": true, "show": show, "max_rate_hz": 30.0 });
        socket.send(Message::text(ask.to_string())).await.unwrap();
        let seen = async {
            loop {
                let Some(Ok(message)) = socket.next().await else { panic!("the socket is open") };
                if let Message::Binary(bytes) = message
                    && let Some(What::Frame(frame)) = proto::Viewed::decode(bytes).unwrap().what
                    && frame.picture == i32::from(wanted)
                {
                    return frame;
                }
            }
        };
        let frame = tokio::time::timeout(Duration::from_secs(60), seen).await.expect(show);
        let picture = image::load_from_memory(&frame.jpeg).unwrap();
        assert_eq!(picture.width() == frame.width_px, show == "raw", "{show}: {} px wide", picture.width());
        assert_eq!(picture.color().has_color(), show == "depth", "{show}");
    }
    let mut measured = Value::Null;
    let heard = async {
        while measured.is_null() {
            let Some(Ok(message)) = socket.next().await else { panic!("the socket is open") };
            if let Message::Text(text) = message {
                let value: Value = serde_json::from_str(&text).unwrap();
                assert_ne!(value["type"], "problem", "{value}");
                if value["type"] == "tick" {
                    measured = value;
                }
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(20), heard).await.expect("a sign of life");
}
