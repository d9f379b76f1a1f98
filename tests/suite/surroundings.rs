//! The program where the system around it is another: a journal that takes its log, no libjpeg-turbo. In a mount
//! namespace, so that nothing of this machine changes.

use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::MetadataExt as _;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use serde_json::Value;

use super::daemon::client;
use super::program::own_mounts;

/// A daemon in a namespace of its own.
struct Secluded {
    child: Child,
    address: String,
}

impl Secluded {
    /// Starts one after `mounts`, a shell's commands in which `$0` is `argument`. Its log goes to a file, which its
    /// environment names as the journal's stream.
    fn start(mounts: &str, argument: &Path, state: &Path, log: &Path) -> Self {
        let log = File::create(log).unwrap();
        let stream = log.metadata().map(|file| format!("{}:{}", file.dev(), file.ino())).unwrap();
        let mut child = own_mounts()
            .args(["sh", "-ec", &format!("{mounts}; exec \"$@\"")])
            .args([argument, Path::new(env!("CARGO_BIN_EXE_plenalign"))])
            .args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--set", "bench.simulation.rays=4"])
            .env("PLENALIGN_STATE_DIR", state)
            .env("JOURNAL_STREAM", stream)
            .env("RUST_LOG", "plenalign=info")
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap_or_else(|_| panic!("the daemon did not start: {line:?}"));
        Self { child, address: said["address"].as_str().unwrap().trim_end_matches('/').to_owned() }
    }

    async fn snapshot(&self) -> Vec<u8> {
        let url = format!("{}/api/v1/snapshot.jpg", self.address);
        let answer = client().get(url).send().await.unwrap().error_for_status().unwrap();
        answer.bytes().await.unwrap().to_vec()
    }
}

impl Drop for Secluded {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[tokio::test]
async fn a_service_manager_s_journal_gets_the_log_with_its_fields() {
    let [run, state] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let journal = run.path().join("systemd/journal");
    std::fs::create_dir_all(&journal).unwrap();
    let socket = UnixDatagram::bind(journal.join("socket")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let log = state.path().join("log");
    let daemon = Secluded::start("mount --bind \"$0\" /run", run.path(), &state.path().join("state"), &log);
    daemon.snapshot().await;
    let mut entries = Vec::new();
    let mut entry = [0; 65_536];
    // The last that is wanted: of the encoder, which the first picture looks for, or of what opened.
    while !entries.iter().any(|entry: &String| entry.contains("MESSAGE") && entry.contains("SYSLOG_IDENTIFIER")) {
        let length = socket.recv(&mut entry).expect("the journal gets an entry");
        entries.push(String::from_utf8_lossy(&entry[..length]).into_owned());
    }
    let entry = entries.last().unwrap();
    assert!(entry.contains("plenalign") && entry.contains("PRIORITY"), "{entry:?}");
    assert_eq!(std::fs::read_to_string(&log).unwrap(), "", "what the journal has is not said twice");
}

#[tokio::test]
async fn without_libjpeg_turbo_pictures_are_encoded_all_the_same() {
    let state = tempfile::tempdir().unwrap();
    let empty = state.path().join("empty");
    std::fs::write(&empty, "").unwrap();
    let log = state.path().join("log");
    // Every file that the loader would take for it is an empty one.
    let hide = "for file in $(/sbin/ldconfig -p | sed -n 's/.*libturbojpeg\\.so\\.0 .*=> //p'); do \
                mount --bind \"$0\" \"$(readlink -f \"$file\")\"; done";
    let daemon = Secluded::start(&format!("unset JOURNAL_STREAM; {hide}"), &empty, &state.path().join("state"), &log);
    let picture = daemon.snapshot().await;
    let decoded = image::load_from_memory_with_format(&picture, image::ImageFormat::Jpeg).unwrap().to_luma8();
    assert!(decoded.width() > 100 && decoded.pixels().any(|pixel| pixel.0[0] > 50), "{}", decoded.width());
    let log = std::fs::read_to_string(&log).unwrap();
    assert!(log.contains("pictures are encoded without libjpeg-turbo"), "{log}");
}
