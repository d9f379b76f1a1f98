//! Recordings on disk: MCAP files with the schemas of all their messages in them, so that Foxglove, Lichtblick and the
//! `mcap` tools of any language read them without this program.
//!
//! [`Writer`] writes a file in whole chunks, one after another: one that is cut (power gone, program killed) can be read
//! up to its last whole chunk. [`Reader`] reads one from its start, piece by piece, and says whether it was whole.
//! What a job puts into a recording is decided in `control`.

/// Messages of `proto/foxglove`, written by `prost-build`; a test compares.
#[allow(missing_docs, unreachable_pub, clippy::all)]
#[rustfmt::skip]
pub mod foxglove;
/// Messages of `proto/plenalign/v1/recording.proto`, written by `prost-build`; a test compares.
#[allow(missing_docs, unreachable_pub, clippy::all)]
#[rustfmt::skip]
pub mod messages;
mod pictures;
mod reader;
mod topics;
mod writer;

pub use pictures::{raw_image, raw_message};
pub use reader::{Ending, Item, ReadError, Reader};
pub use topics::{DESCRIPTIONS, Topic, topic};
pub use writer::{Limits, WriteError, Writer};

/// What the names of recordings end with.
pub const ENDING: &str = "mcap";

/// Name of the metadata record in which a recording says what it is.
pub const METADATA: &str = "plenalign";

/// A time as the messages have it.
#[must_use]
pub fn stamp(at: jiff::Timestamp) -> prost_types::Timestamp {
    let (seconds, nanos) = (at.as_second(), at.subsec_nanosecond());
    // Both parts have one sign; the messages want the fraction from 0 up.
    if nanos < 0 {
        prost_types::Timestamp { seconds: seconds - 1, nanos: nanos + 1_000_000_000 }
    } else {
        prost_types::Timestamp { seconds, nanos }
    }
}

/// A time as the program has it; the epoch where it is beyond what can be told.
#[must_use]
pub fn time(stamp: Option<&prost_types::Timestamp>) -> jiff::Timestamp {
    let parts = stamp.map_or((0, 0), |stamp| (stamp.seconds, stamp.nanos));
    jiff::Timestamp::new(parts.0, parts.1).unwrap_or(jiff::Timestamp::UNIX_EPOCH)
}

/// A time as MCAP has it: ns since 1970, 0 before it.
#[must_use]
pub fn nanoseconds(at: jiff::Timestamp) -> u64 {
    u64::try_from(at.as_nanosecond()).unwrap_or(0)
}
