//! `completions`, `man`: what shells and manuals know of the command line, from the command line itself.

use super::files::Files;
use crate::cli::{Cli, Common};
use crate::failure::Failure;
use crate::output;
use crate::rig::BUILT_IN;
use clap::builder::{PossibleValue, PossibleValuesParser};
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
    #[arg(id = "verb-to-show", value_name = "VERB")]
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
    let text = String::from_utf8_lossy(&text).into_owned();
    let text = match options.shell {
        Shell::Bash => with_labels(&text, &name),
        Shell::Zsh => mended_for_zsh(&text, &command),
        Shell::Fish => text + &more_for_fish(&command),
        _ => text,
    };
    output::print(text.trim_end())
}

/// An argument that takes names, with those that it knows. Bash goes on to files where no name fits; to other shells, the
/// generator would say that there are none, so what may be a file as well stays one, and its names are added later.
fn with_names(arg: Arg, goes_on_to_files: bool) -> Arg {
    if may_be_file(&arg) && !goes_on_to_files {
        return arg;
    }
    let Some((names, mark)) = names_of(arg.get_id().as_str()) else { return arg };
    let names: Vec<String> = names.into_iter().map(|name| format!("{name}{mark}")).collect();
    // A default is no name: `bkl=1e-4..2e-4`.
    let arg = arg.default_values([""; 0]).value_parser(PossibleValuesParser::new(names));
    // Hands over to what is typed after the mark: no space.
    if mark.is_empty() { arg } else { arg.value_hint(ValueHint::Other) }
}

/// May an argument be a file in place of a name? Its value says so.
fn may_be_file(arg: &Arg) -> bool {
    value_name(arg).is_some_and(|name| name.contains("FILE"))
}

fn value_name(arg: &Arg) -> Option<&str> {
    arg.get_value_names()?.first().map(clap::builder::Str::as_str)
}

/// The names that may stand in place of a file.
fn names_beside_files(arg: &Arg) -> Option<String> {
    let (names, _) = names_of(arg.get_id().as_str()).filter(|_| may_be_file(arg))?;
    Some(names.join(" "))
}

/// The names that an argument, whose own is the same in every verb, knows; and what follows one of them.
fn names_of(arg: &str) -> Option<(Vec<String>, &'static str)> {
    let named = |names: &[&str]| names.iter().map(ToString::to_string).collect();
    let channels = || named(&Channel::MEASURED.map(|channel| channel.info().column));
    Some(match arg {
        "rig" | "rig-to-show" => (named(&BUILT_IN.map(|built_in| built_in.name)), ""),
        "command" => (named(&COMMANDS.map(|command| command.name)), ""),
        "channels" => (channels(), ""),
        "noise" | "quantum" => (channels(), "="),
        "effects" => (EFFECTS.iter().map(|effect| effect.name.to_owned()).collect(), "="),
        "set" | "at" | "bounds" | "truth" | "grow" | "watch" => {
            (PARAMETERS.iter().map(|parameter| parameter.name.to_owned()).collect(), "=")
        }
        "verb-to-show" => {
            (Cli::command().get_subcommands().map(|verb| verb.get_name().to_owned()).collect(), "")
        }
        _ => return None,
    })
}

/// The script for bash with labels that it goes to: in the name of a program, the generator writes a hyphen in one way
/// where a verb is recognised, and in another one where its options stand.
fn with_labels(text: &str, name: &str) -> String {
    text.replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__"))
}

/// The script for zsh with names where they may stand in place of a file, and with options behind files: the generator
/// says (`*::`) that a list of files goes to the end. A line has one option, or what stands alone.
fn mended_for_zsh(text: &str, command: &Command) -> String {
    let arguments = command.get_subcommands().chain([command]).flat_map(Command::get_arguments);
    let of_arguments: Vec<(String, String)> = arguments
        .filter_map(|arg| {
            let value = value_name(arg)?;
            let place =
                if arg.is_positional() { format!(":{} -- ", arg.get_id()) } else { format!("]:{value}:") };
            Some((place, names_beside_files(arg)?))
        })
        .collect();
    let lines = text.lines().map(|line| line.replacen("'*::", "'*:", 1));
    let lines = lines.map(|line| match of_arguments.iter().find(|(place, _)| line.contains(place)) {
        None => line,
        Some((_, names)) => {
            let both = format!(r#": _alternative "names\:name\:({names})" "files\:file\:_files"'"#);
            line.replace(":_default'", &both)
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// What the script for fish lacks: names in place of a file, names that stand alone, and that a verb that takes nothing
/// takes no file.
fn more_for_fish(command: &Command) -> String {
    let name = command.get_name();
    let of_command = |command: &Command, is_it: &str| -> String {
        let line = |rest: String| format!("complete -c {name} -n \"{is_it}\" {rest}\n");
        let of_argument = |arg: &Arg| {
            let known = || {
                let values = arg.get_possible_values();
                values.iter().map(PossibleValue::get_name).collect::<Vec<_>>().join(" ")
            };
            match (arg.get_long(), names_beside_files(arg)) {
                (Some(long), Some(names)) => line(format!("-l {long} -r -F -a \"{names}\"")),
                (Some(_), None) => String::new(),
                (None, Some(names)) => line(format!("-F -a \"{names}\"")),
                (None, None) if known().is_empty() => String::new(),
                (None, None) => line(format!("-f -a \"{}\"", known())),
            }
        };
        let takes_nothing = command.get_positionals().next().is_none();
        let none = takes_nothing.then(|| line("-f".to_owned()));
        command.get_arguments().filter(|arg| !arg.is_hide_set()).map(of_argument).chain(none).collect()
    };
    let verbs = || command.get_subcommands().filter(|verb| verb.get_name() != "help");
    let using = format!("__fish_{}_using_subcommand", name.replace('-', "_"));
    let of_verbs = verbs().map(|verb| of_command(verb, &format!("{using} {}", verb.get_name())));
    // The generator's own function for this fails where an option still lacks its value.
    let names: Vec<&str> = verbs().map(Command::get_name).collect();
    let before_verb = format!("not __fish_seen_subcommand_from {}", names.join(" "));
    of_verbs.chain([of_command(command, &before_verb)]).collect()
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
