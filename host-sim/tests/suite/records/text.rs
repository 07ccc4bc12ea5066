//! Records as a user meets them: text files in, messages and text files out.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::measured_data;
use eha_monitor::channel::Channel;
use host_sim::record::{
    Loaded, Mapping, Problem, ReadOptions, Record, RecordError, parse_csv, read_csv, read_csv_with, save_csv,
    write_csv,
};

/// A position that moves by some millimetres, m.
fn position(k: usize) -> f64 {
    4e-3 * (k as f64 * 0.05).sin()
}

/// A text of `rows` rows at 1 kHz; `cell` may replace the text of a cell (row, column), both from 0.
fn text_with(header: &str, rows: usize, cell: impl Fn(usize, usize) -> Option<String>) -> String {
    let mut text = format!("{header}\n");
    for row in 0..rows {
        let plain =
            [format!("{:.3}", row as f64 * 1e-3), position(row).to_string(), position(row).to_string()];
        let cells: Vec<String> =
            plain.into_iter().enumerate().map(|(column, plain)| cell(row, column).unwrap_or(plain)).collect();
        let _ = writeln!(text, "{}", cells.join(","));
    }
    text
}

fn text() -> String {
    text_with(HEADER, 60, |_, _| None)
}

const HEADER: &str = "t_s,command_m,lvdt_m";

/// A text whose cell in `row` and `column` (from 0) is `cell`.
fn with_cell(row: usize, column: usize, cell: &str) -> String {
    text_with(HEADER, 60, |r, c| (r == row && c == column).then(|| cell.to_owned()))
}

fn parse(text: &str) -> Result<Loaded, RecordError> {
    parse_csv("run.csv", text.as_bytes(), &ReadOptions::default())
}

fn message(text: &str) -> String {
    parse(text).expect_err("must be refused").to_string()
}

fn columns(entries: &[&str]) -> ReadOptions {
    let columns = Mapping::parse(entries.iter().copied()).expect("a valid mapping");
    ReadOptions { columns, ..ReadOptions::default() }
}

#[test]
fn a_plain_file_is_read() {
    let Loaded { record, warnings } = parse(&text()).expect("valid");
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!((record.name(), record.len()), ("run.csv", 60));
    assert_eq!((record.sample_period_s(), record.start_time_s()), (1e-3, 0.0));
    assert_eq!(record.channel(Channel::UserPosition).map(|values| values[7]), Some(position(7)));
}

#[test]
fn the_look_of_the_file_does_not_matter() {
    let plain = parse(&text()).expect("valid").record;
    let comments = text().replacen('\n', "\n# a \"comment\", with cells\n\n   \n", 1);
    let mut shuffled = String::new();
    for line in text().lines() {
        let cells: Vec<&str> = line.split(',').collect();
        let _ = writeln!(shuffled, "\"{}\",{}, {} ", cells[2], cells[0], cells[1]);
    }
    for other in [
        format!("\u{feff}# made by hand\n{}", text()),
        text().replace('\n', "\r\n"),
        text().replace('\n', "\r"),
        text().replace(',', ";"),
        text().replace(',', "\t"),
        comments,
        shuffled,
        text().trim_end().to_owned(),
    ] {
        let record = parse(&other).expect(&other).record;
        assert_eq!(record.channels().collect::<Vec<_>>(), plain.channels().collect::<Vec<_>>(), "{other}");
        assert_eq!(record.sample_period_s(), 1e-3);
    }
}

#[test]
fn a_bad_cell_is_named_by_line_and_column() {
    for (row, column, cell, expected) in [
        (0, 2, "abc", "run.csv:2: column `lvdt_m` (3): found `abc`, expected a number"),
        (9, 0, "1_0", "run.csv:11: column `t_s` (1): found `1_0`, expected a number"),
        (3, 2, "-inf", "run.csv:5: column `lvdt_m` (3): found `-inf`, expected a finite number"),
        (3, 2, "1e999", "run.csv:5: column `lvdt_m` (3): found `1e999`, expected a finite number"),
        (3, 1, "", "run.csv:5: column `command_m` (2): found a blank cell or NaN, expected a number"),
        (3, 0, " ", "run.csv:5: column `t_s` (1): found a blank cell or NaN, expected a number"),
        (3, 2, "1,2", "run.csv:5: found 4 cells, expected 3 as in the header"),
        (5, 0, "0.004", "run.csv:7: column `t_s` (1): found 0.004 s after 0.004 s, expected increasing time"),
        (
            5,
            0,
            "0.0051",
            "run.csv:7: column `t_s` (1): found a step of 0.001100000 s where the typical step is",
        ),
    ] {
        let found = message(&with_cell(row, column, cell));
        assert!(found.starts_with(expected), "{found}\n{expected}");
    }
}

#[test]
fn lines_are_those_of_the_file() {
    for end in ["\n", "\r\n"] {
        let bad = with_cell(4, 2, "abc")
            .replacen('\n', "\n\n# a comment\n", 1)
            .replace("\n0.003", "\n# another\n\n0.003")
            .replace('\n', end);
        let bad = format!("# first{end}{bad}");
        let line = bad.split(end).position(|line| line.contains("abc")).map(|index| index as u64 + 1);
        assert_eq!(parse(&bad).expect_err("bad cell").line(), line);
    }
}

#[test]
fn a_lost_row_is_not_uniform() {
    let lost: String = text()
        .lines()
        .filter(|line| !line.starts_with("0.030"))
        .fold(String::new(), |all, line| all + line + "\n");
    let found = message(&lost);
    assert_eq!(
        found,
        "run.csv:32: column `t_s` (1): found a step of 0.002000000 s where the typical step is 0.001000000 s, \
         expected uniform sampling (within 1 %); where stamps jitter or rows are lost, `--rate HZ` puts them on a grid"
    );
    let rate = |hertz| ReadOptions { sample_rate_hz: Some(hertz), ..ReadOptions::default() };
    let Loaded { record, warnings } =
        parse_csv("run.csv", lost.as_bytes(), &rate(1000.0)).expect("on a grid");
    let whole = parse(&text()).expect("valid");
    assert_eq!((record.len(), record.sample_period_s()), (whole.record.len(), 1e-3));
    for (channel, values) in whole.record.channels() {
        for (sample, (&found, &value)) in record.channel(channel).expect("it").iter().zip(values).enumerate()
        {
            match (sample, channel) {
                (30, Channel::UserPosition) => assert!(found.is_nan()),
                (30, _) => assert!((found - value).abs() < 1e-8, "{found} {value}"),
                _ => assert!((found - value).abs() < 1e-15),
            }
        }
    }
    assert_eq!(
        warnings,
        [
            "run.csv: column `t_s` (1): put on a grid of 1000 Hz, by up to 0.000 ms; 1 of 60 rows are lost, the inputs \
             bridged",
            "run.csv: column `lvdt_m` (3): 1 of 60 samples are missing"
        ]
    );
    let other = parse_csv("run.csv", lost.as_bytes(), &rate(400.0)).expect_err("another rate").to_string();
    assert!(other.contains("expected 0.002500000 s of a rate of 400 Hz"), "{other}");
}

#[test]
fn a_header_must_name_each_required_column_once() {
    let renamed = |names: &str| message(&text().replacen(HEADER, names, 1));
    assert_eq!(
        renamed("t_s,command_m,lvdt_mm"),
        "run.csv:1: `lvdt_m` is missing: found `t_s`, `command_m`, `lvdt_mm`; \
         map one, such as `--columns 'lvdt_m=lvdt_mm[mm]'`"
    );
    assert_eq!(
        renamed("t_s,command,lvdt_m"),
        "run.csv:1: `command_m` is missing: found `t_s`, `command`, `lvdt_m`; \
         map one, such as `--columns 'command_m=command'`"
    );
    assert_eq!(
        renamed("t_s,command_m,lvdt_m,lvdt_m"),
        "run.csv:1: column `lvdt_m` (4): found the name a second time (first in column 3), expected it once"
    );
    assert!(parse(&format!("# {}", text())).is_ok(), "names in a comment straight above the numbers");
    assert_eq!(
        message(&format!("# {}", text().replacen("command_m", "command", 1))),
        "run.csv:2: found numbers only, expected a header with column names \
         (is it missing, or commented out by a `#`?)"
    );
}

#[test]
fn files_that_are_no_record_are_told_apart() {
    let empty = "run.csv: found no data, expected a header line and rows of numbers";
    for none in ["", "\n\n", "# only a comment\n", HEADER] {
        assert_eq!(message(none), empty, "{none:?}");
    }
    let bytes =
        |bytes: &[u8]| parse_csv("run.csv", bytes, &ReadOptions::default()).expect_err("no text").to_string();
    let expected = "expected text: save it as CSV";
    for (content, found) in [
        (&b"\xff\xfet\0_\0s\0,"[..], ": found damaged text in UTF-16"),
        (b"PK\x03\x04\x14\0", ": found a ZIP file, as an Excel workbook is one"),
        (b"t_s\n\0\0\xe9", ":2: found bytes that are no text"),
    ] {
        assert_eq!(bytes(content), format!("run.csv{found}, {expected}"));
    }
    let mat = "run.csv: found a MAT file, expected text";
    assert_eq!(bytes(b"MATLAB 5.0 MAT-file\x00"), mat);
    let missing = read_csv(Path::new("no/such/file.csv")).expect_err("no file");
    assert!(missing.to_string().starts_with("no/such/file.csv: cannot be read: "), "{missing}");
    assert!(matches!(missing.problem(), Problem::Io(_)));
}

#[test]
fn too_little_data_is_refused() {
    let short = text_with(HEADER, 49, |_, _| None);
    assert_eq!(message(&short), "run.csv: found 49 samples, expected at least 50");
    let blank = text_with(HEADER, 60, |row, column| (column == 2 && row > 30).then(String::new));
    assert_eq!(
        message(&blank),
        "run.csv: column `lvdt_m` (3): found no value in 29 of 60 samples, expected at least 50 values"
    );
    let constant = text_with(HEADER, 60, |_, column| (column == 2).then(|| "0.001".to_owned()));
    assert_eq!(
        message(&constant),
        "run.csv: column `lvdt_m` (3): found the same value 0.001 in every sample, expected a position that moves"
    );
}

#[test]
fn wrong_units_are_named() {
    let in_unit = |scale: f64, digits: usize| {
        message(&text_with(HEADER, 60, |row, column| {
            (column == 2).then(|| format!("{:.digits$}", position(row) * scale))
        }))
    };
    let found = in_unit(1e3, 4);
    assert!(found.starts_with("run.csv:33: column `lvdt_m` (3): found a magnitude of 3.9"), "{found}");
    let advice =
        "expected at most 2 m; it looks like millimetres: convert with `--columns 'lvdt_m=lvdt_m[mm]'`";
    assert!(found.ends_with(advice), "{found}");
    assert!(in_unit(1e6, 0).contains("it looks like sensor counts: give the scale in m per count"));
    let small = in_unit(400.0, 4);
    assert!(small.contains("expected at most 100 times the command; it looks like millimetres"), "{small}");
}

#[test]
fn decimal_commas_are_recognised() {
    let commas = text_with(HEADER, 60, |_, _| Some("0,001".to_owned()));
    assert!(message(&commas).ends_with(
        "found 6 cells, expected 3 as in the header (decimal commas? use decimal points, or semicolons \
             between cells)"
    ));
}

#[test]
fn missing_samples_are_kept_and_reported() {
    let loaded = parse(&with_cell(12, 2, "")).expect("valid");
    assert_eq!(loaded.record.missing_count(Channel::UserPosition), 1);
    assert!(loaded.record.channel(Channel::UserPosition).is_some_and(|values| values[12].is_nan()));
    assert_eq!(loaded.warnings, ["run.csv: column `lvdt_m` (3): 1 of 60 samples are missing"]);
}

#[test]
fn unknown_columns_are_a_warning() {
    let mut more = String::new();
    for (row, line) in text().lines().enumerate() {
        let _ = writeln!(more, "{line}{}", if row == 0 { ",ram_mm,note,note" } else { ",1.5,text,2" });
    }
    let warnings = parse(&more).expect("valid").warnings;
    assert_eq!(
        warnings,
        ["run.csv: columns not used: `ram_mm` (map it with `--columns 'ram_m=ram_mm[mm]'`), `note`, `note`"]
    );
}

#[test]
fn columns_can_be_mapped_and_converted() {
    let other = text_with("time [ms],ref,Position (mm)", 60, |row, column| match column {
        0 => Some(row.to_string()),
        _ => Some((position(row) * 1e3).to_string()),
    });
    let options = columns(&["t_s=time [ms]", "command_m=ref[mm]", "lvdt_m=Position (mm)*-1e-3"]);
    let record = parse_csv("run.csv", other.as_bytes(), &options).expect("valid").record;
    assert_eq!(record.sample_period_s(), 1e-3);
    let values = record.channel(Channel::UserPosition).expect("mapped");
    assert!(values.iter().enumerate().all(|(k, value)| (value + position(k)).abs() < 1e-15));
    let wrong =
        parse_csv("run.csv", text().as_bytes(), &columns(&["ram_m=ram[mm]"])).expect_err("no such column");
    assert_eq!(
        wrong.to_string(),
        "run.csv:1: `ram_m=ram[mm]` is missing: found `t_s`, `command_m`, `lvdt_m`"
    );
}

#[test]
fn a_rate_stands_in_for_the_time() {
    let no_time = text_with("number,command_m,lvdt_m", 60, |_, _| None);
    assert!(message(&no_time).starts_with("run.csv:1: `t_s` is missing"));
    let rate = |hertz| ReadOptions { sample_rate_hz: Some(hertz), ..ReadOptions::default() };
    let record = parse_csv("run.csv", no_time.as_bytes(), &rate(500.0)).expect("valid").record;
    assert_eq!((record.sample_period_s(), record.start_time_s()), (2e-3, 0.0));
    let both = parse_csv("run.csv", text().as_bytes(), &rate(500.0)).expect("valid");
    assert_eq!(both.record.sample_period_s(), 1e-3);
    assert_eq!(both.warnings, ["run.csv: the sampling rate is not used: column `t_s` (1) gives the time"]);
    let zero = parse_csv("run.csv", no_time.as_bytes(), &rate(0.0)).expect_err("no rate").to_string();
    assert_eq!(zero, "run.csv: found a sampling period of inf s, expected a positive finite one");
}

#[test]
fn rows_that_are_lost_regularly_are_told_from_rounded_stamps_by_the_rate() {
    let whole = text_with(HEADER, 300, |_, _| None);
    let is_kept = |&(index, _): &(usize, &str)| index == 0 || index % 10 != 9;
    let lost: String =
        whole.lines().enumerate().filter(is_kept).fold(String::new(), |all, (_, line)| all + line + "\n");
    let rounded = parse_csv("run.csv", lost.as_bytes(), &ReadOptions::default()).expect("uniform");
    assert!((rounded.record.sample_period_s() * 900.0 - 1.0).abs() < 0.01);
    assert!(rounded.warnings.iter().any(|note| note.contains("`--rate 1000`")), "{:?}", rounded.warnings);
    let rate = ReadOptions { sample_rate_hz: Some(1000.0), ..ReadOptions::default() };
    let stated = parse_csv("run.csv", lost.as_bytes(), &rate).expect("on a grid").record;
    assert_eq!(stated.sample_period_s(), 1e-3);
    assert_eq!(stated.missing_count(Channel::UserPosition), stated.len() - rounded.record.len());
}

#[test]
fn a_window_keeps_what_is_inside_and_checks_only_that() {
    let gap = text_with(HEADER, 200, |row, column| {
        (column == 0).then(|| format!("{:.3}", row as f64 * 1e-3 + if row < 20 { 0.0 } else { 0.5 }))
    });
    assert!(parse(&gap).is_err());
    let options = ReadOptions { from_s: Some(0.55), to_s: Some(0.65), ..ReadOptions::default() };
    let record = parse_csv("run.csv", gap.as_bytes(), &options).expect("uniform inside").record;
    assert_eq!((record.len(), record.start_time_s()), (100, 0.55));
    assert_eq!(record.channel(Channel::Command).map(|values| values[0]), Some(position(50)));
}

#[test]
fn a_period_that_no_logger_has_is_taken_where_its_unit_is_stated() {
    let stamps = |header: &str, stamp: fn(usize) -> String| {
        text_with(header, 60, |row, column| (column == 0).then(|| stamp(row)))
    };
    let read = |text: &str, entries: &[&str], rate: Option<f64>| {
        let columns = Mapping::parse(entries.iter().copied()).expect("a mapping");
        let options = ReadOptions { columns, sample_rate_hz: rate, ..ReadOptions::default() };
        parse_csv("run.csv", text.as_bytes(), &options)
            .map(|loaded| (loaded.record.sample_period_s(), loaded.warnings))
    };
    let refused = |text: &str, entries: &[&str]| read(text, entries, None).expect_err("doubtful").to_string();
    let milliseconds = stamps(HEADER, |row| row.to_string());
    let doubt = |name: &str| {
        format!(
            "run.csv: column `{name}` (1): found a sampling period of 1 s, expected 0.00001 to 0.1 s; it looks like \
             milliseconds: convert with `--columns 't_s={name}[ms]'`; if it is so, say it with `--columns 't_s={name}[s]'`"
        )
    };
    assert_eq!(refused(&milliseconds, &[]), doubt("t_s"));
    let named = milliseconds.replacen("t_s", "Zeit", 1);
    assert_eq!(refused(&named, &["t_s=Zeit"]), doubt("Zeit"));
    // What is stated holds: in the mapping, by a factor, or in a row of units.
    let taken = |text: &str, entries: &[&str]| read(text, entries, None).expect("stated");
    assert_eq!(taken(&named, &["t_s=Zeit[ms]"]), (1e-3, vec![]));
    assert_eq!(taken(&named, &["t_s=Zeit[s]"]), (1.0, vec![]));
    assert_eq!(taken(&named, &["t_s=Zeit*1"]), (1.0, vec![]));
    let (header, rows) = milliseconds.split_once('\n').expect("rows");
    let cells = header.matches(',').count();
    let with_units = format!("{header}\ns{}\n{rows}", ",".repeat(cells));
    assert_eq!(taken(&with_units, &[]), (1.0, vec![]));
    // Faster than any logger: no unit is offered.
    assert_eq!(
        refused(&stamps(HEADER, |row| format!("{row}e-6")), &[]),
        "run.csv: column `t_s` (1): found a sampling period of 0.000001 s, expected 0.00001 to 0.1 s; if it is so, say it \
         with `--columns 't_s=t_s[s]'`"
    );
    // So it is with a rate, where there is no time or where stamps jitter.
    let timeless = milliseconds.replacen("t_s", "n", 1);
    let found = read(&timeless, &[], Some(1.0)).expect_err("no logger's").to_string();
    assert_eq!(
        found,
        "run.csv: found a sampling period of 1 s, expected 0.00001 to 0.1 s: a rate of 10 to 100000 Hz"
    );
    let jitter = stamps(HEADER, |row| format!("{:.3}", row as f64 + 0.1 * (row % 2) as f64));
    assert!(read(&jitter, &[], Some(1.0)).is_err());
    let stated = |text: &str| read(text, &["t_s=t_s[s]"], Some(1.0)).expect("a grid").0;
    assert_eq!(stated(&jitter), 1.0);
}

#[test]
fn a_clock_may_count_from_any_day() {
    let epoch = text_with(HEADER, 60, |row, column| {
        (column == 0).then(|| format!("{:.3}", 1_795_000_000.0 + row as f64 * 1e-3))
    });
    let Loaded { record, warnings } = parse(&epoch).expect("valid");
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!((record.sample_period_s(), record.start_time_s()), (1e-3, 1_795_000_000.0));
}

#[test]
fn what_is_written_reads_back_the_same() {
    let values =
        |phase: f64| -> Vec<f64> { (0..200).map(|k| 1e-3 * (f64::from(k) * 0.3 + phase).sin()).collect() };
    let mut lvdt = values(0.1);
    lvdt[3] = f64::NAN;
    lvdt[199] = f64::NAN;
    let channels = vec![
        (Channel::Command, values(0.0)),
        (Channel::UserPosition, lvdt),
        (Channel::Pressure, values(0.2).iter().map(|value| value * 1e10).collect()),
        (Channel::Load, vec![1e-300; 200]),
    ];
    for (period, start) in [(1e-3, 0.0), (1.0 / 1024.0, 12.5), (2.7e-4, 3.3)] {
        let record = Record::new("made", period, start, channels.clone()).expect("valid");
        let mut text = Vec::new();
        write_csv(&record, &["seed = 7\nrig = eha".to_owned(), "version 1".to_owned()], &mut text)
            .expect("in memory");
        let head = "# seed = 7\n# rig = eha\n# version 1\nt_s,command_m,lvdt_m,dp_Pa,load_N\n";
        assert!(text.starts_with(head.as_bytes()));
        let back = parse_csv("back", &text, &ReadOptions::default()).expect("valid").record;
        assert!((back.sample_period_s() - period).abs() <= 1e-12 * period);
        assert_eq!(back.start_time_s(), start);
        for ((channel, wrote), (_, read)) in record.channels().zip(back.channels()) {
            let same = wrote.iter().zip(read).all(|(a, b)| a == b || a.is_nan() && b.is_nan());
            assert!(same, "{channel:?}");
        }
    }
}

#[test]
fn a_file_is_saved_whole_or_not_at_all() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let record = parse(&text()).expect("valid").record;
    let path = folder.path().join("out.csv");
    save_csv(&record, &[], &path).expect("written");
    assert_eq!(read_csv(&path).expect("valid").record.len(), 60);
    let names: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).expect("readable").flatten().map(|entry| entry.path()).collect();
    assert_eq!(names, [path]);
    let nowhere = folder.path().join("none").join("out.csv");
    let error = save_csv(&record, &[], &nowhere).expect_err("no folder").to_string();
    assert!(error.starts_with(&format!("{}: cannot be written: ", nowhere.display())), "{error}");
}

#[test]
fn measured_files_are_read() {
    for (file, samples, channel) in [
        ("mts/chirp20_0A.csv", 61_500, Channel::Load),
        ("mts/chirp20_1A.csv", 59_100, Channel::Load),
        ("mts/chirp15_0A.csv", 46_800, Channel::Load),
        ("emps/estimation.csv", 24_841, Channel::Drive),
    ] {
        let Some(path) = measured_data::file(file) else { continue };
        let Loaded { record, warnings } = read_csv_with(&path, &ReadOptions::default()).expect(file);
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((record.len(), record.sample_period_s()), (samples, 1e-3), "{file}");
        assert!(record.channel(channel).is_some());
    }
}
