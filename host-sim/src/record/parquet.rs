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
        table.series.push(Series { channel: column.channel, field, values });
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
        other => return Err(Problem::NotANumber(other.to_string())),
    })
}
