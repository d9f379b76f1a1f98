//! `plenalign stop`: stops the bench of a running daemon, or resets its stop.

use std::process::ExitCode;

use anyhow::Context as _;

use super::remote::{Daemon, RemoteArgs, user_and_machine};
use crate::api::types::ResetRequest;
use crate::control::StopReport;
use crate::control::events::StopView;
use crate::device::StopDelivery;

/// Arguments of `plenalign stop`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The daemon's address.
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:8080")]
    server: String,
    #[command(flatten)]
    remote: RemoteArgs,
    /// Reset the stop instead, and say why; nothing moves by it.
    #[arg(long, value_name = "WHY")]
    reset: Option<String>,
    /// Print one JSON object instead of text: how far the stop got on each axis, or the stop after its reset.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    if let Some(why) = &args.reset {
        return runtime.block_on(reset(args, why));
    }
    let report = runtime.block_on(async {
        let daemon = Daemon::new(&args.server, &args.remote)?;
        daemon.post::<StopReport>("/api/v1/stop", &[("owner", user_and_machine())]).await
    })?;
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        println!("focus axis: {}", report.focus);
        println!("e axis: {}", report.e);
        if !report.kept {
            println!("not on the disk yet: a restart now would not know of it");
        }
    }
    let delivered = ![report.focus, report.e].contains(&StopDelivery::Undeliverable);
    Ok(if delivered { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn reset(args: &Args, why: &str) -> anyhow::Result<ExitCode> {
    let daemon = Daemon::new(&args.server, &args.remote)?;
    let asked = ResetRequest { why: why.to_owned(), owner: Some(user_and_machine()) };
    let stop: StopView = daemon.delete("/api/v1/stop", &asked).await?;
    if args.json {
        println!("{}", serde_json::to_string(&stop)?);
    } else if stop.latched {
        println!("STOPPED again meanwhile by {}", stop.by.as_deref().unwrap_or("somebody"));
    } else {
        println!("motion is allowed again");
    }
    Ok(if stop.latched { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
