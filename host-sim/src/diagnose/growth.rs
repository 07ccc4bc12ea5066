//! What a model grows into: with one more effect that its records ask for, or another in the place of one.

use super::Case;
use super::candidate::{self, Candidate, Prospect};
use super::hypothesis::{Hypothesis, beyond_noise};
use super::place::Place;
use super::residual;
use super::search::{BEAM, GROWING_SHARE};
use super::timing::Timing;
use super::weighing::Earned;
use crate::fit::{self, BETTER_VALLEY, FitSettings, Polished, Prepared, TOLD_APART};
use crate::rig::{Range, Rig};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::within_noise;
use rayon::prelude::*;
use std::iter;

/// Fall of chi-square that the linear model must foresee for an effect to be fitted: far below what is accepted.
const PROMISING: f64 = 4.0;
/// The linear model must predict at least this part of the wanted fall of chi-square.
const FORESEEN: f64 = 0.1;
/// Part of its price that the linear model must foresee for an effect to be fitted beside others that leave noise.
const HIDDEN: f64 = 0.5;
/// Most effects that are approached by rough fits for a hypothesis where not all are wanted, the most promising first; and as
/// many that are mixed up with a fault.
const MOST_APPROACHED: usize = 10;
/// Most of them that are fitted, to the fitted records and to all: more than look alike in the position alone, so that
/// the held-out records decide among these.
const MOST_FITTED: usize = 8;
/// Steps of a rough fit, and by how many it goes on where none leads to noise: where channels say far more than the position
/// does, the way to the bottom can be long and bent.
const FEW_STEPS: u32 = 3;
const MANY_STEPS: u32 = 12;
/// How often a model moves to a better valley.
const MOST_MOVES: usize = 3;
/// A candidate whose odds against the best one are these (twice the logarithm; 10^50 to 1) is not fitted to the
/// held-out records: they could not make up for it.
const HOPELESS: f64 = 230.0;

impl Hypothesis {
    /// Fits the effects that promise to lower chi-square, and those that are mixed up with a fault: the fault may be
    /// far from the truth in place of the effect, and the linear model there says nothing. The best first. `wanted` is
    /// the fall of chi-square that is of interest, at least that of the best: where the linear model foresees a small
    /// part of it only, or the approach reaches no more, the fit will not reach it. `others` are more values to start
    /// from.
    /// All are approached where that is wanted, and the fitted records ask for something.
    fn fit_promising(
        &self,
        case: &Case<'_>,
        wanted: f64,
        others: &[Vec<f64>],
        all_wanted: bool,
    ) -> Vec<Candidate> {
        let (promising, wanted) = self.worth_approaching(case, wanted, all_wanted);
        let mut near = self.approached(case, promising, others);
        let reached = |near: &Candidate| self.train.misfit.chi_square - near.fit.misfit.chi_square;
        let wanted = near.iter().map(reached).fold(wanted, f64::max);
        near.retain(|near| reached(near) > FORESEEN * wanted);
        near.sort_by(|a, b| reached(b).total_cmp(&reached(a)));
        near.truncate(MOST_FITTED);
        if !near.iter().any(Candidate::explains) {
            let resized = |near: Candidate| near.or_of_another_size(&self.rig, case.train(), FEW_STEPS);
            let rest = near.split_off(BEAM.min(near.len()));
            near = near.into_par_iter().map(resized).chain(rest).collect();
        }
        case.progress.expect(near.len());
        let mut candidates: Vec<Candidate> = near
            .into_par_iter()
            .filter_map(|near| case.told(near.finished(&self.rig, case.train())))
            .collect();
        candidates.sort_by(candidate::lower);
        candidates
    }

    /// The effects of which the linear model foresees enough, the most promising first, then those that are mixed up with a
    /// fault; and the fall of chi-square that is of interest then.
    fn worth_approaching(&self, case: &Case<'_>, wanted: f64, all_wanted: bool) -> (Vec<&Prospect>, f64) {
        let gain = |prospect: &Prospect| self.train.misfit.chi_square - prospect.foreseen.misfit.chi_square;
        let (mut asked, mut promising): (Vec<&Prospect>, Vec<&Prospect>) =
            self.prospects(case).iter().partition(|prospect| self.confuses(case, prospect));
        let wanted = promising.iter().copied().map(gain).fold(wanted, f64::max);
        let is_noise = within_noise(&self.train.misfit);
        let hides = is_noise && !self.added.is_empty();
        let least = |prospect: &Prospect| {
            if hides {
                HIDDEN * self.price(prospect.effect, 1.0)
            } else if all_wanted && !is_noise {
                // The faults may be far off to make up for an effect: the linear model there says nothing.
                f64::NEG_INFINITY
            } else {
                PROMISING.max(FORESEEN * wanted)
            }
        };
        promising.retain(|prospect| gain(prospect) > least(prospect));
        asked.retain(|prospect| !hides || gain(prospect) > least(prospect));
        for prospects in [&mut promising, &mut asked] {
            prospects.sort_by(|a, b| gain(b).total_cmp(&gain(a)));
            if !all_wanted {
                prospects.truncate(MOST_APPROACHED);
            }
        }
        promising.append(&mut asked);
        (promising, wanted)
    }

    /// Rough fits of some effects, which go on where none of them explains the fitted records.
    fn approached(&self, case: &Case<'_>, promising: Vec<&Prospect>, others: &[Vec<f64>]) -> Vec<Candidate> {
        let (rig, train) = (&self.rig, case.train());
        case.progress.expect(promising.len());
        let near: Vec<Candidate> = promising
            .into_par_iter()
            .filter_map(|prospect| case.told(prospect.approach(rig, train, others, FEW_STEPS)))
            .collect();
        if !near.iter().any(Candidate::explains) {
            case.progress.expect(near.len());
            let further = |near: Candidate| case.told(near.further(rig, train, MANY_STEPS));
            near.into_par_iter().filter_map(further).collect()
        } else if others.is_empty() {
            near
        } else {
            near.into_iter().map(|near| near.or_ringing(rig, train, FEW_STEPS)).collect()
        }
    }

    /// The effects that the fitted records may ask for. What is left after an effect is coloured: what takes less than
    /// a tenth of it is not worth a fit.
    pub(super) fn promising(&self, case: &Case<'_>, all_wanted: bool) -> Vec<Candidate> {
        let wanted = beyond_noise(&self.train.misfit).filter(|_| !self.added.is_empty());
        self.fit_promising(case, wanted.unwrap_or(0.0), &[], all_wanted)
    }

    /// Makes hypotheses of candidates.
    pub(super) fn with(&self, case: &Case<'_>, candidates: Vec<Candidate>) -> Vec<Self> {
        candidates
            .into_par_iter()
            .map(|candidate| {
                let effect = candidate.effect;
                let new = self.joined(case, candidate);
                let other = if new.is_in_doubt() { self.elsewhere(case, effect) } else { None };
                let better = |other: &Self| other.joint.misfit.chi_square < new.joint.misfit.chi_square;
                other.filter(better).unwrap_or(new)
            })
            .collect()
    }

    /// The model with a candidate in it.
    pub(super) fn joined(&self, case: &Case<'_>, candidate: Candidate) -> Self {
        let added = self.and(candidate.effect);
        Self::validated(case, candidate.applied(&self.rig), candidate.ranges, candidate.fit, added)
    }

    /// The model with an effect in the valley that all records show best.
    fn elsewhere(&self, case: &Case<'_>, effect: &'static EffectInfo) -> Option<Self> {
        let all = candidate::found(effect, &self.rig, &self.ranges, case.records, FEW_STEPS)?;
        let (ranges, fit) = candidate::fitted(&self.rig, all.ranges, &all.fit.values, case.train())?;
        Some(self.joined(case, Candidate { effect, ranges, fit }))
    }

    /// The model with one of its effects looked for anew beside the others.
    pub(super) fn again(&self, case: &Case<'_>, effect: &'static EffectInfo) -> Option<Self> {
        let without = self.without(case, effect);
        let found = candidate::found(effect, &without.rig, &without.ranges, case.train(), MANY_STEPS)?;
        Some(without.joined(case, found))
    }

    /// The model with one more effect that all records ask for, where the fitted ones alone ask for nothing more.
    fn asked_by_all(&self, case: &Case<'_>) -> Vec<Self> {
        let whole = Case { fitted: case.records.len(), ..*case };
        let of_all = self.as_all_have_it();
        let scale = self.scale();
        let is_asked_for = |candidate: &Candidate| {
            let gain = (self.joint.misfit.chi_square - candidate.fit.misfit.chi_square) / scale;
            gain > self.price(candidate.effect, scale)
        };
        let asked: Vec<Candidate> =
            of_all.promising(&whole, self.added.is_empty()).into_iter().filter(is_asked_for).collect();
        self.with_of_all(case, asked)
    }

    /// Makes hypotheses of candidates that were fitted to all records.
    fn with_of_all(&self, case: &Case<'_>, candidates: Vec<Candidate>) -> Vec<Self> {
        candidates
            .into_par_iter()
            .filter_map(|Candidate { effect, ranges, fit: joint }| {
                let (ranges, fit) = candidate::fitted(&self.rig, ranges, &joint.values, case.train())?;
                let new = Candidate { effect, ranges, fit };
                let rig = new.applied(&self.rig);
                Some(Self::of(case, rig, new.ranges, [new.fit, joint], self.and(effect)))
            })
            .collect()
    }

    /// This model in a better valley, where the fits of more effects show it one.
    fn moved(&self, case: &Case<'_>, candidates: &[Candidate]) -> Option<Self> {
        let shown = candidates.iter().map(|candidate| {
            let values = &candidate.fit.values[..self.ranges.len()];
            (values, fit::misfit(&self.rig, &self.ranges, values, case.train()).chi_square)
        });
        let (values, _) = shown.min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let train = fit::polish(&self.rig, &self.ranges, values, case.train())?;
        self.at_lower(case, train)
    }

    /// The hypotheses with one more effect that the fitted records ask for. Where the fits of these show a better
    /// valley of the model without them, it moves there, and looks again from there if that takes much away. Where the
    /// fitted records are explained and the held-out ones speak against that, all of them are asked; `known` is what was
    /// fitted before. Effects of which the linear model foresees little are tried as well where all are wanted.
    pub(super) fn grow(&mut self, case: &Case<'_>, known: &[Self], all_wanted: bool) -> Vec<Self> {
        if self.is_in_doubt() || self.is_contradicted(known) {
            let asked = self.asked_by_all(case);
            if !asked.is_empty() {
                return asked;
            }
        }
        let mut candidates = self.promising(case, all_wanted);
        for _ in 0..MOST_MOVES {
            if case.is_over() {
                break;
            }
            let Some(moved) = self.moved(case, &candidates) else { break };
            let is_far = moved.share_of_fitted(self) >= GROWING_SHARE;
            *self = moved;
            if !is_far {
                break;
            }
            candidates = self.promising(case, all_wanted);
        }
        let Some(best) = candidates.first() else { return Vec::new() };
        let scale = best.fit.misfit.mean_square().max(1.0);
        // Samples of what is not noise say the same thing again and again: so many are one.
        let repeats = if within_noise(&best.fit.misfit) {
            1.0
        } else {
            let predictions = fit::predict(&best.applied(&self.rig), case.train());
            residual::correlation_time(case.train(), &predictions)
        };
        let best = best.fit.misfit.chi_square;
        let base = self.train.misfit.chi_square;
        let is_hopeful = |(place, candidate): &(usize, Candidate)| {
            let chi_square = candidate.fit.misfit.chi_square;
            let samples_of_one = if *place < BEAM { repeats } else { 1.0 };
            (base - chi_square) / scale > self.price(candidate.effect, scale)
                && (chi_square - best) / scale < HOPELESS * samples_of_one
        };
        let candidates = candidates.into_iter().enumerate().filter(is_hopeful);
        let candidates = candidates.map(|(_, candidate)| candidate).collect();
        self.with(case, candidates)
    }

    /// The hypotheses with one more effect that leave less than all that are known where everything free is searched for anew,
    /// the faults in all of their ranges: what no slope leads to from here. Where the fitted records are explained and the
    /// held-out ones speak against that, all of them are searched.
    pub(super) fn searched(&self, case: &Case<'_>, settings: &FitSettings, known: &[Self]) -> Vec<Self> {
        let least = |fit: fn(&Self) -> &Polished| {
            known.iter().map(|known| fit(known).misfit.chi_square).fold(f64::INFINITY, f64::min)
        };
        let applies = |effect: &&'static EffectInfo| candidate::applies(effect, &self.rig, &self.ranges);
        let effects: Vec<&EffectInfo> = EFFECTS.iter().filter(applies).collect();
        if self.is_in_doubt() {
            return self.searched_in_all(case, &effects, settings, least(|known| &known.joint));
        }
        let bound = least(|known| &known.train);
        self.with(case, self.searched_from_afar(case, &effects, case.train(), settings, bound))
    }

    /// The hypotheses with one of some effects that leave less of all records than a bound, these searched so.
    pub(super) fn searched_in_all(
        &self,
        case: &Case<'_>,
        effects: &[&'static EffectInfo],
        settings: &FitSettings,
        bound: f64,
    ) -> Vec<Self> {
        self.with_of_all(case, self.searched_from_afar(case, effects, case.records, settings, bound))
    }

    /// The best that a genetic search finds with each of some effects in records, where that is below a bound.
    fn searched_from_afar(
        &self,
        case: &Case<'_>,
        effects: &[&'static EffectInfo],
        records: &[Prepared],
        settings: &FitSettings,
        bound: f64,
    ) -> Vec<Candidate> {
        let search = |&effect: &&'static EffectInfo| {
            case.told(candidate::searched(effect, &self.rig, &self.ranges, records, settings, bound))
        };
        case.progress.expect(effects.len());
        let mut found: Vec<Candidate> = effects.par_iter().filter_map(search).collect();
        found.sort_by(candidate::lower);
        found.truncate(MOST_FITTED);
        found
    }

    /// The effects that could stand in for one that was added: with each in its place, the others kept, the records
    /// are explained as well. Beside others, the faults may have to go far for that, and no slope leads there: what
    /// explains the first moments is followed. Where the fitted records are explained without any, they do not tell what
    /// could; what was tried for the sake of all may.
    pub(super) fn stand_ins(
        &self,
        case: &Case<'_>,
        tried: &[Self],
        earned: &Earned,
        settings: &FitSettings,
    ) -> Vec<Self> {
        let (scale, is_explained) = (self.scale(), self.leaves_noise(case));
        let limit = self.cost_in_place_of(&self.train, earned);
        let without = &earned.without;
        let here = Place::of(&self.rig, &without.ranges);
        let wanted = without.train.misfit.chi_square - scale * limit;
        let mut others =
            without.fit_promising(case, wanted, std::slice::from_ref(&here.values), without.added.is_empty());
        if is_explained {
            others.extend(without.effects_made_up_for(case, settings));
        }
        let timing = Timing::new(self.rig.clone(), &self.ranges, case.train());
        let does_as_well = |other: &Candidate| {
            let chi_square = other.fit.misfit.chi_square;
            let is_another = other.effect.name != earned.effect.name
                || is_explained && chi_square < self.train.misfit.chi_square - BETTER_VALLEY;
            let above = chi_square / scale + self.price(other.effect, scale) - limit;
            let by_timing =
                || timing.makes_up_for(scale * above, &other.applied(&without.rig), &other.ranges);
            is_another && (above < 0.0 || is_explained && by_timing())
        };
        others.retain(does_as_well);
        let twins: Vec<Candidate> = iter::once((earned.effect, self.rig.clone()))
            .chain(others.iter().map(|other| (other.effect, other.applied(&without.rig))))
            .filter_map(|(effect, with)| without.twin_of(case, effect, &with))
            .filter(does_as_well)
            .collect();
        others.extend(twins);
        others.sort_by(|a, b| a.effect.name.cmp(b.effect.name).then_with(|| candidate::lower(a, b)));
        others.dedup_by_key(|other| other.effect.name);
        others.sort_by(candidate::lower);
        let mut others = without.with(case, others);
        for known in tried.iter().filter_map(|known| known.in_place_of(earned.effect, self)) {
            if !others.iter().any(|other| other.same_effects(&known)) {
                others.push(known);
            }
        }
        self.keep_stand_ins(case, earned, &mut others);
        others
    }

    /// Keeps those of some models, each with another effect in the place of one of this, that do as well.
    pub(super) fn keep_stand_ins(&self, case: &Case<'_>, earned: &Earned, others: &mut Vec<Self>) {
        let (scale, is_explained) = (self.scale(), self.leaves_noise(case));
        let [limit, joint_limit] = [&self.train, &self.joint].map(|fit| self.cost_in_place_of(fit, earned));
        let timing = Timing::new(self.rig.clone(), &self.ranges, case.train());
        let joint_timing = Timing::new(self.rig_of_all(), &self.ranges, case.records);
        others.retain(|other| {
            let price = other.newest().map_or(0.0, |effect| self.price(effect, scale));
            let above = other.train.misfit.chi_square / scale + price - limit;
            let joint_above = other.joint.misfit.chi_square / scale + price - joint_limit;
            let by_timing = || timing.makes_up_for(scale * above, &other.rig, &other.ranges);
            let by_joint_timing =
                || joint_timing.makes_up_for(scale * joint_above, &other.rig_of_all(), &other.ranges);
            (!other.same_effects(self) || other.is_likelier(self))
                && (!is_explained || other.leaves_noise(case))
                && (above < 0.0 || is_explained && by_timing())
                && (joint_above < 0.0 || is_explained && by_joint_timing())
        });
    }

    /// What another effect in the place of one that earned its own may cost at most, by a fit of this model, to do as well.
    fn cost_in_place_of(&self, fit: &Polished, earned: &Earned) -> f64 {
        let scale = self.scale();
        fit.misfit.chi_square / scale + self.price(earned.effect, scale) + TOLD_APART
    }

    /// What explains the first moments beside the rest of this model in the place of one of its effects, where that leaves
    /// noise.
    pub(super) fn followed_without(
        &self,
        case: &Case<'_>,
        effect: &EffectInfo,
        settings: &FitSettings,
    ) -> Vec<Self> {
        let without = self.without(case, effect);
        let mut found = without.with(case, without.effects_made_up_for(case, settings));
        found.retain(|new| new.leaves_noise(case));
        found
    }

    /// This model with the effect that cannot be told from another, in the place of that one in a rig.
    fn twin_of(&self, case: &Case<'_>, effect: &EffectInfo, with: &Rig) -> Option<Candidate> {
        let (twin, value) = effect.twin(&with.parameters, &self.rig.parameters)?;
        if !candidate::applies(twin, &self.rig, &self.ranges) {
            return None;
        }
        let range = Range::around(twin.parameters[0], value, twin.sizes[0]);
        let start = Place::of(with, &self.ranges).with(&Place { ranges: vec![range], values: vec![value] });
        let (ranges, fit) = candidate::fitted(&self.rig, start.ranges, &start.values, case.train())?;
        Some(Candidate { effect: twin, ranges, fit })
    }
}
