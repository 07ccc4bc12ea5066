//! The second stage and the jack's chambers: from spool opening and ram velocity to the differential pressure.

use super::state::side;
use crate::parameter::Parameters;
use crate::scalar::Real;

/// Constants of the fluid block.
#[derive(Clone, Copy, Debug)]
pub struct Fluid<T> {
    /// Pressure gain `GP`, Pa/m, at the supply ratio.
    pressure_gain: T,
    /// Flow gain `GQ` of the linear form, m^2/s, at the supply ratio.
    flow_gain: T,
    /// Flow gain of the metering form, m^2/s: its root of `PSR/PSR0` brings the supply ratio in.
    metering_gain: T,
    /// `1/GPQ + Clk`, m^3/(s Pa).
    conductance: T,
    /// `1/(1 + GPQ Clk)`.
    leak_factor: T,
    /// `GPQ AJ`, Pa s/m.
    damping: T,
    /// Supply over return `PSR`, Pa.
    pub supply: T,
    /// Rated supply `PSR0`, Pa.
    rated_supply: T,
    /// Blend from the linear (0) to the square-root form (1).
    blend: T,
    /// Jack area, m^2.
    area: T,
    /// `4 beta/Vt`, Pa/m^3; 0 for incompressible oil.
    bulk_stiffness: T,
    /// Return pressure, Pa.
    return_pressure: T,
    /// Vapour pressure, Pa.
    vapour_pressure: T,
}

impl<T: Real> Fluid<T> {
    /// The fluid of a set of parameters at a supply ratio `k`: pressure gain times `k`, flow gain times `sqrt(k)`.
    pub fn new(p: &Parameters<T>, supply_ratio: T) -> Self {
        let pressure_gain = p.pressure_gain * supply_ratio;
        let flow_gain = p.flow_gain * supply_ratio.root();
        let gpq = pressure_gain / flow_gain;
        // Vt = 2 AJ XJM
        let volume = T::literal(2.0) * p.jack_area * p.jack_stop;
        Self {
            pressure_gain,
            flow_gain,
            metering_gain: p.flow_gain,
            conductance: T::ONE / gpq + p.leakage,
            leak_factor: T::ONE / (T::ONE + gpq * p.leakage),
            damping: gpq * p.jack_area,
            supply: p.supply_pressure * supply_ratio,
            rated_supply: p.supply_pressure,
            blend: p.metering_blend,
            area: p.jack_area,
            bulk_stiffness: if p.oil_compliance > T::ZERO {
                T::literal(4.0) / (p.oil_compliance * volume)
            } else {
                T::ZERO
            },
            return_pressure: p.return_pressure,
            vapour_pressure: p.vapour_pressure,
        }
    }

    /// Is the oil compressible, so that the pressure is a state?
    #[inline(always)]
    pub fn is_compressible(&self) -> bool {
        self.bulk_stiffness > T::ZERO
    }

    /// Is the linear form in use?
    #[inline(always)]
    pub fn is_linear(&self) -> bool {
        self.blend == T::ZERO
    }

    /// Pressure of the linear form before its limit, Pa: `(GP XS - GPQ AJ v)/(1 + GPQ Clk)`.
    #[inline(always)]
    pub fn linear_pressure(&self, opening: T, velocity: T) -> T {
        (self.pressure_gain * opening - self.damping * velocity) * self.leak_factor
    }

    /// Pressure of the linear form in a mode of its limit, Pa.
    #[inline(always)]
    pub fn limited_pressure(&self, mode: i8, opening: T, velocity: T, one: T) -> T {
        self.limited(mode, self.linear_pressure(opening, velocity), one)
    }

    /// What a mode of its limit makes of the pressure of the linear form, Pa.
    #[inline(always)]
    pub fn limited(&self, mode: i8, pressure: T, one: T) -> T {
        if mode == 0 { pressure } else { side::<T>(mode) * self.supply * one }
    }

    /// Pressure of the linear form in a mode of its limit, Pa, and its slope with the velocity, Pa s/m.
    #[inline(always)]
    pub fn limited_law(&self, mode: i8, opening: T, velocity: T) -> (T, T) {
        let slope = if mode == 0 { -self.damping * self.leak_factor } else { T::ZERO };
        (self.limited_pressure(mode, opening, velocity, T::ONE), slope)
    }

    /// Pressure in the middle of a step whose velocity depends on it, `v = velocity + compliance * P12`, Pa, for
    /// either form of incompressible fluid.
    #[inline(always)]
    pub fn implicit_pressure(&self, mode: i8, opening: T, velocity: T, compliance: T) -> T {
        if !self.is_linear() {
            self.metering_pressure(opening, velocity, compliance)
        } else if mode == 0 {
            self.linear_pressure(opening, velocity) / (T::ONE + self.leak_factor * self.damping * compliance)
        } else {
            side::<T>(mode) * self.supply
        }
    }

    /// Largest magnitude of the differential pressure in the metering form, Pa: there the chamber that empties
    /// reaches the vapour pressure, `PRV + (PSR - P12)/2 = PVap`.
    pub fn cavitation_limit(&self) -> T {
        self.supply + T::literal(2.0) * (self.return_pressure - self.vapour_pressure)
    }

    /// Pressures of the two chambers, Pa: `PRV + (PSR +- P12)/2`, not below the vapour pressure.
    pub fn chamber_pressures(&self, differential: T) -> [T; 2] {
        let half = T::literal(0.5);
        [
            (self.return_pressure + (self.supply + differential) * half).larger(self.vapour_pressure),
            (self.return_pressure + (self.supply - differential) * half).larger(self.vapour_pressure),
        ]
    }

    /// Pressure that satisfies the metering law when the ram velocity itself depends on it,
    /// `v = velocity + compliance * P12`, Pa.
    #[inline]
    pub fn metering_pressure(&self, opening: T, velocity: T, compliance: T) -> T {
        self.metering_law(opening, velocity, compliance).0
    }

    /// Pressure of the metering law, Pa, and its slope with the velocity, Pa s/m.
    ///
    /// With `y = sqrt((PSR - s P12)/PSR0)`, `s = sgn(XS)`, the law
    /// `AJ v = GQ XS ((1 - b) + b y) - (1/GPQ + Clk) P12` is a quadratic in `y` with one root that is not negative.
    #[inline]
    pub fn metering_law(&self, opening: T, velocity: T, compliance: T) -> (T, T) {
        let sign = if opening < T::ZERO { -T::ONE } else { T::ONE };
        let opening = opening.magnitude();
        let slope = self.area * compliance + self.conductance;
        let a = slope * self.rated_supply;
        let b = self.metering_gain * opening * self.blend;
        let c = self.flow_gain * opening * (T::ONE - self.blend)
            - sign * self.area * velocity
            - slope * self.supply;
        let limit = self.cavitation_limit();
        let (pressure, rate) = if c >= T::ZERO {
            // The throttle passes nothing (y = 0): what the ram displaces leaves through the conductance.
            (sign * (self.supply + c / slope), -self.area / slope)
        } else {
            // The stable form of the root: y = -2c/(b + sqrt(b^2 - 4ac)).
            let root = (b * b - T::literal(4.0) * a * c).root();
            let y = -T::literal(2.0) * c / (b + root);
            let rate = -T::literal(2.0) * self.rated_supply * self.area * y / root;
            (sign * (self.supply - self.rated_supply * y * y), rate)
        };
        let within = pressure.saturate(limit);
        (within, if within == pressure { rate } else { T::ZERO })
    }

    /// Rate of the pressure of compressible oil, Pa/s: `4 beta/Vt (Q - AJ v - Clk P12)`.
    #[inline(always)]
    pub fn pressure_rate(&self, opening: T, velocity: T, pressure: T) -> T {
        if self.is_linear() {
            self.linear_pressure_rate(opening, velocity, pressure)
        } else {
            self.bulk_stiffness
                * (self.metered_flow(opening, pressure).0
                    - self.area * velocity
                    - self.conductance * pressure)
        }
    }

    /// Rate of the pressure of compressible oil in the linear form, Pa/s.
    #[inline(always)]
    pub fn linear_pressure_rate(&self, opening: T, velocity: T, pressure: T) -> T {
        self.bulk_stiffness * (self.flow_gain * opening - self.area * velocity - self.conductance * pressure)
    }

    /// What the metering form adds to the rate of the pressure of compressible oil over the linear form of a fluid,
    /// Pa/s, and its slope with the pressure, 1/s.
    #[inline]
    pub fn curved_pressure_rate(&self, linear: &Self, opening: T, pressure: T) -> (T, T) {
        let (flow, slope) = if self.is_linear() {
            (self.flow_gain * opening, T::ZERO)
        } else {
            self.metered_flow(opening, pressure)
        };
        let conductance = self.conductance - linear.conductance;
        let excess = flow - linear.flow_gain * opening - conductance * pressure;
        (self.bulk_stiffness * excess, self.bulk_stiffness * (slope - conductance))
    }

    /// Flow through the throttle, m^3/s, and its slope with the pressure, m^3/(s Pa).
    #[inline]
    fn metered_flow(&self, opening: T, pressure: T) -> (T, T) {
        let sign = if opening < T::ZERO { -T::ONE } else { T::ONE };
        let head = ((self.supply - sign * pressure) / self.rated_supply).larger(T::ZERO).root();
        let metered = opening * self.metering_gain * self.blend;
        let flow = opening * self.flow_gain * (T::ONE - self.blend) + metered * head;
        // The root is vertical where it ends; the slope only guides an iteration.
        let steepest = head.larger(T::literal(1e-3));
        (flow, -sign * metered * T::literal(0.5) / (self.rated_supply * steepest))
    }
}
