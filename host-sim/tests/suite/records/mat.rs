//! MAT files as a user meets them: v5 (both byte orders, compressed or not), v7.3, and files that are damaged.

use std::io::Write as _;
use std::path::Path;

use eha_monitor::channel::Channel;
use flate2::{Compression, write::ZlibEncoder};
use hdf5_pure::FileBuilder;
use hdf5_pure::mat::{MatBuilder, MatError, Options};
use host_sim::record::{
    Loaded, Mapping, Problem, ReadOptions, RecordError, parse_csv, parse_mat, read_mat, read_mat_with,
    save_csv,
};

const SAMPLES: usize = 60;

fn times() -> Vec<f64> {
    (0..SAMPLES).map(|k| k as f64 * 1e-3).collect()
}

/// A position that moves by some millimetres, m.
fn motion() -> Vec<f64> {
    (0..SAMPLES).map(|k| 4e-3 * (k as f64 * 0.05).sin()).collect()
}

fn options(entries: &[&str]) -> ReadOptions {
    let columns = Mapping::parse(entries.iter().copied()).expect("a valid mapping");
    ReadOptions { columns, ..ReadOptions::default() }
}

fn parse(bytes: &[u8], entries: &[&str]) -> Result<Loaded, RecordError> {
    parse_mat("run.mat", bytes, &options(entries))
}

fn message(bytes: &[u8], entries: &[&str]) -> String {
    parse(bytes, entries).expect_err("must be refused").to_string()
}

/// Writes MAT v5 elements from the published format, not with the code under test.
struct Level5 {
    big_endian: bool,
    bytes: Vec<u8>,
}

impl Level5 {
    fn new(big_endian: bool) -> Self {
        let mut bytes = b"MATLAB 5.0 MAT-file, made by a test".to_vec();
        bytes.resize(124, b' ');
        bytes.extend_from_slice(if big_endian { b"\x01\x00MI" } else { b"\x00\x01IM" });
        Self { big_endian, bytes }
    }

    fn word(&self, word: u32) -> [u8; 4] {
        if self.big_endian { word.to_be_bytes() } else { word.to_le_bytes() }
    }

    fn element(&self, kind: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        if kind != 14 && (1..=4).contains(&data.len()) {
            bytes.extend(self.word((data.len() as u32) << 16 | kind));
            bytes.extend_from_slice(data);
            bytes.resize(8, 0);
        } else {
            bytes.extend(self.word(kind));
            bytes.extend(self.word(data.len() as u32));
            bytes.extend_from_slice(data);
            bytes.resize(bytes.len().next_multiple_of(8), 0);
        }
        bytes
    }

    fn head(&self, class: u32, name: &str, extents: &[u32]) -> Vec<u8> {
        let words = |words: &[u32]| words.iter().flat_map(|&word| self.word(word)).collect::<Vec<u8>>();
        [
            self.element(6, &words(&[class, 0])),
            self.element(5, &words(extents)),
            self.element(1, name.as_bytes()),
        ]
        .concat()
    }

    fn doubles(&self, name: &str, extents: &[u32], values: &[f64]) -> Vec<u8> {
        let raw = |value: &f64| if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let data: Vec<u8> = values.iter().flat_map(raw).collect();
        self.element(14, &[self.head(6, name, extents), self.element(9, &data)].concat())
    }

    fn column(&self, name: &str, values: &[f64]) -> Vec<u8> {
        self.doubles(name, &[values.len() as u32, 1], values)
    }

    fn structure(&self, name: &str, fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let (names, values): (Vec<&str>, Vec<Vec<u8>>) = fields.iter().cloned().unzip();
        self.structures(name, &names, &[values])
    }

    /// A row of structures, each with its fields.
    fn structures(&self, name: &str, names: &[&str], structures: &[Vec<Vec<u8>>]) -> Vec<u8> {
        let mut body = self.head(2, name, &[1, structures.len() as u32]);
        body.extend(self.element(5, &self.word(8)));
        let padded = |name: &&str| {
            let mut padded = name.as_bytes().to_vec();
            padded.resize(8, 0);
            padded
        };
        body.extend(self.element(1, &names.iter().flat_map(padded).collect::<Vec<u8>>()));
        body.extend(structures.concat().concat());
        self.element(14, &body)
    }

    fn with(mut self, variable: &[u8]) -> Self {
        self.bytes.extend_from_slice(variable);
        self
    }

    fn with_compressed(mut self, variable: &[u8]) -> Self {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(variable).expect("in memory");
        let packed = encoder.finish().expect("in memory");
        self.bytes.extend(self.word(15));
        self.bytes.extend(self.word(packed.len() as u32));
        self.bytes.extend(packed);
        self
    }

    /// The three required channels under their own names.
    fn required(self) -> Self {
        let (t, x) = (self.column("t_s", &times()), self.column("command_m", &motion()));
        let lvdt = self.doubles("lvdt_m", &[1, SAMPLES as u32], &motion());
        self.with(&t).with_compressed(&x).with(&lvdt)
    }
}

/// The three required channels, and what else `fill` adds, as v7.3.
fn level73(fill: impl FnOnce(&mut MatBuilder) -> Result<(), MatError>) -> Vec<u8> {
    let mut builder = MatBuilder::new(Options::default());
    let column = [SAMPLES, 1];
    let required = |builder: &mut MatBuilder| -> Result<(), MatError> {
        builder.write_f64("t_s", &column, &times())?;
        builder.write_f64("command_m", &[1, SAMPLES], &motion())?;
        builder.write_f64("lvdt_m", &column, &motion())?;
        fill(builder)
    };
    required(&mut builder).and_then(|()| builder.finish()).expect("in memory")
}

#[test]
fn both_families_and_byte_orders_are_read() {
    for bytes in
        [Level5::new(false).required().bytes, Level5::new(true).required().bytes, level73(|_| Ok(()))]
    {
        let Loaded { record, warnings } = parse(&bytes, &[]).expect("valid");
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!((record.len(), record.sample_period_s()), (SAMPLES, 1e-3));
        assert_eq!(record.channel(Channel::UserPosition), Some(&motion()[..]));
        assert_eq!(record.channel(Channel::Command), Some(&motion()[..]));
    }
}

#[test]
fn fields_of_structures_are_reached_by_their_path() {
    let file = Level5::new(false);
    let inner = file.structure("", &[("ref", file.column("", &motion()))]);
    let data = file.structure("data", &[("pos", file.column("", &motion())), ("inner", inner)]);
    let t = file.column("t_s", &times());
    let level5 = file.with(&t).with_compressed(&data).bytes;
    let level73 = level73(|builder| {
        builder.struct_("data", |data| {
            data.write_f64("pos", &[SAMPLES, 1], &motion())?;
            data.struct_("inner", |inner| inner.write_f64("ref", &[SAMPLES, 1], &motion()).map(|_| ()))
                .map(|_| ())
        })?;
        Ok(())
    });
    for bytes in [level5, level73] {
        let record =
            parse(&bytes, &["command_m=data.inner.ref", "lvdt_m=data.pos*-1"]).expect("valid").record;
        assert!(record.channel(Channel::UserPosition).is_some_and(|values| values[5] == -motion()[5]));
        let whole = message(&bytes, &["command_m=data", "lvdt_m=data.pos"]);
        assert_eq!(whole, "run.mat: variable `data`: found a structure, expected a real numeric vector");
        let none = message(&bytes, &["command_m=data.none", "lvdt_m=data.pos"]);
        assert!(none.starts_with("run.mat: `command_m=data.none` is missing: found "), "{none}");
        assert!(none.contains("`data.pos`") && none.contains("`data.inner.ref`"), "{none}");
    }
}

#[test]
fn one_of_an_array_of_structures_is_reached_by_its_number() {
    // What a simulation logs as "structure with time": one time, and a structure for each signal.
    let reference: Vec<f64> = motion().iter().map(|position| 2.0 * position).collect();
    let file = Level5::new(true);
    let signal = |values: &[f64]| vec![file.column("", values), file.column("", &[1.0])];
    let signals = file.structures("", &["values", "dims"], &[signal(&reference), signal(&motion())]);
    let log = file.structure("log", &[("time", file.column("", &times())), ("signals", signals)]);
    let level5 = file.with(&log).bytes;
    let mut file = FileBuilder::new();
    for (name, values) in [("a", &reference), ("b", &motion())] {
        file.create_dataset(name).with_f64_data(values);
    }
    let mut log = file.create_group("log");
    log.create_dataset("time").with_f64_data(&times());
    let mut signals = file.create_group("signals");
    signals.create_dataset("values").with_path_references(&["a", "b"]);
    log.add_group(signals.finish());
    file.add_group(log.finish());
    let level73 = file.finish().expect("in memory");

    for bytes in [level5, level73] {
        let columns = ["t_s=log.time", "command_m=log.signals(1).values", "lvdt_m=log.signals(2).values"];
        let record = parse(&bytes, &columns).expect("valid").record;
        let channel = |channel| record.channel(channel).expect("it has one")[5];
        assert_eq!(channel(Channel::Command), reference[5]);
        assert_eq!(channel(Channel::UserPosition), motion()[5]);
        let without =
            |command: &str| message(&bytes, &["t_s=log.time", command, "lvdt_m=log.signals(2).values"]);
        let of_none = without("command_m=log.signals(3).values");
        assert!(of_none.contains("`log.signals(1).values`"), "{of_none}");
        assert!(of_none.contains("`log.signals(2).values`"), "{of_none}");
        let of_all = without("command_m=log.signals.values");
        assert!(of_all.contains("structures, expected a real numeric vector"), "{of_all}");
    }
}

#[test]
fn the_rules_of_a_record_hold() {
    let file = |name: &str, values: &[f64]| {
        let file = Level5::new(false).required();
        let variable = file.column(name, values);
        file.with(&variable).bytes
    };
    let found = message(&file("i", &[1.0; 59]), &["current_mA=i[A]"]);
    assert_eq!(found, "run.mat: variable `i`: found 59 values, expected 60 as in the first series");
    let millimetres: Vec<f64> = motion().iter().map(|value| value * 1e3).collect();
    let found = message(&file("pos", &millimetres), &["lvdt_m=pos"]);
    assert!(found.starts_with("run.mat: variable `pos`, sample 32: found a magnitude of 3.99"), "{found}");
    assert!(
        found.ends_with("it looks like millimetres: convert with `--columns 'lvdt_m=pos[mm]'`"),
        "{found}"
    );
    assert!(parse(&file("pos", &millimetres), &["lvdt_m=pos[mm]"]).is_ok());
    let mut late = times();
    late[7] += 1e-4;
    let found = message(&file("time", &late), &["t_s=time"]);
    assert!(
        found.starts_with("run.mat: variable `time`, sample 8: found a step of 0.001100000 s"),
        "{found}"
    );
    let mut infinite = motion();
    infinite[3] = f64::INFINITY;
    let found = message(&file("pos", &infinite), &["lvdt_m=pos"]);
    assert!(found.starts_with("run.mat: variable `pos`, sample 4: found `inf`, expected a finite number"));
}

#[test]
fn nan_is_a_missing_sample_and_is_reported() {
    let mut lost = motion();
    lost[3] = f64::NAN;
    let bytes = level73(|builder| builder.write_f64("pos", &[SAMPLES, 1], &lost).map(|_| ()));
    let Loaded { record, warnings } = parse(&bytes, &["lvdt_m=pos"]).expect("valid");
    assert_eq!(record.missing_count(Channel::UserPosition), 1);
    assert_eq!(
        warnings,
        [
            "run.mat: variable `pos`: NaN is read as a missing sample",
            "run.mat: variable `pos`: 1 of 60 samples are missing"
        ]
    );
    assert!(
        message(&bytes, &["command_m=pos"]).starts_with("run.mat: variable `pos`, sample 4: found `NaN`")
    );
}

#[test]
fn variables_that_are_no_vectors_are_told_apart() {
    let bytes = level73(|builder| {
        builder.write_f64("matrix", &[30, 2], &motion())?;
        builder.write_char("text", "hello")?;
        Ok(())
    });
    let found = message(&bytes, &["lvdt_m=matrix"]);
    assert_eq!(
        found,
        "run.mat: variable `matrix`: found an array of 30 x 2, of which `matrix(:,1)` is a column, expected a real numeric vector"
    );
    // Where nothing but an array is there, the message says the same.
    let file = Level5::new(false);
    let all = [times(), motion(), motion()].concat();
    let matrix = file.doubles("data", &[SAMPLES as u32, 3], &all);
    let found = message(&file.with(&matrix).bytes, &[]);
    assert_eq!(
        found,
        "run.mat: `t_s`, `command_m`, `lvdt_m` are missing: found `data`; map them: \
         `--columns 't_s=NAME,command_m=NAME,lvdt_m=NAME'`, or give the sampling rate: `--rate HZ`; `data` is an array of \
         60 x 3, of which `data(:,1)` is a column"
    );
    let found = message(&bytes, &["lvdt_m=text"]);
    assert_eq!(found, "run.mat: variable `text`: found text, expected a real numeric vector");
}

#[test]
fn columns_and_rows_of_an_array_are_channels() {
    let columns = [times(), motion(), motion().iter().map(|value| value * 1e3).collect()].concat();
    let rows: Vec<f64> = (0..SAMPLES)
        .flat_map(|sample| (0..3).map(move |part| part * SAMPLES + sample))
        .map(|at| columns[at])
        .collect();
    let file = Level5::new(false);
    let inner = file.structure("log", &[("data", file.doubles("", &[SAMPLES as u32, 3], &columns))]);
    let level5 = file.with(&inner).bytes;
    let level73 = level73(|builder| builder.write_f64("data", &[3, SAMPLES], &rows).map(|_| ()));
    for (bytes, entries) in [
        (&level5, ["t_s=log.data(:,1)", "command_m=log.data(:, 2)", "lvdt_m=log.data(:,3)[mm]"]),
        (&level73, ["t_s=data(1,:)", "command_m=data(2,:)", "lvdt_m=data(3,:)*1e-3"]),
    ] {
        let record = parse(bytes, &entries).expect("valid").record;
        assert_eq!(record.channel(Channel::Command), Some(&motion()[..]));
        let position = record.channel(Channel::UserPosition).expect("required");
        assert!(position.iter().zip(motion()).all(|(found, value)| (found - value).abs() < 1e-15));
        assert_eq!(record.sample_period_s(), 1e-3);
    }
    for part in ["(:,4)", "(61,:)"] {
        assert_eq!(
            message(
                &level5,
                &["t_s=log.data(:,1)", &format!("command_m=log.data{part}"), "lvdt_m=log.data(:,3)[mm]"]
            ),
            format!(
                "run.mat: variable `log.data{part}`: found an array of 60 x 3, which has no such part, expected a real numeric \
                 vector"
            )
        );
    }
    // MATLAB counts from 1.
    assert!(
        message(&level5, &["t_s=log.data(:,0)"])
            .starts_with("run.mat: `t_s=log.data(:,0)`, `command_m`, `lvdt_m` are missing")
    );
}

#[test]
fn a_rate_stands_in_for_the_time() {
    let file = Level5::new(false);
    let (x, y) = (file.column("command_m", &motion()), file.column("lvdt_m", &motion()));
    let bytes = file.with(&x).with(&y).bytes;
    assert_eq!(
        message(&bytes, &[]),
        "run.mat: `t_s` is missing: found `command_m`, `lvdt_m`; map one: `--columns 't_s=NAME'`, or give the sampling rate: \
         `--rate HZ`"
    );
    let options = ReadOptions { sample_rate_hz: Some(2000.0), ..ReadOptions::default() };
    let record = parse_mat("run.mat", &bytes, &options).expect("valid").record;
    assert_eq!(record.sample_period_s(), 5e-4);
}

#[test]
fn import_makes_a_record_that_reads_back() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (mat, csv) = (folder.path().join("run.mat"), folder.path().join("run.csv"));
    std::fs::write(&mat, level73(|_| Ok(()))).expect("written");
    let record = read_mat(&mat).expect("valid").record;
    save_csv(&record, &["from run.mat".to_owned()], &csv).expect("written");
    let text = std::fs::read(&csv).expect("readable");
    let back = parse_csv("run.csv", &text, &ReadOptions::default()).expect("valid").record;
    assert_eq!(back.channels().collect::<Vec<_>>(), record.channels().collect::<Vec<_>>());
}

/// `tests/data/scipy.mat` comes from `SciPy`: `savemat(..., do_compression=True)` of vectors of several classes, a nested
/// structure, text, cells and complex numbers.
#[test]
fn a_file_of_another_program_is_read() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/scipy.mat");
    for entries in [
        &[][..],
        &["lvdt_m=pos_mm[mm]", "command_m=data.inner.ref*0.5"],
        &["lvdt_m=counts*1e-6", "command_m=data.pos"],
    ] {
        let record = read_mat_with(&path, &options(entries)).expect("valid").record;
        let values = record.channel(Channel::UserPosition).expect("required");
        assert!(values.iter().zip(motion()).all(|(a, b)| (a - b).abs() < 1e-6), "{entries:?}");
    }
    let found = |entry: &str| read_mat_with(&path, &options(&[entry])).expect_err("no vector").to_string();
    assert!(found("lvdt_m=z").ends_with("found complex numbers, expected a real numeric vector"));
    assert!(found("lvdt_m=text").ends_with("found text, expected a real numeric vector"));
    assert!(found("lvdt_m=M").contains("found an array of 3 x 4, of which `M(1,:)` is a row, expected"));
}

#[test]
fn damaged_files_are_refused_with_a_reason() {
    let found = message(b"t_s,command_m,lvdt_m\n", &[]);
    assert_eq!(found, "run.mat: cannot be decoded as a MAT file: the file is shorter than a MAT header");
    let found = message(&[b' '; 300], &[]);
    assert!(found.contains("no MAT header of v5 to v7.3"), "{found}");
    let mut cut = Level5::new(false).required().bytes;
    cut.truncate(cut.len() - 9);
    assert_eq!(message(&cut, &[]), "run.mat: cannot be decoded as a MAT file: the file ends too early");
    let missing = read_mat(Path::new("no/such/file.mat")).expect_err("no file");
    assert!(matches!(missing.problem(), Problem::Io(_)));
}
