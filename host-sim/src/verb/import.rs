//! `import`: MAT and foreign CSV files to records.

use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::record::{Mapping, ReadOptions, read_csv_with, read_mat_with};
use serde_json::json;
use std::path::PathBuf;

/// Options of `import`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// MAT file (v5, v7.3) or CSV file.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Where to write the record; `record.csv` in the directory of `--out` by default, else stdout.
    #[arg(long, short, value_name = "REC.csv")]
    output: Option<PathBuf>,
    /// Which variable is which channel, in which unit: `lvdt_m=pos[mm],command_m=ref[mm]`.
    #[arg(long, value_delimiter = ',', value_name = "CHANNEL=VARIABLE[UNIT]")]
    columns: Vec<String>,
    /// Sampling rate, Hz, where the file has no time.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// First time to keep, s.
    #[arg(long, value_name = "S")]
    from: Option<f64>,
    /// Time from which on nothing is kept, s.
    #[arg(long, value_name = "S")]
    to: Option<f64>,
}

/// Runs the verb.
///
/// # Errors
/// Usage: a wrong column mapping. Data: the file is not a record.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let columns = Mapping::parse(options.columns.iter().map(String::as_str)).map_err(Failure::usage)?;
    let read = ReadOptions { columns, sample_rate_hz: options.rate, from_s: options.from, to_s: options.to };
    let is_mat = options.file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mat"));
    let loaded =
        if is_mat { read_mat_with(&options.file, &read)? } else { read_csv_with(&options.file, &read)? };
    for warning in &loaded.warnings {
        output::log(common, &format!("warning: {warning}"));
    }
    let comments =
        [format!("imported from {} by host-sim {}", options.file.display(), env!("CARGO_PKG_VERSION"))];
    let path = options.output.clone().or_else(|| output::out_path(common, output::RECORD_FILE));
    let config = json!({ "file": options.file.display().to_string(), "columns": options.columns });
    output::record(common, &loaded.record, &comments, path.as_deref(), config)
}
