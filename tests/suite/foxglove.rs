//! The live bridge for Foxglove as a viewer sees it, and the layout against what bridge and recordings have.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use plenalign::api::foxglove::TOPICS;
use plenalign::api::proto::{self, viewed::What};
use plenalign::record::foxglove::{CompressedImage, ImageAnnotations};
use plenalign::record::messages::{Measurement, MeterReading};
use plenalign::record::{DESCRIPTIONS, Topic};
use prost::Message as _;
use serde_json::{Value, json};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::Request;
use tokio_tungstenite::tungstenite::{Error, Message};

use super::bench::QUICK_AXES;
use super::limits::exchange;
use super::program::{Program, plenalign, serve};

const PATIENCE: Duration = Duration::from_secs(60);

fn daemon(state: &Path, bridge: &str) -> Program {
    let text = format!(
        "[foxglove]\n{bridge}\n[sensor]\nwidth_px = 560\nheight_px = 560\n[bench.simulation]\nrays = 16\npreview_rate_hz = 10\n{QUICK_AXES}"
    );
    std::fs::write(state.join("bench.toml"), text).unwrap();
    Program::start(serve(state, &[]))
}

fn request(url: &str, protocol: Option<&str>, origin: Option<&str>) -> Request<()> {
    let mut request = url.into_client_request().unwrap();
    for (name, value) in [("sec-websocket-protocol", protocol), ("origin", origin)] {
        if let Some(value) = value {
            request.headers_mut().insert(name, value.parse().unwrap());
        }
    }
    request
}

/// The daemon's metrics, as it writes them.
async fn metrics(program: &Program) -> String {
    let asked = "GET /metrics HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n\r\n";
    exchange(program.address().parse().unwrap(), asked).await
}

/// How many pictures the daemon has made.
async fn pictures_made(program: &Program) -> usize {
    let metrics = metrics(program).await;
    let count = metrics.lines().find_map(|line| line.strip_prefix("plenalign_picture_seconds_count "));
    count.map_or(0, |count| count.trim().parse().unwrap())
}

/// A recorded message's fields by name: the message that each is of, where it is of one.
type Fields = BTreeMap<String, Option<String>>;

fn described() -> BTreeMap<String, Fields> {
    let files = prost_types::FileDescriptorSet::decode(DESCRIPTIONS).unwrap();
    let mut messages = BTreeMap::new();
    for file in &files.file {
        for message in &file.message_type {
            let field = |field: &prost_types::FieldDescriptorProto| {
                let of = field.type_name.as_ref().map(|name| name.trim_start_matches('.').to_owned());
                (field.name().to_owned(), of)
            };
            let name = format!("{}.{}", file.package(), message.name());
            messages.insert(name, message.field.iter().map(field).collect());
        }
    }
    messages
}

#[test]
fn every_topic_has_its_description() {
    let described = described();
    for topic in Topic::ALL {
        assert!(described.contains_key(topic.schema), "{topic:?}");
    }
    assert!(described.contains_key("google.protobuf.Timestamp"));
}

#[tokio::test]
async fn a_viewer_sees_pictures_and_spacing_and_commands_nothing() {
    let state = tempfile::tempdir().unwrap();
    let program = daemon(state.path(), "listen = \"127.0.0.1:0\"\norigins = [\"https://app.foxglove.dev\"]");
    let url = program.said["foxglove"].as_str().expect("the bridge says where it listens").to_owned();
    // A white frame is what the spacing is measured by.
    let aligning = {
        let (state, daemon) = (state.path().to_owned(), program.url().to_owned());
        tokio::task::spawn_blocking(move || {
            plenalign(&state).args(["align", "--json", "--server", &daemon]).output().unwrap()
        })
    };
    for protocol in ["foxglove.sdk.v1", "foxglove.websocket.v1"] {
        let asked = request(&url, Some(protocol), Some("https://app.foxglove.dev"));
        let (mut socket, answer) = connect_async(asked).await.unwrap();
        assert_eq!(answer.headers()["sec-websocket-protocol"], protocol);
        let mut texts = Vec::new();
        while texts.len() < 2 {
            let message = tokio::time::timeout(PATIENCE, socket.next()).await.unwrap().unwrap().unwrap();
            texts.push(serde_json::from_str::<Value>(message.to_text().unwrap()).unwrap());
        }
        assert_eq!((&texts[0]["op"], &texts[1]["op"]), (&json!("serverInfo"), &json!("advertise")));
        assert!(texts[0]["name"].as_str().unwrap().contains("SIMULATED") && texts[0]["capabilities"] == json!([]));
        let channels = texts[1]["channels"].as_array().unwrap();
        assert_eq!(channels.len(), TOPICS.len());
        let subscriptions: Vec<Value> = channels
            .iter()
            .enumerate()
            .map(|(index, channel)| json!({ "id": 100 + index, "channelId": channel["id"] }))
            .collect();
        let ask = json!({ "op": "subscribe", "subscriptions": subscriptions }).to_string();
        socket.send(Message::text(ask)).await.unwrap();
        // What would command something is refused, and so is nonsense; the session goes on.
        for wrong in [json!({ "op": "advertise", "channels": [] }).to_string(), "nonsense".to_owned()] {
            socket.send(Message::text(wrong)).await.unwrap();
        }
        let (mut seen, mut warnings) = (BTreeSet::new(), 0);
        while seen.len() < TOPICS.len() || warnings < 2 {
            match tokio::time::timeout(PATIENCE, socket.next()).await.expect("news in time").unwrap().unwrap() {
                Message::Text(text) => {
                    let status: Value = serde_json::from_str(&text).unwrap();
                    assert_eq!((&status["op"], &status["level"]), (&json!("status"), &json!(1)), "{status}");
                    warnings += 1;
                }
                Message::Binary(data) => {
                    assert_eq!(data[0], 1);
                    let id = u32::from_le_bytes(data[1..5].try_into().unwrap());
                    let at = u64::from_le_bytes(data[5..13].try_into().unwrap());
                    assert!(at > 1_700_000_000_000_000_000, "{at}");
                    let topic = TOPICS[id as usize - 100];
                    if topic == Topic::PICTURE {
                        let picture = CompressedImage::decode(&data[13..]).unwrap();
                        assert!(picture.format == "jpeg" && picture.data.starts_with(&[0xff, 0xd8]));
                    } else if topic == Topic::MEASUREMENT {
                        let spacing = Measurement::decode(&data[13..]).unwrap().spacing.unwrap();
                        assert!((5.0..60.0).contains(&spacing.spacing_px), "{spacing:?}");
                    } else if topic == Topic::READING {
                        let reading = MeterReading::decode(&data[13..]).unwrap();
                        assert!(
                            reading.timestamp.is_some() && reading.exposure_us > 0 && reading.simulated,
                            "{reading:?}"
                        );
                        if reading.state != "measured" {
                            continue;
                        }
                        let px = reading.spacing.unwrap().spacing_px;
                        assert!((5.0..60.0).contains(&px), "{px} px");
                    } else if topic == Topic::ANNOTATIONS {
                        let drawn = ImageAnnotations::decode(&data[13..]).unwrap();
                        assert!(drawn.texts[0].text.contains("wanted"), "{drawn:?}");
                    }
                    seen.insert(topic.name);
                }
                _ => {}
            }
        }
        socket.close(None).await.unwrap();
    }
    for (protocol, origin, status) in
        [(Some("foxglove.sdk.v1"), Some("https://evil.example"), 403), (Some("other.v1"), None, 400), (None, None, 400)]
    {
        match connect_async(request(&url, protocol, origin)).await {
            Err(Error::Http(answer)) => assert_eq!(answer.status().as_u16(), status, "{protocol:?} {origin:?}"),
            other => panic!("{other:?}"),
        }
    }
    // What the meter read for them is counted, part by part.
    let metrics = metrics(&program).await;
    for part in ["thread", "search", "exposure", "grid", "clusters", "pairs", "equations", "noise"] {
        let count = format!("plenalign_reading_part_seconds_count{{part=\"{part}\"}}");
        assert!(metrics.contains(&count), "{part} is not in {metrics}");
    }
    // A viewer that takes nothing does not keep the daemon from ending.
    let _idle = connect_async(request(&url, Some("foxglove.sdk.v1"), None)).await.unwrap();
    let aligned = aligning.await.unwrap();
    assert!(aligned.status.success(), "{}", String::from_utf8_lossy(&aligned.stderr));
    // Whoever reads the meter has whole measurements besides, and no picture is made for that.
    let before = pictures_made(&program).await;
    let (mut meter, _) = connect_async(format!("ws://{}/api/v1/ws", program.address())).await.unwrap();
    let ask = json!({ "type": "readings", "on": true, "whole": true }).to_string();
    meter.send(Message::text(ask)).await.unwrap();
    let (mut measured, mut read) = (false, false);
    while !(measured && read) {
        match tokio::time::timeout(PATIENCE, meter.next()).await.expect("news in time").unwrap().unwrap() {
            Message::Text(text) => measured |= text.contains("\"type\":\"measurement\""),
            Message::Binary(_) => read = true,
            _ => {}
        }
    }
    assert_eq!(pictures_made(&program).await, before);
    program.terminate();
    let (status, _, log) = program.end(Duration::from_secs(6));
    assert!(status.success(), "{log}");
}

#[tokio::test]
async fn a_picture_that_a_page_has_too_is_made_once() {
    const PICTURES: usize = 12;
    let state = tempfile::tempdir().unwrap();
    let program = daemon(state.path(), "listen = \"127.0.0.1:0\"");
    let bridge = program.said["foxglove"].as_str().expect("the bridge says where it listens");
    let (mut bridged, _) = connect_async(request(bridge, Some("foxglove.sdk.v1"), None)).await.unwrap();
    let (mut page, _) = connect_async(format!("ws://{}/api/v1/ws", program.address())).await.unwrap();
    let channel = 1 + TOPICS.iter().position(|&topic| topic == Topic::PICTURE).unwrap();
    let subscribe = json!({ "op": "subscribe", "subscriptions": [{ "id": 1, "channelId": channel }] });
    bridged.send(Message::text(subscribe.to_string())).await.unwrap();
    page.send(Message::text(json!({ "type": "pictures", "on": true }).to_string())).await.unwrap();
    // When each frame was taken, µs.
    let to_bridge = async {
        let mut taken = BTreeSet::new();
        while taken.len() < PICTURES {
            if let Message::Binary(data) = bridged.next().await.unwrap().unwrap() {
                let at = CompressedImage::decode(&data[13..]).unwrap().timestamp.unwrap();
                taken.insert(at.seconds * 1_000_000 + i64::from(at.nanos) / 1000);
            }
        }
        taken
    };
    let to_page = async {
        let mut taken = BTreeSet::new();
        while taken.len() < PICTURES {
            if let Message::Binary(data) = page.next().await.unwrap().unwrap()
                && let Some(What::Frame(frame)) = proto::Viewed::decode(data).unwrap().what
            {
                taken.insert(frame.captured_unix_us);
            }
        }
        taken
    };
    let (to_bridge, to_page) =
        tokio::time::timeout(PATIENCE, async { tokio::join!(to_bridge, to_page) }).await.expect("pictures in time");
    drop((bridged, page));
    let (frames, both) = (to_bridge.union(&to_page).count(), to_bridge.intersection(&to_page).count());
    assert!(both >= PICTURES / 2, "{both} frames went to both");
    // Those that were on their way at the end are made, too; and one after which the other's next was made is made twice.
    let made = pictures_made(&program).await;
    assert!(made <= frames + PICTURES / 3, "{made} pictures of {frames} frames");
}

#[test]
fn there_is_no_bridge_by_default_and_none_beyond_loopback() {
    let state = tempfile::tempdir().unwrap();
    let program = daemon(state.path(), "");
    assert_eq!(program.said.get("foxglove"), None);
    program.kill();
    for (listen, word) in [("0.0.0.0:8765", "beyond loopback"), ("8765", "no address")] {
        let mut command = serve(state.path(), &[]);
        command.args(["--set", &format!("foxglove.listen={listen}")]);
        let refused = command.output().unwrap();
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.contains("foxglove.listen") && said.contains(word), "{said}");
    }
}

/// The panels that a place in a layout leads to.
fn panels(place: &Value, found: &mut Vec<String>) {
    match place {
        Value::String(id) => found.push(id.clone()),
        Value::Object(split) => {
            assert!(["row", "column"].contains(&split["direction"].as_str().unwrap()), "{split:?}");
            assert!((1.0..100.0).contains(&split["splitPercentage"].as_f64().unwrap()), "{split:?}");
            panels(&split["first"], found);
            panels(&split["second"], found);
        }
        other => panic!("{other} is no place in a layout"),
    }
}

/// The layout as the application documents it, against the topics that bridge and recordings have. Whether the
/// application shows it well has to be seen by eye.
#[test]
fn the_layout_shows_what_there_is() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/foxglove-layout.json");
    let layout: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let keys: BTreeSet<&str> = layout.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(keys, ["configById", "globalVariables", "layout", "playbackConfig", "userNodes"].into());
    let configs = layout["configById"].as_object().unwrap();
    let mut placed = Vec::new();
    panels(&layout["layout"], &mut placed);
    for config in configs.values() {
        for tab in config["tabs"].as_array().into_iter().flatten() {
            assert!(tab["title"].is_string());
            panels(&tab["layout"], &mut placed);
        }
    }
    placed.sort();
    let known: Vec<String> = configs.keys().cloned().collect();
    assert_eq!(placed, known, "every panel is placed once, and has its configuration");

    let topic = |name: &Value| {
        let name = name.as_str().unwrap();
        plenalign::record::topic(name).unwrap_or_else(|| panic!("there is no topic {name}"))
    };
    let described = described();
    let mut shown = BTreeSet::new();
    for (id, config) in configs {
        match id.split_once('!').unwrap().0 {
            "Image" => {
                let picture = topic(&config["imageMode"]["imageTopic"]);
                assert!(["foxglove.RawImage", "foxglove.CompressedImage"].contains(&picture.schema), "{id}");
                shown.insert(picture.name);
                for (name, settings) in config["imageMode"]["annotations"].as_object().into_iter().flatten() {
                    let drawn = topic(&json!(name));
                    assert_eq!((drawn.schema, &settings["visible"]), ("foxglove.ImageAnnotations", &json!(true)));
                    shown.insert(drawn.name);
                }
            }
            "3D" => {
                assert_eq!(config["followTf"], "bench");
                // Transforms need no topic to be named.
                shown.insert(Topic::TRANSFORM.name);
                for name in config["topics"].as_object().unwrap().keys() {
                    assert_eq!(topic(&json!(name)).schema, "foxglove.PoseInFrame");
                    shown.insert(topic(&json!(name)).name);
                }
            }
            "Plot" => {
                for path in config["paths"].as_array().unwrap() {
                    let (name, fields) = path["value"].as_str().unwrap().split_once('.').unwrap();
                    let topic = topic(&json!(name));
                    let mut of = Some(topic.schema.to_owned());
                    for field in fields.split('.') {
                        let message = of.unwrap_or_else(|| panic!("{path} goes too far"));
                        of = described[&message]
                            .get(field)
                            .unwrap_or_else(|| panic!("{message} has no {field}"))
                            .clone();
                    }
                    assert!(of.is_none(), "{path} ends at a message");
                    shown.insert(topic.name);
                }
            }
            "RosOut" => {
                assert_eq!(topic(&config["topicToRender"]).schema, "foxglove.Log");
                shown.insert(Topic::LOG.name);
            }
            "Tab" => {}
            other => panic!("{other} is no kind of panel that is known here"),
        }
    }
    for topic in TOPICS {
        assert!(shown.contains(topic.name), "{} is not shown anywhere", topic.name);
    }
}
