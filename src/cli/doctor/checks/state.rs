//! The state folder: room, history, tokens.

use crate::cli::doctor::facts::{Facts, FolderFacts, FolderKind, StateFacts, TokenFacts, quoted};
use crate::cli::doctor::finding::Finding;
use crate::config::Config;
use crate::store::{FILE_NAME, Inspection, ROOM_BYTES};

pub(super) fn check(facts: &Facts) -> Vec<Finding> {
    let state = match &facts.state {
        Ok(state) => state,
        Err(why) => {
            return vec![Finding::problem(
                "state.folder",
                "state folder",
                why,
                "export PLENALIGN_STATE_DIR=/var/lib/plenalign    # a folder that this user can write",
            )];
        }
    };
    let config = facts.configuration.config();
    let mut found = vec![folder("state.folder", "state folder", &state.folder, facts)];
    found.extend(room(&state.folder, config));
    found.push(history(state));
    found.push(tokens(state));
    if let Some(recordings) = &state.recordings {
        found.push(folder("state.recordings", "recordings", recordings, facts));
        found.extend(room_for_recordings(recordings, config));
    }
    found
}

fn folder(id: &'static str, what: &'static str, folder: &FolderFacts, facts: &Facts) -> Finding {
    let (path, user) = (folder.path.display(), &facts.user.name);
    if folder.kind == FolderKind::Other {
        let mend = format!("ls -ld {}    # move it away, or choose another folder", quoted(&folder.path));
        return Finding::problem(id, what, format!("{path} is no folder"), mend);
    }
    if folder.read_only {
        return Finding::problem(
            id,
            what,
            format!(
                "{path} cannot be written: its disk is mounted read-only, and nothing moves while the history cannot be written"
            ),
            format!("sudo mount -o remount,rw \"$(findmnt -no TARGET --target {})\"", quoted(&folder.nearest)),
        );
    }
    match (&folder.unwritable, folder.kind) {
        (Some(why), FolderKind::Missing) => Finding::problem(
            id,
            what,
            format!("{path} is not there, and {user} cannot make it: {why}"),
            format!("sudo install -d -m 750 -o {user} {}", quoted(&folder.path)),
        ),
        (Some(why), _) => Finding::problem(
            id,
            what,
            format!(
                "{path} cannot be written by {user} ({why}), and nothing moves while the history cannot be written"
            ),
            format!("sudo chown -R {user}: {}", quoted(&folder.path)),
        ),
        (None, FolderKind::Missing) => Finding::ok(id, what, format!("{path} will be made at the first start")),
        (None, _) => Finding::ok(id, what, format!("{path} can be written")),
    }
}

/// Whether there is room for the history.
fn room(folder: &FolderFacts, config: Option<&Config>) -> Option<Finding> {
    const ID: &str = "state.room";
    let (free, what) = (folder.free_bytes?, "disk");
    let mend = format!("df -h {0}; du -xsh {0}/* | sort -h | tail", quoted(&folder.nearest));
    if free < ROOM_BYTES {
        let detail = format!(
            "{} are free, {} are needed: nothing moves while the history cannot be written",
            size(free),
            size(ROOM_BYTES)
        );
        return Some(Finding::problem(ID, what, detail, mend));
    }
    let kept = config.map(keep_free).filter(|kept| free < *kept);
    Some(match kept {
        Some(kept) => Finding::warning(
            ID,
            what,
            format!("{} are free: a recording begins only where {} are (record.keep_free_mb)", size(free), size(kept)),
            mend,
        ),
        None => Finding::ok(ID, what, format!("{} are free", size(free))),
    })
}

fn room_for_recordings(folder: &FolderFacts, config: Option<&Config>) -> Option<Finding> {
    let (free, kept) = (folder.free_bytes?, keep_free(config?));
    (free < kept).then(|| {
        Finding::warning(
            "state.recordings_room",
            "recordings",
            format!("{} are free: a recording begins only where {} are (record.keep_free_mb)", size(free), size(kept)),
            format!("df -h {}", quoted(&folder.nearest)),
        )
    })
}

fn keep_free(config: &Config) -> u64 {
    u64::from(config.record.keep_free_mb) * 1_000_000
}

/// Bytes in words, as disks are sold.
fn size(bytes: u64) -> String {
    let mega = bytes as f64 / 1e6;
    if mega >= 1000.0 { format!("{:.1} GB", mega / 1000.0) } else { format!("{mega:.1} MB") }
}

fn history(state: &StateFacts) -> Finding {
    const ID: &str = "state.history";
    let file = state.folder.path.join(FILE_NAME);
    match &state.history {
        Ok(None) => Finding::ok(ID, "history", "there is none yet"),
        Ok(Some(Inspection { version, newest, .. })) if version > newest => Finding::problem(
            ID,
            "history",
            format!(
                "was written by a newer version of plenalign: its tables are version {version}, this program knows {newest}"
            ),
            format!("sudo apt install plenalign    # the newer version; or: mv {0} {0}.newer", quoted(&file)),
        ),
        Ok(Some(Inspection { version, newest, bytes })) if version < newest => Finding::note(
            ID,
            "history",
            format!(
                "{}, tables of version {version}: the daemon's next start brings them to version {newest}",
                size(*bytes)
            ),
        ),
        Ok(Some(Inspection { version, bytes, .. })) => {
            Finding::ok(ID, "history", format!("{}, tables of version {version}", size(*bytes)))
        }
        Err(why) => Finding::problem(
            ID,
            "history",
            why,
            format!("ls -l {0}; mv {0} {0}.damaged    # with it away, a new history is begun", quoted(&file)),
        ),
    }
}

fn tokens(state: &StateFacts) -> Finding {
    const ID: &str = "state.tokens";
    let many = |count: usize| if count == 1 { "1 token".to_owned() } else { format!("{count} tokens") };
    match &state.tokens {
        Ok(TokenFacts { valid, expired: 0 }) => Finding::ok(ID, "tokens", many(*valid)),
        Ok(TokenFacts { valid, expired }) => {
            Finding::note(ID, "tokens", format!("{} that let people in, {expired} expired", many(*valid)))
                .mend("plenalign token list    # then: plenalign token revoke NAME")
        }
        Err(why) => Finding::problem(
            ID,
            "tokens",
            why,
            format!(
                "ls -l {}    # the daemon does not start with tokens that it cannot read",
                quoted(&state.folder.path)
            ),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_said_as_disks_are_sold() {
        assert_eq!(size(4 << 20), "4.2 MB");
        assert_eq!(size(931_400_000_000), "931.4 GB");
    }
}
