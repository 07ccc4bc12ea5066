//! What the firmware costs on the emulated boards, against the limits of `budgets.toml`.

mod limits;

pub use limits::Budget;

use crate::emulator::{Binary, BuildOptions, Emulator, Footprint, Machine};
use crate::failure::Failure;
use crate::hil::{Image, Session, line::Line};
use std::collections::BTreeMap;

/// How a flight of the streaming monitor is made.
type Make = fn() -> Result<Session, Failure>;

/// Flights of the streaming monitor, as `budgets.toml` names them.
const FLIGHTS: [(&str, Make); 3] = [
    ("monitor", || Session::reference(Image::Plain)),
    ("saturated", Session::saturated),
    ("any_rig", || Session::reference(Image::AnyRig)),
];

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
        let mut measures = of_workload(machine, features)?;
        for (name, make) in FLIGHTS {
            measures.append(&mut of_monitor(name, &make()?, machine, features)?);
        }
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

/// What the workload measures, and what its image takes.
fn of_workload(machine: Machine, features: &[&str]) -> Result<BTreeMap<String, u64>, Failure> {
    let options = BuildOptions::for_machine(machine).with(Binary::Workload, features);
    let firmware = options.build().map_err(Failure::other)?;
    let log = Emulator::new(machine).run(&firmware).map_err(Failure::other)?;
    ended_well(machine, log.exit_code)?;
    let footprint = firmware.footprint().map_err(Failure::other)?;
    Ok(named("workload", log.measures, &footprint))
}

/// What the image of the streaming monitor that a session needs measures on it, and what it takes.
fn of_monitor(
    name: &str,
    session: &Session,
    machine: Machine,
    features: &[&str],
) -> Result<BTreeMap<String, u64>, Failure> {
    let options = session.build_options(machine, features);
    let footprint = options.build().and_then(|firmware| firmware.footprint()).map_err(Failure::other)?;
    let outcome = session.run(Line::to_emulator(machine, features, session)?, |_| {})?;
    let log = outcome.log.ok_or_else(|| Failure::other("the monitor's run left no log"))?;
    ended_well(machine, log.exit_code)?;
    Ok(named(name, log.measures, &footprint))
}

/// What a run measured and what its image takes, as `budgets.toml` names them.
fn named(run: &str, measures: BTreeMap<String, u64>, footprint: &Footprint) -> BTreeMap<String, u64> {
    let image = [
        ("static_ram_bytes", footprint.static_ram_bytes),
        ("flash_bytes", footprint.flash_bytes),
        ("core_flash_bytes", footprint.core_flash_bytes),
    ];
    let image = image.map(|(name, value)| (name.to_owned(), value));
    measures.into_iter().chain(image).map(|(name, value)| (format!("{run}.{name}"), value)).collect()
}

fn ended_well(machine: Machine, code: i32) -> Result<(), Failure> {
    if code == 0 {
        Ok(())
    } else {
        Err(Failure::other(format!("{}: the firmware ended with code {code}", machine.name())))
    }
}
