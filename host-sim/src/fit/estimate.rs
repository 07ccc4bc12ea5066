//! Fitted parameters with their errors.

use super::MAX_FREE;
use crate::rig::Range;
use eha_monitor::fit::problem::{Free, Problem};
use eha_monitor::parameter::Parameter;
use nalgebra::SMatrix;

/// Standard errors to each side that hold the true value in 95 of 100 cases.
pub const OF_95: f64 = 1.96;

/// A fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Which parameter.
    pub parameter: Parameter,
    /// Its value.
    pub value: f64,
    /// Its standard error; not finite where the records say nothing about it.
    pub standard_error: f64,
    /// Interval that holds the true value in 95 of 100 cases, cut to the range of the search.
    pub ci95: [f64; 2],
}

impl Estimate {
    /// An estimate with its interval.
    pub fn new(range: &Range, value: f64, standard_error: f64) -> Self {
        Self {
            parameter: range.parameter,
            value,
            standard_error,
            ci95: [
                (value - OF_95 * standard_error).max(range.lower),
                (value + OF_95 * standard_error).min(range.upper),
            ],
        }
    }

    /// The standard error that its interval speaks of, on its wider side.
    pub fn spread(&self) -> f64 {
        (self.ci95[1] - self.value).max(self.value - self.ci95[0]) / OF_95
    }

    /// Widens the interval by a standard error of another origin; where the range cut it, it stays cut.
    pub(super) fn widen(&mut self, range: &Range, error: f64) {
        let wider = |side: f64| side.hypot(OF_95 * error);
        let [below, above] = [self.value - self.ci95[0], self.ci95[1] - self.value].map(wider);
        self.standard_error = self.standard_error.hypot(error);
        self.ci95 = [(self.value - below).max(range.lower), (self.value + above).min(range.upper)];
    }

    /// Widens the interval to where one that was widened, on the sides on which it was, had gone.
    pub(super) fn hold_beyond(&mut self, widened: [f64; 2], before: [f64; 2]) {
        if widened[0] < before[0] {
            self.ci95[0] = self.ci95[0].min(widened[0]);
        }
        if widened[1] > before[1] {
            self.ci95[1] = self.ci95[1].max(widened[1]);
        }
    }

    /// Widens the interval to hold that of another estimate, which may be right as well.
    pub fn hold(&mut self, other: &Self) {
        self.ci95 = [self.ci95[0].min(other.ci95[0]), self.ci95[1].max(other.ci95[1])];
    }
}

/// Covariance of the free parameters, in the product of their units, from that of their genes for white noise.
pub(super) fn in_units(
    problem: &Problem<'_, f64>,
    of_genes: &SMatrix<f64, MAX_FREE, MAX_FREE>,
    inflation: f64,
) -> Vec<Vec<f64>> {
    let range = |gene: usize| problem.free[gene].range();
    let entry =
        |row: usize, column: usize| of_genes[(row, column)] * inflation * (range(row) * range(column));
    let count = problem.free.len();
    (0..count).map(|row| (0..count).map(|column| entry(row, column)).collect()).collect()
}

/// Estimates of the free parameters, with what noise and systematic errors, in genes, make of them.
pub(super) fn estimates(
    problem: &Problem<'_, f64>,
    genes: &[f64; MAX_FREE],
    covariance: &[Vec<f64>],
    systematic: &[f64; MAX_FREE],
) -> Vec<Estimate> {
    let estimate = |(gene, free): (usize, &Free<f64>)| {
        let standard_error = covariance[gene][gene].sqrt().hypot(systematic[gene] * free.range());
        let range = Range { parameter: free.parameter, lower: free.lower, upper: free.upper };
        Estimate::new(&range, free.value(genes[gene]), standard_error)
    };
    problem.free.iter().enumerate().map(estimate).collect()
}
