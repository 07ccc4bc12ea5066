//! The benchmark beside other programs: installs what they are made with, and runs it.

use crate::job::{self, Failure};
use crate::setup::{output, packages};
use std::{env, path::PathBuf, process::Command};

/// Debian's packages of compilers, `NLopt` and Python's environments.
const PACKAGES: [&str; 4] = ["gcc", "g++", "libnlopt-dev", "python3-venv"];
/// Python's packages.
const PYTHON_PACKAGES: [&str; 2] = ["numba", "scipy"];

/// Runs the benchmark.
pub(crate) fn run() -> Result<(), Failure> {
    packages(&PACKAGES, has_packages)?;
    let python = python()?;
    let bench = ["bench", "--locked", "--package", "eha-monitor", "--bench", "peers"];
    job::run(Command::new(env!("CARGO")).args(bench).env("PEERS_PYTHON", python))
}

/// Do the compilers find what they need?
fn has_packages() -> bool {
    let answers = |program: &str, argument: &str| output(Command::new(program).arg(argument)).is_some();
    let has_nlopt =
        output(Command::new("gcc").args(["-E", "-include", "nlopt.h", "-x", "c", "/dev/null"])).is_some();
    answers("gcc", "--version") && answers("g++", "--version") && has_nlopt
}

/// A Python with the packages: in an environment of its own beside the build.
fn python() -> Result<PathBuf, Failure> {
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| PathBuf::from("target"), PathBuf::from);
    let directory = target.join("peers-python");
    let python = directory.join("bin/python");
    let has_packages = || output(Command::new(&python).args(["-c", "import numba, scipy"])).is_some();
    if !has_packages() {
        job::run(Command::new("python3").args(["-m", "venv"]).arg(&directory))?;
        job::run(Command::new(&python).args(["-m", "pip", "install", "--quiet"]).args(PYTHON_PACKAGES))?;
    }
    Ok(python)
}
