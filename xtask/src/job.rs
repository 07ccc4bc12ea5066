//! The jobs themselves: commands, each shown before it runs.

use std::{env, ffi::OsStr, fmt, io, iter, path::Path, process::Command};

/// The Rust target of every supported part.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Why a job failed.
pub(crate) enum Failure {
    /// A command could not be started.
    Start {
        /// The command line.
        command: String,
        /// What the system says.
        error: io::Error,
    },
    /// A command failed, and said why.
    Command(String),
    /// A command that had to fail for a reason did not, or for another one.
    NotRefused {
        /// The command line.
        command: String,
        /// What it had to say.
        reason: &'static str,
    },
    /// Something is not installed and cannot be installed from here. The text says what to do.
    Missing(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Start { command, error } => write!(f, "cannot run `{command}`: {error}"),
            Self::Command(command) => write!(f, "`{command}` failed"),
            Self::NotRefused { command, reason } => write!(f, "`{command}` did not fail with `{reason}`"),
            Self::Missing(text) => f.write_str(text),
        }
    }
}

/// Checks the formatting.
pub(crate) fn fmt() -> Result<(), Failure> {
    run(cargo().args(["fmt", "--all", "--check"]))?;
    run(cargo_for_integrator("fmt").args(["--all", "--check"]))
}

/// Lints the workspace for the host, and what goes to the microcontroller for that.
pub(crate) fn clippy() -> Result<(), Failure> {
    const DENY: [&str; 3] = ["--", "-D", "warnings"];
    run(cargo().args(["clippy", "--locked", "--workspace", "--all-targets", "--all-features"]).args(DENY))?;
    run(cargo_for_firmware("clippy", &FIRMWARE).arg("--all-features").args(DENY))?;
    run(cargo_for_integrator("clippy").args(["--locked", "--release"]).args(DENY))
}

/// Builds the documentation, of private items too: that is what a newcomer reads.
pub(crate) fn doc() -> Result<(), Failure> {
    let doc = ["doc", "--locked", "--workspace", "--no-deps", "--document-private-items"];
    let with_the_images = ["--features", "eha-monitor/firmware"];
    run(cargo().args(doc).args(with_the_images).env("RUSTDOCFLAGS", "-D warnings"))
}

/// Runs every test that is not left out.
pub(crate) fn test() -> Result<(), Failure> {
    run(cargo().args(["test", "--locked", "--workspace"]))
}

/// Runs the hard cases, which the tests leave out.
pub(crate) fn hard() -> Result<(), Failure> {
    run(suite().args(["--", "--ignored", "--skip", WRITES]))
}

/// With this the names of the tests begin that write documents.
const WRITES: &str = "write_the";

/// Makes the table of what `diagnose` makes of every effect.
pub(crate) fn confusion() -> Result<(), Failure> {
    run(&mut written_by("write_the_table"))
}

/// Makes the document of the drawn cases, or shows some of them, or saves their records.
pub(crate) fn blind(cases: &[u64], records: Option<&Path>) -> Result<(), Failure> {
    let cases: Vec<String> = cases.iter().map(u64::to_string).collect();
    let mut cargo = written_by("write_the_drawn_cases");
    cargo.env("BLIND_CASES", cases.join(" "));
    if let Some(folder) = records {
        // The test runs elsewhere.
        cargo.env("BLIND_RECORDS", env::current_dir().unwrap_or_default().join(folder));
    }
    run(&mut cargo)
}

/// A test that writes a document, and shows it as it is made.
fn written_by(test: &str) -> Command {
    let mut suite = suite();
    suite.args(["--", "--ignored", "--nocapture", test]);
    suite
}

/// The tests of the host program from outside.
fn suite() -> Command {
    let mut cargo = cargo();
    cargo.args(["test", "--locked", "--package", "host-sim", "--test", "suite"]);
    cargo
}

/// Links the release firmware for every board. The emulated boards share one image here, which leaves out what only
/// one of their processors can do; the tests build one for each.
pub(crate) fn firmware() -> Result<(), Failure> {
    run(&mut cargo_for_firmware("build", &FIRMWARE))?;
    // The streaming monitor's line is that of the emulated boards.
    run(cargo_for_firmware("build", &FIRMWARE[..1]).args(["--features", "board-stm32h743"]))
}

/// Links a firmware that uses the library as its own author writes one. Beside what the library's own images bring it must
/// not link, or it would show nothing.
pub(crate) fn integrator() -> Result<(), Failure> {
    let build = || {
        let mut cargo = cargo_for_integrator("build");
        cargo.args(["--locked", "--release"]);
        cargo
    };
    run(&mut build())?;
    refused(build().args(["--features", "images-of-the-library"]), "_critical_section_1_0_acquire")
}

/// `cargo VERB` on the firmware of a user of the library: a workspace of its own, which builds where this one has built most of
/// what it needs.
fn cargo_for_integrator(verb: &str) -> Command {
    let mut cargo = cargo();
    cargo.current_dir(root().join("tests/integrator")).arg(verb);
    if env::var_os("CARGO_TARGET_DIR").is_none() {
        cargo.env("CARGO_TARGET_DIR", root().join("target"));
    }
    cargo
}

/// Root of the workspace.
fn root() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package)
}

/// Cargo, as the one that runs this program, at the root of the workspace.
fn cargo() -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(root());
    // What serves the next build, or a debugger, is of no use to a clone that is built once.
    if env::var_os("CI").is_some() {
        cargo.envs([("CARGO_INCREMENTAL", "0"), ("CARGO_PROFILE_DEV_DEBUG", "0")]);
    }
    cargo
}

/// The firmware's binaries: the workload and the streaming monitor.
const FIRMWARE: [&str; 2] = ["firmware", "firmware-monitor"];

/// `cargo VERB` on binaries of the release firmware. Without `--package` the host program's features would reach the
/// dependencies that both share, and those need a standard library.
fn cargo_for_firmware(verb: &str, binaries: &[&str]) -> Command {
    let mut cargo = cargo();
    cargo.args([verb, "--locked", "--release", "--package", "eha-monitor", "--target", TARGET]);
    cargo.args(["--features", "firmware"]);
    cargo.args(binaries.iter().flat_map(|binary| ["--bin", binary]));
    cargo
}

/// Shows a command and runs it to its end.
pub(crate) fn run(command: &mut Command) -> Result<(), Failure> {
    let line = shown(command);
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err(Failure::Command(line)),
        Err(error) => Err(Failure::Start { command: line, error }),
    }
}

/// Shows a command and runs it: it must fail, and say a reason.
fn refused(command: &mut Command, reason: &'static str) -> Result<(), Failure> {
    let line = shown(command);
    match command.output() {
        Ok(output)
            if !output.status.success() && String::from_utf8_lossy(&output.stderr).contains(reason) =>
        {
            eprintln!("refused, as it must be: {reason}");
            Ok(())
        }
        Ok(output) => {
            eprint!("{}", String::from_utf8_lossy(&output.stderr));
            Err(Failure::NotRefused { command: line, reason })
        }
        Err(error) => Err(Failure::Start { command: line, error }),
    }
}

/// A command as one types it; shows it.
fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_name().unwrap_or(command.get_program());
    let words: Vec<_> = iter::once(program).chain(command.get_args()).map(OsStr::to_string_lossy).collect();
    let line = words.join(" ");
    eprintln!("$ {line}");
    line
}
