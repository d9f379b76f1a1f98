//! Where the log goes: to standard error, or to the journal where that is what standard error leads to; and spans of
//! requests and jobs to a collector, where the environment names one.

use std::os::fd::AsFd;
use std::time::Duration;

use async_trait::async_trait;
use axum::body::Bytes;
use axum::http::{Request, Response};
use nix::sys::stat::fstat;
use opentelemetry::KeyValue;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_http::{HttpClient, HttpError};
use opentelemetry_otlp::{SpanExporter, WithHttpConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tokio::runtime::Runtime;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::{EnvFilter, Targets};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{Layer as _, fmt};

use crate::api::server::use_ring;

/// Each of these switches the export on: the collector's address, for everything or for spans.
const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"];
/// A collector that does not answer for so long has not got it.
const ALLOWED: Duration = Duration::from_secs(10);
/// How long the last spans may take at the program's end.
const FLUSH: Duration = Duration::from_secs(1);

/// The log, for as long as the program runs: what has yet to be sent is sent when this is dropped.
pub(super) struct Logging {
    spans: Option<Spans>,
}

/// Spans on their way to a collector.
struct Spans {
    provider: SdkTracerProvider,
    /// Sends them: the program's own runtime may be stuck, or not there.
    _runtime: Runtime,
}

/// Starts logging: only warnings, unless `RUST_LOG` asks for more.
pub(super) fn start() -> Logging {
    let wanted = || EnvFilter::try_from_default_env().unwrap_or_else(|_| "warn".into());
    let stream = std::env::var("JOURNAL_STREAM").unwrap_or_default();
    // A journal that cannot be reached still reads standard error.
    let journal = leads_to(&stream, std::io::stderr()).then(tracing_journald::layer).and_then(Result::ok);
    let text = journal.is_none().then(|| fmt::layer().with_writer(std::io::stderr));
    let mut failed = None;
    let spans = is_wanted().then(Spans::start).and_then(|started| started.map_err(|error| failed = Some(error)).ok());
    let export = spans.as_ref().map(|spans| {
        let layer = tracing_opentelemetry::layer().with_tracer(spans.provider.tracer("plenalign"));
        layer.with_filter(Targets::new().with_target("plenalign", LevelFilter::DEBUG))
    });
    tracing_subscriber::registry()
        .with(journal.map(|journal| journal.with_filter(wanted())))
        .with(text.map(|text| text.with_filter(wanted())))
        .with(export)
        .init();
    if let Some(error) = failed {
        tracing::warn!(%error, "no spans are exported");
    }
    Logging { spans }
}

impl Drop for Logging {
    fn drop(&mut self) {
        if let Some(spans) = &self.spans
            && let Err(error) = spans.provider.shutdown_with_timeout(FLUSH)
        {
            tracing::warn!(%error, "the last spans were not exported");
        }
    }
}

/// Whether a stream is the one that `JOURNAL_STREAM` names, by device and inode: what a service manager has set, and
/// what has been handed on to a program whose standard error leads elsewhere, is told apart.
fn leads_to(journal: &str, stream: impl AsFd) -> bool {
    let named = journal.split_once(':').and_then(|(device, inode)| Some((device.parse().ok()?, inode.parse().ok()?)));
    let Ok(found) = fstat(stream.as_fd()) else { return false };
    named == Some((found.st_dev, found.st_ino))
}

fn is_wanted() -> bool {
    let set = |name: &str| std::env::var(name).is_ok_and(|value| !value.is_empty());
    ENDPOINTS.into_iter().any(set) && std::env::var("OTEL_SDK_DISABLED").as_deref() != Ok("true")
}

impl Spans {
    fn start() -> anyhow::Result<Self> {
        use_ring();
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let sender =
            Sender { runtime: runtime.handle().clone(), client: reqwest::Client::builder().timeout(ALLOWED).build()? };
        let exporter = SpanExporter::builder().with_http().with_http_client(sender).build()?;
        let mut resource =
            Resource::builder().with_attribute(KeyValue::new("service.version", env!("CARGO_PKG_VERSION")));
        if std::env::var_os("OTEL_SERVICE_NAME").is_none() {
            resource = resource.with_service_name("plenalign");
        }
        let provider =
            SdkTracerProvider::builder().with_resource(resource.build()).with_batch_exporter(exporter).build();
        Ok(Self { provider, _runtime: runtime })
    }
}

/// Sends spans with the HTTP client and the cryptography that the rest of the program has.
#[derive(Debug)]
struct Sender {
    runtime: tokio::runtime::Handle,
    client: reqwest::Client,
}

#[async_trait]
impl HttpClient for Sender {
    async fn send_bytes(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let (request, client) = (reqwest::Request::try_from(request)?, self.client.clone());
        let sent = self.runtime.spawn(async move {
            let answer = client.execute(request).await?;
            let (status, headers) = (answer.status(), answer.headers().clone());
            Ok::<_, reqwest::Error>((status, headers, answer.bytes().await?))
        });
        let (status, headers, body) = sent.await??;
        let mut response = Response::new(body);
        *response.status_mut() = status;
        *response.headers_mut() = headers;
        Ok(response)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_stream_that_is_named_leads_to_the_journal() {
        let (one, other) = (tempfile::tempfile().unwrap(), tempfile::tempfile().unwrap());
        let found = fstat(one.as_fd()).unwrap();
        let name = format!("{}:{}", found.st_dev, found.st_ino);
        assert!(leads_to(&name, &one));
        assert!(!leads_to(&name, &other));
        for name in ["", "7", "a:b", &format!("{}:", found.st_dev), &format!("{}:{}", found.st_ino, found.st_dev)] {
            assert!(!leads_to(name, &one), "{name}");
        }
    }
}
