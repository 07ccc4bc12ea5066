//! Samples that no actuator makes: spikes on the line of a sensor, words of a bus that were lost or came twice.
//!
//! One of them weighs in a sum of squares as much as thousands of good samples, and a fit would call it friction. They
//! are told from motion without a model: a position does not jump and jump back. A corner of the motion, such as the
//! user's where the backlash is used up, continues the line on one side of it; a spike continues neither.

use crate::fit;
use crate::record::Record;
use crate::rig::Rig;
use eha_monitor::channel::Channel;
use std::ops::Range;

/// Departure from the lines on both sides, in standard deviations of the noise, that makes a spike.
const SPIKE_SIGMA: f64 = 10.0;
/// Departure in those that are usual around it that makes a spike; both are asked for.
const UNUSUAL: f64 = 5.0;
/// Where a spike of a position lasts for several samples, or at an end of a record, where only one side is there: how
/// far it jumps, in the largest steps within and around it, and of the record but for one in a hundred. A corner of the
/// motion is as large as one step.
const STEPS: f64 = 3.0;
/// Longest spike of a position, s. Other quantities may jump and jump back.
const LONGEST_S: f64 = 0.02;
/// Samples on each side that say what is usual.
const AROUND: usize = 10;
/// Samples on each side among which two give a line.
const REACH: usize = 5;
/// Share of defects above which they are what the channel is like.
const MOST: f64 = 0.05;
/// Friction cannot set the pressure of an actuator that moves as high as that share of the supply's, and when it lets
/// go, the pressure falls within a sample.
const PRESSURE_SHARE: f64 = 0.5;
/// What the line through two neighbours makes of white noise in three samples, in its standard deviation: `sqrt(1 + 4 +
/// 1)`.
const OF_THREE: f64 = 2.449_489_742_783_178;

/// What is wrong with the samples of a channel: indices, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Defects {
    /// The channel.
    pub channel: Channel,
    /// Samples that jump away from the motion, and the motion goes on without them.
    pub spikes: Vec<usize>,
    /// Samples that repeat the one before them, digit by digit, though the motion went on.
    pub stuck: Vec<usize>,
}

impl Defects {
    /// The samples of both kinds.
    pub fn samples(&self) -> impl Iterator<Item = usize> + '_ {
        self.spikes.iter().chain(&self.stuck).copied()
    }

    /// Are they so many that they are no defects, and left in?
    fn is_usual(&self, record: &Record) -> bool {
        self.samples().count() as f64 > MOST * record.len() as f64
    }

    /// The defects in words; `record` is the one that has them.
    pub(super) fn in_words(&self, record: &Record) -> String {
        let kinds = [(&self.spikes, "spike", "spikes"), (&self.stuck, "stuck sample", "stuck samples")];
        let kinds: Vec<String> = kinds
            .into_iter()
            .filter_map(|(samples, one, many)| {
                let first = record.time_s(*samples.first()?);
                let last = record.time_s(*samples.last()?);
                Some(match samples.len() {
                    1 => format!("a {one} at {first} s"),
                    count => format!("{count} {many} from {first} to {last} s"),
                })
            })
            .collect();
        let fate = if self.is_usual(record) { "too many to leave out" } else { "left out of every fit" };
        format!("{}: {}: {fate}", self.channel.info().column, kinds.join(", "))
    }
}

/// What is wrong with the samples of a record: an entry for each channel with defects.
fn defects(rig: &Rig, record: &Record) -> Vec<Defects> {
    let longest = ((LONGEST_S / record.sample_period_s()) as usize).max(1);
    let command = record.channel(Channel::Command).unwrap_or_default();
    Channel::MEASURED
        .into_iter()
        .zip(fit::MODEL_ERROR)
        .filter_map(|(channel, model_error)| {
            let values = record.channel(channel)?;
            let noise = fit::noise_of_series(values);
            let least = SPIKE_SIGMA * noise.max(model_error);
            let (stuck, spikes) = match channel {
                Channel::UserPosition | Channel::RamPosition => {
                    let stuck = stuck(values, least);
                    let spikes = spikes(&lost(values, &stuck), least, Some(longest));
                    (stuck, spikes)
                }
                Channel::Pressure => {
                    let least = PRESSURE_SHARE * rig.parameters.supply_pressure / OF_THREE;
                    (Vec::new(), spikes(values, least, None))
                }
                _ => {
                    // A controller answers a spike of its command with one of its own.
                    let asked = spikes(command, SPIKE_SIGMA * fit::noise_of_series(command), None);
                    let mut spikes = spikes(values, least, None);
                    spikes.retain(|sample| asked.binary_search(sample).is_err());
                    (Vec::new(), spikes)
                }
            };
            Some(Defects { channel, spikes, stuck }).filter(|defects| defects.samples().next().is_some())
        })
        .collect()
}

/// A record whose samples have been looked at.
#[derive(Clone, Debug)]
pub struct Screened {
    /// The record, its defects lost samples.
    pub record: Record,
    /// The defects of each channel that has some.
    pub defects: Vec<Defects>,
    /// What the user should know of it, a line for each of them that starts with the record.
    pub notes: Vec<String>,
}

/// Leaves out what is wrong with the samples of a record; not where that is more than one in twenty.
pub fn screen(rig: &Rig, record: &Record) -> Screened {
    let defects = defects(rig, record);
    let left_out = |channel: Channel| -> Vec<usize> {
        let mut of_channel = defects.iter().filter(|of| of.channel == channel && !of.is_usual(record));
        of_channel.next().map_or_else(Vec::new, |of| of.samples().collect())
    };
    let notes = defects.iter().map(|of| format!("{}: {}", record.name(), of.in_words(record))).collect();
    Screened { record: record.with_lost(left_out), notes, defects }
}

/// The values without some of them.
fn lost(values: &[f64], samples: &[usize]) -> Vec<f64> {
    let mut values = values.to_vec();
    for &sample in samples {
        values[sample] = f64::NAN;
    }
    values
}

/// Samples that lie off the lines on both sides by more than `least` on the same side; where the quantity cannot jump,
/// runs of them too, of at most `longest`, and those at an end.
fn spikes(values: &[f64], least: f64, longest: Option<usize>) -> Vec<usize> {
    let mut large: Vec<f64> = steps(values).collect();
    large.sort_by(f64::total_cmp);
    let jump = least.max(STEPS * large.get(large.len() * 99 / 100).copied().unwrap_or(0.0));
    let mut left = values.to_vec();
    let mut found = Vec::new();
    // One may hide another beside it.
    loop {
        let before = found.len();
        for first in 0..left.len() {
            let ends = first..(first + longest.unwrap_or(1)).min(left.len());
            let mut runs = ends.take_while(|&last| left[last].is_finite()).map(|last| first..last + 1);
            let is_spike = |run: &Range<usize>| {
                is_single_spike(&left, run, least) || longest.is_some() && is_jump(&left, run, jump)
            };
            if let Some(run) = runs.find(is_spike) {
                left[run.clone()].fill(f64::NAN);
                found.extend(run);
            }
        }
        if found.len() == before {
            found.sort_unstable();
            return found;
        }
    }
}

/// Does a run of a single sample lie off the lines on both sides, and off the cubic through both, by more than `least`
/// and than is usual around it?
fn is_single_spike(values: &[f64], run: &Range<usize>, least: f64) -> bool {
    let sides = [before(values, run), after(values, run)];
    let [Some(entry), Some(exit), Some(across)] = [
        departure(values, run.start, (0..run.start).rev()),
        departure(values, run.start, run.end..values.len()),
        from_cubic(values, run.start),
    ] else {
        return false;
    };
    let smallest = entry.abs().min(exit.abs()).min(across.abs());
    let is_one_sided = entry * exit > 0.0 && entry * across > 0.0;
    if run.len() > 1 || !is_one_sided || smallest <= least {
        return false;
    }
    let mut bends: Vec<f64> =
        sides.iter().flat_map(|side| side.windows(3)).map(bend).filter(|bend| bend.is_finite()).collect();
    bends.sort_by(f64::total_cmp);
    smallest > UNUSUAL * bends.get(bends.len() / 2).copied().unwrap_or(0.0)
}

/// Does a run lie off what is on both sides of it by more than `jump` and than the steps within and around it, and off
/// the lines there?
fn is_jump(values: &[f64], run: &Range<usize>, jump: f64) -> bool {
    let sides = [before(values, run), after(values, run)];
    let largest = sides.into_iter().chain([&values[run.clone()]]).flat_map(steps).fold(0.0, f64::max);
    let limit = jump.max(STEPS * largest);
    let is_present = |value: &&f64| value.is_finite();
    let beside = [sides[0].iter().rev().find(is_present), sides[1].iter().find(is_present)];
    let is_off = |value: &f64| beside.into_iter().flatten().all(|other| (value - other).abs() > limit);
    let ends = [
        departure(values, run.start, (0..run.start).rev()),
        departure(values, run.end - 1, run.end..values.len()),
    ];
    let departures = || ends.into_iter().flatten();
    departures().next().is_some()
        && (departures().all(|d| d > limit) || departures().all(|d| d < -limit))
        && values[run.clone()].iter().all(is_off)
}

/// Samples before a run.
fn before<'a>(values: &'a [f64], run: &Range<usize>) -> &'a [f64] {
    &values[run.start.saturating_sub(AROUND)..run.start]
}

/// Samples after a run.
fn after<'a>(values: &'a [f64], run: &Range<usize>) -> &'a [f64] {
    &values[run.end..(run.end + AROUND).min(values.len())]
}

/// Sizes of the steps from sample to sample.
fn steps(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| step.is_finite())
}

/// How far a sample lies off the line through the nearest two of the samples on one side, in units in which white noise
/// has its own standard deviation; none where they are lost.
fn departure(values: &[f64], at: usize, side: impl Iterator<Item = usize>) -> Option<f64> {
    let mut present = side.take(REACH).filter(|&sample| values[sample].is_finite());
    let (near, far) = (present.next()?, present.next()?);
    let slope = near.abs_diff(at) as f64 / near.abs_diff(far) as f64;
    let off = values[at] - values[near] - slope * (values[near] - values[far]);
    Some(off / (1.0 + (1.0 + slope) * (1.0 + slope) + slope * slope).sqrt())
}

/// How far a sample lies off the cubic through the two samples on each side, in the same units: what bends does not;
/// none where one is lost.
fn from_cubic(values: &[f64], at: usize) -> Option<f64> {
    let around = values.get(at.checked_sub(2)?..at + 3)?;
    let foretold = (4.0 * (around[1] + around[3]) - around[0] - around[4]) / 6.0;
    Some((around[2] - foretold) / (1.0 + 34.0 / 36.0_f64).sqrt()).filter(|off| off.is_finite())
}

/// How far the middle one of three samples lies off the line through the others, in the same units.
fn bend(three: &[f64]) -> f64 {
    (three[0] - 2.0 * three[1] + three[2]).abs() / OF_THREE
}

/// Samples of a position that repeat the one before them, and then it jumps by more than `least` and than the steps
/// around: what moved on meanwhile. Something that stood still starts with a step like those that follow.
fn stuck(values: &[f64], least: f64) -> Vec<usize> {
    let (mut found, mut start) = (Vec::new(), 0);
    for run in values.chunk_by(|a, b| a == b) {
        let run = start..start + run.len();
        let sides = [before(values, &run), after(values, &run)];
        let largest = sides.into_iter().flat_map(steps).fold(0.0, f64::max);
        let jump = values.get(run.end).map_or(0.0, |next| (next - values[start]).abs());
        if run.len() > 1 && jump > least.max(STEPS * largest) {
            found.extend(start + 1..run.end);
        }
        start = run.end;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{self, Excitation, Sensing};
    use crate::rig::BUILT_IN;
    use eha_monitor::command::COMMANDS;
    use eha_monitor::parameter::Parameter;

    /// A record of the default actuator with 0.5 mm of backlash and 2000 N of friction.
    fn flown(command: &str, noise: f64) -> (Rig, Record) {
        let mut rig = (BUILT_IN[0].make)();
        rig.parameters.set(Parameter::Backlash, 5e-4);
        rig.parameters.set(Parameter::DryFriction, 2000.0);
        let excitation = Excitation::of_command(command, 2000, 1e-3).unwrap();
        let outputs = plant::run(&rig, &excitation, 1e-5);
        let noise = [
            (Channel::UserPosition, noise),
            (Channel::RamPosition, noise),
            (Channel::Current, 4e3 * noise),
            (Channel::Pressure, 1e9 * noise),
        ];
        let sensing = Sensing { noise: noise.to_vec(), ..Sensing::default() };
        let record = plant::record(command, rig.form, &excitation, &outputs, &sensing, 7).unwrap();
        (rig, record)
    }

    /// The record, a channel changed.
    fn changed(record: &Record, channel: Channel, change: impl Fn(&mut [f64])) -> Record {
        let channels = record.channels().map(|(of, values)| {
            let mut values = values.to_vec();
            if of == channel {
                change(&mut values);
            }
            (of, values)
        });
        Record::new("changed", record.sample_period_s(), 0.0, channels.collect()).unwrap()
    }

    #[test]
    fn an_actuator_makes_no_defect() {
        for command in COMMANDS {
            for noise in [0.0, 1e-6, 1e-5] {
                let (rig, record) = flown(command.name, noise);
                assert_eq!(screen(&rig, &record).notes, [""; 0], "{} with {noise} m of noise", command.name);
            }
        }
    }

    #[test]
    fn spikes_are_found_where_they_are() {
        for command in ["chirp", "sine", "mixed-step"] {
            let (rig, record) = flown(command, 5e-6);
            // At the ends, alone, two side by side of both signs, one apart from another, words of zeros.
            let spikes = [0, 400, 700, 701, 900, 902, 1300, 1999];
            let stuck = [1301, 1302, 1303];
            let spiky = changed(&record, Channel::UserPosition, |values| {
                for (index, &sample) in spikes.iter().enumerate() {
                    values[sample] += if index % 2 == 0 { 3e-3 } else { -2e-3 };
                }
                values[1300..1304].fill(-2e-2);
            });
            let Screened { record: screened, defects, notes } = screen(&rig, &spiky);
            assert_eq!(defects.len(), 1, "{defects:?}");
            assert_eq!(defects[0].channel, Channel::UserPosition);
            assert_eq!(
                (&defects[0].spikes[..], &defects[0].stuck[..]),
                (&spikes[..], &stuck[..]),
                "{command}"
            );
            let expected = "changed: lvdt_m: 8 spikes from 0 to 1.999 s, 3 stuck samples from 1.301 to 1.303 s: left out \
                            of every fit";
            assert_eq!(notes, [expected]);
            assert_eq!(screened.missing_count(Channel::UserPosition), 11);
        }
    }

    #[test]
    fn what_is_within_the_noise_or_usual_is_left_in() {
        let (rig, record) = flown("chirp", 5e-6);
        let small = changed(&record, Channel::UserPosition, |values| values[400] += 4e-5);
        assert_eq!(screen(&rig, &small).defects, []);
        let many = changed(&record, Channel::UserPosition, |values| {
            for value in values.iter_mut().step_by(15) {
                *value += 1e-3;
            }
        });
        let Screened { record: screened, notes, .. } = screen(&rig, &many);
        assert!(notes[0].ends_with("too many to leave out"), "{notes:?}");
        assert_eq!(screened.missing_count(Channel::UserPosition), 0);
    }

    #[test]
    fn a_sensor_that_repeats_itself_while_the_ram_moves_is_stuck() {
        for noise in [0.0, 5e-6] {
            let (rig, record) = flown("sine", noise);
            let held = changed(&record, Channel::RamPosition, |values| {
                let word = values[500];
                values[501..513].fill(word);
            });
            let defects = screen(&rig, &held).defects;
            assert_eq!(defects.len(), 1, "{defects:?}");
            assert_eq!(defects[0].stuck, (501..513).collect::<Vec<_>>());
            let coarse = changed(&record, Channel::RamPosition, |values| {
                for value in values {
                    *value = (*value / 5e-5).round() * 5e-5;
                }
            });
            assert_eq!(screen(&rig, &coarse).defects, []);
        }
    }

    #[test]
    fn a_controller_that_answers_a_spike_of_its_command_has_none_itself() {
        let (rig, record) = flown("sine", 5e-6);
        let spiky = changed(&record, Channel::Current, |values| values[700] += 3.0);
        assert_eq!(screen(&rig, &spiky).defects[0].spikes, [700]);
        let asked = changed(&spiky, Channel::Command, |values| values[700] += 3e-4);
        assert_eq!(screen(&rig, &asked).defects, []);
    }
}
