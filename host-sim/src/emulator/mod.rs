//! The firmware under QEMU: build it, run it, read what it says, and weigh its image.
//!
//! ```no_run
//! use host_sim::emulator::{BuildOptions, Emulator, Machine};
//!
//! let machine = Machine::Mps2An500;
//! let firmware = BuildOptions::for_machine(machine).build()?;
//! let log = Emulator::new(machine).run(&firmware)?;
//! println!("{:?}, {} bytes of flash", log.measures, firmware.footprint()?.flash_bytes);
//! # Ok::<(), host_sim::emulator::EmulatorError>(())
//! ```
//!
//! The counts are of instructions, not of cycles: QEMU models no pipeline, cache or flash wait state.

mod build;
mod error;
mod footprint;
mod log;
mod qemu;

pub use build::{
    Binary, Board, BuildOptions, Cpu, EXIT_HARD_FAULT, Firmware, PANIC_SYMBOL, TARGET, run_on_host,
};
pub use error::EmulatorError;
pub use footprint::Footprint;
pub use log::{LogLine, ResultValue, RunLog};
pub use qemu::{DEFAULT_TIME_LIMIT, Emulator, Machine};
