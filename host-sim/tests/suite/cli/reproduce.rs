//! The source's twelve cases.

use super::harness::{Bench, keys, number, timeless};
use serde_json::{Value, json};

fn reproduce(arguments: &[&str]) -> Value {
    Bench::new().run(&[&["reproduce", "--json", "--cases-only"], arguments].concat()).done().json()
}

fn cases(result: &Value) -> &[Value] {
    result["cases"].as_array().expect("a list of cases")
}

#[test]
fn the_json_has_the_fixed_members() {
    let result = reproduce(&["--lf-data"]);
    assert_eq!(cases(&result).len(), 12);
    for (index, case) in cases(&result).iter().enumerate() {
        assert_eq!(keys(case), ["after", "before", "case", "command", "input", "source"]);
        assert_eq!(case["case"], index + 1);
        assert_eq!(case["command"], if index < 2 { "mixed" } else { "chirp" });
        assert_eq!(keys(&case["input"]), ["bkl", "fdj"]);
        assert_eq!(keys(&case["source"]), ["bkl", "fdj", "mean_error_percent"]);
        assert!(case["after"].is_null() || case["after"].is_object(), "{case}");
        for side in ["before", "after"].into_iter().filter(|side| !case[side].is_null()) {
            for member in
                ["bkl", "fdj", "mean_error_percent", "seconds", "evaluations", "seconds_per_generation"]
            {
                assert!(case[side][member].is_number(), "{member} of {side}: {case}");
            }
        }
    }
    assert_eq!(cases(&result)[0]["input"], json!({ "bkl": 1e-3, "fdj": 6400.0 }));
    assert_eq!(cases(&result)[11]["source"]["fdj"], 832.5374);
}

#[test]
fn on_data_of_its_own_model_every_case_is_within_a_thousandth_in_four_hundred_evaluations() {
    for seed in ["1", "2", "3"] {
        for case in cases(&reproduce(&["--lf-data", "--seed", seed])) {
            let before = &case["before"];
            assert!(number(&before["mean_error_percent"]) <= 0.1, "seed {seed}: {case}");
            assert!(number(&before["evaluations"]) <= 400.0, "seed {seed}: {case}");
        }
    }
}

#[test]
fn neither_threads_nor_time_change_the_result() {
    let first = timeless(reproduce(&["--lf-data", "--threads", "1"]));
    assert_eq!(first, timeless(reproduce(&["--lf-data", "--threads", "2"])));
}

#[test]
fn out_writes_what_json_prints() {
    let bench = Bench::new();
    let run = bench.run(&["reproduce", "--lf-data", "--cases-only", "--json", "--out", "."]).done();
    let written: Value = serde_json::from_str(&bench.read("reproduce.json")).expect("JSON");
    assert_eq!(written, run.json());
}

#[test]
fn the_rig_that_a_diagnosis_wrote_brings_the_cases_within_one_percent() {
    let bench = Bench::new();
    bench
        .write("rig.toml", "[parameters]\nmetering_blend = 1.0\n[[effect]]\nname = \"turbulent-metering\"\n");
    let run = |rig: &str| bench.run(&["reproduce", "--cases-only", "--json", "--rig", rig]).done().json();
    let worst = |result: &Value, side: &str| {
        let errors = cases(result).iter().map(|case| number(&case[side]["mean_error_percent"]));
        errors.fold(0.0, f64::max)
    };
    let (augmented, plain) = (run("rig.toml"), run("eha"));
    assert!(worst(&augmented, "after") <= 1.0, "{augmented}");
    assert_eq!(augmented["added_effects"], json!(["turbulent-metering"]));
    // The control: the rig as it was leaves both columns the same.
    assert!(worst(&plain, "after") > 10.0, "{plain}");
    assert_eq!(worst(&plain, "after"), worst(&plain, "before"));
}
