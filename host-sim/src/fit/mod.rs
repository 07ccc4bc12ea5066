//! From records and a rig to fitted parameters: the bridge to the core's search.

mod bounds;
mod calibrated;
mod closed_loop;
mod colour;
mod correlation;
mod effort;
pub mod engine;
mod estimate;
mod limits;
pub mod measured;
mod noise;
mod periodogram;
mod polish;
mod prepare;
mod reading;
mod result;
mod rounding;
mod search;
mod systematic;
mod valley;
mod visits;

pub use bounds::{Bounds, is_told, remarks};
pub use calibrated::widen_by_calibration;
pub use closed_loop::{LoopScore, force_error, loop_score};
pub use colour::{as_white, colour_of};
pub use correlation::Correlation;
pub use effort::{share_account, spent_s, unless_interrupted};
pub use estimate::{Estimate, OF_95};
pub use limits::{CLIPPED, at_ends, extent, longest_rests, share_at_ends};
pub use noise::{
    COARSE, LaggedProducts, MODEL_ERROR, NoiseSource, SMALLEST_NOISE, TYPICAL_NOISE, correlation_time,
    differences, fourth_differences, is_sparse, longest_correlation_time, noise_of, noise_of_series,
    noise_source, pooled, present, quantum, residual_series, rms, shown_noise,
};
pub use periodogram::{correlations, periodograms, strongest_tone};
pub use polish::{Polished, approach, foresee, misfit, misfit_within, polish};
pub use prepare::{Prepared, Steps, prepare, prepare_with};
pub use reading::{AsRead, Reading, fit_as_read, is_command_late, on_path, speaks_for};
pub use result::Fit;
pub use rounding::most_likely;
pub use search::{FitSettings, Standing, fit, fit_from_seeds, fit_near};
pub use systematic::standard_errors;
pub use valley::Valley;
pub use visits::Visit;

use crate::rig::Rig;
use eha_monitor::fit::problem::Problem;
use eha_monitor::integrate::Stepper;
use eha_monitor::model::state::Outputs;
pub use engine::is_affine;
use engine::{FIT_TOLERANCE, Job, LOOK_TOLERANCE, on_records};

/// Most parameters that one fit may free.
pub const MAX_FREE: usize = 20;
/// Most members of a population.
pub const MAX_POPULATION: usize = 64;

/// Fall of chi-square from which a valley is another one.
pub const BETTER_VALLEY: f64 = 1.0;

/// Twice the logarithm of the odds (100 to 1) below which two models of as many parameters are not told apart.
pub const TOLD_APART: f64 = 9.2;

/// What a model with given parameters predicts for each record.
pub fn predict(rig: &Rig, records: &[Prepared]) -> Vec<Vec<Outputs<f64>>> {
    on_records(rig, &[], records, FIT_TOLERANCE, Trace)
}

/// What a model predicts for each record, roughly ([`LOOK_TOLERANCE`]).
pub fn glimpse(rig: &Rig, records: &[Prepared]) -> Vec<Vec<Outputs<f64>>> {
    on_records(rig, &[], records, LOOK_TOLERANCE, Trace)
}

struct Trace;

impl Job for Trace {
    type Output = Vec<Vec<Outputs<f64>>>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output {
        engine::trace(problem, &[], &mut steppers[0])
    }
}
