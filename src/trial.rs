//! A trial: samples of an actuator whose faults are known, as its sensors would give them.
//!
//! The firmware and the host make the same samples from the same seed, bit for bit, and see what an identification
//! makes of them.

use crate::channel::Channel;
use crate::command::Command;
use crate::fit::problem::{Record, Start};
use crate::fit::walk::Walk;
use crate::integrate::Stepper;
use crate::model::Model;
use crate::random::Random;
use crate::scalar::Real;

/// Standard deviations of the sensors' noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise<T> {
    /// User position, m.
    pub user: T,
    /// Servo-valve current, mA.
    pub current: T,
}

macro_rules! typical {
    ($($scalar:ty),*) => {
        $(impl SensorNoise<$scalar> {
            /// Of the sensors that the design assumes.
            pub const TYPICAL: Self = Self { user: 5e-6, current: 0.02 };
        })*
    };
}
typical!(f32, f64);

/// Samples of command, user position and current, `COUNT` of each, from rest at 0 m.
#[derive(Clone, Debug)]
pub struct Samples<T, const COUNT: usize> {
    period: T,
    start: Start<T>,
    command: [T; COUNT],
    user: [T; COUNT],
    current: [T; COUNT],
}

impl<T: Real, const COUNT: usize> Samples<T, COUNT> {
    /// A buffer in which nothing has been sampled yet.
    pub const fn new() -> Self {
        Self {
            period: T::ZERO,
            start: Start { time: T::ZERO, ram: T::ZERO, velocity: T::ZERO },
            command: [T::ZERO; COUNT],
            user: [T::ZERO; COUNT],
            current: [T::ZERO; COUNT],
        }
    }

    /// Samples a model that follows a command, every `period` s, without noise.
    pub fn take<S: Stepper<T>>(
        &mut self,
        model: &Model<T>,
        stepper: &mut S,
        command: &Command<T>,
        period: T,
    ) {
        self.period = period;
        for (sample, value) in (0_u32..).zip(&mut self.command) {
            *value = command.at(period * T::from_count(sample));
        }
        let record = Record::new(period, &self.command, &self.start);
        let mut walk = Walk::new(model, &record);
        stepper.begin(period, false, true);
        let mut places = self.user.iter_mut().zip(&mut self.current);
        walk.lead_on(&record, stepper, &mut [], COUNT, |_, outputs, _| {
            if let Some((user, current)) = places.next() {
                (*user, *current) = (outputs.user, outputs.current);
            }
        });
    }

    /// Adds bell-shaped noise to user position and current.
    pub fn disturb(&mut self, noise: &SensorNoise<T>, seed: u64) {
        let mut random = Random::new(seed);
        for (user, current) in self.user.iter_mut().zip(&mut self.current) {
            *user += noise.user * random.bell::<T>();
            *current += noise.current * random.bell::<T>();
        }
    }

    /// The samples as a record to be fitted, with the noise to be assumed.
    pub fn record(&self, noise: &SensorNoise<T>) -> Record<'_, T> {
        Record::new(self.period, &self.command, &self.start)
            .with(Channel::UserPosition, &self.user, noise.user)
            .with(Channel::Current, &self.current, noise.current)
    }
}

impl<T: Real, const COUNT: usize> Default for Samples<T, COUNT> {
    fn default() -> Self {
        Self::new()
    }
}
