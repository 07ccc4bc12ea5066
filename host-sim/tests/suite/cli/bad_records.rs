//! Bad input data: one message with file, line and column, exit code 3, nothing half written.

use super::harness::{BAD_DATA, Bench, with_cells};
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

/// Records that are refused, with the place that the message names; `records/text.rs` has the messages in full. The first
/// are those in which the position alone is wrong, of the number that is returned.
fn refused() -> (Vec<(String, &'static str)>, usize) {
    let rows = [
        "0.007,inf,0.001",
        "NaN,0.001,0.001",
        "0.006,0.001,0.001",
        "0.001,0.001,0.001",
        "0.0072,0.001,0.001",
        "0.007,,0.001",
        "0.007,0.001",
    ];
    let with_row = |text: &str| record(100, |index| if index == 7 { text.to_owned() } else { row(index) });
    let scaled = |command: f64, lvdt: f64, digits: usize| {
        record(100, |k| {
            let (t, x) = (k as f64 * 1e-3, position(k));
            format!("{t:.3},{},{:.digits$}", x * command, x * lvdt)
        })
    };
    let good = record(100, row);
    let mut refused = vec![
        (with_row("0.007,0.001,abc"), "bad.csv:9:"),
        (good.replace("lvdt_m", "position"), "bad.csv:1:"),
        (scaled(1.0, 1e7, 0), "counts"),
        (scaled(1.0, 0.0, 6), "same value"),
    ];
    let in_position = refused.len();
    refused.extend(rows.into_iter().map(|text| (with_row(text), "bad.csv:9:")));
    refused.extend([
        (good.replace(&format!("{HEADER}\n"), ""), "bad.csv:1:"),
        (scaled(1e3, 1e3, 6), "millimetres"),
        (
            record(100, |k| format!("{k},{0},{0}", position(k))),
            "bad.csv: column `t_s` (1): found a sampling period of 1 s",
        ),
        (record(49, row), "bad.csv: found 49 samples"),
        (String::new(), "bad.csv: "),
    ]);
    (refused, in_position)
}

#[test]
fn every_kind_is_refused_with_its_place_and_leaves_no_file() {
    let bench = Bench::new();
    let verbs = [
        &["identify", "bad.csv", "--out", "results"][..],
        &["calibrate", "bad.csv", "--out", "results"],
        &["import", "bad.csv", "-o", "record.csv"],
        // It flies the command: what was measured is not read.
        &["simulate", "--command", "bad.csv", "-o", "record.csv"],
    ];
    let (refused, in_position) = refused();
    for (index, (text, place)) in refused.iter().enumerate() {
        bench.write("bad.csv", text);
        for arguments in &verbs[..verbs.len() - usize::from(index < in_position)] {
            let run = bench.run(arguments).refused(BAD_DATA, &["bad.csv", place]);
            assert_eq!(run.stderr.matches("error:").count(), 1, "{place}, {arguments:?}: one message");
            assert_eq!(bench.files(), ["bad.csv"], "{place}, {arguments:?} left something behind");
        }
    }
}

#[test]
fn a_command_is_flown_without_a_position() {
    let bench = Bench::new();
    let command = |row: usize| format!("{:.3},{}", row as f64 * 1e-3, position(row));
    let text = record(100, command).replace(HEADER, "t_s,command_m");
    bench.write("command.csv", &text);
    bench.run(&["simulate", "--command", "command.csv", "--model", "lf", "-o", "record.csv"]).done();
    assert!(bench.read("record.csv").contains("t_s,command_m,lvdt_m"));
    bench.run(&["identify", "command.csv"]).refused(BAD_DATA, &["`lvdt_m` is missing"]);
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

#[test]
fn a_record_without_the_force_that_drives_the_rig_is_refused() {
    let bench = Bench::new();
    bench.write("bad.csv", &record(100, row));
    for verb in ["identify", "calibrate", "diagnose", "check"] {
        let run = bench.run(&[verb, "bad.csv", "--rig", "force-axis"]);
        run.refused(
            BAD_DATA,
            &["bad.csv: `drive_N` is missing", "found `command_m`, `lvdt_m`", "force-axis"],
        );
    }
}

#[test]
fn a_channel_that_says_nothing_is_left_out() {
    let bench = Bench::new();
    bench.noisy_record();
    let text = bench.read("record.csv");
    let channels = |name: &str, part: &str| {
        let run = bench.run(&["import", name, "-o", "out.csv"]).done();
        assert!(run.stderr.contains(part), "`{part}` is not in: {}", run.stderr);
        let out = bench.read("out.csv");
        out.lines().find(|line| line.starts_with("t_s")).expect("a header").to_owned()
    };
    assert_eq!(channels("record.csv", "wrote"), "t_s,command_m,lvdt_m,current_mA");
    for (cell, part) in [
        ("0", "column `current_mA` (4): not used: it has the same value 0 in every sample"),
        ("", "column `current_mA` (4): not used: it has no value"),
    ] {
        bench.write("dead.csv", &with_cells(&text, "current_mA", |_, _| cell.to_owned()));
        assert_eq!(channels("dead.csv", part), "t_s,command_m,lvdt_m");
    }
    // The position is not left out.
    bench.write("dead.csv", &with_cells(&text, "lvdt_m", |_, _| String::new()));
    bench.run(&["import", "dead.csv", "-o", "out.csv"]).refused(BAD_DATA, &["lvdt_m", "found no value"]);
}

#[test]
fn a_segment_without_samples_tells_where_the_record_is() {
    let bench = Bench::new();
    bench.write("record.csv", &record(100, |k| row(k + 5000)));
    let run = bench.run(&["check", "record.csv", "--from", "0.2", "--to", "0.9"]);
    run.refused(BAD_DATA, &["found 0 samples in the segment", "from 5 s to 5.099 s"]);
    bench.run(&["import", "record.csv", "--from", "5.01", "-o", "out.csv"]).done();
}
