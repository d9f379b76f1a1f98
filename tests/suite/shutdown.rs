//! The end of the daemon: within 5 s whoever is connected and whatever moves, with the history written to its end.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use futures_util::{SinkExt as _, StreamExt as _};
use plenalign::api::error::LEASE_HEADER;
use plenalign::store::{JobFilter, Store, read};
use reqwest::{Certificate, Client, Method};
use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, ServerName};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream};
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

use super::program::{Program, plenalign, serve};
use super::until::{until, when};

/// From the signal to the end of the process.
const PROMISED: Duration = Duration::from_secs(5);

/// A daemon that speaks TLS, with a simulated bench whose pictures are small.
struct Daemon {
    program: Program,
    client: Client,
    tls: TlsConnector,
    key: String,
}

type Tls = TlsStream<TcpStream>;

impl Daemon {
    async fn start(state: &Path) -> Self {
        plenalign::api::server::use_ring();
        let made = plenalign(state).args(["tls", "init", "--json"]).output().unwrap();
        let made: Value = serde_json::from_slice(&made.stdout).unwrap();
        let config = format!(
            "[sensor]\nwidth_px = 560\nheight_px = 560\n[bench.simulation]\nrays = 4\npreview_rate_hz = 20\n\
             [server.tls]\ncertificate = {}\nkey = {}\n",
            made["certificate"], made["key"]
        );
        std::fs::write(state.join("bench.toml"), config).unwrap();
        let program = Program::start(serve(state, &[]));
        let ca = std::fs::read(made["ca"].as_str().unwrap()).unwrap();
        let mut roots = rustls::RootCertStore::empty();
        roots.add(CertificateDer::from_pem_slice(&ca).unwrap()).unwrap();
        let tls = rustls::ClientConfig::builder().with_root_certificates(roots).with_no_client_auth();
        let client =
            Client::builder().no_proxy().tls_certs_only([Certificate::from_pem(&ca).unwrap()]).build().unwrap();
        let mut daemon = Self { program, client, tls: TlsConnector::from(Arc::new(tls)), key: String::new() };
        let lease = daemon.command(Method::POST, "/api/v1/lease", json!({ "owner": "a test", "ttl_s": 60 })).await;
        lease["key"].as_str().unwrap().clone_into(&mut daemon.key);
        daemon
    }

    async fn command(&self, method: Method, path: &str, body: Value) -> Value {
        let request = self.client.request(method, format!("{}{path}", self.program.url()));
        let response = request.header(LEASE_HEADER, &self.key).json(&body).send().await.unwrap();
        let status = response.status();
        let said: Value = response.json().await.unwrap();
        assert!(status.is_success(), "{path}: {said}");
        said
    }

    async fn bench(&self) -> Value {
        self.client.get(format!("{}/api/v1/bench", self.program.url())).send().await.unwrap().json().await.unwrap()
    }

    /// Waits until the focus axis is as wanted.
    async fn focus(&self, what: &str, wanted: impl Fn(&Value) -> bool) {
        until(what, async || when(self.bench().await["axes"][0].take(), &wanted)).await;
    }

    /// A connection as the system makes it, which takes little at once.
    async fn tcp(&self) -> TcpStream {
        let socket = TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        socket.connect(([127, 0, 0, 1], self.program.port()).into()).await.unwrap()
    }

    async fn connect(&self) -> Tls {
        self.tls.connect(ServerName::try_from("127.0.0.1").unwrap(), self.tcp().await).await.unwrap()
    }

    /// A request, or the beginning of one, on a connection of its own.
    async fn say(&self, request: &str) -> Tls {
        let mut stream = self.connect().await;
        stream.write_all(request.as_bytes()).await.unwrap();
        stream.flush().await.unwrap();
        stream
    }

    async fn viewer(&self, says: &[Value]) -> WebSocketStream<Tls> {
        let url = format!("wss://{}/api/v1/ws", self.program.address());
        let (mut socket, _) = tokio_tungstenite::client_async(url, self.connect().await).await.unwrap();
        for say in says {
            socket.send(Message::text(say.to_string())).await.unwrap();
        }
        socket
    }
}

/// What is held open while the daemon ends.
struct Crowd {
    /// Told why the daemon closes.
    told: Vec<WebSocketStream<Tls>>,
    /// Never read from.
    deaf: Vec<WebSocketStream<Tls>>,
    streams: Vec<Tls>,
    plain: Vec<TcpStream>,
}

/// One client, or some, of every kind.
async fn crowd(daemon: &Daemon) -> Crowd {
    let pictures = json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "quality": 100, "overlay": true });
    let hold = json!({ "type": "hold", "lease": daemon.key });
    let mut told = Vec::new();
    for _ in 0..3 {
        told.push(daemon.viewer(std::slice::from_ref(&pictures)).await);
    }
    told.push(daemon.viewer(&[hold]).await);
    told.push(daemon.viewer(&[]).await);
    let deaf = vec![daemon.viewer(&[pictures]).await, daemon.viewer(&[]).await];
    let request = |line: &str| format!("{line}\r\nhost: 127.0.0.1\r\n");
    let mjpeg = request("GET /api/v1/stream.mjpg?quality=100 HTTP/1.1") + "\r\n";
    let mut streams = Vec::new();
    for said in [
        // Two viewers who read nothing, a head and a body that have begun and do not go on.
        mjpeg.clone(),
        mjpeg,
        request("GET /api/v1/bench HTTP/1.1"),
        request("POST /api/v1/lease HTTP/1.1") + "content-type: application/json\r\ncontent-length: 40\r\n\r\n{",
        // Nothing at all.
        String::new(),
    ] {
        streams.push(daemon.say(&said).await);
    }
    // Answered, and kept for the next request.
    let mut idle = daemon.say(&(request("GET /healthz HTTP/1.1") + "\r\n")).await;
    let mut answer = [0; 1024];
    let length = idle.read(&mut answer).await.unwrap();
    assert!(answer[..length].starts_with(b"HTTP/1.1 200"));
    streams.push(idle);
    // Connections without a handshake, with the beginning of one, and without TLS.
    let mut plain = Vec::new();
    for said in [&b""[..], &[0x16, 3, 1, 0, 200], b"GET / HT"] {
        let mut stream = daemon.tcp().await;
        stream.write_all(said).await.unwrap();
        plain.push(stream);
    }
    Crowd { told, deaf, streams, plain }
}

/// Ends the daemon and checks its end. Returns how long it took.
async fn end(daemon: Daemon, crowd: Crowd) -> Duration {
    let Crowd { told, deaf, streams, plain } = crowd;
    let (url, client) = (daemon.program.url().to_owned(), daemon.client.clone());
    let seen = Arc::new(AtomicUsize::new(0));
    let listening = told.into_iter().map(|mut viewer| {
        let seen = Arc::clone(&seen);
        tokio::spawn(async move {
            while let Some(message) = viewer.next().await {
                match message {
                    Ok(Message::Close(Some(frame))) => return Some(u16::from(frame.code)),
                    Ok(Message::Binary(_)) => _ = seen.fetch_add(1, Ordering::Relaxed),
                    _ => {}
                }
            }
            None
        })
    });
    let listening: Vec<_> = listening.collect();
    // Whoever never reads is full by then: three viewers have seen as many as come in three seconds.
    until("pictures are seen", async || seen.load(Ordering::Relaxed) >= 3 * 60).await;
    let from = Instant::now();
    daemon.program.terminate();
    let asked = client.post(format!("{url}/api/v1/jobs")).header(LEASE_HEADER, &daemon.key);
    let late = asked.json(&json!({ "kind": "homing" })).timeout(Duration::from_secs(4)).send();
    let ending = tokio::task::spawn_blocking(move || daemon.program.end(PROMISED));
    // A job asked for now is refused, if it is answered at all.
    if let Ok(answer) = late.await {
        assert!(!answer.status().is_success(), "a job was begun while the program ended");
    }
    let (status, _, log) = ending.await.unwrap();
    let took = from.elapsed();
    assert_eq!(status.code(), Some(0), "{log}");
    assert!(took < PROMISED, "{took:?}\n{log}");
    // The refusal of the late job, a 503, is one to the HTTP layer's log.
    let errors = log.lines().filter(|line| line.contains("ERROR") && !line.contains("tower_http"));
    assert_eq!(errors.collect::<Vec<_>>(), Vec::<&str>::new(), "{log}");
    assert!(log.contains("axes stopped focus=Confirmed e=Confirmed"), "{log}");
    for viewer in listening {
        assert_eq!(viewer.await.unwrap(), Some(1001), "a viewer is told that the daemon goes away");
    }
    drop((deaf, streams, plain));
    took
}

/// Everything that the history has begun has an end, the run included.
async fn check_history(state: &Path) -> Vec<(String, String)> {
    let store = Store::to_read(state);
    let moves = store.read(|connection| read::newest_moves(connection, 100)).await.unwrap();
    assert!(!moves.is_empty() && moves.iter().all(|motion| motion.outcome.is_some()), "{moves:#?}");
    let open = store.read(|connection| {
        connection.query_row("SELECT count(*) FROM runs WHERE ended_at IS NULL", [], |row| row.get::<_, i64>(0))
    });
    assert_eq!(open.await.unwrap(), 0, "the run's own end is written");
    let jobs = store.read(|connection| read::jobs(connection, &JobFilter::default(), 10)).await.unwrap();
    assert!(jobs.items.iter().all(|(job, _)| job.ended_at.is_some()));
    jobs.items.into_iter().map(|(job, _)| (job.state, job.reason.unwrap_or_default())).collect()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn it_ends_within_five_seconds_in_mid_job_with_every_kind_of_client() {
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path()).await;
    let crowd = crowd(&daemon).await;
    daemon.command(Method::POST, "/api/v1/jobs", json!({ "kind": "joint_alignment" })).await;
    daemon.focus("moving", |focus| focus["moving"] == true).await;
    let took = end(daemon, crowd).await;
    println!("ended {took:?} after the signal, in mid-job");
    let jobs = check_history(state.path()).await;
    assert!(matches!(&jobs[..], [(state, why)] if state == "cancelled" && why == "the program ended"), "{jobs:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn it_ends_within_five_seconds_in_mid_jog_with_every_kind_of_client() {
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path()).await;
    daemon.command(Method::POST, "/api/v1/axes/focus/home", Value::Null).await;
    daemon.focus("homed", |focus| focus["homed"] == true && focus["moving"] == false).await;
    let crowd = crowd(&daemon).await;
    let (client, url, key) = (daemon.client.clone(), daemon.program.url().to_owned(), daemon.key.clone());
    let jog = async {
        let mut accepted = 0;
        until("the daemon is gone", async || {
            let request = client.post(format!("{url}/api/v1/axes/focus/jog")).header(LEASE_HEADER, &key);
            let body = json!({ "towards": "high", "speed_mm_per_s": 0.05 });
            let answer = request.json(&body).send().await;
            accepted += u32::from(answer.as_ref().is_ok_and(|answer| answer.status() == 202));
            answer.is_err()
        })
        .await;
        accepted
    };
    let ends = async {
        daemon.focus("jogging", |focus| focus["moving"] == true).await;
        end(daemon, crowd).await
    };
    let (accepted, took) = tokio::join!(jog, ends);
    println!("ended {took:?} after the signal, in mid-jog");
    assert!(accepted > 10);
    assert_eq!(check_history(state.path()).await, []);
}
