//! Ctrl-C, or the signal to terminate: a search ends at its next step, and what it has found so far is the result.

use crate::failure::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Exit code after an interrupt, as shells count the signal.
pub const EXIT_CODE: u8 = 130;

/// Within this time after the first signal, another one is the same: `timeout` sends its own to the program and then to all
/// that it started, the program among them.
const SAME_SIGNAL: Duration = Duration::from_millis(300);

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on, the first of these signals asks searches to end, and one that comes later ends the program. For verbs that
/// ask [`requested`]; the others are ended by the first.
///
/// # Errors
/// The system does not let the program watch for them.
pub fn watch() -> Result<(), Failure> {
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Failure::other)?;
    thread::spawn(move || {
        let mut first = None;
        for _ in signals.forever() {
            REQUESTED.store(true, Ordering::Relaxed);
            if first.get_or_insert_with(Instant::now).elapsed() > SAME_SIGNAL {
                process::exit(EXIT_CODE.into());
            }
        }
    });
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
