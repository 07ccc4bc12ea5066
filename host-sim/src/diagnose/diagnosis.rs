//! The answer of a diagnosis.

use super::description::Description;
use super::doubt::Doubt;
use super::residual::{self, MEASURED};
use super::side::Side;
use crate::fit::measured::USER;
use crate::fit::{self, Correlation, Estimate, Fit, Prepared};
use crate::output::effects_in_words;
use crate::rig::Rig;
use eha_monitor::channel::{Channel, ChannelInfo};
use eha_monitor::effect::EffectInfo;
use eha_monitor::model::state::Outputs;

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
    /// Is it a name for what is there? All effects of a model are, or none: where it leaves noise, or takes away 99 % of what
    /// the fitted records have beyond it. If not, it is a help for prediction.
    pub named: bool,
    /// Its parameters, as the last fit has them.
    pub estimates: Vec<Estimate>,
}

/// Misfit of a model on records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Root mean square of the residual of each measured channel, in its unit; not a number where no record has it.
    pub rms: [f64; MEASURED],
}

impl Score {
    /// Root mean square of the user position's residual, m.
    pub const fn position_rms(&self) -> f64 {
        self.rms[USER]
    }
}

/// A fault, and what it is mixed up with.
#[derive(Clone, Debug)]
pub struct Fault {
    /// Its estimate.
    pub estimate: Estimate,
    /// Effects whose presence would leave it undetermined.
    pub confounded_with: Vec<&'static EffectInfo>,
}

/// Why a search ended early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Early {
    /// The user wanted it to, when it had come so far.
    Interrupted(Reached),
    /// Its effort was used up.
    OutOfEffort,
}

impl Early {
    /// For a person.
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Interrupted(_) => "interrupted",
            Self::OutOfEffort => "out of effort",
        }
    }
}

/// How far a diagnosis had come that the user ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reached {
    /// Into the search for the declared faults.
    Search,
    /// To a fit of the declared faults to the fitted records.
    Declared,
    /// To models that were tried.
    Models,
    /// To an answer, in place of which others were looked for.
    Answer,
}

impl Reached {
    /// What that leaves out, for a person, beside effects.
    pub const fn left_out(self) -> Option<&'static str> {
        match self {
            Self::Search => Some(
                "the search for the declared faults had not ended: these are the best values that it has seen, and their \
                 intervals say nothing yet; the held-out records had no say",
            ),
            Self::Declared => Some(
                "the declared faults are those of the fitted records: the held-out ones had no say, and the intervals may be too \
                 narrow",
            ),
            Self::Models => Some(
                "it was not looked for what could stand in for an effect or is mixed up with a fault, and the intervals may be too \
                 narrow",
            ),
            Self::Answer => None,
        }
    }
}

/// The answer.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// Verdict.
    pub verdict: Verdict,
    /// Why the search ended early, if it did: what was not tried by then is not ruled out.
    pub early: Option<Early>,
    /// The faults before any effect was added.
    pub before: Fit,
    /// The declared faults at the end: where noise is left, as all records have them.
    pub faults: Vec<Fault>,
    /// The other parameters that the rig declares free, at the end.
    pub free: Vec<Estimate>,
    /// How all that is free at the end hangs together: the faults, what else the rig declares free, effects.
    pub correlation: Correlation,
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
    /// The final model, with the values of the faults and effects above: where it leaves noise, those of all records.
    pub rig: Rig,
    /// The same with the values of the fitted records alone: what foretells the held-out ones. The errors are its.
    pub foretelling: Rig,
    /// Its prediction of the training records.
    pub predictions: Vec<Vec<Outputs<f64>>>,
    /// What is left, where the verdict is unexplained.
    pub left: Option<Description>,
    /// Where that acts, if the channels tell.
    pub acts: Option<Side>,
    /// The records as they were compared: the fitted ones, then those that were held out.
    pub records: Vec<Prepared>,
    /// Parameters of the rig that may be wrong in place of what was found, or not found.
    pub doubts: Vec<Doubt>,
    /// When the command of each record jumps, s after its first sample, where that was found to be between two samples.
    pub jumps: Option<Vec<Vec<f64>>>,
}

impl Diagnosis {
    /// How far it had come, if the user ended it.
    pub fn interrupted_at(&self) -> Option<Reached> {
        match self.early? {
            Early::Interrupted(reached) => Some(reached),
            Early::OutOfEffort => None,
        }
    }

    /// The same, ended by the user.
    pub(super) fn interrupted(self, reached: Reached) -> Self {
        Self { early: Some(Early::Interrupted(reached)), ..self }
    }

    /// Is more than noise left, so that the records do not speak for how they were read?
    pub fn is_unexplained(&self) -> bool {
        self.verdict == Verdict::Unexplained
    }

    /// The verdict for a person. What explains the records does so whatever was not tried for want of effort.
    pub fn verdict_in_words(&self) -> String {
        let is_open = |early: &Early| matches!(early, Early::Interrupted(_)) || self.is_unexplained();
        let early = self.early.filter(is_open);
        let so_far = early.map_or_else(String::new, |early| format!(" so far ({})", early.in_words()));
        format!("{}{so_far}", self.verdict.name())
    }

    /// Names for a person of effects that were looked for; what stands for none is not known where the search ended early.
    pub fn names_or(&self, effects: &[&'static EffectInfo], none: &str) -> String {
        match effects {
            [] if self.early.is_some() => "not tried".to_owned(),
            [] => none.to_owned(),
            _ => effects_in_words(effects),
        }
    }

    /// The measured channels that were compared, with their noise: root mean square over the fitted records.
    pub fn channels(&self) -> impl Iterator<Item = (usize, &'static ChannelInfo, f64)> {
        let [before, _] = self.train;
        let of_all = Channel::MEASURED.into_iter().zip(self.noise).enumerate();
        let of_all = of_all.map(|(index, (channel, noise))| (index, channel.info(), noise));
        of_all.filter(move |&(index, _, noise)| noise.is_finite() && before.rms[index].is_finite())
    }

    /// What the search took, s of one core: see [`fit::spent_s`].
    pub fn effort_s(&self) -> f64 {
        fit::spent_s(&self.records)
    }

    /// Which values those after an effect was added are, for a person.
    pub fn after_in_words(&self) -> &'static str {
        if self.holdout.is_some() && !self.is_unexplained() { "after, of all records" } else { "after" }
    }

    /// Widens the intervals to hold those of the same model on another path of the command, which may be it as well.
    pub(super) fn hold(&mut self, others: &[Estimate]) {
        let of_faults = self.faults.iter_mut().map(|fault| &mut fault.estimate);
        let of_effects = self.found.iter_mut().flat_map(|found| &mut found.estimates);
        for estimate in of_faults.chain(&mut self.free).chain(of_effects) {
            if let Some(other) = others.iter().find(|other| other.parameter == estimate.parameter) {
                estimate.hold(other);
            }
        }
    }
}

/// Misfit of a model on records.
pub fn score(rig: &Rig, records: &[Prepared]) -> Score {
    let predictions = fit::predict(rig, records);
    Score { rms: std::array::from_fn(|channel| rms_of(records, &predictions, channel)) }
}

/// Root mean square of what predictions leave of the user position, m.
pub(super) fn position_rms(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> f64 {
    rms_of(records, predictions, USER)
}

/// Root mean square of what predictions leave of a channel, in its unit.
fn rms_of(records: &[Prepared], predictions: &[Vec<Outputs<f64>>], channel: usize) -> f64 {
    fit::rms(residual::series(records, predictions, channel).into_iter().flatten())
}
