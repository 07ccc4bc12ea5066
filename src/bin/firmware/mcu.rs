//! The workload's platform on a Cortex-M: entry, `defmt` log over semihosting, measurement, panics and faults.
//!
//! Nothing here can panic, so that the link can prove it of the whole image (see [`on_panic`]). That is why the
//! log does not go through `defmt-semihosting`, which panics on a re-entrant call.
#![allow(
    unsafe_code,
    reason = "three signatures that others prescribe (defmt::Logger, the hard fault handler, the foreign symbol \
              of the panic check) say `unsafe`; nothing in this file does an unsafe operation"
)]

#[path = "counter.rs"]
mod counter;
#[path = "hogs.rs"]
mod hogs;

use crate::{
    Platform,
    workload::{self, Memory},
};
use core::{cell::RefCell, hint::black_box, panic::PanicInfo};
use counter::Counter;
use critical_section::Mutex;
use semihosting::{process, sys::arm_compat::sys_writec};

/// Exit code where the processor faulted.
const EXIT_HARD_FAULT: i32 = 101;
/// Exit code of a panic, which only an unoptimised image can reach.
#[cfg(debug_assertions)]
const EXIT_PANIC: i32 = 102;
/// Exit code where the peripherals were taken before the entry: never, unless the start-up is broken.
const EXIT_NO_PERIPHERALS: i32 = 103;

/// Rounds of a loop of two instructions, which shows that the counter is right over several wraps of its timer.
const CALIBRATION_ROUNDS: u32 = 20_000_000;

#[cortex_m_rt::entry]
fn start() -> ! {
    // The macro hands out a `static mut` of the entry as a reference, once: the entry runs once.
    static mut MEMORY: Memory = Memory::new();
    let Some(peripherals) = cortex_m::Peripherals::take() else {
        process::exit(EXIT_NO_PERIPHERALS);
    };
    let mut board = Board { counter: Counter::new(peripherals.SYST) };
    board.measure("board", "calibration", || cortex_m::asm::delay(CALIBRATION_ROUNDS));
    workload::run(&mut board, MEMORY);
    hogs::take();
    report_stack();
    if cfg!(feature = "negative-control-fault") {
        cortex_m::asm::udf();
    }
    process::exit(0);
}

/// Reports the deepest stack since the reset: the start-up code painted it, and what is no longer paint was used.
fn report_stack() {
    let size = cortex_m_stack::stack_size();
    let used = size.saturating_sub(cortex_m_stack::stack_painted());
    defmt::println!("measure stack.bytes={=u32}", used);
    defmt::info!("stack: {=u32} of {=u32} bytes used", used, size);
}

/// The microcontroller.
struct Board {
    counter: Counter,
}

impl Platform for Board {
    fn result_f32(&mut self, group: &str, name: &str, value: f32) {
        defmt::println!("result {=str}.{=str}={=u32:#010x}", group, name, value.to_bits());
    }

    fn result_count(&mut self, group: &str, name: &str, value: u64) {
        defmt::println!("result {=str}.{=str}={=u64}", group, name, value);
    }

    fn measure<T>(&mut self, group: &str, name: &str, work: impl FnOnce() -> T) -> T {
        let (value, cost) = self.cost_of(work);
        report_cost(group, name, cost);
        value
    }

    fn measure_worst(
        &mut self,
        group: &str,
        name: &str,
        rounds: u32,
        mut prepare: impl FnMut(u32),
        mut work: impl FnMut(u32),
    ) {
        let mut worst = 0;
        for round in 0..rounds {
            prepare(round);
            let ((), cost) = self.cost_of(|| work(round));
            worst = worst.max(cost);
        }
        report_cost(group, name, worst);
    }
}

impl Board {
    /// Runs `work` once; what it gives, and what it cost.
    fn cost_of<T>(&self, work: impl FnOnce() -> T) -> (T, u64) {
        // The black boxes keep the compiler from moving the work out of the measured interval.
        let work = black_box(work);
        let start = self.counter.now();
        let value = black_box(work());
        if cfg!(feature = "negative-control-slow") {
            // Everything takes twice as long, and short work a thousand instructions more.
            let wait = self.counter.since(start).saturating_add(1000);
            cortex_m::asm::delay(u32::try_from(wait).unwrap_or(u32::MAX));
        }
        (value, self.counter.since(start))
    }
}

/// Reports the cost of a piece of work.
fn report_cost(group: &str, name: &str, cost: u64) {
    defmt::println!("measure {=str}.{=str}.{=str}={=u64}", group, name, counter::UNIT, cost);
}

/// State of the log's framing.
static ENCODER: Mutex<RefCell<defmt::Encoder>> = Mutex::new(RefCell::new(defmt::Encoder::new()));

/// Runs `step` with the encoder and the channel to the host. A re-entrant call is lost rather than a panic.
fn with_log(step: impl FnOnce(&mut defmt::Encoder, fn(&[u8]))) {
    critical_section::with(|token| {
        if let Ok(mut encoder) = ENCODER.borrow(token).try_borrow_mut() {
            // The encoder hands out single bytes, so a call to the host per byte loses nothing; the calls that take
            // a buffer also need a file handle, whose checks can panic.
            step(&mut encoder, |bytes| bytes.iter().copied().for_each(sys_writec));
        }
    });
}

/// `defmt` frames over semihosting.
///
/// A frame is not one critical section: only thread mode logs, the interrupt handlers of this image do not.
#[defmt::global_logger]
struct SemihostingLogger;

unsafe impl defmt::Logger for SemihostingLogger {
    fn acquire() {
        with_log(|encoder, sink| encoder.start_frame(sink));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        with_log(|encoder, sink| encoder.end_frame(sink));
    }

    unsafe fn write(bytes: &[u8]) {
        with_log(|encoder, sink| encoder.write(bytes, sink));
    }
}

/// Ends the run at once: the default handler would hang until the host's time limit.
#[cortex_m_rt::exception(trampoline = false)]
unsafe fn HardFault() -> ! {
    process::exit(EXIT_HARD_FAULT)
}

#[cfg(not(debug_assertions))]
unsafe extern "C" {
    /// Defined nowhere: an image in which a panic can be reached does not link.
    safe fn this_firmware_has_a_reachable_panic() -> !;
}

/// In an optimised image the linker drops this function together with the last path to it. A path that is left
/// leaves an undefined symbol, and the link fails.
#[cfg(not(debug_assertions))]
#[panic_handler]
fn on_panic(_: &PanicInfo) -> ! {
    this_firmware_has_a_reachable_panic()
}

/// In an image with debug assertions panics are many and wanted.
#[cfg(debug_assertions)]
#[panic_handler]
fn on_panic(_: &PanicInfo) -> ! {
    process::exit(EXIT_PANIC)
}
