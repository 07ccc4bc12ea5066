//! Which integrator a fit needs, and the buffers for it.

use super::effort::Effort;
use super::{MAX_FREE, Prepared};
use crate::interrupt;
use crate::rig::{Range, Rig};
use eha_monitor::fit::problem::{Free, Offset, Problem, Record};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::collocation::Collocation;
use eha_monitor::integrate::exact::{Exact, FINE};
use eha_monitor::integrate::observed::{Observed, Observer};
use eha_monitor::model::state::{BASE_ORDER, FULL_ORDER, Outputs};
use std::cell::Cell;

/// Distance of the ram, m, that a curved step may err by in a fit: some 0.01 um over a simulation.
pub const FIT_TOLERANCE: f64 = 2e-9;

/// Distance of the ram, m, that a curved step may err by where only a tendency is wanted.
pub const LOOK_TOLERANCE: f64 = 1e-7;

/// Modes whose transition matrices are kept.
const SLOTS: usize = 32;

/// Exact steps of the base model.
type Plain = Exact<f64, BASE_ORDER, SLOTS>;
/// Exact steps of a model that moves more than that.
type Fine<const ORDER: usize> = Exact<f64, ORDER, { SLOTS / 2 }, FINE>;
/// Steps of a model whose laws are not all affine.
type Curved<const ORDER: usize> = Collocation<f64, ORDER, { SLOTS / 2 }>;

/// Fewest states of a model that moves more than the base model, and those that an integrator carries for a few more:
/// an effect has one of its own, the mount two.
const MORE: usize = BASE_ORDER + 1;
const SOME_ORDER: usize = BASE_ORDER + 2;

/// What an integrator must be able to do for every candidate of a problem.
struct Engine {
    /// Are all laws piecewise affine, so that steps are exact?
    is_affine: bool,
    /// States that move.
    order: usize,
}

impl Engine {
    /// What a problem needs.
    fn of(problem: &Problem<'_, f64>) -> Self {
        // A parameter that is free is not neutral inside its range.
        let inside = vec![0.618; problem.free.len()];
        let model = problem.model(&inside);
        Self { is_affine: model.is_affine(), order: model.order() }
    }
}

/// Work that is done with whichever integrator a problem needs.
pub trait Job {
    /// What it gives.
    type Output;

    /// Does it; `steppers` holds one more than there are free parameters.
    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output;
}

/// What the core calls ranges.
fn free_of(ranges: &[Range]) -> Vec<Free<f64>> {
    let free = |range: &Range| Free { parameter: range.parameter, lower: range.lower, upper: range.upper };
    ranges.iter().take(MAX_FREE).map(free).collect()
}

/// Are all laws of a rig piecewise affine, whatever some parameters are inside their ranges? A fit takes a tenth of the
/// time then.
pub fn is_affine(rig: &Rig, ranges: &[Range]) -> bool {
    let free = free_of(ranges);
    Engine::of(&Problem { form: rig.form, parameters: rig.parameters, free: &free, records: &[] }).is_affine
}

/// Makes the problem of fitting ranges (at most [`MAX_FREE`]) to records, and does a job on it with the integrator that
/// it needs; `tolerance` is what one step may move the ram by in error, m, where laws are not affine.
pub fn on_records<J: Job>(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    tolerance: f64,
    job: J,
) -> J::Output {
    let free = free_of(ranges);
    let series: Vec<_> = records.iter().map(Prepared::as_core).collect();
    let problem = Problem { form: rig.form, parameters: rig.parameters, free: &free, records: &series };
    let work = Work { problem: &problem, records, job };
    let Engine { is_affine, order } = Engine::of(&problem);
    match (is_affine, order) {
        (true, ..=BASE_ORDER) => work.with(45, Plain::new),
        (true, MORE..=SOME_ORDER) => work.with(75, Fine::<SOME_ORDER>::new),
        (true, _) => work.with(105, Fine::<FULL_ORDER>::new),
        (false, ..=BASE_ORDER) => work.with(140, || Curved::<BASE_ORDER>::new(tolerance)),
        (false, MORE..=SOME_ORDER) => work.with(190, || Curved::<SOME_ORDER>::new(tolerance)),
        (false, _) => work.with(250, || Curved::<FULL_ORDER>::new(tolerance)),
    }
}

/// A job on a problem.
struct Work<'a, J> {
    problem: &'a Problem<'a, f64>,
    records: &'a [Prepared],
    job: J,
}

impl<J: Job> Work<'_, J> {
    /// Does it with an integrator that takes so many ns for a step on the machine that this was measured on: one for the
    /// model and one for each of its neighbours in a finish.
    fn with<S: Stepper<f64>>(self, step_ns: u64, make: impl Fn() -> S) -> J::Output {
        let effort = self.records.first().map(|record| &record.effort);
        let counted = |_| Observed::new(make(), Counter { steps: Cell::new(0), effort });
        let mut steppers: Vec<_> = (0..=self.problem.free.len()).map(counted).collect();
        let output = self.job.run(self.problem, &mut steppers);
        if let Some(effort) = effort {
            let steps: u64 = steppers.iter().map(|stepper| stepper.observer.steps.get()).sum();
            effort.add(step_ns * steps);
        }
        output
    }
}

/// Counts the steps of a simulation, and leaves it where it is not to begin any more.
struct Counter<'a> {
    steps: Cell<u64>,
    /// The account of its records, if there are any.
    effort: Option<&'a Effort>,
}

impl Observer for Counter<'_> {
    fn begins(&self) {
        if self.effort.is_some_and(Effort::is_to_be_left) {
            interrupt::leave();
        }
    }

    #[inline(always)]
    fn took(&self, steps: u32) {
        self.steps.took(steps);
    }
}

/// What the model of some genes predicts, sample by sample, for each record; where the record's offset is unknown, with
/// its best value.
pub fn trace<S: Stepper<f64>>(
    problem: &Problem<'_, f64>,
    genes: &[f64],
    stepper: &mut S,
) -> Vec<Vec<Outputs<f64>>> {
    let model = problem.model(genes);
    problem
        .records
        .iter()
        .map(|record| {
            stepper.begin(record.sample_period, record.has_force(), true);
            let mut walk = Walk::new(&model, record);
            let mut outputs: Vec<_> =
                std::iter::from_fn(|| walk.next(record, stepper).map(|(_, outputs)| outputs)).collect();
            if record.offset_unknown {
                let offset = offset_of(record, &outputs);
                for outputs in &mut outputs {
                    outputs.user += offset;
                }
            }
            outputs
        })
        .collect()
}

/// The offset of a record that brings a prediction closest to it, m.
fn offset_of(record: &Record<'_, f64>, outputs: &[Outputs<f64>]) -> f64 {
    let measured = record.measured[Offset::<f64>::CHANNEL];
    let mut offset = Offset::NONE;
    for (sample, (measured, outputs)) in measured.iter().zip(outputs).enumerate() {
        if record.is_compared(sample) && measured.is_finite() {
            offset.add(measured - outputs.user);
        }
    }
    offset.mean()
}
