//! Who is let in, to what, and how they are turned away.

use std::sync::Arc;

use futures_util::StreamExt as _;
use jiff::Timestamp;
use plenalign::access::{Demand, Gate, GateSettings, LogAudit, Networks, Scope, Secret, TokenStore};
use plenalign::api::server::ServerSettings;
use plenalign::config::Config;
use reqwest::{Method, RequestBuilder, Response};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::http::HeaderValue;

use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::{until, when};

/// A daemon with a token of each scope.
struct Guarded {
    daemon: Daemon,
    view: String,
    control: String,
    admin: String,
}

fn settings() -> GateSettings {
    GateSettings { requests_per_s: 1000.0, ..GateSettings::default() }
}

async fn behind(gate: Gate) -> Daemon {
    let mut config = Config::default();
    config.bench.camera.timeout_ms = 300;
    Daemon::start_behind(config, fakes().bench, gate, ServerSettings::default()).await
}

impl Guarded {
    async fn start() -> Self {
        let tokens = TokenStore::in_memory();
        let make = |name, scope| tokens.create(name, scope, None).unwrap().0.reveal().to_owned();
        let [view, control, admin] =
            [("Vera", Scope::View), ("Conny", Scope::Control), ("Adele", Scope::Admin)].map(|(n, s)| make(n, s));
        let daemon = behind(Gate::new(settings(), tokens, Box::new(LogAudit))).await;
        Self { daemon, view, control, admin }
    }

    fn by(&self, token: &str, method: Method, path: &str) -> RequestBuilder {
        self.daemon.request(method, path).bearer_auth(token)
    }

    async fn status(&self, token: &str, method: Method, path: &str) -> u16 {
        self.by(token, method, path).send().await.unwrap().status().as_u16()
    }

    async fn sign_in(&self, key: &str) -> Response {
        self.daemon.post("/api/v1/session", &json!({ "key": key })).await
    }
}

/// The cookie of an answer, as a browser would send it back, and the whole of it.
fn cookie(response: &Response) -> (String, String) {
    let whole = response.headers()["set-cookie"].to_str().unwrap().to_owned();
    (whole.split(';').next().unwrap().to_owned(), whole)
}

#[tokio::test]
async fn without_a_token_there_is_nothing_but_health_the_page_and_the_door() {
    let guarded = Guarded::start().await;
    for path in ["/api/v1/bench", "/api/v1/jobs", "/api/v1/snapshot.jpg", "/api/v1/openapi.json", "/api/v1/config"] {
        let response = guarded.daemon.get(path).await;
        assert_eq!(response.headers()["www-authenticate"], "Bearer realm=\"plenalign\"");
        problem(response, 401, "unauthorised").await;
    }
    for path in ["/api/v1/nothing", "/api", "/api/v1/session", "/api/v1/tokens"] {
        problem(guarded.daemon.get(path).await, 401, "unauthorised").await;
    }
    problem(guarded.daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap(), 401, "unauthorised").await;
    for path in ["/healthz", "/", "/login", "/api/v1/docs"] {
        assert_eq!(guarded.daemon.get(path).await.status(), 200, "{path}");
    }
    let socket = tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", guarded.daemon.address)).await;
    assert!(socket.unwrap_err().to_string().contains("401"));
}

#[tokio::test]
async fn an_empty_or_wrong_token_is_never_taken_for_none() {
    let open = behind(Gate::new(settings(), TokenStore::in_memory(), Box::new(LogAudit))).await;
    let guarded = Guarded::start().await;
    for daemon in [&open, &guarded.daemon] {
        for value in ["", "Bearer", "Bearer ", "Bearer wrong", "Basic YTpi"] {
            let request = daemon.request(Method::GET, "/api/v1/bench").header("authorization", value);
            problem(request.send().await.unwrap(), 401, "unauthorised").await;
        }
    }
    assert_eq!(open.get("/api/v1/bench").await.status(), 200);
}

#[tokio::test]
async fn each_scope_opens_what_it_should_and_no_more() {
    let guarded = Guarded::start().await;
    let Guarded { view, control, admin, .. } = &guarded;
    let status = |token, method, path| guarded.status(token, method, path);
    for token in [view, control, admin] {
        assert_eq!(status(token, Method::GET, "/api/v1/bench").await, 200);
        assert_eq!(status(token, Method::HEAD, "/api/v1/bench").await, 200);
        assert_eq!(status(token, Method::GET, "/api/v1/session").await, 200);
        assert_eq!(status(token, Method::GET, "/api/v1/devices").await, 200);
        let draft = guarded.by(token, Method::POST, "/api/v1/design").json(&json!({})).send().await.unwrap();
        assert_eq!(draft.status(), 200);
    }
    assert_eq!(status(view, Method::POST, "/api/v1/axes/focus/home").await, 403);
    assert_eq!(status(view, Method::DELETE, "/api/v1/stop").await, 403);
    let refused = problem(guarded.by(view, Method::DELETE, "/api/v1/stop").send().await.unwrap(), 403, "scope").await;
    assert_eq!((&refused["scope"], &refused["needed"]), (&json!("view"), &json!("control")));
    let reset = guarded.by(control, Method::DELETE, "/api/v1/stop").json(&json!({ "why": "a test" })).send().await;
    assert_eq!(reset.unwrap().status(), 200);
    for (method, path) in
        [(Method::GET, "/api/v1/tokens"), (Method::POST, "/api/v1/tokens"), (Method::PUT, "/api/v1/config")]
    {
        assert_eq!(status(control, method.clone(), path).await, 403, "{method} {path}");
    }
    assert_eq!(status(admin, Method::GET, "/api/v1/tokens").await, 200);
    // What has no entry in the table is for nobody but an administrator, and is not there for them.
    assert_eq!(status(view, Method::PATCH, "/api/v1/bench").await, 403);
    assert_eq!(status(admin, Method::PATCH, "/api/v1/bench").await, 405);
    assert_eq!(status(view, Method::GET, "/api/v1/nothing").await, 404);
}

#[tokio::test]
async fn whoever_may_see_may_stop_however_often() {
    let tokens = TokenStore::in_memory();
    let (token, _) = tokens.create("Vera", Scope::View, None).unwrap();
    let slow = GateSettings { requests_per_s: 1.0, ..GateSettings::default() };
    let daemon = behind(Gate::new(slow, tokens, Box::new(LogAudit))).await;
    let ask = |method, path| daemon.request(method, path).bearer_auth(token.reveal()).send();
    let mut turned_away = None;
    for _ in 0..10 {
        let response = ask(Method::GET, "/api/v1/bench").await.unwrap();
        if response.status() == 429 {
            turned_away = Some(response);
        }
    }
    let turned_away = turned_away.expect("ten requests at once are too many at 1 a second");
    let wait: u64 = turned_away.headers()["retry-after"].to_str().unwrap().parse().unwrap();
    assert!((1..=10).contains(&wait), "{wait}");
    problem(turned_away, 429, "too-many-requests").await;
    for _ in 0..30 {
        assert_eq!(ask(Method::POST, "/api/v1/stop").await.unwrap().status(), 200);
    }
    // Others are not held up by it.
    assert_eq!(daemon.get("/healthz").await.status(), 200);
}

#[tokio::test]
async fn loopback_is_open_until_there_is_a_token() {
    let daemon = behind(Gate::new(settings(), TokenStore::in_memory(), Box::new(LogAudit))).await;
    let me: Value = daemon.get("/api/v1/session").await.json().await.unwrap();
    assert_eq!(me, json!({ "name": "local", "scope": "admin", "signed_in": false, "demanded": false }));
    let made = daemon.post("/api/v1/tokens", &json!({ "name": "Ana", "scope": "control" })).await;
    assert_eq!(made.status(), 201);
    let href = made.headers()["location"].to_str().unwrap().to_owned();
    let made: Value = made.json().await.unwrap();
    assert_eq!((&made["href"], &made["name"], &made["scope"]), (&json!(href), &json!("Ana"), &json!("control")));
    let secret = made["secret"].as_str().unwrap();
    assert!(secret.starts_with("plenalign_") && secret.len() > 60);

    problem(daemon.get("/api/v1/bench").await, 401, "unauthorised").await;
    let me = daemon.request(Method::GET, "/api/v1/session").bearer_auth(secret).send().await.unwrap();
    let me: Value = me.json().await.unwrap();
    assert_eq!(me, json!({ "name": "Ana", "scope": "control", "signed_in": false, "demanded": true }));
}

#[tokio::test]
async fn tokens_are_made_listed_and_revoked_and_their_secret_is_told_once() {
    let guarded = Guarded::start().await;
    let ask = |method, path: &str| guarded.by(&guarded.admin, method, path);
    let body = json!({ "name": "Bo", "scope": "view", "expires_at": "2100-01-01T00:00:00Z" });
    let made: Value = ask(Method::POST, "/api/v1/tokens").json(&body).send().await.unwrap().json().await.unwrap();
    let (secret, href) = (made["secret"].as_str().unwrap(), made["href"].as_str().unwrap());
    assert_eq!(made["expires_at"], "2100-01-01T00:00:00Z");

    let taken = ask(Method::POST, "/api/v1/tokens").json(&body).send().await.unwrap();
    problem(taken, 409, "taken").await;
    for (wrong, field) in [
        (json!({ "name": "", "scope": "view" }), "name"),
        (json!({ "name": "x", "scope": "root" }), "scope"),
        (json!({ "name": "x", "scope": "view", "secret": "mine" }), "secret"),
    ] {
        let refused = ask(Method::POST, "/api/v1/tokens").json(&wrong).send().await.unwrap();
        assert_eq!(problem(refused, 422, "invalid").await["field"], field, "{wrong}");
    }

    for (refused, kind) in [
        (json!({ "name": "local", "scope": "view" }), "taken"),
        (json!({ "name": "x", "scope": "view", "expires_at": "2001-01-01T00:00:00Z" }), "past"),
    ] {
        problem(ask(Method::POST, "/api/v1/tokens").json(&refused).send().await.unwrap(), 409, kind).await;
    }

    assert_eq!(guarded.status(secret, Method::GET, "/api/v1/bench").await, 200);
    let list = ask(Method::GET, "/api/v1/tokens").send().await.unwrap().text().await.unwrap();
    assert!(!list.contains(&secret["plenalign_".len()..]) && !list.contains("sha256"), "{list}");
    let list: Value = serde_json::from_str(&list).unwrap();
    let names: Vec<_> = list["tokens"].as_array().unwrap().iter().map(|token| token["name"].clone()).collect();
    assert_eq!(names, ["Vera", "Conny", "Adele", "Bo"]);
    assert!(list["tokens"][3]["last_used_at"].is_string() && list["tokens"][0]["last_used_at"].is_null());

    assert_eq!(ask(Method::DELETE, href).send().await.unwrap().status(), 204);
    problem(ask(Method::DELETE, href).send().await.unwrap(), 404, "not-found").await;
    problem(ask(Method::DELETE, "/api/v1/tokens/7").send().await.unwrap(), 404, "not-found").await;
    assert_eq!(guarded.status(secret, Method::GET, "/api/v1/bench").await, 401);
}

#[tokio::test]
async fn a_browser_signs_in_with_a_token_and_out_again() {
    let guarded = Guarded::start().await;
    let signed_in = guarded.sign_in(&guarded.control).await;
    assert_eq!(signed_in.status(), 200);
    let (cookie, whole) = cookie(&signed_in);
    for part in ["; HttpOnly", "; SameSite=Strict", "; Path=/", "; Max-Age="] {
        assert!(whole.contains(part), "{whole}");
    }
    assert!(!whole.contains("Secure") && !whole.contains(&guarded.control));
    let said = signed_in.text().await.unwrap();
    assert!(!said.contains(cookie.split('=').nth(1).unwrap()), "no script is to see the session");

    let ask = |method, path| guarded.daemon.request(method, path).header("cookie", &cookie);
    let me: Value = ask(Method::GET, "/api/v1/session").send().await.unwrap().json().await.unwrap();
    assert_eq!(me, json!({ "name": "Conny", "scope": "control", "signed_in": true, "demanded": true }));
    assert_eq!(ask(Method::GET, "/api/v1/tokens").send().await.unwrap().status(), 403);
    // A page elsewhere cannot have the browser command anything, cookie or not.
    for (name, value) in [("origin", "http://evil.example"), ("sec-fetch-site", "cross-site")] {
        let foreign = ask(Method::DELETE, "/api/v1/stop").header(name, value).send().await.unwrap();
        problem(foreign, 403, "cross-origin").await;
    }
    let mut socket = format!("ws://{}/api/v1/ws", guarded.daemon.address).into_client_request().unwrap();
    socket.headers_mut().insert("cookie", HeaderValue::from_str(&cookie).unwrap());
    let (_open, _) = tokio_tungstenite::connect_async(socket).await.unwrap();

    let out = ask(Method::DELETE, "/api/v1/session").send().await.unwrap();
    assert_eq!(out.status(), 204);
    assert!(out.headers()["set-cookie"].to_str().unwrap().contains("Max-Age=0"));
    problem(ask(Method::GET, "/api/v1/bench").send().await.unwrap(), 401, "unauthorised").await;
}

#[tokio::test]
async fn a_revoked_token_takes_its_sessions_with_it() {
    let guarded = Guarded::start().await;
    let (cookie, _) = cookie(&guarded.sign_in(&guarded.view).await);
    let ask = || guarded.daemon.request(Method::GET, "/api/v1/bench").header("cookie", &cookie).send();
    assert_eq!(ask().await.unwrap().status(), 200);
    let mut socket = format!("ws://{}/api/v1/ws", guarded.daemon.address).into_client_request().unwrap();
    socket.headers_mut().insert("cookie", HeaderValue::from_str(&cookie).unwrap());
    let (mut socket, _) = tokio_tungstenite::connect_async(socket).await.unwrap();
    let pictures = guarded.by(&guarded.view, Method::GET, "/api/v1/stream.mjpg").send().await.unwrap();
    assert_eq!(pictures.status(), 200);
    let list = guarded.by(&guarded.admin, Method::GET, "/api/v1/tokens").send().await.unwrap();
    let list: Value = list.json().await.unwrap();
    let vera = list["tokens"][0]["href"].as_str().unwrap();
    assert_eq!(guarded.status(&guarded.admin, Method::DELETE, vera).await, 204);
    assert_eq!(ask().await.unwrap().status(), 401);
    // What is open ends, too.
    let closed = async {
        while let Some(message) = socket.next().await {
            if let Ok(Message::Close(Some(frame))) = message {
                return u16::from(frame.code);
            }
        }
        0
    };
    assert_eq!(tokio::time::timeout(std::time::Duration::from_secs(5), closed).await, Ok(1008));
    let ended = tokio::time::timeout(std::time::Duration::from_secs(5), pictures.bytes()).await;
    assert!(ended.is_ok(), "the pictures go on for a token that was revoked");
}

#[tokio::test]
async fn who_is_signed_in_with_a_token_that_expires_is_told_that_it_has_and_when() {
    let tokens = TokenStore::in_memory();
    let end = Timestamp::now() + jiff::SignedDuration::from_secs(2);
    let brief = tokens.create("Vera", Scope::View, Some(end)).unwrap().0.reveal().to_owned();
    let daemon = behind(Gate::new(settings(), tokens, Box::new(LogAudit))).await;
    let opened = daemon.post("/api/v1/session", &json!({ "key": brief })).await;
    let (cookie, whole) = cookie(&opened);
    // A browser brings its cookie after the end: by nothing else it is known whose it was.
    let (_, lasts_s) = whole.split_once("Max-Age=").unwrap();
    assert!(lasts_s.split(';').next().unwrap().parse::<u64>().unwrap() > 24 * 3600, "{whole}");
    let ask = || daemon.request(Method::GET, "/api/v1/session").header("cookie", &cookie).send();
    assert_eq!(ask().await.unwrap().status(), 200);
    let over = until("the token has expired", async || ask().await.unwrap().status() != 200);
    tokio::time::timeout(std::time::Duration::from_secs(10), over).await.unwrap();
    for told in
        [ask().await.unwrap(), daemon.request(Method::GET, "/api/v1/bench").bearer_auth(&brief).send().await.unwrap()]
    {
        let told = problem(told, 401, "unauthorised").await;
        assert_eq!(told["ended"], json!({ "how": "expired", "name": "Vera", "at": end, "by": null }), "{told}");
        assert!(told["detail"].as_str().unwrap().contains("the token of Vera has expired at"), "{told}");
    }
    let told = problem(daemon.post("/api/v1/session", &json!({ "key": brief })).await, 401, "unauthorised").await;
    assert_eq!(told["ended"]["how"], "expired");
}

#[tokio::test]
async fn the_one_time_key_opens_the_door_once() {
    let gate = GateSettings { demand: Demand::Always, ..settings() };
    let gate = Gate::new(gate, TokenStore::in_memory(), Box::new(LogAudit));
    let key = Secret::random("").unwrap();
    gate.once().set(&key, std::time::Duration::from_secs(60), None);
    let daemon = behind(gate).await;
    problem(daemon.get("/api/v1/bench").await, 401, "unauthorised").await;
    let bearer = daemon.request(Method::GET, "/api/v1/bench").bearer_auth(key.reveal()).send().await.unwrap();
    problem(bearer, 401, "unauthorised").await;

    // To look at the link, as a messenger's preview does, does not use it up.
    assert_eq!(daemon.get(&format!("/login?once={}", key.reveal())).await.status(), 200);
    let opened = daemon.post("/api/v1/session", &json!({ "key": key.reveal() })).await;
    let (cookie, _) = cookie(&opened);
    let me: Value = opened.json().await.unwrap();
    assert_eq!((&me["name"], &me["scope"]), (&json!("one-time link"), &json!("admin")));
    let made = daemon.request(Method::POST, "/api/v1/tokens").header("cookie", &cookie);
    let made = made.json(&json!({ "name": "Ana", "scope": "admin" })).send().await.unwrap();
    assert_eq!(made.status(), 201);
    let again = daemon.post("/api/v1/session", &json!({ "key": key.reveal() })).await;
    problem(again, 401, "unauthorised").await;
}

#[tokio::test]
async fn guessing_is_slowed_down_and_holds_up_nobody_who_has_a_token() {
    let guarded = Guarded::start().await;
    for _ in 0..10 {
        problem(guarded.sign_in("guess").await, 401, "unauthorised").await;
    }
    for key in ["guess", "", &guarded.admin] {
        let refused = guarded.sign_in(key).await;
        let wait: u64 = refused.headers()["retry-after"].to_str().unwrap().parse().unwrap();
        assert!((1..=60).contains(&wait), "{wait}");
        problem(refused, 429, "too-many-requests").await;
    }
    // A wrong token is wrong, however many came before it.
    let refused = guarded.by("guess", Method::GET, "/api/v1/bench").send().await.unwrap();
    problem(refused, 401, "unauthorised").await;
    assert_eq!(guarded.status(&guarded.view, Method::POST, "/api/v1/stop").await, 200);
}

#[tokio::test]
async fn a_ticket_opens_one_path_once() {
    let guarded = Guarded::start().await;
    let ticket = |token: &str, path: &str| {
        let request = guarded.by(token, Method::POST, "/api/v1/tickets").json(&json!({ "path": path }));
        async move { request.send().await.unwrap() }
    };
    let given = ticket(&guarded.view, "/api/v1/bench").await;
    assert_eq!(given.status(), 201);
    let given: Value = given.json().await.unwrap();
    let (href, text) = (given["href"].as_str().unwrap(), given["ticket"].as_str().unwrap());
    assert_eq!((href, &given["lasts_s"]), (format!("/api/v1/bench?ticket={text}").as_str(), &json!(30)));
    let elsewhere = guarded.daemon.get(&format!("/api/v1/jobs?ticket={text}")).await;
    problem(elsewhere, 401, "unauthorised").await;
    assert_eq!(guarded.daemon.get(href).await.status(), 200);
    problem(guarded.daemon.get(href).await, 401, "unauthorised").await;

    // A handler that knows its parameters does not stumble over the ticket: there is no frame, and that is its answer.
    let given: Value = ticket(&guarded.view, "/api/v1/snapshot.jpg").await.json().await.unwrap();
    let answer = guarded.daemon.get(&format!("{}&reduce=2", given["href"].as_str().unwrap())).await;
    problem(answer, 503, "no-frame").await;

    let given: Value = ticket(&guarded.view, "/api/v1/ws").await.json().await.unwrap();
    let url = format!("ws://{}{}", guarded.daemon.address, given["href"].as_str().unwrap());
    let (_socket, _) = tokio_tungstenite::connect_async(&url).await.unwrap();
    assert!(tokio_tungstenite::connect_async(&url).await.is_err());

    problem(ticket(&guarded.view, "/api/v1/tokens").await, 403, "scope").await;
    for path in ["", "/", "/api/v1/nothing", "/api/v1/bench?x=1", "/api/v1/axes/e/home", "http://x/api/v1/bench"] {
        problem(ticket(&guarded.admin, path).await, 422, "invalid").await;
    }
    // A ticket opens nothing that changes something.
    let given: Value = ticket(&guarded.admin, "/api/v1/stop").await.json().await.unwrap();
    let path = given["href"].as_str().unwrap();
    let reset = guarded.daemon.request(Method::DELETE, path).send().await.unwrap();
    problem(reset, 401, "unauthorised").await;
}

#[tokio::test]
async fn a_view_token_cannot_push_out_others_sessions() {
    let guarded = Guarded::start().await;
    let status = |cookie: &str| {
        let request = guarded.daemon.request(Method::GET, "/api/v1/bench").header("cookie", cookie);
        async move { request.send().await.unwrap().status().as_u16() }
    };
    let (mine, _) = cookie(&guarded.sign_in(&guarded.control).await);
    let mut theirs = Vec::new();
    for _ in 0..1010 {
        theirs.push(cookie(&guarded.sign_in(&guarded.view).await).0);
    }
    assert_eq!(status(&mine).await, 200, "a session of another token is gone");
    assert_eq!(status(&theirs[0]).await, 401, "its own oldest goes");
    let kept = &theirs[theirs.len() - 32..];
    for (cookie, expected) in [(&theirs[theirs.len() - 33], 401), (&kept[0], 200), (&kept[31], 200)] {
        assert_eq!(status(cookie).await, expected);
    }
}

#[tokio::test]
async fn a_view_token_cannot_push_out_others_tickets() {
    let guarded = Guarded::start().await;
    let ticket = async |token: &str| -> String {
        let request = guarded.by(token, Method::POST, "/api/v1/tickets").json(&json!({ "path": "/api/v1/bench" }));
        let given: Value = request.send().await.unwrap().json().await.unwrap();
        given["href"].as_str().unwrap().to_owned()
    };
    let mine = ticket(&guarded.control).await;
    let mut theirs = Vec::new();
    for _ in 0..520 {
        theirs.push(ticket(&guarded.view).await);
    }
    assert_eq!(guarded.daemon.get(&mine).await.status(), 200, "a ticket of another token is gone");
    for (href, expected) in [(&theirs[0], 401), (&theirs[520 - 65], 401), (&theirs[520 - 64], 200), (&theirs[519], 200)]
    {
        assert_eq!(guarded.daemon.get(href).await.status(), expected);
    }
}

#[tokio::test]
async fn a_ticket_ends_with_its_token() {
    let guarded = Guarded::start().await;
    let request = guarded.by(&guarded.view, Method::POST, "/api/v1/tickets").json(&json!({ "path": "/api/v1/bench" }));
    let given: Value = request.send().await.unwrap().json().await.unwrap();
    let list = guarded.by(&guarded.admin, Method::GET, "/api/v1/tokens").send().await.unwrap();
    let list: Value = list.json().await.unwrap();
    let vera = list["tokens"][0]["href"].as_str().unwrap();
    assert_eq!(guarded.status(&guarded.admin, Method::DELETE, vera).await, 204);
    problem(guarded.daemon.get(given["href"].as_str().unwrap()).await, 401, "unauthorised").await;
}

#[tokio::test]
async fn a_view_token_has_ten_measurements_a_minute_kept_and_a_control_token_what_it_asks_for() {
    let guarded = Guarded::start().await;
    let measure = |token: &str| guarded.by(token, Method::POST, "/api/v1/measurements").json(&json!({})).send();
    for _ in 0..10 {
        // There is no white frame to measure by: what counts is the asking.
        problem(measure(&guarded.view).await.unwrap(), 409, "not-measurable").await;
    }
    let refused = measure(&guarded.view).await.unwrap();
    let wait: u64 = refused.headers()["retry-after"].to_str().unwrap().parse().unwrap();
    assert!((1..=6).contains(&wait), "{wait}");
    let refused = problem(refused, 429, "too-many-requests").await;
    for words in ["10 measurements a minute", "view", "control"] {
        assert!(refused["detail"].as_str().unwrap().contains(words), "{words}: {refused}");
    }
    assert_eq!(refused["retry_after_s"], wait);
    for _ in 0..20 {
        problem(measure(&guarded.control).await.unwrap(), 409, "not-measurable").await;
    }
    // Nothing else is held up by it.
    assert_eq!(guarded.status(&guarded.view, Method::GET, "/api/v1/measurements").await, 200);
}

#[tokio::test]
async fn what_a_proxy_says_counts_only_where_it_is_trusted() {
    let open = behind(Gate::new(settings(), TokenStore::in_memory(), Box::new(LogAudit))).await;
    for name in ["x-forwarded-for", "forwarded", "x-real-ip", "x-forwarded-host", "x-forwarded-proto"] {
        let request = open.request(Method::GET, "/api/v1/bench").header(name, "203.0.113.9");
        problem(request.send().await.unwrap(), 403, "untrusted-proxy").await;
    }

    let tokens = TokenStore::in_memory();
    let trusting = GateSettings {
        trusted_proxies: Networks::parse(["127.0.0.1"]).unwrap(),
        names: vec!["bench.example".to_owned()],
        ..settings()
    };
    let daemon = behind(Gate::new(trusting, tokens, Box::new(LogAudit))).await;
    // Behind a proxy everybody comes from this machine: nobody is let in for that.
    problem(daemon.get("/api/v1/bench").await, 401, "unauthorised").await;
    let through = |key: &str, origin: &str| {
        let request = daemon.request(Method::POST, "/api/v1/session").json(&json!({ "key": key }));
        let request = request.header("x-forwarded-for", "203.0.113.9").header("x-forwarded-proto", "https");
        request.header("x-forwarded-host", "bench.example").header("origin", origin).send()
    };
    problem(through("x", "http://bench.example").await.unwrap(), 403, "cross-origin").await;
    for _ in 0..10 {
        problem(through("x", "https://bench.example").await.unwrap(), 401, "unauthorised").await;
    }
    // It is the client behind the proxy that has guessed too often, not the proxy.
    problem(through("x", "https://bench.example").await.unwrap(), 429, "too-many-requests").await;
    problem(daemon.post("/api/v1/session", &json!({ "key": "x" })).await, 401, "unauthorised").await;
}

#[tokio::test]
async fn a_session_that_has_run_out_does_not_shut_an_open_door() {
    let open = behind(Gate::new(settings(), TokenStore::in_memory(), Box::new(LogAudit))).await;
    let name = format!("plenalign_session_{}", open.address.port());
    let request = open.request(Method::GET, "/api/v1/bench").header("cookie", format!("{name}=gone"));
    assert_eq!(request.send().await.unwrap().status(), 200);
}

/// The contract says of every operation what it needs.
#[test]
fn the_contract_says_what_is_needed() {
    let contract: Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let schemes = contract["components"]["securitySchemes"].as_object().unwrap();
    assert_eq!(schemes.keys().collect::<Vec<_>>(), ["session", "ticket", "token"]);
    let mut open = Vec::new();
    for (path, item) in contract["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            match operation["security"].as_array() {
                None => open.push(format!("{method} {path}")),
                Some(ways) => {
                    assert_eq!(ways.iter().any(|way| way.get("ticket").is_some()), method == "get", "{method} {path}");
                    let stranger = &operation["responses"]["401"]["content"]["application/problem+json"]["schema"];
                    assert_eq!(stranger["$ref"], "#/components/schemas/UnauthorisedProblem", "{method} {path}");
                }
            }
        }
    }
    assert_eq!(open, ["get /api/v1/docs", "post /api/v1/session", "get /healthz", "get /readyz"]);
    let scope = |path: &str, method: &str| contract["paths"][path][method]["security"][0]["token"][0].clone();
    assert_eq!(scope("/api/v1/stop", "post"), "view");
    assert_eq!(scope("/api/v1/stop", "delete"), "control");
    assert_eq!(scope("/api/v1/config", "put"), "admin");
}

/// One program's token is another's only through the file.
#[tokio::test]
async fn a_token_made_on_the_command_line_works_at_once_and_dies_soon() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = behind(Gate::new(settings(), TokenStore::open(folder.path()).unwrap(), Box::new(LogAudit))).await;
    assert_eq!(daemon.get("/api/v1/bench").await.status(), 200);
    let command_line = TokenStore::open(folder.path()).unwrap();
    let (secret, _) = command_line.create("Ana", Scope::View, None).unwrap();
    let ask = || daemon.request(Method::GET, "/api/v1/bench").bearer_auth(secret.reveal()).send();
    assert_eq!(ask().await.unwrap().status(), 200);
    problem(daemon.get("/api/v1/bench").await, 401, "unauthorised").await;
    command_line.revoke("Ana", None).unwrap();
    let dead = until("a revoked token opens nothing", async || ask().await.unwrap().status() != 200);
    assert!(tokio::time::timeout(std::time::Duration::from_secs(5), dead).await.is_ok(), "a revoked token still opens");
    let told = problem(ask().await.unwrap(), 401, "unauthorised").await;
    assert!(
        told["detail"].as_str().unwrap().contains("the token of Ana was revoked on the daemon's machine"),
        "{told}"
    );
    assert_eq!((&told["ended"]["how"], &told["ended"]["by"]), (&json!("revoked"), &Value::Null));
    // With the last token gone the door does not open for everybody.
    problem(daemon.get("/api/v1/bench").await, 401, "unauthorised").await;
}

/// Kept apart from the rest: it looks at everything that is logged.
#[tokio::test]
async fn no_secret_is_logged() {
    use std::io::Write;
    use std::sync::Mutex;
    #[derive(Clone, Default)]
    struct Log(Arc<Mutex<Vec<u8>>>);
    impl Write for Log {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let log = Log::default();
    let writer = log.clone();
    let subscriber = tracing_subscriber::fmt()
        .with_ansi(false)
        .with_max_level(tracing::Level::TRACE)
        .with_writer(move || writer.clone())
        .finish();
    // With one subscriber alone, a callsite that another test's thread comes to first would be off for good.
    let _another = tracing::Dispatch::new(tracing_subscriber::registry());
    // This test's runtime is one thread, so that all that happens in it is logged here.
    let _guard = tracing::subscriber::set_default(subscriber);
    let guarded = Guarded::start().await;
    let signed_in = guarded.sign_in(&guarded.admin).await;
    let (cookie, _) = cookie(&signed_in);
    let given = guarded.by(&guarded.view, Method::POST, "/api/v1/tickets").json(&json!({ "path": "/api/v1/bench" }));
    let given: Value = given.send().await.unwrap().json().await.unwrap();
    guarded.daemon.get(given["href"].as_str().unwrap()).await;
    guarded.daemon.get("/login?once=abcdefabcdef").await;
    let made = guarded.daemon.request(Method::POST, "/api/v1/tokens").header("cookie", &cookie);
    let made: Value = made.json(&json!({ "name": "Bo", "scope": "view" })).send().await.unwrap().json().await.unwrap();
    // What is done after an answer has been sent is logged after it, too.
    let logged = |log: &String| log.contains("path=\"/api/v1/bench\"") && log.contains("token.create");
    let log =
        until("it is logged", async || when(String::from_utf8(log.0.lock().unwrap().clone()).unwrap(), logged)).await;
    let bare = |secret: &Value| secret.as_str().unwrap().trim_start_matches("plenalign_").to_owned();
    for secret in [
        bare(&json!(guarded.admin)),
        bare(&json!(guarded.view)),
        bare(&made["secret"]),
        bare(&given["ticket"]),
        cookie.split('=').nth(1).unwrap().to_owned(),
        "abcdefabcdef".to_owned(),
    ] {
        // What the test's own client logs of its requests is not the daemon's.
        for line in log.lines().filter(|line| line.contains("plenalign::") || line.contains("tower_http")) {
            assert!(!line.contains(&secret), "{line}");
        }
    }
}
