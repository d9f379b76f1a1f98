//! The history on disk: plain records in, plain records out, in one SQLite file in the state folder.
//!
//! A thread of its own owns the connection that writes; commands reach it through a bounded queue, in order, each
//! committed before the next. Nobody waits for the disk who does not ask to: [`Store::queue`] returns at once,
//! [`Store::write`] waits, but not for ever. Reading has a connection of its own and never waits for writing.
//!
//! A file that cannot be written (disk full, read-only, folder gone) is not the end: [`Store::health`] says why, the
//! thread tries again every second, and goes on when it can.

mod backlog;
mod bench;
mod disk;
mod health;
mod inspection;
mod prune;
pub mod read;
pub mod records;
mod schema;
mod worker;
pub mod write;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rusqlite::Connection;
use tokio::sync::watch;

pub use bench::BenchName;
pub use disk::{ROOM_BYTES, free};
pub use health::{Health, StoreError};
pub use inspection::{Inspection, inspect};
pub use prune::{Deleted, Limits};
pub use read::{JobFilter, Page};
pub use worker::Place;
pub use write::Writer;

use backlog::Backlog;
use records::Audit;
use worker::{Command, Transact};

/// The history's file within the state folder.
pub const FILE_NAME: &str = "history.db";
/// Commands that may wait for the disk; more means that it has stopped taking any.
const QUEUE: usize = 4096;
/// Between two looks whether a full queue takes a command.
const QUEUE_LOOK: Duration = Duration::from_millis(5);
/// Longest wait for a command to be on the disk.
const WRITE_ALLOWED: Duration = Duration::from_secs(5);

/// What keeps the history from being written, on purpose. By default nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Hindrance {
    /// Whether the disk is to be taken for a full one.
    pub full: bool,
    /// How much longer than it should every command takes.
    pub delay: Duration,
}

/// The history. Cheap to clone; the thread ends with the last clone, once it has written what was queued.
#[derive(Clone)]
pub struct Store {
    shared: Arc<Shared>,
}

struct Shared {
    place: Place,
    commands: SyncSender<Command>,
    health: watch::Receiver<Health>,
    hindrance: Arc<Mutex<Hindrance>>,
    /// Entries of the audit log that are not on the disk yet.
    backlog: Arc<Mutex<Backlog>>,
    /// What reads; opened when first needed.
    reader: Mutex<Option<read::Reader>>,
}

impl Store {
    /// The history in a folder, which need not exist yet. Never fails: what is wrong is said by [`Store::health`], and
    /// tried again.
    #[must_use]
    pub fn open(folder: &Path) -> Self {
        Self::start(Place::File(folder.join(FILE_NAME)))
    }

    /// The history in a folder, to be read only: another program may be writing it.
    #[must_use]
    pub fn to_read(folder: &Path) -> Self {
        // Nobody takes commands.
        let (commands, _) = sync_channel(1);
        let place = Place::File(folder.join(FILE_NAME));
        Self {
            shared: Arc::new(Shared {
                place,
                commands,
                health: watch::channel(Health::Opening).1,
                hindrance: Arc::default(),
                backlog: Arc::default(),
                reader: Mutex::new(None),
            }),
        }
    }

    /// A history that lasts as long as this: for replays and tests.
    #[must_use]
    pub fn in_memory() -> Self {
        Self::start(Place::Memory)
    }

    fn start(place: Place) -> Self {
        let (commands, queue) = sync_channel(QUEUE);
        let (told, health) = watch::channel(Health::Opening);
        let (at, hindrance) = (place.clone(), Arc::<Mutex<Hindrance>>::default());
        let hindered = Arc::clone(&hindrance);
        let backlog = Arc::<Mutex<Backlog>>::default();
        let waiting = Arc::clone(&backlog);
        let started = std::thread::Builder::new()
            .name("history".to_owned())
            .spawn(move || worker::run(at, &queue, &told, &hindered, &waiting));
        if let Err(error) = started {
            // The queue's other end is gone: every command says so.
            tracing::error!(%error, "the history's thread does not start");
        }
        Self { shared: Arc::new(Shared { place, commands, health, hindrance, backlog, reader: Mutex::new(None) }) }
    }

    /// Keeps the history from being written from now on, for whoever wants to see what then happens.
    pub fn hinder(&self, hindrance: Hindrance) {
        *self.shared.hindrance.lock().unwrap_or_else(PoisonError::into_inner) = hindrance;
    }

    /// The file, where there is one.
    #[must_use]
    pub fn path(&self) -> Option<&PathBuf> {
        self.shared.place.file()
    }

    /// Room left on the disk of the file, bytes; `None` where there is no file, or the system does not say.
    #[must_use]
    pub fn disk_free_bytes(&self) -> Option<u64> {
        self.path().and_then(|file| disk::free_bytes(file))
    }

    /// Whether the history can be written, and why not.
    #[must_use]
    pub fn health(&self) -> watch::Receiver<Health> {
        self.shared.health.clone()
    }

    /// Queues a command and returns at once. Lost with a word in the log where the queue is full; returns whether it was
    /// taken.
    pub fn queue(&self, command: impl FnOnce(&Writer<'_>) -> rusqlite::Result<()> + Send + 'static) -> bool {
        let mut command = Some(command);
        let act = Box::new(move |transact: &mut Transact<'_>| {
            let done = transact(&mut |writer| command.take().map_or(Ok(()), |command| command(writer)));
            if let Err(error) = &done {
                tracing::warn!(%error, "a record is not in the history");
            }
            done
        });
        let command = Command::Write { needs_room: false, act };
        let taken = self.shared.commands.try_send(command);
        match &taken {
            Ok(()) => {}
            Err(TrySendError::Full(_)) => tracing::error!("the disk takes no more: a record is not in the history"),
            Err(TrySendError::Disconnected(_)) => tracing::error!("the history's thread has ended"),
        }
        taken.is_ok()
    }

    /// Carries a command out, after every one queued before it, and returns once it is on the disk.
    ///
    /// # Errors
    /// [`StoreError`] where it is not there, or not in time. What was given up never comes to be there later, unless it
    /// hung while the disk was writing it. Also where the disk has little room left: what is to come would not fit.
    pub async fn write<T: Send + 'static>(
        &self,
        command: impl FnOnce(&Writer<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreError> {
        self.ask(true, command).await
    }

    /// As [`Store::write`], into the room on the disk that is held back from what is to come, too.
    ///
    /// # Errors
    /// [`StoreError`] where it is not there, or not in time, and then it never comes to be there.
    pub async fn write_reserved<T: Send + 'static>(
        &self,
        command: impl FnOnce(&Writer<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreError> {
        self.ask(false, command).await
    }

    async fn ask<T: Send + 'static>(
        &self,
        needs_room: bool,
        command: impl FnOnce(&Writer<'_>) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreError> {
        let (answer, answered) = sync_channel(1);
        let mut command = Some(command);
        let wanted = Arc::<Wanted>::default();
        let asked = Arc::clone(&wanted);
        let act = Box::new(move |transact: &mut Transact<'_>| {
            let mut value = None;
            let done = transact(&mut |writer| {
                value = command.take().map(|command| command(writer)).transpose()?;
                // The last that is done before it counts.
                asked.settle()
            });
            let told = done.clone().and_then(|()| value.ok_or(StoreError::Ended));
            // Whoever asked may have given up.
            let _ = answer.send(told);
            done
        });
        match self.shared.commands.try_send(Command::Write { needs_room, act }) {
            Ok(()) => wait(answered, wanted).await,
            Err(TrySendError::Full(_)) => Err(StoreError::Late(WRITE_ALLOWED)),
            Err(TrySendError::Disconnected(_)) => Err(StoreError::Ended),
        }
    }

    /// Adds to the audit log and returns at once: before everything that is queued or asked after it, and, where the
    /// history cannot be written or its queue is full, once it can be, in order. Where there is no room left to keep it
    /// until then, it is counted, and the count is an entry in its place.
    pub fn audit(&self, entry: Audit) {
        self.shared.backlog.lock().unwrap_or_else(PoisonError::into_inner).push(entry);
        // A full queue is no loss: the entries are looked after between two commands.
        let _ = self.shared.commands.try_send(Command::WriteAudit { written: None });
    }

    /// Takes away the entries of the audit log that are not on the disk.
    #[must_use]
    pub fn unwritten_audit(&self) -> Vec<Audit> {
        self.shared.backlog.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Waits until everything queued so far is written, or cannot be.
    pub async fn flush(&self) {
        let (written, answered) = sync_channel(1);
        let commands = self.shared.commands.clone();
        let waited = tokio::task::spawn_blocking(move || {
            let until = Instant::now() + WRITE_ALLOWED;
            let mut command = Command::WriteAudit { written: Some(written) };
            while let Err(refused) = commands.try_send(command) {
                match refused {
                    TrySendError::Full(back) if Instant::now() < until => command = back,
                    _ => return,
                }
                std::thread::sleep(QUEUE_LOOK);
            }
            let _ = answered.recv_timeout(until.saturating_duration_since(Instant::now()));
        });
        let _ = waited.await;
    }

    /// Reads.
    ///
    /// # Errors
    /// [`StoreError`] where the file cannot be read.
    pub async fn read<T: Send + 'static>(
        &self,
        query: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreError> {
        let Some(file) = self.path().cloned() else {
            // What is in memory is seen by the connection that writes it only.
            return self.ask(false, move |writer| query(writer.connection())).await;
        };
        let shared = Arc::clone(&self.shared);
        let read = tokio::task::spawn_blocking(move || {
            let mut reader = shared.reader.lock().unwrap_or_else(PoisonError::into_inner);
            read::with_reader(&mut reader, &file, query)
        });
        read.await.map_err(|_| StoreError::Ended)?
    }
}

/// Whether a command is still waited for: it counts, or whoever asked for it has given it up, and never both.
#[derive(Debug, Default)]
struct Wanted(AtomicU8);

impl Wanted {
    const OPEN: u8 = 0;
    const COUNTS: u8 = 1;
    const GIVEN_UP: u8 = 2;

    fn turn(&self, what: u8) -> bool {
        self.0.compare_exchange(Self::OPEN, what, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }

    /// Has the command count from here on.
    fn settle(&self) -> rusqlite::Result<()> {
        let given_up = || rusqlite::Error::ToSqlConversionFailure("whoever asked for it has given it up".into());
        self.turn(Self::COUNTS).then_some(()).ok_or_else(given_up)
    }

    /// Gives the command up; returns whether that was in time.
    fn give_up(&self) -> bool {
        self.turn(Self::GIVEN_UP)
    }
}

/// Waits on a thread for blocking work: by the real clock, which is the disk's, and with tokio's clock held where it is
/// paused.
async fn wait<T: Send + 'static>(
    answered: Receiver<Result<T, StoreError>>,
    wanted: Arc<Wanted>,
) -> Result<T, StoreError> {
    let late = Err(StoreError::Late(WRITE_ALLOWED));
    let waited = tokio::task::spawn_blocking(move || match answered.recv_timeout(WRITE_ALLOWED) {
        Ok(done) => done,
        Err(RecvTimeoutError::Timeout) if wanted.give_up() => late,
        // The disk is writing it: what comes of that is waited for, so that it is not denied.
        Err(RecvTimeoutError::Timeout) => answered.recv_timeout(WRITE_ALLOWED).unwrap_or(late),
        Err(RecvTimeoutError::Disconnected) => Err(StoreError::Ended),
    });
    waited.await.map_err(|_| StoreError::Ended)?
}
