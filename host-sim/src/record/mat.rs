//! Reads records from MAT files: v5 to v7 and v7.3.

use std::path::Path;

use eha_monitor::channel::{Channel, ChannelRole};

use super::error::{Field, MOST_LISTED, Problem, RecordError};
use super::table::{Series, Table, missing};
use super::time_base::Resolution;
use super::{Loaded, ReadOptions};

mod v5;
mod v73;

/// Most columns of an array that are offered one by one.
const MOST_OFFERED: usize = 32;

/// A numeric array of a MAT file.
#[derive(Clone, Debug, PartialEq)]
struct Array {
    /// Extents, the number of rows first.
    extents: Vec<usize>,
    /// Column by column.
    values: Vec<f64>,
    /// Stored in single precision?
    single: bool,
}

impl Array {
    /// Has it one extent at most?
    fn is_vector(&self) -> bool {
        self.extents.iter().filter(|&&extent| extent != 1).count() <= 1
    }
}

/// What a name of a MAT file stands for.
#[derive(Clone, Debug, PartialEq)]
enum Variable {
    /// Real numbers.
    Array(Array),
    /// Anything else, in words.
    Other(String),
}

/// A name in a path and, where it is followed by the number of one structure of an array (`signals(2)`), its place, from 0.
fn indexed(name: &str) -> (&str, Option<usize>) {
    let split = || {
        let (name, number) = name.strip_suffix(')')?.split_once('(')?;
        Some((name, number.trim().parse::<usize>().ok()?.checked_sub(1)?))
    };
    split().map_or((name, None), |(name, place)| (name, Some(place)))
}

/// The two families of MAT files, decoded.
enum Contents {
    V5(v5::Variables),
    V73(v73::Variables),
}

impl Contents {
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        if v73::is_hdf5(bytes) {
            v73::Variables::decode(bytes).map(Self::V73)
        } else {
            v5::Variables::decode(bytes).map(Self::V5)
        }
    }

    /// Names of the variables, and the paths of the fields of structures.
    fn paths(&self) -> Vec<String> {
        match self {
            Self::V5(variables) => variables.paths(),
            Self::V73(variables) => variables.paths(),
        }
    }

    /// The names that can be read: vectors, and the columns of arrays.
    fn readable(&self) -> Vec<String> {
        let of_path = |path: String| match self.find(&path) {
            Some(Ok(Variable::Array(array))) if array.is_vector() => vec![path],
            Some(Ok(Variable::Array(Array { extents, .. }))) => match extents[..] {
                [rows, columns] if columns <= rows.min(MOST_OFFERED) => {
                    (1..=columns).map(|column| format!("{path}(:,{column})")).collect()
                }
                _ => Vec::new(),
            },
            _ => Vec::new(),
        };
        self.paths().into_iter().flat_map(of_path).collect()
    }

    /// Channels that are missing, with what of the file is no vector.
    fn with_unread(&self, problem: Problem) -> Problem {
        let Problem::Missing { expected, present, hint } = problem else { return problem };
        let unread = present.iter().filter_map(|path| match self.find(path) {
            Some(Ok(Variable::Other(what))) => Some(format!("`{path}` is {what}, which is not read")),
            Some(Ok(Variable::Array(array))) if !array.is_vector() => {
                Some(format!("`{path}` is {}", with_part(&array.extents, path)))
            }
            _ => None,
        });
        let hints: Vec<String> = hint.into_iter().chain(unread.take(MOST_LISTED)).collect();
        Problem::Missing { expected, present, hint: (!hints.is_empty()).then(|| hints.join("; ")) }
    }

    /// The variable, or the field of a structure, of a path such as `data.pos`.
    fn find(&self, path: &str) -> Option<Result<Variable, String>> {
        match self {
            Self::V5(variables) => variables.find(path).map(Ok),
            Self::V73(variables) => variables.find(path),
        }
    }
}

/// Reads a record whose variables have the names of the channel table.
///
/// # Errors
///
/// See [`parse_mat`]; a file that cannot be read.
pub fn read_mat(path: &Path) -> Result<Loaded, RecordError> {
    read_mat_with(path, &ReadOptions::default())
}

/// Reads a record from the variables, the rate and the window of `options`.
///
/// # Errors
///
/// See [`parse_mat`]; a file that cannot be read.
pub fn read_mat_with(path: &Path, options: &ReadOptions) -> Result<Loaded, RecordError> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| RecordError::new(&name, Problem::Io(error)))?;
    parse_mat(&name, &bytes, options)
}

/// Reads a record from the content of a MAT file (v5 to v7, or v7.3 and other HDF5); `file` names it in messages.
///
/// A channel is a real numeric vector of any numeric class, or a column or a row of an array (`data(:,2)`, `data(2,:)`).
/// NaN in a measured channel is a missing sample, as MAT files have no blank cells; the warnings tell how many.
///
/// # Errors
///
/// [`RecordError`] with the variable: a file that cannot be decoded, a variable that is missing or is not a real numeric
/// vector, lengths that differ, and the checks of [`Record`](super::Record) and of its time.
pub fn parse_mat(file: &str, bytes: &[u8], options: &ReadOptions) -> Result<Loaded, RecordError> {
    let fail = |problem| RecordError::new(file, problem);
    let contents = Contents::decode(bytes).map_err(|what| fail(Problem::BadMat(what)))?;
    let paths = contents.paths();
    let channels = options
        .columns
        .resolve(
            |info| options.wanted(info),
            &paths,
            || contents.readable(),
            |path| {
                let whole = || contents.find(path).map(|variable| (path.to_owned(), variable, None));
                let part = || {
                    let (name, part) = Part::split(path)?;
                    contents.find(name).map(|variable| (path.to_owned(), variable, Some(part)))
                };
                whole().or_else(part)
            },
        )
        .map_err(|problem| fail(contents.with_unread(problem)))?;
    let mut table = Table {
        file: file.to_owned(),
        lines: None,
        resolution: Resolution::EXACT,
        series: Vec::new(),
        warnings: Vec::new(),
    };
    for found in channels {
        let (path, variable, part) = found.source;
        let array = variable.map_err(Problem::BadMat).and_then(|variable| match part {
            Some(part) => part.of(variable),
            None => vector(variable, &path),
        });
        let field = Field::Variable(path);
        let array = array.map_err(|problem| fail(problem).in_field(field.clone()))?;
        let values: Vec<f64> = array.values.iter().map(|value| value * found.factor).collect();
        if found.channel == Channel::Time && array.single {
            table.resolution = Resolution::of_singles(&values);
        }
        if found.channel.info().role == ChannelRole::Measured && missing(&values) > 0 {
            table.warn(&format!("{field}: NaN is read as a missing sample"));
        }
        table.series.push(Series {
            channel: found.channel,
            field,
            factor: found.factor,
            unit: found.unit,
            values,
        });
    }
    table.into_loaded(options)
}

/// A column or a row of an array, from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Column(usize),
    Row(usize),
}

impl Part {
    /// The name of the array and the part of it in a text such as `data(:,2)`, which counts from 1.
    fn split(text: &str) -> Option<(&str, Self)> {
        let (name, part) = text.strip_suffix(')')?.rsplit_once('(')?;
        let (row, column) = part.split_once(',')?;
        let number = |text: &str| text.parse::<usize>().ok()?.checked_sub(1);
        let part = match (row.trim(), column.trim()) {
            (":", column) => Self::Column(number(column)?),
            (row, ":") => Self::Row(number(row)?),
            _ => return None,
        };
        Some((name.trim(), part))
    }

    /// The values of the part.
    fn of(self, variable: Variable) -> Result<Array, Problem> {
        let Array { extents, values, single } = match variable {
            Variable::Array(array) => array,
            Variable::Other(what) => return Err(Problem::NotAVector(what)),
        };
        let values: Option<Vec<f64>> = match (self, &extents[..]) {
            (Self::Column(column), &[rows, columns]) if column < columns => {
                values.chunks(rows.max(1)).nth(column).map(<[f64]>::to_vec)
            }
            (Self::Row(row), &[rows, _]) if row < rows => {
                Some(values.into_iter().skip(row).step_by(rows).collect())
            }
            _ => None,
        };
        match values {
            Some(values) => Ok(Array { extents: vec![values.len(), 1], values, single }),
            None => Err(Problem::NotAVector(format!("{}, which has no such part", in_words(&extents)))),
        }
    }
}

/// The array of a variable that is a vector.
fn vector(variable: Variable, path: &str) -> Result<Array, Problem> {
    match variable {
        Variable::Other(what) => Err(Problem::NotAVector(what)),
        Variable::Array(array) if array.is_vector() => Ok(array),
        Variable::Array(Array { extents, .. }) => Err(Problem::NotAVector(with_part(&extents, path))),
    }
}

/// An array that is no vector, in words, and what names a part of it that is one.
fn with_part(extents: &[usize], path: &str) -> String {
    let part = match *extents {
        [rows, columns] if rows < columns => format!("of which `{path}(1,:)` is a row"),
        [_, _] => format!("of which `{path}(:,1)` is a column"),
        _ => "which is not read".to_owned(),
    };
    format!("{}, {part}", in_words(extents))
}

fn in_words(extents: &[usize]) -> String {
    let extents: Vec<String> = extents.iter().map(ToString::to_string).collect();
    format!("an array of {}", extents.join(" x "))
}
