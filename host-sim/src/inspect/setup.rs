//! Errors of a set-up that no actuator makes up for: another unit, sign or column, a sensor at its end, a noise that is none.
//!
//! Each is told by a ratio that physics bounds: how far a channel moves against what the model, at the rig's values,
//! says of it. Faults change that by less than the limits here, a wrong unit by more.

use super::likeness::{correlation, likeness, response, slope};
use super::slack::left_behind;
use super::{Motion, TURN_SIGMA, motion};
use crate::fit::measured::USER;
use crate::fit::{self, Prepared};
use crate::output::{plain, quantity};
use crate::record::Record;
use crate::record::units::{Unit, units_of};
use crate::rig::{Range, Rig};
use eha_monitor::channel::{Channel, ChannelRole};
use eha_monitor::model::Drive;
use eha_monitor::parameter::Parameter;
use std::iter;
use std::ops::RangeInclusive;
use std::slice;

/// Correlation from which on two series are the same motion, and below which they are not.
const ALIKE: f64 = 0.9;
const UNLIKE: f64 = 0.5;
/// Part by which a position may be beyond the stop of the jack: what its sensor's gain may be off.
const BEYOND: f64 = 0.01;
/// Part by which a ratio may differ from that of two units: what faults and an unknown gain make of it.
const ABOUT: f64 = 0.2;
/// Millimetres of an inch: a column of millimetres that was taken for inches.
const INCH: f64 = 25.4;
/// How many times more, in mean square, the user's position behind a play of the ram must leave than the other way round,
/// and than noise does.
const MORE: f64 = 2.0;
/// Samples by which a position must be ahead of its command: a clock that is one off is another matter.
const AHEAD: f64 = 2.0;
/// Share of the rig's delay by which a position must be later: that of a step is where two shapes are most alike, and noise
/// moves it.
const LATER: f64 = 0.1;

/// How many times less than a record shows the noise may be that a rig states: a motion that turns sharply between slow samples
/// shows as noise of some fifteen times the sensor's. The next unit is a thousand away, and so it is above.
const LESS_NOISE: f64 = 30.0;
/// How many times more it may be: noise of a colour shows as a small part of it from sample to sample, and a record that a
/// program made shows the least that is believed, a fiftieth of a sensor's.
const MORE_NOISE: f64 = 100.0;

/// A scale in the unit of a channel for each unit of the column, as an example.
const EXAMPLE: f64 = 1.5e-5;

/// How many times as long as anywhere else a sensor rests at its end where that is a limit: the dwells of a play get shorter
/// as its motion gets faster.
const LONGER: usize = 2;

/// Most faults whose ends are tried in every combination: of 20 there would be a million. Beyond it they go to their ends one
/// after the other.
const MOST_COMBINED: usize = 4;

/// How many times as far as its model a channel may move, or as little.
const fn most(channel: Channel) -> f64 {
    match channel {
        // A loop goes where it is told to; where its current is at the limit, the model's is as well.
        Channel::UserPosition | Channel::RamPosition => 3.0,
        // The current is the speed over the gain of the valve, whatever the friction.
        Channel::Current => 30.0,
        // The pressure carries the friction, of which faults make twenty times as much.
        _ => 100.0,
    }
}

/// How many times as far as its model a channel moves with the faults that it may have: what tells its unit.
const fn likely(channel: Channel) -> RangeInclusive<f64> {
    match channel {
        Channel::UserPosition | Channel::RamPosition | Channel::Current => 1.0 - ABOUT..=1.0 + ABOUT,
        _ => 0.5..=20.0,
    }
}

/// What the user should look at before anything is fitted.
pub(crate) fn remarks(rig: &Rig, record: &Record) -> Vec<String> {
    let noise = fit::noise_of(rig, record);
    let prepared = fit::prepare_with(rig, record, noise);
    [
        idle_drive(rig, record),
        noise_of_another_unit(rig, record),
        late_start(&prepared),
        never_turns(rig, record, noise[USER]),
        clipped(rig, record),
        beyond_stop(rig, record),
        ahead(rig, record),
        ram_behind_user(record, noise),
        beyond_faults(rig, record, &prepared),
        against_model(rig, record, &prepared),
    ]
    .concat()
}

/// A force that is recorded as what drives the jack, where the rig has a valve for that.
fn idle_drive(rig: &Rig, record: &Record) -> Vec<String> {
    let column = Channel::Drive.info().column;
    let is_idle = rig.form.drive == Drive::Valve && record.channel(Channel::Drive).is_some();
    let remark = || {
        format!(
            "{column} is not used: a valve drives the jack of the rig `{}`; where that force does, take a rig with `drive = \
             \"force\"`, such as `--rig force-axis`",
            rig.name
        )
    };
    is_idle.then(remark).into_iter().collect()
}

/// A noise that the rig states, of which the record shows far less or far more.
fn noise_of_another_unit(rig: &Rig, record: &Record) -> Vec<String> {
    iter::zip(Channel::MEASURED, 0..)
        .filter_map(|(channel, index): (Channel, usize)| {
            let stated = rig.noise_of(channel)?;
            let shown = fit::shown_noise(index, record.channel(channel)?);
            let info = channel.info();
            (!(shown / LESS_NOISE..=shown * MORE_NOISE).contains(&stated)).then(|| {
                format!(
                    "the rig states a noise of {} {} for {} ([noise]), the record shows {}: is it in another unit?",
                    plain(stated),
                    info.unit,
                    info.column,
                    quantity(shown, info.unit)
                )
            })
        })
        .collect()
}

/// A record, or a stretch of it, that does not start at rest where it is told to, or nobody knows where.
fn late_start(prepared: &Prepared) -> Vec<String> {
    let settling = prepared.settling_s();
    let blind = (prepared.unstarted > 0).then(|| {
        format!(
            "not compared with the model, because too many samples of lvdt_m are lost where they start: {} of the \
             stretches of an open loop",
            prepared.unstarted
        )
    });
    let remark = || {
        format!(
            "the record does not start at rest at its command: the first {settling:.3} s of {:.3} s are not compared with \
             the model, while it forgets the start",
            prepared.duration()
        )
    };
    (settling > 0.0).then(remark).into_iter().chain(blind).collect()
}

/// A motion in one direction, where a backlash is asked for; `noise` is that of the user position, m.
fn never_turns(rig: &Rig, record: &Record, noise: f64) -> Vec<String> {
    let position = record.channel(Channel::UserPosition).unwrap_or_default();
    let Motion { travel_m, reversals, .. } = motion(position, record.sample_period_s(), noise);
    let is_one_way = travel_m > TURN_SIGMA * noise && reversals == 0;
    let remark =
        "the ram never turns: backlash does not show without a reversal, only as a zero of the sensor would";
    (is_one_way && range_of(rig, Parameter::Backlash).is_some())
        .then(|| remark.to_owned())
        .into_iter()
        .collect()
}

/// Sensors that end within the motion.
fn clipped(rig: &Rig, record: &Record) -> Vec<String> {
    let sensors = record.channels().filter(|(channel, _)| channel.info().role == ChannelRole::Measured);
    let limit = rig.parameters.current_limit;
    // The controller has a limit of its own, and the model knows it.
    let is_limit = |channel: Channel, values: &[f64]| {
        channel == Channel::Current
            && fit::extent(values).iter().any(|end| (end.abs() / limit - 1.0).abs() < BEYOND)
    };
    // Where the command rests, the actuator may.
    let command = record.channel(Channel::Command).unwrap_or_default();
    let moves = |sample: usize| sample > 0 && command.get(sample) != command.get(sample - 1);
    sensors
        .filter(|(channel, values)| !is_limit(*channel, values))
        .filter_map(|(channel, values)| {
            let ends = fit::at_ends(values);
            let resting = (0..ends.len()).filter(|&sample| ends[sample] && moves(sample)).count();
            let share = resting as f64 / values.len().max(1) as f64;
            // A play dwells wherever the ram turns, not at the ends alone.
            let [at_ends, elsewhere] = fit::longest_rests(values, moves);
            (share > fit::CLIPPED && at_ends > LONGER * elsewhere).then(|| {
                format!(
                    "{} is at its smallest or largest value in {:.1} % of the samples, while the command moves: is it clipped?",
                    channel.info().column,
                    share * 100.0
                )
            })
        })
        .collect()
}

/// Positions where the jack cannot be.
fn beyond_stop(rig: &Rig, record: &Record) -> Vec<String> {
    let stop = rig.parameters.jack_stop;
    let is_position = |channel: Channel| channel.info().unit == "m";
    record
        .channels()
        .filter(|(channel, _)| is_position(*channel))
        .filter_map(|(channel, values)| {
            let [low, high] = fit::extent(values);
            let furthest = if -low > high { low } else { high };
            (furthest.abs() > (1.0 + BEYOND) * stop).then(|| {
                format!(
                    "{} reaches {furthest:.4} m, the jack's stop is at {stop} m (`jack_stop` of the rig): is it in another \
                     unit?",
                    channel.info().column
                )
            })
        })
        .collect()
}

/// A position that is ahead of its command.
fn ahead(rig: &Rig, record: &Record) -> Vec<String> {
    if rig.form.drive != Drive::Valve {
        return Vec::new();
    }
    let [position, command] =
        [Channel::UserPosition, Channel::Command].map(|of| record.channel(of).unwrap_or_default());
    let period = record.sample_period_s();
    let forward = likeness(position, command, period);
    let falls = forward.first().zip(forward.get(1)).is_some_and(|(now, next)| now > next);
    let backward = response(&likeness(command, position, period), period)
        .filter(|back| falls && back.delay_s >= AHEAD * period && back.correlation > ALIKE.max(forward[0]));
    backward
        .into_iter()
        .map(|back| {
            format!(
                "lvdt_m is {:.1} ms ahead of command_m: are their columns swapped? {}",
                back.delay_s * 1e3,
                exchanged(record, [Channel::UserPosition, Channel::Command])
            )
        })
        .collect()
}

/// A position that is later than the model with any of its faults, or beside where any of them leaves it. What else is
/// free in a rig may be the reason.
fn beyond_faults(rig: &Rig, record: &Record, prepared: &Prepared) -> Vec<String> {
    if rig.form.drive != Drive::Valve || !rig.free.is_empty() {
        return Vec::new();
    }
    let [position, command] =
        [Channel::UserPosition, Channel::Command].map(|of| record.channel(of).unwrap_or_default());
    let period = record.sample_period_s();
    let delay = |position: &[f64]| response(&likeness(position, command, period), period);
    let mut answered = |rig: &Rig| {
        let answer: Vec<f64> =
            fit::glimpse(rig, slice::from_ref(prepared)).concat().iter().map(|output| output.user).collect();
        Answer {
            delay_s: delay(&answer).map_or(0.0, |of| of.delay_s),
            beside: mean_difference(position, &answer),
        }
    };
    let answers = if rig.faults.len() <= MOST_COMBINED {
        combinations(rig).iter().map(answered).collect()
    } else {
        Answer::MEASURES.map(|measure| walked(rig, measure, &mut answered)).concat()
    };
    let mut found = Vec::new();
    let latest = answers.iter().map(|answer| answer.delay_s).fold(0.0, f64::max);
    let margin = (AHEAD * period).max(LATER * latest);
    if let Some(late) = delay(position).filter(|of| of.correlation > ALIKE && of.delay_s > latest + margin) {
        found.push(format!(
            "lvdt_m follows {:.1} ms behind command_m, the rig {:.1} ms at most, whatever its faults: is something delayed, \
             or is it another rig?",
            late.delay_s * 1e3,
            latest * 1e3
        ));
    }
    // A play may hang on either side.
    let play = range_of(rig, Parameter::Backlash).map_or(0.0, |range| range.upper);
    let beside: Vec<f64> = answers.iter().map(|answer| answer.beside).collect();
    let [least, most] = fit::extent(&beside);
    let nearest = if least > 0.0 { least } else { most.min(0.0) };
    if nearest.abs() > play {
        found.push(format!(
            "lvdt_m is in the mean {} or more beside what the rig answers, whatever its faults: is its zero another one?",
            quantity(nearest, "m")
        ));
    }
    found
}

/// How a record stands to what a rig answers.
#[derive(Clone, Copy, Debug)]
struct Answer {
    /// How late the rig is, s.
    delay_s: f64,
    /// How far the record is beside it, in the mean, m.
    beside: f64,
}

impl Answer {
    /// What the faults are taken to their ends for: the latest answer, and those furthest to either side.
    const MEASURES: [fn(&Self) -> f64; 3] =
        [|answer| answer.delay_s, |answer| answer.beside, |answer| -answer.beside];
}

/// A rig with one of its faults at some values.
fn with_each<const N: usize>(rig: &Rig, range: &Range, values: [f64; N]) -> [Rig; N] {
    values.map(|value| {
        let mut rig = rig.clone();
        rig.parameters.set(range.parameter, value);
        rig
    })
}

/// A rig with each of its faults at its smallest, in the middle and at its largest, in every combination: a fault in the
/// middle may make a motion later than one at either end.
fn combinations(rig: &Rig) -> Vec<Rig> {
    let with_each = |rigs: Vec<Rig>, range: &Range| {
        let middle = 0.5 * (range.lower + range.upper);
        rigs.iter().flat_map(|rig| with_each(rig, range, [range.lower, middle, range.upper])).collect()
    };
    rig.faults.iter().fold(vec![rig.clone()], with_each)
}

/// The answers on the way of a rig whose faults go, one after the other, to the end at which a measure is larger.
fn walked(rig: &Rig, measure: fn(&Answer) -> f64, mut answered: impl FnMut(&Rig) -> Answer) -> Vec<Answer> {
    let mut here = rig.clone();
    let mut all = Vec::new();
    for range in &rig.faults {
        let [low, high] = with_each(&here, range, [range.lower, range.upper]);
        let answers = [answered(&low), answered(&high)];
        let [of_low, of_high] = answers.each_ref().map(measure);
        here = if of_high > of_low { high } else { low };
        all.extend(answers);
    }
    all
}

fn range_of(rig: &Rig, parameter: Parameter) -> Option<&Range> {
    rig.faults.iter().find(|range| range.parameter == parameter)
}

/// Mean of one series minus another one, over the samples that both have.
fn mean_difference(one: &[f64], other: &[f64]) -> f64 {
    let differences =
        || iter::zip(one, other).map(|(one, other)| one - other).filter(|left| left.is_finite());
    differences().sum::<f64>() / differences().count().max(1) as f64
}

/// A ram that has the play which the user's position has to have.
fn ram_behind_user(record: &Record, noise: [f64; Channel::MEASURED.len()]) -> Vec<String> {
    let [user, ram] = Channel::POSITIONS.map(|channel| record.channel(channel).unwrap_or_default());
    let of_noise: f64 = iter::zip(Channel::MEASURED, noise)
        .filter(|(channel, noise)| Channel::POSITIONS.contains(channel) && noise.is_finite())
        .map(|(_, noise)| noise * noise)
        .sum();
    let period = record.sample_period_s();
    let foreseen = left_behind(user, ram, period);
    let exchange = left_behind(ram, user, period);
    let is_swapped = foreseen > MORE * exchange.max(of_noise);
    let remark = || {
        format!(
            "ram_m rests where lvdt_m turns, as if the play of the linkage were its own: are their columns swapped? {}",
            exchanged(record, Channel::POSITIONS)
        )
    };
    is_swapped.then(remark).into_iter().collect()
}

/// The option that reads two channels from the columns of each other. Where they have one unit, a column keeps what was
/// said of its own; else a channel does.
fn exchanged(record: &Record, [one, other]: [Channel; 2]) -> String {
    let [of_one, of_other] = [one, other].map(|channel| record.factor(channel));
    let is_same = one.info().unit == other.info().unit;
    let [to_one, to_other] = if is_same { [of_other, of_one] } else { [of_one, of_other] };
    record.columns_option(&[(one, other, to_one), (other, one, to_other)])
}

/// A measured channel, and what stands beside it: the model's, or the command where no loop is known.
struct Beside<'a> {
    channel: Channel,
    measured: &'a [f64],
    model: Vec<f64>,
}

/// The measured channels that the model, at the rig's values, says something of.
fn beside<'a>(rig: &Rig, record: &'a Record, prepared: &Prepared) -> Vec<Beside<'a>> {
    let measured = rig.measurable().iter().filter_map(|&channel| Some((channel, record.channel(channel)?)));
    if rig.form.drive == Drive::Force && rig.controller.is_none() {
        // An open loop follows the record, whatever it is.
        let command = record.channel(Channel::Command).unwrap_or_default();
        return measured
            .map(|(channel, measured)| Beside { channel, measured, model: command.to_vec() })
            .collect();
    }
    let outputs = fit::glimpse(rig, slice::from_ref(prepared)).concat();
    // With an unknown gain of the controller goes an unknown current.
    let is_unknown =
        |channel: Channel| channel == Channel::Current && rig.is_free(Parameter::ProportionalGain);
    iter::zip(Channel::MEASURED, 0..)
        .filter_map(|(channel, index): (Channel, usize)| {
            let measured = record.channel(channel).filter(|_| !is_unknown(channel))?;
            let model = outputs.iter().map(|output| output.to_array()[index]).collect();
            Some(Beside { channel, measured, model })
        })
        .collect()
}

/// Channels whose sign, size or name is another one.
fn against_model(rig: &Rig, record: &Record, prepared: &Prepared) -> Vec<String> {
    let all = beside(rig, record, prepared);
    let mut found = Vec::new();
    let mut swapped = Vec::new();
    for (place, one) in all.iter().enumerate() {
        for other in &all[place + 1..] {
            let own = [one, other].map(|of| correlation(of.measured, &of.model).abs());
            let crossed = [correlation(one.measured, &other.model), correlation(other.measured, &one.model)]
                .map(f64::abs);
            if own.into_iter().all(|own| own < UNLIKE) && crossed.into_iter().all(|crossed| crossed > ALIKE) {
                let pair = [one.channel, other.channel];
                let [one, other] = pair.map(|channel| channel.info().column);
                swapped.extend(pair);
                found.push(format!("{one} and {other} look swapped: {}", exchanged(record, pair)));
            }
        }
    }
    found.extend(
        all.iter().filter(|one| !swapped.contains(&one.channel)).filter_map(|one| one.remark(record)),
    );
    found
}

impl Beside<'_> {
    fn remark(&self, record: &Record) -> Option<String> {
        let anew = |factor: f64| record.columns_option(&[(self.channel, self.channel, factor)]);
        let factor = record.factor(self.channel);
        let column = self.channel.info().column;
        let alike = correlation(self.measured, &self.model);
        if alike < -UNLIKE {
            return Some(format!(
                "{column} goes the other way than it is told to (correlation {alike:.2}): is its sign another one? {}",
                anew(-factor)
            ));
        }
        let ratio = slope(self.measured, &self.model);
        let most = most(self.channel);
        if alike < UNLIKE || !ratio.is_finite() || (most.recip()..=most).contains(&ratio) {
            return None;
        }
        let is_meant = |unit: &&Unit| likely(self.channel).contains(&(ratio * unit.factor / factor.abs()));
        let mut meant: Vec<f64> =
            units_of(self.channel.info()).filter(is_meant).map(|unit| unit.factor.copysign(factor)).collect();
        let in_inches = factor / INCH;
        if meant.is_empty()
            && self.channel.info().unit == "m"
            && likely(self.channel).contains(&(ratio / INCH))
        {
            meant.push(in_inches);
        }
        let times = if ratio > 1.0 {
            format!("{ratio:.1} times more")
        } else {
            format!("{:.1} times less", ratio.recip())
        };
        let options: Vec<String> = meant.into_iter().map(anew).collect();
        let advice = if options.is_empty() {
            "say its scale, as in ".to_owned() + &anew(EXAMPLE)
        } else {
            options.join(" or ")
        };
        Some(format!("{column} moves {times} than the rig foresees: is it in another unit? {advice}"))
    }
}

#[cfg(test)]
mod tests {
    use super::{Answer, combinations, remarks, walked};
    use crate::record::Record;
    use crate::rig::{Range, Rig};
    use eha_monitor::channel::Channel;
    use eha_monitor::parameter::Parameter;
    use std::time::{Duration, Instant};

    /// A rig with so many faults.
    fn with_faults(count: usize) -> Rig {
        let mut rig = Rig::load("eha").unwrap();
        let others = Parameter::all().filter(|parameter| {
            let info = parameter.info();
            let is_wide = info.lower < info.default && info.default < info.upper && info.upper.is_finite();
            is_wide && info.default != 0.0 && rig.faults.iter().all(|known| known.parameter != *parameter)
        });
        let near = |parameter: Parameter| {
            let default = parameter.info().default;
            Range::around(parameter, default, 0.01 * default.abs())
        };
        let more: Vec<Range> = others.map(near).collect();
        rig.faults.extend(more);
        assert!(rig.faults.len() >= count);
        rig.faults.truncate(count);
        rig
    }

    #[test]
    fn one_fault_after_the_other_goes_as_far_as_every_combination() {
        let rig = with_faults(4);
        let answered = |rig: &Rig| {
            let part = |range: &Range| rig.parameters.get(range.parameter) / range.upper;
            let all: Vec<f64> = rig.faults.iter().map(part).collect();
            Answer { delay_s: all.iter().sum(), beside: all[0] - all[1] + all[2] - all[3] }
        };
        let combined: Vec<Answer> = combinations(&rig).iter().map(answered).collect();
        assert_eq!(combined.len(), 81);
        for measure in Answer::MEASURES {
            let walk = walked(&rig, measure, answered);
            assert_eq!(walk.len(), 8);
            let furthest = |all: &[Answer]| all.iter().map(measure).fold(f64::NEG_INFINITY, f64::max);
            assert!((furthest(&walk) - furthest(&combined)).abs() < 1e-9);
        }
    }

    #[test]
    fn many_faults_are_looked_at_before_a_fit_in_no_time() {
        let command: Vec<f64> = (0..400).map(|k| 1e-3 * (f64::from(k) * 0.03).sin()).collect();
        let late: Vec<f64> = (0..400).map(|k: usize| command[k.saturating_sub(60)]).collect();
        let record = |position: Vec<f64>| {
            let channels = vec![(Channel::Command, command.clone()), (Channel::UserPosition, position)];
            Record::new("made", 1e-3, 0.0, channels).unwrap()
        };
        let started = Instant::now();
        for count in [2, 13] {
            let says_late = |position: &[f64]| {
                let said = remarks(&with_faults(count), &record(position.to_vec()));
                said.iter().any(|remark| remark.contains("is something delayed"))
            };
            let soon: Vec<f64> = (0..400).map(|k: usize| command[k.saturating_sub(10)]).collect();
            assert!(says_late(&late) && !says_late(&soon), "{count} faults");
        }
        // Every combination of 13 would take minutes.
        assert!(started.elapsed() < Duration::from_secs(20), "{:?}", started.elapsed());
    }
}
