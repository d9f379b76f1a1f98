//! The report as one page that needs nothing beside it: tables, charts as SVG, pictures within.

mod chart;

use std::fmt::Write as _;

use super::{Chapter, Finding, StudyOptions, Table, Verdict};
use crate::text::{csv_field, data_uri, escape};

/// How the page looks, on a screen and on paper.
const STYLE: &str = include_str!("style.css");

/// The report of a study: `origin` says where the configuration came from.
#[must_use]
pub fn html(chapters: &[Chapter], options: StudyOptions, origin: &str) -> String {
    let mut page = String::from("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    page.push_str("<meta name=\"viewport\" content=\"width=device-width\">\n");
    let _ =
        writeln!(page, "<title>Plenalign: the paper’s experiments</title>\n<style>{STYLE}</style>\n</head>\n<body>");
    page.push_str("<h1>The paper’s experiments, run again</h1>\n");
    let _ = writeln!(
        page,
        "<p class=\"simulated\">SIMULATED: every frame was rendered by exact rays; no camera was used</p>\n<p>After \
         “Underwater plenoptic cameras optimized for water refraction”, Optics Express 31(13), 21464 (2023). Made by \
         plenalign {} with seed {}{}; configuration: {}. The camera and shell of the preset are inferred from Table 2: \
         Tables 1 and 3 of the paper are not printed.</p>",
        env!("CARGO_PKG_VERSION"),
        options.seed,
        if options.quick { ", quick: small sensors and few seeds, whose statistics say little" } else { "" },
        escape(origin)
    );
    contents(&mut page, chapters);
    for chapter in chapters {
        section(&mut page, chapter);
    }
    page.push_str("</body>\n</html>\n");
    page
}

/// A table as CSV.
#[must_use]
pub fn csv(table: &Table) -> String {
    let mut text = String::new();
    for row in std::iter::once(&table.columns).chain(&table.rows) {
        let fields: Vec<String> = row.iter().map(|field| csv_field(field)).collect();
        text.push_str(&fields.join(","));
        text.push_str("\r\n");
    }
    text
}

fn contents(page: &mut String, chapters: &[Chapter]) {
    page.push_str("<nav>\n<ol>\n");
    for chapter in chapters {
        let differs = chapter.findings.iter().filter(|finding| finding.verdict == Verdict::Differs).count();
        let note = match differs {
            0 => String::new(),
            1 => " <span class=\"differs\">one figure differs from the paper’s</span>".to_owned(),
            n => format!(" <span class=\"differs\">{n} figures differ from the paper’s</span>"),
        };
        let _ = writeln!(page, "<li><a href=\"#{}\">{}</a>{note}</li>", escape(&chapter.name), escape(&chapter.title));
    }
    page.push_str("</ol>\n</nav>\n");
}

fn section(page: &mut String, chapter: &Chapter) {
    let _ = writeln!(page, "<section id=\"{}\">\n<h2>{}</h2>", escape(&chapter.name), escape(&chapter.title));
    for paragraph in &chapter.text {
        let _ = writeln!(page, "<p>{}</p>", escape(paragraph));
    }
    if !chapter.findings.is_empty() {
        page.push_str("<table class=\"findings\">\n<thead><tr><th>figure</th><th>paper</th><th>here</th><th></th>");
        page.push_str("<th>why</th></tr></thead>\n<tbody>\n");
        for finding in &chapter.findings {
            row(page, finding);
        }
        page.push_str("</tbody>\n</table>\n");
    }
    for table in &chapter.tables {
        grid(page, table);
    }
    for drawn in &chapter.charts {
        let _ = writeln!(
            page,
            "<figure>{}<figcaption>{}</figcaption></figure>",
            chart::svg(drawn).unwrap_or_else(|why| format!("<p>{}</p>", escape(&why))),
            escape(&drawn.title)
        );
    }
    if !chapter.pictures.is_empty() {
        page.push_str("<div class=\"pictures\">\n");
        for picture in &chapter.pictures {
            let _ = writeln!(
                page,
                "<figure><img src=\"{}\" width=\"{}\" height=\"{}\" alt=\"{caption}\"><figcaption>{caption}</figcaption></figure>",
                data_uri("image/png", &picture.png),
                picture.width,
                picture.height,
                caption = escape(&picture.caption)
            );
        }
        page.push_str("</div>\n");
    }
    let _ = writeln!(page, "<p class=\"time\">{:.1} s</p>\n</section>", chapter.seconds);
}

fn row(page: &mut String, finding: &Finding) {
    let (class, word) = match finding.verdict {
        Verdict::Agrees => ("agrees", "agrees"),
        Verdict::Differs => ("differs", "differs"),
        Verdict::New => ("new", "not in the paper"),
    };
    let _ = writeln!(
        page,
        "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"{class}\">{word}</td><td>{}</td></tr>",
        escape(&finding.what),
        escape(&finding.paper),
        escape(&finding.ours),
        escape(&finding.remark)
    );
}

fn grid(page: &mut String, table: &Table) {
    let _ = writeln!(page, "<table>\n<caption>{}</caption>\n<thead><tr>", escape(&table.title));
    for column in &table.columns {
        let _ = write!(page, "<th>{}</th>", escape(column));
    }
    page.push_str("</tr></thead>\n<tbody>\n");
    for row in &table.rows {
        page.push_str("<tr>");
        for cell in row {
            let _ = write!(page, "<td>{}</td>", escape(cell));
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</tbody>\n</table>\n");
}
