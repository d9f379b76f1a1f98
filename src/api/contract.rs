//! The contract, completed with what follows from what the handlers say: failures that every operation of a kind
//! shares, what each kind of job takes, what can be done with what has been made, and the configuration's own schema.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use utoipa::IntoResponses;
use utoipa::openapi::link::Link;
use utoipa::openapi::path::{Operation, Parameter, ParameterIn};
use utoipa::openapi::schema::{AdditionalProperties, Object, OneOf, Schema, SchemaType, Type};
use utoipa::openapi::{
    Components, ContentBuilder, ObjectBuilder, OneOfBuilder, OpenApi, Ref, RefOr, Response, ResponseBuilder,
};

use super::access::security;
use crate::config::Config;
use crate::control::design::draft::SECTIONS;
use crate::control::job::{JobKind, JobRequest};

/// Failures of a command that only the holder of the control lease may give.
pub(super) struct Leased;

impl IntoResponses for Leased {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems([("412", "The lease's key is not the holder's"), ("428", "No lease was shown")])
    }
}

/// Failures of a command of motion.
pub(super) struct Motion;

impl IntoResponses for Motion {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        let mut responses = Leased::responses();
        responses.extend(problems([
            ("409", "Refused now"),
            ("503", "The controller is away, the history cannot be written, or the program is shutting down"),
        ]));
        responses
    }
}

/// Failures of an answer to an operator step, which shows a key.
pub(super) struct Keyed;

impl IntoResponses for Keyed {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems([
            ("403", "The key confirms nothing of this job"),
            ("428", "No key was shown"),
            ("429", "Too many keys were wrong"),
        ])
    }
}

/// Failures of reading the history.
pub(super) struct FromHistory;

impl IntoResponses for FromHistory {
    fn responses() -> BTreeMap<String, RefOr<Response>> {
        problems([("503", "The history cannot be read")])
    }
}

/// A failure as the contract has it.
pub(super) fn problem(description: &str) -> RefOr<Response> {
    failure("Problem", description)
}

/// A failure whose body has a schema of this name.
pub(super) fn failure(schema: &str, description: &str) -> RefOr<Response> {
    let content = ContentBuilder::new().schema(Some(Ref::from_schema_name(schema))).build();
    ResponseBuilder::new().description(description).content("application/problem+json", content).build().into()
}

fn problems<const N: usize>(which: [(&str, &str); N]) -> BTreeMap<String, RefOr<Response>> {
    which.map(|(status, description)| (status.to_owned(), problem(description))).into()
}

/// The contract that the handlers' own words make, with what follows from them.
pub(super) fn complete(mut contract: OpenApi) -> OpenApi {
    security::describe(&mut contract);
    for item in contract.paths.paths.values_mut() {
        let every = [&mut item.get, &mut item.post, &mut item.put, &mut item.delete];
        every.into_iter().flatten().for_each(add_shared_failures);
    }
    if let Some(components) = &mut contract.components {
        tell_jobs_apart(components);
    }
    link(&mut contract, "/api/v1/jobs", "$response.body#/id");
    link(&mut contract, "/api/v1/tokens", "$response.body#/id");
    contract
}

/// Has the answer of what makes something lead to everything that can be done with it.
fn link(contract: &mut OpenApi, collection: &str, id: &str) {
    let below = format!("{collection}/{{id}}");
    let of_one = contract.paths.paths.iter().filter(|(path, _)| path.starts_with(&below));
    let operations = of_one.flat_map(|(_, item)| [&item.get, &item.post, &item.put, &item.delete]).flatten();
    let names: Vec<String> = operations.filter_map(|operation| operation.operation_id.clone()).collect();
    let Some(made) = contract.paths.paths.get_mut(collection).and_then(|item| item.post.as_mut()) else { return };
    for status in ["200", "201"] {
        if let Some(RefOr::T(answer)) = made.responses.responses.get_mut(status) {
            for name in &names {
                let link = Link::builder().operation_id(name).parameter("id", id).build();
                answer.links.insert(name.clone(), link.into());
            }
        }
    }
}

/// The contract as JSON, with the schema of the configuration in its place: it is made by other means than the rest.
pub(super) fn with_configuration(mut contract: Value) -> Value {
    let mut schema = Config::json_schema();
    lead_to_components(&mut schema);
    let parts = schema.as_object_mut().and_then(|schema| {
        schema.remove("$schema");
        schema.remove("$defs")
    });
    let parts: Map<String, Value> = parts.and_then(|parts| parts.as_object().cloned()).unwrap_or_default();
    if let Some(schemas) = contract.pointer_mut("/components/schemas").and_then(Value::as_object_mut) {
        schemas.extend(parts.into_iter().map(|(name, part)| (format!("Config.{name}"), part)));
        schemas.insert("Config".to_owned(), schema);
        let place = schemas.get_mut("ConfigRequest").and_then(|asked| asked.pointer_mut("/properties/config"));
        if let Some(Value::Object(place)) = place {
            place.insert("$ref".to_owned(), json!("#/components/schemas/Config"));
        }
        draft_sections(schemas);
    }
    contract
}

/// Has the sections of a draft be those of the configuration.
fn draft_sections(schemas: &mut Map<String, Value>) {
    for section in SECTIONS {
        let there = schemas.get("Config").and_then(|config| config.pointer(&format!("/properties/{section}/$ref")));
        let Some(reference) = there.cloned() else { continue };
        let draft = schemas.get_mut("DraftRequest");
        let place = draft.and_then(|draft| draft.pointer_mut(&format!("/properties/{section}")));
        if let Some(Value::Object(place)) = place {
            place.remove("type");
            place.insert("$ref".to_owned(), reference);
        }
    }
}

/// Has a schema's references lead to where its parts are in the contract.
fn lead_to_components(schema: &mut Value) {
    match schema {
        Value::Object(members) => {
            for (key, member) in members {
                match member {
                    Value::String(to) if key == "$ref" => {
                        *to = to.replace("#/$defs/", "#/components/schemas/Config.");
                    }
                    member => lead_to_components(member),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(lead_to_components),
        _ => {}
    }
}

/// Every request with a body, a query or a parameter in its path can fail in these ways, wherever it goes.
fn add_shared_failures(operation: &mut Operation) {
    let body = [
        ("400", "The body is not JSON"),
        ("408", "The body is late"),
        ("413", "The body is too large"),
        ("415", "The body is not said to be JSON"),
        ("422", "The request does not say what it must; `field` names where"),
    ];
    let query = [("422", "A parameter does not say what it must; `field` names it")];
    let path = [("404", "There is nothing under this name")];
    let has = |place: &ParameterIn| {
        let is_there = |it: &RefOr<Parameter>| matches!(it, RefOr::T(it) if it.parameter_in == *place);
        operation.parameters.iter().flatten().any(is_there)
    };
    let (has_query, has_path) = (has(&ParameterIn::Query), has(&ParameterIn::Path));
    let body = body.into_iter().filter(|_| operation.request_body.is_some());
    let query = query.into_iter().filter(|_| has_query);
    let path = path.into_iter().filter(|_| has_path);
    let shared: Vec<_> = body.chain(query).chain(path).collect();
    for (status, description) in shared {
        operation.responses.responses.entry(status.to_owned()).or_insert_with(|| problem(description));
    }
}

/// Has the request of a job say for each kind what it takes, where its fields alone would allow anything with anything.
fn tell_jobs_apart(components: &mut Components) {
    let Some(RefOr::T(Schema::Object(all))) = components.schemas.get("JobRequest") else { return };
    let kinds = JobKind::ALL.into_iter().map(|kind| RefOr::T(Schema::Object(of_kind(all, kind))));
    let one_of = kinds.fold(OneOfBuilder::new(), OneOfBuilder::item).description(all.description.clone());
    let one_of: OneOf = one_of.build();
    components.schemas.insert("JobRequest".to_owned(), RefOr::T(Schema::OneOf(one_of)));
}

/// A job's request as an object with the fields of its kind.
fn of_kind(all: &Object, kind: JobKind) -> Object {
    let name = serde_json::to_value(kind).unwrap_or_default();
    let constant = ObjectBuilder::new().schema_type(SchemaType::Type(Type::String)).enum_values(Some([name])).build();
    let mut object = ObjectBuilder::new()
        .property("kind", constant)
        .required("kind")
        .additional_properties(Some(AdditionalProperties::FreeForm(false)))
        .build();
    for field in JobRequest::takes(kind).iter().chain(&["note", "record"]) {
        if let Some(schema) = all.properties.get(*field) {
            object.properties.insert((*field).to_owned(), schema.clone());
        }
    }
    for &field in JobRequest::needs(kind) {
        object.required.push(field.to_owned());
        if let Some(schema) = object.properties.get_mut(field) {
            forbid_null(schema);
        }
    }
    object
}

/// Takes null out of what a schema allows: a field that is needed is not there when it is null.
fn forbid_null(schema: &mut RefOr<Schema>) {
    let null = SchemaType::Type(Type::Null);
    match schema {
        RefOr::T(Schema::Object(object)) => {
            if let SchemaType::Array(types) = &mut object.schema_type {
                types.retain(|kind| *kind != Type::Null);
                if let [only] = &types[..] {
                    object.schema_type = SchemaType::Type(only.clone());
                }
            }
        }
        RefOr::T(Schema::OneOf(one_of)) => {
            one_of.items.retain(|item| !matches!(item, RefOr::T(Schema::Object(object)) if object.schema_type == null));
            if let [only] = &one_of.items[..] {
                *schema = only.clone();
            }
        }
        _ => {}
    }
}
