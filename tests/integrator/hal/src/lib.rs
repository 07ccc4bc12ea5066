//! The board: memory layout, clocks, converters, lamps, critical section. Nothing of it knows of the monitor.
#![no_std]

use core::sync::atomic::{AtomicI16, AtomicU32, Ordering};
use cortex_m::Peripherals;
use cortex_m::interrupt;
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m::register::primask;
use critical_section::RawRestoreState;

/// Clock of the core after the reset, Hz.
const CORE_CLOCK: u32 = 64_000_000;
/// Rate of the samples, Hz.
const SAMPLE_RATE: u32 = 1000;
/// What a count of the command's and the LVDT's converters is, m: 0.2 m in 15 bits.
const POSITION_COUNT: f32 = 0.2 / 32768.0;
/// What a count of the current's converter is, mA: 16 mA in 15 bits.
const CURRENT_COUNT: f32 = 16.0 / 32768.0;

/// Latest command, position and current in counts: the converters' DMA writes them here.
static CONVERSIONS: [AtomicI16; 3] = [const { AtomicI16::new(0) }; 3];
/// Lamps of backlash and friction, a bit each: the maintenance panel's driver reads it.
static LAMPS: AtomicU32 = AtomicU32::new(0);
/// Windows that told nothing of the actuator.
static UNUSABLE_WINDOWS: AtomicU32 = AtomicU32::new(0);

/// The board.
pub struct Board {
    sample_clock: SYST,
}

impl Board {
    /// The board, once.
    pub fn take() -> Option<Self> {
        Peripherals::take().map(|peripherals| Self { sample_clock: peripherals.SYST })
    }

    /// Lets the interrupt of the samples come.
    pub fn start_sample_clock(&mut self) {
        let clock = &mut self.sample_clock;
        clock.set_clock_source(SystClkSource::Core);
        clock.set_reload(CORE_CLOCK / SAMPLE_RATE - 1);
        clock.clear_current();
        clock.enable_counter();
        clock.enable_interrupt();
    }
}

/// Command and position, m, and current, mA, at this tick.
pub fn conversions() -> [f32; 3] {
    let [command, user, current] = &CONVERSIONS;
    let value = |counts: &AtomicI16, unit: f32| f32::from(counts.load(Ordering::Relaxed)) * unit;
    [value(command, POSITION_COUNT), value(user, POSITION_COUNT), value(current, CURRENT_COUNT)]
}

/// Lights the lamps.
pub fn show_alarms(backlash: bool, friction: bool) {
    LAMPS.store(u32::from(backlash) | u32::from(friction) << 1, Ordering::Relaxed);
}

/// Counts a window that told nothing.
pub fn count_unusable_window() {
    // Only the background writes.
    UNUSABLE_WINDOWS.store(UNUSABLE_WINDOWS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

/// Does nothing any more.
pub fn stop() -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

/// One core, all code privileged: nothing else runs while interrupts are masked.
struct Masked;

critical_section::set_impl!(Masked);

// SAFETY: from `acquire` to the `release` that is given its result, no interrupt comes.
unsafe impl critical_section::Impl for Masked {
    unsafe fn acquire() -> RawRestoreState {
        let mask = primask::read_raw();
        interrupt::disable();
        mask
    }

    unsafe fn release(mask: RawRestoreState) {
        // SAFETY: the mask as it was: it lets interrupts come only where the outermost critical section ends.
        unsafe { primask::write_raw(mask) };
    }
}
