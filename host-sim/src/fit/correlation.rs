//! How estimates hang together.

use crate::output;
use eha_monitor::parameter::Parameter;
use serde_json::{Value, json};

/// Correlation of the estimates of some parameters, as far as they err by noise.
#[derive(Clone, Debug)]
pub struct Correlation {
    /// The parameters.
    pub parameters: Vec<Parameter>,
    /// A row and a column for each, -1 to 1; not finite where the records say nothing.
    pub matrix: Vec<Vec<f64>>,
}

impl Correlation {
    /// That of estimates with a covariance.
    pub fn new(parameters: impl IntoIterator<Item = Parameter>, covariance: &[Vec<f64>]) -> Self {
        let error = |index: usize| covariance[index][index].sqrt();
        let row = |(index, row): (usize, &Vec<f64>)| {
            row.iter().enumerate().map(|(other, both)| both / (error(index) * error(other))).collect()
        };
        Self {
            parameters: parameters.into_iter().collect(),
            matrix: covariance.iter().enumerate().map(row).collect(),
        }
    }

    /// The matrix in a result.
    pub fn json(&self) -> Value {
        let rows = self.matrix.iter().map(|row| row.iter().map(|&value| output::number(value)).collect());
        json!(rows.collect::<Vec<Vec<Value>>>())
    }
}
