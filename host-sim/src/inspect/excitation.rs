//! What a command can tell of the faults: the standard errors that the model's sensitivities foresee, before any fit.

use crate::failure::Failure;
use crate::fit::{self, Prepared};
use crate::output::quantity;
use crate::plant::Excitation;
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::channel::Channel;
use eha_monitor::command::{COMMANDS, Command, CommandInfo, Shape};
use eha_monitor::model::Drive;
use rayon::prelude::*;

const MEASURED: usize = Channel::MEASURED.len();

/// Longest built-in command that is tried, s.
const LONGEST_S: f64 = 5.0;

/// Amplitudes that are tried, in those of the command.
const AMPLITUDES: [f64; 3] = [0.5, 1.0, 2.0];

/// Sets of channels that are compared, as indices of [`Channel::MEASURED`].
const SETS: [&[usize]; 4] = [&[0], &[0, 2], &[0, 1], &[0, 1, 2, 3]];

/// The standard errors that a set of channels promises.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// The channels.
    pub channels: Vec<Channel>,
    /// Does the record have them all?
    pub recorded: bool,
    /// Standard error of each parameter; not finite where the channels say nothing about it.
    pub standard_errors: Vec<f64>,
}

/// What a built-in command promises.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// The command.
    pub command: &'static CommandInfo,
    /// Its amplitude, m (ramp: m/s); 0 where the shape fixes it.
    pub amplitude: f64,
    /// Its duration, s; it is flown again until it is as long as the record.
    pub duration_s: f64,
    /// Share of the samples in which the current is at its limit: there, sensitivities are large on paper and hang on
    /// the details of the limit.
    pub saturated_share: f64,
    /// Standard error of each parameter.
    pub standard_errors: Vec<f64>,
}

/// Share of samples at the limit of the current up to which a command is recommended.
const SATURATION: f64 = 0.01;

/// Trials that are shown to people.
pub const SHOWN: usize = 8;

/// Share of its range below which the 95 % interval of a parameter is called narrow, and fair.
const NARROW: f64 = 0.01;
const FAIR: f64 = 0.1;

/// How well a parameter would be known.
pub fn grade(range: &Range, standard_error: f64) -> &'static str {
    let share = 2.0 * fit::OF_95 * standard_error / (range.upper - range.lower);
    match share {
        _ if share < NARROW => "narrow",
        _ if share < FAIR => "fair",
        _ => "poor",
    }
}

/// What the grades mean.
pub fn grades() -> String {
    format!(
        "Interval: narrow where that of 95 % is below {:.0} % of the range of the search, fair below {:.0} %, else poor.",
        100.0 * NARROW,
        100.0 * FAIR
    )
}

impl Trial {
    /// Unit of the amplitude.
    pub fn amplitude_unit(&self) -> &'static str {
        if self.command.shape == Shape::Ramp { "m/s" } else { "m" }
    }

    /// The amplitude in words; a dash where the shape fixes it.
    pub fn amplitude_text(&self) -> String {
        if self.amplitude > 0.0 { quantity(self.amplitude, self.amplitude_unit()) } else { "-".to_owned() }
    }

    /// The command with its amplitude, where it has one.
    pub fn name(&self) -> String {
        if self.amplitude > 0.0 {
            format!("{} {}", self.command.name, self.amplitude_text())
        } else {
            self.command.name.to_owned()
        }
    }

    /// Does it keep the current at its limit for more than a moment?
    pub fn saturates(&self) -> bool {
        self.saturated_share > SATURATION
    }
}

/// What is asked: which parameters, where, with which noise.
#[derive(Clone, Debug)]
pub struct Question<'a> {
    /// The rig, with the values at which sensitivities are taken.
    pub rig: &'a Rig,
    /// The parameters.
    pub ranges: &'a [Range],
    /// Noise of the measured channels; not finite where the record lacks one.
    pub noise: [f64; MEASURED],
    /// What the standard errors of an open loop are multiplied by: it leaves more than noise.
    excess: f64,
}

/// Steps towards what an open loop leaves.
const STEPS: u32 = 5;

impl<'a> Question<'a> {
    /// What a record can tell of the parameters.
    pub fn new(rig: &'a Rig, ranges: &'a [Range], record: &Record) -> Self {
        let noise = fit::noise_of(rig, record);
        let mut question = Self { rig, ranges, noise, excess: 1.0 };
        question.excess = question.left_by_open_loop(record).unwrap_or(1.0);
        question
    }

    /// What an open loop leaves of a record, with the weight that its samples do not have because they repeat each other,
    /// in units of the noise. Whatever a model lacks is integrated twice there, and a loop corrects nothing: the noise of
    /// the sensor says little of what a fit will leave.
    fn left_by_open_loop(&self, record: &Record) -> Option<f64> {
        self.rig.restart_s.filter(|_| self.rig.controller.is_none())?;
        let records = [fit::prepare_with(self.rig, record, self.noise)];
        let found = fit::approach(self.rig, self.ranges, &self.start(), &records, STEPS)?;
        let predictions = fit::glimpse(&found.applied(self.rig, self.ranges), &records);
        let left = fit::residual_series(&[records[0].as_core()], &predictions, 0);
        Some((found.misfit.mean_square().max(1.0) * fit::correlation_time(&left)).sqrt())
    }

    /// Says so where an open loop leaves more than noise.
    pub fn excess_in_words(&self) -> Option<String> {
        (self.excess > 1.0).then(|| {
            "an open loop: the standard errors are those of what the model leaves of this record, not of its noise"
                .to_owned()
        })
    }

    /// The rig's values of the parameters.
    fn start(&self) -> Vec<f64> {
        self.ranges.iter().map(|range| self.rig.parameters.get(range.parameter)).collect()
    }

    /// The noise that is used: the record's, else what is assumed.
    pub fn noise_used(&self) -> [f64; MEASURED] {
        std::array::from_fn(|index| {
            if self.noise[index].is_finite() { self.noise[index] } else { fit::TYPICAL_NOISE[index] }
        })
    }

    /// What sets of channels would tell under the command of a record; those that its rig has.
    pub fn of_record(&self, record: &Record) -> Vec<Promise> {
        let prepared = fit::prepare_with(self.rig, record, self.noise_used());
        let Some(full) = self.imagined(&prepared, record) else { return Vec::new() };
        let is_measurable = |&index: &usize| self.rig.measurable().contains(&Channel::MEASURED[index]);
        SETS.into_iter()
            .filter(|set| set.iter().all(is_measurable))
            .map(|set| Promise {
                channels: set.iter().map(|&index| Channel::MEASURED[index]).collect(),
                recorded: set.iter().all(|&index| self.noise[index].is_finite()),
                standard_errors: self.standard_errors(&full, set),
            })
            .collect()
    }

    /// What the built-in commands promise with the channels of a record, for as long as it, best first, but those that
    /// keep the current at its limit last; none for a rig that follows no command.
    pub fn of_commands(&self, record: &Record) -> Vec<Trial> {
        if self.rig.form.drive == Drive::Force {
            return Vec::new();
        }
        let period = record.sample_period_s();
        let record_s = record.len() as f64 * period;
        let duration_s = record_s.min(LONGEST_S);
        let set: Vec<usize> = (0..MEASURED).filter(|&index| self.noise[index].is_finite()).collect();
        let trials: Vec<(&CommandInfo, f64)> = COMMANDS
            .iter()
            .flat_map(|info| {
                let multiples: &[f64] = if info.amplitude > 0.0 { &AMPLITUDES } else { &[0.0] };
                multiples.iter().map(move |multiple| (info, multiple * info.amplitude))
            })
            .collect();
        let mut found: Vec<Trial> = trials
            .into_par_iter()
            .filter_map(|(info, amplitude)| {
                let command = Command::<f64> { amplitude, ..Command::new(info) };
                let samples = (duration_s / period).round() as usize + 1;
                let excitation = Excitation {
                    sample_period: period,
                    command: (0..samples).map(|sample| command.at(sample as f64 * period)).collect(),
                    load: Vec::new(),
                    drive: Vec::new(),
                };
                let within = |value: &f64| value.abs() < self.rig.parameters.jack_stop;
                if !excitation.command.iter().all(within) {
                    return None;
                }
                let record = flown(info.name, &excitation).ok()?;
                let prepared = fit::prepare_with(self.rig, &record, self.noise_used());
                let full = self.imagined(&prepared, &record)?;
                // Flown again until it is as long as the record, a command says as much more each time.
                let again = (duration_s / (record_s.max(duration_s))).sqrt();
                let standard_errors =
                    self.standard_errors(&full, &set).iter().map(|error| error * again).collect();
                let limit = 0.999 * self.rig.parameters.current_limit;
                let current = full.measured(2);
                let saturated = current.iter().filter(|value| value.abs() >= limit).count();
                let saturated_share = saturated as f64 / current.len().max(1) as f64;
                Some(Trial { command: info, amplitude, duration_s, saturated_share, standard_errors })
            })
            .collect();
        found.sort_by(|a, b| {
            let badness = |trial: &Trial| self.badness(&trial.standard_errors);
            a.saturates().cmp(&b.saturates()).then(badness(a).total_cmp(&badness(b)))
        });
        found
    }

    /// How little standard errors say, all parameters together: mean of the logarithms of their shares of the ranges.
    pub fn badness(&self, standard_errors: &[f64]) -> f64 {
        let shares = standard_errors.iter().zip(self.ranges).map(|(error, range)| {
            let share = error / (range.upper - range.lower);
            if share.is_finite() { share.max(1e-12).ln() } else { 50.0 }
        });
        shares.sum::<f64>() / self.ranges.len().max(1) as f64
    }

    /// The record as the model would make it, with every channel.
    fn imagined(&self, prepared: &Prepared, record: &Record) -> Option<Prepared> {
        let outputs = fit::predict(self.rig, std::slice::from_ref(prepared)).pop()?;
        let mut channels: Vec<(Channel, Vec<f64>)> = record
            .channels()
            .filter(|(channel, _)| !Channel::MEASURED.contains(channel))
            .map(|(channel, values)| (channel, values.to_vec()))
            .collect();
        for (index, channel) in Channel::MEASURED.into_iter().enumerate() {
            channels.push((channel, outputs.iter().map(|output| output.to_array()[index]).collect()));
        }
        let full = Record::new(record.name(), prepared.sample_period, 0.0, channels).ok()?;
        Some(fit::prepare_with(self.rig, &full, self.noise_used()))
    }

    fn standard_errors(&self, full: &Prepared, set: &[usize]) -> Vec<f64> {
        let used = self.noise_used();
        let noise =
            std::array::from_fn(|index| if set.contains(&index) { used[index] } else { f64::INFINITY });
        let mut records = [full.clone()];
        records[0].noise = noise;
        match fit::foresee(self.rig, self.ranges, &self.start(), &records) {
            Some(foreseen) if self.excess > 1.0 => {
                (0..self.ranges.len()).map(|index| foreseen.standard_error(index) * self.excess).collect()
            }
            Some(foreseen) => fit::standard_errors(self.rig, self.ranges, &foreseen, &records),
            None => vec![f64::NAN; self.ranges.len()],
        }
    }
}

/// A record of a command whose position is the command itself: a place for the model to put its own.
fn flown(name: &str, excitation: &Excitation) -> Result<Record, Failure> {
    let channels =
        [Channel::Command, Channel::UserPosition].map(|channel| (channel, excitation.command.clone()));
    Ok(Record::new(name, excitation.sample_period, 0.0, channels.to_vec())?)
}
