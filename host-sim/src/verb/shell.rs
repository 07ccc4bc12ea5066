//! `completions`, `man`: what shells and manuals know of the command line, from the command line itself.

use super::files::Files;
use crate::cli::{Cli, Common};
use crate::failure::Failure;
use crate::output;
use clap::CommandFactory as _;
use clap_complete::Shell;

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
    let mut text = Vec::new();
    let mut command = Cli::command();
    let name = command.get_name().to_owned();
    clap_complete::generate(options.shell, &mut command, name, &mut text);
    output::print(String::from_utf8_lossy(&text).trim_end())
}

/// Prints a manual page, or writes all of them.
///
/// # Errors
/// Usage: no such verb. A file cannot be written.
pub fn man(common: &Common, options: &ManOptions) -> Result<(), Failure> {
    let mut command = Cli::command();
    command.build();
    let page = |command: &clap::Command| -> Result<Vec<u8>, Failure> {
        let mut text = Vec::new();
        clap_mangen::Man::new(command.clone()).render(&mut text).map_err(Failure::other)?;
        Ok(text)
    };
    let verbs = || command.get_subcommands().filter(|verb| verb.get_name() != "help");
    if let Some(directory) = &common.out {
        let of_verb =
            |verb: &clap::Command| (format!("{}-{}.1", command.get_name(), verb.get_name()), verb.clone());
        let own = (format!("{}.1", command.get_name()), command.clone());
        let pages: Vec<(String, clap::Command)> = std::iter::once(own).chain(verbs().map(of_verb)).collect();
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
            Failure::usage(crate::rig::unknown("verb", name, verbs().map(clap::Command::get_name)))
        })?,
    };
    output::print(String::from_utf8_lossy(&page(wanted)?).trim_end())
}
