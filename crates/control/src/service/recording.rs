//! Recordings of the service's jobs: where they are, what a job begins with, and a service that is to do the same.

use std::path::PathBuf;

use super::Service;
use crate::budget::{AirPlace, AirStep, BoardSeen};
use crate::events::InView;
use crate::job::{JobSnapshot, Recording, word};
use crate::loops::calibrated::CalibratedCamera;
use crate::loops::room::Contact;
use crate::recording::{Place, file_name, folder, is_wanted, words};
use crate::running::job::Job;
use bench::config::Config;
use bench::device::{AxisName, Frame};
use bench::record::messages::{self, JobStart};
use bench::record::stamp;

/// The configuration as a recording has it: without what says who may ask the daemon, and where.
fn configuration(config: &Config) -> String {
    let written = toml::Table::try_from(config).map(|mut table| {
        ["server", "alpaca", "foxglove", "mqtt", "record"].into_iter().for_each(|section| drop(table.remove(section)));
        table
    });
    written.and_then(|table| toml::to_string(&table)).unwrap_or_else(|error| {
        tracing::error!(%error, "the configuration cannot be written as TOML");
        String::new()
    })
}

impl Service {
    /// Where a job that has been accepted is recorded; `None` where it is not. `path` is where its caller wants it.
    pub(super) fn place_of(&self, job: &Job, path: Option<PathBuf>) -> Option<Result<Place, String>> {
        let snapshot = job.snapshot();
        if let Some(path) = path {
            return Some(Ok(Place { name: path.display().to_string(), path }));
        }
        if !is_wanted(&self.config, &snapshot.request) {
            return None;
        }
        let name = file_name(snapshot.id, snapshot.kind, snapshot.simulated);
        let folder = folder(&self.config, self.journal.store().path().map(PathBuf::as_path));
        Some(match folder {
            Some(folder) => Ok(Place { path: folder.join(&name), name }),
            None => Err("there is no folder for recordings: set record.folder".to_owned()),
        })
    }

    /// The file of a job's recording in the folder of recordings.
    ///
    /// # Errors
    /// Why there is none, in words.
    pub fn recording_file(&self, recording: &Recording) -> Result<PathBuf, String> {
        if recording.file.contains('/') {
            return Err(format!("it was asked for elsewhere, at {}", recording.file));
        }
        folder(&self.config, self.journal.store().path().map(PathBuf::as_path))
            .map(|folder| folder.join(&recording.file))
            .ok_or_else(|| "there is no folder for recordings".to_owned())
    }

    /// What a job that has been accepted begins with.
    pub(super) fn start_of(&self, job: &JobSnapshot) -> JobStart {
        let axis = |axis: AxisName| {
            let stage = self.bench.stage(axis);
            let info = stage.info();
            Some(messages::AxisState {
                disagreements: info.disagreements,
                firmware_limits_mm: info
                    .firmware_limits
                    .map_or_else(Vec::new, |(low, high)| vec![low.value(), high.value()]),
                homes_also: stage.homes_also().map(|other| other.name().to_owned()),
                ..words::axis_state(&stage.state().borrow())
            })
        };
        JobStart {
            timestamp: Some(stamp(job.created_at)),
            job_id: job.id.to_string(),
            request_json: serde_json::to_string(&job.request).unwrap_or_default(),
            configuration_toml: configuration(&self.config),
            design_origin: self.design_origin.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            simulated: job.simulated,
            owner: job.owner.clone(),
            focus: axis(AxisName::Focus),
            e: axis(AxisName::E),
            shell: word(&self.motion.shell()),
            l_bound_mm: self.motion.l_bound_mm(),
            measured_contact: self.measured_contact(),
            spacing_target_px: self.eye.target_px(),
            aim_mm: self.eye.aim_mm(),
            air_step: self.eye.last_air_step().map(|(air, holds)| messages::AirStep {
                lens_to_mla_mm: air.camera.lens_to_mla_mm,
                mla_to_sensor_mm: air.camera.mla_to_sensor_mm,
                image_distance_sigma_mm: air.camera.image_distance_sigma_mm,
                window_px: air.camera.window_px,
                delta_v_mm: air.delta_v.0,
                delta_v_sigma_mm: air.delta_v.1,
                focus_mm: air.focus_mm,
                boards: air.boards.iter().flatten().map(messages::BoardSeen::from).collect(),
                focus_scale: air.focus_scale,
                places: air.places.iter().map(messages::AirPlace::from).collect(),
                place_lost: !holds,
            }),
            white_frame_before: self.eye.white_frame().is_some(),
            other_in_view: self.eye.in_view().lacks_flat_board(),
            camera_unfit: self.bench.camera.state().borrow().unfit.clone(),
        }
    }

    fn measured_contact(&self) -> Option<messages::MeasuredContact> {
        let Contact { e_mm, measured_sigma_mm } = self.motion.contact();
        measured_sigma_mm.map(|sigma_mm| messages::MeasuredContact { e_mm, sigma_mm })
    }

    /// Begins where a recorded job began; `white` is the white frame of an earlier one.
    ///
    /// # Errors
    /// Why it cannot, in words.
    pub(crate) async fn begin_as(&self, start: &JobStart, white: Option<Frame>) -> Result<(), String> {
        self.motion.set_shell(words::known(&start.shell)?);
        let contact = start.measured_contact.map_or_else(
            || Contact { e_mm: start.l_bound_mm - self.config.assembly.clearance_mm, measured_sigma_mm: None },
            |seen| Contact { e_mm: seen.e_mm, measured_sigma_mm: Some(seen.sigma_mm) },
        );
        self.motion.set_l_bound(start.l_bound_mm, contact);
        if let Some(e_mm) = start.aim_mm {
            self.eye.aim_at(e_mm);
        }
        self.eye.see(start.other_in_view.then_some(InView::Other));
        if let Some(air) = &start.air_step {
            self.eye.keep_air_step(AirStep {
                camera: CalibratedCamera {
                    design: self.config.design(),
                    lens_to_mla_mm: air.lens_to_mla_mm,
                    mla_to_sensor_mm: air.mla_to_sensor_mm,
                    image_distance_sigma_mm: air.image_distance_sigma_mm,
                    pixel_mm: self.eye.pixel_mm(),
                    window_px: air.window_px,
                    aberrations_sigma: self.config.uncertainty.shell_aberrations,
                },
                delta_v: (air.delta_v_mm, air.delta_v_sigma_mm),
                boards: boards(&air.boards).try_into().ok(),
                focus_mm: air.focus_mm,
                focus_scale: air.focus_scale,
                places: air.places.iter().map(AirPlace::from).collect(),
            });
            if air.place_lost {
                self.eye.lose_air_step();
            }
        }
        if let Some(white) = white {
            self.eye.learn(white.into()).await.map_err(|end| end.to_string())?;
        }
        Ok(())
    }
}

impl From<&BoardSeen> for messages::BoardSeen {
    fn from(board: &BoardSeen) -> Self {
        Self { distance_mm: board.distance_mm, spacing_px: board.spacing_px, sigma_px: board.sigma_px }
    }
}

impl From<&messages::BoardSeen> for BoardSeen {
    fn from(recorded: &messages::BoardSeen) -> Self {
        let messages::BoardSeen { distance_mm, spacing_px, sigma_px } = *recorded;
        Self { distance_mm, spacing_px, sigma_px }
    }
}

impl From<&AirPlace> for messages::AirPlace {
    fn from(place: &AirPlace) -> Self {
        Self { focus_mm: place.focus_mm, boards: place.boards.iter().map(messages::BoardSeen::from).collect() }
    }
}

impl From<&messages::AirPlace> for AirPlace {
    fn from(recorded: &messages::AirPlace) -> Self {
        Self { focus_mm: recorded.focus_mm, boards: boards(&recorded.boards) }
    }
}

/// The boards of a recording, nearest first.
fn boards(recorded: &[messages::BoardSeen]) -> Vec<BoardSeen> {
    recorded.iter().map(BoardSeen::from).collect()
}
