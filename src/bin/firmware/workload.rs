//! The monitor's run: samples of an actuator with faults, and the identification of these faults from them.
//!
//! Two trials, both in `f32`. In `lf` the samples come from the monitor's own model, so that the estimates are off by
//! the noise only. In `hf` they come from the high-fidelity equations (metering valve, midpoint rule), and what the
//! monitor's model leaves out is read as a fault: the estimates come as they are.

#[cfg(feature = "three-faults")]
#[path = "watch.rs"]
mod watch;

use crate::Platform;
use core::{hint::black_box, slice};
use eha_monitor::{
    command::{Command, CommandInfo},
    fit::{
        identify::{Identification, Settings},
        problem::{Free, Problem, Record},
        walk::Walk,
    },
    ga::{Settings as SearchSettings, SteadyState},
    integrate::{Stepper, exact::Exact, midpoint::Midpoint},
    model::{Form, Model, state::BASE_ORDER},
    monitor::{queue::SampleQueue, sample::Sample},
    parameter::{Parameter, Parameters},
    trial::{Samples, SensorNoise},
};

/// Sample period, s.
const PERIOD: f32 = 1e-3;
/// One second of samples and both of its ends.
const SAMPLES: usize = 1001;
/// The command: 1 cm, 0.1 to 1.5 Hz.
const COMMAND: &str = "chirp";
/// Noise of an LVDT, m, and of a current sensor, mA.
const NOISE: SensorNoise<f32> = SensorNoise::<f32>::TYPICAL;
/// Backlash of the actuator, m, and its dry friction, N: four times the healthy one.
const FAULTS: [f32; 2] = [2e-4, 800.0];
/// What is identified, in the source's bounds.
const FREE: [Free<f32>; 2] = [
    Free { parameter: Parameter::Backlash, lower: 0.0, upper: 1.5e-3 },
    Free { parameter: Parameter::DryFriction, lower: 200.0, upper: 4000.0 },
];
/// Members of the population, as in the source.
const POPULATION: usize = 20;
/// Modes whose transition matrices are kept: spool and jack, sliding or stuck, make four; the rest is for limits.
const SLOTS: usize = 8;
/// Step of the high-fidelity equations, s, as in the source.
const HF_STEP: f32 = 1e-5;
/// Samples in the middle of a slide: the first of them, and how many.
const QUIET_SAMPLE: usize = 150;
const QUIET_SAMPLES: usize = 100;
/// Seeds of the noise and of the search.
const NOISE_SEED: u64 = 1;
const SEARCH_SEED: u64 = 2;

/// Exact steps of the monitor's model.
type MonitorStepper = Exact<f32, BASE_ORDER, SLOTS>;

/// What the run needs to keep in RAM; too large for a stack that others share.
pub(crate) struct Memory {
    samples: Samples<f32, SAMPLES>,
    stepper: MonitorStepper,
    #[cfg(feature = "three-faults")]
    watch: watch::Watch,
}

impl Memory {
    pub(crate) const fn new() -> Self {
        Self {
            samples: Samples::new(),
            stepper: Exact::new(),
            #[cfg(feature = "three-faults")]
            watch: watch::NEW,
        }
    }
}

/// Runs the workload and reports its results.
pub(crate) fn run(platform: &mut impl Platform, memory: &mut Memory) {
    let Memory { samples, stepper, .. } = memory;
    let Some(command) = CommandInfo::named(COMMAND).map(Command::new) else { return };
    let monitored = Parameters { bkl: FAULTS[0], fdj: FAULTS[1], ..Parameters::default() };
    let lf = Model::new(Form::default(), &monitored);
    let hf = Model::new(Form::default(), &Parameters { metering_blend: 1.0, ..monitored });

    platform.measure("lf", "sampling", || samples.take(&lf, stepper, &command, PERIOD));
    measure_quiet_samples(platform, &lf, &samples.record(&NOISE), stepper);
    samples.disturb(&NOISE, NOISE_SEED);
    measure_generation(platform, samples, stepper);
    identify(platform, "lf", samples, stepper);
    measure_push(platform);

    platform.measure("hf", "sampling", || samples.take(&hf, &mut Midpoint::new(HF_STEP), &command, PERIOD));
    samples.disturb(&NOISE, NOISE_SEED);
    identify(platform, "hf", samples, stepper);

    #[cfg(feature = "three-faults")]
    watch::fly(platform, &mut memory.watch);
    #[cfg(feature = "negative-control-panic")]
    platform.result_count("negative_control", "panic", reachable_panic());
    #[cfg(feature = "negative-control-f64")]
    platform.result_f32("negative_control", "f64", double_precision());
}

/// Reports what samples cost the monitor's model where nothing happens, and shows that nothing did.
fn measure_quiet_samples(
    platform: &mut impl Platform,
    model: &Model<f32>,
    record: &Record<'_, f32>,
    stepper: &mut MonitorStepper,
) {
    stepper.begin(record.sample_period, false, false);
    let mut walk = Walk::new(model, record);
    walk.lead_on(record, stepper, &mut [], QUIET_SAMPLE, |_, _, _| ());
    let (_, before) = walk.effort();
    let mut user = f32::NAN;
    platform.measure("lf", "quiet_samples", || {
        walk.lead_on(record, stepper, &mut [], QUIET_SAMPLES, |_, outputs, _| user = outputs.user);
    });
    let (_, after) = walk.effort();
    platform.result_count("lf", "quiet_samples_steps", u64::from(after - before));
    platform.result_f32("lf", "quiet_samples_user_m", user);
}

/// What is fitted to the samples.
fn problem<'a>(records: &'a [Record<'a, f32>]) -> Problem<'a, f32> {
    Problem { form: Form::default(), parameters: Parameters::default(), free: &FREE, records }
}

/// Reports what a generation costs: as many children as the population has members.
fn measure_generation(
    platform: &mut impl Platform,
    samples: &Samples<f32, SAMPLES>,
    stepper: &mut MonitorStepper,
) {
    let records = [samples.record(&NOISE)];
    let problem = problem(&records);
    let mut search = SteadyState::<f32, { FREE.len() }, POPULATION>::new(
        SearchSettings::default(),
        FREE.len(),
        SEARCH_SEED,
    );
    let mut generation = || {
        for _ in 0..POPULATION {
            let genes = search.ask();
            search.tell(problem.misfit(&genes, stepper).mean_square());
        }
    };
    generation();
    platform.measure("lf", "generation", generation);
    platform.result_count("lf", "generation_replacements", search.counters().replacements.into());
}

/// Reports what the interrupt pays for a sample, with room in the queue and without, at every place of its ring.
fn measure_push(platform: &mut impl Platform) {
    const CAPACITY: u32 = 8;
    let mut queue = SampleQueue::<{ CAPACITY as usize }>::new();
    let (mut inlet, mut outlet) = queue.split();
    let empty = |round: u32| {
        if round.is_multiple_of(CAPACITY + 1) {
            while outlet.pop().is_some() {}
        }
    };
    platform.measure_worst("monitor", "push", CAPACITY * (CAPACITY + 1), empty, |tick| {
        // One that finds no room is counted below.
        let _ = inlet.push(black_box(Sample { tick, command: 1.0, user: f32::NAN, current: 2.0 }));
    });
    platform.result_count("monitor", "push_overruns", outlet.overruns().into());
}

/// Identifies the faults from the samples with the monitor's model, and reports what it finds and what it costs.
fn identify(
    platform: &mut impl Platform,
    trial: &str,
    samples: &Samples<f32, SAMPLES>,
    stepper: &mut MonitorStepper,
) {
    let records = [samples.record(&NOISE)];
    let problem = problem(&records);
    let truth = [FREE[0].gene(FAULTS[0]), FREE[1].gene(FAULTS[1])];
    let misfit = platform.measure(trial, "evaluation", || problem.misfit(&truth, stepper));
    platform.result_f32(trial, "chi_square_of_truth", misfit.chi_square);

    let Some(mut identification) =
        Identification::<f32, { FREE.len() }, POPULATION>::new(&problem, Settings::default(), SEARCH_SEED)
    else {
        return;
    };
    let reason =
        platform.measure(trial, "identification", || identification.run(&problem, slice::from_mut(stepper)));
    platform.result_count(trial, "stop_reason", reason as u64);
    platform.result_count(trial, "evaluations", identification.evaluations().into());
    platform.result_count(trial, "generations", identification.search().generations().into());
    let Some(found) = identification.result() else { return };
    platform.result_f32(trial, "chi_square", found.normal.misfit.chi_square);
    let Some(errors) = found.normal.standard_errors() else { return };
    let names = [["bkl_m", "bkl_error_m"], ["fdj_N", "fdj_error_N"]];
    for (([value, error], free), (gene, gene_error)) in
        names.into_iter().zip(&FREE).zip(found.genes.into_iter().zip(errors))
    {
        platform.result_f32(trial, value, free.value(gene));
        platform.result_f32(trial, error, free.range() * gene_error);
    }
}

/// An index that the compiler cannot prove to be in bounds: the release image must not link.
#[cfg(feature = "negative-control-panic")]
fn reachable_panic() -> u64 {
    [1, 2, 3][black_box(1_usize)]
}

/// A sum and a product in double precision: on a part without a double-precision unit they call `__aeabi_d*`.
#[cfg(feature = "negative-control-f64")]
fn double_precision() -> f32 {
    (black_box(1.5_f64) * black_box(2.0_f64) + 1.0) as f32
}
