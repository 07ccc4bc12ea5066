//! Host program around the `eha-monitor` core.
//!
//! ```text
//! cli.rs --> verb/*.rs, one file a verb
//!              |-- record/   CSV, MAT and Parquet in          |-- plant.rs  the actuator as a source of records
//!              |-- rig/      what is known of the actuator    |-- hil/      samples to the firmware's monitor
//!              |-- inspect/  what a record is worth           |-- emulator/ firmware under QEMU, budget/ its limits
//!              |-- fit/      records + rig --> core search    |-- output.rs results to stdout, log to stderr
//!              |             --> estimates, residuals         |-- report/   HTML with plots
//!              |-- diagnose/ residual --> missing effects     |-- trace.rs, table_file.rs samples as CSV and Parquet
//! ```

pub mod budget;
pub mod cli;
pub mod diagnose;
pub mod emulator;
pub mod failure;
pub mod fit;
pub mod hil;
pub mod inspect;
pub mod interrupt;
pub mod output;
pub mod plant;
pub mod record;
mod report;
pub mod rig;
mod shell_word;
mod table_file;
pub mod thesis;
pub mod trace;
pub mod verb;
mod whole_file;

use cli::{Cli, Verb};
use failure::Failure;

/// Stack of a worker, bytes: the transition matrices of a full model are made on it.
pub const WORKER_STACK: usize = 16 << 20;

/// Runs what the command line asks for.
///
/// # Errors
/// The failure and its exit code; see [`failure::EXIT_CODES`].
pub fn run(cli: &Cli) -> Result<(), Failure> {
    let common = &cli.common;
    rayon::ThreadPoolBuilder::new()
        .num_threads(common.threads.map_or(0, usize::from))
        .stack_size(WORKER_STACK)
        .build_global()
        .map_err(Failure::other)?;
    if let (Some(out), false) = (&common.out, cli.verb.writes_files()) {
        return Err(Failure::usage(format!(
            "--out {}: this verb writes no files; its result goes to stdout",
            out.display()
        )));
    }
    if let (Some(rig), false) = (&common.rig, cli.verb.takes_rig()) {
        let why = match &cli.verb {
            Verb::Demo(_) => "`demo` is about its own rig",
            Verb::Rigs(_) => "this verb takes the rig as an argument, `rigs NAME`",
            _ => "this verb is about no rig",
        };
        return Err(Failure::usage(format!("--rig {rig}: {why}, expected no such option")));
    }
    match &cli.verb {
        Verb::Demo(options) => verb::demo::run(common, options),
        Verb::Simulate(options) => verb::simulate::run(common, options),
        Verb::Check(options) => verb::check::run(common, options),
        Verb::Identify(options) => verb::identify::run(common, options),
        Verb::Diagnose(options) => verb::diagnose::run(common, options),
        Verb::Calibrate(options) => verb::calibrate::run(common, options),
        Verb::Reproduce(options) => verb::reproduce::run(common, options),
        Verb::Effects => verb::lists::effects(common),
        Verb::Commands => verb::lists::commands(common),
        Verb::Rigs(options) => verb::lists::rigs(common, options),
        Verb::Import(options) => verb::import::run(common, options),
        Verb::Hil(options) => verb::hil::run(common, options),
        Verb::Budget(options) => verb::budget::run(common, options),
        Verb::Completions(options) => verb::shell::completions(options),
        Verb::Man(options) => verb::shell::man(common, options),
    }
}
