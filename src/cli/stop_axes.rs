//! `plenalign stop-axes`: stops the configured axes straight over their ports, with no daemon: what a service manager runs
//! when the daemon has died.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;

use super::Context;
use super::lock::BenchLock;
use crate::config::BenchDriver;
use crate::device::open::open_stages;
use crate::device::{AxisName, StopDelivery};

/// Longest wait for one axis's answer.
const ALLOWED: Duration = Duration::from_secs(5);

/// Arguments of `plenalign stop-axes`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    if context.config.bench.driver == BenchDriver::Simulated {
        println!("the configured bench is SIMULATED: there is no axis to stop");
        return Ok(ExitCode::SUCCESS);
    }
    // Whoever holds the bench holds its ports, too. A state folder that cannot be written is no reason not to stop.
    let _lock = match BenchLock::take(&context.config.bench) {
        Ok(lock) => Some(lock),
        Err(error) if error.to_string().contains("another process drives this bench") => {
            return Err(error.context("the axes are the running daemon's to stop: plenalign stop --server URL"));
        }
        Err(error) => {
            eprintln!("plenalign: {error}; stopping all the same");
            None
        }
    };
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let delivered = runtime.block_on(async {
        // Opening a controller stops it already; this asks it to say so.
        let (focus, e) = open_stages(&context.config.bench).await?;
        let stop = |stage: std::sync::Arc<dyn crate::device::Stage>| async move {
            tokio::time::timeout(ALLOWED, stage.stop()).await.unwrap_or(StopDelivery::Undeliverable)
        };
        anyhow::Ok(tokio::join!(stop(focus), stop(e)))
    });
    runtime.shutdown_background();
    let (focus, e) = delivered?;
    if args.json {
        println!("{}", serde_json::json!({ "focus": focus, "e": e }));
    } else {
        for (axis, delivery) in [(AxisName::Focus, focus), (AxisName::E, e)] {
            println!("{axis} axis: {}", words(delivery));
        }
    }
    let stopped = focus == StopDelivery::Confirmed && e == StopDelivery::Confirmed;
    Ok(if stopped { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn words(delivery: StopDelivery) -> &'static str {
    match delivery {
        StopDelivery::Confirmed => "stopped, and the controller says that it stands still",
        StopDelivery::Sent => "the stop was sent; no confirmation came",
        StopDelivery::Undeliverable => "the stop could NOT be sent: use the hardware stop",
    }
}
