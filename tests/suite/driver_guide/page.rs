//! The page's code is the code that was compiled, and what it says to change can be changed like that.

use std::fs;
use std::path::Path;

const PAGE: &str = "docs/write-a-driver.md";

/// The files that the page's blocks of Rust are pieces of, beside each what the page calls it.
const FILES: [(&str, &str); 3] = [
    ("tests/suite/driver_guide/fjell.rs", include_str!("fjell.rs")),
    ("tests/suite/driver_guide/twin.rs", include_str!("twin.rs")),
    ("tests/suite/driver_guide/mod.rs", include_str!("mod.rs")),
];

fn read(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The lines of the page's fenced blocks of a kind, block by block.
fn blocks(page: &str, kind: &str) -> Vec<Vec<String>> {
    let mut blocks = Vec::new();
    let mut block: Option<(bool, Vec<String>)> = None;
    for line in page.lines() {
        if let Some(said) = line.strip_prefix("```") {
            match block.take() {
                Some((true, lines)) => blocks.push(lines),
                Some((false, _)) => {}
                None => block = Some((said == kind, Vec::new())),
            }
        } else if let Some((_, lines)) = &mut block {
            lines.push(line.to_owned());
        }
    }
    assert!(block.is_none(), "{PAGE}: a block has no end");
    blocks
}

#[test]
fn every_block_of_rust_is_a_piece_of_what_was_compiled() {
    let page = read(PAGE);
    let rust = blocks(&page, "rust");
    assert!(rust.len() >= 6, "{PAGE} has {} blocks of Rust", rust.len());
    for block in &rust {
        let found = FILES.iter().any(|(_, text)| {
            let lines: Vec<&str> = text.lines().collect();
            lines.windows(block.len()).any(|window| window == block.as_slice())
        });
        assert!(found, "{PAGE}: this is in none of the compiled files, line by line:\n{}", block.join("\n"));
    }
}

#[test]
fn the_page_shows_the_whole_driver() {
    let shown: Vec<String> = blocks(&read(PAGE), "rust").concat();
    let missing: Vec<&str> = FILES[0].1.lines().filter(|line| !shown.iter().any(|shown| shown == line)).collect();
    assert!(missing.is_empty(), "{PAGE} does not show these lines of {}:\n{}", FILES[0].0, missing.join("\n"));
}

#[test]
fn what_is_to_be_changed_is_where_the_page_says() {
    let diffs = blocks(&read(PAGE), "diff");
    assert!(diffs.len() >= 4, "{PAGE} has {} changes", diffs.len());
    for diff in diffs {
        let file = diff.first().and_then(|line| line.strip_prefix("+++ ")).unwrap_or_else(|| {
            panic!("{PAGE}: a block of changes begins with `+++ ` and a file: {diff:?}");
        });
        let text = read(file);
        for line in &diff[1..] {
            if let Some(context) = line.strip_prefix(' ') {
                assert!(text.lines().any(|there| there == context), "{PAGE}: {file} has no line `{context}`");
            } else {
                assert!(line.starts_with(['+', '@']), "{PAGE}: `{line}` is neither added nor there already");
            }
        }
    }
}
