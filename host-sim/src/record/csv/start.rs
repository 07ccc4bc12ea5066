//! Where the names of the columns are, in a text file whose first row has none: behind lines of the logger's own, in a
//! comment, as `numpy.savetxt` writes them, or between blanks.

use std::borrow::Cow;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::cells::{is_blank, with_point};
use super::rows::{Rows, declared, line_ends, separator_of};
use crate::record::error::{Problem, RecordError};

/// Lines, but for blank ones, among which the names are looked for.
const LOOKED_AT: usize = 100;

/// The row of the names.
pub(super) struct Start {
    pub(super) names: Vec<String>,
    /// Its line, the first is 1.
    pub(super) line: u64,
    /// Where the next line begins, bytes.
    rest: usize,
    /// What separates the cells below it; none: blanks.
    separator: Option<u8>,
    is_comment: bool,
    /// Is there a row above it?
    is_later: bool,
}

/// A line that is not blank.
struct Line {
    number: u64,
    end: usize,
    is_comment: bool,
    cells: Vec<String>,
    separator: Option<u8>,
}

impl Start {
    /// The first row, if `is_header` knows it for that of the names; else another one, if one is found.
    ///
    /// # Errors
    /// No row at all, or a first one that cannot be split into cells.
    pub(super) fn new(
        file: &str,
        text: &str,
        is_header: impl Fn(&[String]) -> bool,
    ) -> Result<Self, RecordError> {
        let mut rows = Rows::new(file, text);
        let Some((line, row)) = rows.next().transpose()? else {
            return Err(RecordError::new(file, Problem::Empty));
        };
        let names: Vec<String> = row.iter().map(str::to_owned).collect();
        let other = if is_header(&names) { None } else { Self::other(text, is_header) };
        Ok(other.unwrap_or_else(|| Self {
            names,
            line,
            rest: past_line_end(text, rows.read()),
            separator: Some(rows.separator),
            is_comment: false,
            is_later: false,
        }))
    }

    /// The row that `is_header` knows, among the first lines; else a comment that it knows, straight above numbers; else the
    /// one that must be it: the first of those above the first numbers that are as long as they, or the last one.
    fn other(text: &str, is_header: impl Fn(&[String]) -> bool) -> Option<Self> {
        let lines = lines(text);
        let rows: Vec<&Line> = lines.iter().filter(|line| !line.is_comment).collect();
        let of = |line: &Line, separator| Self {
            names: line.cells.clone(),
            line: line.number,
            rest: line.end,
            separator,
            is_comment: line.is_comment,
            is_later: rows.first().is_some_and(|first| first.number < line.number),
        };
        if let Some(line) = rows.iter().find(|line| is_header(&line.cells)) {
            return Some(of(line, line.separator));
        }
        for (index, line) in lines.iter().enumerate().filter(|(_, line)| line.is_comment) {
            if let Some(next) = lines[index..].iter().find(|line| !line.is_comment)
                && next.is_numbers()
                && next.cells.len() == line.cells.len()
                && is_header(&line.cells)
            {
                return Some(of(line, next.separator));
            }
        }
        let first = rows.iter().position(|line| line.is_numbers())?;
        let is_alike = |line: &&&Line| {
            line.cells.len() == rows[first].cells.len() && line.separator == rows[first].separator
        };
        let is_split = |line: &&&Line| line.cells.len() > 1 && line.separator == rows[first].separator;
        let alike = rows[..first].iter().rev().take_while(is_alike).count();
        // Names that are too few or too many are above the numbers all the same.
        let above = alike.max(rows[..first].iter().rev().take(1).filter(is_split).count());
        let line = rows[first - above];
        Some(of(line, line.separator))
    }

    /// The rows below it, and what separates their cells.
    pub(super) fn rows<'a>(&self, text: &'a str) -> (Cow<'a, str>, u8) {
        let rest = &text[self.rest..];
        match self.separator {
            Some(separator) => (Cow::Borrowed(rest), separator),
            None => (Cow::Owned(with_tabs(rest)), b'\t'),
        }
    }

    /// The line after it.
    pub(super) fn next_line(&self, text: &str) -> u64 {
        1 + line_ends(&text.as_bytes()[..self.rest])
    }

    /// What to tell of it.
    pub(super) fn note(&self) -> Option<String> {
        if self.is_comment {
            Some(format!("the names of the columns are those of the comment on line {}", self.line))
        } else if self.is_later {
            Some(format!("the names of the columns are on line {}: what is above it is skipped", self.line))
        } else {
            None
        }
    }
}

impl Line {
    /// Is it a row of a record: numbers, what stands for one that is lost, and perhaps a clock?
    fn is_numbers(&self) -> bool {
        let is_number = |cell: &String| cell.parse::<f64>().is_ok() || with_point(cell).is_some();
        let is_clock = |cell: &str| cell.starts_with(|c: char| c.is_ascii_digit()) && cell.contains(':');
        self.cells.len() > 1
            && self.cells.iter().all(|cell| is_number(cell) || is_blank(cell) || is_clock(cell))
            && self.cells.iter().any(is_number)
    }
}

/// The first lines of a text that are not blank, without one that declares its separator.
fn lines(text: &str) -> Vec<Line> {
    let mut end = 0;
    let all = text.split_inclusive(['\n', '\r']).map(|line| {
        let start = end;
        end += line.len();
        (start, end, line.trim())
    });
    let mut all = all.filter(|(_, _, line)| !line.is_empty()).peekable();
    let of_all = all.peek().and_then(|(_, _, line)| declared(line));
    let all = all.skip(usize::from(of_all.is_some())).take(LOOKED_AT);
    all.map(|(start, end, line)| {
        let is_comment = line.starts_with('#');
        let plain = line.trim_start_matches(['#', ' ', '\t']);
        let separator = of_all.or_else(|| separator_of(plain));
        Line {
            number: 1 + line_ends(&text.as_bytes()[..start]),
            end: past_line_end(text, end),
            is_comment,
            cells: match separator {
                // What is blank at the end of a line may be a cell.
                Some(separator) if !is_comment => {
                    cells(text[start..end].trim_end_matches(['\n', '\r']), separator)
                }
                Some(separator) => cells(plain, separator),
                None => cells(&with_tabs(plain), b'\t'),
            },
            separator,
        }
    })
    .collect()
}

/// The byte after a line end of which this one is the middle, or this one.
fn past_line_end(text: &str, byte: usize) -> usize {
    let is_between = text.as_bytes().get(byte) == Some(&b'\n') && text.as_bytes()[..byte].ends_with(b"\r");
    byte + usize::from(is_between)
}

/// The cells of a line.
fn cells(line: &str, separator: u8) -> Vec<String> {
    let mut reader = ReaderBuilder::new();
    let mut reader =
        reader.delimiter(separator).has_headers(false).trim(Trim::All).from_reader(line.as_bytes());
    let mut row = StringRecord::new();
    // A line that is none gives no cells.
    let _ = reader.read_record(&mut row);
    row.iter().map(str::to_owned).collect()
}

/// A text with a tab in place of the blanks between cells, and none around them.
fn with_tabs(text: &str) -> String {
    let mut tabbed = String::with_capacity(text.len());
    let [mut is_quoted, mut is_gap, mut is_start] = [false, false, true];
    for letter in text.chars() {
        match letter {
            '\n' | '\r' => {
                tabbed.push(letter);
                [is_quoted, is_gap, is_start] = [false, false, true];
            }
            ' ' | '\t' if !is_quoted => is_gap = true,
            letter => {
                if is_gap && !is_start {
                    tabbed.push('\t');
                }
                is_quoted ^= letter == '"';
                [is_gap, is_start] = [false, false];
                tabbed.push(letter);
            }
        }
    }
    tabbed
}
