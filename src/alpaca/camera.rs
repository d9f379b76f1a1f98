//! The bench's camera as a Camera. Seeing needs no control lease: any number of clients may be connected, and share the
//! one exposure under way.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};
use tokio::time::Instant;

use super::answer::Answer;
use super::common::Device;
use super::exposure::CameraState;
use super::fault::{Fault, Refused};
use super::image::Window;
use super::request::{Call, Caller, Verb, Verbs};
use super::server::Facade;
use crate::raw::{CfaPattern, PixelFormat};

/// Members of a Camera alone.
pub(super) const MEMBERS: &[(&str, Verbs)] = &[
    ("abortexposure", Verbs::Put),
    ("bayeroffsetx", Verbs::Get),
    ("bayeroffsety", Verbs::Get),
    ("binx", Verbs::Both),
    ("biny", Verbs::Both),
    ("camerastate", Verbs::Get),
    ("cameraxsize", Verbs::Get),
    ("cameraysize", Verbs::Get),
    ("canabortexposure", Verbs::Get),
    ("canasymmetricbin", Verbs::Get),
    ("canfastreadout", Verbs::Get),
    ("cangetcoolerpower", Verbs::Get),
    ("canpulseguide", Verbs::Get),
    ("cansetccdtemperature", Verbs::Get),
    ("canstopexposure", Verbs::Get),
    ("ccdtemperature", Verbs::Get),
    ("cooleron", Verbs::Both),
    ("coolerpower", Verbs::Get),
    ("electronsperadu", Verbs::Get),
    ("exposuremax", Verbs::Get),
    ("exposuremin", Verbs::Get),
    ("exposureresolution", Verbs::Get),
    ("fastreadout", Verbs::Both),
    ("fullwellcapacity", Verbs::Get),
    ("gain", Verbs::Both),
    ("gainmax", Verbs::Get),
    ("gainmin", Verbs::Get),
    ("gains", Verbs::Get),
    ("hasshutter", Verbs::Get),
    ("heatsinktemperature", Verbs::Get),
    ("imagearray", Verbs::Get),
    ("imagearrayvariant", Verbs::Get),
    ("imageready", Verbs::Get),
    ("ispulseguiding", Verbs::Get),
    ("lastexposureduration", Verbs::Get),
    ("lastexposurestarttime", Verbs::Get),
    ("maxadu", Verbs::Get),
    ("maxbinx", Verbs::Get),
    ("maxbiny", Verbs::Get),
    ("numx", Verbs::Both),
    ("numy", Verbs::Both),
    ("offset", Verbs::Both),
    ("offsetmax", Verbs::Get),
    ("offsetmin", Verbs::Get),
    ("offsets", Verbs::Get),
    ("percentcompleted", Verbs::Get),
    ("pixelsizex", Verbs::Get),
    ("pixelsizey", Verbs::Get),
    ("pulseguide", Verbs::Put),
    ("readoutmode", Verbs::Both),
    ("readoutmodes", Verbs::Get),
    ("sensorname", Verbs::Get),
    ("sensortype", Verbs::Get),
    ("setccdtemperature", Verbs::Both),
    ("startexposure", Verbs::Put),
    ("startx", Verbs::Both),
    ("starty", Verbs::Both),
    ("stopexposure", Verbs::Put),
    ("subexposureduration", Verbs::Both),
];

/// So many clients are remembered; whoever has asked nothing for longest is forgotten first.
const MOST_VIEWERS: usize = 256;

/// Sensor types, by the specification's numbers.
const MONOCHROME: i32 = 0;
const RGGB: i32 = 2;

/// Why the camera does not have some of its members.
const SET_BY_CONFIGURATION: &str = "the camera's own controls are set by the bench's configuration";
const NO_COOLER: &str = "the camera has no cooler, and tells no temperature";
const NO_GUIDING: &str = "the camera guides nothing";
const NOT_KNOWN: &str = "the camera does not tell";

/// The clients that are connected to the camera.
#[derive(Default)]
pub(super) struct Viewers(Mutex<HashMap<Caller, Instant>>);

impl Viewers {
    fn seen(&self) -> MutexGuard<'_, HashMap<Caller, Instant>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn connect(&self, caller: Caller) {
        let mut seen = self.seen();
        if seen.len() >= MOST_VIEWERS
            && !seen.contains_key(&caller)
            && let Some(idle) = seen.iter().min_by_key(|(_, at)| **at).map(|(caller, _)| *caller)
        {
            seen.remove(&idle);
        }
        seen.insert(caller, Instant::now());
    }

    pub(super) fn disconnect(&self, caller: Caller) {
        self.seen().remove(&caller);
    }

    pub(super) fn is_connected(&self, caller: Caller) -> bool {
        let mut seen = self.seen();
        let found = seen.get_mut(&caller);
        found.map(|at| *at = Instant::now()).is_some()
    }
}

impl Facade {
    pub(super) fn connect_camera(&self, caller: Caller) -> Result<(), Fault> {
        let state = self.service.bench().camera.state().borrow().clone();
        if !state.online {
            let why = state.fault.unwrap_or_else(|| "no frames arrive".to_owned());
            return Err(Fault::device(format!("the camera is not connected: {why}")));
        }
        self.viewers.connect(caller);
        Ok(())
    }

    fn window(&self) -> MutexGuard<'_, Window> {
        self.window.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn answer_camera(&self, call: &Call) -> Result<Answer, Refused> {
        match call.verb {
            Verb::Get => {
                self.need_connection(Device::Camera, call.caller)?;
                Ok(self.read_camera(call.member)?)
            }
            Verb::Put => self.tell_camera(call),
        }
    }

    fn read_camera(&self, member: &str) -> Result<Answer, Fault> {
        let config = self.service.config();
        let sensor = &config.sensor;
        let exposure = |frame: &crate::device::Frame| frame.exposed_to.saturating_duration_since(frame.exposed_from);
        Ok(match member {
            "bayeroffsetx" => Answer::of(bayer_offset(sensor.mosaic)?[0]),
            "bayeroffsety" => Answer::of(bayer_offset(sensor.mosaic)?[1]),
            "sensortype" => Answer::of(if sensor.mosaic.is_some() { RGGB } else { MONOCHROME }),
            // Its data sheet's name, which no driver tells.
            "sensorname" => Answer::of(""),
            "cameraxsize" => Answer::of(sensor.width_px),
            "cameraysize" => Answer::of(sensor.height_px),
            "pixelsizex" | "pixelsizey" => Answer::of(sensor.pixel_um),
            "binx" | "biny" | "maxbinx" | "maxbiny" => Answer::of(1),
            "startx" => Answer::of(self.window().start_x),
            "starty" => Answer::of(self.window().start_y),
            "numx" => Answer::of(self.window().num_x),
            "numy" => Answer::of(self.window().num_y),
            "camerastate" => Answer::of(self.shutter.state() as i32),
            "imageready" => Answer::of(self.shutter.is_ready()?),
            "imagearray" | "imagearrayvariant" => Answer::Picture(self.shutter.picture()?),
            "percentcompleted" => Answer::of(self.percent_completed()?),
            "lastexposureduration" => Answer::of(exposure(&*self.shutter.last()?).as_secs_f64()),
            "lastexposurestarttime" => {
                let frame = self.shutter.last()?;
                let begin = frame.captured_at.checked_sub(exposure(&frame)).unwrap_or(frame.captured_at);
                // As FITS has it: UTC, without saying so.
                Answer::of(begin.strftime("%Y-%m-%dT%H:%M:%S%.3f").to_string())
            }
            "maxadu" => Answer::of(self.max_adu()?),
            "exposuremin" | "exposureresolution" => Answer::of(0.0),
            "exposuremax" => Answer::of(self.longest_exposure_s()),
            "readoutmode" => Answer::of(0),
            "readoutmodes" => Answer::of(json!(["Raw"])),
            "canabortexposure" => Answer::of(true),
            "canasymmetricbin"
            | "canfastreadout"
            | "cangetcoolerpower"
            | "canpulseguide"
            | "cansetccdtemperature"
            | "canstopexposure"
            | "hasshutter" => Answer::of(false),
            "ispulseguiding" => return Err(Fault::not_implemented(member, NO_GUIDING)),
            "electronsperadu" | "fullwellcapacity" => return Err(Fault::not_implemented(member, NOT_KNOWN)),
            "ccdtemperature" | "cooleron" | "coolerpower" | "heatsinktemperature" | "setccdtemperature" => {
                return Err(Fault::not_implemented(member, NO_COOLER));
            }
            _ => return Err(Fault::not_implemented(member, SET_BY_CONFIGURATION)),
        })
    }

    fn tell_camera(&self, call: &Call) -> Result<Answer, Refused> {
        let (params, member) = (&call.params, call.member);
        let connected = || self.need_connection(Device::Camera, call.caller);
        // What is malformed is so in every state of the device.
        match member {
            "startexposure" => {
                let (duration_s, _light) = (params.number("Duration")?, params.flag("Light")?);
                connected()?;
                self.expose(duration_s)?;
            }
            "abortexposure" => {
                connected()?;
                self.shutter.abort();
            }
            "stopexposure" => {
                connected()?;
                return Err(Fault::not_implemented(member, "a frame is taken as a whole, or not at all").into());
            }
            "startx" | "starty" | "numx" | "numy" => {
                let (name, least) = match member {
                    "startx" => ("StartX", 0),
                    "starty" => ("StartY", 0),
                    "numx" => ("NumX", 1),
                    _ => ("NumY", 1),
                };
                let value = params.int(name)?;
                connected()?;
                if value < least {
                    return Err(Fault::invalid_value(format!("{name}: {value} is less than {least}")).into());
                }
                let mut window = self.window();
                match member {
                    "startx" => window.start_x = value,
                    "starty" => window.start_y = value,
                    "numx" => window.num_x = value,
                    _ => window.num_y = value,
                }
            }
            "binx" | "biny" | "readoutmode" => {
                let (name, only) = match member {
                    "binx" => ("BinX", 1),
                    "biny" => ("BinY", 1),
                    _ => ("ReadoutMode", 0),
                };
                let value = params.int(name)?;
                connected()?;
                if value != only {
                    return Err(Fault::invalid_value(format!("{name}: {value} is not {only}, the only one")).into());
                }
            }
            "cooleron" => {
                params.flag("CoolerOn")?;
                return Err(Fault::not_implemented("CoolerOn", NO_COOLER).into());
            }
            "setccdtemperature" => {
                params.number("SetCCDTemperature")?;
                return Err(Fault::not_implemented("SetCCDTemperature", NO_COOLER).into());
            }
            "pulseguide" => {
                params.int("Direction")?;
                params.int("Duration")?;
                return Err(Fault::not_implemented("PulseGuide", NO_GUIDING).into());
            }
            "fastreadout" => {
                params.flag("FastReadout")?;
                return Err(Fault::not_implemented("FastReadout", SET_BY_CONFIGURATION).into());
            }
            "subexposureduration" => {
                params.number("SubExposureDuration")?;
                return Err(Fault::not_implemented("SubExposureDuration", SET_BY_CONFIGURATION).into());
            }
            _ => {
                params.int(if member == "gain" { "Gain" } else { "Offset" })?;
                return Err(Fault::not_implemented(member, SET_BY_CONFIGURATION).into());
            }
        }
        Ok(Answer::Done)
    }

    /// Begins an exposure.
    fn expose(&self, duration_s: f64) -> Result<(), Fault> {
        let longest = self.longest_exposure_s();
        if !(0.0..=longest).contains(&duration_s) {
            return Err(Fault::invalid_value(format!(
                "Duration: {duration_s} is not within ExposureMin and ExposureMax, 0 to {longest}: the camera exposes each \
                 frame as the bench's configuration sets it, and LastExposureDuration says how long that was"
            )));
        }
        let (window, sensor) = (*self.window(), &self.service.config().sensor);
        window.check(sensor.width_px as usize, sensor.height_px as usize)?;
        if let Some(why) = self.service.bench().camera.state().borrow().unfit.clone() {
            return Err(Fault::invalid_operation(why));
        }
        self.shutter.open(self.service.clone(), window)
    }

    /// No frame is exposed for longer than from one to the next, s.
    fn longest_exposure_s(&self) -> f64 {
        1.0 / self.service.config().bench.camera.frame_rate_hz
    }

    fn percent_completed(&self) -> Result<i32, Fault> {
        match self.shutter.state() {
            // How far it has come is not known.
            CameraState::Exposing => Ok(0),
            CameraState::Idle if self.shutter.is_ready()? => Ok(100),
            _ => Err(Fault::invalid_operation("no exposure is under way")),
        }
    }

    /// The largest value of a sample.
    fn max_adu(&self) -> Result<u16, Fault> {
        let seen = self.shutter.last().ok().or_else(|| self.service.bench().camera.newest());
        if let Some(frame) = seen {
            return Ok(frame.image.white_level());
        }
        let bench = &self.service.config().bench;
        let bits = if self.service.bench().is_simulated() {
            Some(bench.simulation.bits)
        } else {
            PixelFormat::from_name(&bench.camera.format).map(PixelFormat::bits)
        };
        let white = bits.and_then(|bits| 1u32.checked_shl(bits.into())?.checked_sub(1)?.try_into().ok());
        white.ok_or_else(|| Fault::not_set("no frame has come yet, and the camera's depth is not known before"))
    }

    /// What the camera does.
    pub(super) fn camera_states(&self) -> Vec<(&'static str, Value)> {
        let mut states = vec![("CameraState", json!(self.shutter.state() as i32))];
        states.extend(self.shutter.is_ready().ok().map(|ready| ("ImageReady", json!(ready))));
        states.extend(self.percent_completed().ok().map(|percent| ("PercentCompleted", json!(percent))));
        states
    }
}

/// Where the first red pixel is.
fn bayer_offset(mosaic: Option<CfaPattern>) -> Result<[i32; 2], Fault> {
    match mosaic {
        Some(CfaPattern::Rggb) => Ok([0, 0]),
        Some(CfaPattern::Grbg) => Ok([1, 0]),
        Some(CfaPattern::Gbrg) => Ok([0, 1]),
        Some(CfaPattern::Bggr) => Ok([1, 1]),
        None => Err(Fault::not_implemented("BayerOffsetX and BayerOffsetY", "the sensor is monochrome")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_clients_forgets_who_asked_nothing_for_longest() {
        let viewers = Viewers::default();
        let caller = |id: usize| Caller { id: u32::try_from(id).unwrap(), address: [127, 0, 0, 1].into() };
        viewers.connect(caller(0));
        for id in 1..=MOST_VIEWERS {
            assert!(viewers.is_connected(caller(0)), "{id}");
            viewers.connect(caller(id));
        }
        assert_eq!(viewers.seen().len(), MOST_VIEWERS);
        assert!(viewers.is_connected(caller(0)) && !viewers.is_connected(caller(1)));
        viewers.disconnect(caller(0));
        assert!(!viewers.is_connected(caller(0)));
    }

    #[test]
    fn the_first_red_pixel_is_where_the_mosaic_has_it() {
        assert_eq!(bayer_offset(Some(CfaPattern::Grbg)), Ok([1, 0]));
        assert_eq!(bayer_offset(Some(CfaPattern::Bggr)), Ok([1, 1]));
        assert_eq!(bayer_offset(None).unwrap_err().number, 0x400);
    }
}
