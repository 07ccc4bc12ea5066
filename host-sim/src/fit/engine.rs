//! Which integrator a fit needs, and the buffers for it.

use super::{MAX_FREE, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::problem::{Free, Problem};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::collocation::Collocation;
use eha_monitor::integrate::exact::{Exact, FINE};
use eha_monitor::model::state::{BASE_ORDER, FULL_ORDER, Outputs};

/// Distance of the ram, m, that a curved step may err by in a fit: some 0.01 um over a simulation.
pub const FIT_TOLERANCE: f64 = 2e-9;

/// The same where only a tendency is wanted.
pub const LOOK_TOLERANCE: f64 = 1e-7;

/// Modes whose transition matrices are kept.
const SLOTS: usize = 32;

/// Exact steps of the base model.
pub type Base = Exact<f64, BASE_ORDER, SLOTS>;
/// Exact steps of a model with every state.
pub type Full = Exact<f64, FULL_ORDER, { SLOTS / 2 }, FINE>;

/// Steps of a base model with laws that are not affine.
pub type CurvedBase = Collocation<f64, BASE_ORDER, SLOTS>;
/// Steps of a model with every state and laws that are not affine.
pub type CurvedFull = Collocation<f64, FULL_ORDER, { SLOTS / 2 }>;

/// The integrators that a fit can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// [`Base`].
    Base,
    /// [`Full`].
    Full,
    /// [`CurvedBase`].
    CurvedBase,
    /// [`CurvedFull`].
    CurvedFull,
}

impl Engine {
    /// The fastest integrator that is right for every candidate of a problem.
    pub fn of(problem: &Problem<'_, f64>) -> Self {
        // A parameter that is free is not neutral inside its range.
        let inside = vec![0.618; problem.free.len()];
        let model = problem.model(&inside);
        match (model.is_affine(), model.order() == BASE_ORDER) {
            (true, true) => Self::Base,
            (true, false) => Self::Full,
            (false, true) => Self::CurvedBase,
            (false, false) => Self::CurvedFull,
        }
    }
}

/// One stepper for a model and one for each of its neighbours in a finish.
fn steppers<S>(problem: &Problem<'_, f64>, make: impl Fn() -> S) -> Vec<S> {
    (0..=problem.free.len()).map(|_| make()).collect()
}

/// Work that is done with whichever integrator a problem needs.
pub trait Job {
    /// What it gives.
    type Output;

    /// Does it; `steppers` holds one more than there are free parameters.
    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output;
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
    let free: Vec<Free<f64>> = ranges
        .iter()
        .take(MAX_FREE)
        .map(|range| Free { parameter: range.parameter, lower: range.lower, upper: range.upper })
        .collect();
    let records: Vec<_> = records.iter().map(Prepared::as_core).collect();
    let problem = Problem { form: rig.form, parameters: rig.parameters, free: &free, records: &records };
    match Engine::of(&problem) {
        Engine::Base => job.run(&problem, &mut steppers(&problem, Base::new)),
        Engine::Full => job.run(&problem, &mut steppers(&problem, Full::new)),
        Engine::CurvedBase => job.run(&problem, &mut steppers(&problem, || CurvedBase::new(tolerance))),
        Engine::CurvedFull => job.run(&problem, &mut steppers(&problem, || CurvedFull::new(tolerance))),
    }
}

/// What the model of some genes predicts, sample by sample, for each record.
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
            std::iter::from_fn(|| walk.next(record, stepper).map(|(_, outputs)| outputs)).collect()
        })
        .collect()
}
