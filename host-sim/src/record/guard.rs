//! Decoders of libraries that panic on some damaged files.

use super::error::{Problem, RecordError};
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Does this thread run a decoder?
    static IS_DECODING: Cell<bool> = const { Cell::new(false) };
}

/// The hook of the process is changed once: others may read at the same time, or panic for another reason.
static HOOK: Once = Once::new();

/// Runs a decoder; a panic inside it is a file that it cannot decode, and leaves no trace on stderr.
pub(super) fn guarded<T>(
    file: &str,
    problem: fn(String) -> Problem,
    decode: impl FnOnce() -> Result<T, RecordError>,
) -> Result<T, RecordError> {
    HOOK.call_once(|| {
        let hook = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !IS_DECODING.get() {
                hook(info);
            }
        }));
    });
    let before = IS_DECODING.replace(true);
    // What the decoder leaves half done is dropped with it.
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    IS_DECODING.set(before);
    result.unwrap_or_else(|_| Err(RecordError::new(file, problem("the file is damaged".to_owned()))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;
    use std::thread;

    /// In a process of its own: its stderr is looked at by the test below.
    #[test]
    #[ignore = "run by the test of what it prints"]
    fn readers_side_by_side() {
        let reader = || {
            for _ in 0..200 {
                let result = guarded::<()>("a.mat", Problem::BadMat, || panic!("damaged"));
                assert!(matches!(result.expect_err("damaged").problem(), Problem::BadMat(_)));
            }
        };
        thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(reader);
            }
        });
        assert!(thread::spawn(|| panic!("of another kind")).join().is_err());
    }

    #[test]
    fn panics_of_decoders_alone_are_silent() {
        let child = "record::guard::tests::readers_side_by_side";
        let output = Command::new(std::env::current_exe().expect("this program"))
            .args(["--exact", child, "--ignored", "--nocapture"])
            .output()
            .expect("it runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        assert!(!stderr.contains("damaged"), "{stderr}");
        // The control: one that is no decoder's is told.
        assert_eq!(stderr.matches("of another kind").count(), 1, "{stderr}");
    }
}
