//! The Alpaca facade: its wire, its numbers, and that whoever comes by it is held to the same rules as anybody.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use plenalign::access::{Gate, GateSettings, TokenStore};
use plenalign::alpaca::{Alpaca, IN_RESERVE, UniqueIds};
use plenalign::api::server::{Connections, ServerSettings};
use plenalign::config::Config;
use plenalign::control::open_bench;
use plenalign::control::service::history::HistoryAudit;
use plenalign::device::Bench;
use plenalign::device::faults::Faults;
use reqwest::{Method, RequestBuilder, Response};
use serde_json::{Value, json};

use super::bench::{frames, small_config};
use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::{until, when};

const NOT_IMPLEMENTED: i64 = 0x400;
const INVALID_VALUE: i64 = 0x401;
const VALUE_NOT_SET: i64 = 0x402;
const NOT_CONNECTED: i64 = 0x407;
const INVALID_OPERATION: i64 = 0x40B;
const ACTION_NOT_IMPLEMENTED: i64 = 0x40C;
const CANCELLED: i64 = 0x40E;
const DEVICE: i64 = 0x500;

/// A daemon with the facade beside it.
struct Facade {
    daemon: Daemon,
    address: SocketAddr,
}

/// A client of the facade, by its ClientID.
struct Client<'f>(&'f Facade, u32);

impl Facade {
    async fn start(mut config: Config, bench: Bench) -> Self {
        // The tests ask as fast as they can.
        config.server.requests_per_s = 1e5;
        let daemon = Daemon::start_with(config, bench).await;
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let settings = GateSettings { requests_per_s: 1e5, ..GateSettings::default() };
        let audit = HistoryAudit(Arc::clone(&daemon.service));
        let gate = Arc::new(Gate::new(settings, TokenStore::in_memory(), Box::new(audit)));
        let alpaca = Alpaca::new(Arc::clone(&daemon.service), gate, address, UniqueIds::new());
        let connections = Connections::new(ServerSettings::default());
        tokio::spawn(connections.serve(listener, alpaca.router(), IN_RESERVE, daemon.api.closing()));
        Self { daemon, address }
    }

    /// Over stand-ins, whose axes are where they are told to be at once.
    async fn still() -> Self {
        Self::start(Config::default(), fakes().bench).await
    }

    /// Over the simulated bench.
    async fn simulated() -> Self {
        let config = small_config(1);
        let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
        Self::start(config, bench).await
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.daemon.client.request(method, format!("http://{}{path}", self.address))
    }

    fn client(&self, id: u32) -> Client<'_> {
        Client(self, id)
    }

    /// Who has the control lease, as REST tells it.
    async fn lease(&self) -> Value {
        self.daemon.get("/api/v1/lease").await.json::<Value>().await.unwrap()["lease"].clone()
    }
}

impl Client<'_> {
    async fn answer(&self, request: RequestBuilder) -> Value {
        let response = request.send().await.unwrap();
        let (status, text) = (response.status(), response.text().await.unwrap());
        assert_eq!(status, 200, "{text}");
        serde_json::from_str(&text).unwrap()
    }

    async fn ask(&self, path: &str) -> Value {
        let path = format!("/api/v1/{path}?ClientID={}", self.1);
        self.answer(self.0.request(Method::GET, &path)).await
    }

    async fn tell(&self, path: &str, values: &[(&str, &str)]) -> Value {
        let mut form: Vec<(String, String)> = vec![("ClientID".to_owned(), self.1.to_string())];
        form.extend(values.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())));
        let body = form_urlencoded::Serializer::new(String::new()).extend_pairs(form).finish();
        let request = self.0.request(Method::PUT, &format!("/api/v1/{path}")).body(body);
        self.answer(request.header("content-type", "application/x-www-form-urlencoded")).await
    }

    /// The value of a member.
    async fn get(&self, path: &str) -> Value {
        let answer = self.ask(path).await;
        assert_eq!(answer["ErrorNumber"], 0, "{path}: {answer}");
        answer["Value"].clone()
    }

    async fn put(&self, path: &str, values: &[(&str, &str)]) {
        let answer = self.tell(path, values).await;
        assert_eq!((&answer["ErrorNumber"], &answer["ErrorMessage"]), (&json!(0), &json!("")), "{path}: {answer}");
    }

    async fn connect(&self, device: &str, state: bool) {
        self.put(&format!("{device}/connected"), &[("Connected", if state { "True" } else { "False" })]).await;
    }

    async fn at_rest(&self, device: &str) {
        let moving = format!("{device}/ismoving");
        until(&format!("{device} comes to rest"), async || self.get(&moving).await != true).await;
    }

    async fn home(&self, device: &str) {
        self.put(&format!("{device}/action"), &[("Action", "home"), ("Parameters", "")]).await;
        assert_eq!(self.get(&format!("{device}/ismoving")).await, true, "from the acceptance on");
        self.at_rest(device).await;
    }
}

/// That an answer is this error, and says these words of it.
fn refused(answer: &Value, number: i64, words: &str) {
    assert_eq!(answer["ErrorNumber"], number, "{answer}");
    assert!(answer["ErrorMessage"].as_str().unwrap().contains(words), "{words:?} is not in: {answer}");
    assert_eq!(answer.get("Value"), None, "{answer}");
}

async fn malformed(response: Response, status: u16, words: &str) {
    assert_eq!(response.headers()["content-type"], "text/plain; charset=utf-8");
    let (found, text) = (response.status(), response.text().await.unwrap());
    assert!(found == status && text.contains(words), "{found}, {words:?}: {text}");
}

#[tokio::test]
async fn devices_are_listed_and_transactions_are_echoed_and_counted() {
    let facade = Facade::still().await;
    let ask = async |path: &str| -> Value {
        let response = facade.request(Method::GET, path).send().await.unwrap();
        assert_eq!(response.headers()["content-type"], "application/json");
        assert!(!response.headers().contains_key("access-control-allow-origin"));
        response.json().await.unwrap()
    };
    let versions = ask("/management/apiversions?ClientID=7&clienttransactionid=4294967295").await;
    assert_eq!((&versions["Value"], &versions["ClientTransactionID"]), (&json!([1]), &json!(4_294_967_295_u32)));
    let description = ask("/management/v1/description").await["Value"].clone();
    assert_eq!((&description["ServerName"], &description["Manufacturer"]), (&json!("Plenalign"), &json!("Plenalign")));
    let devices = ask("/management/v1/configureddevices").await["Value"].clone();
    let kinds: Vec<_> = devices.as_array().unwrap().iter().map(|d| (&d["DeviceType"], &d["DeviceNumber"])).collect();
    let (focuser, camera) = (json!("Focuser"), json!("Camera"));
    assert_eq!(kinds, [(&focuser, &json!(0)), (&focuser, &json!(1)), (&camera, &json!(0))]);
    assert_eq!(devices, ask("/management/v1/configureddevices").await["Value"], "UniqueIDs stay what they are");

    let first = ask("/api/v1/focuser/0/name?clientTRANSACTIONid=17").await;
    assert_eq!(first["Value"], "Plenalign focus axis");
    assert_eq!((&first["ClientTransactionID"], &first["ErrorNumber"]), (&json!(17), &json!(0)));
    let next = ask("/api/v1/camera/0/interfaceversion").await;
    assert_eq!((&next["Value"], &next["ClientTransactionID"]), (&json!(4), &json!(0)));
    let counted = |answer: &Value| answer["ServerTransactionID"].as_u64().unwrap();
    assert_eq!(counted(&next), counted(&first) + 1);
    let client = facade.client(3);
    for device in ["focuser/0", "focuser/1", "camera/0"] {
        assert_eq!(client.get(&format!("{device}/connected")).await, false);
        assert_eq!(client.get(&format!("{device}/connecting")).await, false);
        assert_eq!(client.get(&format!("{device}/driverversion")).await, "0.1");
        assert!(client.get(&format!("{device}/description")).await.as_str().unwrap().len() <= 64);
        refused(
            &client.tell(&format!("{device}/commandstring"), &[("Command", "?"), ("Raw", "true")]).await,
            NOT_IMPLEMENTED,
            "motion rules",
        );
        refused(
            &client.tell(&format!("{device}/action"), &[("Action", "Dance")]).await,
            ACTION_NOT_IMPLEMENTED,
            "Dance",
        );
    }
    assert_eq!(client.get("focuser/1/supportedactions").await, json!(["Home"]));
    let set_up = facade.request(Method::GET, "/setup/v1/camera/0/setup").send().await.unwrap();
    assert_eq!(set_up.status(), 200);
}

#[tokio::test]
async fn what_cannot_be_read_is_400_whatever_the_state() {
    let facade = Facade::still().await;
    let get = |path: &str| facade.request(Method::GET, path).send();
    for (path, words) in [
        ("/api/v1/telescope/0/name", "focuser and camera"),
        ("/api/v1/Focuser/0/name", "lower case"),
        ("/api/v1/focuser/2/name", "0 to 1"),
        ("/api/v1/camera/1/name", "0 to 0"),
        ("/api/v1/focuser/-1/name", "0 to 1"),
        ("/api/v1/focuser/x/name", "0 to 1"),
        ("/api/v1/focuser/0/Name", "lower case"),
        ("/api/v1/focuser/0/binx", "no member"),
        ("/api/v2/focuser/0/name", "nothing at"),
        ("/api/v1/focuser/0", "nothing at"),
        ("/API/v1/focuser/0/name", "nothing at"),
        ("/management/v2/description", "nothing at"),
        ("/", "nothing at"),
        ("/api/v1/focuser/0/name?ClientID=", "ClientID"),
        ("/api/v1/focuser/0/name?ClientID=-7", "ClientID"),
        ("/api/v1/focuser/0/name?clientid=qwe", "ClientID"),
        ("/api/v1/focuser/0/name?ClientTransactionID=1.5", "ClientTransactionID"),
        ("/management/apiversions?ClientTransactionID=x", "ClientTransactionID"),
    ] {
        malformed(get(path).await.unwrap(), 400, words).await;
    }
    for (method, path, allowed) in [
        (Method::GET, "/api/v1/focuser/0/halt", "PUT"),
        (Method::PUT, "/api/v1/focuser/0/position", "GET"),
        (Method::POST, "/api/v1/focuser/0/connected", "GET, PUT"),
        (Method::DELETE, "/management/apiversions", "GET"),
    ] {
        let response = facade.request(method, path).send().await.unwrap();
        assert_eq!(response.headers()["allow"], allowed);
        malformed(response, 405, allowed).await;
    }
    let form = "application/x-www-form-urlencoded";
    let put = |path: &str, kind: &str, body: &str| {
        facade.request(Method::PUT, path).header("content-type", kind).body(body.to_owned()).send()
    };
    for (path, body, words) in [
        ("focuser/0/move", "", "Position is missing"),
        ("focuser/0/move", "position=5", "\"position\" is not its name"),
        ("focuser/0/move", "Position=five", "Position"),
        ("focuser/0/move", "Position=2147483648", "Position"),
        ("focuser/0/connected", "Connected=maybe", "neither True nor False"),
        ("focuser/0/connected", "Connected=True&ClientID=a", "ClientID"),
        ("focuser/0/tempcomp", "TempComp=1", "TempComp"),
        ("camera/0/startexposure", "Duration=0.01", "Light is missing"),
        ("camera/0/startexposure", "Duration=NaN&Light=true", "Duration"),
        ("camera/0/binx", "BinX=", "BinX"),
        ("camera/0/gain", "gain=1", "Gain is missing"),
        ("camera/0/action", "", "Action is missing"),
    ] {
        malformed(put(&format!("/api/v1/{path}"), form, body).await.unwrap(), 400, words).await;
    }
    let path = "/api/v1/focuser/0/connected";
    malformed(put(path, "application/json", "{\"Connected\":true}").await.unwrap(), 400, "urlencoded").await;
    malformed(put(path, form, &"x".repeat(20_000)).await.unwrap(), 400, "16384").await;
    let in_query = facade.request(Method::PUT, &format!("{path}?Connected=true")).send().await.unwrap();
    malformed(in_query, 400, "Connected is missing").await;
    assert_eq!(facade.lease().await, Value::Null);
}

#[tokio::test]
async fn other_hosts_and_other_pages_are_turned_away() {
    let facade = Facade::still().await;
    let with = |method: Method, name: &str, value: &str| {
        facade.request(method, "/api/v1/focuser/0/connected").header(name, value).send()
    };
    malformed(with(Method::GET, "host", "evil.example").await.unwrap(), 421, "127.0.0.1").await;
    // Reading, too: it would renew a lease.
    for method in [Method::GET, Method::PUT] {
        for origin in ["http://evil.example", "null", "http://127.0.0.1:1"] {
            malformed(with(method.clone(), "origin", origin).await.unwrap(), 403, "page").await;
        }
        malformed(with(method.clone(), "sec-fetch-site", "cross-site").await.unwrap(), 403, "another site").await;
        malformed(with(method, "x-forwarded-for", "203.0.113.9").await.unwrap(), 403, "proxy").await;
    }
    let preflight = facade.request(Method::OPTIONS, "/api/v1/focuser/0/move").send().await.unwrap();
    assert_eq!(preflight.status(), 405);
}

#[tokio::test]
async fn to_connect_a_focuser_takes_the_lease_and_one_client_has_it() {
    let facade = Facade::still().await;
    let (ada, bob) = (facade.client(42), facade.client(43));
    for member in ["position", "ismoving", "maxstep", "devicestate", "temperature"] {
        refused(&ada.ask(&format!("focuser/0/{member}")).await, NOT_CONNECTED, "set Connected to True");
    }
    refused(&ada.tell("focuser/0/move", &[("Position", "3000")]).await, NOT_CONNECTED, "focus axis");
    refused(&facade.client(0).tell("focuser/0/connect", &[]).await, INVALID_OPERATION, "ClientID above 0");
    assert_eq!(facade.lease().await, Value::Null);

    ada.put("focuser/0/connect", &[]).await;
    ada.connect("focuser/0", true).await;
    ada.connect("focuser/1", true).await;
    let lease = facade.lease().await;
    assert_eq!((&lease["owner"], &lease["ttl_s"]), (&json!("alpaca:42"), &json!(30.0)));
    assert_eq!(ada.get("focuser/1/connected").await, true);
    refused(&bob.tell("focuser/0/connected", &[("Connected", "true")]).await, INVALID_OPERATION, "alpaca:42 has the");
    refused(&bob.tell("focuser/0/move", &[("Position", "1")]).await, NOT_CONNECTED, "alpaca:42 has the control lease");
    assert_eq!(bob.get("focuser/0/connected").await, false);
    let held = facade.daemon.post("/api/v1/lease", &json!({ "owner": "Eve" })).await;
    assert_eq!(problem(held, 409, "lease-held").await["owner"], "alpaca:42");
    // Disconnecting what one has not connected takes nothing from anybody.
    bob.connect("focuser/0", false).await;

    ada.put("focuser/0/move", &[("Position", "3000")]).await;
    ada.at_rest("focuser/0").await;
    assert_eq!(ada.get("focuser/0/position").await, 3000);
    let bench: Value = facade.daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert!((bench["axes"][0]["position_mm"].as_f64().unwrap() - 1.0).abs() < 1e-9, "{bench}");

    ada.connect("focuser/0", false).await;
    assert_eq!(facade.lease().await["owner"], "alpaca:42", "the other Focuser is still connected");
    refused(&ada.tell("focuser/0/move", &[("Position", "3000")]).await, NOT_CONNECTED, "focus axis");
    ada.put("focuser/1/disconnect", &[]).await;
    assert_eq!(facade.lease().await, Value::Null);
    bob.connect("focuser/1", true).await;
    bob.connect("focuser/1", false).await;

    let expected = [
        ("alpaca:42", "lease.take"),
        ("alpaca:42", "axis.move"),
        ("alpaca:42", "lease.release"),
        ("alpaca:43", "lease.take"),
        ("alpaca:43", "lease.release"),
    ];
    // What is done does not wait for its record.
    let recorded = |audit: &Value| {
        let entries = audit["entries"].as_array().unwrap();
        let did: Vec<_> =
            entries.iter().rev().map(|e| (e["who"].as_str().unwrap(), e["what"].as_str().unwrap())).collect();
        assert!(did == expected || did.len() < expected.len(), "{audit}");
        did == expected
    };
    facade.daemon.until("/api/v1/audit", "all is recorded", recorded).await;
}

#[tokio::test]
async fn who_has_the_lease_by_rest_keeps_it_and_whoever_takes_it_over_has_it() {
    let facade = Facade::still().await;
    let ada = facade.client(42);
    ada.connect("focuser/0", true).await;
    let key = facade.daemon.lease().await.to_owned();
    assert_eq!(ada.get("focuser/0/connected").await, false, "an administrator has taken over");
    refused(&ada.tell("focuser/0/move", &[("Position", "1")]).await, NOT_CONNECTED, "a test has the control lease");
    refused(&ada.tell("focuser/0/connect", &[]).await, INVALID_OPERATION, "a test has the control lease");
    let go = json!({ "position_mm": 1.0 });
    let moved = facade.daemon.command(Method::POST, "/api/v1/axes/focus/move", &go).await;
    assert_eq!(moved.status(), 202, "{key}");
    // To see needs no lease.
    ada.connect("camera/0", true).await;
    assert_eq!(ada.get("camera/0/camerastate").await, 0);
    assert_eq!(facade.lease().await["owner"], "a test");
}

#[tokio::test]
async fn a_client_keeps_the_lease_while_it_asks_and_loses_it_when_it_is_gone() {
    let mut config = Config::default();
    config.alpaca.lease_ttl_s = 2.0;
    let facade = Facade::start(config, fakes().bench).await;
    let (ada, bob) = (facade.client(42), facade.client(43));
    ada.connect("focuser/0", true).await;
    let ends = |lease: &Value| lease["expires_at"].as_str().unwrap().parse::<Timestamp>().unwrap();
    let first = ends(&facade.lease().await);
    until("its first term is over", async || {
        // Whatever it asks, of whatever device.
        ada.get("camera/0/name").await;
        assert_eq!(bob.get("focuser/0/connected").await, false);
        Timestamp::now() > first
    })
    .await;
    let lease = facade.lease().await;
    assert_eq!(lease["owner"], "alpaca:42", "renewed by each request");
    let end = ends(&lease) + SignedDuration::from_millis(100);
    until("its last term is over", async || Timestamp::now() > end).await;
    assert_eq!(facade.lease().await, Value::Null, "run out");
    assert_eq!(ada.get("focuser/0/connected").await, false);
    bob.connect("focuser/0", true).await;
    refused(&ada.tell("focuser/0/connect", &[]).await, INVALID_OPERATION, "alpaca:43");
}

#[tokio::test]
async fn limits_and_wall_hold() {
    let fakes = fakes();
    let mut config = Config::default();
    // An axis that is exact may go to the wall.
    (config.bench.e.zero_uncertainty_mm, config.bench.e.scale_uncertainty) = (0.0, 0.0);
    let facade = Facade::start(config, fakes.bench).await;
    let ada = facade.client(42);
    for device in ["focuser/0", "focuser/1"] {
        ada.connect(device, true).await;
        assert_eq!(ada.get(&format!("{device}/absolute")).await, true);
        assert_eq!(ada.get(&format!("{device}/stepsize")).await, 1.0);
        assert_eq!(ada.get(&format!("{device}/tempcompavailable")).await, false);
        assert_eq!(ada.get(&format!("{device}/tempcomp")).await, false);
        refused(&ada.ask(&format!("{device}/temperature")).await, NOT_IMPLEMENTED, "no such sensor");
        refused(&ada.tell(&format!("{device}/tempcomp"), &[("TempComp", "true")]).await, NOT_IMPLEMENTED, "TempComp");
    }
    // −2 to 5 mm, and −5 to 32 mm; the stand-in stands at 0 and at 30.
    assert_eq!(
        (ada.get("focuser/0/maxstep").await, ada.get("focuser/0/maxincrement").await),
        (json!(7000), json!(7000))
    );
    assert_eq!(ada.get("focuser/1/maxstep").await, 37_000);
    assert_eq!(
        (ada.get("focuser/0/position").await, ada.get("focuser/1/position").await),
        (json!(2000), json!(35_000))
    );
    let go = async |device: &str, step: &str| ada.tell(&format!("{device}/move"), &[("Position", step)]).await;
    for step in ["-1", "7001", "2147483647", "-2147483648"] {
        refused(&go("focuser/0", step).await, INVALID_VALUE, "not within 0 to MaxStep, 7000");
    }
    // The e wall is at −0.1 mm.
    refused(&go("focuser/1", "4800").await, INVALID_VALUE, "the lens could touch the shell");
    assert_eq!(go("focuser/1", "4900").await["ErrorNumber"], 0);
    ada.at_rest("focuser/1").await;
    assert_eq!(fakes.e.told.lock().unwrap().last().map(|mm| (mm * 1000.0).round()), Some(-100.0));
    let states = ada.get("focuser/1/devicestate").await;
    let state = |name: &str| states.as_array().unwrap().iter().find(|s| s["Name"] == name).map(|s| s["Value"].clone());
    assert_eq!((state("Position"), state("IsMoving")), (Some(json!(4900)), Some(json!(false))));
    assert!(state("TimeStamp").unwrap().as_str().unwrap().ends_with('Z'), "{states}");

    let stopped = facade.daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
    assert_eq!(stopped.status(), 200);
    refused(&go("focuser/0", "1000").await, INVALID_OPERATION, "the stop is latched; reset it first");
    facade.daemon.reset_stop().await;
    assert_eq!(go("focuser/0", "1000").await["ErrorNumber"], 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn anybody_halts_a_move_and_the_next_one_goes_on() {
    let facade = Facade::simulated().await;
    let (ada, stranger) = (facade.client(42), facade.client(0));
    ada.connect("focuser/0", true).await;
    refused(&ada.ask("focuser/0/position").await, VALUE_NOT_SET, "not homed");
    refused(&ada.tell("focuser/0/move", &[("Position", "3000")]).await, INVALID_OPERATION, "not homed");
    stranger.put("focuser/0/halt", &[]).await;
    ada.home("focuser/0").await;
    let home = ada.get("focuser/0/position").await.as_i64().unwrap();
    assert!((home - 2000).abs() <= 1, "{home}");

    ada.put("focuser/0/move", &[("Position", "6500")]).await;
    // Accepted is moving, from the first question on.
    assert_eq!(ada.get("focuser/0/ismoving").await, true);
    refused(&ada.tell("focuser/0/move", &[("Position", "3000")]).await, INVALID_OPERATION, "is moving");
    let position = async || ada.get("focuser/0/position").await.as_i64().unwrap();
    until("it is under way", async || position().await > home + 100).await;
    stranger.put("focuser/0/halt", &[]).await;
    assert_eq!(ada.get("focuser/0/ismoving").await, false, "at once, and no failure of the client's");
    let halted = ada.get("focuser/0/position").await.as_i64().unwrap();
    assert!(halted > home + 100 && halted < 6400, "{halted}");
    frames(facade.daemon.service.bench(), 8).await;
    assert_eq!(ada.get("focuser/0/position").await, halted, "and stays there");

    ada.put("focuser/0/move", &[("Position", "2500")]).await;
    ada.at_rest("focuser/0").await;
    let reached = ada.get("focuser/0/position").await.as_i64().unwrap();
    assert!((reached - 2500).abs() <= 1, "{reached}");

    // A stop that ends a move is told to whoever waits for its end.
    ada.put("focuser/0/move", &[("Position", "6500")]).await;
    facade.daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
    let ended = |answer: &Value| answer["Value"] != true;
    let told = until("the move ends", async || when(ada.ask("focuser/0/ismoving").await, ended)).await;
    refused(&told, CANCELLED, "the stop ended the move");
    facade.daemon.reset_stop().await;
    ada.put("focuser/0/move", &[("Position", "2500")]).await;
    ada.at_rest("focuser/0").await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_halt_ends_the_job_that_moves_the_axis_and_no_other_does() {
    let facade = Facade::simulated().await;
    let ada = facade.client(42);
    let job = json!({ "kind": "homing" });
    let job: Value = facade.daemon.command(Method::POST, "/api/v1/jobs", &job).await.json().await.unwrap();
    let href = job["href"].as_str().unwrap().to_owned();
    let moves = async || -> bool {
        let bench: Value = facade.daemon.get("/api/v1/bench").await.json().await.unwrap();
        bench["axes"].as_array().unwrap().iter().any(|axis| axis["moving"] == true)
    };
    until("the job moves something", &moves).await;
    // Whichever it has begun with.
    ada.put("focuser/0/halt", &[]).await;
    ada.put("focuser/1/halt", &[]).await;
    let ended = facade.daemon.until(&href, "the job ends", |job| !job["ended_at"].is_null()).await;
    assert_eq!(ended["state"], "cancelled", "{ended}");
    assert!(ended["reason"].as_str().unwrap().contains("was halted by alpaca:42"), "{ended}");
    assert!(!moves().await);
}

#[tokio::test]
async fn a_stage_that_is_gone_is_told() {
    let facade = Facade::simulated().await;
    let ada = facade.client(42);
    ada.connect("focuser/0", true).await;
    let simulated = facade.daemon.service.bench().simulated.clone().unwrap();
    let mut faults = Faults::default();
    faults.serial.unplugged = true;
    simulated.set_faults(faults);
    let mut state = facade.daemon.service.bench().focus.state();
    tokio::time::timeout(Duration::from_secs(20), state.wait_for(|state| !state.connected)).await.unwrap().unwrap();
    for member in ["position", "ismoving"] {
        refused(&ada.ask(&format!("focuser/0/{member}")).await, DEVICE, "not connected");
    }
    ada.connect("focuser/0", false).await;
    refused(&ada.tell("focuser/0/connect", &[]).await, DEVICE, "not connected");
    assert_eq!(facade.lease().await, Value::Null);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_exposure_gives_a_frame_from_after_it_on_both_wires() {
    let facade = Facade::simulated().await;
    let ada = facade.client(42);
    refused(
        &ada.tell("camera/0/startexposure", &[("Duration", "0.01"), ("Light", "True")]).await,
        NOT_CONNECTED,
        "camera",
    );
    ada.connect("camera/0", true).await;
    assert_eq!(facade.lease().await, Value::Null, "to see takes no lease");
    assert_eq!((ada.get("camera/0/cameraxsize").await, ada.get("camera/0/numy").await), (json!(560), json!(560)));
    assert_eq!((ada.get("camera/0/maxadu").await, ada.get("camera/0/pixelsizex").await), (json!(255), json!(3.45)));
    for member in ["imagearray", "lastexposureduration", "lastexposurestarttime", "percentcompleted"] {
        refused(&ada.ask(&format!("camera/0/{member}")).await, INVALID_OPERATION, "");
    }
    assert_eq!(ada.get("camera/0/imageready").await, false);

    let start =
        async |duration: &str| ada.tell("camera/0/startexposure", &[("Duration", duration), ("Light", "true")]).await;
    for duration in ["-0.1", "10"] {
        refused(&start(duration).await, INVALID_VALUE, "ExposureMax");
    }
    let begun = jiff::Timestamp::now();
    assert_eq!(start("0.01").await["ErrorNumber"], 0);
    assert_eq!((ada.get("camera/0/imageready").await, ada.get("camera/0/camerastate").await), (json!(false), json!(2)));
    refused(&start("0.01").await, INVALID_OPERATION, "under way");
    ready(&ada).await;
    assert_eq!(ada.get("camera/0/percentcompleted").await, 100);
    assert_eq!(ada.get("camera/0/lastexposureduration").await, 0.01);
    let started = ada.get("camera/0/lastexposurestarttime").await;
    let started: jiff::Timestamp = format!("{}Z", started.as_str().unwrap()).parse().unwrap();
    // Told to the millisecond.
    assert!(started.duration_since(begun).as_millis() >= -1, "{started} is before {begun}");

    let columns = image(&facade, &ada).await;
    assert_eq!((columns.len(), columns[0].len()), (560, 560));
    // A window of it, of the next exposure.
    for (member, name, value) in [("startx", "StartX", "100"), ("starty", "StartY", "20"), ("numx", "NumX", "30")] {
        ada.put(&format!("camera/0/{member}"), &[(name, value)]).await;
    }
    refused(&start("0.01").await, INVALID_VALUE, "StartY = 20 and NumY = 560");
    ada.put("camera/0/numy", &[("NumY", "7")]).await;
    assert_eq!(start("0.01").await["ErrorNumber"], 0);
    ready(&ada).await;
    let window = image(&facade, &ada).await;
    assert_eq!((window.len(), window[0].len()), (30, 7));
    // Of the same scene, but for the noise.
    for (x, column) in window.iter().enumerate() {
        for (y, sample) in column.iter().enumerate() {
            assert!((sample - columns[100 + x][20 + y]).abs() < 60, "at {x}, {y}");
        }
    }
}

async fn ready(client: &Client<'_>) {
    until("an image comes", async || client.get("camera/0/imageready").await != false).await;
}

/// The image as JSON has it; as bytes it is the same.
async fn image(facade: &Facade, client: &Client<'_>) -> Vec<Vec<i64>> {
    let answer = client.ask("camera/0/imagearray").await;
    assert_eq!((&answer["Type"], &answer["Rank"], &answer["ErrorNumber"]), (&json!(2), &json!(2), &json!(0)));
    let columns: Vec<Vec<i64>> = serde_json::from_value(answer["Value"].clone()).unwrap();
    let path = format!("/api/v1/camera/0/imagearrayvariant?ClientID={}&ClientTransactionID=99", client.1);
    let request = facade.request(Method::GET, &path).header("accept", "application/json;q=0.5, application/imagebytes");
    let response = request.send().await.unwrap();
    assert_eq!(response.headers()["content-type"], "application/imagebytes");
    let bytes = response.bytes().await.unwrap();
    let head: Vec<u32> = bytes[..44].chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
    let size = [columns.len() as u32, columns[0].len() as u32];
    assert_eq!((&head[..3], &head[4..]), (&[1, 0, 99][..], &[44, 2, 6, 2, size[0], size[1], 0][..]));
    let samples: Vec<i64> = bytes[44..].iter().map(|&byte| i64::from(byte)).collect();
    assert_eq!(samples, columns.concat());
    columns
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_camera_that_hangs_fails_the_exposure_and_the_next_may_succeed() {
    let facade = Facade::simulated().await;
    let ada = facade.client(42);
    ada.connect("camera/0", true).await;
    let light = [("Duration", "0"), ("Light", "False")];
    ada.put("camera/0/startexposure", &light).await;
    ready(&ada).await;
    let simulated = facade.daemon.service.bench().simulated.clone().unwrap();
    let mut faults = Faults::default();
    faults.camera.frozen = true;
    simulated.set_faults(faults);
    ada.put("camera/0/startexposure", &light).await;
    until("the exposure ends", async || ada.get("camera/0/camerastate").await != 2).await;
    assert_eq!(ada.get("camera/0/camerastate").await, 5);
    for member in ["imageready", "imagearray"] {
        refused(&ada.ask(&format!("camera/0/{member}")).await, DEVICE, "same to the last pixel");
    }
    simulated.set_faults(Faults::default());
    ada.put("camera/0/startexposure", &light).await;
    ready(&ada).await;

    faults.camera.frozen = false;
    faults.camera.unplugged = true;
    simulated.set_faults(faults);
    let mut state = facade.daemon.service.bench().camera.state();
    tokio::time::timeout(Duration::from_secs(20), state.wait_for(|state| !state.online)).await.unwrap().unwrap();
    refused(&facade.client(43).tell("camera/0/connect", &[]).await, DEVICE, "it is unplugged");
}

#[tokio::test]
async fn an_exposure_is_aborted_and_one_that_fails_says_why() {
    let fakes = fakes();
    fakes.camera.hang();
    let facade = Facade::start(Config::default(), fakes.bench).await;
    let ada = facade.client(42);
    ada.connect("camera/0", true).await;
    ada.put("camera/0/abortexposure", &[]).await;
    ada.put("camera/0/startexposure", &[("Duration", "0.01"), ("Light", "True")]).await;
    assert_eq!(
        (ada.get("camera/0/camerastate").await, ada.get("camera/0/percentcompleted").await),
        (json!(2), json!(0))
    );
    refused(&ada.tell("camera/0/stopexposure", &[]).await, NOT_IMPLEMENTED, "as a whole");
    ada.put("camera/0/abortexposure", &[]).await;
    assert_eq!((ada.get("camera/0/camerastate").await, ada.get("camera/0/imageready").await), (json!(0), json!(false)));
    refused(&ada.ask("camera/0/imagearray").await, INVALID_OPERATION, "no image has been taken");

    // This one's camera gives no frame to measure.
    let facade = Facade::still().await;
    let ada = facade.client(42);
    ada.connect("camera/0", true).await;
    ada.put("camera/0/startexposure", &[("Duration", "0.01"), ("Light", "True")]).await;
    until("the exposure ends", async || ada.get("camera/0/camerastate").await != 2).await;
    for member in ["imageready", "imagearray"] {
        refused(&ada.ask(&format!("camera/0/{member}")).await, DEVICE, "camera is not connected: a stand-in");
    }
    ada.put("camera/0/abortexposure", &[]).await;
    refused(&ada.ask("camera/0/lastexposureduration").await, INVALID_OPERATION, "no image has been taken");
}

#[tokio::test]
async fn what_the_camera_has_not_is_said() {
    let facade = Facade::still().await;
    let ada = facade.client(42);
    ada.connect("camera/0", true).await;
    for member in [
        "bayeroffsetx",
        "ccdtemperature",
        "cooleron",
        "coolerpower",
        "electronsperadu",
        "fastreadout",
        "fullwellcapacity",
        "gain",
        "gainmax",
        "gainmin",
        "gains",
        "heatsinktemperature",
        "ispulseguiding",
        "offset",
        "offsetmax",
        "offsetmin",
        "offsets",
        "setccdtemperature",
        "subexposureduration",
    ] {
        refused(&ada.ask(&format!("camera/0/{member}")).await, NOT_IMPLEMENTED, "not implemented");
    }
    for (member, values) in [
        ("cooleron", &[("CoolerOn", "true")][..]),
        ("fastreadout", &[("FastReadout", "true")]),
        ("gain", &[("Gain", "1")]),
        ("offset", &[("Offset", "1")]),
        ("setccdtemperature", &[("SetCCDTemperature", "-10.5")]),
        ("subexposureduration", &[("SubExposureDuration", "1")]),
        ("pulseguide", &[("Direction", "0"), ("Duration", "100")]),
    ] {
        refused(&ada.tell(&format!("camera/0/{member}"), values).await, NOT_IMPLEMENTED, "not implemented");
    }
    for member in ["canasymmetricbin", "canfastreadout", "canpulseguide", "canstopexposure", "hasshutter"] {
        assert_eq!(ada.get(&format!("camera/0/{member}")).await, false);
    }
    assert_eq!(
        (ada.get("camera/0/sensortype").await, ada.get("camera/0/readoutmodes").await),
        (json!(0), json!(["Raw"]))
    );
    for (member, name, only, other) in
        [("binx", "BinX", "1", "2"), ("biny", "BinY", "1", "0"), ("readoutmode", "ReadoutMode", "0", "1")]
    {
        ada.put(&format!("camera/0/{member}"), &[(name, only)]).await;
        refused(&ada.tell(&format!("camera/0/{member}"), &[(name, other)]).await, INVALID_VALUE, "the only one");
    }
    refused(&ada.tell("camera/0/numx", &[("NumX", "0")]).await, INVALID_VALUE, "less than 1");
}
