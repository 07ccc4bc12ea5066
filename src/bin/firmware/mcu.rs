//! The workload's platform on a Cortex-M: entry and measurement.

#[path = "counter.rs"]
mod counter;
#[path = "hogs.rs"]
mod hogs;
#[cfg(not(feature = "board-stm32h743"))]
#[path = "registers.rs"]
mod registers;
#[path = "runtime.rs"]
mod runtime;

use crate::{
    Platform,
    workload::{self, Memory},
};
use counter::Counter;
use runtime::{EXIT_NO_PERIPHERALS, report_stack};
use semihosting::process;

/// Rounds of a loop of two instructions, which shows that the counter is right.
const CALIBRATION_ROUNDS: u32 = 20_000_000;

#[cortex_m_rt::entry]
fn start() -> ! {
    // The macro hands out a `static mut` of the entry as a reference, once: the entry runs once.
    static mut MEMORY: Memory = Memory::new();
    let Some(peripherals) = cortex_m::Peripherals::take() else {
        process::exit(EXIT_NO_PERIPHERALS);
    };
    let mut board = Board { counter: Counter::new(peripherals) };
    board.measure("board", "calibration", || cortex_m::asm::delay(CALIBRATION_ROUNDS));
    workload::run(&mut board, MEMORY);
    hogs::take();
    report_stack();
    if cfg!(feature = "negative-control-fault") {
        cortex_m::asm::udf();
    }
    process::exit(0);
}

/// The microcontroller.
struct Board {
    counter: Counter,
}

impl Platform for Board {
    fn result_f32(&mut self, group: &str, name: &str, value: f32) {
        defmt::println!("result {=str}.{=str}={=u32:#010x}", group, name, value.to_bits());
    }

    fn result_count(&mut self, group: &str, name: &str, value: u64) {
        defmt::println!("result {=str}.{=str}={=u64}", group, name, value);
    }

    fn measure<T>(&mut self, group: &str, name: &str, work: impl FnOnce() -> T) -> T {
        let (value, cost) = self.counter.cost_of(work);
        counter::report(group, name, cost);
        value
    }

    fn measure_worst(
        &mut self,
        group: &str,
        name: &str,
        rounds: u32,
        mut prepare: impl FnMut(u32),
        mut work: impl FnMut(u32),
    ) {
        let mut worst = 0;
        for round in 0..rounds {
            prepare(round);
            let ((), cost) = self.counter.cost_of(|| work(round));
            worst = worst.max(cost);
        }
        counter::report(group, name, worst);
    }
}
