//! `plenalign sim-stage`: the twin of a stage controller behind a pseudo-terminal or a TCP port, to try a set-up with.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use tokio::net::TcpListener;

use super::Context;
use super::serve::Signals;
use crate::config::AxisConfig;
use crate::sim::plant::{Plant, RecordedSlides, Slides};
use crate::sim::stage::{ControllerTwin, Protocol, firmware};

/// Arguments of `plenalign sim-stage`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// What the controller speaks.
    #[arg(long, value_enum)]
    protocol: Protocol,
    /// Serve only the axes that the configuration has on this controller: one axis makes of `thorlabs` a K-Cube (KDC101).
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// A link to the pseudo-terminal, made anew, to have a name that stays.
    #[arg(long, value_name = "PATH", conflicts_with = "listen")]
    link: Option<PathBuf>,
    /// Serve on a TCP port instead, one connection at a time.
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Write every motion of the slides to this file: time in microseconds since 1970, number of the axis (0: focus, 1:
    /// e; 0 for the only one), position in mm.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Print one JSON object instead of text once it serves: `protocol`, `port`.
    #[arg(long)]
    json: bool,
}

/// The bench's axes, with their names, as a twin of this protocol can have them: under the protocol's own where the
/// configured ones are another's. All, or those on one controller.
fn axes(context: &Context, protocol: Protocol, only: Option<&str>) -> anyhow::Result<Vec<(&'static str, AxisConfig)>> {
    let bench = &context.config.bench;
    let mut axes = vec![("focus", bench.focus.clone()), ("e", bench.e.clone())];
    if let Some(name) = only {
        let is_one = bench.controllers.get(name).is_some_and(|controller| controller.driver == protocol.driver());
        axes.retain(|(_, axis)| is_one && axis.controller == name);
        anyhow::ensure!(
            !axes.is_empty(),
            "the configuration has no {} controller `{name}` with an axis",
            protocol.name()
        );
    }
    for ((_, axis), name) in axes.iter_mut().zip(protocol.first_axes()) {
        let controller = bench.controllers.get(&axis.controller);
        if controller.is_none_or(|controller| controller.driver != protocol.driver()) {
            name.clone_into(&mut axis.axis);
            axis.steps_per_mm = protocol.driver().units_per_mm().unwrap_or(axis.steps_per_mm);
        }
    }
    Ok(axes)
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    runtime.block_on(serve(&context, &args))?;
    Ok(ExitCode::SUCCESS)
}

async fn serve(context: &Context, args: &Args) -> anyhow::Result<()> {
    let mut signals = Signals::new()?;
    let axes = axes(context, args.protocol, args.controller.as_deref())?;
    // A little off home, as after any other day.
    let starts = axes.iter().map(|(_, axis)| (axis, axis.home_position_mm - axis.home_side.sign()));
    let slides = Slides::new(&starts.collect::<Vec<_>>());
    let plant: Arc<dyn Plant> = match &args.record {
        Some(path) => {
            RecordedSlides::new(slides, path).with_context(|| format!("cannot make the record {}", path.display()))?
        }
        None => slides,
    };
    let twin = firmware(args.protocol, &axes.iter().map(|(_, axis)| axis).collect::<Vec<_>>(), plant);
    let port = match &args.listen {
        Some(address) => listen(twin, address).await?,
        None => {
            let path = twin.serve_on_terminal().context("no pseudo-terminal")?;
            match &args.link {
                Some(link) => make_link(&path, link)?,
                None => path.display().to_string(),
            }
        }
    };
    if args.json {
        println!("{}", serde_json::json!({ "protocol": args.protocol.name(), "port": port }));
    } else {
        println!("plenalign: SIMULATED {} controller at {port}; end it with Ctrl-C", args.protocol.name());
        for (name, axis) in &axes {
            println!("  axis {} is the {name} axis, {} units/mm", axis.axis, axis.steps_per_mm);
        }
    }
    let _ = std::io::stdout().flush();
    signals.next().await;
    if let Some(link) = &args.link {
        let _ = std::fs::remove_file(link);
    }
    Ok(())
}

async fn listen(twin: ControllerTwin, address: &str) -> anyhow::Result<String> {
    let listener = TcpListener::bind(address).await.with_context(|| format!("cannot listen on {address}"))?;
    let address = listener.local_addr()?.to_string();
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let _ = stream.set_nodelay(true);
            twin.serve(stream).await;
        }
    });
    Ok(address)
}

fn make_link(path: &Path, link: &Path) -> anyhow::Result<String> {
    // Only a link of an earlier run is replaced.
    if std::fs::symlink_metadata(link).is_ok_and(|found| found.file_type().is_symlink()) {
        std::fs::remove_file(link).with_context(|| format!("cannot replace {}", link.display()))?;
    }
    std::os::unix::fs::symlink(path, link).with_context(|| format!("cannot make the link {}", link.display()))?;
    Ok(link.display().to_string())
}
