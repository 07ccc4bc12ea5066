//! Does the size of a channel's values fit its unit?
//!
//! Three rules, on values that are present:
//!
//! 1. The largest magnitude is at most [`ChannelInfo::plausible`] of the channel table; of a time, that of what has passed
//!    since the first sample. Above it, whole numbers beyond 50 times the limit are called sensor counts; otherwise the
//!    first unit a thousand times smaller or more that brings them below the limit is named; where there is none,
//!    sensor counts. Where fewer than a tenth of the samples are above it, it is none of these.
//! 2. A measured position moves at most 100 times as far as the command asks (peak to peak). This finds a small
//!    motion in millimetres beside a command in metres. It needs a command that moves, and is left out
//!    where a driving force replaces the valve.
//! 3. Where only a name says that a time is in seconds, or nothing, or where there is none but a rate, the sampling period is
//!    one of a logger.

use std::fmt;
use std::ops::RangeInclusive;

use eha_monitor::channel::{Channel, ChannelInfo, ChannelRole};

use super::error::Field;
use super::mapping::option;
use super::table::Series;
use super::time_base::median_step;
use super::units::{Unit, units_of};
use crate::output::{counted, plain};

/// Whole numbers this many times above the limit are called counts.
const COUNTS_FROM: f64 = 50.0;

/// Share of the samples below which those above the limit are no unit.
const RARE: f64 = 0.1;

/// Largest ratio of a position's travel to that of the command.
const MOST_TRAVEL: f64 = 100.0;

/// Travel of a position that is held, m: its noise, and what the loop creeps.
const AT_REST: f64 = 1e-4;

/// Share of the samples that are left out at either end, so that no spike counts as travel.
const SPIKES: f64 = 0.01;

/// Sampling periods of loggers, s: with others, the unit of the time is doubted.
const PERIODS: RangeInclusive<f64> = 1e-5..=0.1;

/// A magnitude that does not fit its unit, and what it looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspicion {
    /// What was measured.
    pub found: Excess,
    /// The unit that the values seem to have; `None` for sensor counts.
    pub looks_like: Option<&'static Unit>,
    /// Name of the channel's column.
    pub column: &'static str,
    /// Unit of the channel.
    pub unit: &'static str,
    /// Name of the column or variable that was read; none where no file was.
    pub source: Option<String>,
}

/// Which rule was broken, and by how much; in the unit of the channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Excess {
    /// The largest magnitude is above the limit.
    Magnitude {
        /// The largest magnitude.
        largest: f64,
        /// The limit.
        limit: f64,
        /// How many samples are above it, where they are so few that they are no unit, but marks of something.
        rare: Option<u32>,
    },
    /// The position travels too far for the command.
    Travel {
        /// Peak to peak of the position.
        position: f64,
        /// Peak to peak of the command.
        command: f64,
    },
    /// The sampling period is none of a logger.
    Period(f64),
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { looks_like, column, unit, source, .. } = self;
        match self.found {
            Excess::Magnitude { largest, limit, rare } => {
                write!(
                    f,
                    "found a magnitude of {}, expected at most {} {unit}",
                    plain(largest),
                    plain(limit)
                )?;
                if let Some(count) = rare {
                    let samples = counted(count as usize, "sample");
                    return write!(
                        f,
                        ", in {samples} only: where it stands for one that is lost, leave the cell blank"
                    );
                }
            }
            Excess::Travel { position, command } => write!(
                f,
                "found {} from peak to peak where the command moves by {} {unit}, \
                 expected at most {MOST_TRAVEL} times the command",
                plain(position),
                plain(command)
            )?,
            Excess::Period(period) => write!(
                f,
                "found a sampling period of {} s, expected {} to {} s",
                plain(period),
                PERIODS.start(),
                PERIODS.end()
            )?,
        }
        let Some(source) = source else {
            // Of a time that no file has: a rate was given.
            return match self.found {
                Excess::Period(_) => {
                    let [lowest, highest] =
                        [PERIODS.end(), PERIODS.start()].map(|period| period.recip().round());
                    write!(f, ": a rate of {lowest} to {highest} Hz")
                }
                _ => Ok(()),
            };
        };
        match looks_like {
            Some(Unit { name, symbol, .. }) => {
                write!(
                    f,
                    "; it looks like {name}: convert with {}",
                    option(&format!("{column}={source}[{symbol}]"))
                )?;
            }
            None if matches!(self.found, Excess::Period(_)) => {}
            None => write!(
                f,
                "; it looks like sensor counts: give the scale in {unit} per count, as in {}",
                option(&format!("{column}={source}*1.5e-5"))
            )?,
        }
        if matches!(self.found, Excess::Period(_)) {
            write!(f, "; if it is so, say it with {}", option(&format!("{column}={source}[{unit}]")))?;
        }
        Ok(())
    }
}

/// The index of the sample that breaks rule 1, and what is suspected.
pub(super) fn magnitude(info: &ChannelInfo, series: &Series) -> Option<(usize, Suspicion)> {
    // A clock may count from any day.
    let is_time = info.channel == Channel::Time;
    let origin = series.values.first().filter(|_| is_time).copied().unwrap_or(0.0);
    let (index, largest) = series
        .values
        .iter()
        .map(|value| (value - origin).abs())
        .enumerate()
        .filter(|(_, value)| !value.is_nan())
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    if largest <= info.plausible {
        return None;
    }
    let present = || series.values.iter().filter(|value| !value.is_nan());
    let whole = present().all(|value| value.fract() == 0.0);
    let counts = whole && !is_time && largest > COUNTS_FROM * info.plausible;
    let above = present().filter(|value| (*value - origin).abs() > info.plausible).count();
    let is_rare = !is_time && (above as f64) < RARE * present().count() as f64;
    let found = Excess::Magnitude { largest, limit: info.plausible, rare: is_rare.then_some(above as u32) };
    let looks_like = match () {
        () if is_time => unit_of_step(median_step(&series.values), series.factor),
        () if counts => None,
        () => smaller_unit(series, largest, info.plausible),
    };
    Some((index, suspicion(info, series, found, looks_like)))
}

/// The first series that breaks rule 2, and what is suspected.
pub(super) fn travel(all: &[Series]) -> Option<(&Series, Suspicion)> {
    let find = |channel| all.iter().find(|series| series.channel == channel);
    if find(Channel::Drive).is_some() {
        return None;
    }
    let command = find(Channel::Command)?;
    let unit = command.channel.info().unit;
    let asked = peak_to_peak(&command.values);
    all.iter()
        .filter(|series| {
            let info = series.channel.info();
            info.unit == unit && info.role == ChannelRole::Measured
        })
        .find_map(|series| {
            let position = peak_to_peak(&series.values);
            let info = series.channel.info();
            (asked > 0.0 && position > MOST_TRAVEL * asked).then(|| {
                let looks_like = smaller_unit(series, position, MOST_TRAVEL * asked);
                (series, suspicion(info, series, Excess::Travel { position, command: asked }, looks_like))
            })
        })
}

/// The command, and how far the position goes, m, where one stands still and the other does not: not where a driving force
/// replaces the valve, nor where a load moves the jack.
pub(super) fn still_command(all: &[Series]) -> Option<(&Series, f64)> {
    let find = |channel| all.iter().find(|series| series.channel == channel);
    let moves = |channel| find(channel).is_some_and(|series| peak_to_peak(&series.values) > 0.0);
    let command = find(Channel::Command).filter(|series| peak_to_peak(&series.values) == 0.0)?;
    let travel = travel_of_most(&find(Channel::UserPosition)?.values);
    let is_moved = find(Channel::Drive).is_some() || moves(Channel::Load);
    (travel > AT_REST && !is_moved).then_some((command, travel))
}

/// What is suspected of a time whose samples are `period`, s, apart, if that breaks rule 3.
pub(super) fn period(period: f64, time: &Series) -> Option<Suspicion> {
    let looks_like = unit_of_step(period, time.factor);
    let suspect = || suspicion(Channel::Time.info(), time, Excess::Period(period), looks_like);
    (!PERIODS.contains(&period)).then(suspect)
}

fn suspicion(
    info: &ChannelInfo,
    series: &Series,
    found: Excess,
    looks_like: Option<&'static Unit>,
) -> Suspicion {
    let source = match &series.field {
        Field::Column { name, .. } | Field::Variable(name) => Some(name.clone()),
        Field::Channel(_) => None,
    };
    Suspicion { found, looks_like, column: info.column, unit: info.unit, source }
}

/// The unit of a time whose steps are so long, s, as it was converted: the largest smaller one in which a logger may take
/// them.
fn unit_of_step(step: f64, factor: f64) -> Option<&'static Unit> {
    let (raw, factor) = (step / factor, factor.abs());
    units_of(Channel::Time.info()).find(|unit| unit.factor < factor && PERIODS.contains(&(raw * unit.factor)))
}

/// The largest unit, a thousandth of what a series was converted from or less, that brings `value` down to `limit`.
fn smaller_unit(series: &Series, value: f64, limit: f64) -> Option<&'static Unit> {
    let factor = series.factor.abs();
    units_of(series.channel.info())
        .find(|unit| unit.factor <= 1e-3 * factor && value / factor * unit.factor <= limit)
}

/// Largest minus smallest value; 0 where there is none.
fn peak_to_peak(values: &[f64]) -> f64 {
    let (low, high) = values
        .iter()
        .filter(|value| !value.is_nan())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)));
    (high - low).max(0.0)
}

/// Travel of a position but for its spikes.
fn travel_of_most(values: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let cut = (sorted.len() as f64 * SPIKES) as usize;
    peak_to_peak(sorted.get(cut..sorted.len() - cut).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(channel: Channel, values: &[f64]) -> Series {
        Series::in_memory(channel, values.to_vec())
    }

    fn looks_like(values: &[f64]) -> Option<&'static str> {
        let info = Channel::UserPosition.info();
        magnitude(info, &series(info.channel, values))
            .map(|(_, s)| s.looks_like.map_or("counts", |unit| unit.symbol))
    }

    #[test]
    fn magnitudes_are_named_by_what_they_look_like() {
        assert_eq!(looks_like(&[0.1, f64::NAN, -0.4]), None);
        assert_eq!(looks_like(&[0.5, 9.0]), Some("mm"));
        assert_eq!(looks_like(&[0.0, 3.0]), Some("mm"), "whole millimetres");
        assert_eq!(looks_like(&[2040.0, 2051.0]), Some("counts"));
        assert_eq!(looks_like(&[9012.5, 100.0]), Some("um"));
    }

    #[test]
    fn a_mark_of_a_lost_sample_is_no_unit() {
        let said = |marks: usize| {
            let mut values = vec![1e-3; 100];
            values[..marks].fill(-9999.0);
            let info = Channel::UserPosition.info();
            let (_, suspicion) = magnitude(info, &series(info.channel, &values)).expect("too large");
            Suspicion { source: Some("pos".to_owned()), ..suspicion }.to_string()
        };
        assert!(said(3).contains("in 3 samples only: where it stands for one that is lost"), "{}", said(3));
        assert!(!said(3).contains("it looks like") && said(20).contains("it looks like"), "{}", said(20));
    }

    #[test]
    fn a_unit_is_that_of_the_file() {
        let mapped = |factor: f64, values: &[f64]| {
            let converted = values.iter().map(|value| value * factor).collect();
            let series = Series { factor, ..Series::in_memory(Channel::UserPosition, converted) };
            magnitude(series.channel.info(), &series)
                .map(|(_, s)| s.looks_like.map_or("counts", |unit| unit.symbol))
        };
        assert_eq!(mapped(1e-2, &[9012.5, 100.0]), Some("um"));
        assert_eq!(mapped(-1e-3, &[9012.5, 100.0]), Some("um"));
        assert_eq!(mapped(1e-6, &[9012.5, 100.0]), None);
        let step = |factor: f64| unit_of_step(1e6 * factor, factor).map(|unit| unit.symbol);
        assert_eq!(
            [step(1.0), step(1e-3), step(1e-6), step(1e-9)],
            [Some("ns"), Some("ns"), Some("ns"), None]
        );
    }

    #[test]
    fn channels_without_smaller_units_look_like_counts() {
        let info = Channel::Load.info();
        let found = magnitude(info, &series(info.channel, &[2.5e7]));
        assert!(found.is_some_and(|(_, s)| s.looks_like.is_none()));
    }

    #[test]
    fn small_motion_in_millimetres_is_found_beside_the_command() {
        let command = series(Channel::Command, &[0.0, 0.001]);
        let position = series(Channel::UserPosition, &[0.0, f64::NAN, 0.97]);
        let drive = series(Channel::Drive, &[0.0, 1.0]);
        let found = travel(&[command.clone(), position.clone()]).map(|(_, s)| s.looks_like.map(|u| u.symbol));
        assert_eq!(found, Some(Some("mm")));
        assert!(travel(&[command, position.clone(), drive]).is_none(), "the force drives, not the command");
        assert!(
            travel(&[series(Channel::Command, &[0.0, 0.0]), position]).is_none(),
            "no command to compare"
        );
    }

    #[test]
    fn a_command_that_stands_still_is_found_beside_a_position_that_moves() {
        let still = series(Channel::Command, &[1e-3; 200]);
        let moving: Vec<f64> = (0..200).map(|k| 1e-2 * (f64::from(k) * 0.1).sin()).collect();
        let position = series(Channel::UserPosition, &moving);
        let travel = |all: &[Series]| still_command(all).map(|(_, travel)| travel);
        let found = travel(&[still.clone(), position.clone()]).expect("found");
        assert!((found / 2e-2 - 1.0).abs() < 0.01, "{found}");
        // The controls: a command that moves, a force or a load that does, a position that is held but for a spike.
        let with = |channel| series(channel, &[&moving[..199], &[1.0]].concat());
        assert_eq!(travel(&[with(Channel::Command), position.clone()]), None);
        for channel in [Channel::Drive, Channel::Load] {
            assert_eq!(travel(&[still.clone(), position.clone(), with(channel)]), None, "{channel:?}");
        }
        let constant_load = series(Channel::Load, &[100.0; 200]);
        assert!(travel(&[still.clone(), position, constant_load]).is_some());
        let mut held = vec![1e-3; 200];
        held[7] = 2e-2;
        held[9] = 1.05e-3;
        assert_eq!(travel(&[still, series(Channel::UserPosition, &held)]), None);
    }
}
