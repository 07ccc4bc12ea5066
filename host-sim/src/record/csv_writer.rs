//! Writes records as CSV: comment lines, the header of the channel table, one row per sample.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use eha_monitor::channel::Channel;

use super::Record;

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
    save_atomically(path, |out| write_csv(record, comments, out)).map_err(|error| {
        io::Error::new(error.kind(), format!("{}: cannot be written: {error}", path.display()))
    })
}

fn save_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut tempfile::NamedTempFile>) -> io::Result<()>,
) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".record-").suffix(".tmp");
    // The rights of an ordinary new file, not the private ones of a temporary file.
    #[cfg(unix)]
    let builder = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(folder)?;
    let mut out = BufWriter::new(&mut file);
    write(&mut out)?;
    out.flush()?;
    drop(out);
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() -> io::Result<()> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("run.csv");
        std::fs::write(&path, "old")?;
        let failed = save_atomically(&path, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read_to_string(&path)?, "old");
        assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);
        Ok(())
    }
}
