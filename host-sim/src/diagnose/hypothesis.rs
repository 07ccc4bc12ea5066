//! A model that may be the right one: effects added to the rig, all that is free fitted.

use super::Case;
use super::candidate::{self, Prospect};
use super::place::{self, Place};
use super::residual;
use super::signature::Signatures;
use super::trade::Trade;
use crate::fit::{self, BETTER_VALLEY, Estimate, Fit, Polished, Prepared, TOLD_APART, Valley};
use crate::rig::{Range, Rig};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::within_noise;
use eha_monitor::fit::problem::Misfit;
use eha_monitor::model::state::Outputs;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::iter;
use std::sync::OnceLock;

/// Share of the misfit beyond noise that effects must take away to be named although something else is left.
const NAMING_SHARE: f64 = 0.99;

/// What a model is made of, and how it fits.
#[derive(Clone)]
pub(super) struct Hypothesis {
    /// The rig, with the values that fit the fitted records.
    pub(super) rig: Rig,
    pub(super) ranges: Vec<Range>,
    /// Fit of the fitted records.
    pub(super) train: Polished,
    /// Fit of all records: what the held-out records add to its chi-square is their misfit, the uncertainty of the
    /// parameters allowed for.
    pub(super) joint: Polished,
    /// What the joint fit predicts, for every record.
    pub(super) predictions: Vec<Vec<Outputs<f64>>>,
    /// Effects that were added.
    pub(super) added: Vec<&'static EffectInfo>,
    /// What the linear model around it says of every other effect, once it was asked.
    prospects: OnceLock<Vec<Prospect>>,
    /// How far the fitted records leave its faults open, once that was asked.
    valley: OnceLock<Valley>,
    /// What its faults may trade with, once that was asked.
    pub(super) trades: OnceLock<Vec<Trade>>,
}

impl Hypothesis {
    /// The model with the declared faults alone, as it was fitted to the records of the case or to longer ones.
    pub(super) fn root(case: &Case<'_>, fit: &Fit, ranges: Vec<Range>) -> Self {
        Self::validated(case, fit.applied(case.rig), ranges, fit.polished(), Vec::new())
    }

    /// Fits the held-out records as well. Where that leads to a valley that the fitted records alone like better than
    /// theirs, they had been in a wrong one.
    pub(super) fn validated(
        case: &Case<'_>,
        mut rig: Rig,
        mut ranges: Vec<Range>,
        mut train: Polished,
        added: Vec<&'static EffectInfo>,
    ) -> Self {
        let mut joint = train.clone();
        if !case.holdout().is_empty()
            && let Some((wide, all)) = candidate::fitted(&rig, ranges.clone(), &train.values, case.records)
        {
            // What all records ask for may be outside the ranges that the fitted ones need.
            (ranges, joint) = (wide, all);
            let there = fit::misfit(&rig, &ranges, &joint.values, case.train());
            if there.chi_square < train.misfit.chi_square - BETTER_VALLEY
                && let Some(better) = fit::polish(&rig, &ranges, &joint.values, case.train())
            {
                rig = better.applied(&rig, &ranges);
                train = better;
            }
        }
        Self::of(case, rig, ranges, [train, joint], added)
    }

    /// A model with its fits of the fitted records and of all.
    pub(super) fn of(
        case: &Case<'_>,
        rig: Rig,
        ranges: Vec<Range>,
        [train, joint]: [Polished; 2],
        added: Vec<&'static EffectInfo>,
    ) -> Self {
        let predictions = fit::predict(&joint.applied(&rig, &ranges), case.records);
        Self {
            rig,
            ranges,
            train,
            joint,
            predictions,
            added,
            prospects: OnceLock::new(),
            valley: OnceLock::new(),
            trades: OnceLock::new(),
        }
    }

    /// This model fitted to the records of another case, of which its own are a part or which are a part of its own.
    pub(super) fn refitted(&self, case: &Case<'_>) -> Self {
        let rig = self.rig.reading_as(case.rig);
        let shown = |effect: &&EffectInfo| place::shown_by(effect, &rig, &self.ranges, case.train());
        let here = Place { ranges: self.ranges.clone(), values: self.train.values.clone() };
        let starts = iter::once(here).chain(self.added.iter().flat_map(shown)).collect();
        self.refitted_from(starts, case)
    }

    /// This model with the values that it has, to the records of another case.
    pub(super) fn taken_to(&self, case: &Case<'_>) -> Self {
        let there = |fit: &Polished, records| {
            let misfit = fit::misfit(&self.rig, &self.ranges, &fit.values, records);
            Polished { misfit, ..fit.clone() }
        };
        let fits = [there(&self.train, case.train()), there(&self.joint, case.records)];
        Self::of(case, self.rig.clone(), self.ranges.clone(), fits, self.added.clone())
    }

    /// The same fitted to the records of a case that differ little from its own.
    pub(super) fn moved_to(&self, case: &Case<'_>) -> Self {
        self.moved_from(self.train.values.clone(), case)
    }

    /// The same from values near its own.
    pub(super) fn moved_from(&self, values: Vec<f64>, case: &Case<'_>) -> Self {
        self.refitted_from(vec![Place { ranges: self.ranges.clone(), values }], case)
    }

    /// The best that leads from some places to fits of the records of a case.
    fn refitted_from(&self, starts: Vec<Place>, case: &Case<'_>) -> Self {
        let rig = self.rig.reading_as(case.rig);
        let (ranges, train) = starts
            .into_par_iter()
            .filter_map(|start| candidate::fitted(&rig, start.ranges, &start.values, case.train()))
            .min_by(|(_, a), (_, b)| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))
            .unwrap_or_else(|| (self.ranges.clone(), self.train.clone()));
        let rig = train.applied(&rig, &ranges);
        Self::validated(case, rig, ranges, train, self.added.clone())
    }

    /// Mean square, in units of the noise, of what the model leaves; at least 1.
    pub(super) fn scale(&self) -> f64 {
        self.joint.misfit.mean_square().max(1.0)
    }

    /// Share of another model's misfit beyond noise that this one takes away, of the fitted records and of all: the
    /// smaller one. Records that the other model leaves noise on do not count.
    pub(super) fn share_of(&self, other: &Self) -> f64 {
        self.share_of_fitted(other).min(share(&self.joint.misfit, &other.joint.misfit))
    }

    /// The same of the fitted records alone.
    pub(super) fn share_of_fitted(&self, other: &Self) -> f64 {
        share(&self.train.misfit, &other.train.misfit)
    }

    /// Chi-square of all records in units of `scale`, with a price on every added parameter.
    pub(super) fn cost(&self, scale: f64) -> f64 {
        self.joint.misfit.chi_square / scale + self.price_of_added(scale)
    }

    /// The same of the fitted records.
    pub(super) fn cost_of_fitted(&self, scale: f64) -> f64 {
        self.train.misfit.chi_square / scale + self.price_of_added(scale)
    }

    fn price_of_added(&self, scale: f64) -> f64 {
        self.added.iter().map(|effect| self.price(effect, scale)).sum()
    }

    /// Do all records speak for this model against another one of as many parameters, at the odds that tell effects
    /// apart?
    pub(super) fn is_likelier(&self, other: &Self) -> bool {
        other.joint.misfit.chi_square - self.joint.misfit.chi_square > TOLD_APART * other.scale()
    }

    /// What an effect must gain to be believed, in units of `scale`, the mean square that is left: for each of its parameters
    /// the logarithm of the number of samples over that scale, and the odds of having tried the whole catalogue.
    pub(super) fn price(&self, effect: &EffectInfo, scale: f64) -> f64 {
        price(effect.parameters.len(), f64::from(self.joint.misfit.count) / scale, EFFECTS.len())
    }

    /// What is free where noise is what is left, as all records have it.
    pub(super) fn estimates(&self, case: &Case<'_>) -> Vec<Estimate> {
        self.estimates_at(case, &self.likeliest(case))
    }

    /// The most likely fit of all records, where it leaves noise.
    pub(super) fn likeliest(&self, case: &Case<'_>) -> Polished {
        let found = fit::most_likely(&self.rig_of_all(), &self.ranges, &self.joint, case.records);
        found.unwrap_or_else(|| self.joint.clone())
    }

    /// What is free, given that fit.
    pub(super) fn estimates_at(&self, case: &Case<'_>, likeliest: &Polished) -> Vec<Estimate> {
        let Self { ranges, joint, .. } = self;
        let rig = self.rig_of_all();
        let errors = fit::standard_errors(&rig, ranges, likeliest, case.records);
        let mut estimates = self.with_errors(case, likeliest, case.records, errors);
        let faults = case.rig.faults.len();
        Valley::around(&rig, ranges, joint, case.records, faults).widen(&mut estimates[..faults]);
        estimates
    }

    /// What is free where more than noise is left, as the fitted records have it, with errors for white noise that is
    /// `inflation` times as strong.
    pub(super) fn inflated_estimates(&self, case: &Case<'_>, inflation: f64) -> Vec<Estimate> {
        let Self { ranges, train, .. } = self;
        let errors = (0..ranges.len()).map(|index| train.standard_error(index) * inflation.sqrt()).collect();
        self.with_errors(case, train, case.train(), errors)
    }

    /// The values of a fit of some records with their standard errors, these wider where times of jumps were fitted as well.
    fn with_errors(
        &self,
        case: &Case<'_>,
        fit: &Polished,
        records: &[Prepared],
        errors: Vec<f64>,
    ) -> Vec<Estimate> {
        let rig = fit.applied(&self.rig, &self.ranges);
        let cost = case.timed.and_then(|timed| timed.jumps.cost(&rig, &self.ranges, fit, records));
        let widening = cost.map_or_else(|| vec![1.0; errors.len()], |cost| cost.widening);
        let values = self.ranges.iter().zip(&fit.values).zip(iter::zip(errors, widening));
        let mut estimates: Vec<Estimate> = values
            .map(|((range, &value), (error, wider))| Estimate::new(range, value, wider * error))
            .collect();
        fit::widen_by_calibration(&rig, &self.ranges, &mut estimates, records);
        estimates
    }

    /// The effect that was added last.
    pub(super) fn newest(&self) -> Option<&'static EffectInfo> {
        self.added.last().copied()
    }

    /// The same with its effects in the other order.
    pub(super) fn reversed(mut self) -> Self {
        self.added.reverse();
        self
    }

    pub(super) fn same_effects(&self, other: &Self) -> bool {
        self.is_of(&other.added)
    }

    /// Are these all its effects?
    pub(super) fn is_of(&self, effects: &[&EffectInfo]) -> bool {
        self.added.len() == effects.len() && effects.iter().all(|effect| self.has(effect))
    }

    /// How far the fitted records leave its faults open; they are those that the model was made with, and it leaves noise
    /// of them.
    pub(super) fn valley(&self, case: &Case<'_>) -> &Valley {
        self.valley.get_or_init(|| {
            let faults = case.rig.faults.len();
            Valley::around(&self.rig, &self.ranges, &self.train, case.train(), faults)
        })
    }

    /// The same at the bottom of its valley, where that leaves no more of all records, or far less of the fitted ones.
    pub(super) fn settled(self, case: &Case<'_>) -> Self {
        let bottom = self.valley(case).bottom.clone();
        self.at_lower(case, bottom).unwrap_or(self)
    }

    /// The same with a lower fit of the fitted records, where that leaves no more of all records, or far less of the fitted
    /// ones.
    pub(super) fn at_lower(&self, case: &Case<'_>, train: Polished) -> Option<Self> {
        let gain = self.train.misfit.chi_square - train.misfit.chi_square;
        if gain < BETTER_VALLEY {
            return None;
        }
        let rig = train.applied(&self.rig, &self.ranges);
        let lower = Self::validated(case, rig, self.ranges.clone(), train, self.added.clone());
        let is_better = gain > TOLD_APART || lower.joint.misfit.chi_square <= self.joint.misfit.chi_square;
        is_better.then_some(lower)
    }

    /// Is what the joint fit leaves just noise, in every record?
    pub(super) fn leaves_noise(&self, case: &Case<'_>) -> bool {
        case.is_noise_left(&self.predictions)
    }

    /// What the linear model says of every effect that is not in the model yet; the fitted records are those that the
    /// model was made with.
    pub(super) fn prospects(&self, case: &Case<'_>) -> &[Prospect] {
        let applies = |effect: &&'static EffectInfo| candidate::applies(effect, &self.rig, &self.ranges);
        self.prospects.get().unwrap_or_else(|| {
            let signatures = Signatures::new(&self.rig, &self.ranges, case.train());
            let look = |effect| candidate::look(effect, &self.rig, &self.ranges, case.train(), &signatures);
            let seen = EFFECTS.par_iter().filter(applies).filter_map(look).collect();
            self.prospects.get_or_init(|| seen)
        })
    }

    /// Are its effects a name for what is there, not just a help for prediction? They leave noise, or take nearly all
    /// of the misfit beyond it that a rig without them leaves of the fitted records.
    pub(super) fn is_name(&self, case: &Case<'_>, without: &Rig) -> bool {
        let excess = |rig: &Rig| residual::excess(case.train(), &fit::predict(rig, case.train()));
        self.leaves_noise(case) || excess(&self.rig) < (1.0 - NAMING_SHARE) * excess(without)
    }

    /// Moves the model to the valley of a fit to all records, if that valley is the better one for all of them. The fitted
    /// records follow unless they clearly prefer their own valley.
    pub(super) fn or_in_valley_of_all(self, case: &Case<'_>, all: &Fit) -> Self {
        if all.misfit.chi_square > self.joint.misfit.chi_square - BETTER_VALLEY {
            return self;
        }
        let joint = all.polished();
        let there = fit::polish(&self.rig, &self.ranges, &joint.values, case.train());
        let is_open = |there: &Polished| there.misfit.chi_square < self.train.misfit.chi_square + TOLD_APART;
        let train = there.filter(is_open).unwrap_or(self.train);
        Self::of(case, train.applied(&self.rig, &self.ranges), self.ranges, [train, joint], self.added)
    }

    /// Are the fitted records explained, but not the held-out ones?
    pub(super) fn is_in_doubt(&self) -> bool {
        let (train, joint) = (&self.train.misfit, &self.joint.misfit);
        let held_out =
            Misfit { chi_square: joint.chi_square - train.chi_square, count: joint.count - train.count };
        held_out.count > 0 && within_noise(train) && !within_noise(&held_out)
    }

    /// The rig with the values that fit all records.
    pub(super) fn rig_of_all(&self) -> Rig {
        self.joint.applied(&self.rig, &self.ranges)
    }

    /// The model with the values that the fitted records have, for all of them.
    pub(super) fn as_fitted_have_it(&self) -> Self {
        Self { joint: self.train.clone(), ..self.clone() }
    }

    /// The model with the values that all records have.
    pub(super) fn as_all_have_it(&self) -> Self {
        Self {
            rig: self.rig_of_all(),
            train: self.joint.clone(),
            prospects: OnceLock::new(),
            valley: OnceLock::new(),
            trades: OnceLock::new(),
            ..self.clone()
        }
    }

    /// Its effects and one more.
    pub(super) fn and(&self, effect: &'static EffectInfo) -> Vec<&'static EffectInfo> {
        self.added.iter().copied().chain([effect]).collect()
    }

    /// This model with its effects in such an order that the last one is in the place of one of another model, where all
    /// others are the same.
    pub(super) fn in_place_of(&self, effect: &EffectInfo, of: &Self) -> Option<Self> {
        let (kept, new): (Vec<_>, Vec<_>) = self.added.iter().copied().partition(|known| of.has(known));
        let is_it = self.added.len() == of.added.len() && new.len() == 1 && !self.has(effect);
        is_it.then(|| Self { added: [kept, new].concat(), ..self.clone() })
    }

    /// This model without an effect, if it is among those that were fitted before.
    pub(super) fn known_without<'a>(&self, effect: &EffectInfo, known: &'a [Self]) -> Option<&'a Self> {
        let is_it = |known: &&Self| {
            known.added.len() + 1 == self.added.len()
                && known.added.iter().all(|one| one.name != effect.name && self.has(one))
        };
        known.iter().find(is_it)
    }

    /// Do the fitted records say anything of the size of an effect?
    pub(super) fn is_told(&self, effect: &EffectInfo) -> bool {
        let size = self.ranges.iter().position(|range| range.parameter == effect.parameters[0]);
        size.is_some_and(|size| self.train.standard_error(size).is_finite())
    }

    /// Is an effect part of the model?
    pub(super) fn has(&self, effect: &EffectInfo) -> bool {
        self.added.iter().any(|added| added.name == effect.name)
    }

    /// This model without an effect, fitted.
    pub(super) fn without(&self, case: &Case<'_>, effect: &EffectInfo) -> Self {
        let mut added = self.added.clone();
        added.retain(|known| known.name != effect.name);
        let mut rig = self.rig.clone();
        if !case.rig.effects.contains(&effect) {
            rig.effects.retain(|known| known.name != effect.name);
        }
        for &parameter in effect.parameters {
            rig.parameters.set(parameter, case.rig.parameters.get(parameter));
        }
        let mut ranges = self.ranges.clone();
        ranges.retain(|range| !effect.parameters.contains(&range.parameter));
        let start = Place::of(&rig, &ranges);
        let (ranges, train) = candidate::fitted(&rig, start.ranges, &start.values, case.train())
            .unwrap_or_else(|| (ranges, self.train.clone()));
        let rig = train.applied(&rig, &ranges);
        Self::validated(case, rig, ranges, train, added).in_valley_of(case, self)
    }

    /// This model where the fit to all records of one with more in it shows a better valley of them.
    fn in_valley_of(self, case: &Case<'_>, larger: &Self) -> Self {
        let there = Place::of(&larger.rig_of_all(), &self.ranges);
        match fit::polish(&self.rig, &self.ranges, &there.values, case.records) {
            Some(joint) if joint.misfit.chi_square < self.joint.misfit.chi_square - BETTER_VALLEY => {
                let Self { rig, ranges, train, added, .. } = self;
                Self::of(case, rig, ranges, [train, joint], added)
            }
            _ => self,
        }
    }
}

/// What some parameters must gain to be believed: for each the logarithm of the number of samples, and the odds of having tried
/// so many others in their place.
pub(super) fn price(parameters: usize, samples: f64, tried: usize) -> f64 {
    parameters as f64 * samples.ln().max(1.0) + 2.0 * (tried as f64).ln()
}

/// Which of two leaves less of all records.
pub(super) fn lower(a: &Hypothesis, b: &Hypothesis) -> Ordering {
    a.joint.misfit.chi_square.total_cmp(&b.joint.misfit.chi_square)
}

/// Share of a misfit beyond noise that is not left in another one; all of it where noise is left in the first.
fn share(own: &Misfit<f64>, other: &Misfit<f64>) -> f64 {
    beyond_noise(other).map_or(1.0, |beyond| (other.chi_square - own.chi_square) / beyond)
}

/// Chi-square beyond what noise makes of it; none where noise may be all there is.
pub(super) fn beyond_noise(misfit: &Misfit<f64>) -> Option<f64> {
    (!within_noise(misfit)).then(|| misfit.chi_square - f64::from(misfit.count))
}
