//! A search in the first moments of the records, followed to their end.
//!
//! What rings, or sticks and slips, has as many valleys as it has turns, each narrower than the one before: over a whole
//! record no search meets the right one, and no slope leads there. In the first moments there are few turns, and the
//! valleys are wide. What explains these is followed as they grow, each fit starting where the one before ended.

use super::Case;
use super::candidate::{self, Candidate};
use super::hypothesis::Hypothesis;
use super::place;
use crate::fit::{self, FitSettings, Prepared};
use crate::interrupt;
use crate::rig::Range;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::within_noise;
use rayon::prelude::*;
use std::iter;

/// The first moments, s, and the factor by which they grow.
const FIRST_S: f64 = 0.1;
const GROWTH: f64 = 1.15;
/// How many of them, the first that ask for something and those after it, are searched before an effect is given up.
const TRIES: usize = 2;
/// Mean square, in units of the noise, of what an effect leaves of them from which on it does not explain them.
const BEYOND_NOISE: f64 = 2.0;

impl Hypothesis {
    /// The hypotheses with one more effect that explain the first moments of the fitted records which this one does not
    /// explain. What does not explain all later ones is then as good as it can be from where it last did.
    pub(super) fn followed(&self, case: &Case<'_>, settings: &FitSettings) -> Vec<Self> {
        let all = moments(case.train());
        let is_explained = |records: &Vec<Prepared>| {
            within_noise(&fit::fit(&self.rig, &self.ranges, records, settings, |_| {}).misfit)
        };
        let open: Vec<Vec<Prepared>> = all.skip_while(is_explained).collect();
        let applied = |effect: &&'static EffectInfo| candidate::applies(effect, &self.rig, &self.ranges);
        let applied: Vec<_> = EFFECTS.iter().filter(applied).collect();
        case.progress.expect(applied.len());
        let follow = |effect| case.told(self.follow(effect, &open, case.train(), settings));
        let found = applied.into_par_iter().filter_map(follow).collect();
        self.with(case, found)
    }

    /// An effect fitted from moment to moment, and to the whole; none where it explains none of the first.
    fn follow(
        &self,
        effect: &'static EffectInfo,
        moments: &[Vec<Prepared>],
        whole: &[Prepared],
        settings: &FitSettings,
    ) -> Option<Candidate> {
        let searched = |records: &Vec<Prepared>| {
            let within = |span: Vec<Range>| {
                let ranges = [&self.ranges[..], &span].concat();
                let fit = fit::fit(&self.rig, &ranges, records, settings, |_| {}).polished();
                Candidate { effect, ranges, fit }
            };
            let spans = place::spans_of_moments(effect, &self.rig, records).into_par_iter();
            spans.filter(|_| !interrupt::requested()).map(within).min_by(candidate::lower)
        };
        let mut moments = moments.iter();
        let explains = |found: &Candidate| within_noise(&found.fit.misfit);
        let mut here = moments.by_ref().take(TRIES).filter_map(searched).find(explains)?;
        let fitted = |here: &Candidate, records: &[Prepared]| {
            let (ranges, fit) = candidate::fitted(&self.rig, here.ranges.clone(), &here.fit.values, records)?;
            Some(Candidate { effect, ranges, fit })
        };
        for records in moments {
            let next = fitted(&here, records)?;
            if next.fit.misfit.mean_square() > BEYOND_NOISE || interrupt::requested() {
                break;
            }
            here = next;
        }
        fitted(&here, whole)
    }
}

/// The beginnings of records, ever longer ones, the last of them shorter than the longest record.
fn moments(records: &[Prepared]) -> impl Iterator<Item = Vec<Prepared>> {
    let longest = records.iter().map(|record| record.len() as f64 * record.sample_period).fold(0.0, f64::max);
    let lengths = iter::successors(Some(FIRST_S), |&length| Some(length * GROWTH));
    lengths.take_while(move |&length| length < longest).map(|length| {
        records.iter().map(|record| record.begin((length / record.sample_period) as usize)).collect()
    })
}
