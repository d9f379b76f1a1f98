//! `plenalign study --quick`: what its report must say, and that an interrupted study goes on.

use serde_json::Value;

use super::measure_cli::{json, plenalign};

/// The findings of a chapter, by what they are about.
fn finding<'a>(results: &'a Value, chapter: &str, about: &str) -> &'a Value {
    let chapter = results["chapters"].as_array().unwrap().iter().find(|c| c["name"] == chapter).expect(chapter);
    let findings = chapter["findings"].as_array().unwrap();
    findings.iter().find(|f| f["what"].as_str().unwrap().contains(about)).unwrap_or_else(|| panic!("{about}"))
}

fn cells(results: &Value, chapter: &str, table: &str, column: &str) -> Vec<f64> {
    let chapter = results["chapters"].as_array().unwrap().iter().find(|c| c["name"] == chapter).expect(chapter);
    let table = chapter["tables"].as_array().unwrap().iter().find(|t| t["name"] == table).expect(table);
    let at = table["columns"].as_array().unwrap().iter().position(|c| c == column).expect(column);
    table["rows"].as_array().unwrap().iter().map(|row| row[at].as_str().unwrap().parse().unwrap()).collect()
}

#[test]
fn the_quick_study_holds_what_the_paper_claims() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("study");
    let run = || json(&["study", "--quick", "--json", "--out", out.to_str().unwrap()]);
    let results = run();

    // Table 2, to its last digit, and the f that follows from it.
    for optimisation in ["Δv, clarity", "Δv, joint"] {
        assert_eq!(finding(&results, "table_2", optimisation)["verdict"], "agrees");
    }
    // Clarity and joint far above direct, for every texture, on the same piece of board.
    let ratios = cells(&results, "clarity", "eog", "same board, mean per pixel");
    for texture in ratios.chunks_exact(4) {
        let [_, direct, clarity, joint] = texture else { panic!("{texture:?}") };
        assert!(*clarity > 1.5 * direct && *joint > 1.5 * direct, "{texture:?}");
        assert!((joint / clarity - 1.0).abs() < 0.15, "{texture:?}");
    }
    // What is seen of the board is what rays say.
    for off in cells(&results, "field_of_view", "cases", "difference, %") {
        assert!(off.abs() < 1.0, "{off}");
    }
    for off in cells(&results, "blur", "blur", "difference, px") {
        assert!(off.abs() < 0.3, "{off}");
    }
    for about in ["median of |z/z_true", "block artefacts", "energy of gradient of the scene"] {
        let found = finding(&results, "two_fish", about);
        assert_eq!(found["verdict"], "agrees", "{found}");
    }
    for what in cells(&results, "two_fish", "depth", "median |z/z_true − 1|, %") {
        assert!(what < 3.0, "{what}");
    }
    assert_eq!(finding(&results, "second_camera", "l_bound")["verdict"], "agrees");

    // The report stands alone; the tables and pictures are there.
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("data:image/png;base64,") && report.contains("SIMULATED"));
    assert!(!report.contains("src=\"http") && !report.contains("href=\"http"));
    assert!(out.join("tables/table_2-cases.csv").exists() && out.join("pictures/two_fish-depth.png").exists());

    // A chapter that was not finished is made again, and only that one.
    std::fs::remove_file(out.join("chapters/table_2.json")).unwrap();
    let again = plenalign(&["study", "--quick", "--out", out.to_str().unwrap()]);
    let told = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(again.status.success(), "{told}");
    assert_eq!(told.matches("kept from an earlier run").count(), 8, "{told}");
}
