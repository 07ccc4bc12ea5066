//! Ctrl-C, or the signal to terminate: a search ends at its next step, and what it has found so far is the result.

use crate::failure::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};

/// Exit code after an interrupt, as shells count the signal.
pub const EXIT_CODE: u8 = 130;

static REQUESTED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// From now on, the first of these signals asks searches to end, and a second one ends the program. For verbs that ask
/// [`requested`]; the others are ended by the first.
///
/// # Errors
/// The system does not let the program watch for them.
pub fn watch() -> Result<(), Failure> {
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal is none that comes after one.
        register_conditional_shutdown(signal, EXIT_CODE.into(), Arc::clone(&REQUESTED))
            .and_then(|_| register(signal, Arc::clone(&REQUESTED)))
            .map_err(Failure::other)?;
    }
    Ok(())
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
