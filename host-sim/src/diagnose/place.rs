//! Where the fit of an effect starts, and how far around it looks.

use super::ripple;
use crate::fit::Prepared;
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::parameter::Parameter;

/// Half width of the search for an effect's parameter, in its sizes.
const REACH: f64 = 20.0;
/// The same for what would be small: a difference in the wide range would jump over an effect that a channel shows far
/// better than the position does.
const NEAR: f64 = 0.6;
/// Where an effect is looked for, and how far around, in its sizes: a play or a dead zone that is seen at one size is
/// not linear in it.
const ONE_SIDED: &[(f64, f64)] = &[(0.0, NEAR), (0.03, NEAR), (0.3, 10.0 * NEAR), (3.0, REACH)];
/// The same for an effect of several parameters: its absence says nothing of the others, and where it resonates a valley is
/// narrower than a decade.
const OF_SEVERAL: &[(f64, f64)] =
    &[(0.003, 0.1 * NEAR), (0.03, NEAR), (0.3, 10.0 * NEAR), (1.0, REACH), (3.0, REACH), (10.0, REACH)];
/// The same for what can be on either side of its absence.
const TWO_SIDED: &[(f64, f64)] = &[(-2.0, REACH), (0.0, NEAR), (0.0, REACH), (2.0, REACH)];
/// Times at which a step load is looked for.
const STEP_TIMES: usize = 10;

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

    /// The same with other parameters behind its own.
    pub(super) fn with(&self, others: &Self) -> Self {
        Self {
            ranges: [&self.ranges[..], &others.ranges].concat(),
            values: [&self.values[..], &others.values].concat(),
        }
    }
}

/// A range around the value that a rig has.
fn around(rig: &Rig, parameter: Parameter, half_width: f64) -> Range {
    Range::around(parameter, rig.parameters.get(parameter), half_width)
}

/// Where an effect of a rig is looked for in records.
pub(super) fn places(effect: &EffectInfo, rig: &Rig, records: &[Prepared]) -> Vec<Place> {
    let reach = |index: usize| around(rig, effect.parameters[index], REACH * effect.sizes[index]);
    match effect.parameters {
        [_, Parameter::StepLoadTime] => {
            let duration = |record: &Prepared| record.len() as f64 * record.sample_period;
            let upper = records.iter().map(duration).fold(0.0, f64::max);
            let ranges = vec![reach(0), Range { parameter: Parameter::StepLoadTime, lower: 0.0, upper }];
            let load = rig.parameters.get(effect.parameters[0]) + 0.5 * effect.sizes[0];
            let time = |step: usize| upper * (step as f64 + 0.5) / STEP_TIMES as f64;
            (0..STEP_TIMES)
                .map(|step| Place { ranges: ranges.clone(), values: vec![load, time(step)] })
                .collect()
        }
        [_, _, Parameter::CoggingPitch] => ripple::ripples(rig, records)
            .into_iter()
            .map(|ripple| Place {
                ranges: vec![reach(0), reach(1), ripple.pitch_range()],
                values: vec![ripple.amplitudes[0], ripple.amplitudes[1], ripple.pitch],
            })
            .collect(),
        [first, others @ ..] => {
            let (info, size, here) = (first.info(), effect.sizes[0], rig.parameters.get(*first));
            let multiples = match (here <= info.lower, others) {
                (true, []) => ONE_SIDED,
                (true, _) => OF_SEVERAL,
                (false, _) => TWO_SIDED,
            };
            let place = |&(multiple, reach_of_first): &(f64, f64)| Place {
                ranges: std::iter::once(around(rig, *first, reach_of_first * size))
                    .chain((1..=others.len()).map(reach))
                    .collect(),
                values: std::iter::once((here + multiple * size).clamp(info.lower, info.upper))
                    .chain(effect.sizes[1..].iter().copied())
                    .collect(),
            };
            multiples.iter().map(place).collect()
        }
        [] => Vec::new(),
    }
}

/// Where records show an effect of a model that was fitted to a part of them. None for an effect that is not looked for
/// in the records.
pub(super) fn shown_by(effect: &EffectInfo, rig: &Rig, ranges: &[Range], records: &[Prepared]) -> Vec<Place> {
    if !matches!(effect.parameters, [.., Parameter::CoggingPitch]) {
        return Vec::new();
    }
    let mut without = rig.clone();
    for &parameter in effect.parameters {
        without.parameters.set(parameter, parameter.info().default);
    }
    let others: Vec<Range> =
        ranges.iter().filter(|range| !effect.parameters.contains(&range.parameter)).copied().collect();
    let others = Place::of(rig, &others);
    places(effect, &without, records).iter().map(|place| others.with(place)).collect()
}
