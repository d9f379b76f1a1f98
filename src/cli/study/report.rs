//! What a study writes into its folder and prints.

use std::path::Path;

use serde::Serialize;

use super::Context;
use crate::study::{self, Archive, Chapter, Curve, StudyOptions, Table, Verdict};

#[derive(Serialize)]
struct Results<'a> {
    version: &'static str,
    simulated: bool,
    quick: bool,
    seed: u64,
    benches: u64,
    assemblies: u64,
    configuration: String,
    report: String,
    chapters: &'a [Chapter],
}

/// Writes report, tables and results, and prints the results.
pub(super) fn write(
    context: &Context,
    options: StudyOptions,
    archive: &Archive,
    chapters: &[Chapter],
    as_json: bool,
) -> anyhow::Result<()> {
    let configuration = context.origin.describe(&context.config);
    let report = archive.write("report.html", study::html(chapters, options, &configuration).as_bytes())?;
    for chapter in chapters {
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
        quick: options.quick,
        seed: options.seed,
        benches: options.counts.benches,
        assemblies: options.counts.assemblies,
        configuration,
        report: report.display().to_string(),
        chapters,
    };
    archive.write("results.json", &serde_json::to_vec_pretty(&results)?)?;
    if as_json {
        println!("{}", serde_json::to_string(&results)?);
    } else {
        print(chapters);
        println!("\nreport           {}", report.display());
    }
    Ok(())
}

/// Says which chapters are there for the merge.
pub(super) fn others(out: &Path, chapters: &[Chapter], as_json: bool) {
    let names: Vec<&str> = chapters.iter().map(|chapter| chapter.name.as_str()).collect();
    if as_json {
        println!("{}", serde_json::json!({ "out": out.display().to_string(), "chapters": names }));
    } else {
        println!("chapters         {}", names.join(", "));
    }
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
