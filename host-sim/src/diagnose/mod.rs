//! Closing the loop: from a residual to a named missing effect, or to an honest "I cannot tell".
//!
//! ```text
//! fit the declared faults
//!        |
//!        v
//! look at every effect of the catalogue beside them (linear), fit the promising ones --> evidence
//!        |
//!        v
//! keep the best few hypotheses, grow each by another effect, until one leaves noise or nothing helps (up to five)
//!        |
//!        v
//! none leaves noise: search faults and one effect anew in all of their ranges (genetic), grow what is better
//!        |
//!        v
//! drop what does not earn its place beside the others: significant, matters, validates on the held-out records
//!        |
//!        v
//! which effects could stand in for each that is left? --> its class, or its place
//! residual noise? adequate or explained : unexplained
//!        |
//!        v
//! not adequate: do commands that jump between samples explain it better? Then anew, with that
//!        |
//!        v
//! unexplained: is it noise if the noise is coloured? Then anew, with that
//! ```

mod candidate;
mod hypothesis;
mod jumps;
mod place;
pub mod progress;
pub mod residual;
mod ripple;
mod search;
mod signature;
mod weighing;

use crate::fit::{self, BETTER_VALLEY, Estimate, Fit, FitSettings, Polished, Prepared, Reading, TOLD_APART};
use crate::interrupt;
use crate::rig::{CommandPath, Rig};
use candidate::Candidate;
use eha_monitor::channel::Channel;
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::problem::Misfit;
use eha_monitor::model::state::Outputs;
use hypothesis::Hypothesis;
use jumps::{Jumps, Timed};
use progress::{Log, Progress, Watch};
use residual::{Description, MEASURED};
use std::iter;
use weighing::Earned;

/// Chi-square between two readings of records that is no difference, whatever is found in them.
const NO_DIFFERENCE: f64 = 1.0;
/// Seeds from which the declared faults are fitted where the first leaves more than noise.
const ROOT_SEEDS: u64 = 8;
/// Standard deviations of the residual tests: with four channels, a chance of 1e-4 of a false alarm.
const RESIDUAL_LIMIT: f64 = 5.0;

/// How often jumps are timed beside effects that are then found to be others.
const MOST_TIMED: usize = 3;
/// What is told of a diagnosis that takes them to be there.
const JUMPING: &str = ", command jumps between samples";

/// What the data say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The declared faults explain the records down to the noise.
    Adequate,
    /// With the added effects, the residual is noise.
    Explained,
    /// Something is left that no effect of the catalogue explains.
    Unexplained,
}

impl Verdict {
    /// Name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Adequate => "adequate",
            Self::Explained => "explained",
            Self::Unexplained => "unexplained",
        }
    }
}

/// An effect that was added to the model.
#[derive(Clone, Debug)]
pub struct Found {
    /// The effect that fits best.
    pub effect: &'static EffectInfo,
    /// All effects that these records cannot tell from it, itself first.
    pub class: Vec<&'static EffectInfo>,
    /// Twice the logarithm of the odds against the model without it.
    pub evidence: f64,
    /// Does it, with those before it, explain the better part of the misfit, or do fitted and held-out records, each for
    /// itself, give it the same size? If not it is a help for prediction, not a name for what is there.
    pub named: bool,
    /// Its parameters, as the last fit has them.
    pub estimates: Vec<Estimate>,
}

/// Misfit of a model on records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Root mean square of the user position's residual, m.
    pub position_rms: f64,
}

/// A fault, and what it is mixed up with.
#[derive(Clone, Debug)]
pub struct Fault {
    /// Its estimate.
    pub estimate: Estimate,
    /// Effects whose presence would leave it undetermined.
    pub confounded_with: Vec<&'static EffectInfo>,
}

/// The answer.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Was it interrupted? What was not tried by then is not ruled out.
    pub interrupted: bool,
    /// The faults before any effect was added.
    pub before: Fit,
    /// The declared faults at the end.
    pub faults: Vec<Fault>,
    /// The other parameters that the rig declares free, at the end.
    pub free: Vec<Estimate>,
    /// Effects that were added.
    pub found: Vec<Found>,
    /// Noise of each measured channel, rms over the fitted records.
    pub noise: [f64; MEASURED],
    /// What neighbouring samples of each measured channel share of it: 0 where it is white.
    pub colour: [f64; MEASURED],
    /// Training records, before and after.
    pub train: [Score; 2],
    /// Held-out records, before and after; none where there are none.
    pub holdout: Option<[Score; 2]>,
    /// Do the fitted records leave so much open that the held-out ones are predicted worse than their noise, although the
    /// model explains them all together?
    pub is_open: bool,
    /// The final model.
    pub rig: Rig,
    /// Its prediction of the training records.
    pub predictions: Vec<Vec<Outputs<f64>>>,
    /// What is left, where the verdict is unexplained.
    pub left: Option<Description>,
    /// The records as they were compared: the fitted ones, then those that were held out.
    pub records: Vec<Prepared>,
    /// When the command of each record jumps, s after its first sample, where that was found to be between two samples.
    pub jumps: Option<Vec<Vec<f64>>>,
}

impl Diagnosis {
    /// The verdict for a person.
    pub fn verdict_in_words(&self) -> String {
        let so_far = self.interrupted && self.verdict == Verdict::Unexplained;
        format!("{}{}", self.verdict.name(), if so_far { " so far (interrupted)" } else { "" })
    }

    /// Widens the intervals to hold those of the same model on another path of the command, which may be it as well.
    fn hold(&mut self, others: &[Estimate]) {
        let of_faults = self.faults.iter_mut().map(|fault| &mut fault.estimate);
        let of_effects = self.found.iter_mut().flat_map(|found| &mut found.estimates);
        for estimate in of_faults.chain(&mut self.free).chain(of_effects) {
            if let Some(other) = others.iter().find(|other| other.parameter == estimate.parameter) {
                estimate.hold(other);
            }
        }
    }
}

/// What a diagnosis works on.
pub struct Case<'a> {
    /// The rig, with declared faults and free parameters.
    pub rig: &'a Rig,
    /// The records: those that are fitted first, then those that are held out.
    pub records: &'a [Prepared],
    /// How many of them are fitted.
    pub fitted: usize,
    /// Channels whose noise the rig states.
    pub known_noise: [Option<f64>; MEASURED],
    /// What a prediction of each channel may be off without anything being missing: the model's own error, and what is
    /// lost to the steps in which the commands were recorded and the sensors are read.
    pub model_error: [f64; MEASURED],
    /// The jumps of their commands, and the model beside which their times were fitted, where they were.
    timed: Option<&'a Timed>,
    /// Whom it tells where it stands.
    progress: Progress<'a>,
}

impl<'a> Case<'a> {
    /// The same with another rig that reads the records in the same way.
    fn under<'b>(&self, rig: &'b Rig) -> Case<'b>
    where
        'a: 'b,
    {
        Case { rig, ..*self }
    }

    /// Tells that a candidate was fitted, if that led anywhere.
    fn told(&self, candidate: Option<Candidate>) -> Option<Candidate> {
        self.progress.fitted(candidate.as_ref().map(|new| new.fit.misfit.mean_square().sqrt()));
        candidate
    }

    /// The same as a part of a diagnosis, between two shares of it, that takes the records in some way.
    fn part(&self, range: [f64; 2], reading: &'static str) -> Self {
        Case { progress: self.progress.part(range, reading), ..*self }
    }

    /// A case of records that are ready for a rig, of which the first ones are fitted.
    pub fn new(rig: &'a Rig, records: &'a [Prepared], fitted: usize) -> Self {
        let error = |channel: usize| {
            let lost = records.iter().map(|record| record.lost[channel]).fold(0.0, f64::max);
            // The sensor is the same in all of them: the one that shows most of its noise tells what that leaves of its
            // steps. One in which it rests on a step shows none.
            let by_steps = records.iter().map(|record| record.off_by_steps[channel]);
            let by_steps = by_steps.filter(|&off| off > 0.0).reduce(f64::min).unwrap_or(0.0);
            fit::MODEL_ERROR[channel].hypot(lost).hypot(by_steps)
        };
        Self {
            rig,
            records,
            fitted,
            known_noise: Channel::MEASURED.map(|channel| rig.noise_of(channel)),
            model_error: std::array::from_fn(error),
            timed: None,
            progress: Progress::SILENT,
        }
    }

    /// Records that are fitted.
    pub fn train(&self) -> &'a [Prepared] {
        &self.records[..self.fitted]
    }

    /// Records that are only predicted.
    pub fn holdout(&self) -> &'a [Prepared] {
        &self.records[self.fitted..]
    }

    /// The records with excerpts in place of the long ones; none where all are short.
    fn excerpts(&self) -> Option<Vec<Prepared>> {
        let excerpts: Vec<Option<Prepared>> = self.records.iter().map(Prepared::excerpt).collect();
        let or_whole =
            |(excerpt, whole): (Option<Prepared>, &Prepared)| excerpt.unwrap_or_else(|| whole.clone());
        let is_any = excerpts.iter().any(Option::is_some);
        is_any.then(|| excerpts.into_iter().zip(self.records).map(or_whole).collect())
    }

    /// The case to search in: with the excerpts in place of the records, if there are any.
    fn searched<'b>(&self, excerpts: Option<&'b [Prepared]>) -> Case<'b>
    where
        'a: 'b,
    {
        Case { records: excerpts.unwrap_or(self.records), timed: None, ..*self }
    }

    /// Do predictions of all records leave no more than noise of them?
    fn is_noise_left(&self, predictions: &[Vec<Outputs<f64>>]) -> bool {
        let (train, holdout) = predictions.split_at(self.fitted);
        self.is_noise_left_of(self.train(), train) && self.is_noise_left_of(self.holdout(), holdout)
    }

    /// Do predictions of some of them?
    fn is_noise_left_of(&self, records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> bool {
        let residuals = residual::of_channels(records, predictions);
        residuals.iter().enumerate().all(|(channel, residual)| {
            residual.is_none_or(|residual| {
                residual.is_noise(self.model_error[channel], self.known_noise[channel], RESIDUAL_LIMIT)
            })
        })
    }
}

/// Diagnoses a case. `watch` is told where it stands.
///
/// Commands are taken to jump at samples, and noise for white, first. Jumps between two samples may be the truth; where
/// something is left, noise that is coloured, as its spectrum where no actuator follows tells. What explains more is the
/// answer.
pub fn diagnose(case: &Case<'_>, settings: &FitSettings, watch: Watch<'_>) -> Diagnosis {
    let log = Log::new(watch);
    let case = &Case { progress: Progress::of(&log), ..*case };
    let answer = diagnose_in_noise(&case.part([0.0, 0.7], ""), settings);
    if interrupt::requested() {
        return answer.diagnosis;
    }
    // What explains the records says how they are to be read.
    let rig =
        if answer.is_unexplained() { case.rig.clone() } else { case.rig.with_spool_of(&answer.model.rig) };
    let between = diagnose_with_jumps(&case.under(&rig).part([0.7, 0.9], JUMPING), &answer, settings);
    let is_unexplained = answer.is_unexplained();
    let mut diagnosis = answer.diagnosis;
    match between {
        Between::Found(other) if is_unexplained || other.verdict != Verdict::Unexplained => {
            diagnosis = *other;
        }
        Between::Open(estimates) if !is_unexplained => diagnosis.hold(&estimates),
        _ => {}
    }
    if diagnosis.verdict != Verdict::Unexplained || interrupt::requested() {
        return diagnosis;
    }
    let colour: [f64; MEASURED] = std::array::from_fn(|channel| {
        fit::colour_of(&residual::series(case.train(), &diagnosis.predictions, channel))
    });
    if colour == [0.0; MEASURED] {
        return diagnosis;
    }
    let is_known = case.known_noise.map(|noise| noise.is_some());
    // A filter shares less over a longer period.
    let period = case.train()[0].sample_period;
    let colour_at = |other: f64| colour.map(|shared| shared.powf(other / period));
    let records: Vec<Prepared> = case
        .records
        .iter()
        .map(|record| record.coloured(colour_at(record.sample_period), is_known))
        .collect();
    let known_noise = std::array::from_fn(|channel| {
        case.known_noise[channel].map(|noise| noise * fit::as_white(colour[channel]))
    });
    let coloured = Case { records: &records, known_noise, ..case.part([0.9, 1.0], ", coloured noise") };
    let other = diagnose_in_noise(&coloured, settings);
    if other.is_unexplained() { diagnosis } else { other.diagnosis }
}

/// A diagnosis, and the models behind it.
struct Answer {
    diagnosis: Diagnosis,
    model: Hypothesis,
    /// What the fitted records alone speak for.
    asked: Hypothesis,
    /// The models of one effect at most that were tried.
    simple: Vec<Hypothesis>,
}

impl Answer {
    fn is_unexplained(&self) -> bool {
        self.diagnosis.verdict == Verdict::Unexplained
    }

    /// Do the records speak for it against one in another reading? All of them, or the fitted ones where both leave more
    /// than noise: a command that jumps between samples may be what is left of the others.
    fn is_better_than(&self, other: &Self, scale: f64) -> bool {
        if self.is_unexplained() && other.is_unexplained() {
            self.asked.cost_of_fitted(1.0) < other.asked.cost_of_fitted(1.0)
        } else {
            self.model.cost(scale) < other.model.cost(scale)
        }
    }

    /// The model beside which the times of jumps are fitted: where it explains nothing, they may have been wrong for what
    /// the fitted records ask for.
    fn to_be_timed(&self) -> &Hypothesis {
        if self.is_unexplained() { &self.asked } else { &self.model }
    }
}

/// What records say of commands that jump between samples.
enum Between {
    /// That there are none, or that they jump at samples.
    No,
    /// That these may be: what is free would be this.
    Open(Vec<Estimate>),
    /// That these are: the answer with them.
    Found(Box<Diagnosis>),
}

/// Diagnoses a case whose commands jump between samples, if they do: if that explains more than the model that was found
/// without it.
fn diagnose_with_jumps(case: &Case<'_>, without: &Answer, settings: &FitSettings) -> Between {
    let is_curve = case.rig.command_path == CommandPath::Curve;
    let as_it_is = || is_curve.then(|| Reading { rig: case.rig.clone(), records: case.records.to_vec() });
    let Some(Reading { rig, records }) = fit::curved(case.rig, case.records).or_else(as_it_is) else {
        return Between::No;
    };
    let curved = &Case { rig: &rig, records: &records, ..*case };
    let Some(jumps) = Jumps::of(&records) else { return Between::No };
    let beside = |model: &Hypothesis| {
        let rig = rig.with_spool_of(&model.rig);
        let moved = |case: &Case<'_>| model.refitted(case);
        jumps.timed(&curved.under(&rig), moved, |_, case| moved(case))
    };
    let found = &without.model;
    let asked = Some(without.to_be_timed()).filter(|asked| !asked.same_effects(found));
    let models = iter::once(found).chain(asked).filter(|model| !model.added.is_empty());
    // Wherever the jumps are in their samples, the faults are near where they are without the answers to them, or where
    // they were with jumps at samples.
    let roots: Vec<&Hypothesis> = without.simple.iter().filter(|model| model.added.is_empty()).collect();
    let moved = |start: &Hypothesis, case: &Case<'_>| {
        let refits = roots.iter().copied().chain([start]).map(|root| root.refitted(case));
        refits.min_by(hypothesis::lower).unwrap_or_else(|| start.clone())
    };
    curved.progress.begin("timing the jumps", [0.0, 0.2]);
    let alone = jumps.timed(curved, |case| Declared::of(case, settings).root, moved);
    curved.progress.begin("timing the jumps beside what was found", [0.2, 0.4]);
    let timed: Vec<Timed> = iter::once(alone).chain(models.map(beside)).collect();
    let scale = timed.iter().map(|timed| timed.model.scale()).fold(found.scale(), f64::min);
    let cost = |timed: &Timed| Some(timed.model.cost(scale) + timed.price()?);
    let best = timed.into_iter().filter_map(|timed| Some((cost(&timed)?, timed)));
    let Some((mut least, mut best)) = best.min_by(|(a, _), (b, _)| a.total_cmp(b)) else {
        return Between::No;
    };
    let gain = found.cost(scale) - least;
    if gain.abs() <= TOLD_APART && found.same_effects(&best.model) {
        return Between::Open(best.model.estimates(&best.case(curved), None));
    }
    if gain <= TOLD_APART {
        return Between::No;
    }
    let mut turn = 1;
    loop {
        let answer = diagnose_in_noise(&best.case(curved).part([0.4, 1.0], ""), settings);
        let next = answer.to_be_timed();
        let is_same = next.same_effects(&best.model)
            && next.rig.has_sticking_spool() == best.model.rig.has_sticking_spool();
        let is_last = turn == MOST_TIMED || is_same || interrupt::requested();
        let next = (!is_last).then(|| beside(next));
        let better = next.and_then(|next| Some((cost(&next)?, next))).filter(|(cost, _)| *cost < least);
        let Some(better) = better else {
            let jumps = Some(best.jumps.times(&records));
            return Between::Found(Box::new(Diagnosis { jumps, ..answer.diagnosis }));
        };
        (least, best) = better;
        turn += 1;
    }
}

/// Diagnoses a case whose noise is as it says.
///
/// Records do not say what a command does between its samples, nor a rig when its spool sticks: the likeliest of the
/// readings that the rig leaves open is taken (see [`Reading::all`]). Where another one makes a difference to what is found
/// in that, and may be it as well, it is tried too; also where nothing explains the records in the first, and one effect
/// leaves less of them in the other: what was missing may have spoken for the wrong one.
fn diagnose_in_noise(case: &Case<'_>, settings: &FitSettings) -> Answer {
    case.progress.begin("fitting the declared faults", [0.0, 0.05]);
    let own = Declared::of(case, settings);
    let readings = Reading::all(case.rig, case.records);
    let cases: Vec<Case<'_>> =
        readings.iter().map(|Reading { rig, records }| Case { rig, records, ..*case }).collect();
    let differs = |other: &&Case<'_>| readings_apart(&own.root.rig, case, other) > NO_DIFFERENCE;
    let others: Vec<(&Case<'_>, Declared)> =
        cases.iter().skip(1).filter(differs).map(|other| (other, Declared::of(other, settings))).collect();
    let mut read: Vec<(&Case<'_>, Declared)> = iter::once((case, own)).chain(others).collect();
    if read.len() == 1 {
        return diagnose_from(case, read.remove(0).1, settings);
    }
    let misfits: Vec<Misfit<f64>> = read.iter().map(|(_, declared)| declared.root.joint.misfit).collect();
    let (here, declared) = read.swap_remove(fit::speaks_for(&misfits));
    let mut answer = diagnose_from(&here.part([0.0, 0.6], ""), declared, settings);
    let is_unexplained = answer.is_unexplained();
    let Answer { diagnosis, model: best, simple, .. } = &mut answer;
    let scale = best.scale();
    let mut rivals = Vec::new();
    for (there, declared) in read {
        let moved = best.refitted(there);
        let is_open = !best.is_likelier(&moved);
        if is_open && !is_unexplained {
            diagnosis.hold(&moved.estimates(there, None));
        }
        let differs = readings_apart(&best.rig, here, there) >= TOLD_APART * scale;
        if differs && (is_open || is_unexplained) {
            rivals.push((moved.cost(scale), is_open, there, declared));
        }
    }
    let likeliest = rivals.into_iter().min_by(|(a, ..), (b, ..)| a.total_cmp(b));
    let Some((_, is_open, there, declared)) = likeliest else { return answer };
    if diagnosis.verdict == Verdict::Adequate || interrupt::requested() {
        return answer;
    }
    if !is_open {
        case.progress.begin("trying another reading", [0.6, 0.65]);
        let excerpts = there.excerpts();
        let searched = there.searched(excerpts.as_deref());
        let root = &declared.root;
        let root = if excerpts.is_some() { root.refitted(&searched) } else { root.clone() };
        let others = search::first_round(&searched, root);
        if !leaves_less(&others, simple, scale) {
            return answer;
        }
    }
    let other = diagnose_from(&there.part([0.65, 1.0], ", in another reading"), declared, settings);
    if other.is_better_than(&answer, scale) { other } else { answer }
}

/// Does one of some models leave less than all of some others, of all records or of the fitted ones?
fn leaves_less(some: &[Hypothesis], others: &[Hypothesis], scale: f64) -> bool {
    let costs = [Hypothesis::cost, Hypothesis::cost_of_fitted];
    costs.iter().any(|cost| {
        let least = |models: &[Hypothesis]| {
            models.iter().map(|model| cost(model, scale)).fold(f64::INFINITY, f64::min)
        };
        least(some) < least(others)
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
struct Declared {
    fit: Fit,
    root: Hypothesis,
}

impl Declared {
    fn of(case: &Case<'_>, settings: &FitSettings) -> Self {
        let ranges = case.rig.declared();
        let fit = fit::fit_from_seeds(case.rig, &ranges, case.train(), settings, ROOT_SEEDS, |standing| {
            case.progress.searched(standing);
        });
        let root = Hypothesis::root(case, &fit, ranges);
        Self { fit, root }
    }
}

/// Diagnoses a case whose declared faults are fitted. A model beside which the times of its jumps were fitted is one of
/// those that are weighed.
fn diagnose_from(
    case: &Case<'_>,
    Declared { fit: mut before, root }: Declared,
    settings: &FitSettings,
) -> Answer {
    // Long records are searched in excerpts; what is found is then fitted to the whole.
    let excerpts = case.excerpts();
    let in_excerpts = excerpts.is_some();
    let searched = case.searched(excerpts.as_deref());
    let in_them = |model: Hypothesis| if in_excerpts { model.refitted(&searched) } else { model };
    let known = case.timed.map(|timed| timed.model.clone()).filter(|known| !known.added.is_empty());
    let sound = search::search(&searched, in_them(root), known.map(in_them), settings);
    let Hypothesis { ranges, train: Polished { values, .. }, .. } = &sound.root;
    let there = fit::misfit(case.rig, ranges, values, case.train());
    if there.chi_square < before.misfit.chi_square - BETTER_VALLEY {
        before = fit::fit_near(case.rig, ranges, values, case.train(), settings);
    }
    case.progress.begin("looking for what is mixed up with a fault", [0.95, 1.0]);
    let whole = if in_excerpts { sound.best.refitted(case) } else { sound.best.clone() };
    let named = whole.is_name(case, &before.misfit);
    let confounded = sound.best.confounded(&searched);
    let (whole, earned, stand_ins) = if named {
        (whole, sound.earned, sound.stand_ins)
    } else {
        let (whole, earned) = helpful(case, &before, whole, sound.earned);
        let none = vec![Vec::new(); earned.len()];
        (whole, earned, none)
    };
    let open = Open { named, stand_ins, confounded };
    let diagnosis = conclude(case, before, &whole, &earned, &open);
    Answer { diagnosis, model: whole, asked: sound.asked, simple: sound.simple }
}

/// An empirical term is there to predict: as long as the held-out records, or the fitted ones where none are held out, are
/// predicted worse than without any, the weakest is dropped.
fn helpful(
    case: &Case<'_>,
    before: &Fit,
    mut model: Hypothesis,
    mut earned: Vec<Earned>,
) -> (Hypothesis, Vec<Earned>) {
    let predicted = if case.holdout().is_empty() { case.train() } else { case.holdout() };
    let error = |rig: &Rig| score(rig, predicted).position_rms;
    let without_any = error(&before.applied(case.rig));
    while error(&model.rig) > without_any {
        let weakest = (0..earned.len()).min_by(|&a, &b| earned[a].evidence.total_cmp(&earned[b].evidence));
        let Some(weakest) = weakest else { break };
        model = model.without(case, earned.remove(weakest).effect);
    }
    (model, earned)
}

/// What the records leave open.
struct Open {
    /// Is what was found named?
    named: bool,
    /// For each effect that was found, the hypotheses with another in its place that do as well.
    stand_ins: Vec<Vec<Hypothesis>>,
    /// For each declared fault, the effects whose presence would leave it undetermined.
    confounded: Vec<Vec<&'static EffectInfo>>,
}

/// Puts the answer together.
fn conclude(case: &Case<'_>, before: Fit, best: &Hypothesis, earned: &[Earned], open: &Open) -> Diagnosis {
    let predictions = fit::predict(&best.rig, case.train());
    let noise_only = best.leaves_noise(case);
    let verdict = match (noise_only, earned.is_empty()) {
        (true, true) => Verdict::Adequate,
        (true, false) => Verdict::Explained,
        (false, _) => Verdict::Unexplained,
    };
    let inflation = (!noise_only).then(|| inflation(case.train(), &predictions, &best.train.misfit));
    let estimates: Vec<Estimate> = best.estimates(case, inflation);
    let found: Vec<Found> = earned
        .iter()
        .zip(&open.stand_ins)
        .map(|(earned, others)| Found {
            effect: earned.effect,
            class: iter::once(earned.effect).chain(others.iter().filter_map(Hypothesis::newest)).collect(),
            evidence: earned.evidence,
            named: open.named,
            estimates: estimates
                .iter()
                .filter(|estimate| earned.effect.parameters.contains(&estimate.parameter))
                .copied()
                .collect(),
        })
        .collect();
    let others: Vec<Vec<Estimate>> =
        open.stand_ins.iter().flatten().map(|other| other.estimates(case, inflation)).collect();
    let faults = (0..case.rig.faults.len())
        .map(|index| {
            let mut estimate = estimates[index];
            // Whatever stands in for an effect has its own opinion of the faults: the interval holds them all.
            for other in &others {
                estimate.hold(&other[index]);
            }
            Fault { estimate, confounded_with: open.confounded[index].clone() }
        })
        .collect();
    let foretold = || case.is_noise_left_of(case.holdout(), &fit::predict(&best.rig, case.holdout()));
    let is_open = noise_only && !foretold();
    let left = (!noise_only).then(|| residual::describe(&case.train()[0], &predictions[0]));
    let bare = before.applied(case.rig);
    let scores = |records: &[Prepared]| [score(&bare, records), score(&best.rig, records)];
    Diagnosis {
        verdict,
        interrupted: interrupt::requested(),
        faults,
        free: estimates[case.rig.faults.len()..before.estimates.len()].to_vec(),
        found,
        noise: fit::pooled(case.train().iter().map(Prepared::noise_rms)),
        colour: case.train()[0].colour,
        train: scores(case.train()),
        holdout: (!case.holdout().is_empty()).then(|| scores(case.holdout())),
        left,
        is_open,
        rig: best.rig.clone(),
        predictions,
        before,
        records: case.records.to_vec(),
        jumps: None,
    }
}

/// How much larger than white noise of the stated size what a model leaves counts: mean square times correlation time.
fn inflation(records: &[Prepared], predictions: &[Vec<Outputs<f64>>], misfit: &Misfit<f64>) -> f64 {
    misfit.mean_square().max(1.0) * residual::correlation_time(records, predictions)
}

/// Misfit of a model on records.
pub fn score(rig: &Rig, records: &[Prepared]) -> Score {
    let series = residual::series(records, &fit::predict(rig, records), 0).concat();
    Score { position_rms: fit::rms(series.into_iter()) }
}
