//! Reads records from MAT files: v5 to v7 and v7.3.

use std::path::Path;

use eha_monitor::channel::{Channel, ChannelRole};

use super::error::{Field, Problem, RecordError};
use super::table::{Series, Table, missing};
use super::time_base::Resolution;
use super::{Loaded, ReadOptions};

mod v5;
mod v73;

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

/// What a name of a MAT file stands for.
#[derive(Clone, Debug, PartialEq)]
enum Variable {
    /// Real numbers.
    Array(Array),
    /// Anything else, in words.
    Other(String),
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
/// A channel is a real numeric vector, a row or a column of any numeric class. NaN in a measured channel is a missing
/// sample, as MAT files have no blank cells; the warnings tell how many.
///
/// # Errors
///
/// [`RecordError`] with the variable: a file that cannot be decoded, a variable that is missing or is not a real numeric
/// vector, lengths that differ, and the checks of [`Record`](super::Record) and of its time.
pub fn parse_mat(file: &str, bytes: &[u8], options: &ReadOptions) -> Result<Loaded, RecordError> {
    let fail = |problem| RecordError::new(file, problem);
    let contents = Contents::decode(bytes).map_err(|what| fail(Problem::BadMat(what)))?;
    let channels = options
        .columns
        .resolve(options.sample_rate_hz.is_some(), &contents.paths(), |path| {
            contents.find(path).map(|variable| (path.to_owned(), variable))
        })
        .map_err(fail)?;
    let mut table = Table {
        file: file.to_owned(),
        lines: None,
        resolution: Resolution::EXACT,
        series: Vec::new(),
        warnings: Vec::new(),
    };
    for found in channels {
        let (path, variable) = found.source;
        let field = Field::Variable(path);
        let array = variable
            .map_err(Problem::BadMat)
            .and_then(vector)
            .map_err(|problem| fail(problem).in_field(field.clone()))?;
        let values: Vec<f64> = array.values.iter().map(|value| value * found.factor).collect();
        if found.channel == Channel::Time && array.single {
            table.resolution = Resolution::of_singles(&values);
        }
        if found.channel.info().role == ChannelRole::Measured && missing(&values) > 0 {
            table.warn(&format!("{field}: NaN is read as a missing sample"));
        }
        table.series.push(Series { channel: found.channel, field, values });
    }
    table.into_loaded(options)
}

/// The array of a variable that is a vector.
fn vector(variable: Variable) -> Result<Array, Problem> {
    match variable {
        Variable::Other(what) => Err(Problem::NotAVector(what)),
        Variable::Array(array) if array.extents.iter().filter(|&&extent| extent != 1).count() <= 1 => {
            Ok(array)
        }
        Variable::Array(array) => {
            let extents: Vec<String> = array.extents.iter().map(ToString::to_string).collect();
            Err(Problem::NotAVector(format!("an array of {}", extents.join(" x "))))
        }
    }
}
