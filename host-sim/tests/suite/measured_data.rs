//! Where the measured data are, for the tests that need them.

use std::path::{Path, PathBuf};

/// A file of the folder with measured data; none, with a message, where it is absent. The folder is `shared/data` beside
/// the repository, or what `EHA_DATA` names.
pub(crate) fn file(name: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("EHA_DATA").map_or(beside, PathBuf::from).join(name);
    if !path.exists() {
        eprintln!("skipped: no measured data at {}", path.display());
        return None;
    }
    Some(path)
}
