//! Ctrl-C: a search ends at its next step, and what it has found so far is the result.

use crate::failure::Failure;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code after an interrupt, as shells count the signal.
pub const EXIT_CODE: u8 = 130;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on, the first Ctrl-C asks searches to end, and a second one ends the program. For verbs that ask
/// [`requested`]; the others are ended by the first.
///
/// # Errors
/// The system does not let the program watch for it.
pub fn watch() -> Result<(), Failure> {
    ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(EXIT_CODE));
        }
    })
    .map_err(Failure::other)
}

/// Was an end asked for?
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// A result that was found before the end of its search is no success.
///
/// # Errors
/// An end was asked for.
pub fn check() -> Result<(), Failure> {
    if requested() {
        return Err(Failure::interrupted("interrupted: the result is what was found so far"));
    }
    Ok(())
}
