//! Writes records as CSV: comment lines, the header of the channel table, one row per sample.

use std::io::{self, Write};
use std::path::Path;

use eha_monitor::channel::Channel;

use super::Record;
use crate::whole_file;

/// Writes a record with `comments` above its header, one `#` line for each line of each.
///
/// Every number is the shortest that reads back as the same `f64`; a missing sample is a blank cell.
///
/// # Errors
///
/// Those of `out`.
pub fn write_csv<W: Write>(record: &Record, comments: &[String], mut out: W) -> io::Result<()> {
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(out, "# {line}")?;
    }
    write!(out, "{}", Channel::Time.info().column)?;
    for (channel, _) in record.channels() {
        write!(out, ",{}", channel.info().column)?;
    }
    writeln!(out)?;
    for index in 0..record.len() {
        write!(out, "{}", record.time_s(index))?;
        for (_, values) in record.channels() {
            match values[index] {
                value if value.is_nan() => out.write_all(b",")?,
                // `Debug` keeps very small and very large numbers short.
                value => write!(out, ",{value:?}")?,
            }
        }
        writeln!(out)?;
    }
    out.flush()
}

/// Writes a record to the file `path`, which is either complete or untouched: the text goes to a temporary file
/// beside it, which takes its place at the end.
///
/// # Errors
///
/// A folder that does not exist or cannot be written to, a full disk; the message names `path`.
pub fn save_csv(record: &Record, comments: &[String], path: &Path) -> io::Result<()> {
    whole_file::save(path, |out| write_csv(record, comments, out)).map_err(|error| {
        io::Error::new(error.kind(), format!("{}: cannot be written: {error}", path.display()))
    })
}
