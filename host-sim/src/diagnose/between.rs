//! Commands that may jump between the samples of their record: the answer where they do.

use super::case::Case;
use super::diagnosis::Diagnosis;
use super::hypothesis::{self, Hypothesis};
use super::jumps::{Jumps, Timed};
use super::readings::{Answer, Declared, diagnose_in_noise};
use super::search::{GROWING_SHARE, Rival, Suggested, least_scale};
use crate::fit::{self, Estimate, FitSettings, Prepared, Reading, TOLD_APART};
use crate::rig::CommandPath;
use std::borrow::Cow;
use std::iter;

/// How often jumps are timed beside effects that are then found to be others.
const MOST_TIMED: usize = 3;
/// What is told of a diagnosis that takes them to be there.
const JUMPING: &str = ", command jumps between samples";

/// What records say of commands that jump between samples.
pub(super) enum Between {
    /// That there are none, or that they jump at samples.
    No,
    /// That these may be: what is free would be this.
    Open(Vec<Estimate>),
    /// That these are: the answer with them.
    Found(Box<Diagnosis>),
}

/// The records of a case with jumps between samples in their commands.
pub(super) struct Jumping {
    reading: Reading,
    jumps: Jumps,
    /// Their times beside the declared faults alone, or beside what those records ask for whose commands do not jump.
    first: Timed,
    /// What that model costs with these, in place of effects in another reading; none where the records do not tell the
    /// times.
    pub(super) rival: Option<Rival>,
}

impl Jumping {
    /// None where the rig rules it out, or no command jumps now and then.
    pub(super) fn of(case: &Case<'_>, settings: &FitSettings) -> Option<Self> {
        let is_curve = case.rig.command_path == CommandPath::Curve;
        let as_it_is = || is_curve.then(|| Reading { rig: case.rig.clone(), records: case.records.to_vec() });
        let reading = fit::on_path(case.rig, case.records, CommandPath::Curve).or_else(as_it_is)?;
        let jumps = Jumps::of(&reading.records)?;
        // What leaves out the answers to jumps may end in another valley of the faults than all of it: each place is
        // searched.
        let moved = |start: &Hypothesis, case: &Case<'_>| {
            let [searched, moved] = [Declared::from_seeds(case, settings, 1).root, start.refitted(case)];
            if hypothesis::lower(&moved, &searched).is_lt() { moved } else { searched }
        };
        let curved = case.read_as(&reading, JUMPING);
        curved.progress.begin("timing the jumps", [0.0, 1.0]);
        let mut first = jumps.timed(&curved, |case| Declared::of(case, settings).root, moved);
        if !first.model.leaves_noise(&first.case(case))
            && let Some(asked) = asked_by_calm(case, &curved, settings).map(|asked| asked.taken_to(&curved))
            && !curved.is_over()
            && jumps.may_explain(&asked, &curved, &asked)
        {
            let beside = jumps.beside(&asked, &curved);
            let scale = least_scale([&first.model, &beside.model].into_iter());
            if beside.cost(scale).zip(first.cost(scale)).is_some_and(|(beside, alone)| beside < alone) {
                first = beside;
            }
        }
        // What does as well with its jumps at their samples needs no times.
        let needs_times =
            |rival: &Rival| first.model.added.is_empty() || rival.beats(&first.model.refitted(case));
        let rival = first.rival(case).filter(needs_times);
        Some(Self { reading, jumps, first, rival })
    }

    /// The effects beside which the first times were fitted; none where these are the declared faults alone.
    pub(super) fn suggested(&self) -> Option<Suggested<'_>> {
        let model = Some(&self.first.model).filter(|model| !model.added.is_empty())?;
        Some(Suggested { model, explanation: None })
    }

    /// Diagnoses the case in it, if that explains more than the model that was found without it.
    pub(super) fn diagnose(self, case: &Case<'_>, without: &Answer, settings: &FitSettings) -> Between {
        let Self { reading, jumps, first, rival } = &self;
        let curved = &case.read_as(reading, JUMPING);
        let beside = |model: &Hypothesis| jumps.beside(model, curved);
        let found = &without.model;
        let asked = Some(without.to_be_timed()).filter(|asked| !asked.same_effects(found));
        // Where nothing explains the records, and no times of the jumps take away much of that, they are not what is missing.
        let may_explain = |model: &Hypothesis, is_in_it: bool| {
            let rig = curved.rig.with_spool_of(&model.rig);
            let there = curved.under(&rig);
            let in_it = if is_in_it { Cow::Borrowed(model) } else { Cow::Owned(model.refitted(&there)) };
            jumps.may_explain(&in_it, &there, model)
        };
        let is_worth_timing = |model: &&Hypothesis| {
            !model.added.is_empty()
                && !rival.is_some_and(|rival| rival.beats_throughout(model))
                && (!without.is_unexplained() || may_explain(model, false))
        };
        let models = iter::once(found).chain(asked).filter(is_worth_timing);
        curved.progress.begin("timing the jumps beside what was found", [0.0, 0.3]);
        let timed: Vec<Timed> = iter::once(first.clone()).chain(models.map(beside)).collect();
        let scale = least_scale(timed.iter().map(|timed| &timed.model).chain([found]));
        let best = timed.into_iter().filter_map(|timed| Some((timed.cost(scale)?, timed)));
        let Some((mut least, mut best)) = best.min_by(|(a, _), (b, _)| a.total_cmp(b)) else {
            return Between::No;
        };
        let gain = found.cost(scale) - least;
        if gain.abs() <= TOLD_APART && found.same_effects(&best.model) {
            return Between::Open(best.model.estimates(&best.case(curved)));
        }
        let explains_little = without.is_unexplained() && best.model.share_of(found) < GROWING_SHARE;
        if gain <= TOLD_APART || explains_little {
            return Between::No;
        }
        let cheaper_beside = |model: &Hypothesis, least: f64| {
            let timed = beside(model);
            timed.cost(scale).filter(|cost| *cost < least).map(|cost| (cost, timed))
        };
        // Times that were fitted beside too little ask for effects that make up for it.
        for _ in 1..MOST_TIMED {
            let there = best.case(curved);
            let next = Declared::of(&there, settings).sketched(&there);
            if curved.is_over() || next.added.is_empty() || next.same_effects(&best.model) {
                break;
            }
            let Some(better) = cheaper_beside(&next, least) else { break };
            (least, best) = better;
        }
        let mut turn = 1;
        loop {
            let answer = diagnose_in_noise(&best.case(curved).part([0.3, 1.0], "").another(), settings);
            let next = answer.to_be_timed();
            let is_same = next.same_effects(&best.model)
                && next.rig.has_sticking_spool() == best.model.rig.has_sticking_spool();
            let is_last = turn == MOST_TIMED || is_same || curved.is_over();
            let is_open = !is_last && (!answer.is_unexplained() || may_explain(next, true));
            let Some(better) = is_open.then(|| cheaper_beside(next, least)).flatten() else {
                let traded = in_place_of_times(case, &answer, &best.case(curved), settings);
                let jumps = Some(best.jumps.times(curved.records));
                let diagnosis = traded.unwrap_or(Diagnosis { jumps, ..answer.diagnosis });
                return Between::Found(Box::new(diagnosis));
            };
            (least, best) = better;
            turn += 1;
        }
    }
}

/// The answer to a case without times of jumps in which an effect that a fault trades with beside these explains the records, at
/// less cost. `timed` is the case with the times.
fn in_place_of_times(
    case: &Case<'_>,
    beside: &Answer,
    timed: &Case<'_>,
    settings: &FitSettings,
) -> Option<Diagnosis> {
    if beside.is_unexplained() || case.is_over() {
        return None;
    }
    let price = timed.timed?.price()?;
    let bound = |scale: f64| beside.model.cost(scale) + price - TOLD_APART;
    case.progress.begin("looking for what a fault trades with", [0.9, 0.95]);
    let model = beside.model.traded(timed, case, settings, bound)?;
    let suggested = Some(Suggested { model: &model, explanation: None });
    let case = Case { suggested, ..case.part([0.95, 1.0], "").another() };
    let answer = diagnose_in_noise(&case, settings);
    let scale = answer.model.scale();
    (!answer.is_unexplained() && answer.model.cost(scale) < bound(scale)).then_some(answer.diagnosis)
}

/// What those of the fitted records ask for whose commands do not jump, where there are any and the declared faults alone do
/// not explain them: that cannot be the doing of a jump. None where a computer may hold the commands: it may be the doing of
/// that. `curved` is the case in the reading that is asked.
fn asked_by_calm(case: &Case<'_>, curved: &Case<'_>, settings: &FitSettings) -> Option<Hypothesis> {
    let is_calm: Vec<bool> = curved.records.iter().map(|record| record.jumps().is_empty()).collect();
    let fitted = is_calm[..curved.fitted].iter().filter(|&&is_calm| is_calm).count();
    if fitted == 0 {
        return None;
    }
    let calm_of = |case: &Case<'_>| -> Vec<Prepared> {
        let calm = iter::zip(case.records, &is_calm).filter(|&(_, &is_calm)| is_calm);
        calm.map(|(record, _)| record.clone()).collect()
    };
    let calm = Case { records: &calm_of(curved), fitted, ..*curved };
    let declared = Declared::of(&calm, settings);
    if declared.root.leaves_noise(&calm) {
        return None;
    }
    if let Some(held) = fit::on_path(case.rig, &calm_of(case), CommandPath::Held) {
        let least = declared.root.joint.misfit.chi_square;
        if Declared::leaving_less(&calm.read_as(&held, ""), settings, least).is_some() {
            return None;
        }
    }
    let asked = declared.sketched(&calm);
    (!asked.added.is_empty()).then_some(asked)
}

#[cfg(test)]
mod tests {
    use super::super::jumps::Jumps;
    use super::super::signature::tests::{record, sine_and_stairs, with};
    use super::{Case, Declared, Hypothesis, asked_by_calm};
    use crate::fit::{self, FitSettings, Prepared};
    use crate::rig::{CommandPath, Rig};
    use eha_monitor::parameter::Parameter;

    /// Both explain records of stairs: times of the jumps with a friction that is far off, and an effect.
    #[test]
    fn times_of_jumps_do_not_stand_in_for_an_effect_that_a_fault_trades_with() {
        let rig = Rig::load("eha").unwrap();
        let traded = |mut truth: Rig| {
            (truth.parameters.bkl, truth.parameters.fdj) = (2e-4, 700.0);
            let records = sine_and_stairs(&truth).map(|record| record.along(&rig));
            let case = Case::new(&rig, &records, 1);
            let reading = fit::on_path(&rig, &records, CommandPath::Curve).unwrap();
            let curved = case.read_as(&reading, "");
            let settings = FitSettings::default();
            let timed = Jumps::of(&reading.records).unwrap().timed(
                &curved,
                |case| Declared::from_seeds(case, &settings, 1).root,
                Hypothesis::refitted,
            );
            let there = timed.case(&curved);
            assert!(timed.model.leaves_noise(&there));
            let found = timed.model.traded(&there, &case, &settings, |scale| timed.cost(scale).unwrap());
            (timed.model.joint.values[1], found)
        };
        let (friction, found) = traded(with(&rig, Parameter::SpoolOverlap, 16e-6));
        assert!(friction > 1500.0, "{friction}");
        let found = found.unwrap();
        assert_eq!(found.newest().unwrap().name, "spool-overlap");
        // It stands by its values to within their intervals, and does not make them wide enough for those that were timed.
        let (values, ranges) = (&found.joint.values, &found.ranges);
        let off =
            |index: usize, truth: f64| (values[index] - truth).abs() / found.joint.standard_error(index);
        let is = |parameter| ranges.iter().position(|range| range.parameter == parameter).unwrap();
        let [of_friction, of_overlap] = [is(Parameter::DryFriction), is(Parameter::SpoolOverlap)];
        assert!(off(of_friction, 700.0) < 3.0 && off(of_overlap, 16e-6) < 3.0, "{values:?}");
        assert!(off(of_friction, friction) > 3.0, "{friction}, {values:?}");
        // Where the command jumps between samples, nothing does.
        let (friction, found) = traded(Rig { command_path: CommandPath::Curve, ..rig.clone() });
        assert!((friction - 700.0).abs() < 50.0, "{friction}");
        assert!(found.is_none());
    }

    #[test]
    fn calm_records_of_a_command_that_a_computer_holds_ask_for_nothing() {
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 800.0);
        let asked = |records: &[Prepared]| {
            let case = Case::new(&rig, records, 1);
            let curve = fit::on_path(&rig, records, CommandPath::Curve).unwrap();
            let asked = asked_by_calm(&case, &case.read_as(&curve, ""), &FitSettings::default());
            asked.map(|asked| asked.added.iter().map(|effect| effect.name).collect::<Vec<_>>())
        };
        let loaded = with(&rig, Parameter::ConstantLoad, 500.0);
        assert_eq!(asked(&[record(&loaded)]), Some(vec!["constant-load"]));
        let held = record(&Rig { command_path: CommandPath::Held, ..loaded }).along(&rig);
        assert_eq!(asked(&[held]), None);
    }
}
