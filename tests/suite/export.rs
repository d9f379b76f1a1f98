//! A whole alignment's records, and what is made of them.

use plenalign::api::export;
use plenalign::control::history::read::JobArchive;
use plenalign::control::job::JobState;
use plenalign::store::Store;
use reqwest::Method;
use serde_json::{Value, json};

use super::bench::{align, service, small_config};
use super::daemon::Daemon;
use super::fakes::fakes;

async fn archive() -> JobArchive {
    let service = service(small_config(1)).await;
    let job = align(&service).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    service.archive(job.id).await.unwrap()
}

#[tokio::test(start_paused = true)]
async fn everything_of_an_alignment_is_kept_and_exported() {
    let archive = archive().await;
    let job = &archive.job;
    // What the history has is what the job says of itself.
    assert!(archive.measurements.len() >= job.iterations.len());
    for iteration in &job.iterations {
        assert!(archive.measurements.iter().any(|measured| measured.spacing == iteration.spacing), "{iteration:?}");
    }
    let moved = job.iterations.iter().filter(|iteration| iteration.axis.is_some()).count();
    let moves: Vec<_> = archive.moves.iter().filter(|motion| motion.what == "move").collect();
    assert!(moves.len() >= moved && moves.iter().all(|motion| motion.outcome.as_deref() == Some("done")));
    for motion in &moves {
        assert!((motion.end_mm.unwrap() - motion.to_mm.unwrap()).abs() < 0.01, "{motion:?}");
        assert!(motion.job == Some(job.id) && motion.ended_at > Some(motion.started_at));
    }
    assert_eq!(archive.moves.iter().filter(|motion| motion.what == "home").count(), 2);
    let names: Vec<_> = archive.operator_steps.iter().map(|asked| asked.step.name.as_str()).collect();
    assert_eq!(names, ["white_frame", "triple_board_in_air", "aperture", "shell_and_water"]);
    assert!(archive.operator_steps.iter().all(|asked| asked.confirmed_at.is_some()));
    let run = archive.run.as_ref().unwrap();
    assert!(run.configuration.contains("width_px = 560") && run.version == env!("CARGO_PKG_VERSION"));
    let pictures: Vec<_> = archive.pictures.iter().map(|picture| picture.name.as_str()).collect();
    assert_eq!(pictures, ["before", "after"]);
    for picture in &archive.pictures {
        let decoded = image::load_from_memory(&picture.bytes).unwrap();
        assert!(decoded.width() > 20 && decoded.height() > 20);
    }
    assert_ne!(archive.pictures[0].bytes, archive.pictures[1].bytes);

    json_has_it_all(&archive);
    csv_has_a_line_for_each_iteration(&archive);
    report_has_everything_in_it(&archive);
}

fn json_has_it_all(archive: &JobArchive) {
    let document: Value = serde_json::from_str(&export::json(archive)).unwrap();
    assert_eq!((&document["format"], &document["simulated"]), (&json!("plenalign-job"), &json!(true)));
    assert_eq!(document["job"]["iterations"], json!(archive.job.iterations));
    assert_eq!(document["moves"].as_array().unwrap().len(), archive.moves.len());
    assert!(document["pictures"][0]["data"].as_str().unwrap().starts_with("data:image/jpeg;base64,/9j/"));
    // It can be read back.
    let read: export::JobExport = serde_json::from_value(document).unwrap();
    assert_eq!(read.job, archive.job);
    assert!(export::file_name(archive, "json").starts_with("SIMULATED-"));
}

fn csv_has_a_line_for_each_iteration(archive: &JobArchive) {
    let csv = export::csv(archive);
    let lines: Vec<&str> = csv.split("\r\n").collect();
    assert_eq!(lines.len(), archive.job.iterations.len() + 2);
    assert_eq!(lines.last(), Some(&""));
    assert!(lines[0].starts_with("job,simulated,number,at,stage,kind,axis,focus_mm,e_mm,"));
    let columns: Vec<&str> = lines[0].split(',').collect();
    let first: Vec<&str> = lines[1].split(',').collect();
    let cell = |name: &str| first[columns.iter().position(|column| *column == name).unwrap()];
    let iteration = &archive.job.iterations[0];
    assert_eq!((cell("simulated"), cell("number"), cell("axis")), ("true", "1", ""));
    assert_eq!(cell("spacing_px").parse::<f64>().unwrap(), iteration.spacing.spacing_px);
    assert_eq!(cell("delta_v_sigma_mm").parse::<f64>().unwrap(), iteration.delta_v_sigma_mm.unwrap());
}

fn report_has_everything_in_it(archive: &JobArchive) {
    let page = export::html(archive);
    assert!(page.starts_with("<!doctype html>"));
    // Loud at both ends, and in the title of the window and of the printed page.
    assert_eq!(page.matches("<p class=\"simulated\">SIMULATED").count(), 2);
    assert!(page.contains("<title>SIMULATED"));
    assert_eq!(page.matches("<svg class=\"plot\"").count(), 4);
    assert_eq!(page.matches("<svg class=\"map\"").count(), 1);
    assert_eq!(page.matches("src=\"data:image/jpeg;base64,").count(), 2);
    // Without the pictures, whose letters may say anything.
    let words: String =
        page.split("src=\"data:").map(|part| part.split_once("\">").map_or(part, |(_, rest)| rest)).collect();
    for missing in ["http://", "https://", "<script", "NaN", "url("] {
        assert!(!words.contains(missing), "{missing} is in the report");
    }
    // A mark for each iteration in the first plot, and its bar.
    let plot = page.split("<svg class=\"plot\"").nth(1).unwrap().split("</svg>").next().unwrap();
    let iterations = archive.job.iterations.len();
    assert_eq!((plot.matches("<circle").count(), plot.matches("class=\"bar\"").count()), (iterations, iterations));
    let report = archive.job.report.as_ref().unwrap();
    assert!(page.contains(&format!("target {:.4} px", report.spacing_target_px)));
    assert!(page.contains("width_px = 560"), "the configuration is there");
    let row = |name: &str, value: &str| page.contains(&format!("<th scope=\"row\">{name}</th><td>{value}</td>"));
    assert!(row("Started by", &archive.job.owner) && !archive.job.owner.is_empty());
    assert!(!page.contains(">Note</th>"));
    let mut noted = archive.clone();
    noted.job.request.note = Some("Camera <17>".to_owned());
    assert!(export::html(&noted).contains("<th scope=\"row\">Note</th><td>Camera &lt;17&gt;</td>"));
}

#[tokio::test(start_paused = true)]
async fn nothing_of_a_job_becomes_markup() {
    let mut archive = archive().await;
    let wicked = "<script>alert(1)</script>\"'&";
    archive.job.reason = Some(wicked.to_owned());
    archive.job.log[0].message = wicked.to_owned();
    archive.job.iterations[0].decision = wicked.to_owned();
    archive.operator_steps[0].step.instruction = wicked.to_owned();
    archive.moves[0].outcome = Some(wicked.to_owned());
    archive.pictures[0].media_type = wicked.to_owned();
    archive.pictures[1].name = wicked.to_owned();
    let run = archive.run.as_mut().unwrap();
    (run.bench, run.configuration, run.version) = (wicked.to_owned(), wicked.to_owned(), wicked.to_owned());
    if let Some(report) = &mut archive.job.report {
        (report.design_origin, report.notes) = (wicked.to_owned(), vec![wicked.to_owned()]);
    }
    let page = export::html(&archive);
    assert!(!page.contains("<script") && !page.contains("\"'&"), "markup came through");
    assert!(page.matches("&lt;script&gt;").count() >= 11);
    let csv = export::csv(&archive);
    assert!(csv.contains(",\"<script>alert(1)</script>\"\"'&\"\r\n"), "{csv}");
}

#[tokio::test]
async fn exports_come_as_files_with_names_and_of_what_is_not_there_as_problems() {
    let daemon = Daemon::start_keeping(small_config(1), fakes().bench, Store::in_memory()).await;
    let job: Value =
        daemon.command(Method::POST, "/api/v1/jobs", &json!({ "kind": "joint_alignment" })).await.json().await.unwrap();
    let (id, href) = (job["id"].as_str().unwrap(), job["href"].as_str().unwrap());
    for (path, kind, disposition) in [
        ("export.json", "application/json", format!("attachment; filename=\"plenalign-{id}.json\"")),
        ("export.csv", "text/csv; charset=utf-8", format!("attachment; filename=\"plenalign-{id}.csv\"")),
        ("report.html", "text/html; charset=utf-8", format!("inline; filename=\"plenalign-{id}.html\"")),
    ] {
        let response = daemon.get(&format!("{href}/{path}")).await;
        assert_eq!(response.status(), 200);
        let header = |name| response.headers()[name].to_str().unwrap();
        assert_eq!((header("content-type"), header("content-disposition")), (kind, disposition.as_str()));
        assert_eq!(header("plenalign-simulated"), "false");
        if path == "report.html" {
            assert!(header("content-security-policy").starts_with("default-src 'none'"));
        }
        let text = response.text().await.unwrap();
        assert!(!text.contains("SIMULATED"), "{text}");
        let none = daemon.get(&format!("/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11/{path}")).await;
        super::daemon::problem(none, 404, "not-found").await;
    }
    for list in ["log", "iterations", "measurements", "moves"] {
        let found: Value = daemon.get(&format!("{href}/{list}")).await.json().await.unwrap();
        let key = if list == "log" { "lines" } else { list };
        assert!(found[key].is_array(), "{found}");
        let none = daemon.get(&format!("/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11/{list}")).await;
        super::daemon::problem(none, 404, "not-found").await;
    }
}
