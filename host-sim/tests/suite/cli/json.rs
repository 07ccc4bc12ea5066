//! `--json` is one object on stdout, whatever the verb.

use super::harness::Bench;

#[test]
fn every_verb_prints_one_object() {
    let bench = Bench::new();
    bench.noisy_record();
    for arguments in [
        &["effects"][..],
        &["commands"],
        &["rigs"],
        &["rigs", "eha"],
        &["simulate", "--model", "lf", "--step", "1e-5"],
        &["simulate", "--model", "lf", "--step", "1e-5", "-o", "new.csv"],
        &["import", "record.csv"],
        &["import", "record.csv", "--out", "imported"],
        &["check", "record.csv"],
        &["identify", "record.csv"],
        &["calibrate", "record.csv", "--rig", "eha", "--bounds", "fdj=0..2000", "--bounds", "bkl=0..1e-3"],
        &["reproduce", "--lf-data", "--cases-only"],
    ] {
        let result = bench.run(&[arguments, &["--json"]].concat()).done().json();
        assert_eq!(result["schema"], 1, "{arguments:?}: {result}");
    }
    assert_eq!(bench.files(), ["imported", "new.csv", "record.csv"]);
}

#[test]
fn a_simulated_record_is_the_same_in_json_as_in_csv() {
    let bench = Bench::new();
    let arguments =
        ["simulate", "--model", "lf", "--step", "1e-5", "--dropout", "0.05", "--noise", "lvdt_m=5e-6"];
    let result = bench.run(&[&arguments[..], &["--json"]].concat()).done().json();
    let text = bench.run(&arguments).done().stdout;
    let mut rows = text.lines().filter(|line| !line.starts_with('#'));
    let column = rows.next().expect("a header").split(',').position(|name| name == "lvdt_m").expect("lvdt_m");
    let values = result["columns"]["lvdt_m"].as_array().expect("a column");
    assert_eq!(result["samples"], values.len());
    let mut missing = 0;
    for (row, value) in rows.zip(values) {
        let cell = row.split(',').nth(column).expect("a cell");
        assert_eq!(cell.parse::<f64>().ok(), value.as_f64(), "{row}");
        missing += usize::from(cell.is_empty());
    }
    assert!(missing > 0);
    assert_eq!(result["config"]["dropout"], 0.05);
}
