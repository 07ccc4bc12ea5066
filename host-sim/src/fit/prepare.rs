//! A record made ready for the core: inputs joined, start state found, settling marked.

use super::colour::{as_white, in_differences};
use super::effort::Effort;
use super::measured::{CURRENT, RAM, USER};
use super::noise::{
    MODEL_ERROR, command_step, correlation_time, differences, least_noise_of_series, noise_of, present,
    quantum, rms,
};
use crate::record::Record;
use crate::rig::{Knots, Rig};
use eha_monitor::channel::Channel;
use eha_monitor::fit::problem::{Record as CoreRecord, Start};
use eha_monitor::model::Drive;
use eha_monitor::model::drive::Law;
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::{Parameter, Parameters};
use std::f64::consts::{PI, SQRT_2};
use std::slice;

const MEASURED: usize = Channel::MEASURED.len();
/// Samples that are averaged for the position at a start that is not the commanded one.
const START_SAMPLES: usize = 5;
/// Standard deviations of the noise by which the first sample of a record that starts at rest at its command may differ
/// from it: a chance of 6e-5.
const START_SIGMA: f64 = 4.0;
/// Standard deviations of the noise below its limit from which on a recorded current is taken to be at it.
const LIMIT_SIGMA: f64 = 5.0;
/// Time after which a closed loop has forgotten a start that was only measured, s, at the earliest.
const SETTLE_S: f64 = 0.1;
/// How far the ram may be from the user at a start that was only measured, m, where no backlash is declared.
const START_REACH: f64 = 1e-4;
/// Time at the start of a record from which a first value of an offset of the command is taken, s.
const OFFSET_S: f64 = 0.5;
/// Pieces that are cut from a long record, their length, s, and how much of it is not compared, s.
const PIECES: usize = 8;
const PIECE_S: f64 = 0.75;
const PIECE_SETTLE_S: f64 = 0.15;
/// Half width, in samples, of the line that gives position and velocity at a restart.
const RESTART_REACH: usize = 12;

/// The series of a record, owned, with what a fit needs to know beside them.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Sample period, s.
    pub sample_period: f64,
    command: Vec<f64>,
    arriving: Vec<f64>,
    ahead: Vec<f64>,
    force: Vec<f64>,
    measured: [Vec<f64>; MEASURED],
    /// Standard deviation of the noise of each measured channel, in its unit, or of the white noise that weighs as much
    /// where it is coloured; infinite where it is absent or not used.
    pub noise: [f64; MEASURED],
    /// What neighbouring samples of each measured channel share of their noise, from 0 (white) to below 1.
    pub colour: [f64; MEASURED],
    starts: Vec<Start<f64>>,
    stretch: usize,
    settle: usize,
    offset_unknown: bool,
    law: Option<Law<f64>>,
    holds: bool,
    drive: Vec<f64>,
    /// What a prediction of each measured channel may be off, rms, in its unit, by the steps in which the command was
    /// recorded.
    pub lost: [f64; MEASURED],
    /// The steps in which the sensor of each measured channel is read; none where they are finer than a model's own error.
    pub steps: [Option<Steps>; MEASURED],
    /// Stretches that are not compared, because too few samples are there to tell where they start.
    pub unstarted: usize,
    /// The account of what is spent on it.
    pub(super) effort: Effort,
}

/// The steps in which a sensor is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// One of them, in the channel's unit.
    pub step: f64,
    /// What the channel may be off by them, rms, in its unit, as far as the noise that is stated, or that a record shows at
    /// least, leaves it.
    pub error: f64,
}

impl Prepared {
    /// The view that the core fits.
    pub fn as_core(&self) -> CoreRecord<'_, f64> {
        CoreRecord {
            sample_period: self.sample_period,
            command: &self.command,
            arriving: &self.arriving,
            ahead: &self.ahead,
            force: &self.force,
            holds: self.holds,
            law: self.law,
            measured: std::array::from_fn(|index| self.measured[index].as_slice()),
            noise: self.noise,
            stretch: self.stretch,
            starts: &self.starts,
            settle: self.settle,
            offset_unknown: self.offset_unknown,
        }
    }

    /// Pieces from all over a record that is long: enough to search with, in a time that does not grow with its length.
    /// None where the record is short enough itself.
    ///
    /// Each piece starts anew from the measured position and velocity, and is compared once that is forgotten.
    pub fn excerpt(&self) -> Option<Self> {
        let is_whole = self.stretch >= self.len();
        let (stretch, settle) = if is_whole {
            let samples = |seconds: f64| (seconds / self.sample_period) as usize;
            (samples(PIECE_S).max(1), samples(PIECE_SETTLE_S))
        } else {
            (self.stretch, self.settle)
        };
        let available = self.len() / stretch;
        let wanted = (PIECES as f64 * PIECE_S / (stretch as f64 * self.sample_period)) as usize;
        if available < 2 * wanted.max(1) {
            return None;
        }
        let start = |at: usize| match at / stretch {
            piece if !is_whole || piece == 0 => Some(self.starts[piece]),
            _ => moving_start(&self.measured[0], at, self.sample_period),
        };
        let (at, starts): (Vec<usize>, Vec<Start<f64>>) = (0..wanted.max(1))
            .map(|piece| piece * available / wanted.max(1) * stretch)
            .filter_map(|at| Some((at, start(at)?)))
            .unzip();
        let cut = |values: &Vec<f64>| -> Vec<f64> {
            at.iter().filter_map(|&at| values.get(at..at + stretch)).flatten().copied().collect()
        };
        Some(Self { stretch, settle, ..self.cut(cut, starts) })
    }

    /// The first samples of the record, so many of them; one at least.
    pub fn begin(&self, samples: usize) -> Self {
        let cut = |values: &Vec<f64>| values[..samples.max(1).min(values.len())].to_vec();
        self.cut(cut, self.starts.clone())
    }

    /// The same of a part of every series, which starts so.
    fn cut(&self, cut: impl Fn(&Vec<f64>) -> Vec<f64>, starts: Vec<Start<f64>>) -> Self {
        Self {
            command: cut(&self.command),
            arriving: cut(&self.arriving),
            ahead: cut(&self.ahead),
            force: cut(&self.force),
            measured: self.measured.each_ref().map(&cut),
            drive: cut(&self.drive),
            starts,
            effort: self.effort.clone(),
            ..*self
        }
    }

    /// The same record, its command on the path that a rig says. It must be on straight lines now: the samples
    /// themselves.
    ///
    /// The current of a controller at a sample answers the sample, and the model's the knot beside it: the recorded one
    /// is taken there, unless it is at its limit, or so close to it that noise may show it below.
    #[must_use]
    pub fn along(&self, rig: &Rig) -> Self {
        let Knots { command, arriving, ahead } = rig.knots(&self.command);
        let Parameters { proportional_gain, current_limit, .. } = rig.parameters;
        let mut measured = self.measured.clone();
        let noise = if self.noise[CURRENT].is_finite() { self.noise[CURRENT] } else { 0.0 };
        let below_limit = current_limit - LIMIT_SIGMA * noise;
        let moved =
            command.iter().zip(&self.command).map(|(knot, sample)| proportional_gain * (knot - sample));
        for (current, moved) in measured[CURRENT].iter_mut().zip(moved) {
            if current.abs() < below_limit {
                *current += moved;
            }
        }
        Self { command, arriving, ahead, measured, ..self.clone() }
    }

    /// The same record, knowing what its command may have lost to the step in which it was recorded: that much error of
    /// a prediction is noise, of as many samples as it stays the same.
    fn with_losses(mut self, rig: &Rig, step: f64) -> Self {
        let moved = self.moved_within(step);
        let [as_recorded, moved] =
            [&self, &moved].map(|record| super::glimpse(rig, slice::from_ref(record)).concat());
        for channel in 0..MEASURED {
            let changes: Vec<f64> = differences(&as_recorded, &moved, channel).collect();
            let lost = rms(changes.iter().copied());
            let repeats = correlation_time(&[changes]);
            self.lost[channel] = lost;
            self.noise[channel] = self.noise[channel].hypot(lost * repeats.sqrt());
        }
        self
    }

    /// The same record with the error that each sensor's steps cause. While the motion rests, a sensor that is read in steps
    /// repeats one and the same rounding error, unless noise of its own spreads the readings over several steps. That error
    /// is taken to be the first harmonic of the rounding saw tooth, reduced by the noise: by what the rig states, else by what
    /// the record shows at least.
    fn with_steps_of_sensors(mut self, rig: &Rig) -> Self {
        for channel in 0..MEASURED {
            let step = quantum(&present(&self.measured[channel]));
            if step > MODEL_ERROR[channel] {
                let stated = rig.noise_of(Channel::MEASURED[channel]);
                let noise = stated.unwrap_or_else(|| least_noise_of_series(&self.measured[channel]));
                let noise = (noise.powi(2) - step * step / 12.0).max(0.0) / (step * step);
                let error = step / PI * (-2.0 * PI * PI * noise).exp() / SQRT_2;
                self.steps[channel] = Some(Steps { step, error });
            }
        }
        self
    }

    /// The same record, whose noise was taken for white, with noise of a colour. Where it is not known but was
    /// estimated, the estimate saw a part of it only.
    #[must_use]
    pub fn coloured(&self, colour: [f64; MEASURED], is_known: [bool; MEASURED]) -> Self {
        let noise = std::array::from_fn(|channel| {
            let seen = if is_known[channel] { 1.0 } else { in_differences(colour[channel]) };
            self.noise[channel] / seen * as_white(colour[channel])
        });
        Self { noise, colour, ..self.clone() }
    }

    /// Standard deviation of the noise of each measured channel, of all of it, in its unit.
    pub fn noise_rms(&self) -> [f64; MEASURED] {
        std::array::from_fn(|channel| self.noise[channel] / as_white(self.colour[channel]))
    }

    /// The same record with its command moved by as much as it may have lost to a step, and as fast as it crosses
    /// steps: up on even ones, down on odd ones.
    fn moved_within(&self, step: f64) -> Self {
        let lost = step / 12.0_f64.sqrt();
        let is_even = |value: f64| (value / step).round() % 2.0 == 0.0;
        let moved_by: Vec<f64> =
            self.command.iter().map(|&value| if is_even(value) { lost } else { -lost }).collect();
        let moved = |values: &[f64]| values.iter().zip(&moved_by).map(|(value, by)| value + by).collect();
        Self { command: moved(&self.command), arriving: moved(&self.arriving), ..self.clone() }
    }

    /// Time at the start of a record of one stretch that is not compared, while the start is forgotten, s.
    pub fn settling_s(&self) -> f64 {
        if self.stretch < self.len() { 0.0 } else { self.settle as f64 * self.sample_period }
    }

    /// Samples at which the command jumps.
    pub fn jumps(&self) -> Vec<usize> {
        let jumps = |&sample: &usize| {
            let ends = (self.arriving.get(sample), self.command.get(sample));
            let is_between = self.ahead.get(sample).is_some_and(|&ahead| ahead > 0.0);
            matches!(ends, (Some(arriving), Some(command)) if arriving != command) && !is_between
        };
        (1..self.len()).filter(jumps).collect()
    }

    /// The same record without its measured samples of a time, s, from each jump of its command on.
    #[must_use]
    pub fn without_jumps(&self, answer: f64) -> Self {
        let longest = (answer / self.sample_period) as usize;
        let mut measured = self.measured.clone();
        for jump in self.jumps() {
            let answer = jump..(jump + longest).min(self.len());
            for values in measured.iter_mut().filter(|values| !values.is_empty()) {
                values[answer.clone()].fill(f64::NAN);
            }
        }
        Self { measured, ..self.clone() }
    }

    /// The same record, its command jumping ahead of some samples by shares of the ones before, from 0 to below 1.
    #[must_use]
    pub fn with_jumps_ahead(&self, jumps: impl IntoIterator<Item = (usize, f64)>) -> Self {
        let mut ahead = self.ahead.clone();
        ahead.resize(self.len(), 0.0);
        for (sample, share) in jumps {
            ahead[sample] = share;
        }
        Self { ahead, ..self.clone() }
    }

    /// Samples after which a closed loop that starts at rest has forgotten that: it is where it would be had it moved
    /// as measured, the ram off the user by half of the largest backlash to either side. The other faults are in the
    /// middle of their ranges.
    fn forgets(&self, rig: &Rig, moving: Start<f64>) -> usize {
        let mut rig = rig.clone();
        let mut reach = START_REACH;
        for fault in &rig.faults {
            if fault.parameter == Parameter::Backlash {
                reach = 0.5 * fault.upper;
            } else {
                rig.parameters.set(fault.parameter, 0.5 * (fault.lower + fault.upper));
            }
        }
        let from = |start: Start<f64>| {
            let record = Self { starts: vec![start], ..self.clone() };
            super::predict(&rig, slice::from_ref(&record)).concat()
        };
        let at_rest = from(self.starts[0]);
        let differs = |other: &[Outputs<f64>], channel: usize| {
            let limit = MODEL_ERROR[channel];
            let far = differences(&at_rest, other, channel).enumerate().filter(|(_, by)| by.abs() > limit);
            far.last().map_or(0, |(sample, _)| sample + 1)
        };
        let known = (0..MEASURED).filter(|&channel| self.noise[channel].is_finite());
        let others = [-reach, reach].map(|off| from(Start { ram: moving.ram + off, ..moving }));
        known.flat_map(|channel| others.each_ref().map(|other| differs(other, channel))).max().unwrap_or(0)
    }

    /// Is its command the same, between the samples too, as that of another one?
    pub fn flies_as(&self, other: &Self) -> bool {
        self.command == other.command && self.arriving == other.arriving && self.ahead == other.ahead
    }

    /// How long it is, s.
    pub fn duration(&self) -> f64 {
        self.len() as f64 * self.sample_period
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.command.len()
    }

    /// Has it no sample?
    pub fn is_empty(&self) -> bool {
        self.command.is_empty()
    }

    /// Values of a measured channel, empty where absent.
    pub fn measured(&self, index: usize) -> &[f64] {
        &self.measured[index]
    }

    /// Driving force as recorded, N; empty where a valve drives.
    pub fn drive(&self) -> &[f64] {
        &self.drive
    }

    /// Do command and user position differ by a constant that nobody knows?
    pub const fn offset_unknown(&self) -> bool {
        self.offset_unknown
    }

    /// The known controller that closes the loop.
    pub const fn law(&self) -> Option<Law<f64>> {
        self.law
    }

    /// Is a sample compared with the model?
    pub fn is_compared(&self, sample: usize) -> bool {
        self.as_core().is_compared(sample)
    }

    /// Samples of a measured channel that are compared with the model: none where the record lacks it.
    pub fn compared(&self, channel: usize) -> usize {
        let samples = self.measured[channel].iter().enumerate();
        samples.filter(|(sample, value)| value.is_finite() && self.is_compared(*sample)).count()
    }

    /// Samples between the start of its stretch and a sample.
    pub fn since_start(&self, sample: usize) -> usize {
        sample % self.stretch
    }

    /// Time of a sample in the record that it comes from, s.
    pub fn time(&self, sample: usize) -> f64 {
        self.starts[sample / self.stretch].time + self.since_start(sample) as f64 * self.sample_period
    }

    /// Commanded position, m.
    pub fn command(&self) -> &[f64] {
        &self.command
    }
}

/// Makes a record ready for a rig; the noise is what the rig states or the record shows. A command loses nothing to the
/// step in which it was recorded where a controller that is known takes its samples as they are.
pub fn prepare(rig: &Rig, record: &Record) -> Prepared {
    let prepared = prepare_with(rig, record, noise_of(rig, record)).with_steps_of_sensors(rig);
    let command = record.channel(Channel::Command).filter(|_| rig.controller.is_none());
    match command.map_or(0.0, command_step) {
        0.0 => prepared,
        step => prepared.with_losses(rig, step),
    }
}

/// Makes a record ready for a rig, given the noise of its measured channels.
///
/// Where the rig says that commands carry an offset, what the first half second shows of it is removed; the rest is the
/// fit's.
///
/// A closed loop starts at rest where the command is, if the first sample agrees with that (the next ones may be moving
/// already); else where the first samples are, and nothing is compared before it has forgotten that (0.1 s or more, at
/// most half of the record). An open loop starts anew from the measured position and velocity at each restart, and a
/// known controller closes the loop from those at the start on: its first 0.1 s is not compared.
pub fn prepare_with(rig: &Rig, record: &Record, noise: [f64; MEASURED]) -> Prepared {
    let values = |channel: Channel| record.channel(channel).map(<[f64]>::to_vec);
    let mut command = values(Channel::Command).unwrap_or_default();
    let position = values(Channel::UserPosition).unwrap_or_default();
    // Where the ram is measured, that says where it starts: the user's sensor may have an offset.
    let (ram, ram_noise) = match values(Channel::RamPosition) {
        Some(ram) if noise[RAM].is_finite() => (ram, noise[RAM]),
        _ => (position.clone(), noise[USER]),
    };
    let load = values(Channel::Load);
    let drive = values(Channel::Drive).filter(|_| rig.form.drive == Drive::Force);
    let law = rig.controller;
    let force = match (drive.as_ref().filter(|_| law.is_none()), load) {
        (Some(drive), Some(load)) => drive.iter().zip(load).map(|(drive, load)| drive - load).collect(),
        (Some(drive), None) => drive.clone(),
        (None, Some(load)) => load.into_iter().map(|load| -load).collect(),
        (None, None) => Vec::new(),
    };
    let sample_period = record.sample_period_s();
    if rig.command_offset {
        let window = (OFFSET_S / sample_period) as usize;
        let differences: Vec<f64> = position
            .iter()
            .zip(&command)
            .take(window)
            .map(|(x, com)| x - com)
            .filter(|d| d.is_finite())
            .collect();
        let offset = differences.iter().sum::<f64>() / differences.len().max(1) as f64;
        for value in &mut command {
            *value += offset;
        }
    }
    let settled = ((SETTLE_S / sample_period) as usize).min(command.len() / 4);
    let restart = rig.restart_s.map(|seconds| ((seconds / sample_period).round() as usize).max(2));
    let mut measured = Channel::MEASURED.map(|channel| values(channel).unwrap_or_default());
    let mut unstarted = 0;
    let (starts, stretch, settle) = if law.is_some() {
        (vec![first_start(&position, sample_period)], command.len(), settled)
    } else if let Some(stretch) = restart {
        let start = |at: usize| {
            moving_start(&position, at, sample_period).unwrap_or_else(|| {
                unstarted += 1;
                for values in measured.iter_mut().filter(|values| !values.is_empty()) {
                    values[at..(at + stretch).min(position.len())].fill(f64::NAN);
                }
                Start::default()
            })
        };
        ((0..command.len()).step_by(stretch).map(start).collect(), stretch, 1)
    } else {
        let first: Vec<f64> = ram.iter().copied().filter(|x| x.is_finite()).take(START_SAMPLES).collect();
        let mean = first.iter().sum::<f64>() / first.len().max(1) as f64;
        let commanded = command.first().copied().unwrap_or(mean);
        let at_command = first.first().is_none_or(|x| (x - commanded).abs() <= START_SIGMA * ram_noise);
        if at_command {
            (vec![Start { ram: commanded, ..Start::default() }], command.len(), 0)
        } else {
            (vec![Start { ram: mean, ..Start::default() }], command.len(), settled)
        }
    };
    let drive = drive.unwrap_or_default();
    let on_lines = Prepared {
        sample_period,
        command,
        arriving: Vec::new(),
        ahead: Vec::new(),
        force,
        measured,
        noise,
        colour: [0.0; MEASURED],
        starts,
        stretch,
        settle,
        offset_unknown: rig.command_offset,
        law,
        holds: rig.drive_holds,
        drive,
        lost: [0.0; MEASURED],
        steps: [None; MEASURED],
        unstarted,
        effort: Effort::default(),
    };
    let mut prepared = on_lines.along(rig);
    if law.is_none() && restart.is_none() && settle > 0 {
        let moving = first_start(&ram, sample_period);
        prepared.settle = prepared.forgets(rig, moving).clamp(settle, prepared.len() / 2);
    }
    prepared
}

/// Position and velocity at the first sample; at rest where the first one that is there is, if too few are there at first.
fn first_start(position: &[f64], sample_period: f64) -> Start<f64> {
    let first = || position.iter().copied().find(|value| value.is_finite()).unwrap_or_default();
    moving_start(position, 0, sample_period).unwrap_or_else(|| Start { ram: first(), ..Start::default() })
}

/// Time, position and velocity at a sample, from a parabola through the samples around it; none where these tell the position
/// no better than a single sample would.
fn moving_start(position: &[f64], at: usize, sample_period: f64) -> Option<Start<f64>> {
    let low = at.saturating_sub(RESTART_REACH);
    let high = (at + RESTART_REACH + 1).min(position.len());
    let points: Vec<(f64, f64)> = (low..high)
        .filter(|&k| position[k].is_finite())
        .map(|k| ((k as f64 - at as f64) * sample_period, position[k]))
        .collect();
    // Normal equations of a parabola, in time scaled to the reach.
    let scale = RESTART_REACH as f64 * sample_period;
    let mut matrix = nalgebra::Matrix3::zeros();
    let mut side = nalgebra::Vector3::zeros();
    for (time, value) in points {
        let basis = nalgebra::Vector3::new(1.0, time / scale, (time / scale) * (time / scale));
        matrix += basis * basis.transpose();
        side += basis * value;
    }
    let inverse = matrix.cholesky()?.inverse();
    let solution = inverse * side;
    let is_told = inverse[(0, 0)] <= 1.0;
    is_told.then_some(Start {
        time: at as f64 * sample_period,
        ram: solution[0],
        velocity: solution[1] / scale,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_whose_start_nothing_tells_is_not_compared() {
        let rig = Rig { restart_s: Some(0.1), ..Rig::load("force-axis").unwrap() };
        let prepared = |lost: std::ops::Range<usize>| {
            let mut position: Vec<f64> = (0..500).map(|k| 0.1 * (f64::from(k) * 0.01).sin()).collect();
            let command = position.clone();
            position[lost].fill(f64::NAN);
            let drive = vec![1.0; 500];
            let channels =
                vec![(Channel::Command, command), (Channel::UserPosition, position), (Channel::Drive, drive)];
            prepare_with(&rig, &Record::new("made", 1e-3, 0.0, channels).unwrap(), [1e-6; MEASURED])
        };
        let compared = |prepared: &Prepared| {
            let stretches = prepared.measured[USER].chunks(prepared.stretch);
            stretches.map(|stretch| stretch.iter().any(|value| value.is_finite())).collect::<Vec<_>>()
        };
        let reach = RESTART_REACH;
        let blind = prepared(200 - reach..200 + reach);
        assert_eq!((blind.unstarted, compared(&blind)), (1, vec![true, true, false, true, true]));
        let seen = prepared(200 - reach..200);
        assert_eq!((seen.unstarted, compared(&seen)), (0, vec![true; 5]));
        assert!((seen.starts[2].ram - 0.1 * 2.0_f64.sin()).abs() < 1e-6, "{:?}", seen.starts[2]);
    }
}
