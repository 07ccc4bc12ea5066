//! Text files as loggers, spreadsheets and other programs write them.

use std::fmt::Write as _;

use eha_monitor::channel::Channel;

use super::*;
use crate::record::{Mapping, Record};

/// A position that moves by some millimetres, m.
fn position(row: usize) -> f64 {
    4e-3 * (row as f64 * 0.05).sin()
}

/// A text of 60 rows at 1 kHz, of time and twice the position.
fn text(header: &str, row: impl Fn(usize) -> [String; 3]) -> String {
    let mut text = format!("{header}\n");
    for index in 0..60 {
        let _ = writeln!(text, "{}", row(index).join(";"));
    }
    text
}

/// The same in the units of the channels.
fn plain(row: usize) -> [String; 3] {
    [format!("{:.3}", row as f64 * 1e-3), position(row).to_string(), position(row).to_string()]
}

/// The same in milliseconds and millimetres.
fn in_milli(row: usize) -> [String; 3] {
    let position = (position(row) * 1e3).to_string();
    [row.to_string(), position.clone(), position]
}

const HEADER: &str = "t_s;command_m;lvdt_m";

fn parse(text: &str, entries: &[&str], rate: Option<f64>) -> Result<Loaded, RecordError> {
    let columns = Mapping::parse(entries.iter().copied()).expect("a valid mapping");
    let options = ReadOptions { columns, sample_rate_hz: rate, ..ReadOptions::default() };
    parse_csv("run.csv", text.as_bytes(), &options)
}

fn message(text: &str, entries: &[&str], rate: Option<f64>) -> String {
    parse(text, entries, rate).expect_err("must be refused").to_string()
}

/// Is it the motion of [`text`], at 1 kHz?
fn is_motion(record: &Record) -> bool {
    let values = record.channel(Channel::UserPosition).expect("required");
    (record.sample_period_s() - 1e-3).abs() < 1e-12
        && values.len() == 60
        && values.iter().enumerate().all(|(row, value)| (value - position(row)).abs() < 1e-12)
}

#[test]
fn what_other_programs_write_for_a_lost_sample_is_one() {
    for lost in ["NaN", "nan", "NA", "N/A", "null", "#N/A", "#NV", "-nan(ind)", "-1.#IND", "None", ""] {
        let with = |column: usize| {
            text(HEADER, |row| {
                let mut cells = plain(row);
                if row == 12 {
                    cells[column] = lost.to_owned();
                }
                cells
            })
        };
        let loaded = parse(&with(2), &[], None).expect(lost);
        assert_eq!(loaded.record.missing_count(Channel::UserPosition), 1);
        assert_eq!(loaded.warnings, ["run.csv: column `lvdt_m` (3): 1 of 60 samples are missing"]);
        // A line that begins with `#` is a comment.
        let first = usize::from(lost.starts_with('#'));
        for (column, name) in [(0, "t_s"), (1, "command_m")].into_iter().skip(first) {
            let place =
                format!("run.csv:14: column `{name}` ({}): found a blank cell or NaN, expected", column + 1);
            assert!(message(&with(column), &[], None).starts_with(&place), "{lost}");
        }
    }
}

#[test]
fn what_spreadsheets_write_that_is_not_utf_8_is_read() {
    let columns = ["command_m=ref [µm]", "lvdt_m=pos [µm]"];
    let plain = text("t_s;ref [µm];pos [µm]", |row| {
        let [time, command, user] = plain(row);
        let micro = |metres: &str| format!("{metres}e6");
        [time, micro(&command), micro(&user)]
    });
    let read = |bytes: &[u8]| {
        let columns = Mapping::parse(columns).expect("a valid mapping");
        parse_csv("run.csv", bytes, &ReadOptions { columns, ..ReadOptions::default() })
    };
    let utf_8 = read(plain.as_bytes()).expect("UTF-8");
    assert!(is_motion(&utf_8.record));
    for (mark, bytes) in [(0xfeff_u16, u16::to_le_bytes as fn(u16) -> [u8; 2]), (0xfeff, u16::to_be_bytes)] {
        let utf_16: Vec<u8> = [mark].into_iter().chain(plain.encode_utf16()).flat_map(bytes).collect();
        let loaded = read(&utf_16).expect("UTF-16");
        assert!(is_motion(&loaded.record));
        assert_eq!(loaded.warnings, utf_8.warnings);
        // Cut in the middle of a character.
        let cut = read(&utf_16[..utf_16.len() - 1]).expect_err("damaged").to_string();
        assert_eq!(cut, "run.csv: found damaged text in UTF-16, expected text: save it as CSV");
    }
    let windows: Vec<u8> = plain.chars().map(|character| u8::try_from(character).expect("Latin-1")).collect();
    let Loaded { record, warnings } = read(&windows).expect("Windows-1252");
    assert!(is_motion(&record));
    assert_eq!(warnings[0], "run.csv: line 1 is not in UTF-8: the file is read as Windows-1252");
    assert_eq!(warnings[1..], utf_8.warnings);
}

#[test]
fn decimal_commas_are_read_between_other_separators() {
    let german = text(HEADER, |row| plain(row).map(|cell| cell.replace('.', ",")));
    for text in [german.clone(), german.replace(';', "\t")] {
        let Loaded { record, warnings } = parse(&text, &[], None).expect("valid");
        assert!(is_motion(&record) && warnings.is_empty(), "{warnings:?}");
    }
    // The digits of the time are counted as those of a point: a lost row is seen.
    let lost: Vec<&str> = german.lines().filter(|line| !line.starts_with("0,030")).collect();
    let lost = lost.join("\n");
    assert!(message(&lost, &[], None).contains("found a step of 0.002000000 s"));
    assert_eq!(
        message(&german.replace("0,007;", "0.007;"), &[], None),
        "run.csv:9: column `t_s` (1): found `0.007`, expected decimal points or decimal commas, not both"
    );
    let quoted = german.replace(';', "\",\"").replace('\n', "\"\n\"");
    let found = message(&format!("\"{}", quoted.trim_end_matches('"')), &[], None);
    assert!(
        found.contains("found `0,000` with a decimal comma, expected a decimal point where commas"),
        "{found}"
    );
    let open = text("t_s;command_m;lvdt_m", |row| [row.to_string(), "1,250".to_owned(), row.to_string()]);
    let found = message(&open, &["t_s=t_s[ms]"], None);
    assert!(
        found.starts_with("run.csv:2: column `command_m` (2): found `1,250`, which is 1.250 or 1250"),
        "{found}"
    );
}

#[test]
fn a_separator_may_be_declared() {
    // More commas than semicolons in the header.
    let header = "t_s;command_m;lvdt_m;note, with, three, commas";
    let body = text(header, plain).replace('\n', ";-\n").replacen(";-\n", "\n", 1);
    assert!(message(&body, &[], None).contains("are missing"));
    for first in ["sep=;", "\u{feff}sep=;", "\"sep=;\"", "# by hand\n\nSEP=;"] {
        let Loaded { record, .. } = parse(&format!("{first}\n{body}"), &[], None).expect(first);
        assert!(is_motion(&record), "{first}");
    }
    let wrong = format!("sep=;\n{}", body.replace("0.007;", "x;"));
    assert!(message(&wrong, &[], None).starts_with("run.csv:10: column `t_s` (1): found `x`"));
    let tabs = format!("sep=\t\n{}", body.replace(';', "\t"));
    assert!(is_motion(&parse(&tabs, &[], None).expect("valid").record));
}

#[test]
fn a_row_of_units_counts_where_nothing_else_says_a_unit() {
    let units = |units: &str| text(&format!("time;ref;pos\n{units}"), in_milli);
    let names = ["t_s=time", "command_m=ref", "lvdt_m=pos"];
    for row in ["ms;mm;mm", "[ms];[mm];[mm]", "(ms);(mm);(mm)"] {
        let Loaded { record, warnings } = parse(&units(row), &names, None).expect(row);
        assert!(is_motion(&record), "{row}");
        assert_eq!(warnings, ["run.csv: units of line 2: `time` in ms, `ref` in mm, `pos` in mm"]);
    }
    // The mapping has the last word, and a factor is for what has no unit.
    let stated = ["t_s=time[ms]", "command_m=ref[mm]", "lvdt_m=pos*1e-3"];
    let Loaded { record, warnings } = parse(&units("s;mm;counts"), &stated, None).expect("valid");
    assert!(is_motion(&record) && warnings.is_empty(), "{warnings:?}");
    let wrong = |row: &str| message(&units(row), &names, None);
    let place = "run.csv:2: column `pos` (3): found the unit";
    assert_eq!(
        wrong("ms;mm;bar"),
        format!(
            "{place} `bar`, expected one of m, in, cm, mm, um; say which, as in `--columns 'lvdt_m=pos[m]'`, or give the \
             scale in m per unit, as in `--columns 'lvdt_m=pos*1.5e-5'`"
        )
    );
    assert!(wrong("ms;mm;furlong").starts_with(&format!("{place} `furlong`, expected one of m")));
    // Names of channels say their unit.
    let plain_units = |row: &str| text(&format!("{HEADER}\n{row}"), plain);
    assert!(is_motion(&parse(&plain_units("s;m;m"), &[], None).expect("valid").record));
    assert_eq!(
        message(&plain_units("s;m;mm"), &[], None),
        "run.csv:2: column `lvdt_m` (3): found the unit `mm`, expected m as the name says; if it is that unit, \
         `--columns 'lvdt_m=lvdt_m[mm]'`"
    );
    // What no unit of the channel is is refused there too, whatever it measures.
    for unit in ["V", "mV", "counts", "furlong", "%", "m/s", "bar", "[V]"] {
        assert_eq!(
            message(&plain_units(&format!("s;m;{unit}")), &[], None),
            format!(
                "run.csv:2: column `lvdt_m` (3): found the unit `{unit}`, expected m as the name says; if it is m, \
                 `--columns 'lvdt_m=lvdt_m[m]'`; else give the scale in m per unit, as in \
                 `--columns 'lvdt_m=lvdt_m*1.5e-5'`"
            )
        );
        let stated = parse(&plain_units(&format!("s;m;{unit}")), &["lvdt_m=lvdt_m[m]"], None).expect(unit);
        assert!(is_motion(&stated.record), "{unit}");
    }
    for (unit, symbol) in [("Millimeter", "mm"), ("inches", "in")] {
        let found = message(&plain_units(&format!("s;m;{unit}")), &[], None);
        assert!(found.ends_with(&format!("`--columns 'lvdt_m=lvdt_m[{symbol}]'`")), "{found}");
    }
    // No unit, and the channel's own in its spellings.
    for row in ["s;m;", "s;m;-", "s;m;[-]", "sec;metres;Meter", "Seconds;[m];(m)"] {
        assert!(is_motion(&parse(&plain_units(row), &[], None).expect(row).record), "{row}");
    }
    // A clock that is not used has any.
    let clock = text(&format!("{HEADER}\nhh:mm:ss;m;m"), |row| {
        let [_, command, position] = plain(row);
        [format!("12:00:00.{row:03}"), command, position]
    });
    assert!(is_motion(&parse(&clock, &[], Some(1000.0)).expect("valid").record));
    assert!(message(&clock, &[], None).contains("column `t_s` (1): found the unit `hh:mm:ss`, expected s"));
    // Words that are no units are no numbers either.
    assert!(message(&plain_units("Zeit;Soll;Ist"), &[], None).contains("found `Zeit`, expected a number"));
}

#[test]
fn lines_of_the_logger_above_the_names_are_skipped() {
    let above = "Test rig 7\nOperator: X, Y\n\n# Date: 12:00\n***End_of_Header***\n";
    for separator in [",", ";", "\t", " ", "   "] {
        for end in ["\n", "\r\n", "\r"] {
            let body = text(HEADER, plain).replace(';', separator);
            let Loaded { record, warnings } =
                parse(&format!("{above}{body}").replace('\n', end), &[], None).expect(separator);
            assert!(is_motion(&record), "`{separator}`");
            let note = "run.csv: the names of the columns are on line 6: what is above it is skipped";
            assert_eq!(warnings, [note], "`{separator}`");
            let wrong = body.replace(&format!("0.007{separator}"), &format!("x{separator}"));
            let found = message(&format!("{above}{wrong}").replace('\n', end), &[], None);
            assert!(found.starts_with("run.csv:14: column `t_s` (1): found `x`"), "{found}");
            // The control: nothing above, no note.
            let Loaded { record, warnings } = parse(&body.replace('\n', end), &[], None).expect(separator);
            assert!(is_motion(&record) && warnings.is_empty(), "{warnings:?}");
        }
    }
    // Names that are not those of channels are told from the numbers below them, and may be mapped.
    let named = format!("{above}{}", text("Zeit;Soll;Ist\ns;m;m", plain));
    assert_eq!(
        message(&named, &[], None),
        "run.csv:6: `t_s`, `command_m`, `lvdt_m` are missing: found `Zeit`, `Soll`, `Ist`; map them: \
         `--columns 't_s=NAME,command_m=NAME,lvdt_m=NAME'`, or give the sampling rate: `--rate HZ`"
    );
    let mapped = parse(&named, &["t_s=Zeit", "command_m=Soll", "lvdt_m=Ist"], None).expect("valid");
    assert!(is_motion(&mapped.record));
    // What is declared holds for what comes later.
    let declared = format!("sep=;\nmade, by, hand, today\n{}", text(HEADER, plain));
    assert!(is_motion(&parse(&declared, &[], None).expect("valid").record));
    // The first hundred lines are looked at.
    let far = format!("{}{}", "a line\n".repeat(120), text(HEADER, plain));
    assert!(
        message(&far, &[], None)
            .starts_with("run.csv:1: `t_s`, `command_m`, `lvdt_m` are missing: found `a line`")
    );
}

#[test]
fn blanks_may_separate_cells() {
    let aligned = text("  t_s    command_m  lvdt_m  ", |row| plain(row).map(|cell| format!("  {cell} ")));
    let aligned = aligned.replace(';', " ");
    let Loaded { record, warnings } = parse(&aligned, &[], None).expect("valid");
    assert!(is_motion(&record) && warnings.is_empty(), "{warnings:?}");
    let quoted = aligned.replace("t_s ", "\"my time\" ");
    assert!(is_motion(&parse(&quoted, &["t_s=my time"], None).expect("valid").record));
    let german = aligned.replace('.', ",");
    assert!(is_motion(&parse(&german, &[], None).expect("valid").record));
    let short = aligned.replacen("  0.007 ", "", 1);
    assert_eq!(message(&short, &[], None), "run.csv:9: found 2 cells, expected 3 as in the header");
}

#[test]
fn names_may_be_in_the_comment_above_numbers() {
    for separator in [" ", ",", "\t"] {
        let numpy = format!("# {}", text(HEADER, plain).replace(';', separator));
        let Loaded { record, warnings } = parse(&format!("# run 7\n{numpy}"), &[], None).expect(separator);
        assert!(is_motion(&record), "`{separator}`");
        assert_eq!(warnings, ["run.csv: the names of the columns are those of the comment on line 2"]);
    }
    // Not where they are not those of the numbers.
    let four =
        text("# t_s command_m lvdt_m", |row| plain(row).map(|cell| format!("{cell} 1"))).replace(';', " ");
    assert!(message(&four, &[], None).starts_with("run.csv:2: found numbers only"));
    let bare = text("", plain).trim_start().to_owned();
    for separator in [";", " "] {
        let found = message(&bare.replace(';', separator), &[], None);
        assert!(found.starts_with("run.csv:1: found numbers only"), "{found}");
    }
}

#[test]
fn a_command_that_never_changes_is_asked_about() {
    let still = text(HEADER, |row| {
        let [time, _, position] = plain(row);
        [time, "0.001".to_owned(), position]
    });
    let Loaded { warnings, .. } = parse(&still, &[], None).expect("a warning only");
    let expected = "run.csv: column `command_m` (2) never changes, and the position moves by ";
    assert!(warnings.len() == 1 && warnings[0].starts_with(expected), "{warnings:?}");
    assert!(warnings[0].ends_with("is it the right column?"), "{warnings:?}");
    // The control: one that moves.
    assert!(parse(&text(HEADER, plain), &[], None).expect("valid").warnings.is_empty());
}

#[test]
fn a_rate_does_without_a_clock() {
    let clock = text(HEADER, |row| {
        let [_, command, position] = plain(row);
        [format!("2024-05-01T12:00:00.{row:03}"), command, position]
    });
    let found = message(&clock, &[], None);
    let expected = "run.csv:2: column `t_s` (1): found the clock time `2024-05-01T12:00:00.000`, expected a number of seconds";
    assert!(found.starts_with(expected) && found.contains("`--rate HZ`"), "{found}");
    let Loaded { record, warnings } = parse(&clock, &[], Some(1000.0)).expect("valid");
    assert!(is_motion(&record));
    let note = "run.csv: column `t_s` (1): not used, the rate gives the time: found `2024-05-01T12:00:00.000`, which is";
    assert!(warnings.len() == 1 && warnings[0].starts_with(note), "{warnings:?}");
    // A clock that ends in words is damaged, not a clock.
    let damaged = text(HEADER, plain).replace("0.007;", "late;");
    assert!(message(&damaged, &[], Some(1000.0)).contains("found `late`, expected a number"));
}

#[test]
fn a_rate_is_one_of_a_logger_as_a_time_is() {
    let timeless = text("command_m;lvdt_m;note", |row| {
        let [_, command, position] = plain(row);
        [command, position, "-".to_owned()]
    });
    for (rate, period) in [(1.0, "1"), (5.0, "0.2"), (1e6, "0.000001")] {
        assert_eq!(
            message(&timeless, &[], Some(rate)),
            format!(
                "run.csv: found a sampling period of {period} s, expected 0.00001 to 0.1 s: a rate of 10 to 100000 Hz"
            )
        );
    }
    for rate in [10.0, 1000.0, 1e5] {
        let Loaded { record, .. } = parse(&timeless, &[], Some(rate)).expect("valid");
        assert!((record.sample_period_s() * rate - 1.0).abs() < 1e-12);
    }
    // Stamps that jitter are put on a grid that is judged as they would be; a unit that is stated has the last word.
    let slow = text(HEADER, |row| {
        let [_, command, position] = plain(row);
        [format!("{}", row as f64 + if row % 7 == 3 { 0.2 } else { 0.0 }), command, position]
    });
    let found = message(&slow, &[], Some(1.0));
    assert!(found.contains("column `t_s` (1): found a sampling period of 1 s"), "{found}");
    assert!(parse(&slow, &["t_s=t_s[s]"], Some(1.0)).is_ok());
    assert!(parse(&slow, &["t_s=t_s[ms]"], Some(1000.0)).is_ok());
}

#[test]
fn rows_that_come_twice_are_left_out() {
    let twice =
        text(HEADER, plain).replace("\n0.030;", "\n#\n0.030;").lines().fold(String::new(), |all, line| {
            let times = if line.starts_with("0.007") || line.starts_with("0.03") { 2 } else { 1 };
            all + &format!("{line}\n").repeat(times)
        });
    for rate in [None, Some(1000.0)] {
        let Loaded { record, warnings } = parse(&twice, &[], rate).expect("valid");
        assert!(is_motion(&record));
        assert_eq!(
            warnings[0],
            "run.csv: 11 rows repeat the one before, time and all: left out, the first at line 10"
        );
    }
    // Different values at one time are not the same row.
    let (row, other) = (plain(7).join(";"), plain(8)[1].clone());
    let differs = text(HEADER, plain).replace(&row, &format!("{row}\n0.007;{other};{other}"));
    assert_eq!(
        message(&differs, &[], None),
        "run.csv:10: column `t_s` (1): found 0.007 s after 0.007 s, expected increasing time"
    );
}

#[test]
fn the_unit_of_a_clock_is_told_from_its_steps() {
    let since_epoch = |per_second: u64| {
        text(HEADER, |row| {
            let [_, command, position] = plain(row);
            let stamp = 1_714_564_800 * per_second + row as u64 * per_second / 1000;
            [stamp.to_string(), command, position]
        })
    };
    let found = message(&since_epoch(1_000_000_000), &[], None);
    let hint = "it looks like nanoseconds: convert with `--columns 't_s=t_s[ns]'`";
    assert!(found.contains("found a magnitude of") && found.ends_with(hint), "{found}");
    for (per_second, unit) in [(1_000_000_000, "ns"), (1_000_000, "us"), (1000, "ms")] {
        let record =
            parse(&since_epoch(per_second), &[&format!("t_s=t_s[{unit}]")], None).expect(unit).record;
        assert!((record.sample_period_s() - 1e-3).abs() < 1e-9, "{unit}: {}", record.sample_period_s());
    }
    assert_eq!(
        message(&since_epoch(1_000_000), &[], None),
        "run.csv: column `t_s` (1): found a sampling period of 1000 s, expected 0.00001 to 0.1 s; it looks like \
         microseconds: convert with `--columns 't_s=t_s[us]'`; if it is so, say it with `--columns 't_s=t_s[s]'`"
    );
}

#[test]
fn names_are_found_with_and_without_a_space_before_the_unit() {
    for (header, entry) in
        [("Zeit [ms]", "t_s=Zeit[ms]"), ("Zeit[ms]", "t_s=Zeit [ms]"), ("Zeit  [ms]", "t_s=Zeit [ms]")]
    {
        let text = text(&format!("{header};Soll;Ist"), in_milli);
        let record =
            parse(&text, &[entry, "command_m=Soll[mm]", "lvdt_m=Ist[mm]"], None).expect(header).record;
        assert!(is_motion(&record), "{header}");
    }
    let text = text("Zeit [ms];Soll;Ist", in_milli);
    assert_eq!(
        message(&text, &["t_s=Ziet[ms]", "command_m=Soll[mm]", "lvdt_m=Ist[mm]"], None),
        "run.csv:1: `t_s=Ziet[ms]` is missing: found `Zeit [ms]`, `Soll`, `Ist`; did you mean \
         `--columns 't_s=Zeit [ms],command_m=Soll[mm],lvdt_m=Ist[mm]'`?"
    );
    assert_eq!(
        message(&text, &["command_m=Soll[mm]", "lvdt_m=Ist[mm]"], None),
        "run.csv:1: `t_s` is missing: found `Zeit [ms]`, `Soll`, `Ist`; map one: \
         `--columns 't_s=NAME,command_m=Soll[mm],lvdt_m=Ist[mm]'`, or give the sampling rate: `--rate HZ`"
    );
}

#[test]
fn messages_list_a_few_names_that_can_be_printed() {
    let many: Vec<String> = (0..500).map(|column| format!("ch{column}")).collect();
    let wide = text(&format!("{HEADER};{};LVDT [mm]", many.join(";")), |row| {
        let [time, command, position] = plain(row);
        [time, command, format!("{position}{}", ";0".repeat(501))]
    });
    let Loaded { warnings, .. } = parse(&wide, &[], None).expect("valid");
    let first =
        "run.csv: columns not used: `LVDT [mm]` (map it with `--columns 'lvdt_m=LVDT [mm]'`), `ch0`, `ch1`,";
    assert!(warnings[0].starts_with(first) && warnings[0].ends_with("`ch8` and 491 more"), "{}", warnings[0]);
    let found = message(&wide.replacen("lvdt_m", "foo", 1), &[], None);
    assert!(
        found.contains("`t_s`, `command_m`, `foo`, `ch0`,") && found.contains("`ch6` and 494 more"),
        "{found}"
    );
    // Ten are all listed, in their order.
    let ten = text(&format!("t_s;command_m;foo;{}", many[..7].join(";")), plain);
    assert!(message(&ten, &[], None).contains("`ch5`, `ch6`; map one"), "{}", message(&ten, &[], None));
    // A file of one long line, and one with bytes that cannot be printed.
    let json = format!("{{{}}}", "\"lvdt\": 1.25e-3 ".repeat(2000));
    let found = message(&json, &[], None);
    assert!(found.len() < 400 && found.contains("...`"), "{found}");
    let found = message("a\u{1b}[31mb\u{7}c\n1\n", &[], None);
    assert!(found.contains("found `a\\u{1b}[31mb\\u{7}c`") && !found.contains('\u{1b}'), "{found}");
    let found = message(&text(HEADER, plain).replace("0.007;", "\u{1b}[2J;"), &[], None);
    assert!(found.ends_with("found `\\u{1b}[2J`, expected a number"), "{found}");
    let zeros = text(HEADER, plain).replace("0.007;", "\0\0;");
    assert!(message(&zeros, &[], None).starts_with("run.csv:9: found bytes that are no text"));
}
