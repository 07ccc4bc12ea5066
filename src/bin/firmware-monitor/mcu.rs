//! Entry of the image: bytes from the line to the station, its answers back.

#[path = "../firmware/counter.rs"]
mod counter;
#[path = "../firmware/hogs.rs"]
mod hogs;
#[path = "../firmware/registers.rs"]
mod registers;
#[cfg(feature = "negative-control-ram")]
#[path = "roomy.rs"]
mod roomy;
#[path = "../firmware/runtime.rs"]
mod runtime;
#[path = "uart.rs"]
mod uart;

use counter::Counter;
use eha_monitor::link::station::{self, POPULATION, Station, WINDOW};
use runtime::{EXIT_NO_PERIPHERALS, report_stack};
use semihosting::process;
use uart::Uart;

/// Modes whose transition matrices are kept: spool and jack, sliding or stuck, make four.
const SLOTS: usize = 4;

/// The steps inside a mode.
#[cfg(not(feature = "any-rig"))]
type Steps = station::PlainSteps<SLOTS>;
#[cfg(not(feature = "any-rig"))]
const STEPS: Steps = Steps::new();
#[cfg(feature = "any-rig")]
type Steps = station::AnySteps<SLOTS>;
#[cfg(feature = "any-rig")]
const STEPS: Steps = station::any_steps();

/// The steps, with room around them where that is to overrun a budget.
#[cfg(not(feature = "negative-control-ram"))]
type Rule = Steps;
#[cfg(not(feature = "negative-control-ram"))]
const RULE: Rule = STEPS;
#[cfg(feature = "negative-control-ram")]
type Rule = roomy::Roomy<Steps>;
#[cfg(feature = "negative-control-ram")]
const RULE: Rule = Rule::new(STEPS, roomy::Room::NEW);

#[cortex_m_rt::entry]
fn start() -> ! {
    // The macro hands out a `static mut` of the entry as a reference, once: the entry runs once.
    static mut STATION: Station<Rule, WINDOW, POPULATION> = Station::new(RULE);
    let Some(peripherals) = cortex_m::Peripherals::take() else {
        process::exit(EXIT_NO_PERIPHERALS);
    };
    let counter = Counter::new(peripherals);
    let mut uart = Uart::new();
    let (mut window, mut worst_window, mut worst_sample) = (0, 0, 0);
    loop {
        let byte = uart.read();
        let mut has_answered = false;
        let (goes_on, cost) = counter.cost_of(|| {
            STATION.receive(byte, &mut |bytes| {
                has_answered = true;
                uart.write(bytes);
            })
        });
        window += cost;
        worst_sample = cost.max(worst_sample);
        if has_answered {
            worst_window = window.max(worst_window);
            window = 0;
        }
        if !goes_on {
            break;
        }
    }
    hogs::take();
    defmt::println!("measure monitor_state.bytes={=usize}", size_of_val(STATION.monitor()));
    counter::report("monitor", "window", worst_window);
    counter::report("monitor", "frame", worst_sample);
    report_stack();
    process::exit(0)
}
