//! Cost of a piece of code, from a counter of 32 bits that no interrupt serves: what is measured, and the stack with it,
//! is the code's own, in every run.
//!
//! Under QEMU with `-icount shift=6` every instruction takes 64 ns of the board's time and a timer of the mps2 boards
//! ticks every 40 ns (25 MHz): the count is one of instructions, exact and repeatable, and says nothing of cycles. It
//! lasts for 2.6 G instructions a piece. On the real part the core's own counter (DWT) counts cycles, 10 s at 400 MHz.

use core::hint::black_box;
use cortex_m::Peripherals;

#[cfg(not(feature = "board-stm32h743"))]
mod clock {
    //! The first timer of the mps2 boards (Arm CMSDK APB timer), which counts down.
    #![allow(unsafe_code, reason = "says where the timer's registers are")]

    use super::super::registers::Registers;
    use cortex_m::Peripherals;

    /// What is counted.
    pub(super) const UNIT: &str = "instructions";
    /// Counts per tick, as a fraction: 40 ns a tick over 64 ns an instruction.
    pub(super) const COUNTS_PER_TICK: (u64, u64) = (40, 64);

    /// Address of the registers.
    const BASE: usize = 0x4000_0000;
    /// Offsets of the registers, in words.
    const CONTROL: u8 = 0;
    const VALUE: u8 = 1;
    const RELOAD: u8 = 2;
    /// Bit of the control: count, without interrupt.
    const ENABLE: u32 = 1 << 0;

    /// The timer, which is this owner's.
    pub(super) struct Clock(Registers);

    impl Clock {
        /// Starts it. The core's peripherals have no part in it.
        pub(super) fn start(_: Peripherals) -> Self {
            // SAFETY: the timer's block, which only this clock uses.
            let mut registers = unsafe { Registers::at(BASE) };
            registers.set(RELOAD, u32::MAX);
            registers.set(VALUE, u32::MAX);
            registers.set(CONTROL, ENABLE);
            Self(registers)
        }

        /// Ticks since any time; they wrap.
        pub(super) fn ticks(&self) -> u32 {
            u32::MAX - self.0.get(VALUE)
        }
    }
}

#[cfg(feature = "board-stm32h743")]
mod clock {
    //! The cycle counter of the core.

    use cortex_m::{Peripherals, peripheral::DWT};

    /// What is counted.
    pub(super) const UNIT: &str = "cycles";
    /// Counts per tick, as a fraction.
    pub(super) const COUNTS_PER_TICK: (u64, u64) = (1, 1);

    /// The counter, which is this owner's.
    pub(super) struct Clock(DWT);

    impl Clock {
        /// Starts it.
        pub(super) fn start(mut peripherals: Peripherals) -> Self {
            peripherals.DCB.enable_trace();
            DWT::unlock();
            peripherals.DWT.enable_cycle_counter();
            Self(peripherals.DWT)
        }

        /// Cycles since any time; they wrap.
        pub(super) fn ticks(&self) -> u32 {
            self.0.cyccnt.read()
        }
    }
}

/// Reports the cost of a piece of work.
pub(crate) fn report(group: &str, name: &str, cost: u64) {
    defmt::println!("measure {=str}.{=str}.{=str}={=u64}", group, name, clock::UNIT, cost);
}

/// A running count of instructions (emulated boards) or cycles (real part).
pub(crate) struct Counter {
    clock: clock::Clock,
    /// Ticks between two readings with nothing between them.
    overhead: u32,
}

impl Counter {
    /// Starts the clock, which is this counter's from now on.
    pub(crate) fn new(peripherals: Peripherals) -> Self {
        let mut counter = Self { clock: clock::Clock::start(peripherals), overhead: 0 };
        let start = counter.now();
        counter.overhead = counter.now().wrapping_sub(start);
        counter
    }

    /// Ticks since any time; they wrap. A call, so that every reading costs the same.
    #[inline(never)]
    fn now(&self) -> u32 {
        self.clock.ticks()
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

    /// Instructions (cycles on the real part) since `start`, without the cost of reading the clock.
    fn since(&self, start: u32) -> u64 {
        let ticks = self.now().wrapping_sub(start).saturating_sub(self.overhead);
        // A tick is shorter than an instruction: each reading is exact to one instruction.
        let (numerator, denominator) = clock::COUNTS_PER_TICK;
        (u64::from(ticks) * numerator + denominator / 2) / denominator
    }
}
