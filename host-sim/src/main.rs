//! The `host-sim` program: parses the command line, runs a verb, turns a failure into its exit code.

use clap::Parser;
use host_sim::cli::Cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    match host_sim::run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            let style = clap::builder::Styles::styled();
            let error = style.get_error();
            anstream::eprintln!("{error}error:{error:#} {failure}");
            ExitCode::from(failure.kind.exit_code())
        }
    }
}
