//! Where the fit of an effect starts, and how far around it looks.

use super::candidate::Candidate;
use super::ripple::{self, Ripple};
use super::signature::Signatures;
use crate::fit::{self, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::parameter::Parameter;
use nalgebra::DVector;
use rayon::prelude::*;

/// Half width of the search for an effect's parameter, in its sizes.
const REACH: f64 = 20.0;
/// Half width of the search for what would be small, in its sizes: a difference in the wide range would jump over an
/// effect that a channel shows far better than the position does.
const NEAR: f64 = 0.6;
/// Largest size at which an effect that is on one side of its absence is tried, in its sizes, and how many in a decade
/// below that: a valley of a play or a dead zone is a fifth as wide as its size, and one of many.
const LARGEST: f64 = 40.0;
const PER_DECADE: i32 = 10;
const DECADES: i32 = 5;
/// Sizes at which an effect of several parameters is tried where no signature leads to it, in its sizes: the first, and the
/// second where nothing is known of it.
const COARSE: [f64; 3] = [0.3, 1.0, 3.0];
/// Change of chi-square by a signature alone below which smaller sizes are not seen, and the part of chi-square that
/// the best amount of them could take away below which they are not worth it: another effect must come first.
const UNSEEN: f64 = 1.0;
const NEGLIGIBLE: f64 = 0.01;
/// Part of a signature, squared, that it may differ by from the one of the size before to be in proportion to it, and in
/// how many sizes in a row it is for all smaller ones to be.
const LINEAR: f64 = 1e-3;
const LINEAR_STEPS: usize = 3;
/// Most places at which the fit of an effect starts of those that were tried, the best first.
const MOST_PLACES: usize = 3;
/// Where an effect that can be on either side of its absence is looked for, and how far around, in its sizes.
const EITHER_SIDE: &[(f64, f64)] = &[(-2.0, REACH), (0.0, NEAR), (0.0, REACH), (2.0, REACH)];
/// Sizes in a decade at which ringing oil is tried, and over how many decades below its size: a valley is half a
/// hundredth as wide as the compressibility there. Larger ones ring slower, and their valleys are wide; smaller ones
/// are not seen.
const RINGING_PER_DECADE: i32 = 460;
const RINGING_DECADES: i32 = 2;
/// Half width of the search around such a size, as a part of it.
const RINGING_REACH: f64 = 0.1;
/// The largest size of it that is looked for in the first moments of records, in its sizes, and in how many spans of a decade,
/// over how many decades below that.
const LARGEST_RINGING: f64 = 10.0;
const RINGING_SPANS_PER_DECADE: i32 = 8;
const RINGING_SPAN_DECADES: i32 = 3;
/// What a mount is tried with: whether the load's inertia follows its base, and whether the loop sees it.
const MOUNTS: [[f64; 2]; 4] = [[1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]];
/// Half widths of the search for an effect where no slope leads to it, in its sizes.
const SPANS: &[f64] = &[REACH, 5.0, 1.0, 0.2];
/// Times at which a step load is tried, at least, and how far apart they are at most, s.
const STEP_TIMES: usize = 40;
const STEP_EVERY_S: f64 = 0.125;
/// Parts into which the distance between two of them is divided around the best ones, and how often.
const FINER: i32 = 5;
const FINER_ROUNDS: i32 = 3;

/// Where a fit starts.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// The free parameters.
    pub(super) ranges: Vec<Range>,
    /// Their values.
    pub(super) values: Vec<f64>,
}

impl Place {
    /// Some parameters where a rig has them.
    pub(super) fn of(rig: &Rig, ranges: &[Range]) -> Self {
        let values = ranges.iter().map(|range| rig.parameters.get(range.parameter)).collect();
        Self { ranges: ranges.to_vec(), values }
    }

    /// This place with other parameters behind its own.
    pub(super) fn with(&self, others: &Self) -> Self {
        Self {
            ranges: [&self.ranges[..], &others.ranges].concat(),
            values: [&self.values[..], &others.values].concat(),
        }
    }

    /// The same once what is in front of an effect's parameters has followed these by some rough steps, and the chi-square
    /// that this leaves.
    pub(super) fn followed(
        &self,
        effect: &EffectInfo,
        rig: &Rig,
        records: &[Prepared],
        steps: u32,
    ) -> Option<(f64, Self)> {
        let before = self.ranges.len() - effect.parameters.len();
        let there = rig.with_values(&self.ranges[before..], &self.values[before..]);
        let found = fit::approach(&there, &self.ranges[..before], &self.values[..before], records, steps)?;
        let values = [&found.values, &self.values[before..]].concat();
        Some((found.misfit.chi_square, Self { ranges: self.ranges.clone(), values }))
    }
}

/// Where an effect of a rig is looked for in records, whose signatures are those around the rig; `is_first`: no effect
/// is found yet.
pub(super) fn places(
    effect: &EffectInfo,
    rig: &Rig,
    records: &[Prepared],
    signatures: &Signatures<'_>,
    is_first: bool,
) -> Vec<Place> {
    let seeker = Seeker { effect, rig, signatures, is_first, others: &effect.sizes[1..] };
    match effect.parameters {
        [] => Vec::new(),
        [.., Parameter::LoadFollowsBase, Parameter::LoopSeesBase, Parameter::PlaySeesBase] => seeker.mounts(),
        [_, Parameter::StepLoadTime] => seeker.steps(records),
        [_, _, Parameter::CoggingPitch] => seeker.ripples(records),
        [first, ..] if rig.parameters.get(*first) > first.info().lower => seeker.either_side(),
        [..] => seeker.one_side(),
    }
}

/// Where ringing oil explains more than a rough fit of it does, everything else as the fit has it; none of another
/// effect. The phase of what rings tells its valleys apart, and no slope leads from one to the next.
pub(super) fn ringing(rough: &Candidate, rig: &Rig, records: &[Prepared]) -> Vec<Place> {
    let &[compliance @ Parameter::OilCompliance] = rough.effect.parameters else { return Vec::new() };
    let (Some((_, ranges)), Some((_, values))) = (rough.ranges.split_last(), rough.fit.values.split_last())
    else {
        return Vec::new();
    };
    let rest = Place { ranges: ranges.to_vec(), values: values.to_vec() };
    let place = |step: usize| {
        let size = rough.effect.sizes[0] * 10_f64.powf(-(step as f64) / f64::from(RINGING_PER_DECADE));
        let range = Range::around(compliance, size, RINGING_REACH * size);
        rest.with(&Place { ranges: vec![range], values: vec![size] })
    };
    let bound = rough.fit.misfit.chi_square;
    let cost = |place: Place| {
        let chi_square = fit::misfit_within(rig, &place.ranges, &place.values, records, bound).chi_square;
        if chi_square < bound { chi_square } else { f64::INFINITY }
    };
    let steps = (RINGING_PER_DECADE * RINGING_DECADES) as usize;
    let costs: Vec<f64> = (0..steps).into_par_iter().map(|step| cost(place(step))).collect();
    valleys(&costs, f64::INFINITY).into_iter().map(place).collect()
}

/// The ranges around an effect of a rig up to the largest sizes at which it is looked for.
pub(super) fn widest(effect: &EffectInfo, rig: &Rig) -> Vec<Range> {
    let around = |(&parameter, size): (&Parameter, f64)| {
        Range::around(parameter, rig.parameters.get(parameter), LARGEST * size)
    };
    effect.parameters.iter().zip(effect.sizes.iter().copied()).map(around).collect()
}

/// The ranges in which an effect of a rig is searched where no slope leads to it, the widest first.
pub(super) fn spans(effect: &EffectInfo, rig: &Rig, records: &[Prepared]) -> Vec<Vec<Range>> {
    let around = |index: usize, sizes: f64| {
        let parameter = effect.parameters[index];
        if parameter == Parameter::StepLoadTime {
            return step_times(records);
        }
        Range::around(parameter, rig.parameters.get(parameter), sizes * effect.sizes[index])
    };
    let span = |&first: &f64| {
        (0..effect.parameters.len())
            .map(|index| around(index, if index == 0 { first } else { REACH }))
            .collect()
    };
    SPANS.iter().map(span).collect()
}

/// The ranges in which an effect of a rig is searched in the first moments of records. What rings has valleys that are a
/// part of its size wide, whatever that is.
pub(super) fn spans_of_moments(effect: &EffectInfo, rig: &Rig, moments: &[Prepared]) -> Vec<Vec<Range>> {
    let &[parameter @ Parameter::OilCompliance] = effect.parameters else {
        return spans(effect, rig, moments);
    };
    let size = |step: i32| {
        LARGEST_RINGING
            * effect.sizes[0]
            * 10_f64.powf(-f64::from(step) / f64::from(RINGING_SPANS_PER_DECADE))
    };
    let steps = 0..RINGING_SPANS_PER_DECADE * RINGING_SPAN_DECADES;
    steps.map(|step| vec![Range { parameter, lower: size(step + 1), upper: size(step) }]).collect()
}

/// The times at which the load may step in some records.
fn step_times(records: &[Prepared]) -> Range {
    // Those of an excerpt are the times of its whole record.
    let end = |record: &Prepared| record.time(record.len().saturating_sub(1)) + record.sample_period;
    let upper = records.iter().map(end).fold(0.0, f64::max);
    Range { parameter: Parameter::StepLoadTime, lower: 0.0, upper }
}

/// A time at which the load may step.
#[derive(Clone, Copy, Debug)]
struct Timed {
    /// The time, s.
    time: f64,
    /// The best amount of the step that was tried there, as a multiple of it.
    amount: f64,
    /// By how much that lowers chi-square.
    gain: f64,
}

/// What looks for the places of an effect.
struct Seeker<'a> {
    effect: &'a EffectInfo,
    rig: &'a Rig,
    signatures: &'a Signatures<'a>,
    /// Is no effect found yet?
    is_first: bool,
    /// Where the parameters behind the effect's first start.
    others: &'a [f64],
}

impl Seeker<'_> {
    fn here(&self, index: usize) -> f64 {
        self.rig.parameters.get(self.effect.parameters[index])
    }

    fn around(&self, index: usize, half_width: f64) -> Range {
        Range::around(self.effect.parameters[index], self.here(index), half_width)
    }

    fn reach(&self, index: usize) -> Range {
        self.around(index, REACH * self.effect.sizes[index])
    }

    /// The signature of some values of the effect.
    fn signature(&self, values: &[f64]) -> DVector<f64> {
        let mut rig = self.rig.clone();
        for (&parameter, &value) in self.effect.parameters.iter().zip(values) {
            rig.parameters.set(parameter, value);
        }
        self.signatures.of(&rig)
    }

    /// The times at which a step of the load explains most. What a step sets going swings: its time has valleys that are
    /// narrower than the ones that are tried first are apart.
    fn steps(&self, records: &[Prepared]) -> Vec<Place> {
        let times = step_times(records);
        let count = STEP_TIMES.max((times.upper / STEP_EVERY_S).ceil() as usize);
        let apart = times.upper / count as f64;
        let step = 0.5 * self.effect.sizes[0];
        let judged = |time: f64| {
            let signature = self.signature(&[self.here(0) + step, time]);
            let (amount, gain) =
                self.signatures.best(&[signature]).map_or((1.0, 0.0), |(amounts, gain)| (amounts[0], gain));
            Timed { time, amount, gain }
        };
        let tried: Vec<Timed> =
            (0..count).into_par_iter().map(|index| judged(apart * (index as f64 + 0.5))).collect();
        let refined = |coarse: usize| {
            let finer = |best: Timed, round: i32| {
                let apart = apart / f64::from(FINER.pow(round as u32));
                let around = (-FINER..=FINER).into_par_iter().map(|step| best.time + apart * f64::from(step));
                around.map(judged).chain([best]).max_by(|a, b| a.gain.total_cmp(&b.gain)).unwrap_or(best)
            };
            (1..=FINER_ROUNDS).fold(tried[coarse], finer)
        };
        let place = |timed: Timed| Place {
            ranges: vec![self.reach(0), times],
            values: vec![self.here(0) + timed.amount * step, timed.time.clamp(times.lower, times.upper)],
        };
        let costs: Vec<f64> = tried.iter().map(|timed| -timed.gain).collect();
        valleys(&costs, 0.0).into_iter().map(refined).map(place).collect()
    }

    /// The pitches at which a ripple explains most.
    fn ripples(&self, records: &[Prepared]) -> Vec<Place> {
        let judged = |ripple: Ripple| {
            let size = ripple.amplitude();
            let signatures = [[size, 0.0], [0.0, size]].map(|[cosine, sine]| {
                self.signature(&[self.here(0) + cosine, self.here(1) + sine, ripple.pitch])
            });
            let (amounts, gain) = self.signatures.best(&signatures)?;
            let values =
                vec![self.here(0) + amounts[0] * size, self.here(1) + amounts[1] * size, ripple.pitch];
            Some((gain, Place { ranges: vec![self.reach(0), self.reach(1), ripple.pitch_range()], values }))
        };
        let mut seen: Vec<(f64, Place)> =
            ripple::ripples(self.rig, records).into_par_iter().filter_map(judged).collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        seen.into_iter().take(MOST_PLACES).map(|(_, place)| place).collect()
    }

    /// The compliances of a mount that explain most, whatever follows and sees its base: with another answer to that, a
    /// soft mount is another model, and no slope leads from one to the next.
    fn mounts(&self) -> Vec<Place> {
        let [lag, mass, _, _, passed] = *self.others else { return Vec::new() };
        let formed = |&[follows, sees]: &[f64; 2]| {
            let others = &[lag, mass, follows, sees, passed];
            Seeker { others, ..*self }.seen().into_iter().next()
        };
        let mut places = self.unseen();
        places.par_extend(MOUNTS.par_iter().filter_map(formed));
        places
    }

    /// Some sizes of what can be on either side of its absence, and that.
    fn either_side(&self) -> Vec<Place> {
        EITHER_SIDE
            .iter()
            .map(|&(change, reach)| self.place(change * self.effect.sizes[0], reach * self.effect.sizes[0]))
            .collect()
    }

    /// The sizes that explain most of what is on one side of its absence, and that.
    fn one_side(&self) -> Vec<Place> {
        let mut places = self.unseen();
        places.extend(self.seen());
        places
    }

    /// The sizes that explain most of what is on one side of its absence, the best first.
    fn seen(&self) -> Vec<Place> {
        let size = self.effect.sizes[0];
        let absent = self.signatures.chi_square(&self.signatures.none());
        // A signature takes away at most twice its product with what is left.
        let least = UNSEEN.max((NEGLIGIBLE / 2.0).powi(2) * absent);
        let largest = self.effect.parameters[0].info().upper - self.here(0);
        let ratio = 10_f64.powf(-1.0 / f64::from(PER_DECADE));
        let sizes: Vec<f64> = (0..=PER_DECADE * DECADES)
            .map(|step| LARGEST * size * ratio.powi(step))
            .filter(|change| change * ratio <= largest)
            .collect();
        let mut costs = Vec::with_capacity(sizes.len());
        let (mut signature, mut linear) = (self.signatures.none(), 0);
        for &change in &sizes {
            let scaled = &signature * ratio;
            if linear < LINEAR_STEPS {
                signature = self.signature(&self.place(change, 0.0).values);
                let is_linear = (&signature - scaled).norm_squared() < LINEAR * signature.norm_squared();
                linear = if is_linear { linear + 1 } else { 0 };
            } else {
                signature = scaled;
            }
            costs.push(self.signatures.chi_square(&signature));
            if signature.norm_squared() < least {
                break;
            }
        }
        let seen = valleys(&costs, absent);
        seen.into_iter().map(|index| self.place(sizes[index], sizes[index])).collect()
    }

    /// Where what is on one side of its absence is tried whatever its signature says. Where an effect of several
    /// parameters is absent, the others say nothing; as the first, it has its coarse sizes, because the faults may be
    /// far off to make up for it.
    fn unseen(&self) -> Vec<Place> {
        let size = self.effect.sizes[0];
        if self.effect.parameters.len() == 1 {
            return vec![self.place(0.0, NEAR * size)];
        }
        if !self.is_first {
            return Vec::new();
        }
        let seconds = match self.effect.parameters[1] {
            Parameter::ThinningVelocity => &COARSE[..],
            _ => &[1.0],
        };
        let place = |change: f64, second: f64| {
            let mut place = self.place(change * size, change * size);
            place.values[1] *= second;
            place
        };
        COARSE.iter().flat_map(|&first| seconds.iter().map(move |&second| place(first, second))).collect()
    }

    /// A change of the first parameter and how far around the rig's value it is looked for; the others start where they do.
    fn place(&self, change: f64, half_width: f64) -> Place {
        let sizes = self.effect.sizes;
        let info = self.effect.parameters[0].info();
        Place {
            ranges: std::iter::once(self.around(0, half_width))
                .chain((1..sizes.len()).map(|index| self.reach(index)))
                .collect(),
            values: std::iter::once((self.here(0) + change).clamp(info.lower, info.upper))
                .chain(self.others.iter().copied())
                .collect(),
        }
    }
}

/// Indices of the lowest of some costs that are below both neighbours, the lowest first; `behind` follows the last one.
fn valleys(costs: &[f64], behind: f64) -> Vec<usize> {
    let cost = |index: usize| costs.get(index).copied();
    let is_valley = |&index: &usize| {
        let before = index.checked_sub(1).and_then(cost).unwrap_or(f64::INFINITY);
        costs[index] < before && costs[index] <= cost(index + 1).unwrap_or(behind)
    };
    let mut valleys: Vec<usize> = (0..costs.len()).filter(is_valley).collect();
    valleys.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    valleys.truncate(MOST_PLACES);
    valleys
}

/// Where records show an effect of a model that was fitted to a part of them. None for an effect that is not looked for
/// in the records.
pub(super) fn shown_by(effect: &EffectInfo, rig: &Rig, ranges: &[Range], records: &[Prepared]) -> Vec<Place> {
    if !matches!(effect.parameters, [.., Parameter::CoggingPitch | Parameter::StepLoadTime]) {
        return Vec::new();
    }
    let mut without = rig.clone();
    for &parameter in effect.parameters {
        without.parameters.set(parameter, parameter.info().default);
    }
    let others: Vec<Range> =
        ranges.iter().filter(|range| !effect.parameters.contains(&range.parameter)).copied().collect();
    let signatures = Signatures::new(&without, &others, records);
    let others = Place::of(rig, &others);
    places(effect, &without, records, &signatures, false).iter().map(|place| others.with(place)).collect()
}

#[cfg(test)]
mod tests {
    use super::valleys;

    #[test]
    fn valleys_are_below_their_neighbours_and_the_lowest_comes_first() {
        assert_eq!(valleys(&[5.0, 2.0, 4.0, 1.0, 3.0, 2.5], 3.0), [3, 1, 5]);
        assert_eq!(valleys(&[5.0, 2.0, 4.0, 1.0, 3.0, 2.5], 2.0), [3, 1]);
        assert_eq!(valleys(&[1.0, 1.0, 2.0], 3.0), [0]);
        assert_eq!(valleys(&[4.0, 1.0, 3.0, 1.5, 3.0, 2.0, 3.0, 2.5], 3.0), [1, 3, 5]);
    }
}
