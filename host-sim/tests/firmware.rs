//! The firmware on both emulated boards against the same code on this host, and the budgets of its image.
//!
//! Every budget has a negative control: a build with a planted defect that the budget must catch.

use host_sim::emulator::{
    Board, BuildOptions, Cpu, EXIT_HARD_FAULT, Emulator, EmulatorError, Firmware, Machine, PANIC_SYMBOL,
    RunLog, run_on_host,
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

#[test]
fn instruction_counts_and_stack_repeat_exactly() {
    for machine in Machine::ALL {
        let firmware = build(machine);
        let first = run(machine, &firmware);
        // Three wraps of the timer at 8 instructions each, and a few to set the loop up.
        let excess = first.measures["board.calibration.instructions"].checked_sub(CALIBRATION_INSTRUCTIONS);
        assert!(excess.is_some_and(|excess| excess < 40), "{:?}", first.measures);
        assert!((1..RAM_BYTES).contains(&first.measures["stack.bytes"]), "{:?}", first.measures);
        assert_eq!(first, run(machine, &firmware), "{}", machine.name());
    }
}

#[test]
fn the_image_fits_the_real_part() {
    let options = BuildOptions { board: Board::Stm32h743, cpu: Cpu::CortexM7, features: Vec::new() };
    let footprint = expect(expect(options.build()).footprint());
    assert_eq!(footprint.flash_origin, FLASH_ORIGIN);
    assert!((1..FLASH_BYTES).contains(&footprint.flash_bytes), "{footprint:?}");
    assert!((1..RAM_BYTES).contains(&footprint.static_ram_bytes), "{footprint:?}");
}

#[test]
fn no_double_precision_slips_in() {
    let machine = Machine::Mps2An386;
    let footprint = expect(build(machine).footprint());
    assert_eq!(footprint.soft_double_symbols, [""; 0]);

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
