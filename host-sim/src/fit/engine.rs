//! Which integrator a fit needs, and the buffers for it.

use super::{MAX_FREE, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::problem::{Free, Problem};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::integrate::midpoint::Midpoint;
use eha_monitor::model::state::{BASE_ORDER, FULL_ORDER, Outputs};

/// Longest step of the midpoint rule in a fit, s: its error is then below 0.3 um on every command.
pub const FIT_STEP: f64 = 5e-5;

/// Longest step of the midpoint rule where only a tendency is wanted, s.
pub const LOOK_STEP: f64 = 1.25e-4;

/// Modes whose transition matrices are kept.
const SLOTS: usize = 32;

/// Exact steps of the base model.
pub type Base = Exact<f64, BASE_ORDER, SLOTS>;
/// Exact steps of a model with every state.
pub type Full = Exact<f64, FULL_ORDER, { SLOTS / 2 }>;

/// Fixed steps of a model that is not piecewise affine.
pub type Fixed = Midpoint<f64>;

/// The integrators that a fit can use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// [`Base`].
    Base,
    /// [`Full`].
    Full,
    /// [`Fixed`].
    Midpoint,
}

impl Engine {
    /// The fastest integrator that is right for every candidate of a problem.
    pub fn of(problem: &Problem<'_, f64>) -> Self {
        // A parameter that is free is not neutral inside its range.
        let inside = vec![0.618; problem.free.len()];
        let model = problem.model(&inside);
        if !model.is_affine() {
            Self::Midpoint
        } else if model.order() == BASE_ORDER {
            Self::Base
        } else {
            Self::Full
        }
    }
}

/// One stepper for a model and one for each of its neighbours in a finish.
fn steppers<S: Clone>(stepper: S) -> Vec<S> {
    vec![stepper; MAX_FREE + 1]
}

/// Work that is done with whichever integrator a problem needs.
pub trait Job {
    /// What it gives.
    type Output;

    /// Does it; `steppers` holds `MAX_FREE + 1` of them.
    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output;
}

/// Makes the problem of fitting ranges (at most [`MAX_FREE`]) to records, and does a job on it with the integrator that
/// it needs; `step` is the longest one, s, where that is the midpoint rule.
pub fn on_records<J: Job>(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    noise: [f64; 4],
    step: f64,
    job: J,
) -> J::Output {
    let free: Vec<Free<f64>> = ranges
        .iter()
        .take(MAX_FREE)
        .map(|range| Free { parameter: range.parameter, lower: range.lower, upper: range.upper })
        .collect();
    let records: Vec<_> = records.iter().map(Prepared::as_core).collect();
    let problem =
        Problem { form: rig.form, parameters: rig.parameters, free: &free, records: &records, noise };
    match Engine::of(&problem) {
        Engine::Base => job.run(&problem, &mut steppers(Base::new())),
        Engine::Full => job.run(&problem, &mut steppers(Full::new())),
        Engine::Midpoint => job.run(&problem, &mut steppers(Fixed::new(step))),
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
            stepper.begin(record.sample_period, !record.force.is_empty(), true);
            let mut walk = Walk::new(&model, record);
            std::iter::from_fn(|| walk.next(record, stepper).map(|(_, outputs)| outputs)).collect()
        })
        .collect()
}
