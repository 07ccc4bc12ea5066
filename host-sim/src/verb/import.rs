//! `import`: MAT, Parquet and foreign CSV files to records.

use super::InputOptions;
use super::files::Files;
use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::table_file::table_path_or_stdout;
use serde_json::json;
use std::path::PathBuf;

/// Options of `import`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// MAT file (v5, v7.3), Parquet or CSV file.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Where to write the record (CSV, or Parquet if it ends so); `record.csv` in the directory of `--out` by default,
    /// else stdout (`-`).
    #[arg(long, short, value_name = "REC.csv|.parquet", value_parser = table_path_or_stdout())]
    output: Option<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
}

/// Runs the verb.
///
/// # Errors
/// Usage: a wrong column mapping. Data: the file is not a record.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let path = output::record_path(common, options.output.as_deref());
    Files::new(common).reads(std::slice::from_ref(&options.file)).writes(path.clone()).check()?;
    let record = options.input.read(common, std::slice::from_ref(&options.file))?.remove(0);
    let comments =
        [format!("imported from {} by host-sim {}", options.file.display(), env!("CARGO_PKG_VERSION"))];
    let config = json!({ "file": options.file.display().to_string(), "reading": options.input.json() });
    output::record(common, &record, &comments, path.as_deref(), config)
}
