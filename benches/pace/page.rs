//! The page in a real browser, without a screen.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde::Deserialize;

use crate::Failure;
use crate::daemon::Daemon;

/// What the page did, a second.
#[derive(Deserialize)]
pub(crate) struct Shown {
    /// Pictures painted.
    pub(crate) pictures: f64,
    /// Readings that the meter was handed.
    pub(crate) readings: f64,
}

/// Has a browser show the page for so long.
pub(crate) async fn show(daemon: &Daemon, lasting: Duration) -> Result<Shown, Failure> {
    let web = Path::new(env!("CARGO_MANIFEST_DIR")).join("web");
    let mut browser = Command::new("node");
    browser.arg("e2e/pace.mjs").arg(format!("http://{}", daemon.address)).arg(lasting.as_secs().to_string());
    browser.current_dir(web).env("PLENALIGN", env!("CARGO_BIN_EXE_plenalign")).stderr(Stdio::inherit());
    let output = tokio::task::spawn_blocking(move || browser.output()).await??;
    if !output.status.success() {
        return Err(format!("the page could not be timed: {}", output.status).into());
    }
    Ok(serde_json::from_slice(&output.stdout)?)
}
