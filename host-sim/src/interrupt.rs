//! Ctrl-C, or the signal to terminate: a search ends at its next step, and what it has found so far is the result.
//!
//! Work of many steps, of which half is worth nothing, is left where it is (see [`leave`]).

use crate::cli::Common;
use crate::failure::Failure;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::{IsTerminal as _, Write as _, stderr};
use std::panic::{self, AssertUnwindSafe};
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Exit code after an interrupt, as shells count the signal.
pub const EXIT_CODE: u8 = 130;

/// Within this time after the first signal, another one is the same: `timeout` sends its own to the program and then to all
/// that it started, the program among them.
const SAME_SIGNAL: Duration = Duration::from_millis(300);

/// What a person at a terminal is told at the first signal: over the line that a progress bar draws.
const ENDING: &str = "\r\x1b[2Kending with what was found so far; another Ctrl-C ends it at once";

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on, the first of these signals asks searches to end, and one that comes later ends the program. For verbs that
/// ask [`requested`]; the others are ended by the first. A terminal is told at the first, if the user wants any messages.
///
/// # Errors
/// The system does not let the program watch for them.
pub fn watch(common: &Common) -> Result<(), Failure> {
    let is_told = !common.quiet && stderr().is_terminal();
    let mut signals = Signals::new([SIGINT, SIGTERM]).map_err(Failure::other)?;
    thread::spawn(move || {
        let mut first = None;
        for _ in signals.forever() {
            if !REQUESTED.swap(true, Ordering::Relaxed) && is_told {
                // Whether it gets there or not, the program is ending.
                let _ = writeln!(stderr(), "{ENDING}");
            }
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

/// Why work unwinds: it was left.
struct Left;

/// Leaves the work that [`unless_left`] does: it unwinds from here, whichever of its threads this is.
pub fn leave() -> ! {
    panic::resume_unwind(Box::new(Left))
}

/// Does some work; none where it was left. What it has kept elsewhere by then is all that there is of it.
pub fn unless_left<T>(work: impl FnOnce() -> T) -> Option<T> {
    match panic::catch_unwind(AssertUnwindSafe(work)) {
        Ok(done) => Some(done),
        Err(reason) if reason.is::<Left>() => None,
        Err(reason) => panic::resume_unwind(reason),
    }
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

#[cfg(test)]
mod tests {
    use super::{leave, unless_left};
    use rayon::prelude::*;

    #[test]
    fn work_is_left_from_whichever_thread_and_a_panic_is_none_of_that() {
        let work = |left: Option<usize>| -> Option<usize> {
            let one = |index: usize| if left == Some(index) { leave() } else { index };
            unless_left(|| (0..100).into_par_iter().map(one).sum())
        };
        assert_eq!(work(None), Some(4950));
        assert_eq!(work(Some(70)), None);
        let panicked =
            std::panic::catch_unwind(|| unless_left(|| std::panic::resume_unwind(Box::new("broken"))));
        assert!(panicked.is_err());
    }
}
