//! The command line: one file per subcommand.
//!
//! With `--json` a command prints one JSON object on standard output and nothing else there; human text otherwise.
//! Progress goes to standard error, an error is one line there, and the exit code is 0 only on success.

#[macro_use]
mod output;

mod align;
mod alpaca;
mod announce;
mod calibrate;
mod camera;
mod completions;
mod demo;
mod design;
mod doctor;
mod exposure;
mod faults;
mod fleet;
mod grid;
mod jobs;
mod listen;
mod lock;
mod logging;
mod man;
mod measure;
mod open_files;
mod plan;
mod pose;
mod progress;
mod remote;
mod render;
mod replay;
mod report;
mod serve;
mod sim_camera;
mod sim_stage;
mod stop;
mod stop_axes;
mod study;
mod supervised;
mod tls;
mod token;
mod view;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::ensure;
use clap::{Parser, Subcommand};

use crate::config::{Config, ConfigOrigin};

/// Aligns underwater plenoptic cameras.
#[derive(Debug, Parser)]
#[command(name = "plenalign", version, about)]
struct Cli {
    /// Configuration file; without it the reference preset stands.
    #[arg(long, global = true, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Set a key of the configuration for this run, e.g. `assembly.initial_e_mm=25`; may be repeated.
    #[arg(long, global = true, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run the daemon: REST, WebSocket and the page.
    Serve(serve::Args),
    /// Run a joint alignment, in process or through a running daemon.
    Align(align::Args),
    /// Stop the bench of a running daemon, at once.
    Stop(stop::Args),
    /// Make, list and revoke the tokens that a daemon lets people in by.
    Token(token::Args),
    /// Make a certificate for a daemon that is reached over a network.
    Tls(tls::Args),
    /// Print clarity, FOV and joint solutions of the configured camera.
    Design(design::Args),
    /// Print how the configured camera would be aligned, and what stands in the way; nothing moves.
    Plan(plan::Args),
    /// Measure the spacing of a raw frame.
    Measure(measure::Args),
    /// Find the micro-images of raw frames alone.
    Grid(grid::Args),
    /// Pictures and distances from a raw frame.
    View(view::Args),
    /// Find d and b from a raw frame of a triple-level board.
    Calibrate(calibrate::Args),
    /// Render a raw frame of the configured camera by exact rays.
    Render(render::Args),
    /// Show the cameras that are connected, what they offer and how they can be set.
    Camera(camera::Args),
    /// Run the paper's experiments again on the simulated camera, and write a report.
    Study(study::Args),
    /// Measure a recording's frames again and compare what is decided.
    Replay(replay::Args),
    /// List, show and export the jobs of the history.
    Jobs(jobs::Args),
    /// Serve the simulated bench and align it before your eyes.
    Demo(demo::Args),
    /// Stand in for a GigE Vision camera, on the network.
    SimCamera(sim_camera::Args),
    /// Stand in for a stage controller, behind a pseudo-terminal or a TCP port.
    SimStage(sim_stage::Args),
    /// Stop the configured axes straight over their ports, where no daemon runs.
    StopAxes(stop_axes::Args),
    /// Say what is found on this machine, what is wrong, and what to type to mend it.
    Doctor(doctor::Args),
    /// Look at several daemons at once.
    Fleet(fleet::Args),
    /// Print a shell's completion script.
    Completions(completions::Args),
    /// Write the manual's pages, one for each command.
    Man(man::Args),
}

/// What every subcommand gets.
struct Context {
    /// The configuration in force.
    config: Config,
    /// Where it came from.
    origin: ConfigOrigin,
}

/// Runs the program with the process's arguments.
#[must_use]
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli) {
        Ok(code) => match output::lost() {
            None => code,
            Some(why) => {
                eprintln!("plenalign: standard output cannot be written: {why}");
                ExitCode::FAILURE
            }
        },
        Err(error) => {
            eprintln!("plenalign: {}", one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// An error and its causes on one line, without the causes that it quotes itself.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !line.contains(&cause) {
            line.push_str(": ");
            line.push_str(&cause);
        }
    }
    line
}

fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    let _logging = logging::start();
    let settings = Settings { file: cli.config, assignments: cli.set };
    // Only what needs the configuration opens it: a stop is not kept waiting for a file that is wrong.
    match cli.command {
        Command::Serve(args) => serve::run(settings.open()?, args),
        Command::Align(args) => align::run(&settings, args),
        Command::Stop(args) => stop::run(&args),
        Command::Token(args) => token::run(&args),
        Command::Tls(args) => tls::run(&args),
        Command::Design(args) => design::run(settings.open()?, args),
        Command::Plan(args) => plan::run(settings.open()?, args),
        Command::Measure(args) => measure::run(settings.open()?, args),
        Command::Grid(args) => grid::run(settings.open()?, args),
        Command::View(args) => view::run(settings.open()?, args),
        Command::Calibrate(args) => calibrate::run(settings.open()?, args),
        Command::Render(args) => render::run(settings.open()?, args),
        Command::Camera(args) => camera::run(settings.open()?, args),
        Command::Study(args) => study::run(&settings.open()?, args),
        Command::Replay(args) => {
            settings.refuse("the recorded configuration is in force")?;
            replay::run(&args)
        }
        Command::Jobs(args) => jobs::run(settings.open()?, args),
        Command::Demo(args) => demo::run(settings.open()?, args),
        Command::SimCamera(args) => sim_camera::run(settings.open()?, args),
        Command::SimStage(args) => sim_stage::run(settings.open()?, args),
        Command::StopAxes(args) => stop_axes::run(settings.open_to_stop()?, args),
        // It says itself what is wrong with the configuration.
        Command::Doctor(args) => doctor::run(settings.file.as_deref(), &settings.assignments, &args),
        Command::Fleet(args) => {
            settings.refuse("the daemons' own configurations are in force")?;
            fleet::run(args)
        }
        Command::Completions(args) => completions::run(&args),
        Command::Man(args) => man::run(&args),
    }
}

/// What the command line says of the configuration.
struct Settings {
    file: Option<PathBuf>,
    /// `KEY=VALUE` each.
    assignments: Vec<String>,
}

impl Settings {
    /// Refuses what a command would not heed, and says why it would not.
    fn refuse(&self, why: &str) -> anyhow::Result<()> {
        let given = self.file.is_some() || !self.assignments.is_empty();
        ensure!(!given, "{why}: leave --config and --set away");
        Ok(())
    }

    /// Reads the configuration.
    fn open(&self) -> anyhow::Result<Context> {
        let (config, origin) = Config::open(self.file.as_deref(), &self.assignments)?;
        Ok(Context { config, origin })
    }

    /// Reads it for stopping the axes.
    fn open_to_stop(&self) -> anyhow::Result<Context> {
        let (config, origin) = Config::open_to_stop(self.file.as_deref(), &self.assignments)?;
        Ok(Context { config, origin })
    }
}
