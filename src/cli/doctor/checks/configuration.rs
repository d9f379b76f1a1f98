//! The configuration: whether it is read, and what is wrong with it.

use crate::cli::doctor::facts::{ConfigurationFacts, Facts, quoted};
use crate::cli::doctor::finding::Finding;
use crate::config::{Config, ConfigError, PRESET_ORIGIN, Position};

const FILE: &str = "configuration.file";

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let configuration = &facts.configuration;
    let mut found = match &configuration.config {
        Ok(config) => usable(configuration, config),
        Err(error) => unusable(configuration, error),
    };
    if let Some(service) = &configuration.service_file {
        found.push(
            Finding::note(
                "configuration.service",
                service.display().to_string(),
                "is what the service reads; it has not been looked at",
            )
            .mend(format!("plenalign --config {} doctor", quoted(service))),
        );
    }
    found
}

fn usable(configuration: &ConfigurationFacts, config: &Config) -> Vec<Finding> {
    let mut found = vec![match &configuration.file {
        Some(file) => Finding::ok(FILE, file.display().to_string(), "is read, and makes physical sense"),
        None => {
            let told = Finding::note(FILE, "configuration", format!("no file is named: the {PRESET_ORIGIN}, stands"));
            match configuration.service_file {
                Some(_) => told,
                None => told.mend("plenalign --config FILE doctor    # every key: deploy/plenalign.toml"),
            }
        }
    }];
    for notice in config.notices() {
        let mend = format!("{}    # then: plenalign doctor again", edit(configuration, None));
        found.push(Finding::warning("configuration.notice", "configuration", notice, mend));
    }
    found
}

fn unusable(configuration: &ConfigurationFacts, error: &ConfigError) -> Vec<Finding> {
    let name = configuration.name();
    let file = configuration.file.as_deref().map_or_else(|| "FILE".to_owned(), quoted);
    match error {
        ConfigError::Read { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            vec![Finding::problem(
                FILE,
                name,
                "is not there",
                format!("ls -l {file}    # correct the path after --config"),
            )]
        }
        ConfigError::Read { source, .. } => {
            vec![Finding::problem(FILE, name, format!("cannot be read: {source}"), format!("ls -l {file}"))]
        }
        ConfigError::Syntax { position, message, .. } => vec![Finding::problem(
            "configuration.syntax",
            name,
            format!("{position}: it is not TOML: {message}"),
            edit(configuration, Some(*position)),
        )],
        ConfigError::Invalid { violations, .. } => violations
            .iter()
            .map(|violation| {
                let (key, message) = (&violation.key, &violation.message);
                if error.is_of_set() || violation.is_of_set() {
                    let mend =
                        "plenalign --set assembly.initial_e_mm=25 doctor    # KEY=VALUE, as in deploy/plenalign.toml";
                    return Finding::problem("configuration.set", format!("--set {key}"), violation.to_string(), mend);
                }
                let place = violation.position.map_or_else(String::new, |position| format!("{position}: "));
                let mend = edit(configuration, violation.position);
                Finding::problem("configuration.key", key, format!("{place}{message}"), mend)
            })
            .collect(),
    }
}

/// The command that opens the configuration at a place.
fn edit(configuration: &ConfigurationFacts, position: Option<Position>) -> String {
    match &configuration.file {
        None => "correct what follows --set".to_owned(),
        Some(file) => {
            let line = position.map_or_else(String::new, |position| format!("+{} ", position.line));
            format!("${{EDITOR:-nano}} {line}{}", quoted(file))
        }
    }
}
