//! Installs what the tests need beside Rust: what those of the firmware need, or a message that says exactly what is
//! missing; a browser for those of the reports and shells for those of their completions, which are skipped without.

use crate::job::{self, Failure, TARGET};
use std::{path::Path, process::Command};

/// The emulator's program, and its package in Debian.
const QEMU: &str = "qemu-system-arm";
/// The browser's program, and its package in Debian.
const BROWSER: &str = "chromium";
/// Programs of the shells beside bash, and their packages in Debian.
const SHELLS: [&str; 2] = ["zsh", "fish"];

/// Installs the Rust target, QEMU, a browser and shells where they are absent. All are tried, so that one run tells all that
/// is missing. It is no failure if there is no browser or a shell is missing.
pub(crate) fn run() -> Result<(), Failure> {
    if let Err(missing) = program(BROWSER) {
        eprintln!("xtask: {missing}; without it, the tests that look at reports are skipped");
    }
    if let Err(missing) = packages(&SHELLS, || SHELLS.into_iter().all(has)) {
        eprintln!("xtask: {missing}; without them, the tests of completions in those shells are skipped");
    }
    match (target(), program(QEMU)) {
        (Err(target), Err(qemu)) => Err(Failure::Missing(format!("{target}\n{qemu}"))),
        (target, qemu) => target.and(qemu),
    }
}

/// The core library of the microcontroller.
fn target() -> Result<(), Failure> {
    if has_target() {
        return Ok(());
    }
    match job::run(Command::new("rustup").args(["target", "add", TARGET])) {
        Ok(()) if has_target() => Ok(()),
        _ => Err(Failure::Missing(format!(
            "the Rust target {TARGET} is not installed, and rustup could not add it: run `rustup target add {TARGET}` \
             where the network allows it, or unpack the component `rust-std` of {TARGET}, of the release that \
             `rustc --version` names, into the directory that `rustc --print sysroot` names"
        ))),
    }
}

/// Does this compiler have the core library of the microcontroller?
fn has_target() -> bool {
    let print = output(Command::new("rustc").args(["--print", "target-libdir", "--target", TARGET]));
    print.is_some_and(|directory| Path::new(&directory).is_dir())
}

/// A program that has the name of its package.
fn program(name: &str) -> Result<(), Failure> {
    packages(&[name], || has(name))
}

/// Installs Debian's packages, unless what they bring is there already.
pub(crate) fn packages(names: &[&str], is_there: impl Fn() -> bool) -> Result<(), Failure> {
    if is_there() {
        return Ok(());
    }
    let mut install = vec!["install", "-y", "--no-install-recommends"];
    install.extend(names);
    if is_root() && has("apt-get") {
        let installed = job::run(Command::new("apt-get").arg("update"))
            .and_then(|()| job::run(Command::new("apt-get").args(&install)));
        if installed.is_ok() && is_there() {
            return Ok(());
        }
    }
    Err(Failure::Missing(format!(
        "{} is not installed: as root, run `apt-get update && apt-get {}`, or the like of it where there is no apt",
        names.join(", "),
        install.join(" ")
    )))
}

/// Can a program be started?
fn has(name: &str) -> bool {
    output(Command::new(name).arg("--version")).is_some()
}

/// May this process install packages?
fn is_root() -> bool {
    output(Command::new("id").arg("-u")).is_some_and(|id| id == "0")
}

/// What a command prints, without the white space around it; none where it fails or does not exist.
pub(crate) fn output(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
