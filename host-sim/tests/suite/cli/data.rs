//! Records in from other formats, names and units; traces out.

use super::harness::{BAD_DATA, Bench, USAGE, named, number, timeless};
use serde_json::Value;
use std::fmt::Write as _;

/// The rows of a CSV file without comments, by column.
fn columns(text: &str) -> Vec<(String, Vec<Option<f64>>)> {
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().expect("a header");
    let mut columns: Vec<(String, Vec<Option<f64>>)> =
        header.split(',').map(|name| (name.to_owned(), Vec::new())).collect();
    for line in lines {
        for ((_, values), cell) in columns.iter_mut().zip(line.split(',')) {
            values.push(cell.parse().ok());
        }
    }
    columns
}

fn column<'a>(columns: &'a [(String, Vec<Option<f64>>)], name: &str) -> &'a [Option<f64>] {
    &columns.iter().find(|(other, _)| other == name).unwrap_or_else(|| panic!("no {name}")).1
}

/// `record.csv` under other names, in millimetres and milliseconds.
fn foreign(bench: &Bench, name: &str, with_time: bool) {
    let columns = columns(&bench.read("record.csv"));
    let mut text = String::from(if with_time { "time,ref,pos,amps\n" } else { "ref,pos,amps\n" });
    for row in 0..columns[0].1.len() {
        let cell =
            |name: &str, factor: f64| column(&columns, name)[row].map_or(f64::NAN, |value| value * factor);
        if with_time {
            let _ = write!(text, "{},", cell("t_s", 1e3));
        }
        let _ =
            writeln!(text, "{},{},{}", cell("command_m", 1e3), cell("lvdt_m", 1e3), cell("current_mA", 1e-3));
    }
    bench.write(name, &text);
}

const MAPPING: &str = "command_m=ref[mm],lvdt_m=pos[mm],current_mA=amps[A]";

fn faults(result: &Value) -> [f64; 2] {
    ["bkl", "fdj"].map(|name| number(&named(&result["faults"], name)["value"]))
}

#[test]
fn every_verb_reads_foreign_columns_and_units() {
    let bench = Bench::new();
    bench.noisy_record();
    foreign(&bench, "foreign.csv", true);
    foreign(&bench, "timeless.csv", false);
    let known = faults(&bench.run(&["identify", "record.csv", "--json"]).done().json());
    let timed = format!("t_s=time[ms],{MAPPING}");
    for arguments in [
        &["identify", "foreign.csv", "--columns", &timed][..],
        &["identify", "timeless.csv", "--columns", MAPPING, "--rate", "1000"],
    ] {
        let found = faults(&bench.run(&[arguments, &["--json"]].concat()).done().json());
        for (found, known) in found.iter().zip(known) {
            assert!((found / known - 1.0).abs() < 1e-6, "{arguments:?}: {found} {known}");
        }
    }
    bench.run(&["check", "foreign.csv", "--columns", &timed]).done();
    bench.run(&["diagnose", "foreign.csv", "--columns", &timed]).done();
    let bounds = ["--rig", "eha", "--bounds", "fdj=0..2000", "--bounds", "bkl=0..1e-3"];
    bench.run(&[&["calibrate", "foreign.csv", "--columns", &timed][..], &bounds].concat()).done();
    // Without the mapping, the message offers it.
    bench.run(&["identify", "foreign.csv"]).refused(BAD_DATA, &["foreign.csv", "t_s=time"]);
    bench
        .run(&["identify", "timeless.csv", "--columns", MAPPING, "--rate", "0"])
        .refused(USAGE, &["--rate 0"]);
    bench
        .run(&["identify", "timeless.csv", "--columns", "lvdt_m=pos[furlong]"])
        .refused(USAGE, &["furlong", "expected one of"]);
}

#[test]
fn a_window_of_a_record_is_a_record() {
    let bench = Bench::new();
    bench.noisy_record();
    let result = bench.run(&["check", "record.csv", "--from", "0.2", "--to", "0.7", "--json"]).done().json();
    assert_eq!(result["records"][0]["samples"], 500);
    assert!((number(&result["records"][0]["start_time_s"]) - 0.2).abs() < 1e-9);
    bench
        .run(&["identify", "record.csv", "--from", "0.7", "--to", "0.2"])
        .refused(USAGE, &["--from 0.7 --to 0.2"]);
    bench
        .run(&["identify", "record.csv", "--from", "0.98"])
        .refused(BAD_DATA, &["in the segment, expected at least 50: the record goes from 0 s to 1 s"]);
    // A segment of each file for itself: one half fitted, the other held out.
    let result = bench.run(&["check", "record.csv@0.2..0.7", "record.csv@..0.3", "--json"]).done().json();
    assert_eq!(result["records"][0]["samples"], 500);
    assert_eq!(result["records"][1]["samples"], 300);
    let halves = ["diagnose", "record.csv@..0.5", "--holdout", "record.csv@0.5..", "--json"];
    let result = bench.run(&halves).done().json();
    assert_eq!(result["config"]["records"][1], "record.csv@0.5..");
    assert!(result["error"]["holdout"].is_object());
    for wrong in ["record.csv@0.7..0.2", "record.csv@a..b"] {
        bench.run(&["identify", wrong]).refused(USAGE, &[wrong, "expected FILE@FROM..TO"]);
    }
}

#[test]
fn samples_that_count_twice_are_told() {
    let bench = Bench::new();
    bench.noisy_record();
    let warnings = |records: &[&str]| {
        bench.run(&[&["identify", "--json"][..], records].concat()).done().json()["warnings"].to_string()
    };
    let note = "record.csv@..0.6 and ./record.csv have samples in common, which count twice";
    let found = warnings(&["record.csv@..0.6", "./record.csv"]);
    assert!(found.contains(note), "{found}");
    let found = warnings(&["record.csv@..0.5", "record.csv@0.5.."]);
    assert!(!found.contains("in common"), "{found}");
    // A copy under another name may be another flight of the same command.
    bench.write("copy.csv", &bench.read("record.csv"));
    let found = warnings(&["record.csv", "copy.csv"]);
    assert!(!found.contains("in common"), "{found}");
}

#[test]
fn what_is_lost_of_a_record_that_starts_at_zero_leaves_its_start() {
    let bench = Bench::new();
    bench.noisy_record();
    let rows = bench.read("record.csv").replace("\n0.03,", "\n#");
    bench.write("gap.csv", &rows);
    let printed = bench.run(&["check", "gap.csv", "--rate", "1000"]).done().stdout;
    assert!(printed.starts_with("gap.csv: 1001 samples, 1000 Hz, 1.001 s from 0 s\n"), "{printed}");
}

#[test]
fn a_trace_adds_up_and_parquet_says_the_same_as_csv() {
    let bench = Bench::new();
    bench.noisy_record();
    bench.run(&["identify", "record.csv", "--trace", "trace.csv"]).done();
    bench.run(&["identify", "record.csv", "--trace", "trace.parquet"]).done();
    let trace = columns(&bench.read("trace.csv"));
    let (measured, model, residual) =
        (column(&trace, "lvdt_m"), column(&trace, "lvdt_m_model"), column(&trace, "lvdt_m_model_residual"));
    assert_eq!(measured.len(), 1001);
    let mut power = 0.0;
    for row in 0..measured.len() {
        let [measured, model, residual] = [measured[row], model[row], residual[row]].map(Option::unwrap);
        assert!((measured - model - residual).abs() < 1e-15);
        power += residual * residual;
    }
    let rms = (power / 1001.0).sqrt();
    let result = bench.run(&["identify", "record.csv", "--json"]).done().json();
    assert!((rms / number(&result["residual_rms_m"]) - 1.0).abs() < 1e-9, "{rms}");
    // A trace is a record too: read again from both formats, it gives the same answer, bit for bit.
    let again = |name: &str| {
        let mut result = timeless(bench.run(&["identify", name, "--json"]).done().json());
        result["config"]["records"] = Value::Null;
        let warnings = result["warnings"].to_string();
        assert!(warnings.contains("columns not used: `record`, `lvdt_m_model`"), "{warnings}");
        result["warnings"] = Value::Null;
        result
    };
    assert_eq!(again("trace.csv"), again("trace.parquet"));
    assert_eq!(faults(&again("trace.parquet")), faults(&result));
}

#[test]
fn records_of_one_name_are_told_apart() {
    let bench = Bench::new();
    bench.noisy_record();
    for folder in ["a", "b"] {
        std::fs::create_dir(bench.path(folder)).expect("a directory");
        bench.write(&format!("{folder}/rec.csv"), &bench.read("record.csv"));
    }
    bench.run(&["identify", "a/rec.csv", "b/rec.csv", "--out", "ab"]).done();
    let report = bench.read("ab/report.html");
    assert!(report.contains("a/rec: ") && report.contains("b/rec: "), "{report}");
    let trace = bench.read("ab/trace.csv");
    let numbers: Vec<&str> = trace.lines().filter_map(|line| line.split(',').next()).collect();
    assert_eq!((numbers[0], numbers[1], numbers[2002]), ("record", "1", "2"));
    bench.run(&["check", "a/rec.csv", "b/rec.csv", "--out", "worth"]).done();
    let report = bench.read("worth/report.html");
    assert!(report.contains("a/rec") && !report.contains(">rec<"), "{report}");
}

#[test]
fn a_damaged_parquet_file_is_refused() {
    let bench = Bench::new();
    bench.noisy_record();
    bench.run(&["identify", "record.csv", "--trace", "trace.parquet"]).done();
    let whole = std::fs::read(bench.path("trace.parquet")).expect("a file");
    std::fs::write(bench.path("half.parquet"), &whole[..whole.len() / 2]).expect("a file");
    bench.run(&["identify", "half.parquet"]).refused(BAD_DATA, &["half.parquet", "Parquet"]);
    bench
        .run(&["identify", "trace.parquet", "--columns", "lvdt_m=position"])
        .refused(BAD_DATA, &["lvdt_m=position", "`command_m`"]);
}
