//! What the timing of records adds to the evidence for a model.
//!
//! No recording, and no program that steps through its equations, is timed better than by some microseconds. Where a great
//! many samples say nearly the same of two effects, that little may be what tells them apart.

use super::residual;
use super::signature::Signatures;
use crate::fit::{self, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::model::state::Outputs;
use std::cell::OnceCell;
use std::iter;

/// By how much records may be early or late, s: a step of the plants of the design.
const TIMING_S: f64 = 2e-6;

/// A fitted model, its records early or late, that others are judged beside.
pub(super) struct Timing<'a> {
    rig: Rig,
    free: &'a [Range],
    records: &'a [Prepared],
    gain: OnceCell<f64>,
}

impl<'a> Timing<'a> {
    pub(super) fn new(rig: Rig, free: &'a [Range], records: &'a [Prepared]) -> Self {
        Self { rig, free, records, gain: OnceCell::new() }
    }

    /// Whether the timing that suits another model best makes up for a chi-square that is too high by so much, beside what
    /// its own timing does for this one.
    pub(super) fn makes_up_for(&self, excess: f64, rig: &Rig, free: &[Range]) -> bool {
        let own = self.gain.get_or_init(|| gain(&self.rig, self.free, self.records));
        gain(rig, free, self.records) - own > excess
    }
}

/// By how much the chi-square of a fitted model falls where its records are as early or late as suits it best, all of them
/// by the same part of [`TIMING_S`], and what is free makes up for what it can.
fn gain(rig: &Rig, free: &[Range], records: &[Prepared]) -> f64 {
    let predictions = fit::predict(rig, records);
    let late: Vec<Vec<Outputs<f64>>> =
        records.iter().zip(&predictions).map(|(record, outputs)| delayed(record, outputs)).collect();
    let residual = residual::in_noise(records, &predictions);
    let change = Signatures::new(rig, free, records).project(residual::in_noise(records, &late) - &residual);
    let (slope, curvature) = (change.dot(&residual), change.norm_squared());
    if curvature == 0.0 {
        return 0.0;
    }
    let share = (-slope / curvature).clamp(-1.0, 1.0);
    -share * (2.0 * slope + share * curvature)
}

/// A prediction as a record shows it that is late by [`TIMING_S`], a small part of its sample period.
fn delayed(record: &Prepared, outputs: &[Outputs<f64>]) -> Vec<Outputs<f64>> {
    let share = TIMING_S / record.sample_period;
    let between = |before: f64, here: f64| here + share * (before - here);
    let first = outputs.first().copied().unwrap_or_default();
    let before = iter::once(&first).chain(outputs);
    outputs
        .iter()
        .zip(before)
        .map(|(here, before)| Outputs {
            user: between(before.user, here.user),
            ram: between(before.ram, here.ram),
            current: between(before.current, here.current),
            pressure: between(before.pressure, here.pressure),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::signature::tests::recorded;

    fn chi_square(rig: &Rig, records: &[Prepared]) -> f64 {
        residual::in_noise(records, &fit::predict(rig, records)).norm_squared()
    }

    #[test]
    fn the_best_timing_takes_away_what_being_late_adds_and_no_more_than_may_be() {
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 800.0);
        let late = |times: usize| {
            let times_late = |record: &Prepared, outputs: Vec<Outputs<f64>>| {
                (0..times).fold(outputs, |outputs, _| delayed(record, &outputs))
            };
            [recorded(&rig, times_late)]
        };
        let (on_time, once, five_times) = (late(0), late(1), late(5));
        assert!(gain(&rig, &[], &on_time) < 1e-6);

        let added = chi_square(&rig, &once);
        assert!(added > 1.0, "{added}");
        assert!((gain(&rig, &[], &once) / added - 1.0).abs() < 1e-2);

        // Where it does as much for one as for the other, it decides nothing.
        let timing = Timing::new(rig.clone(), &[], &once);
        assert!(
            !timing.makes_up_for(1e-3 * added, &rig, &[]) && timing.makes_up_for(-1e-3 * added, &rig, &[])
        );

        // A fifth of it is what may be: 25 times as much becomes 16 times as much.
        let taken = gain(&rig, &[], &five_times) / added;
        assert!((taken - 9.0).abs() < 0.1, "{taken}");

        // What the faults make up for is theirs.
        assert!(gain(&rig, &rig.faults, &once) < 0.9 * added);
    }
}
