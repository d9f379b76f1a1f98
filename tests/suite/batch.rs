//! The files for Kubernetes in `deploy/batch`: their commands, run by hand as it would run them.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use super::study::with_chapters;

/// Small, and of as many items as there are parts.
const STUDY_ARGS: &str = "--quick --benches 2 --assemblies 200";

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/batch").join(name)
}

/// A command that finds the program as in an image or on a node: with nothing in the environment but where programs are.
fn bare(program: &str, folder: &Path) -> Command {
    let program_folder = Path::new(env!("CARGO_BIN_EXE_plenalign")).parent().unwrap();
    let mut command = Command::new(program);
    command.env_clear().env("PATH", format!("{}:/usr/bin:/bin", program_folder.display())).current_dir(folder);
    command
}

fn said(output: &Output) -> String {
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The results of the study in a folder.
fn results(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("study/results.json")).unwrap()).unwrap()
}

/// The objects of a Kubernetes file.
fn objects(name: &str) -> Vec<Value> {
    let text = fs::read_to_string(file(name)).unwrap();
    serde_saphyr::from_multiple(&text).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn of_kind(objects: &[Value], kind: &str) -> Value {
    objects.iter().find(|object| object["kind"] == kind).unwrap_or_else(|| panic!("{kind}")).clone()
}

/// A Job's one container, ready to be run: its command in the environment that the map gives it.
fn container(job: &Value, map: &Value, folder: &Path) -> Command {
    let pod = &job["spec"]["template"]["spec"];
    let containers = pod["containers"].as_array().unwrap();
    let [container] = containers.as_slice() else { panic!("one container: {containers:?}") };
    assert_eq!(container["envFrom"][0]["configMapRef"]["name"], map["metadata"]["name"]);
    // What is mounted is what there is, at the places that the map names.
    let mounts = container["volumeMounts"].as_array().unwrap();
    for mount in mounts {
        let volume = pod["volumes"].as_array().unwrap().iter().find(|volume| volume["name"] == mount["name"]).unwrap();
        let claimed = &volume["persistentVolumeClaim"]["claimName"];
        assert!(*claimed == "plenalign-study" || volume["configMap"]["name"] == map["metadata"]["name"], "{volume}");
    }
    let mounted = |path: &Value| {
        mounts.iter().any(|mount| path.as_str().unwrap().starts_with(mount["mountPath"].as_str().unwrap()))
    };
    assert!(mounted(&map["data"]["OUT"]) && mounted(&map["data"]["CONFIG"]));
    let words: Vec<&str> = container["command"].as_array().unwrap().iter().map(|word| word.as_str().unwrap()).collect();
    let mut command = bare(words[0], folder);
    command.args(&words[1..]);
    for (name, value) in map["data"].as_object().unwrap() {
        command.env(name, value.as_str().unwrap());
    }
    command
}

#[test]
fn kubernetes_pods_do_every_part_and_merge_them() {
    let folder = with_chapters(&["loops", "assembly"]);
    let (parts, merge) = (objects("kubernetes-parts.yaml"), objects("kubernetes-merge.yaml"));
    let (map, job) = (of_kind(&parts, "ConfigMap"), of_kind(&parts, "Job"));
    assert_eq!(job["spec"]["completionMode"], "Indexed");
    assert_eq!(map["data"]["SHARDS"], job["spec"]["completions"].to_string());
    assert_eq!(of_kind(&parts, "PersistentVolumeClaim")["metadata"]["name"], "plenalign-study");
    // What the map tells the parts is what the program takes.
    let told = container(&job, &map, folder.path()).env("JOB_COMPLETION_INDEX", "8").output().unwrap();
    let error = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(!told.status.success() && error.contains("there is no part 9 of 8"), "{error}");

    let config = folder.path().join("plenalign.toml");
    fs::write(&config, map["data"]["plenalign.toml"].as_str().unwrap()).unwrap();
    let ready = |job: &Value| {
        let mut command = container(job, &map, folder.path());
        command.env("OUT", "study").env("CONFIG", &config).env("STUDY_ARGS", STUDY_ARGS).env("SHARDS", "2");
        command
    };
    for index in ["0", "1"] {
        said(&ready(&job).env("JOB_COMPLETION_INDEX", index).output().unwrap());
    }
    said(&ready(&of_kind(&merge, "Job")).output().unwrap());
    let results = results(folder.path());
    assert_eq!((&results["benches"], &results["assemblies"]), (&2.into(), &200.into()));
}
