//! The series of a file before they are a record: the checks that every source has to pass.

use eha_monitor::channel::{Channel, ChannelRole};

use super::error::{Field, Problem, RecordError};
use super::mapping::UnitFrom;
use super::time_base::{Grid, Resolution, is_rate_of, median_step, on_grid, rate_if_lost, uniform};
use super::{Loaded, MIN_SAMPLES, ReadOptions, Record, plausible};
use crate::output::{plain, quantity};

/// The values of one channel, in its unit, and where they came from. NaN is a missing sample.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) channel: Channel,
    pub(super) field: Field,
    /// Unit of the channel per unit in which the values were.
    pub(super) factor: f64,
    /// What says so.
    pub(super) unit: UnitFrom,
    pub(super) values: Vec<f64>,
}

impl Series {
    /// Values that come from no file.
    pub(super) fn in_memory(channel: Channel, values: Vec<f64>) -> Self {
        let field = Field::Channel(channel.info().column);
        Self { channel, field, factor: 1.0, unit: UnitFrom::Name, values }
    }
}

/// The series of a file, one value per sample in each.
#[derive(Clone, Debug)]
pub(super) struct Table {
    /// Path or label.
    pub(super) file: String,
    /// The line of each sample, in a text file.
    pub(super) lines: Option<Vec<u64>>,
    /// How finely time is given.
    pub(super) resolution: Resolution,
    /// In the order of the channel table; may or may not have [`Channel::Time`].
    pub(super) series: Vec<Series>,
    /// What the user should know.
    pub(super) warnings: Vec<String>,
}

impl Table {
    /// The record of the samples in the window of `options`, if it passes every check.
    pub(super) fn into_loaded(mut self, options: &ReadOptions) -> Result<Loaded, RecordError> {
        self.check_shape()?;
        for series in &self.series {
            self.check_finite(series)?;
        }
        self.drop_repeats();
        let length = self.series.first().map_or(0, |series| series.values.len());
        let time = self.series.iter().position(|series| series.channel == Channel::Time);
        let has_time = time.is_some();
        let time = match (time.map(|index| self.series.remove(index)), options.sample_rate_hz) {
            (Some(time), _) => time,
            (None, Some(rate)) if rate.is_finite() && rate > 0.0 => {
                Series::in_memory(Channel::Time, (0..length).map(|index| index as f64 / rate).collect())
            }
            (None, rate) => {
                let period = rate.map_or(f64::NAN, f64::recip);
                return Err(RecordError::new(&self.file, Problem::BadPeriod(period)));
            }
        };
        let whole = [time.values.first(), time.values.last()].map(|stamp| stamp.copied().unwrap_or(f64::NAN));
        let time = self.cut(time, options);
        if time.values.len() < MIN_SAMPLES && length >= MIN_SAMPLES {
            let [first, last] = whole;
            let problem = Problem::ShortSegment { found: time.values.len(), first, last };
            return Err(RecordError::new(&self.file, problem));
        }
        self.check_length(time.values.len())?;
        self.check_magnitude(&time)?;
        let is_in_seconds = has_time && matches!(time.unit, UnitFrom::Mapping | UnitFrom::Row);
        let clock = uniform(&time.values, self.resolution);
        // Of stamps that are uniform but for their rounding, most steps may be those of another rate.
        let is_of_rows = |rate| match clock {
            Ok((_, period)) => !is_rate_of(period, rate) && is_rate_of(median_step(&time.values), rate),
            Err(_) => true,
        };
        let is_on_grid = options.sample_rate_hz.is_some_and(is_of_rows);
        let clock = match (clock, options.sample_rate_hz) {
            (_, Some(rate)) if is_on_grid => on_grid(&time.values, rate).map(|grid| {
                self.spread(&grid, &time.field, rate);
                (grid.start, rate.recip())
            }),
            (clock, rate) => {
                if clock.is_ok() && rate.is_some() && has_time {
                    self.warn(&format!("the sampling rate is not used: {} gives the time", time.field));
                } else if let (Ok((_, period)), Some(rate)) = (&clock, rate_if_lost(&time.values)) {
                    self.warn(&format!(
                        "{}: {} Hz, whose stamps are rounded: where they are not, and rows are lost, say `--rate {}`",
                        time.field,
                        plain(period.recip().round()),
                        plain(rate.round())
                    ));
                }
                clock
            }
        };
        let (start, period) = clock.map_err(|(index, problem)| self.at(&time, index, problem))?;
        self.drop_dead();
        self.check_values()?;
        if let Some(suspicion) = plausible::period(period, &time).filter(|_| !is_in_seconds) {
            let error = RecordError::new(&self.file, Problem::Implausible(suspicion));
            return Err(if has_time { error.in_field(time.field.clone()) } else { error });
        }
        self.report_missing();
        self.report_still_command();
        let Self { file, series, warnings, .. } = self;
        Ok(Loaded { record: Record::of_checked(file, period, start, series), warnings })
    }

    /// Keeps the samples in the window of `options` and returns their times.
    fn cut(&mut self, mut time: Series, options: &ReadOptions) -> Series {
        if options.from_s.is_none() && options.to_s.is_none() {
            return time;
        }
        let from = options.from_s.unwrap_or(f64::NEG_INFINITY);
        let to = options.to_s.unwrap_or(f64::INFINITY);
        let keep: Vec<bool> = time.values.iter().map(|&t| in_window(t, from, to)).collect();
        retain(&mut time.values, &keep);
        self.retain(&keep);
        time
    }

    /// Keeps some of the samples.
    fn retain(&mut self, keep: &[bool]) {
        for series in &mut self.series {
            retain(&mut series.values, keep);
        }
        if let Some(lines) = &mut self.lines {
            retain(lines, keep);
        }
    }

    /// Leaves out measured channels that say nothing: without a value, or with the same one in every sample. A position
    /// that is asked for is looked at later.
    fn drop_dead(&mut self) {
        let mut series = std::mem::take(&mut self.series);
        series.retain(|series| {
            if series.channel.info().role != ChannelRole::Measured || series.channel.info().required {
                return true;
            }
            let found = match constant(&series.values) {
                Some(value) => format!("the same value {} in every sample", plain(value)),
                None if missing(&series.values) == series.values.len() => "no value".to_owned(),
                None => return true,
            };
            self.warn(&format!("{}: not used: it has {found}", series.field));
            false
        });
        self.series = series;
    }

    /// Leaves out rows that are the one before them once more, their time too.
    fn drop_repeats(&mut self) {
        let Some(time) = self.series.iter().find(|series| series.channel == Channel::Time) else { return };
        let same = |values: &[f64], row: usize| {
            let [before, after] = [values[row - 1], values[row]];
            before == after || before.is_nan() && after.is_nan()
        };
        let is_new = |row: usize| row == 0 || !self.series.iter().all(|series| same(&series.values, row));
        let keep: Vec<bool> = (0..time.values.len()).map(is_new).collect();
        let Some(first) = keep.iter().position(|keep| !keep) else { return };
        let count = keep.iter().filter(|keep| !**keep).count();
        let place = match self.lines.as_ref().and_then(|lines| lines.get(first)) {
            Some(line) => format!("line {line}"),
            None => format!("sample {}", first + 1),
        };
        let rows = if count == 1 { "1 row repeats" } else { &format!("{count} rows repeat") };
        self.warn(&format!("{rows} the one before, time and all: left out, the first at {place}"));
        self.retain(&keep);
    }

    /// Puts the rows on a grid of a rate. Of rows that are lost the sensors have no sample, and the inputs are bridged.
    fn spread(&mut self, grid: &Grid, time: &Field, rate: f64) {
        let length = grid.points.last().map_or(0, |last| last + 1);
        for series in &mut self.series {
            let mut spread = vec![f64::NAN; length];
            for (&point, &value) in grid.points.iter().zip(&series.values) {
                spread[point] = value;
            }
            if series.channel.info().role != ChannelRole::Measured {
                bridge(&mut spread);
            }
            series.values = spread;
        }
        // The line of a lost row is that of the one before it.
        if let Some(lines) = &mut self.lines {
            let last_before = |point| grid.points.partition_point(|&other| other <= point) - 1;
            *lines = (0..length).map(|point| lines[last_before(point)]).collect();
        }
        let lost = length - grid.points.len();
        self.warn(&format!(
            "{time}: put on a grid of {rate} Hz, by up to {:.3} ms; {lost} of {length} rows are lost, the inputs bridged",
            grid.off * 1e3
        ));
    }

    /// Every check that does not need the time: also those of a record that was made in memory.
    pub(super) fn check(&self) -> Result<(), RecordError> {
        self.check_shape()?;
        for series in &self.series {
            self.check_finite(series)?;
        }
        self.check_length(self.series.first().map_or(0, |series| series.values.len()))?;
        self.check_values()
    }

    fn check_length(&self, samples: usize) -> Result<(), RecordError> {
        if samples < MIN_SAMPLES {
            return Err(RecordError::new(&self.file, Problem::TooFewSamples(samples)));
        }
        Ok(())
    }

    fn check_shape(&self) -> Result<(), RecordError> {
        let expected = self.series.first().map_or(0, |series| series.values.len());
        match self.series.iter().find(|series| series.values.len() != expected) {
            Some(series) => {
                let found = series.values.len();
                Err(RecordError::new(&self.file, Problem::UnequalLength { found, expected })
                    .in_field(series.field.clone()))
            }
            None => Ok(()),
        }
    }

    /// No infinity anywhere, and missing samples in measured channels only.
    fn check_finite(&self, series: &Series) -> Result<(), RecordError> {
        let measured = series.channel.info().role == ChannelRole::Measured;
        let wrong = |value: &f64| !(value.is_finite() || value.is_nan() && measured);
        let Some(index) = series.values.iter().position(wrong) else { return Ok(()) };
        let problem = match series.values[index] {
            value if value.is_nan() && self.lines.is_some() => Problem::Blank,
            value => Problem::NotFinite(value.to_string()),
        };
        Err(self.at(series, index, problem))
    }

    /// Magnitudes, missing samples, motion.
    fn check_values(&self) -> Result<(), RecordError> {
        for series in &self.series {
            self.check_magnitude(series)?;
        }
        if let Some((series, suspicion)) = plausible::travel(&self.series) {
            return Err(
                RecordError::new(&self.file, Problem::Implausible(suspicion)).in_field(series.field.clone())
            );
        }
        for series in &self.series {
            let samples = series.values.len();
            let blank = missing(&series.values);
            let problem = if samples - blank < MIN_SAMPLES {
                Problem::TooManyBlanks { blank, samples }
            } else if series.channel == Channel::UserPosition
                && let Some(value) = constant(&series.values)
            {
                Problem::ConstantPosition(value)
            } else {
                continue;
            };
            return Err(RecordError::new(&self.file, problem).in_field(series.field.clone()));
        }
        Ok(())
    }

    fn check_magnitude(&self, series: &Series) -> Result<(), RecordError> {
        match plausible::magnitude(series.channel.info(), series) {
            Some((index, suspicion)) => Err(self.at(series, index, Problem::Implausible(suspicion))),
            None => Ok(()),
        }
    }

    fn report_missing(&mut self) {
        for index in 0..self.series.len() {
            let series = &self.series[index];
            let blank = missing(&series.values);
            if blank > 0 {
                let samples = series.values.len();
                self.warn(&format!("{}: {blank} of {samples} samples are missing", series.field));
            }
        }
    }

    /// A command that is held while a load or a neighbour moves the actuator is one, and so is one that stepped before the
    /// record begins: it is no error.
    fn report_still_command(&mut self) {
        if let Some((command, travel)) = plausible::still_command(&self.series) {
            let travel = quantity(travel, Channel::UserPosition.info().unit);
            self.warn(&format!(
                "{} never changes, and the position moves by {travel}: is it the right column?",
                command.field
            ));
        }
    }

    pub(super) fn warn(&mut self, text: &str) {
        self.warnings.push(format!("{}: {text}", self.file));
    }

    /// A problem at a sample of a series.
    fn at(&self, series: &Series, index: usize, problem: Problem) -> RecordError {
        let error = RecordError::new(&self.file, problem).in_field(series.field.clone());
        match self.lines.as_ref().and_then(|lines| lines.get(index)) {
            Some(&line) => error.at_line(line),
            None => error.at_sample(index + 1),
        }
    }
}

/// Is `time` in `from` (included) to `to` (excluded), s, but for rounding?
pub(super) fn in_window(time: f64, from: f64, to: f64) -> bool {
    let noise = 1e-9 + 1e-12 * time.abs();
    time >= from - noise && time < to - noise
}

/// Keeps the values that are marked.
fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
    let mut kept = keep.iter();
    values.retain(|_| kept.next().is_some_and(|&kept| kept));
}

/// How many samples are missing.
pub(super) fn missing(values: &[f64]) -> usize {
    values.iter().filter(|value| value.is_nan()).count()
}

/// Bridges what is missing of an input: by the cubic through the two samples on each side, or what there is of them.
pub(super) fn bridge(values: &mut [f64]) {
    let there: Vec<usize> = (0..values.len()).filter(|&sample| !values[sample].is_nan()).collect();
    let (Some(&first), Some(&last)) = (there.first(), there.last()) else { return };
    for before in 0..there.len() - 1 {
        let nodes = &there[before.saturating_sub(1)..(before + 3).min(there.len())];
        for sample in there[before] + 1..there[before + 1] {
            let apart = |a: usize, b: usize| a as f64 - b as f64;
            let weight = |node: usize| -> f64 {
                let others = nodes.iter().filter(|&&other| other != node);
                others.map(|&other| apart(sample, other) / apart(node, other)).product()
            };
            values[sample] = nodes.iter().map(|&node| weight(node) * values[node]).sum();
        }
    }
    let [begin, end] = [values[first], values[last]];
    values[..first].fill(begin);
    values[last..].fill(end);
}

/// The value that every sample has, if it is one.
fn constant(values: &[f64]) -> Option<f64> {
    let mut present = values.iter().copied().filter(|value| !value.is_nan());
    let first = present.next()?;
    present.all(|value| value == first).then_some(first)
}
