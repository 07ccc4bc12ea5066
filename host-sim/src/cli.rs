//! The command line, as it is typed.

use crate::failure::EXIT_CODES;
use crate::shell_word;
use crate::verb;
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Arg, Args, Command, Parser, Subcommand, ValueHint};
use std::path::PathBuf;

/// Health monitoring of electro-hydraulic actuators: faults, and the effects a model lacks, from LVDT records.
///
/// Results go to stdout, log and progress to stderr.
#[derive(Debug, Parser)]
#[command(version, after_help = EXIT_CODES, max_term_width = 110)]
pub struct Cli {
    #[command(flatten)]
    pub(crate) common: Common,
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

/// Options that every verb understands.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Print one JSON object instead of tables.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// No log and no progress.
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    /// Seed of all randomness.
    #[arg(long, global = true, default_value_t = 1, allow_negative_numbers = true)]
    pub(crate) seed: u64,
    /// Threads; all processors by default. Results do not depend on it.
    #[arg(long, global = true, allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(crate) threads: Option<u16>,
    /// Rig: a built-in name (see `rigs`) or a TOML file; of the verbs that fit, check or simulate.
    #[arg(long, global = true, value_name = "NAME|FILE.toml")]
    pub(crate) rig: Option<String>,
    /// Directory for files that a verb writes; made if it is not there.
    #[arg(long, global = true, value_name = "DIR", value_parser = written_path(), value_hint = ValueHint::DirPath)]
    pub(crate) out: Option<PathBuf>,
}

/// A path to write to beside the result, which has stdout: `-` is none.
pub(crate) fn written_path() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().try_map(|path| {
        if path.as_os_str() == "-" {
            Err("standard output has the result, expected a path")
        } else {
            Ok(path)
        }
    })
}

/// Options of every verb that one of them refuses: not in its help, and understood, so that the message says why.
fn hidden(options: &'static [&'static str]) -> impl Iterator<Item = Arg> {
    let common = Common::augment_args(Command::new(""));
    let all: Vec<Arg> = common.get_arguments().cloned().collect();
    all.into_iter().filter(|arg| options.contains(&arg.get_id().as_str())).map(|arg| arg.hide(true))
}

/// What to do. A verb hides what it refuses: see [`writes_files`](Self::writes_files) and [`takes_rig`](Self::takes_rig).
#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// The main job on an embedded example: faults from an actuator, and what the monitor's model lacks.
    #[command(args = hidden(&["rig"]))]
    Demo(verb::demo::Options),
    /// Make a record: HF or LF model, command, faults, effects, sensor noise.
    Simulate(verb::simulate::Options),
    /// What records are worth before any fit: sampling, noise, delay, and what they can tell of the faults.
    Check(verb::check::Options),
    /// Faults from records.
    Identify(verb::identify::Options),
    /// Free parameters of a rig (`servo-hydraulic` unless `--rig` names another) from records; writes a rig file with
    /// `--out`.
    Calibrate(verb::calibrate::Options),
    /// What does the model lack? Names a missing effect, with the error before and after, or says that it cannot tell.
    Diagnose(verb::diagnose::Options),
    /// The source's twelve cases: its result and ours.
    Reproduce(verb::reproduce::Options),
    /// The physical effects that a model can have.
    #[command(args = hidden(&["rig", "out"]))]
    Effects,
    /// The test commands.
    #[command(args = hidden(&["rig", "out"]))]
    Commands,
    /// The built-in rigs; with a name or file, everything in it.
    #[command(args = hidden(&["rig", "out"]))]
    Rigs(verb::lists::RigsOptions),
    /// Convert a MAT (v5, v7.3), Parquet or foreign CSV file to a record.
    #[command(args = hidden(&["rig"]))]
    Import(verb::import::Options),
    /// Hardware in the loop: samples to the firmware's monitor over a serial line, its estimates as they come. Builds the
    /// firmware from the sources that this program was built from.
    #[command(args = hidden(&["out"]))]
    Hil(verb::hil::Options),
    /// What the firmware costs on the emulated boards, against its limits. Builds it from the sources that this program was
    /// built from.
    #[command(args = hidden(&["rig", "out"]))]
    Budget(verb::budget::Options),
    /// Completions for a shell: `host-sim completions bash > /etc/bash_completion.d/host-sim`.
    #[command(args = hidden(&["rig", "out"]))]
    Completions(verb::shell::CompletionsOptions),
    /// The manual page of the program or a verb; with `--out DIR`, all of them as files.
    #[command(args = hidden(&["rig"]))]
    Man(verb::shell::ManOptions),
}

impl Verb {
    /// Does the verb write files into the directory of `--out`?
    pub(crate) const fn writes_files(&self) -> bool {
        match self {
            Self::Demo(_)
            | Self::Simulate(_)
            | Self::Check(_)
            | Self::Identify(_)
            | Self::Calibrate(_)
            | Self::Diagnose(_)
            | Self::Reproduce(_)
            | Self::Import(_)
            | Self::Man(_) => true,
            Self::Effects
            | Self::Commands
            | Self::Rigs(_)
            | Self::Hil(_)
            | Self::Budget(_)
            | Self::Completions(_) => false,
        }
    }

    /// Is a rig of the user's any use to the verb?
    pub(crate) const fn takes_rig(&self) -> bool {
        match self {
            Self::Simulate(_)
            | Self::Check(_)
            | Self::Identify(_)
            | Self::Calibrate(_)
            | Self::Diagnose(_)
            | Self::Reproduce(_)
            | Self::Hil(_) => true,
            Self::Demo(_)
            | Self::Effects
            | Self::Commands
            | Self::Rigs(_)
            | Self::Import(_)
            | Self::Budget(_)
            | Self::Completions(_)
            | Self::Man(_) => false,
        }
    }
}

/// The command line of this run, as a shell takes it.
pub(crate) fn command_line() -> String {
    let quoted = |argument: std::ffi::OsString| shell_word::quoted(&argument.to_string_lossy()).into_owned();
    let arguments = std::env::args_os().skip(1).map(quoted);
    std::iter::once(env!("CARGO_PKG_NAME").to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use std::any::TypeId;

    fn is_number(arg: &Arg) -> bool {
        let parsed = arg.get_value_parser().type_id();
        let types = [
            TypeId::of::<f64>(),
            TypeId::of::<u64>(),
            TypeId::of::<u32>(),
            TypeId::of::<u16>(),
            TypeId::of::<usize>(),
        ];
        types.iter().any(|&number| parsed == number)
    }

    #[test]
    fn a_verb_hides_the_options_that_it_refuses() {
        let mut command = Cli::command();
        command.build();
        let mut verbs: Vec<&str> = command.get_subcommands().map(Command::get_name).collect();
        verbs.retain(|verb| *verb != "help");
        for verb in verbs {
            let argument = match verb {
                "check" | "identify" | "calibrate" | "diagnose" | "import" => Some("record.csv"),
                "completions" => Some("bash"),
                _ => None,
            };
            let parsed =
                Cli::try_parse_from(["host-sim", verb].into_iter().chain(argument)).expect(verb).verb;
            let arguments = || command.find_subcommand(verb).into_iter().flat_map(Command::get_arguments);
            let shows = |option: &str| arguments().any(|arg| arg.get_id() == option && !arg.is_hide_set());
            assert_eq!([shows("out"), shows("rig")], [parsed.writes_files(), parsed.takes_rig()], "{verb}");
            assert!(shows("json"), "{verb}");
        }
    }

    #[test]
    fn a_number_below_zero_comes_to_the_check_of_its_option() {
        let command = Cli::command();
        let all = command.get_arguments().chain(command.get_subcommands().flat_map(Command::get_arguments));
        let numbers: Vec<&Arg> =
            all.filter(|arg| is_number(arg) && arg.get_action().takes_values()).collect();
        assert!(numbers.len() >= 15, "{}", numbers.len());
        for arg in numbers {
            // A whole number has no exponent, whose sign clap does not take for a part of one.
            let is_whole = arg.get_value_parser().type_id() != TypeId::of::<f64>();
            assert!(
                if is_whole { arg.is_allow_negative_numbers_set() } else { arg.is_allow_hyphen_values_set() },
                "{arg}"
            );
        }
        let parsed = Cli::try_parse_from(["host-sim", "simulate", "--amplitude", "-5e-3", "--json"]);
        assert!(parsed.is_ok_and(|cli| cli.common.json));
        // The control: a path is none.
        assert!(!command.get_arguments().any(|arg| arg.get_id() == "out" && is_number(arg)));
    }
}
