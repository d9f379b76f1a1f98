//! Writing a recording: append only, in whole chunks, within limits.

use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions};
use nix::sys::statvfs::fstatvfs;

use super::{DESCRIPTIONS, METADATA, Topic};

/// A chunk is closed once it is longer than this: a frame fills one.
const CHUNK_BYTES: u64 = 1 << 20;
/// A recording shows the laboratory: its owner and their group may look at it.
const MODE: u32 = 0o640;

/// How much of the disk a recording may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Longest file, bytes.
    pub max_bytes: u64,
    /// Room left on the disk for others, bytes.
    pub keep_free_bytes: u64,
}

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// There is one already.
    #[error("{} is there already; a recording takes the place of no other file", .0.display())]
    Exists(PathBuf),
    /// The disk says no.
    #[error("{}: {source}", path.display())]
    Disk {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Others need the room.
    #[error("the disk of {} has {free} MB left, and record.keep_free_mb keeps {keep} MB free", path.display())]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// Free, MB.
        free: u64,
        /// To be kept free, MB.
        keep: u64,
    },
    /// It is as long as it may become.
    #[error("{} is as long as record.max_file_mb = {max} lets it become", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Longest file, MB.
        max: u64,
    },
    /// The file's format cannot hold it.
    #[error("{}: {source}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<mcap::McapError>,
    },
}

/// What the file's format is written to: counts, and never goes back.
struct Counted {
    file: BufWriter<File>,
    at: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.at += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.at),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "a recording is only ever appended to")),
        }
    }
}

/// A recording being written.
pub struct Writer {
    mcap: mcap::Writer<Counted>,
    /// For asking about the disk.
    file: File,
    path: PathBuf,
    limits: Limits,
    channels: HashMap<Topic, u16>,
    /// Bytes of messages so far, before they are compressed: never fewer than are in the file.
    bytes: u64,
}

impl Writer {
    /// Begins a recording, which says what it is in `metadata`.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn create(path: &Path, limits: Limits, metadata: BTreeMap<String, String>) -> Result<Self, WriteError> {
        let disk = |source| WriteError::Disk { path: path.to_owned(), source };
        if path.metadata().is_ok_and(|found| found.is_file() && found.len() > 0) {
            return Err(WriteError::Exists(path.to_owned()));
        }
        let file = OpenOptions::new().write(true).create(true).truncate(true).mode(MODE).open(path).map_err(disk)?;
        let asked = file.try_clone().map_err(disk)?;
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            // Frames are mostly noise, of which more effort makes little more.
            .compression_level(1)
            .chunk_size(Some(CHUNK_BYTES))
            .profile("plenalign")
            .library(concat!("plenalign ", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true);
        let mcap = options
            .create(Counted { file: BufWriter::new(file), at: 0 })
            .map_err(|source| format_error(path, source))?;
        let mut writer = Self { mcap, file: asked, path: path.to_owned(), limits, channels: HashMap::new(), bytes: 0 };
        writer.check_room(0)?;
        writer
            .mcap
            .write_metadata(&Metadata { name: METADATA.to_owned(), metadata })
            .map_err(|source| writer.error(source))?;
        writer.flush()?;
        Ok(writer)
    }

    fn error(&self, source: mcap::McapError) -> WriteError {
        format_error(&self.path, source)
    }

    /// Adds a message of a topic. `at` is when it was made.
    ///
    /// # Errors
    /// [`WriteError`]; the recording ends with what it has.
    pub fn write(
        &mut self,
        topic: Topic,
        sequence: u32,
        at: jiff::Timestamp,
        message: &impl prost::Message,
    ) -> Result<(), WriteError> {
        let data = message.encode_to_vec();
        self.check_room(data.len() as u64)?;
        self.bytes += data.len() as u64;
        let channel_id = self.channel(topic)?;
        let log_time = super::nanoseconds(at);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap.write_to_known_channel(&header, &data).map_err(|source| format_error(&self.path, source))
    }

    fn channel(&mut self, topic: Topic) -> Result<u16, WriteError> {
        if let Some(&id) = self.channels.get(&topic) {
            return Ok(id);
        }
        let added = self
            .mcap
            .add_schema(topic.schema, "protobuf", DESCRIPTIONS)
            .and_then(|schema| self.mcap.add_channel(schema, topic.name, "protobuf", &BTreeMap::new()));
        let id = added.map_err(|source| self.error(source))?;
        self.channels.insert(topic, id);
        Ok(id)
    }

    /// Whether so many bytes more may be written.
    fn check_room(&self, bytes: u64) -> Result<(), WriteError> {
        let (path, limits) = (&self.path, self.limits);
        if self.bytes + bytes > limits.max_bytes {
            return Err(WriteError::TooLong { path: path.clone(), max: limits.max_bytes >> 20 });
        }
        let said = fstatvfs(&self.file)
            .map_err(|source| WriteError::Disk { path: path.clone(), source: io::Error::from(source) })?;
        // The C library's widths differ between machines.
        #[allow(clippy::unnecessary_cast)]
        let free = said.blocks_available() as u64 * said.fragment_size() as u64;
        if free < limits.keep_free_bytes.saturating_add(bytes) {
            let keep = limits.keep_free_bytes >> 20;
            return Err(WriteError::NoRoom { path: path.clone(), free: free >> 20, keep });
        }
        Ok(())
    }

    /// Hands everything so far to the system: whatever becomes of the program, it can be read.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn flush(&mut self) -> Result<(), WriteError> {
        self.mcap.flush().map_err(|source| format_error(&self.path, source))
    }

    /// Ends the recording with its index, and returns how long the file is, bytes.
    ///
    /// # Errors
    /// [`WriteError`]; what was flushed can be read all the same.
    pub fn finish(mut self) -> Result<u64, WriteError> {
        self.mcap.finish().map_err(|source| format_error(&self.path, source))?;
        let mut counted = self.mcap.into_inner();
        let disk = |source| WriteError::Disk { path: self.path.clone(), source };
        counted.flush().map_err(disk)?;
        match counted.file.get_ref().sync_data() {
            // A pipe or a device has nothing to be synchronised.
            Err(error) if error.raw_os_error() == Some(nix::errno::Errno::EINVAL as i32) => {}
            done => done.map_err(disk)?,
        }
        Ok(counted.at)
    }
}

fn format_error(path: &Path, source: mcap::McapError) -> WriteError {
    let path = path.to_owned();
    match source {
        mcap::McapError::Io(source) => WriteError::Disk { path, source },
        source => WriteError::Format { path, source: Box::new(source) },
    }
}
