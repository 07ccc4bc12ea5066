//! What a change of the rig does to the residual that nothing which is free can undo.

use super::residual;
use crate::fit::{self, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::gauss_newton::Settings;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

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
        let difference = Settings::<f64>::default().difference;
        let columns: Vec<DVector<f64>> = free
            .par_iter()
            .map(|range| {
                let (here, width) =
                    (rig.parameters.get(range.parameter), difference * (range.upper - range.lower));
                let mut moved = rig.clone();
                moved.parameters.set(range.parameter, here + range.inward(here, width));
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

    /// What the free parameters leave of a change of the residual.
    pub(super) fn project(&self, residual: DVector<f64>) -> DVector<f64> {
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

#[cfg(test)]
pub(super) mod tests {
    use super::Signatures;
    use crate::fit::{self, Prepared};
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;
    use eha_monitor::model::state::Outputs;
    use eha_monitor::parameter::Parameter;
    use nalgebra::DVector;
    use rand_distr::{Distribution as _, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng as _;
    use std::slice;

    const PERIOD: f64 = 1e-3;
    const NOISE: [f64; 4] = [1e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY];

    pub(in super::super) fn with(rig: &Rig, parameter: Parameter, change: f64) -> Rig {
        let mut rig = rig.clone();
        rig.parameters.set(parameter, rig.parameters.get(parameter) + change);
        rig
    }

    /// A second of a growing sine, with the position of a rig.
    pub(in super::super) fn record(rig: &Rig) -> Prepared {
        recorded(rig, |_, outputs| outputs)
    }

    /// The same, with the position that a recorder makes of what the rig puts out.
    pub(in super::super) fn recorded(
        rig: &Rig,
        recorder: impl FnOnce(&Prepared, Vec<Outputs<f64>>) -> Vec<Outputs<f64>>,
    ) -> Prepared {
        let command: Vec<f64> =
            (0..1000).map(|k| f64::from(k) * 5e-6 * (f64::from(k) * PERIOD * 20.0).sin()).collect();
        flown(rig, &command, NOISE, recorder)
    }

    /// The positions of a rig that flies a sine and stairs, in 5 um of noise. What jumps on a curve does so in the middle of
    /// a sample.
    pub(in super::super) fn sine_and_stairs(rig: &Rig) -> [Prepared; 2] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let noise = [5e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY];
        let mut noisy = |unseen: &Prepared, _| {
            let between = unseen.with_jumps_ahead(unseen.jumps().into_iter().map(|jump| (jump, 0.5)));
            let mut outputs = fit::predict(rig, &[between]).concat();
            for outputs in &mut outputs {
                let normal: f64 = StandardNormal.sample(&mut random);
                outputs.user += noise[0] * normal;
            }
            outputs
        };
        let sine = |k: u16| 2e-3 * (f64::from(k) * 6e-3).sin();
        let stairs = |k: u16| [0.0, 1e-3, -5e-4, -2e-3, 1.5e-3][usize::from(k / 210)];
        [(0..1000).map(sine).collect::<Vec<_>>(), (0..1000).map(stairs).collect()]
            .map(|command| flown(rig, &command, noise, &mut noisy))
    }

    fn flown(
        rig: &Rig,
        command: &[f64],
        noise: [f64; 4],
        recorder: impl FnOnce(&Prepared, Vec<Outputs<f64>>) -> Vec<Outputs<f64>>,
    ) -> Prepared {
        let prepared = |position: Vec<f64>| {
            let channels = vec![(Channel::Command, command.to_vec()), (Channel::UserPosition, position)];
            let record = Record::new("made".to_owned(), PERIOD, 0.0, channels).unwrap();
            fit::prepare_with(rig, &record, noise)
        };
        let unseen = prepared(command.to_vec());
        let outputs = fit::predict(rig, slice::from_ref(&unseen)).concat();
        prepared(recorder(&unseen, outputs).iter().map(|outputs| outputs.user).collect())
    }

    #[test]
    fn what_is_free_leaves_no_signature_and_what_is_not_shows_its_size() {
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 800.0);
        let records = [record(&with(&rig, Parameter::ConstantLoad, 40.0))];
        let (free, none) =
            (Signatures::new(&rig, &rig.faults, &records), Signatures::new(&rig, &[], &records));
        let stiffer = with(&rig, Parameter::DryFriction, 5.0);
        assert!(none.of(&stiffer).norm() > 1.0);
        assert!(free.of(&stiffer).norm() < 0.05 * none.of(&stiffer).norm());

        let loaded = free.of(&with(&rig, Parameter::ConstantLoad, 10.0));
        let (amounts, gain) = free.best(slice::from_ref(&loaded)).unwrap();
        assert!((amounts[0] - 4.0).abs() < 0.2, "{amounts}");
        let left = free.chi_square(&DVector::zeros(loaded.len()));
        assert!(gain > 0.95 * left, "{gain} of {left}");
        assert!(free.chi_square(&(&loaded * amounts[0])) < 0.05 * left);
        assert!(free.best(&[free.none()]).is_none());
    }
}
