//! Samples that no actuator makes: spikes on the line of a sensor, words of a bus that were lost or came twice.
//!
//! One of them weighs in a sum of squares as much as thousands of good samples, and a fit would call it friction. They
//! are told from motion without a model: a position does not jump and jump back. A corner of the motion, such as the
//! user's where the backlash is used up, continues the line on one side of it; a spike continues neither.

mod held;
mod spikes;
mod stuck;

use crate::fit;
use crate::output::counted;
use crate::record::{LONGEST_GAP_S, Record};
use crate::rig::Rig;
use eha_monitor::channel::{Channel, ChannelRole};
use eha_monitor::model::Drive;
use eha_monitor::parameter::{Parameter, Parameters};
use held::{Held, held, on_coarse_steps};
use spikes::{OF_THREE, spikes};
use std::iter;
use std::ops::Range;
use stuck::{chance_of_repeat, filled, filled_as_well, repeating};

/// Departure from the lines on both sides, in standard deviations of the noise, that makes a spike.
const SPIKE_SIGMA: f64 = 10.0;
/// Longest spike of a position, s. Other quantities may jump and jump back.
const LONGEST_S: f64 = 0.02;
/// Share of defects above which they are what the channel is like.
const MOST: f64 = 0.05;
/// Rows that may come twice by chance in a record whose noise would not.
const FEW: f64 = 0.1;
/// Friction cannot set the pressure of an actuator that moves as high as that share of the supply's, and when it lets
/// go, the pressure falls within a sample.
const PRESSURE_SHARE: f64 = 0.5;

/// What is wrong with the samples of a channel: indices, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Defects {
    /// The channel.
    pub channel: Channel,
    /// Samples that jump away from the motion, and the motion goes on without them.
    pub spikes: Vec<usize>,
    /// Samples that repeat the one before them, digit by digit, though the motion went on, or that somebody put on a
    /// straight line.
    pub stuck: Vec<usize>,
    /// Samples of a command that jump and jump back where no sensor shows a defect: it may have been flown so.
    pub flown: Vec<usize>,
    /// How it is read, where that is less often than it is recorded.
    pub held: Option<Held>,
    /// Samples that say nothing new because the channel is read in coarse steps.
    pub coarse: Vec<usize>,
}

impl Defects {
    /// Those of a channel that has none.
    fn none(channel: Channel) -> Self {
        let none = Vec::new;
        Self { channel, spikes: none(), stuck: none(), flown: none(), held: None, coarse: none() }
    }

    /// Spikes and stuck samples.
    pub fn samples(&self) -> impl Iterator<Item = usize> + '_ {
        self.spikes.iter().chain(&self.stuck).copied()
    }

    /// Are those of a sensor so many that they are no defects, and left in?
    fn is_usual(&self, record: &Record) -> bool {
        self.channel != Channel::Command && self.samples().count() as f64 > MOST * record.len() as f64
    }

    /// The samples that no fit takes.
    fn left_out(&self, record: &Record) -> Vec<usize> {
        let mut all = self.coarse.clone();
        merge(&mut all, self.held.iter().flat_map(|held| held.repeats.iter().copied()));
        if !self.is_usual(record) {
            merge(&mut all, self.samples());
        }
        all
    }

    /// The defects in words, if there are some; `record` is the one that has them.
    pub(super) fn in_words(&self, record: &Record) -> Option<String> {
        let some = |samples: &[usize], one: &str, many: &str| {
            let first = record.time_s(*samples.first()?);
            let last = record.time_s(*samples.last()?);
            Some(match samples.len() {
                1 => format!("a {one} at {first} s"),
                count => format!("{count} {many} from {first} to {last} s"),
            })
        };
        let is_measured = self.channel.info().role == ChannelRole::Measured;
        let stuck = if is_measured {
            some(&self.stuck, "stuck sample", "stuck samples")
        } else {
            some(&self.stuck, "repeated value", "repeated values")
        };
        let defects = [some(&self.spikes, "spike", "spikes"), stuck];
        let defects: Vec<String> = defects.into_iter().flatten().collect();
        let fate = match self.channel.info().role {
            _ if self.is_usual(record) => "too many to leave out",
            ChannelRole::Measured => "left out of every fit",
            _ => "bridged, and left out of the sensors as well",
        };
        let lost = (!defects.is_empty()).then(|| format!("{}: {fate}", defects.join(", ")));
        let flown = some(&self.flown, "spike", "spikes")
            .map(|flown| format!("{flown}: taken as flown, since no position shows a defect there"));
        let held = self.held.as_ref().map(|held| {
            format!("a new value every {} samples only: those between are left out of every fit", held.every)
        });
        let coarse = (!self.coarse.is_empty()).then(|| {
            let count = counted(self.coarse.len(), "sample");
            format!("{count} that stay on one of its coarse steps are left out of every fit")
        });
        let all: Vec<String> = [lost, flown, held, coarse].into_iter().flatten().collect();
        (!all.is_empty()).then(|| format!("{}: {}", self.channel.info().column, all.join("; ")))
    }
}

/// What is wrong with the samples of a record: an entry for each sensor with defects, and for the command.
fn defects(rig: &Rig, record: &Record) -> Vec<Defects> {
    let repeated = repeated_rows(record);
    let mut all: Vec<Defects> = iter::zip(Channel::MEASURED, fit::MODEL_ERROR)
        .filter_map(|(channel, model_error)| of_sensor(rig, record, channel, model_error, &repeated))
        .collect();
    let stuck: Vec<Range<usize>> = all.iter().flat_map(|of| runs(&of.stuck)).collect();
    for of in all.iter_mut().filter(|of| of.held.is_none()) {
        let values = record.channel(of.channel).unwrap_or_default();
        let as_well = filled_as_well(values, &stuck);
        merge(&mut of.stuck, as_well.iter().copied());
        of.spikes.retain(|sample| as_well.binary_search(sample).is_err());
    }
    let command = record.channel(Channel::Command).unwrap_or_default();
    let command = without(command, repeated.iter().copied());
    let least = SPIKE_SIGMA * fit::noise_of_series(&command).max(fit::MODEL_ERROR[0]);
    let is_zero = |sample: usize| record.channels().all(|(_, values)| values[sample] == 0.0);
    let (lost, flown): (Vec<usize>, Vec<usize>) =
        spikes(&command, least, None).into_iter().partition(|&sample| {
            let is_defect = |of: &Defects| {
                Channel::POSITIONS.contains(&of.channel) && of.samples().any(|other| other == sample)
            };
            all.iter().any(is_defect) || is_zero(sample)
        });
    for of in &mut all {
        // A controller answers a spike of its command with one of its own.
        of.spikes.retain(|sample| {
            Channel::POSITIONS.contains(&of.channel) || flown.binary_search(sample).is_err()
        });
        merge(&mut of.spikes, lost.iter().copied());
    }
    all.push(Defects { spikes: lost, stuck: repeated, flown, ..Defects::none(Channel::Command) });
    all.retain(|of| *of != Defects::none(of.channel));
    all
}

/// Adds samples to others, all in order.
fn merge(samples: &mut Vec<usize>, others: impl IntoIterator<Item = usize>) {
    samples.extend(others);
    samples.sort_unstable();
    samples.dedup();
}

/// The runs of neighbours among samples in order.
fn runs(samples: &[usize]) -> Vec<Range<usize>> {
    samples.chunk_by(|a, b| a + 1 == *b).map(|run| run[0]..run[run.len() - 1] + 1).collect()
}

/// What is wrong with the samples of a sensor, if the record has it; `repeated` are the rows that came twice.
fn of_sensor(
    rig: &Rig,
    record: &Record,
    channel: Channel,
    model_error: f64,
    repeated: &[usize],
) -> Option<Defects> {
    let values = record.channel(channel)?;
    let held = held(values);
    let coarse = if held.is_none() { on_coarse_steps(values, model_error) } else { Vec::new() };
    let mut left_out = repeated.to_vec();
    merge(&mut left_out, held.iter().flat_map(|held| held.repeats.iter().copied()));
    let mut fresh: Vec<usize> =
        (0..values.len()).filter(|sample| left_out.binary_search(sample).is_err()).collect();
    let of = |fresh: &[usize]| -> Vec<f64> { fresh.iter().map(|&sample| values[sample]).collect() };
    if fit::is_sparse(&of(&fresh)) {
        fresh.retain(|&sample| values[sample].is_finite());
    }
    let values = of(&fresh);
    let least = SPIKE_SIGMA * fit::noise_of_series(&values).max(model_error);
    let mut stuck = filled(&values, model_error);
    if Channel::POSITIONS.contains(&channel) {
        merge(&mut stuck, repeating(&values, least));
    }
    let longest = ((LONGEST_S / record.sample_period_s()) as usize * fresh.len() / record.len()).max(1);
    let (least, longest) = match channel {
        Channel::Pressure => (PRESSURE_SHARE * rig.parameters.supply_pressure / OF_THREE, None),
        channel => (least, Channel::POSITIONS.contains(&channel).then_some(longest)),
    };
    let spikes = spikes(&without(&values, stuck.iter().copied()), least, longest);
    let in_record =
        |samples: Vec<usize>| -> Vec<usize> { samples.into_iter().map(|sample| fresh[sample]).collect() };
    let (mut stuck, mut spikes) = (in_record(stuck), in_record(spikes));
    if channel == Channel::Current && !spikes.is_empty() {
        let asked = asked_current(rig, record);
        let current = record.channel(channel)?;
        let limit = rig.parameters.current_limit;
        let is_at_limit =
            |&sample: &usize| current.get(sample).is_some_and(|value| value.abs() > limit - least);
        let stays_at_limit = |sample: usize| {
            is_at_limit(&sample) && [sample.wrapping_sub(1), sample + 1].iter().any(is_at_limit)
        };
        spikes.retain(|&sample| !answers(current, &asked, sample) && !stays_at_limit(sample));
    }
    if held.is_none() {
        merge(&mut stuck, repeated.iter().copied());
    }
    Some(Defects { spikes, stuck, held, coarse, ..Defects::none(channel) })
}

/// The current that a controller in proportion asks for where command and position are; empty where its gain is not known.
fn asked_current(rig: &Rig, record: &Record) -> Vec<f64> {
    let Parameters { proportional_gain, current_limit, .. } = rig.parameters;
    let is_known = rig.form.drive == Drive::Valve && !rig.is_free(Parameter::ProportionalGain);
    let positions = [Channel::RamPosition, Channel::UserPosition].map(|of| record.channel(of));
    let command = record.channel(Channel::Command);
    let (Some(position), Some(command)) =
        (positions.into_iter().flatten().next(), command.filter(|_| is_known))
    else {
        return Vec::new();
    };
    let asked = |(command, position): (&f64, &f64)| proportional_gain * (command - position);
    iter::zip(command, position).map(asked).map(|asked| asked.clamp(-current_limit, current_limit)).collect()
}

/// Is what a sample departs from its neighbours, for the most part, what another series does there as well?
fn answers(values: &[f64], other: &[f64], sample: usize) -> bool {
    let off = |series: &[f64]| {
        let (before, after) = (series.get(sample.checked_sub(1)?)?, series.get(sample + 1)?);
        Some(series[sample] - 0.5 * (before + after))
    };
    let both = off(values).zip(off(other));
    both.is_some_and(|(own, other)| (own - other).abs() < 0.5 * own.abs())
}

/// Rows that repeat the one before them in every channel, digit by digit, though the command moves or the noise of the
/// sensors would not: a frame that came twice. Where they are more than one in twenty and no slow sensors, they are what
/// the record is like.
fn repeated_rows(record: &Record) -> Vec<usize> {
    let sensors = || {
        let all = iter::zip(Channel::MEASURED, fit::MODEL_ERROR);
        all.filter_map(|(channel, model_error)| Some((record.channel(channel)?, model_error)))
    };
    let by_chance: f64 =
        sensors().map(|(values, model_error)| chance_of_repeat(values, model_error)).product();
    let is_noise_alive = record.len() as f64 * by_chance < FEW;
    let command = record.channel(Channel::Command).unwrap_or_default();
    let moves = |row: usize| row > 0 && row < command.len() && command[row] != command[row - 1];
    let repeats = |row: usize| record.channels().all(|(_, values)| values[row] == values[row - 1]);
    let longest = (LONGEST_GAP_S / record.sample_period_s()) as usize;
    let (mut found, mut row) = (Vec::new(), 1);
    while row < record.len() {
        let end = (row..record.len()).find(|&row| !repeats(row)).unwrap_or(record.len());
        let goes_on = is_noise_alive || moves(row - 1) && moves(end);
        if goes_on && end - row <= longest {
            found.extend(row..end);
        }
        row = end + 1;
    }
    let is_few = found.len() as f64 <= MOST * record.len() as f64;
    if is_few || sensors().all(|(values, _)| held(values).is_some()) { found } else { Vec::new() }
}

/// A record whose samples have been looked at.
#[derive(Clone, Debug)]
pub struct Screened {
    /// The record, its defects lost samples.
    pub record: Record,
    /// The defects of each channel that has some.
    pub defects: Vec<Defects>,
    /// What the user should know of it, a line for each channel with defects that starts with the record.
    pub notes: Vec<String>,
}

/// Leaves out what is wrong with the samples of a record; not where that is more than one in twenty.
pub fn screen(rig: &Rig, record: &Record) -> Screened {
    let defects = defects(rig, record);
    // What a bad word of the command has lost, the other inputs have as well.
    let of = |channel: Channel| match channel.info().role {
        ChannelRole::Measured => channel,
        _ => Channel::Command,
    };
    let left_out = |channel: Channel| -> Vec<usize> {
        let mut of_channel = defects.iter().filter(|defects| defects.channel == of(channel));
        of_channel.next().map_or_else(Vec::new, |of| of.left_out(record))
    };
    let in_words = defects.iter().filter_map(|of| of.in_words(record));
    let notes = in_words.map(|words| format!("{}: {words}", record.name())).collect();
    Screened { record: record.with_lost(left_out), notes, defects }
}

/// The values without some of them.
pub(crate) fn without(values: &[f64], samples: impl IntoIterator<Item = usize>) -> Vec<f64> {
    let mut values = values.to_vec();
    for sample in samples {
        values[sample] = f64::NAN;
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::{self, Excitation, Sensing};
    use crate::rig::BUILT_IN;
    use eha_monitor::command::COMMANDS;

    /// A record of the default actuator with 0.5 mm of backlash and 2000 N of friction.
    fn flown(command: &str, noise: f64) -> (Rig, Record) {
        flown_every(1e-3, command, noise)
    }

    /// The same with a sample every so many seconds.
    fn flown_every(period: f64, command: &str, noise: f64) -> (Rig, Record) {
        let mut rig = (BUILT_IN[0].make)();
        rig.parameters.set(Parameter::Backlash, 5e-4);
        rig.parameters.set(Parameter::DryFriction, 2000.0);
        let excitation = Excitation::of_command(command, (2.0 / period) as usize, period).unwrap();
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
    fn a_current_that_answers_a_command_in_a_few_samples_has_no_spike() {
        let says = |rig: &Rig, record: &Record| {
            let mut notes = screen(rig, record).notes;
            notes.retain(|note| note.contains("current_mA"));
            notes
        };
        for command in COMMANDS {
            for noise in [1e-6, 5e-6] {
                for period in [2e-3, 5e-3] {
                    let (rig, record) = flown_every(period, command.name, noise);
                    let notes = says(&rig, &record);
                    assert_eq!(notes, [""; 0], "{} every {period} s, {noise} m of noise", command.name);
                }
            }
        }
        let (rig, record) = flown_every(2e-3, "mixed-step", 5e-6);
        let spiky = changed(&record, Channel::Current, |values| values[150] += 2.0);
        assert_eq!(says(&rig, &spiky).len(), 1);
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
            let none = |of: &Defects| of.samples().count() == 0;
            assert!(screen(&rig, &coarse).defects.iter().all(none));
        }
    }

    #[test]
    fn a_word_that_the_command_lost_with_the_sensors_is_bridged() {
        let (rig, record) = flown("sine", 5e-6);
        let torn = [310, 705];
        let channels = record.channels().map(|(channel, values)| {
            let mut values = values.to_vec();
            for sample in torn {
                values[sample] = 0.0;
            }
            (channel, values)
        });
        let bad = Record::new("bad", record.sample_period_s(), 0.0, channels.collect()).unwrap();
        let Screened { record: mended, notes, .. } = screen(&rig, &bad);
        for sample in torn {
            for channel in Channel::MEASURED {
                assert!(
                    mended.channel(channel).unwrap()[sample].is_nan(),
                    "{} {sample}",
                    channel.info().column
                );
            }
            let [mended, flown] = [&mended, &record].map(|of| of.channel(Channel::Command).unwrap()[sample]);
            // What the command bends by over two samples.
            assert!((mended - flown).abs() < 0.5 * 4e-3 * (31.5_f64 * 1e-3).powi(2), "{mended} {flown}");
        }
        let expected =
            "bad: command_m: 2 spikes from 0.31 to 0.705 s: bridged, and left out of the sensors as well";
        assert!(notes.iter().any(|note| note == expected), "{notes:?}");
        // A position that goes on says nothing of a bad word.
        let alone = changed(&record, Channel::Command, |values| values[310] += 3e-4);
        let Screened { record: as_it_is, notes, .. } = screen(&rig, &alone);
        assert!(as_it_is.channels().eq(alone.channels()));
        assert_eq!(
            notes,
            ["changed: command_m: a spike at 0.31 s: taken as flown, since no position shows a defect there"]
        );
    }

    #[test]
    fn a_row_that_came_twice_is_lost() {
        let (rig, record) = flown("sine", 5e-6);
        let twice = [400, 401, 900];
        let again = |every: usize| {
            let channels = record.channels().map(|(channel, values)| {
                let mut values = values.to_vec();
                for sample in 1..values.len() {
                    if twice.contains(&sample) || sample % every != 0 {
                        values[sample] = values[sample - 1];
                    }
                }
                (channel, values)
            });
            screen(&rig, &Record::new("again", record.sample_period_s(), 0.0, channels.collect()).unwrap())
        };
        let Screened { record: mended, notes, .. } = again(1);
        for (channel, left) in mended.channels() {
            for sample in 0..left.len() {
                let is_lost = twice.contains(&sample) && channel.info().role == ChannelRole::Measured;
                assert_eq!(left[sample].is_nan(), is_lost, "{} {sample}", channel.info().column);
            }
        }
        let expected = "again: command_m: 3 repeated values from 0.4 to 0.9 s: bridged, and left out of the sensors as well";
        assert!(notes.len() == 5 && notes.iter().any(|note| note == expected), "{notes:?}");
        // Everything read every other time: the command goes in lines, and the sensors have half of their samples.
        let slow = again(2).record;
        let [slow_command, command] = [&slow, &record].map(|of| of.channel(Channel::Command).unwrap());
        let bend = 4e-3 * (31.5_f64 * 1e-3).powi(2);
        // Whether the first and the last row came twice nobody knows, and a bridge takes its slope from both sides.
        let off = iter::zip(slow_command, command)
            .take(1996)
            .skip(4)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off < 3.0 * bend, "{off}");
        assert!(slow.missing_count(Channel::UserPosition) >= 1000);
    }

    #[test]
    fn the_rest_before_a_step_is_no_repeated_row() {
        let (rig, record) = flown("mixed-step", 0.0);
        let standing =
            record.channel(Channel::Command).unwrap().iter().take_while(|&&command| command == 0.0).count();
        assert!(standing > 5, "{standing}");
        // What the last digits of a program do wherever the ram moves.
        let trembling = changed(&record, Channel::RamPosition, |values| {
            for (value, digits) in
                values.iter_mut().zip((1_u32..).map(|sample| sample.wrapping_mul(2_654_435_761)))
            {
                if *value != 0.0 {
                    *value += 1e-9 * f64::from(digits) / f64::from(u32::MAX);
                }
            }
        });
        assert_eq!(screen(&rig, &trembling).notes, [""; 0]);
    }

    #[test]
    fn between_the_readings_of_a_slow_sensor_nothing_is_measured() {
        let (rig, record) = flown("chirp", 5e-6);
        let spike = |values: &mut [f64]| {
            values[600] += 2e-3;
            for sample in 0..values.len() {
                values[sample] = values[sample - sample % 5];
            }
        };
        let slow = changed(&record, Channel::UserPosition, spike);
        let Screened { record: screened, notes, .. } = screen(&rig, &slow);
        let [left, all] = [&screened, &record].map(|of| of.channel(Channel::UserPosition).unwrap());
        for sample in 0..all.len() {
            let expected = if sample % 5 == 0 && sample != 600 { all[sample] } else { f64::NAN };
            assert_eq!(left[sample].to_bits(), expected.to_bits(), "{sample}");
        }
        let expected = "changed: lvdt_m: a spike at 0.6 s: left out of every fit; a new value every 5 samples only: those \
                        between are left out of every fit";
        assert_eq!(notes, [expected]);
    }

    #[test]
    fn a_sensor_of_which_every_second_sample_is_blank_has_no_spikes() {
        for command in ["chirp", "sine", "mixed"] {
            let (rig, record) = flown(command, 5e-6);
            for channel in [Channel::UserPosition, Channel::Current] {
                for every in [2, 3] {
                    let blank = changed(&record, channel, |values| {
                        let blanks = (0..values.len()).filter(|sample| sample % every > 0);
                        values.copy_from_slice(&without(values, blanks));
                    });
                    assert_eq!(screen(&rig, &blank).notes, [""; 0], "{command}, every {every}");
                    let spiky = changed(&blank, channel, |values| values[600] *= 100.0);
                    assert_eq!(screen(&rig, &spiky).notes.len(), 1, "{command}, every {every}");
                }
            }
        }
    }

    #[test]
    fn a_gap_that_somebody_filled_is_a_gap() {
        let (rig, record) = flown("chirp", 5e-6);
        // In motion, and where the ram turns; with the last value, and on a line.
        for first in [300, 800, 1201] {
            for on_line in [false, true] {
                for channel in [Channel::UserPosition, Channel::Current, Channel::Pressure] {
                    let filled = changed(&record, channel, |values| {
                        let step = if on_line { (values[first + 15] - values[first]) / 15.0 } else { 0.0 };
                        for sample in first + 1..first + 15 {
                            values[sample] = values[first] + step * (sample - first) as f64;
                        }
                    });
                    let defects = screen(&rig, &filled).defects;
                    let what = format!("{} {first} {on_line}: {defects:?}", channel.info().column);
                    assert!(defects.len() == 1 && defects[0].channel == channel, "{what}");
                    assert_eq!(defects[0].stuck, (first + 1..first + 15).collect::<Vec<_>>(), "{what}");
                    assert_eq!(defects[0].spikes, [0; 0], "{what}");
                }
            }
        }
    }

    #[test]
    fn a_line_across_a_gap_of_a_coarse_sensor_is_between_its_steps() {
        let (rig, record) = flown("chirp", 5e-6);
        let coarse =
            |values: &mut [f64]| values.iter_mut().for_each(|x| *x = (*x / 2e-5).round() * 2e-5 + 7e-6);
        let read = changed(&record, Channel::UserPosition, coarse);
        assert_eq!(screen(&rig, &read).defects, []);
        let filled = changed(&read, Channel::UserPosition, |values| {
            let step = (values[417] - values[400]) / 17.0;
            for sample in 401..417 {
                values[sample] = values[400] + step * (sample - 400) as f64;
            }
        });
        let defects = screen(&rig, &filled).defects;
        assert!(defects.len() == 1 && defects[0].stuck == (401..417).collect::<Vec<_>>(), "{defects:?}");
    }

    #[test]
    fn a_controller_that_answers_a_spike_of_its_command_has_none_itself() {
        let (rig, record) = flown("sine", 5e-6);
        let spiky = changed(&record, Channel::Current, |values| values[700] += 3.0);
        assert_eq!(screen(&rig, &spiky).defects[0].spikes, [700]);
        let asked = changed(&spiky, Channel::Command, |values| values[700] += 3e-4);
        let defects = screen(&rig, &asked).defects;
        assert!(defects.len() == 1 && defects[0].channel == Channel::Command, "{defects:?}");
    }
}
