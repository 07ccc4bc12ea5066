//! A firmware over the library: an interrupt pushes a sample a millisecond, the background polls, a report is handled.
//!
//! Start-up, memory layout, critical section and panic handler are this firmware's and its board's; of the library it has
//! the state of the monitor and the queue.
#![no_std]
#![no_main]

use core::cell::Cell;
use core::panic::PanicInfo;
use cortex_m_rt::{entry, exception};
use critical_section::Mutex;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::Form;
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::queue::{Inlet, SampleQueue};
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::trial::SensorNoise;
use hal::Board;

/// Exact steps of a piecewise affine actuator of five states; the matrices of four modes are kept.
type Steps = Exact<f32, BASE_ORDER, 4>;
/// Windows of a second, two faults, a population of 20: 24 KB.
type Watch = Monitor<Steps, 1000, 2, 20>;

/// Most steps of the model that one round of the background takes.
const STEPS_PER_POLL: u32 = 100;

/// What the monitor is told: the actuator, its sensors, and for each fault what is healthy and what must be alarmed.
fn config() -> Config<2> {
    Config {
        form: Form::default(),
        parameters: Parameters::default(),
        sample_period: 1e-3,
        // The flight computer gives a command at every sample and holds it until the next one.
        holds_command: true,
        noise: SensorNoise { user: 5e-6, current: 0.02 },
        faults: [
            Fault::new(Parameter::Backlash, [0.0, 1.5e-3], 1e-4, 2e-4),
            Fault::new(Parameter::DryFriction, [200.0, 4000.0], 400.0, 600.0),
        ],
        false_alarm_rate: Config::<2>::FALSE_ALARM_RATE,
        seed: 1,
        steps_per_sample: STEPS_PER_POLL,
    }
}

/// The interrupt's end of the queue, on its way from the start-up to the interrupt.
static INLET: Mutex<Cell<Option<Inlet<'static>>>> = Mutex::new(Cell::new(None));

/// The sample clock, 1 kHz: constant time, never waits.
#[exception]
fn SysTick() {
    // The macro hands these out as references: only this handler has them.
    static mut OWN_INLET: Option<Inlet<'static>> = None;
    static mut TICK: u32 = 0;
    if OWN_INLET.is_none() {
        *OWN_INLET = critical_section::with(|token| INLET.borrow(token).take());
    }
    if let Some(inlet) = OWN_INLET {
        let [command, user, current] = hal::conversions();
        // Where the background was too slow the sample is lost, and the gap in the ticks tells it.
        let _ = inlet.push(Sample { tick: *TICK, command, user, current });
    }
    *TICK = TICK.wrapping_add(1);
}

#[entry]
fn start() -> ! {
    // As above: the entry runs once, and these are static.
    static mut QUEUE: SampleQueue<16> = SampleQueue::new();
    static mut MONITOR: Watch = Watch::idle(Steps::new());

    let Some(mut board) = Board::take() else { hal::stop() };
    // Refused here or never: the loop below has no errors.
    if MONITOR.configure(&config()).is_err() {
        hal::stop();
    }
    let (inlet, mut outlet) = QUEUE.split();
    critical_section::with(|token| INLET.borrow(token).set(Some(inlet)));
    board.start_sample_clock();
    loop {
        let poll = MONITOR.poll(&mut outlet, STEPS_PER_POLL);
        if let Some(report) = &poll.report {
            handle(report);
        }
        if poll.samples == 0 && poll.steps == 0 {
            cortex_m::asm::wfi();
        }
    }
}

/// What becomes of a report: two lamps, and a count of the windows that told nothing.
fn handle(report: &Report<2>) {
    let [backlash, friction] = &report.faults;
    hal::show_alarms(backlash.alarmed, friction.alarmed);
    match report.verdict {
        Verdict::Healthy | Verdict::Fault | Verdict::Uninformative => (),
        Verdict::ModelInadequate | Verdict::SensorFault => hal::count_unusable_window(),
    }
}

#[cfg(not(debug_assertions))]
unsafe extern "C" {
    /// Defined nowhere: where a panic can be reached, the optimised image does not link.
    safe fn this_firmware_has_a_reachable_panic() -> !;
}

#[panic_handler]
fn on_panic(_: &PanicInfo) -> ! {
    #[cfg(not(debug_assertions))]
    this_firmware_has_a_reachable_panic();
    #[cfg(debug_assertions)]
    hal::stop()
}
