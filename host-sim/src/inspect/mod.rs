//! What a record is worth, before any fit: its sampling, its channels, its motion, and what it can tell of the faults.

pub mod excitation;
mod likeness;
pub mod screen;
pub(crate) mod setup;
mod slack;

use crate::fit;
use crate::output::{counted, quantity};
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::channel::Channel;
use excitation::{Promise, Question, Trial};
pub use likeness::Response;
use likeness::{likeness, response};
use screen::{Defects, Screened, screen};

/// A record, and everything that is said of it.
#[derive(Clone, Debug)]
pub struct Inspection {
    /// The record.
    pub record: Record,
    /// What it shows.
    pub facts: Facts,
    /// What sets of channels promise.
    pub promises: Vec<Promise>,
    /// What the built-in commands promise, best first.
    pub trials: Vec<Trial>,
    /// How many times smaller standard errors the best command gives, where one can be recommended and the record tells
    /// something itself.
    pub best_gain: Option<f64>,
}

/// Gain from which on another command is recommended.
const WORTH_FLYING: f64 = 1.2;

impl Inspection {
    /// Looks at a record; `ranges` are the parameters that somebody wants to know.
    pub fn new(rig: &Rig, ranges: &[Range], record: Record) -> Self {
        let Screened { record: usable, defects, .. } = screen(rig, &record);
        let question = Question::new(rig, ranges, &usable);
        let promises = question.of_record(&usable);
        let trials = question.of_commands(&usable);
        let tells = |promise: &&Promise| {
            promise.recorded && promise.standard_errors.iter().all(|error| error.is_finite())
        };
        let own = promises.iter().filter(tells);
        let own = own.map(|promise| question.badness(&promise.standard_errors)).fold(f64::INFINITY, f64::min);
        let best_gain = trials
            .first()
            .filter(|best| !best.saturates())
            .map(|best| (own - question.badness(&best.standard_errors)).exp())
            .filter(|gain| gain.is_finite());
        let mut facts = facts(&record, &usable, &defects, &question.noise);
        facts.notes.extend(setup::remarks(rig, &usable));
        facts.notes.extend(question.excess_in_words());
        Self { record, facts, promises, trials, best_gain }
    }

    /// What all recorded channels together promise.
    pub fn own_promise(&self) -> Option<&Promise> {
        self.promises.iter().filter(|promise| promise.recorded).max_by_key(|promise| promise.channels.len())
    }

    /// What to fly next.
    pub fn advice(&self) -> String {
        match (self.best_gain, self.trials.first()) {
            (Some(gain), Some(best)) if gain > WORTH_FLYING => format!(
                "`{}` would give standard errors {gain:.1} times smaller (geometric mean of the faults)",
                best.name()
            ),
            (None, Some(best)) if !best.saturates() => {
                format!("`{}` would tell something", best.name())
            }
            _ => "no built-in command does much better than this record".to_owned(),
        }
    }
}

/// A channel of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelFacts {
    /// Which channel.
    pub channel: Channel,
    /// Smallest and largest value, in its unit.
    pub range: [f64; 2],
    /// Standard deviation of its white noise; not for an input.
    pub noise: Option<f64>,
    /// Step in which it is read; 0 where it shows none.
    pub quantum: f64,
    /// Lost samples.
    pub missing: usize,
    /// Longest run of lost samples, s.
    pub longest_gap_s: f64,
    /// What is wrong with its samples, if something is.
    pub defects: Option<Defects>,
    /// Share of the samples that rest exactly at the smallest or largest value of the channel.
    pub saturated_share: f64,
}

impl ChannelFacts {
    /// What [`cells`](Self::cells) holds.
    pub const COLUMNS: [&str; 10] = [
        "channel",
        "smallest",
        "largest",
        "noise",
        "step",
        "lost",
        "longest gap",
        "spikes",
        "stuck",
        "at min/max (clipped?)",
    ];

    /// How many spikes, flown or not, and stuck samples.
    pub fn defect_counts(&self) -> [usize; 2] {
        self.defects.as_ref().map_or([0; 2], |of| [of.spikes.len() + of.flown.len(), of.stuck.len()])
    }

    /// Samples from a reading of the sensor to the next.
    pub fn new_value_every(&self) -> usize {
        self.defects.as_ref().and_then(|of| of.held.as_ref()).map_or(1, |held| held.every)
    }

    /// The facts as a row of a table; `quantity` writes a value with its unit.
    pub fn cells(&self, quantity: fn(f64, &str) -> String) -> [String; 10] {
        let [spikes, stuck] = self.defect_counts();
        let info = self.channel.info();
        let shown = |value| quantity(value, info.unit);
        let or_none = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), shown);
        [
            info.column.to_owned(),
            shown(self.range[0]),
            shown(self.range[1]),
            or_none(self.noise),
            or_none(Some(self.quantum).filter(|&step| step > 0.0)),
            self.missing.to_string(),
            format!("{:.0} ms", self.longest_gap_s * 1e3),
            spikes.to_string(),
            stuck.to_string(),
            format!("{:.1} %", self.saturated_share * 100.0),
        ]
    }
}

/// What the ram did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Largest minus smallest position, m.
    pub travel_m: f64,
    /// Largest speed over 10 ms, m/s.
    pub top_speed_m_s: f64,
    /// Turning points.
    pub reversals: usize,
    /// Share of the time at rest.
    pub rest_share: f64,
}

impl Motion {
    /// The motion in words; `quantity` writes a value with its unit.
    pub fn in_words(&self, quantity: fn(f64, &str) -> String) -> String {
        format!(
            "travel {}, top speed {:.3} m/s, {}, {:.0} % of the time at rest",
            quantity(self.travel_m, "m"),
            self.top_speed_m_s,
            counted(self.reversals, "reversal"),
            self.rest_share * 100.0
        )
    }
}

/// What is said of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Its channels.
    pub channels: Vec<ChannelFacts>,
    /// Correlation of the position with the command so many samples before, from none on; empty where the command
    /// does not move.
    pub likeness: Vec<f64>,
    /// How it follows its command; none where the command does not move.
    pub response: Option<Response>,
    /// What the ram did.
    pub motion: Motion,
    /// What the user should look at.
    pub notes: Vec<String>,
}

/// Travel, in standard deviations of the noise, that is no motion: what noise alone has in a million samples.
const STILL_SIGMA: f64 = 12.0;
/// How far a position must go back for that to be a reversal, in standard deviations of the noise.
const TURN_SIGMA: f64 = 8.0;
/// Time over which a speed is taken, s.
const SPEED_S: f64 = 0.01;

/// What a record shows; `usable` is what a fit would take of it, `noise` that of its measured channels.
fn facts(record: &Record, usable: &Record, defects: &[Defects], noise: &[f64]) -> Facts {
    let channels: Vec<ChannelFacts> = record
        .channels()
        .map(|(channel, values)| {
            let defects = defects.iter().find(|defects| defects.channel == channel);
            channel_facts(record, (channel, values), defects, noise)
        })
        .collect();
    let position = usable.channel(Channel::UserPosition).unwrap_or_default();
    let command = usable.channel(Channel::Command).unwrap_or_default();
    let likeness = likeness(position, command, record.sample_period_s());
    let response = response(&likeness, record.sample_period_s());
    let motion = motion(position, record.sample_period_s(), noise[0]);
    let is_still = response.is_none() && motion.travel_m < STILL_SIGMA * noise[0];
    let notes = notes(record, &channels, response, is_still);
    Facts { channels, likeness, response, motion, notes }
}

fn finite(values: &[f64]) -> impl Iterator<Item = f64> {
    values.iter().copied().filter(|value| value.is_finite())
}

fn channel_facts(
    record: &Record,
    (channel, values): (Channel, &[f64]),
    defects: Option<&Defects>,
    noise: &[f64],
) -> ChannelFacts {
    let measured = Channel::MEASURED.into_iter().position(|known| known == channel);
    let gaps = values.chunk_by(|a, b| a.is_nan() == b.is_nan()).filter(|run| run[0].is_nan());
    ChannelFacts {
        channel,
        range: fit::extent(values),
        noise: measured.map(|index| noise[index]).filter(|noise| noise.is_finite()),
        quantum: if measured.is_some() { fit::quantum(values) } else { 0.0 },
        missing: record.missing_count(channel),
        defects: defects.cloned(),
        longest_gap_s: gaps.map(<[f64]>::len).max().unwrap_or(0) as f64 * record.sample_period_s(),
        saturated_share: fit::share_at_ends(values),
    }
}

fn motion(position: &[f64], period: f64, noise: f64) -> Motion {
    let values: Vec<f64> = finite(position).collect();
    let [low, high] = fit::extent(position);
    let reach = ((SPEED_S / period).round() as usize).max(1);
    let moves: Vec<f64> = values.windows(reach + 1).map(|window| (window[reach] - window[0]).abs()).collect();
    let top = moves.iter().copied().fold(0.0, f64::max);
    let resting = moves.iter().filter(|&&moved| moved < 4.0 * noise).count();
    Motion {
        travel_m: high - low,
        top_speed_m_s: top / (reach as f64 * period),
        reversals: reversals(&values, (TURN_SIGMA * noise).max(0.01 * (high - low))),
        rest_share: resting as f64 / moves.len().max(1) as f64,
    }
}

/// Turning points of a series, of more than `least` each.
fn reversals(values: &[f64], least: f64) -> usize {
    let Some(&first) = values.first() else { return 0 };
    let (mut extreme, mut direction, mut count) = (first, 0.0, 0);
    for &value in values {
        if direction == 0.0 {
            if (value - first).abs() > least {
                direction = (value - first).signum();
                extreme = value;
            }
        } else if (value - extreme) * direction > 0.0 {
            extreme = value;
        } else if (extreme - value) * direction > least {
            direction = -direction;
            extreme = value;
            count += 1;
        }
    }
    count
}

fn notes(
    record: &Record,
    channels: &[ChannelFacts],
    response: Option<Response>,
    is_still: bool,
) -> Vec<String> {
    let mut notes = Vec::new();
    let samples = record.len() as f64;
    for facts in channels {
        let info = facts.channel.info();
        let column = info.column;
        if facts.missing > 0 {
            notes.push(format!(
                "{column}: {} samples lost ({:.1} %), at most {} ms in a row",
                facts.missing,
                facts.missing as f64 / samples * 100.0,
                (facts.longest_gap_s * 1e3).round()
            ));
        }
        notes.extend(facts.defects.as_ref().and_then(|defects| defects.in_words(record)));
        if let Some(noise) = facts.noise.filter(|noise| facts.quantum > 2.0 * noise) {
            let [step, noise] = [facts.quantum, noise].map(|value| quantity(value, info.unit));
            notes.push(format!("{column} is read in steps of {step}, coarser than its noise of {noise}"));
        }
    }
    if is_still {
        notes.push("this record says nothing: command and actuator do not move".to_owned());
        return notes;
    }
    match response {
        None => notes.push("the command does not move".to_owned()),
        Some(response) if response.correlation < 0.5 => notes.push(format!(
            "the position hardly follows the command (correlation {:.2}): is it the command of this record?",
            response.correlation
        )),
        Some(_) => {}
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_points_count_above_the_noise_only() {
        let wave: Vec<f64> =
            (0..2000).map(|k| (f64::from(k) * 0.01).sin() + 1e-3 * f64::from(k % 2)).collect();
        assert_eq!(reversals(&wave, 0.01), 6);
        assert_eq!(reversals(&[1.0; 50], 0.01), 0);
    }
}
