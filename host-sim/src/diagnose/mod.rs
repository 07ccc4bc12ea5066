//! Closing the loop: from a residual to a named missing effect, or to an honest "I cannot tell".
//!
//! ```text
//! fit the declared faults
//!        |
//!        v
//! look at every effect of the catalogue beside them (linear), fit the promising ones --> evidence
//!        |  significant, matters, and helps the held-out record?
//!        v
//! keep the best few hypotheses, grow each by another effect, until one leaves noise or nothing helps (up to three)
//!        |
//!        v
//! which effects could stand in for each that was added? --> its class
//! residual noise? adequate or explained : unexplained
//! ```

pub mod candidate;
pub mod residual;

use crate::fit::{self, Estimate, Fit, FitSettings, Polished, Prepared};
use crate::interrupt;
use crate::rig::{Range, Rig};
use candidate::{Candidate, Prospect};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::problem::Misfit;
use eha_monitor::model::state::Outputs;
use rayon::prelude::*;
use residual::{ChannelResidual, Description, MEASURED, MODEL_ERROR};

/// Most effects that are added.
const MOST_EFFECTS: usize = 3;
/// Fall of chi-square that the linear model must foresee for an effect to be fitted: far below what is accepted.
const PROMISING: f64 = 4.0;
/// Hypotheses that are grown further.
const BEAM: usize = 3;
/// Most effects that are fitted for a hypothesis in a round, the most promising first.
const MOST_FITTED: usize = 10;
/// Twice the logarithm of the odds (100 to 1) below which two effects are not told apart.
const CLASS_EVIDENCE: f64 = 9.2;
/// Standard deviations of the residual tests: with four channels, a chance of 1e-4 of a false alarm.
const RESIDUAL_LIMIT: f64 = 5.0;
/// A fault whose standard error grows by this factor when an effect is fitted beside it is confounded with the effect.
const CONFOUNDED: f64 = 5.0;

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
    /// Does it, with those before it, explain the better part of the misfit? If not it is a help for prediction, not
    /// a name for what is there.
    pub named: bool,
    /// Its parameters, as the last fit has them.
    pub estimates: Vec<Estimate>,
}

/// Misfit of a model on records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Root mean square of the user position's residual, m.
    pub position_rms: f64,
    /// Sum of the squares of all channels in units of their noise.
    pub chi_square: f64,
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
    /// The faults before any effect was added.
    pub before: Fit,
    /// The declared faults at the end.
    pub faults: Vec<Fault>,
    /// Effects that were added.
    pub found: Vec<Found>,
    /// Noise of each measured channel.
    pub noise: [f64; MEASURED],
    /// Training records, before and after.
    pub train: [Score; 2],
    /// Held-out records, before and after; none where there are none.
    pub holdout: Option<[Score; 2]>,
    /// The final model.
    pub rig: Rig,
    /// Its prediction of the training records.
    pub predictions: Vec<Vec<Outputs<f64>>>,
    /// Residual of each channel at the end.
    pub residuals: [Option<ChannelResidual>; MEASURED],
    /// What is left, where the verdict is unexplained.
    pub left: Option<Description>,
    /// Other effects that came near, for the user: name and evidence.
    pub runners_up: Vec<(&'static EffectInfo, f64)>,
}

/// What a diagnosis works on.
pub struct Case<'a> {
    /// The rig, with declared faults and free parameters.
    pub rig: &'a Rig,
    /// Records that are fitted.
    pub train: &'a [Prepared],
    /// Records that are only predicted.
    pub holdout: &'a [Prepared],
    /// Noise of each measured channel.
    pub noise: [f64; MEASURED],
    /// Channels whose noise the rig states.
    pub known_noise: [Option<f64>; MEASURED],
}

/// Diagnoses a case. `watch` is told what is being done, and how much of it (0 to 1).
pub fn diagnose(case: &Case<'_>, settings: &FitSettings, watch: &(dyn Fn(&str, f64) + Sync)) -> Diagnosis {
    let mut ranges = case.rig.faults.clone();
    for range in &case.rig.free {
        if ranges.iter().all(|known| known.parameter != range.parameter) {
            ranges.push(*range);
        }
    }
    watch("fitting the declared faults", 0.0);
    let before = fit::fit(case.rig, &ranges, case.train, case.noise, settings, |_| {});
    let rig = Rig { parameters: before.parameters, ..case.rig.clone() };
    let score_before = [score(case, &rig, case.train), score(case, &rig, case.holdout)];
    let root = Hypothesis {
        polished: Polished {
            values: before.estimates.iter().map(|estimate| estimate.value).collect(),
            misfit: before.misfit,
            covariance: covariance(&before),
            evaluations: before.evaluations,
        },
        rig,
        ranges,
        added: Vec::new(),
        prospects: Vec::new(),
        inflation: 1.0,
        penalty: 0.0,
        holdout: score_before[1].chi_square,
        runners_up: Vec::new(),
    };
    let mut best = root.clone();
    let mut beam = vec![root];
    for stage in 0..MOST_EFFECTS {
        if interrupt::requested() {
            break;
        }
        let label = format!("trying effects, round {}", stage + 1);
        let mut grown: Vec<Hypothesis> = Vec::new();
        for (index, hypothesis) in beam.iter_mut().enumerate() {
            let share = (stage as f64 + index as f64 / BEAM as f64 + 0.5) / (MOST_EFFECTS as f64 + 1.0);
            watch(&label, share);
            grown.extend(hypothesis.grow(case));
        }
        if stage == 0 {
            best.clone_from(&beam[0]);
        }
        grown.sort_by(|a, b| a.cost(&best).total_cmp(&b.cost(&best)));
        grown.dedup_by(|a, b| a.same_effects(b));
        grown.truncate(BEAM);
        let Some(first) = grown.first() else { break };
        if first.cost(&best) < best.cost(&best) {
            best.clone_from(first);
        }
        if best.leaves_noise(case) {
            break;
        }
        beam = grown;
    }
    if best.prospects.is_empty() {
        best.look(case);
    }
    watch("testing the residual", 0.95);
    best.conclude(case, before, score_before)
}

/// A model that may be the right one: effects that were added, and how it fits.
#[derive(Clone)]
struct Hypothesis {
    rig: Rig,
    ranges: Vec<Range>,
    polished: Polished,
    /// Effects that were added, each with its evidence against the model without it.
    added: Vec<(&'static EffectInfo, f64)>,
    /// What the linear model says of every further effect.
    prospects: Vec<Prospect>,
    /// How much the noise is to be multiplied by for what is left: mean square times correlation time.
    inflation: f64,
    /// What its parameters cost, in chi-square of plain noise.
    penalty: f64,
    /// Chi-square of the held-out records, which it was not fitted to.
    holdout: f64,
    /// Effects that came near.
    runners_up: Vec<(&'static EffectInfo, f64)>,
}

impl Hypothesis {
    /// Chi-square of fitted and held-out records with a price on parameters, in units of what the best model leaves.
    fn cost(&self, best: &Self) -> f64 {
        (self.polished.misfit.chi_square + self.holdout) / self.inflation.min(best.inflation).max(1.0)
            + self.penalty
    }

    fn same_effects(&self, other: &Self) -> bool {
        self.added.len() == other.added.len()
            && self
                .added
                .iter()
                .all(|(effect, _)| other.added.iter().any(|(known, _)| known.name == effect.name))
    }

    fn leaves_noise(&self, case: &Case<'_>) -> bool {
        [case.train, case.holdout].into_iter().all(|records| {
            let predictions = fit::predict(&self.rig, records);
            is_noise(case, &residuals(records, &predictions))
        })
    }

    /// Looks at every effect that is not in the model yet.
    fn look(&mut self, case: &Case<'_>) {
        let (rig, ranges) = (&self.rig, &self.ranges);
        self.prospects = EFFECTS
            .par_iter()
            .filter(|effect| !interrupt::requested() && candidate::applies(effect, rig, ranges))
            .filter_map(|effect| candidate::look(effect, rig, ranges, case.train, case.noise))
            .collect();
    }

    /// Fits the effects that promise to lower chi-square, best first.
    fn fit_promising(&self, case: &Case<'_>) -> Vec<Candidate> {
        let base = self.polished.misfit.chi_square;
        let mut promising: Vec<&Prospect> = self
            .prospects
            .iter()
            .filter(|prospect| base - prospect.foreseen.misfit.chi_square > PROMISING)
            .collect();
        promising.sort_by(|a, b| a.foreseen.misfit.chi_square.total_cmp(&b.foreseen.misfit.chi_square));
        promising.truncate(MOST_FITTED);
        let mut candidates: Vec<Candidate> = promising
            .par_iter()
            .filter(|_| !interrupt::requested())
            .filter_map(|prospect| prospect.fit(&self.rig, case.train, case.noise))
            .collect();
        candidates.sort_by(|a, b| a.fit.misfit.chi_square.total_cmp(&b.fit.misfit.chi_square));
        candidates
    }

    /// The hypotheses with one more effect that is significant, matters and validates, best first.
    fn grow(&mut self, case: &Case<'_>) -> Vec<Self> {
        self.look(case);
        let candidates = self.fit_promising(case);
        let Some(best) = candidates.first() else { return Vec::new() };
        self.inflation = inflation(case, &best.rig, &best.fit.misfit);
        let count = f64::from(self.polished.misfit.count);
        let trials = 2.0 * (self.prospects.len() as f64).ln();
        let ranked: Vec<(Candidate, f64, f64)> = candidates
            .into_iter()
            .map(|candidate| {
                let gain =
                    (self.polished.misfit.chi_square - candidate.fit.misfit.chi_square) / self.inflation;
                let price = candidate.effect.parameters.len() as f64 * (count / self.inflation).ln().max(1.0)
                    + trials;
                (candidate, gain - price, price)
            })
            .collect();
        self.runners_up =
            ranked.iter().take(3).map(|(candidate, evidence, _)| (candidate.effect, *evidence)).collect();
        ranked
            .into_par_iter()
            .filter(|(_, evidence, _)| *evidence > 0.0)
            .filter(|(candidate, ..)| self.matters(case, candidate))
            .map(|(candidate, evidence, price)| {
                let holdout = score(case, &candidate.rig, case.holdout).chi_square;
                (candidate, evidence, price, holdout)
            })
            .filter(|(.., holdout)| case.holdout.is_empty() || *holdout < self.holdout)
            .map(|(candidate, evidence, price, holdout)| {
                let mut added = self.added.clone();
                added.push((candidate.effect, evidence));
                Self {
                    inflation: inflation(case, &candidate.rig, &candidate.fit.misfit),
                    rig: candidate.rig,
                    ranges: candidate.ranges,
                    polished: candidate.fit,
                    added,
                    prospects: Vec::new(),
                    penalty: self.penalty + price,
                    holdout,
                    runners_up: Vec::new(),
                }
            })
            .collect()
    }

    /// The effects that could stand in for one that was added: with each in its place, the others kept, the records
    /// are explained as well.
    fn class_of(&self, case: &Case<'_>, effect: &'static EffectInfo) -> Vec<&'static EffectInfo> {
        let mut without = self.clone();
        without.rig.effects.retain(|known| known.name != effect.name);
        for &parameter in effect.parameters {
            without.rig.parameters.set(parameter, case.rig.parameters.get(parameter));
        }
        without.ranges.retain(|range| !effect.parameters.contains(&range.parameter));
        let starts =
            [without.ranges.iter().map(|range| without.rig.parameters.get(range.parameter)).collect()];
        if let Some(fit) = fit::polish(&without.rig, &without.ranges, &starts, case.train, case.noise) {
            without.rig = fit.applied(&without.rig, &without.ranges);
            without.polished = fit;
        }
        without.look(case);
        let price = |parameters: usize| parameters as f64 * f64::from(self.polished.misfit.count).ln();
        let mine = self.polished.misfit.chi_square / self.inflation + price(effect.parameters.len());
        let mut class = vec![effect];
        class.extend(
            without
                .fit_promising(case)
                .iter()
                .filter(|other| other.effect.name != effect.name)
                .filter(|other| {
                    let theirs =
                        other.fit.misfit.chi_square / self.inflation + price(other.effect.parameters.len());
                    theirs - mine < CLASS_EVIDENCE
                })
                .map(|other| other.effect),
        );
        class
    }

    /// Does an effect change a prediction by more than the model's own error, or bias a fault beyond its error?
    fn matters(&self, case: &Case<'_>, candidate: &Candidate) -> bool {
        let records = if case.holdout.is_empty() { case.train } else { case.holdout };
        let (without, with) = (fit::predict(&self.rig, records), fit::predict(&candidate.rig, records));
        let mut sums = [0.0; MEASURED];
        let mut count = 0_usize;
        for (a, b) in without.iter().flatten().zip(with.iter().flatten()) {
            for (sum, (a, b)) in sums.iter_mut().zip(a.to_array().into_iter().zip(b.to_array())) {
                *sum += (a - b) * (a - b);
            }
            count += 1;
        }
        let changes = (0..MEASURED).any(|channel| {
            case.noise[channel].is_finite()
                && (sums[channel] / count.max(1) as f64).sqrt() > MODEL_ERROR[channel]
        });
        let biases = (0..case.rig.faults.len()).any(|index| {
            let shift = (candidate.fit.values[index] - self.polished.values[index]).abs();
            shift > 3.0 * candidate.fit.standard_error(index) * self.inflation.sqrt()
        });
        changes || biases
    }

    fn conclude(self, case: &Case<'_>, before: Fit, score_before: [Score; 2]) -> Diagnosis {
        let predictions = fit::predict(&self.rig, case.train);
        let residuals = residuals(case.train, &predictions);
        let noise_only = self.leaves_noise(case);
        let verdict = match (noise_only, self.added.is_empty()) {
            (true, true) => Verdict::Adequate,
            (true, false) => Verdict::Explained,
            (false, _) => Verdict::Unexplained,
        };
        // Effects that leave most of the misfit are a help for prediction, not a name for what is there.
        let excess = |misfit: &Misfit<f64>| (misfit.mean_square() - 1.0).max(0.0);
        let explains = excess(&self.polished.misfit) < 0.1 * excess(&before.misfit);
        let inflation = if noise_only { 1.0 } else { inflation(case, &self.rig, &self.polished.misfit) };
        let estimates: Vec<Estimate> = self
            .ranges
            .iter()
            .enumerate()
            .map(|(index, range)| {
                let standard_error = self.polished.standard_error(index) * inflation.sqrt();
                Estimate::new(range, self.polished.values[index], standard_error)
            })
            .collect();
        let found: Vec<Found> = self
            .added
            .iter()
            .map(|&(effect, evidence)| Found {
                effect,
                class: self.class_of(case, effect),
                evidence,
                named: verdict == Verdict::Explained || explains,
                estimates: estimates
                    .iter()
                    .filter(|estimate| effect.parameters.contains(&estimate.parameter))
                    .copied()
                    .collect(),
            })
            .collect();
        let faults = (0..case.rig.faults.len())
            .map(|index| Fault { estimate: estimates[index], confounded_with: self.confounded_with(index) })
            .collect();
        let score_after = [score(case, &self.rig, case.train), score(case, &self.rig, case.holdout)];
        let left = (verdict == Verdict::Unexplained).then(|| {
            let series = residual::series(case.train, &predictions, 0);
            residual::describe(&case.train[0], &predictions[0], &series[0])
        });
        Diagnosis {
            verdict,
            before,
            faults,
            found,
            noise: case.noise,
            train: [score_before[0], score_after[0]],
            holdout: (!case.holdout.is_empty()).then_some([score_before[1], score_after[1]]),
            rig: self.rig,
            predictions,
            residuals,
            left,
            runners_up: self.runners_up,
        }
    }

    /// Effects, not in the model, whose presence would leave a fault undetermined.
    fn confounded_with(&self, fault: usize) -> Vec<&'static EffectInfo> {
        let alone = self.polished.standard_error(fault);
        self.prospects
            .iter()
            .filter(|prospect| prospect.foreseen.standard_error(fault) > CONFOUNDED * alone)
            .map(|prospect| prospect.effect)
            .collect()
    }
}

fn covariance(fit: &Fit) -> Vec<Vec<f64>> {
    fit.correlation
        .iter()
        .enumerate()
        .map(|(row, correlations)| {
            correlations
                .iter()
                .enumerate()
                .map(|(column, correlation)| {
                    correlation * fit.estimates[row].standard_error * fit.estimates[column].standard_error
                })
                .collect()
        })
        .collect()
}

/// How much larger than white noise of the stated size what a model leaves counts: mean square times correlation time.
fn inflation(case: &Case<'_>, rig: &Rig, misfit: &Misfit<f64>) -> f64 {
    let predictions = fit::predict(rig, case.train);
    let time = (0..MEASURED)
        .filter(|&channel| case.noise[channel].is_finite())
        .map(|channel| fit::correlation_time(&residual::series(case.train, &predictions, channel)))
        .fold(1.0, f64::max);
    misfit.mean_square().max(1.0) * time
}

fn score(case: &Case<'_>, rig: &Rig, records: &[Prepared]) -> Score {
    let predictions = fit::predict(rig, records);
    let mut chi_square = 0.0;
    let mut position_rms = f64::NAN;
    for channel in (0..MEASURED).filter(|&channel| case.noise[channel].is_finite()) {
        let values: Vec<f64> = residual::series(records, &predictions, channel)
            .concat()
            .into_iter()
            .filter(|x| x.is_finite())
            .collect();
        let sum: f64 = values.iter().map(|x| x * x).sum();
        if channel == 0 {
            position_rms = (sum / values.len().max(1) as f64).sqrt();
        }
        chi_square += sum / (case.noise[channel] * case.noise[channel]);
    }
    Score { position_rms, chi_square }
}

/// Residual of each measured channel.
fn residuals(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> [Option<ChannelResidual>; MEASURED] {
    std::array::from_fn(|channel| residual::test(&residual::series(records, predictions, channel)))
}

/// Is the residual of every channel just noise?
fn is_noise(case: &Case<'_>, residuals: &[Option<ChannelResidual>; MEASURED]) -> bool {
    residuals.iter().enumerate().all(|(channel, residual)| {
        residual.is_none_or(|residual| residual.is_noise(channel, case.known_noise[channel], RESIDUAL_LIMIT))
    })
}
