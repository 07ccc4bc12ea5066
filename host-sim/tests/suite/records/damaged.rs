//! Files of every format with random damage: never a panic, and a message that names the file.

use eha_monitor::channel::Channel;
use eha_monitor::random::Random;
use hdf5_pure::mat::{MatBuilder, Options};
use host_sim::record::{ReadOptions, Record, read, save_csv};
use host_sim::trace::Trace;
use parquet::basic::{Compression, GzipLevel, ZstdLevel};
use parquet::data_type::DoubleType;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// Damaged files of each kind.
const TRIALS: u64 = 400;
const SAMPLES: usize = 120;

/// Names of the columns, with their values: the motion has few distinct ones, for the dictionaries of Parquet.
fn columns() -> [(&'static str, Vec<f64>); 3] {
    let times = (0..SAMPLES).map(|k| k as f64 * 1e-3).collect();
    let motion: Vec<f64> = (0..SAMPLES).map(|k| 1e-3 * (k % 9) as f64).collect();
    [("t_s", times), ("command_m", motion.clone()), ("lvdt_m", motion)]
}

fn record() -> Record {
    let [_, (_, command), (_, position)] = columns();
    Record::new("whole", 1e-3, 0.0, vec![(Channel::Command, command), (Channel::UserPosition, position)])
        .expect("a record")
}

fn mat_v73() -> Vec<u8> {
    let mut builder = MatBuilder::new(Options::default());
    for (name, values) in columns() {
        builder.write_f64(name, &[SAMPLES, 1], &values).expect("a variable");
    }
    builder.finish().expect("in memory")
}

fn parquet(compression: Compression) -> Vec<u8> {
    let schema = "message m { REQUIRED DOUBLE t_s; REQUIRED DOUBLE command_m; REQUIRED DOUBLE lvdt_m; }";
    let schema = Arc::new(parse_message_type(schema).expect("a schema"));
    let properties = WriterProperties::builder().set_compression(compression).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties)).expect("in memory");
    let mut group = writer.next_row_group().expect("a group");
    for (_, values) in columns() {
        let mut column = group.next_column().expect("in memory").expect("a column");
        column.typed::<DoubleType>().write_batch(&values, None, None).expect("in memory");
        column.close().expect("in memory");
    }
    group.close().expect("in memory");
    writer.into_inner().expect("in memory")
}

/// A place in a file: one in two within the last 300 bytes, where some formats keep what describes the rest.
fn place(bytes: &[u8], random: &mut Random) -> usize {
    let near_the_end = bytes.len().min(300);
    match random.below(2) {
        0 => bytes.len() - 1 - random.below(near_the_end),
        _ => random.below(bytes.len()),
    }
}

fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        if bytes.is_empty() {
            return;
        }
        let at = place(bytes, random);
        let end = bytes.len().min(at + 1 + random.below(16));
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 => bytes[at..end].iter_mut().for_each(|byte| *byte = random.below(256) as u8),
            3 => bytes[at..end].fill(if random.below(2) == 0 { 0 } else { 0xff }),
            4 => drop(bytes.drain(at..end)),
            _ => bytes.truncate(at),
        }
    }
}

/// Reads a file, which must be a record or be refused with its name; true where it is refused.
fn is_refused(path: &Path) -> bool {
    let name = path.display().to_string();
    match read(path, &ReadOptions::default()) {
        Ok(_) => false,
        Err(error) => {
            let message = error.to_string();
            assert!(message.starts_with(&name), "{message}");
            true
        }
    }
}

#[test]
fn random_damage_never_panics_and_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a directory");
    let file = |name: &str| folder.path().join(name);
    save_csv(&record(), &[], &file("whole.csv")).expect("a file");
    Trace::new(&[record()], &[], &[]).save(&file("trace.parquet")).expect("a file");
    fs::write(file("v73.mat"), mat_v73()).expect("a file");
    fs::write(file("plain.parquet"), parquet(Compression::UNCOMPRESSED)).expect("a file");
    fs::write(file("snappy.parquet"), parquet(Compression::SNAPPY)).expect("a file");
    fs::write(file("zstd.parquet"), parquet(Compression::ZSTD(ZstdLevel::default()))).expect("a file");
    fs::write(file("gzip.parquet"), parquet(Compression::GZIP(GzipLevel::default()))).expect("a file");
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    for name in ["scipy.mat", "scipy_plain.mat"] {
        fs::copy(fixtures.join(name), file(name)).expect("a copy");
    }
    let mut names: Vec<_> = fs::read_dir(folder.path())
        .expect("a directory")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    names.sort();
    assert_eq!(names.len(), 9);
    for path in names {
        assert!(!is_refused(&path), "{} is whole", path.display());
        let whole = fs::read(&path).expect("a file");
        let refused = (0..TRIALS)
            .filter(|&trial| {
                let mut bytes = whole.clone();
                damage(&mut bytes, &mut Random::new(trial));
                fs::write(&path, &bytes).expect("a file");
                is_refused(&path)
            })
            .count() as u64;
        println!("{}: {refused} of {TRIALS} refused", path.display());
        assert!(refused > TRIALS / 4, "{}: only {refused} refused", path.display());
    }
}

#[test]
fn bytes_that_only_begin_as_a_format_does_are_refused() {
    let folder = tempfile::tempdir().expect("a directory");
    let mut random = Random::new(3);
    for (name, start) in [
        ("noise.parquet", &b"PAR1"[..]),
        ("noise.mat", b"MATLAB 5.0 MAT-file"),
        ("hdf5.mat", b"\x89HDF\r\n\x1a\n"),
        ("noise.csv", b"t_s,command_m,lvdt_m\n"),
    ] {
        let path = folder.path().join(name);
        for length in 0..TRIALS as usize {
            let mut bytes = start.to_vec();
            bytes.extend((0..length).map(|_| random.below(256) as u8));
            if name.ends_with("parquet") {
                bytes.extend_from_slice(&(length as u32 / 2).to_le_bytes());
                bytes.extend_from_slice(b"PAR1");
            }
            fs::write(&path, &bytes).expect("a file");
            assert!(is_refused(&path), "{name}, {length}");
        }
    }
}
