//! Files that are written whole or not at all. What is no file, a device or a pipe, is written to and stays what it is.

use std::fs::{self, OpenOptions, Permissions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// What a path stands for, links followed.
#[derive(Debug, PartialEq)]
enum Place {
    /// A regular file, or none yet: a temporary file takes its place.
    File(PathBuf),
    /// A device, a pipe, or what a process has open: nothing may take its place.
    Stream,
}

/// Where the links of `path` lead; the last one may lead to a file that is not there yet.
fn place(path: &Path) -> io::Result<Place> {
    // A loop of links fails here, so that the walk along them ends.
    let found = match fs::metadata(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        found => Some(found?),
    };
    match found {
        Some(found) if found.is_dir() => return Err(io::Error::other("it is a directory, expected a file")),
        Some(found) if !found.is_file() => return Ok(Place::Stream),
        _ => {}
    }
    let mut path = path.to_path_buf();
    while fs::symlink_metadata(&path).is_ok_and(|link| link.is_symlink()) {
        let directory = fs::canonicalize(directory_of(&path))?;
        // Such as stdout that goes to a file, `/dev/stdout`: a new file would not be the one that is open.
        if directory.starts_with("/proc") {
            return Ok(Place::Stream);
        }
        path = directory.join(fs::read_link(&path)?);
    }
    Ok(Place::File(path))
}

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The error without the temporary file that a library names in it.
fn unnamed(error: &io::Error) -> io::Error {
    error.kind().into()
}

/// Refuses a file that says by its rights that it is not to be changed: a rename would not ask them. They are looked at
/// themselves, because a privileged user may open any file.
fn replaceable(file: &Path) -> io::Result<()> {
    if fs::metadata(file).is_ok_and(|old| old.permissions().readonly()) {
        let reason = "it is read-only, expected another file or one that may be written to";
        return Err(io::Error::new(ErrorKind::PermissionDenied, reason));
    }
    Ok(())
}

/// The regular file that `path` is or would be, so that two paths to one file are the same; none for a stream, or where
/// no file can be.
pub(crate) fn file_at(path: &Path) -> Option<PathBuf> {
    match place(path) {
        Ok(Place::File(path)) => fs::canonicalize(&path).or_else(|_| std::path::absolute(&path)).ok(),
        Ok(Place::Stream) | Err(_) => None,
    }
}

/// Can a file be written at `path`, in place of the one that is there, its directories made if they are not there? Leaves nothing behind.
///
/// # Errors
/// Why it cannot.
pub(crate) fn check(path: &Path) -> io::Result<()> {
    let at = match place(path) {
        Ok(Place::File(path)) => path,
        Ok(Place::Stream) => return Ok(()),
        // Something on the way is a file: found below.
        Err(error) if error.kind() == ErrorKind::NotADirectory => path.to_path_buf(),
        Err(error) => return Err(error),
    };
    replaceable(&at)?;
    let mut directory = directory_of(&at);
    let found = loop {
        match fs::metadata(directory) {
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                directory = directory_of(directory);
            }
            found => break found?,
        }
    };
    let shown = directory.display();
    if !found.is_dir() {
        return Err(io::Error::other(format!("{shown} is a file, expected a directory")));
    }
    tempfile::tempfile_in(directory).map(drop).map_err(|error| {
        io::Error::new(error.kind(), format!("no file can be made in {shown}: {}", unnamed(&error)))
    })
}

/// Writes to a temporary file beside `path`, which takes its place at the end; what is no file is written to directly.
///
/// # Errors
/// A directory that is not there or cannot be written to, a file that is read-only, a full disk, or what `write` fails with; whatever was at
/// `path` is untouched then.
pub(crate) fn save(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let path = match place(path)? {
        Place::File(path) => path,
        Place::Stream => {
            // What a process has open may be a file that holds something already.
            let mut out = BufWriter::new(OpenOptions::new().append(true).open(path)?);
            write(&mut out)?;
            return out.flush();
        }
    };
    replaceable(&path)?;
    let mut builder = tempfile::Builder::new();
    // The rights of an ordinary new file, as the user's mask allows, not the private ones of a temporary file.
    #[cfg(unix)]
    let builder = builder.permissions(<Permissions as std::os::unix::fs::PermissionsExt>::from_mode(0o666));
    let mut file = builder.tempfile_in(directory_of(&path)).map_err(|error| unnamed(&error))?;
    let mut out = BufWriter::new(file.as_file_mut());
    write(&mut out)?;
    out.flush()?;
    drop(out);
    if let Ok(old) = fs::metadata(&path) {
        file.as_file().set_permissions(old.permissions())?;
    }
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
        fs::write(&path, "old")?;
        let failed = save(&path, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read_to_string(&path)?, "old");
        assert_eq!(fs::read_dir(folder.path())?.count(), 1);
        Ok(())
    }

    #[test]
    fn a_check_leaves_nothing_and_says_what_is_in_the_way() -> io::Result<()> {
        let folder = tempfile::tempdir()?;
        let path = |name: &str| folder.path().join(name);
        check(&path("new/deep/run.csv"))?;
        assert_eq!(fs::read_dir(folder.path())?.count(), 0);
        fs::write(path("file"), "")?;
        let reason = |name: &str| check(&path(name)).expect_err(name).to_string();
        assert!(reason("file/run.csv").ends_with("file is a file, expected a directory"));
        assert!(reason("file/deep/run.csv").ends_with("file is a file, expected a directory"));
        assert_eq!(reason("."), "it is a directory, expected a file");
        Ok(())
    }

    #[test]
    fn a_read_only_file_is_not_replaced() -> io::Result<()> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("run.csv");
        fs::write(&path, "old")?;
        let writable = fs::metadata(&path)?.permissions();
        let mut read_only = writable.clone();
        read_only.set_readonly(true);
        fs::set_permissions(&path, read_only)?;
        let put = || save(&path, |out| out.write_all(b"new"));
        for refused in [check(&path), put()] {
            let error = refused.expect_err("a read-only file");
            assert!(error.to_string().starts_with("it is read-only"), "{error}");
        }
        assert_eq!(fs::read_to_string(&path)?, "old");
        fs::set_permissions(&path, writable)?;
        check(&path)?;
        put()?;
        assert_eq!(fs::read_to_string(&path)?, "new");
        Ok(())
    }

    #[cfg(unix)]
    #[test]
    fn links_and_rights_stay_and_what_is_no_file_is_written_to() -> io::Result<()> {
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
        let folder = tempfile::tempdir()?;
        let path = |name: &str| folder.path().join(name);
        let put = |path: &Path| save(path, |out| out.write_all(b"new"));
        fs::create_dir(path("deep"))?;
        fs::write(path("deep/target"), "old")?;
        fs::set_permissions(path("deep/target"), Permissions::from_mode(0o640))?;
        symlink("deep/target", path("link"))?;
        symlink("link", path("second"))?;
        put(&path("second"))?;
        assert_eq!(fs::read_to_string(path("deep/target"))?, "new");
        assert_eq!(fs::metadata(path("deep/target"))?.permissions().mode() & 0o777, 0o640);
        assert!(fs::symlink_metadata(path("second"))?.is_symlink() && path("link").is_symlink());
        assert_eq!(file_at(&path("second")), file_at(&path("deep/../deep/target")));
        // A link to a file that is still to be made.
        symlink("deep/later", path("dangling"))?;
        put(&path("dangling"))?;
        assert_eq!(fs::read_to_string(path("deep/later"))?, "new");
        assert!(path("dangling").is_symlink());
        // A link to a device.
        symlink("/dev/null", path("null"))?;
        check(&path("null"))?;
        put(&path("null"))?;
        assert!(fs::metadata(path("null"))?.file_type().is_char_device() && path("null").is_symlink());
        assert_eq!((file_at(&path("null")), fs::read_dir(folder.path())?.count()), (None, 5));
        symlink("loop", path("loop"))?;
        assert!(put(&path("loop")).is_err());
        Ok(())
    }
}
