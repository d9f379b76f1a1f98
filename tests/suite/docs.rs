//! What the repository's Markdown says: every link leads somewhere, every command line is one that the program takes, every
//! key is one that the configuration has.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use plenalign::config::Config;
use serde_json::Value;

use super::program::plenalign;

/// What looks like a key and is the name of one of `plenalign doctor`'s findings.
const FINDINGS: [&str; 5] = ["bench.lock", "server.access", "server.alpaca", "server.certificate", "server.open_files"];
/// Folders that hold what others have written, or what was made.
const NOT_OURS: [&str; 4] = [".git", "target", "node_modules", "dist"];
/// What `plenalign` may be followed by where it is a word of prose and no command.
const COMMANDS_BEGIN: fn(char) -> bool = |c| c.is_ascii_lowercase() || c == '-';

/// One Markdown file.
struct Page {
    /// Below the repository's root.
    path: PathBuf,
    text: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn pages() -> Vec<Page> {
    fn collect(folder: &Path, pages: &mut Vec<Page>) {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let (path, name) = (entry.path(), entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                if !NOT_OURS.iter().any(|&other| name == other) {
                    collect(&path, pages);
                }
            } else if path.extension().is_some_and(|extension| extension == "md") {
                let text = fs::read_to_string(&path).unwrap();
                pages.push(Page { path: path.strip_prefix(root()).unwrap().to_owned(), text });
            }
        }
    }
    let mut pages = Vec::new();
    collect(root(), &mut pages);
    assert!(pages.len() > 20, "the pages were not found");
    pages.sort_by(|one, other| one.path.cmp(&other.path));
    pages
}

/// A page's lines with their numbers, and whether each is within a fenced block.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str, bool)> {
    let mut fenced = false;
    text.lines().enumerate().map(move |(index, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        (index + 1, line, fenced || fence)
    })
}

/// What a heading can be linked by.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase()
}

/// The text of a heading as it is shown: without marks, and of a link its words.
fn shown(heading: &str) -> String {
    let mut shown = String::new();
    let mut rest = heading;
    while let Some((before, link)) = rest.split_once('[') {
        shown.push_str(before);
        let (words, after) = link.split_once(']').unwrap_or((link, ""));
        shown.push_str(words);
        rest = after.strip_prefix('(').and_then(|after| after.split_once(')')).map_or(after, |(_, after)| after);
    }
    (shown + rest).replace(['`', '*'], "")
}

/// Every anchor of a page: of headings that are alike the later ones are numbered.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut seen = BTreeMap::<String, usize>::new();
    let mut anchors = BTreeSet::new();
    for (_, line, fenced) in lines(text) {
        let heading = line.trim_start_matches('#');
        if fenced || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let name = anchor(&shown(heading.trim()));
        let count = seen.entry(name.clone()).or_default();
        anchors.insert(if *count == 0 { name } else { format!("{name}-{count}") });
        *count += 1;
    }
    anchors
}

/// The targets of a line's links and pictures, code left out.
fn targets(line: &str) -> Vec<String> {
    let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("`");
    let inline = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target.to_owned());
    inline.collect()
}

#[test]
fn every_link_leads_somewhere() {
    let pages = pages();
    let mut wrong = Vec::new();
    let mut count = 0;
    for page in &pages {
        let folder = page.path.parent().unwrap();
        for (number, line, fenced) in lines(&page.text) {
            if fenced {
                continue;
            }
            for target in targets(line) {
                if target.starts_with("http://") || target.starts_with("https://") || target.starts_with("mailto:") {
                    continue;
                }
                count += 1;
                let here = format!("{}:{number}: {target}", page.path.display());
                let (file, fragment) = target.split_once('#').unwrap_or((&target, ""));
                let path = if file.is_empty() { root().join(&page.path) } else { root().join(folder).join(file) };
                let Ok(path) = path.canonicalize() else {
                    wrong.push(format!("{here}: there is no such file"));
                    continue;
                };
                if path.strip_prefix(root().canonicalize().unwrap()).is_err() {
                    wrong.push(format!("{here}: leads out of the repository"));
                } else if !fragment.is_empty() && !anchors(&fs::read_to_string(&path).unwrap()).contains(fragment) {
                    wrong.push(format!("{here}: the page has no such heading"));
                }
            }
        }
    }
    assert!(count > 80, "only {count} links were found");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_page_is_in_the_index() {
    let index = fs::read_to_string(root().join("docs/README.md")).unwrap();
    for page in pages() {
        if page.path.parent() == Some(Path::new("docs")) && page.path.file_name().unwrap() != "README.md" {
            let name = page.path.file_name().unwrap().to_str().unwrap();
            assert!(index.contains(&format!("]({name})")), "docs/README.md has no link to {name}");
        }
    }
}

/// A command's own subcommands and flags, as its help has them.
struct Help {
    subcommands: BTreeSet<String>,
    flags: BTreeSet<String>,
}

/// The help of a command, e.g. `["jobs", "export"]`.
fn help(command: &[String]) -> Help {
    static ASKED: OnceLock<std::sync::Mutex<BTreeMap<Vec<String>, String>>> = OnceLock::new();
    let mut asked = ASKED.get_or_init(Default::default).lock().unwrap();
    let text = asked.entry(command.to_vec()).or_insert_with(|| {
        let state = tempfile::tempdir().unwrap();
        let output = plenalign(state.path()).args(command).arg("--help").output().unwrap();
        assert!(output.status.success(), "plenalign {} --help", command.join(" "));
        String::from_utf8(output.stdout).unwrap()
    });
    let (mut subcommands, mut flags) = (BTreeSet::new(), BTreeSet::from(["--help".to_owned(), "-h".to_owned()]));
    let mut in_commands = false;
    for line in text.lines() {
        if !line.starts_with(' ') {
            in_commands = line == "Commands:";
        } else if in_commands && line.starts_with("  ") && !line.starts_with("   ") {
            subcommands.extend(line.split_whitespace().next().map(str::to_owned));
        } else if line.trim_start().starts_with('-') {
            let words = line.split([' ', ',', '=', '[']).filter(|word| word.starts_with('-'));
            flags.extend(words.map(str::to_owned));
        }
    }
    Help { subcommands, flags }
}

/// The command lines in a page: of code, from `plenalign` to the end of the command.
fn command_lines(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut unfinished: Option<(usize, String)> = None;
    for (number, line, fenced) in lines(text) {
        let code: Vec<String> = if fenced || line.starts_with("    ") {
            match unfinished.take() {
                Some((begun, before)) => {
                    let whole = format!("{before} {}", line.trim());
                    if let Some(more) = whole.strip_suffix('\\') {
                        unfinished = Some((begun, more.to_owned()));
                        vec![]
                    } else {
                        vec![whole]
                    }
                }
                None => match line.strip_suffix('\\') {
                    Some(more) => {
                        unfinished = Some((number, more.to_owned()));
                        vec![]
                    }
                    None => vec![line.to_owned()],
                },
            }
        } else {
            line.split('`').skip(1).step_by(2).map(str::to_owned).collect()
        };
        for code in code {
            // What stands behind a word of its own, or behind a path to it.
            let mut rest = code.as_str();
            while let Some((before, after)) = rest.split_once("plenalign ") {
                let path = ["./", "bin/", "release/", "debug/"].iter().any(|folder| before.ends_with(folder));
                let begins = path || before.is_empty() || before.ends_with([' ', '(', '"', '=', '$', '|']);
                // `-u plenalign` is the user of that name, `-t plenalign` a container's.
                let named = before.split_whitespace().last().is_some_and(|word| word.starts_with('-') && word != "--");
                if begins && !named && after.starts_with(COMMANDS_BEGIN) {
                    let end = after.find(['|', '>', ';', '&', '#', ')', '…', '<']).unwrap_or(after.len());
                    found.push((number, after[..end].trim().to_owned()));
                }
                rest = after;
            }
        }
    }
    found
}

/// What is wrong with a command line, if anything.
fn fault(line: &str) -> Option<String> {
    let mut words = line.split_whitespace().peekable();
    let mut command = Vec::<String>::new();
    let mut flags = help(&command).flags;
    while let Some(word) = words.next() {
        let word = word.trim_matches(|c| matches!(c, '[' | ']' | '"' | '\'' | ','));
        if word.starts_with('-') {
            let flag = word.split('=').next().unwrap_or(word);
            if flag.starts_with("--") && !flags.contains(flag) {
                return Some(format!("`plenalign {}` knows no {flag}", command.join(" ")));
            }
            // A value of its own, which may look like a subcommand.
            if matches!(flag, "--config" | "--set") && !word.contains('=') {
                words.next();
            }
        } else {
            let here = help(&command);
            if here.subcommands.contains(word) {
                command.push(word.to_owned());
                flags = help(&command).flags;
            } else if command.is_empty() {
                return Some(format!("there is no `plenalign {word}`"));
            }
        }
    }
    None
}

#[test]
fn every_command_line_is_one_that_the_program_takes() {
    let mut wrong = Vec::new();
    let mut count = 0;
    for page in pages() {
        for (number, line) in command_lines(&page.text) {
            count += 1;
            if let Some(fault) = fault(&line) {
                wrong.push(format!("{}:{number}: plenalign {line}: {fault}", page.path.display()));
            }
        }
    }
    assert!(count > 90, "only {count} command lines were found");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(
        fault("serve --lisen x").is_some()
            && fault("aling").is_some()
            && fault("jobs export ID --format html").is_none()
    );
}

/// Every key of the configuration, dotted, with its sections.
fn keys() -> BTreeSet<String> {
    fn walk(schema: &Value, whole: &Value, path: &str, keys: &mut BTreeSet<String>) {
        let resolved = match schema.get("$ref").and_then(Value::as_str) {
            Some(reference) => whole.pointer(reference.trim_start_matches('#')).unwrap(),
            None => schema,
        };
        for (name, of) in resolved.get("properties").and_then(Value::as_object).into_iter().flatten() {
            let key = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            keys.insert(key.clone());
            for part in of.get("anyOf").and_then(Value::as_array).into_iter().flatten() {
                walk(part, whole, &key, keys);
            }
            walk(of, whole, &key, keys);
        }
        if let Some(named) = resolved.get("additionalProperties").filter(|named| named.is_object()) {
            keys.insert(format!("{path}.*"));
            walk(named, whole, &format!("{path}.*"), keys);
        }
    }
    let schema = Config::json_schema();
    let mut keys = BTreeSet::new();
    walk(&schema, &schema, "", &mut keys);
    assert!(keys.contains("bench.controllers.*.port") && keys.contains("shell.outer_radius_mm"), "{keys:?}");
    keys
}

/// Whether there is a key, under a name of the user's own or not; `at_end` is enough where a page writes a section's key
/// without its section.
fn is_key(keys: &BTreeSet<String>, key: &str, at_end: bool) -> bool {
    let same = |known: &str| {
        let (known, wanted): (Vec<_>, Vec<_>) = (known.split('.').collect(), key.split('.').collect());
        let known = if at_end { &known[known.len().saturating_sub(wanted.len())..] } else { &known[..] };
        known.len() == wanted.len() && known.iter().zip(&wanted).all(|(known, wanted)| *known == "*" || known == wanted)
    };
    keys.iter().any(|known| same(known))
}

#[test]
fn every_key_is_one_that_the_configuration_has() {
    let keys = keys();
    let sections: BTreeSet<&str> = keys.iter().filter_map(|key| key.split('.').next()).collect();
    let mut wrong = Vec::new();
    let mut count = 0;
    for page in pages() {
        let mut section = None;
        for (number, line, fenced) in lines(&page.text) {
            let mut check = |key: &str, at_end: bool| {
                count += 1;
                if !is_key(&keys, key, at_end) && !FINDINGS.contains(&key) {
                    wrong.push(format!("{}:{number}: the configuration has no {key}", page.path.display()));
                }
            };
            if line.trim_start().starts_with("```") {
                section = (line.trim() == "```toml").then(String::new);
            } else if let (true, Some(section)) = (fenced, &mut section) {
                // A piece of a configuration file.
                let line = line.split('#').next().unwrap_or_default().trim();
                if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
                    name.clone_into(section);
                    check(name, false);
                } else if let Some((key, _)) = line.split_once('=') {
                    let key =
                        if section.is_empty() { key.trim().to_owned() } else { format!("{section}.{}", key.trim()) };
                    check(&key, false);
                }
            } else if !fenced {
                for code in line.split('`').skip(1).step_by(2) {
                    // `[section]`, and `[section] key`.
                    if let Some((name, key)) = code.strip_prefix('[').and_then(|code| code.split_once(']')) {
                        let name = name.trim_matches('[');
                        if sections.contains(name.split('.').next().unwrap_or_default()) {
                            check(name, false);
                            let key = key.split('=').next().unwrap_or_default().trim();
                            if !key.is_empty() {
                                check(&format!("{name}.{key}"), false);
                            }
                        }
                    } else if let Some((key, _)) =
                        code.split('=').next().map(str::trim).and_then(|code| code.split_once(' ').or(Some((code, ""))))
                        && key.contains('.')
                        && key.split('.').next().is_some_and(|first| sections.contains(first))
                        && key.bytes().all(|byte| {
                            byte.is_ascii_lowercase() || byte.is_ascii_digit() || matches!(byte, b'_' | b'.')
                        })
                        && !is_path(key)
                    {
                        check(key, true);
                    }
                }
            }
            for setting in line.split("--set ").skip(1).filter_map(|rest| rest.split(['=', ' ']).next()) {
                if setting.contains('.') {
                    check(setting.trim_matches(['"', '\'']), false);
                }
            }
        }
    }
    assert!(count > 100, "only {count} keys were found");
    assert!(is_key(&keys, "bench.controllers.main.port", false) && is_key(&keys, "outer_radius_mm", true));
    assert!(!is_key(&keys, "shell.outer_radius", true) && !is_key(&keys, "outer_radius_mm", false));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Whether a word with a dot is a file's name, a protocol's or an answer's field rather than a key.
fn is_path(word: &str) -> bool {
    const FIELDS: [&str; 5] =
        ["camera.fault", "camera.replay", "recording.fault", "foxglove.sdk.v1", "foxglove.websocket.v1"];
    let extension = word.rsplit('.').next().unwrap_or_default();
    FIELDS.contains(&word)
        || ["md", "rs", "json", "toml", "jpg", "png", "py", "sh", "db", "html", "csv", "mcap"].contains(&extension)
}

/// The tests that stand beside the claims of docs/security.md are there: a claim whose test was renamed or taken away has
/// none.
/// Where tests are: what the names of those below a folder begin with, and the folder.
const FOLDERS: [(&str, &str); 4] =
    [("", "tests/suite"), ("", "src"), ("", "crates/bench/src"), ("control::", "crates/control/src")];

#[test]
fn every_test_named_beside_a_claim_is_there() {
    let text = fs::read_to_string(root().join("docs/security.md")).unwrap();
    let table = text.split_once("## What shows it").unwrap().1;
    let mut named = 0;
    let tests = table.lines().filter_map(|line| line.strip_prefix('|')?.split_once('|')).map(|(_, tests)| tests);
    for name in tests.flat_map(|tests| tests.split('`').skip(1).step_by(2)) {
        named += 1;
        let first = name.split_whitespace().next().unwrap();
        if first.contains('/') {
            assert!(root().join(first).exists(), "{name} is not there");
            for file in name.split_whitespace().skip(1) {
                assert!(root().join(file).exists(), "{file} is not there");
            }
            continue;
        }
        let is_there = FOLDERS.iter().any(|(module, folder)| {
            let Some(path) = name.strip_prefix(module) else { return false };
            let path: Vec<_> = path.split("::").collect();
            (1..=path.len()).any(|cut| {
                let module = root().join(folder).join(path[..cut].join("/"));
                let files = [module.with_extension("rs"), module.join("mod.rs")];
                let function = path[cut..].last();
                files.iter().filter_map(|file| fs::read_to_string(file).ok()).any(|source| match function {
                    Some(function) if path.len() - cut == 1 => source.contains(&format!("fn {function}(")),
                    Some(_) => false,
                    None => source.contains("test"),
                })
            })
        });
        assert!(is_there, "no test {name}");
    }
    assert!(named > 40, "{named}");
}
