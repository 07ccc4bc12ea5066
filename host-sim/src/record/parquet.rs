//! Reads records from Parquet files: flat columns of numbers; a null is a missing sample. A time that is a timestamp counts
//! from the first sample.

use eha_monitor::channel::Channel;
use std::collections::BTreeSet;
use std::path::Path;

use parquet::basic::{Compression, ConvertedType, LogicalType, TimeUnit, Type as PhysicalType};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ColumnChunkMetaData, KeyValue, ParquetMetaData, RowGroupMetaData};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field as Cell;
use parquet::schema::types::Type;
use serde_json::Value;

use super::error::{Field, Problem, RecordError};
use super::guard::guarded;
use super::header::Header;
use super::mapping::{Found, UnitFrom};
use super::table::{Series, Table};
use super::time_base::Resolution;
use super::units::unit;
use super::{Loaded, ReadOptions};

/// Reads a record from the columns, the rate and the window of `options`.
///
/// # Errors
///
/// [`RecordError`] with the column: a file that cannot be read or decoded, a column that is missing or is not of
/// numbers, and the checks of [`Record`](super::Record) and of its time.
pub fn read_parquet_with(path: &Path, options: &ReadOptions) -> Result<Loaded, RecordError> {
    let file = &path.display().to_string();
    guarded(file, Problem::BadParquet, || decoded(file, path, options))
}

fn decoded(file: &str, path: &Path, options: &ReadOptions) -> Result<Loaded, RecordError> {
    let broken = |error: ParquetError| RecordError::new(file, Problem::BadParquet(error.to_string()));
    let source = std::fs::File::open(path).map_err(|error| RecordError::new(file, Problem::Io(error)))?;
    let reader = SerializedFileReader::new(source).map_err(broken)?;
    let schema = reader.metadata().file_metadata().schema();
    let names: Vec<String> = schema.get_fields().iter().map(|field| field.name().to_owned()).collect();
    let header = Header::new(names, options).map_err(|(problem, place)| {
        let error = RecordError::new(file, problem);
        match place {
            Some((_, name)) => error.in_field(Field::Variable(name)),
            None => error,
        }
    })?;
    let Header { names, columns } = &header;
    let read = needed(schema, columns.iter().map(|column| column.source)).map_err(broken)?;
    check_compressions(reader.metadata(), &read).map_err(|problem| RecordError::new(file, problem))?;
    let place = |column: &Found<usize>| {
        read.get_fields().iter().position(|field| field.name() == schema.get_fields()[column.source].name())
    };
    let places: Vec<usize> = columns.iter().filter_map(place).collect();
    let mut clock = columns.iter().find(|column| column.channel == Channel::Time).and_then(|time| {
        Clock::of(&schema.get_fields()[time.source], reader.metadata().file_metadata().key_value_metadata())
    });
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    for (index, row) in reader.get_row_iter(Some(read)).map_err(broken)?.enumerate() {
        let row = row.map_err(broken)?;
        for ((column, &place), values) in columns.iter().zip(&places).zip(&mut values) {
            let cell = row.get_column_iter().nth(place).map_or(&Cell::Null, |(_, cell)| cell);
            if column.channel == Channel::Time
                && let Some(clock) = &mut clock
                && let Some(count) = count(cell)
            {
                values.push(clock.seconds(count));
                continue;
            }
            let value = number(cell).map_err(|problem| {
                RecordError::new(file, problem)
                    .at_sample(index + 1)
                    .in_field(Field::Variable(names[column.source].clone()))
            })?;
            values.push(value * column.factor);
        }
    }
    if values.first().is_none_or(Vec::is_empty) {
        return Err(RecordError::new(file, Problem::Empty));
    }
    let mut table = Table {
        file: file.to_owned(),
        lines: None,
        resolution: Resolution::EXACT,
        series: Vec::new(),
        warnings: Vec::new(),
    };
    if let Some(text) = header.unused(options) {
        table.warn(&text);
    }
    for (column, values) in columns.iter().zip(values) {
        if column.channel == Channel::Time && is_single(&schema.get_fields()[column.source]) {
            table.resolution = Resolution::of_singles(&values);
        }
        let is_clock = column.channel == Channel::Time && clock.is_some();
        let field = Field::Variable(names[column.source].clone());
        table.series.push(Series {
            channel: column.channel,
            field,
            factor: column.factor,
            unit: if is_clock { UnitFrom::Mapping } else { column.unit },
            values,
        });
    }
    table.into_loaded(options)
}

/// The schema of the columns at these places alone, in the order of the file.
fn needed(schema: &Type, places: impl Iterator<Item = usize>) -> Result<Type, ParquetError> {
    let places: BTreeSet<usize> = places.collect();
    let fields = places.iter().map(|&place| schema.get_fields()[place].clone()).collect();
    Type::group_type_builder(schema.name()).with_fields(fields).build()
}

/// Does a column hold single-precision numbers?
fn is_single(column: &Type) -> bool {
    column.is_primitive() && column.get_physical_type() == PhysicalType::FLOAT
}

/// A column of times that states its own unit, whatever a mapping says of it.
struct Clock {
    /// Its unit, s.
    unit: f64,
    /// Is it a time of a calendar, which is counted from the first sample?
    is_calendar: bool,
    /// The first count.
    first: Option<i64>,
}

impl Clock {
    /// The clock of a column; none where the column does not say that it is one. Parquet has no durations: pandas notes
    /// them in the metadata of the file.
    fn of(column: &Type, metadata: Option<&Vec<KeyValue>>) -> Option<Self> {
        let calendar = |unit: f64| Some(Self { unit, is_calendar: true, first: None });
        if let Some(LogicalType::Timestamp(stamp)) = column.get_basic_info().logical_type_ref() {
            return match stamp.unit {
                TimeUnit::MILLIS => calendar(1e-3),
                TimeUnit::MICROS => calendar(1e-6),
                TimeUnit::NANOS => calendar(1e-9),
            };
        }
        match column.get_basic_info().converted_type() {
            ConvertedType::TIMESTAMP_MILLIS => return calendar(1e-3),
            ConvertedType::TIMESTAMP_MICROS => return calendar(1e-6),
            _ => {}
        }
        let noted = metadata?.iter().find(|entry| entry.key == "pandas")?.value.as_ref()?;
        let noted: Value = serde_json::from_str(noted).ok()?;
        let of_column = |entry: &&Value| entry["field_name"] == column.name();
        let kind = noted["columns"].as_array()?.iter().find(of_column)?["numpy_type"].as_str()?;
        let symbol = kind.strip_prefix("timedelta64[")?.strip_suffix(']')?;
        let unit = unit(symbol).filter(|unit| unit.base == Channel::Time.info().unit)?;
        Some(Self { unit: unit.factor, is_calendar: false, first: None })
    }

    /// The time of a count, s.
    fn seconds(&mut self, count: i64) -> f64 {
        let first = *self.first.get_or_insert(if self.is_calendar { count } else { 0 });
        count.saturating_sub(first) as f64 * self.unit
    }
}

/// The count of a cell of a clock.
fn count(cell: &Cell) -> Option<i64> {
    match cell {
        Cell::Long(count) | Cell::TimestampMillis(count) | Cell::TimestampMicros(count) => Some(*count),
        _ => None,
    }
}

/// Refuses a compression that is not built in, of the columns that are read.
fn check_compressions(metadata: &ParquetMetaData, read: &Type) -> Result<(), Problem> {
    let is_built_in = |compression: &Compression| {
        matches!(
            compression,
            Compression::UNCOMPRESSED | Compression::SNAPPY | Compression::GZIP(_) | Compression::ZSTD(_)
        )
    };
    let columns = metadata.row_groups().iter().flat_map(RowGroupMetaData::columns);
    let is_read = |column: &&ColumnChunkMetaData| {
        let root = column.column_path().parts().first();
        read.get_fields().iter().any(|field| Some(field.name()) == root.map(String::as_str))
    };
    let mut compressions = columns.filter(is_read).map(ColumnChunkMetaData::compression);
    match compressions.find(|compression| !is_built_in(compression)) {
        None => Ok(()),
        Some(found) => {
            let found = format!("{found:?}").to_lowercase();
            let name = found.split('(').next().unwrap_or_default();
            Err(Problem::BadParquet(format!(
                "it is compressed with {name}, expected snappy, gzip, zstd or none: write it anew with one of these"
            )))
        }
    }
}

/// The value of a cell; NaN for a null.
fn number(cell: &Cell) -> Result<f64, Problem> {
    Ok(match cell {
        Cell::Null => f64::NAN,
        Cell::Double(value) => *value,
        Cell::Float(value) => f64::from(*value),
        Cell::Byte(value) => f64::from(*value),
        Cell::Short(value) => f64::from(*value),
        Cell::Int(value) => f64::from(*value),
        Cell::Long(value) => *value as f64,
        Cell::UByte(value) => f64::from(*value),
        Cell::UShort(value) => f64::from(*value),
        Cell::UInt(value) => f64::from(*value),
        Cell::ULong(value) => *value as f64,
        // Its text is the number in full.
        Cell::Decimal(_) => cell.to_string().parse().map_err(|_| Problem::NotANumber(cell.to_string()))?,
        other => return Err(Problem::NotANumber(other.to_string())),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use parquet::data_type::{DoubleType, Int64Type};
    use parquet::file::writer::SerializedFileWriter;
    use parquet::schema::parser::parse_message_type;

    use super::*;
    use crate::record::Mapping;

    /// A file of 60 rows at 1 kHz since a day in 2024, with a clock of so many parts of a second.
    fn file(clock: &str, parts: i64) -> Result<Vec<u8>, ParquetError> {
        let schema = format!(
            "message m {{ REQUIRED INT64 t_s {clock}; REQUIRED DOUBLE command_m; REQUIRED DOUBLE lvdt_m; }}"
        );
        let mut writer =
            SerializedFileWriter::new(Vec::new(), Arc::new(parse_message_type(&schema)?), Arc::default())?;
        let mut group = writer.next_row_group()?;
        let stamps: Vec<i64> = (0..60).map(|row| 1_714_564_800 * parts + row * parts / 1000).collect();
        let motion: Vec<f64> = (0..60).map(|row| 1e-3 * (f64::from(row) * 0.1).sin()).collect();
        let mut is_first = true;
        while let Some(mut column) = group.next_column()? {
            if is_first {
                column.typed::<Int64Type>().write_batch(&stamps, None, None)?;
            } else {
                column.typed::<DoubleType>().write_batch(&motion, None, None)?;
            }
            is_first = false;
            column.close()?;
        }
        group.close()?;
        writer.into_inner()
    }

    #[test]
    fn what_is_not_needed_is_not_read() {
        let schema = parse_message_type(
            "message m { REQUIRED DOUBLE other; REQUIRED DOUBLE lvdt_m; REQUIRED DOUBLE t_s; REQUIRED DOUBLE command_m; }",
        );
        let mut writer =
            SerializedFileWriter::new(Vec::new(), Arc::new(schema.expect("a schema")), Arc::default())
                .expect("a writer");
        let mut group = writer.next_row_group().expect("a group");
        // Times are told from the motion by their place.
        let motion: Vec<f64> = (0..60).map(|row| 1e-3 * (f64::from(row) * 0.1).sin()).collect();
        let times: Vec<f64> = (0..60).map(|row| f64::from(row) * 1e-3).collect();
        for values in [&motion, &motion, &times, &motion] {
            let mut column = group.next_column().expect("a column").expect("one more");
            column.typed::<DoubleType>().write_batch(values, None, None).expect("in memory");
            column.close().expect("in memory");
        }
        group.close().expect("in memory");
        let bytes = writer.into_inner().expect("in memory");
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("run.parquet");
        std::fs::write(&path, &bytes).expect("a file");
        let whole =
            SerializedFileReader::new(std::fs::File::open(&path).expect("a file")).expect("a Parquet file");
        let with_damaged = |column: usize| {
            let (start, length) = whole.metadata().row_group(0).column(column).byte_range();
            let mut damaged = bytes.clone();
            damaged[start as usize..(start + length) as usize].fill(0xff);
            std::fs::write(&path, damaged).expect("a file");
            read_parquet_with(&path, &ReadOptions::default())
        };
        let record = with_damaged(0).expect("only what is not read is damaged").record;
        assert_eq!(record.channel(Channel::UserPosition), Some(motion.as_slice()));
        assert!((record.sample_period_s() - 1e-3).abs() < 1e-12);
        for column in 1..4 {
            assert!(matches!(with_damaged(column).expect_err("needed").problem(), Problem::BadParquet(_)));
        }
    }

    #[test]
    fn a_duration_has_the_unit_that_its_writer_notes() {
        let schema = parse_message_type("message m { REQUIRED INT64 time; }").expect("a schema");
        let seconds = |kind: &str| {
            let note = format!(r#"{{"columns": [{{"field_name": "time", "numpy_type": "{kind}"}}]}}"#);
            let metadata = vec![KeyValue::new("pandas".to_owned(), note)];
            let clock = Clock::of(&schema.get_fields()[0], Some(&metadata));
            clock.map(|mut clock| clock.seconds(2_000_000).round())
        };
        assert_eq!(seconds("timedelta64[us]"), Some(2.0));
        assert_eq!(seconds("timedelta64[ms]"), Some(2000.0));
        assert_eq!(seconds("int64"), None);
    }

    #[test]
    fn decimals_are_numbers() {
        use parquet::data_type::Decimal;
        let value = |digits: i64| number(&Cell::Decimal(Decimal::from_i64(digits, 18, 6))).expect("a number");
        assert_eq!([value(-1500), value(0), value(2_000_000)], [-0.0015, 0.0, 2.0]);
    }

    #[test]
    fn clocks_of_other_programs_are_times() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("run.parquet");
        for (clock, parts, entry) in [
            ("(TIMESTAMP(MILLIS,true))", 1000, None),
            ("(TIMESTAMP(MICROS,false))", 1_000_000, None),
            ("(TIMESTAMP(NANOS,false))", 1_000_000_000, None),
            ("(TIMESTAMP(NANOS,true))", 1_000_000_000, Some("t_s=t_s[ns]")),
            ("", 1000, Some("t_s=t_s[ms]")),
        ] {
            std::fs::write(&path, file(clock, parts).expect("in memory")).expect("a file");
            let columns = Mapping::parse(entry).expect("valid");
            let options = ReadOptions { columns, ..ReadOptions::default() };
            let record = read_parquet_with(&path, &options).expect(clock).record;
            assert!((record.sample_period_s() - 1e-3).abs() < 1e-12, "{clock}: {}", record.sample_period_s());
            let start = if clock.is_empty() { 1_714_564_800.0 } else { 0.0 };
            assert!((record.start_time_s() - start).abs() < 1e-6, "{clock}: {}", record.start_time_s());
        }
    }
}
