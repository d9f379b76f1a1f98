//! What happens to the bench and the daemon without anybody's asking: time, connections, faults, restarts and kills.

use std::path::PathBuf;
use std::time::Duration;

use tokio::time::Instant;

use super::super::until::elapse;
use super::exchange::Mark;
use super::leases::Why;
use super::life::Life;
use super::requests::Shown;
use super::rig::Trouble;
use super::run::Run;
use super::steps::{By, Wish};

/// Longest that axes may take to come to rest.
const REST_WITHIN: Duration = Duration::from_secs(30);
/// Longest that a lease is waited for to run out.
const EXPIRES_WITHIN: Duration = Duration::from_secs(16);

impl Run {
    pub(super) async fn expire(&mut self) {
        let Some((at, lease)) = self.known.leases.iter().enumerate().rev().find(|(_, lease)| lease.over.is_none())
        else {
            return;
        };
        let until = lease.until;
        if lease.is_held() || until.1 > Instant::now() + EXPIRES_WITHIN {
            return;
        }
        let wait = |moment: Instant| elapse(moment.saturating_duration_since(Instant::now()));
        wait(until.0 - Duration::from_millis(4)).await;
        let moving = self.in_motion();
        wait(until.1 + Duration::from_millis(150)).await;
        let now = self.mark();
        self.known.pass(now);
        let expired = matches!(self.known.leases[at].over, Some((_, Why::Expired)));
        self.tally.expiries_in_motion += u64::from(moving && expired);
        // Long enough for what should have ended to be seen moving.
        elapse(Duration::from_millis(900)).await;
    }

    pub(super) async fn rest(&self) {
        let until = Instant::now() + REST_WITHIN;
        let mut still = 0;
        while still < 6 && Instant::now() < until {
            elapse(Duration::from_millis(50)).await;
            still = if self.in_motion() { 0 } else { still + 1 };
        }
    }

    pub(super) async fn connect(&mut self, by: By) {
        let Some((who, Shown { lease: Some(key), .. }, _)) = self.resolve(by, &Wish::Renew).await else { return };
        let held = self.life.as_mut().unwrap().hold(who, &key).await;
        let now = self.mark();
        self.known.pass(now);
        if held {
            self.known.connected(&key);
            self.tally.connections += 1;
        }
    }

    pub(super) fn trouble(&mut self, trouble: Trouble) {
        self.tally.troubles += 1;
        self.rig.suffer(trouble);
        let now = self.mark();
        let lasts = matches!(trouble, Trouble::Unplug | Trouble::Late(_));
        let forgets = matches!(trouble, Trouble::PowerCycle);
        self.known.suffer(now, forgets, lasts);
    }

    /// Puts something in the place of the state folder, or the folder back.
    pub(super) async fn fill_disk(&mut self, full: bool) {
        if full == self.known.unwritable {
            return;
        }
        let (folder, away) = (self.folder(), self.state.path().join("away"));
        if full {
            std::fs::rename(&folder, &away).unwrap();
            std::fs::write(&folder, "in the way").unwrap();
            self.known.unwritable = true;
            self.tally.full_disks += 1;
        } else {
            std::fs::remove_file(&folder).unwrap();
            std::fs::rename(&away, &folder).unwrap();
            self.life().writable().await;
            self.known.unwritable = false;
            if self.known.latched.is_some() {
                self.known.kept_latch = self.known.latched;
            }
        }
    }

    pub(super) fn folder(&self) -> PathBuf {
        self.state.path().join("state")
    }

    pub(super) async fn restart(&mut self, kill: bool) {
        let (down, moving) = (self.mark(), self.in_motion());
        let life = self.life.take().unwrap();
        if kill {
            self.tally.kills += 1;
            self.tally.kills_in_motion += u64::from(moving);
            life.kill(!self.known.unwritable).await;
        } else {
            life.end().await;
        }
        let down = Mark { at: if kill { down.at } else { Instant::now() }, ..down };
        let life = Life::start(&self.rig, &self.folder()).await;
        self.known.secrets.extend(life.tokens.values().cloned());
        self.life = Some(life);
        let up = self.mark();
        self.known.restarted(down, up, kill);
        (self.anew, self.restarted) = (true, true);
        self.tally.restarts += 1;
        self.tally.latched_restarts += u64::from(self.known.kept_latch == Some(true));
    }
}
