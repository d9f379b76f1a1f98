//! The configuration: in force, in its file, checked, written. What is written takes effect when the daemon starts
//! again: then the axes have to be homed, so that no position outlives a change of scale, limits or ports.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;

use crate::access::{AuditRecord, Digest, Principal, write_whole};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::JsonBody;
use crate::config::{Change, Config, ConfigError, ConfigOrigin, Forbidden, LOCKED};
use crate::control::events::BenchView;

/// The file of the configuration, as far as the API has to do with it.
pub(in crate::api) struct ConfigFile {
    path: Option<PathBuf>,
    /// What the file said when the daemon started, or would have said.
    at_start: Config,
    /// One writer at a time.
    writing: Mutex<()>,
}

/// What the file holds now.
struct Stored {
    /// Where its bytes are: where a link leads to.
    path: PathBuf,
    text: String,
    config: Config,
}

impl ConfigFile {
    pub(in crate::api) fn of(origin: &ConfigOrigin, in_force: &Config) -> Self {
        let path = origin.file().map(Path::to_owned);
        let at_start = path.as_deref().and_then(|path| Config::load(path).ok()).unwrap_or_else(|| in_force.clone());
        Self { path, at_start, writing: Mutex::default() }
    }

    fn read(&self) -> Result<Stored> {
        let Some(path) = &self.path else {
            return Err(Problem::no_config_file());
        };
        let unreadable = |why: &dyn std::fmt::Display| {
            Problem::config_unreadable(format!("{} cannot be used: {why}; mend it on the machine", path.display()))
        };
        let path = path.canonicalize().map_err(|error| unreadable(&error))?;
        let text = fs::read_to_string(&path).map_err(|error| unreadable(&error))?;
        let config = Config::from_toml(&text, &path.display().to_string()).map_err(|error| unreadable(&error))?;
        Ok(Stored { path, text, config })
    }

    /// Keys that take effect when the daemon starts again.
    fn pending(&self, stored: &Config) -> Vec<String> {
        keys(&self.at_start.changes(stored))
    }
}

/// Names a state of the file.
fn tag(text: &str) -> String {
    let digest = serde_json::to_value(Digest::of(text)).unwrap_or_default();
    format!("\"{}\"", digest.as_str().and_then(|hex| hex.get(..32)).unwrap_or_default())
}

fn keys(changes: &[Change]) -> Vec<String> {
    changes.iter().map(|change| change.key.clone()).collect()
}

/// The configuration in force and where it came from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct ConfigView {
    /// Where the design's numbers come from.
    pub(in crate::api) origin: String,
    /// The file read, if any.
    pub(in crate::api) file: Option<String>,
    /// The configuration in force: every key of the file with its value, defaults filled in, secrets redacted.
    pub(in crate::api) config: Value,
    /// What the file holds now, likewise: the base of a change. Absent where there is no file that can be read.
    pub(in crate::api) stored: Option<Value>,
    /// Why the file cannot be read now, in words; absent where it can, or there is none.
    pub(in crate::api) fault: Option<String>,
    /// Keys of the file that take effect when the daemon starts again.
    pub(in crate::api) restart_required: Vec<String>,
    /// Keys, with all below them, that are changed only on the machine itself.
    pub(in crate::api) locked: Vec<String>,
}

/// What may be a configuration.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct ConfigTried {
    /// Anything: the answer says what is wrong with it.
    pub(in crate::api) config: Value,
}

/// A configuration to be written.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct ConfigRequest {
    /// Every key of the file with its value, as `stored` has it; a key left out gets its default.
    pub(in crate::api) config: Value,
}

/// Something that is wrong with a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct ConfigFault {
    /// The key, dotted from the root.
    pub(in crate::api) key: String,
    /// What is wrong, and what would be right.
    pub(in crate::api) message: String,
}

/// What is wrong with a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct ConfigCheck {
    /// Whether it could be written.
    pub(in crate::api) valid: bool,
    /// Everything that is wrong.
    pub(in crate::api) problems: Vec<ConfigFault>,
    /// What is allowed and yet worth a word.
    pub(in crate::api) notices: Vec<String>,
}

/// What has been written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct ConfigWritten {
    /// The keys that have changed in the file.
    pub(in crate::api) changed: Vec<String>,
    /// Keys of the file that take effect when the daemon starts again; nothing takes effect before.
    pub(in crate::api) restart_required: Vec<String>,
    /// What is allowed and yet worth a word.
    pub(in crate::api) notices: Vec<String>,
}

/// The configuration in force, and what its file holds now.
///
/// `ETag` names the state of the file, for `If-Match` when it is written.
#[utoipa::path(
    get, path = "/api/v1/config", operation_id = "get_config", tag = "configuration",
    responses((status = 200, body = ConfigView, headers(("ETag" = String, description = "State of the file"))))
)]
pub(in crate::api) async fn get(State(app): State<App>) -> Result<Response> {
    let file = app.config.clone();
    let stored = blocking(move || file.read()).await?;
    let fault = stored.as_ref().err().filter(|_| app.origin.file().is_some()).map(|problem| problem.detail.clone());
    let stored = stored.ok();
    let redacted = |config: &Config| {
        config.redacted().map_err(|error| {
            tracing::error!(%error, "the configuration cannot be written as JSON");
            Problem::internal()
        })
    };
    let in_force = app.service.config();
    let view = ConfigView {
        origin: app.origin.describe(in_force),
        file: app.origin.file().map(|path| path.display().to_string()),
        config: redacted(in_force)?,
        stored: stored.as_ref().map(|stored| redacted(&stored.config)).transpose()?,
        fault,
        restart_required: stored.as_ref().map(|stored| app.config.pending(&stored.config)).unwrap_or_default(),
        locked: LOCKED.map(str::to_owned).to_vec(),
    };
    Ok(tagged(stored.map(|stored| tag(&stored.text)), Json(view)))
}

/// The JSON Schema of the configuration.
#[utoipa::path(
    get, path = "/api/v1/config/schema", operation_id = "get_config_schema", tag = "configuration",
    responses((status = 200, body = Object, content_type = "application/schema+json"))
)]
pub(in crate::api) async fn schema() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/schema+json")], Config::json_schema().to_string())
}

/// Checks a configuration without writing it.
#[utoipa::path(
    post, path = "/api/v1/config/validate", operation_id = "validate_config", tag = "configuration",
    request_body = ConfigTried, responses((status = 200, body = ConfigCheck))
)]
pub(in crate::api) async fn validate(
    State(app): State<App>,
    JsonBody(ConfigTried { config }): JsonBody<ConfigTried>,
) -> Result<Json<ConfigCheck>> {
    let file = app.config.clone();
    let base =
        blocking(move || file.read()).await?.map_or_else(|_| app.config.at_start.clone(), |stored| stored.config);
    let check = match accepted(&config, &base) {
        Ok((after, _)) => ConfigCheck { valid: true, problems: Vec::new(), notices: after.notices() },
        Err(problems) => ConfigCheck { valid: false, problems, notices: Vec::new() },
    };
    Ok(Json(check))
}

/// Writes the configuration's file, keeping its comments.
///
/// Refused while the bench moves or a job holds it. Nothing takes effect before the daemon starts again. `If-Match` has
/// to carry the `ETag` of the state that was changed: `*`, which is any state, is not enough.
#[utoipa::path(
    put, path = "/api/v1/config", operation_id = "put_config", tag = "configuration", request_body = ConfigRequest,
    params(("If-Match" = String, Header, pattern = "^\"[0-9a-f]{32}\"$",
        description = "`ETag` of the state that was changed")),
    responses(
        (status = 200, body = ConfigWritten, headers(("ETag" = String, description = "State of the file now"))),
        (status = 409, description = "There is no file, or not now", body = Problem,
         content_type = "application/problem+json"),
        (status = 412, description = "The file has changed since", body = Problem,
         content_type = "application/problem+json"),
        (status = 428, description = "If-Match names no state", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "It cannot be kept", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn put(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    headers: HeaderMap,
    JsonBody(ConfigRequest { config }): JsonBody<ConfigRequest>,
) -> Result<Response> {
    let file = app.config.clone();
    let state = headers.get(header::IF_MATCH).map(|tag| tag.to_str().unwrap_or("?").to_owned());
    let service = app.service.clone();
    let written = blocking(move || file.write(state.as_deref(), &config, || idle(&service.bench_view()))).await??;
    let Written { after, changes, text } = written;
    let restart_required = app.config.pending(&after);
    if !changes.is_empty() {
        let detail: Vec<Value> =
            changes.iter().map(|change| json!({ "key": change.key, "from": change.from, "to": change.to })).collect();
        app.gate.audit(AuditRecord::of(&principal, "config.write", json!({ "changes": detail })));
    }
    let view = ConfigWritten { changed: keys(&changes), restart_required, notices: after.notices() };
    Ok(tagged(Some(tag(&text)), Json(view)))
}

/// What has become of the file.
struct Written {
    after: Config,
    changes: Vec<Change>,
    text: String,
}

impl ConfigFile {
    /// Writes the file, if it is in the state named and nothing speaks against it. Does blocking I/O.
    fn write(&self, state: Option<&str>, asked: &Value, idle: impl FnOnce() -> Result<()>) -> Result<Written> {
        let _one = self.writing.lock();
        let stored = self.read()?;
        let now = tag(&stored.text);
        let mut states = state.into_iter().flat_map(|states| states.split(',')).map(str::trim).peekable();
        if states.peek().is_none_or(|state| *state == "*") {
            return Err(Problem::if_match_missing(&now));
        }
        if states.all(|state| state != now) {
            return Err(Problem::config_changed(&now));
        }
        let (after, changes) = accepted(asked, &stored.config).map_err(|faults| refused(&faults))?;
        if changes.is_empty() {
            return Ok(Written { after, changes, text: stored.text });
        }
        idle()?;
        let text = stored
            .config
            .edited(&stored.text, &after)
            .map_err(|error| Problem::config_unreadable(error.to_string()))?;
        let kept =
            |error: std::io::Error| Problem::not_kept(format!("cannot write {}: {error}", stored.path.display()));
        let mode = fs::metadata(&stored.path).map_err(kept)?.permissions().mode() & 0o777;
        write_whole(&stored.path, text.as_bytes(), mode).map_err(kept)?;
        Ok(Written { after, changes, text })
    }
}

/// A configuration asked for and what it changes, or everything that is wrong with it.
fn accepted(asked: &Value, base: &Config) -> std::result::Result<(Config, Vec<Change>), Vec<ConfigFault>> {
    let after = Config::from_json(asked, base).map_err(|error| faults(&error))?;
    let changes = base.changes(&after);
    let forbidden: Vec<ConfigFault> = changes.iter().filter_map(forbidden).collect();
    if forbidden.is_empty() { Ok((after, changes)) } else { Err(forbidden) }
}

fn faults(error: &ConfigError) -> Vec<ConfigFault> {
    let faults = error.violations().iter();
    let mut faults: Vec<_> =
        faults.map(|fault| ConfigFault { key: fault.key.clone(), message: fault.message.clone() }).collect();
    if faults.is_empty() {
        faults.push(ConfigFault { key: "config".to_owned(), message: error.to_string() });
    }
    faults
}

fn forbidden(change: &Change) -> Option<ConfigFault> {
    let message = match change.check_from_afar().err()? {
        Forbidden::Locked => "is locked: change it in the file, on the machine itself",
        Forbidden::NoDevice => "has to name a device: a path below /dev, usb: and a serial number, or card: and a name",
    };
    Some(ConfigFault { key: change.key.clone(), message: message.to_owned() })
}

/// Locked keys are not allowed, whatever their values; the rest does not fit.
fn refused(faults: &[ConfigFault]) -> Problem {
    let locked = |fault: &ConfigFault| LOCKED.iter().any(|key| fault.key.starts_with(key));
    if faults.iter().any(|fault| locked(fault) && fault.message.starts_with("is locked")) {
        return Problem::config_locked(json!(faults));
    }
    Problem::config_invalid(json!(faults))
}

fn idle(bench: &BenchView) -> Result<()> {
    use crate::control::Refusal;
    if let Some(job) = bench.job {
        return Err(Refusal::Busy { job }.into());
    }
    match bench.axes.iter().find(|axis| axis.moving) {
        Some(axis) => Err(Refusal::Moving { axis: axis.axis }.into()),
        None => Ok(()),
    }
}

fn tagged(tag: Option<String>, body: impl IntoResponse) -> Response {
    let mut response = body.into_response();
    if let Some(tag) = tag.and_then(|tag| HeaderValue::from_str(&tag).ok()) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// Runs what waits for a disk where that is allowed.
async fn blocking<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Result<T> {
    tokio::task::spawn_blocking(work).await.map_err(|_| Problem::internal())
}
