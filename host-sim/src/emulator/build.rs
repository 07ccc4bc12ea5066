//! Builds the firmware from this source tree, for one board and processor.

use super::{
    error::EmulatorError,
    footprint::{self, Footprint},
    log::{LogLine, RunLog},
};
use std::{
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// The Rust target of every supported part: Cortex-M4F and Cortex-M7, floats in registers.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// The symbol that the linker misses where the release firmware has a reachable panic.
pub const PANIC_SYMBOL: &str = "this_firmware_has_a_reachable_panic";

/// The code that the firmware ends with where the processor faults.
pub const EXIT_HARD_FAULT: i32 = 101;

/// Flags that keep the code small: of what the compiler would copy into its callers or write out round by round for
/// speed, what gains next to none. Measured on the streaming monitor's image: a seventh less flash for two percent more
/// instructions.
const LEAN: [&str; 3] = [
    "-Cllvm-args=-inline-threshold=40",
    "-Cllvm-args=-unroll-threshold=200",
    "-Cllvm-args=-unroll-runtime=false",
];

/// The processor that the compiler may use all instructions of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cpu {
    /// Cortex-M4F: single precision only.
    CortexM4,
    /// Cortex-M7 with the double-precision unit.
    CortexM7,
}

impl Cpu {
    /// The compiler's name of it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::CortexM4 => "cortex-m4",
            Self::CortexM7 => "cortex-m7",
        }
    }
}

/// The board that the image is linked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// The emulated mps2-an500 and mps2-an386, which share their memory map.
    Mps2,
    /// The real part. QEMU cannot run its image.
    Stm32h743,
}

impl Board {
    /// The feature of `eha-monitor` that selects it.
    const fn feature(self) -> Option<&'static str> {
        match self {
            Self::Mps2 => None,
            Self::Stm32h743 => Some("board-stm32h743"),
        }
    }
}

/// Which of the firmware's binaries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// The workload: an identification of samples that it makes itself.
    Workload,
    /// The streaming monitor behind the serial line.
    Monitor,
}

impl Binary {
    /// Its name in `eha-monitor`.
    const fn name(self) -> &'static str {
        match self {
            Self::Workload => "firmware",
            Self::Monitor => "firmware-monitor",
        }
    }
}

/// Which firmware to build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BuildOptions {
    /// The binary.
    pub binary: Binary,
    /// The board.
    pub board: Board,
    /// The processor.
    pub cpu: Cpu,
    /// Further features of `eha-monitor`.
    pub features: Vec<String>,
}

impl BuildOptions {
    /// Builds the release image, panic check included.
    ///
    /// Several processes may build different images at once: they take turns, and each image stays its own file.
    ///
    /// # Errors
    ///
    /// Where the target is not installed, or the firmware does not compile or link.
    pub fn build(&self) -> Result<Firmware, EmulatorError> {
        require_target()?;
        let directory = target_directory().join("firmware");
        let file_error = |path: &Path| {
            let path = path.to_owned();
            move |source| EmulatorError::File { path, source }
        };
        fs::create_dir_all(&directory).map_err(file_error(&directory))?;
        // Cargo puts every image under the same name: hold the lock until this one is a file of its own.
        let lock_path = directory.join("images.lock");
        let lock = fs::File::create(&lock_path).map_err(file_error(&lock_path))?;
        lock.lock().map_err(file_error(&lock_path))?;

        let output = run(&mut self.cargo(&directory))?;
        if !output.status.success() {
            return Err(EmulatorError::Build {
                stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
            });
        }
        let built = directory.join(TARGET).join("release").join(self.binary.name());
        let path = directory.join(self.image_name());
        let image = fs::read(&built).map_err(file_error(&built))?;
        // An image of this name may be running: rename, so that it keeps the file it has.
        let fresh = path.with_extension("new");
        fs::write(&fresh, &image).map_err(file_error(&fresh))?;
        fs::rename(&fresh, &path).map_err(file_error(&path))?;
        Ok(Firmware { path, image })
    }

    /// The build command.
    fn cargo(&self, target_directory: &Path) -> Command {
        let mut cargo = cargo("build", self.binary);
        cargo.args(["--release", "--target", TARGET]).arg("--target-dir").arg(target_directory);
        let features: Vec<&str> =
            self.board.feature().into_iter().chain(self.features.iter().map(String::as_str)).collect();
        cargo.arg("--features").arg(features.join(","));
        let cpu = self.cpu.name();
        let lean = LEAN.map(|flag| format!(",'{flag}'")).concat();
        cargo.arg("--config").arg(format!("target.{TARGET}.rustflags=['-Ctarget-cpu={cpu}'{lean}]"));
        // Code that is built in pieces takes more instructions, and the profile is the workspace's.
        cargo.env("CARGO_INCREMENTAL", "0");
        let is_of_profile = |name: &String| name.starts_with("CARGO_PROFILE_RELEASE_");
        for name in env::vars_os().filter_map(|(name, _)| name.into_string().ok()).filter(is_of_profile) {
            cargo.env_remove(name);
        }
        cargo
    }

    /// File name of the image.
    fn image_name(&self) -> String {
        let board = match self.board {
            Board::Mps2 => "mps2",
            Board::Stm32h743 => "stm32h743",
        };
        let parts: Vec<&str> = [self.binary.name(), board, self.cpu.name()]
            .into_iter()
            .chain(self.features.iter().map(String::as_str))
            .collect();
        format!("{}.elf", parts.join("-"))
    }
}

/// A linked image of the firmware.
#[derive(Clone, Debug)]
pub struct Firmware {
    path: PathBuf,
    image: Vec<u8>,
}

impl Firmware {
    /// Takes an image that was built before.
    ///
    /// # Errors
    ///
    /// Where the file cannot be read.
    pub fn open(path: &Path) -> Result<Self, EmulatorError> {
        let image = fs::read(path).map_err(|source| EmulatorError::File { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), image })
    }

    /// Where the image lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The image: an ELF file.
    pub(super) fn image(&self) -> &[u8] {
        &self.image
    }

    /// What the image takes of the part's memory.
    ///
    /// # Errors
    ///
    /// Where the image is no ELF file, or has no symbols.
    pub fn footprint(&self) -> Result<Footprint, EmulatorError> {
        footprint::of_image(&self.image)
    }
}

/// Builds the same firmware for this host and runs it: the reference for its results.
///
/// # Errors
///
/// Where it does not build, ends abnormally or prints a malformed line.
pub fn run_on_host() -> Result<RunLog, EmulatorError> {
    let output = run(cargo("run", Binary::Workload).arg("--target-dir").arg(target_directory()))?;
    let stderr = || String::from_utf8_lossy(&output.stderr).into_owned();
    let Some(exit_code) = output.status.code() else {
        return Err(EmulatorError::Run { status: output.status.to_string(), stderr: stderr() });
    };
    let stdout = String::from_utf8_lossy(&output.stdout);
    if exit_code != 0 && stdout.is_empty() {
        return Err(EmulatorError::Build { stderr: stderr() });
    }
    RunLog::new(
        stdout.lines().map(|line| LogLine { level: None, message: line.to_owned() }).collect(),
        exit_code,
    )
}

/// `cargo VERB` for a binary of the firmware, free of what the caller's environment would do to the compiler.
fn cargo(verb: &str, binary: Binary) -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .current_dir(workspace())
        .args([
            verb,
            "--locked",
            "--quiet",
            "--color",
            "never",
            "--package",
            "eha-monitor",
            "--features",
            "firmware",
            "--bin",
            binary.name(),
        ])
        // These win over the flags for the processor, and instrumented code is not what will fly.
        .env_remove("RUSTFLAGS")
        .env_remove("CARGO_ENCODED_RUSTFLAGS");
    cargo
}

/// Is there a core library for the target?
fn require_target() -> Result<(), EmulatorError> {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = run(Command::new(rustc).current_dir(workspace()).args([
        "--print",
        "target-libdir",
        "--target",
        TARGET,
    ]))?;
    let directory = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    if output.status.success() && Path::new(&directory).is_dir() {
        Ok(())
    } else {
        Err(EmulatorError::TargetMissing)
    }
}

/// Root of the source tree that this program was built from.
fn workspace() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package)
}

/// Where this workspace builds.
fn target_directory() -> PathBuf {
    env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| workspace().join("target"), |directory| workspace().join(directory))
}

/// Runs a command to its end.
fn run(command: &mut Command) -> Result<Output, EmulatorError> {
    command.output().map_err(|source| EmulatorError::Program {
        program: command.get_program().to_string_lossy().into_owned(),
        source,
    })
}
