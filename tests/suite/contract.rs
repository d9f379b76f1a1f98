//! The contract in `proto/` and the code say the same. `UPDATE=1` rewrites what is written by code.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Compares a committed file with what the code makes of it now, or rewrites it.
fn assert_current(path: &str, now: &str) {
    let file = root().join(path);
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&file, now).unwrap();
    }
    let committed = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(committed == now, "{path} is not what the code makes of it; run `UPDATE=1 cargo test contract`");
}

#[test]
fn openapi_json_is_current() {
    assert_current("proto/openapi.json", plenalign::api::openapi_json());
}

/// What `prost-build` makes of a file below `proto/`.
fn rust_messages(file: &str, package: &str, bytes: &[&str]) -> String {
    let out = tempfile::tempdir().unwrap();
    let proto = root().join("proto");
    let mut config = prost_build::Config::new();
    config.out_dir(out.path()).bytes(bytes);
    let files = protox::compile([proto.join(file)], [proto]).unwrap();
    config.compile_fds(files).unwrap();
    std::fs::read_to_string(out.path().join(format!("{package}.rs"))).unwrap()
}

#[test]
fn rust_messages_are_current() {
    let viewed = rust_messages(
        "plenalign/v1/frame.proto",
        "plenalign.v1",
        &[".plenalign.v1.Frame.jpeg", ".plenalign.v1.Frame.png"],
    );
    assert_current("src/api/proto.rs", &viewed);
    let recorded = rust_messages("plenalign/v1/recording.proto", "plenalign.v1", &[]);
    assert_current("crates/bench/src/record/messages.rs", &recorded);
    let pictures = [".foxglove.RawImage.data", ".foxglove.CompressedImage.data"];
    assert_current(
        "crates/bench/src/record/foxglove.rs",
        &rust_messages("foxglove/foxglove.proto", "foxglove", &pictures),
    );
}

/// What a recording says its messages by is made of the files below `proto/`, whole, with what they import.
#[test]
fn embedded_descriptions_are_current() {
    use prost::Message as _;
    let proto = root().join("proto");
    let mut compiler = protox::Compiler::new([&proto]).unwrap();
    compiler.include_imports(true).include_source_info(false);
    compiler.open_files([proto.join("foxglove/foxglove.proto"), proto.join("plenalign/v1/recording.proto")]).unwrap();
    let now = compiler.file_descriptor_set().encode_to_vec();
    let file = root().join("crates/bench/src/record/descriptions.binpb");
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&file, &now).unwrap();
    }
    let committed = std::fs::read(&file).unwrap_or_default();
    assert!(committed == now, "{} is not what proto/ says; run `UPDATE=1 cargo test contract`", file.display());
}

/// Values of `type` that the variants of a message have in the OpenAPI document.
fn types_in_code(name: &str) -> BTreeSet<String> {
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let variants = contract["components"]["schemas"][name]["oneOf"].as_array().expect("a tagged enum").clone();
    let found: BTreeSet<_> =
        variants.iter().filter_map(|v| v["properties"]["type"]["enum"][0].as_str()).map(str::to_owned).collect();
    assert_eq!(found.len(), variants.len(), "a variant of {name} without a type");
    found
}

/// Names of the messages below a channel's operation in `asyncapi.yaml`: `# text` lines carry `const:`.
fn types_in_asyncapi(direction: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join("proto/asyncapi.yaml")).unwrap();
    let section = text.split("x-direction: ").skip(1).filter(|part| part.starts_with(direction));
    section.filter_map(|part| part.split("const: ").nth(1)?.split_whitespace().next()).map(str::to_owned).collect()
}

#[test]
fn asyncapi_names_every_message_and_no_other() {
    assert_eq!(types_in_asyncapi("server"), types_in_code("ServerMessage"));
    assert_eq!(types_in_asyncapi("viewer"), types_in_code("ViewerMessage"));
}

/// Every operation has a name of its own, and every failure is said to be a problem.
#[test]
fn every_failure_in_the_contract_is_a_problem() {
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let (mut failures, mut names) = (0, BTreeSet::new());
    for (path, item) in contract["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let name = operation["operationId"].as_str().expect("a name for generated clients");
            assert!(names.insert(name.to_owned()), "{name} is there twice");
            for (status, response) in operation["responses"].as_object().unwrap() {
                if status.starts_with(['4', '5']) {
                    failures += 1;
                    let content = response["content"].as_object().unwrap();
                    assert_eq!(content.keys().collect::<Vec<_>>(), ["application/problem+json"], "{method} {path}");
                }
            }
        }
    }
    assert!(failures > 20, "only {failures} failures are documented");
}

/// What is said to those who read no Rust: a contract's or a configuration schema's descriptions.
fn descriptions<'v>(value: &'v serde_json::Value, found: &mut Vec<&'v str>) {
    match value {
        serde_json::Value::Object(object) => {
            found.extend(object.get("description").and_then(serde_json::Value::as_str));
            object.values().for_each(|inner| descriptions(inner, found));
        }
        serde_json::Value::Array(array) => array.iter().for_each(|inner| descriptions(inner, found)),
        _ => {}
    }
}

#[test]
fn descriptions_are_no_rust() {
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let schema = plenalign::config::Config::json_schema();
    let mut found = Vec::new();
    descriptions(&contract, &mut found);
    let in_contract = found.len();
    descriptions(&schema, &mut found);
    assert!(in_contract > 500 && found.len() > in_contract + 200, "{in_contract} of {}", found.len());
    for text in found {
        let rust = ["`None`", "`Some", "[`", "::", "`Self"].into_iter().find(|&word| text.contains(word));
        assert_eq!(rust, None, "{text}");
    }
}

#[test]
fn references_of_asyncapi_lead_somewhere() {
    let text = std::fs::read_to_string(root().join("proto/asyncapi.yaml")).unwrap();
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let mut found = 0;
    for reference in text.split("openapi.json#").skip(1) {
        let pointer = reference.split(['\'', '"']).next().unwrap();
        assert!(contract.pointer(pointer).is_some(), "openapi.json has no {pointer}");
        found += 1;
    }
    assert!(found >= 6);
    let proto: PathBuf = root().join("proto/plenalign/v1/frame.proto");
    assert!(text.contains("plenalign/v1/frame.proto") && proto.exists());
}

#[test]
fn references_and_links_of_the_contract_lead_somewhere() {
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let operations: Vec<&str> = contract["paths"]
        .as_object()
        .unwrap()
        .values()
        .flat_map(|item| item.as_object().unwrap().values())
        .filter_map(|operation| operation["operationId"].as_str())
        .collect();
    let (mut references, mut links) = (0, 0);
    let mut left = vec![&contract];
    while let Some(value) = left.pop() {
        match value {
            serde_json::Value::Object(members) => {
                for (key, member) in members {
                    match (key.as_str(), member.as_str()) {
                        ("$ref", Some(to)) => {
                            let found = to.strip_prefix('#').and_then(|pointer| contract.pointer(pointer));
                            assert!(found.is_some(), "{to} leads nowhere");
                            references += 1;
                        }
                        _ => left.push(member),
                    }
                }
                for link in members.get("links").and_then(|links| links.as_object()).into_iter().flatten() {
                    assert!(operations.contains(&link.1["operationId"].as_str().unwrap()), "{link:?}");
                    links += 1;
                }
            }
            serde_json::Value::Array(items) => left.extend(items),
            _ => {}
        }
    }
    assert!(references > 100 && links > 10, "{references} references, {links} links");
    // A configuration is written by the schema that it is read by.
    let schemas = &contract["components"]["schemas"];
    assert_eq!(schemas["ConfigRequest"]["properties"]["config"]["$ref"], "#/components/schemas/Config");
    assert_eq!(schemas["Config"]["properties"]["sensor"]["$ref"], "#/components/schemas/Config.SensorConfig");
}

/// What a kind of job needs is there and not null, as the daemon takes it.
#[test]
fn a_job_is_not_promised_what_it_needs_as_null() {
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let kinds = contract["components"]["schemas"]["JobRequest"]["oneOf"].as_array().unwrap();
    let mut needed = 0;
    for kind in kinds {
        for field in kind["required"].as_array().unwrap() {
            let schema = &kind["properties"][field.as_str().unwrap()];
            assert!(schema.is_object() && !schema.to_string().contains("\"null\""), "{field} may be null: {schema}");
            needed += 1;
        }
    }
    assert!(needed > kinds.len(), "no kind needs anything but its name");
}

/// Every topic and every event of a job that code publishes is in the contract of what goes over MQTT, and no other;
/// `tests/mqtt` holds the messages themselves against it.
#[test]
fn asyncapi_of_mqtt_names_every_topic_event_and_alert_and_no_other() {
    let text = std::fs::read_to_string(root().join("proto/asyncapi-mqtt.yaml")).unwrap();
    let after = |mark: &str, end: char| -> BTreeSet<String> {
        text.split(mark)
            .skip(1)
            .filter_map(|rest| rest.split(end).next())
            .map(|found| found.trim().to_owned())
            .collect()
    };
    assert_eq!(after("address: '", '\''), plenalign::fleet::forms().into_iter().collect());
    assert_eq!(after("event: { const: ", '}'), plenalign::fleet::EVENTS.map(str::to_owned).into());
    let listed = text.split("alert:\n                enum: [").nth(1).and_then(|rest| rest.split(']').next()).unwrap();
    let alerts: Vec<&str> = listed.split(',').map(str::trim).collect();
    assert_eq!(alerts, plenalign::fleet::ALERTS);
    let contract: serde_json::Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let references = after("openapi.json#", '\'');
    for pointer in &references {
        assert!(contract.pointer(pointer).is_some(), "openapi.json has no {pointer}");
    }
    assert!(references.len() >= 12, "{references:?}");
}
