//! A second-order step for every model, smooth or piecewise affine.
//!
//! All states are advanced with rates at the middle of the step. The ram's velocity, whose time constant
//! `MJ/(AJ^2 GPQ)` is 62 us, is taken by the implicit midpoint rule; with either fluid form that is a closed formula
//! (see [`Fluid::metering_pressure`](crate::model::fluid::Fluid::metering_pressure)).

use super::{Run, Step, Stepper};
use crate::model::Model;
use crate::model::state::{Input, Mode, State};
use crate::scalar::Real;

/// Time in which what an event stirs up (flapper: 2.5 ms, jack: 62 us) dies down, s.
const CALM: f64 = 3e-3;

/// Steps by the midpoint rule: a longest one, and a quarter of it while an event and its transient pass.
#[derive(Clone, Copy, Debug)]
pub struct Midpoint<T> {
    longest_step: T,
    finest: T,
    units: u32,
    calm: u32,
}

impl<T: Real> Midpoint<T> {
    /// Equal steps in every sample, as few as keep each at or below a longest step, s (at most a million).
    pub const fn new(longest_step: T) -> Self {
        Self { longest_step, finest: longest_step, units: 4, calm: 0 }
    }
}

impl<T: Real> Stepper<T> for Midpoint<T> {
    const TOP: usize = 1;
    const SHIFT: u32 = 2;

    fn takes(&self, _: &Model<T>) -> bool {
        true
    }

    fn begin(&mut self, sample_period: T, _: bool, _: bool) {
        // A hundredth of a step is forgiven, so that 1 ms in steps of 1 us is 1000 in every precision.
        let due = sample_period - self.longest_step * T::literal(1e-2);
        let mut steps: u32 = 1;
        while steps < 1_000_000 && T::from_count(steps) * self.longest_step < due {
            steps += 1;
        }
        self.units = 4 * steps;
        self.finest = sample_period / T::from_count(self.units);
        self.calm = 0;
        while self.calm < 4_000_000 && T::from_count(self.calm) * self.finest < T::literal(CALM) {
            self.calm += 16;
        }
    }

    fn units(&self) -> u32 {
        self.units
    }

    fn calm(&self) -> u32 {
        self.calm
    }

    fn unit(&self) -> T {
        self.finest
    }

    fn enter(&mut self, _: &Model<T>, _: &Run<T>) {}

    #[inline]
    fn step(
        &self,
        model: &Model<T>,
        mode: &Mode,
        state: &State<T>,
        input: &Input<T>,
        force_rate: T,
        level: usize,
    ) -> Step<T> {
        let step = if level == 0 { self.finest } else { self.finest * T::literal(4.0) };
        Step::exact(model.midpoint_step(mode, state, input, force_rate, step))
    }
}
