//! What the program counts and times about itself, by the names under which Prometheus reads it.
//!
//! Whoever has something to count calls a function here; without [`install`] nothing is kept, and counting costs a few
//! nanoseconds.
//!
//! What is kept grows with the number of labels' values, so that each label takes them from a closed set: of this
//! program's own words, of its routes, or of the configuration's names. Nothing that a request says is among them.

use std::time::Duration;

use metrics::{counter, describe_counter, describe_gauge, describe_histogram, gauge, histogram};
use metrics_exporter_prometheus::{Matcher, PrometheusBuilder, PrometheusHandle};

const STOP_LATENCY: &str = "plenalign_stop_latency_seconds";
const REQUEST: &str = "plenalign_http_request_seconds";
const MEASUREMENT: &str = "plenalign_measurement_seconds";
const WHITE: &str = "plenalign_white_frame_seconds";
const READINGS: &str = "plenalign_readings_total";
const READING: &str = "plenalign_reading_seconds";
const READING_PART: &str = "plenalign_reading_part_seconds";
const READING_AGE: &str = "plenalign_reading_age_seconds";
const FRAMES_LEFT_OUT: &str = "plenalign_frames_left_out_total";
const READINGS_LEFT_OUT: &str = "plenalign_readings_left_out_total";
const LOOK: &str = "plenalign_view_seconds";
const PICTURE: &str = "plenalign_picture_seconds";
const PICTURE_LATENCY: &str = "plenalign_picture_latency_seconds";
const PICTURES_DROPPED: &str = "plenalign_pictures_dropped_total";
const ROUND_TRIP: &str = "plenalign_serial_round_trip_seconds";
const RECONNECTS: &str = "plenalign_controller_connections_total";
const JOBS: &str = "plenalign_jobs_total";
const FRAME_AGE: &str = "plenalign_frame_age_seconds";
const CAMERA_ONLINE: &str = "plenalign_camera_online";
const FRAMES_LOST: &str = "plenalign_frames_lost_total";
const FRAMES_DAMAGED: &str = "plenalign_frames_damaged_total";
const AXIS_CONNECTED: &str = "plenalign_axis_connected";
const AXIS_HOMED: &str = "plenalign_axis_homed";
const AXIS_POSITION: &str = "plenalign_axis_position_metres";
const STOP_LATCHED: &str = "plenalign_stop_latched";
const LEASE_HELD: &str = "plenalign_lease_held";
const JOB_RUNNING: &str = "plenalign_job_running";
const VIEWERS: &str = "plenalign_viewers";
const SIMULATED: &str = "plenalign_simulated";
const BUILD: &str = "plenalign_build_info";
const PICTURE_ENCODER: &str = "plenalign_picture_encoder_info";
const READY: &str = "plenalign_ready";
const HISTORY_WRITABLE: &str = "plenalign_history_writable";
const DISK_FREE: &str = "plenalign_disk_free_bytes";
const DISK_KEPT: &str = "plenalign_disk_kept_free_bytes";
const MQTT_CONNECTED: &str = "plenalign_mqtt_connected";
const MQTT_WAITING: &str = "plenalign_mqtt_waiting_events";
const MQTT_PUBLISHED: &str = "plenalign_mqtt_published_total";
const MQTT_DROPPED: &str = "plenalign_mqtt_dropped_total";
const MQTT_FAILURES: &str = "plenalign_mqtt_failures_total";

/// Upper ends of the histograms' buckets, s: from a serial byte to a measurement of twelve megapixels.
const BUCKETS_S: [f64; 16] =
    [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15, 0.25, 0.5, 1.0, 2.5, 10.0];

/// The methods that are told apart; whatever else a request names is one more.
const METHODS: [&str; 9] = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"];
/// The route of a path that matches none.
pub const NO_ROUTE: &str = "none";
/// Between two times that what was timed is put into its buckets: until then each single time is kept.
const UPKEEP: Duration = Duration::from_secs(5);

/// How a viewer watches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ViewerKind {
    /// Over the WebSocket.
    WebSocket,
    /// The MJPEG stream.
    Mjpeg,
}

impl ViewerKind {
    const fn name(self) -> &'static str {
        match self {
            Self::WebSocket => "websocket",
            Self::Mjpeg => "mjpeg",
        }
    }
}

/// Starts keeping what is counted, for the whole process, and returns what writes it as text. [`keep_up`] has to run as
/// long as it is kept.
///
/// # Errors
/// When something else has been installed already, in words.
pub fn install() -> Result<PrometheusHandle, String> {
    let handle = PrometheusBuilder::new()
        .set_buckets_for_metric(Matcher::Suffix("_seconds".to_owned()), &BUCKETS_S)
        .and_then(PrometheusBuilder::install_recorder)
        .map_err(|error| error.to_string())?;
    describe_histogram!(
        STOP_LATENCY,
        "From the request for a stop to the last byte of the stop order on a serial line"
    );
    describe_histogram!(REQUEST, "From a request to its answer, by method, route and status");
    describe_histogram!(MEASUREMENT, "Measuring the spacing of a frame or of several");
    describe_histogram!(WHITE, "Learning grid and vignetting from a white frame");
    describe_counter!(READINGS, "Frames that the meter has tried to read the spacing in, by outcome");
    describe_histogram!(READING, "The meter's reading of a frame, by what it took to find the spacing");
    describe_histogram!(READING_PART, "Parts of the meter's reading of a frame");
    describe_histogram!(READING_AGE, "From the end of a frame's exposure to its reading, by outcome");
    describe_counter!(FRAMES_LEFT_OUT, "Frames that came while the meter was at another, and were not read");
    describe_counter!(READINGS_LEFT_OUT, "Readings that a recording or a viewer was too slow for, by reader");
    describe_histogram!(LOOK, "Making a frame ready for views and depth");
    describe_histogram!(PICTURE, "Making a picture, once for all viewers of the same");
    describe_histogram!(PICTURE_LATENCY, "From the end of a frame's exposure to its picture handed to the socket");
    describe_counter!(PICTURES_DROPPED, "Frames that a viewer watching was not sent");
    describe_histogram!(ROUND_TRIP, "From a request on a serial line to its answer");
    describe_counter!(RECONNECTS, "Connections made to a stage controller, the first included");
    describe_counter!(JOBS, "Jobs that have ended, by kind and outcome");
    describe_gauge!(FRAME_AGE, "Age of the newest frame");
    describe_gauge!(CAMERA_ONLINE, "Whether frames arrive");
    describe_counter!(FRAMES_LOST, "Frames lost by the camera, by gaps in their numbers");
    describe_counter!(FRAMES_DAMAGED, "Frames that came damaged");
    describe_gauge!(AXIS_CONNECTED, "Whether an axis's controller answers");
    describe_gauge!(AXIS_HOMED, "Whether an axis's position is known");
    describe_gauge!(AXIS_POSITION, "Readback of an axis; NaN while unknown");
    describe_gauge!(STOP_LATCHED, "Whether motion is refused until the stop is reset");
    describe_gauge!(LEASE_HELD, "Whether somebody has the control lease");
    describe_gauge!(JOB_RUNNING, "Whether a job is under way");
    describe_gauge!(VIEWERS, "Viewers of the live picture");
    describe_gauge!(SIMULATED, "Whether the bench is simulated");
    describe_gauge!(READY, "Whether the bench can be worked with");
    describe_gauge!(HISTORY_WRITABLE, "Whether the history can be written, without which nothing moves");
    describe_gauge!(DISK_FREE, "Room left on the disk of the state folder");
    describe_gauge!(DISK_KEPT, "Room on the disk that recordings leave for others");
    describe_gauge!(MQTT_CONNECTED, "Whether the MQTT broker has taken the bench's birth");
    describe_gauge!(MQTT_WAITING, "Events that wait for the MQTT broker");
    describe_counter!(MQTT_PUBLISHED, "Messages that the MQTT broker has taken, by kind");
    describe_counter!(MQTT_DROPPED, "Messages that were given up before the MQTT broker took them, by reason");
    describe_counter!(MQTT_FAILURES, "Connections to the MQTT broker that failed or were lost, by reason");
    describe_gauge!(PICTURE_ENCODER, "What encodes pictures for viewers; always 1");
    describe_gauge!(BUILD, "Version of the program; always 1");
    gauge!(BUILD, "version" => env!("CARGO_PKG_VERSION")).set(1.0);
    Ok(handle)
}

/// Keeps what was timed in its buckets, for ever: without it every single time is kept until somebody reads the metrics.
pub async fn keep_up(kept: PrometheusHandle) {
    let mut tick = tokio::time::interval(UPKEEP);
    loop {
        tick.tick().await;
        kept.run_upkeep();
    }
}

/// The word for a request's method: its own where it is one of HTTP's.
#[must_use]
pub fn method_word(method: &str) -> &'static str {
    METHODS.into_iter().find(|known| *known == method).unwrap_or("other")
}

/// Pictures for viewers are encoded by this.
pub fn picture_encoder(name: &'static str) {
    gauge!(PICTURE_ENCODER, "encoder" => name).set(1.0);
}

/// A stop's last byte was handed to the serial line so long after it was asked for.
pub fn stop_sent(latency: Duration) {
    histogram!(STOP_LATENCY).record(latency);
}

/// A request was answered by a route, or by [`NO_ROUTE`].
pub fn answered(method: &str, route: &'static str, status: u16, took: Duration) {
    let method = method_word(method);
    histogram!(REQUEST, "method" => method, "route" => route, "status" => status.to_string()).record(took);
}

/// Frames were measured.
pub fn measured(took: Duration) {
    histogram!(MEASUREMENT).record(took);
}

/// Grid and vignetting were learnt from a white frame.
pub fn learnt(took: Duration) {
    histogram!(WHITE).record(took);
}

/// What became of a frame at the meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadingOutcome {
    /// It has a spacing.
    Measured,
    /// The spacing is searched for.
    Lost,
    /// It cannot be measured.
    Refused,
}

impl ReadingOutcome {
    const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Lost => "lost",
            Self::Refused => "refused",
        }
    }
}

/// The meter looked for the spacing of a frame: near that of the one before, or, `searched`, as if nothing were known.
pub fn read(searched: bool, outcome: ReadingOutcome, took: Duration) {
    counter!(READINGS, "outcome" => outcome.name()).increment(1);
    histogram!(READING, "search" => if searched { "whole" } else { "near" }).record(took);
}

/// A part of one reading took so long, by the word for it: `thread` for the wait for a thread to read on.
pub fn reading_part(part: &'static str, took: Duration) {
    histogram!(READING_PART, "part" => part).record(took);
}

/// A reading of a frame of this age was published, and so many frames before it were not read.
pub fn reading_published(outcome: ReadingOutcome, age: Duration, left_out: u64) {
    histogram!(READING_AGE, "outcome" => outcome.name()).record(age);
    counter!(FRAMES_LEFT_OUT).increment(left_out);
}

/// Who takes each of the meter's readings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReaderKind {
    /// A job's recording.
    Recording,
    /// A viewer of the live bridge for Foxglove.
    Foxglove,
}

impl ReaderKind {
    const fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Foxglove => "foxglove",
        }
    }
}

/// So many of the meter's readings were left out of what `reader` takes, because it was too slow for them.
pub fn reading_left_out(reader: ReaderKind, count: u64) {
    counter!(READINGS_LEFT_OUT, "reader" => reader.name()).increment(count);
}

/// A frame was made ready for views and depth.
pub fn looked(took: Duration) {
    histogram!(LOOK).record(took);
}

/// A picture was made.
pub fn picture_made(took: Duration) {
    histogram!(PICTURE).record(took);
}

/// A picture of a frame of this age was handed to a viewer's socket, and so many frames before it were not.
pub fn picture_sent(viewer: ViewerKind, age: Duration, dropped: u64) {
    histogram!(PICTURE_LATENCY, "viewer" => viewer.name()).record(age);
    counter!(PICTURES_DROPPED, "viewer" => viewer.name()).increment(dropped);
}

/// A viewer watches for as long as this lives.
#[derive(Debug)]
pub struct Viewing(ViewerKind);

/// A viewer begins to watch.
#[must_use]
pub fn viewing(viewer: ViewerKind) -> Viewing {
    gauge!(VIEWERS, "viewer" => viewer.name()).increment(1.0);
    Viewing(viewer)
}

impl Drop for Viewing {
    fn drop(&mut self) {
        gauge!(VIEWERS, "viewer" => self.0.name()).decrement(1.0);
    }
}

/// A serial line answered.
pub fn round_trip(took: Duration) {
    histogram!(ROUND_TRIP).record(took);
}

/// A stage controller was connected, by the name that the configuration has for it.
pub fn connected(controller: &str) {
    counter!(RECONNECTS, "controller" => controller.to_owned()).increment(1);
}

/// A job ended, by the words for its kind and its final state.
pub fn job_ended(kind: &str, outcome: &str) {
    counter!(JOBS, "kind" => kind.to_owned(), "outcome" => outcome.to_owned()).increment(1);
}

/// The bench as it is, at the moment of asking.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchGauges {
    /// Age of the newest frame, if there is one.
    pub frame_age: Option<Duration>,
    /// Whether frames arrive.
    pub camera_online: bool,
    /// Frames lost so far.
    pub frames_lost: u64,
    /// Frames damaged so far.
    pub frames_damaged: u64,
    /// Name, whether connected, whether homed, position (mm) of each axis.
    pub axes: Vec<(&'static str, bool, bool, Option<f64>)>,
    /// Whether the stop is latched.
    pub stop_latched: bool,
    /// Whether the control lease is held.
    pub lease_held: bool,
    /// Whether a job is under way.
    pub job_running: bool,
    /// Whether the bench is simulated.
    pub simulated: bool,
    /// Whether nothing keeps it from being worked with.
    pub ready: bool,
    /// Whether the history can be written.
    pub history_writable: bool,
    /// Room left on the disk of the state folder, bytes, where that can be told.
    pub disk_free: Option<u64>,
    /// Room that recordings leave for others, bytes.
    pub disk_kept: u64,
}

/// What is so or not, as a gauge has it.
fn flag(set: bool) -> f64 {
    f64::from(u8::from(set))
}

/// Says how the bench is.
pub fn bench(now: &BenchGauges) {
    gauge!(FRAME_AGE).set(now.frame_age.map_or(f64::NAN, |age| age.as_secs_f64()));
    gauge!(CAMERA_ONLINE).set(flag(now.camera_online));
    counter!(FRAMES_LOST).absolute(now.frames_lost);
    counter!(FRAMES_DAMAGED).absolute(now.frames_damaged);
    for &(axis, connected, homed, position_mm) in &now.axes {
        gauge!(AXIS_CONNECTED, "axis" => axis).set(flag(connected));
        gauge!(AXIS_HOMED, "axis" => axis).set(flag(homed));
        gauge!(AXIS_POSITION, "axis" => axis).set(position_mm.map_or(f64::NAN, |position| position / 1000.0));
    }
    gauge!(STOP_LATCHED).set(flag(now.stop_latched));
    gauge!(LEASE_HELD).set(flag(now.lease_held));
    gauge!(JOB_RUNNING).set(flag(now.job_running));
    gauge!(SIMULATED).set(flag(now.simulated));
    gauge!(READY).set(flag(now.ready));
    gauge!(HISTORY_WRITABLE).set(flag(now.history_writable));
    gauge!(DISK_FREE).set(now.disk_free.map_or(f64::NAN, |bytes| bytes as f64));
    gauge!(DISK_KEPT).set(now.disk_kept as f64);
}

/// Why a message was given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dropped {
    /// Too many waited: the oldest went.
    QueueFull,
    /// It had waited for longer than it was worth.
    Expired,
    /// The broker did not take it.
    Refused,
    /// It was longer than the broker takes.
    TooLong,
    /// The program ended first.
    ProgramEnded,
}

impl Dropped {
    const fn name(self) -> &'static str {
        match self {
            Self::QueueFull => "queue_full",
            Self::Expired => "expired",
            Self::Refused => "refused",
            Self::TooLong => "too_long",
            Self::ProgramEnded => "program_ended",
        }
    }
}

/// Whether the MQTT broker has taken the bench's birth.
pub fn mqtt_connected(connected: bool) {
    gauge!(MQTT_CONNECTED).set(flag(connected));
}

/// So many events wait for the MQTT broker.
pub fn mqtt_waiting(events: usize) {
    gauge!(MQTT_WAITING).set(events as f64);
}

/// The MQTT broker has taken a message of this kind.
pub fn mqtt_published(kind: &'static str) {
    counter!(MQTT_PUBLISHED, "kind" => kind).increment(1);
}

/// So many messages were given up.
pub fn mqtt_dropped(reason: Dropped, count: u64) {
    counter!(MQTT_DROPPED, "reason" => reason.name()).increment(count);
}

/// A connection to the MQTT broker failed or was lost.
pub fn mqtt_failed(reason: &'static str) {
    counter!(MQTT_FAILURES, "reason" => reason).increment(1);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Memory of this process, bytes. Other tests run beside this one, and take some of it.
    fn resident() -> usize {
        let text = std::fs::read_to_string("/proc/self/statm").unwrap();
        text.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
    }

    #[tokio::test(start_paused = true)]
    async fn what_is_timed_takes_no_memory_though_nobody_reads_the_metrics() {
        const BATCH: usize = 500_000;
        const BATCHES: usize = 10;
        let recorder = PrometheusBuilder::new().set_buckets(&BUCKETS_S).unwrap().build_recorder();
        let keeping = tokio::spawn(keep_up(recorder.handle()));
        let from = resident();
        for _ in 0..BATCHES {
            let timed = metrics::with_local_recorder(&recorder, || histogram!(ROUND_TRIP));
            for _ in 0..BATCH {
                timed.record(0.001);
            }
            tokio::time::sleep(UPKEEP).await;
        }
        // A time that is kept by itself takes 8 bytes and more.
        let grown = resident().saturating_sub(from);
        assert!(grown < BATCH * BATCHES * 8, "{grown} bytes more");
        keeping.abort();
    }
}
