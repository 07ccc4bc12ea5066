//! The budgets of `budgets.toml`: kept by the firmware on both boards, and each seen to fail where it is overrun.

use host_sim::budget::{Budget, Target};
use host_sim::emulator::Machine;
use std::collections::BTreeSet;

/// The machine of the negative controls: the slower one.
const CONTROL_MACHINE: Machine = Machine::Mps2An386;

/// Figures that have to be there, whatever else is.
const REQUIRED: [&str; 8] = [
    "instructions_per_lf_step",
    "instructions_per_generation",
    "instructions_push_worst",
    "instructions_per_identification",
    "instructions_per_frame",
    "stack_bytes",
    "static_ram_bytes",
    "flash_bytes",
];

fn measure(machine: Machine, features: &[&str]) -> Target {
    Target::measure(machine, features).unwrap_or_else(|failure| panic!("{failure}"))
}

#[test]
fn the_firmware_keeps_its_budgets_and_they_are_tight() {
    for machine in Machine::ALL {
        let target = measure(machine, &[]);
        for measure in &target.measures {
            println!("{}: {} = {} of {}", machine.name(), measure.budget.name, measure.value, measure.limit);
        }
        assert_eq!(target.overruns().collect::<Vec<_>>(), [] as [&_; 0]);
        for name in REQUIRED {
            assert!(
                target.measures.iter().any(|measure| measure.budget.name == name),
                "{name} is not measured"
            );
        }
        for measure in &target.measures {
            let (name, machine) = (&measure.budget.name, machine.name());
            assert!(!measure.budget.reason.is_empty(), "{name}");
            if measure.misses_target() || measure.budget.target.is_none() {
                assert!(
                    measure.limit * 20 <= measure.value * 23,
                    "{machine}: {name}: a limit with too much room"
                );
            } else {
                assert!(
                    Some(measure.limit) <= measure.budget.target,
                    "{machine}: {name}: looser than its target"
                );
            }
        }
    }
}

#[test]
fn every_budget_fails_where_it_is_overrun_and_no_other_does() {
    let budgets = Budget::all().unwrap_or_else(|failure| panic!("{failure}"));
    let controls: BTreeSet<&str> = budgets.iter().map(|budget| budget.control.as_str()).collect();
    for control in controls {
        let target = measure(CONTROL_MACHINE, &[control]);
        let overrun: Vec<&str> = target.overruns().map(|measure| measure.budget.name.as_str()).collect();
        let meant: Vec<&str> = budgets
            .iter()
            .filter(|budget| budget.control == control)
            .map(|budget| budget.name.as_str())
            .collect();
        let values: Vec<(&str, u64)> =
            target.overruns().map(|measure| (measure.budget.name.as_str(), measure.value)).collect();
        assert_eq!(overrun, meant, "{control}: {values:?}");
    }
}
