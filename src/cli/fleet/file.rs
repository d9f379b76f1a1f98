//! The file that lists daemons.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::Deserialize;

use super::ask::{Target, address};
use crate::cli::remote::RemoteArgs;

/// A fleet as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fleet {
    #[serde(default)]
    daemon: Vec<Entry>,
}

/// `[[daemon]]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// What it is called.
    name: String,
    /// Where it is.
    url: String,
    /// PEM file with the authority that vouches for it.
    ca: Option<PathBuf>,
    /// File that holds a token for it.
    token_file: Option<PathBuf>,
}

/// Reads a file. A path in it that is not absolute is taken from the file's own folder; what an entry leaves out, the
/// command line has.
///
/// # Errors
/// What is wrong, and where.
pub(super) fn read(path: &Path, remote: &RemoteArgs) -> anyhow::Result<Vec<Target>> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {shown}"))?;
    let fleet: Fleet = toml::from_str(&text).map_err(|error| {
        let line = error.span().map_or(1, |span| text[..span.start.min(text.len())].matches('\n').count() + 1);
        anyhow::anyhow!("{shown}: line {line}: {}", error.message())
    })?;
    if fleet.daemon.is_empty() {
        bail!("{shown} lists no daemon: each is a section [[daemon]] with name and url");
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut targets: Vec<Target> = Vec::new();
    for entry in fleet.daemon {
        if targets.iter().any(|other| other.name == entry.name) {
            bail!("{shown}: two daemons are named {:?}", entry.name);
        }
        let of_entry = || format!("{shown}: daemon {:?}", entry.name);
        let url = address(&entry.url).with_context(of_entry)?;
        let token = match &entry.token_file {
            Some(file) => Some(token(&folder.join(file)).with_context(of_entry)?),
            None => remote.token.clone(),
        };
        let ca = entry.ca.as_ref().map(|file| folder.join(file)).or_else(|| remote.ca.clone());
        targets.push(Target { name: entry.name, url, remote: RemoteArgs { token, ca }, at: None });
    }
    Ok(targets)
}

/// The token in a file: its first line.
fn token(file: &Path) -> anyhow::Result<String> {
    use std::os::unix::fs::PermissionsExt as _;

    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let token = text.lines().next().unwrap_or_default().trim().to_owned();
    if token.is_empty() {
        bail!("{} holds no token", file.display());
    }
    let mode = std::fs::metadata(file).map_or(0, |found| found.permissions().mode());
    if mode & 0o077 != 0 {
        eprintln!("plenalign: {0} can be read by other users: chmod 600 {0}", file.display());
    }
    Ok(token)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fleet_is_read_with_what_each_daemon_needs() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("fleet.toml");
        let remote = RemoteArgs { token: Some("for all".to_owned()), ca: None };
        let write = |text: &str| std::fs::write(&file, text).unwrap();
        std::fs::write(folder.path().join("left.token"), "plenalign_left\n").unwrap();
        write(
            "[[daemon]]\nname = \"left\"\nurl = \"https://bench-1.lab:8443/\"\nca = \"ca.pem\"\n\
             token_file = \"left.token\"\n[[daemon]]\nname = \"right\"\nurl = \"http://127.0.0.1:8080\"\n",
        );
        let targets = read(&file, &remote).unwrap();
        assert_eq!(targets.len(), 2);
        let (left, right) = (&targets[0], &targets[1]);
        assert_eq!((left.name.as_str(), left.url.as_str()), ("left", "https://bench-1.lab:8443/"));
        assert_eq!(left.remote.token.as_deref(), Some("plenalign_left"));
        assert_eq!(left.remote.ca.as_deref(), Some(folder.path().join("ca.pem").as_path()));
        assert_eq!((right.remote.token.as_deref(), &right.remote.ca), (Some("for all"), &None));

        for (text, said) in [
            ("", "lists no daemon"),
            ("[[daemon]]\nname = \"a\"\nurl = \"http://a\"\ntoken = \"x\"\n", "line 4: unknown field `token`"),
            ("[[daemon]]\nname = \"a\"\n", "missing field `url`"),
            ("[[daemon]]\nname = \"a\"\nurl = \"a:80\"\n", "\"a:80\" is not an address"),
            ("[[daemon]]\nname = \"a\"\nurl = \"http://a\"\ntoken_file = \"none\"\n", "cannot read"),
            (
                "[[daemon]]\nname = \"a\"\nurl = \"http://a\"\n[[daemon]]\nname = \"a\"\nurl = \"http://b\"\n",
                "two daemons are named \"a\"",
            ),
            ("[[daemon]\n", "line 1"),
        ] {
            write(text);
            let refused = format!("{:#}", read(&file, &remote).unwrap_err());
            assert!(refused.contains(said) && refused.contains("fleet.toml"), "{said}: {refused}");
        }
    }
}
