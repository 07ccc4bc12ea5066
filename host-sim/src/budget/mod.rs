//! What the firmware costs on the emulated boards, against the limits of `budgets.toml`.

mod limits;

pub use limits::Budget;

use crate::emulator::{BuildOptions, Emulator, Machine};
use crate::failure::Failure;

/// One figure against its limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Measure {
    /// The budget.
    pub budget: Budget,
    /// What was measured.
    pub value: u64,
    /// Most that it may be.
    pub limit: u64,
}

impl Measure {
    /// Is the limit kept?
    pub const fn is_kept(&self) -> bool {
        self.value <= self.limit
    }

    /// Is there a target that the figure misses?
    pub fn misses_target(&self) -> bool {
        self.budget.target.is_some_and(|target| self.value > target)
    }
}

/// The figures of one board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Target {
    /// The board.
    pub machine: Machine,
    /// Its figures, in the order of the file.
    pub measures: Vec<Measure>,
}

impl Target {
    /// Builds the firmware for a board with further features of `eha-monitor`, runs it and takes its figures.
    ///
    /// # Errors
    /// It does not build or run, or a budget of the file is not measured.
    pub fn measure(machine: Machine, features: &[&str]) -> Result<Self, Failure> {
        let options = BuildOptions::for_machine(machine);
        let features = features.iter().map(|&feature| feature.to_owned()).collect();
        let firmware = BuildOptions { features, ..options }.build().map_err(Failure::other)?;
        let log = Emulator::new(machine).run(&firmware).map_err(Failure::other)?;
        if log.exit_code != 0 {
            let name = machine.name();
            return Err(Failure::other(format!("{name}: the firmware ended with code {}", log.exit_code)));
        }
        let footprint = firmware.footprint().map_err(Failure::other)?;
        let mut measures = log.measures;
        measures.insert("image.static_ram_bytes".to_owned(), footprint.static_ram_bytes);
        measures.insert("image.flash_bytes".to_owned(), footprint.flash_bytes);
        let measure = |budget: Budget| {
            let (value, limit) = (budget.figure(&measures)?, budget.limit(machine.name())?);
            Ok(Measure { budget, value, limit })
        };
        let measures = Budget::all()?.into_iter().map(measure).collect::<Result<_, Failure>>()?;
        Ok(Self { machine, measures })
    }

    /// The figures that are above their limits.
    pub fn overruns(&self) -> impl Iterator<Item = &Measure> {
        self.measures.iter().filter(|measure| !measure.is_kept())
    }
}
