//! The backlash operator `play(u, state, h)`: the output rests while the input moves within its gap.

use crate::scalar::Real;

/// Moves the output of a play of half width `half` to where the input `input` pushes it.
///
/// Rate-independent: only the turning points of the input matter.
#[inline(always)]
pub fn play<T: Real>(input: T, output: T, half: T) -> T {
    output.larger(input - half).smaller(input + half)
}

/// The output of a play that is in contact on one side (`side` = 1: input at the upper edge of the gap).
#[inline(always)]
pub fn in_contact<T: Real>(input: T, side: T, half: T) -> T {
    input - side * half
}
