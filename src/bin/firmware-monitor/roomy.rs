//! Negative control of the budget of the monitor's state: a stepper that has more with it than the budget leaves room for.

use eha_monitor::integrate::observed::{Observed, Observer};

/// More than the state leaves free, words.
const WORDS: usize = 256;

/// Room.
pub(crate) struct Room([u32; WORDS]);

impl Room {
    pub(crate) const NEW: Self = Self([0; WORDS]);
}

impl Observer for Room {
    fn begins(&self) {
        core::hint::black_box(&self.0);
    }
}

/// A stepper with room around it.
pub(crate) type Roomy<S> = Observed<S, Room>;
