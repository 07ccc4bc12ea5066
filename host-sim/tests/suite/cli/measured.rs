//! Real machines. Each test is skipped, with a message, where the measured data are not there.

use super::harness::{Bench, named, number};
use crate::measured_data;

/// Largest residual of a calibrated `servo-hydraulic` rig on the record below, m rms (measured: 26.0 um).
const MTS_BAR: f64 = 27e-6;

/// Largest residual of a calibrated `force-axis` rig over windows of 1 s, m rms (measured: 1.40 mm).
const EMPS_BAR: f64 = 1.45e-3;

#[test]
fn a_testing_machine_is_calibrated_and_its_rig_is_accepted() {
    let Some(record) = measured_data::file("mts/chirp15_0A.csv") else { return };
    let record = record.to_str().expect("a path in UTF-8");
    let bench = Bench::new();
    let result = bench.run(&["calibrate", record, "--json", "--out", "."]).done().json();
    let residual = number(&result["residual_rms_m"]);
    assert!(residual <= MTS_BAR, "{residual} m rms");
    let gain = number(&named(&result["parameters"], "proportional_gain")["value"]);
    assert!((gain / 2460.0 - 1.0).abs() < 0.05, "{gain} mA/m");
    let text = bench.read("rig.toml");
    assert!(text.contains(&format!("proportional_gain = {gain:?}")), "{text}");
    // A part of the record serves to show that the rig is accepted, and is faster.
    bench.run(&["import", record, "--from", "10", "--to", "14", "-o", "part.csv"]).done();
    let fitted = bench.run(&["identify", "part.csv", "--rig", "rig.toml", "--json"]).done().json();
    assert_eq!(fitted["config"]["rig"], "servo-hydraulic");
    assert_eq!(fitted["config"]["parameters"]["proportional_gain"], gain);
}

#[test]
fn an_axis_that_a_force_drives_is_calibrated() {
    let Some(record) = measured_data::file("emps/estimation.csv") else { return };
    let record = record.to_str().expect("a path in UTF-8");
    let bench = Bench::new();
    let arguments = ["calibrate", record, "--rig", "force-axis", "--json"];
    let result = bench.run(&arguments).done().json();
    let residual = number(&result["residual_rms_m"]);
    assert!(residual <= EMPS_BAR, "{residual} m rms");
    // The published symmetric model, with the spread of what was published.
    for (name, published, tolerance) in [
        ("load_mass", 95.11, 0.05),
        ("viscous_friction", 203.5, 0.15),
        ("fdj", 20.39, 0.15),
        ("constant_load", -3.165, 0.2),
    ] {
        let value = number(&named(&result["parameters"], name)["value"]);
        assert!((value / published - 1.0).abs() < tolerance, "{name}: {value}, published {published}");
    }
}

#[test]
fn what_an_open_loop_will_leave_is_foreseen() {
    let Some(record) = measured_data::file("emps/estimation.csv") else { return };
    let record = record.to_str().expect("a path in UTF-8");
    let bench = Bench::new();
    let json = |verb: &str| bench.run(&[verb, record, "--rig", "force-axis", "--json"]).done().json();
    let found = number(&named(&json("identify")["faults"], "fdj")["standard_error"]);
    let check = json("check");
    let promised = number(&named(&check["records"][0]["foreseen"][0]["faults"], "fdj")["standard_error"]);
    assert!((promised / found).ln().abs() < 1.5_f64.ln(), "{promised} N foreseen, {found} N found");
    assert!(check["records"][0]["notes"].to_string().contains("an open loop"), "{check}");
}
