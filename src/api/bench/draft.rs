//! Drafts of a camera: asked about, worked out, not kept.

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use utoipa::ToSchema;

use super::config::ConfigFault;
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::JsonBody;
use crate::config::{Config, ConfigOrigin};
use crate::control::design::draft::DraftView;
use crate::control::plan::PlanView;

/// What a draft's keys are laid over.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(in crate::api) enum DraftBase {
    /// The configuration in force.
    #[default]
    InForce,
    /// The reference preset, inferred from the paper.
    Preset,
}

/// A draft of a camera: sections of the configuration with the keys that are to be otherwise. `water`, where it is
/// there, stands alone, its keys being alternatives.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::api) struct DraftRequest {
    /// What they are laid over.
    base: DraftBase,
    /// The main lens.
    #[schema(value_type = Object)]
    main_lens: Map<String, Value>,
    /// The microlens array.
    #[schema(value_type = Object)]
    mla: Map<String, Value>,
    /// The sensor.
    #[schema(value_type = Object)]
    sensor: Map<String, Value>,
    /// The spherical shell.
    #[schema(value_type = Object)]
    shell: Map<String, Value>,
    /// The water.
    #[schema(value_type = Object)]
    water: Map<String, Value>,
    /// The object distances.
    #[schema(value_type = Object)]
    object: Map<String, Value>,
    /// Which boards there are in air.
    #[schema(value_type = Object)]
    boards: Map<String, Value>,
    /// How the camera is put together, and to which tolerances.
    #[schema(value_type = Object)]
    assembly: Map<String, Value>,
}

impl DraftRequest {
    /// The sections that say something.
    fn sections(self) -> Value {
        let Self { base: _, main_lens, mla, sensor, shell, water, object, boards, assembly } = self;
        let sections = [
            ("main_lens", main_lens),
            ("mla", mla),
            ("sensor", sensor),
            ("shell", shell),
            ("water", water),
            ("object", object),
            ("boards", boards),
            ("assembly", assembly),
        ];
        let said = sections.into_iter().filter(|(_, keys)| !keys.is_empty());
        Value::Object(said.map(|(name, keys)| (name.to_owned(), Value::Object(keys))).collect())
    }
}

/// Works out a camera: its solutions, curves, and rays to be drawn. Nothing is kept and nothing moves.
#[utoipa::path(
    post, path = "/api/v1/design", operation_id = "draft_design", tag = "bench", request_body = DraftRequest,
    responses(
        (status = 200, body = DraftView),
        (status = 409, description = "No camera can be like that: `problems` says why, key by key", body = Problem,
         content_type = "application/problem+json"),
        (status = 422, description = "The request does not say what it must", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn work_out(
    State(app): State<App>,
    JsonBody(request): JsonBody<DraftRequest>,
) -> Result<Json<DraftView>> {
    let (draft, origin) = drafted(&app, request)?;
    DraftView::of(&draft, &origin).map(Json).ok_or_else(|| Problem::design_impossible(json!([])))
}

/// Works out how a camera would be aligned on this bench: where it measures, where the boards go, what it is expected to be
/// good to, and what stands in the way. Nothing is kept and nothing moves.
#[utoipa::path(
    post, path = "/api/v1/plan", operation_id = "plan_alignment", tag = "bench", request_body = DraftRequest,
    responses(
        (status = 200, body = PlanView),
        (status = 409, description = "No camera can be like that: `problems` says why, key by key", body = Problem,
         content_type = "application/problem+json"),
        (status = 422, description = "The request does not say what it must", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn plan(
    State(app): State<App>,
    JsonBody(request): JsonBody<DraftRequest>,
) -> Result<Json<PlanView>> {
    let (draft, origin) = drafted(&app, request)?;
    let plan = PlanView::within(&draft, &origin, app.service.travel(&draft));
    let in_force = draft == **app.service.config();
    Ok(Json(if in_force { app.service.as_it_usually_took(plan).await } else { plan }))
}

/// The draft that a request describes, and where its numbers come from.
fn drafted(app: &App, request: DraftRequest) -> Result<(Config, ConfigOrigin)> {
    let preset = Config::default();
    let (base, origin) = match request.base {
        DraftBase::InForce => (app.service.config().as_ref(), (*app.origin).clone()),
        DraftBase::Preset => (&preset, ConfigOrigin::Preset),
    };
    let draft = base.drafted(&request.sections()).map_err(|error| {
        let faults = error.violations().iter();
        let faults = faults.map(|fault| ConfigFault { key: fault.key.clone(), message: fault.message.clone() });
        Problem::design_impossible(json!(faults.collect::<Vec<_>>()))
    })?;
    let origin = origin.overridden(base, &draft);
    Ok((draft, origin))
}
