//! Whether an effect earns its place in a hypothesis: significant, it matters, and the held-out records agree.

use super::Case;
use super::hypothesis::Hypothesis;
use super::residual::{self, MEASURED};
use crate::fit::{self, Polished, Prepared, SMALLEST_NOISE};
use crate::rig::Range;
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::FRICTION_ERROR;
use eha_monitor::fit::identify::within_noise;
use eha_monitor::model::Drive;
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::Parameter;
use rayon::prelude::*;
use std::cell::LazyCell;

/// Rise of the chi-square of some records, from what they say to what others say, that chance explains (three standard
/// deviations of one parameter: with two, one effect in fifty would be refused though it is there), in units of what is left
/// and for samples that say different things.
const HOLDOUT_CHANCE: f64 = 9.0;
/// Standard errors, over blocks of the records, that a gain must have where what is left is not noise.
const ROBUST_SIGMA: f64 = 2.0;
/// Standard uncertainties of the friction that may be a model's own error.
const FRICTION_SIGMA: f64 = 3.0;
/// Standard errors that an effect's size must be from none: one whose interval holds none opens another valley of the
/// rest, no more.
const SIZE_SIGMA: f64 = 2.0;

/// An effect that earns its place.
pub(super) struct Earned {
    pub(super) effect: &'static EffectInfo,
    /// Twice the logarithm of the odds against the model without it, less what the steps of sensors may have added.
    pub(super) evidence: f64,
    /// The model without it.
    pub(super) without: Hypothesis,
}

impl Hypothesis {
    /// The effects of the model, each weighed against the model without it as far as that is known.
    pub(super) fn weighed(&self, case: &Case<'_>, known: &[Self]) -> Vec<Earned> {
        let scale = self.scale();
        let weigh = |&effect: &&'static EffectInfo| {
            let without = self.known_without(effect, known)?.clone();
            let gain = (without.joint.misfit.chi_square - self.joint.misfit.chi_square) / scale;
            let [before, after] = [&without.predictions, &self.predictions];
            let by_steps = residual::share_of_steps(case.records, &case.steps, before, after);
            let own = 1.0 - by_steps.min(1.0);
            Some(Earned { effect, evidence: gain * own * own - self.price(effect, scale), without })
        };
        self.added.iter().filter_map(weigh).collect()
    }

    /// Does every effect earn its place, as far as the model without it is known?
    pub(super) fn is_welcome(&self, case: &Case<'_>, known: &[Self]) -> bool {
        self.weakest(case, &self.weighed(case, known)).is_none()
    }

    /// Are the fitted records explained, but the held-out ones better without one of its effects?
    pub(super) fn is_contradicted(&self, known: &[Self]) -> bool {
        let mut without = self.added.iter().filter_map(|effect| self.known_without(effect, known));
        within_noise(&self.train.misfit) && without.any(|without| self.harm(without) >= HOLDOUT_CHANCE)
    }

    /// Drops the effects that do not earn their place beside the others, the weakest first, but those first that are
    /// weighed without another fit. What was fitted before is in `known`, and what is fitted now is added to it: the model
    /// without an effect anew from here, as it may have ended in a worse valley before.
    pub(super) fn pruned(mut self, case: &Case<'_>, known: &mut Vec<Self>) -> (Self, Vec<Earned>) {
        loop {
            let mut earned = self.weighed(case, known);
            if self.weakest(case, &earned).is_none() {
                let new: Vec<Self> = self.added.par_iter().map(|effect| self.without(case, effect)).collect();
                for new in new {
                    learn(known, new);
                }
                earned = self.weighed(case, known);
            }
            let Some(weakest) = self.weakest(case, &earned) else { return (self, earned) };
            self = if self.is_of_a_size(case, weakest.effect) {
                weakest.without.clone()
            } else {
                // The rest is just as good without it where this one has it.
                learn(known, self.without(case, weakest.effect)).clone()
            };
        }
    }

    /// The weakest of the effects that do not earn their place.
    fn weakest<'a>(&self, case: &Case<'_>, all: &'a [Earned]) -> Option<&'a Earned> {
        let noise_only = self.leaves_noise(case);
        let repeats = if noise_only {
            1.0
        } else {
            residual::correlation_time(case.holdout(), &self.predictions[case.fitted..])
        };
        // Where what is left is not noise an effect is no name, just a help for prediction: what is believed is bar enough.
        let bar = LazyCell::new(|| if noise_only { self.own_error(case) } else { SMALLEST_NOISE });
        let earns = |earned: &Earned| {
            earned.evidence > 0.0
                && self.is_of_a_size(case, earned.effect)
                && (self.harm(&earned.without) < HOLDOUT_CHANCE * repeats
                    || noise_only && !self.changes_the_held_out(case, &earned.without, &bar))
                && self.matters_against(case, &earned.without, noise_only, &bar)
                && (noise_only || self.gains_everywhere(case, &earned.without))
        };
        let idle = all.iter().filter(|earned| !earns(earned));
        idle.min_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }

    /// Does the interval of an effect's size, its shape as it is, leave out that it is not there? That of all records does,
    /// and that of the fitted ones, unless these leave open what all of them say.
    fn is_of_a_size(&self, case: &Case<'_>, effect: &EffectInfo) -> bool {
        let index = |wanted: &Parameter| self.ranges.iter().position(|range| range.parameter == *wanted);
        let Some(indices) = effect.parameters.iter().map(index).collect::<Option<Vec<usize>>>() else {
            return true;
        };
        let size = indices[0];
        let is_told_from = |fit: &Polished, value: f64| {
            let error = fit.standard_error_beside(&indices) * self.scale().sqrt();
            (fit.values[size] - value).abs() > SIZE_SIGMA * error
        };
        let none = case.rig.parameters.get(effect.parameters[0]);
        // The curvature at one end of a long valley tells nothing of the other end: what is left there does.
        let is_open = || {
            let there = fit::misfit(&self.rig_of_all(), &[], &[], case.train());
            let rest = (self.ranges.len() - 1) as f64;
            there.chi_square - self.train.misfit.chi_square <= (HOLDOUT_CHANCE + rest) * self.scale()
        };
        is_told_from(&self.joint, none)
            && (is_told_from(&self.train, none)
                || !is_told_from(&self.train, self.joint.values[size])
                || is_open())
    }

    /// By how much the held-out records' chi-square is above that of another model.
    fn harm(&self, without: &Self) -> f64 {
        let held_out = |model: &Self| model.joint.misfit.chi_square - model.train.misfit.chi_square;
        (held_out(self) - held_out(without)) / self.scale()
    }

    /// Are the held-out records predicted otherwise than by another model, by more than a bar? If not, they can neither
    /// speak for it nor against it.
    fn changes_the_held_out(&self, case: &Case<'_>, without: &Self, bar: &[f64; MEASURED]) -> bool {
        let [here, there] = [self, without].map(|model| &model.predictions[case.fitted..]);
        differ(case.holdout(), here, there, bar)
    }

    /// What its prediction of each channel may be off without anything being missing. What rings or slips and sticks can
    /// turn a hair of friction into another course: more than a model's own error is what that much of it changes which
    /// no record takes away.
    fn own_error(&self, case: &Case<'_>) -> [f64; MEASURED] {
        let mut error = case.model_error;
        if case.rig.form.drive == Drive::Valve {
            let mut rig = self.rig_of_all();
            rig.parameters.fdj += FRICTION_SIGMA * FRICTION_ERROR;
            let moved = fit::predict(&rig, case.records);
            for (one, other) in self.predictions.iter().zip(&moved) {
                for (channel, error) in error.iter_mut().enumerate() {
                    *error = error.max(fit::rms(fit::differences(one, other, channel)));
                }
            }
        }
        error
    }

    /// Does it change the prediction of a record by more than a bar, or make noise of what the other leaves? Or does it
    /// change it by more than is believed of a channel, and move a fault by more than its error and so far that this alone
    /// would?
    fn matters_against(
        &self,
        case: &Case<'_>,
        without: &Self,
        noise_only: bool,
        bar: &[f64; MEASURED],
    ) -> bool {
        let changes = |bar| differ(case.records, &self.predictions, &without.predictions, bar);
        let is_biased = |(index, range): (usize, &Range)| {
            let shift = without.train.values[index] - self.train.values[index];
            let error = self.train.standard_error(index) * self.scale().sqrt();
            let moved = || {
                let mut rig = self.rig_of_all();
                rig.parameters.set(range.parameter, self.joint.values[index] + shift);
                fit::predict(&rig, case.records)
            };
            shift.abs() > 3.0 * error && differ(case.records, &self.predictions, &moved(), bar)
        };
        changes(bar)
            || noise_only && !without.leaves_noise(case)
            || changes(&SMALLEST_NOISE) && case.rig.faults.iter().enumerate().any(is_biased)
    }

    /// Is its gain over another model more than the luck of a few places? What is left is not noise, so the spread of
    /// the gain over blocks of the records is what there is to go by.
    fn gains_everywhere(&self, case: &Case<'_>, without: &Self) -> bool {
        let gains = residual::gains(case.records, &without.predictions, &self.predictions);
        let count = gains.len().max(2) as f64;
        let mean = gains.iter().sum::<f64>() / count;
        let variance = gains.iter().map(|gain| (gain - mean).powi(2)).sum::<f64>() / (count - 1.0);
        mean > ROBUST_SIGMA * (variance / count).sqrt()
    }
}

/// Fall of chi-square by which a fit is no better than another one of the same model: rounding, and the last step that was not
/// worth it.
const SAME_FIT: f64 = 0.1;

/// Adds a model to those that are known, or puts it in place of one of the same effects that fits worse; what is known
/// of these effects then.
pub(super) fn learn(known: &mut Vec<Hypothesis>, new: Hypothesis) -> &Hypothesis {
    let index = known.iter().position(|known| known.same_effects(&new)).unwrap_or(known.len());
    match known.get_mut(index) {
        Some(known) if known.joint.misfit.chi_square <= new.joint.misfit.chi_square + SAME_FIT => {}
        Some(known) => *known = new,
        None => known.push(new),
    }
    &known[index]
}

/// Do two predictions of records differ in a channel by more than a bar, rms over one of the records?
fn differ(
    records: &[Prepared],
    one: &[Vec<Outputs<f64>>],
    other: &[Vec<Outputs<f64>>],
    bar: &[f64; MEASURED],
) -> bool {
    records.iter().zip(one).zip(other).any(|((record, one), other)| {
        (0..MEASURED).any(|channel| {
            let changes = fit::differences(one, other, channel);
            record.noise[channel].is_finite() && fit::rms(changes) > bar[channel]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::search::tests::model;
    use super::super::signature::tests::{record, with};
    use super::{Case, learn};
    use crate::rig::Rig;
    use eha_monitor::parameter::Parameter;

    #[test]
    fn a_fit_to_the_same_place_takes_nothing_from_what_is_known() {
        let rig = Rig::load("eha").unwrap();
        let records = [record(&with(&rig, Parameter::ConstantLoad, 500.0))];
        let case = Case::new(&rig, &records, 1);
        let model = model(&case, &rig, &[]);
        let lower_by = |fall: f64| {
            let mut lower = model.clone();
            lower.joint.misfit.chi_square -= fall;
            learn(&mut vec![model.clone()], lower).joint.misfit.chi_square
        };
        assert_eq!(lower_by(0.01), model.joint.misfit.chi_square);
        assert!(lower_by(1.0) < model.joint.misfit.chi_square);
    }
}
