//! One effect of the catalogue as a hypothesis: its parameters added to the free ones, fitted together.

use crate::fit::{self, Polished, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::model::{Drive, ValveForm};
use eha_monitor::parameter::Parameter;

/// Half width of the search for an effect's parameter, in its sizes.
const REACH: f64 = 20.0;
/// Times at which a step load is looked for.
const STEP_TIMES: usize = 10;

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
    !part_of_model && !out_of_place
}

/// Ranges of an effect's parameters around the values that a rig has.
fn effect_ranges(effect: &EffectInfo, rig: &Rig, duration: f64) -> Vec<Range> {
    effect
        .parameters
        .iter()
        .zip(effect.sizes)
        .map(|(&parameter, &size)| {
            let (info, here) = (parameter.info(), rig.parameters.get(parameter));
            if parameter == Parameter::StepLoadTime {
                return Range { parameter, lower: 0.0, upper: duration };
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
fn effect_starts(effect: &EffectInfo, rig: &Rig, duration: f64) -> Vec<Vec<f64>> {
    let here = rig.parameters.get(effect.parameters[0]);
    let (info, size) = (effect.parameters[0].info(), effect.sizes[0]);
    if effect.parameters.contains(&Parameter::StepLoadTime) {
        return (0..STEP_TIMES)
            .map(|k| vec![here + 0.5 * size, duration * (k as f64 + 0.5) / STEP_TIMES as f64])
            .collect();
    }
    let one_sided = here <= info.lower;
    let multiples: &[f64] = if one_sided { &[0.5, 3.0] } else { &[0.25] };
    multiples.iter().map(|multiple| vec![(here + multiple * size).min(info.upper)]).collect()
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
    /// Where a fit is to start.
    start: Vec<f64>,
}

/// Looks at an effect beside the parameters that are free already, whose present values are in the rig. None where
/// the records say nothing about it, or too many parameters are free.
pub(super) fn look(
    effect: &'static EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    noise: [f64; 4],
) -> Option<Prospect> {
    let duration =
        records.iter().map(|record| record.len() as f64 * record.sample_period).fold(0.0, f64::max);
    let mut all = ranges.to_vec();
    all.extend(effect_ranges(effect, rig, duration));
    if all.len() > fit::MAX_FREE {
        return None;
    }
    let here: Vec<f64> = ranges.iter().map(|range| rig.parameters.get(range.parameter)).collect();
    let starts: Vec<Vec<f64>> = effect_starts(effect, rig, duration)
        .into_iter()
        .map(|start| here.iter().copied().chain(start).collect())
        .collect();
    let (start, foreseen) = starts
        .into_iter()
        .filter_map(|start| {
            let foreseen = fit::foresee(rig, &all, std::slice::from_ref(&start), records, noise).pop()?;
            Some((start, foreseen))
        })
        .min_by(|a, b| a.1.misfit.chi_square.total_cmp(&b.1.misfit.chi_square))?;
    Some(Prospect { effect, ranges: all, foreseen, start })
}

impl Prospect {
    /// Fits it.
    pub(super) fn fit(&self, rig: &Rig, records: &[Prepared], noise: [f64; 4]) -> Option<Candidate> {
        let starts = [self.start.clone(), self.foreseen.values.clone()];
        let fit = fit::polish(rig, &self.ranges, &starts, records, noise)?;
        let mut fitted = fit.applied(rig, &self.ranges);
        fitted.effects.push(self.effect);
        Some(Candidate { effect: self.effect, ranges: self.ranges.clone(), fit, rig: fitted })
    }
}
