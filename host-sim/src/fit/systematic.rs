//! What the model's own error can do to an estimate, however much is recorded.

use super::engine::{FIT_TOLERANCE, Job, on_records};
use super::noise::{MODEL_ERROR, SMALLEST_NOISE};
use super::polish::genes_of;
use super::{MAX_FREE, Polished, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::FRICTION_ERROR;
use eha_monitor::fit::gauss_newton::{Settings, normal_equations};
use eha_monitor::fit::problem::{Problem, Record};
use eha_monitor::integrate::Stepper;
use eha_monitor::model::Drive;
use eha_monitor::parameter::Parameter;
use nalgebra::SMatrix;
use std::iter;

/// Covariance of the genes of a fit.
type Covariance = SMatrix<f64, MAX_FREE, MAX_FREE>;

/// Standard error of each value of a fit that leaves noise of records: what white noise makes of it, and what the model's
/// own error can.
pub fn standard_errors(rig: &Rig, ranges: &[Range], fit: &Polished, records: &[Prepared]) -> Vec<f64> {
    let systematic = on_records(rig, ranges, records, FIT_TOLERANCE, Systematic { fit });
    let noise = (0..ranges.len()).map(|index| fit.standard_error(index));
    noise.zip(systematic).map(|(noise, systematic)| noise.hypot(systematic)).collect()
}

struct Systematic<'a> {
    fit: &'a Polished,
}

impl Job for Systematic<'_> {
    type Output = Vec<f64>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Vec<f64> {
        let covariance = covariance_of_genes(problem, &self.fit.covariance);
        let shifts = of_genes(problem, &genes_of(problem, &self.fit.values), &covariance, steppers);
        iter::zip(problem.free, shifts).map(|(free, shift)| shift * free.range()).collect()
    }
}

/// Covariance of the genes from that of the values.
pub(super) fn covariance_of_genes(problem: &Problem<'_, f64>, of_values: &[Vec<f64>]) -> Covariance {
    Covariance::from_fn(|row, column| {
        let (Some(one), Some(other)) = (problem.free.get(row), problem.free.get(column)) else { return 0.0 };
        of_values[row][column] / (one.range() * other.range())
    })
}

/// Standard uncertainty of each gene that comes from the model's own error.
pub(super) fn of_genes<S: Stepper<f64>>(
    problem: &Problem<'_, f64>,
    genes: &[f64; MAX_FREE],
    covariance: &Covariance,
    steppers: &mut [S],
) -> [f64; MAX_FREE] {
    let mut shifts = where_noiseless(problem, genes, covariance, steppers);
    if problem.form.drive == Drive::Valve {
        for (free, shift) in iter::zip(problem.free, &mut shifts) {
            if free.parameter == Parameter::DryFriction {
                *shift = shift.hypot(FRICTION_ERROR / free.range());
            }
        }
    }
    shifts
}

/// The same of the channels that have no noise to speak of: zero where all have.
///
/// An error repeats itself, so no number of samples averages it out. At worst it has the very shape of what a gene does,
/// and shifts the gene by the error's size times the root of the number of samples times the norm of that gene's row of the
/// estimator; anything between that and its opposite is as likely.
fn where_noiseless<S: Stepper<f64>>(
    problem: &Problem<'_, f64>,
    genes: &[f64; MAX_FREE],
    covariance: &Covariance,
    steppers: &mut [S],
) -> [f64; MAX_FREE] {
    let records: Vec<_> = problem.records.iter().map(noiseless).collect();
    if records.iter().all(|record| record.noise.iter().all(|noise| noise.is_infinite())) {
        return [0.0; MAX_FREE];
    }
    let problem = Problem { records: &records, ..*problem };
    let normal = normal_equations(&problem, genes, Settings::default().difference, steppers);
    let squares = (covariance * normal.curvature * covariance).diagonal() * f64::from(normal.misfit.count);
    std::array::from_fn(|gene| (squares[gene] / 3.0).sqrt())
}

/// A record with the channels alone that have no noise to speak of, each with the weight of a fit's answer to the model's
/// error.
fn noiseless<'a>(record: &Record<'a, f64>) -> Record<'a, f64> {
    let noise = std::array::from_fn(|channel| {
        let noise = record.noise[channel];
        if noise <= SMALLEST_NOISE[channel] { noise * noise / MODEL_ERROR[channel] } else { f64::INFINITY }
    });
    Record { noise, ..*record }
}
