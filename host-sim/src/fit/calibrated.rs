//! What is found with a rig is no better known than the values that were fitted to other records before.

use super::engine::{FIT_TOLERANCE, Job, on_records};
use super::polish::genes_of;
use super::{Estimate, MAX_FREE, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::gauss_newton::{Settings, normal_equations};
use eha_monitor::fit::problem::Problem;
use eha_monitor::integrate::Stepper;
use nalgebra::DMatrix;

/// Half width of the range in which the slope of a calibrated value is taken, in its standard errors: its forward
/// difference is then a fifth of one.
const HALF_WIDTH: f64 = 50.0;

/// Widens the intervals of values that were fitted to records with a rig by what its calibrated values are off by.
pub fn widen_by_calibration(rig: &Rig, ranges: &[Range], estimates: &mut [Estimate], records: &[Prepared]) {
    let values: Vec<f64> = estimates.iter().map(|estimate| estimate.value).collect();
    let errors = errors(rig, ranges, &values, records).unwrap_or_default();
    for ((estimate, range), error) in estimates.iter_mut().zip(ranges).zip(errors) {
        estimate.widen(range, error);
    }
}

/// Standard error of each fitted value that comes from those of the rig's calibrated ones, in its unit; none where nothing
/// is known of those, or all are fitted again.
///
/// With `A` the curvature of chi-square in the fitted values and `B` that between them and the calibrated ones, an error `c`
/// of these shifts the fitted values by `-A^-1 B c`, as long as the model is linear in it.
fn errors(rig: &Rig, ranges: &[Range], values: &[f64], records: &[Prepared]) -> Option<Vec<f64>> {
    let calibration = rig.calibration.beside(ranges);
    let calibrated = calibration.parameters.iter().zip(&calibration.standard_errors);
    let around = calibrated.map(|(&parameter, error)| {
        Range::around(parameter, rig.parameters.get(parameter), HALF_WIDTH * error)
    });
    let kept: Vec<(usize, Range)> = around
        .enumerate()
        .filter(|(_, range)| range.lower < range.upper)
        .take(MAX_FREE.saturating_sub(ranges.len()))
        .collect();
    if kept.is_empty() {
        return None;
    }
    let all: Vec<Range> = ranges.iter().copied().chain(kept.iter().map(|(_, range)| *range)).collect();
    let known = kept.iter().map(|(_, range)| rig.parameters.get(range.parameter));
    let there: Vec<f64> = values.iter().copied().chain(known).collect();
    let curvature = on_records(rig, &all, records, FIT_TOLERANCE, Curvature { values: &there });
    let (own, beside) = (ranges.len(), kept.len());
    let of_fitted = curvature.view((0, 0), (own, own)).into_owned();
    let between = curvature.view((0, own), (own, beside)).into_owned();
    let shifts = of_fitted.try_inverse()? * between;
    let covariance =
        DMatrix::from_fn(beside, beside, |one, other| calibration.covariance(kept[one].0, kept[other].0));
    let passed_on = (&shifts * covariance * shifts.transpose()).diagonal();
    Some(passed_on.iter().map(|square| square.max(0.0).sqrt()).collect())
}

/// The curvature of chi-square at some values, in the product of their units.
struct Curvature<'a> {
    values: &'a [f64],
}

impl Job for Curvature<'_> {
    type Output = DMatrix<f64>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> DMatrix<f64> {
        let genes: [f64; MAX_FREE] = genes_of(problem, self.values);
        let normal = normal_equations(problem, &genes, Settings::default().difference, steppers);
        let scale = |gene: usize| problem.free[gene].range();
        let count = problem.free.len();
        DMatrix::from_fn(count, count, |row, column| {
            normal.curvature[(row, column)] / (scale(row) * scale(column))
        })
    }
}
