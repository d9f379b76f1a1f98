//! `plenalign stop`: stops the bench of a running daemon.

use std::process::ExitCode;

use anyhow::Context as _;

use super::remote::{Daemon, RemoteArgs};
use crate::control::StopReport;
use crate::device::StopDelivery;

/// Arguments of `plenalign stop`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The daemon's address.
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:8080")]
    server: String,
    #[command(flatten)]
    remote: RemoteArgs,
    /// Print one JSON object instead of text: how far the stop got on each axis.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let report = runtime.block_on(async {
        let daemon = Daemon::new(&args.server, &args.remote)?;
        daemon.post::<StopReport>("/api/v1/stop").await
    })?;
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        println!("focus axis: {}", words(report.focus));
        println!("e axis: {}", words(report.e));
    }
    let delivered = ![report.focus, report.e].contains(&StopDelivery::Undeliverable);
    Ok(if delivered { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn words(delivery: StopDelivery) -> &'static str {
    match delivery {
        StopDelivery::Confirmed => "stopped",
        StopDelivery::Sent => "stop sent, not confirmed",
        StopDelivery::Undeliverable => "STOP NOT DELIVERABLE",
    }
}
