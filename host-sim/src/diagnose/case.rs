//! What a diagnosis works on.

use super::candidate::Candidate;
use super::jumps::Timed;
use super::progress::Progress;
use super::residual::{self, ChannelResidual, MEASURED};
use super::search::{Rival, Suggested};
use super::so_far::SoFar;
use crate::fit::measured::PRESSURE;
use crate::fit::{self, Prepared, Reading, Steps};
use crate::rig::Rig;
use eha_monitor::channel::Channel;
use eha_monitor::model::Drive;
use eha_monitor::model::state::Outputs;
use std::sync::atomic::{AtomicBool, Ordering};

/// Standard deviations of the residual tests. White noise is beyond them by chance in 1.3e-4 of cases (chi-square of 20 degrees
/// of freedom above 51.6), in each channel; fitted and held-out records are tested each for themselves: with four channels, a
/// chance of 1e-3 that some test of a right model fails.
const RESIDUAL_LIMIT: f64 = 5.0;

/// Most that is spent on a search where nobody says otherwise, s of one core for each second of the fitted records, or for a
/// thousand samples where these are closer.
pub const EFFORT_PER_SECOND: f64 = 24.0;
/// Bounds of that, s of one core.
pub const EFFORT_BOUNDS_S: [f64; 2] = [30.0, 240.0];

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
    /// lost to the steps in which the commands were recorded.
    pub model_error: [f64; MEASURED],
    /// The steps in which the sensor of each channel is read, where they are larger than that.
    pub steps: [Option<Steps>; MEASURED],
    /// The jumps of their commands, and the model beside which their times were fitted, where they were.
    pub(super) timed: Option<&'a Timed>,
    /// An explanation of the records that is known already, where one is: models that cost more are not grown.
    pub(super) rival: Option<Rival>,
    /// A model that is known to explain the records, or much of them, in another reading: tried in this one as well.
    pub(super) suggested: Option<Suggested<'a>>,
    /// Whether the two most expensive searches are made where nothing else explains the records: in the first moments beside
    /// other effects, and over the whole ranges. They are made in the likeliest reading only.
    pub(super) searches_far: bool,
    /// Most that is spent on the search, s of one core as [`fit::spent_s`] counts them: what is begun then is ended.
    pub effort_s: f64,
    /// Whether that was not enough.
    pub(super) cut: Option<&'a AtomicBool>,
    /// Where it keeps what it has found.
    pub(super) so_far: Option<&'a SoFar>,
    /// Whom it tells where it stands.
    pub(super) progress: Progress<'a>,
}

/// Most that is spent on a search that fits some records where nobody says otherwise, s of one core: longer ones take longer
/// to simulate, and tell more.
fn usual_effort_s(fitted: &[Prepared]) -> f64 {
    let worth = |record: &Prepared| record.duration().max(record.len() as f64 * 1e-3);
    let seconds: f64 = fitted.iter().map(worth).sum();
    (EFFORT_PER_SECOND * seconds).clamp(EFFORT_BOUNDS_S[0], EFFORT_BOUNDS_S[1])
}

impl<'a> Case<'a> {
    /// The same with another rig that reads the records in the same way.
    pub(super) fn under<'b>(&self, rig: &'b Rig) -> Case<'b>
    where
        'a: 'b,
    {
        Case { rig, ..*self }
    }

    /// The same records in a reading of them, of which is told in some words.
    pub(super) fn read_as<'b>(&self, Reading { rig, records }: &'b Reading, words: &'static str) -> Case<'b>
    where
        'a: 'b,
    {
        Case { rig, records, ..self.part([0.0, 1.0], words) }
    }

    /// Tells that a candidate was fitted, if that led anywhere.
    pub(super) fn told(&self, candidate: Option<Candidate>) -> Option<Candidate> {
        self.progress.fitted(candidate.as_ref().map(|new| new.fit.misfit.mean_square().sqrt()));
        candidate
    }

    /// The same as a part of a diagnosis, between two shares of it, that takes the records in some way.
    pub(super) fn part(&self, range: [f64; 2], reading: &'static str) -> Self {
        Case { progress: self.progress.part(range, reading), ..*self }
    }

    /// The same case for a reading that is tried after the likeliest one: without the most expensive searches.
    pub(super) fn another(self) -> Self {
        Case { searches_far: false, ..self }
    }

    /// A case of records that are ready for a rig, of which the first ones are fitted.
    pub fn new(rig: &'a Rig, records: &'a [Prepared], fitted: usize) -> Self {
        let error = |channel: usize| {
            let lost = records.iter().map(|record| record.lost[channel]).fold(0.0, f64::max);
            fit::MODEL_ERROR[channel].hypot(lost)
        };
        // The sensor is the same in all of them: the one that shows most of its noise tells what that leaves of its steps.
        // One in which it rests on a step shows none.
        let steps = |channel: usize| {
            let all = records.iter().filter_map(|record| record.steps[channel]);
            all.min_by(|one, other| one.error.total_cmp(&other.error))
        };
        Self {
            rig,
            records,
            fitted,
            known_noise: Channel::MEASURED.map(|channel| rig.noise_of(channel)),
            model_error: std::array::from_fn(error),
            steps: std::array::from_fn(steps),
            timed: None,
            rival: None,
            suggested: None,
            searches_far: true,
            effort_s: usual_effort_s(&records[..fitted]),
            cut: None,
            so_far: None,
            progress: Progress::SILENT,
        }
    }

    /// Is the search to end, because its effort is used up? For what is done by one thread: what others spend meanwhile
    /// differs from run to run.
    pub(super) fn is_over(&self) -> bool {
        let is_used_up = fit::spent_s(self.records) > self.effort_s;
        if let Some(cut) = self.cut.filter(|_| is_used_up) {
            cut.store(true, Ordering::Relaxed);
        }
        is_used_up
    }

    /// Records that are fitted.
    pub fn train(&self) -> &'a [Prepared] {
        &self.records[..self.fitted]
    }

    /// Does no fitted record show a force on the ram, so that the friction can make up for what is missing?
    pub(super) fn hides_friction(&self) -> bool {
        let shows_pressure = |record: &Prepared| record.noise[PRESSURE].is_finite();
        self.rig.form.drive == Drive::Valve && !self.train().iter().any(shows_pressure)
    }

    /// Records that are only predicted.
    pub fn holdout(&self) -> &'a [Prepared] {
        &self.records[self.fitted..]
    }

    /// The records with excerpts in place of the long ones; none where all are short.
    pub(super) fn excerpts(&self) -> Option<Vec<Prepared>> {
        let excerpts: Vec<Option<Prepared>> = self.records.iter().map(Prepared::excerpt).collect();
        let or_whole =
            |(excerpt, whole): (Option<Prepared>, &Prepared)| excerpt.unwrap_or_else(|| whole.clone());
        let is_any = excerpts.iter().any(Option::is_some);
        is_any.then(|| excerpts.into_iter().zip(self.records).map(or_whole).collect())
    }

    /// The case to search in: with the excerpts in place of the records, if there are any.
    pub(super) fn searched<'b>(&self, excerpts: Option<&'b [Prepared]>) -> Case<'b>
    where
        'a: 'b,
    {
        let rival = self.rival.filter(|_| excerpts.is_none());
        Case { records: excerpts.unwrap_or(self.records), timed: None, rival, ..*self }
    }

    /// Do predictions of all records leave no more than noise of them?
    pub(super) fn is_noise_left(&self, predictions: &[Vec<Outputs<f64>>]) -> bool {
        let (train, holdout) = predictions.split_at(self.fitted);
        self.is_noise_left_of(self.train(), train) && self.is_noise_left_of(self.holdout(), holdout)
    }

    /// Do predictions of some of them?
    pub(super) fn is_noise_left_of(&self, records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> bool {
        let residuals = residual::of_channels(records, predictions);
        residuals
            .iter()
            .enumerate()
            .all(|(channel, left)| left.is_none_or(|left| self.is_noise(channel, &left)))
    }

    /// Is what is left of a channel no more than noise?
    pub(super) fn is_noise(&self, channel: usize, left: &ChannelResidual) -> bool {
        // Of the saw tooth of a sensor that is read in steps noise leaves the first harmonic on the whole; all of it is what it
        // may swing by.
        let by_steps =
            self.steps[channel].map_or([0.0; 2], |steps| [steps.error, steps.step / 12.0_f64.sqrt()]);
        let errors = by_steps.map(|error| self.model_error[channel].hypot(error));
        left.is_noise(errors, self.known_noise[channel], RESIDUAL_LIMIT)
    }
}

#[cfg(test)]
mod tests {
    use super::super::signature::tests::record;
    use super::{EFFORT_BOUNDS_S, EFFORT_PER_SECOND, usual_effort_s};
    use crate::fit;
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;

    #[test]
    fn a_search_takes_as_long_as_its_records_are_worth() {
        let rig = Rig::load("eha").unwrap();
        let second = record(&rig);
        assert_eq!(second.duration(), 1.0);
        let effort_of = |count: usize| usual_effort_s(&vec![second.clone(); count]);
        assert_eq!([effort_of(2), effort_of(3)], [2.0 * EFFORT_PER_SECOND, 3.0 * EFFORT_PER_SECOND]);
        assert_eq!([effort_of(1), effort_of(20)], EFFORT_BOUNDS_S);
        // A thousand samples of a fast record take as many steps as a second.
        let swing: Vec<f64> = (0..2000).map(|k| 1e-3 * (f64::from(k) * 0.01).sin()).collect();
        let channels = vec![(Channel::Command, swing.clone()), (Channel::UserPosition, swing)];
        let fast = fit::prepare(&rig, &Record::new("fast".to_owned(), 1e-4, 0.0, channels).unwrap());
        assert_eq!(usual_effort_s(&[fast]), 2.0 * EFFORT_PER_SECOND);
    }
}
