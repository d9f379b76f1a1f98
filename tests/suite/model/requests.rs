//! Who asks for what, and how that is said over HTTP: the one file to change where the API does.

use plenalign::access::Scope;
use plenalign::api::error::{CONFIRM_HEADER, LEASE_HEADER};
use plenalign::device::AxisName;
use reqwest::Method;
use serde_json::{Value, json};

/// Whoever asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Who {
    Vera,
    Cleo,
    Carl,
    Root,
    /// With a token that opens nothing.
    Guesser,
    /// Without a token.
    Nobody,
}

impl Who {
    /// Those who have a token.
    pub(super) const KNOWN: [Self; 4] = [Self::Vera, Self::Cleo, Self::Carl, Self::Root];
    /// All.
    pub(super) const ALL: [Self; 6] = [Self::Vera, Self::Cleo, Self::Carl, Self::Root, Self::Guesser, Self::Nobody];

    pub(super) const fn scope(self) -> Option<Scope> {
        match self {
            Self::Vera => Some(Scope::View),
            Self::Cleo | Self::Carl => Some(Scope::Control),
            Self::Root => Some(Scope::Admin),
            Self::Guesser | Self::Nobody => None,
        }
    }

    pub(super) fn name(self) -> String {
        format!("{self:?}")
    }
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Ask {
    Move {
        axis: AxisName,
        mm: f64,
    },
    Home(AxisName),
    Jog {
        axis: AxisName,
        towards: &'static str,
        press: Option<String>,
    },
    EndJog(AxisName),
    Shell(&'static str),
    Stop,
    Reset {
        why: bool,
    },
    Take {
        ttl_s: f64,
    },
    Renew,
    Release,
    TakeOver {
        ttl_s: f64,
    },
    Job(Kind),
    Cancel {
        job: String,
    },
    Confirm {
        job: String,
        step: u64,
    },
    /// Another confirm key for a job.
    NewKey {
        job: String,
    },
    ReadStop,
    ReadLease,
    ReadAudit,
    ReadTokens,
}

/// The keys that a request shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Shown {
    /// As a lease's.
    pub(super) lease: Option<String>,
    /// As a confirm key.
    pub(super) confirm: Option<String>,
}

/// A job to start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    HomeBoth,
    HomeOne(AxisName),
    /// Waits for the operator once or twice, then moves an axis step by step.
    Sweep(AxisName),
    /// Homes what is not homed, then waits for the operator.
    Alignment,
}

impl Ask {
    /// Whether what is asked for moves an axis.
    pub(super) const fn moves(&self) -> bool {
        matches!(self, Self::Move { .. } | Self::Home(_) | Self::Jog { .. } | Self::Job(_))
    }

    /// Whether it needs the key of a lease, whoever asks.
    pub(super) const fn needs_lease(&self) -> bool {
        self.moves() || matches!(self, Self::Shell(_) | Self::Renew)
    }

    /// The scope that it needs.
    pub(super) const fn needs(&self) -> Scope {
        match self {
            Self::Stop | Self::ReadStop | Self::ReadLease => Scope::View,
            Self::TakeOver { .. } | Self::ReadAudit | Self::ReadTokens => Scope::Admin,
            _ => Scope::Control,
        }
    }

    /// Method, path and body.
    pub(super) fn on_the_wire(&self, who: Who) -> (Method, String, Value) {
        let of_axis = |axis: &AxisName, what: &str| format!("/api/v1/axes/{axis}/{what}");
        let none = Value::Null;
        let owner = |ttl_s: f64| json!({ "owner": who.name(), "note": "a model's", "ttl_s": ttl_s });
        match self {
            Self::Move { axis, mm } => (Method::POST, of_axis(axis, "move"), json!({ "position_mm": mm })),
            Self::Home(axis) => (Method::POST, of_axis(axis, "home"), none),
            Self::Jog { axis, towards, press } => {
                (Method::POST, of_axis(axis, "jog"), json!({ "towards": towards, "press": press }))
            }
            Self::EndJog(axis) => (Method::DELETE, of_axis(axis, "jog"), none),
            Self::Shell(state) => (Method::PUT, "/api/v1/shell".to_owned(), json!({ "state": state })),
            Self::Stop => (Method::POST, "/api/v1/stop".to_owned(), none),
            Self::Reset { why } => {
                let body = if *why { json!({ "why": "hands are out of the bench" }) } else { none };
                (Method::DELETE, "/api/v1/stop".to_owned(), body)
            }
            Self::Take { ttl_s } => (Method::POST, "/api/v1/lease".to_owned(), owner(*ttl_s)),
            Self::Renew => (Method::POST, "/api/v1/lease/heartbeat".to_owned(), none),
            Self::Release => (Method::DELETE, "/api/v1/lease".to_owned(), none),
            Self::TakeOver { ttl_s } => (Method::POST, "/api/v1/lease/takeover".to_owned(), owner(*ttl_s)),
            Self::Job(kind) => (Method::POST, "/api/v1/jobs".to_owned(), kind.body()),
            Self::Cancel { job } => (Method::DELETE, format!("/api/v1/jobs/{job}"), none),
            Self::Confirm { job, step } => {
                (Method::POST, format!("/api/v1/jobs/{job}/confirm"), json!({ "step": step }))
            }
            Self::NewKey { job } => (Method::POST, format!("/api/v1/jobs/{job}/confirm-key"), none),
            Self::ReadStop => (Method::GET, "/api/v1/stop".to_owned(), none),
            Self::ReadLease => (Method::GET, "/api/v1/lease".to_owned(), none),
            Self::ReadAudit => (Method::GET, "/api/v1/audit?limit=20".to_owned(), none),
            Self::ReadTokens => (Method::GET, "/api/v1/tokens".to_owned(), none),
        }
    }
}

impl Kind {
    fn body(self) -> Value {
        match self {
            Self::HomeBoth => json!({ "kind": "homing" }),
            Self::HomeOne(axis) => json!({ "kind": "homing", "axes": [axis.name()] }),
            Self::Sweep(axis) => {
                let (from_mm, to_mm) = if axis == AxisName::E { (18.0, 26.0) } else { (0.5, 3.0) };
                json!({ "kind": "focus_sweep", "axis": axis.name(), "from_mm": from_mm, "to_mm": to_mm, "steps": 3 })
            }
            Self::Alignment => json!({ "kind": "joint_alignment" }),
        }
    }
}

/// An answer.
#[derive(Debug, Clone)]
pub(super) struct Answer {
    pub(super) status: u16,
    pub(super) text: String,
    pub(super) body: Value,
}

impl Answer {
    pub(super) const fn accepted(&self) -> bool {
        matches!(self.status, 200..=299)
    }

    /// The kind of problem, where it is one.
    pub(super) fn problem(&self) -> &str {
        let kind = self.body["type"].as_str().unwrap_or_default();
        kind.strip_prefix("urn:plenalign:problem:").unwrap_or(kind)
    }
}

/// Sends a request and reads its answer.
pub(super) async fn send(
    client: &reqwest::Client,
    base: &str,
    token: Option<&str>,
    shown: &Shown,
    (method, path, body): (Method, String, Value),
) -> Answer {
    let mut request = client.request(method, format!("{base}{path}"));
    if let Some(token) = token {
        request = request.bearer_auth(token);
    }
    for (header, key) in [(LEASE_HEADER, &shown.lease), (CONFIRM_HEADER, &shown.confirm)] {
        if let Some(key) = key {
            request = request.header(header, key);
        }
    }
    if !body.is_null() {
        request = request.json(&body);
    }
    let response = request.send().await.unwrap();
    let status = response.status().as_u16();
    let text = response.text().await.unwrap();
    let body = serde_json::from_str(&text).unwrap_or(Value::Null);
    Answer { status, text, body }
}
