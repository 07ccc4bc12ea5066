//! A diagnosis whose effort is bounded.

use super::harness::{Bench, NO_CONVERGENCE, number, timeless};
use serde_json::Value;

/// A diagnosis of an actuator that lacks two effects, and its exit code.
fn diagnosed(arguments: &[&str]) -> (Value, Option<i32>) {
    let bench = Bench::new();
    let effects = ["--effect", "sensor-lag=5e-4", "--effect", "sensor-gain=5e-3"];
    let options = ["--model", "lf", "--set", "fdj=800", "--noise", "lvdt_m=3e-6"];
    bench.simulate("two.csv", &[&options[..], &effects].concat());
    let run = bench.run(&[&["diagnose", "two.csv", "--json"], arguments].concat());
    (timeless(run.json()), run.code)
}

fn found(result: &Value) -> Vec<&Value> {
    result["effects"].as_array().expect("a list").iter().map(|effect| &effect["name"]).collect()
}

#[test]
fn a_search_that_uses_up_its_effort_says_so_and_repeats_with_any_number_of_threads() {
    let (result, code) = diagnosed(&["--effort", "0.1", "--threads", "1"]);
    assert_eq!((&result, code), (&diagnosed(&["--effort", "0.1", "--threads", "2"]).0, Some(NO_CONVERGENCE)));
    assert_eq!([&result["out_of_effort"], &result["interrupted"]], [true, false], "{result}");
    assert_eq!(result["verdict"], "unexplained", "{result}");
    assert_eq!(found(&result), [""; 0], "{result}");
    assert!(result["warnings"].to_string().contains("--effort allows more"), "{result}");

    let (whole, code) = diagnosed(&[]);
    assert_eq!((&whole["out_of_effort"], code), (&false.into(), Some(0)), "{whole}");
    assert_eq!(found(&whole), ["sensor-gain", "sensor-lag"], "{whole}");
    let effort = |result: &Value| number(&result["effort_s"]);
    assert!(effort(&result) > 0.1 && effort(&result) < effort(&whole), "{result}");
    assert!(effort(&whole) < number(&whole["config"]["search"]["effort_s"]), "{whole}");
}

#[test]
fn an_effort_is_said_to_be_counted_and_not_a_bound_on_time() {
    let help = Bench::new().run(&["diagnose", "--help"]).done().stdout;
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in ["steps are counted, and nothing beside them", "are made in any case", "twice as long"] {
        assert!(help.contains(part), "`{part}`: {help}");
    }
}
