//! What the fuzz target and the tests run on random bytes: nothing in them may panic, hang or poison the monitor.

use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::observed::Observed;
use eha_monitor::link::station::{PlainSteps, any_steps};
use eha_monitor::model::state::{Input, InputSegment};
use eha_monitor::model::{Form, Model};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::queue::SampleQueue;
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::simulate::Actuator;
use eha_monitor::trial::SensorNoise;
use std::cell::Cell;
use std::sync::OnceLock;

/// Samples of a window, most of which are compared.
const WINDOW: usize = 300;

type Small<S> = Monitor<S, WINDOW, 2, 8>;

const BUDGET: u32 = 400;
/// Backlash, m, and dry friction, N, of the actuator that is flown.
const HEALTHY: [f32; 2] = [1e-4, 400.0];
/// Samples of a period of its command, a sine, and of the flight.
const PERIOD: usize = 400;
const FLIGHT: usize = 5 * PERIOD;

/// A monitor of some parameters with the steps for them.
fn monitor<S: Stepper<f32>>(steps: S, parameters: &Parameters<f32>) -> Box<Small<S>> {
    let mut monitor = Box::new(Small::idle(steps));
    let config = Config {
        form: Form::default(),
        parameters: *parameters,
        sample_period: 1e-3,
        holds_command: false,
        noise: SensorNoise { user: 5e-6, current: 0.02 },
        faults: [
            Fault::new(Parameter::Backlash, [0.0, 1.5e-3], HEALTHY[0], 2e-4),
            Fault::new(Parameter::DryFriction, [0.0, 4000.0], HEALTHY[1], 600.0),
        ],
        false_alarm_rate: 1e-6,
        seed: 1,
        steps_per_sample: 60,
    };
    assert_eq!(monitor.configure(&config), Ok(()));
    monitor
}

fn plain() -> Box<Small<PlainSteps<6>>> {
    monitor(PlainSteps::new(), &Parameters::default())
}

/// A report that nothing has poisoned.
fn is_sound(report: &Report<2>) -> bool {
    report.faults.iter().all(|fault| {
        fault.value.is_finite() && !fault.standard_error.is_nan() && (0.0..=1.0).contains(&fault.evidence)
    }) && report.residual_rms.iter().chain(&report.offset).all(|value| value.is_finite())
}

/// Command, user position and current of a healthy actuator in steady motion, over a whole number of periods.
fn flight(parameters: &Parameters<f32>) -> Vec<[f32; 3]> {
    let at = |sample: usize| 2e-3 * (std::f32::consts::TAU / PERIOD as f32 * (sample % PERIOD) as f32).sin();
    let [bkl, fdj] = HEALTHY;
    let model = Model::new(Form::default(), &Parameters { bkl, fdj, ..*parameters });
    let (actuator, mut steps) = (Actuator::new(model, 1e-3), Box::new(any_steps::<4>()));
    steps.begin(1e-3, false, true);
    let mut motion = actuator.at_rest(at(0), &Input { command: at(0), ..Input::default() });
    let mut sample = |place: usize| {
        let line = InputSegment::between([at(place), at(place + 1)], [0.0; 2], place as f32 * 1e-3, 1e3);
        actuator.advance(&mut *steps, &mut motion, &line);
        let input = Input { command: at(place + 1), ..line.start };
        let outputs = actuator.measure(&mut motion, &input);
        [input.command, outputs.user, outputs.current]
    };
    (0..2 * FLIGHT).map(&mut sample).skip(FLIGHT).collect()
}

/// Samples of a flight from raw bits: the first byte of each says how much of it is wild.
fn samples<'a>(flight: &'a [[f32; 3]], bytes: &'a [u8]) -> impl Iterator<Item = Sample> + 'a {
    let mut tick = 0_u32;
    bytes.chunks_exact(13).zip(flight.iter().cycle()).map(move |(chunk, flown)| {
        let word = |at: usize| u32::from_le_bytes([chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]]);
        let kind = chunk[0];
        tick = if kind.is_multiple_of(16) { word(1) } else { tick.wrapping_add(1) };
        let value = |place: usize, mask: u8| {
            if kind & mask == mask { f32::from_bits(word(1 + 4 * place)) } else { flown[place] }
        };
        Sample { tick, command: value(0, 0x30), user: value(1, 0xc0), current: value(2, 0xa0) }
    })
}

/// Feeds samples of any bits to a monitor: behind a first byte that 8 divides to one for every rig, of an actuator that
/// meters by the square root of the pressure drop.
pub(crate) fn stream(bytes: &[u8]) {
    let mut parameters = Parameters::default();
    let steps = Cell::new(0);
    match bytes.split_first() {
        Some((first, samples)) if first.is_multiple_of(8) => {
            parameters.metering_blend = 1.0;
            let observed = Observed::new(any_steps::<4>(), &steps);
            feed(&mut monitor(observed, &parameters), &steps, &flight(&parameters), samples);
        }
        Some((_, samples)) => {
            let observed = Observed::new(PlainSteps::<6>::new(), &steps);
            feed(&mut monitor(observed, &parameters), &steps, &flight(&parameters), samples);
        }
        None => {}
    }
}

/// What a monitor says of samples of any bits is sound, and good ones after them are those of a healthy actuator.
fn feed<S: Stepper<f32>>(monitor: &mut Small<S>, steps: &Cell<u64>, flight: &[[f32; 3]], bytes: &[u8]) {
    let mut queue = SampleQueue::<16>::new();
    let (mut inlet, mut outlet) = queue.split();
    for sample in samples(flight, bytes) {
        assert!(inlet.push(sample), "each is taken at once");
        let poll = monitor.poll(&mut outlet, BUDGET);
        // As the stepper counts them: the monitor's own count is cut to its budget.
        assert!(steps.take() <= BUDGET.into());
        assert!(poll.report.as_ref().is_none_or(is_sound), "{:?}", poll.report);
    }
    settles(monitor, flight, 0);
}

/// On good samples from a tick on it says sound things, and comes to what a healthy actuator is.
fn settles<S: Stepper<f32>>(monitor: &mut Small<S>, flight: &[[f32; 3]], first: u32) {
    let mut last = None;
    let samples = flight.iter().cycle().skip(first as usize % flight.len());
    for (tick, &[command, user, current]) in (first..).zip(samples).take(8 * WINDOW) {
        monitor.take(&Sample { tick, command, user, current });
        let (_, report) = monitor.work(u32::MAX);
        assert!(report.as_ref().is_none_or(is_sound), "{report:?}");
        last = report.or(last);
    }
    // It is not poisoned.
    let last = last.expect("a report on good windows");
    assert_eq!(last.verdict, Verdict::Healthy, "{last:?}");
    for (fault, truth) in last.faults.iter().zip(HEALTHY) {
        assert!((fault.value / truth - 1.0).abs() < 0.02, "{last:?}");
    }
}

/// Restores a monitor from any bytes, and from a snapshot of its own in which they stand in places of it.
pub(crate) fn restore(bytes: &[u8]) {
    assert!(plain().restore(bytes).is_err(), "random bytes with the checksum of a snapshot");
    let flown = FLOWN.get_or_init(Flown::new);
    let words = flown.snapshot.len() / 4 - 1;
    let damage = bytes.chunks_exact(6).map(|chunk| {
        let (place, word) = chunk.split_at(2);
        (usize::from(u16::from_le_bytes([place[0], place[1]])) % words, word.try_into().expect("four bytes"))
    });
    flown.restore(damage);
}

/// Words of a snapshot.
pub(crate) fn words() -> usize {
    FLOWN.get_or_init(Flown::new).snapshot.len() / 4 - 1
}

static FLOWN: OnceLock<Flown> = OnceLock::new();

/// A flight, and a monitor's snapshot in the middle of its third window, while the second is analysed.
struct Flown {
    flight: Vec<[f32; 3]>,
    snapshot: Vec<u8>,
}

impl Flown {
    const TICKS: u32 = 2 * WINDOW as u32 + 40;

    fn new() -> Self {
        let flight = flight(&Parameters::default());
        let mut monitor = plain();
        for (tick, &[command, user, current]) in (0..Self::TICKS).zip(&flight) {
            monitor.take(&Sample { tick, command, user, current });
            let budget = if tick < 2 * WINDOW as u32 { BUDGET } else { 30 };
            let (_, report) = monitor.work(budget);
            assert!(report.is_none_or(|report| report.verdict == Verdict::Healthy));
        }
        let mut snapshot = vec![0; Small::<PlainSteps<6>>::SNAPSHOT_BYTES];
        let length = monitor.snapshot(&mut snapshot).expect("room for it");
        snapshot.truncate(length);
        Self { flight, snapshot }
    }

    /// Restores a monitor from the snapshot with words in places of it, under a checksum that is right. Where it is taken,
    /// the monitor says sound things, and recovers.
    fn restore(&self, damage: impl Iterator<Item = (usize, [u8; 4])>) {
        let mut bytes = self.snapshot.clone();
        let content = bytes.len() - 4;
        for (place, word) in damage {
            bytes[4 * place..4 * place + 4].copy_from_slice(&word);
        }
        let checksum = crc32(&bytes[..content]);
        bytes[content..].copy_from_slice(&checksum.to_le_bytes());
        let mut monitor = plain();
        if monitor.restore(&bytes).is_ok() {
            settles(&mut monitor, &self.flight, Self::TICKS);
        }
    }
}

/// The checksum of a snapshot (CRC-32 of ISO-HDLC).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1)))
    })
}
