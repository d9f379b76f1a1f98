//! The program while it is flooded, in its own process and with few descriptors: a stop gets through, and what is held
//! open for nothing is closed.

use std::net::SocketAddr;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use nix::sys::resource::{Resource, getrlimit, setrlimit};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

use super::limits::{STOP, exchange};
use super::program::{Program, serve};

/// What every test here begins with: the other listeners beside the main one.
const CONFIG: &str = "[bench.simulation]\nrays = 4\n[alpaca]\nlisten = \"127.0.0.1:0\"\ndiscovery = false\n\
                      [foxglove]\nlisten = \"127.0.0.1:0\"\n";
const HALT: &str = "PUT /api/v1/focuser/0/halt HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 0\r\n\r\n";
const HEALTH: &str = "GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n\r\n";
const KEPT: &str = "GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\n\r\n";
/// A stop that is starved takes half a minute and more.
const STARVED: Duration = Duration::from_secs(3);

/// A daemon with these descriptors, as `ulimit` has them.
fn limited(state: &Path, ulimit: &str, server: &str) -> Command {
    std::fs::write(state.join("bench.toml"), format!("{CONFIG}[server]\n{server}\n")).unwrap();
    let daemon = serve(state, &[]);
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit {ulimit} && exec \"$0\" \"$@\"")]);
    command.arg(daemon.get_program()).args(daemon.get_args());
    for (name, value) in daemon.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    command
}

struct Addresses {
    main: SocketAddr,
    alpaca: SocketAddr,
    foxglove: SocketAddr,
}

fn addresses(program: &Program) -> Addresses {
    let said = |key: &str| program.said[key].as_str().unwrap().trim_start_matches("ws://").parse().unwrap();
    Addresses { main: program.address().parse().unwrap(), alpaca: said("alpaca"), foxglove: said("foxglove") }
}

/// Connections that say nothing. Those that the daemon closes at once count, too.
async fn idle(address: SocketAddr, count: usize) -> Vec<TcpStream> {
    let (_, hard) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
    setrlimit(Resource::RLIMIT_NOFILE, hard, hard).unwrap();
    let mut held = Vec::new();
    for _ in 0..count {
        // What the daemon does not accept waits in the system's queue until that is full.
        let connected = tokio::time::timeout(STARVED, TcpStream::connect(address)).await;
        held.push(connected.unwrap_or_else(|_| panic!("{address} accepts nothing after {}", held.len())).unwrap());
    }
    held
}

async fn stops(address: SocketAddr, request: &str) {
    let from = Instant::now();
    let answer = tokio::time::timeout(STARVED, exchange(address, request)).await.unwrap_or_default();
    assert!(answer.starts_with("HTTP/1.1 200"), "after {:?}: {answer:?}", from.elapsed());
}

async fn stops_under_a_flood(ulimit: &str) {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(limited(state.path(), ulimit, ""));
    let Addresses { main, alpaca, foxglove } = addresses(&program);
    let mut held = idle(foxglove, 1000).await;
    stops(main, STOP).await;
    held.extend(idle(alpaca, 1000).await);
    stops(main, STOP).await;
    stops(alpaca, HALT).await;
    held.extend(idle(main, 1000).await);
    stops(main, STOP).await;
    stops(alpaca, HALT).await;
    let open = std::fs::read_dir(format!("/proc/{}/fd", program.id())).unwrap().count();
    assert!(
        open < 64 + 128 + 96,
        "the daemon has {open} files open: more than one address's share, reserve and its own"
    );
    drop(held);
    program.terminate();
    let (status, _, log) = program.end(Duration::from_secs(6));
    assert!(status.success(), "{log}");
    assert!(!log.contains("no connection can be accepted"), "it ran out of descriptors: {log}");
}

#[tokio::test]
async fn a_stop_gets_through_while_thousands_of_connections_idle_at_every_listener() {
    stops_under_a_flood("-Sn 1024").await;
}

#[tokio::test]
async fn a_stop_gets_through_with_as_few_descriptors_as_the_connections_need() {
    stops_under_a_flood("-n 736").await;
}

#[tokio::test]
async fn connections_that_say_nothing_are_closed_at_every_listener() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(limited(state.path(), "-n 1024", "idle_timeout_s = 1.0"));
    let Addresses { main, alpaca, foxglove } = addresses(&program);
    for address in [main, alpaca, foxglove] {
        for mut stream in idle(address, 200).await {
            let read = tokio::time::timeout(Duration::from_secs(10), stream.read(&mut [0])).await;
            assert!(matches!(read, Ok(Ok(0) | Err(_))), "{address} keeps an idle connection: {read:?}");
        }
    }
}

#[tokio::test]
async fn one_address_has_its_share_of_the_places_whichever_listeners_it_takes_them_at() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(limited(state.path(), "-n 1024", "max_connections_per_address = 8"));
    let Addresses { main, alpaca, foxglove } = addresses(&program);
    let mut held = Vec::new();
    for address in [foxglove, alpaca] {
        held.extend(idle(address, 3).await);
        // It is accepted after those before it, so that its answer says that all have their places.
        let mut last = TcpStream::connect(address).await.unwrap();
        last.write_all(KEPT.as_bytes()).await.unwrap();
        let mut answer = [0; 1024];
        let length = last.read(&mut answer).await.unwrap();
        let answer = String::from_utf8_lossy(&answer[..length]);
        assert!(answer.starts_with("HTTP/1.1 ") && !answer.starts_with("HTTP/1.1 503"), "{address}: {answer}");
        held.push(last);
    }
    for address in [main, alpaca, foxglove] {
        let answer = exchange(address, HEALTH).await;
        assert!(answer.starts_with("HTTP/1.1 503") && answer.contains("crowded"), "{address}: {answer}");
    }
}

#[tokio::test]
async fn the_soft_limit_on_descriptors_is_raised_to_the_hard_one() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(limited(state.path(), "-Sn 300", ""));
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", program.id())).unwrap();
    let files = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    let words: Vec<&str> = files.split_whitespace().collect();
    assert_eq!(words[3], words[4], "soft and hard: {files}");
}

#[tokio::test]
async fn too_few_descriptors_for_the_connections_are_said_and_a_stop_gets_through_all_the_same() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(limited(state.path(), "-n 300", ""));
    let Addresses { main, foxglove, .. } = addresses(&program);
    let mut held = idle(foxglove, 500).await;
    held.extend(idle(main, 500).await);
    stops(main, STOP).await;
    program.terminate();
    let (status, _, log) = program.end(Duration::from_secs(6));
    assert!(status.success(), "{log}");
    for words in ["server.max_connections = 256", "736", "300", "38 connections", "ulimit -n", "LimitNOFILE"] {
        assert!(log.contains(words), "{words}: {log}");
    }
    assert!(!log.contains("no connection can be accepted"), "{log}");
}

#[test]
fn too_few_descriptors_for_any_connection_keep_it_from_starting() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::spawn(limited(state.path(), "-n 128", ""));
    let (status, _, said) = program.end(Duration::from_secs(20));
    assert!(!status.success());
    for words in ["128 open files", "226", "ulimit -n", "LimitNOFILE"] {
        assert!(said.contains(words), "{words}: {said}");
    }
}
