//! What the rig says of its machine may be wrong: the parameters that no effect changes, one by one.

use super::Case;
use super::candidate;
use super::diagnosis::Diagnosis;
use super::hypothesis::price;
use super::place::Place;
use super::residual::MEASURED;
use super::signature::Signatures;
use crate::fit::{self, Estimate, Prepared, Reading, TOLD_APART};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EFFECTS;
use eha_monitor::parameter::{PARAMETERS, Parameter};
use rayon::prelude::*;
use std::iter;

/// Part of its value by which a parameter is changed to see what that does.
const CHANGE: f64 = 0.01;
/// Part of its value by which it may be wrong, and still be found.
const WRONG_BY: f64 = 0.5;
/// Of those that in the linear model take away what a parameter must gain to be believed, so many that take most are fitted.
const MOST_FITTED: usize = 4;
/// Rough steps of a fit before it goes to the bottom.
const STEPS: u32 = 12;

/// A parameter of the rig that no effect changes, and a value of it with which the declared faults explain all records.
#[derive(Clone, Copy, Debug)]
pub struct Doubt {
    /// What the rig says of it.
    pub stated: f64,
    /// What the records say.
    pub estimate: Estimate,
}

/// The parameters that the rig of a case may have wrong in place of what a diagnosis found, or did not find: the one that leaves
/// least, and those that the records do not tell from it.
pub(super) fn doubts(case: &Case<'_>, diagnosis: &Diagnosis) -> Vec<Doubt> {
    let is_unexplained = diagnosis.is_unexplained();
    let own = Reading { rig: case.rig.reading_as(&diagnosis.rig), records: diagnosis.records.clone() };
    // What explains the records says how they are to be read.
    let mut others = if is_unexplained { Reading::all(case.rig, case.records) } else { Vec::new() };
    if diagnosis.jumps.is_none() && diagnosis.colour == [0.0; MEASURED] {
        others.retain(|other| other.rig != own.rig);
    }
    let readings: Vec<Reading> = iter::once(own)
        .chain(others)
        .map(|Reading { rig, records }| Reading { rig: diagnosis.before.applied(&rig), records })
        .collect();
    let most = if is_unexplained {
        f64::INFINITY
    } else {
        fit::misfit(&diagnosis.rig, &[], &[], &diagnosis.records).chi_square + TOLD_APART
    };
    let mut found: Vec<(f64, Doubt)> = promising(&case.read_as(&readings[0], ""))
        .into_par_iter()
        .filter_map(|parameter| {
            let fits = readings.iter().filter_map(|reading| doubted(&case.read_as(reading, ""), parameter));
            fits.min_by(|(a, _), (b, _)| a.total_cmp(b))
        })
        .collect();
    found.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let least = found.first().map_or(f64::INFINITY, |&(least, _)| least);
    found.retain(|&(left, _)| left <= most.min(least + TOLD_APART));
    found.into_iter().map(|(_, doubt)| doubt).collect()
}

/// The parameters that are worth a fit, as the linear model around the rig of a case sees them.
fn promising(case: &Case<'_>) -> Vec<Parameter> {
    let (rig, declared, excerpts) = (case.rig, case.rig.declared(), case.excerpts());
    let records = excerpts.as_deref().unwrap_or(case.records);
    let signatures = Signatures::new(rig, &declared, records);
    let open = open_to_doubt(rig);
    let compared = |record: &Prepared| (0..MEASURED).map(|channel| record.compared(channel)).sum::<usize>();
    let samples: usize = records.iter().map(compared).sum();
    let price = price(1, samples as f64, open.len());
    let gain = |parameter: Parameter| {
        let mut changed = rig.clone();
        changed.parameters.set(parameter, (1.0 + CHANGE) * rig.parameters.get(parameter));
        let (_, gain) = signatures.best(&[signatures.of(&changed)])?;
        (gain > price).then_some((parameter, gain))
    };
    let mut gains: Vec<(Parameter, f64)> = open.into_par_iter().filter_map(gain).collect();
    gains.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    gains.into_iter().take(MOST_FITTED).map(|(parameter, _)| parameter).collect()
}

/// The parameters that are neither part of an effect, nor free, nor absent.
fn open_to_doubt(rig: &Rig) -> Vec<Parameter> {
    let in_effect = |parameter| EFFECTS.iter().any(|effect| effect.parameters.contains(&parameter));
    PARAMETERS
        .iter()
        .map(|info| info.parameter)
        .filter(|&parameter| rig.parameters.get(parameter) != 0.0)
        .filter(|&parameter| !rig.declares(parameter) && !in_effect(parameter))
        .collect()
}

/// A parameter fitted beside what is declared, with its chi-square, if that leaves noise of all records and asks for another
/// value than the rig has.
fn doubted(case: &Case<'_>, parameter: Parameter) -> Option<(f64, Doubt)> {
    let rig = case.rig;
    let stated = rig.parameters.get(parameter);
    let range = Range::around(parameter, stated, WRONG_BY * stated.abs());
    let start = Place::of(rig, &[rig.declared(), vec![range]].concat());
    let rough = fit::approach(rig, &start.ranges, &start.values, case.records, STEPS)?;
    let (ranges, fit) = candidate::fitted(rig, start.ranges, &rough.values, case.records)?;
    let predictions = fit::predict(&fit.applied(rig, &ranges), case.records);
    let (last, range) = (fit.values.len() - 1, ranges.last()?);
    let estimate = Estimate::new(range, fit.values[last], fit.standard_error(last));
    let [lower, upper] = estimate.ci95;
    let is_another = !(lower..=upper).contains(&stated);
    (is_another && case.is_noise_left(&predictions))
        .then_some((fit.misfit.chi_square, Doubt { stated, estimate }))
}

#[cfg(test)]
mod tests {
    use super::super::conclusion::{Open, conclude};
    use super::super::hypothesis::Hypothesis;
    use super::super::signature::tests::{record, with};
    use super::{Case, doubts, open_to_doubt};
    use crate::fit::{self, FitSettings};
    use crate::rig::Rig;
    use eha_monitor::parameter::Parameter;

    #[test]
    fn what_the_rig_has_wrong_is_doubted_and_what_an_effect_does_is_not() {
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 600.0);
        let doubted = |parameter, change| {
            let records = [record(&with(&rig, parameter, change))];
            let case = Case::new(&rig, &records, 1);
            let before = fit::fit(&rig, &rig.declared(), case.records, &FitSettings::default(), |_| {});
            let root = Hypothesis::root(&case, &before, rig.declared());
            let open = Open { named: true, stand_ins: Vec::new(), confounded: vec![Vec::new(); 2] };
            doubts(&case, &conclude(&case, before, &root, &[], &open))
        };
        let wrong = Parameter::ProportionalGain;
        let found = doubted(wrong, 500.0);
        let first = found.iter().find(|doubt| doubt.estimate.parameter == wrong).unwrap();
        assert_eq!(first.stated, rig.parameters.proportional_gain);
        assert!((first.estimate.value - 10_500.0).abs() < 5.0, "{found:?}");
        let [lower, upper] = first.estimate.ci95;
        assert!(lower > first.stated && upper < 10_600.0, "{found:?}");
        // Nothing of the rig pulls to one side.
        assert!(doubted(Parameter::ConstantLoad, 200.0).is_empty());
    }

    #[test]
    fn neither_what_is_free_nor_what_an_effect_changes_is_open_to_doubt() {
        let rig = Rig::load("eha").unwrap();
        let open = open_to_doubt(&rig);
        let is_open = |parameter| open.contains(&parameter);
        assert!(is_open(Parameter::ProportionalGain) && is_open(Parameter::BreakawayRatio));
        let (free, of_effect, absent) =
            (Parameter::DryFriction, Parameter::TorqueMotorGain, Parameter::DerivativeGain);
        assert!(!is_open(free) && !is_open(of_effect) && !is_open(absent));
    }
}
