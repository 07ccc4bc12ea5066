//! Time of a sample, a simulation, a generation and an identification: `cargo bench --bench core`.
#![allow(missing_docs, reason = "the macros of the harness make public functions")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{PERIOD, Rig, command};
use criterion::{Criterion, criterion_group, criterion_main};
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::{Identification, Settings};
use eha_monitor::fit::problem::{Free, Problem, Record, Start};
use eha_monitor::fit::walk::Walk;
use eha_monitor::ga::{Settings as SearchSettings, SteadyState};
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::collocation::Collocation;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::model::{Form, Model};
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::scalar::Real;
use std::hint::black_box;

type Exactly<T> = Exact<T, BASE_ORDER, 32>;

/// Samples of a record: one second.
const SAMPLES: usize = 1000;
/// A sample of the chirp in which nothing happens.
const QUIET: usize = 500;
const FAULTS: [f64; 2] = [2e-4, 800.0];

fn model<T: Real>(blend: f64) -> Model<T> {
    let [bkl, fdj] = FAULTS.map(T::literal);
    let metering_blend = T::literal(blend);
    Model::new(Form::default(), &Parameters { bkl, fdj, metering_blend, ..Parameters::default() })
}

fn simulate<T: Real, S: Stepper<T>>(model: &Model<T>, record: &Record<'_, T>, stepper: &mut S) {
    stepper.begin(record.sample_period, false, false);
    Walk::new(model, record).lead_on(record, stepper, &mut [], SAMPLES, |_, outputs, _| {
        black_box(outputs.user);
    });
}

fn sample(criterion: &mut Criterion) {
    let (command, start) = (command("chirp", SAMPLES), Start { time: 0.0, ram: 0.0, velocity: 0.0 });
    let record = Record::new(PERIOD, &command, &start);
    let mut stepper = Exactly::new();
    stepper.begin(PERIOD, false, true);
    let mut walk = Walk::new(&model(0.0), &record);
    for _ in 0..QUIET {
        walk.next(&record, &mut stepper);
    }
    // So many that the copy of the walk does not count.
    criterion.bench_function("100 quiet samples, f64", |bencher| {
        bencher.iter(|| {
            let mut walk = walk;
            walk.lead_on(&record, &mut stepper, &mut [], 100, |_, outputs, _| {
                black_box(outputs.user);
            });
        });
    });
}

fn simulations(criterion: &mut Criterion) {
    let start = Start { time: 0.0, ram: 0.0, velocity: 0.0 };
    let single_start = Start { time: 0.0, ram: 0.0, velocity: 0.0 };
    for name in ["chirp", "sine"] {
        let double = command(name, SAMPLES);
        let single: Vec<f32> = double.iter().map(|&value| value as f32).collect();
        let record = Record::new(PERIOD, &double, &start);
        let single_record = Record::new(PERIOD as f32, &single, &single_start);
        let mut exact = Exactly::new();
        criterion.bench_function(&format!("{name} 1 s, f64"), |bencher| {
            bencher.iter(|| simulate(&model(0.0), &record, &mut exact));
        });
        let mut exact = Exactly::new();
        criterion.bench_function(&format!("{name} 1 s, f32"), |bencher| {
            bencher.iter(|| simulate(&model(0.0), &single_record, &mut exact));
        });
        let mut collocation = Collocation::<f64, BASE_ORDER, 32>::new(2e-9);
        criterion.bench_function(&format!("{name} 1 s with metering, f64"), |bencher| {
            bencher.iter(|| simulate(&model(1.0), &record, &mut collocation));
        });
    }
}

fn searches(criterion: &mut Criterion) {
    let free = [
        Free { parameter: Parameter::Backlash, lower: 0.0, upper: 1.5e-3 },
        Free { parameter: Parameter::DryFriction, lower: 0.0, upper: 8000.0 },
    ];
    let (command, start) = (command("chirp", SAMPLES), Start { time: 0.0, ram: 0.0, velocity: 0.0 });
    let truth = Rig::with(|p| (p.bkl, p.fdj) = (FAULTS[0], FAULTS[1])).exact(&command);
    let records = [Record::new(PERIOD, &command, &start)
        .with(Channel::UserPosition, &truth.user, 1e-6)
        .with(Channel::Current, &truth.current, 0.02)];
    let problem =
        Problem { form: Form::default(), parameters: Parameters::default(), free: &free, records: &records };
    let search =
        || Identification::<f64, 2, 20>::new(&problem, Settings::default(), 1).expect("two are free");
    criterion.bench_function("generation of 20", |bencher| {
        let mut generation = SteadyState::<f64, 2, 20>::new(SearchSettings::default(), free.len(), 1);
        let mut stepper = Exactly::new();
        let mut children = || {
            for _ in 0..20 {
                let genes = generation.ask();
                generation.tell(problem.misfit(&genes, &mut stepper).mean_square());
            }
        };
        // The first ones make the matrices.
        children();
        bencher.iter(children);
    });
    criterion.bench_function("identification of two faults", |bencher| {
        bencher.iter(|| {
            let mut steppers = vec![Exactly::new()];
            search().run(&problem, &mut steppers)
        });
    });
}

criterion_group!(benches, sample, simulations, searches);
criterion_main!(benches);
