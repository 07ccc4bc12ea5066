//! The firmware on both emulated boards against the same code on this host, and what must not be in its image.
//!
//! What must not be there has a negative control: a build with a planted defect that the check must catch. The budgets
//! have tests of their own (`budget.rs`).

use host_sim::emulator::{
    Binary, Board, BuildOptions, Cpu, EXIT_HARD_FAULT, Emulator, EmulatorError, Firmware, Machine,
    PANIC_SYMBOL, RunLog, run_on_host,
};
use std::time::Duration;

/// Instructions of the firmware's calibration loop, without those around it.
const CALIBRATION_INSTRUCTIONS: u64 = 40_000_000;
/// Start of the flash of the real part.
const FLASH_ORIGIN: u64 = 0x0800_0000;
/// Flash of the real part, bytes.
const FLASH_BYTES: u64 = 2 << 20;
/// RAM without wait states of the real part, bytes.
const RAM_BYTES: u64 = 128 << 10;

/// Faults of the actuator that the firmware samples: backlash, m, and dry friction, N.
const FAULTS: [(&str, &str, f64); 2] = [("bkl_m", "bkl_error_m", 2e-4), ("fdj_N", "fdj_error_N", 800.0)];

/// Unwraps with the message for people, which says what to install.
fn expect<T>(result: Result<T, EmulatorError>) -> T {
    result.unwrap_or_else(|error| panic!("{error}"))
}

fn build(machine: Machine) -> Firmware {
    expect(BuildOptions::for_machine(machine).build())
}

fn run(machine: Machine, firmware: &Firmware) -> RunLog {
    let log = expect(Emulator::new(machine).run(firmware));
    assert_eq!(log.exit_code, 0, "{}: {:#?}", machine.name(), log.lines);
    log
}

fn negative_control(machine: Machine, feature: &str) -> BuildOptions {
    BuildOptions { features: vec![feature.to_owned()], ..BuildOptions::for_machine(machine) }
}

#[test]
fn both_boards_give_the_bits_of_the_host() {
    let host = expect(run_on_host());
    assert_eq!(host.exit_code, 0, "{:#?}", host.lines);
    assert!(!host.results.is_empty());
    for machine in Machine::ALL {
        assert_eq!(run(machine, &build(machine)).results, host.results, "{}", machine.name());
    }
}

/// How far the estimates of a trial are off, in their standard errors.
fn deviations(log: &RunLog, trial: &str) -> [f64; 2] {
    let result = |name: &str| log.results[&format!("{trial}.{name}")].as_f64();
    FAULTS.map(|(value, error, truth)| ((result(value) - truth) / result(error)).abs())
}

#[test]
fn the_faults_are_found_where_the_model_is_that_of_the_actuator() {
    let log = expect(run_on_host());
    let reason = |trial: &str| log.results[&format!("{trial}.stop_reason")].as_f64();
    assert!(deviations(&log, "lf").iter().all(|&off| off < 4.0), "{:?}", log.results);
    assert_eq!(reason("lf"), 0.0, "the residual is down to the noise");
    assert_eq!(log.results["lf.quiet_samples_steps"].as_f64(), 100.0, "an event in the quiet samples");
    // The square root of the valve's flow is not in the monitor's model, which takes it for friction.
    assert!(deviations(&log, "hf")[1] > 10.0, "{:?}", log.results);
    assert_eq!(reason("hf"), 1.0, "the search settles above the noise");
}

#[test]
fn instruction_counts_and_stack_repeat_exactly() {
    for machine in Machine::ALL {
        let firmware = build(machine);
        let first = run(machine, &firmware);
        // A few instructions set the loop up.
        let excess = first.measures["board.calibration.instructions"].checked_sub(CALIBRATION_INSTRUCTIONS);
        assert!(excess.is_some_and(|excess| excess < 16), "{:?}", first.measures);
        assert!((1..RAM_BYTES).contains(&first.measures["stack.bytes"]), "{:?}", first.measures);
        assert_eq!(first, run(machine, &firmware), "{}", machine.name());
    }
}

#[test]
fn the_image_fits_the_real_part() {
    let options = BuildOptions {
        binary: Binary::Workload,
        board: Board::Stm32h743,
        cpu: Cpu::CortexM7,
        features: Vec::new(),
    };
    let footprint = expect(expect(options.build()).footprint());
    assert_eq!(footprint.flash_origin, FLASH_ORIGIN);
    assert!((1..FLASH_BYTES).contains(&footprint.flash_bytes), "{footprint:?}");
    assert!((1..RAM_BYTES).contains(&footprint.static_ram_bytes), "{footprint:?}");
}

#[test]
fn no_double_precision_slips_in() {
    let machine = Machine::Mps2An386;
    for binary in [Binary::Workload, Binary::Monitor] {
        let options = BuildOptions::for_machine(machine).with(binary, &[]);
        let footprint = expect(expect(options.build()).footprint());
        assert_eq!(footprint.soft_double_symbols, [""; 0], "{binary:?}");
    }

    let control = expect(expect(negative_control(machine, "negative-control-f64").build()).footprint());
    for symbol in ["__aeabi_dadd", "__aeabi_dmul"] {
        assert!(control.soft_double_symbols.iter().any(|found| found == symbol), "{control:?}");
    }
}

#[test]
fn a_reachable_panic_does_not_link() {
    // That an image without one links is what every other test here relies on.
    match negative_control(Machine::Mps2An386, "negative-control-panic").build() {
        Err(EmulatorError::Build { stderr }) => {
            assert!(stderr.contains(&format!("undefined symbol: {PANIC_SYMBOL}")), "{stderr}");
        }
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("a reachable panic went unnoticed"),
    }
}

#[test]
fn a_monitor_of_three_faults_links_without_a_panic_and_runs() {
    for machine in Machine::ALL {
        let options = BuildOptions::for_machine(machine).with(Binary::Workload, &["three-faults"]);
        let results = run(machine, &expect(options.build())).results;
        assert!(results["three_faults.reports"].as_f64() >= 2.0, "{results:?}");
        assert_eq!(results["three_faults.restored"].as_f64(), 1.0, "{results:?}");
    }
}

#[test]
fn a_fault_ends_the_run_with_its_code() {
    let machine = Machine::Mps2An386;
    let firmware = expect(negative_control(machine, "negative-control-fault").build());
    assert_eq!(expect(Emulator::new(machine).run(&firmware)).exit_code, EXIT_HARD_FAULT);
}

#[test]
fn a_run_beyond_its_time_limit_is_ended() {
    let machine = Machine::Mps2An386;
    let result = Emulator::new(machine).time_limit(Duration::ZERO).run(&build(machine));
    assert!(matches!(result, Err(EmulatorError::TimeLimit { .. })), "{result:?}");
}
