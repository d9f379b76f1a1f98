//! `plenalign sim-camera`: the simulated camera as a GigE Vision device on the network, to try a set-up with.

use std::io::{BufRead as _, Write as _};
use std::net::Ipv4Addr;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use serde::Deserialize;
use serde_json::json;
use tokio::sync::mpsc;
use tokio::time::Instant;

use super::Context;
use super::faults::read_plan;
use super::serve::Signals;
use crate::config::TimestampMeans;
use crate::device::Setup;
use crate::device::faults::Plannable as _;
use crate::sim::gige::{GigeCamera, GigeFaultPlan, GigeFaults, LinkFaults, Options, SlideRecord};

/// Longest serial number and user's name, bytes.
const LONGEST_NAME: usize = 15;
/// What a link can carry, Mbit/s.
const LINK_MBIT_S: RangeInclusive<f64> = 0.1..=1_000_000.0;
/// Most frames that are kept to be sent again and again.
const MOST_REPEATED: usize = 16;
/// For how long the camera can be without power, s.
const LONGEST_AWAY_S: RangeInclusive<f64> = 0.0..=86_400.0;

/// Arguments of `plenalign sim-camera`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The camera's address, of one of this machine's networks. Whoever reaches it has the camera: there is no
    /// authentication.
    #[arg(long, value_name = "ADDR", default_value_t = Ipv4Addr::LOCALHOST)]
    listen: Ipv4Addr,
    /// Its serial number.
    #[arg(long, value_name = "NUMBER", default_value = "SIM-1")]
    serial: String,
    /// The name that a user gave it.
    #[arg(long, value_name = "NAME", default_value = "")]
    name: String,
    /// What its timestamps are of, as `bench.camera.timestamp_means` has it; with `arrival` it has no clock.
    #[arg(long, value_enum, value_name = "MOMENT", default_value = "exposure_start")]
    timestamp_means: TimestampMeans,
    /// A record that `sim-stage --record` writes: the camera sees those slides move. `focus=FILE` or `e=FILE` is of a stage
    /// with that axis alone; may be repeated.
    #[arg(long, value_name = "[AXIS=]FILE")]
    slides: Vec<SlideRecord>,
    /// What the camera's link carries.
    #[arg(long, value_name = "MBIT_S", default_value_t = 1000.0)]
    link_mbit_s: f64,
    /// One packet in so many is lost; 0 for none.
    #[arg(long, value_name = "N", default_value_t = 0)]
    lost_one_in: u32,
    /// One packet in so many comes late, after others.
    #[arg(long, value_name = "N", default_value_t = 0)]
    late_one_in: u32,
    /// One packet in so many comes twice.
    #[arg(long, value_name = "N", default_value_t = 0)]
    doubled_one_in: u32,
    /// One packet in so many says that it is of another frame.
    #[arg(long, value_name = "N", default_value_t = 0)]
    misnumbered_one_in: u32,
    /// Plan of what goes wrong with camera, scene and link, and when, in the place of the four above: see docs/faults.md.
    #[arg(long, value_name = "PLAN.json", conflicts_with_all = ["lost_one_in", "late_one_in", "doubled_one_in", "misnumbered_one_in"])]
    faults: Option<PathBuf>,
    /// It does not say which program has control of it, as not every camera does.
    #[arg(long)]
    anonymous_control: bool,
    /// What chance depends on, for which packets go wrong.
    #[arg(long, value_name = "NUMBER", default_value_t = 1)]
    seed: u64,
    /// Print one JSON object instead of text once it serves: `address`, `serial`.
    #[arg(long)]
    json: bool,
}

/// A line of standard input: what is to happen with the camera and what stands before it.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Order {
    /// Set the bench up so, as an operator does.
    Setup(Setup),
    /// Camera, scene and link are to have these faults, and no others; a plan ends.
    Faults(GigeFaults),
    /// So many of its next frames are sent again and again, without rendering any more; 0 ends that.
    Repeat(usize),
    /// The camera is without power for so many seconds.
    RestartS(f64),
    /// Say where everything really is.
    Truth,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    runtime.block_on(serve(context, args))?;
    Ok(ExitCode::SUCCESS)
}

async fn serve(context: Context, args: Args) -> anyhow::Result<()> {
    ensure!(
        LINK_MBIT_S.contains(&args.link_mbit_s),
        "--link-mbit-s {}: it has to be from {} to {}",
        args.link_mbit_s,
        LINK_MBIT_S.start(),
        LINK_MBIT_S.end()
    );
    for (option, text) in [("--serial", &args.serial), ("--name", &args.name)] {
        ensure!(text.len() <= LONGEST_NAME, "{option} {text:?} is longer than the {LONGEST_NAME} bytes that there are");
    }
    let mut signals = Signals::new()?;
    let link = LinkFaults {
        lost_one_in: args.lost_one_in,
        late_one_in: args.late_one_in,
        doubled_one_in: args.doubled_one_in,
        misnumbered_one_in: args.misnumbered_one_in,
        ..LinkFaults::default()
    };
    let faults = GigeFaults { link, ..GigeFaults::default() };
    faults.check().map_err(|fault| anyhow!("{}: {fault}", fault.field))?;
    let plan = args.faults.as_deref().map(|path| read_plan(path, GigeFaultPlan::check)).transpose()?;
    let options = Options {
        address: args.listen,
        serial: args.serial.clone(),
        user_name: args.name,
        means: args.timestamp_means,
        link_mbit_s: args.link_mbit_s,
        names_controller: !args.anonymous_control,
        faults,
        seed: args.seed,
        slides: args.slides,
    };
    let camera = GigeCamera::start(&Arc::new(context.config), options)
        .with_context(|| format!("no camera can be served at {}:3956", args.listen))?;
    if args.json {
        println!("{}", json!({ "address": args.listen, "serial": args.serial }));
    } else {
        println!("plenalign: SIMULATED GigE Vision camera {} at {}; end it with Ctrl-C", args.serial, args.listen);
        if !args.listen.is_loopback() {
            println!("  whoever reaches this address has the camera: there is no authentication");
        }
    }
    let _ = std::io::stdout().flush();
    let mut orders = lines();
    let mut plan = plan.map(PlanInForce::begin);
    loop {
        let change = plan.as_mut().and_then(|plan| plan.carry_out(&camera));
        tokio::select! {
            () = signals.next() => return Ok(()),
            () = until(change) => {}
            Some(line) = orders.recv() => {
                println!("{}", tokio::task::block_in_place(|| obeyed(&camera, &mut plan, &line)));
            }
        }
    }
}

/// A plan of faults in force.
struct PlanInForce {
    plan: GigeFaultPlan,
    began: Instant,
    /// Until when nothing changes.
    until: Option<Instant>,
}

impl PlanInForce {
    fn begin(plan: GigeFaultPlan) -> Self {
        let began = Instant::now();
        Self { plan, began, until: Some(began) }
    }

    /// Has happen what is due by now; when the next is.
    fn carry_out(&mut self, camera: &GigeCamera) -> Option<Instant> {
        let now = Instant::now();
        if self.until.is_some_and(|until| until <= now) {
            let seconds = (now - self.began).as_secs_f64();
            let faults = self.plan.at(seconds);
            tracing::info!(seconds, ?faults, "the plan of faults goes on");
            camera.set_faults(faults);
            self.until = self.plan.next_change(seconds).map(|next| self.began + Duration::from_secs_f64(next));
        }
        self.until
    }
}

/// Waits until then; without, for ever.
async fn until(moment: Option<Instant>) {
    match moment {
        Some(moment) => tokio::time::sleep_until(moment).await,
        None => std::future::pending().await,
    }
}

/// Standard input's lines. The thread that reads them ends with the program.
fn lines() -> mpsc::Receiver<String> {
    // Who writes faster than is answered waits.
    let (to, lines) = mpsc::channel(1);
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if to.blocking_send(line).is_err() {
                return;
            }
        }
    });
    lines
}

/// Does what a line says; what is answered.
fn obeyed(camera: &GigeCamera, plan: &mut Option<PlanInForce>, line: &str) -> serde_json::Value {
    match serde_json::from_str(line) {
        Ok(Order::Setup(setup)) => match setup.check() {
            Ok(()) => camera.obey(&setup),
            Err(error) => return json!({ "error": error }),
        },
        Ok(Order::Faults(faults)) => match faults.check() {
            Ok(()) => {
                *plan = None;
                camera.set_faults(faults);
            }
            Err(error) => return json!({ "error": format!("{}: {error}", error.field) }),
        },
        Ok(Order::Repeat(frames)) if frames <= MOST_REPEATED => camera.repeat(frames),
        Ok(Order::Repeat(frames)) => {
            return json!({ "error": format!("repeat {frames}: it has to be from 0 to {MOST_REPEATED}") });
        }
        Ok(Order::RestartS(seconds)) if LONGEST_AWAY_S.contains(&seconds) => {
            camera.restart(Duration::from_secs_f64(seconds));
        }
        Ok(Order::RestartS(seconds)) => {
            return json!({ "error": format!("restart_s {seconds}: it has to be from 0 to {}", LONGEST_AWAY_S.end()) });
        }
        Ok(Order::Truth) => return camera.truth(),
        Err(error) => return json!({ "error": error.to_string() }),
    }
    json!({ "done": true })
}
