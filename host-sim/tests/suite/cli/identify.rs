//! Faults out of records.

use super::harness::{BKL, Bench, FDJ, NO_CONVERGENCE, keys, named, number, timeless, with_cells};
use serde_json::Value;

/// Members of the result that the design fixes.
const FIXED: [&str; 9] = [
    "config",
    "evaluations",
    "faults",
    "generations",
    "residual_rms_m",
    "schema",
    "seconds",
    "seconds_per_generation",
    "seed",
];
/// Members beyond those.
const ADDED: [&str; 6] = ["channels", "closed_loop", "correlation", "mean_square", "stop", "warnings"];

fn sorted<'a>(lists: &[&[&'a str]]) -> Vec<&'a str> {
    let mut all = lists.concat();
    all.sort_unstable();
    all
}

/// Deviation of an estimate from the truth in standard errors, which are a quarter of the interval at 95 %.
fn deviation(result: &Value, name: &str, truth: f64) -> f64 {
    let fault = named(&result["faults"], name);
    let [low, high] = [number(&fault["ci95"][0]), number(&fault["ci95"][1])];
    (number(&fault["value"]) - truth) / ((high - low) / (2.0 * 1.96))
}

fn assert_finds_the_faults(result: &Value) {
    for (name, truth) in [("bkl", BKL), ("fdj", FDJ)] {
        let off = deviation(result, name, truth);
        assert!(off.abs() < 4.0, "{name} is {off} standard errors off: {result}");
    }
}

#[test]
fn finds_the_faults_of_a_noisy_record() {
    let bench = Bench::new();
    for command in ["mixed", "chirp"] {
        for seed in ["1", "2", "3"] {
            let noise = "lvdt_m=5e-6,current_mA=0.02";
            let sensors = ["--noise", noise, "--quantum", "lvdt_m=1e-6", "--channels", "lvdt_m,current_mA"];
            let options = ["--model", "lf", "--command", command, "--seed", seed];
            bench.simulate("record.csv", &[&options[..], &sensors].concat());
            let result = bench.run(&["identify", "record.csv", "--json", "--seed", seed]).done().json();
            assert_finds_the_faults(&result);
            let fdj = named(&result["faults"], "fdj");
            assert!((number(&fdj["value"]) / FDJ - 1.0).abs() < 0.02, "{fdj}");
            assert!((number(&result["residual_rms_m"]) / 5e-6 - 1.0).abs() < 0.1, "{result}");
        }
    }
}

/// Nobody says how the command went from sample to sample.
#[test]
fn a_command_that_a_computer_held_is_found_out() {
    let bench = Bench::new();
    let sensors = ["--noise", "lvdt_m=5e-6,current_mA=0.02", "--channels", "lvdt_m,current_mA"];
    for path in ["held", "lines"] {
        bench.write("flown.toml", &format!("base = \"eha\"\n[model]\ncommand-path = \"{path}\"\n"));
        let flown = ["--model", "lf", "--command", "chirp", "--rig", "flown.toml"];
        bench.simulate("record.csv", &[&flown[..], &sensors].concat());
        let result = bench.run(&["identify", "record.csv", "--json"]).done().json();
        assert_finds_the_faults(&result);
        assert_eq!(result["config"]["model"]["command_path"] == "held", path == "held", "{path}: {result}");
    }
}

#[test]
fn the_json_has_the_fixed_members() {
    let bench = Bench::new();
    bench.noisy_record();
    let result = bench.run(&["identify", "record.csv", "--json", "--seed", "5"]).done().json();
    assert_eq!(keys(&result), sorted(&[&FIXED, &ADDED]));
    assert_eq!((&result["schema"], &result["seed"]), (&1.into(), &5.into()));
    let faults = result["faults"].as_array().expect("a list");
    let names: Vec<&Value> = faults.iter().map(|fault| &fault["name"]).collect();
    assert_eq!(names, ["bkl", "fdj"]);
    for (fault, unit) in faults.iter().zip(["m", "N"]) {
        assert_eq!(keys(fault), sorted(&[&["name", "value", "ci95", "unit"], &["standard_error"]]));
        assert_eq!(fault["unit"], unit);
        let [low, value, high] = [&fault["ci95"][0], &fault["value"], &fault["ci95"][1]].map(number);
        assert!(low < value && value < high, "{fault}");
    }
    for counter in ["evaluations", "generations"] {
        assert!(result[counter].as_u64().is_some_and(|count| count > 0), "{result}");
    }
    for time in ["seconds", "seconds_per_generation", "residual_rms_m"] {
        assert!(number(&result[time]) > 0.0, "{result}");
    }
    let channels = result["channels"].as_array().expect("a list");
    let noise = [("lvdt_m", 5e-6), ("current_mA", 0.02)];
    assert_eq!(channels.len(), noise.len(), "{result}");
    for (channel, (name, noise)) in channels.iter().zip(noise) {
        assert_eq!((&channel["name"], &channel["noise_from"]), (&name.into(), &"record".into()));
        // All but the start.
        assert!(
            channel["samples"].as_u64().is_some_and(|samples| (990..=1001).contains(&samples)),
            "{channel}"
        );
        for shown in [&channel["noise"], &channel["residual_rms"]].map(number) {
            assert!((shown / noise - 1.0).abs() < 0.1, "{channel}");
        }
    }
    assert_eq!(result["residual_rms_m"], channels[0]["residual_rms"]);
    let config = &result["config"];
    assert_eq!((&config["rig"], &config["seed"]), (&"eha".into(), &5.into()));
    assert_eq!(config["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(number(&named(&config["free"], "bkl")["upper"]), 1.5e-3);
}

#[test]
fn the_seed_alone_decides_the_result() {
    let bench = Bench::new();
    bench.noisy_record();
    let run = |arguments: &[&str]| {
        timeless(bench.run(&[&["identify", "record.csv", "--json"], arguments].concat()).done().json())
    };
    let first = run(&[]);
    assert_eq!(first, run(&[]));
    assert_eq!(first, run(&["--seed", "1"]));
    assert_eq!(first, run(&["--threads", "1"]));
    assert_eq!(first, run(&["--threads", "2"]));
    assert_eq!(first, run(&["--quiet"]));
    assert_ne!(first, run(&["--seed", "2"]));
}

#[test]
fn lost_samples_are_left_out_and_reported() {
    let bench = Bench::new();
    let noise = ["--noise", "lvdt_m=5e-6,current_mA=0.02", "--channels", "lvdt_m,current_mA"];
    bench.simulate("record.csv", &[&["--model", "lf", "--dropout", "0.02"][..], &noise].concat());
    let text = bench.read("record.csv");
    let blank = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .filter(|line| line.split(',').nth(2).is_some_and(str::is_empty));
    let blank = blank.count();
    assert!((5..60).contains(&blank), "{blank} of 1001 samples are blank");
    let run = bench.run(&["identify", "record.csv", "--json"]).done();
    let note = format!("{blank} of 1001 samples are missing");
    assert!(run.stderr.contains(&note), "{}", run.stderr);
    assert!(run.json()["warnings"].to_string().contains(&note), "{}", run.stdout);
    assert_finds_the_faults(&run.json());
}

#[test]
fn spikes_are_left_out() {
    let bench = Bench::new();
    bench.noisy_record();
    let spiky = |every: usize| {
        with_cells(&bench.read("record.csv"), "lvdt_m", |sample, cell| {
            let spike = if sample % every == every / 2 { 1e-3 } else { 0.0 };
            (cell.parse::<f64>().expect("a number") + spike).to_string()
        })
    };
    bench.write("some.csv", &spiky(100));
    assert_finds_the_faults(&bench.run(&["identify", "some.csv", "--json"]).done().json());
    // So many are what the sensor is like: they stay in, and spoil the fit.
    bench.write("many.csv", &spiky(15));
    let many = bench.run(&["identify", "many.csv", "--json"]).done().json();
    assert!(many["warnings"].to_string().contains("67 spikes"), "{many}");
    assert!(many["warnings"].to_string().contains("too many to leave out"), "{many}");
    assert!(number(&many["residual_rms_m"]) > 2e-4, "{many}");
}

#[test]
fn several_records_are_fitted_together() {
    let bench = Bench::new();
    bench.noisy_record();
    let alone = bench.run(&["identify", "record.csv", "--json"]).done().json();
    let more = ["--model", "lf", "--command", "mixed", "--seed", "8", "--noise", "lvdt_m=5e-6"];
    bench.simulate("more.csv", &[&more[..], &["--channels", "lvdt_m"]].concat());
    let both = bench.run(&["identify", "record.csv", "more.csv", "--json"]).done().json();
    assert_finds_the_faults(&both);
    assert_eq!(both["config"]["records"], serde_json::json!(["record.csv", "more.csv"]));
    let error = |result: &Value| number(&named(&result["faults"], "bkl")["standard_error"]);
    assert!(error(&both) < error(&alone), "a second record narrows the interval");
    let one_bad = bench.run(&["identify", "record.csv", "none.csv"]);
    one_bad.refused(super::harness::BAD_DATA, &["none.csv"]);
}

#[test]
fn bounds_hold_and_free_what_they_name() {
    let bench = Bench::new();
    bench.noisy_record();
    let bounds = ["--bounds", "BKL=1e-4..3e-4", "--bounds", "viscous_friction=0..500"];
    let result = bench.run(&[&["identify", "record.csv", "--json"], &bounds[..]].concat()).done().json();
    assert_finds_the_faults(&result);
    let names: Vec<&str> = result["faults"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|fault| fault["name"].as_str())
        .collect();
    assert_eq!(names, ["bkl", "fdj", "viscous_friction"]);
    let narrow = ["--bounds", "fdj=1000..2000"];
    let result = bench.run(&[&["identify", "record.csv", "--json"], &narrow[..]].concat()).done().json();
    assert!(number(&named(&result["faults"], "fdj")["value"]) >= 1000.0, "{result}");
}

#[test]
fn a_zero_of_its_own_is_no_effect_that_the_model_lacks() {
    let bench = Bench::new();
    let base = ["--model", "lf", "--noise", "lvdt_m=5e-6,current_mA=0.02", "--channels", "lvdt_m,current_mA"];
    bench.simulate("zero.csv", &[&base[..], &["--effect", "sensor-offset=1e-3"]].concat());
    bench.simulate("gain.csv", &[&base[..], &["--effect", "sensor-gain=0.05"]].concat());
    bench.write("offset.toml", "[model]\ncommand-offset = true\n");
    let advice = "`command-offset = true`";
    let warnings = |arguments: &[&str]| {
        let result = bench.run(&[&["identify", "--json"], arguments].concat()).json()["warnings"].to_string();
        (result.contains("lacks something"), result.contains(advice))
    };
    assert_eq!(warnings(&["zero.csv"]), (true, true));
    assert_eq!(warnings(&["zero.csv", "--rig", "offset.toml"]), (false, false));
    assert_eq!(warnings(&["gain.csv"]), (true, false));
    assert_finds_the_faults(
        &bench.run(&["identify", "zero.csv", "--rig", "offset.toml", "--json"]).done().json(),
    );
}

#[test]
fn a_calibration_says_which_faults_it_holds() {
    let bench = Bench::new();
    bench.noisy_record();
    let calibrate = |bounds: &[&str]| {
        let fixed =
            ["calibrate", "record.csv", "--rig", "eha", "--json", "--bounds", "viscous_friction=0..500"];
        bench.run(&[&fixed[..], bounds].concat()).json()["warnings"].to_string()
    };
    let held = calibrate(&["--bounds", "bkl=0..1e-3"]);
    assert!(held.contains("held: fdj at 200.000 N;") && held.contains("--bounds NAME=LOW..HIGH"), "{held}");
    let free = calibrate(&["--bounds", "bkl=0..1e-3", "--bounds", "fdj=0..2000"]);
    assert!(!free.contains("held: "), "{free}");
}

#[test]
fn a_search_that_runs_out_of_budget_says_so_and_shows_what_it_has() {
    let bench = Bench::new();
    bench.simulate("hf.csv", &[]);
    let run = bench.run(&["identify", "hf.csv", "--json", "--budget", "20"]);
    assert_eq!(run.code, Some(NO_CONVERGENCE), "{}", run.stderr);
    assert!(run.stderr.contains("no convergence") && run.stderr.contains("--budget"), "{}", run.stderr);
    assert_eq!(run.json()["stop"], "budget");
    let run = bench.run(&[
        "calibrate",
        "hf.csv",
        "--rig",
        "eha",
        "--bounds",
        "fdj=0..2000",
        "--budget",
        "20",
        "--out",
        "rig",
    ]);
    assert_eq!(run.code, Some(NO_CONVERGENCE), "{}", run.stderr);
    assert!(bench.path("rig/calibrate.json").exists(), "what was found so far");
    assert!(!bench.path("rig/rig.toml").exists(), "no rig from a search that did not converge");
    assert!(run.stderr.contains("rig.toml is not written"), "{}", run.stderr);
}

#[test]
fn out_writes_what_json_prints() {
    let bench = Bench::new();
    bench.noisy_record();
    let run = bench.run(&["identify", "record.csv", "--json", "--out", "new/results"]).done();
    let written: Value = serde_json::from_str(&bench.read("new/results/identify.json")).expect("JSON");
    assert_eq!(written, run.json());
}

#[test]
fn the_log_ends_where_the_summary_does() {
    let bench = Bench::new();
    bench.noisy_record();
    bench.simulate("hf.csv", &[]);
    for name in ["record.csv", "hf.csv"] {
        let arguments = ["identify", name, "--log", "--budget", "200"];
        let text = bench.run(&arguments).stdout;
        let log: Vec<Vec<&str>> = text
            .lines()
            .take_while(|line| line.starts_with('|'))
            .map(|line| line.split('|').map(str::trim).filter(|cell| !cell.is_empty()).collect())
            .collect();
        let column = |name: &str| log[0].iter().position(|cell| *cell == name).expect("a column");
        let last = |name: &str| {
            log.iter().filter_map(|row| row.get(column(name))?.parse::<usize>().ok()).next_back()
        };
        let result = bench.run(&[&arguments[..], &["--json"]].concat()).json();
        for (name, member) in [("evaluations", "evaluations"), ("generation", "generations")] {
            assert_eq!(last(name).map(Value::from), Some(result[member].clone()), "{name}: {text}");
        }
        assert!(text.contains("(taken)"), "{text}");
    }
}

#[test]
fn an_estimate_on_a_bound_is_said_to_be() {
    let bench = Bench::new();
    bench.noisy_record();
    let arguments = ["identify", "record.csv", "--bounds", "fdj=1000..2000", "--out", "."];
    let text = bench.run(&arguments).done().stdout;
    let note = "fdj is at its lower bound (1000.000 N): widen its range with `--bounds fdj=0..2000`";
    assert!(text.contains(note), "{text}");
    assert!(bench.read("identify.json").contains(note) && bench.read("report.html").contains(note));
}
