//! Installs what the firmware's tests need, or says exactly what is missing.

use crate::job::{self, Failure, TARGET};
use std::{path::Path, process::Command};

/// The emulator's program, and its package in Debian.
const QEMU: &str = "qemu-system-arm";

/// Installs the Rust target and QEMU where they are absent. Both are tried, so that one run tells all that is missing.
pub(crate) fn run() -> Result<(), Failure> {
    match (target(), qemu()) {
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

/// The emulator.
fn qemu() -> Result<(), Failure> {
    packages(&[QEMU], has_qemu)
}

/// Installs Debian's packages, unless what they bring is there already.
pub(crate) fn packages(names: &[&str], is_there: impl Fn() -> bool) -> Result<(), Failure> {
    if is_there() {
        return Ok(());
    }
    let mut install = vec!["install", "-y", "--no-install-recommends"];
    install.extend(names);
    if is_root() && output(Command::new("apt-get").arg("--version")).is_some() {
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

/// Can the emulator be started?
fn has_qemu() -> bool {
    output(Command::new(QEMU).arg("--version")).is_some()
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
