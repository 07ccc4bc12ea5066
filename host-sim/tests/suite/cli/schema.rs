//! Every JSON result against its published schema in `docs/schema`.

use super::harness::Bench;
use jsonschema::Validator;
use serde_json::{Value, json};
use std::path::PathBuf;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/schema")
}

fn schema(name: &str) -> Validator {
    let path = folder().join(format!("{name}.schema.json"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let schema: Value =
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    jsonschema::validator_for(&schema).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn mistakes(schema: &Validator, value: &Value) -> Vec<String> {
    schema.iter_errors(value).map(|error| format!("{}: {error}", error.instance_path())).collect()
}

#[test]
fn every_result_keeps_to_its_schema() {
    let bench = Bench::new();
    bench.noisy_record();
    // A record whose disturbance no effect explains: the members of an unexplained diagnosis.
    bench.simulate("tone.csv", &["--model", "lf", "--load", "sine:400:9", "--noise", "lvdt_m=5e-6"]);
    let tone = bench.read("tone.csv");
    let column = tone
        .lines()
        .find(|line| line.starts_with("t_s"))
        .and_then(|header| header.split(',').position(|name| name == "load_N"));
    let column = column.expect("the load");
    let hidden: Vec<String> = tone
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let cells = line.split(',').enumerate().filter(|(index, _)| *index != column);
            cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
        })
        .collect();
    bench.write("hidden.csv", &hidden.join("\n"));
    let mut tested: Vec<&str> = Vec::new();
    let help = bench.run(&["--help"]).done().stdout;
    let listed =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // A verb's name stands two columns in; what it does may go on below, further in.
    let mut verbs: Vec<&str> = listed
        .filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')))
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    for (name, arguments) in [
        ("identify", &["identify", "record.csv"][..]),
        ("identify", &["identify", "record.csv", "--truth", "bkl=2e-4,fdj=800"]),
        ("calibrate", &["calibrate", "record.csv", "--rig", "eha", "--bounds", "fdj=0..2000"]),
        ("diagnose", &["diagnose", "record.csv"]),
        ("diagnose", &["diagnose", "hidden.csv", "--holdout", "record.csv"]),
        ("reproduce", &["reproduce", "--lf-data", "--cases-only"]),
        ("check", &["check", "record.csv", "hidden.csv"]),
        ("record", &["simulate", "--model", "lf", "--step", "1e-5"]),
        ("record", &["import", "record.csv", "--output", "again.csv"]),
        ("effects", &["effects"]),
        ("commands", &["commands"]),
        ("rigs", &["rigs"]),
        ("rig", &["rigs", "servo-hydraulic"]),
        ("diagnose", &["demo", "--out", "demo"]),
        ("hil", &["hil", "--seconds", "2.2", "--damage", "1e-4"]),
        ("hil", &["hil", "record.csv", "--machine", "mps2-an386"]),
        ("budget", &["budget", "--machine", "mps2-an386"]),
    ] {
        let result = bench.run(&[arguments, &["--json"]].concat()).done().json();
        let schema = schema(name);
        assert_eq!(mistakes(&schema, &result), [""; 0], "{arguments:?}: {result}");
        // The schema must be able to fail: a member too many, one too few, one of another type.
        let mut more = result.clone();
        more["surprise"] = json!(1);
        let mut less = result.clone();
        less.as_object_mut().expect("an object").remove("schema");
        let mut other = result.clone();
        other["schema"] = json!("one");
        for wrong in [more, less, other] {
            assert!(!mistakes(&schema, &wrong).is_empty(), "{name} lets everything through: {wrong}");
        }
        tested.push(name);
        verbs.retain(|&verb| verb != arguments[0]);
    }
    assert_eq!(verbs, ["completions", "man", "help"], "verbs with a JSON result that is not tested");
    let mut published: Vec<String> = std::fs::read_dir(folder())
        .expect("the folder of the schemas")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().replace(".schema.json", ""))
        .collect();
    published.retain(|name| !tested.contains(&name.as_str()));
    assert_eq!(published, [""; 0], "published, and not tested");
}
