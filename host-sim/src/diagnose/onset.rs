//! A search in the first moments of the records, followed to their end.
//!
//! What rings, or sticks and slips, has as many valleys as it has turns, each narrower than the one before: over a whole
//! record no search meets the right one, and no slope leads there. In the first moments there are few turns, and the
//! valleys are wide. What explains these is followed as they grow, each fit starting where the one before ended.

use super::Case;
use super::candidate::{self, Candidate};
use super::hypothesis::Hypothesis;
use super::place::{self, Place};
use crate::fit::{self, FitSettings, Prepared};
use crate::interrupt;
use crate::rig::Range;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::within_noise;
use rayon::prelude::*;
use std::iter;

/// The first moments, s, and the factor by which they grow.
const FIRST_S: f64 = 0.1;
/// Fewest samples of them: those that 100 Hz gives. Records that are sampled more slowly have later first moments.
const FEWEST_SAMPLES: f64 = 10.0;
const GROWTH: f64 = 1.15;
/// By how many such factors at once they grow as long as that leaves noise.
const STRIDE: usize = 4;
/// How many of them, the first that ask for something and those after it, are searched before an effect is given up.
const TRIES: usize = 2;
/// Every span of an effect is searched with such a part of the evaluations at first, and such a part of them, the best, with
/// all.
const SIEVE: u32 = 4;
/// Mean square, in units of the noise, of what an effect leaves of them from which on it does not explain them.
const BEYOND_NOISE: f64 = 2.0;

impl Hypothesis {
    /// The hypotheses with one more effect that explain the first moments of the fitted records which this one does not
    /// explain. What does not explain all later ones is then as good as it can be from where it last did.
    pub(super) fn followed(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Self> {
        self.with(case, self.effects_followed(case, settings))
    }

    /// The effects of these; all that is free is fitted with each.
    fn effects_followed(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Candidate> {
        let all = moments(case.train());
        let is_explained = |records: &Vec<Prepared>| {
            within_noise(&fit::fit(&self.rig, &self.ranges, records, settings, |_| {}).misfit)
        };
        let open: Vec<Vec<Prepared>> = all.skip_while(is_explained).collect();
        let applied = |effect: &&'static EffectInfo| candidate::applies(effect, &self.rig, &self.ranges);
        let applied: Vec<_> = EFFECTS.iter().filter(applied).collect();
        case.progress.expect(applied.len());
        let follow = |effect| case.told(self.follow(effect, &open, case.train(), settings));
        applied.into_par_iter().filter_map(follow).collect()
    }

    /// The same for the sake of a class: none where the faults cannot be far off to make up for an effect. Without effects
    /// they were searched for; where laws are not affine, this would take minutes.
    pub(super) fn effects_made_up_for(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Candidate> {
        let may_be_far =
            !self.added.is_empty() && case.hides_friction() && fit::is_affine(&self.rig, &self.ranges);
        if may_be_far && !case.is_over() { self.effects_followed(case, settings) } else { Vec::new() }
    }

    /// An effect fitted from moment to moment, and to the whole; none where it explains none of the first.
    fn follow(
        &self,
        effect: &'static EffectInfo,
        moments: &[Vec<Prepared>],
        whole: &[Prepared],
        settings: &FitSettings,
    ) -> Option<Candidate> {
        let explains = |found: &Candidate| within_noise(&found.fit.misfit);
        let tried = moments.iter().take(TRIES).enumerate();
        let mut found = tried
            .filter_map(|(moment, records)| Some((moment, self.searched_in(records, effect, settings)?)));
        let (mut moment, mut here) = found.find(|(_, found)| explains(found))?;
        while moment + 1 < moments.len() && !interrupt::requested() {
            let at = |stride: usize| {
                let next = (moment + stride).min(moments.len() - 1);
                Some((next, here.clone().finished(&self.rig, &moments[next])?))
            };
            let is_near = |found: &Candidate| found.fit.misfit.mean_square() <= BEYOND_NOISE;
            let next = at(STRIDE)
                .filter(|(_, found)| explains(found))
                .or_else(|| at(1).filter(|(_, found)| is_near(found)));
            let Some(next) = next else { break };
            (moment, here) = next;
        }
        here.finished(&self.rig, whole)
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
            .filter(|_| !interrupt::requested())
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

/// Most evaluations of a search in some moments: those of a budget in the first ones, fewer in longer ones, so that it takes
/// no longer there.
fn searches_within(budget: u32, moments: &[Prepared]) -> u32 {
    (f64::from(budget) * (FIRST_S / longest(moments)).min(1.0)) as u32
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
        assert_eq!([100.0, 200.0, 1000.0].map(first), [10, 20, 100]);
    }
}
