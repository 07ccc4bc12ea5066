//! Reads records from text files: a header, one row per sample, `#` for comments.

use std::path::Path;

use csv::{ReaderBuilder, StringRecord, Trim};
use eha_monitor::channel::Channel;

use super::error::{Field, Problem, RecordError};
use super::header::Header;
use super::mapping::Found;
use super::table::{Series, Table};
use super::time_base::Digits;
use super::{Loaded, ReadOptions};

/// Longest part of a cell that a message repeats.
const QUOTED_CHARACTERS: usize = 40;

/// First bytes of files that are no text.
const MAT_SIGNATURES: [&[u8]; 2] = [b"MATLAB ", b"\x89HDF\r\n\x1a\n"];

/// Byte order mark of UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

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
/// The separator is a comma, a semicolon or a tab, whichever the header has most of. A byte order mark, CRLF,
/// quoted cells and blank lines are fine. Columns that are not used become a warning. A blank cell of a measured
/// column is a missing sample.
///
/// # Errors
///
/// [`RecordError`] with line and column: a column that is missing or there twice, a row that is shorter or longer than
/// the header, a cell that is blank, not a number or not finite, and the checks of [`Record`](super::Record)
/// and of its time.
pub fn parse_csv(file: &str, bytes: &[u8], options: &ReadOptions) -> Result<Loaded, RecordError> {
    let text = decode(file, bytes)?;
    let mut rows = Rows::new(file, text);
    let Some((header_line, row)) = rows.next().transpose()? else {
        return Err(RecordError::new(file, Problem::Empty));
    };
    let names: Vec<String> = row.iter().map(str::to_owned).collect();
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
    let Header { names, columns } = &header;

    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    let mut lines = Vec::new();
    let mut digits = Digits::default();
    for row in rows {
        let (line, row) = row?;
        if row.len() != names.len() {
            let problem = Problem::UnequalRow { found: row.len(), expected: names.len() };
            return Err(RecordError::new(file, problem).at_line(line));
        }
        for (column, values) in columns.iter().zip(&mut values) {
            let cell = row.get(column.source).unwrap_or_default();
            let value = number(cell).map_err(|problem| {
                RecordError::new(file, problem).at_line(line).in_field(field(names, column.source))
            })?;
            if column.channel == Channel::Time && !value.is_nan() {
                digits.add(cell);
            }
            values.push(value * column.factor);
        }
        lines.push(line);
    }
    if lines.is_empty() {
        return Err(RecordError::new(file, Problem::Empty));
    }
    let time_unit =
        columns.iter().find(|column| column.channel == Channel::Time).map_or(1.0, |time| time.factor);
    let mut table = Table {
        file: file.to_owned(),
        lines: Some(lines),
        resolution: digits.resolution(time_unit),
        series: Vec::new(),
        warnings: Vec::new(),
    };
    if let Some(text) = header.unused() {
        table.warn(&text);
    }
    table.series = columns
        .iter()
        .zip(values)
        .map(|(Found { channel, source, .. }, values)| Series {
            channel: *channel,
            field: field(names, *source),
            values,
        })
        .collect();
    table.into_loaded(options)
}

/// Do the bytes start as a MAT file does?
pub(super) fn is_mat(bytes: &[u8]) -> bool {
    MAT_SIGNATURES.iter().any(|signature| bytes.starts_with(signature))
}

/// The text of a file without its byte order mark.
fn decode<'a>(file: &str, bytes: &'a [u8]) -> Result<&'a str, RecordError> {
    if is_mat(bytes) {
        return Err(RecordError::new(file, Problem::MatFile));
    }
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + line_ends(&bytes[..error.valid_up_to()]);
        RecordError::new(file, Problem::NotUtf8).at_line(line)
    })
}

/// The value of a cell; NaN for a blank one.
fn number(cell: &str) -> Result<f64, Problem> {
    if cell.is_empty() {
        return Ok(f64::NAN);
    }
    let shown = || cell.chars().take(QUOTED_CHARACTERS).collect::<String>();
    match cell.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(Problem::NotFinite(shown())),
        Err(_) if cell.matches(',').count() == 1 && cell.replace(',', ".").parse::<f64>().is_ok() => {
            Err(Problem::DecimalComma(shown()))
        }
        Err(_) => Err(Problem::NotANumber(shown())),
    }
}

fn field(names: &[String], index: usize) -> Field {
    Field::Column { name: names.get(index).cloned().unwrap_or_default(), number: index + 1 }
}

/// The rows of a text, each with its line in the file; the first is the header.
struct Rows<'a> {
    file: &'a str,
    text: &'a [u8],
    reader: csv::Reader<&'a [u8]>,
    /// Everything before this byte is counted in `line`.
    counted: usize,
    line: u64,
}

impl<'a> Rows<'a> {
    fn new(file: &'a str, text: &'a str) -> Self {
        let reader = ReaderBuilder::new()
            .delimiter(separator(text))
            .comment(Some(b'#'))
            .has_headers(false)
            .flexible(true)
            .trim(Trim::All)
            .from_reader(text.as_bytes());
        Self { file, text: text.as_bytes(), reader, counted: 0, line: 1 }
    }

    /// The line of the row that the reader found after byte `start`: it passes over blank and comment lines
    /// without a count, so they are counted here.
    fn line_after(&mut self, start: usize) -> u64 {
        let mut start = start.min(self.text.len());
        loop {
            let rest = &self.text[start..];
            start += match rest.first() {
                Some(b'\n' | b'\r') => 1,
                Some(b'#') => rest.iter().position(|&byte| byte == b'\n').unwrap_or(rest.len()),
                _ => break,
            };
        }
        self.line += line_ends(&self.text[self.counted.min(start)..start]);
        self.counted = start;
        self.line
    }
}

impl Iterator for Rows<'_> {
    type Item = Result<(u64, StringRecord), RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut row = StringRecord::new();
        loop {
            let start = usize::try_from(self.reader.position().byte()).unwrap_or(usize::MAX);
            let found = self.reader.read_record(&mut row);
            let line = self.line_after(start);
            match found {
                Ok(false) => return None,
                Ok(true) => {
                    let first = row.get(0).unwrap_or_default();
                    let blank = row.len() == 1 && first.is_empty();
                    if !blank && !first.starts_with('#') {
                        return Some(Ok((line, row)));
                    }
                }
                Err(error) => {
                    let problem = Problem::Malformed(error.to_string());
                    return Some(Err(RecordError::new(self.file, problem).at_line(line)));
                }
            }
        }
    }
}

/// The separator that the header has most of; a comma if it has none.
fn separator(text: &str) -> u8 {
    let header = text
        .lines()
        .map(str::trim)
        .find(|line| !line.is_empty() && !line.starts_with('#'))
        .unwrap_or_default();
    let count = |separator: u8| header.bytes().filter(|&byte| byte == separator).count();
    [b'\t', b';', b','].into_iter().max_by_key(|&separator| count(separator)).unwrap_or(b',')
}

/// How many lines end in a text: by `\n`, `\r\n` or `\r`.
fn line_ends(text: &[u8]) -> u64 {
    let ends = (0..text.len()).filter(|&index| match text[index] {
        b'\n' => true,
        b'\r' => text.get(index + 1) != Some(&b'\n'),
        _ => false,
    });
    ends.count() as u64
}
