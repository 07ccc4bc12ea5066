//! Bad input data: one message with file, line and column, exit code 3, nothing half written.

use super::harness::{BAD_DATA, Bench};
use std::fmt::Write as _;

const HEADER: &str = "t_s,command_m,lvdt_m";

fn position(row: usize) -> f64 {
    4e-3 * (row as f64 * 0.05).sin()
}

/// A record of `rows` rows; the first row stands on line 2.
fn record(rows: usize, row_text: impl Fn(usize) -> String) -> String {
    let mut text = format!("{HEADER}\n");
    for row in 0..rows {
        let _ = writeln!(text, "{}", row_text(row));
    }
    text
}

fn row(row: usize) -> String {
    format!("{:.3},{},{}", row as f64 * 1e-3, position(row), position(row))
}

/// A record whose row `at` is `text`.
fn with_row(at: usize, text: &str) -> String {
    record(100, |index| if index == at { text.to_owned() } else { row(index) })
}

/// Records that are refused, with parts of the message that say where and why.
fn refused() -> Vec<(&'static str, String, Vec<&'static str>)> {
    let scaled = |factor: f64| {
        record(100, |k| format!("{:.3},{},{}", k as f64 * 1e-3, position(k) * factor, position(k) * factor))
    };
    let counts =
        record(100, |k| format!("{:.3},{},{}", k as f64 * 1e-3, position(k), (position(k) * 1e7).round()));
    let good = record(100, row);
    vec![
        (
            "a missing column",
            good.replace("lvdt_m", "position"),
            vec!["bad.csv:1:", "`lvdt_m` is missing", "`position`"],
        ),
        (
            "a cell that is not a number",
            with_row(7, "0.007,0.001,abc"),
            vec!["bad.csv:9:", "column `lvdt_m` (3)", "`abc`"],
        ),
        (
            "a value that is not finite",
            with_row(7, "0.007,inf,0.001"),
            vec!["bad.csv:9:", "column `command_m` (2)", "finite"],
        ),
        ("NaN", with_row(7, "0.007,0.001,NaN"), vec!["bad.csv:9:", "column `lvdt_m` (3)", "finite"]),
        (
            "time that stands still",
            with_row(7, "0.006,0.001,0.001"),
            vec!["bad.csv:9:", "column `t_s` (1)", "increasing"],
        ),
        (
            "time that runs backwards",
            with_row(7, "0.001,0.001,0.001"),
            vec!["bad.csv:9:", "column `t_s` (1)", "increasing"],
        ),
        (
            "time that is not uniform",
            with_row(7, "0.0072,0.001,0.001"),
            vec!["bad.csv:9:", "column `t_s` (1)", "uniform"],
        ),
        ("too few samples", record(49, row), vec!["bad.csv", "49 samples", "at least 50"]),
        (
            "a constant position",
            record(100, |k| format!("{:.3},{},0.001", k as f64 * 1e-3, position(k))),
            vec!["bad.csv", "column `lvdt_m` (3)", "same value"],
        ),
        ("millimetres", scaled(1e3), vec!["bad.csv:", "column `", "millimetres"]),
        ("counts", counts, vec!["bad.csv:", "column `", "counts"]),
        (
            "a blank command",
            with_row(7, "0.007,,0.001"),
            vec!["bad.csv:9:", "column `command_m` (2)", "blank"],
        ),
        ("a short row", with_row(7, "0.007,0.001"), vec!["bad.csv:9:", "2 cells"]),
        ("an empty file", String::new(), vec!["bad.csv", "no data"]),
        ("no header", good.replace(&format!("{HEADER}\n"), ""), vec!["bad.csv:1:", "header"]),
    ]
}

#[test]
fn every_kind_is_refused_with_its_place_and_leaves_no_file() {
    let bench = Bench::new();
    for (what, text, parts) in refused() {
        bench.write("bad.csv", &text);
        for arguments in [
            &["identify", "bad.csv", "--out", "results"][..],
            &["calibrate", "bad.csv", "--out", "results"],
            &["import", "bad.csv", "-o", "record.csv"],
            &["simulate", "--command", "bad.csv", "-o", "record.csv"],
        ] {
            let run = bench.run(arguments).refused(BAD_DATA, &parts);
            assert_eq!(run.stderr.matches("error:").count(), 1, "{what}, {arguments:?}: one message");
            assert_eq!(bench.files(), ["bad.csv"], "{what}, {arguments:?} left something behind");
        }
    }
}

#[test]
fn the_record_that_the_bad_ones_are_made_from_is_good() {
    let bench = Bench::new();
    bench.write("good.csv", &record(100, row));
    bench.run(&["identify", "good.csv"]).done();
}

#[test]
fn an_earlier_result_survives_a_failure() {
    let bench = Bench::new();
    bench.write("bad.csv", &record(49, row));
    bench.write("record.csv", "kept");
    bench.run(&["import", "bad.csv", "-o", "record.csv"]).refused(BAD_DATA, &["49 samples"]);
    assert_eq!(bench.read("record.csv"), "kept");
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let bench = Bench::new();
    bench.run(&["identify", "none.csv"]).refused(BAD_DATA, &["none.csv", "cannot be read"]);
    bench.run(&["identify", "."]).refused(BAD_DATA, &["cannot be read"]);
    bench.run(&["import", "none.mat"]).refused(BAD_DATA, &["none.mat", "cannot be read"]);
    bench.write("damaged.mat", "MATLAB 5.0 MAT-file, cut short");
    bench.run(&["import", "damaged.mat"]).refused(BAD_DATA, &["damaged.mat"]);
    bench.run(&["identify", "damaged.mat"]).refused(BAD_DATA, &["damaged.mat", "MAT header"]);
}

#[test]
fn a_result_that_cannot_be_written_is_a_failure() {
    let bench = Bench::new();
    bench.write("good.csv", &record(100, row));
    let run = bench.run(&["identify", "good.csv", "--out", "good.csv/results"]);
    run.refused(1, &["cannot write", "good.csv/results"]);
}
