//! What was measured, predicted and left, sample by sample, as a CSV or Parquet file.

use crate::failure::Failure;
use crate::fit::Prepared;
use crate::output;
use crate::record::Record;
use crate::table_file::{self, TableKind};
use eha_monitor::channel::{CHANNELS, Channel, ChannelRole};
use eha_monitor::model::state::Outputs;
use std::path::Path;

/// Name of a trace in the output directory.
pub const TRACE_FILE: &str = "trace.csv";

/// The column of the numbers of the records, which are whole.
const RECORD: &str = "record";

/// Columns of equal length, each with its name; NaN is a blank cell, or a null.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    columns: Vec<(String, Vec<f64>)>,
}

impl Trace {
    /// The prediction of a record's position, sample by sample.
    pub fn of_prediction(record: &Record, predicted: &[Outputs<f64>]) -> Self {
        let times = (0..predicted.len()).map(|sample| record.time_s(sample)).collect();
        let positions = predicted.iter().map(|output| output.user).collect();
        let column = |channel: Channel| channel.info().column.to_owned();
        Self { columns: vec![(column(Channel::Time), times), (column(Channel::UserPosition), positions)] }
    }

    /// The trace of records against models, each with a name and its predictions of every record: the number of the
    /// record, its time and inputs, and for each measured channel the value, and what each model predicts of it.
    pub fn new(records: &[Record], prepared: &[Prepared], models: &[(&str, &[Vec<Outputs<f64>>])]) -> Self {
        let mut trace = Self::default();
        let times =
            |record: &Record| (0..record.len()).map(|sample| record.time_s(sample)).collect::<Vec<_>>();
        let numbers =
            records.iter().enumerate().map(|(index, record)| vec![(index + 1) as f64; record.len()]);
        trace.columns.push((RECORD.to_owned(), numbers.flatten().collect()));
        trace
            .columns
            .push((Channel::Time.info().column.to_owned(), records.iter().flat_map(times).collect()));
        let given = |channel: Channel| records.iter().any(|record| record.channel(channel).is_some());
        for info in CHANNELS.iter().filter(|info| info.role == ChannelRole::Input && given(info.channel)) {
            let values = records.iter().flat_map(|record| series(record, info.channel));
            trace.columns.push((info.column.to_owned(), values.collect()));
        }
        for (index, channel) in
            Channel::MEASURED.into_iter().enumerate().filter(|(_, channel)| given(*channel))
        {
            let column = channel.info().column;
            let values = records.iter().flat_map(|record| series(record, channel));
            trace.columns.push((column.to_owned(), values.collect()));
            for (name, predictions) in models {
                let predicted: Vec<f64> = predictions.iter().flatten().map(|o| o.to_array()[index]).collect();
                let compared = prepared.iter().flat_map(|one| {
                    let record = one.as_core();
                    (0..one.len()).map(|sample| record.is_compared(sample)).collect::<Vec<_>>()
                });
                let measured = records.iter().flat_map(|record| series(record, channel));
                let residual =
                    measured.zip(&predicted).zip(compared).map(|((value, predicted), compared)| {
                        if compared { value - predicted } else { f64::NAN }
                    });
                let residual = residual.collect();
                trace.columns.push((format!("{column}_{name}"), predicted));
                trace.columns.push((format!("{column}_{name}_residual"), residual));
            }
        }
        trace
    }

    /// Writes the trace whole or not at all: as Parquet if the name of the file ends so, else as CSV.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let bytes = if TableKind::of(path) == Some(TableKind::Parquet) {
            let columns: Vec<_> =
                self.columns.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
            table_file::parquet(&columns, &[]).map_err(Failure::other)?
        } else {
            self.csv()?
        };
        output::write_file(path, &bytes)
    }

    fn csv(&self) -> Result<Vec<u8>, Failure> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(self.columns.iter().map(|(name, _)| name)).map_err(Failure::other)?;
        let rows = self.columns.first().map_or(0, |(_, values)| values.len());
        for row in 0..rows {
            let cells = self.columns.iter().map(|(name, values)| match values[row] {
                value if value.is_nan() => String::new(),
                number if name == RECORD => number.to_string(),
                value => format!("{value:?}"),
            });
            writer.write_record(cells).map_err(Failure::other)?;
        }
        writer.into_inner().map_err(Failure::other)
    }
}

/// The values of a channel; missing everywhere where the record does not have it.
fn series(record: &Record, channel: Channel) -> Vec<f64> {
    record.channel(channel).map_or_else(|| vec![f64::NAN; record.len()], <[f64]>::to_vec)
}
