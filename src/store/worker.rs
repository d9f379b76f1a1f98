//! The thread that writes.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use rusqlite::Connection;
use tokio::sync::watch;

use super::disk::{self, Identity};
use super::health::{Health, StoreError};
use super::write::Writer;
use super::{Hindrance, records, schema};

/// Between two looks at the disk while nothing is written.
const LOOK: Duration = Duration::from_secs(1);
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
}

/// Carries commands out until nobody can send any more.
pub(super) fn run(
    place: Place,
    commands: &Receiver<Command>,
    health: &watch::Sender<Health>,
    hindrance: &Mutex<Hindrance>,
) {
    let mut worker = Worker { place, open: None, opened: 0, health, hindrance };
    worker.look();
    loop {
        match commands.recv_timeout(LOOK) {
            Ok(Command::Write { needs_room, act }) => worker.write(needs_room, act),
            Err(RecvTimeoutError::Timeout) => worker.look(),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl Worker<'_> {
    /// Looks whether the history can be written; while it could not be, by writing.
    fn look(&mut self) {
        let was_writable = matches!(*self.health.borrow(), Health::Writable { .. });
        let found = self.ready(true).and_then(|open| if was_writable { Ok(()) } else { probe(open) });
        self.tell(found);
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
    std::fs::create_dir_all(folder)
        .map_err(|error| StoreError::Unusable(format!("cannot make the state folder {}: {error}", folder.display())))?;
    let connection = open_file(path).map_err(|error| error.of(path))?;
    Ok((connection, Identity::of(path)))
}

fn open_file(path: &Path) -> Result<Connection, StoreError> {
    let mut connection = Connection::open(path)?;
    connection.busy_timeout(BUSY_ALLOWED)?;
    // Readers never wait, and a commit is on the disk when it returns, also when the power fails.
    connection.pragma_update(None, "journal_mode", "wal")?;
    connection.pragma_update(None, "synchronous", "full")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    schema::bring_up_to_date(&mut connection)?;
    Ok(connection)
}
