//! An actuator in flight: commands that nobody chose for a test, faults that change, sensors with noise.

use eha_monitor::integrate::Stepper as _;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::{BASE_ORDER, Input, InputSegment};
use eha_monitor::model::{Form, Model};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::report::Report;
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::random::Random;
use eha_monitor::simulate::{Actuator, Motion};
use eha_monitor::trial::SensorNoise;

/// Sample period, s.
pub(crate) const PERIOD: f32 = 1e-3;
/// Samples in a window.
pub(crate) const WINDOW: usize = 1000;
/// Noise of the sensors, m and mA.
pub(crate) const NOISE: SensorNoise<f32> = SensorNoise { user: 5e-6, current: 0.02 };
/// The healthy backlash, m, and friction, N, and those that must be alarmed.
pub(crate) const HEALTHY: [f32; 2] = [1e-4, 400.0];
pub(crate) const ALARMED: [f32; 2] = [2e-4, 600.0];

/// Exact steps of the monitor's model.
pub(crate) type Steps = Exact<f32, BASE_ORDER, 6>;
/// The monitor under test.
pub(crate) type TestMonitor = Monitor<Steps, WINDOW, 2, 20>;

/// What the monitor under test is told.
pub(crate) fn config() -> Config<2> {
    let fault = |parameter, range, index: usize| Fault::new(parameter, range, HEALTHY[index], ALARMED[index]);
    Config {
        form: Form::default(),
        parameters: Parameters::default(),
        sample_period: PERIOD,
        holds_command: false,
        noise: NOISE,
        faults: [
            fault(Parameter::Backlash, [0.0, 1.5e-3], 0),
            fault(Parameter::DryFriction, [200.0, 4000.0], 1),
        ],
        false_alarm_rate: Config::<2>::FALSE_ALARM_RATE,
        seed: 1,
        steps_per_sample: STEPS_PER_SAMPLE,
    }
}

/// A monitor that is ready.
pub(crate) fn monitor() -> Box<TestMonitor> {
    let mut monitor = Box::new(TestMonitor::idle(Steps::new()));
    monitor.configure(&config()).expect("a configuration that is right");
    monitor
}

/// A command as an aircraft flies it: three sines of random amplitude, frequency and phase, and a slow one below them.
#[derive(Clone, Debug)]
pub(crate) struct Flown {
    sines: [(f64, f64, f64); 4],
}

impl Flown {
    /// Any flight: now and then a window without a turn.
    pub(crate) fn new(seed: u64) -> Self {
        Self::of(seed, [[5e-3, 20e-3], [1e-3, 4e-3]])
    }

    /// Manoeuvres: the ram turns back in every window.
    pub(crate) fn lively(seed: u64) -> Self {
        Self::of(seed, [[2e-3, 5e-3], [2e-3, 5e-3]])
    }

    fn of(seed: u64, [slow, quick]: [[f64; 2]; 2]) -> Self {
        let mut random = Random::new(seed ^ 0x00f1_0e1d);
        let mut draw = |low: f64, high: f64| low + (high - low) * random.uniform::<f64>();
        let mut sine = |amplitude: [f64; 2], frequency: [f64; 2]| {
            (
                draw(amplitude[0], amplitude[1]),
                draw(frequency[0], frequency[1]),
                draw(0.0, core::f64::consts::TAU),
            )
        };
        Self {
            sines: [
                sine(slow, [0.05, 0.2]),
                sine(quick, [0.5, 1.0]),
                sine([0.5e-3, 2e-3], [1.0, 2.0]),
                sine([0.1e-3, 1e-3], [2.0, 4.0]),
            ],
        }
    }

    pub(crate) fn at(&self, sample: u32) -> f32 {
        let time = f64::from(sample) * f64::from(PERIOD);
        self.sines
            .iter()
            .map(|(amplitude, frequency, phase)| {
                amplitude * (core::f64::consts::TAU * frequency * time + phase).sin()
            })
            .sum::<f64>() as f32
    }
}

/// An actuator that flies.
pub(crate) struct Flight<C> {
    command: C,
    /// Sample period, s.
    period: f32,
    /// Does the command keep the value of a sample until the next one?
    pub(crate) holds: bool,
    parameters: Parameters<f32>,
    stepper: Steps,
    motion: Motion<f32>,
    random: Random,
    sample: u32,
}

impl<C: Fn(u32) -> f32> Flight<C> {
    pub(crate) fn new(command: C, seed: u64) -> Self {
        Self::of(&Parameters::default(), command, seed)
    }

    /// An actuator with parameters of its own.
    pub(crate) fn of(parameters: &Parameters<f32>, command: C, seed: u64) -> Self {
        Self::sampled(PERIOD, parameters, command, seed)
    }

    /// An actuator with parameters and a sample period, s, of its own.
    pub(crate) fn sampled(period: f32, parameters: &Parameters<f32>, command: C, seed: u64) -> Self {
        let parameters = Parameters { bkl: HEALTHY[0], fdj: HEALTHY[1], ..*parameters };
        let actuator = Actuator::new(Model::new(Form::default(), &parameters), period);
        let first = command(0);
        let input = Input { command: first, command_rate: 0.0, force: 0.0 };
        let mut stepper = Steps::new();
        stepper.begin(period, false, true);
        let motion = actuator.at_rest(first, &input);
        Self {
            command,
            period,
            holds: false,
            parameters,
            stepper,
            motion,
            random: Random::new(seed),
            sample: 0,
        }
    }

    /// The next sample, with a backlash and a friction.
    pub(crate) fn next(&mut self, faults: [f32; 2]) -> Sample {
        let sample = self.quiet(faults);
        Sample {
            user: sample.user + NOISE.user * self.random.bell::<f32>(),
            current: sample.current + NOISE.current * self.random.bell::<f32>(),
            ..sample
        }
    }

    /// The same without noise.
    pub(crate) fn quiet(&mut self, [bkl, fdj]: [f32; 2]) -> Sample {
        let changed = bkl != self.parameters.bkl || fdj != self.parameters.fdj;
        self.parameters = Parameters { bkl, fdj, ..self.parameters };
        let actuator = Actuator::new(Model::new(Form::default(), &self.parameters), self.period);
        if changed {
            self.stepper.begin(self.period, false, false);
        }
        let command = (self.command)(self.sample);
        let mut input = Input { command, command_rate: 0.0, force: 0.0 };
        if self.sample > 0 {
            let before = (self.command)(self.sample - 1);
            let arriving = if self.holds { before } else { command };
            let segment = InputSegment::between([before, arriving], [0.0; 2], 0.0, 1.0 / self.period);
            actuator.advance(&mut self.stepper, &mut self.motion, &segment);
            input.command_rate = segment.start.command_rate;
            if arriving != command {
                let from = Input { command: arriving, ..input };
                actuator.jump(&mut self.stepper, &mut self.motion, &from, &input, self.period);
            }
        }
        let outputs = actuator.measure(&mut self.motion, &input);
        let tick = self.sample;
        self.sample += 1;
        Sample { tick, command, user: outputs.user, current: outputs.current }
    }
}

/// The faults at a sample of an actuator that is healthy until they begin to grow, and grow over a second.
pub(crate) fn growing(sample: u32, begin: u32, grown: [f32; 2]) -> [f32; 2] {
    let part = ((sample as f32 - begin as f32) / WINDOW as f32).clamp(0.0, 1.0);
    [0, 1].map(|fault| HEALTHY[fault] + (grown[fault] - HEALTHY[fault]) * part)
}

/// Steps that the monitor may take for each sample in the tests: as many as on the boards of `host-sim hil`.
pub(crate) const STEPS_PER_SAMPLE: u32 = 100;

/// Lets a monitor take a sample and work.
pub(crate) fn feed(monitor: &mut TestMonitor, sample: &Sample) -> Option<Report<2>> {
    monitor.take(sample);
    monitor.work(STEPS_PER_SAMPLE).1
}

/// A report without what depends on when the work is done.
pub(crate) const fn timeless(mut report: Report<2>) -> Report<2> {
    report.latency_samples = 0;
    report
}
