//! `plenalign man` and `plenalign completions` as a package's build and a user meet them.

use std::collections::BTreeSet;
use std::fs;
use std::process::{Command, Output};

fn plenalign(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plenalign")).args(arguments).output().expect("the program starts")
}

/// The commands that `--help` lists of a command.
fn commands(of: &[&str]) -> Vec<String> {
    let output = plenalign(&[of, &["--help"]].concat());
    let help = String::from_utf8(output.stdout).expect("help is text");
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next());
    names.filter(|name| *name != "help").map(str::to_owned).collect()
}

#[test]
fn every_command_has_a_page() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let pages = folder.path().join("below/man");
    let output = plenalign(&["man", pages.to_str().expect("a plain name")]);
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    let mut expected = BTreeSet::from(["plenalign.1".to_owned()]);
    for command in commands(&[]) {
        expected.extend(commands(&[&command]).iter().map(|below| format!("plenalign-{command}-{below}.1")));
        expected.insert(format!("plenalign-{command}.1"));
    }
    assert!(expected.contains("plenalign-token-create.1") && expected.contains("plenalign-man.1"), "{expected:?}");
    let names = fs::read_dir(&pages).expect("the folder is made");
    let found: BTreeSet<_> = names.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    assert_eq!(found, expected);
    let serve = fs::read_to_string(pages.join("plenalign-serve.1")).expect("a page is text");
    assert!(serve.contains(".TH plenalign-serve 1") && serve.contains(r"\-\-simulated"), "{serve}");
}

#[test]
fn a_folder_that_cannot_be_made_is_named() {
    let file = tempfile::NamedTempFile::new().expect("a scratch file");
    let folder = file.path().join("man");
    let output = plenalign(&["man", folder.to_str().expect("a plain name")]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        !output.status.success() && said.contains(&format!("cannot make the folder {}", folder.display())),
        "{said}"
    );
}

#[test]
fn every_shell_completes_every_command() {
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let output = plenalign(&["completions", shell]);
        assert!(output.status.success() && output.stderr.is_empty(), "{shell}: {output:?}");
        let script = String::from_utf8(output.stdout).expect("a script is text");
        for command in commands(&[]) {
            assert!(script.contains(&command), "{shell} knows no {command}");
        }
    }
}

#[test]
fn another_shell_is_refused_with_those_that_are_known() {
    let output = plenalign(&["completions", "tcsh"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && said.contains("bash") && said.contains("fish"), "{said}");
}
