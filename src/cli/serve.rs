//! `plenalign serve`: configuration to bench to service to API, until a signal.

use std::io::Write as _;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::alpaca::{Prepared, Serving};
use super::announce::Announcement;
use super::faults::{self, FaultArgs};
use super::listen::{Exposure, bind};
use super::lock::BenchLock;
use super::remote::{RemoteArgs, host_name};
use super::{Context, open_files, supervised};
use crate::access::{Gate, TokenStore};
use crate::api::foxglove::Bridge;
use crate::api::server::Connections;
use crate::api::{Api, IN_RESERVE};
use crate::config::BenchDriver;
use crate::control::service::history::HistoryAudit;
use crate::control::{Service, open_bench};
use crate::fleet::{Fleet, Prepared as FleetPrepared};
use crate::jpeg::Encoder;
use crate::state_folder::{mend, state_folder};
use crate::store::Store;
use crate::telemetry;

/// Where the daemon serves unless told otherwise.
pub(super) const DEFAULT_ADDRESS: &str = "127.0.0.1:8080";
/// Between the first signal and the end of what is orderly, whatever hangs. With [`LEFT_OVER`] less than the 5 s that
/// are promised; each part is bounded by itself, to less.
const SHUTDOWN: Duration = Duration::from_millis(4_250);
/// How long a thread that hangs may hold up the end of the process.
const LEFT_OVER: Duration = Duration::from_millis(250);
/// Exit code after a second signal: 128 and the number of SIGINT, as shells have it.
const INTERRUPTED: i32 = 130;

/// Arguments of `plenalign serve`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Address to listen on. Beyond loopback a token and TLS are demanded: see `plenalign token` and `plenalign tls`.
    #[arg(long, value_name = "ADDR", default_value = DEFAULT_ADDRESS)]
    listen: String,
    /// Serve beyond loopback without TLS: tokens and pictures can be read on the way.
    #[arg(long)]
    insecure: bool,
    /// Use the simulated bench, whatever the configuration says.
    #[arg(long)]
    simulated: bool,
    #[command(flatten)]
    faults: FaultArgs,
    /// Print one JSON object instead of text once it serves: `address`, `simulated`, and `alpaca` and `foxglove`, where
    /// these are spoken.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let code = runtime.block_on(serve(context, args));
    // A blocking task that hangs must not hold the end up.
    runtime.shutdown_timeout(LEFT_OVER);
    code
}

async fn serve(mut context: Context, args: Args) -> anyhow::Result<ExitCode> {
    if args.simulated {
        context.config.bench.driver = BenchDriver::Simulated;
    }
    let plan = args.faults.read()?;
    // Signals are taken from here on, so that none in the next lines ends the program with a bench half open.
    let mut signals = Signals::new()?;
    let mut server = Server::start(context, &args.listen, args.insecure).await?;
    faults::put_in_force(&server.service, plan)?;
    let watchdog = supervised::serving(&server.service, &server.api);
    say_address(&server, args.json);
    server.offer_key(!args.json)?;
    tokio::select! {
        () = signals.next() => {}
        ended = &mut server.task => {
            server.service.shut_down().await;
            ended.context("the server ended")?;
            return Err(anyhow!("the server ended by itself"));
        }
    }
    supervised::stopping();
    // Ending is bounded by itself.
    watchdog.inspect(tokio::task::JoinHandle::abort);
    server.shut_down(&mut signals).await;
    Ok(ExitCode::SUCCESS)
}

/// The signals that end the program.
pub(super) struct Signals {
    terminate: Signal,
    interrupt: Signal,
}

impl Signals {
    /// Takes the signals over from the system's default.
    pub(super) fn new() -> anyhow::Result<Self> {
        Ok(Self { terminate: signal(SignalKind::terminate())?, interrupt: signal(SignalKind::interrupt())? })
    }

    /// The next one.
    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = self.terminate.recv() => {}
            _ = self.interrupt.recv() => {}
        }
    }
}

/// A daemon that serves: its bench is this process's until it is dropped.
pub(super) struct Server {
    /// Where it serves.
    pub(super) address: SocketAddr,
    /// Whether its bench is simulated.
    pub(super) simulated: bool,
    service: Arc<Service>,
    api: Api,
    gate: Arc<Gate>,
    exposure: Exposure,
    task: JoinHandle<()>,
    announcement: Option<Announcement>,
    alpaca: Option<Serving>,
    /// The bridge for Foxglove, where one is configured.
    bridge: Option<Bridge>,
    /// What is published over MQTT, where a broker is configured.
    fleet: Option<Fleet>,
    _lock: BenchLock,
}

impl Server {
    /// Takes port and bench, and serves. Beyond loopback only with TLS, unless `insecure`.
    pub(super) async fn start(context: Context, address: &str, insecure: bool) -> anyhow::Result<Self> {
        // The port first: where it is taken, another daemon may well have the bench.
        let listener = bind(address).await?;
        let address = listener.local_addr()?;
        let config = Arc::new(context.config);
        let state = state_folder()?;
        mend(&state);
        let mut exposure = Exposure::decide(&config.server, address, &state, insecure)?;
        exposure.server.connections = open_files::connections_for(exposure.server.connections)?;
        let alpaca = Prepared::take(&config.alpaca, &state, insecure).await?;
        let fleet = FleetPrepared::read(&config.mqtt, host_name().as_deref(), insecure).map_err(|why| anyhow!(why))?;
        let lock = BenchLock::take(&config.bench)?;
        let tokens = TokenStore::open(&state).context("the tokens cannot be read")?;
        let store = Store::open(&state);
        let bench = open_bench(&config).await.context("the bench cannot be opened")?;
        let simulated = bench.is_simulated();
        let service = Service::start(Arc::clone(&config), context.origin.describe(&config), bench, store);
        service.open_history().await;
        let audit = Box::new(HistoryAudit(Arc::clone(&service)));
        let gate = Arc::new(Gate::new(exposure.gate.clone(), tokens, audit));
        // A second server in one process would count into the first one's metrics.
        let metrics = telemetry::install().inspect_err(|error| tracing::warn!(%error, "no metrics are kept")).ok();
        metrics.clone().map(|kept| tokio::spawn(telemetry::keep_up(kept)));
        let encoder = Encoder::here().name();
        telemetry::picture_encoder(encoder);
        tracing::info!(encoder, "pictures for viewers");
        let api = Api::new(Arc::clone(&service), Arc::clone(&gate), address, context.origin).with_metrics(metrics);
        let connections = Connections::new(exposure.server.clone());
        let task = tokio::spawn(connections.clone().serve(listener, api.router(), IN_RESERVE, api.closing()));
        let alpaca = match alpaca {
            Some(prepared) => {
                let (service, gate) = (Arc::clone(&service), Arc::clone(&gate));
                Some(prepared.serve(service, gate, &connections, api.closing()).await)
            }
            None => None,
        };
        let fleet = fleet.map(|fleet| fleet.start(&service, api.boot_id()));
        let bridge = api.bridge(&connections).await.map_err(|why| anyhow!(why))?;
        let announcement =
            if config.server.mdns { announce(address, exposure.server.tls.is_some(), simulated) } else { None };
        Ok(Self {
            address,
            simulated,
            service,
            api,
            gate,
            exposure,
            task,
            announcement,
            alpaca,
            bridge,
            fleet,
            _lock: lock,
        })
    }

    /// Where it is reached, without a slash at the end.
    pub(super) fn url(&self) -> String {
        self.exposure.url(self.address)
    }

    /// Where a token is demanded and there is none, makes the key with which the first person gets in: on a terminal
    /// it is shown, elsewhere it is put into a file that only this user can read.
    pub(super) fn offer_key(&self, may_print: bool) -> anyhow::Result<()> {
        super::listen::offer_key(&self.gate, &self.url(), may_print)
    }

    /// How this program's own client says who it is.
    pub(super) fn own_client(&self) -> RemoteArgs {
        RemoteArgs {
            token: self.gate.own_token().map(|secret| secret.reveal().to_owned()),
            ca: self.exposure.ca.clone(),
        }
    }

    /// Ends it: axes and job first, then the streams while the history is written to its end. A second signal ends the
    /// program at once.
    pub(super) async fn shut_down(mut self, signals: &mut Signals) {
        tracing::info!("stopping: axes first, then the streams");
        let orderly = async {
            self.service.come_to_rest().await;
            let (announcement, alpaca, fleet) = (self.announcement.take(), self.alpaca.take(), self.fleet.take());
            tokio::join!(
                self.service.end(),
                async {
                    self.api.close().await;
                    tracing::info!("streams closed");
                    let _ = (&mut self.task).await;
                    if let Some(alpaca) = alpaca {
                        alpaca.end().await;
                    }
                },
                async {
                    if let Some(fleet) = fleet {
                        fleet.close("the program ended").await;
                    }
                },
                async {
                    if let Some(bridge) = &self.bridge {
                        bridge.close().await;
                    }
                },
                async {
                    let _ = tokio::task::spawn_blocking(move || drop(announcement)).await;
                },
            );
        };
        tokio::select! {
            ended = timeout(SHUTDOWN, orderly) => if ended.is_err() {
                tracing::warn!("connections were still open when the time was up");
            },
            () = signals.next() => std::process::exit(INTERRUPTED),
        }
    }
}

/// Announces the daemon; it serves all the same where that fails.
fn announce(address: SocketAddr, tls: bool, simulated: bool) -> Option<Announcement> {
    match Announcement::start(address, tls, simulated) {
        Ok(Some(announcement)) => Some(announcement),
        Ok(None) => {
            tracing::warn!(%address, "server.mdns: not announced, since nobody else reaches loopback");
            None
        }
        Err(error) => {
            tracing::warn!(error = format!("{error:#}"), "server.mdns: the daemon is not announced");
            None
        }
    }
}

fn say_address(server: &Server, json: bool) {
    let (url, simulated) = (format!("{}/", server.url()), server.simulated);
    let bridge = server.bridge.as_ref().map(|bridge| format!("ws://{}", bridge.address()));
    if json {
        let mut said = serde_json::json!({ "address": url, "simulated": simulated });
        if let Some(alpaca) = &server.alpaca {
            said["alpaca"] = alpaca.address.to_string().into();
        }
        if let Some(bridge) = bridge {
            said["foxglove"] = bridge.into();
        }
        println!("{said}");
    } else {
        let bench = if simulated { "SIMULATED bench" } else { "bench" };
        println!("plenalign: {bench} at {url}");
        if let Some(alpaca) = &server.alpaca {
            println!("plenalign: ASCOM Alpaca at {}", alpaca.address);
        }
        if let Some(bridge) = bridge {
            println!("plenalign: for Foxglove and Lichtblick at {bridge}");
        }
    }
    let _ = std::io::stdout().flush();
    tracing::info!(address = %server.address, simulated, "serving");
}
