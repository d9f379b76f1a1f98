//! The WebSocket: the snapshot, changes in order, pictures, and its end.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use plenalign::api::proto::{self, viewed::What};
use plenalign::raw::RawImage;
use prost::Message as _;
use reqwest::Method;
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::until;

pub(super) type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

pub(super) async fn open(daemon: &Daemon) -> Socket {
    open_at(&daemon.address.to_string()).await
}

pub(super) async fn open_at(address: &str) -> Socket {
    connect_async(format!("ws://{address}/api/v1/ws")).await.unwrap().0
}

pub(super) async fn next(socket: &mut Socket) -> Message {
    let wait = async {
        loop {
            match socket.next().await.expect("the socket is open").unwrap() {
                Message::Ping(_) | Message::Pong(_) => {}
                message => return message,
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(5), wait).await.expect("a message within 5 s")
}

/// The next text message.
async fn next_message(socket: &mut Socket) -> Value {
    loop {
        if let Message::Text(text) = next(socket).await {
            return serde_json::from_str(&text).unwrap();
        }
    }
}

/// The next text message that is not a sign of life.
async fn next_text(socket: &mut Socket) -> Value {
    loop {
        let value = next_message(socket).await;
        if value["type"] != "tick" {
            return value;
        }
    }
}

/// The next answer to a message that could not be used; changes may come before it.
pub(super) async fn next_problem(socket: &mut Socket) -> Value {
    loop {
        let message = next_text(socket).await;
        if message["type"] == "problem" {
            return message;
        }
    }
}

pub(super) async fn next_picture(socket: &mut Socket) -> proto::Frame {
    loop {
        if let Message::Binary(bytes) = next(socket).await
            && let Some(What::Frame(frame)) = proto::Viewed::decode(bytes).unwrap().what
        {
            return frame;
        }
    }
}

pub(super) async fn say(socket: &mut Socket, value: Value) {
    socket.send(Message::text(value.to_string())).await.unwrap();
}

#[tokio::test]
async fn a_snapshot_comes_first_and_then_changes_without_a_gap() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut one = open(&daemon).await;
    let snapshot = next_text(&mut one).await;
    assert_eq!(snapshot["type"], "snapshot");
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(snapshot["bench"]["axes"], bench["axes"]);
    let health: Value = daemon.get("/healthz").await.json().await.unwrap();
    assert_eq!(snapshot["boot_id"], health["boot_id"]);

    let mut seq = snapshot["seq"].as_u64().unwrap();
    for latched in [true, false, true] {
        let done = if latched {
            daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap()
        } else {
            daemon.reset_stop().await
        };
        assert_eq!(done.status(), 200);
        loop {
            let change = next_text(&mut one).await;
            assert_eq!(change["seq"].as_u64().unwrap(), seq + 1, "{change}");
            seq += 1;
            if change["type"] == "bench" && change["bench"]["stop"]["latched"] == latched {
                break;
            }
        }
    }
    // Who comes later starts where the others are.
    let mut two = open(&daemon).await;
    assert!(next_text(&mut two).await["seq"].as_u64().unwrap() >= seq);
}

#[tokio::test]
async fn pictures_come_to_who_asks_and_carry_where_they_were_taken() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let mut socket = open(&daemon).await;
    next_text(&mut socket).await;
    fakes.camera.take(3);
    say(&mut socket, json!({ "type": "pictures", "on": true, "reduce": 2 })).await;
    let picture = next_picture(&mut socket).await;
    assert_eq!((picture.seq, picture.width_px, picture.height_px, picture.reduce), (3, 64, 48, 2));
    assert_eq!((picture.focus_mm, picture.e_mm), (Some(0.25), None));
    assert!(picture.settled && picture.preview && picture.exposure_assumed && !picture.simulated);
    assert_eq!((picture.exposure_us / 1000, picture.frames_skipped), (10, 0));
    assert!(picture.age_ms >= 0.0 && picture.age_ms < 5000.0);
    let age = jiff::Timestamp::now().as_microsecond() - picture.captured_unix_us;
    assert!((0..5_000_000).contains(&age), "{age} µs");
    let jpeg = image::load_from_memory(&picture.jpeg).unwrap();
    assert_eq!((jpeg.width(), jpeg.height()), (32, 24));
}

/// By it a page tells a line that is late all the time from the daemon's clock.
#[tokio::test]
async fn the_daemons_clock_is_told_to_who_asks() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut socket = open(&daemon).await;
    let before = jiff::Timestamp::now();
    say(&mut socket, json!({ "type": "clock", "asked_ms": 1234.5 })).await;
    let told = loop {
        let message = next_text(&mut socket).await;
        if message["type"] == "clock" {
            break message;
        }
    };
    assert_eq!(told["asked_ms"], 1234.5);
    let now: jiff::Timestamp = told["now"].as_str().unwrap().parse().unwrap();
    assert!(before <= now && now <= jiff::Timestamp::now(), "{told}");
    // And the clock that nobody sets, of the same moment as a tick's.
    let tick = loop {
        let message = next_message(&mut socket).await;
        if message["type"] == "tick" {
            break message;
        }
    };
    let apart = tick["monotonic_us"].as_u64().unwrap() - told["monotonic_us"].as_u64().unwrap();
    let then: jiff::Timestamp = tick["now"].as_str().unwrap().parse().unwrap();
    assert!((apart as i64 - then.duration_since(now).as_micros() as i64).abs() < 20_000, "{told} {tick}");
}

#[tokio::test]
async fn a_picture_that_comes_again_as_if_it_were_new_is_told() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let mut socket = open(&daemon).await;
    next_text(&mut socket).await;
    let grey = |level: u8| RawImage::from_u8(64, 48, vec![level; 64 * 48]);
    let whole = json!({ "type": "pictures", "on": true, "max_rate_hz": 60 });
    say(&mut socket, whole.clone()).await;
    for (seq, level, alike) in [(1, 120, 1), (2, 120, 2), (3, 120, 3), (4, 121, 1), (5, 0, 1), (6, 0, 1), (7, 120, 1)] {
        fakes.camera.take_image(seq, grey(level));
        let picture = next_picture(&mut socket).await;
        assert_eq!((picture.seq, picture.alike), (seq, alike), "grey {level}");
    }
    // Looked at otherwise it is the same frame, and counts on.
    fakes.camera.take_image(8, grey(120));
    assert_eq!(next_picture(&mut socket).await.alike, 2);
    say(&mut socket, json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "reduce": 2 })).await;
    fakes.camera.take_image(8, grey(120));
    let again = next_picture(&mut socket).await;
    assert_eq!((again.seq, again.alike), (8, 2));
}

#[tokio::test]
async fn a_slow_viewer_is_sent_the_newest_frame_and_holds_nobody_up() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let (mut slow, mut quick) = (open(&daemon).await, open(&daemon).await);
    say(&mut slow, json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "window": 1 })).await;
    say(&mut quick, json!({ "type": "pictures", "on": true, "max_rate_hz": 60 })).await;
    fakes.camera.take(0);
    assert_eq!(next_picture(&mut slow).await.seq, 0);
    assert_eq!(next_picture(&mut quick).await.seq, 0);

    // One of them has seen nothing yet; to the other comes every frame.
    for seq in 1..=100 {
        fakes.camera.take(seq);
        assert_eq!(next_picture(&mut quick).await.seq, seq);
    }

    // Nothing is sent beyond the window; once it opens, the newest frame is, and what was not sent is counted.
    say(&mut slow, json!({ "type": "seen", "seq": 0 })).await;
    let picture = next_picture(&mut slow).await;
    assert_eq!((picture.seq, picture.frames_skipped), (100, 99));

    // Who asks anew is sent nothing more before it has seen what is on the way.
    say(&mut slow, json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "window": 1, "quality": 50 })).await;
    (101..=109).for_each(|seq| fakes.camera.take(seq));
    tokio::time::timeout(Duration::from_millis(200), next_picture(&mut slow)).await.expect_err("nothing is sent");
    say(&mut slow, json!({ "type": "seen", "seq": 100 })).await;
    assert_eq!(next_picture(&mut slow).await.seq, 109);
}

#[tokio::test]
async fn the_camera_is_watched_only_while_somebody_asks_for_pictures_or_readings() {
    let fakes = fakes();
    let camera = fakes.camera.clone();
    let daemon = Daemon::start(fakes.bench).await;
    let mut socket = open(&daemon).await;
    next_text(&mut socket).await;
    assert_eq!(camera.viewers(), 0);
    for (on, viewers) in [(true, 1), (true, 1), (false, 0), (true, 1)] {
        say(&mut socket, json!({ "type": "pictures", "on": on })).await;
        // An answer to something else says that the message before has been taken.
        say(&mut socket, json!({ "type": "nonsense" })).await;
        next_problem(&mut socket).await;
        assert_eq!(camera.viewers(), viewers);
    }
    for (on, viewers) in [(true, 2), (false, 1), (true, 2)] {
        say(&mut socket, json!({ "type": "readings", "on": on })).await;
        // The meter begins and ends in its own time.
        until("the meter follows", async || camera.viewers() == viewers).await;
    }
    socket.close(None).await.unwrap();
    until("a viewer that left watches no more", async || camera.viewers() == 0).await;
}

#[tokio::test]
async fn a_message_that_cannot_be_used_is_answered_and_the_rest_goes_on() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut socket = open(&daemon).await;
    next_text(&mut socket).await;
    let cases = [
        ("{", 400, None),
        ("{\"type\":\"dance\"}", 422, Some("type")),
        ("{\"type\":\"pictures\",\"on\":true,\"reduce\":3}", 422, Some("reduce")),
        ("{\"type\":\"pictures\",\"on\":true,\"max_rate_hz\":1000}", 422, Some("max_rate_hz")),
        ("{\"type\":\"pictures\",\"on\":true,\"window\":99}", 422, Some("window")),
        ("{\"type\":\"readings\",\"on\":true,\"max_rate_hz\":1000}", 422, Some("max_rate_hz")),
        ("{\"type\":\"readings\"}", 422, Some("on")),
    ];
    for (text, status, field) in cases {
        socket.send(Message::text(text)).await.unwrap();
        let answer = next_problem(&mut socket).await;
        assert_eq!(answer["problem"]["status"], status, "{text}");
        if let Some(field) = field.filter(|field| *field != "type") {
            assert_eq!(answer["problem"]["field"], field);
        }
    }
}

#[tokio::test]
async fn a_page_of_another_origin_gets_no_socket() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut request = format!("ws://{}/api/v1/ws", daemon.address).into_client_request().unwrap();
    request.headers_mut().insert("origin", "http://evil.example".parse().unwrap());
    match connect_async(request).await {
        Err(Error::Http(response)) => assert_eq!(response.status(), 403),
        other => panic!("{other:?}"),
    }
    let mut request = format!("ws://{}/api/v1/ws", daemon.address).into_client_request().unwrap();
    request.headers_mut().insert("origin", format!("http://{}", daemon.address).parse().unwrap());
    connect_async(request).await.unwrap();
    problem(daemon.get("/api/v1/ws").await, 426, "upgrade-required").await;
}

#[tokio::test]
async fn closing_tells_every_viewer_and_comes_to_an_end() {
    let daemon = Daemon::start(fakes().bench).await;
    let (mut one, mut two) = (open(&daemon).await, open(&daemon).await);
    next_text(&mut one).await;
    next_text(&mut two).await;
    tokio::time::timeout(Duration::from_secs(3), daemon.api.close()).await.expect("closing is bounded");
    for socket in [&mut one, &mut two] {
        // The axes are stopped before, of which viewers are told.
        let code = loop {
            match next(socket).await {
                Message::Text(_) => {}
                Message::Close(Some(frame)) => break u16::from(frame.code),
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(code, 1001);
    }
}

async fn open_after(daemon: &Daemon, after: u64, boot_id: &str) -> Socket {
    let address = format!("ws://{}/api/v1/ws?after={after}&boot_id={boot_id}", daemon.address);
    connect_async(address).await.unwrap().0
}

#[tokio::test]
async fn a_viewer_that_comes_back_goes_on_where_it_was_or_is_told_of_the_gap() {
    let daemon = Daemon::start(fakes().bench).await;
    let mut first = open(&daemon).await;
    let snapshot = next_text(&mut first).await;
    let (seq, boot_id) = (snapshot["seq"].as_u64().unwrap(), snapshot["boot_id"].as_str().unwrap().to_owned());
    let toggle = async || {
        daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
        daemon.reset_stop().await;
    };
    toggle().await;
    let mut back = open_after(&daemon, seq, &boot_id).await;
    let change = next_text(&mut back).await;
    assert_eq!((change["type"].as_str(), change["seq"].as_u64()), (Some("bench"), Some(seq + 1)));

    // Another run's numbers mean nothing here.
    let other = uuid::Uuid::nil().to_string();
    let mut stranger = open_after(&daemon, seq, &other).await;
    let gap = next_text(&mut stranger).await;
    assert_eq!((gap["type"].as_str(), gap["after_boot_id"].as_str()), (Some("gap"), Some(other.as_str())));
    assert_eq!(next_text(&mut stranger).await["type"], "snapshot");

    // More changes than are kept.
    for _ in 0..260 {
        toggle().await;
    }
    let mut late = open_after(&daemon, seq, &boot_id).await;
    let gap = next_text(&mut late).await;
    assert_eq!((gap["type"].as_str(), gap["after"].as_u64()), (Some("gap"), Some(seq)));
    assert_eq!(next_text(&mut late).await["type"], "snapshot");
    // A number that has not been given yet.
    let mut ahead = open_after(&daemon, u64::MAX, &boot_id).await;
    assert_eq!(next_text(&mut ahead).await["type"], "gap");
}

#[tokio::test]
async fn a_connection_holds_the_lease() {
    let daemon = Daemon::start(fakes().bench).await;
    let key = daemon.lease().await.to_owned();
    let mut socket = open(&daemon).await;
    next_text(&mut socket).await;
    say(&mut socket, json!({ "type": "hold", "lease": "guess" })).await;
    assert_eq!(next_problem(&mut socket).await["problem"]["status"], 412);
    say(&mut socket, json!({ "type": "hold", "lease": key })).await;
    let held = |lease: &Value| lease["lease"]["expires_at"].is_null();
    daemon.until("/api/v1/lease", "held", held).await;
    drop(socket);
    let lease = daemon.until("/api/v1/lease", "let go", |lease| !held(lease)).await;
    let expires: jiff::Timestamp = lease["lease"]["expires_at"].as_str().unwrap().parse().unwrap();
    let left = expires.duration_since(jiff::Timestamp::now()).as_secs_f64();
    assert!((5.0..=10.0).contains(&left), "{left} s of grace");
}
