//! A model walked along a record: one prediction a sample.

use super::problem::{Record, Start};
use crate::integrate::{Run, Stepper};
use crate::model::Model;
use crate::model::state::{Input, InputSegment, Outputs};
use crate::scalar::Real;
use crate::simulate::{Actuator, Follower, Motion};

/// A model's place in a record.
#[derive(Clone, Copy, Debug)]
pub struct Walk<T> {
    actuator: Actuator<T>,
    motion: Motion<T>,
    sample_rate: T,
    sample: usize,
    /// First sample of the stretch, and its time, s.
    origin: (usize, T),
}

impl<T: Real> Walk<T> {
    /// The start of a record.
    pub fn new(model: &Model<T>, record: &Record<'_, T>) -> Self {
        let actuator = Actuator::new(*model, record.sample_period);
        let motion = actuator.at_rest(T::ZERO, &Input::default());
        Self { actuator, motion, sample_rate: T::ONE / record.sample_period, sample: 0, origin: (0, T::ZERO) }
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

    /// The same with followers, which start anew where the walk does.
    #[inline]
    pub fn lead<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        stepper: &mut S,
        followers: &mut [Option<Follower<T>>],
    ) -> Option<(usize, Outputs<T>)> {
        let sample = self.sample;
        let command = *record.command.get(sample)?;
        let force_at = |index: usize| record.force.get(index).copied().unwrap_or(T::ZERO);
        let input;
        if sample.is_multiple_of(record.stretch.max(1)) {
            input = Input { command, command_rate: T::ZERO, force: force_at(sample) };
            let start = record.starts.get(sample / record.stretch.max(1)).copied().unwrap_or_default();
            self.origin = (sample, start.time);
            self.motion = self.started(&start, &input);
            for follower in followers.iter_mut().flatten() {
                follower.restart(self.motion.user);
            }
        } else {
            let previous = record.command.get(sample - 1).copied().unwrap_or(command);
            let segment = InputSegment::between(
                [previous, command],
                [force_at(sample - 1), force_at(sample)],
                self.origin.1 + record.sample_period * T::from_count((sample - 1 - self.origin.0) as u32),
                self.sample_rate,
            );
            self.actuator.lead(stepper, &mut self.motion, &segment, followers);
            input = Input { command, force: force_at(sample), ..segment.start };
        }
        self.sample += 1;
        Some((sample, self.actuator.measure(&mut self.motion, &input)))
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
        Motion::resuming(Run::starting(model, state, mode, input), start.ram)
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
