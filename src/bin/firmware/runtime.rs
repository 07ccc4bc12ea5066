//! What every image for a Cortex-M shares: `defmt` log over semihosting, panics, faults, the stack's high-water mark.
//!
//! Nothing here can panic, so that the link can prove it of the whole image (see [`on_panic`]). That is why the
//! log does not go through `defmt-semihosting`, which panics on a re-entrant call.
#![allow(
    unsafe_code,
    reason = "three signatures that others prescribe (defmt::Logger, the hard fault handler, the foreign symbol \
              of the panic check) say `unsafe`; nothing in this file does an unsafe operation"
)]

use core::{cell::RefCell, panic::PanicInfo};
use critical_section::Mutex;
use semihosting::{process, sys::arm_compat::sys_writec};

/// Exit code where the processor faulted.
const EXIT_HARD_FAULT: i32 = 101;
/// Exit code of a panic, which only an unoptimised image can reach.
#[cfg(debug_assertions)]
const EXIT_PANIC: i32 = 102;
/// Exit code where the peripherals were taken before the entry: never, unless the start-up is broken.
pub(crate) const EXIT_NO_PERIPHERALS: i32 = 103;

/// Reports the deepest stack since the reset: the start-up code painted it, and what is no longer paint was used.
pub(crate) fn report_stack() {
    let size = cortex_m_stack::stack_size();
    let used = size.saturating_sub(cortex_m_stack::stack_painted());
    defmt::println!("measure stack.bytes={=u32}", used);
    defmt::info!("stack: {=u32} of {=u32} bytes used", used, size);
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
