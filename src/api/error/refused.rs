//! What the service refuses, as problems.

use axum::http::StatusCode;
use serde_json::json;

use super::{CONFIRM_HEADER, LEASE_HEADER, Problem};
use crate::access::TokenError;
use crate::control::{Refusal, ServiceError};
use crate::device::DeviceError;

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        let it = &refusal;
        match it {
            Refusal::Stopped => Self::refused("stopped", "The stop is latched", it, json!({})),
            Refusal::LeaseRequired => Self::new(
                StatusCode::PRECONDITION_REQUIRED,
                "lease-required",
                "Motion needs the control lease",
                format!("{it}: POST /api/v1/lease, and send the key it gives as the header {LEASE_HEADER}"),
            ),
            Refusal::LeaseLost { holder } => Self::new(
                StatusCode::PRECONDITION_FAILED,
                "lease-lost",
                "The control lease shown is not in force",
                it.to_string(),
            )
            .with(json!({ "owner": holder })),
            Refusal::ControlEnded { axis, .. } => {
                Self::refused("control-ended", "Control ended", it, json!({ "axis": axis }))
            }
            Refusal::LeaseHeld { owner, note, job } => {
                let members = json!({ "owner": owner, "note": note, "job": job });
                Self::refused("lease-held", "Somebody else has control", it, members)
            }
            Refusal::Busy { job } => {
                let members = json!({ "job": job, "href": crate::api::types::job_href(*job) });
                Self::refused("busy", "A job holds the bench", it, members)
            }
            Refusal::Searching => Self::refused("busy", "The camera's exposure is searched for", it, json!({})),
            Refusal::Limit { axis, target, low, high } => {
                let members = json!({
                    "axis": axis, "target_mm": target.value(), "low_mm": low.value(), "high_mm": high.value(),
                });
                Self::refused("limit", "Outside the axis's travel", it, members)
            }
            Refusal::Wall { target, wall, .. } => {
                let members = json!({ "axis": "e", "target_mm": target.value(), "wall_mm": wall.value() });
                Self::refused("wall", "Beyond the e wall", it, members)
            }
            Refusal::Step { axis, distance, max } => {
                let members = json!({ "axis": axis, "distance_mm": distance.value(), "max_mm": max.value() });
                Self::refused("step", "Longer than one move may be", it, members)
            }
            Refusal::Speed { axis, speed, max } => {
                let members = json!({ "axis": axis, "speed_mm_per_s": speed, "max_mm_per_s": max });
                Self::refused("speed", "Faster than the axis goes", it, members)
            }
            Refusal::NotHomed { axis } => {
                Self::refused("not-homed", "The axis is not homed", it, json!({ "axis": axis }))
            }
            Refusal::Moving { axis } => {
                Self::refused("moving", "Not while the axis moves", it, json!({ "axis": axis }))
            }
            Refusal::Contradiction { axis, contradictions } => {
                let members = json!({ "axis": axis, "contradictions": contradictions });
                Self::refused("contradiction", "The controller contradicts the configuration", it, members)
            }
            Refusal::HomingTowardsShell { axis, shell } => {
                let title = "Homing would run towards the shell";
                Self::refused("homing-towards-shell", title, it, json!({ "axis": axis, "shell": shell }))
            }
            Refusal::SwitchPressed { axis, .. } => {
                Self::refused("switch-pressed", "A limit switch is pressed", it, json!({ "axis": axis }))
            }
            Refusal::LeavingTowardsShell { pressed, shell } => {
                let (title, members) =
                    ("Leaving the switch would run towards the shell", json!({ "pressed": pressed, "shell": shell }));
                Self::refused("leaving-towards-shell", title, it, members)
            }
            Refusal::JobState { state, .. } => {
                Self::refused("job-state", "Not in the job's state", it, json!({ "state": state }))
            }
            Refusal::SpansMotion { axes } => {
                Self::refused("spans-motion", "The frame spans motion", it, json!({ "axes": axes }))
            }
            Refusal::NotMeasurable { .. } => Self::refused("not-measurable", "Nothing can be measured", it, json!({})),
            Refusal::NotViewable { .. } => Self::refused("not-viewable", "This view cannot be made", it, json!({})),
            Refusal::NoControl { control, .. } => {
                Self::refused("no-control", "The camera cannot be set so", it, json!({ "control": control }))
            }
            Refusal::ControlRange { control, value, minimum, maximum, unit } => {
                let members = json!({
                    "control": control, "value": value, "minimum": minimum, "maximum": maximum, "unit": unit,
                });
                Self::refused("control-range", "Outside the control's limits", it, members)
            }
            Refusal::NotExposed { .. } => Self::refused("not-exposed", "No exposure fits", it, json!({})),
            Refusal::PoseUnknown { .. } => {
                Self::refused("pose-unknown", "The camera's pose is not known", it, json!({}))
            }
            Refusal::NoHistory { .. } => {
                let title = "The history cannot be written";
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "history-unwritable", title, it.to_string())
            }
            Refusal::ConfirmKeyRequired => Self::new(
                StatusCode::PRECONDITION_REQUIRED,
                "confirm-key-required",
                "Confirming needs a key",
                format!("{it}: send one as the header {LEASE_HEADER}, or {CONFIRM_HEADER}"),
            ),
            Refusal::ConfirmKeyWrong => {
                let title = "The key confirms nothing of this job";
                Self::new(StatusCode::FORBIDDEN, "confirm-key-wrong", title, it.to_string())
            }
            Refusal::OldPicture => Self::refused("old-picture", "The picture is an old one", it, json!({})),
            Refusal::NoConfirmKey { .. } => {
                let title = "No confirm key can be made";
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "no-confirm-key", title, it.to_string())
            }
            Refusal::ResetNotKept { .. } => Self::not_kept(it.to_string()),
            Refusal::PressEnded { axis } => {
                Self::refused("press-ended", "The press has ended", it, json!({ "axis": axis }))
            }
            Refusal::KeyReused { job, .. } => {
                let title = "The Idempotency-Key stands for another request";
                Self::new(StatusCode::UNPROCESSABLE_ENTITY, "idempotency-key-reused", title, it.to_string())
                    .with(json!({ "job": job, "href": crate::api::types::job_href(*job) }))
            }
            Refusal::ShuttingDown => {
                let title = "The program is shutting down";
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "shutting-down", title, it.to_string())
            }
        }
    }
}

impl From<DeviceError> for Problem {
    fn from(error: DeviceError) -> Self {
        const GONE: StatusCode = StatusCode::SERVICE_UNAVAILABLE;
        const REFUSED: StatusCode = StatusCode::CONFLICT;
        let it = &error;
        match it {
            DeviceError::Disconnected { device, .. } => {
                let title = "A device is not connected";
                Self::device(GONE, "device-disconnected", title, it, json!({ "device": device }))
            }
            DeviceError::Busy { device, .. } => {
                let title = "A device is in use by another program";
                Self::device(GONE, "device-in-use", title, it, json!({ "device": device }))
            }
            DeviceError::WrongDevice { device, .. } => {
                let title = "Another device answers than the one configured";
                Self::device(GONE, "device-wrong", title, it, json!({ "device": device }))
            }
            DeviceError::Timeout { device, .. } => {
                Self::device(GONE, "device-timeout", "A device is late", it, json!({ "device": device }))
            }
            DeviceError::Protocol { device, .. } => {
                let title = "A device's answer cannot be understood";
                Self::device(GONE, "device-protocol", title, it, json!({ "device": device }))
            }
            DeviceError::Refused { device, .. } => {
                Self::device(REFUSED, "device-refused", "A device refuses", it, json!({ "device": device }))
            }
            DeviceError::Alarm { device, .. } => {
                Self::device(REFUSED, "device-alarm", "A device is in alarm", it, json!({ "device": device }))
            }
            DeviceError::NotHomed { axis } => Refusal::NotHomed { axis: *axis }.into(),
            DeviceError::Stopped { axis } => {
                Self::device(REFUSED, "stopped", "The axis was stopped", it, json!({ "axis": axis }))
            }
        }
    }
}

impl From<ServiceError> for Problem {
    fn from(error: ServiceError) -> Self {
        match error {
            ServiceError::Refused(refusal) => refusal.into(),
            ServiceError::Device(error) => error.into(),
            ServiceError::NoSuchJob { .. } => Self::not_found(error.to_string()),
            ServiceError::Unreadable { .. } => {
                let title = "The history cannot be read";
                Self::new(StatusCode::SERVICE_UNAVAILABLE, "history-unreadable", title, error.to_string())
            }
            ServiceError::Invalid { field, .. } => Self::invalid(field, error.to_string()),
        }
    }
}

impl From<TokenError> for Problem {
    fn from(error: TokenError) -> Self {
        let said = error.to_string();
        match error {
            TokenError::Name(_) => Self::invalid("name", said),
            TokenError::Past(_) => {
                Self::new(StatusCode::CONFLICT, "past", "The time is over", said).with(json!({ "field": "expires_at" }))
            }
            TokenError::Taken(_) | TokenError::Reserved(_) | TokenError::Full => Self::taken(said),
            TokenError::Unknown(_) => Self::not_found(said),
            TokenError::File { .. } => Self::not_kept(said),
        }
    }
}
