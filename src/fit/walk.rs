//! A model walked along a record: one prediction a sample.

use super::problem::{Record, Start};
use crate::integrate::{Run, Stepper};
use crate::model::drive::{Lag, LawState};
use crate::model::state::{Input, InputSegment, Outputs, State};
use crate::model::{Drive, Model};
use crate::scalar::Real;
use crate::simulate::{Actuator, Follower, Motion};

/// A model's place in a record.
#[derive(Clone, Copy, Debug)]
pub struct Walk<T> {
    actuator: Actuator<T>,
    motion: Motion<T>,
    sample_rate: T,
    sample: usize,
    /// Time from which the samples of the stretch count theirs, s: 0 in a record that is whole.
    origin: T,
    /// Samples to come before the walk starts anew.
    left: usize,
    /// Command at the last sample, m.
    command: T,
    lag: Option<Lag<T>>,
    /// The force that lags, at the last sample, N.
    lagging: T,
    law: LawState<T>,
    /// What drives at the last sample, N.
    drive: T,
}

impl<T: Real> Walk<T> {
    /// The start of a record.
    pub fn new(model: &Model<T>, record: &Record<'_, T>) -> Self {
        let actuator = Actuator::new(*model, record.sample_period);
        let motion = actuator.at_rest(T::ZERO, &Input::default());
        let lags = model.form.drive == Drive::Force;
        Self {
            actuator,
            motion,
            sample_rate: T::ONE / record.sample_period,
            sample: 0,
            origin: T::ZERO,
            left: 0,
            command: T::ZERO,
            lag: if lags { Lag::new(model.parameters().drive_lag, record.sample_period) } else { None },
            lagging: T::ZERO,
            law: LawState::coming(T::ZERO, T::ZERO, record.sample_period),
            drive: T::ZERO,
        }
    }

    /// Predicts the next sample: its index and what the channels show; none past the end.
    #[inline]
    pub fn next<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        stepper: &mut S,
    ) -> Option<(usize, Outputs<T>)> {
        self.lead(record, stepper, &mut [])
    }

    /// The next sample and its outputs, with followers, which start anew where the walk does.
    #[inline]
    pub fn lead<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        stepper: &mut S,
        followers: &mut [Option<Follower<T>>],
    ) -> Option<(usize, Outputs<T>)> {
        let sample = self.sample;
        let command = *record.command.get(sample)?;
        let outer = record.force.get(sample).copied().unwrap_or(T::ZERO);
        let input;
        if self.left == 0 {
            let stretch = record.stretch.max(1);
            let start = record.starts.get(sample / stretch).copied().unwrap_or_default();
            self.origin = start.time - record.sample_period * T::from_count(sample as u32);
            self.law = LawState::coming(start.ram, start.velocity, record.sample_period);
            self.drive = outer + self.asked(record, command, &self.actuator.model.at_rest(start.ram));
            self.lagging = self.drive;
            input = Input { command, command_rate: T::ZERO, force: self.drive };
            self.motion = self.started(&start, &input);
            for follower in followers.iter_mut().flatten() {
                follower.start(&self.actuator.model, &self.motion.run.state, start.ram);
            }
            self.left = stretch;
        } else {
            let last = if record.holds || record.law.is_some() { self.drive } else { outer };
            let drive = [self.drive, last];
            let force = self.lag.map_or(drive, |lag| lag.follow(&mut self.lagging, drive));
            let time = self.origin + record.sample_period * T::from_count((sample as u32).saturating_sub(1));
            let arriving = record.arriving(sample)?;
            let mut line = InputSegment::between([self.command, arriving], force, time, self.sample_rate);
            let ahead = record.ahead.get(sample).copied().unwrap_or(T::ZERO);
            if ahead > T::ZERO {
                // Behind the jump the command is on the line of the sample that follows.
                let rise = record.arriving(sample + 1).map_or(T::ZERO, |next| next - command);
                let before = line;
                line = InputSegment::between([command - rise, command], force, time, self.sample_rate);
                let lines = [&before, &line];
                let part = T::ONE - ahead;
                self.actuator.lead_over_jump(stepper, &mut self.motion, lines, part, followers);
            } else {
                self.actuator.lead(stepper, &mut self.motion, &line, followers);
                if arriving != command {
                    let from = Input { command: arriving, ..line.at(record.sample_period) };
                    let time = time + record.sample_period;
                    let to = Input { command, ..from };
                    self.actuator.jump(stepper, &mut self.motion, &from, &to, time);
                }
            }
            self.drive = outer;
            if record.law.is_some() {
                let state = self.motion.run.state;
                self.drive = outer + self.asked(record, command, &state);
            }
            let force = if self.lag.is_some() { self.lagging } else { self.drive };
            input = Input { command, force, ..line.start };
        }
        self.command = command;
        self.left = self.left.saturating_sub(1);
        self.sample += 1;
        Some((sample, self.actuator.measure(&mut self.motion, &input)))
    }

    /// Has the record samples that are not yet predicted?
    pub const fn has_next(&self, record: &Record<'_, T>) -> bool {
        self.sample < record.command.len()
    }

    /// Samples to come before the walk starts anew.
    pub(super) fn left(&self, record: &Record<'_, T>) -> usize {
        if self.left == 0 { record.stretch.max(1) } else { self.left }
    }

    /// Predicts the next samples, at most a number of them, and shows each: its index, what the channels show, and the
    /// followers.
    #[inline]
    pub fn lead_on<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        stepper: &mut S,
        followers: &mut [Option<Follower<T>>],
        most: usize,
        mut show: impl FnMut(usize, &Outputs<T>, &mut [Option<Follower<T>>]),
    ) {
        let end = self.sample.saturating_add(most).min(record.command.len());
        while self.sample < end {
            let first = self.sample;
            let ahead = record.command.get(first..end.min(first + self.left)).unwrap_or(&[]);
            let ahead = ahead.get(..record.unbroken(first, ahead.len())).unwrap_or(&[]);
            if !ahead.is_empty() && record.force.is_empty() && record.law.is_none() {
                let (actuator, motion) = (&self.actuator, &mut self.motion);
                let done =
                    actuator.glide(stepper, motion, self.command, ahead, |offset, passing, outputs| {
                        for follower in followers.iter_mut().flatten() {
                            follower.pass(passing);
                        }
                        show(first + offset, outputs, followers);
                    });
                if let Some(&command) = done.checked_sub(1).and_then(|last| ahead.get(last)) {
                    self.command = command;
                    self.sample += done;
                    self.left -= done;
                    continue;
                }
            }
            let Some((sample, outputs)) = self.lead(record, stepper, followers) else { return };
            show(sample, &outputs, followers);
        }
    }

    /// The force that a known controller asks for, N.
    fn asked(&mut self, record: &Record<'_, T>, command: T, state: &State<T>) -> T {
        record.law.map_or(T::ZERO, |law| self.law.ask(&law, command, state, self.sample_rate))
    }

    fn started(&self, start: &Start<T>, input: &Input<T>) -> Motion<T> {
        if start.velocity == T::ZERO {
            return self.actuator.at_rest(start.ram, input);
        }
        let model = &self.actuator.model;
        let mut state = model.at_rest(start.ram);
        let mut mode = model.mode_at_rest();
        state.ram_velocity = start.velocity;
        mode.jack = if start.velocity < T::ZERO { -1 } else { 1 };
        self.actuator.resuming(Run::starting(model, state, mode, input), start.ram)
    }

    /// What is walked along the record.
    pub const fn actuator(&self) -> &Actuator<T> {
        &self.actuator
    }

    /// Mode changes and steps so far.
    pub const fn effort(&self) -> (u32, u32) {
        (self.motion.run.events, self.motion.run.steps)
    }
}
