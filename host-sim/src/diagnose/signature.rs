//! What a change of the rig does to the residual that nothing which is free can undo.

use super::residual;
use crate::fit::{self, Prepared};
use crate::rig::{Range, Rig};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Width of the differences, in ranges.
const DIFFERENCE: f64 = 2e-3;

/// Residuals of records with what the free parameters can take away projected out, as far as they act linearly.
pub(super) struct Signatures<'a> {
    records: &'a [Prepared],
    /// Orthonormal directions in which the free parameters move the residual, one a column.
    absorbed: DMatrix<f64>,
    /// What they leave of the rig's own residual, in units of the noise.
    left: DVector<f64>,
}

impl<'a> Signatures<'a> {
    /// Around the values that a rig has.
    pub(super) fn new(rig: &Rig, free: &[Range], records: &'a [Prepared]) -> Self {
        let residual = residual_of(rig, records);
        let columns: Vec<DVector<f64>> = free
            .par_iter()
            .map(|range| {
                let (here, width) =
                    (rig.parameters.get(range.parameter), DIFFERENCE * (range.upper - range.lower));
                let mut moved = rig.clone();
                moved.parameters.set(
                    range.parameter,
                    if here + width > range.upper { here - width } else { here + width },
                );
                (residual_of(&moved, records) - &residual).normalize()
            })
            .filter(|column| column.iter().all(|value| value.is_finite()))
            .collect();
        let absorbed = if columns.is_empty() {
            DMatrix::zeros(residual.len(), 0)
        } else {
            DMatrix::from_columns(&columns).qr().q()
        };
        let mut signatures = Self { records, absorbed, left: residual };
        signatures.left = signatures.project(signatures.left.clone());
        signatures
    }

    fn project(&self, residual: DVector<f64>) -> DVector<f64> {
        let taken = &self.absorbed * self.absorbed.tr_mul(&residual);
        residual - taken
    }

    /// Chi-square that is left with a signature added: once the free parameters have followed.
    pub(super) fn chi_square(&self, signature: &DVector<f64>) -> f64 {
        (&self.left + signature).norm_squared()
    }

    /// The signature of a rig that does not change.
    pub(super) fn none(&self) -> DVector<f64> {
        DVector::zeros(self.left.len())
    }

    /// The signature of a changed rig: what it adds to what is left, in units of the noise.
    pub(super) fn of(&self, rig: &Rig) -> DVector<f64> {
        self.project(residual_of(rig, self.records)) - &self.left
    }

    /// How much of each of some signatures is best, and the fall of chi-square that it gives; none where they are alike
    /// or show nowhere.
    pub(super) fn best(&self, signatures: &[DVector<f64>]) -> Option<(DVector<f64>, f64)> {
        let columns = DMatrix::from_columns(signatures);
        let pull = -columns.tr_mul(&self.left);
        let amounts = columns.tr_mul(&columns).cholesky()?.solve(&pull);
        let gain = amounts.dot(&pull);
        Some((amounts, gain))
    }
}

fn residual_of(rig: &Rig, records: &[Prepared]) -> DVector<f64> {
    residual::in_noise(records, &fit::glimpse(rig, records))
}
