//! A monitor of three faults: all of it that a program may call, so that the link shows that none of it can panic.

use crate::Platform;
use core::hint::black_box;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::{Form, state::BASE_ORDER};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::{queue::SampleQueue, sample::Sample};
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::trial::SensorNoise;

/// Samples in a window, faults, members of the population.
const WINDOW: usize = 300;
const FAULTS: usize = 3;
const POPULATION: usize = 20;
/// Samples that are flown, and steps of the model for each of them.
const FLIGHT: u32 = 1000;
const STEPS_PER_SAMPLE: u32 = 200;

type Steps = Exact<f32, BASE_ORDER, 4>;
type ThreeFaults = Monitor<Steps, WINDOW, FAULTS, POPULATION>;

/// The monitor and a place for its state.
pub(super) struct Watch {
    monitor: ThreeFaults,
    saved: [u8; ThreeFaults::SNAPSHOT_BYTES],
}

pub(super) const NEW: Watch =
    Watch { monitor: Monitor::idle(Steps::new()), saved: [0; ThreeFaults::SNAPSHOT_BYTES] };

fn config() -> Config<FAULTS> {
    Config {
        form: Form::default(),
        parameters: Parameters::default(),
        sample_period: 1e-3,
        holds_command: false,
        noise: SensorNoise::<f32>::TYPICAL,
        faults: [
            Fault::new(Parameter::Backlash, [0.0, 1.5e-3], 1e-4, 2e-4),
            Fault::new(Parameter::DryFriction, [200.0, 4000.0], 400.0, 600.0),
            Fault::new(Parameter::SpoolFriction, [0.0, 50.0], 10.0, 20.0),
        ],
        false_alarm_rate: Config::<FAULTS>::FALSE_ALARM_RATE,
        seed: 1,
        steps_per_sample: STEPS_PER_SAMPLE,
    }
}

/// Flies a triangle past the monitor, saves its state and restores it.
pub(super) fn fly(platform: &mut impl Platform, watch: &mut Watch) {
    let Watch { monitor, saved } = watch;
    let is_ready = monitor.configure(&black_box(config())).is_ok();
    let mut queue = SampleQueue::<8>::new();
    let (mut inlet, mut outlet) = queue.split();
    let mut reports = 0;
    for tick in 0..black_box(FLIGHT) {
        let command = 2e-5 * (tick % 200).min(200 - tick % 200) as f32;
        let is_in = inlet.push(Sample { tick, command, user: command, current: 0.0 });
        let poll = monitor.poll(&mut outlet, STEPS_PER_SAMPLE);
        reports += u64::from(is_in && poll.report.is_some());
    }
    let length = monitor.snapshot(saved).unwrap_or_default();
    let is_back = saved.get(..length).is_some_and(|bytes| monitor.restore(bytes).is_ok());
    platform.result_count("three_faults", "reports", reports);
    platform.result_count("three_faults", "restored", u64::from(is_ready && is_back));
}
