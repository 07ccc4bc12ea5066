//! `host-sim budget`: what the firmware costs on the emulated boards, against its limits.

use crate::budget::{Measure, Target};
use crate::cli::Common;
use crate::emulator::Machine;
use crate::failure::Failure;
use crate::output;
use serde_json::{Value, json};

/// Clock of the real part's Cortex-M7, Hz.
const CLOCK_HZ: f64 = 480e6;
/// Cycles that an instruction is taken for.
const CYCLES_PER_INSTRUCTION: f64 = 1.0;
/// What the figures are, and what the estimate of cycles rests on.
const ASSUMPTION: &str = "Instructions counted under QEMU, not cycles: it has no pipeline, cache or wait state. The time \
                          takes one cycle for each at 480 MHz, code and data in memory without wait states; a \
                          Cortex-M7 issues up to two in a cycle and loses some to branches and divisions.";

/// Options of `budget`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Only this emulated board.
    #[arg(long, value_enum)]
    machine: Option<Machine>,
}

/// Runs the verb.
///
/// # Errors
/// The firmware cannot be built or run, or a limit is exceeded (the figures are printed all the same).
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let machines = options.machine.map_or(Machine::ALL.to_vec(), |machine| vec![machine]);
    let mut targets = Vec::new();
    for machine in machines {
        output::log(common, &format!("{}: building and running the firmware", machine.name()));
        targets.push(Target::measure(machine, &[])?);
    }
    if common.json {
        output::print_json(&json_of(common, &targets))?;
    } else {
        print(&targets)?;
    }
    let overruns: Vec<String> = targets.iter().flat_map(overruns_of).collect();
    if overruns.is_empty() { Ok(()) } else { Err(Failure::other(overruns.join("\n"))) }
}

fn overruns_of(target: &Target) -> impl Iterator<Item = String> {
    target.overruns().map(|measure| {
        let Measure { budget, value, limit } = measure;
        format!("{}: {} is {value} {}, the limit is {limit}", target.machine.name(), budget.name, budget.unit)
    })
}

/// What some instructions take on the real part, s, as estimated.
fn seconds(measure: &Measure) -> Option<f64> {
    let cycles = measure.value as f64 * CYCLES_PER_INSTRUCTION;
    (measure.budget.unit == "instructions").then_some(cycles / CLOCK_HZ)
}

fn json_of(common: &Common, targets: &[Target]) -> Value {
    let measure = |measure: &Measure| {
        json!({
            "name": measure.budget.name,
            "value": measure.value,
            "limit": measure.limit,
            "unit": measure.budget.unit,
            "target": measure.budget.target,
            "target_missed": measure.misses_target(),
            "estimated_cycles": seconds(measure).map(|seconds| seconds * CLOCK_HZ),
            "reason": measure.budget.reason,
        })
    };
    let target = |target: &Target| {
        json!({
            "machine": target.machine.name(),
            "measures": target.measures.iter().map(measure).collect::<Vec<_>>(),
        })
    };
    json!({
        "schema": output::SCHEMA,
        "assumption": ASSUMPTION,
        "clock_hz": CLOCK_HZ,
        "cycles_per_instruction": CYCLES_PER_INSTRUCTION,
        "targets": targets.iter().map(target).collect::<Vec<_>>(),
        "seed": common.seed,
        "config": {
            "version": env!("CARGO_PKG_VERSION"),
            "machines": targets.iter().map(|target| target.machine.name()).collect::<Vec<_>>(),
        },
    })
}

fn print(targets: &[Target]) -> Result<(), Failure> {
    for target in targets {
        let mut table =
            output::table(["measure", "value", "limit", "target", "unit", "at 480 MHz", "verdict"]);
        for measure in &target.measures {
            let verdict = match (measure.is_kept(), measure.misses_target()) {
                (false, _) => "OVER THE LIMIT",
                (true, true) => "kept, target missed",
                (true, false) => "kept",
            };
            table.add_row([
                measure.budget.name.clone(),
                measure.value.to_string(),
                measure.limit.to_string(),
                measure.budget.target.map_or("-".to_owned(), |target| target.to_string()),
                measure.budget.unit.clone(),
                seconds(measure).map_or("-".to_owned(), |seconds| format!("{:.3} us", seconds * 1e6)),
                verdict.to_owned(),
            ]);
        }
        output::print(&format!("{} ({})\n{table}\n", target.machine.name(), target.machine.cpu().name()))?;
    }
    output::print(ASSUMPTION)
}
