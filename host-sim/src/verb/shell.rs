//! `completions`, `man`: what shells and manuals know of the command line, from the command line itself.

use super::files::Files;
use crate::cli::{Cli, Common};
use crate::failure::Failure;
use crate::output;
use crate::rig::BUILT_IN;
use clap::builder::PossibleValuesParser;
use clap::{Arg, Command, CommandFactory as _, ValueHint};
use clap_complete::Shell;
use eha_monitor::channel::Channel;
use eha_monitor::command::COMMANDS;
use eha_monitor::effect::EFFECTS;
use eha_monitor::parameter::PARAMETERS;

/// Options of `completions`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct CompletionsOptions {
    /// Shell to complete for.
    shell: Shell,
}

/// Options of `man`.
#[derive(Clone, Debug, clap::Args)]
pub struct ManOptions {
    /// Verb to print the page of; the program's own by default. With `--out`, every page is written.
    verb: Option<String>,
}

/// Prints the completions of a shell.
///
/// # Errors
/// Stdout cannot be written.
pub fn completions(options: &CompletionsOptions) -> Result<(), Failure> {
    let is_bash = options.shell == Shell::Bash;
    let known = |arg: Arg| with_names(arg, is_bash);
    let mut command = Cli::command().mut_args(known).mut_subcommands(|verb| verb.mut_args(known));
    let name = command.get_name().to_owned();
    let mut text = Vec::new();
    clap_complete::generate(options.shell, &mut command, name.as_str(), &mut text);
    let text = String::from_utf8_lossy(&text);
    output::print(if is_bash { with_labels(&text, &name) } else { text.into_owned() }.trim_end())
}

/// An argument that takes names, with those that it knows. Bash goes on to files where no name fits; the other shells
/// would not, so there what may be a file as well stays one.
fn with_names(arg: Arg, goes_on_to_files: bool) -> Arg {
    let may_be_file = arg.get_value_names().into_iter().flatten().any(|name| name.contains("FILE"));
    let Some((names, mark)) = names_of(arg.get_id().as_str()).filter(|_| goes_on_to_files || !may_be_file)
    else {
        return arg;
    };
    let names: Vec<String> = names.into_iter().map(|name| format!("{name}{mark}")).collect();
    // A default is no name: `bkl=1e-4..2e-4`.
    let arg = arg.default_values([""; 0]).value_parser(PossibleValuesParser::new(names));
    // Hands over to what is typed after the mark: no space.
    if mark.is_empty() { arg } else { arg.value_hint(ValueHint::Other) }
}

/// The names that an argument, whose own is the same in every verb, knows; and what follows one of them.
fn names_of(arg: &str) -> Option<(Vec<&'static str>, &'static str)> {
    let channels = || Channel::MEASURED.map(|channel| channel.info().column).to_vec();
    Some(match arg {
        "rig" | "rig-to-show" => (BUILT_IN.map(|built_in| built_in.name).to_vec(), ""),
        "command" => (COMMANDS.map(|command| command.name).to_vec(), ""),
        "channels" => (channels(), ""),
        "noise" | "quantum" => (channels(), "="),
        "effects" => (EFFECTS.iter().map(|effect| effect.name).collect(), "="),
        "set" | "at" | "bounds" | "truth" | "grow" | "watch" => {
            (PARAMETERS.iter().map(|parameter| parameter.name).collect(), "=")
        }
        _ => return None,
    })
}

/// The script for bash with labels that it goes to: in the name of a program, the generator writes a hyphen in one way
/// where a verb is recognised, and in another one where its options stand.
fn with_labels(text: &str, name: &str) -> String {
    text.replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__"))
}

/// Prints a manual page, or writes all of them.
///
/// # Errors
/// Usage: no such verb. A file cannot be written.
pub fn man(common: &Common, options: &ManOptions) -> Result<(), Failure> {
    let mut command = Cli::command();
    command.build();
    let page = |command: &Command| -> Result<Vec<u8>, Failure> {
        let mut text = Vec::new();
        clap_mangen::Man::new(command.clone()).render(&mut text).map_err(Failure::other)?;
        Ok(text)
    };
    let verbs = || command.get_subcommands().filter(|verb| verb.get_name() != "help");
    if let Some(directory) = &common.out {
        let of_verb =
            |verb: &Command| (format!("{}-{}.1", command.get_name(), verb.get_name()), verb.clone());
        let own = (format!("{}.1", command.get_name()), command.clone());
        let pages: Vec<(String, Command)> = std::iter::once(own).chain(verbs().map(of_verb)).collect();
        let names: Vec<&str> = pages.iter().map(|(name, _)| name.as_str()).collect();
        Files::new(common).writes_in_out(&names).check()?;
        for (name, command) in &pages {
            output::write_file(&directory.join(name), &page(command)?)?;
        }
        output::log(common, &format!("wrote the manual pages to {}", directory.display()));
        return Ok(());
    }
    let wanted = match &options.verb {
        None => &command,
        Some(name) => verbs().find(|verb| verb.get_name() == name).ok_or_else(|| {
            Failure::usage(crate::rig::unknown("verb", name, verbs().map(Command::get_name)))
        })?,
    };
    output::print(String::from_utf8_lossy(&page(wanted)?).trim_end())
}
