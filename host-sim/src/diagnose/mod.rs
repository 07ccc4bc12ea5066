//! Closing the loop: from a residual to a named missing effect, or to an honest "I cannot tell".
//!
//! ```text
//! fit the declared faults --> residual noise? --> adequate
//!        |  no, or some effect still matters
//!        v
//! refit jointly with every effect of the catalogue --> evidence --> best one, and its class
//!        |  significant, matters, and helps the held-out record?
//!        v
//! add it, up to three --> residual noise? explained : unexplained
//! ```

pub mod candidate;
pub mod residual;

use crate::fit::{self, Estimate, Fit, FitSettings, Polished, Prepared};
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
/// Most effects that are fitted in a round, the most promising first.
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
    /// Mean square of all channels in units of their noise.
    pub mean_square: f64,
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
    let mut rig = Rig { parameters: before.parameters, ..case.rig.clone() };
    let score_before = [score(case, &rig, case.train), score(case, &rig, case.holdout)];
    let mut state = State {
        polished: Polished {
            values: before.estimates.iter().map(|estimate| estimate.value).collect(),
            misfit: before.misfit,
            covariance: covariance(&before),
            evaluations: before.evaluations,
        },
        ranges,
        found: Vec::new(),
        runners_up: Vec::new(),
        inflation: 1.0,
        prospects: Vec::new(),
    };
    for stage in 0..MOST_EFFECTS {
        let label = format!("trying effects, round {}", stage + 1);
        watch(&label, (1.0 + stage as f64) / (2.0 + MOST_EFFECTS as f64));
        if !state.grow(case, &mut rig) {
            break;
        }
    }
    watch("testing the residual", 1.0);
    state.conclude(case, rig, before, score_before)
}

/// A diagnosis as it goes on.
struct State {
    ranges: Vec<Range>,
    polished: Polished,
    found: Vec<Found>,
    runners_up: Vec<(&'static EffectInfo, f64)>,
    /// How much the noise is to be multiplied by for what is left: mean square times correlation time.
    inflation: f64,
    /// The last round's prospects: what the faults would be mixed up with.
    prospects: Vec<Prospect>,
}

impl State {
    /// Adds the best effect that is significant, matters and validates; says whether there was one.
    fn grow(&mut self, case: &Case<'_>, rig: &mut Rig) -> bool {
        let here = &*rig;
        let ranges = &self.ranges;
        let base = self.polished.misfit;
        self.prospects = EFFECTS
            .par_iter()
            .filter(|effect| candidate::applies(effect, here, ranges))
            .filter_map(|effect| candidate::look(effect, here, ranges, case.train, case.noise))
            .collect();
        let mut promising: Vec<&Prospect> = self
            .prospects
            .iter()
            .filter(|prospect| base.chi_square - prospect.foreseen.misfit.chi_square > PROMISING)
            .collect();
        promising.sort_by(|a, b| a.foreseen.misfit.chi_square.total_cmp(&b.foreseen.misfit.chi_square));
        promising.truncate(MOST_FITTED);
        let mut candidates: Vec<Candidate> =
            promising.par_iter().filter_map(|prospect| prospect.fit(here, case.train, case.noise)).collect();
        candidates.sort_by(|a, b| a.fit.misfit.chi_square.total_cmp(&b.fit.misfit.chi_square));
        let Some(best) = candidates.first() else { return false };
        self.inflation = inflation(case, &best.rig, &best.fit.misfit);
        let catalogue = 2.0 * (self.prospects.len() as f64).ln();
        let evidence = |candidate: &Candidate| {
            let parameters = candidate.effect.parameters.len() as f64;
            (base.chi_square - candidate.fit.misfit.chi_square) / self.inflation
                - parameters * (f64::from(base.count) / self.inflation.max(1.0)).ln().max(1.0)
                - catalogue
        };
        let ranked: Vec<(&Candidate, f64)> =
            candidates.iter().map(|candidate| (candidate, evidence(candidate))).collect();
        let accepted = ranked
            .iter()
            .filter(|(_, evidence)| *evidence > 0.0)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(candidate, _)| {
                self.matters(case, rig, candidate) && validates(case, rig, &candidate.rig)
            })
            .map(|(candidate, evidence)| ((*candidate).clone(), *evidence));
        let Some((chosen, gained)) = accepted else {
            self.runners_up =
                ranked.iter().take(3).map(|(candidate, evidence)| (candidate.effect, *evidence)).collect();
            return false;
        };
        let mut class = vec![chosen.effect];
        class.extend(
            ranked
                .iter()
                .filter(|(candidate, evidence)| {
                    candidate.effect.name != chosen.effect.name
                        && *evidence > 0.0
                        && gained - evidence < CLASS_EVIDENCE
                })
                .map(|(candidate, _)| candidate.effect),
        );
        self.runners_up = ranked
            .iter()
            .filter(|(candidate, _)| class.iter().all(|member| member.name != candidate.effect.name))
            .take(3)
            .map(|(candidate, evidence)| (candidate.effect, *evidence))
            .collect();
        self.found.push(Found {
            effect: chosen.effect,
            class,
            evidence: gained,
            named: true,
            estimates: Vec::new(),
        });
        *rig = chosen.rig;
        self.ranges = chosen.ranges;
        self.polished = chosen.fit;
        true
    }

    /// Does an effect change a prediction by more than the model's own error, or bias a fault beyond its error?
    fn matters(&self, case: &Case<'_>, rig: &Rig, candidate: &Candidate) -> bool {
        let records = if case.holdout.is_empty() { case.train } else { case.holdout };
        let (without, with) = (fit::predict(rig, records), fit::predict(&candidate.rig, records));
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

    fn conclude(mut self, case: &Case<'_>, rig: Rig, before: Fit, score_before: [Score; 2]) -> Diagnosis {
        let predictions = fit::predict(&rig, case.train);
        let residuals: [Option<ChannelResidual>; MEASURED] = std::array::from_fn(|channel| {
            residual::test(&residual::series(case.train, &predictions, channel))
        });
        let noise_only = residuals.iter().enumerate().all(|(channel, residual)| {
            residual
                .is_none_or(|residual| residual.is_noise(channel, case.known_noise[channel], RESIDUAL_LIMIT))
        });
        let verdict = match (noise_only, self.found.is_empty()) {
            (true, true) => Verdict::Adequate,
            (true, false) => Verdict::Explained,
            (false, _) => Verdict::Unexplained,
        };
        // Effects that leave most of the misfit are a help for prediction, not a name for what is there.
        let excess = |misfit: &Misfit<f64>| (misfit.mean_square() - 1.0).max(0.0);
        let explains = excess(&self.polished.misfit) < 0.1 * excess(&before.misfit);
        let inflation = if noise_only { 1.0 } else { inflation(case, &rig, &self.polished.misfit) };
        let estimates: Vec<Estimate> = self
            .ranges
            .iter()
            .enumerate()
            .map(|(index, range)| estimate(range, &self.polished, index, inflation))
            .collect();
        for found in &mut self.found {
            found.named = verdict == Verdict::Explained || explains;
            found.estimates = estimates
                .iter()
                .filter(|estimate| found.effect.parameters.contains(&estimate.parameter))
                .copied()
                .collect();
        }
        let faults = (0..case.rig.faults.len())
            .map(|index| Fault {
                estimate: estimates[index],
                confounded_with: self.confounded_with(index, &rig),
            })
            .collect();
        let score_after = [score(case, &rig, case.train), score(case, &rig, case.holdout)];
        let left = (verdict == Verdict::Unexplained).then(|| {
            let series = residual::series(case.train, &predictions, 0);
            residual::describe(&case.train[0], &predictions[0], &series[0])
        });
        Diagnosis {
            verdict,
            before,
            faults,
            found: self.found,
            noise: case.noise,
            train: [score_before[0], score_after[0]],
            holdout: (!case.holdout.is_empty()).then_some([score_before[1], score_after[1]]),
            rig,
            predictions,
            residuals,
            left,
            runners_up: self.runners_up,
        }
    }

    /// Effects, not in the model, whose presence would leave a fault undetermined.
    fn confounded_with(&self, fault: usize, rig: &Rig) -> Vec<&'static EffectInfo> {
        let alone = self.polished.standard_error(fault);
        self.prospects
            .iter()
            .filter(|prospect| rig.effects.iter().all(|effect| effect.name != prospect.effect.name))
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

fn estimate(range: &Range, polished: &Polished, index: usize, inflation: f64) -> Estimate {
    let (value, standard_error) = (polished.values[index], polished.standard_error(index) * inflation.sqrt());
    Estimate {
        parameter: range.parameter,
        value,
        standard_error,
        ci95: [
            (value - 1.96 * standard_error).max(range.lower),
            (value + 1.96 * standard_error).min(range.upper),
        ],
    }
}

/// How much larger than white noise of the stated size what a model leaves counts: mean square times correlation time.
fn inflation(case: &Case<'_>, rig: &Rig, misfit: &Misfit<f64>) -> f64 {
    let predictions = fit::predict(rig, case.train);
    let time = (0..MEASURED)
        .filter(|&channel| case.noise[channel].is_finite())
        .map(|channel| residual::correlation_time(&residual::series(case.train, &predictions, channel)))
        .fold(1.0, f64::max);
    misfit.mean_square().max(1.0) * time
}

fn score(case: &Case<'_>, rig: &Rig, records: &[Prepared]) -> Score {
    let predictions = fit::predict(rig, records);
    let (mut chi_square, mut count) = (0.0, 0_usize);
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
        count += values.len();
    }
    Score { position_rms, mean_square: chi_square / count.max(1) as f64 }
}

/// Does a model predict the held-out records better than another? Where there are none, there is nothing to refuse it.
fn validates(case: &Case<'_>, without: &Rig, with: &Rig) -> bool {
    case.holdout.is_empty()
        || score(case, with, case.holdout).mean_square < score(case, without, case.holdout).mean_square
}
