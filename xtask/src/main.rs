//! The jobs of the continuous integration, one sub-command each: what it runs, anyone can run.

mod job;
mod peers;
mod setup;

use clap::{Parser, Subcommand};
use job::Failure;
use std::path::PathBuf;
use std::process::ExitCode;

/// The jobs of the continuous integration, one sub-command each.
#[derive(Parser)]
struct Arguments {
    #[command(subcommand)]
    task: Task,
}

/// A job.
#[derive(Subcommand)]
enum Task {
    /// Install what the tests need: the Rust target, QEMU; a browser and shells, without which some are skipped.
    Setup,
    /// Every job below, in this order, after `setup`; stops at the first failure.
    Ci,
    /// Check the formatting.
    Fmt,
    /// Lint everything, for the host and for the microcontroller.
    Clippy,
    /// Build the documentation; a broken link fails.
    Doc,
    /// Run every test but the hard cases; those of the firmware run it under QEMU.
    Test,
    /// Link the release firmware for every board, panic check included.
    Firmware,
    /// Link a firmware that uses the library as its own author writes one (`tests/integrator`).
    Integrator,
    /// Run the hard cases of `diagnose`, which take twelve minutes. Not part of `ci`: for a change to it.
    Hard,
    /// Make `docs/confusion.md` anew: what `diagnose` makes of every effect of the catalogue. Some twenty minutes.
    Confusion,
    /// Make `docs/blind.md` anew: what it makes of actuators of which everything is drawn at random. Some thirty minutes.
    Blind {
        /// Numbers of cases to show; the document stays as it is.
        cases: Vec<u64>,
        /// Folder to save the records of these cases to, as CSV; they are not diagnosed.
        #[arg(long, value_name = "DIR", requires = "cases")]
        records: Option<PathBuf>,
    },
    /// Run the monitor beside other programs on the same records and print one table; installs what they need.
    /// Not part of `ci`.
    Peers,
}

impl Task {
    fn run(self) -> Result<(), Failure> {
        match self {
            Self::Setup => setup::run(),
            Self::Ci => [
                Self::Setup,
                Self::Fmt,
                Self::Clippy,
                Self::Doc,
                Self::Test,
                Self::Firmware,
                Self::Integrator,
            ]
            .into_iter()
            .try_for_each(Self::run),
            Self::Fmt => job::fmt(),
            Self::Clippy => job::clippy(),
            Self::Doc => job::doc(),
            Self::Test => job::test(),
            Self::Firmware => job::firmware(),
            Self::Integrator => job::integrator(),
            Self::Hard => job::hard(),
            Self::Confusion => job::confusion(),
            Self::Blind { cases, records } => job::blind(&cases, records.as_deref()),
            Self::Peers => peers::run(),
        }
    }
}

fn main() -> ExitCode {
    match Arguments::parse().task.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::FAILURE
        }
    }
}
