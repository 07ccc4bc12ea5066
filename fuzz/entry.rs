//! What the fuzz target and the tests run on random bytes: nothing in them may panic, hang or poison the monitor.

use eha_monitor::fit::problem::Free;
use eha_monitor::integrate::Stepper;
use eha_monitor::link::station::{PlainSteps, any_steps};
use eha_monitor::model::Form;
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::queue::SampleQueue;
use eha_monitor::monitor::report::Report;
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::trial::SensorNoise;

type Small<S> = Monitor<S, 100, 2, 8>;

const BUDGET: u32 = 400;

/// A monitor of some parameters with the steps for them.
fn monitor<S: Stepper<f32>>(steps: S, parameters: Parameters<f32>) -> Box<Small<S>> {
    let fault = |parameter, upper, healthy, alarm| Fault {
        free: Free { parameter, lower: 0.0, upper },
        healthy,
        alarm,
    };
    let mut monitor = Box::new(Small::idle(steps));
    let config = Config {
        form: Form::default(),
        parameters,
        sample_period: 1e-3,
        holds_command: false,
        noise: SensorNoise { user: 5e-6, current: 0.02 },
        faults: [
            fault(Parameter::Backlash, 1.5e-3, 1e-4, 2e-4),
            fault(Parameter::DryFriction, 4000.0, 400.0, 600.0),
        ],
        false_alarm_rate: 1e-6,
        seed: 1,
    };
    assert_eq!(monitor.configure(&config), Ok(()));
    monitor
}

fn plain() -> Box<Small<PlainSteps<6>>> {
    monitor(PlainSteps::new(), Parameters::default())
}

/// A report that nothing has poisoned.
fn is_sound(report: &Report<2>) -> bool {
    report.faults.iter().all(|fault| {
        fault.value.is_finite() && !fault.standard_error.is_nan() && (0.0..=1.0).contains(&fault.evidence)
    }) && report.residual_rms.iter().chain(&report.offset).all(|value| value.is_finite())
}

/// Samples from raw bits: the first byte of each says how much of it is wild.
fn samples(bytes: &[u8]) -> impl Iterator<Item = Sample> + '_ {
    let mut tick = 0_u32;
    bytes.chunks_exact(13).map(move |chunk| {
        let word = |at: usize| u32::from_le_bytes([chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]]);
        let kind = chunk[0];
        tick = if kind.is_multiple_of(16) { word(1) } else { tick.wrapping_add(1) };
        let value = |at: usize, range: f32, wild: bool| {
            if wild {
                f32::from_bits(word(at))
            } else {
                word(at).cast_signed() as f32 / i32::MAX as f32 * range
            }
        };
        Sample {
            tick,
            command: value(1, 0.2, kind & 0x30 == 0x30),
            user: value(5, 0.2, kind & 0xc0 == 0xc0),
            current: value(9, 10.0, kind & 0xa0 == 0xa0),
        }
    })
}

/// Feeds samples of any bits to a monitor: behind a first byte that 8 divides to one for every rig, of an actuator that
/// meters by the square root of the pressure drop.
pub(crate) fn stream(bytes: &[u8]) {
    match bytes.split_first() {
        Some((first, samples)) if first.is_multiple_of(8) => {
            let parameters = Parameters { metering_blend: 1.0, ..Parameters::default() };
            feed(&mut monitor(any_steps::<4>(), parameters), samples);
        }
        Some((_, samples)) => feed(&mut plain(), samples),
        None => {}
    }
}

/// What a monitor says of samples of any bits, and of good ones after them, is sound.
fn feed<S: Stepper<f32>>(monitor: &mut Small<S>, bytes: &[u8]) {
    let mut queue = SampleQueue::<16>::new();
    let (mut inlet, mut outlet) = queue.split();
    for sample in samples(bytes) {
        inlet.push(sample);
        let poll = monitor.poll(&mut outlet, BUDGET);
        assert!(poll.steps <= BUDGET);
        assert!(poll.report.as_ref().is_none_or(is_sound), "{:?}", poll.report);
    }
    // It is not poisoned: ten good windows later it has nothing but finite things to say.
    for tick in 0..1000_u32 {
        let command = 1e-3 * (tick % 40) as f32;
        monitor.take(&Sample { tick, command, user: command, current: 0.0 });
        let (_, report) = monitor.work(u32::MAX);
        assert!(report.as_ref().is_none_or(is_sound), "{report:?}");
    }
    assert!(monitor.counters().windows >= 8, "{:?}", monitor.counters());
}

/// Restores a monitor from any bytes.
pub(crate) fn restore(bytes: &[u8]) {
    assert!(plain().restore(bytes).is_err(), "random bytes with the checksum of a snapshot");
}
