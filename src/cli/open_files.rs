//! Files that the daemon may have open at once, against those that its connections take: a stop needs some of them, too.

use anyhow::bail;
use nix::sys::resource::{Resource, getrlimit, setrlimit};

use crate::api::server::RESERVE;

/// Files that are open whoever is connected: listeners, ports, camera, history, recordings, broker, announcement.
const OWN: u64 = 96;
/// Files of a connection: its socket, and the recording that is sent over it.
const EACH: u64 = 2;

/// Raises the soft limit of this process to its hard one, which no privilege is needed for, and returns it.
fn raise() -> nix::Result<u64> {
    let (soft, hard) = getrlimit(Resource::RLIMIT_NOFILE)?;
    if soft < hard {
        setrlimit(Resource::RLIMIT_NOFILE, hard, hard)?;
    }
    Ok(hard)
}

/// How many files this process may have open once it has raised its limit; `None` where the system does not say.
pub(super) fn hard_limit() -> Option<u64> {
    getrlimit(Resource::RLIMIT_NOFILE).ok().map(|(_, hard)| hard)
}

/// Files that so many connections take, with the reserve for the stop and the daemon's own.
pub(super) const fn needed(connections: usize) -> u64 {
    (connections as u64).saturating_mul(EACH).saturating_add(RESERVE as u64 + OWN)
}

/// Of so many connections those that fit into a limit.
fn that_fit(connections: usize, limit: u64) -> usize {
    let room = limit.saturating_sub(needed(0)) / EACH;
    usize::try_from(room).map_or(connections, |room| room.min(connections))
}

/// Raises the limit on open files, and returns how many of the configured connections it leaves room for; where these
/// are fewer, that is said.
///
/// # Errors
/// Where there is room for none.
pub(super) fn connections_for(configured: usize) -> anyhow::Result<usize> {
    let limit = match raise() {
        Ok(limit) => limit,
        Err(error) => {
            tracing::warn!(%error, "the limit on open files cannot be raised");
            let (soft, _) = getrlimit(Resource::RLIMIT_NOFILE)?;
            soft
        }
    };
    let connections = that_fit(configured, limit);
    if connections == 0 {
        bail!(
            "the system lets this process have {limit} open files, and the daemon needs {} at least, so that a stop gets \
             through: raise the limit (ulimit -n, or LimitNOFILE= in the unit)",
            needed(1)
        );
    }
    if connections < configured {
        let said = format!(
            "server.max_connections = {configured} takes {} open files, and the system lets this process have {limit}: \
             {connections} connections are served at once; raise the limit (ulimit -n, or LimitNOFILE= in the unit)",
            needed(configured)
        );
        tracing::warn!("{said}");
        eprintln!("plenalign: {said}");
    }
    Ok(connections)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_leaves_the_reserve_and_the_daemons_own_files_alone() {
        assert_eq!(needed(256), 736);
        for (limit, fitting) in
            [(0, 0), (224, 0), (225, 0), (226, 1), (300, 38), (735, 255), (736, 256), (u64::MAX, 256)]
        {
            assert_eq!(that_fit(256, limit), fitting, "{limit}");
        }
    }
}
