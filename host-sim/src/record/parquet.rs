//! Reads records from Parquet files: flat columns of numbers; a null is a missing sample.

use eha_monitor::channel::Channel;
use std::path::Path;

use parquet::basic::Type as PhysicalType;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::{Field as Cell, Row};
use parquet::schema::types::Type;

use super::error::{Field, Problem, RecordError};
use super::guard::guarded;
use super::header::Header;
use super::table::{Series, Table};
use super::time_base::Resolution;
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
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    for (index, row) in reader.get_row_iter(None).map_err(broken)?.enumerate() {
        let row = row.map_err(broken)?;
        for (column, values) in columns.iter().zip(&mut values) {
            let value = number(&row, column.source).map_err(|problem| {
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
    if let Some(text) = header.unused() {
        table.warn(&text);
    }
    for (column, values) in columns.iter().zip(values) {
        if column.channel == Channel::Time && is_single(&schema.get_fields()[column.source]) {
            table.resolution = Resolution::of_singles(&values);
        }
        let field = Field::Variable(names[column.source].clone());
        table.series.push(Series {
            channel: column.channel,
            field,
            factor: column.factor,
            unit: column.unit,
            values,
        });
    }
    table.into_loaded(options)
}

/// Does a column hold single-precision numbers?
fn is_single(column: &Type) -> bool {
    column.is_primitive() && column.get_physical_type() == PhysicalType::FLOAT
}

/// The value of a cell; NaN for a null.
fn number(row: &Row, column: usize) -> Result<f64, Problem> {
    let cell = row.get_column_iter().nth(column).map_or(&Cell::Null, |(_, cell)| cell);
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
        // Clocks: in s.
        Cell::TimestampMillis(value) => *value as f64 * 1e-3,
        Cell::TimestampMicros(value) => *value as f64 * 1e-6,
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
    fn clocks_of_other_programs_are_times() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("run.parquet");
        for (clock, parts, entry) in [
            ("(TIMESTAMP(MILLIS,true))", 1000, None),
            ("(TIMESTAMP(MICROS,false))", 1_000_000, None),
            ("(TIMESTAMP(NANOS,false))", 1_000_000_000, Some("t_s=t_s[ns]")),
            ("", 1000, Some("t_s=t_s[ms]")),
        ] {
            std::fs::write(&path, file(clock, parts).expect("in memory")).expect("a file");
            let columns = Mapping::parse(entry).expect("valid");
            let options = ReadOptions { columns, ..ReadOptions::default() };
            let record = read_parquet_with(&path, &options).expect(clock).record;
            assert!((record.sample_period_s() - 1e-3).abs() < 1e-12, "{clock}: {}", record.sample_period_s());
            assert!((record.start_time_s() - 1_714_564_800.0).abs() < 1e-6, "{clock}");
        }
    }
}
