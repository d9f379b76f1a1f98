//! Reading a recording from its start, piece by piece: no more of it is in memory than its largest chunk.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// Longest record that is believed: beyond it a damaged length is likelier than a frame.
const LONGEST_RECORD: usize = 1 << 30;

/// Why a file is no recording that can be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The disk says no.
    #[error("{}: {source}", path.display())]
    Disk {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is something else.
    #[error("{} is no MCAP file: it does not begin as one", .0.display())]
    NotMcap(PathBuf),
}

/// How a file came to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// As it should.
    Whole,
    /// In the middle: why, in words.
    Cut(String),
}

/// A piece of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// What the file says of itself under a name.
    Metadata {
        /// The name.
        name: String,
        /// What it says.
        values: BTreeMap<String, String>,
    },
    /// A message.
    Message {
        /// Its topic.
        topic: String,
        /// Its full name.
        schema: String,
        /// Its number.
        sequence: u32,
        /// The message, in Protocol Buffers' encoding.
        data: Vec<u8>,
    },
}

/// A recording being read.
pub struct Reader {
    file: File,
    linear: LinearReader,
    schemas: HashMap<u16, String>,
    /// Topic and full name of messages in Protocol Buffers' encoding.
    channels: HashMap<u16, (String, String)>,
    ending: Option<Ending>,
    footer: bool,
}

impl Reader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`ReadError`] where it cannot be read, or is no MCAP file.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let disk = |source| ReadError::Disk { path: path.to_owned(), source };
        let mut file = File::open(path).map_err(disk)?;
        let mut magic = [0; mcap::MAGIC.len()];
        match file.read_exact(&mut magic) {
            Ok(()) if magic == mcap::MAGIC => {}
            Err(error) if error.kind() != io::ErrorKind::UnexpectedEof => return Err(disk(error)),
            _ => return Err(ReadError::NotMcap(path.to_owned())),
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(LONGEST_RECORD);
        let linear = LinearReader::new_with_options(options);
        Ok(Self { file, linear, schemas: HashMap::new(), channels: HashMap::new(), ending: None, footer: false })
    }

    /// How the file came to its end, once it has.
    #[must_use]
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    fn end(&mut self, ending: Ending) -> Option<Item> {
        // What is behind the footer tells nothing of the messages.
        self.ending = Some(if self.footer { Ending::Whole } else { ending });
        None
    }
}

impl Iterator for Reader {
    type Item = Item;

    fn next(&mut self) -> Option<Item> {
        if self.ending.is_some() {
            return None;
        }
        loop {
            let item = match self.linear.next_event() {
                None => return self.end(Ending::Cut("the file ends without its index".to_owned())),
                Some(Err(error)) => return self.end(Ending::Cut(words(&error))),
                Some(Ok(LinearReadEvent::ReadRequest(need))) => {
                    match self.file.read(self.linear.insert(need)) {
                        Ok(read) => self.linear.notify_read(read),
                        Err(error) => return self.end(Ending::Cut(error.to_string())),
                    }
                    continue;
                }
                Some(Ok(LinearReadEvent::Record { opcode, data })) => match mcap::parse_record(opcode, data) {
                    Err(error) => Err(words(&error)),
                    Ok(record) => Ok(match record {
                        Record::Schema { header, .. } => {
                            self.schemas.insert(header.id, header.name);
                            None
                        }
                        Record::Channel(channel) => {
                            let schema = self.schemas.get(&channel.schema_id);
                            if let Some(schema) = schema.filter(|_| channel.message_encoding == "protobuf") {
                                self.channels.insert(channel.id, (channel.topic, schema.clone()));
                            }
                            None
                        }
                        Record::Message { header, data } => {
                            self.channels.get(&header.channel_id).map(|(topic, schema)| Item::Message {
                                topic: topic.clone(),
                                schema: schema.clone(),
                                sequence: header.sequence,
                                data: data.into_owned(),
                            })
                        }
                        Record::Metadata(metadata) => {
                            Some(Item::Metadata { name: metadata.name, values: metadata.metadata })
                        }
                        Record::Footer(_) => {
                            self.footer = true;
                            None
                        }
                        _ => None,
                    }),
                },
            };
            match item {
                Ok(Some(item)) => return Some(item),
                Ok(None) => {}
                Err(why) => return self.end(Ending::Cut(why)),
            }
        }
    }
}

fn words(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::UnexpectedEof | mcap::McapError::UnexpectedEoc => {
            "the file ends in the middle of a record".to_owned()
        }
        error => format!("it is damaged: {error}"),
    }
}
