//! What a record is worth, before any fit: its sampling, its channels, its motion, and what it can tell of the faults.

pub mod excitation;
pub mod screen;

use crate::fit;
use crate::output::{counted, quantity};
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::channel::{Channel, ChannelRole};
use excitation::{Promise, Question, Trial};
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
    /// How many times smaller standard errors the best command gives, where one can be recommended.
    pub best_gain: Option<f64>,
}

/// Gain from which on another command is recommended.
const WORTH_FLYING: f64 = 1.2;

impl Inspection {
    /// Looks at a record; `ranges` are the parameters that somebody wants to know.
    pub fn new(rig: &Rig, ranges: &[Range], record: Record) -> Self {
        let Screened { record: usable, defects, .. } = screen(rig, &record);
        let noise = fit::noise_of(rig, &usable);
        let question = Question { rig, ranges, noise };
        let promises = question.of_record(&usable);
        let trials = question.of_commands(&usable);
        let own = promises.iter().filter(|promise| promise.recorded);
        let own = own.map(|promise| question.badness(&promise.standard_errors)).fold(f64::INFINITY, f64::min);
        let best_gain = trials
            .first()
            .filter(|best| !best.saturates())
            .map(|best| (own - question.badness(&best.standard_errors)).exp());
        Self { facts: facts(&record, &usable, &defects, &noise), promises, trials, best_gain, record }
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
    /// Share of the samples that rest exactly on an extreme of the channel.
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
        "on an extreme",
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

/// How the position follows the command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Delay at which the position is most like the command, s.
    pub delay_s: f64,
    /// Correlation at that delay.
    pub correlation: f64,
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

/// Share of samples on an extreme above which a channel is called saturated.
const SATURATED: f64 = 0.01;
/// Longest delay of the position that is looked for, s.
const LONGEST_DELAY_S: f64 = 0.5;
/// Difference of correlations that does not count.
const ABOUT_AS_HIGH: f64 = 0.02;
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
    let likeness = likeness(usable);
    let response = response(&likeness, record.sample_period_s());
    let motion = motion(position, record.sample_period_s(), noise[0]);
    let notes = notes(record, &channels, response, motion);
    Facts { channels, likeness, response, motion, notes }
}

fn finite(values: &[f64]) -> impl Iterator<Item = f64> {
    values.iter().copied().filter(|value| value.is_finite())
}

fn range(values: &[f64]) -> [f64; 2] {
    finite(values)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// Does a sample rest on an extreme of its channel? One is always on each; a limit shows as a run of equal values.
pub fn rests(values: &[f64]) -> Vec<bool> {
    let [low, high] = range(values);
    values
        .chunk_by(|a, b| a == b)
        .flat_map(|run| {
            let rests = run.len() >= 3 && (run[0] == low || run[0] == high);
            std::iter::repeat_n(rests, run.len())
        })
        .collect()
}

fn channel_facts(
    record: &Record,
    (channel, values): (Channel, &[f64]),
    defects: Option<&Defects>,
    noise: &[f64],
) -> ChannelFacts {
    let measured = Channel::MEASURED.into_iter().position(|known| known == channel);
    let gaps = values.chunk_by(|a, b| a.is_nan() == b.is_nan()).filter(|run| run[0].is_nan());
    let resting = rests(values).into_iter().filter(|&rests| rests).count();
    ChannelFacts {
        channel,
        range: range(values),
        noise: measured.map(|index| noise[index]).filter(|noise| noise.is_finite()),
        quantum: if measured.is_some() { fit::quantum(values) } else { 0.0 },
        missing: record.missing_count(channel),
        defects: defects.cloned(),
        longest_gap_s: gaps.map(<[f64]>::len).max().unwrap_or(0) as f64 * record.sample_period_s(),
        saturated_share: resting as f64 / values.len().max(1) as f64,
    }
}

fn likeness(record: &Record) -> Vec<f64> {
    let position = record.channel(Channel::UserPosition).unwrap_or_default();
    let command = record.channel(Channel::Command).unwrap_or_default();
    let [low, high] = range(command);
    if low >= high {
        return Vec::new();
    }
    let most = ((LONGEST_DELAY_S / record.sample_period_s()) as usize).min(position.len() / 4);
    (0..=most).map(|delay| correlation(&position[delay..], command)).collect()
}

fn response(likeness: &[f64], period: f64) -> Option<Response> {
    let highest = likeness.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Of a periodic command every period is as good: the first top that is about as high.
    let is_top = |&delay: &usize| {
        let next = likeness.get(delay + 1).copied().unwrap_or(f64::NEG_INFINITY);
        likeness[delay] >= next && likeness[delay] > highest - ABOUT_AS_HIGH
    };
    let best = (0..likeness.len()).find(is_top)?;
    // The top of the parabola through the best delay and its neighbours.
    let shift = match (best.checked_sub(1).map(|before| likeness[before]), likeness.get(best + 1)) {
        (Some(before), Some(after)) if before + after < 2.0 * likeness[best] => {
            0.5 * (before - after) / (before + after - 2.0 * likeness[best])
        }
        _ => 0.0,
    };
    Some(Response { delay_s: (best as f64 + shift) * period, correlation: likeness[best] })
}

/// Correlation of two series, over the samples that both have.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let pairs = || a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite());
    let count = pairs().count().max(1) as f64;
    let (mean_a, mean_b) =
        (pairs().map(|(a, _)| a).sum::<f64>() / count, pairs().map(|(_, b)| b).sum::<f64>() / count);
    let (mut product, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
    for (a, b) in pairs() {
        product += (a - mean_a) * (b - mean_b);
        square_a += (a - mean_a) * (a - mean_a);
        square_b += (b - mean_b) * (b - mean_b);
    }
    product / (square_a * square_b).sqrt().max(f64::MIN_POSITIVE)
}

fn motion(position: &[f64], period: f64, noise: f64) -> Motion {
    let values: Vec<f64> = finite(position).collect();
    let [low, high] = range(position);
    let reach = ((SPEED_S / period).round() as usize).max(1);
    let moves: Vec<f64> = values.windows(reach + 1).map(|window| (window[reach] - window[0]).abs()).collect();
    let top = moves.iter().copied().fold(0.0, f64::max);
    let resting = moves.iter().filter(|&&moved| moved < 4.0 * noise).count();
    Motion {
        travel_m: high - low,
        top_speed_m_s: top / (reach as f64 * period),
        reversals: reversals(&values, (8.0 * noise).max(0.01 * (high - low))),
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
    motion: Motion,
) -> Vec<String> {
    let mut notes = Vec::new();
    let samples = record.len() as f64;
    for facts in channels {
        let info = facts.channel.info();
        let column = info.column;
        if info.role == ChannelRole::Measured && facts.saturated_share > SATURATED {
            notes.push(format!(
                "{column} rests on an extreme in {:.1} % of the samples: is it cut off?",
                facts.saturated_share * 100.0
            ));
        }
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
    match response {
        None => notes.push("the command does not move".to_owned()),
        Some(response) if response.correlation < 0.5 => notes.push(format!(
            "the position hardly follows the command (correlation {:.2}): is it the command of this record?",
            response.correlation
        )),
        Some(_) => {}
    }
    if motion.reversals == 0 {
        notes.push("the ram never turns: backlash does not show without a reversal".to_owned());
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

    #[test]
    fn a_delay_is_found_between_the_samples() {
        let wave = |t: f64| (std::f64::consts::TAU * 2.0 * t).sin();
        let command: Vec<f64> = (0..2000).map(|k| wave(f64::from(k) * 1e-3)).collect();
        let position: Vec<f64> = (0..2000).map(|k| 0.9 * wave(f64::from(k) * 1e-3 - 0.0123)).collect();
        let record = |command: &[f64], position: &[f64]| {
            let channels = [(Channel::Command, command), (Channel::UserPosition, position)];
            let channels = channels.map(|(channel, values)| (channel, values.to_vec()));
            Record::new("wave", 1e-3, 0.0, channels.to_vec()).unwrap()
        };
        let found = response(&likeness(&record(&command, &position)), 1e-3).unwrap();
        assert!((found.delay_s - 0.0123).abs() < 2e-4 && found.correlation > 0.999, "{found:?}");
        assert!(likeness(&record(&[0.0; 2000], &position)).is_empty());
    }
}
