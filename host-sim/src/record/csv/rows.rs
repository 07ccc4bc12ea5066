//! The rows of a text file: its separator, its comments and blank lines, the line of each row.

use csv::{ReaderBuilder, StringRecord, Trim};

use crate::record::error::{Problem, RecordError};

/// The rows of a text, each with its line in the file; the first is the header.
pub(super) struct Rows<'a> {
    file: &'a str,
    text: &'a [u8],
    pub(super) separator: u8,
    reader: csv::Reader<&'a [u8]>,
    /// Everything before this byte is counted in `line`.
    counted: usize,
    line: u64,
}

impl<'a> Rows<'a> {
    /// The separator is the one that the text declares in a first line `sep=;`, as spreadsheets write it, which is no row
    /// then; else a comma, a semicolon or a tab, whichever the header has most of.
    pub(super) fn new(file: &'a str, text: &'a str) -> Self {
        let line = first_line(text);
        let declared = declared(line);
        let separator = declared.or_else(|| separator_of(line)).unwrap_or(b',');
        let mut rows = Self::from_line(file, text, 1, separator);
        if declared.is_some() {
            rows.next();
        }
        rows
    }

    /// The rows of a text whose first line is this one of the file.
    pub(super) fn from_line(file: &'a str, text: &'a str, line: u64, separator: u8) -> Self {
        let reader = ReaderBuilder::new()
            .delimiter(separator)
            .comment(Some(b'#'))
            .has_headers(false)
            .flexible(true)
            .trim(Trim::All)
            .from_reader(text.as_bytes());
        Self { file, text: text.as_bytes(), separator, reader, counted: 0, line }
    }

    /// How many bytes are read.
    pub(super) fn read(&self) -> usize {
        usize::try_from(self.reader.position().byte()).unwrap_or(usize::MAX).min(self.text.len())
    }

    /// The line of the row that the reader found after byte `start`: it passes over blank and comment lines
    /// without a count, so they are counted here.
    fn line_after(&mut self, start: usize) -> u64 {
        let mut start = start;
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
            let start = self.read();
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

/// The first line that is neither blank nor a comment.
fn first_line(text: &str) -> &str {
    let mut lines = text.lines().map(str::trim);
    lines.find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or_default()
}

/// The separator of a line such as `sep=;`.
pub(super) fn declared(line: &str) -> Option<u8> {
    let line = line.trim_matches('"');
    match line.split_at_checked(4)? {
        (key, separator) if key.eq_ignore_ascii_case("sep=") => match separator.as_bytes() {
            // A tab at the end of a line is gone with the white space.
            [] => Some(b'\t'),
            &[separator] => Some(separator),
            _ => None,
        },
        _ => None,
    }
}

/// The separator that a line has most of, if it has one.
pub(super) fn separator_of(line: &str) -> Option<u8> {
    let count = |separator: &u8| line.bytes().filter(|byte| byte == separator).count();
    [b'\t', b';', b','].into_iter().max_by_key(count).filter(|separator| count(separator) > 0)
}

/// How many lines end in a text: by `\n`, `\r\n` or `\r`.
pub(super) fn line_ends(text: &[u8]) -> u64 {
    let ends = (0..text.len()).filter(|&index| match text[index] {
        b'\n' => true,
        b'\r' => text.get(index + 1) != Some(&b'\n'),
        _ => false,
    });
    ends.count() as u64
}
