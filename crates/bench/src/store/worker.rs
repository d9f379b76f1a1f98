//! The thread that writes.

use std::fs::OpenOptions;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rusqlite::Connection;
use tokio::sync::watch;

use super::backlog::Backlog;
use super::disk::{self, Identity};
use super::health::{Health, StoreError};
use super::write::Writer;
use super::{Hindrance, records, schema};
use crate::state_folder::{OWNERS, make_folder, restrict};

/// Between two looks at the disk while nothing is written.
const LOOK: Duration = Duration::from_secs(1);
/// Largest file of an older version that is written anew so that it can shrink, bytes: it takes some seconds.
const QUICK_BYTES: u64 = 256 << 20;
/// Room that the file's companion keeps, bytes.
const WAL_BYTES: i64 = 4 << 20;
/// How long another program may hold the file.
const BUSY_ALLOWED: Duration = Duration::from_secs(2);

/// Where a history is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// In a file.
    File(PathBuf),
    /// Nowhere but in memory.
    Memory,
}

impl Place {
    /// The file, where there is one.
    #[must_use]
    pub const fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::File(path) => Some(path),
            Self::Memory => None,
        }
    }
}

/// Carries a change out in a transaction, and returns once that is committed, or why it is not.
pub(super) type Transact<'a> =
    dyn FnMut(&mut dyn FnMut(&Writer<'_>) -> rusqlite::Result<()>) -> Result<(), StoreError> + 'a;
type Act = Box<dyn FnOnce(&mut Transact<'_>) -> Result<(), StoreError> + Send>;

/// What the thread is asked.
pub(super) enum Command {
    /// To carry out a change, in a transaction of its own.
    Write {
        /// Whether there has to be room for what comes after it, too.
        needs_room: bool,
        /// Makes the change with what it is given, and tells whoever asked.
        act: Act,
    },
    /// To write what waits of the audit log, and to tell whoever asked that this was tried.
    WriteAudit {
        /// Whoever asked.
        written: Option<SyncSender<Result<(), StoreError>>>,
    },
}

struct Open {
    connection: Connection,
    /// Counted from 1.
    number: u64,
    identity: Option<Identity>,
}

struct Worker<'a> {
    place: Place,
    open: Option<Open>,
    opened: u64,
    health: &'a watch::Sender<Health>,
    hindrance: &'a Mutex<Hindrance>,
    backlog: &'a Mutex<Backlog>,
}

/// Carries commands out until nobody can send any more.
pub(super) fn run(
    place: Place,
    commands: &Receiver<Command>,
    health: &watch::Sender<Health>,
    hindrance: &Mutex<Hindrance>,
    backlog: &Mutex<Backlog>,
) {
    let mut worker = Worker { place, open: None, opened: 0, health, hindrance, backlog };
    worker.look();
    loop {
        match commands.recv_timeout(LOOK) {
            Ok(Command::Write { needs_room, act }) => {
                worker.write_audit(false);
                worker.write(needs_room, act);
            }
            Ok(Command::WriteAudit { written }) => {
                worker.write_audit(written.is_some());
                if let Some(written) = written {
                    let _ = written.send(Ok(()));
                }
            }
            Err(RecvTimeoutError::Timeout) => worker.look(),
            Err(RecvTimeoutError::Disconnected) => return worker.write_audit(true),
        }
    }
}

impl Worker<'_> {
    /// Looks whether the history can be written; while it could not be, by writing.
    fn look(&mut self) {
        let was_writable = matches!(*self.health.borrow(), Health::Writable { .. });
        let found = self.ready(true).and_then(|open| if was_writable { Ok(()) } else { probe(open) });
        self.tell(found);
        self.write_audit(false);
        // Nobody waits now: what was written goes from the companion into the file, which shrinks only then.
        if let Some(open) = &self.open
            && let Err(error) = open.connection.query_row("PRAGMA wal_checkpoint(PASSIVE)", [], |_| Ok(()))
        {
            tracing::debug!(%error, "the history's companion stays as it is for now");
        }
    }

    fn waiting(&self) -> MutexGuard<'_, Backlog> {
        self.backlog.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes what waits of the audit log. While the history cannot be written it is tried only where `insist`: the next
    /// look at the disk finds out.
    fn write_audit(&mut self, insist: bool) {
        while !self.waiting().is_empty() {
            if !insist && !matches!(*self.health.borrow(), Health::Writable { .. }) {
                return;
            }
            let batch = self.waiting().oldest();
            let done = self.ready(false).and_then(|open| {
                transact(&mut open.connection, open.number, &mut |writer| {
                    batch.iter().try_for_each(|entry| writer.add_audit(entry))
                })
            });
            match done {
                Ok(()) => self.waiting().written(batch.len()),
                Err(StoreError::Refused(why)) => {
                    // What the file will never take must not hold up what comes after it.
                    tracing::error!(why, entries = ?batch, "entries of the audit log are not in the history");
                    self.waiting().written(batch.len());
                }
                Err(error) => {
                    self.open = None;
                    return self.tell(Err(error));
                }
            }
        }
    }

    fn write(&mut self, needs_room: bool, act: Act) {
        let done = act(&mut |change| {
            let open = self.ready(needs_room)?;
            let done = transact(&mut open.connection, open.number, change);
            if matches!(done, Err(StoreError::Unusable(_))) {
                // What has failed is not trusted again.
                self.open = None;
            }
            done
        });
        match done {
            // There may be less room than motion needs: the next look says so.
            Ok(()) if !needs_room => {}
            Err(StoreError::Refused(_)) => {}
            done => self.tell(done),
        }
    }

    /// The connection, opened anew where the file is no longer the one that was opened.
    fn ready(&mut self, needs_room: bool) -> Result<&mut Open, StoreError> {
        let hindrance = *self.hindrance.lock().unwrap_or_else(PoisonError::into_inner);
        std::thread::sleep(hindrance.delay);
        if hindrance.full {
            return Err(StoreError::Unusable("the disk is full: the simulated bench is told to have it so".to_owned()));
        }
        if let Place::File(path) = &self.place {
            if self.open.as_ref().is_some_and(|open| open.identity != Identity::of(path)) {
                tracing::warn!(path = %path.display(), "the history's file is gone or another one; it is opened anew");
                self.open = None;
            }
            if needs_room && self.open.is_some() {
                disk::check(path)?;
            }
        }
        match self.open.take() {
            Some(open) => Ok(self.open.insert(open)),
            None => {
                let (connection, identity) = open(&self.place)?;
                let open = Open { connection, number: self.opened + 1, identity };
                if let (true, Place::File(path)) = (needs_room, &self.place) {
                    disk::check(path)?;
                }
                self.opened += 1;
                Ok(self.open.insert(open))
            }
        }
    }

    /// Says how it went.
    fn tell(&mut self, found: Result<(), StoreError>) {
        let health = match found {
            Ok(()) => Health::Writable { opened: self.opened },
            Err(error) => Health::Unwritable { why: error.to_string() },
        };
        self.health.send_if_modified(|told| {
            let changed = *told != health;
            if changed {
                match &health {
                    Health::Unwritable { why } => tracing::error!(why, "the history cannot be written"),
                    _ => tracing::info!("the history is written"),
                }
                *told = health;
            }
            changed
        });
    }
}

/// Carries a change out as a whole or not at all.
fn transact(
    connection: &mut Connection,
    number: u64,
    change: &mut dyn FnMut(&Writer<'_>) -> rusqlite::Result<()>,
) -> Result<(), StoreError> {
    let file = connection.path().map(PathBuf::from).filter(|path| !path.as_os_str().is_empty());
    let done = connection.transaction().and_then(|transaction| {
        change(&Writer::new(&transaction, number))?;
        transaction.commit()
    });
    done.map_err(|error| match &file {
        Some(file) => StoreError::from(error).of(file),
        None => error.into(),
    })
}

/// Finds out by writing.
fn probe(open: &mut Open) -> Result<(), StoreError> {
    let written = records::Kept { bench: String::new(), key: "probe".to_owned(), value: serde_json::Value::Null };
    transact(&mut open.connection, open.number, &mut |writer| writer.keep(&written))
}

fn open(place: &Place) -> Result<(Connection, Option<Identity>), StoreError> {
    let Place::File(path) = place else {
        let mut connection = Connection::open_in_memory()?;
        schema::bring_up_to_date(&mut connection)?;
        return Ok((connection, None));
    };
    let folder = path.parent().unwrap_or(path);
    make_folder(folder)
        .map_err(|error| StoreError::Unusable(format!("cannot make the state folder {}: {error}", folder.display())))?;
    keep_private(path)
        .map_err(|error| StoreError::Unusable(format!("cannot make the history's file {}: {error}", path.display())))?;
    let connection = open_file(path).map_err(|error| error.of(path))?;
    Ok((connection, Identity::of(path)))
}

/// Makes a file able to give room back. A new one is at once; one of an older version is written anew, as long as that is
/// quick and the disk has room for it twice: nothing moves before the history is open.
fn make_shrinkable(connection: &Connection, path: &Path) -> Result<(), StoreError> {
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    if number("auto_vacuum")? != 0 {
        return Ok(());
    }
    connection.pragma_update(None, "auto_vacuum", "incremental")?;
    let bytes = number("page_count")?.saturating_mul(number("page_size")?).unsigned_abs();
    if bytes == 0 {
        return Ok(());
    }
    let room = disk::free_bytes(path).is_some_and(|free| free > 2 * bytes + disk::ROOM_BYTES);
    if bytes > QUICK_BYTES || !room {
        tracing::info!(path = %path.display(), bytes, "the history's file is not made able to shrink");
        return Ok(());
    }
    if let Err(error) = connection.execute_batch("VACUUM") {
        tracing::info!(path = %path.display(), %error, "the history's file is not made able to shrink");
    }
    Ok(())
}

/// Makes the file before SQLite does, which would leave its permissions to the umask; its companions get those of the
/// file. What it or they have from before is mended. SQLite does not say what keeps a file from being made.
fn keep_private(path: &Path) -> std::io::Result<()> {
    match OpenOptions::new().write(true).create_new(true).mode(OWNERS).open(path) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    for companion in ["", "-wal", "-shm"] {
        let mut name = path.as_os_str().to_owned();
        name.push(companion);
        restrict(Path::new(&name), OWNERS);
    }
    Ok(())
}

fn open_file(path: &Path) -> Result<Connection, StoreError> {
    let mut connection = Connection::open(path)?;
    connection.busy_timeout(BUSY_ALLOWED)?;
    // Readers never wait, and a commit is on the disk when it returns, also when the power fails.
    make_shrinkable(&connection, path)?;
    connection.pragma_update(None, "journal_mode", "wal")?;
    // What a large transaction has made of the companion is given back.
    connection.pragma_update(None, "journal_size_limit", WAL_BYTES)?;
    connection.pragma_update(None, "synchronous", "full")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    schema::bring_up_to_date(&mut connection)?;
    Ok(connection)
}
