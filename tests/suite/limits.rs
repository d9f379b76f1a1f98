//! Connections: how many, how slow, and that a stop gets through when there are too many.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use plenalign::access::{Gate, GateSettings, LogAudit, TokenStore};
use plenalign::api::server::ServerSettings;
use plenalign::config::Config;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use super::daemon::Daemon;
use super::fakes::fakes;
use super::until::until;

async fn daemon(settings: ServerSettings) -> Daemon {
    let gate = Gate::new(GateSettings::default(), TokenStore::in_memory(), Box::new(LogAudit));
    Daemon::start_behind(Config::default(), fakes().bench, gate, settings).await
}

fn few() -> ServerSettings {
    ServerSettings { connections: 4, connections_per_address: 4, ..ServerSettings::default() }
}

/// A connection on which a request has begun and does not go on.
async fn half_a_request(address: SocketAddr) -> TcpStream {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\n").await.unwrap();
    stream
}

/// What comes back for a request on a connection of its own.
pub(crate) async fn exchange(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let _ = stream.write_all(request.as_bytes()).await;
    let mut answer = Vec::new();
    let _ = tokio::time::timeout(Duration::from_secs(5), stream.read_to_end(&mut answer)).await;
    String::from_utf8_lossy(&answer).into_owned()
}

pub(crate) const STOP: &str = "POST /api/v1/stop HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 0\r\n\r\n";
const HEALTH: &str = "GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n\r\n";

#[tokio::test]
async fn a_stop_gets_through_when_every_connection_is_taken_and_nothing_else_does() {
    let daemon = daemon(few()).await;
    let mut held = Vec::new();
    for _ in 0..4 {
        held.push(half_a_request(daemon.address).await);
    }
    let refused = exchange(daemon.address, HEALTH).await;
    assert!(refused.starts_with("HTTP/1.1 503") && refused.contains("urn:plenalign:problem:crowded"), "{refused}");
    assert!(refused.contains("retry-after: ") && refused.contains("connection: close"), "{refused}");
    let stopped = exchange(daemon.address, STOP).await;
    assert!(stopped.starts_with("HTTP/1.1 200") && stopped.contains("\"focus\":\"confirmed\""), "{stopped}");

    // The reserve being full, too, a stop takes the place of who fills it.
    for _ in 0..300 {
        held.push(half_a_request(daemon.address).await);
    }
    let from = Instant::now();
    let stopped = exchange(daemon.address, STOP).await;
    assert!(stopped.starts_with("HTTP/1.1 200"), "{stopped}");
    assert!(from.elapsed() < Duration::from_secs(1), "the stop took {:?}", from.elapsed());

    drop(held);
    until("a place is free", async || exchange(daemon.address, HEALTH).await.starts_with("HTTP/1.1 200")).await;
}

#[tokio::test]
async fn a_websocket_keeps_its_place_for_as_long_as_it_lasts() {
    let daemon = daemon(ServerSettings { connections: 1, ..few() }).await;
    let url = format!("ws://{}/api/v1/ws", daemon.address);
    let (socket, _) = tokio_tungstenite::connect_async(&url).await.unwrap();
    assert!(exchange(daemon.address, HEALTH).await.starts_with("HTTP/1.1 503"));
    drop(socket);
    until("the place is free", async || exchange(daemon.address, HEALTH).await.starts_with("HTTP/1.1 200")).await;
}

#[tokio::test]
async fn a_head_that_trickles_in_and_a_connection_that_idles_are_cut_off() {
    let daemon = daemon(ServerSettings { idle_timeout: Duration::from_millis(300), ..few() }).await;
    let mut idle = TcpStream::connect(daemon.address).await.unwrap();
    let mut slow = TcpStream::connect(daemon.address).await.unwrap();
    let trickle = async {
        let mut head = b"GET /healthz HTTP/1.1\r\nx: ".iter().chain(std::iter::repeat(&b'x'));
        let cut = until("the slow one is cut off", async || slow.write_all(&[*head.next().unwrap()]).await.is_err());
        let cut = tokio::time::timeout(Duration::from_secs(5), cut).await;
        assert!(cut.is_ok(), "a slow head is waited for without end");
    };
    let ends = async {
        let mut nothing = [0; 1];
        let read = tokio::time::timeout(Duration::from_secs(5), idle.read(&mut nothing)).await;
        assert!(matches!(read, Ok(Ok(0) | Err(_))), "an idle connection is kept: {read:?}");
    };
    tokio::join!(trickle, ends);
}

#[tokio::test]
async fn too_many_or_too_large_headers_are_refused() {
    let daemon = daemon(few()).await;
    let with =
        |headers: String| format!("GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n{headers}\r\n");
    let many = |count: usize| (0..count).map(|n| format!("x-{n}: 1\r\n")).collect::<String>();
    let large = |bytes: usize| format!("x: {}\r\n", "y".repeat(bytes));
    for headers in [many(100), large(20_000)] {
        let answer = exchange(daemon.address, &with(headers)).await;
        assert!(answer.starts_with("HTTP/1.1 431"), "{answer}");
        assert!(
            answer.contains("content-type: application/problem+json") && answer.contains("head-too-large"),
            "{answer}"
        );
    }
    // Beyond what is read at all there is the status alone.
    for headers in [many(300), large(100_000)] {
        let answer = exchange(daemon.address, &with(headers)).await;
        assert!(answer.starts_with("HTTP/1.1 431"), "{answer}");
    }
    let path = format!("GET /healthz?{} HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n", "x".repeat(20_000));
    assert!(exchange(daemon.address, &path).await.contains("head-too-large"));
    assert!(exchange(daemon.address, &with(String::new())).await.starts_with("HTTP/1.1 200"));
}

#[tokio::test]
async fn a_method_counts_as_part_of_the_head() {
    let daemon = daemon(few()).await;
    let asked = |method: String| format!("{method} /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n\r\n");
    let answer = exchange(daemon.address, &asked("X".repeat(20_000))).await;
    assert!(answer.starts_with("HTTP/1.1 431") && answer.contains("head-too-large"), "{answer}");
    let answer = exchange(daemon.address, &asked("X".repeat(1000))).await;
    assert!(answer.starts_with("HTTP/1.1 405"), "{answer}");
}

#[tokio::test]
async fn the_end_is_bounded_whatever_hangs() {
    let daemon = daemon(few()).await;
    let _held = half_a_request(daemon.address).await;
    let (_socket, _) = tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", daemon.address)).await.unwrap();
    let from = Instant::now();
    daemon.api.close().await;
    until("the port is closed", async || TcpStream::connect(daemon.address).await.is_err()).await;
    assert!(from.elapsed() < Duration::from_secs(4), "the port was open for {:?}", from.elapsed());
}
