//! Runs an image under QEMU.

use super::{
    build::{Binary, Board, BuildOptions, Cpu, Firmware},
    error::EmulatorError,
    log::{self, RunLog},
};
use std::{
    io::{self, Read},
    process::{Child, Command, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

/// The emulator's program.
const QEMU: &str = "qemu-system-arm";

/// Time limit of a run unless one is given. A billion instructions take some 2 s.
pub const DEFAULT_TIME_LIMIT: Duration = Duration::from_mins(2);

/// How often a run is asked whether it has ended.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// An emulated board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Machine {
    /// Cortex-M7.
    #[value(name = "mps2-an500")]
    Mps2An500,
    /// Cortex-M4F.
    #[value(name = "mps2-an386")]
    Mps2An386,
}

impl Machine {
    /// Every emulated board.
    pub const ALL: [Self; 2] = [Self::Mps2An500, Self::Mps2An386];

    /// QEMU's name of it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mps2An500 => "mps2-an500",
            Self::Mps2An386 => "mps2-an386",
        }
    }

    /// Its processor.
    pub const fn cpu(self) -> Cpu {
        match self {
            Self::Mps2An500 => Cpu::CortexM7,
            Self::Mps2An386 => Cpu::CortexM4,
        }
    }
}

impl BuildOptions {
    /// The firmware's workload for an emulated board, with the instructions of its processor.
    pub const fn for_machine(machine: Machine) -> Self {
        Self { binary: Binary::Workload, board: Board::Mps2, cpu: machine.cpu(), features: Vec::new() }
    }

    /// These options for another binary, with further features.
    #[must_use]
    pub fn with(self, binary: Binary, features: &[&str]) -> Self {
        Self { binary, features: features.iter().map(|&feature| feature.to_owned()).collect(), ..self }
    }
}

/// An emulated board, ready to run images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emulator {
    machine: Machine,
    time_limit: Duration,
    /// Port on this host that the board's serial line is connected to.
    line: Option<u16>,
}

impl Emulator {
    /// The board `machine`, with a limit of two minutes on a run.
    pub const fn new(machine: Machine) -> Self {
        Self { machine, time_limit: DEFAULT_TIME_LIMIT, line: None }
    }

    /// Sets the wall-clock limit of a run.
    #[must_use]
    pub const fn time_limit(mut self, limit: Duration) -> Self {
        self.time_limit = limit;
        self
    }

    /// Connects the board's first serial line to a port on which this host listens.
    #[must_use]
    pub const fn line(mut self, port: u16) -> Self {
        self.line = Some(port);
        self
    }

    /// Runs `firmware` until it ends by itself.
    ///
    /// # Errors
    ///
    /// Where QEMU is missing or fails, the run exceeds its time limit, or the log cannot be understood.
    /// A firmware that ends with another code than 0 is no error here: see [`RunLog::exit_code`].
    pub fn run(&self, firmware: &Firmware) -> Result<RunLog, EmulatorError> {
        let mut qemu = Running(self.command(firmware).spawn().map_err(|source| {
            if source.kind() == io::ErrorKind::NotFound {
                EmulatorError::QemuMissing
            } else {
                program_error(source)
            }
        })?);
        // QEMU stops where a pipe is full: both are read while it runs.
        let stdout = read_in_background(qemu.0.stdout.take());
        let stderr = read_in_background(qemu.0.stderr.take());
        let status = qemu.wait(self.time_limit)?;
        drop(qemu);
        let collected = |reader: thread::JoinHandle<Vec<u8>>| reader.join().unwrap_or_default();
        let lines = log::decode(firmware.image(), &collected(stdout))?;
        let Some(status) = status else {
            let messages: Vec<&str> = lines.iter().map(|line| line.message.as_str()).collect();
            return Err(EmulatorError::TimeLimit { limit: self.time_limit, log: messages.join("\n") });
        };
        let stderr = String::from_utf8_lossy(&collected(stderr)).into_owned();
        // QEMU reports its own failures on the standard error stream, which the firmware cannot reach.
        match status.code() {
            Some(code) if stderr.is_empty() => RunLog::new(lines, code),
            _ => Err(EmulatorError::Run { status: status.to_string(), stderr }),
        }
    }

    /// The command line. `-icount` makes time a function of the instructions, at 64 ns each.
    fn command(&self, firmware: &Firmware) -> Command {
        let mut command = Command::new(QEMU);
        command
            .args(["-machine", self.machine.name()])
            .args(["-display", "none", "-monitor", "none"])
            .args(["-chardev", "stdio,id=log,signal=off"])
            .args(["-semihosting-config", "enable=on,target=native,chardev=log"])
            .args(["-icount", "shift=6,align=off,sleep=off"])
            .arg("-kernel")
            .arg(firmware.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        if let Some(port) = self.line {
            let socket = format!("socket,id=line,host=127.0.0.1,port={port},nodelay=on");
            command.args(["-chardev", &socket, "-serial", "chardev:line"]);
        } else {
            command.args(["-serial", "none"]);
        }
        command
    }
}

/// A run that does not outlive its owner.
struct Running(Child);

impl Running {
    /// Waits for the end; none where `limit` comes first.
    fn wait(&mut self, limit: Duration) -> Result<Option<ExitStatus>, EmulatorError> {
        let deadline = Instant::now() + limit;
        loop {
            if let Some(status) = self.0.try_wait().map_err(program_error)? {
                return Ok(Some(status));
            }
            if Instant::now() >= deadline {
                return Ok(None);
            }
            thread::sleep(POLL_INTERVAL);
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Both fail only where the run has already ended and been waited for.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// QEMU could not be started or waited for.
fn program_error(source: io::Error) -> EmulatorError {
    EmulatorError::Program { program: QEMU.to_owned(), source }
}

/// Reads a pipe to its end on a thread of its own; what arrived before a read error counts.
fn read_in_background(pipe: Option<impl Read + Send + 'static>) -> thread::JoinHandle<Vec<u8>> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut pipe) = pipe {
            let _ = pipe.read_to_end(&mut bytes);
        }
        bytes
    })
}
