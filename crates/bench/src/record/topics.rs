//! The topics of recordings and of the live bridge, and the schema of each.

/// Descriptions of all the messages: a `FileDescriptorSet` of the files below `proto/` with what they import, which
/// every schema of a recording has in full. Written from `proto/`; a test compares.
pub const DESCRIPTIONS: &[u8] = include_bytes!("descriptions.binpb");

/// A topic and the full name of its messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Topic {
    /// Its name.
    pub name: &'static str,
    /// The messages' full name.
    pub schema: &'static str,
    /// What is on it, in words.
    pub what: &'static str,
}

macro_rules! topics {
    ($($constant:ident = $name:literal $schema:literal $what:literal;)*) => {
        impl Topic {
            $(#[doc = $what] pub const $constant: Self = Self { name: $name, schema: $schema, what: $what };)*
            /// Every topic.
            pub const ALL: &[Self] = &[$(Self::$constant),*];
        }
    };
}

topics! {
    START = "/job/start" "plenalign.v1.JobStart" "What the job began with.";
    FRAME = "/job/frame" "plenalign.v1.FrameInfo" "When and where each recorded frame was taken.";
    RAW = "/camera/raw" "foxglove.RawImage" "The frames that were measured, as the sensor gave them.";
    PICTURE = "/camera/picture" "foxglove.CompressedImage" "The live picture.";
    VIEW = "/camera/view" "foxglove.CompressedImage" "Central views kept with the job.";
    ANNOTATIONS = "/camera/annotations" "foxglove.ImageAnnotations" "The measured spacing, drawn on the frame.";
    TRANSFORM = "/bench/transform" "foxglove.FrameTransform" "Where e and focus axis stand, as frames of reference.";
    POSE = "/bench/pose" "foxglove.PoseInFrame" "Where the camera stands on the bench.";
    LOG = "/log" "foxglove.Log" "The job's log.";
    MEASUREMENT = "/job/measurement" "plenalign.v1.Measurement" "What was measured.";
    READING = "/meter/reading" "plenalign.v1.MeterReading" "What the meter reads, frame by frame.";
    DECISION = "/job/decision" "plenalign.v1.Decision" "What was decided.";
    ANSWER = "/job/answer" "plenalign.v1.Answer" "What the devices answered.";
    END = "/job/end" "plenalign.v1.JobEnd" "How the job ended.";
}

/// The topic of a name.
#[must_use]
pub fn topic(name: &str) -> Option<Topic> {
    Topic::ALL.iter().copied().find(|topic| topic.name == name)
}
