//! Records of an actuator: uniformly sampled channels, read from CSV, MAT or Parquet files and written to CSV.
//!
//! A [`Record`] is checked once, when it is made: whoever holds one holds data that can be identified from.
//! Columns, units and limits are those of [`eha_monitor::channel::CHANNELS`].

use eha_monitor::channel::{CHANNELS, Channel, ChannelInfo, ChannelRole};
use std::fs::File;
use std::io::Read;
use std::path::Path;

mod csv;
mod csv_writer;
mod error;
mod guard;
mod header;
mod mapping;
mod mat;
mod parquet;
pub mod plausible;
mod table;
mod time_base;
pub mod units;

pub use csv::{parse_csv, read_csv, read_csv_with};
pub use csv_writer::{save_csv, write_csv};
pub use error::{Field, Problem, RecordError};
use mapping::Wanted;
pub use mapping::{Mapping, MappingError};
pub use mat::{parse_mat, read_mat, read_mat_with};
pub use parquet::read_parquet_with;

use table::{Series, Table};
pub(crate) use time_base::LONGEST_GAP_S;
use time_base::Resolution;

/// First bytes of a Parquet file.
const PARQUET_SIGNATURE: &[u8] = b"PAR1";

/// What messages call the record on stdin.
const STDIN: &str = "stdin";

/// Fewest samples of a record, and fewest present samples of a measured channel.
pub const MIN_SAMPLES: usize = 50;

/// Channels sampled together at a constant rate.
///
/// Every channel has the same number of values. A missing sample is [`f64::NAN`] and occurs in measured channels only;
/// every other value is finite. There are at least [`MIN_SAMPLES`] samples, the command and the user position
/// are there, and the user position moves.
#[derive(Clone, Debug)]
pub struct Record {
    name: String,
    sample_period_s: f64,
    start_time_s: f64,
    /// In the order of the channel table, without time.
    series: Vec<Series>,
}

/// What to read from a file, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Which column or variable holds which channel.
    pub columns: Mapping,
    /// Sampling rate, Hz, for a file without time, whose first sample is at 0 s then, or for one whose stamps are not
    /// uniform: they are put on a grid, and rows that are lost are missing samples.
    pub sample_rate_hz: Option<f64>,
    /// First time to keep, s. The checks see only what is kept.
    pub from_s: Option<f64>,
    /// Time, s, from which on nothing is kept.
    pub to_s: Option<f64>,
    /// Is the record only flown, not compared? Then its measured channels are not read, and none is needed.
    pub inputs_only: bool,
}

impl ReadOptions {
    /// Is a channel read?
    fn wanted(&self, info: &ChannelInfo) -> Wanted {
        if self.inputs_only && info.role == ChannelRole::Measured {
            Wanted::No
        } else if info.required && !(info.channel == Channel::Time && self.sample_rate_hz.is_some()) {
            Wanted::Must
        } else {
            Wanted::May
        }
    }
}

/// A record, and what the user should know about the file it came from.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The record.
    pub record: Record,
    /// One line each, starting with the file.
    pub warnings: Vec<String>,
}

/// Reads a record from a CSV, MAT or Parquet file, whichever it is by its first bytes or, for MAT, its name. What is no
/// file is read once, as CSV or MAT: a pipe, a device, or stdin, which is `-`.
///
/// # Errors
///
/// Those of [`read_csv_with`], [`read_mat_with`] and [`read_parquet_with`].
pub fn read(path: &Path, options: &ReadOptions) -> Result<Loaded, RecordError> {
    let is_named_mat = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mat"));
    if path.as_os_str() == "-" {
        return read_stream(STDIN, std::io::stdin().lock(), is_named_mat, options);
    }
    let name = path.display().to_string();
    let cannot_read = |error| RecordError::new(&name, Problem::Io(error));
    let file = File::open(path).map_err(cannot_read)?;
    if !file.metadata().map_err(cannot_read)?.is_file() {
        return read_stream(&name, file, is_named_mat, options);
    }
    let mut first = Vec::new();
    file.take(8).read_to_end(&mut first).map_err(cannot_read)?;
    if first.starts_with(PARQUET_SIGNATURE) {
        read_parquet_with(path, options)
    } else if is_named_mat || csv::is_mat(&first) {
        read_mat_with(path, options)
    } else {
        read_csv_with(path, options)
    }
}

/// Reads a record from a text or a MAT file that comes as a stream, whose bytes are there once.
fn read_stream(
    name: &str,
    mut stream: impl Read,
    is_named_mat: bool,
    options: &ReadOptions,
) -> Result<Loaded, RecordError> {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).map_err(|error| RecordError::new(name, Problem::Io(error)))?;
    if is_named_mat || csv::is_mat(&bytes) {
        parse_mat(name, &bytes, options)
    } else {
        parse_csv(name, &bytes, options)
    }
}

impl Record {
    /// A record of `channels`, each with its values in the unit of the channel; the time is not one of them.
    ///
    /// `name` is a path or a label for messages, `sample_period_s` and `start_time_s` are in s.
    ///
    /// # Errors
    ///
    /// A period that is not positive, a required channel that is missing, a channel given twice, lengths that differ,
    /// fewer than [`MIN_SAMPLES`] samples, an infinity, a missing sample in a channel that is not measured,
    /// fewer than [`MIN_SAMPLES`] present values, a magnitude that does not fit the unit (see [`plausible`]),
    /// a user position that never changes.
    pub fn new(
        name: impl Into<String>,
        sample_period_s: f64,
        start_time_s: f64,
        channels: Vec<(Channel, Vec<f64>)>,
    ) -> Result<Self, RecordError> {
        let file = name.into();
        let fail = |problem| Err(RecordError::new(&file, problem));
        if !(sample_period_s.is_finite() && sample_period_s > 0.0) {
            return fail(Problem::BadPeriod(sample_period_s));
        }
        if !start_time_s.is_finite() {
            return fail(Problem::NotFinite(start_time_s.to_string()));
        }
        let present: Vec<String> =
            channels.iter().map(|(channel, _)| channel.info().column.to_owned()).collect();
        for info in CHANNELS {
            let mut places = (0..channels.len()).filter(|&index| channels[index].0 == info.channel);
            let (first, second) = (places.next(), places.next());
            if let (Some(first), Some(_)) = (first, second) {
                let error = RecordError::new(&file, Problem::Duplicate { first: first + 1 });
                return Err(error.in_field(Field::Channel(info.column)));
            }
            if first.is_none() && info.required && info.channel != Channel::Time {
                let expected = vec![info.column.to_owned()];
                return fail(Problem::Missing { expected, present, hint: None });
            }
        }
        let series = channels
            .into_iter()
            .filter(|(channel, _)| *channel != Channel::Time)
            .map(|(channel, values)| Series::in_memory(channel, values))
            .collect();
        let table = Table { file, lines: None, resolution: Resolution::EXACT, series, warnings: Vec::new() };
        table.check()?;
        Ok(Self::of_checked(table.file, sample_period_s, start_time_s, table.series))
    }

    /// A record of series that passed every check.
    fn of_checked(name: String, sample_period_s: f64, start_time_s: f64, mut series: Vec<Series>) -> Self {
        series.sort_by_key(|series| CHANNELS.iter().position(|info| info.channel == series.channel));
        Self { name, sample_period_s, start_time_s, series }
    }

    /// Path of the file, or a label.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Sampling period, s.
    pub fn sample_period_s(&self) -> f64 {
        self.sample_period_s
    }

    /// Time of the first sample, s.
    pub fn start_time_s(&self) -> f64 {
        self.start_time_s
    }

    /// Time of the sample `index`, s; with a whole sampling rate, the double nearest to the decimal number.
    pub fn time_s(&self, index: usize) -> f64 {
        let rate = self.sample_period_s.recip();
        let whole = rate.round();
        let elapsed = if whole > 0.0 && (rate - whole).abs() <= 1e-9 * whole {
            index as f64 / whole
        } else {
            index as f64 * self.sample_period_s
        };
        self.start_time_s + elapsed
    }

    /// Number of samples.
    #[expect(clippy::len_without_is_empty, reason = "a record has at least MIN_SAMPLES samples")]
    pub fn len(&self) -> usize {
        self.series.first().map_or(0, |series| series.values.len())
    }

    /// The values of a channel in its unit, NaN where the sample is missing; `None` if the record does not have it.
    /// The time is not stored: see [`time_s`](Self::time_s).
    pub fn channel(&self, channel: Channel) -> Option<&[f64]> {
        self.channels().find(|(other, _)| *other == channel).map(|(_, values)| values)
    }

    /// The channels of the record, in the order of the channel table, without the time.
    pub fn channels(&self) -> impl Iterator<Item = (Channel, &[f64])> {
        self.series.iter().map(|series| (series.channel, series.values.as_slice()))
    }

    /// How many samples of a channel are missing; 0 if the record does not have the channel.
    pub fn missing_count(&self, channel: Channel) -> usize {
        self.channel(channel).map_or(0, table::missing)
    }

    /// Unit of a channel per unit of the column or variable that it was read from; 1 where it was read from none.
    pub(crate) fn factor(&self, channel: Channel) -> f64 {
        self.source(channel).map_or(1.0, |source| source.factor)
    }

    /// The option that reads channels otherwise than this record did: each from the source of another one, or its own,
    /// with another factor.
    pub(crate) fn columns_option(&self, anew: &[(Channel, Channel, f64)]) -> String {
        let entry = |&(channel, from, factor): &(Channel, Channel, f64)| {
            let name = self.source(from).map_or(from.info().column, |source| source.field.name());
            mapping::entry_with(channel.info(), name, factor)
        };
        mapping::option(&anew.iter().map(entry).collect::<Vec<_>>().join(","))
    }

    fn source(&self, channel: Channel) -> Option<&Series> {
        self.series.iter().find(|series| series.channel == channel)
    }

    /// The record with every sample of its command one sample earlier, the last one repeated.
    #[must_use]
    pub fn with_earlier_command(&self) -> Self {
        let mut record = self.clone();
        for Series { values, .. } in
            record.series.iter_mut().filter(|series| series.channel == Channel::Command)
        {
            let last = values.len() - 1;
            values.copy_within(1.., 0);
            values[last] = values[last - 1];
        }
        record
    }

    /// The same record, some samples lost: `samples` tells which of a channel. A channel keeps its own where fewer than
    /// [`MIN_SAMPLES`] would be left; those of an input are bridged.
    #[must_use]
    pub fn with_lost(&self, samples: impl Fn(Channel) -> Vec<usize>) -> Self {
        let mut record = self.clone();
        for Series { channel, values, .. } in &mut record.series {
            let lost = samples(*channel);
            if values.len() - table::missing(values) >= lost.len() + MIN_SAMPLES {
                for sample in lost {
                    values[sample] = f64::NAN;
                }
                if channel.info().role != ChannelRole::Measured {
                    table::bridge(values);
                }
            }
        }
        record
    }
}

#[cfg(test)]
mod tests;
