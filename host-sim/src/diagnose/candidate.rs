//! One effect of the catalogue as a hypothesis: its parameters added to the free ones, fitted together.

use super::ripple::{self, Ripple};
use crate::fit::{self, Polished, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::model::{Drive, ValveForm};
use eha_monitor::parameter::Parameter;

/// Half width of the search for an effect's parameter, in its sizes.
const REACH: f64 = 20.0;
/// The same for what would be small: a difference in the wide range would jump over an effect that a channel shows far
/// better than the position does.
const NEAR: f64 = 0.6;
/// Factor by which a range is widened where a fit ends at its edge, and how often.
const WIDER: f64 = 10.0;
const MOST_WIDENED: usize = 3;
/// Times at which a step load is looked for.
const STEP_TIMES: usize = 10;
/// Where an effect is looked for, and how far around, in its sizes: a play or a dead zone that is seen at one size is
/// not linear in it.
const ONE_SIDED: &[(f64, f64)] = &[(0.0, NEAR), (0.03, REACH), (0.3, REACH), (3.0, REACH)];
/// The same for what can be on either side of its absence.
const TWO_SIDED: &[(f64, f64)] = &[(-2.0, REACH), (0.0, REACH), (2.0, REACH)];

/// An effect that was fitted together with everything that was free before.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// The effect.
    pub(super) effect: &'static EffectInfo,
    /// The free parameters: those of before, then the effect's.
    pub(super) ranges: Vec<Range>,
    /// The fit.
    pub(super) fit: Polished,
    /// The rig with the fitted values.
    pub(super) rig: Rig,
}

/// Can an effect act in a rig at all? An effect of the valve or the fluid needs them; one whose parameter is free
/// already is part of the model.
pub(super) fn applies(effect: &EffectInfo, rig: &Rig, ranges: &[Range]) -> bool {
    use eha_monitor::effect::Port;
    let part_of_model =
        effect.parameters.iter().any(|&wanted| ranges.iter().any(|range| range.parameter == wanted));
    let pilot = matches!(
        effect.parameters[0],
        Parameter::FeedbackPlay | Parameter::FilterClogging | Parameter::SpoolFriction
    );
    let in_hydraulics = matches!(effect.port, Port::Valve | Port::Fluid);
    let out_of_place = (in_hydraulics && rig.form.drive == Drive::Force)
        || (pilot && rig.form.valve == ValveForm::FirstOrder);
    let no_drive = effect.port == Port::Drive && rig.form.drive == Drive::Valve;
    // A known controller samples the sensor: what lies between ram and sensor would be inside its loop.
    !part_of_model && !out_of_place && !no_drive
}

/// Where a fit starts.
#[derive(Clone, Debug)]
struct Place {
    /// The free parameters.
    ranges: Vec<Range>,
    /// Their values.
    values: Vec<f64>,
}

impl Place {
    /// Some parameters where a rig has them.
    fn of(rig: &Rig, ranges: &[Range]) -> Self {
        let values = ranges.iter().map(|range| rig.parameters.get(range.parameter)).collect();
        Self { ranges: ranges.to_vec(), values }
    }

    /// The same with other parameters behind its own.
    fn with(&self, others: &Self) -> Self {
        Self {
            ranges: [&self.ranges[..], &others.ranges].concat(),
            values: [&self.values[..], &others.values].concat(),
        }
    }
}

/// Where the fit of an effect's parameters starts in a rig, for records of a duration, s, that show some ripples.
fn places(effect: &EffectInfo, rig: &Rig, duration: f64, ripples: &[Ripple]) -> Vec<Place> {
    let around = |parameter: Parameter, half_width: f64| {
        let (info, here) = (parameter.info(), rig.parameters.get(parameter));
        let (lower, upper) = ((here - half_width).max(info.lower), (here + half_width).min(info.upper));
        Range { parameter, lower, upper }
    };
    let (first, size) = (effect.parameters[0], effect.sizes[0]);
    let ranges = |reach: f64| -> Vec<Range> {
        let others = effect.parameters.iter().zip(effect.sizes).skip(1);
        std::iter::once(around(first, reach * size))
            .chain(others.map(|(&parameter, size)| around(parameter, REACH * size)))
            .collect()
    };
    let here = rig.parameters.get(first);
    if effect.parameters.contains(&Parameter::StepLoadTime) {
        let time = |step: usize| duration * (step as f64 + 0.5) / STEP_TIMES as f64;
        let all = Range { parameter: Parameter::StepLoadTime, lower: 0.0, upper: duration };
        let ranges = vec![around(first, REACH * size), all];
        return (0..STEP_TIMES)
            .map(|step| Place { ranges: ranges.clone(), values: vec![here + 0.5 * size, time(step)] })
            .collect();
    }
    if effect.parameters.contains(&Parameter::CoggingPitch) {
        let [amplitudes @ .., _] = &ranges(REACH)[..] else { return Vec::new() };
        return ripples
            .iter()
            .map(|ripple| Place {
                ranges: [amplitudes, &[ripple.pitch_range()]].concat(),
                values: vec![ripple.amplitudes[0], ripple.amplitudes[1], ripple.pitch],
            })
            .collect();
    }
    let info = first.info();
    let multiples = if here <= info.lower { ONE_SIDED } else { TWO_SIDED };
    multiples
        .iter()
        .map(|&(multiple, reach)| {
            let value = (here + multiple * size).clamp(info.lower, info.upper);
            let others = effect.sizes.iter().skip(1).copied();
            Place { ranges: ranges(reach), values: std::iter::once(value).chain(others).collect() }
        })
        .collect()
}

/// Where records show an effect of a model that was fitted to a part of them: the free parameters and their values, for
/// each place. None for an effect that is not looked for in the records.
pub(super) fn shown_by(
    effect: &EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
) -> Vec<(Vec<Range>, Vec<f64>)> {
    if !effect.parameters.contains(&Parameter::CoggingPitch) {
        return Vec::new();
    }
    let mut without = rig.clone();
    for &parameter in effect.parameters {
        without.parameters.set(parameter, parameter.info().default);
    }
    let others: Vec<Range> =
        ranges.iter().filter(|range| !effect.parameters.contains(&range.parameter)).copied().collect();
    let others = Place::of(rig, &others);
    let ripples = ripple::ripples(&without, records);
    let all = places(effect, &without, 0.0, &ripples).into_iter().map(|place| others.with(&place));
    all.map(|place| (place.ranges, place.values)).collect()
}

/// An effect as the linear model sees it, before anything is fitted.
#[derive(Clone, Debug)]
pub(super) struct Prospect {
    /// The effect.
    pub(super) effect: &'static EffectInfo,
    /// What the linear model foresees: values, misfit, covariance.
    pub(super) foreseen: Polished,
    /// The ranges in which it does.
    ranges: Vec<Range>,
    /// Where the effect was looked for.
    places: Vec<Place>,
}

/// Looks at an effect beside the parameters that are free already, whose present values are in the rig. None where
/// the records say nothing about it, or too many parameters are free.
pub(super) fn look(
    effect: &'static EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
) -> Option<Prospect> {
    if ranges.len() + effect.parameters.len() > fit::MAX_FREE {
        return None;
    }
    let duration =
        records.iter().map(|record| record.len() as f64 * record.sample_period).fold(0.0, f64::max);
    let ripples = if effect.parameters.contains(&Parameter::CoggingPitch) {
        ripple::ripples(rig, records)
    } else {
        Vec::new()
    };
    let base = Place::of(rig, ranges);
    let places: Vec<Place> =
        places(effect, rig, duration, &ripples).iter().map(|place| base.with(place)).collect();
    let (ranges, foreseen) = places
        .iter()
        .filter_map(|place| Some((&place.ranges, fit::foresee(rig, &place.ranges, &place.values, records)?)))
        .min_by(|(_, a), (_, b)| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))?;
    Some(Prospect { effect, foreseen, ranges: ranges.clone(), places })
}

impl Prospect {
    /// A rough fit, from what the linear model foresees and from each place where it was looked for: what was free
    /// before first follows it there, because it may have been far off to make up for the effect.
    pub(super) fn approach(&self, rig: &Rig, records: &[Prepared]) -> Option<Rough> {
        let before = self.ranges.len() - self.effect.parameters.len();
        let followed = self.places.iter().filter_map(|Place { ranges, values }| {
            let mut there = rig.clone();
            for (range, &value) in ranges.iter().zip(values).skip(before) {
                there.parameters.set(range.parameter, value);
            }
            let found = fit::approach(&there, &ranges[..before], &values[..before], records)?;
            Some((found.misfit.chi_square, ranges, [&found.values, &values[before..]].concat()))
        });
        let best = followed.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, ranges, values)| (ranges, values));
        let starts = std::iter::once((&self.ranges, self.foreseen.values.clone())).chain(best);
        starts
            .filter_map(|(ranges, start)| {
                let fit = fit::approach(rig, ranges, &start, records)?;
                Some(Rough { effect: self.effect, ranges: ranges.clone(), fit })
            })
            .min_by(|a, b| a.fit.misfit.chi_square.total_cmp(&b.fit.misfit.chi_square))
    }
}

/// An effect that was fitted roughly.
pub(super) struct Rough {
    effect: &'static EffectInfo,
    /// The free parameters: those of before, then the effect's.
    ranges: Vec<Range>,
    /// The fit.
    pub(super) fit: Polished,
}

impl Rough {
    /// Goes on to the bottom.
    pub(super) fn finish(self, rig: &Rig, records: &[Prepared]) -> Option<Candidate> {
        let (ranges, fit) = fitted(rig, self.ranges, &self.fit.values, records)?;
        let mut rig = fit.applied(rig, &ranges);
        rig.effects.push(self.effect);
        Some(Candidate { effect: self.effect, ranges, fit, rig })
    }
}

/// Fits the ranges from a start, those of effects wider where the fit ends at their edge; none where the records hold
/// nothing to compare.
pub(super) fn fitted(
    rig: &Rig,
    mut ranges: Vec<Range>,
    start: &[f64],
    records: &[Prepared],
) -> Option<(Vec<Range>, Polished)> {
    let mut fit = fit::polish(rig, &ranges, start, records)?;
    for _ in 0..MOST_WIDENED {
        let wider = widened(rig, &ranges, &fit.values);
        if wider == ranges {
            break;
        }
        ranges = wider;
        fit = fit::polish(rig, &ranges, &fit.values, records)?;
    }
    Some((ranges, fit))
}

/// The ranges, but those that the rig does not declare wider where a value is at their edge and inside what is possible.
fn widened(rig: &Rig, ranges: &[Range], values: &[f64]) -> Vec<Range> {
    let is_given = |parameter| {
        let declared = rig.faults.iter().chain(&rig.free).any(|range| range.parameter == parameter);
        declared || parameter == Parameter::StepLoadTime
    };
    let widen = |(range, &value): (&Range, &f64)| {
        let info = range.parameter.info();
        let [below, above] = range.at_edge(value);
        let at_edge = (below && range.lower > info.lower) || (above && range.upper < info.upper);
        if !at_edge || is_given(range.parameter) {
            return *range;
        }
        let more = (WIDER - 1.0) / 2.0 * (range.upper - range.lower);
        Range {
            lower: (range.lower - more).max(info.lower),
            upper: (range.upper + more).min(info.upper),
            ..*range
        }
    };
    ranges.iter().zip(values).map(widen).collect()
}
