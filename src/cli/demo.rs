//! `plenalign demo`: what `make run` runs. Serves the simulated bench, aligns it through the daemon's own API, prints
//! the report and the page's address, and keeps serving.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;

use super::serve::{DEFAULT_ADDRESS, Server, Signals};
use super::{Context, remote, report};
use crate::config::BenchDriver;
use crate::control::job::JobState;

/// Arguments of `plenalign demo`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Address to serve at.
    #[arg(long, value_name = "ADDR", default_value = DEFAULT_ADDRESS)]
    listen: String,
    /// Serve beyond loopback without TLS: whoever is on the network can read along.
    #[arg(long)]
    insecure: bool,
    /// End after the report.
    #[arg(long)]
    once: bool,
}

pub(super) fn run(mut context: Context, args: Args) -> anyhow::Result<ExitCode> {
    context.config.bench.driver = BenchDriver::Simulated;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let code = runtime.block_on(demonstrate(context, &args));
    runtime.shutdown_timeout(Duration::from_millis(500));
    code
}

async fn demonstrate(context: Context, args: &Args) -> anyhow::Result<ExitCode> {
    let mut signals = Signals::new()?;
    let server = Server::start(context, &args.listen, args.insecure).await?;
    let url = server.url();
    println!("aligning the SIMULATED camera; the page, to watch: {url}/");
    server.offer_key(true)?;
    let own = server.own_client();
    let aligned = tokio::select! {
        job = remote::align(&url, &own, None) => Some(job),
        () = signals.next() => None,
    };
    let code = match &aligned {
        Some(Ok(job)) => {
            println!();
            print!("{}", report::report_text(job));
            if job.state == JobState::Converged { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Some(Err(_)) | None => ExitCode::FAILURE,
    };
    if let Some(Ok(_)) = &aligned
        && !args.once
    {
        println!("\nserving the page at {url}/ until Ctrl-C");
        signals.next().await;
    }
    server.shut_down(&mut signals).await;
    aligned.transpose()?;
    Ok(code)
}
