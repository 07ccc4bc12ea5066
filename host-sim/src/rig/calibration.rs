//! How well the values of a rig are known that records gave it.

use super::Range;
use crate::fit::{Correlation, Estimate};
use eha_monitor::parameter::Parameter;

/// How well values are known that were fitted to records: what is found with such a rig is no better known than they are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// The parameters that were fitted, each once.
    pub parameters: Vec<Parameter>,
    /// Standard error of each value, in its unit.
    pub standard_errors: Vec<f64>,
    /// How the values hang together: a row and a column for each, -1 to 1.
    pub correlation: Vec<Vec<f64>>,
}

impl Calibration {
    /// Is every value what it is, as far as anybody says?
    pub const fn is_empty(&self) -> bool {
        self.parameters.is_empty()
    }

    /// Covariance of two of the values, in the product of their units.
    pub fn covariance(&self, one: usize, other: usize) -> f64 {
        self.correlation[one][other] * self.standard_errors[one] * self.standard_errors[other]
    }

    /// That of fitted values and how they hang together, but for those of which the records say nothing.
    pub fn of(estimates: &[Estimate], correlation: &Correlation) -> Self {
        let entry = |one: usize, other: usize| {
            let shared = 0.5 * (correlation.matrix[one][other] + correlation.matrix[other][one]);
            if one == other {
                1.0
            } else if shared.is_finite() {
                shared.clamp(-1.0, 1.0)
            } else {
                0.0
            }
        };
        let row = |one: usize| (0..estimates.len()).map(|other| entry(one, other)).collect();
        let all = Self {
            parameters: estimates.iter().map(|estimate| estimate.parameter).collect(),
            standard_errors: estimates.iter().map(Estimate::spread).collect(),
            correlation: (0..estimates.len()).map(row).collect(),
        };
        let is_told = |&place: &usize| estimates[place].standard_error.is_finite();
        all.part(&(0..estimates.len()).filter(is_told).collect::<Vec<_>>())
    }

    /// What it says of the parameters of some places in it.
    fn part(&self, places: &[usize]) -> Self {
        let row = |&one: &usize| places.iter().map(|&other| self.correlation[one][other]).collect();
        Self {
            parameters: places.iter().map(|&place| self.parameters[place]).collect(),
            standard_errors: places.iter().map(|&place| self.standard_errors[place]).collect(),
            correlation: places.iter().map(row).collect(),
        }
    }

    /// What it says of values that are not fitted again.
    #[must_use]
    pub fn beside(&self, ranges: &[Range]) -> Self {
        let stays = |&place: &usize| ranges.iter().all(|range| range.parameter != self.parameters[place]);
        self.part(&(0..self.parameters.len()).filter(stays).collect::<Vec<_>>())
    }

    /// What it says, and an earlier one of parameters of which it says nothing: the two hang together in nothing.
    #[must_use]
    pub fn after(&self, earlier: &Self) -> Self {
        let is_kept = |&place: &usize| !self.parameters.contains(&earlier.parameters[place]);
        let earlier = earlier.part(&(0..earlier.parameters.len()).filter(is_kept).collect::<Vec<_>>());
        let (before, own) = (earlier.parameters.len(), self.parameters.len());
        let entry = |row: usize, column: usize| match (row.checked_sub(before), column.checked_sub(before)) {
            (None, None) => earlier.correlation[row][column],
            (Some(row), Some(column)) => self.correlation[row][column],
            _ => 0.0,
        };
        let row = |row: usize| (0..before + own).map(|column| entry(row, column)).collect();
        Self {
            parameters: [earlier.parameters.as_slice(), &self.parameters].concat(),
            standard_errors: [earlier.standard_errors.as_slice(), &self.standard_errors].concat(),
            correlation: (0..before + own).map(row).collect(),
        }
    }
}
