//! The position controller: `Cor = sat(GAP*e + GAI*int(e) + GAD*de/dt - GAS*dx/dt, CorM)`.

use super::state::{Input, side};
use crate::parameter::Parameters;
use crate::scalar::Real;

/// Gains and limits of the controller.
#[derive(Clone, Copy, Debug)]
pub struct Controller<T> {
    proportional: T,
    integral: T,
    derivative: T,
    velocity: T,
    /// Limit of the current `CorM`, mA.
    pub current_limit: T,
    /// Limit of the integrated error `ErIM`, m s.
    pub integral_limit: T,
}

/// A velocity (m/s) or an acceleration (m/s2) of both that the controller sees.
#[derive(Clone, Copy, Debug)]
pub struct Seen<T> {
    /// Of what is fed back.
    pub fed_back: T,
    /// Of the ram, whatever is fed back.
    pub ram: T,
}

impl<T: Real> Controller<T> {
    /// The controller of a set of parameters.
    pub const fn new(p: &Parameters<T>) -> Self {
        Self {
            proportional: p.proportional_gain,
            integral: p.integral_gain,
            derivative: p.derivative_gain,
            velocity: p.velocity_gain,
            current_limit: p.current_limit,
            integral_limit: p.integral_limit,
        }
    }

    /// Current before its limit, mA, from the fed-back position, the velocities and the integrated error.
    #[inline(always)]
    pub fn demand(&self, input: &Input<T>, position: T, velocity: &Seen<T>, integral: T) -> T {
        self.proportional * (input.command - position)
            + self.integral * integral
            + self.derivative * (input.command_rate - velocity.fed_back)
            - self.velocity * velocity.ram
    }

    /// Current before its limit, mA, of a controller that sees nothing but the position error, m.
    #[inline(always)]
    pub fn proportional_demand(&self, error: T) -> T {
        self.proportional * error
    }

    /// Rate of the demand, mA/s, from the rates of what it is made of.
    #[inline(always)]
    pub fn demand_rate(
        &self,
        input: &Input<T>,
        position: T,
        velocity: &Seen<T>,
        acceleration: &Seen<T>,
    ) -> T {
        self.proportional * (input.command_rate - velocity.fed_back)
            + self.integral * (input.command - position)
            - self.derivative * acceleration.fed_back
            - self.velocity * acceleration.ram
    }

    /// The current that leaves the controller in a mode of its limit; `one` is 1 (see [`super::Model::affine_rate`]).
    #[inline(always)]
    pub fn current(&self, mode: i8, demand: T, one: T) -> T {
        if mode == 0 { demand } else { side::<T>(mode) * self.current_limit * one }
    }

    /// Does the demand follow the rate of the command?
    pub fn sees_rates(&self) -> bool {
        self.derivative != T::ZERO
    }

    /// Does the demand follow nothing but the position error (and its integral)?
    pub fn sees_position_only(&self) -> bool {
        self.derivative == T::ZERO && self.velocity == T::ZERO
    }

    /// Position error at which a proportional controller reaches its limit, m.
    pub fn error_at_limit(&self) -> T {
        self.current_limit / self.proportional
    }

    /// Is the controller purely proportional, so that it needs no state?
    pub fn is_proportional(&self) -> bool {
        self.integral == T::ZERO
    }
}
