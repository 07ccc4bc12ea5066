//! Records taken in each way that a rig leaves open: paths of the command between samples, laws of the spool.

use super::case::Case;
use super::conclusion::{Open, conclude, helped_by_whole, helpful};
use super::diagnosis::{Diagnosis, Score, Verdict};
use super::hypothesis::{Hypothesis, beyond_noise};
use super::residual;
use super::search::{
    self, Class, ExplainedElsewhere, Explanation, FirstRound, Known, MOST_EFFECTS, Suggested,
};
use super::weighing::Earned;
use crate::fit::{self, BETTER_VALLEY, Fit, FitSettings, Polished, Prepared, Reading, TOLD_APART};
use crate::rig::{CommandPath, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::problem::Misfit;
use eha_monitor::parameter::Parameter;
use std::cell::OnceCell;
use std::{iter, ptr};

/// Chi-square between two readings of records that is no difference, whatever is found in them.
const NO_DIFFERENCE: f64 = 1.0;
/// A reading in which the declared faults leave so many times as much as in another one is not judged by what one effect makes
/// of it: the effect would have to look like the difference between the two (by a correlation of 0.87).
const FAR_BEHIND: f64 = 4.0;
/// Part of what the declared faults leave, squared, that two readings may differ by for the effects that are worth a fit in one
/// to be those of the other: a quarter of its swing.
const NEARLY_SAME: f64 = 1.0 / 16.0;
/// Seeds from which the declared faults are fitted where the first leaves more than noise.
pub(super) const ROOT_SEEDS: u64 = 8;
/// Effects of which as many are tried in other readings where that many leave more than noise in the likeliest one: this was
/// chosen by what one effect makes of each.
const EFFECTS_ELSEWHERE: usize = 2;
/// What is told while the declared faults are fitted.
pub(super) const DECLARED: &str = "fitting the declared faults";
/// What is told of a reading in which a computer holds the command from sample to sample.
const HELD: &str = ", command held";

/// A diagnosis, and the models behind it.
pub(super) struct Answer {
    pub(super) diagnosis: Diagnosis,
    pub(super) model: Hypothesis,
    /// What the fitted records alone speak for.
    asked: Hypothesis,
    /// The models of one effect at most that were tried.
    simple: Vec<Hypothesis>,
    explanation: Explanation,
}

impl Answer {
    pub(super) fn is_unexplained(&self) -> bool {
        self.diagnosis.is_unexplained()
    }

    /// Do the records speak for it against one in another reading? All of them; where both leave more than noise, the terms
    /// with which one of them is closer to the fitted records and to the held-out ones, or else what the fitted ones ask
    /// for: a command that jumps between samples may be what is left of the others.
    fn is_better_than(&self, other: &Self, scale: f64) -> bool {
        if !self.is_unexplained() || !other.is_unexplained() {
            return self.model.cost(scale) < other.model.cost(scale);
        }
        if self.helps_more_than(other) || other.helps_more_than(self) {
            return self.helps_more_than(other);
        }
        self.asked.cost_of_fitted(1.0) < other.asked.cost_of_fitted(1.0)
    }

    /// Are there terms with which it is closer than another one to the fitted records, and to the held-out ones?
    fn helps_more_than(&self, other: &Self) -> bool {
        let after = |[_, after]: [Score; 2]| after.position_rms();
        let [own, other] = [&self.diagnosis, &other.diagnosis];
        let held_out = own.holdout.zip(other.holdout);
        !own.found.is_empty()
            && after(own.train) < after(other.train)
            && held_out.is_some_and(|(own, other)| after(own) < after(other))
    }

    /// The model without the delay of the sensor that explains the records, or what looks like one; none where nothing of
    /// the kind does.
    fn without_delay(&self, case: &Case<'_>) -> Option<Hypothesis> {
        let is_delay = |effect: &&EffectInfo| effect.parameters == [Parameter::SensorDelay];
        let delay = self.diagnosis.found.iter().find(|found| found.class.iter().any(is_delay))?;
        (!self.is_unexplained()).then(|| self.model.without(case, delay.effect))
    }

    /// The model beside which the times of jumps are fitted: where it explains nothing, they may have been wrong for what
    /// the fitted records ask for.
    pub(super) fn to_be_timed(&self) -> &Hypothesis {
        if self.is_unexplained() { &self.asked } else { &self.model }
    }
}

/// Diagnoses a case whose noise is as it says.
///
/// Records do not say what a command does between its samples, nor a rig when its spool sticks: the likeliest of the
/// readings that the rig leaves open is taken (see [`Reading::all`]). What is missing may speak for the wrong one: where
/// one effect does not explain the records in it, the readings are judged again by the best that one effect makes of each, and
/// a command that a computer holds is one of them, if the declared faults leave less in it: unless a rival explains them, and
/// that one leaves no less. Where another one makes a difference to what is found in the one that is taken, and may be it as
/// well, it is tried too; also where nothing explains the records, and one effect leaves less of them in the other.
pub(super) fn diagnose_in_noise(case: &Case<'_>, settings: &FitSettings) -> Answer {
    case.progress.begin(DECLARED, [0.0, 0.05]);
    diagnose_beside(case, Declared::of(case, settings), settings)
}

/// The same where the declared faults are fitted in the reading of the case.
pub(super) fn diagnose_beside(case: &Case<'_>, declared: Declared, settings: &FitSettings) -> Answer {
    case.progress.begin(DECLARED, [0.0, 0.05]);
    let own = Read { case, declared };
    own.keep_root();
    let readings = Reading::all(case.rig, case.records);
    let cases: Vec<Case<'_>> = readings.iter().map(|reading| case.read_as(reading, "")).collect();
    let differs = |other: &&Case<'_>| readings_apart(&own.declared.root.rig, case, other) > NO_DIFFERENCE;
    let others: Vec<Read<'_>> =
        cases.iter().skip(1).filter(differs).map(|other| Read::of(other, settings)).collect();
    let mut read: Vec<Read<'_>> = iter::once(own).chain(others).collect();
    let misfits: Vec<Misfit<f64>> = read.iter().map(Read::misfit).collect();
    let mut likeliest = fit::speaks_for(&misfits);
    read[likeliest].keep_root();
    let first = read[likeliest].begun();
    read[likeliest].case.keep_models(first.models());
    let is_settled = case.rival.is_some_and(|rival| rival.settles(first));
    let (held, held_case);
    if !first.leaves_noise && !case.is_over() {
        held =
            fit::on_path(&case.rig.with_spool_of(read[likeliest].case.rig), case.records, CommandPath::Held);
        held_case = held.as_ref().map(|reading| case.read_as(reading, HELD));
        let least = misfits.iter().map(|misfit| misfit.chi_square).fold(f64::INFINITY, f64::min);
        read.extend(held_case.as_ref().and_then(|held| {
            let declared = Declared::leaving_less(held, settings, least)?;
            Some(Read { case: held, declared })
        }));
        let may_be_held = read.len() > misfits.len();
        if may_be_held || !is_settled {
            let best = |other: &Read<'_>| {
                let is_behind = other.misfit().chi_square > FAR_BEHIND * least;
                if is_behind { other.misfit() } else { other.begun_among(&read).best().joint.misfit }
            };
            likeliest = fit::speaks_for(&read.iter().map(best).collect::<Vec<_>>());
        }
    }
    answered(case, read, likeliest, settings)
}

/// The answer of the likeliest of the readings of a case, of another one in which the records are explained, or of what may
/// be it as well.
fn answered(case: &Case<'_>, mut read: Vec<Read<'_>>, likeliest: usize, settings: &FitSettings) -> Answer {
    let end = if read.len() == 1 { 1.0 } else { 0.6 };
    let mut here = read.swap_remove(likeliest);
    let (mut begin, mut asks_others) = (0.0, true);
    let answer = loop {
        let others = Others { read: &read, has_usual: !ptr::eq(here.case, case) };
        let others = if asks_others { others } else { Others::NONE };
        match diagnose_from(&here.case.part([begin, end], ""), &here.declared, others, settings) {
            Ok(answer) => break answer,
            Err(ExplainedElsewhere(place)) => {
                read.push(here);
                here = read.swap_remove(place);
                // Once: the records are not taken to and fro.
                (begin, asks_others) = (0.5 * end, false);
            }
        }
    };
    case.keep_answer(&answer.diagnosis);
    or_in_another(case, answer, here.case, read, settings)
}

/// An answer in one reading of a case, or that in the one of the others which may be it as well.
fn or_in_another(
    case: &Case<'_>,
    mut answer: Answer,
    here: &Case<'_>,
    others: Vec<Read<'_>>,
    settings: &FitSettings,
) -> Answer {
    let is_unexplained = answer.is_unexplained();
    let Answer { diagnosis, model: best, simple, explanation, .. } = &mut answer;
    let scale = best.scale();
    let mut rivals = Vec::new();
    for Read { case: there, declared } in others {
        let mut moved = best.moved_to(there);
        // The usual reading is not given up for a valley in which it is not at its best.
        if ptr::eq(there, case) && !is_unexplained {
            moved = moved.settled(there);
        }
        let is_open = !best.is_likelier(&moved);
        if is_open && !is_unexplained {
            diagnosis.hold(&moved.estimates(there));
        }
        let differs = readings_apart(&best.rig, here, there) >= TOLD_APART * scale;
        if differs && (is_open || is_unexplained) {
            rivals.push(Elsewhere { moved, is_open, case: there, declared });
        }
    }
    let is_usual = |there: &Elsewhere<'_>| there.is_open && !is_unexplained && ptr::eq(there.case, case);
    let price = |there: &Elsewhere<'_>| {
        if is_usual(there) { f64::NEG_INFINITY } else { there.moved.cost(scale) }
    };
    let Some(there) = rivals.into_iter().min_by(|a, b| price(a).total_cmp(&price(b))) else { return answer };
    if diagnosis.verdict == Verdict::Adequate || case.is_over() {
        return answer;
    }
    let is_usual = is_usual(&there);
    let Elsewhere { moved, is_open, case: there, declared } = there;
    let explanation = (!is_unexplained).then_some(&*explanation);
    let suggested = is_open.then_some(Suggested { model: &moved, explanation });
    let there = Case { suggested, ..there.part([0.6, 1.0], ", in another reading").another().unkept() };
    if !is_open && !leaves_less(declared.begun(&there), simple, scale) {
        return answer;
    }
    let Ok(mut other) = diagnose_from(&there, &declared, Others::NONE, settings) else { return answer };
    if is_usual && !other.is_unexplained() {
        // What the records do not tell from the usual reading is no reason to take them in another one.
        let gain = answer.model.cost(scale) - other.model.cost(scale);
        if gain < -TOLD_APART {
            return answer;
        }
        if gain < TOLD_APART {
            other.diagnosis.hold(&answer.model.estimates(here));
        }
        return other;
    }
    if other.is_better_than(&answer, scale) { other } else { answer }
}

/// What another reading of some records makes of an answer.
struct Elsewhere<'a> {
    /// Its model, fitted there.
    moved: Hypothesis,
    /// May that be it as well?
    is_open: bool,
    case: &'a Case<'a>,
    declared: Declared,
}

/// The answer to a case whose commands a computer holds from sample to sample, which is half a sample of delay, where that
/// explains the records in place of a delay of the sensor.
pub(super) fn diagnose_held(case: &Case<'_>, without: &Answer, settings: &FitSettings) -> Option<Answer> {
    let model = without.without_delay(case)?;
    let reading = fit::on_path(case.rig, case.records, CommandPath::Held)?;
    let held = case.read_as(&reading, HELD).another();
    held.progress.begin("fitting it without the delay", [0.0, 0.05]);
    if case.is_over() || !model.refitted(&held).leaves_noise(&held) {
        return None;
    }
    let answer = diagnose_in_noise(&held, settings);
    let scale = search::least_scale([&answer.model, &without.model].into_iter());
    let is_cheaper = answer.model.cost(scale) < without.model.cost(scale);
    (!answer.is_unexplained() && is_cheaper).then_some(answer)
}

/// Does one of the first models in a reading leave less than all of some in another, of all records or of the fitted ones?
fn leaves_less(some: &FirstRound, others: &[Hypothesis], scale: f64) -> bool {
    let least = |costs: &mut dyn Iterator<Item = f64>| costs.fold(f64::INFINITY, f64::min);
    [Hypothesis::cost, Hypothesis::cost_of_fitted].iter().any(|cost| {
        let [here, there] = [
            least(&mut some.models().map(|model| cost(model, scale))),
            least(&mut others.iter().map(|model| cost(model, scale))),
        ];
        here < there
    })
}

/// Chi-square between what a model predicts for records in two readings.
fn readings_apart(rig: &Rig, one: &Case<'_>, other: &Case<'_>) -> f64 {
    let [one, other] = [one, other].map(|case| {
        residual::in_noise(case.records, &fit::glimpse(&rig.with_spool_of(case.rig), case.records))
    });
    (one - other).norm_squared()
}

/// The declared faults, fitted to the records of a case.
pub(super) struct Declared {
    fit: Fit,
    pub(super) root: Hypothesis,
    /// The first round of the search beside them, once it was asked for.
    begun: OnceCell<FirstRound>,
}

impl Declared {
    pub(super) fn of(case: &Case<'_>, settings: &FitSettings) -> Self {
        Self::from_seeds(case, settings, ROOT_SEEDS)
    }

    /// The best of searches from so many seeds.
    pub(super) fn from_seeds(case: &Case<'_>, settings: &FitSettings, seeds: u64) -> Self {
        Self::of_fit(case, Self::fit(case, case.train(), settings, seeds), settings, seeds)
    }

    /// Those that such searches found in the fitted records of a case.
    pub(super) fn of_fit(case: &Case<'_>, fit: Fit, settings: &FitSettings, seeds: u64) -> Self {
        let mut root = Hypothesis::root(case, &fit, case.rig.declared());
        if root.is_in_doubt() {
            root = root.or_in_valley_of_all(case, &Self::fit(case, case.records, settings, seeds));
        }
        Self { fit, root, begun: OnceCell::new() }
    }

    /// Their best fit to some records of a case, of searches from so many seeds.
    pub(super) fn fit(case: &Case<'_>, records: &[Prepared], settings: &FitSettings, seeds: u64) -> Fit {
        let watch = |standing| case.progress.searched(standing);
        fit::fit_from_seeds(case.rig, &case.rig.declared(), records, settings, seeds, watch)
    }

    /// Those of a case, searched from one seed, if they leave less of all its records than a bound.
    pub(super) fn leaving_less(case: &Case<'_>, settings: &FitSettings, bound: f64) -> Option<Self> {
        let declared = Self::from_seeds(case, settings, 1);
        (declared.root.joint.misfit.chi_square < bound).then_some(declared)
    }

    /// The first round of the search beside them. Long records are searched in excerpts.
    fn begun(&self, case: &Case<'_>) -> &FirstRound {
        self.begun_or(case, || None)
    }

    /// The same; where it has not begun, with the models of another case that differs little, if there is one.
    fn begun_or<'b>(&self, case: &Case<'_>, known: impl FnOnce() -> Option<&'b FirstRound>) -> &FirstRound {
        self.begun.get_or_init(|| {
            let excerpts = case.excerpts();
            let searched = case.searched(excerpts.as_deref());
            if let Some(known) = known() {
                return known.moved_to(&searched);
            }
            let root = if excerpts.is_some() { self.root.refitted(&searched) } else { self.root.clone() };
            FirstRound::of(&searched, root)
        })
    }

    /// The best model that a short search beside them finds; see [`search::sketch`].
    pub(super) fn sketched(&self, case: &Case<'_>) -> Hypothesis {
        let excerpts = case.excerpts();
        search::sketch(&case.searched(excerpts.as_deref()), self.begun(case).clone(), MOST_EFFECTS)
    }
}

/// A reading of some records.
struct Read<'a> {
    case: &'a Case<'a>,
    declared: Declared,
}

impl<'a> Read<'a> {
    fn of(case: &'a Case<'a>, settings: &FitSettings) -> Self {
        Self { case, declared: Declared::of(case, settings) }
    }

    /// What the declared faults leave of all records.
    fn misfit(&self) -> Misfit<f64> {
        self.declared.root.joint.misfit
    }

    /// Keeps the model with the declared faults alone, if that is kept of its case.
    fn keep_root(&self) {
        self.case.keep_reading(&self.declared.fit, &self.declared.root);
    }

    fn begun(&self) -> &FirstRound {
        self.declared.begun(self.case)
    }

    /// The first round of the search. Where it is known of a reading that is nearly the same, the effects that were found worth a
    /// fit there are fitted here.
    fn begun_among(&self, readings: &[Self]) -> &FirstRound {
        self.declared.begun_or(self.case, || {
            readings.iter().find_map(|other| other.declared.begun.get().filter(|_| self.is_nearly(other)))
        })
    }

    /// Do the declared faults predict nearly the same in another reading, measured by what they leave there?
    fn is_nearly(&self, other: &Self) -> bool {
        let left = beyond_noise(&other.misfit()).unwrap_or(0.0);
        readings_apart(&other.declared.root.rig, other.case, self.case) <= NEARLY_SAME * left
    }

    /// Do a few effects leave noise?
    fn is_explained(&self) -> bool {
        !self.case.is_over()
            && search::sketch(self.case, self.begun().clone(), EFFECTS_ELSEWHERE).leaves_noise(self.case)
    }
}

/// Other readings of the records of a search.
struct Others<'a> {
    /// They, the usual one first, if it is one of them.
    read: &'a [Read<'a>],
    has_usual: bool,
}

impl Others<'_> {
    const NONE: Self = Self { read: &[], has_usual: false };

    /// The place of one in which the effects of a model that leaves more than noise in its own reading, after so many rounds
    /// of effects, leave noise, or others do. One effect may be missing so that another seems to speak for a reading; the
    /// records are read by one effect before. The usual one is asked what others do there before anything is looked for, the
    /// rest when two effects were found.
    fn explain(&self, best: &Hypothesis, rounds: usize, case: &Case<'_>) -> Option<usize> {
        if best.leaves_noise(case) {
            return None;
        }
        let moved = |there: &Read<'_>| best.moved_to(there.case).leaves_noise(there.case);
        let by_itself =
            if best.added.len() >= EFFECTS_ELSEWHERE { self.read.iter().position(moved) } else { None };
        let usual = usize::from(self.has_usual);
        let mut places = match rounds {
            0 => 0..usual,
            EFFECTS_ELSEWHERE => usual..self.read.len(),
            _ => 0..0,
        };
        by_itself.or_else(|| places.find(|&place| self.read[place].is_explained()))
    }
}

/// Diagnoses a case whose declared faults are fitted. A model beside which the times of its jumps were fitted is one of
/// those that are weighed.
///
/// # Errors
/// The effects that were found leave noise in one of some other readings, and more here.
fn diagnose_from(
    case: &Case<'_>,
    declared: &Declared,
    others: Others<'_>,
    settings: &FitSettings,
) -> Result<Answer, ExplainedElsewhere> {
    let begun = declared.begun(case).clone();
    case.keep_reading(&declared.fit, &declared.root);
    case.keep_models(begun.models());
    let mut before = declared.fit.clone();
    // What is found in excerpts is then fitted to the whole.
    let excerpts = case.excerpts();
    let in_excerpts = excerpts.is_some();
    let searched = case.searched(excerpts.as_deref());
    let known = case.timed.map(|timed| timed.model.clone()).filter(|known| !known.added.is_empty());
    let model = known.map(|model| if in_excerpts { model.refitted(&searched) } else { model });
    let known = Known { model, suggested: case.suggested };
    let others = if in_excerpts { Others::NONE } else { others };
    let elsewhere = |best: &Hypothesis, rounds| others.explain(best, rounds, &searched);
    let sound = search::search(&searched, begun, known, elsewhere, settings)?;
    let Hypothesis { ranges, train: Polished { values, .. }, .. } = &sound.root;
    let there = fit::misfit(case.rig, ranges, values, case.train());
    if there.chi_square < before.misfit.chi_square - BETTER_VALLEY {
        before = fit::fit_near(case.rig, ranges, values, case.train(), settings, |_| {});
    }
    let in_whole = |model: &Hypothesis| if in_excerpts { model.refitted(case) } else { model.clone() };
    let whole = in_whole(&sound.best);
    let whole = if whole.leaves_noise(case) { whole.settled(case) } else { whole };
    let named = whole.is_name(case, &before.applied(case.rig));
    let (whole, earned, stand_ins) = if named {
        (whole, sound.earned, sound.stand_ins)
    } else {
        let (whole, earned) = helpful(case, &before, || in_whole(&sound.root), whole, sound.earned);
        let (whole, earned) =
            if in_excerpts { helped_by_whole(case, whole, earned) } else { (whole, earned) };
        let none = vec![Vec::new(); earned.len()];
        (whole, earned, none)
    };
    let open = Open { named, stand_ins, confounded: sound.confounded };
    let diagnosis = conclude(case, before, &whole, &earned, &open);
    let class = |(earned, others): (Earned, Vec<Hypothesis>)| Class { effect: earned.effect, others };
    let classes = iter::zip(earned, open.stand_ins).map(class).collect();
    let explanation = Explanation { classes, confounded: open.confounded };
    Ok(Answer { diagnosis, model: whole, asked: sound.asked, simple: sound.simple, explanation })
}

#[cfg(test)]
mod tests {
    use super::super::signature::tests::{record, with};
    use super::{Answer, Case, Declared, Others, Read, Suggested, diagnose_from};
    use crate::fit::{self, FitSettings};
    use crate::rig::{CommandPath, Rig};
    use eha_monitor::parameter::Parameter;

    #[test]
    fn a_reading_that_is_nearly_the_same_is_judged_by_the_effects_of_the_other() {
        let rig = Rig::load("eha").unwrap();
        let mut truth = with(&rig, Parameter::ConstantLoad, 500.0);
        (truth.parameters.bkl, truth.parameters.fdj) = (2e-4, 800.0);
        let records = [record(&truth)];
        let paths = [CommandPath::Curve, CommandPath::Held];
        let others = paths.map(|path| fit::on_path(&rig, &records, path).unwrap());
        let lines = Case::new(&rig, &records, 1);
        let [curve, held] = others.each_ref().map(|other| lines.read_as(other, ""));
        let settings = FitSettings::default();
        let [lines, curve, held] = [&lines, &curve, &held]
            .map(|case| Read { case, declared: Declared::from_seeds(case, &settings, 1) });
        assert!(curve.is_nearly(&lines) && !held.is_nearly(&lines));

        let spent = |read: &Read<'_>, known: &[Read<'_>]| {
            let before = fit::spent_s(&records);
            let best = read.begun_among(known).best().newest().unwrap().name;
            (best, fit::spent_s(&records) - before)
        };
        let (best, of_catalogue) = spent(&lines, &[]);
        assert_eq!(best, "constant-load");
        let known = [lines];
        let (best, of_known) = spent(&curve, &known);
        assert_eq!(best, "constant-load");
        assert!(of_known < 0.2 * of_catalogue, "{of_known} of {of_catalogue}");
        // What differs is looked at by itself.
        let (_, by_itself) = spent(&held, &known);
        assert!(by_itself > of_catalogue, "{by_itself} of {of_catalogue}");
    }

    #[test]
    fn what_explains_the_records_in_another_reading_is_taken_over_from_there() {
        let rig = Rig::load("eha").unwrap();
        let settings = FitSettings::default();
        let answer = |case: &Case<'_>, suggested: Option<Suggested<'_>>| -> (Answer, f64) {
            let case = Case { suggested, ..case.part([0.0, 1.0], "") };
            let declared = Declared::from_seeds(&case, &settings, 1);
            declared.begun(&case);
            let before = fit::spent_s(case.records);
            let Ok(answer) = diagnose_from(&case, &declared, Others::NONE, &settings) else { unreachable!() };
            (answer, fit::spent_s(case.records) - before)
        };
        let classes = |answer: &Answer| -> Vec<Vec<&str>> {
            let found = &answer.diagnosis.found;
            found.iter().map(|found| found.class.iter().map(|effect| effect.name).collect()).collect()
        };
        let compared = |parameter, size| {
            let records = [record(&with(&rig, parameter, size))];
            let curve = fit::on_path(&rig, &records, CommandPath::Curve).unwrap();
            let lines = Case::new(&rig, &records, 1);
            let curve = lines.read_as(&curve, "");
            let (in_lines, _) = answer(&lines, None);
            let suggested = Suggested { model: &in_lines.model, explanation: Some(&in_lines.explanation) };
            let (anew, spent) = answer(&curve, None);
            let (taken_over, spent_less) = answer(&curve, Some(suggested));
            (classes(&in_lines), classes(&anew), classes(&taken_over), spent_less / spent)
        };
        let (there, anew, taken_over, spent) = compared(Parameter::ConstantLoad, 500.0);
        assert_eq!(there, [["constant-load", "step-load"]]);
        assert!(taken_over == there && anew == there && spent < 0.2, "{taken_over:?}, {anew:?}, {spent}");
        // Another effect explains them better here.
        let (there, anew, taken_over, spent) = compared(Parameter::Leakage, 1e-11);
        assert_eq!((&there[0][0], &anew[0][0]), (&"pressure-gain", &"leakage"));
        assert!(taken_over == anew && spent > 0.9, "{taken_over:?}, {spent}");
    }
}
