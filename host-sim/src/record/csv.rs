//! Reads records from text files: a header, one row per sample, `#` for comments.

use std::path::Path;

use csv::StringRecord;
use eha_monitor::channel::Channel;

use super::error::{Field, Problem, RecordError};
use super::header::Header;
use super::mapping::Found;
use super::table::{Series, Table};
use super::time_base::Digits;
use super::{Loaded, ReadOptions};
use cells::{Cells, is_blank, shown, with_point};
use encoding::decode;
use rows::Rows;
use start::Start;

mod cells;
mod encoding;
mod rows;
mod start;
mod unit_row;

/// First bytes of files that are no text.
const MAT_SIGNATURES: [&[u8]; 2] = [b"MATLAB ", b"\x89HDF\r\n\x1a\n"];

/// Reads a record whose columns have the names of the channel table.
///
/// # Errors
///
/// See [`parse_csv`]; a file that cannot be read.
pub fn read_csv(path: &Path) -> Result<Loaded, RecordError> {
    read_csv_with(path, &ReadOptions::default())
}

/// Reads a record from the columns, the rate and the window of `options`.
///
/// # Errors
///
/// See [`parse_csv`]; a file that cannot be read.
pub fn read_csv_with(path: &Path, options: &ReadOptions) -> Result<Loaded, RecordError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| RecordError::new(&name, Problem::Io(error)))?;
    parse_csv(&name, &bytes, options)
}

/// Reads a record from the content of a text file; `file` names it in messages.
///
/// The separator is a comma, a semicolon or a tab, whichever the header has most of, or what a first line `sep=;` says;
/// where it is no comma, numbers may have decimal commas. Where the header has none of them, blanks separate cells. Lines
/// above the names of the columns are skipped; where there are numbers only, a comment above them may have the names. CRLF,
/// quoted cells and blank lines are fine, and so is text in UTF-16 with a byte order mark; what is not UTF-8 is read as
/// Windows-1252, with a warning. A row of units under the header counts for columns of which nothing else says a unit, and
/// may not contradict the name of a channel. Columns that are not used become a warning. A blank cell of a measured column
/// is a missing sample, and so is `NaN` or `NA`.
///
/// # Errors
///
/// [`RecordError`] with line and column: a column that is missing or there twice, a row that is shorter or longer than
/// the header, a cell that is blank, not a number or not finite, and the checks of [`Record`](super::Record)
/// and of its time.
pub fn parse_csv(file: &str, bytes: &[u8], options: &ReadOptions) -> Result<Loaded, RecordError> {
    let (text, encoding) = decode(file, bytes)?;
    let text = text.as_ref();
    let start = Start::new(file, text, |names| Header::new(names.to_vec(), options).is_ok())?;
    let (below, separator) = start.rows(text);
    let mut rows = Rows::from_line(file, &below, start.next_line(text), separator);
    let mut notes: Vec<String> = encoding.into_iter().chain(start.note()).collect();
    let Start { names, line: header_line, .. } = start;
    if names.iter().all(|name| name.parse::<f64>().is_ok()) {
        return Err(RecordError::new(file, Problem::NoHeader).at_line(header_line));
    }
    let header = Header::new(names, options).map_err(|(problem, place)| {
        let error = RecordError::new(file, problem).at_line(header_line);
        match place {
            Some((index, name)) => error.in_field(Field::Column { name, number: index + 1 }),
            None => error,
        }
    })?;
    let unused = header.unused(options);
    let Header { names, mut columns } = header;
    let failed = |line: u64, column: usize, problem: Problem| {
        RecordError::new(file, problem).at_line(line).in_field(field(&names, column))
    };

    let mut cells = Cells::new(separator);
    let mut first = rows.next().transpose()?;
    let units = first.take_if(|(_, row)| unit_row::is_one(&columns, row));
    if units.is_some() {
        first = rows.next().transpose()?;
    }
    // Before its unit is looked at: what is not used may have any.
    if let (Some((_, row)), Some(_)) = (&first, options.sample_rate_hz) {
        notes.extend(leave_out_clock(&mut columns, &names, row));
    }
    if let Some((line, row)) = units {
        let units = unit_row::apply(&mut columns, &names, &row);
        let units = units.map_err(|(column, problem)| failed(line, column, problem))?;
        if !units.is_empty() {
            notes.push(format!("units of line {line}: {}", units.join(", ")));
        }
    }

    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    let mut lines = Vec::new();
    let mut digits = Digits::default();
    for row in first.map(Ok).into_iter().chain(rows) {
        let (line, row) = row?;
        if row.len() != names.len() {
            let problem = Problem::UnequalRow { found: row.len(), expected: names.len() };
            return Err(RecordError::new(file, problem).at_line(line));
        }
        for (column, values) in columns.iter().zip(&mut values) {
            let cell = row.get(column.source).unwrap_or_default();
            let is_time = column.channel == Channel::Time;
            let value = cells.number(cell, (line, column.source)).map_err(|problem| {
                let problem = match problem {
                    Problem::NotANumber(text) if is_time && text.contains(':') => Problem::ClockTime(text),
                    other => other,
                };
                failed(line, column.source, problem)
            })?;
            if is_time && !value.is_nan() {
                digits.add(with_point(cell).as_deref().unwrap_or(cell));
            }
            values.push(value * column.factor);
        }
        lines.push(line);
    }
    if lines.is_empty() {
        return Err(RecordError::new(file, Problem::Empty));
    }
    cells.check().map_err(|((line, column), problem)| failed(line, column, problem))?;
    let time_unit =
        columns.iter().find(|column| column.channel == Channel::Time).map_or(1.0, |time| time.factor);
    let mut table = Table {
        file: file.to_owned(),
        lines: Some(lines),
        resolution: digits.resolution(time_unit),
        series: Vec::new(),
        warnings: Vec::new(),
    };
    for note in unused.into_iter().chain(notes) {
        table.warn(&note);
    }
    table.series = columns
        .iter()
        .zip(values)
        .map(|(Found { channel, source, factor, unit }, values)| Series {
            channel: *channel,
            field: field(&names, *source),
            factor: *factor,
            unit: *unit,
            values,
        })
        .collect();
    table.into_loaded(options)
}

/// Leaves out a column of times that are no numbers, as the first row has it; what to tell of it.
fn leave_out_clock(columns: &mut Vec<Found<usize>>, names: &[String], row: &StringRecord) -> Option<String> {
    let place = columns.iter().position(|column| column.channel == Channel::Time)?;
    let source = columns[place].source;
    let cell = row.get(source).unwrap_or_default();
    if is_blank(cell) || cell.parse::<f64>().is_ok() || with_point(cell).is_some() {
        return None;
    }
    columns.remove(place);
    Some(format!(
        "{}: not used, the rate gives the time: found `{}`, which is no number of seconds",
        field(names, source),
        shown(cell)
    ))
}

/// Do the bytes start as a MAT file does?
pub(super) fn is_mat(bytes: &[u8]) -> bool {
    MAT_SIGNATURES.iter().any(|signature| bytes.starts_with(signature))
}

fn field(names: &[String], index: usize) -> Field {
    Field::Column { name: names.get(index).cloned().unwrap_or_default(), number: index + 1 }
}

#[cfg(test)]
mod tests;
