//! Negative controls of the memory budgets: each takes what overruns one of them. A plain image has none.

/// More than what any budget of memory leaves free, words.
#[cfg(any(
    feature = "negative-control-stack",
    all(feature = "negative-control-ram", not(feature = "any-rig")),
    feature = "negative-control-flash"
))]
const WORDS: usize = 6 << 10;

/// Takes what the features of this image ask for.
pub(crate) fn take() {
    #[cfg(feature = "negative-control-stack")]
    stack();
    #[cfg(all(feature = "negative-control-ram", not(feature = "any-rig")))]
    ram();
    #[cfg(feature = "negative-control-flash")]
    flash();
}

/// A large frame, of which its far end is used.
#[cfg(feature = "negative-control-stack")]
#[inline(never)]
#[expect(clippy::large_stack_arrays, reason = "the overrun that the budget of the stack is to see")]
fn stack() {
    use core::mem::MaybeUninit;
    let mut frame = [const { MaybeUninit::<u32>::uninit() }; WORDS];
    frame[0].write(0);
    core::hint::black_box(&mut frame);
}

/// A large variable. Beside the monitor for every rig there is no place for it: its room overruns that budget alone.
#[cfg(all(feature = "negative-control-ram", not(feature = "any-rig")))]
fn ram() {
    use core::sync::atomic::AtomicU32;
    static BUFFER: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
    core::hint::black_box(&BUFFER);
}

/// A large table.
#[cfg(feature = "negative-control-flash")]
fn flash() {
    static TABLE: [u32; WORDS] = {
        let mut table = [0; WORDS];
        let mut index = 0;
        while index < WORDS {
            table[index] = index as u32;
            index += 1;
        }
        table
    };
    core::hint::black_box(&TABLE);
}
