//! Files with samples in columns that the program writes: CSV or Parquet, as their names end.

use crate::cli::written_path;
use clap::builder::TypedValueParser;
use parquet::data_type::DoubleType;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What a file of samples is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TableKind {
    /// Text, one row a sample.
    Csv,
    /// Apache Parquet.
    Parquet,
}

impl TableKind {
    /// The kind of a file, by the end of its name; a name without one, such as that of a device, is text.
    pub(crate) fn of(path: &Path) -> Option<Self> {
        match path.extension() {
            None => Some(Self::Csv),
            Some(end) if end.eq_ignore_ascii_case("csv") => Some(Self::Csv),
            Some(end) if end.eq_ignore_ascii_case("parquet") => Some(Self::Parquet),
            Some(_) => None,
        }
    }
}

/// The path of a file of samples beside the result, of a kind that can be written.
pub(crate) fn table_path() -> impl TypedValueParser<Value = PathBuf> {
    written_path().try_map(of_known_kind)
}

/// As [`table_path`], of a file that is the result: `-` is stdout.
pub(crate) fn table_path_or_stdout() -> impl TypedValueParser<Value = PathBuf> {
    clap::builder::PathBufValueParser::new().try_map(of_known_kind)
}

fn of_known_kind(path: PathBuf) -> Result<PathBuf, &'static str> {
    match TableKind::of(&path) {
        Some(_) => Ok(path),
        None => Err("samples are written as .csv or .parquet, expected a name that ends so"),
    }
}

/// Columns of equal length, each with its name, as a Parquet file; NaN is a null. The comments are in its metadata.
pub(crate) fn parquet(columns: &[(&str, &[f64])], comments: &[String]) -> Result<Vec<u8>, ParquetError> {
    let fields: Vec<String> = columns.iter().map(|(name, _)| format!("OPTIONAL DOUBLE {name};")).collect();
    let schema = Arc::new(parse_message_type(&format!("message samples {{ {} }}", fields.join(" ")))?);
    let comments = comments.iter().map(|line| KeyValue::new("comment".to_owned(), line.clone())).collect();
    let properties = WriterProperties::builder().set_key_value_metadata(Some(comments)).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (_, values) in columns {
        let Some(mut column) = group.next_column()? else { break };
        let present: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
        let levels: Vec<i16> = values.iter().map(|value| i16::from(!value.is_nan())).collect();
        column.typed::<DoubleType>().write_batch(&present, Some(&levels), None)?;
        column.close()?;
    }
    group.close()?;
    writer.into_inner()
}
