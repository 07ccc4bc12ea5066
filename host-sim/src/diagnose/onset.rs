//! A search in the first moments of the records, followed to their end.
//!
//! What rings, or sticks and slips, has as many valleys as it has turns, each narrower than the one before: over a whole
//! record no search meets the right one, and no slope leads there. In the first moments there are few turns, and the
//! valleys are wide. What explains these is followed as they grow, each fit starting where the one before ended.

use super::Case;
use super::candidate::{self, Candidate};
use super::hypothesis::Hypothesis;
use super::place::{self, Place};
use super::search::BEAM;
use crate::fit::{self, FitSettings, Prepared};
use crate::rig::Range;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::within_noise;
use rayon::prelude::*;
use std::cmp::Ordering;
use std::iter;

/// The first moments, s, and the factor by which they grow. What a ram that begins to move shows of ringing oil in its first
/// 30 ms has one wide valley, where 0.1 s have several that are a tenth as wide.
const FIRST_S: f64 = 0.02;
/// Fewest samples of them. Records that are sampled at less than 500 Hz have later first moments.
const FEWEST_SAMPLES: f64 = 10.0;
const GROWTH: f64 = 1.15;
/// Part of the records up to which moments are first ones: in longer ones there are no fewer valleys than in the whole.
const FIRST_PART: f64 = 0.5;
/// By how many such factors at once they grow as long as that leaves noise.
const STRIDE: usize = 4;
/// In how many of them an effect is searched before it is given up: the first that ask for something, then, if it explains
/// these, the first that it could not be followed to.
const TRIES: usize = 3;
/// How long a search in them may be for all evaluations of a budget, s.
const SEARCHED_S: f64 = 0.1;
/// Every span of an effect is searched with such a part of the evaluations at first, and such a part of them, the best, with
/// all.
const SIEVE: u32 = 4;
/// Mean square, in units of the noise, of what an effect leaves of them from which on it does not explain them.
const BEYOND_NOISE: f64 = 2.0;
/// Moments in turn over which the samples double: an effect that leaves more than noise of so many is given up, and one that
/// does not explain so many more than that in which it was found explains those by chance.
const DOUBLE: usize = 5;

/// An effect beside a model that is followed from moment to moment.
#[derive(Clone)]
struct Followed {
    /// Which moment it was found in, and which it has come to.
    found: usize,
    moment: usize,
    /// Its fit there.
    there: Candidate,
    /// The last moment that it explains, if it explains any, and its fit there.
    explained: Option<(usize, Candidate)>,
}

impl Followed {
    /// At the moment in which it is found.
    fn at(moment: usize, there: Candidate) -> Self {
        let explained = there.explains().then(|| (moment, there.clone()));
        Self { found: moment, moment, there, explained }
    }

    /// Fitted beside a model from each moment to the next, if it explains the first, as long as it explains these, or nearly.
    fn on(mut self, model: &Hypothesis, moments: &[Vec<Prepared>]) -> Self {
        while self.may_go_on() && self.moment + 1 < moments.len() {
            let after = |stride: usize| {
                let moment = (self.moment + stride).min(moments.len() - 1);
                Some(Self::at(moment, self.there.clone().finished(&model.rig, &moments[moment])?))
            };
            let is_near = |next: &Self| next.there.fit.misfit.mean_square() <= BEYOND_NOISE;
            let far = if self.there.explains() { after(STRIDE) } else { None };
            let next = far.filter(|next| next.explained.is_some()).or_else(|| after(1).filter(is_near));
            let Some(next) = next else { break };
            self = Self { found: self.found, explained: next.explained.or(self.explained), ..next };
        }
        self
    }

    /// Does it explain any moment, and has it not left more than noise for so long that chance would have evened out?
    fn may_go_on(&self) -> bool {
        self.last_explained().is_some_and(|last| self.moment < last + DOUBLE)
    }

    /// Does it explain twice the samples in which it was found, or all of some moments?
    fn is_no_chance(&self, moments: &[Vec<Prepared>]) -> bool {
        self.last_explained().is_some_and(|last| last >= (self.found + DOUBLE).min(moments.len() - 1))
    }

    /// The last moment that it explains, if it explains any.
    fn last_explained(&self) -> Option<usize> {
        self.explained.as_ref().map(|&(moment, _)| moment)
    }

    /// Which of two explains more moments, or leaves less of the last one.
    fn further(a: &Self, b: &Self) -> Ordering {
        b.last_explained().cmp(&a.last_explained()).then_with(|| candidate::lower(&a.there, &b.there))
    }
}

impl Hypothesis {
    /// The hypotheses with one more effect that explain the first moments of the fitted records which this one does not
    /// explain. What does not explain all later ones is then as good as it can be from where it last did. Where none explains
    /// the whole, and there is no other effect yet, those with two that do.
    pub(super) fn followed(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Self> {
        let moments = self.unexplained_moments(case, settings);
        let mut singles = self.each_followed(case, &moments, settings);
        let mut found = self.with(case, self.finished(case, &singles, &moments));
        if self.added.is_empty() && !found.iter().any(|new| within_noise(&new.train.misfit)) {
            singles.sort_by(Followed::further);
            singles.truncate(BEAM);
            found.par_extend(
                singles.into_par_iter().flat_map_iter(|single| self.pairs_of(case, single, &moments)),
            );
        }
        found
    }

    /// The effects that explain the first moments beside this model, for the sake of a class: none where the faults cannot be
    /// far off to make up for an effect. Without effects they were searched for; where laws are not affine, this would take
    /// minutes.
    pub(super) fn effects_made_up_for(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Candidate> {
        let may_be_far =
            !self.added.is_empty() && case.hides_friction() && fit::is_affine(&self.rig, &self.ranges);
        if !may_be_far || case.is_over() {
            return Vec::new();
        }
        let moments = self.unexplained_moments(case, settings);
        self.finished(case, &self.each_followed(case, &moments, settings), &moments)
    }

    /// The first moments of the fitted records that this model does not explain, all that is free fitted to them, and all
    /// later ones.
    fn unexplained_moments(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Vec<Prepared>> {
        let is_explained = |records: &Vec<Prepared>| {
            within_noise(&fit::fit(&self.rig, &self.ranges, records, settings, |_| {}).misfit)
        };
        moments(case.train()).skip_while(is_explained).collect()
    }

    /// Each effect that can act beside this model, from the first of some moments on.
    fn each_followed(
        &self,
        case: &Case<'_>,
        moments: &[Vec<Prepared>],
        settings: &FitSettings,
    ) -> Vec<Followed> {
        let applied = |effect: &&'static EffectInfo| candidate::applies(effect, &self.rig, &self.ranges);
        let applied: Vec<_> = EFFECTS.iter().filter(applied).collect();
        case.progress.expect(applied.len());
        let follow = |effect| {
            let followed = self.effect_followed(effect, moments, settings);
            let left = followed.as_ref().map(|followed| followed.there.fit.misfit.mean_square().sqrt());
            case.progress.fitted(left);
            followed
        };
        applied.into_par_iter().filter_map(follow).collect()
    }

    /// An effect beside this model, from the first of some moments on.
    fn effect_followed(
        &self,
        effect: &'static EffectInfo,
        moments: &[Vec<Prepared>],
        settings: &FitSettings,
    ) -> Option<Followed> {
        let mut best: Option<Followed> = None;
        let mut moment = 0;
        for _ in 0..TRIES {
            let Some(records) = moments.get(moment) else { break };
            let Some(found) = self.searched_in(records, effect, settings) else { break };
            let found = Followed::at(moment, found).on(self, moments);
            let last = found.last_explained();
            if best.is_none() || last.is_some() {
                best = Some(found);
            }
            // What does not explain some moments does not explain longer ones.
            let Some(last) = last else { break };
            moment = last + 1;
        }
        best
    }

    /// Those of some effects that explain some moments by no chance, fitted to the whole.
    fn finished(&self, case: &Case<'_>, followed: &[Followed], moments: &[Vec<Prepared>]) -> Vec<Candidate> {
        let explaining = followed.par_iter().filter(|followed| followed.is_no_chance(moments));
        explaining.filter_map(|followed| followed.there.clone().finished(&self.rig, case.train())).collect()
    }

    /// The hypotheses with an effect and one more that this asks for in the first of the moments that it does not explain.
    fn pairs_of(&self, case: &Case<'_>, single: Followed, moments: &[Vec<Prepared>]) -> Vec<Self> {
        let (moment, single) =
            single.explained.map_or((single.moment, single.there), |(moment, there)| (moment + 1, there));
        let is_short = |records: &&Vec<Prepared>| longest(records) < FIRST_PART * longest(case.train());
        let Some(records) = moments.get(moment).filter(is_short) else { return Vec::new() };
        let there = &Case { records, fitted: records.len(), timed: None, ..*case };
        let Some(single) = single.finished(&self.rig, records) else { return Vec::new() };
        let single = self.joined(there, single);
        let mut pairs: Vec<Followed> = single
            .promising(there, false)
            .into_par_iter()
            .filter(Candidate::explains)
            .map(|pair| Followed::at(moment, pair).on(&single, moments))
            .collect();
        pairs.sort_by(Followed::further);
        pairs.truncate(BEAM);
        let mut whole = single.finished(case, &pairs, moments);
        whole.retain(Candidate::explains);
        single.with(case, whole)
    }

    /// The best of an effect in some moments. It is searched for together with the faults, the effects that are there already
    /// as they are, and then fitted with all that is free.
    fn searched_in(
        &self,
        moments: &[Prepared],
        effect: &'static EffectInfo,
        settings: &FitSettings,
    ) -> Option<Candidate> {
        let (declared, others) = self.ranges.split_at(self.rig.declared().len());
        let budget = searches_within(settings.budget, moments);
        let searched = |ranges: Vec<Range>, budget: u32| {
            let settings = FitSettings { budget, ..*settings };
            let fit = fit::fit(&self.rig, &ranges, moments, &settings, |_| {}).polished();
            Candidate { effect, ranges, fit }
        };
        let mut rough: Vec<Candidate> = place::spans_of_moments(effect, &self.rig, moments)
            .into_par_iter()
            .map(|span| searched([declared, &span].concat(), budget / SIEVE))
            .collect();
        rough.sort_by(candidate::lower);
        let best = if rough.first().is_some_and(|best| within_noise(&best.fit.misfit)) {
            rough.swap_remove(0)
        } else {
            rough.truncate(rough.len().div_ceil(SIEVE as usize));
            let thorough = rough.into_par_iter().map(|rough| searched(rough.ranges, budget));
            thorough.min_by(candidate::lower)?
        };
        if others.is_empty() {
            // The search has been to the bottom already.
            return Some(best);
        }
        let (faults, size) = best.fit.values.split_at(declared.len());
        let all = [&self.ranges[..], &best.ranges[declared.len()..]].concat();
        let start = [faults, &Place::of(&self.rig, others).values, size].concat();
        let (ranges, fit) = candidate::fitted(&self.rig, all, &start, moments)?;
        Some(Candidate { effect, ranges, fit })
    }
}

/// Most evaluations of a search in some moments: those of a budget in short ones, fewer in longer ones, so that it takes
/// no longer there.
fn searches_within(budget: u32, moments: &[Prepared]) -> u32 {
    (f64::from(budget) * (SEARCHED_S / longest(moments)).min(1.0)) as u32
}

/// How long the longest of some records is, s.
fn longest(records: &[Prepared]) -> f64 {
    records.iter().map(Prepared::duration).fold(0.0, f64::max)
}

/// The beginnings of records, ever longer ones, the last of them shorter than the longest record.
fn moments(records: &[Prepared]) -> impl Iterator<Item = Vec<Prepared>> {
    let longest = longest(records);
    let fewest = |record: &Prepared| FEWEST_SAMPLES * record.sample_period;
    let first = records.iter().map(fewest).fold(FIRST_S, f64::max);
    let lengths = iter::successors(Some(first), |&length| Some(length * GROWTH));
    lengths.take_while(move |&length| length < longest).map(|length| {
        records.iter().map(|record| record.begin((length / record.sample_period) as usize)).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::{FEWEST_SAMPLES, moments};
    use crate::fit::{self, Prepared};
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;

    /// 20 s of a slow sine.
    fn sampled(rate: f64) -> [Prepared; 1] {
        let swing: Vec<f64> = (0..(20.0 * rate) as usize).map(|k| 1e-3 * (k as f64 / rate).sin()).collect();
        let channels = vec![(Channel::Command, swing.clone()), (Channel::UserPosition, swing)];
        let record = Record::new("slow", 1.0 / rate, 0.0, channels).unwrap();
        [fit::prepare(&Rig::load("eha").unwrap(), &record)]
    }

    #[test]
    fn first_moments_have_samples_however_slowly_they_are_taken() {
        let first = |rate: f64| moments(&sampled(rate)).next().unwrap()[0].len();
        assert!([5.0, 8.0, 40.0].map(first).iter().all(|&first| first >= FEWEST_SAMPLES as usize));
        // At the rates that there are, they last as long as ever.
        assert_eq!([500.0, 1000.0, 2000.0].map(first), [10, 20, 40]);
    }
}
