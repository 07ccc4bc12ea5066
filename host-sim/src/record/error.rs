//! What can be wrong with a record, and the one message that says so.

use std::fmt;

use super::MIN_SAMPLES;
use super::plausible::Suspicion;
use crate::output::plain;

/// Most names that a message lists.
pub(super) const MOST_LISTED: usize = 10;

/// Longest part of a name that a message repeats.
pub(super) const SHOWN_OF_NAME: usize = 60;

/// Why a record was refused: where, what was found, what was expected.
///
/// [`Display`](fmt::Display) gives the whole message, `file:line: column `x` (n): found ..., expected ...`,
/// with the parts that do not apply left out.
#[derive(Debug)]
pub struct RecordError(Box<Report>);

/// The parts of a [`RecordError`].
#[derive(Debug)]
struct Report {
    file: String,
    line: Option<u64>,
    field: Option<Field>,
    sample: Option<usize>,
    problem: Problem,
}

/// Where a series of values came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Field {
    /// A column of a text file.
    Column {
        /// Name in the header.
        name: String,
        /// Number, the first is 1.
        number: usize,
    },
    /// A variable of a MAT file, or the path of a structure's field.
    Variable(String),
    /// A channel that was made in memory.
    Channel(&'static str),
}

impl Field {
    /// Name of the column, the variable or the channel.
    pub fn name(&self) -> &str {
        match self {
            Self::Column { name, .. } | Self::Variable(name) => name,
            Self::Channel(name) => name,
        }
    }
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Column { name, number } => {
                write!(f, "column `{}` ({number})", printable(name, SHOWN_OF_NAME))
            }
            Self::Variable(name) => write!(f, "variable `{}`", printable(name, SHOWN_OF_NAME)),
            Self::Channel(name) => write!(f, "channel `{name}`"),
        }
    }
}

/// What is wrong. Times are in s, values in the unit of the channel.
#[derive(Debug)]
#[non_exhaustive]
pub enum Problem {
    /// The file could not be read.
    Io(std::io::Error),
    /// A file that is no text; what it looks like, in words.
    NotText(&'static str),
    /// A MAT file where a text file was expected.
    MatFile,
    /// No header, or no rows below it.
    Empty,
    /// Numbers in the place of the header.
    NoHeader,
    /// The text could not be split into cells.
    Malformed(String),
    /// Required columns or mapped ones are not there.
    Missing {
        /// What was looked for.
        expected: Vec<String>,
        /// What the file has.
        present: Vec<String>,
        /// A mapping that may be meant.
        hint: Option<String>,
    },
    /// A name occurs twice in the header.
    Duplicate {
        /// Number of the column that has the name already.
        first: usize,
    },
    /// A row whose number of cells is not that of the header.
    UnequalRow {
        /// Cells in this row.
        found: usize,
        /// Cells in the header.
        expected: usize,
    },
    /// A cell that is not a number.
    NotANumber(String),
    /// A number with a decimal comma where commas separate cells.
    DecimalComma(String),
    /// A decimal comma in a file with decimal points, or the other way round.
    MixedDecimals(String),
    /// A comma that is a decimal one or sets thousands apart.
    OpenComma(String),
    /// A time of day or a date in place of a number of seconds.
    ClockTime(String),
    /// A unit under the header that does not suit the column.
    WrongUnit {
        /// As it is written.
        found: String,
        /// What is, in words.
        expected: String,
    },
    /// NaN, an infinity, or a number that overflows.
    NotFinite(String),
    /// A blank cell, or what stands for a missing sample, where none is allowed.
    Blank,
    /// Too few values are left once the blank cells are taken out.
    TooManyBlanks {
        /// Samples without a value.
        blank: usize,
        /// Samples.
        samples: usize,
    },
    /// Fewer samples than [`MIN_SAMPLES`].
    TooFewSamples(usize),
    /// Fewer samples in the segment that is asked for, of a record that has enough.
    ShortSegment {
        /// Samples in the segment.
        found: usize,
        /// Time of the first sample of the record.
        first: f64,
        /// Time of the last one.
        last: f64,
    },
    /// Time stands still or runs backwards.
    TimeNotIncreasing {
        /// Time of the sample before.
        previous: f64,
        /// Time of this sample.
        found: f64,
    },
    /// A step that differs from the others.
    TimeNotUniform {
        /// This step.
        step: f64,
        /// The typical step.
        typical: f64,
    },
    /// A rate that the user states, and the stamps have another.
    OtherRate {
        /// Stated, Hz.
        rate: f64,
        /// The median step.
        median: f64,
    },
    /// Two rows within one sample of the stated rate.
    TwoAtOnce {
        /// Time of the row before.
        previous: f64,
        /// Time of this row.
        found: f64,
        /// Stated, Hz.
        rate: f64,
    },
    /// More rows are lost than can be bridged.
    LongGap {
        /// Rows that are lost.
        lost: usize,
        /// Rows that can be.
        most: usize,
    },
    /// A period that is not a positive finite number.
    BadPeriod(f64),
    /// The position has the same value in every sample.
    ConstantPosition(f64),
    /// A magnitude that points to a wrong unit.
    Implausible(Suspicion),
    /// A series whose length is not that of the others.
    UnequalLength {
        /// Values of this series.
        found: usize,
        /// Values of the first one.
        expected: usize,
    },
    /// A MAT file that cannot be decoded.
    BadMat(String),
    /// A Parquet file that cannot be decoded.
    BadParquet(String),
    /// A variable that is not a real numeric vector.
    NotAVector(String),
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "cannot be read: {error}"),
            Self::NotText(looks_like) => write!(f, "found {looks_like}, expected text: save it as CSV"),
            Self::MatFile => f.write_str("found a MAT file, expected text"),
            Self::Empty => f.write_str("found no data, expected a header line and rows of numbers"),
            Self::NoHeader => f.write_str(
                "found numbers only, expected a header with column names (is it missing, or commented out by a `#`?)",
            ),
            Self::Malformed(what) => write!(f, "cannot be split into cells: {what}"),
            Self::Missing { expected, present, hint } => {
                let are = if expected.len() == 1 { "is" } else { "are" };
                write!(f, "{} {are} missing: found {}", quoted(expected), quoted(present))?;
                hint.iter().try_for_each(|hint| write!(f, "; {hint}"))
            }
            Self::Duplicate { first } => {
                write!(f, "found the name a second time (first in column {first}), expected it once")
            }
            Self::UnequalRow { found, expected } => {
                write!(f, "found {found} cells, expected {expected} as in the header")?;
                if *found == 2 * expected {
                    f.write_str(" (decimal commas? use decimal points, or semicolons between cells)")?;
                }
                Ok(())
            }
            Self::NotANumber(text) => write!(f, "found `{text}`, expected a number"),
            Self::DecimalComma(text) => {
                write!(f, "found `{text}` with a decimal comma, expected a decimal point where commas separate cells")
            }
            Self::MixedDecimals(text) => {
                write!(f, "found `{text}`, expected decimal points or decimal commas, not both")
            }
            Self::OpenComma(text) => write!(
                f,
                "found `{text}`, which is {} or {}, expected decimal points or commas that leave no doubt",
                text.replace(',', "."),
                text.replace(',', "")
            ),
            Self::ClockTime(text) => write!(
                f,
                "found the clock time `{text}`, expected a number of seconds; with a rate, `--rate HZ`, the column is not \
                 needed"
            ),
            Self::WrongUnit { found, expected } => write!(f, "found the unit `{found}`, expected {expected}"),
            Self::NotFinite(text) => {
                write!(f, "found `{text}`, expected a finite number (leave the cell of a lost sample blank)")
            }
            Self::Blank => f.write_str(
                "found a blank cell or NaN, expected a number: only measured columns may have lost samples",
            ),
            Self::TooManyBlanks { blank, samples } => write!(
                f,
                "found no value in {blank} of {samples} samples, expected at least {MIN_SAMPLES} values"
            ),
            Self::TooFewSamples(found) => write!(f, "found {found} samples, expected at least {MIN_SAMPLES}"),
            Self::ShortSegment { found, first, last } => write!(
                f,
                "found {found} samples in the segment, expected at least {MIN_SAMPLES}: the record goes from {} s to {} s",
                in_full(*first),
                in_full(*last)
            ),
            Self::TimeNotIncreasing { previous, found } => {
                write!(f, "found {} s after {} s, expected increasing time", in_full(*found), in_full(*previous))
            }
            Self::TimeNotUniform { step, typical } => write!(
                f,
                "found a step of {step:.9} s where the typical step is {typical:.9} s, \
                 expected uniform sampling (within 1 %); where stamps jitter or rows are lost, `--rate HZ` puts them \
                 on a grid"
            ),
            Self::OtherRate { rate, median } => write!(
                f,
                "found a median step of {median:.9} s, expected {:.9} s of a rate of {rate} Hz",
                rate.recip()
            ),
            Self::TwoAtOnce { previous, found, rate } => write!(
                f,
                "found {} s after {} s, expected one row in each sample of a rate of {rate} Hz",
                in_full(*found),
                in_full(*previous)
            ),
            Self::LongGap { lost, most } => write!(
                f,
                "found a gap of {lost} lost rows, expected at most {most}: cut the record there (`--from`, `--to`)"
            ),
            Self::BadPeriod(period) => {
                write!(f, "found a sampling period of {period} s, expected a positive finite one")
            }
            Self::ConstantPosition(value) => {
                write!(f, "found the same value {} in every sample, expected a position that moves", plain(*value))
            }
            Self::Implausible(suspicion) => suspicion.fmt(f),
            Self::UnequalLength { found, expected } => {
                write!(f, "found {found} values, expected {expected} as in the first series")
            }
            Self::BadParquet(what) => write!(f, "cannot be decoded as a Parquet file: {what}"),
            Self::BadMat(what) => write!(f, "cannot be decoded as a MAT file: {what}"),
            Self::NotAVector(found) => write!(f, "found {found}, expected a real numeric vector"),
        }
    }
}

/// A time, s, without what the factor of its unit leaves behind its nanoseconds.
fn in_full(time: f64) -> f64 {
    (time * 1e9).round() / 1e9
}

/// The names in back quotes, separated by commas.
fn quoted(names: &[String]) -> String {
    if names.is_empty() {
        return "nothing".to_owned();
    }
    listed(names.iter().map(|name| format!("`{}`", printable(name, SHOWN_OF_NAME))))
}

/// The first of some entries, separated by commas, and how many more there are.
pub(super) fn listed(entries: impl ExactSizeIterator<Item = String>) -> String {
    let more = entries.len().saturating_sub(MOST_LISTED);
    let shown = entries.take(MOST_LISTED).collect::<Vec<_>>().join(", ");
    if more == 0 { shown } else { format!("{shown} and {more} more") }
}

/// So many letters of a text, what cannot be printed in its escapes.
pub(super) fn printable(text: &str, most: usize) -> String {
    let mut letters = text.chars();
    let mut shown = String::new();
    for letter in letters.by_ref().take(most) {
        if letter.is_control() || letter == char::REPLACEMENT_CHARACTER {
            shown.extend(letter.escape_default());
        } else {
            shown.push(letter);
        }
    }
    if letters.next().is_some() {
        shown.push_str("...");
    }
    shown
}

impl RecordError {
    /// A problem of the whole of `file` (a path or a label).
    pub fn new(file: &str, problem: Problem) -> Self {
        Self(Box::new(Report { file: file.to_owned(), line: None, field: None, sample: None, problem }))
    }

    /// The error at a line of the file; the first line is 1.
    #[must_use]
    pub fn at_line(mut self, line: u64) -> Self {
        self.0.line = Some(line);
        self
    }

    /// The error in a column or a variable.
    #[must_use]
    pub fn in_field(mut self, field: Field) -> Self {
        self.0.field = Some(field);
        self
    }

    /// The error at a sample of a series that has no lines; the first sample is 1.
    #[must_use]
    pub fn at_sample(mut self, sample: usize) -> Self {
        self.0.sample = Some(sample);
        self
    }

    /// What is wrong.
    pub fn problem(&self) -> &Problem {
        &self.0.problem
    }

    /// The line of the file, the first is 1; `None` where a line is not the place.
    pub fn line(&self) -> Option<u64> {
        self.0.line
    }

    /// The column or variable, where one is to blame.
    pub fn field(&self) -> Option<&Field> {
        self.0.field.as_ref()
    }
}

impl fmt::Display for RecordError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report { file, line, field, sample, problem } = &*self.0;
        f.write_str(file)?;
        line.iter().try_for_each(|line| write!(f, ":{line}"))?;
        f.write_str(": ")?;
        if let Some(field) = field {
            write!(f, "{field}")?;
            sample.iter().try_for_each(|sample| write!(f, ", sample {sample}"))?;
            f.write_str(": ")?;
        }
        problem.fmt(f)
    }
}

impl std::error::Error for RecordError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match &self.0.problem {
            Problem::Io(error) => Some(error),
            _ => None,
        }
    }
}
