//! `plenalign study`: the paper's experiments on the simulated camera, as a report.

use std::path::PathBuf;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use super::Context;
use crate::study::{self, Archive, Chapter, Curve, StudyOptions, Table, Verdict, Watch};

/// Arguments of `plenalign study`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Write report.html, results.json, tables and pictures into this folder. A study that was interrupted goes on from
    /// the chapters that are there.
    #[arg(long, value_name = "DIR", default_value = "study")]
    out: PathBuf,
    /// Print the results as one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Small sensors and few seeds: a minute or two instead of half an hour.
    #[arg(long)]
    quick: bool,
    /// Seed of textures, noise, parts and benches.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

#[derive(Serialize)]
struct Results<'a> {
    version: &'static str,
    simulated: bool,
    quick: bool,
    seed: u64,
    configuration: String,
    report: String,
    chapters: &'a [Chapter],
}

/// Progress on standard error.
struct Bar(ProgressBar);

impl Watch for Bar {
    fn chapter(&self, number: usize, of: usize, title: &str, kept: bool) {
        let note = if kept { " (kept from an earlier run)" } else { "" };
        self.0.suspend(|| eprintln!("{number}/{of} {title}{note}"));
        self.0.set_position(0);
    }

    fn done(&self, steps: u64, of: u64) {
        self.0.set_length(of);
        self.0.set_position(steps);
    }
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{elapsed:>4} [{bar:30}] {pos}/{len}") {
        bar.set_style(style.progress_chars("=> "));
    }
    let options = StudyOptions { quick: args.quick, seed: args.seed };
    let archive = Archive::open(&args.out, &context.config, options)?;
    let chapters = study::run(&context.config, options, &archive, &Bar(bar.clone()))?;
    bar.finish_and_clear();

    let configuration = context.origin.describe(&context.config);
    let report = archive.write("report.html", study::html(&chapters, options, &configuration).as_bytes())?;
    for chapter in &chapters {
        for table in &chapter.tables {
            archive.write(&format!("tables/{}-{}.csv", chapter.name, table.name), study::csv(table).as_bytes())?;
        }
        for chart in &chapter.charts {
            let name = format!("tables/{}-{}-chart.csv", chapter.name, chart.name);
            archive.write(&name, study::csv(&points(&chart.x, &chart.y, &chart.curves)).as_bytes())?;
        }
    }
    let results = Results {
        version: env!("CARGO_PKG_VERSION"),
        simulated: true,
        quick: args.quick,
        seed: args.seed,
        configuration,
        report: report.display().to_string(),
        chapters: &chapters,
    };
    archive.write("results.json", &serde_json::to_vec_pretty(&results)?)?;
    if args.json {
        println!("{}", serde_json::to_string(&results)?);
    } else {
        print(&chapters);
        println!("\nreport           {}", report.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// A chart's points as a table.
fn points(x: &str, y: &str, curves: &[Curve]) -> Table {
    let rows = curves
        .iter()
        .flat_map(|curve| curve.points.iter().map(|[x, y]| vec![curve.name.clone(), x.to_string(), y.to_string()]))
        .collect();
    Table {
        name: String::new(),
        title: String::new(),
        columns: vec!["curve".to_owned(), x.to_owned(), y.to_owned()],
        rows,
    }
}

fn print(chapters: &[Chapter]) {
    println!("SIMULATED: every frame was rendered by exact rays");
    for chapter in chapters {
        println!("\n{} ({:.1} s)", chapter.title, chapter.seconds);
        for finding in &chapter.findings {
            let beside = match finding.verdict {
                Verdict::Agrees => format!("paper: {}", finding.paper),
                Verdict::Differs => format!("DIFFERS from the paper: {}", finding.paper),
                Verdict::New => "not in the paper".to_owned(),
            };
            println!("  {}: {} [{beside}]", finding.what, finding.ours);
        }
    }
}
