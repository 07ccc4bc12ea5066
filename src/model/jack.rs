//! The jack: `MJ v' = AJ P12 - CJ v - F_ext - Kaer x - friction`, with stick-slip and end stops.

use crate::parameter::Parameters;
use crate::scalar::Real;

/// Constants of the jack.
#[derive(Clone, Copy, Debug)]
pub struct Jack<T> {
    /// Area `AJ`, m^2.
    pub area: T,
    mass: T,
    viscous: T,
    quadratic: T,
    spring: T,
    /// End stop `XJM`, m.
    pub stop: T,
    /// Sliding dry friction `FDJ`, N.
    sliding: T,
    /// Breakaway over sliding friction `FSD`.
    breakaway_ratio: T,
    asymmetry: T,
    stribeck_velocity: T,
    /// Load against extension that is always there, N.
    constant_load: T,
    /// Load against extension from its time on, N.
    step_load: T,
    /// When the step load starts, s.
    pub step_load_time: T,
}

impl<T: Real> Jack<T> {
    /// The jack of a set of parameters.
    pub const fn new(p: &Parameters<T>) -> Self {
        Self {
            area: p.jack_area,
            mass: p.load_mass,
            viscous: p.viscous_friction,
            quadratic: p.quadratic_drag,
            spring: p.spring_load,
            stop: p.jack_stop,
            sliding: p.fdj,
            breakaway_ratio: p.breakaway_ratio,
            asymmetry: p.friction_asymmetry,
            stribeck_velocity: p.stribeck_velocity,
            constant_load: p.constant_load,
            step_load: p.step_load,
            step_load_time: p.step_load_time,
        }
    }

    /// Are all of its laws piecewise affine?
    pub fn is_affine(&self) -> bool {
        self.quadratic == T::ZERO && self.stribeck_velocity == T::ZERO
    }

    /// Does a step load exist?
    #[inline(always)]
    pub fn has_step_load(&self) -> bool {
        self.step_load != T::ZERO
    }

    /// Force on the ram other than damping and friction, N, positive in extension.
    #[inline(always)]
    pub fn drive(&self, pressure: T, ram: T, force: T, step_load_on: bool, one: T) -> T {
        let load = if step_load_on { self.constant_load + self.step_load } else { self.constant_load };
        self.area * pressure + force - load * one - self.spring * ram
    }

    /// Magnitude of the friction that is to be overcome at rest, N, in a direction (-1 or 1).
    #[inline(always)]
    pub fn breakaway(&self, direction: T) -> T {
        self.sliding * self.breakaway_ratio * (T::ONE + self.asymmetry * direction)
    }

    /// Friction of the sliding ram, N, positive in extension: Coulomb's, opposite to `direction`.
    #[inline(always)]
    pub fn coulomb(&self, direction: T) -> T {
        -direction * self.sliding * (T::ONE + self.asymmetry * direction)
    }

    /// Acceleration of the sliding ram by the affine laws, m/s^2.
    #[inline(always)]
    pub fn affine_acceleration(&self, drive: T, velocity: T, direction: T, one: T) -> T {
        (drive + self.coulomb(direction) * one - self.viscous * velocity) / self.mass
    }

    /// Forces that are not affine in the velocity (Stribeck, quadratic drag), N, positive in extension.
    #[inline]
    pub fn curved_force(&self, velocity: T, direction: T) -> T {
        let speed = (velocity * direction).larger(T::ZERO);
        let mut force = -direction * self.quadratic * speed * speed;
        if self.stribeck_velocity > T::ZERO {
            force += self.coulomb(direction)
                * (self.breakaway_ratio - T::ONE)
                * (speed / self.stribeck_velocity).exp_negative();
        }
        force
    }

    /// The line on which velocity and pressure lie at the middle of a step:
    /// `v_mid = velocity + compliance * P12` (implicit midpoint), from everything but the pressure's force.
    #[inline(always)]
    pub fn midpoint_line(&self, force_without_pressure: T, velocity: T, step: T) -> (T, T) {
        let half = step * T::literal(0.5);
        let inertia = self.mass + half * self.viscous;
        (
            velocity + half * (force_without_pressure - self.viscous * velocity) / inertia,
            half * self.area / inertia,
        )
    }
}
