//! Cost of a piece of code, from the system timer.
//!
//! Under QEMU with `-icount shift=6` every instruction takes 64 ns of the board's time and the system timer of the
//! mps2 boards ticks every 40 ns (25 MHz): the count is one of instructions, exact and repeatable, and says nothing
//! of cycles. On the real part the timer runs at the core's clock and counts cycles.

use core::{
    hint::black_box,
    sync::atomic::{AtomicU32, Ordering},
};
use cortex_m::peripheral::{SYST, syst::SystClkSource};

/// What the counter counts.
const UNIT: &str = if cfg!(feature = "board-stm32h743") { "cycles" } else { "instructions" };

/// Counts per tick of the timer, as a fraction: 40 ns a tick over 64 ns an instruction, or a cycle a tick.
const COUNTS_PER_TICK: (u64, u64) = if cfg!(feature = "board-stm32h743") { (1, 1) } else { (40, 64) };

/// Largest value of the 24-bit timer. It counts down from here, so a wrap is this plus one ticks.
const RELOAD: u32 = 0x00ff_ffff;

/// Wraps of the timer since it was started: one every 0.67 s at 25 MHz, so 32 bits outlast any run.
static WRAPS: AtomicU32 = AtomicU32::new(0);

/// Counts the wraps: 24 bits last for 10 million instructions only. Its own cost, 8 instructions a wrap, is part
/// of what is measured.
#[cortex_m_rt::exception]
fn SysTick() {
    WRAPS.store(WRAPS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Reports the cost of a piece of work.
pub(crate) fn report(group: &str, name: &str, cost: u64) {
    defmt::println!("measure {=str}.{=str}.{=str}={=u64}", group, name, UNIT, cost);
}

/// A running count of instructions (emulated boards) or cycles (real part).
pub(crate) struct Counter {
    timer: SYST,
    /// Ticks between two readings with nothing between them.
    overhead: u64,
}

impl Counter {
    /// Starts the timer, which is this counter's from now on.
    pub(crate) fn new(mut timer: SYST) -> Self {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload(RELOAD);
        timer.clear_current();
        timer.enable_interrupt();
        timer.enable_counter();
        let mut counter = Self { timer, overhead: 0 };
        let start = counter.now();
        counter.overhead = counter.now().wrapping_sub(start);
        counter
    }

    /// Ticks since the start.
    #[inline(never)]
    fn now(&self) -> u64 {
        // A wrap between the two readings of its count would give the new timer value with the old count.
        loop {
            let wraps = WRAPS.load(Ordering::Relaxed);
            let ticks = RELOAD - (self.timer.cvr.read() & RELOAD);
            if WRAPS.load(Ordering::Relaxed) == wraps {
                return (u64::from(wraps) << 24) + u64::from(ticks);
            }
        }
    }

    /// Runs `work` once; what it gives, and what it cost.
    pub(crate) fn cost_of<T>(&self, work: impl FnOnce() -> T) -> (T, u64) {
        // The black boxes keep the compiler from moving the work out of the measured interval.
        let work = black_box(work);
        let start = self.now();
        let value = black_box(work());
        if cfg!(feature = "negative-control-slow") {
            // Everything takes twice as long, and short work a thousand instructions more.
            let wait = self.since(start).saturating_add(1000);
            cortex_m::asm::delay(u32::try_from(wait).unwrap_or(u32::MAX));
        }
        (value, self.since(start))
    }

    /// Instructions (cycles on the real part) since `start`, without the cost of reading the timer.
    fn since(&self, start: u64) -> u64 {
        let ticks = self.now().saturating_sub(start).saturating_sub(self.overhead);
        // A tick is shorter than an instruction: each reading is exact to one instruction.
        let (numerator, denominator) = COUNTS_PER_TICK;
        (ticks * numerator + denominator / 2) / denominator
    }
}
