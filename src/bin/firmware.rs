//! The monitor on a microcontroller, and the same run on a host.
//!
//! One workload, two platforms: a Cortex-M (emulated `mps2-an500` and `mps2-an386`, or an STM32H743) logs with
//! `defmt` over semihosting, a host prints. Both give the lines
//!
//! - `result GROUP.NAME=0x3f800000` (the bits of an `f32`) or `result GROUP.NAME=42` (a count): equal on every
//!   platform, bit for bit;
//! - `measure GROUP.NAME.UNIT=42`: what it cost, on the microcontroller only;
//!
//! so that a test compares them as text. `host-sim`'s module `emulator` builds, runs and reads this binary.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg_attr(target_os = "none", path = "firmware/mcu.rs")]
#[cfg_attr(not(target_os = "none"), path = "firmware/host.rs")]
mod platform;
#[path = "firmware/workload.rs"]
mod workload;

/// What the workload needs of the machine that it runs on.
trait Platform {
    /// Reports the bits of a value that must be the same on every platform.
    fn result_f32(&mut self, group: &str, name: &str, value: f32);

    /// Reports a count that must be the same on every platform.
    fn result_count(&mut self, group: &str, name: &str, value: u64);

    /// Runs `work` once and reports what it cost, where the platform can tell.
    fn measure<T>(&mut self, group: &str, name: &str, work: impl FnOnce() -> T) -> T;

    /// Runs `work` in several rounds, each after `prepare` of its number, and reports what the dearest of them cost.
    fn measure_worst(
        &mut self,
        group: &str,
        name: &str,
        rounds: u32,
        prepare: impl FnMut(u32),
        work: impl FnMut(u32),
    );
}

/// The host's entry; the microcontroller's is `platform::start`.
#[cfg(not(target_os = "none"))]
fn main() {
    workload::run(&mut platform::Host, &mut workload::Memory::new());
}
