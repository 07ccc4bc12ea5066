//! Decoders of libraries that panic on some damaged files.

use super::error::{Problem, RecordError};
use std::panic::{self, AssertUnwindSafe};

/// Runs a decoder; a panic inside it is a file that it cannot decode, and leaves no trace on stderr.
pub(super) fn guarded<T>(
    file: &str,
    problem: fn(String) -> Problem,
    decode: impl FnOnce() -> Result<T, RecordError>,
) -> Result<T, RecordError> {
    let hook = panic::take_hook();
    panic::set_hook(Box::new(|_| {}));
    // What the decoder leaves half done is dropped with it.
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    panic::set_hook(hook);
    result.unwrap_or_else(|_| Err(RecordError::new(file, problem("the file is damaged".to_owned()))))
}
