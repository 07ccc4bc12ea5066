//! What can go wrong between a source tree and a decoded log.

use super::build::TARGET;
use std::{path::PathBuf, time::Duration};

/// Why the firmware could not be built, run or understood. Each message says what to do, where anything can be done.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The compiler has no core library for the microcontroller.
    #[error(
        "the Rust target {TARGET} is not installed: run `rustup target add {TARGET}` (or `cargo xtask setup`)"
    )]
    TargetMissing,
    /// The emulator is not installed.
    #[error(
        "qemu-system-arm is not installed: run `apt-get install -y --no-install-recommends qemu-system-arm` \
         (or `cargo xtask setup`)"
    )]
    QemuMissing,
    /// A program could not be started or waited for.
    #[error("cannot run `{program}`: {source}")]
    Program {
        /// The program.
        program: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The compiler or the linker refused the firmware.
    #[error("the firmware does not build:\n{stderr}")]
    Build {
        /// What cargo printed.
        stderr: String,
    },
    /// The image is no ELF file that can be analysed.
    #[error("cannot read the firmware image: {0}")]
    Image(String),
    /// The image has no symbols, so nothing can be said of what is linked into it.
    #[error("the firmware image is stripped: what is linked into it cannot be told")]
    Stripped,
    /// QEMU or the host's run of the firmware ended without a code of the firmware's.
    #[error("the run ended abnormally ({status}):\n{stderr}")]
    Run {
        /// How it ended.
        status: String,
        /// What it printed.
        stderr: String,
    },
    /// The run did not end in time; it was killed.
    #[error("the run did not end within {} s; its log so far:\n{log}", limit.as_secs_f64())]
    TimeLimit {
        /// The limit.
        limit: Duration,
        /// The lines logged until then.
        log: String,
    },
    /// The log is not of this image, or was damaged on its way.
    #[error("cannot decode the firmware's log: {0}")]
    Log(String),
    /// A line that starts like a result or a measurement is none.
    #[error("malformed line in the firmware's log: `{0}`")]
    Line(String),
}
