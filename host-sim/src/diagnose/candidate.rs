//! One effect of the catalogue as a hypothesis: its parameters added to the free ones, fitted together.

use super::ripple::{self, Ripple};
use crate::fit::{self, Polished, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::model::{Drive, ValveForm};
use eha_monitor::parameter::Parameter;

/// Half width of the search for an effect's parameter, in its sizes.
const REACH: f64 = 20.0;
/// Factor by which a range is widened where a fit ends at its edge, and how often.
const WIDER: f64 = 10.0;
const MOST_WIDENED: usize = 3;
/// Times at which a step load is looked for.
const STEP_TIMES: usize = 10;
/// Where an effect is looked for, in its sizes: a play or a dead zone that is seen at one size is not linear in it.
const ONE_SIDED: &[f64] = &[0.0, 0.03, 0.3, 3.0];
/// The same for what can be on either side of its absence.
const TWO_SIDED: &[f64] = &[-2.0, 0.0, 2.0];

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

/// Ranges of an effect's parameters around the values that a rig has.
fn effect_ranges(effect: &EffectInfo, rig: &Rig, duration: f64, ripples: &[Ripple]) -> Vec<Range> {
    effect
        .parameters
        .iter()
        .zip(effect.sizes)
        .map(|(&parameter, &size)| {
            let (info, here) = (parameter.info(), rig.parameters.get(parameter));
            if parameter == Parameter::StepLoadTime {
                return Range { parameter, lower: 0.0, upper: duration };
            }
            if parameter == Parameter::CoggingPitch {
                let reach = |factor: f64| ripples.iter().map(move |ripple| ripple.pitch * factor);
                let (low, high) = (1.0 - ripple::PITCH_REACH, 1.0 + ripple::PITCH_REACH);
                return Range {
                    parameter,
                    lower: reach(low).fold(info.upper, f64::min).max(info.lower),
                    upper: reach(high).fold(info.lower, f64::max).min(info.upper),
                };
            }
            Range {
                parameter,
                lower: (here - REACH * size).max(info.lower),
                upper: (here + REACH * size).min(info.upper),
            }
        })
        .collect()
}

/// Values of an effect's parameters from which its fit starts.
fn effect_starts(effect: &EffectInfo, rig: &Rig, duration: f64, ripples: &[Ripple]) -> Vec<Vec<f64>> {
    let here = rig.parameters.get(effect.parameters[0]);
    let (info, size) = (effect.parameters[0].info(), effect.sizes[0]);
    if effect.parameters.contains(&Parameter::StepLoadTime) {
        return (0..STEP_TIMES)
            .map(|k| vec![here + 0.5 * size, duration * (k as f64 + 0.5) / STEP_TIMES as f64])
            .collect();
    }
    if effect.parameters.contains(&Parameter::CoggingPitch) {
        let start = |ripple: &Ripple| vec![ripple.amplitudes[0], ripple.amplitudes[1], ripple.pitch];
        return ripples.iter().map(start).collect();
    }
    let multiples = if here <= info.lower { ONE_SIDED } else { TWO_SIDED };
    multiples
        .iter()
        .map(|multiple| {
            let first = (here + multiple * size).clamp(info.lower, info.upper);
            let others = effect.parameters.iter().zip(effect.sizes).skip(1);
            std::iter::once(first).chain(others.map(|(_, &size)| size)).collect()
        })
        .collect()
}

/// An effect as the linear model sees it, before anything is fitted.
#[derive(Clone, Debug)]
pub(super) struct Prospect {
    /// The effect.
    pub(super) effect: &'static EffectInfo,
    /// The free parameters: those of before, then the effect's.
    ranges: Vec<Range>,
    /// What the linear model foresees: values, misfit, covariance.
    pub(super) foreseen: Polished,
    /// Where it was looked for.
    starts: Vec<Vec<f64>>,
}

/// Looks at an effect beside the parameters that are free already, whose present values are in the rig. None where
/// the records say nothing about it, or too many parameters are free.
pub(super) fn look(
    effect: &'static EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
) -> Option<Prospect> {
    let duration =
        records.iter().map(|record| record.len() as f64 * record.sample_period).fold(0.0, f64::max);
    let mut all = ranges.to_vec();
    let ripples = if effect.parameters.contains(&Parameter::CoggingPitch) {
        ripple::ripples(rig, records)
    } else {
        Vec::new()
    };
    all.extend(effect_ranges(effect, rig, duration, &ripples));
    if all.len() > fit::MAX_FREE {
        return None;
    }
    let here: Vec<f64> = ranges.iter().map(|range| rig.parameters.get(range.parameter)).collect();
    let starts: Vec<Vec<f64>> = effect_starts(effect, rig, duration, &ripples)
        .into_iter()
        .map(|start| here.iter().copied().chain(start).collect())
        .collect();
    let foreseen = fit::foresee(rig, &all, &starts, records)
        .into_iter()
        .min_by(|a, b| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))?;
    Some(Prospect { effect, ranges: all, foreseen, starts })
}

impl Prospect {
    /// A rough fit, from what the linear model foresees and from each place where it was looked for: what was free
    /// before first follows it there, because it may have been far off to make up for the effect.
    pub(super) fn approach(&self, rig: &Rig, records: &[Prepared]) -> Option<Polished> {
        let before = self.ranges.len() - self.effect.parameters.len();
        let followed = self.starts.iter().filter_map(|start| {
            let mut there = rig.clone();
            for (range, &value) in self.ranges.iter().zip(start).skip(before) {
                there.parameters.set(range.parameter, value);
            }
            let found = fit::approach(&there, &self.ranges[..before], &start[..before], records)?;
            Some((found.misfit.chi_square, [&found.values, &start[before..]].concat()))
        });
        let best = followed.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, start)| start);
        let starts = std::iter::once(self.foreseen.values.clone()).chain(best);
        starts
            .filter_map(|start| fit::approach(rig, &self.ranges, &start, records))
            .min_by(|a, b| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))
    }

    /// Fits it from a start.
    pub(super) fn fit(&self, rig: &Rig, start: &[f64], records: &[Prepared]) -> Option<Candidate> {
        let mut ranges = self.ranges.clone();
        let mut fit = fit::polish(rig, &ranges, start, records)?;
        for _ in 0..MOST_WIDENED {
            let wider = self.widened(&ranges, &fit.values);
            if wider == ranges {
                break;
            }
            ranges = wider;
            fit = fit::polish(rig, &ranges, &fit.values, records)?;
        }
        let mut fitted = fit.applied(rig, &ranges);
        fitted.effects.push(self.effect);
        Some(Candidate { effect: self.effect, ranges, fit, rig: fitted })
    }

    /// The ranges, those of the effect's parameters wider where a value is at their edge but inside what is possible.
    fn widened(&self, ranges: &[Range], values: &[f64]) -> Vec<Range> {
        let before = ranges.len() - self.effect.parameters.len();
        let widen = |(index, (range, &value)): (usize, (&Range, &f64))| {
            let info = range.parameter.info();
            let [below, above] = range.at_edge(value);
            let at_edge = (below && range.lower > info.lower) || (above && range.upper < info.upper);
            if index < before || !at_edge || range.parameter == Parameter::StepLoadTime {
                return *range;
            }
            let more = (WIDER - 1.0) / 2.0 * (range.upper - range.lower);
            Range {
                lower: (range.lower - more).max(info.lower),
                upper: (range.upper + more).min(info.upper),
                ..*range
            }
        };
        ranges.iter().zip(values).enumerate().map(widen).collect()
    }
}
